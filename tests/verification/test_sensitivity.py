"""Derivatives of onsets and eigenvalues: extended precision's, what dimensions demand, folds and double roots."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from fivcore import Rig, flutter_onsets, onset_curves, onset_sensitivity, sliding_modes, sliding_sensitivity
from studies.accuracy.rigs import drawn_scene
from tests.helpers import extended_onsets as extended
from tests.helpers.rigs import workshop_rig

BARE = {"d1": 0.0, "d2": 0.0}
DAMPINGS = [{}, *(pytest.param(each, marks=pytest.mark.slow) for each in (BARE, {"d1": 500.0, "d2": 2e-6}))]


def coarse(rig):
    """Fewer elements: elimination along many loses digits that a difference of neighbours then wants."""
    return replace(rig, p1=replace(rig.p1, elements=8), p2=replace(rig.p2, elements=15))


@cache
def drawn(number):
    scene = drawn_scene(2010, number)
    return coarse(scene.rig), scene.theta, scene.mu


def agree(mine, theirs, error, share):
    """Elasticities agree, those below a share of the largest of a root as a part of that share."""
    largest = np.max([np.abs(each) for each in mine.values()], axis=0)
    for name, each in theirs.items():
        size = np.maximum(np.abs(mine[name]), share * largest)
        assert np.all(np.abs(each - mine[name]) < error * size), name
    assert all(np.all(mine[name] == 0.0) for name in set(mine) - set(theirs))


def onsets_agree(rig, theta, error, step):
    mine, found = onset_sensitivity(rig, theta), flutter_onsets(rig, theta)
    np.testing.assert_array_equal(mine.mu, found.mu)
    np.testing.assert_array_equal(mine.frequency, found.frequency)
    assert not np.any(mine.fold)
    assert len(found.mu)
    start = [2.0 * np.pi * found.frequency, found.mu]
    theirs = extended.elasticities(extended.numbers(rig, theta), partial(extended.onset_roots, rig), start, step)
    for k, each in enumerate((mine.frequency_elasticity, mine.mu_elasticity)):
        agree(each, {name: both[k] for name, both in theirs.items()}, error, 1e-3)
    for name, p in extended.numbers(rig, theta).items():
        np.testing.assert_allclose(mine.mu_gradient[name] * p, mine.mu_elasticity[name] * mine.mu, rtol=1e-12)
        slope, expected = mine.frequency_gradient[name] * p, mine.frequency_elasticity[name] * mine.frequency
        np.testing.assert_allclose(slope, expected, rtol=1e-12)


def eigenvalues_agree(rig, theta, mu, error, step):
    mine, modes = sliding_sensitivity(rig, theta, mu), sliding_modes(rig, theta, mu)
    np.testing.assert_array_equal(mine.eigenvalue, modes.growth_rate + 2j * np.pi * modes.frequency)
    felt = ~modes.uncoupled
    values = extended.numbers(rig, theta) | {"mu": mu}
    start = [modes.eigenvalue[felt], mine.eigenvalue[felt]]
    theirs = extended.elasticities(values, partial(extended.damped_roots, rig), start, step)
    own = {name: each[felt] for name, each in mine.elasticity.items() if values[name] != 0.0}
    agree(own, {name: both[1] for name, both in theirs.items()}, error, 1e-2)


@pytest.mark.parametrize("damping", DAMPINGS)
def test_the_papers_onsets_and_eigenvalues_follow_extended_precision(damping):
    """On its mesh, which takes digits from the reference, and on a coarse one, which does not."""
    onsets_agree(Rig(**damping), 5.0, 1e-6, 2e-4)
    onsets_agree(coarse(Rig(**damping)), 5.0, 1e-7, 5e-5)
    eigenvalues_agree(Rig(**damping), 5.0, 0.3, 1e-6, 1e-4)
    eigenvalues_agree(coarse(Rig(**damping)), 5.0, 0.3, 1e-6, 1.5e-5)
    eigenvalues_agree(coarse(Rig(**damping)), -35.0, 0.3, 1e-6, 1.5e-5)


SOME = [*range(6), *(pytest.param(number, marks=pytest.mark.slow) for number in range(6, 20))]


@pytest.mark.parametrize("number", SOME)
def test_random_rigs_onsets_and_eigenvalues_follow_extended_precision(number):
    rig, theta, mu = drawn(number)
    onsets_agree(rig, theta, 1e-7, 5e-5)
    onsets_agree(replace(rig, **BARE), theta, 1e-7, 5e-5)
    eigenvalues_agree(rig, theta, mu, 1e-6, 1.5e-5)


def test_next_to_no_damping_is_none():
    bare = onset_sensitivity(Rig(**BARE), 5.0)
    for damping in ({"d1": 1e-300}, {"d1": 1e-9}, {"d1": 1e-3}, {"d2": 1e-20}):
        found = onset_sensitivity(Rig(**BARE | damping), 5.0)
        for name, each in bare.mu_elasticity.items():
            np.testing.assert_allclose(found.mu_elasticity[name], each, rtol=1e-7, atol=1e-9)
            mine, expected = found.frequency_elasticity[name], bare.frequency_elasticity[name]
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


@pytest.mark.parametrize("law", IDENTITIES)
@pytest.mark.parametrize("rig", [Rig(), Rig(**BARE), *map(workshop_rig, (1, 3, 5, 9, 14))])
def test_scaled_rigs_scale(law, rig):
    """Nothing changes, but rates and frequencies with the unit of time."""
    theta, expected = 5.0 if rig.p1 == Rig().p1 else 9.0, float(law == "another unit of time")
    onsets, modes = onset_sensitivity(rig, theta), sliding_sensitivity(rig, theta, 0.3)
    assert len(modes.eigenvalue)
    scaled = (onsets.mu_elasticity, 0.0), (onsets.frequency_elasticity, expected), (modes.elasticity, expected)
    for each, total in scaled:
        terms = [weight * each[name] for name, weight in IDENTITIES[law].items()]
        size = 1.0 + np.sum(np.abs(terms), axis=0)
        np.testing.assert_allclose(np.sum(terms, axis=0) / size, total / size, atol=1e-9)


@pytest.mark.parametrize("theta", [5.0, 20.0])
def test_under_a_heavy_head_onsets_follow_a_closed_form(theta):
    """mu = (1 + e) tan(theta) + e / tan(theta), at a frequency that does not know theta, whatever e is."""
    found, t = onset_sensitivity(Rig(head_mass=1e12), theta), np.tan(np.radians(theta))
    e = (found.mu - t) / (t + 1.0 / t)
    slope = np.radians(1.0 + t**2) * (1.0 + e - e / t**2)
    np.testing.assert_allclose(found.mu_gradient["theta"], slope, rtol=1e-10)
    for each in (found.frequency_elasticity["theta"], found.mu_elasticity["head_mass"]):
        np.testing.assert_allclose(each, 0.0, atol=1e-10)


# Modes that the contact does not feel.
def test_a_longitudinal_mode_that_the_contact_does_not_feel_follows_its_closed_form():
    modes, found = sliding_modes(Rig(**BARE), 5.0, 0.3), sliding_sensitivity(Rig(**BARE), 5.0, 0.3)
    (k,) = np.flatnonzero(modes.uncoupled)
    expected = {"p2_young_modulus": 0.5, "p2_density": -0.5, "p2_length": -1.0}
    for name, each in found.elasticity.items():
        assert each[k] == pytest.approx(expected.get(name, 0.0), abs=1e-12)


def central(one, other, step):
    """Difference of the eigenvalues of two sets of modes over a step."""
    return (other.growth_rate - one.growth_rate + 2j * np.pi * (other.frequency - one.frequency)) / step


def test_upright_a_mode_the_contact_does_not_feel_is_felt_at_the_least_inclination():
    """Transverse modes of P1 do not open the gap at theta = 0, but do in proportion to theta."""
    rig, mu, step = coarse(Rig()), 0.3, 1e-4
    modes, found = sliding_modes(rig, 0.0, mu), sliding_sensitivity(rig, 0.0, mu)
    assert np.count_nonzero(modes.uncoupled) > 2
    slope = central(*(sliding_modes(rig, way * step, mu) for way in (-1, 1)), 2.0 * step)
    np.testing.assert_allclose(found.gradient["theta"], slope, rtol=1e-5, atol=1e-3)
    assert np.all(np.abs(found.gradient["theta"][modes.uncoupled][:2]) > 1.0)
    assert np.all(found.elasticity["theta"] == 0.0)


# Where there is no derivative.
@pytest.mark.parametrize("seed", [9, pytest.param(42, marks=pytest.mark.slow)])
def test_at_a_fold_the_slope_is_infinite(seed):
    """Towards it the slope grows with the inverse root of the distance, until the two onsets are one."""
    rig = workshop_rig(seed)
    curves = onset_curves(rig, np.linspace(0.5, 42.0, 12)).onsets
    curve, k = next((curve, k) for curve in curves for k in (0, -1) if curve.ends[k] == "fold")
    end, frequency, inwards = curve.theta[k], curve.frequency[k], 1.0 if k == 0 else -1.0

    def near(theta):
        found = onset_sensitivity(rig, theta, 10e3, 1.1)
        return found, np.flatnonzero(np.abs(found.frequency / frequency - 1.0) < 0.02)

    slopes = []
    for distance in (1e-5, 1e-7):
        found, (k,) = near(end + inwards * distance)
        assert not found.fold[k]
        slopes.append(found.mu_gradient["theta"][k])
    # From where the two are born the onset moves downwards.
    assert inwards * slopes[1] < 0.0
    assert slopes[1] / slopes[0] == pytest.approx(10.0, rel=0.05)
    outside, inside = end - 1e-6 * inwards, end + 1e-6 * inwards
    while (middle := 0.5 * (outside + inside)) not in (outside, inside):
        outside, inside = (outside, middle) if len(near(middle)[1]) else (middle, inside)
    found, (k,) = near(inside)
    assert found.fold[k]
    for each in (found.mu_gradient, found.mu_elasticity, found.frequency_gradient):
        assert np.all(np.isnan([values[k] for values in each.values()]))
    assert np.all(np.isfinite(found.mu_gradient["theta"][~found.fold]))


def test_a_double_eigenvalue_has_no_derivative():
    rig = Rig(**BARE)
    onsets = flutter_onsets(rig, 5.0)
    found = sliding_sensitivity(rig, 5.0, onsets.mu[0])
    pair = np.abs(found.eigenvalue.imag / (2.0 * np.pi * onsets.frequency[0]) - 1.0) < 1e-5
    assert np.count_nonzero(pair) == 2
    for name, each in found.gradient.items():
        assert np.all(np.isnan(each[pair])), name
        assert np.all(np.isfinite(each[~pair]))
