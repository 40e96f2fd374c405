"""Steady sliding where friction falls with the speed: dense eigenvalues, onsets along mu, V, F, closed forms."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy import linalg

from fivcore import Friction, Rig, Scene, Structure, flutter_onsets, sliding_modes, sliding_onsets
from fivcore.stability.falling import falling_crossings
from fivcore.stability.many import FlutterOnsets
from tests.helpers.structures import assert_same_set, drawn, within

FALLING = Friction(0.5, 0.02)
XI = 0.05
# A block on a belt: x'' + 2 xi x' + x = friction, pressed down by a unit load.
BLOCK = Structure.from_modes([0.0, 0.5 / np.pi], [1.0, 0.0], [0.0, 1.0], load=[-1.0, 0.0], damping_ratio=[0.0, XI])


def normal_force(own, m):
    """Of steady sliding, for a unit load: static equilibrium as a matrix."""
    size = len(own.frequency)
    p, n, t, load = (each[:size] for each in (own.stiffness, own.normal, own.tangential, own.load))
    force, scale = n + m * t, p.max()
    own_force, own_load = own.normal[size:] / own.stiffness[size:], own.load[size:]
    flexible = own_force @ (own.normal + m * own.tangential)[size:], own_force @ own_load
    matrix = np.block([[np.diag(p) / scale, -force[:, None]], [n[None], np.array([[scale * flexible[0]]])]])
    return np.linalg.solve(matrix, np.append(load, -scale * flexible[1]))[-1]


def dense_exponents(own, m, k):
    """Exponents with Im >= 0 of all modes with g_N = 0 and T' = m N' + k g_T' as a matrix."""
    size = len(own.frequency)
    unit = np.sqrt(own.stiffness[:size].max())
    p, c, n, t = (
        own.stiffness[:size] / unit**2,
        own.damping[:size] / unit,
        own.normal[:size],
        own.tangential[:size],
    )
    k = k / unit
    if not own.static:
        right, left = linalg.null_space(n[None]), linalg.null_space((n + m * t)[None]).T
        mass, damping, stiffness = (
            left @ each @ right for each in (np.eye(size), np.diag(c) - k * np.outer(t, t), np.diag(p))
        )
        lower = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
        values = np.linalg.eigvals(np.vstack([np.eye(len(mass), 2 * len(mass), len(mass)), lower]))
        return unit * values[values.imag >= 0.0]
    # States q, q' and g_T; (1 + d2 phi) gaps of the compliance are R (N, T), and k g_T' = T - m N.
    gaps, rows, d2 = np.stack([n, t]), np.stack([own.normal, own.tangential])[:, size:], own.d2 * unit
    R = (rows / own.stiffness[size:]) @ rows.T * unit**2
    forces = np.linalg.solve(
        R - d2 / k * np.array([[0.0, 0.0], [-m, 1.0]]), np.hstack([-gaps, -d2 * gaps, [[0.0], [1.0]]])
    )
    matrix = np.zeros((2 * size + 1, 2 * size + 1))
    matrix[:size, size:-1] = np.eye(size)
    matrix[size:-1, :-1] = np.hstack([-np.diag(p), -np.diag(c)])
    matrix[size:-1] += gaps.T @ forces
    matrix[-1] = (forces[1] - m * forces[0]) / k
    values = np.linalg.eigvals(matrix)
    return unit * values[values.imag >= 0.0]


def scene(seed, kind):
    """A random scene and its band: a structure, or the paper's rig with a coarse mesh."""
    rng = np.random.default_rng(5000 + seed)
    speed, decay = 10.0 ** rng.uniform(-3.0, 1.0), ("exponential", "rational")[int(rng.integers(2))]
    law = Friction(rng.uniform(0.0, 0.95), speed, decay)
    V, mu = speed * rng.uniform(0.1, 4.0), rng.uniform(0.05, 1.2)
    if kind == "rig":
        rig = Rig.of(p1_elements=3, p2_elements=5, d1=10.0 ** rng.uniform(0.0, 3.0))
        return Scene(
            V, float(rng.uniform(-40.0, 40.0)), mu, speed * 10.0 ** rng.uniform(-1.0, 3.0), rig, law
        ), 10e3
    own, scale = drawn(seed, kind == "Rayleigh")
    return Scene(V, 0.0, mu, speed * scale * 10.0 ** rng.uniform(-4.0, 1.0), own, law), scale


