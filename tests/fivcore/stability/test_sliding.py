"""Complex modes of steady sliding against dense solves, symmetries and limits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, linear_sum_assignment

from fivcore import Beam, Rig, Scene, flutter_onsets, node_positions, sliding_modes
from fivcore.beams import modes as bases
from fivcore.beams.modes import rig_bases
from fivcore.jit import kernel
from fivcore.stability import secular, sliding
from tests.helpers import reference
from tests.helpers.rigs import angles, frictions, rigs, workshop_rig


def assert_same_modes(rig: Rig, theta: float, mu: float, fmax: float, dense: np.ndarray, tolerances) -> int:
    """Compare every oscillating mode in the band; returns how many there are."""
    above, below, growth = tolerances
    modes = sliding_modes(rig, theta, mu, fmax)
    oscillating = modes.frequency > 0.0
    mine = modes.growth_rate[oscillating] + 2j * np.pi * modes.frequency[oscillating]
    theirs = reference.damped(dense, rig.d1, rig.d2)
    theirs = theirs[theirs.imag <= 2.0 * np.pi * fmax]
    assert len(mine) == len(theirs)
    if len(mine):
        pairs = linear_sum_assignment(np.abs(mine[:, None] - theirs[None]) / np.abs(theirs))
        mine, theirs = mine[pairs[0]], theirs[pairs[1]]
        error = np.abs(mine.imag / theirs.imag - 1.0)
        low = theirs.imag < 2.0 * np.pi * 100.0
        assert np.all(error[~low] < above)
        assert np.all(error[low] < below)
        assert np.all(np.abs(mine.real - theirs.real) < growth * np.abs(theirs.imag))
    return len(mine)


@pytest.mark.parametrize(("theta", "mu"), [(5.0, 0.0), (10.0, 0.3), (-5.0, 0.2)])
def test_the_papers_mesh_against_a_dense_solve(theta, mu):
    dense = reference.sliding_eigenvalues(Rig(), theta, mu)
    # What the Rayleigh quotients of the reference allow.
    assert assert_same_modes(Rig(), theta, mu, 10e3, dense, (1e-11, 1e-11, 1e-10)) >= 10


BLOCKS = [0, *(pytest.param(block, marks=pytest.mark.slow) for block in range(1, 15))]


@pytest.mark.parametrize("block", BLOCKS)
def test_other_rigs_against_a_dense_solve(block):
    compared = 0
    for seed in range(30 * block, 30 * block + 30):
        rig = workshop_rig(seed, damping=seed % 3 > 0)
        rng = np.random.default_rng(seed)
        theta, mu = rng.uniform(-75.0, 75.0), rng.uniform(0.0, 3.0)
        fmax = 10 ** rng.uniform(2.5, 4.7)
        dense = reference.sliding_eigenvalues(rig, theta, mu)
        compared += assert_same_modes(rig, theta, mu, fmax, dense, (1e-8, 1e-7, 1e-6))
    assert compared > 100


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(500))
def test_no_eigenvalue_is_ever_unaccounted_for(seed):
    """Strong friction on odd rigs, up to where most roots come from outside the band."""
    rig = workshop_rig(seed, damping=seed % 2 > 0)
    rng = np.random.default_rng(seed)
    sliding_modes(rig, rng.uniform(-85.0, 85.0), rng.uniform(0.0, 10.0, 100), 10 ** rng.uniform(1.0, 5.0))


@pytest.mark.parametrize(("theta", "mu"), [(20.0, 0.6), (-12.0, 0.9)])
def test_a_small_mesh_against_extended_precision(theta, mu):
    rig = Rig(Beam(0.05, 0.01, 0.0015, 185e9, 7900.0, 2), Beam(0.15, 0.015, 0.003, 185e9, 7900.0, 3))
    exact = reference.sliding_eigenvalues_extended(rig, theta, mu)
    assert assert_same_modes(rig, theta, mu, 60e3, exact, (1e-10, 1e-10, 1e-10)) >= 9


@given(rigs, angles, frictions)
@settings(max_examples=60, deadline=None)
def test_mirrored_scenes_are_one(rig, theta, mu):
    """(theta, V) and (-theta, -V): the same stability; V and F irrelevant."""
    scene = Scene(0.002, theta, mu, 9.0, rig)
    assert scene.mirrored().mirrored() == scene
    assert scene.mirrored().drive_theta == scene.drive_theta
    for other in (Scene(7.0, theta, mu, 9.0, rig), Scene(0.002, theta, mu, 1e4, rig)):
        assert other.drive_theta == scene.drive_theta


def test_the_other_direction_of_sliding_is_the_other_inclination():
    """A dense solve with the friction force reversed, V < 0, against the scene in the mirror."""
    rig, theta, mu = workshop_rig(11), -8.0, 0.4
    scene = Scene(-0.005, theta, mu, 9.0, rig)
    dense = reference.sliding_eigenvalues(rig, theta, -mu)
    assert assert_same_modes(rig, scene.drive_theta, mu, 20e3, dense, (1e-8, 1e-7, 1e-6)) > 3


@given(st.integers(0, 10_000), angles, frictions, st.floats(1e3, 20e3))
@settings(max_examples=60, deadline=None)
def test_upright_or_frictionless_is_stable(seed, theta, mu, fmax):
    rig = workshop_rig(seed)
    assert not np.any(sliding_modes(rig, 0.0, mu, fmax).unstable)
    assert not np.any(sliding_modes(rig, theta, 0.0, fmax).unstable)
    assert len(flutter_onsets(rig, 0.0, fmax).mu) == 0


@pytest.mark.parametrize("d1", [1e6, 1e12])
def test_heavy_damping_does_not_cancel(d1):
    """Overdamped: the slower root is -lambda / d1 to first order, and never an oscillation."""
    modes = sliding_modes(Rig(d1=d1, d2=0.0), 5.0, 0.05, 30.0)
    slow = -modes.eigenvalue.real / d1
    np.testing.assert_allclose(
        modes.growth_rate[-1], slow[-1], rtol=5.0 * modes.eigenvalue[-1].real / d1**2 + 1e-12
    )
    np.testing.assert_array_equal(modes.frequency, 0.0)


def test_the_papers_unstable_pairs_at_its_operating_point_and_modes_5_and_6_without_friction():
    modes = sliding_modes(Rig(), 5.0, 0.2)
    np.testing.assert_allclose(modes.frequency[modes.unstable], [398.0, 2794.0], atol=0.5)
    np.testing.assert_allclose(modes.growth_rate[modes.unstable], [384.0, 1764.0], atol=0.5)
    np.testing.assert_allclose(sliding_modes(Rig(), 5.0, 0.0).frequency[4:6], [2530.0, 3087.0], atol=1.0)


def test_proportional_damping_only_maps_the_eigenvalues():
    undamped = Rig(d1=0.0, d2=0.0)
    bare, damped = sliding_modes(undamped, 5.0, 0.2), sliding_modes(Rig(), 5.0, 0.2)
    np.testing.assert_allclose(np.sort(bare.eigenvalue), np.sort(damped.eigenvalue), rtol=1e-12)
    # Without damping and below every onset nothing grows or decays at all.
    assert np.all(sliding_modes(undamped, 5.0, 0.1).growth_rate == 0.0)


@given(rigs, angles, st.lists(frictions, min_size=2, max_size=12), st.floats(500.0, 30e3))
@settings(max_examples=60, deadline=None)
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


@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_shapes_solve_the_equations_of_motion(mu):
    """In the reference's finite elements: (K - lambda M) u = (G_N + mu G_T) N and G_N u = 0."""
    rig, theta = workshop_rig(4), 12.0
    k, m, normal, tangential = reference.assemble(rig, theta)
    modes = sliding_modes(rig, theta, mu, 12e3)
    n1 = rig.p1.elements
    assert len(modes.frequency) > 4
    for value, shape in zip(modes.eigenvalue, modes.shape, strict=True):
        assert np.max(np.abs(shape[:, :2])) == pytest.approx(1.0)
        upper, lower = shape[: n1 + 1][::-1], shape[n1 + 1 :]
        u = np.concatenate([upper[:-1].ravel(), upper[-1, 1:2], lower[1:].ravel()])
        force = normal + mu * tangential
        residual = k @ u - value * (m @ u)
        residual -= force * (force @ residual) / (force @ force)
        # Measured against the forces that balance in it.
        assert np.max(np.abs(residual)) < 1e-7 * np.max(np.abs(k) @ np.abs(u))
        assert abs(normal @ u) < 1e-7 * np.abs(normal) @ np.abs(u) + 1e-9


