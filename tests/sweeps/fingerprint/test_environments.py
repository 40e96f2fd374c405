"""Where points were computed: told, compared, and marked where a file holds points of several environments."""

import json
import os
import re
import subprocess
import sys
import warnings

import netCDF4
import numpy as np
import pytest

from sweeps import FAILED, Axis, Grid, InputError, MixedWarning, SchedulerError, Sweep, Variable, open_results
from sweeps.fingerprint import provenance
from sweeps.fingerprint.provenance import environment, environments_of, mixed
from tests import HOME
from tests.helpers.waves import BROKEN, interrupted, product, sweep

OTHER = "numpy .* -> 9.9"
FIRST, MORE = {"x": [1.0, 3.0]}, {"x": [1.0, 2.0, 3.0, 4.0]}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "waves.nc"


@pytest.fixture
def elsewhere(monkeypatch):
    """From the call on, another version of a library."""

    def change(library="numpy", version="9.9"):
        before = provenance._version
        monkeypatch.setattr(provenance, "_version", lambda name: version if name == library else before(name))

    return change


def test_an_environment():
    here = environment()
    assert list(here) == ["python", "numpy", "scipy", "numba", "llvmlite", "blas", "processor"]
    assert here["numpy"] == np.__version__
    # No path of a library, nor anything else of a machine.
    assert "/" not in json.dumps(here)


