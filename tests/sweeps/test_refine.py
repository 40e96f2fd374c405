"""Refinement: what it finds, what it can miss, what it costs; and a refined sweep that is killed, grown, read."""

from itertools import pairwise

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from sweeps import Axis, Grid, Refinement, Sweep, Variable, open_results, refined, status
from sweeps.refine import lattice
from sweeps.refine import refine as engine
from tests.helpers.boundaries import distances, explored, refine
from tests.helpers.waves import BROKEN, LOG, interrupted


def Rule(thresholds=(), tolerance=None, whole=False):
    """What is worth computing of a lattice that belongs to no sweep."""
    return Refinement("", 0, tolerance, thresholds, whole=whole)


CLASSES = Rule(whole=True)


def plane(size=65):
    return np.meshgrid(np.linspace(-1.0, 1.0, size), np.linspace(-1.0, 1.0, size), indexing="ij")


X, Y = plane()
SHAPES = {
    "circle": np.hypot(X - 0.1, Y + 0.05) < 0.6,
    "line": X + 0.3 * Y > 0.1,
    "along the lattice": X > 0.01,
    "diagonal": X > Y,
    "wedge": np.abs(Y - 0.03) < 0.25 * (X + 0.4),
    "three classes": np.digitize(np.hypot(X, Y) + 0.2 * np.sin(5.0 * X), [0.4, 0.9]),
    "checkerboard of quarters": (X > 0.02) ^ (Y > 0.3),
    "thin but rooted": ((np.abs(Y) < 0.04) & (X < 0.7)) | (X < -0.5),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_a_map_of_classes_is_that_of_the_full_grid(shape):
    found, computed, _ = explored(SHAPES[shape], 3, CLASSES)
    np.testing.assert_array_equal(found, SHAPES[shape])
    assert computed.mean() < 0.16
    assert computed[::8, ::8].all()


@pytest.mark.parametrize("axis", [0, 1])
def test_a_mirrored_map_is_computed_at_mirrored_points(axis):
    truth = SHAPES["wedge"] + 2.0 * SHAPES["circle"]
    _, computed, _ = explored(truth, 3, CLASSES)
    _, mirrored, _ = explored(np.flip(truth, axis), 3, CLASSES)
    np.testing.assert_array_equal(np.flip(mirrored, axis), computed)


def noise(seed, width, size=33, classes=3):
    """Classes of any roughness, from speckle to smooth."""
    random = np.random.default_rng(seed).normal(size=(size, size))
    smooth = gaussian_filter(random, width) if width else random
    return np.digitize(smooth, np.quantile(smooth, np.arange(1, classes) / classes)).astype(float)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.7, 1.5, 3.0, 6.0]), st.integers(2, 4), st.integers(1, 4))
def test_what_is_shown_is_true_but_for_islands_that_no_computed_point_has_met(seed, width, classes, levels):
    truth = noise(seed, width, classes=classes)
    found, computed, _ = explored(truth, levels, CLASSES)
    np.testing.assert_array_equal(found[computed], truth[computed])
    for axis in (0, 1):
        values, known, wrong = (np.moveaxis(each, axis, 0) for each in (found, computed, found != truth))
        change = values[1:] != values[:-1]
        # A change of class is claimed between computed points only.
        assert np.all(known[1:][change] & known[:-1][change])
        # So what is missed lies, with all its neighbours, in what is shown as one class.
        assert not np.any((wrong[1:] | wrong[:-1])[change])


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_neither_order_nor_interruption_changes_what_is_computed(seed, order):
    truth = noise(seed, 2.0, size=17)
    _, whole, _ = explored(truth, 3, CLASSES)
    known = np.zeros(truth.shape, dtype=bool)
    random = np.random.default_rng(order)
    while True:
        due = lattice.closure(truth, known, 3, CLASSES) & ~known
        if not due.any():
            break
        some = due & (random.uniform(size=due.shape) < 0.5)
        known |= some if some.any() else due
    np.testing.assert_array_equal(known, whole)


