"""Steady sliding where friction falls with the speed: dense eigenvalues, onsets along mu, V and F, closed forms."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy import linalg

from fivcore import Friction, Rig, Scene, Structure, flutter_onsets, sliding_modes, sliding_onsets
from fivcore.stability.many import FlutterOnsets
from tests.verification.test_structures import assert_same_set, drawn, within

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
    zeros = np.zeros((size, size))
    matrix = np.block(
        [
            [zeros, np.eye(size), zeros[:, :1]],
            [-np.diag(p), -np.diag(c), zeros[:, :1]],
            [np.zeros((1, 2 * size + 1))],
        ]
    )
    matrix[size : 2 * size] += gaps.T @ forces
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
    for seed in range(80):
        given, fmax = scene(seed, kind)
        own = structure_of(given)
        m, k, held = steady(given)
        if not held:
            with pytest.raises(ValueError, match=r"^mu = .* the contact jams"):
                exponents(given, fmax)
            continue
        mine, theirs = (within(each, fmax) for each in (exponents(given, fmax), dense_exponents(own, m, k)))
        theirs = theirs[np.abs(theirs) > 1e-12 * fmax]
        assert_same_set(mine, theirs, 1e-8)
        count += len(mine)
    assert count > 500


def onsets_of(given, name, fmax):
    low, high = {"mu": (0.0, 1.0), "V": (0.1 * given.V, 10.0 * given.V), "F": (0.1 * given.F, 10.0 * given.F)}[name]
    return low, high, sliding_onsets(given, name, low, high, fmax)


@pytest.mark.parametrize("name", ["mu", "V", "F"])
@pytest.mark.parametrize("kind", ["by mode", "Rayleigh", "rig"])
def test_growth_changes_its_sign_at_onsets(name, kind):
    """There is a dense eigenvalue on the axis; between onsets there are no more growing pairs than they explain."""
    count = 0
    for seed in range(24):
        given, fmax = scene(seed, kind)
        try:
            low, high, found = onsets_of(given, name, fmax)
        except ValueError as problem:
            assert "the contact jams" in str(problem)
            continue
        print(kind, name, seed, len(found.value))
        count += len(found.value)
        for value, frequency, change in zip(found.value, found.frequency, found.change, strict=True):
            growth = []
            for way in (-1e-6, 1e-6):
                beside = exponents(replace(given, **{name: value * (1.0 + way)}), fmax * 1.01)
                nearest = beside[np.abs(beside - 2j * np.pi * frequency).argmin()]
                assert abs(nearest - 2j * np.pi * frequency) < 1e-3 * abs(nearest)
                growth.append(nearest.real * np.sign(way))
            assert np.all(np.sign(growth) == change), (seed, value, growth)
    assert count > 5
