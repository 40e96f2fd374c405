"""Functions of stability as callers use them: shapes, bands, batches and searches; and parts of their numerics."""

from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fivcore import (
    Rig,
    Structure,
    flutter_onsets,
    flutter_onsets_many,
    glued_frequencies,
    node_positions,
    onset_curves,
    onset_sensitivity,
    sliding_modes,
)
from fivcore.beams.modes import secular_root
from fivcore.rig import P1, P2
from fivcore.stability import many
from fivcore.stability.intervals import _dense
from tests.helpers.examples import examples
from tests.helpers.rigs import angles, frictions, rigs
from tests.helpers.scattered import scattered


@given(rigs, angles, st.lists(frictions, min_size=2, max_size=12), st.floats(500.0, 30e3))
@examples(25)
def test_a_point_has_the_same_bits_in_any_batch(rig, theta, mu, fmax):
    together = sliding_modes(rig, theta, mu, fmax)
    for i, one in enumerate(mu):
        alone = sliding_modes(rig, theta, one, fmax)
        count = len(alone.frequency)
        np.testing.assert_array_equal(together.frequency[i, :count], alone.frequency)
        np.testing.assert_array_equal(together.growth_rate[i, :count], alone.growth_rate)
        assert np.all(np.isnan(together.frequency[i, count:]))


def test_theta_and_mu_broadcast_and_places_without_a_mode_are_nan():
    modes = sliding_modes(Rig(), np.array([[4.0], [8.0]]), np.linspace(0.0, 0.5, 51))
    assert modes.frequency.shape[:2] == (2, 51)
    one = sliding_modes(Rig(), 8.0, 0.3)
    np.testing.assert_array_equal(modes.frequency[1, 30, : len(one.frequency)], one.frequency)
    gone = np.isnan(modes.frequency)
    assert gone.any()
    assert np.all(np.isnan(modes.growth_rate) == gone)
    assert np.all(modes.frequency[~gone] > 1.0)
    assert not np.any(modes.unstable & gone)


@pytest.mark.parametrize("fmax", [15.0, 1e3, 3e5])
def test_any_band_gives_the_same_modes(fmax):
    wide, some = (sliding_modes(Rig(), 5.0, 0.2, band).frequency for band in (40e3, fmax))
    count = min(np.count_nonzero(wide <= fmax), len(some))
    assert count == np.count_nonzero(wide <= min(fmax, 40e3))
    np.testing.assert_allclose(some[:count], wide[:count], rtol=1e-10)


def test_every_glued_mode_has_the_same_bits_whatever_the_count():
    everything = glued_frequencies(Rig(), 5.0, 359)
    assert np.all(np.diff(everything) >= 0.0)
    for count in (1, 6, 17):
        np.testing.assert_array_equal(glued_frequencies(Rig(), 5.0, count), everything[:count])


def test_node_positions_go_from_the_support_over_the_contact_to_the_free_end():
    positions = node_positions(Rig(), 30.0)
    np.testing.assert_allclose(positions[0], 0.05 * np.array([0.5, np.sqrt(0.75)]), rtol=1e-12)
    np.testing.assert_allclose(positions[30], 0.0, atol=1e-15)
    np.testing.assert_allclose(positions[[31, -1]], [[-0.08, 0.0], [0.07, 0.0]], atol=1e-15)


def test_results_neither_share_nor_give_away_their_arrays():
    mu = np.array([0.1, 0.2])
    modes = sliding_modes(Rig(), 5.0, mu)
    mu[:] = 0.5
    np.testing.assert_array_equal(modes.mu, [0.1, 0.2])
    found = flutter_onsets_many({"theta": 5.0})
    for part in (modes.frequency, modes.growth_rate, modes.eigenvalue, modes.theta, modes.mu, found.mu):
        with pytest.raises(ValueError, match="read-only"):
            part[...] = 0.0


