"""Refinement: its guarantee, estimate and cost; and a refined sweep that is interrupted, grown and read."""

import json
from itertools import product

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from studies.answering.refinement import report, shares
from studies.cli.execution import timed
from sweeps import open_results, status
from sweeps.refine import lattice
from tests.helpers.boundaries import CLASSES, ROUGH, SHAPES, SMOOTH, Rule, X, Y, bumps, explored, noise, refine
from tests.helpers.examples import examples
from tests.helpers.waves import BROKEN, LOG, SHOWN, cliff, hills, interrupted, truth_of


@pytest.mark.parametrize("shape", SHAPES)
def test_a_map_of_classes_is_that_of_the_full_grid_and_mirrored_with_it(shape):
    shown, computed, _ = explored(SHAPES[shape], 3, CLASSES)
    np.testing.assert_array_equal(shown, SHAPES[shape])
    assert computed.mean() < 0.25
    for axis in (0, 1):
        mirrored = explored(np.flip(SHAPES[shape], axis), 3, CLASSES)[1]
        np.testing.assert_array_equal(np.flip(mirrored, axis), computed)


@examples(15)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.7, 1.5, 3.0, 6.0]), st.integers(2, 4), st.integers(1, 4))
def test_only_islands_that_no_computed_point_has_met_are_missed(seed, width, classes, levels):
    truth = noise(seed, width, classes=classes)
    shown, computed, _ = explored(truth, levels, CLASSES)
    np.testing.assert_array_equal(shown[computed], truth[computed])
    for axis in (0, 1):
        values, certain, wrong = (np.moveaxis(each, axis, 0) for each in (shown, computed, shown != truth))
        change = values[1:] != values[:-1]
        # Classes change between computed points only: a missed point and its neighbours are shown in one class.
        assert np.all(certain[1:][change] & certain[:-1][change])
        assert not np.any((wrong[1:] | wrong[:-1])[change])


@examples(2)
@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.booleans())
def test_neither_order_nor_interruption_changes_the_choice(seed, order, whole):
    truth = noise(seed, 2.0, 17) if whole else bumps(np.random.default_rng(seed))[:17, :17]
    rule = CLASSES if whole else Rule(tolerance=0.02)
    _, expected, choice = explored(truth, 3, rule)
    computed, random = np.zeros(truth.shape, dtype=bool), np.random.default_rng(order)
    while np.any(due := lattice.choose(truth, computed, 3, rule).points & ~computed):
        some = due & (random.uniform(size=due.shape) < 0.5)
        computed |= some if some.any() else due
    np.testing.assert_array_equal(computed, expected)
    assert lattice.choose(truth, computed, 3, rule).levels == choice.levels


@pytest.mark.parametrize("kind", [pytest.param(k, marks=pytest.mark.slow) if k != "kinks" else k for k in ROUGH])
def test_control_points_estimate_the_share_of_wrong_points(kind):
    outcomes = []
    for seed in range(8):
        truth = ROUGH[kind](np.random.default_rng(seed))
        shown, computed, choice = explored(truth, 3, Rule(tolerance=0.02))
        wrong = np.abs(shown - truth)[~computed] > 0.02 * np.ptp(truth)
        outcomes.append((wrong.mean(), *shares(choice.levels)))
    wrong, estimate, upper = np.array(outcomes).T
    # On average over some 8 x 250 control points within three standard errors.
    assert abs(np.mean(estimate - wrong)) < 0.003 + 3.0 * np.sqrt(np.mean(wrong) / 2000.0)
    assert np.count_nonzero(wrong <= upper) >= 7
    assert np.all((estimate < upper) & (upper < estimate + 0.06))


def test_a_large_map_has_as_many_control_points_as_its_estimate_needs():
    _, computed, choice = explored(np.ones((257, 257)), 5, Rule(tolerance=0.02))
    assert [round(each["represents"]) for each in choice.levels] == [12, 12, 12, 48, 189]
    assert computed.mean() < 0.02
    assert 0.0 == shares(choice.levels)[0] < shares(choice.levels)[1] < 0.012


@pytest.mark.parametrize("kind", SMOOTH)
def test_values_are_within_the_tolerance(kind):
    truth, most = SMOOTH[kind]
    shown, computed, _ = explored(truth, 3, Rule(tolerance=0.02))
    error = np.abs(shown - truth) / np.ptp(truth)
    assert computed.mean() < most
    assert np.quantile(error, 0.98) < 0.02
    np.testing.assert_array_equal(np.flip(explored(np.flip(truth), 3, Rule(tolerance=0.02))[1]), computed)
    assert np.abs(explored(truth, 3, Rule(tolerance=0.002))[0] - truth).max() <= np.abs(shown - truth).max()


