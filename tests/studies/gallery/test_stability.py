"""The plane of inclination and friction: its numbers, what follows from it, its tables and its figure."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fivcore import Rig, flutter_onsets, onset_curves, sliding_modes
from studies import paper
from studies.gallery.stability import findings, study
from studies.gallery.stability.study import STUDY, largest_growth
from studies.plotting import figures
from studies.spec import evenly
from tests.helpers.rigs import frictions, workshop_rig

SMALL = {"theta": evenly(-4.0, 16.0, 21), "mu": evenly(0.0, 0.5, 26)}


@pytest.fixture(scope="module")
def computed(computed):
    return partial(computed, "stability")


@pytest.fixture(scope="module")
def plane(computed):
    return computed(**SMALL)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 300), st.floats(-40.0, 40.0), frictions)
def test_the_largest_growth_is_that_of_the_fastest_mode(seed, theta, mu):
    rig = workshop_rig(seed)
    modes = sliding_modes(rig, theta, mu, 8e3)
    growth, frequency, count = largest_growth(rig, theta, mu, 8e3)
    if not np.any(np.isfinite(modes.growth_rate)):
        assert np.isnan(growth)
        assert np.isnan(frequency)
    else:
        assert growth == np.nanmax(modes.growth_rate)
        assert frequency in modes.frequency[modes.growth_rate == growth]
    assert count == np.count_nonzero(modes.growth_rate > 0.0)


def test_a_band_without_modes_has_no_growth():
    growth, frequency, count = largest_growth(Rig(), [5.0, 6.0], 0.2, 1.0)
    assert np.all(np.isnan(growth) & np.isnan(frequency))
    np.testing.assert_array_equal(count, 0)


def test_the_papers_onsets_are_where_growth_begins(plane):
    at = plane.sel(theta=paper.THETA)
    np.testing.assert_allclose(np.sort(at["pair_onset_mu"]), [0.11123, 0.15298, 0.22365], atol=1e-5)
    assert float(at["onset_mu"]) == flutter_onsets(Rig(), paper.THETA, 10e3, 0.5).mu[0]
    assert float(at["onset_frequency"]) == pytest.approx(2802.0, abs=0.5)
    np.testing.assert_array_equal(at["growth_rate"] > 0.0, at["mu"] > at["onset_mu"])


def test_the_plane_holds_what_the_solver_says_and_the_branches_agree(plane):
    np.testing.assert_array_equal(plane["unstable_modes"], findings.expected(plane))
    np.testing.assert_array_equal(plane["growth_rate"] > 0.0, plane["unstable_modes"] > 0)
    theta, mu = plane["theta"].values[:, None], plane["mu"].values
    growth, frequency, count = largest_growth(Rig(), theta, mu, 10e3)
    np.testing.assert_allclose(plane["growth_rate"], growth, rtol=1e-3)
    np.testing.assert_allclose(plane["frequency"], frequency, rtol=1e-4)
    np.testing.assert_array_equal(plane["unstable_modes"], count)


def test_nothing_grows_outside_the_bound(plane):
    bound = plane["bound_mu"].fillna(np.inf)
    np.testing.assert_array_equal(np.isinf(bound), plane["theta"] <= 0.0)
    assert not np.any((plane["growth_rate"] > 0.0) & (plane["mu"] <= bound))


def test_branches_are_kept_to_their_ends(plane):
    curves = onset_curves(Rig(), SMALL["theta"], 10e3, 0.5)
    number = plane["trace_branch"].values
    for k, curve in enumerate(curves.onsets):
        np.testing.assert_allclose(plane["trace_theta"].values[number == k], curve.theta, rtol=1e-6)
        np.testing.assert_allclose(plane["trace_mu"].values[number == k], curve.mu, rtol=1e-6)
        assert plane["trace_mu"].values[number == k][0] == pytest.approx(0.5)
    assert plane["pair_begins"].attrs["flag_meanings"].split()[int(plane["pair_begins"][0])] == "mu_max"
    lowest = plane.isel(pair=int(np.argmin(plane["pair_lowest_mu"].values)))
    assert float(lowest["pair_lowest_mu"]) == pytest.approx(0.09083, abs=1e-5)
    assert float(lowest["pair_lowest_theta"]) == pytest.approx(2.5935, abs=1e-3)


def test_the_windows_are_at_the_papers_friction_or_the_nearest_there_is(plane, computed):
    assert float(plane["window_mu"]) == paper.MU
    np.testing.assert_allclose(plane["window_from"], [1.97, 0.62], atol=0.01)
    np.testing.assert_allclose(plane["window_to"], [9.35, 10.68], atol=0.01)
    for mu, taken in (([0.0, 0.1], 0.1), ([0.3, 0.4], 0.3)):
        assert float(computed(theta=[0.0, 10.0], mu=mu)["window_mu"]) == taken


def test_a_rig_whose_pairs_recover(computed):
    data = computed(theta=evenly(0.0, 20.0, 11), mu=evenly(0.0, 0.6, 13), p1_length=0.08)
    mu = data["pair_recovery_mu"].values
    assert np.any(np.isfinite(mu))
    assert np.all(mu[np.isfinite(mu)] <= 0.6)
    text = STUDY.report(data)
    assert "\nrecovery " in text
    assert "paper" not in text.lower()


def over_the_plane(dataset):
    """The figures of the plane by their names."""
    (table,) = (part for part in findings.findings(dataset) if getattr(part, "heads", [""])[0] == "over the plane")
    return dict(table.rows)


def test_the_figures_of_the_plane(plane):
    rows = over_the_plane(plane)
    assert rows["points with a growing mode"].endswith(
        f"({100.0 * float((plane['growth_rate'] > 0.0).mean()):.1f} %)"
    )
    for name in ("growing outside 0 < tan(theta) < mu", "growing, but not by the branches, or the reverse"):
        assert rows[name] == "0"
    top = plane.where(plane["growth_rate"] == plane["growth_rate"].max(), drop=True).squeeze()
    place = f"theta = {float(top['theta']):g} degrees, mu = {float(top['mu']):g}"
    rate = f"{float(top['growth_rate']):.0f} 1/s, {float(top['frequency']):.0f} Hz"
    assert rows["largest growth rate"] == f"{rate} at {place}"


def test_growth_without_an_onset_in_the_band_is_counted(computed):
    """At theta = 24 and mu = 0.8 a pair of the paper's rig diverges."""
    data = computed(theta=[20.0, 24.0, 28.0], mu=[0.7, 0.8, 0.9])
    diverge = np.count_nonzero(data["frequency"] == 0.0)
    differ = np.count_nonzero(data["unstable_modes"].values != findings.expected(data))
    assert diverge
    assert differ
    rows = over_the_plane(data)
    assert rows["points whose fastest growing mode does not oscillate"] == f"{diverge}"
    assert rows["more or fewer growing modes than by the branches"] == f"{differ}"