def test_the_core_type_of_blas_belongs_to_it():
    show = "from sweeps.fingerprint.provenance import environment; print(environment()['blas'])"
    told = [
        subprocess.run(
            [sys.executable, "-c", show],
            cwd=HOME,
            env=os.environ | own,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for own in ({}, {"OPENBLAS_CORETYPE": "Nehalem"})
    ]
    if "openblas" not in told[0]:
        pytest.skip("BLAS is not OpenBLAS here")
    assert "Nehalem" in told[1]
    assert told[0] != told[1]


def test_differences():
    one = environment()
    assert mixed([one, dict(one)]) == ""
    assert mixed([one, one | {"numba": "1"}, one | {"numba": "1"}]) == f"numba {one['numba']} -> 1"
    assert mixed([{"numpy": "1"}, {"scipy": "2"}]) == "numpy 1 -> unknown, scipy unknown -> 2"


def test_what_one_environment_computes_is_marked_by_the_file_alone(path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sweep(FIRST).plan(path).run("sync")
        data = sweep(MORE).plan(path, strict=True).run("sync")
    assert "computed_by" not in data
    assert environments_of(data.attrs) == [environment()]
    assert data.attrs["history"].count(f"numpy {np.__version__}, scipy ") == 2


def test_points_of_another_environment_are_told_and_marked(path, elsewhere):
    sweep(FIRST).plan(path).run("sync")
    here = environment()
    elsewhere()
    plan = sweep(MORE).plan(path)
    assert re.search(f"\nenvironment +{OTHER}; what is there is kept$", repr(plan))
    told = f"^{path}: not all points are computed in one environment: {OTHER}; computed_by says"
    with pytest.warns(MixedWarning, match=told) as seen:
        data = plan.run("sync")
    assert len(seen) == 1
    assert seen[0].filename == __file__
    assert data["computed_by"].values.tolist() == [0, 1, 0, 1]
    assert environments_of(data.attrs) == [here, environment()]
    with netCDF4.Dataset(path) as file:
        assert file["computed_by"].dtype == np.int16
    # What is there is taken as it is; who asks for less gets it with its marks.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert sweep({"x": [4.0, 1.0]}).plan(path).run("sync")["computed_by"].values.tolist() == [1, 0]
    # A third, and one of those before.
    elsewhere(version="9.8")
    with pytest.warns(MixedWarning):
        sweep({"x": [*MORE["x"], 5.0]}).plan(path).run("sync")
    elsewhere()
    with pytest.warns(MixedWarning):
        data = sweep({"x": [*MORE["x"], 5.0, 6.0]}).plan(path).run("sync")
    assert data["computed_by"].values.tolist() == [0, 1, 0, 1, 2, 1]
    assert len(environments_of(data.attrs)) == 3


def test_who_is_strict_gets_nothing_of_another_environment(path, elsewhere):
    sweep(FIRST).plan(path).run("sync")
    before = path.read_bytes()
    elsewhere()
    with pytest.raises(
        InputError, match=f"{OTHER}; choose another folder, start over with fresh, or leave strict"
    ):
        sweep(MORE).plan(path, strict=True).run("sync")
    assert path.read_bytes() == before
    assert os.listdir(path.parent) == [path.name]
    # Nothing is mixed where nothing is computed, or nothing kept.
    sweep(FIRST).plan(path, strict=True).run("sync")
    assert "computed_by" not in sweep(MORE).plan(path, strict=True, fresh=True).run("sync")


def test_parts_of_a_run_that_was_interrupted_are_marked(path, elsewhere, monkeypatch):
    monkeypatch.setattr("sweeps.plan.batches.BATCH_BYTES", 1.0)
    interrupted(sweep(MORE).plan(path), 2)
    elsewhere()
    with pytest.warns(MixedWarning, match=OTHER):
        interrupted(sweep(MORE).plan(path), 1)
    assert open_results(path)["computed_by"].values.tolist() == [0, 0, 1, -1]
    with pytest.warns(MixedWarning, match=OTHER):
        data = sweep(MORE).plan(path).run("sync")
    assert data["computed_by"].values.tolist() == [0, 0, 1, 1]


def test_what_is_computed_again_has_the_mark_of_who_did(path, elsewhere):
    BROKEN["points"] = {(1.0,), (3.0,)}
    data = sweep(FIRST).plan(path).run("sync")
    assert np.all(data["status"] == FAILED)
    BROKEN["points"] = set()
    elsewhere()
    with pytest.warns(MixedWarning, match=OTHER):
        data = sweep(FIRST).plan(path, retry_failed=True).run("sync")
    assert "computed_by" not in data
    assert environments_of(data.attrs) == [environment()]


def scaled(points):
    return {"y": 0.1 + 0.0 * points["a"]}


def ratios(a):
    """A sweep whose points at equal a / b are one computation, scaled by b."""
    grid = Grid({"a": Axis(a), "b": Axis([1.0, 2.0])})
    one = {"key": lambda points: points["a"] / points["b"], "scale": lambda points: {"b": points["b"]}}
    return Sweep("ratios", scaled, grid, {"y": Variable("m", "y", scale="b")}, **one)


@pytest.mark.parametrize("make", [ratios, lambda a: sweep({"x": a, "y": [1.0, 2.0]}, key=product)])
def test_copies_have_the_mark_of_what_was_computed(tmp_path, elsewhere, make):
    path = tmp_path / "copies.nc"
    make([1.0, 2.0]).plan(path).run("sync")
    elsewhere()
    with pytest.warns(MixedWarning):
        make([1.0, 2.0, 4.0]).plan(path).run("sync")
    plan = make([1.0, 2.0, 4.0, 8.0]).plan(path)
    assert plan.cached
    with pytest.warns(MixedWarning):
        data = plan.run("sync")
    by = data["computed_by"].values
    assert np.all(by[:2] == 0)
    assert np.all(by[3] == 1)
    assert set(by[2]) <= {0, 1}


def test_files_that_do_not_say_are_extended(path):
    """Older ones have the versions of all libraries; still older ones nothing."""
    sweep(FIRST).plan(path).run("sync")
    for attributes, told in (
        ({"libraries": json.dumps({"python": "3.10.1", "numpy": "2.0", "matplotlib": "1"})}, "numpy 2.0 -> "),
        ({}, "numpy unknown -> "),
    ):
        with netCDF4.Dataset(path, "a") as file:
            file.delncattr("environments")
            for name in {"checksums"} & set(file.ncattrs()):
                file.delncattr(name)
            file.setncatts(attributes)
        assert "computed_by" not in open_results(path)
        with pytest.warns(MixedWarning, match=told) as seen:
            data = sweep(MORE).plan(path).run("sync")
        assert "matplotlib" not in str(seen[0].message)
        assert data["computed_by"].values.tolist() == [0, 1, 0, 1]
        with pytest.raises(InputError, match=told):
            sweep({"x": [*MORE["x"], 5.0]}).plan(path, strict=True).run("sync")
        path.unlink()
        sweep(FIRST).plan(path).run("sync")


WORKER = """
import sys, distributed
from sweeps.fingerprint import provenance

if __name__ == "__main__":
    if sys.argv[1] == "other":
        before = provenance._version
        provenance._version = lambda name: "9.9" if name == "numpy" else before(name)
    options = {"processes": False, "protocol": "tcp://", "silence_logs": 50, "dashboard_address": None}
    options["scheduler_kwargs"] = {"dashboard_address": "127.0.0.1:0"}
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, **options) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""


@pytest.fixture
def far(tmp_path):
    """A scheduler whose worker has another version of a library."""
    (tmp_path / "worker.py").write_text(WORKER)
    with subprocess.Popen(
        [sys.executable, tmp_path / "worker.py", "other"],
        env=os.environ | {"PYTHONPATH": str(HOME)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        yield process.stdout.readline().strip()
        process.stdin.close()


def test_workers_are_compared(path, tmp_path, far):
    sweep(FIRST).plan(path).run("sync")
    with pytest.raises(InputError, match=OTHER):
        sweep(MORE).plan(path, strict=True).run(far)
    assert not path.with_suffix(".parts").exists()
    with pytest.warns(MixedWarning, match=OTHER):
        data = sweep(MORE).plan(path).run(far)
    assert data["computed_by"].values.tolist() == [0, 1, 0, 1]
    assert [each["numpy"] for each in environments_of(data.attrs)] == [np.__version__, "9.9"]
    # Who hands the points out computes none: one environment is enough for the strict.
    alone = sweep(MORE).plan(tmp_path / "alone.nc", strict=True).run(far)
    assert [each["numpy"] for each in environments_of(alone.attrs)] == ["9.9"]
    assert alone["root"].equals(data["root"])


def test_a_worker_that_joins_later_is_refused_by_who_is_strict(path, far, monkeypatch):
    here = environment()
    monkeypatch.setattr("sweeps.compute.cluster.environments_at", lambda address: [here])
    with pytest.raises(SchedulerError, match=f"a worker joined whose environment is another .*{OTHER}"):
        sweep(MORE).plan(path, strict=True).run(far)
    # Where nobody else computes, nothing is mixed.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        data = sweep(FIRST).plan(path).run(far)
    assert [each["numpy"] for each in environments_of(data.attrs)] == ["9.9"]


def test_workers_that_join_later_are_told_at_the_end(path, far, monkeypatch):
    sweep(FIRST).plan(path).run("sync")
    here = environment()
    monkeypatch.setattr("sweeps.compute.cluster.environments_at", lambda address: [here])
    told = f"^{path}: not all points are computed in one environment: {OTHER}; computed_by says"
    with pytest.warns(MixedWarning, match=told) as seen:
        data = sweep(MORE).plan(path).run(far)
    assert len(seen) == 1
    assert seen[0].filename == __file__
    assert data["computed_by"].values.tolist() == [0, 1, 0, 1]
