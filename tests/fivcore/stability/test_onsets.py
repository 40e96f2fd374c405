"""Flutter onsets: the paper's, dense solves', closed forms', and none missed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from fivcore import Beam, Rig, flutter_onsets, flutter_onsets_many, sliding_modes
from fivcore.beams.modes import contact_modes
from fivcore.rig import P1, P2
from fivcore.stability.onsets import (
    MOST_INTERVALS,
    entries,
    isolate,
    onset_crossings,
    onset_friction,
    onset_function,
)
from tests.helpers import reference
from tests.helpers.rigs import workshop_rig


def test_the_papers_onsets():
    found = flutter_onsets(Rig(), 5.0)
    np.testing.assert_allclose(found.mu, [0.11123, 0.15298, 0.22365], atol=1e-5)
    np.testing.assert_allclose(found.frequency, [2802.0, 398.0, 7705.0], atol=0.5)
    assert len(found.recovery_mu) == 0
    # The paper's 0.12, 0.16 and 0.23: the first unstable values on its grid of step 0.01.
    np.testing.assert_allclose(np.ceil(100.0 * found.mu) / 100.0, [0.12, 0.16, 0.23])


def test_the_onsets_with_the_head_mass_tuned_at_80_mm():
    found = flutter_onsets(Rig(head_mass=3.533), 5.0)
    np.testing.assert_allclose(found.mu, [0.1113, 0.1534, 0.2239], atol=5e-5)


def growth(rig: Rig, theta: float, mu: float, frequency: float) -> float:
    """Growth rate of the fastest growing mode near a frequency, by the dense solve."""
    phi = reference.damped(reference.sliding_eigenvalues(rig, theta, mu), rig.d1, rig.d2)
    near = np.abs(phi.imag / (2.0 * np.pi * frequency) - 1.0) < 0.02
    return float(phi.real[near].max())


@pytest.mark.parametrize("rig", [Rig(), Rig(replace(P1, elements=10), replace(P2, elements=30))])
def test_the_papers_onsets_by_a_dense_solve(rig):
    found = flutter_onsets(rig, 5.0)
    for mu, frequency in list(zip(found.mu, found.frequency, strict=True))[: 1 if rig == Rig() else 3]:
        below, above = (growth(rig, 5.0, mu * (1.0 + way), frequency) for way in (-1e-8, 1e-8))
        assert below < 0.0 < above


SOME_SEEDS = [5, 14, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (9, 21, 33, 40))]


@pytest.mark.parametrize("seed", SOME_SEEDS)
def test_other_rigs_onsets_by_a_dense_solve(seed):
    rig = workshop_rig(seed)
    found = flutter_onsets(rig, 9.0, 8e3, 1.0)
    turns = [(m, f, -1.0) for m, f in zip(found.mu, found.frequency, strict=True)]
    turns += [(m, f, 1.0) for m, f in zip(found.recovery_mu, found.recovery_frequency, strict=True)]
    for mu, frequency, sign in turns[:4]:
        low, high = mu * (1.0 - 1e-5), mu * (1.0 + 1e-5)
        assert sign * growth(rig, 9.0, low, frequency) > 0.0 > sign * growth(rig, 9.0, high, frequency)
        dense = brentq(lambda m, f=frequency: growth(rig, 9.0, m, f), low, high, xtol=1e-13)
        assert dense == pytest.approx(mu, rel=1e-8)


def right_half_plane(rig: Rig, theta: float, mu: np.ndarray, fmax: float) -> np.ndarray:
    """Growing eigenvalues phi: two for a growing oscillation, one for a divergence."""
    modes = sliding_modes(rig, theta, mu, fmax)
    return np.sum(modes.unstable * np.where(modes.frequency > 0.0, 2, 1), axis=-1)


BLOCKS = [0, 1, *(pytest.param(block, marks=pytest.mark.slow) for block in range(2, 60))]


@pytest.mark.parametrize("block", BLOCKS)
def test_no_onset_is_missed(block):
    """Counting growing modes over mu steps up and down at onsets, recoveries and the band's top, nowhere else."""
    checked = entered = 0
    for seed in range(30 * block, 30 * block + 30):
        rng = np.random.default_rng(seed)
        rig, theta, fmax = workshop_rig(seed, seed % 4 > 0), rng.uniform(1.0, 35.0), 10 ** rng.uniform(3.0, 4.2)
        found = flutter_onsets(rig, theta, fmax, 0.9)
        mu = np.sort(rng.uniform(0.0, 0.9, 60))
        up = (found.mu < mu[:, None]).sum(axis=1) - (found.recovery_mu < mu[:, None]).sum(axis=1)
        # Growing pairs come and go through the top of the band as well.
        crossings = np.array(onset_crossings(rig, theta, fmax, 0.9)).reshape(-1, 3)
        at_top = crossings[crossings[:, 1] > fmax]
        up = up + ((at_top[:, 0] < mu[:, None]) * (2 * at_top[:, 2].astype(int) - 1)).sum(axis=1)
        entered += len(found.entry_mu)
        # A divergence that comes from beyond the band is not a flutter: from there on nothing is compared.
        wider = sliding_modes(rig, theta, mu, 1.3 * fmax)
        violent = wider.unstable & ((wider.frequency == 0.0) | (np.abs(wider.eigenvalue) > (6.0 * fmax) ** 2))
        fit = ~np.maximum.accumulate(np.any(violent, axis=-1))
        np.testing.assert_array_equal(right_half_plane(rig, theta, mu, fmax)[fit], 2 * up[fit], str(seed))
        checked += len(np.nonzero(up[fit])[0])
    assert checked > 100
    assert entered > 0 or block not in (0, 1)


