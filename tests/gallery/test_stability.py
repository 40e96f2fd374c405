"""The plane of inclination and friction, and the linear stability that studies share."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fivcore import Rig, flutter_onsets, onset_curves, sliding_modes
from studies import paper, registry, runner
from studies.answering import claims, summary
from studies.declaring.spec import evenly
from studies.motion.stability import first_growth, largest_growth
from studies.physics import onsets as plane_study
from tests.helpers.examples import examples
from tests.helpers.rigs import frictions, workshop_rig

STUDY = registry.load("stability")
SMALL = {"theta": evenly(-4.0, 16.0, 21), "mu": evenly(0.0, 0.5, 26)}


@pytest.fixture(scope="module")
def plane(computed):
    return computed("stability", **SMALL)


def by_branches(data):
    """Number of unstable pairs: onsets below less recoveries below."""
    mu = data["mu"].values[:, None]
    names = ("pair_onset_mu", "pair_recovery_mu")
    onsets, recoveries = (np.sum(data[name].values[:, None, :] < mu, axis=-1) for name in names)
    return onsets - recoveries


@examples(20)
@given(st.integers(0, 300), st.floats(-40.0, 40.0), frictions)
def test_the_largest_growth_is_that_of_the_least_stable_mode(seed, theta, mu):
    rig = workshop_rig(seed)
    modes = sliding_modes(rig, theta, mu, 8e3)
    growth, frequency, count = largest_growth(rig, theta, mu, 8e3)
    assert count == np.count_nonzero(modes.growth_rate > 0.0)
    if np.any(np.isfinite(modes.growth_rate)):
        assert growth == np.nanmax(modes.growth_rate)
        assert frequency in modes.frequency[modes.growth_rate == growth]
    assert np.isnan(largest_growth(Rig(), 5.0, 0.2, 1.0)[0])


def test_the_papers_onsets_are_where_growth_begins(plane):
    at = plane.sel(theta=paper.THETA)
    np.testing.assert_allclose(np.sort(at["pair_onset_mu"]), [0.11123, 0.15298, 0.22365], atol=1e-5)
    assert float(at["onset_mu"]) == flutter_onsets(Rig(), paper.THETA, 10e3, 0.5).mu[0]
    assert (float(at["onset_mu"]), float(at["onset_frequency"])) == first_growth(Rig(), paper.THETA, 10e3, 0.5)
    np.testing.assert_array_equal(at["growth_rate"] > 0.0, at["mu"] > at["onset_mu"])


def test_grid_branches_and_bound_agree(plane):
    np.testing.assert_array_equal(plane["unstable_modes"], by_branches(plane))
    found = largest_growth(Rig(), plane["theta"].values[:, None], plane["mu"].values)
    for name, values in zip(STUDY.outputs, found, strict=True):
        np.testing.assert_allclose(plane[name], values, rtol=1e-3)
    bound = plane["bound_mu"].fillna(np.inf)
    np.testing.assert_array_equal(np.isinf(bound), plane["theta"] <= 0.0)
    assert not np.any((plane["growth_rate"] > 0.0) & (plane["mu"] <= bound))


def test_branches_are_kept_to_their_ends(plane):
    number = plane["trace_branch"].values
    for k, curve in enumerate(onset_curves(Rig(), SMALL["theta"], 10e3, 0.5).onsets):
        np.testing.assert_allclose(plane["trace_theta"].values[number == k], curve.theta, rtol=1e-6)
        np.testing.assert_allclose(plane["trace_mu"].values[number == k], curve.mu, rtol=1e-6)
    lowest = plane.isel(pair=int(np.argmin(plane["pair_lowest_mu"].values)))
    assert float(lowest["pair_lowest_mu"]) == pytest.approx(0.09083, abs=1e-5)
    assert float(lowest["pair_lowest_theta"]) == pytest.approx(2.5935, abs=1e-3)


def test_pairs_that_recover_or_diverge_are_counted(computed):
    data = computed("stability", theta=evenly(0.0, 20.0, 3), mu=[0.0, 0.6], p1_length=0.08)
    assert np.nanmax(data["pair_recovery_mu"]) <= 0.6
    # At theta = 24 and mu = 0.8 a pair of the paper's rig diverges.
    data = computed("stability", theta=[20.0, 24.0, 28.0], mu=[0.7, 0.8])
    counts = np.sum(data["frequency"].values == 0.0), np.sum(data["unstable_modes"].values != by_branches(data))
    (table,) = (part[1] for part in STUDY.summary(data) if part[0] == "Over the plane")
    assert all(counts)
    assert set(counts) <= set(table["value"])


def test_branches_that_cannot_be_followed_leave_all_else(monkeypatch, computed):
    def fails(*args):
        raise ArithmeticError("onsets near theta = 1 cannot be told apart")

    monkeypatch.setattr(plane_study, "onset_curves", fails)
    data = computed("stability", theta=[0.0, 5.0], mu=[0.1, 0.2])
    assert (data.sizes["pair"], data.sizes["window"]) == (0, 2)
    assert "onsets near theta = 1 cannot be told apart" in summary.text(summary.parts(STUDY, data), 200)
    assert runner.draw(STUDY, data)


def test_the_papers_numbers_stand_beside_the_branches_and_the_plane(plane):
    rows = claims.beside(plane, STUDY.claims)["deviation"].tolist()
    assert rows == ["-7.3 %", "+0.1 %", "-4.4 %", "-0.5 %", "-2.8 %", "+0.1 %", *["none"] * 4]