def test_thresholds_and_missing_values_separate_classes():
    truth = np.where(np.hypot(X, Y) > 0.9, np.nan, X - 0.3 * Y - 0.11)
    shown, computed, _ = explored(truth, 3, Rule((0.0,), 1.0))
    np.testing.assert_array_equal(np.isnan(shown), np.isnan(truth))
    np.testing.assert_array_equal(shown > 0.0, truth > 0.0)
    assert computed.mean() < 0.3
    infinite = np.where(np.isnan(truth), np.inf, truth)
    np.testing.assert_array_equal(explored(infinite, 3, Rule((0.0,), 1.0))[0] == np.inf, infinite == np.inf)


@pytest.mark.parametrize("shape", [(33,), (33, 1), (17, 17, 17)])
def test_lattices_of_other_dimensions(shape):
    axes = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in shape), indexing="ij")
    truth = sum(each**2 for each in axes) < 0.7
    shown, computed, _ = explored(truth, 2, CLASSES)
    np.testing.assert_array_equal(shown, truth)
    assert computed.mean() < 0.6
    np.testing.assert_allclose(explored(sum(axes), 2, Rule(tolerance=0.1))[0], sum(axes), atol=1e-14)


def test_rounding_is_no_feature():
    truth = 25.0 + 1e-13 * np.random.default_rng(1).normal(size=X.shape)
    control = sum(int(lattice.control_points((n, n)).sum()) for n in (65, 33, 17))
    assert explored(truth, 3, Rule(tolerance=0.02))[1].sum() == 81 + control


def test_a_refined_sweep_computes_some_points_and_interpolates_the_others(path):
    LOG.clear()
    data = refine(hills(65, 3, tolerance=0.02), path, "sync")
    kind, height = truth_of(data)
    np.testing.assert_array_equal(data["kind"], kind)
    computed = data["status"].values == 1
    assert len(LOG) == len(set(LOG)) == computed.sum() < 0.2 * computed.size
    assert np.all(data["status"].values[~computed] == 4)
    np.testing.assert_array_equal(data["height"].values[computed], height.values[computed])
    np.testing.assert_array_equal(np.isnan(data["wall_time"]), ~computed)
    assert data["status"].attrs["flag_meanings"] == "pending done failed skipped interpolated"
    assert data["status"].attrs["flag_values"].tolist() == [0, 1, 2, 3, 4]
    assert '"refinement": {"variable": "kind", "levels": 3, "tolerance": 0.02' in data.attrs["configuration"]
    assert (status(path).state, status(path).interpolated) == ("complete", computed.size - computed.sum())
    before = path.read_bytes()
    again = hills(65, 3, tolerance=0.02).plan(path)
    assert (again.todo, again.whole) == (0, True)
    xr.testing.assert_identical(again.run(), data)
    assert path.read_bytes() == before


def test_a_file_records_how_wrong_its_interpolated_points_are(path):
    data = refine(hills(33, 2, "height", (-1.0, 1.0), 0.02, cliff), path, "sync")
    record, computed = json.loads(open_results(path).attrs["refinement"]), data["status"].values == 1
    first, last = record["levels"]
    assert [(each["level"], each["spacing"]) for each in record["levels"]] == [(1, 2), (2, 1)]
    assert 81 + first["computed"] + last["computed"] == computed.sum() == computed.size - record["interpolated"]
    assert record["control"] == first["control"] + last["control"] > 20
    wrong = np.mean(np.abs(data["height"].values - cliff(data)["height"].values)[~computed] > 0.04)
    assert wrong == pytest.approx(shares(record["levels"])[0], abs=0.03)
    assert wrong < shares(record["levels"])[1] < 0.2
    # The cliff is too steep for the finest level, and nothing else is.
    assert record["exhausted"] == last["mispredicted"] > 30
    assert record["within"]["y"] == [-1.0, 1.0]
    assert -0.5 < record["within"]["x"][0] < record["within"]["x"][1] < 0.5
    share, end = report(data)
    assert share.startswith(f"{record['interpolated']} points are interpolated, of which about ")
    assert f" {record['exhausted']} points (x -0." in end
    unknown = json.dumps(record | {"levels": [], "exhausted": 0})
    assert "is not known" in "".join(report(data.assign_attrs(refinement=unknown)))
    assert "in another class" in report(refine(hills(), path.with_name("kind.nc"), "sync"))[0]
    assert report(refine(hills(9, 0), path.with_name("full.nc"), "sync")) == []


