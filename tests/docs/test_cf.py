"""Every file that the project writes is CF: by the compliance checker of IOOS, by UDUNITS, and by plain readers.

The checker knows CF up to 1.11, which is what the files say they follow. No finding is excused.
"""

import re
import shutil
from functools import cache

import netCDF4
import pytest
import xarray as xr
from compliance_checker.cf import util
from compliance_checker.runner import CheckSuite

import studies
from studies import registry, runner
from studies.asking.sweep import sweep_of
from sweeps import Axis, Grid, Sweep, Variable
from tests import HOME

RESULTS = HOME / "results" / "reference"
KEPT = sorted(RESULTS.glob("*/*.nc"))
VERSION = "1.11"
# Between them every kind of variable and dimension; the others are checked among the slow tests.
VARIED = ("contact", "robust", "stress")


@pytest.fixture(scope="module")
def suite():
    CheckSuite.load_all_available_checkers()
    with pytest.MonkeyPatch.context() as patch:
        # It asks for the whole file's coordinates at each variable, again and again.
        for name in ("get_coordinate_variables", "get_auxiliary_coordinate_variables", "get_time_variables"):
            patch.setattr(util, name, cache(getattr(util, name)))
        yield CheckSuite()


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    """Files of every kind that are not among the results: failures, maps, rows, words, recorded series."""
    folder = tmp_path_factory.mktemp("cf")
    _, plan = runner.plan_map("theta=-10:20:3", "mu=0:0.5:3", ["growth_rate"], refine=1, tolerance=0.1, out=folder)
    plan.run("sync")
    plan.store.rename(folder / "growth_rate.nc")
    # Axes that vary together, and nothing said of what anything is.
    zipped = Grid({"x": Axis([1.0, 2.0]), "y": Axis(["left", "right"])}, zipped=("x", "y"))
    bare = Sweep("bare", lambda points: {"z": points["x"]}, zipped, {"z": Variable()}, title="Bare")
    bare.plan(folder / "bare.nc").run("sync")
    # Words as an axis, one of which fails.
    cases = Grid({"case": Axis(["fine", "µ = 0"], long_name="case"), "size": Axis([1.0, 2.0], "m")})

    def picky(points):
        if "µ = 0" in points["case"]:
            raise ValueError("µ must be above 0 — always")
        return {"z": points["size"]}

    Sweep("words", picky, cases, {"z": Variable("m")}, title="Words").plan(folder / "words.nc").run("sync")
    values = {"V": [2e-3, 5e-3], "theta": 5.0, "mu": 0.2, "F": 9.0, "duration": 0.02}
    scenes = registry.load("scenes")
    recorded = sweep_of(scenes, values, record=("velocity_B", "state"), sample_rate=1e3)
    recorded.plan(folder / "recorded.nc").run("sync")
    del values["V"]
    rows = {"numerical_damping": ["none", "published"], "V": [2e-3, 5e-3]}
    sweep_of(scenes, values, rows=rows).plan(folder / "rows.nc").run("sync")
    # A fit, some of whose draws cannot be.
    target = {"output": "glued_frequency_2", "value": "460Hz", "within": "10Hz"}
    stated = {"unknown": {"contact_position": "uniform:140:160mm"}, "set": {"theta": 5}, "target": [target]}
    studies.fit(stated, samples=8, rounds=1, out=folder)
    (folder / "fit" / "fit" / "fit.nc").rename(folder / "fit.nc")
    return folder


def findings(suite, path):
    """What the checker has to say against a file."""
    dataset = suite.load_dataset(str(path))
    try:
        ((groups, problems),) = suite.run_all(dataset, [f"cf:{VERSION}"], []).values()
    finally:
        dataset.close()
    assert not problems
    assert len(groups) > 20
    told = []
    for group in groups:
        # What is checked is counted: less than all of it is a finding. Some groups only inform.
        passed, of = group.value if isinstance(group.value, tuple) else (int(bool(group.value)), 1)
        if passed < of:
            told += [f"{group.name}: {text}" for text in group.msgs or ["not passed"]]
    return told


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=[pytest.mark.slow] * (path.stem not in VARIED), id=path.stem) for path in KEPT],
)
def test_results_pass_the_checker(suite, path):
    assert findings(suite, path) == []


@pytest.mark.parametrize("name", ["growth_rate", "bare", "words", "recorded", "rows", "fit"])
def test_what_is_written_now_passes_the_checker(suite, fresh, name):
    assert findings(suite, fresh / f"{name}.nc") == []


def every_file(fresh):
    return [*KEPT, *sorted(fresh.glob("*.nc"))]


def test_units_are_read_by_udunits(fresh):
    cf_units = pytest.importorskip("cf_units", reason="cf-units comes with the compliance checker")
    seen = set()
    for path in every_file(fresh):
        with netCDF4.Dataset(path) as file:
            for name, variable in file.variables.items():
                if hasattr(variable, "units"):
                    seen.add(variable.units)
                else:
                    # Texts and codes have none; a number has.
                    assert variable.dtype.kind == "S" or hasattr(variable, "flag_meanings"), (path, name)
    for units in seen:
        read = cf_units.Unit(units)
        assert not read.is_unknown()
        assert not read.is_no_unit()
        # A time is a time, and no date.
        assert not read.is_time_reference()
    assert {"1", "s", "Hz", "N", "m s-1", "degree", "s-1", "m2 s-1"} <= seen


def test_attributes_that_every_file_has_and_plain_xarray_opens_it_anywhere(fresh, tmp_path):
    for path in every_file(fresh):
        with netCDF4.Dataset(path) as file:
            assert file.Conventions == f"CF-{VERSION}"
            assert file.title
            assert re.search(r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ [\w-]+ computed by \w+", file.history)
            assert path not in KEPT or re.search(r"fiv .* \(commit .*\)", file.source)
            for name, variable in file.variables.items():
                assert variable.long_name, (path, name)
                assert not re.search(r"[^\x20-\x7e]", variable.long_name), (path, name)
                assert name not in file.dimensions or not hasattr(variable, "_FillValue"), (path, name)
        with xr.open_dataset(shutil.copy(path, tmp_path)) as data:
            data.load()
            assert set(data["status"].dims) <= set(data.coords)
            for name, variable in data.variables.items():
                # Nothing is taken for a date.
                assert variable.dtype.kind not in "mM", (path, name)