def structure_of(given):
    return given.rig if isinstance(given.rig, Structure) else Structure.of(given.rig, given.theta)


def steady(given):
    """m and k, from static equilibrium."""
    m = given.mu * given.friction.ratio(given.V)
    force = normal_force(structure_of(given), m)
    return m, -given.F * force * given.mu * given.friction.slope(given.V), force > 0.0


def exponents(given, fmax):
    found = sliding_modes(given.rig, given.theta, given.mu, fmax, friction=given.friction, V=given.V, F=given.F)
    values = found.growth_rate + 2j * np.pi * found.frequency
    return values[np.isfinite(values)]


@pytest.mark.parametrize("kind", ["by mode", "Rayleigh", "rig"])
def test_modes_are_dense_eigenvalues(kind):
    count = 0
    for seed in range(70):
        given, fmax = scene(seed, kind)
        own = structure_of(given)
        m, k, held = steady(given)
        if not held:
            with jams():
                exponents(given, fmax)
            continue
        mine, theirs = (within(each, fmax) for each in (exponents(given, fmax), dense_exponents(own, m, k)))
        theirs = theirs[np.abs(theirs) > 1e-12 * fmax]
        assert_same_set(mine, theirs, 1e-8)
        count += len(mine)
    assert count > 500


@pytest.mark.parametrize("seed", [1127, 11, 23, 42])
def test_steep_falls_leave_no_guess_without_a_value(seed):
    """A guess that is thrown far out has none, and may not spread to the others."""
    own, scale = drawn(seed, seed == 42)
    for mu, V, F, fall in (
        (0.27483, 2.19343e-3, 37.877064, 5.039665e-4),
        (0.3, 1e-3, 10.0, 1e-3),
        (0.2, 1e-2, 100.0, 1e-2),
    ):
        given = Scene(V, 0.0, mu, F, own, Friction(0.6, fall))
        m, k, held = steady(given)
        if held:
            mine, theirs = (
                within(each, 2.0 * scale) for each in (exponents(given, 2.0 * scale), dense_exponents(own, m, k))
            )
            assert_same_set(mine, theirs[np.abs(theirs) > 1e-12 * scale], 1e-7)


def limits(given, name):
    value = getattr(given, name)
    return (0.0, 1.0) if name == "mu" else (0.1 * value, 10.0 * value)


def jams():
    return pytest.raises(ValueError, match=r"^mu = .* the contact jams and steady sliding ceases to exist$")


@pytest.mark.parametrize("name", ["mu", "V", "F"])
@pytest.mark.parametrize("kind", ["by mode", "Rayleigh", "rig"])
def test_growth_changes_its_sign_at_onsets(name, kind):
    """And crossings count all dense eigenvalues that grow in a scan."""
    count = 0
    for seed in range(8):
        given, fmax = scene(seed, kind)
        low, high = limits(given, name)
        own, omega = structure_of(given), 2.0 * np.pi * fmax
        if not steady(replace(given, **{name: low}))[2]:
            with jams():
                sliding_onsets(given, name, low, high, fmax)
            continue
        found = sliding_onsets(given, name, low, high, fmax)
        count += len(found.value)
        for value, frequency, change in zip(found.value, found.frequency, found.change, strict=True):
            here, growth = replace(given, **{name: value}), []
            # Where the contact nearly jams, the normal force is sensitive.
            held = normal_force(own, 0.0) / normal_force(own, here.mu * here.friction.ratio(here.V))
            for way in (-1e-6, 1e-6):
                beside = exponents(replace(given, **{name: value * (1.0 + way * min(held, 1.0))}), fmax * 1.01)
                nearest = beside[np.abs(beside - 2j * np.pi * frequency).argmin()]
                assert abs(nearest - 2j * np.pi * frequency) < 1e-2 * abs(nearest)
                growth.append(nearest.real * np.sign(way))
            assert np.all(np.sign(growth) == change)
        values = {"mu": given.mu, "V": given.V, "F": given.F}
        table, numbers = falling_crossings(own, fmax, given.friction, values, name, low, high), set()
        for value in np.geomspace(max(low, 1e-2 * high), high, 8).tolist():
            m, k, held = steady(replace(given, **{name: value}))
            if held:
                phi = dense_exponents(own, m, k)
                phi = phi[(phi.real > 1e-12 * omega) & (phi.imag < omega) & (np.abs(phi) < 2.0 * omega)]
                numbers.add(np.where(phi.imag > 0.0, 2, 1).sum() - table[table[:, 0] < value, 2].sum())
        assert len(numbers) <= 1
        if name == "mu":
            also = flutter_onsets(given.rig, given.theta, fmax, friction=given.friction, V=given.V, F=given.F)
            np.testing.assert_array_equal(also.mu, found.value[found.change > 0])
            np.testing.assert_array_equal(also.recovery_frequency, found.frequency[found.change < 0])
    assert count > 5