def test_killed_anywhere_it_goes_on(path, tmp_path, small_pieces):
    whole = refine(hills(), tmp_path / "whole.nc", "sync")
    total = len(LOG)
    LOG.clear()
    for kept in (3, 9, 5, 20, 1, 8, 2):
        # Within a pass, or a pass or two further on.
        interrupted(hills().plan(path), kept)
        assert (status(path).state, status(path).interpolated) == ("interrupted", 0)
        data = open_results(path)
        assert np.all(np.isnan(data["kind"].values[data["status"] == 0]))
    data = refine(hills(), path, "sync")
    assert len(LOG) == len(set(LOG)) == total
    xr.testing.assert_equal(data[SHOWN], whole[SHOWN])
    assert data.attrs["refinement"] == whole.attrs["refinement"]


def test_a_finer_map_continues_the_coarser_one(path, tmp_path):
    refine(hills(17, 1), path, "sync")
    finer = refine(hills(65, 3), path, "sync")
    alone = refine(hills(65, 3), tmp_path / "alone.nc", "sync")
    # The points of the coarser map are among those of the finer one.
    xr.testing.assert_equal(finer[["kind", "status"]], alone[["kind", "status"]])
    # The coarser map again is read from the file, which stays as it is.
    np.testing.assert_array_equal(refine(hills(17, 1), path, "sync")["kind"], finer["kind"][::4, ::4])
    xr.testing.assert_equal(open_results(path)[SHOWN], finer[SHOWN])


def test_another_range_makes_a_larger_file_of_which_each_map_is_a_part(path):
    first = refine(hills(), path, "sync")
    other = refine(hills(ends=(-1.0, 2.0)), path, "sync")
    np.testing.assert_array_equal(other["kind"], truth_of(other)[0])
    np.testing.assert_array_equal(refine(hills(), path, "sync")["kind"], first["kind"])
    # No coarse lattice of the whole is computed throughout.
    assert set(np.unique(open_results(path)["status"])) == {0, 1}


def test_failed_points_have_a_boundary_too(path, small_pieces):
    axes = [axis.values.tolist() for axis in hills().grid.axes.values()]
    BROKEN["points"] = {point for point in product(*axes) if point[0] > 0.4}
    data = refine(hills(), path, "sync")
    assert np.any(data["status"] == 2)
    xr.testing.assert_equal(data["kind"], truth_of(data)[0].where(data["x"] <= 0.4))
    BROKEN["points"] = set()
    assert hills().plan(path).todo == 0
    mended = refine(hills(), path, "sync", retry_failed=True)
    np.testing.assert_array_equal(mended["kind"], truth_of(mended)[0])
    assert not np.any(mended["status"] == 2)


def test_copies_are_computed_with_one_of_them(tmp_path):
    LOG.clear()
    sweep = hills(key=lambda points: np.hypot(points["x"], points["y"]), ends=(-1.0, 1.0))
    data = refine(sweep, tmp_path / "h.nc")
    np.testing.assert_array_equal(data["kind"], truth_of(data)[0])
    assert len(LOG) == len({round(np.hypot(*point), 12) for point in LOG}) < np.count_nonzero(data["status"] == 1)
    np.testing.assert_array_equal(data["status"], data["status"].T)
    first, last = json.loads(data.attrs["refinement"])["levels"]
    assert first["computed"] + last["computed"] < len(LOG)


def test_skipped_points_are_left_out(tmp_path):
    data = refine(hills(ends=(-1.0, 1.0), skip=lambda points: points["y"] > 0.5), tmp_path / "hills.nc", "sync")
    assert np.all((data["status"] == 3) == (data["y"] > 0.5))
    xr.testing.assert_equal(data["kind"].where(data["y"] <= 0.5), truth_of(data)[0].where(data["y"] <= 0.5))


def test_more_points_than_fit_into_memory_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("sweeps.plan.planning.LARGE", 100)
    with pytest.raises(ValueError, match="289 points of kind are too many to refine; it must be at most 100"):
        hills().plan(tmp_path / "hills.nc")


def test_a_plan_is_its_first_pass_and_a_run_in_memory_goes_through_all(tmp_path):
    plan = timed(hills().plan())
    assert (plan.points, plan.requested_count, plan.todo) == (289, 25, 25)
    assert "refined         25 points (8.65 %) so far" in repr(plan)
    assert plan.most_seconds == pytest.approx(plan.seconds / 25 * 289)
    xr.testing.assert_equal(plan.run("sync")[SHOWN], refine(hills(), tmp_path / "hills.nc", "sync")[SHOWN])