@pytest.mark.parametrize(
    ("function", "most"),
    [
        (lambda x, y: 2.0 * x - y + 3.0, 0.02),
        (lambda x, y: x * y, 0.02),
        (lambda x, y: np.exp(-8.0 * (x**2 + y**2)), 0.06),
        (lambda x, y: np.sin(3.0 * x) * np.cos(2.0 * y), 0.08),
        (lambda x, y: np.abs(x - 0.3 * y + 0.1), 0.04),
        (lambda x, y: np.sqrt(np.maximum(x + 0.4 * y, 0.0)), 0.1),
    ],
)
def test_values_are_within_the_tolerance(function, most):
    truth = function(X, Y)
    found, computed, _ = explored(truth, 3, Rule(tolerance=0.02))
    error = np.abs(found - truth) / np.ptp(truth)
    assert computed.mean() < most
    assert np.quantile(error, 0.97) < 0.02
    finer, more, _ = explored(truth, 3, Rule(tolerance=0.002))
    assert more.sum() >= computed.sum()
    assert np.abs(finer - truth).max() <= np.abs(found - truth).max()


def test_a_smooth_patch_is_blended_from_its_edges():
    """Linear in each direction and their product: known on the edges of the cell, it is known inside."""
    x, y = plane(9)
    truth = 1.0 + x - 2.0 * y + 3.0 * x * y
    known = np.zeros(truth.shape, dtype=bool)
    known[[0, -1], :] = known[:, [0, -1]] = True
    np.testing.assert_allclose(lattice.survey(truth, known, 3, Rule()).values, truth, atol=1e-14)
    # In the middle of a cell any sum of functions of one coordinate each, too.
    x, y = plane(3)
    truth = np.exp(x) + np.cos(2.0 * y)
    np.testing.assert_allclose(lattice.survey(truth, (x != 0.0) | (y != 0.0), 1, Rule()).values, truth)


def test_a_threshold_and_a_missing_value_part_classes():
    truth = np.where(np.hypot(X, Y) > 0.9, np.nan, X - 0.3 * Y - 0.11)
    found, computed, _ = explored(truth, 3, Rule((0.0,), 1.0))
    np.testing.assert_array_equal(np.isnan(found), np.isnan(truth))
    np.testing.assert_array_equal(found > 0.0, truth > 0.0)
    assert computed.mean() < 0.2
    infinite = np.where(np.isnan(truth), np.inf, truth)
    again, same, _ = explored(infinite, 3, Rule((0.0,), 1.0))
    np.testing.assert_array_equal(same, computed)
    np.testing.assert_array_equal(again == np.inf, infinite == np.inf)


def test_rounding_is_no_feature(tmp_path):
    truth = 25.0 + 1e-13 * np.random.default_rng(1).normal(size=X.shape)
    assert explored(truth, 3, Rule(tolerance=0.02))[1].sum() == 81
    flat = {"kind": VARIABLES["kind"], "height": Variable("m", "height", dtype="float32", digits=3)}
    sweep = hills(17, 2, "height", (9.0, 9.01), 0.02, variables=flat, function=slope)
    assert sweep.refinement.resolution == 1e-3
    assert np.count_nonzero(refine(sweep, tmp_path / "flat.nc", "sync")["status"] == 1) == 25


@pytest.mark.parametrize("shape", [(33,), (33, 1), (17, 17, 17)])
def test_lattices_of_other_dimensions(shape):
    axes = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in shape), indexing="ij")
    truth = sum(each**2 for each in axes) < 0.7
    found, computed, _ = explored(truth, 2, CLASSES)
    np.testing.assert_array_equal(found, truth)
    assert computed.mean() < 0.55
    linear = sum((k + 1.0) * each for k, each in enumerate(axes))
    np.testing.assert_allclose(explored(linear, 2, Rule(tolerance=0.1))[0], linear, atol=1e-14)


def test_distances_between_boundaries():
    assert len(distances(X > 0.0, X > 0.0)) == 65
    assert set(distances(X > 0.0, X > 3.0 / 32.0)) == {3.0}
    one = np.zeros((9, 9))
    one[4, 4] = 1
    assert np.all(np.isinf(distances(one, np.zeros((9, 9)))))


# A refined sweep.

VARIABLES = {"kind": Variable("1", "kind", dtype="int8"), "height": Variable("m", "height")}


def hill(points):
    rows = list(zip(*(values.tolist() for values in points.values()), strict=True))
    LOG.extend(rows)
    if BROKEN["points"] & set(rows):
        raise ValueError("no result")
    away = np.hypot(points["x"], points["y"])
    return {"kind": 1 * (away < 0.6), "height": np.exp(-4.0 * away**2)}


def slope(points):
    return {"kind": np.ones(len(points["x"]), dtype=int), "height": 100.0 + points["y"]}