def test_branches_that_cannot_be_followed_leave_all_else(monkeypatch, computed):
    def fails(*args):
        raise ArithmeticError("onsets near theta = 1 cannot be told apart")

    monkeypatch.setattr(study, "onset_curves", fails)
    data = computed(theta=[0.0, 5.0], mu=[0.1, 0.2])
    assert data.sizes["pair"] == data.sizes["trace"] == 0
    assert data.sizes["window"] == 2
    text = STUDY.report(data)
    assert "could not be followed over theta: onsets near theta = 1 cannot be told apart." in text
    assert "by the branches" not in text


def test_the_papers_numbers_stand_beside_the_branches_and_the_plane(plane, computed):
    def rows(data):
        return [row[2:5] for row in findings.findings(data)[-1].rows]

    mu = [["0.12", "0.1112", "-7.3 %"], ["0.16", "0.153", "-4.4 %"], ["0.23", "0.2236", "-2.8 %"]]
    hertz = [["2800", "2802", "+0.1 %"], ["400", "397.8", "-0.5 %"], ["7700", "7705", "+0.1 %"]]
    assert (rows(plane)[:6:2], rows(plane)[1:6:2]) == (mu, hertz)
    # Two pairs at 5 degrees; none at 15, below 0 and above 12, where the rig slides steadily.
    assert rows(plane)[6:] == [["2", "2", "none"], *[["0", "0", "none"]] * 3]
    other = plane.copy(deep=True)
    other["unstable_modes"].loc[{"theta": 13.0, "mu": paper.MU}] = 1
    assert rows(other)[-2:] == [["0", "0", "none"], ["0", "0 to 1", "differs"]]
    # An onset is known by its frequency, whichever branches there are.
    few = computed(theta=[4.0, 5.0], mu=[0.0, 0.13])
    assert few.sizes["pair"] == 1
    assert rows(few) == rows(plane)[:2]


@pytest.mark.parametrize(("first", "line"), [(10, " of 210 "), (0, "No point has been computed yet.")])
def test_points_that_are_missing_stay_white(plane, first, line):
    some = plane.copy(deep=True)
    for name in ("growth_rate", "frequency", "unstable_modes"):
        some[name] = some[name].astype(float)
        some[name][:, first:] = np.nan
    assert line in STUDY.report(some)
    with figures.style():
        figure = STUDY.draw(some)
        figure.canvas.draw()
    meshes = [each for each in figure.axes[0].collections if np.size(each.get_array()) == 26 * 21]
    assert meshes
    assert all(np.ma.getmaskarray(mesh.get_array()).reshape(26, 21)[first:].all() for mesh in meshes)
