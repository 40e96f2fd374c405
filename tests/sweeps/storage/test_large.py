"""Large variables are written in blocks and read when they are used; the file is CF, whatever its size."""

from threading import get_ident

import numpy as np
import pytest
import xarray as xr

from sweeps import Axis, Sweep, Variable, open_results, status
from sweeps.plan import batches
from sweeps.storage.parts import PartSource
from tests.helpers.state import Chosen, Log
from tests.helpers.waves import interrupted

LOG = Log()
BROKEN = Chosen()
STEP = Axis(np.arange(5.0), "s")


@pytest.fixture(autouse=True)
def _small_batches(monkeypatch):
    """Batches of three points, once the first have told how long they take."""
    LOG.clear()
    BROKEN.clear()
    monkeypatch.setattr(batches, "BATCH_BYTES", 400.0)


def record(points):
    total = sum(values for values in points.values()) + np.pi
    LOG.extend(total.tolist())
    if BROKEN & set(np.round(total - np.pi, 6).tolist()):
        raise ValueError("no")
    series = total[:, None] * np.exp(STEP.values)
    state = np.sign(series - 200.0)
    return {"series": series, "rounded": series, "state": state, "single": series}


VARIABLES = {
    "series": Variable("m", "series", "step"),
    "rounded": Variable("m", "rounded", "step", digits=3),
    "state": Variable("1", "state", "step", "int8", flags={-1: "low", 0: "at the limit", 1: "high"}),
    "single": Variable("m", "single", "step", "float32"),
}
GRID = {"a": [1.0, 4.0], "b": [10.0, 30.0], "c": [100.0, 200.0, 400.0]}
GROWN = {"a": [0.0, 1.0, 4.0], "b": [10.0, 20.0, 30.0], "c": [100.0, 150.0, 400.0]}


def sweep(values=GRID, **changes):
    grid = {name: Axis(each, "m") for name, each in values.items()}
    return Sweep("records", record, grid, VARIABLES, coords={"step": STEP}, **changes)


def add_mean(data):
    return data.assign(mean=data["series"].mean("step"), top=data["rounded"].max())


def runs(path, changes):
    """A file that grows, with a failure, an interruption and a retry on the way."""
    BROKEN.update({111.0, 11.0})
    yield sweep(**changes).plan(path).run()
    interrupted(sweep(GROWN, **changes).plan(path), 3)
    yield open_results(path)
    yield sweep(GROWN, **changes).plan(path).run()
    BROKEN.clear()
    yield sweep(GROWN, **changes).plan(path, retry_failed=True).run()
    yield open_results(path)


CHANGES = {"derive": add_mean, "order_by": ("c", "b"), "key": lambda points: points["a"] + points["c"]}


def test_large_variables_have_the_values_and_attributes_of_small_ones(tmp_path, limits):
    """With copies of points, derived variables and an order of their own."""
    found = {}
    for large in (False, True):
        limits(150 if large else 1 << 40)
        every = runs(tmp_path / str(large) / "records.nc", CHANGES)
        found[large] = [data.load().drop_vars("wall_time") for data in every]
    for small, large in zip(found[False], found[True], strict=True):
        xr.testing.assert_equal(small, large)
        for name in small.variables:
            assert repr(small[name].attrs) == repr(large[name].attrs)
            assert small[name].dtype == large[name].dtype or small[name].dtype.kind == "U"


def test_one_thread_writes_a_file(path, limits, monkeypatch):
    """Two may wait for each other's locks for ever."""
    limits(150)
    threads, original = set(), PartSource.read
    monkeypatch.setattr(PartSource, "read", lambda *each: threads.add(get_ident()) or original(*each))
    sweep().plan(path).run()
    assert threads == {get_ident()}


def test_large_variables_are_read_when_they_are_used(path, limits, monkeypatch):
    """Also of an unfinished run: nothing is copied to a temporary folder; status and plan read no values."""
    limits(150)
    read, seen, original = [], [], PartSource.read
    monkeypatch.setattr(
        PartSource, "read", lambda self, name, *rest: read.append(name) or original(self, name, *rest)
    )
    monkeypatch.setattr("tempfile.mkdtemp", None)
    monkeypatch.setattr("tempfile.mkstemp", None)

    def derive(data):
        seen.append(data["series"].variable._in_memory)
        return data.assign(first=data["series"].isel(step=0, drop=True))

    interrupted(sweep(derive=derive).plan(path), 6)
    before = sorted(path.parent.rglob("*"))
    assert status(path).done == sweep(derive=derive).plan(path).cached == 6
    assert read == []
    partly = open_results(path)
    assert "series" not in read
    some = partly["series"].isel(a=0, b=0, c=0).values
    assert 0 < read.count("series") <= 2
    assert sorted(path.parent.rglob("*")) == before
    found = sweep(derive=derive).plan(path).run()
    assert seen == [False]
    assert not found["series"].variable._in_memory
    assert not sweep(GRID | {"b": [30.0]}).plan(path).run()["series"].variable._in_memory
    np.testing.assert_array_equal(found["first"], found["series"][..., 0])
    np.testing.assert_array_equal(found["series"].values.ravel(), record(sweep().grid.points())["series"].ravel())
    np.testing.assert_array_equal(some, found["series"][0, 0, 0])


@pytest.mark.parametrize("large", [150, 1 << 40])
def test_derive_that_raises_loses_nothing(path, limits, large):
    limits(large)

    def broken(data):
        raise ArithmeticError(f"no {float(data['series'].max())}")

    with pytest.raises(ArithmeticError, match="no "):
        sweep(derive=broken).plan(path).run()
    LOG.clear()
    assert path.exists()
    xr.testing.assert_equal(open_results(path).load(), sweep().plan(path).run().load())
    assert LOG == []
