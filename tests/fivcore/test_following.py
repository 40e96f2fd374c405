"""Modes keep their numbers along friction and other parameters: closed forms, the rig, random structures."""

import numpy as np
import pytest

from fivcore import InputError, Rig, Structure, followed_modes, modes_along, sliding_modes

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


def pair(frequency, normal, tangential, mu):
    """Exponents of three modes at a rigid contact without damping: roots of sum n (n + mu t) / (p - z) = 0."""
    p, a = (2.0 * np.pi * np.asarray(frequency)) ** 2, normal * (normal + mu * tangential)
    total = sum(a[k] * np.poly(np.delete(p, k)) for k in range(3))
    return np.sort(
        np.sqrt(np.roots(total).astype(complex)).imag + 1j * np.sqrt(np.roots(total).astype(complex)).real
    )


N, T, LOAD = np.array([0.5, 0.4, 0.3]), np.array([0.1, -0.2, 0.1]), [-1.0, -1.0, -1.0]


def test_along_an_open_frequency_modes_veer_and_the_node_at_the_contact_is_crossed():
    """Coupled modes are roots of a polynomial; a mode with a node at the contact has its own frequency."""
    values = np.linspace(300.0, 3000.0, 28)

    def at(hertz):
        own = Structure.from_modes([hertz, 900.0, 1500.0, 2100.0], [*N, 0.0], [*T, 0.0], load=[*LOAD, 0.0])
        return own, 0.0, 0.2

    found = modes_along(at, values)
    exact = np.sort([np.abs(pair([hertz, 900.0, 1500.0], N, T, 0.2)) / (2.0 * np.pi) for hertz in values], axis=1)
    # Numbers are those at the first value, ascending there; the node's mode has the highest.
    np.testing.assert_allclose(found.frequency[:, 2], 2100.0, rtol=1e-12)
    np.testing.assert_allclose(found.frequency[:, :2], exact, rtol=1e-9)
    back = modes_along(at, values[::-1])
    np.testing.assert_array_equal(np.sort(back.frequency[::-1], axis=1), np.sort(found.frequency, axis=1))


def test_symmetric_pairs_cross_and_the_signs_and_order_of_modes_do_not_matter():
    """Two equal halves of which one is scaled: each family keeps its modes though all cross."""
    p, n, t = np.array([400.0, 900.0, 1600.0]), np.array([0.5, 0.3, 0.4]), np.array([0.4, -0.5, 0.2])
    rng = np.random.default_rng(0)

    def at(scale):
        # The other half is not loaded and does not touch.
        frequency = np.append(p, scale * np.array([300.0, 700.0]))
        normal, tangential = np.append(n, [0.0, 0.0]), np.append(t, [0.0, 0.0])
        load, output = [-1.0, -1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 0.3]
        order, sign = rng.permutation(5), rng.choice([-1.0, 1.0], 5)
        rows = [np.multiply(each, sign)[order] for each in (normal, tangential, load, output)]
        return Structure.from_modes(frequency[order], *rows[:2], load=rows[2], output=rows[3]), 0.0, 0.1

    values = np.linspace(1.0, 4.0, 16)
    found = modes_along(at, values).frequency
    for hertz in (300.0, 700.0):
        family = int(np.abs(found[0] - hertz).argmin())
        np.testing.assert_allclose(found[:, family], hertz * values, rtol=1e-9)
    still = [k for k in range(found.shape[1]) if np.ptp(found[:, k]) < 1e-6]
    assert len(still) == 2


def test_conjugates_lock_in_and_part_along_the_inclination():
    """Of a pair that has locked in one mode grows and one decays; where it parts, the decaying one is lower."""
    found = modes_along(lambda theta: (Rig(), theta, 0.2), np.linspace(0.0, 20.0, 21))
    assert found.frequency.shape[1] == 10
    assert np.isfinite(found.frequency).all()
    locked = found.growth_rate[5] > 1.0
    for high in np.flatnonzero(locked):
        low = int(np.argmin(np.where(locked, np.inf, np.abs(found.frequency[5] - found.frequency[5, high]))))
        assert found.growth_rate[5, low] < 0.0
        np.testing.assert_allclose(found.frequency[5, low], found.frequency[5, high], rtol=1e-3)
        assert found.frequency[-1, low] < found.frequency[-1, high]
    assert locked.sum() == 2
    coarse = modes_along(lambda theta: (Rig(), theta, 0.2), [0.0, 10.0, 20.0])
    np.testing.assert_array_equal(coarse.frequency, found.frequency[::10])


def test_along_friction_both_ways_of_comparing_agree():
    mu = np.linspace(0.0, 0.3, 31)
    for theta in (5.0, 10.0):
        one, other = followed_modes(Rig(), theta, mu), modes_along(lambda mu, theta=theta: (Rig(), theta, mu), mu)
        np.testing.assert_array_equal(one.frequency, other.frequency)
        np.testing.assert_array_equal(one.growth_rate, other.growth_rate)


@pytest.mark.parametrize(
    ("name", "low", "high"), [("p1_length", 0.05, 0.08), ("p2_young_modulus", 1.5e11, 2.5e11)]
)
def test_along_a_number_of_the_rig_curves_are_modes(name, low, high):
    values, fine = np.linspace(low, high, 13), np.linspace(low, high, 97)
    found, dense = (modes_along(lambda x: (Rig.of(**{name: x}), 5.0, 0.05), x).frequency for x in (values, fine))
    # Modes veer; in steps an eighth as long none jumps, and both have the same names.
    np.testing.assert_allclose(dense[::8, : found.shape[1]], found, rtol=1e-9)
    assert np.nanmax(np.abs(np.diff(dense, 2, axis=0))) < 60.0
    plain = np.array([sliding_modes(Rig.of(**{name: value}), 5.0, 0.05).frequency.size for value in values])
    np.testing.assert_array_equal(np.isfinite(found).sum(axis=1), plain)


def test_models_that_cannot_be_compared_are_refused():
    def at(n):
        return Structure.from_modes(
            np.arange(1.0, n + 1.0) * 500.0, np.ones(int(n)), np.ones(int(n)), load=-np.ones(int(n))
        )

    with pytest.raises(InputError, match="5 modes, and 4 at the first value"):
        modes_along(lambda n: (at(n), 0.0, 0.1), [4.0, 5.0])
    for values in ([], [1.0, 1.0], [[1.0]], [0.0, 2.0, 1.0]):
        with pytest.raises(InputError, match="values"):
            modes_along(lambda theta: (Rig(), theta, 0.1), values)


@pytest.mark.parametrize("count", [1, 2, 51])
def test_a_band_without_modes_has_none_to_follow(count):
    mu = np.linspace(0.0, 0.5, count)
    assert followed_modes(Rig(), 5.0, mu, 10.0).frequency.shape == (count, 0)
    assert modes_along(lambda theta: (Rig(), theta, 0.2), mu, 10.0).frequency.shape == (count, 0)
