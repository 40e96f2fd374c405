"""Every file that the project writes is CF: by the compliance checker of IOOS, by UDUNITS, and by plain readers.

The checker knows CF up to 1.11, which is what the files say they follow. No finding is excused.
"""

import re
import shutil
from functools import cache

import netCDF4
import numpy as np
import pytest
import xarray as xr
from compliance_checker.cf import util
from compliance_checker.runner import CheckSuite

from studies import registry
from studies.maps import maps
from studies.scatter.study import scattered
from sweeps import Axis, Grid, Sweep, Variable
from tests import HOME
from tests.helpers import trials
from tests.helpers.boundaries import refine

RESULTS = HOME / "results" / "reference"
KEPT = sorted(RESULTS.glob("*/*.nc"))
VERSION = "1.11"


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
    """Files of every kind that are not among the results: with failures, maps, refined, with a time series."""
    folder = tmp_path_factory.mktemp("cf")
    trials.sweep().plan(folder / "failures.nc").run("sync")
    for name, quantity, halvings, tolerance in (
        ("refined", "growth_rate", 1, 0.1),
        ("whole", "unstable_modes", 0, None),
    ):
        plane = maps.plane_of("theta=-10:20:3", "mu=0:0.5:3", halvings)
        refine(maps.sweep_of(plane, quantity, {}, halvings, tolerance), folder / f"{name}.nc", "sync")
    # Axes that vary together, and nothing said of what anything is.
    zipped = Grid({"x": Axis([1.0, 2.0]), "y": Axis(["left", "right"])}, zipped=("x", "y"))
    bare = Sweep("bare", lambda points: {"z": points["x"]}, zipped, {"z": Variable()}, title="Bare")
    bare.plan(folder / "bare.nc").run("sync")
    # Texts as an axis, one of which fails.
    cases = Grid({"case": Axis(["fine", "µ = 0"], long_name="case"), "size": Axis([1.0, 2.0], "m")})

    def picky(points):
        return {"z": points["size"], "error": [ValueError(c) if c == "µ = 0" else None for c in points["case"]]}

    Sweep("texts", picky, cases, {"z": Variable("m")}, title="Texts").plan(folder / "texts.nc").run("sync")
    plane = maps.plane_of("V=2e-3,5e-3", "mu=0.1,0.2")
    maps.sweep_of(plane, "regime", {"members": 1.0, "most": 0.03}).plan(folder / "regime.nc").run("sync")
    given = {"V": [2e-3, 5e-3], "theta": 5.0, "mu": 0.2, "F": 9.0, "duration": 0.02}
    recorded = registry.load("scenes").sweep(given, record=("velocity_B", "state"), sample_rate=1e3)
    recorded.plan(folder / "recorded.nc").run("sync")
    # Draws, and rows of a table with texts.
    drawn = scattered(registry.load("fig5"), {}, {"mu": "normal:0.05:0.03", "theta": "normal:5:1"}, samples=4)
    drawn.sweep({}).plan(folder / "drawn.nc").run("sync")
    columns = {"numerical_damping": ["none", "published"], "V": [2e-3, 5e-3]}
    del given["V"]
    table = scattered(registry.load("scenes"), given, points=columns)
    table.sweep(given).plan(folder / "table.nc").run("sync")
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


def test_there_are_results_of_every_study():
    assert {path.stem for path in KEPT} == set(registry.NAMES)


@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.stem)
def test_results_pass_the_checker(suite, path):
    assert findings(suite, path) == []


@pytest.mark.parametrize(
    "name", ["failures", "refined", "whole", "bare", "texts", "regime", "recorded", "drawn", "table"]
)
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
    with pytest.raises(ValueError, match="wobbles"):
        cf_units.Unit("wobbles")


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


def test_a_large_file_passes_too(suite, tmp_path, monkeypatch):
    """One whose variables are copied from parts to the file block by block."""
    monkeypatch.setattr("sweeps.storage.assemble.LARGE", 1000)

    def series(points):
        return {"y": points["x"][:, None] * np.arange(100.0)}

    grid = Grid({"x": Axis(np.arange(20.0), "m", "place")})
    coords = {"elapsed": Axis(np.arange(100.0), "s", "time since the start")}
    variables = {"y": Variable("m", "series", ("elapsed",))}
    Sweep("large", series, grid, variables, coords=coords, title="Large").plan(tmp_path / "large.nc").run("sync")
    assert findings(suite, tmp_path / "large.nc") == []