def test_node_positions_go_from_the_support_over_the_contact_to_the_free_end():
    positions = node_positions(Rig(), 30.0)
    np.testing.assert_allclose(positions[0], 0.05 * np.array([0.5, np.sqrt(0.75)]), rtol=1e-12)
    np.testing.assert_allclose(positions[30], 0.0, atol=1e-15)
    np.testing.assert_allclose(positions[[31, -1]], [[-0.08, 0.0], [0.07, 0.0]], atol=1e-15)


def test_a_contact_at_a_node_of_a_mode_leaves_that_mode_alone():
    """The second bending mode of a cantilever has a node at 0.7834 of its length: hidden, not lost."""
    rig = Rig(p2=Beam(0.15, 0.015, 0.003, 185e9, 7900.0, 40), d1=0.0, d2=0.0)

    def second_mode(x):
        return rig_bases(replace(rig, contact_position=x), 5.0)[1].normal[1]

    at_node = replace(rig, contact_position=brentq(second_mode, 0.7 * 0.15, 0.9 * 0.15, xtol=1e-16))
    second = np.sqrt(rig_bases(at_node, 5.0)[1].stiffness[1]) / (2.0 * np.pi)
    found = sliding_modes(at_node, 5.0, 0.1)
    assert np.min(np.abs(found.frequency / second - 1.0)) < 1e-12
    dense = reference.sliding_eigenvalues(at_node, 5.0, 0.1)
    assert_same_modes(at_node, 5.0, 0.1, 8e3, dense, (1e-8, 1e-7, 1e-6))


