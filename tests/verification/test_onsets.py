"""Flutter onsets: dense solves', closed forms', and none missed; those of many rigs are those of one at a time."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import brentq

from fivcore import Beam, Rig, flutter_onsets, flutter_onsets_many, sliding_modes
from fivcore.beams.modes import contact_modes
from fivcore.beams.similar import unit_cantilever
from fivcore.contact.compression import FAR
from fivcore.rig import P1, P2
from fivcore.stability import many
from fivcore.stability.onsets import (
    MOST_INTERVALS,
    NONE,
    ONE,
    PATH_TOP,
    classify_interval,
    divergence_onset,
    isolate,
    onset_friction,
    onset_function,
    onset_root,
)
from fivcore.stability.sampled import STEPS
from tests import known
from tests.helpers import reference
from tests.helpers.rigs import workshop_rig
from tests.helpers.scattered import rig_of, scattered


def growth(rig, theta, mu, frequency):
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


# None is missed.
def right_half_plane(rig, theta, mu, fmax):
    """Growing eigenvalues phi: two for a growing oscillation, one for a divergence."""
    modes = sliding_modes(rig, theta, mu, fmax)
    return np.sum(modes.unstable * np.where(modes.frequency > 0.0, 2, 1), axis=-1)


BLOCKS = [0, *(pytest.param(block, marks=pytest.mark.slow) for block in range(1, 60))]


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
        crossings = many.crossings(many.rig_table({"theta": theta}, rig), fmax, 0.9, rig)[0].T
        at_top = crossings[(crossings[:, 2] > fmax) & (crossings[:, 2] <= PATH_TOP * fmax)]
        up = up + ((at_top[:, 1] < mu[:, None]) * np.sign(at_top[:, 3]).astype(int)).sum(axis=1)
        entered += len(found.entry_mu)
        # A divergence that comes from beyond the band is not a flutter: from there on nothing is compared.
        wider = sliding_modes(rig, theta, mu, 1.3 * fmax)
        violent = wider.unstable & ((wider.frequency == 0.0) | (np.abs(wider.eigenvalue) > (6.0 * fmax) ** 2))
        fit = ~np.maximum.accumulate(np.any(violent, axis=-1))
        assert_array_equal(right_half_plane(rig, theta, mu, fmax)[fit], 2 * up[fit], str(seed))
        checked += len(np.nonzero(up[fit])[0])
    assert checked > 100
    assert entered > 0 or block not in (0, 1)


def test_a_pair_that_enters_the_band_already_growing():
    rig = Rig(replace(P1, length=0.045625), contact_position=0.068125)
    found, [entry] = flutter_onsets(rig, 8.0), flutter_onsets(rig, 8.0).entry_mu
    assert entry < found.mu[0]
    modes = sliding_modes(rig, 8.0, [entry * (1.0 - 1e-6), entry * (1.0 + 1e-6)])
    assert_array_equal(modes.unstable.sum(axis=-1), [0, 1])
    assert_allclose(modes.frequency[modes.unstable], 10e3, rtol=1e-6)
    of_many = flutter_onsets_many({"theta": 8.0}, rig=rig)
    assert_allclose(of_many.entry_mu, [[entry]], rtol=1e-10)
    assert_array_equal(of_many.unstable([0.2, 0.26, 0.5]), [[False, True, True]])


@pytest.mark.parametrize(("theta", "last"), [(0.03, 0.1), (5.0, 0.9)])
def test_identical_beams_whose_modes_all_but_coincide(theta, last):
    """Nearly coincident poles: neither a growing mode without an onset nor the reverse."""
    beam = Beam(0.1, 0.01, 0.002, 185e9, 7900.0, 24)
    rig = Rig(beam, beam, 0.05, 2.9434, 0.0, 0.0)
    mu = np.linspace(0.0, last, 960)
    found = flutter_onsets(rig, theta, 20e3)
    up = (found.mu < mu[:, None]).sum(axis=1) - (found.recovery_mu < mu[:, None]).sum(axis=1)
    assert_array_equal(right_half_plane(rig, theta, mu, 20e3), 2 * up)


def test_heavy_damping_hides_no_growing_mode():
    rig = Rig(d1=2e4)
    found = flutter_onsets(rig, 5.0, 100.0, 20.0)
    assert len(found.mu) == 1
    for fmax in (100.0, 10e3):
        assert not np.any(sliding_modes(rig, 5.0, found.mu[0] * (1.0 - 1e-6), fmax).unstable[:1])
        assert np.any(sliding_modes(rig, 5.0, found.mu[0] * (1.0 + 1e-6), fmax).unstable)


@pytest.mark.parametrize("seed", range(4))
def test_undamped_onsets_are_the_limit_of_damped_ones(seed):
    rig = workshop_rig(seed, damping=False)
    bare, light = (flutter_onsets(each, 8.0, 5e3) for each in (rig, replace(rig, d1=1e-3, d2=1e-13)))
    assert_allclose(bare.mu, light.mu, rtol=1e-6)
    assert_allclose(bare.recovery_mu, light.recovery_mu, rtol=1e-6)


def test_two_degrees_of_freedom_coalesce_where_the_closed_form_says():
    """Mode coupling written as a gap held by a contact spring kn.

    The receptances are then those of the free modes: two poles from the uncoupled system, K0 = K - kn e2 e2', and
    a constant 1 / kn, which a very high pole provides. The common eigenvalue is the mean of the diagonal.
    """
    values, vectors = np.linalg.eigh(np.array([[known.K11, known.K12], [known.K12, known.K22 - known.KN]]))
    stiff, scale, brackets = 1e14, 4.0, np.empty((MOST_INTERVALS, 3))
    a, b = np.append(vectors[1] ** 2, stiff / known.KN), np.append(-vectors[1] * vectors[0], 0.0)
    poles_of, rest = (np.append(values, stiff) / scale, a / scale, b / scale), (0.0, 0.0)
    assert isolate(*poles_of, *rest, 5.0, brackets)[0] == 1
    system = (int(brackets[0, 2]), *poles_of, *rest)
    omega = onset_root(brackets[0, 0], brackets[0, 1], *system)
    assert onset_friction(omega, *system) == pytest.approx(known.CRITICAL, rel=1e-10)
    assert scale * omega**2 == pytest.approx(0.5 * (known.K11 + known.K22), rel=1e-10)


# Many rigs, by modes from similarity and a secular equation.
FIELDS = ("mu", "frequency", "recovery_mu", "recovery_frequency", "entry_mu")


def made(p1=None, p2=None, **change):
    return Rig(replace(P1, **(p1 or {})), replace(P2, **(p2 or {})), **change)


EXTREMES = {
    "paper": (made(), 5.0),
    "upright": (made(), 0.0),
    "leaning back": (made(), -80.0),
    "hardly leaning": (made(), 1e-3),
    "no head, upright": (made(head_mass=0.0), 0.0),
    "heavy head": (made(head_mass=1e15), 5.0),
    "undamped": (made(d1=0.0, d2=0.0), 5.0),
    "heavily damped": (made(d1=2e4, d2=1e-5), 5.0),
    "one element": (made({"elements": 1}, {"elements": 1}), 7.0),
    "200 elements": (made({"elements": 200}, {"elements": 200}), 7.0),
    "stiff on soft": (made({"young_modulus": 1e20}, {"young_modulus": 1e9}), 7.0),
    "soft on stiff": (made({"young_modulus": 1e9}, {"young_modulus": 1e20}), 7.0),
    "contact at the end": (made(contact_position=0.15), 7.0),
}
WORKSHOP = {f"workshop {s}": (workshop_rig(s, s % 3 > 0), 80.0 * np.sin(s + 1.0)) for s in range(10)}
CASES = [pytest.param(*case, id=name) for name, case in (EXTREMES | WORKSHOP).items()]


def poles(rig, theta, limit):
    """Poles and residues of a rig, ascending, those beyond FAR `limit` (rad2/s2) replaced."""
    beams = (unit_cantilever(beam.elements) for beam in (rig.p1, rig.p2))
    system = np.stack(many.contact_poles(many.rig_table({"theta": theta}, rig)[0], 1.0, limit, *beams))
    return system[:, np.argsort(system[0], kind="stable")]


@pytest.mark.parametrize(("rig", "theta"), CASES)
def test_modes_from_similarity_and_onsets_are_those_of_one_rig(rig, theta):
    p, normal, tangential = contact_modes(rig, theta)
    order = np.argsort(p, kind="stable")
    p, normal, tangential = (each[order][normal[order] != 0.0] for each in (p, normal, tangential))
    mine = poles(rig, theta, np.inf)
    # The larger of the two shapes carries the rounding of the eigenvectors.
    rounding = max(1e-11, 1e-15 * max(rig.p1.elements, rig.p2.elements) ** 2.2)
    assert_allclose(mine[0], p, rtol=rounding)
    assert_allclose(mine[1], normal**2, rtol=0.0, atol=30.0 * rounding * np.max(normal**2))
    scale = np.abs(normal).max() * np.abs(tangential).max()
    assert_allclose(mine[2], normal * tangential, rtol=0.0, atol=30.0 * rounding * scale)
    # Poles far beyond the band are replaced by a few.
    unit = (2e4 * np.pi) ** 2
    far, new = (each[:, each[0] > FAR * unit] for each in (mine, poles(rig, theta, unit)))
    for x in unit * np.array([-4.0, -1.0, 0.0, 0.5, 1.0, 1.0 - 0.3j, -1j]):
        terms = np.sum(np.abs(far[1:]) / far[0], axis=1)
        exact, found = (np.sum(each[1:] / (each[0] - x), axis=1) for each in (far, new))
        assert np.all(np.abs(found - exact) <= 1e-14 * terms)
    one, found = flutter_onsets(rig, theta), flutter_onsets_many({"theta": theta}, rig=rig)
    for name in FIELDS:
        assert_allclose(getattr(found, name)[0], getattr(one, name), rtol=1e-10, err_msg=name)


def test_onsets_where_every_number_is_scattered():
    """Those of one rig at a time."""
    numbers = scattered(60)
    found = flutter_onsets_many(numbers, 8e3, 0.8)
    for row in range(60):
        rig, theta = rig_of(numbers, row), float(numbers["theta"][row])
        one = flutter_onsets(rig, theta, 8e3, 0.8)
        for name in FIELDS:
            values = getattr(found, name)[row]
            assert_allclose(values[np.isfinite(values)], getattr(one, name), rtol=1e-10)


def counted(found, mu):
    """Growing eigenvalues of each rig at its own friction, by the changes of their number."""
    return np.sum(np.where(found.change_mu < mu[:, None], found.change, 0.0), axis=1)


POINTS = [40, pytest.param(2000, marks=pytest.mark.slow)]


@pytest.mark.parametrize("fmax", [3e3, 20e3])
@pytest.mark.parametrize("count", POINTS)
def test_rigs_have_the_growing_modes_that_sliding_has(count, fmax):
    """Also those that enter the band while they grow, and those that do not oscillate."""
    numbers, mu = scattered(count, count, 0.3), np.random.default_rng(count).uniform(0.0, 1.0, count)
    found = flutter_onsets_many(numbers, fmax)
    unstable, expected, real = found.unstable(mu[:, None])[:, 0], np.empty(count), np.empty(count, dtype=bool)
    for row in range(count):
        modes = sliding_modes(rig_of(numbers, row), float(numbers["theta"][row]), mu[row], fmax)
        expected[row] = np.sum(np.where(modes.frequency > 0.0, 2, 1)[modes.unstable])
        real[row] = np.any(modes.unstable & (modes.frequency == 0.0))
    assert_array_equal(counted(found, mu), expected)
    assert_array_equal(unstable, expected > 0)
    assert np.all(found.divergence_mu[real] < mu[real])
    assert 0.1 < unstable.mean() < 0.9
    assert np.any(real)


# Parts of the search.
def test_an_angle_of_rounding_couples_no_further_modes():
    assert poles(Rig(), 1e-15, np.inf).shape == poles(Rig(), 0.0, np.inf).shape


def test_no_interval_with_an_onset_is_left_out():
    """About the onsets of modes near each other, against samples of the receptances themselves."""
    rng, grid, judged = np.random.default_rng(0), np.linspace(0.01, 0.99, 1000), []

    def seen(omega, system, d1, d2):
        """Signs of W, and mu, between samples."""
        p, a, b = system[:, :, None]
        gap = p - (omega**2 - 1j * d1 * omega) / (1.0 + 1j * d2 * omega)
        A, B = np.sum(a / gap, axis=0), np.sum(b / gap, axis=0)
        positive, mu = (A * B.conj()).imag < 0.0, -(A / B).real[1:]
        return (positive[1:] != positive[:-1]), (mu > 0.0) & (mu <= 5.0)

    while len(judged) < 1000:
        n, t = rng.normal(size=(2, rng.integers(2, 5)))
        system = np.stack([rng.uniform(0.1, 0.8) + rng.uniform(-0.1, 0.1, len(n)), n * n, n * t])
        damping = 10.0 ** rng.uniform(-4.0, -1.0, 2)
        for place in np.flatnonzero(np.logical_and(*seen(grid, system, *damping))):
            width = 10.0 ** rng.uniform(-3.0, -1.0)
            low = max(grid[place] - width * rng.random(), 1e-3)
            high = min(low + width, 1.0)
            nearest = int(np.argmin(np.abs(system[0] - (0.5 * (low + high)) ** 2)))
            verdict = classify_interval(low, high, np.nan, nearest, *system, *damping, 5.0)[0]
            flips, wanted = seen(np.linspace(low, high, 400), system, *damping)
            assert verdict != NONE or not np.any(flips & wanted)
            assert verdict != ONE or np.sum(flips) == 1
            judged.append(verdict)
    assert min(judged.count(NONE), judged.count(ONE)) > 10


def test_the_bound_on_the_curvature_is_thrice_the_curvature():
    """Near a pole that moves no gap, where of two others one moves the normal gap and one couples both.

    With u_i = 1 / (p_i - lambda), W'' is 2 (lambda')^2 (|u_1| + |u_2|) and its bound 6 of these, times the same.
    """
    system, low, high = np.array([[0.25, 0.27, 0.05], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]), 0.4999, 0.5001
    w = [onset_function(omega, 0, *system, 0.0, 0.0) for omega in (low, 0.5, high)]
    curvature = 4.0 * abs(w[0] - 2.0 * w[1] + w[2])

    def promised(change):
        """Whether a change of W by so much is enough for one zero."""
        return classify_interval(low, high, w[2] - change, 0, *system, 0.0, 0.0, 1e9)[0] == ONE

    assert promised(3.5 * curvature)
    assert not promised(2.9 * curvature)


def test_the_least_friction_of_divergence_is_where_its_derivative_is_zero():
    """Without damping it is a ratio of polynomials in phi^2."""
    p, a, b = np.array([0.5, 1.0, 2.0]), np.array([1.0, 0.3, 1.0]), np.array([-0.2, -1.0, -0.1])
    A, B = (np.poly1d(sum(each[i] * np.poly(-np.delete(p, i)) for i in range(3))) for each in (a, b))
    (x,) = [root.real for root in (A.deriv() * B - A * B.deriv()).roots if root.real > 0.0]
    assert divergence_onset(p, 0.0 * p, a, b, 10.0) == pytest.approx(-A(x) / B(x), rel=1e-12)
    assert np.isnan(divergence_onset(p, 0.0 * p, a, b, -0.99 * A(x) / B(x)))


def test_samples_are_at_least_twice_as_dense_each_time():
    assert np.all(np.divide(STEPS[:-1], STEPS[1:]) >= 2.0)