def hills(size=17, levels=2, variable="kind", ends=(-1.0, 1.25), tolerance=None, function=hill, **changes):
    grid = Grid({"x": Axis(np.linspace(-1.0, 1.0, size), "m"), "y": Axis(np.linspace(*ends, size), "m")})
    options = {"variables": VARIABLES} | changes
    return refined(Sweep("hills", function, grid, **options), Refinement(variable, levels, tolerance))


def truth_of(data):
    away = np.hypot(data["x"], data["y"])
    return (away < 0.6).astype(float), np.exp(-4.0 * away**2)


def test_a_refined_sweep_computes_what_is_worth_it_and_interpolates_the_rest(path):
    LOG.clear()
    data = refine(hills(65, 3, tolerance=0.02), path, "sync")
    kind, height = truth_of(data)
    np.testing.assert_array_equal(data["kind"], kind)
    assert np.abs(data["height"] - height).max() < 0.2
    computed = data["status"].values == 1
    assert len(LOG) == len(set(LOG)) == computed.sum() < 0.1 * computed.size
    assert np.all(data["status"].values[~computed] == 4)
    np.testing.assert_array_equal(data["height"].values[computed], height.values[computed])
    np.testing.assert_array_equal(np.isnan(data["wall_time"]), ~computed)
    with xr.open_dataset(path) as plain:
        assert plain["status"].attrs["flag_meanings"] == "pending done failed skipped interpolated"
        assert plain["status"].attrs["flag_values"].tolist() == [0, 1, 2, 3, 4]
        assert '"refinement": {"variable": "kind", "levels": 3, "tolerance": 0.02' in plain.attrs["configuration"]
    told = status(path)
    assert (told.state, told.pending, told.interpolated) == ("complete", 0, computed.size - computed.sum())
    # Once more: nothing to do, and nothing changes.
    before = path.read_bytes()
    again = hills(65, 3, tolerance=0.02).plan(path)
    assert (again.todo, again.whole) == (0, True)
    xr.testing.assert_identical(refine(hills(65, 3, tolerance=0.02), path), data)
    assert path.read_bytes() == before


def test_killed_anywhere_it_goes_on(path, tmp_path, small_pieces):
    whole = refine(hills(), tmp_path / "whole.nc", "sync")
    total = len(LOG)
    LOG.clear()
    stops = 0
    for kept in (3, 9, 5, 30, 1, 8, 2, 40):
        plan = hills().plan(path)
        if kept >= total - plan.cached:
            continue
        # Within a pass, or a pass or two further on.
        interrupted(plan, kept)
        stops += 1
        told = status(path)
        assert (told.state, told.interpolated) == ("interrupted", 0)
        data = open_results(path)
        assert np.all(np.isnan(data["kind"].values[data["status"] == 0]))
    assert stops > 3
    data = refine(hills(), path, "sync")
    assert len(LOG) == len(set(LOG)) == total
    xr.testing.assert_equal(data[["kind", "height", "status"]], whole[["kind", "height", "status"]])


def test_between_passes_the_next_points_are_pending(path):
    counts = []

    def look(snapshot):
        told = status(path)
        assert (told.done, told.interpolated) == (snapshot.done, 0)
        assert told.done + told.pending == told.points
        counts.append((snapshot.done, snapshot.todo))

    hills(65, 3).plan(path).run("sync", progress=look)
    # At the end of a pass all is done that was asked for, and what was found asks for more.
    passes = [done for (done, todo), (_, later) in pairwise(counts) if later > todo]
    assert len(passes) > 3
    assert all((done, done) in counts for done in passes)
    told = status(path)
    assert told.done + told.interpolated == told.points
    assert told.done == counts[-1][0] == counts[-1][1]


def test_a_finer_map_takes_up_the_coarser_one(path, tmp_path):
    refine(hills(17, 1), path, "sync")
    LOG.clear()
    finer = refine(hills(65, 3), path, "sync")
    alone = refine(hills(65, 3), tmp_path / "alone.nc", "sync")
    np.testing.assert_array_equal(finer["kind"], alone["kind"])
    # What the coarser one asked for is among what the finer one does.
    assert finer["status"].equals(alone["status"])
    # The coarser again: of the file, which stays as it is.
    coarse = refine(hills(17, 1), path, "sync")
    assert coarse.sizes == {"x": 17, "y": 17}
    np.testing.assert_array_equal(coarse["kind"], finer["kind"][::4, ::4])
    whole = open_results(path)
    assert whole.sizes["x"] == 65
    np.testing.assert_array_equal(whole["kind"], finer["kind"])
    assert np.all(np.isin(whole["status"], (1, 4)))


