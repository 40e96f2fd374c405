"""Points that are one computation: done once, copied to the others, and there multiplied by their own factors."""

import numpy as np
import pytest

from sweeps import Axis, Grid, Sweep, Variable, open_results
from sweeps.plan import batches
from sweeps.storage.assemble import rounded
from tests.helpers.state import Chosen, Log
from tests.helpers.waves import interrupted

# What was computed, and which computations fail; not part of the fingerprint, as constants would be.
LOG = Log()
BROKEN = Chosen()


@pytest.fixture(autouse=True)
def _small_batches(monkeypatch):
    LOG.clear()
    BROKEN.clear()
    monkeypatch.setattr(batches, "BATCH_BYTES", 400.0)


def key(points):
    """A point up to its size: V / F, as exact as the axes."""
    return np.stack([np.log10(points["V"] / points["F"]).round(9), points["mu"]], axis=1)


def scale(points):
    return {"force": points["F"], "square": points["F"] ** 2}


def raw(rows):
    """The results at F = 1."""
    value = rows[:, 0] / (1.0 + rows[:, 1])
    results = {"force": value, "square": 3.0 * value, "series": value[:, None] / [1, 2, 3]}
    return results | {"own": value, "kept": value}


def oscillate(points):
    rows = [*map(tuple, key(points).tolist())]
    LOG.extend(rows)
    errors = [ValueError("not this") if row in BROKEN else None for row in rows]
    return raw(key(points)) | {"wall_time": np.ones(len(rows)), "error": errors}


VARIABLES = {
    "force": Variable("N", scale="force"),
    "square": Variable("N2", dtype="float32", scale="square"),
    "series": Variable("N", dims="step", scale="force"),
    "own": Variable(),
    "kept": Variable("N", digits=4, scale="force"),
}


def sweep(V=(0, 6), F=(8, 5), mu=(0.1, 0.5), skip=None, **changes):
    """Geometric axes V and F: first power and count of each."""
    ends = {"V": V, "F": F}
    powers = {name: 10.0 ** (0.25 * np.arange(k, k + n) - 3.0) for name, (k, n) in ends.items()}
    grid = Grid({"V": Axis(powers["V"], "m/s"), "mu": Axis(mu), "F": Axis(powers["F"], "N")}, skip=skip)
    options = {"key": key, "scale": scale, "coords": {"step": [1, 2, 3]}}
    return Sweep("oscillations", oscillate, grid, VARIABLES, **(options | changes))


def assert_right(data, one, rtol=0.0):
    """Whether finished points have the results at F = 1 times their factors; to the bit, unless a file grew."""
    points, is_done = one.grid.points(), (data["status"] == 1).values.ravel()
    for name, value in raw(key(points)).items():
        variable = VARIABLES[name]
        factor = scale(points).get(variable.scale, np.ones(one.grid.size))
        value = rounded(value.astype(variable.dtype), variable.digits)
        expected = rounded((value.T * factor).T.astype(variable.dtype), variable.digits)
        found = data[name].values.reshape(expected.shape)
        most = max(rtol, 1e-4) if rtol and variable.digits else rtol
        np.testing.assert_allclose(found[is_done], expected[is_done], rtol=most)


def test_a_geometric_grid_costs_its_diagonals_only(path):
    for store in (None, path):
        LOG.clear()
        plan = sweep().plan(store)
        assert (plan.points, plan.distinct, plan.todo) == (60, 20, 20)
        data = plan.run()
        assert len(LOG) == len(set(LOG)) == 20
        assert_right(data, sweep())
        # A copy costs nothing, and does not make the rest look cheap.
        assert float(data["wall_time"].sum()) == np.count_nonzero(data["wall_time"]) == 20
    plan = sweep(V=(0, 9)).plan(path)
    assert (plan.todo, plan.seconds) == (6, pytest.approx(6.0))


def test_a_failure_is_one_however_many_points_it_has(path):
    rows = [tuple(row) for row in key(sweep().grid.points()).tolist()]
    broken = max(set(rows), key=rows.count)
    BROKEN.add(broken)
    data = sweep().plan(path).run()
    is_copy = np.array([row == broken for row in rows]).reshape(data["status"].shape)
    np.testing.assert_array_equal(data["status"], np.where(is_copy, 2, 1))
    np.testing.assert_array_equal(data["error"], np.where(is_copy, "ValueError: not this", ""))
    assert data.sizes["failure"] == 1
    # A new copy that comes first has the same failure.
    grown = sweep(V=(-1, 7), F=(7, 6)).plan(path).run()
    assert grown["traceback"].values.tolist() == data["traceback"].values.tolist()
    assert np.count_nonzero(grown["status"] == 2) == np.count_nonzero(is_copy) + 1
    BROKEN.clear()
    plan = sweep().plan(path, retry_failed=True)
    assert plan.todo == 1
    assert_right(plan.run(), sweep())


@pytest.mark.parametrize("before", [(1, 1, 8, 1), (2, 3, 5, 4)])
def test_only_new_diagonals_are_computed_and_earlier_results_stay_where_points_are_skipped(path, before):
    # New points that equal old ones come first; values that are there stay, to the bit.
    first = sweep(V=before[:2], F=before[2:]).plan(path).run().load()
    for v, nv, f, nf in (before, (0, 2, 7, 2), (0, 6, 7, 6)):
        one, count = sweep(V=(v, nv), F=(f, nf), order_by=("mu", "V")), len(LOG)
        plan = one.plan(path)
        assert_right(plan.run(), one, rtol=1e-6)
        assert len(LOG) - count == plan.todo
    same = open_results(path)["kept"].sel({dim: first[dim] for dim in first["kept"].dims})
    np.testing.assert_array_equal(same, first["kept"])
    interrupted(sweep(V=(0, 8), F=(7, 6)).plan(path), 1)
    one = sweep(V=(0, 7), F=(7, 6), skip=lambda points: points["V"] > 5e-3)
    data = one.plan(path).run()
    assert_right(data, one, rtol=1e-6)
    assert len(LOG) == len(set(LOG))
    assert set(np.unique(data["status"])) == {1, 3}
    assert np.isnan(data["force"].values[data["status"] == 3]).all()


def test_without_a_key_each_point_is_computed_and_if_all_are_skipped_none(tmp_path):
    data = sweep(skip=lambda points: points["F"] > 0.0).plan(tmp_path / "none.nc").run()
    assert np.all(data["status"] == 3)
    assert LOG == []
    data = sweep(key=None).plan(tmp_path / "all.nc").run()
    assert len(LOG) == 60
    assert_right(data, sweep())
