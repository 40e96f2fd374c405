"""Modes of steady sliding and of the glued beams: known values, a second rig, extended precision, limits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq, linear_sum_assignment

from fivcore import Beam, Rig, Scene, flutter_onsets, flutter_onsets_many, glued_frequencies, sliding_modes
from fivcore import tune_head_mass as tuned
from fivcore.beams.modes import rig_bases
from tests import known
from tests.helpers import reference
from tests.helpers.rigs import workshop_rig

# Known values, by every method that claims them.


def onsets_of_many(rig, theta):
    return flutter_onsets_many({"theta": theta}, rig=rig)


@pytest.mark.parametrize("method", [flutter_onsets, onsets_of_many])
@pytest.mark.parametrize("row", known.ONSETS, ids=lambda row: row.source)
def test_flutter_onsets(row, method):
    found = method(row.rig, row.theta)
    mu, frequency = np.ravel(found.mu), np.ravel(found.frequency)
    np.testing.assert_allclose(mu, row.mu, atol=row.error)
    if row.frequency:
        np.testing.assert_allclose(frequency, row.frequency, atol=0.5)
    np.testing.assert_allclose(np.ceil(100.0 * mu) / 100.0, known.FIRST_UNSTABLE)


def modes_secular(rig, theta, mu):
    found = sliding_modes(rig, theta, mu)
    return found.growth_rate + 2j * np.pi * found.frequency


def modes_assembled(rig, theta, mu):
    phi = reference.damped(reference.sliding_eigenvalues(rig, theta, mu), rig.d1, rig.d2)
    return phi[phi.imag < 2e4 * np.pi]


@pytest.mark.parametrize("method", [modes_secular, modes_assembled])
@pytest.mark.parametrize("row", known.MODES, ids=lambda row: row.source)
def test_modes_of_steady_sliding(row, method):
    found = method(Rig(), 5.0, row.mu)
    found = found[found.real > 0.0] if row.places is None else found[row.places]
    np.testing.assert_allclose(found.imag / (2.0 * np.pi), row.frequency, atol=row.error)
    if row.growth_rate:
        np.testing.assert_allclose(found.real, row.growth_rate, atol=row.error)


def glued_assembled(rig, theta, count):
    return np.sqrt(reference.glued_eigenvalues(rig, theta)[:count]) / (2.0 * np.pi)


@pytest.mark.parametrize("method", [glued_frequencies, glued_assembled])
def test_table_4_is_found_at_85_mm_and_not_at_80_mm(method):
    rig = replace(known.AT_85, head_mass=tuned(known.AT_85, 5.0, known.TABLE_4[0]))
    assert rig.head_mass == pytest.approx(Rig().head_mass, abs=1e-4)
    np.testing.assert_allclose(method(rig, 5.0, 8), known.TABLE_4, rtol=0.0025)
    assert method(known.AT_85, 5.0, 9)[8] == pytest.approx(8237.0, abs=1.0)
    at_80 = replace(Rig(), head_mass=tuned(Rig(), 5.0, known.TABLE_4[0]))
    assert np.abs(method(at_80, 5.0, 8) / known.TABLE_4 - 1.0).max() > 0.1
    assert method(Rig(), 5.0, 1)[0] == pytest.approx(17.5, abs=0.05)


# Glued beams.
@pytest.mark.parametrize("seed", range(6))
def test_glued_frequencies_are_those_of_a_dense_solve(seed):
    rig, theta = (known.AT_85, 5.0) if seed == 0 else (workshop_rig(seed), 7.0 * seed - 40.0)
    np.testing.assert_allclose(glued_frequencies(rig, theta, 12), glued_assembled(rig, theta, 12), rtol=1e-10)


# Steady sliding against a second rig.
def assert_same_modes(rig, theta, mu, fmax, dense, tolerances):
    """Every oscillating mode in the band is that of a dense solve; returns how many there are."""
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
    rig, rng = workshop_rig(seed, damping=seed % 2 > 0), np.random.default_rng(seed)
    sliding_modes(rig, rng.uniform(-85.0, 85.0), rng.uniform(0.0, 10.0, 100), 10 ** rng.uniform(1.0, 5.0))


@pytest.mark.parametrize(("theta", "mu"), [(20.0, 0.6), (-12.0, 0.9)])
def test_a_small_mesh_against_extended_precision(theta, mu):
    rig = Rig(Beam(0.05, 0.01, 0.0015, 185e9, 7900.0, 2), Beam(0.15, 0.015, 0.003, 185e9, 7900.0, 3))
    exact = reference.sliding_eigenvalues_extended(rig, theta, mu)
    assert assert_same_modes(rig, theta, mu, 60e3, exact, (1e-10, 1e-10, 1e-10)) >= 9


def test_the_other_direction_of_sliding_is_the_other_inclination():
    """A dense solve with the friction force reversed, V < 0, against the scene in the mirror."""
    rig, theta, mu = workshop_rig(11), -8.0, 0.4
    dense = reference.sliding_eigenvalues(rig, theta, -mu)
    mirrored = Scene(-0.005, theta, mu, 9.0, rig).drive_theta
    assert assert_same_modes(rig, mirrored, mu, 20e3, dense, (1e-8, 1e-7, 1e-6)) > 3


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


def test_divergence_is_a_growing_mode_that_does_not_oscillate():
    theta, mu = 30.0, 3.0
    found = ((rig, sliding_modes(rig, theta, mu, 10e3)) for rig in map(workshop_rig, range(200)))
    rig, modes = next(pair for pair in found if np.any((pair[1].frequency == 0.0) & pair[1].unstable))
    dense = reference.sliding_eigenvalues(rig, theta, mu)
    real = dense[(np.abs(dense.imag) < 1e-9 * np.abs(dense)) & (dense.real < 0.0)].real
    for value in modes.eigenvalue[(modes.frequency == 0.0) & modes.unstable].real:
        assert np.min(np.abs(real / value - 1.0)) < 1e-6


# Limits, and modes that are hard to find.
@pytest.mark.parametrize("d1", [1e6, 1e12])
def test_heavy_damping_does_not_cancel(d1):
    """Overdamped: the slower root is -lambda / d1 to first order, and never an oscillation."""
    modes = sliding_modes(Rig(d1=d1, d2=0.0), 5.0, 0.05, 30.0)
    slow, small = -modes.eigenvalue[-1].real / d1, modes.eigenvalue[-1].real / d1**2
    np.testing.assert_allclose(modes.growth_rate[-1], slow, rtol=5.0 * small + 1e-12)
    np.testing.assert_array_equal(modes.frequency, 0.0)


def test_proportional_damping_only_maps_the_eigenvalues():
    undamped = Rig(d1=0.0, d2=0.0)
    bare, damped = sliding_modes(undamped, 5.0, 0.2), sliding_modes(Rig(), 5.0, 0.2)
    np.testing.assert_allclose(np.sort(bare.eigenvalue), np.sort(damped.eigenvalue), rtol=1e-12)
    # Without damping and below every onset nothing grows or decays at all.
    assert np.all(sliding_modes(undamped, 5.0, 0.1).growth_rate == 0.0)


def test_a_contact_at_a_node_of_a_mode_leaves_that_mode_alone():
    """The second bending mode of a cantilever has a node at 0.7834 of its length: hidden, not lost."""
    rig = Rig(p2=Beam(0.15, 0.015, 0.003, 185e9, 7900.0, 40), d1=0.0, d2=0.0)

    def second_mode(x):
        return rig_bases(replace(rig, contact_position=x), 5.0)[1].normal[1]

    at_node = replace(rig, contact_position=brentq(second_mode, 0.7 * 0.15, 0.9 * 0.15, xtol=1e-16))
    second = np.sqrt(rig_bases(at_node, 5.0)[1].stiffness[1]) / (2.0 * np.pi)
    assert np.min(np.abs(sliding_modes(at_node, 5.0, 0.1).frequency / second - 1.0)) < 1e-12
    dense = reference.sliding_eigenvalues(at_node, 5.0, 0.1)
    assert_same_modes(at_node, 5.0, 0.1, 8e3, dense, (1e-8, 1e-7, 1e-6))
