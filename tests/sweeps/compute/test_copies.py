"""Points that are one computation: done once, copied to the others, and there multiplied by their own factors."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sweeps import Axis, Grid, Sweep, Variable, open_results
from sweeps.plan import batches
from tests.helpers.waves import interrupted

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


def test_a_geometric_grid_collapses_to_its_diagonals(path):
    asked, distinct = sweep(), (6 + 5 - 1) * 2 * 2
    for store in (None, path):
        LOG.clear()
        planned = asked.plan(store)
        assert (planned.points, planned.distinct, planned.todo) == (120, distinct, distinct)
        found = planned.run()
        assert len(LOG) == len(set(LOG)) == distinct
        same(found, asked)
        # A copy costs nothing.
        assert float(found["wall_time"].sum()) == distinct
        assert np.count_nonzero(found["wall_time"]) == distinct
    # Nor does it make what is to come look cheap: each computation has told that it took a second.
    planned = sweep(V=(0, 9)).plan(path)
    assert planned.todo == 3 * 4
    assert planned.seconds == pytest.approx(planned.todo)


def test_an_interrupted_run_goes_on(path):
    asked = sweep()
    sweep(V=(0, 3)).plan(path).run()
    LOG.clear()
    interrupted(asked.plan(path), 6)
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
def test_a_failure_is_one_however_many_points_it_has(path, scaled):
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
    # Of a part without the failing points there is nothing to tell.
    assert "failure" not in sweep(theta=(1.0 - broken[1],), scaled=scaled).plan(path).run().dims
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


GROWING = st.tuples(st.integers(-2, 3), st.integers(1, 5), st.integers(5, 9), st.integers(1, 4), st.just((0.5,)))
DIAGONALS = [(0, 6, 8, 5), (0, 6, 8, 6), (0, 7, 7, 7), (0, 6, 7, 2, (0.5, 0.3)), (6, 1, 12, 1, (0.3,))]


@given(st.lists(GROWING, max_size=3), st.booleans(), st.sampled_from([(), "F", ("theta", "V")]), st.booleans())
@example(DIAGONALS, True, (), False)
@example(DIAGONALS, False, (), False)
# New points that equal old ones come first: an old copy may become what is computed.
@example([(1, 1, 8, 1), (0, 1, 7, 1), (0, 2, 7, 2)], True, (), False)
@example([(1, 1, 8, 1), (0, 1, 7, 1), (0, 2, 7, 2)], False, (), False)
@settings(max_examples=8, deadline=None)
def test_new_diagonals_only_are_computed_and_bits_do_not_depend_on_what_was_there(
    tmp_path_factory, before, scaled, together, skipping
):
    path = tmp_path_factory.mktemp("copies") / "o.nc"
    options = {"scaled": scaled, "order_by": together}
    LOG.clear()
    for v, nv, f, nf, *mu in before:
        asked, done = sweep(V=(v, nv), F=(f, nf), **options, **({"mu": mu[0]} if mu else {})), len(LOG)
        planned = asked.plan(path)
        assert planned.cached + planned.todo == planned.distinct
        same(planned.run(), asked)
        assert len(LOG) - done == planned.todo
    # The order in which points are asked for decides which one is computed, and nothing else.
    asked = sweep(**options, theta=(1.0, 0.0), mu=(0.5, 0.1))
    if skipping:
        asked = sweep(**options, grid=Grid(asked.grid.axes, skip=lambda p: p["theta"] + p["mu"] > 1.2))
    found = asked.plan(path).run()
    assert len(LOG) == len(set(LOG))
    done = (found["status"] == 1).values
    assert set(np.unique(found["status"])) <= ({1, 3} if skipping else {1})
    for name, values in expected(asked, asked.variables).items():
        np.testing.assert_array_equal(found[name].values[done], values[done])
    whole = open_results(path)
    assert np.nansum(whole["wall_time"]) == np.count_nonzero(whole["wall_time"] > 0.0)
    assert skipping or np.nansum(whole["wall_time"]) == len(LOG)


def test_without_a_key_or_with_all_skipped(tmp_path):
    """Without a key every point is computed, and multiplied all the same; where all is skipped, none is."""
    grid = sweep().grid
    nothing = sweep(grid=Grid(grid.axes, skip=lambda points: points["F"] > 0.0))
    for store in (None, tmp_path / "o.nc"):
        found = nothing.plan(store).run()
        assert np.all(found["status"] == 3)
        assert np.all(np.isnan(found["force"]))
    assert LOG == []
    found = sweep().plan(tmp_path / "o.nc").run()
    same(found, sweep())
    xr.testing.assert_identical(open_results(tmp_path / "o.nc"), found)
    LOG.clear()
    same(sweep(key=None).plan(tmp_path / "all.nc").run(), sweep(key=None))
    assert len(LOG) == 120
