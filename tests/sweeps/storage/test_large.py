"""Variables too large for memory go from shard to file; what they hold is what small ones would hold."""

import numpy as np
import pytest
import xarray as xr

from sweeps import Axis, Grid, Sweep, Variable, open_results
from sweeps.plan import batches
from tests.helpers.waves import interrupted

LOG: list[float] = []
BROKEN: dict[str, set] = {"points": set()}
STEP = Axis(np.arange(5.0), "s")
ONE = Axis(["only"])
DIMS = ("step", "one")


@pytest.fixture(autouse=True)
def _in_small_pieces(monkeypatch):
    # Of three points, once the first have told how long they take.
    monkeypatch.setattr(batches, "BATCH_BYTES", 400.0)


def record(points):
    total = sum(values for values in points.values()) + np.pi
    LOG.extend(total.tolist())
    if BROKEN["points"] & set(np.round(total - np.pi, 6).tolist()):
        raise ValueError("no")
    series = total[:, None, None] * np.exp(STEP.values)[:, None]
    return {
        "series": series,
        "rounded": series,
        "state": np.sign(series - 200.0),
        "single": series,
        "peak": series.max(axis=(1, 2)),
    }


def unit(points):
    """The same for points that differ in `c` only."""
    return record({name: values for name, values in points.items() if name != "c"})


VARIABLES = {
    "series": Variable("m", "series", DIMS),
    "rounded": Variable("m", "rounded", DIMS, digits=3),
    "state": Variable("1", "state", DIMS, "int8"),
    "single": Variable("m", "single", DIMS, "float32"),
    "peak": Variable("m", "peak"),
}
SCALED = {
    n: Variable(v.units, v.long_name, v.dims, v.dtype, v.digits, "c" * (n != "state"))
    for n, v in VARIABLES.items()
}
GRID = {"a": [1.0, 4.0], "b": [10.0, 30.0], "c": [100.0, 200.0, 400.0]}


def sweep(values=GRID, function=record, **changes):
    axes = {name: Axis(each, "m") for name, each in values.items()}
    options = {"variables": VARIABLES, "coords": {"step": STEP, "one": ONE}, "grid": Grid(axes)}
    return Sweep("records", function, **(options | changes))


COPIED = {
    "function": unit,
    "key": lambda points: np.stack([points["a"], points["b"]], axis=1),
    "scale": lambda points: {"c": points["c"] / 100.0},
    "variables": SCALED,
}
PLAIN_COPIES = {"function": unit, "key": COPIED["key"]}
CASES = {
    "derived, in another order": {
        "order_by": ("c", "b"),
        "derive": lambda data: data.assign(mean=data["series"].mean("step"), top=data["rounded"].max()),
    },
    "copies": PLAIN_COPIES,
    "copies with factors": COPIED,
    "zipped": {"grid": Grid({name: Axis([1.0, 2.0, 3.0]) for name in "abc"}, zipped=("a", "c"))},
    "skipped": {"grid": Grid({n: Axis(v) for n, v in GRID.items()}, skip=lambda p: p["a"] * p["b"] == 40.0)},
}
GROWN = {"a": [0.0, 1.0, 4.0], "b": [10.0, 20.0, 30.0], "c": [100.0, 150.0, 400.0]}


def runs(path, changes):
    """A file that grows, with a failure, an interruption and a retry on the way."""
    axes = changes.get("grid")
    BROKEN["points"] = {111.0, 11.0}
    yield sweep(**changes).plan(path).run()
    if axes is None:
        interrupted(sweep(GROWN, **changes).plan(path), 3)
        yield open_results(path)
        yield sweep(GROWN, **changes).plan(path).run()
        BROKEN["points"] = set()
        yield sweep(GROWN, **changes).plan(path, retry_failed=True).run()
    BROKEN["points"] = set()
    yield open_results(path)


@pytest.mark.parametrize("case", CASES)
def test_large_variables_are_what_small_ones_are(tmp_path, limits, case):
    found = {}
    for large in (False, True):
        folder = tmp_path / str(large)
        limits(150 if large else 1 << 40)
        LOG.clear()
        found[large] = [data.load().drop_vars("wall_time") for data in runs(folder / "records.nc", CASES[case])]
        assert [p.name for p in folder.iterdir()] == ["records.nc"]
    if "scale" in CASES[case] and len(found[False]) > 1:
        # Large variables are not kept as they were before they were scaled: their new copies are computed again,
        # which a run that is interrupted has not done.
        del found[False][1], found[True][1]
    for small, large in zip(found[False], found[True], strict=True):
        xr.testing.assert_equal(small, large)
        for name in small.variables:
            assert repr(small[name].attrs) == repr(large[name].attrs)
            assert small[name].dtype == large[name].dtype or small[name].dtype.kind == "U"
    with xr.open_dataset(tmp_path / "True" / "records.nc", chunks=None) as data:
        xr.testing.assert_equal(data.drop_vars("wall_time").load(), found[True][-1])


def test_what_is_at_hand_is_not_computed_again(path, limits):
    limits(150)
    for changes, distinct in (({}, 12), (PLAIN_COPIES, 4)):
        LOG.clear()
        sweep(**changes).plan(path, fresh=True).run()
        assert len(LOG) == distinct
        before = path.read_bytes()
        assert sweep(**changes).plan(path).todo == 0
        sweep(**changes).plan(path).run()
        assert path.read_bytes() == before
        LOG.clear()
        whole = sweep(GROWN | {"a": GRID["a"]}, **changes).plan(path).run()
        assert len(LOG) == (2 * 3 * 3 - 2 * 2 * 2 if not changes else 2)
        assert np.all(whole["status"] == 1)
        times = open_results(path)["wall_time"].values
        assert np.count_nonzero(times > 0.0) == distinct + len(LOG)


def test_large_variables_are_read_when_they_are_used(path, limits):
    limits(150)
    seen = {}

    def derive(data):
        seen["in memory"] = data["series"].variable._in_memory
        return data.assign(first=data["series"].isel(step=0, one=0, drop=True))

    found = sweep(derive=derive).plan(path).run()
    assert seen == {"in memory": False}
    assert not found["series"].variable._in_memory
    assert not sweep(GRID | {"b": [30.0]}).plan(path).run()["series"].variable._in_memory
    np.testing.assert_array_equal(found["first"], found["series"].values[..., 0, 0])
    expected = record(sweep().grid.points())["series"]
    np.testing.assert_array_equal(found["series"].values.ravel(), expected.ravel())


@pytest.mark.parametrize("large", [150, 1 << 40])
def test_what_cannot_be_derived_takes_nothing_with_it(path, limits, large):
    limits(large)

    def broken(data):
        raise ArithmeticError(f"no {float(data['series'].max())}")

    with pytest.raises(ArithmeticError, match="no "):
        sweep(derive=broken).plan(path).run()
    LOG.clear()
    xr.testing.assert_equal(open_results(path).load(), sweep().plan(path).run().load())
    assert LOG == []
