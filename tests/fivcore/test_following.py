"""Modes keep their numbers along friction: closed forms, the paper's rig, and random structures."""

import numpy as np
import pytest

from fivcore import Rig, Structure, followed_modes, sliding_modes

MU = np.linspace(0.0, 0.5, 501)


def ordered(modes):
    values = np.where(np.isnan(modes.frequency), np.inf, modes.growth_rate + 2j * np.pi * modes.frequency)
    return np.sort_complex(values)


def same_at_common_points(fine, coarse, step):
    for name in ("frequency", "growth_rate"):
        one, other = getattr(fine, name)[::step], getattr(coarse, name)
        count = min(one.shape[1], other.shape[1])
        np.testing.assert_array_equal(one[:, :count], other[:, :count])
        assert np.isnan(one[:, count:]).all()
        assert np.isnan(other[:, count:]).all()


def test_modes_that_friction_does_not_couple_cross():
    """Two modes and a rigid contact have one mode; another, of a node at the contact, is crossed by it."""
    p, n, t = np.array([400.0, 900.0]) ** 2, np.array([0.5, 0.3]), np.array([0.4, -0.5])
    n, t = np.append(n, 0.0), np.append(t, 0.0)

    def alone(mu):
        a = [n[k] * (n[k] + mu * t[k]) for k in (0, 1)]
        return np.sqrt((a[0] * p[1] + a[1] * p[0]) / (a[0] + a[1]))

    middle = alone(0.25)
    own = Structure.from_modes([400.0, 900.0, middle], n, t, load=[-1.0, -1.0, 0.0])
    found = followed_modes(own, 0.0, MU)
    first = int(middle < alone(0.0))
    np.testing.assert_allclose(found.frequency[:, first], alone(MU), rtol=1e-9)
    np.testing.assert_allclose(found.frequency[:, 1 - first], middle, rtol=1e-12)
    assert np.any(np.diff(sliding_modes(own, 0.0, MU).uncoupled[:, 0].astype(int)))


@pytest.mark.parametrize("theta", [5.0, 10.0])
def test_names_of_the_rig_do_not_depend_on_the_steps(theta):
    fine = followed_modes(Rig(), theta, MU)
    same_at_common_points(fine, followed_modes(Rig(), theta, MU[::50]), 50)
    np.testing.assert_array_equal(followed_modes(Rig(), theta, 0.2).frequency, fine.frequency[200, :10])
    # Curves are modes: none jumps, and two share a number at no friction.
    assert np.nanmax(np.abs(np.diff(fine.frequency, axis=0))) < 60.0
    assert (np.diff(fine.frequency[0, :10]) > 0.0).all()


def test_of_two_modes_that_lock_in_the_lower_decays():
    found = followed_modes(Rig(), 5.0, MU)
    for low, high, onset in ((1, 2, 0.16), (4, 5, 0.12), (7, 9, 0.23)):
        assert (found.growth_rate[onset < MU, low] < found.growth_rate[onset < MU, high]).all()
        assert (found.growth_rate[onset < MU, high] > 0.0).all()
    # The mode between them has a node at the contact.
    assert np.ptp(found.frequency[:, 8]) == 0.0


@pytest.mark.parametrize("seed", range(6))
def test_random_structures_have_the_modes_of_each_friction_and_names_of_none_but_themselves(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 20))
    damping = ({"damping_ratio": rng.uniform(1e-4, 0.03, n)}, {"d1": 20.0, "d2": 1e-7}, {})[seed % 3]
    load, mu = -rng.uniform(0.2, 1.0, n), np.linspace(0.0, 1.0, 101)
    own = Structure.from_modes(
        np.sort(rng.uniform(100.0, 12e3, n)), -load, rng.normal(size=n), load=load, **damping
    )
    found, plain = followed_modes(own, 0.0, mu), sliding_modes(own, 0.0, mu)
    one, other = ordered(found), ordered(plain)
    np.testing.assert_array_equal(one[:, : other.shape[1]], other)
    assert np.isinf(one[:, other.shape[1] :]).all()
    same_at_common_points(found, followed_modes(own, 0.0, mu[::10]), 10)


def test_a_mode_that_ceases_to_oscillate_keeps_its_number():
    own = Structure.from_modes(
        [500.0, 800.0, 1700.0], [0.4, 0.1, 0.4], [-0.9, -0.7, -0.4], load=[-0.4, -0.1, 0.0], damping_ratio=0.002
    )
    found = followed_modes(own, 0.0, [0.443, 0.444])
    assert (found.frequency[:, 0] > 0.0).tolist() == [True, False]
    assert found.growth_rate[1, 0] > 0.0
    assert (found.frequency[:, 1] > found.frequency[:, 0]).all()


def test_modes_of_several_contacts_are_followed():
    rng = np.random.default_rng(2)
    own = Structure.from_modes(
        np.sort(rng.uniform(100.0, 5e3, 8)),
        *rng.uniform(0.2, 1.0, (2, 2, 8)),
        load=-rng.uniform(0.2, 1.0, 8),
        d2=1e-7,
    )
    mu = np.linspace(0.0, 0.3, 31)
    found = followed_modes(own, 0.0, mu)
    np.testing.assert_array_equal(ordered(found), ordered(sliding_modes(own, 0.0, mu)))
    same_at_common_points(found, followed_modes(own, 0.0, mu[::10]), 10)