def test_a_single_angle_has_no_curves_and_where_nothing_flutters_there_is_nothing():
    curves = onset_curves(Rig(), [5.0])
    np.testing.assert_array_equal(np.sort(curves.mu[0]), flutter_onsets(Rig(), 5.0).mu)
    assert all(len(curve.theta) == 1 and curve.ends == ("range", "range") for curve in curves.onsets)
    curves = onset_curves(Rig(), np.linspace(-20.0, 0.0, 5))
    assert curves.onsets == curves.recoveries == ()
    assert curves.mu.shape == curves.recovery_frequency.shape == (5, 0)
    found = onset_sensitivity(Rig(), -5.0)
    assert all(each.shape == (0,) for each in (found.mu, found.fold, *found.mu_gradient.values()))
    none = flutter_onsets_many({"theta": []})
    assert (none.mu.shape, none.unstable([0.1, 0.2]).shape) == ((0, 0), (0, 2))


def test_neither_threads_nor_neighbours_change_a_bit_of_many_rigs(monkeypatch):
    numbers = scattered(40)
    whole = flutter_onsets_many(numbers)
    monkeypatch.setattr(many, "RIGS_AT_ONCE", 7)
    parts = flutter_onsets_many(numbers, threads=2)
    alone = flutter_onsets_many({name: value[17] for name, value in numbers.items()})
    for name in (each.name for each in fields(whole) if each.name != "mu_max"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(parts, name))
        values = getattr(alone, name)[0]
        np.testing.assert_array_equal(np.atleast_1d(getattr(whole, name)[17])[: np.size(values)], values)


def test_what_is_not_named_of_many_rigs_is_the_rigs():
    rig = Rig(replace(P1, elements=6, width=0.02), replace(P2, elements=9), head_mass=1.0)
    found = flutter_onsets_many({"theta": [5.0, 12.0], "p2_density": 7000.0}, rig=rig)
    for row, theta in enumerate((5.0, 12.0)):
        one = flutter_onsets(replace(rig, p2=replace(rig.p2, density=7000.0)), theta)
        np.testing.assert_allclose(found.mu[row][np.isfinite(found.mu[row])], one.mu, rtol=1e-10)


def test_a_search_without_end_names_its_row(monkeypatch):
    search = many._search_rows

    def endless(*given):
        return *search(*given)[:2], 1 if given[0][1, 0] == 8.0 else -1

    monkeypatch.setattr(many, "RIGS_AT_ONCE", 2)
    monkeypatch.setattr(many, "_search_rows", endless)
    with pytest.raises(ArithmeticError, match="row 3, theta = 8, below fmax = 10000 Hz"):
        flutter_onsets_many({"theta": [5.0, 6.0, 7.0, 8.0]})


# Numerics.
def test_two_modes_of_one_frequency_keep_both_eigenvalues():
    """A mode of P1 and one of P2 that coincide to the last bit: one combination is hidden."""
    own, found = Structure.of(Rig(), 5.0), []
    for apart in (0.0, 1e-9):
        changed = own.stiffness.copy()
        changed[2] = changed[91 + 3] * (1.0 + apart)
        found.append(sliding_modes(replace(own, stiffness=changed), 0.0, 0.1).frequency)
    np.testing.assert_allclose(*found, rtol=1e-8)


def test_a_secular_equation_with_poles_that_all_but_coincide():
    """Roots of a rank-one change against closed-form sums of them; gaps keep their relative accuracy."""
    d = np.array([1.0, 1.0 + 4e-16, 2.0, 2.0 + 1e-9, 50.0])
    w, gap = np.array([0.3, 1e-20, 1e-8, 0.2, 3.0]), np.empty(5)
    last = np.append(d, d[-1] + 10.0)
    roots, distances = [], []
    for k in range(5):
        roots.append(secular_root(k, last, w, 0.5, gap))
        distances.append(-gap.copy())
    assert all(low <= root <= high for root, (low, high) in zip(roots, pairwise(last), strict=True))
    assert sum(roots) == pytest.approx(np.sum(d) + np.sum(w) / 0.5, rel=1e-14)
    # Residues of prod (d_i - z) / prod (root_k - z) give back the weights.
    for i, weight in enumerate(w):
        product = np.prod([distances[k][i] for k in range(5)]) / np.prod(np.delete(d, i) - d[i])
        assert 0.5 * product == pytest.approx(weight, rel=1e-12)


def test_angles_between_the_given_ones_are_at_most_a_step_apart():
    given = [0.0, 0.1, 0.5, 1.55]
    angles = _dense(np.array(given), 0.2)
    assert set(given) <= set(angles)
    assert len(angles) == 1 + 1 + 2 + 6
    assert np.diff(angles).max() < 0.2 + 1e-12
