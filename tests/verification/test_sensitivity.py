"""Derivatives of onsets: differences of onsets, what dimensions demand, limits of parameters, folds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import lu_factor, lu_solve

from fivcore import Rig, flutter_onsets, flutter_onsets_many, onset_curves, onset_sensitivity
from fivcore.stability.sensitivity import CENTRAL, RELATIVE_STEP
from studies.accuracy.rigs import drawn_scene
from studies.declaring.parameters import rig_numbers
from tests.helpers.reference import assemble
from tests.helpers.rigs import workshop_rig

BARE = {"d1": 0.0, "d2": 0.0}
# Rigs drawn at random, with and without damping.
SOME = [*range(6), *(pytest.param(number, marks=pytest.mark.slow) for number in range(6, 20))]


@pytest.mark.parametrize("damping", [{}, BARE])
@pytest.mark.parametrize("number", SOME)
def test_derivatives_are_differences_of_onsets(number, damping):
    scene, step = drawn_scene(2010, number), 1e-5
    rig, theta = replace(scene.rig, **damping), scene.theta
    mine, values = onset_sensitivity(rig, theta), rig_numbers(rig) | {"theta": theta}
    assert len(mine.mu)
    assert not np.any(mine.fold)

    def changed(name, way):
        numbers = values | {name: values[name] * (1.0 + way)}
        angle = numbers.pop("theta")
        found = flutter_onsets(Rig.of(**numbers), angle)
        return np.stack([found.mu, found.frequency])

    for name, of_mu in mine.mu_normalised.items():
        slopes = (changed(name, step) - changed(name, -step)) / (2.0 * step * np.stack([mine.mu, mine.frequency]))
        found = [of_mu, mine.frequency_normalised[name]]
        np.testing.assert_allclose(found, slopes, rtol=1e-5, atol=1e-6, err_msg=name)
        np.testing.assert_allclose(mine.mu_gradient[name] * values[name], of_mu * mine.mu, rtol=1e-12)


def in_closed_form(rig, theta, mu, frequency, name):
    """d mu / dp and d frequency / dp by the implicit function theorem, at an onset of the plain model.

    F = n A^-1 (n + mu t) = 0 there, two real equations; A = (1 + d2 phi) K + (phi + d1) phi M, phi = i omega.
    Matrices change as their differences in extended precision do.
    """
    numbers, phi = rig_numbers(rig) | {"theta": theta}, 2j * np.pi * np.longdouble(frequency)

    def model(way):
        given = numbers | {name: numbers[name] * (1.0 + way * 1e-4)}
        value, angle = np.longdouble(given[name]), given.pop("theta")
        changed = Rig.of(**given)
        k, m, n, t = assemble(changed, angle, np.longdouble)
        return value, (1.0 + changed.d2 * phi) * k + (phi + changed.d1) * phi * m, n, n + mu * t, k, m, t

    (_, a, n, force, k, m, t), *changed = map(model, (0.0, -1.0, 1.0, -2.0, 2.0))
    (low, *less), (high, *more), (lower, *least), (higher, *most) = changed
    near, far = (
        [(y - x) / (end - start) for x, y in zip(one[:3], other[:3], strict=True)]
        for start, one, end, other in ((low, less, high, more), (lower, least, higher, most))
    )
    da, dn, df = ((4.0 * x - y) / 3.0 for x, y in zip(near, far, strict=True))
    factors = lu_factor(a.astype(complex))

    def solved(right):
        x = np.zeros_like(a[0])
        for _ in range(4):
            x = x + lu_solve(factors, (right - a @ x).astype(complex))
        return x

    x, y = solved(n), solved(force)
    by_omega = -1j * x @ ((rig.d2 * k + (2.0 * phi + rig.d1) * m) @ y)
    by_each = dn @ y + x @ df - x @ (da @ y)
    columns = np.array([x @ t, by_omega]).astype(complex)
    by_each = complex(by_each)
    by_mu, by_omega = np.linalg.solve([columns.real, columns.imag], [-by_each.real, -by_each.imag])
    return float(by_mu), float(by_omega) / (2.0 * np.pi)


COSTLY = [pytest.param(rig, marks=pytest.mark.slow) for rig in (Rig(), workshop_rig(14))]


@pytest.mark.parametrize("rig", [*map(workshop_rig, (1, 3, 5)), *COSTLY])
def test_derivatives_are_those_in_closed_form(rig):
    theta = 5.0 if rig == Rig() else 9.0
    mine, numbers = onset_sensitivity(rig, theta), rig_numbers(rig) | {"theta": theta}
    values = {name: numbers[name] for name in mine.mu_gradient}
    assert len(mine.mu)
    for k, (mu, frequency) in enumerate(zip(mine.mu, mine.frequency, strict=True)):
        found = np.array(
            [[each[name][k] for name in values] for each in (mine.mu_normalised, mine.frequency_normalised)]
        )
        expected = np.transpose(
            [np.array(in_closed_form(rig, theta, mu, frequency, name)) * value for name, value in values.items()]
        )
        expected /= np.array([[mu], [frequency]])
        error, size = np.abs(found - expected), np.abs(expected)
        assert np.all(error <= np.maximum(5e-8 * size, 5e-10 * size.max(axis=1, keepdims=True)))


def test_next_to_no_damping_is_none():
    bare = onset_sensitivity(Rig(**BARE), 5.0)
    for damping in ({"d1": 1e-300}, {"d1": 1e-9}, {"d1": 1e-3}, {"d2": 1e-20}):
        found = onset_sensitivity(Rig(**BARE | damping), 5.0)
        for name, each in bare.mu_normalised.items():
            np.testing.assert_allclose(found.mu_normalised[name], each, rtol=1e-7, atol=1e-9)
            mine, expected = found.frequency_normalised[name], bare.frequency_normalised[name]
            np.testing.assert_allclose(mine, expected, rtol=1e-7, atol=1e-9)


# Dimensions.
MASSES = {"p1_density": 1.0, "p2_density": 1.0, "head_mass": 1.0}
IDENTITIES = {
    "more of all masses and stiffnesses": {"p1_young_modulus": 1.0, "p2_young_modulus": 1.0, **MASSES},
    "the same by the widths": {"p1_width": 1.0, "p2_width": 1.0, "head_mass": 1.0},
    "another unit of length": {
        **{f"{beam}_{way}": 1.0 for beam in ("p1", "p2") for way in ("length", "width", "thickness")},
        "contact_position": 1.0, "p1_density": -2.0, "p2_density": -2.0, "head_mass": 1.0,
    },
    "another unit of time": {"p1_young_modulus": 2.0, "p2_young_modulus": 2.0, "d1": 1.0, "d2": -1.0},
}  # fmt: skip


def assert_scaling(onsets, atol):
    """Nothing changes, but rates and frequencies with the unit of time."""
    for law, weights in IDENTITIES.items():
        rate = float(law == "another unit of time")
        for each, total in ((onsets.mu_normalised, 0.0), (onsets.frequency_normalised, rate)):
            terms = [weight * each[name] for name, weight in weights.items()]
            size = 1.0 + np.sum(np.abs(terms), axis=0)
            np.testing.assert_allclose(np.sum(terms, axis=0) / size, total / size, atol=atol, err_msg=law)


@pytest.mark.parametrize("rig", [Rig(), Rig(**BARE), *map(workshop_rig, (1, 3, 5, 9, 14))])
def test_scaled_rigs_scale(rig):
    assert_scaling(onset_sensitivity(rig, 5.0 if rig.p1 == Rig().p1 else 9.0), 1e-9)


@pytest.mark.parametrize("theta", [5.0, 20.0])
def test_under_a_heavy_head_onsets_follow_a_closed_form(theta):
    """mu = (1 + e) tan(theta) + e / tan(theta), at a frequency that does not know theta, whatever e is.

    The differences divide the rounding of the onsets by STEP: each sensitivity is as wrong as that allows, and
    over angles next to each other the errors cancel, since they are nothing else.
    """
    rig, errors = Rig(head_mass=1e12), []
    for angle in theta * (1.0 + 1e-5 * np.arange(24)):
        found, t = onset_sensitivity(rig, angle), np.tan(np.radians(angle))
        e = (found.mu - t) / (t + 1.0 / t)
        slope = np.radians(1.0 + t**2) * (1.0 + e - e / t**2)
        of_mu = found.mu_normalised["theta"] - angle * slope / found.mu
        errors.append([of_mu, found.mu_normalised["head_mass"], found.frequency_normalised["theta"]])
    assert np.all(np.abs(np.mean(errors, axis=0)) < 1e-10)
    angles = theta * (1.0 + 1e-7 * np.arange(1000))
    near, t = flutter_onsets_many({"theta": angles}, rig=rig), np.tan(np.radians(angles))[:, None]
    e = np.median((near.mu - t) / (t + 1.0 / t), axis=0)
    rounding = np.abs(((1.0 + e) * t + e / t) / near.mu - 1.0).max(axis=0)
    of_frequency = np.ptp(near.frequency, axis=0) / near.frequency[0]
    lost = np.maximum([rounding, rounding, of_frequency], np.finfo(float).eps)
    assert np.all(np.abs(errors).max(axis=0) <= np.abs(CENTRAL[1]).sum() / RELATIVE_STEP * lost)


# Limits of parameters.
def test_at_the_limit_of_a_parameter_the_derivative_is_that_towards_its_range():
    """No damping, no head, contact at P2's end, P1 all but lying: units still demand their sums."""
    rig = Rig(contact_position=0.15, head_mass=0.0, **BARE)
    for theta in (7.0, 89.9):
        found = onset_sensitivity(rig, theta, 10e3, 1.0 if theta < 45.0 else 1e4)
        assert len(found.mu)
        assert_scaling(found, 1e-6)
        for name in ("d1", "d2"):
            np.testing.assert_array_equal(found.mu_normalised[name], 0.0)