def test_another_range_makes_a_larger_file_of_which_each_asks_its_part(path):
    first = refine(hills(), path, "sync")
    other = refine(hills(ends=(-1.0, 2.0)), path, "sync")
    np.testing.assert_array_equal(other["kind"], truth_of(other)[0])
    assert np.all(np.isin(other["status"], (1, 4)))
    again = refine(hills(), path, "sync")
    np.testing.assert_array_equal(again["kind"], first["kind"])
    # No lattice of the whole is known throughout.
    assert set(np.unique(open_results(path)["status"])) == {0, 1}


def test_without_levels_every_point_is_computed_whatever_was_interpolated(path):
    some = refine(hills(), path, "sync")
    LOG.clear()
    data = refine(hills(levels=0), path, "sync")
    assert np.all(data["status"] == 1)
    assert len(LOG) == np.count_nonzero(some["status"] == 4)
    np.testing.assert_array_equal(data["height"], truth_of(data)[1])
    # And once there, they stay.
    assert np.all(refine(hills(), path, "sync")["status"] == 1)


def test_failed_points_have_a_boundary_too(path, small_pieces):
    grid = hills().grid
    points = list(zip(*(values.tolist() for values in grid.points().values()), strict=True))
    BROKEN["points"] = {point for point in points if point[0] > 0.4}
    data = refine(hills(), path, "sync")
    failed = data["status"].values == 2
    beyond = np.broadcast_to((data["x"] > 0.4).values[:, None], failed.shape)
    assert failed.any()
    assert np.all(beyond[failed])
    np.testing.assert_array_equal(np.isnan(data["kind"]), beyond)
    np.testing.assert_array_equal(data["kind"].values[~beyond], truth_of(data)[0].values[~beyond])
    BROKEN["points"] = set()
    LOG.clear()
    assert refine(hills(), path, "sync")["status"].equals(data["status"])
    assert LOG == []
    mended = refine(hills(), path, "sync", retry_failed=True)
    np.testing.assert_array_equal(mended["kind"], truth_of(mended)[0])
    assert not np.any(mended["status"] == 2)


def test_copies_are_known_with_one_of_them(tmp_path):
    LOG.clear()
    data = refine(
        hills(key=lambda points: np.hypot(points["x"], points["y"]), ends=(-1.0, 1.0)), tmp_path / "h.nc"
    )
    kind, _ = truth_of(data)
    np.testing.assert_array_equal(data["kind"], kind)
    assert len(LOG) == len({round(np.hypot(*point), 12) for point in LOG}) < np.count_nonzero(data["status"] == 1)
    np.testing.assert_array_equal(data["status"], data["status"].T)


def test_skipped_points_are_left_out(tmp_path):
    x = Axis(np.linspace(-1.0, 1.0, 17), "m")
    grid = Grid({"x": x, "y": x}, skip=lambda points: points["y"] > 0.5)
    sweep = refined(Sweep("hills", hill, grid, VARIABLES), Refinement("kind", 2))
    data = refine(sweep, tmp_path / "hills.nc", "sync")
    beyond = np.broadcast_to((data["y"] > 0.5).values, (17, 17))
    np.testing.assert_array_equal(data["status"] == 3, beyond)
    np.testing.assert_array_equal(data["kind"].values[~beyond], truth_of(data)[0].values[~beyond])


def test_more_points_than_fit_into_memory_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("sweeps.storage.manifest.LARGE", 1000)
    monkeypatch.setattr(engine, "LARGE", 1000)
    with pytest.raises(ValueError, match="289 points of height are too many to refine; it must be at most 125"):
        hills().plan(tmp_path / "hills.nc")


def test_a_plan_is_its_first_pass_and_a_run_in_memory_goes_through_all(tmp_path):
    plan = hills().plan().timed()
    assert (plan.points, plan.wanted, plan.todo) == (289, 25, 25)
    assert "refined         to 25 points (8.65 %) so far; what" in repr(plan)
    assert plan.most_seconds == pytest.approx(plan.seconds / 25 * 289)
    data = plan.run("sync")
    assert np.count_nonzero(data["status"] == 1) > 25
    names = ["kind", "height", "status"]
    xr.testing.assert_equal(data[names], refine(hills(), tmp_path / "hills.nc", "sync")[names])