def test_a_pair_that_enters_the_band_already_growing():
    rig = Rig(replace(P1, length=0.045625), contact_position=0.068125)
    found, [entry] = flutter_onsets(rig, 8.0), flutter_onsets(rig, 8.0).entry_mu
    assert entry < found.mu[0]
    modes = sliding_modes(rig, 8.0, [entry * (1.0 - 1e-6), entry * (1.0 + 1e-6)])
    np.testing.assert_array_equal(modes.unstable.sum(axis=-1), [0, 1])
    np.testing.assert_allclose(modes.frequency[modes.unstable], 10e3, rtol=1e-6)
    many = flutter_onsets_many({"theta": 8.0}, rig=rig)
    np.testing.assert_allclose(many.entry_mu, [[entry]], rtol=1e-10)
    np.testing.assert_array_equal(many.unstable([0.2, 0.26, 0.5]), [[False, True, True]])


def test_a_pair_that_left_the_band_growing_and_comes_back_is_no_new_one():
    row, rises = np.array([0.0, 0.0, 0.0, 0.0, 1.0]), np.array([False, True, True, False, True])
    found = entries(row, np.array([True, True, True, True, True]), rises)
    np.testing.assert_array_equal(found, [False, False, True, False, True])


@pytest.mark.parametrize(("theta", "last"), [(0.03, 0.1), (5.0, 0.9)])
def test_identical_beams_whose_modes_all_but_coincide(theta, last):
    """Nearly coincident poles: neither a growing mode without an onset nor the reverse."""
    beam = Beam(0.1, 0.01, 0.002, 185e9, 7900.0, 24)
    rig = Rig(beam, beam, 0.05, 2.9434, 0.0, 0.0)
    mu = np.linspace(0.0, last, 960)
    found = flutter_onsets(rig, theta, 20e3)
    up = (found.mu < mu[:, None]).sum(axis=1) - (found.recovery_mu < mu[:, None]).sum(axis=1)
    np.testing.assert_array_equal(right_half_plane(rig, theta, mu, 20e3), 2 * up)


def test_heavy_damping_hides_no_growing_mode():
    rig = Rig(d1=2e4)
    found = flutter_onsets(rig, 5.0, 100.0, 20.0)
    assert len(found.mu) == 1
    for fmax in (100.0, 10e3):
        assert not np.any(sliding_modes(rig, 5.0, found.mu[0] * (1.0 - 1e-6), fmax).unstable[:1])
        assert np.any(sliding_modes(rig, 5.0, found.mu[0] * (1.0 + 1e-6), fmax).unstable)


@pytest.mark.parametrize("d2", [1e-3, 1.0, 1e3])
def test_heavy_damping_is_searched_quickly(d2):
    stiffness, normal, tangential = contact_modes(Rig(), 5.0)
    unit = 2.0 * np.pi * 10e3
    seen = normal != 0.0
    system = stiffness[seen] / unit**2, normal[seen] ** 2 / unit**2, (normal * tangential)[seen] / unit**2
    _, judged = isolate(*system, 50.0 / unit, d2 * unit, 1.0, np.empty((MOST_INTERVALS, 3)))
    assert judged < 5000


@pytest.mark.parametrize("seed", range(4))
def test_undamped_onsets_are_the_limit_of_damped_ones(seed):
    rig = workshop_rig(seed, damping=False)
    bare, light = (flutter_onsets(each, 8.0, 5e3) for each in (rig, replace(rig, d1=1e-3, d2=1e-13)))
    np.testing.assert_allclose(bare.mu, light.mu, rtol=1e-6)
    np.testing.assert_allclose(bare.recovery_mu, light.recovery_mu, rtol=1e-6)


def test_two_degrees_of_freedom_coalesce_where_the_closed_form_says():
    """Mode coupling with K = [[k11, k12 - mu kn], [k12, k22]] and unit masses (Hoffmann et al. 2002).

    Written as a gap held by a contact spring kn, the kernels' receptances become those of the free modes:
    two poles from the uncoupled system and a constant, 1 / kn, which a very high pole provides.
    """
    k11, k12, k22, kn = 3.0, 0.7, 1.6, 1.0
    expected = (k12 + (k11 - k22) ** 2 / (4.0 * k12)) / kn
    # q'' + [[k11 - mu kn * 0, ...]]: the mu term is -mu kn e1 (e2 . q), a force along 1 read along 2. With the
    # contact spring taken out of K, K0 = K - kn e2 e2', f = e2'(K0 - l)^-1 e2 - mu e2'(K0 - l)^-1 e1 + 1 / kn.
    values, vectors = np.linalg.eigh(np.array([[k11, k12], [k12, k22 - kn]]))
    stiff = 1e14
    p = np.append(values, stiff)
    a = np.append(vectors[1] ** 2, stiff / kn)
    b = np.append(-vectors[1] * vectors[0], 0.0)
    assert np.all(values > 0.0)
    scale = 4.0
    brackets = np.empty((MOST_INTERVALS, 3))
    count, _ = isolate(p / scale, a / scale, b / scale, 0.0, 0.0, 5.0, brackets)
    assert count == 1
    system = (int(brackets[0, 2]), p / scale, a / scale, b / scale, 0.0, 0.0)
    omega = brentq(onset_function, brackets[0, 0], brackets[0, 1], args=system, xtol=1e-15)
    assert onset_friction(omega, *system) == pytest.approx(expected, rel=1e-10)
    # The common eigenvalue is the mean of the diagonal.
    assert scale * omega**2 == pytest.approx(0.5 * (k11 + k22), rel=1e-10)