# Where there is no derivative.
@pytest.mark.parametrize("seed", [9, pytest.param(42, marks=pytest.mark.slow)])
def test_at_a_fold_the_slope_is_infinite(seed):
    """Towards it the slope grows; where a step of the difference reaches the fold it is NaN."""
    rig = workshop_rig(seed)
    curves = onset_curves(rig, np.linspace(0.5, 42.0, 12)).onsets
    curve, k = next((curve, k) for curve in curves for k in (0, -1) if curve.ends[k] == "fold")
    end, frequency, inwards = curve.theta[k], curve.frequency[k], 1.0 if k == 0 else -1.0

    def near(distance):
        found = onset_sensitivity(rig, end + inwards * distance, 10e3, 1.1)
        (k,) = np.flatnonzero(np.abs(found.frequency / frequency - 1.0) < 0.02)
        return found, k

    slopes = []
    for distance in (0.1, 0.003):
        found, k = near(distance)
        slopes.append(found.mu_gradient["theta"][k])
        one, other = (near(distance + way)[0].mu[k] for way in (-1e-4, 1e-4))
        assert slopes[-1] == pytest.approx(inwards * (other - one) / 2e-4, rel=1e-3)
    # From where the two are born the onset moves downwards.
    assert inwards * slopes[1] < 2.0 * inwards * slopes[0] < 0.0
    for distance in (1e-4, 1e-7):
        found, k = near(distance)
        assert found.fold[k]
        for each in (found.mu_gradient, found.mu_normalised, found.frequency_gradient):
            assert np.all(np.isnan([each[name][k] for name in ("theta", "p1_length", "p2_length")]))
        assert np.all(np.isfinite(found.mu_gradient["theta"][~found.fold]))