def test_two_modes_of_one_frequency_keep_both_eigenvalues(monkeypatch):
    """A mode of P1 and one of P2 that coincide to the last bit: one combination is hidden."""
    stiffness, normal, tangential = bases.contact_modes(Rig(), 5.0)
    changed = stiffness.copy()
    p1_mode, p2_mode = 2, 91 + 3
    changed[p1_mode] = changed[p2_mode]
    apart = changed.copy()
    apart[p1_mode] *= 1.0 + 1e-9
    counts = []
    for values in (changed, apart):
        monkeypatch.setattr(secular, "contact_modes", lambda *_, v=values: (v, normal, tangential))
        secular.sliding_problem.cache_clear()
        counts.append(sliding_modes(Rig(), 5.0, 0.1))
    secular.sliding_problem.cache_clear()
    np.testing.assert_allclose(counts[0].frequency, counts[1].frequency, rtol=1e-8)


def test_divergence_is_a_growing_mode_that_does_not_oscillate():
    theta, mu = 30.0, 3.0
    found = ((rig, sliding_modes(rig, theta, mu, 10e3)) for rig in map(workshop_rig, range(200)))
    rig, modes = next(pair for pair in found if np.any((pair[1].frequency == 0.0) & pair[1].unstable))
    still = modes.frequency == 0.0
    dense = reference.sliding_eigenvalues(rig, theta, mu)
    real = dense[(np.abs(dense.imag) < 1e-9 * np.abs(dense)) & (dense.real < 0.0)].real
    for value in modes.eigenvalue[still & modes.unstable].real:
        assert np.min(np.abs(real / value - 1.0)) < 1e-6


def test_the_count_by_the_argument_principle_notices_a_missing_root():
    problem = secular.sliding_problem(Rig(), 5.0, 10e3)
    residues, tail = (each[0] + 0.2 * each[1] for each in (problem.residues, problem.tail))
    assert secular.find_roots(problem.guesses.copy(), problem.poles, residues, tail) == 0
    assert secular.find_roots(problem.guesses[:8].copy(), problem.poles, residues, tail) > 0


def test_too_few_guesses_are_made_good(monkeypatch):
    """What friction brings in from outside the band is found from further guesses."""
    expected = sliding_modes(Rig(), 6.5, [0.1, 0.4])
    whole = secular.sliding_problem(Rig(), 6.5, 10e3)
    monkeypatch.setattr(sliding, "sliding_problem", lambda *_: replace(whole, guesses=whole.guesses[:3]))
    found = sliding_modes(Rig(), 6.5, [0.1, 0.4])
    np.testing.assert_allclose(found.frequency, expected.frequency, rtol=1e-9)
    np.testing.assert_allclose(found.growth_rate, expected.growth_rate, rtol=1e-6, atol=1e-6)


def test_a_kernel_compiles_without_a_place_to_keep_it(monkeypatch):
    def nowhere(self):
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr("numba.core.dispatcher.Dispatcher.enable_caching", nowhere)

    @kernel
    def twice(x):
        return 2.0 * x

    assert twice(1.5) == 3.0


@pytest.mark.parametrize("fmax", [15.0, 1e3, 3e5])
def test_any_band_gives_the_same_modes(fmax):
    wide = sliding_modes(Rig(), 5.0, 0.2, 40e3)
    some = sliding_modes(Rig(), 5.0, 0.2, fmax)
    count = min(np.count_nonzero(wide.frequency <= fmax), len(some.frequency))
    assert count == np.count_nonzero(wide.frequency <= min(fmax, 40e3))
    np.testing.assert_allclose(some.frequency[:count], wide.frequency[:count], rtol=1e-10)