@pytest.mark.parametrize(("decay", "share"), [("exponential", np.log(10.0)), ("rational", np.sqrt(10.0) - 1.0)])
def test_a_block_on_a_belt_is_stable_from_a_speed_on(decay, share):
    """x'' + (2 xi + N mu'(V)) x' + x = 0; the mode with the contact in it is the block alone."""
    given = Scene(1.0, 0.0, 1.0, 1.0, BLOCK, Friction(0.5, 0.5, decay))
    found = sliding_onsets(given, "V", 1e-3, 10.0, 1.0)
    np.testing.assert_allclose(found.value, 0.5 * share, rtol=1e-12)
    np.testing.assert_allclose(found.frequency, 0.5 / np.pi, rtol=1e-12)
    assert found.change.tolist() == [-1]
    for name in ("mu", "F"):
        found = sliding_onsets(given, name, 0.0 if name == "mu" else 1e-3, 10.0, 1.0)
        np.testing.assert_allclose(found.value, -2.0 * XI / given.friction.slope(1.0), rtol=1e-12)
        assert found.change.tolist() == [1]
    modes = sliding_modes(BLOCK, 0.0, 1.0, 1.0, friction=given.friction, V=1.0, F=1.0)
    np.testing.assert_allclose(modes.growth_rate, -XI - 0.5 * given.friction.slope(1.0), rtol=1e-12)
    np.testing.assert_array_equal(np.abs(modes.shape), [[0.0, 1.0]])


def test_modes_with_one_pole_are_dense_eigenvalues():
    """Of two or three such modes; their shapes leave the normal gap closed and balance the forces."""
    for seed in range(30):
        rng = np.random.default_rng(seed)
        frequency = np.repeat(rng.uniform(1.0, 10.0, 6), [1, 2, 3, 1, 2, 1])
        n, t, V, F = *rng.normal(size=(2, 10)), 0.02, 10.0 ** rng.uniform(-2.0, 1.0)
        n[[1, 2]] *= seed % 3 > 0
        own = Structure.from_modes(frequency, n, t, load=-n, damping_ratio=0.01)
        m, k, _ = steady(Scene(V, 0.0, 0.3, F, own, FALLING))
        found = sliding_modes(own, 0.0, 0.3, 20.0, friction=FALLING, V=V, F=F)
        mine, n, t = found.growth_rate + 2j * np.pi * found.frequency, own.normal, own.tangential
        theirs = dense_exponents(own, m, k)
        assert_same_set(mine, within(theirs, 20.0), 1e-8)
        assert found.uncoupled.sum() == 1 + (seed % 3 == 0)
        for phi, q in zip(mine, found.shape, strict=True):
            force = (own.stiffness + own.damping * phi + phi**2) * q - k * phi * t * (t @ q)
            assert abs(n @ q) < 1e-8
            normal = (n + m * t) @ force / ((n + m * t) @ (n + m * t))
            assert np.abs(force - (n + m * t) * normal).max() < 1e-7 * own.stiffness.max()


