"""Points that are one computation: done once, copied to the others, and there multiplied by their own factors."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from sweeps import Axis, Grid, Sweep, Variable, open_results
from sweeps.plan import batches

# What was computed, and which computations fail; not part of a sweep's identity, as arguments would be.
LOG: list[tuple] = []
BROKEN: dict[str, set] = {"keys": set()}
RATIO = 10.0**0.25
STEP = Axis([1, 2, 3])


@pytest.fixture(autouse=True)
def _in_small_pieces(monkeypatch):
    LOG.clear()
    BROKEN["keys"] = set()
    monkeypatch.setattr(batches, "BATCH_BYTES", 400.0)


def key(points):
    """What a point is up to its size: V / F, as exact as the axes are."""
    ratio = points["V"] / points["F"]
    digits = 11 - np.floor(np.log10(ratio))
    return np.stack([np.round(ratio * 10.0**digits) / 10.0**digits, points["theta"], points["mu"]], axis=1)


def scale(points):
    return {"force": points["F"], "square": points["F"] ** 2}


def raw(rows):
    """The results of a unit load."""
    ratio, theta, mu = rows.T
    value = np.sqrt(ratio) * (1.0 + theta) / (1.0 + mu)
    series = value[:, None] / STEP.values
    return {
        "force": value,
        "square": 3.0 * value,
        "count": (10 * theta).astype(int),
        "series": series,
        "own": value,
    }


def oscillate(points):
    rows = key(points)
    LOG.extend(map(tuple, rows.tolist()))
    errors = [ValueError("no, not this") if tuple(row) in BROKEN["keys"] else None for row in rows.tolist()]
    return raw(rows) | {"wall_time": np.ones(len(rows)), "error": errors}


VARIABLES = {
    "force": Variable("N", scale="force"),
    "square": Variable("N2", dtype="float32", scale="square"),
    "series": Variable("N", "", ("step",), scale="force"),
    "own": Variable(),
    "count": Variable(dtype="int16"),
}
NAMES = list(VARIABLES)
# Without factors a copy's values are those of its computation.
PLAIN = {name: Variable(v.units, "", v.dims, v.dtype) for name, v in VARIABLES.items()}


def geometric(first, count):
    return 1e-3 * RATIO ** np.arange(first, first + count)


def sweep(V=(0, 6), F=(8, 5), theta=(0.0, 1.0), mu=(0.1, 0.5), scaled=True, **changes):
    axes = {
        "V": Axis(geometric(*V), "m/s"),
        "theta": Axis(theta, "degree"),
        "mu": Axis(mu),
        "F": Axis(geometric(*F), "N"),
    }
    options = {"key": key, "coords": {"step": STEP}, "grid": Grid(axes)}
    options |= {"scale": scale, "variables": VARIABLES} if scaled else {"variables": PLAIN}
    return Sweep("oscillations", oscillate, **(options | changes))


def expected(asked, variables=VARIABLES):
    """What was asked for, computed directly: results of a unit load times factors."""
    points = asked.grid.points()
    factors = scale(points)
    values = {}
    for name, value in raw(key(points)).items():
        value = value.astype(variables[name].dtype)
        if variables[name].scale:
            factor = factors[variables[name].scale]
            value = (value * factor.reshape(-1, *(1,) * (value.ndim - 1))).astype(value.dtype)
        values[name] = value.reshape(*asked.grid.shape, *value.shape[1:])
    return values


def same(found, asked):
    for name, values in expected(asked, asked.variables).items():
        assert found[name].values.tobytes() == values.astype(found[name].dtype).tobytes(), name


@pytest.mark.parametrize("scaled", [True, False])
@pytest.mark.parametrize("stored", [True, False])
def test_a_geometric_grid_collapses_to_its_diagonals(tmp_path, scaled, stored):
    asked = sweep(scaled=scaled)
    planned = asked.plan(tmp_path / "o.nc" if stored else None)
    distinct = (6 + 5 - 1) * 2 * 2
    assert (planned.points, planned.distinct, planned.todo) == (120, distinct, distinct)
    found = planned.run()
    assert len(LOG) == len(set(LOG)) == distinct
    same(found, asked)
    # A copy costs nothing.
    assert float(found["wall_time"].sum()) == distinct
    assert np.count_nonzero(found["wall_time"]) == distinct


@pytest.mark.parametrize("scaled", [True, False])
def test_grown_grids_compute_new_diagonals_only(tmp_path, scaled):
    path = tmp_path / "o.nc"
    total = 0
    for options in (
        {},
        {"F": (8, 6)},
        {"F": (7, 7), "V": (0, 7)},
        {"F": (7, 2), "mu": (0.5, 0.3)},
        {"V": (6, 1), "F": (12, 1), "mu": (0.3,)},
    ):
        asked = sweep(**options, scaled=scaled)
        LOG.clear()
        planned = asked.plan(path)
        assert planned.cached + planned.todo == planned.distinct
        found = planned.run()
        assert len(LOG) == planned.todo
        total += planned.todo
        same(found, asked)
        whole = open_results(path)
        assert np.nansum(whole["wall_time"]) == np.count_nonzero(whole["wall_time"] > 0.0) == total
    known = set(zip(*np.where(whole["status"].values == 1), strict=True))
    assert len(known) < whole["status"].size  # holes
    # The order in which points are asked for decides which one is computed, and nothing else.
    LOG.clear()
    turned = sweep(V=(0, 6), F=(8, 5), theta=(1.0, 0.0), mu=(0.5, 0.1), scaled=scaled)
    planned = turned.plan(path)
    assert planned.todo == 0
    same(planned.run(), turned)
    assert LOG == []
    assert np.nansum(open_results(path)["wall_time"]) == total


@pytest.mark.parametrize("scaled", [True, False])
def test_an_old_copy_may_become_what_is_computed(tmp_path, scaled):
    """New points that equal old ones come first: all the same, nothing is computed and no time counts twice."""
    path = tmp_path / "o.nc"
    sweep(V=(1, 1), F=(8, 1), scaled=scaled).plan(path).run()
    LOG.clear()
    asked = sweep(V=(0, 1), F=(7, 1), scaled=scaled)
    planned = asked.plan(path)
    assert (planned.todo, planned.cached) == (0, 4)
    same(planned.run(), asked)
    assert LOG == []
    whole = open_results(path)
    assert whole["status"].values[:, 0, 0].tolist() == [[1, 0], [0, 1]]
    assert np.nansum(whole["wall_time"]) == 4.0
    filled = sweep(V=(0, 2), F=(7, 2), scaled=scaled)
    same(filled.plan(path).run(), filled)
    assert len(LOG) == 2 * 4
    assert float(open_results(path)["wall_time"].sum()) == 12.0


@pytest.mark.parametrize("scaled", [True, False])
def test_copies_do_not_make_what_is_to_come_look_cheap(tmp_path, scaled):
    sweep(scaled=scaled).plan(tmp_path / "o.nc").run()
    planned = sweep(V=(0, 9), scaled=scaled).plan(tmp_path / "o.nc")
    # Each computation has told that it took a second.
    assert planned.todo == 3 * 4
    assert planned.seconds == pytest.approx(planned.todo)


@pytest.mark.parametrize("scaled", [True, False])
def test_an_interrupted_run_goes_on(tmp_path, scaled):
    path = tmp_path / "o.nc"
    asked = sweep(scaled=scaled)
    sweep(V=(0, 3), scaled=scaled).plan(path).run()

    def stop(snapshot):
        if snapshot.done >= 6:
            raise KeyboardInterrupt

    LOG.clear()
    with pytest.raises(KeyboardInterrupt):
        asked.plan(path).run("sync", progress=stop)
    partly = open_results(path)
    done = (partly["status"] == 1).values
    assert 60 < np.count_nonzero(done) < 120
    for name, values in expected(asked, asked.variables).items():
        np.testing.assert_array_equal(partly[name].values[done], values[done])
    found = asked.plan(path).run()
    assert len(LOG) == len(set(LOG)) == 3 * 4
    same(found, asked)
    assert float(found["wall_time"].sum()) == 40.0


@pytest.mark.parametrize("scaled", [True, False])
def test_a_failure_is_one_however_many_points_it_has(tmp_path, scaled):
    path = tmp_path / "o.nc"
    rows = [tuple(row) for row in key(sweep().grid.points()).tolist()]
    broken = max(set(rows), key=rows.count)
    BROKEN["keys"] = {broken}
    found = sweep(scaled=scaled).plan(path).run()
    copies = np.array([row == broken for row in rows]).reshape(found["status"].shape)
    assert copies.sum() == 5
    np.testing.assert_array_equal(found["status"], np.where(copies, 2, 1))
    assert set(found["error"].values[copies]) == {"ValueError: no, not this"}
    assert np.all(np.isnan(found["force"].values[copies]))
    assert found.sizes["failure"] == 1
    assert found["traceback"].values[0].endswith("ValueError: no, not this")
    assert key({name: found[f"failure_{name}"].values for name in sweep().grid.axes}).tolist() == [list(broken)]
    # A copy that comes first, of what has failed: still the one failure, with its reason.
    grown = sweep(V=(-1, 7), F=(7, 6), scaled=scaled).plan(path).run()
    assert grown.sizes["failure"] == 1
    assert grown["traceback"].values.tolist() == found["traceback"].values.tolist()
    assert grown["reproduce"].values.tolist() == found["reproduce"].values.tolist()
    assert np.count_nonzero(grown["status"] == 2) == 6
    LOG.clear()
    BROKEN["keys"] = {broken} if scaled else set()
    planned = sweep(scaled=scaled).plan(path, retry_failed=True)
    assert planned.todo == 1
    again = planned.run()
    assert [broken] == LOG
    assert again.sizes.get("failure", 0) == scaled
    BROKEN["keys"] = set()
    asked = sweep(V=(-1, 7), F=(7, 6), scaled=scaled)
    same(asked.plan(path, retry_failed=True).run(), asked)
    assert "traceback" not in open_results(path)


@given(
    st.lists(st.tuples(st.integers(-2, 3), st.integers(1, 5), st.integers(5, 9), st.integers(1, 4)), max_size=3),
    st.booleans(),
    st.sampled_from([(), "F", ("theta", "V")]),
    st.booleans(),
)
@settings(max_examples=15, deadline=None)
def test_bits_do_not_depend_on_what_was_there_before(tmp_path_factory, before, scaled, together, skipping):
    path = tmp_path_factory.mktemp("copies") / "o.nc"
    options = {"scaled": scaled, "order_by": together}
    LOG.clear()
    for v, nv, f, nf in before:
        sweep(V=(v, nv), F=(f, nf), mu=(0.5,), **options).plan(path).run()
    assert len(LOG) == len(set(LOG))
    asked = sweep(**options)
    if skipping:
        asked = sweep(**options, grid=Grid(asked.grid.axes, skip=lambda p: p["theta"] + p["mu"] > 1.2))
    LOG.clear()
    found = asked.plan(path).run()
    assert len(LOG) == len(set(LOG))
    done = (found["status"] == 1).values
    assert set(np.unique(found["status"])) <= ({1, 3} if skipping else {1})
    for name, values in expected(asked, asked.variables).items():
        np.testing.assert_array_equal(found[name].values[done], values[done])
    whole = open_results(path)
    assert np.nansum(whole["wall_time"]) == np.count_nonzero(whole["wall_time"] > 0.0)


def test_a_factor_that_the_key_does_not_know(tmp_path):
    """Without a key every point is computed, and multiplied all the same."""
    asked = sweep(key=None)
    same(asked.plan(tmp_path / "o.nc").run(), asked)
    assert len(LOG) == 120


def test_everything_skipped_and_nothing_to_scale(tmp_path):
    path = tmp_path / "o.nc"
    grid = sweep().grid
    nothing = sweep(grid=Grid(grid.axes, skip=lambda points: points["F"] > 0.0))
    for store in (None, path):
        found = nothing.plan(store).run()
        assert np.all(found["status"] == 3)
        assert np.all(np.isnan(found["force"]))
    assert LOG == []
    found = sweep().plan(path).run()
    same(found, sweep())
    xr.testing.assert_identical(open_results(path), found)