@pytest.mark.parametrize("kind", ["by mode", "Rayleigh", "rig"])
def test_friction_that_does_not_fall_has_the_bits_of_one_coefficient(kind):
    """A jump has those of the kinetic coefficient; friction that hardly falls comes near."""
    for seed in range(4):
        given, fmax = scene(seed, kind)
        rig, theta, mu = given.rig, given.theta, np.array([0.0, given.mu])
        plain, kinetic = sliding_modes(rig, theta, mu, fmax), sliding_modes(rig, theta, 0.5 * mu, fmax)
        coulomb = sliding_modes(rig, theta, mu, fmax, friction=Friction(1.0, 0.3), V=[1.0, 2.0], F=3.0)
        jump = sliding_modes(rig, theta, mu, fmax, friction=Friction(0.5, 0.0))
        for name in ("frequency", "growth_rate", "eigenvalue", "uncoupled", "shape"):
            np.testing.assert_array_equal(getattr(coulomb, name), getattr(plain, name))
            np.testing.assert_array_equal(getattr(jump, name), getattr(kinetic, name))
        one, other = (
            flutter_onsets(rig, theta, fmax),
            flutter_onsets(rig, theta, fmax, friction=Friction(1.0, 0.3)),
        )
        half = flutter_onsets(rig, theta, fmax, 2.0, friction=Friction(0.5, 0.0))
        for name in (each.name for each in fields(FlutterOnsets)):
            np.testing.assert_array_equal(getattr(other, name), getattr(one, name))
            share = 2.0 if name.endswith("mu") else 1.0
            np.testing.assert_allclose(getattr(half, name), share * getattr(one, name), rtol=2e-12)
        hardly = replace(given, friction=Friction(1.0 - 1e-13, 1.0))
        if steady(hardly)[2]:
            near = exponents(hardly, fmax)
            values = (plain.growth_rate + 2j * np.pi * plain.frequency)[1]
            values = values[values.imag > 0.0]
            assert_same_set(within(near[near.imag > 0.0], fmax), within(values, fmax), 1e-6)


def test_speed_and_load_broadcast():
    V, F = np.array([0.01, 0.02, 0.05]), np.array([[1.0], [3.0]])
    found = sliding_modes(BLOCK, 0.0, 0.4, 1.0, friction=FALLING, V=V, F=F)
    assert found.mu.shape == found.V.shape == found.F.shape == (2, 3)
    assert found.friction == FALLING
    one = sliding_modes(BLOCK, 0.0, 0.4, 1.0, friction=FALLING, V=0.05, F=3.0)
    np.testing.assert_array_equal(found.growth_rate[1, 2], one.growth_rate)


BELT = Scene(-1.0, 0.0, 1.0, 1.0, BLOCK, FALLING)
WRONG = {
    r"^V is missing: where friction falls with the speed give V \(m/s\) and F \(N\)$": (sliding_modes, {"F": 1.0}),
    r"^F is missing: ": (flutter_onsets, {"V": 1.0}),
    r"^V = -1.0: it must be a number from 1e-100": (sliding_modes, {"V": -1.0, "F": 1.0}),
    r"^F = 0.0: it must be a number from 1e-100": (flutter_onsets, {"V": 1.0, "F": 0.0}),
    r"^F of shape \(3,\): it must broadcast with theta, mu, V, \(2,\)$": (
        sliding_modes,
        {"V": [1.0] * 2, "F": [1.0] * 3},
    ),
    r"^V of shape \(2,\): it must be one number$": (flutter_onsets, {"V": [1.0, 2.0], "F": 1.0}),
    r"^friction = 'Stribeck': it must be a Friction$": (sliding_modes, {"friction": "Stribeck"}),
}
ALONG = {
    r"^parameter = 'theta': it must be one of mu, V, F$": (BELT, "theta", 0.0, 1.0),
    r"^low = 0.0: it must be a number from 1e-100": (BELT, "V", 0.0, 1.0),
    r"^high = 1.0: it must be above low = 2": (BELT, "F", 2.0, 1.0),
    r"^scene = 'belt': it must be a Scene$": ("belt", "mu", 0.0, 1.0),
    r"^d2 = 0.001: with friction that falls with the speed it must be at most 3.18e-06 s for fmax = 10000 Hz;": (
        (replace(BELT, rig=Rig(d2=1e-3)), "mu", 0.0, 1.0)
    ),
}


@pytest.mark.parametrize("text", [*WRONG, *ALONG])
def test_wrong_input_is_named(text):
    function, given = WRONG.get(text, (sliding_onsets, {}))
    arguments = ALONG.get(text, (BLOCK, 0.0, 0.2) if function is sliding_modes else (BLOCK, 0.0))
    given = {"friction": FALLING} | given if text in WRONG else {}
    with pytest.raises(ValueError, match=text):
        function(*arguments, **given)
