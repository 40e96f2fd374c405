"""Steady sliding where friction falls with the speed.

With m = mu(V) and k = -N0 mu'(V), N0 the normal force of steady sliding, T' = m N' + k d(g_T')/dt, so that
f(phi) = h_NN + m h_NT - k phi (h_NN h_TT - h_NT^2) = 0 with damping by mode or of Rayleigh (`by_mode`, `secular`).
Where an exponent passes an axis f = 0 is two real equations for m and k, linear in both (`by_mode_onsets`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from fivcore import checks
from fivcore.beams.modes import EPS
from fivcore.errors import InputError, UnsolvedError
from fivcore.finite_elements import STATIC
from fivcore.friction import Friction
from fivcore.jit import Array, Complex, ReadOnlyArrays
from fivcore.rig import Rig, Scene
from fivcore.stability.by_mode import BAND, KEPT, damped_by_mode, exponents, far_series, frictionless, upper_half
from fivcore.stability.by_mode_onsets import (
    STEPS,
    agree,
    brackets,
    crossing_function,
    damped_crossings,
    place,
    quadratic,
    sample,
)
from fivcore.stability.onsets import ARC, proportional_crossings
from fivcore.stability.secular import RADIUS, SlidingProblem, all_roots
from fivcore.structure import Structure, structure_of

SPEED, LOAD = "a speed from 1e-100 to 1e+100 m/s", "a load from 1e-100 to 1e+100 N"
# Poles kept at most where those of stiff modes crowd at phi = -1 / d2.
CROWD = 200


@lru_cache(maxsize=128)
def falling_problem(own: Structure, fmax: float) -> SlidingProblem:
    """`damped_problem` with residues and tail of h_NN, h_NT and h_TT, (3, n) and (3, terms)."""
    m, unit = len(own.frequency), 2.0 * np.pi * fmax / BAND
    p, c, n, t = own.stiffness / unit**2, own.damping / unit, own.normal / unit, own.tangential / unit
    # Static modes are nothing but compliances, damped as all others are.
    p[m:], n[m:], t[m:] = p[m:] * STATIC, n[m:] * STATIC**0.5, t[m:] * STATIC**0.5
    c[m:] = own.d2 * unit * p[m:]
    order = np.lexsort((c, p))
    p, c, n, t, static = p[order], c[order], n[order], t[order], order >= m
    new = np.diff(p, prepend=-np.inf) > 4.0 * EPS * p
    new |= np.abs(np.diff(c, prepend=-np.inf)) > 4.0 * EPS * np.maximum(c, np.sqrt(p))
    for group in np.split(np.arange(len(p)), np.flatnonzero(new)[1:]):
        # Of modes with one pole, two combinations move the gaps: one both, one the tangential gap alone.
        if len(group) > 1:
            size = np.hypot.reduce(n[group])
            along = n[group] if size > 0.0 else t[group]
            along = along / max(np.hypot.reduce(along), 1e-300)
            both = along @ t[group]
            rest = np.hypot.reduce(t[group] - both * along)
            n[group], t[group] = 0.0, 0.0
            n[group[0]], t[group[:2]] = size, (both, rest)
    residues = np.stack([n * n, n * t, t * t])
    compliance = (residues[:, p > 0.0] / p[p > 0.0]).sum(axis=1)
    felt, moved = (residues[k] > 1e-17 * compliance[k] * p for k in (0, 2))
    coupled = felt | moved
    uncoupled = exponents(p[~coupled], c[~coupled]).ravel()
    p, c, residues, felt, static = p[coupled], c[coupled], residues[:, coupled], felt[coupled], static[coupled]
    distance = np.abs(exponents(p, c)).min(axis=0)
    limit = max(KEPT, *np.sort(distance[~static])[: int(np.sum(distance < BAND)) + 2][-1:])
    near = distance <= limit
    if np.any(near & static) or (own.d2 * unit * limit > 1.0 and np.sum(near) > CROWD):
        raise InputError(
            f"d2 = {own.d2:g}: with friction that falls with the speed it must be at most"
            f" {1.0 / (KEPT * unit):.3g} s for fmax = {fmax:g} Hz; choose a smaller d2 or fmax"
        )
    tail = far_series(p[~near], c[~near], residues[:, ~near])[:, : 1 if near.all() else None].copy()
    p, c, residues, felt = p[near], c[near], residues[:, near].copy(), felt[near]
    guesses = exponents(p[~felt], c[~felt]).ravel() * np.exp(1e-3j)
    if felt.any():
        guesses = np.append(frictionless(p[felt], c[felt], residues[0, felt], tail), guesses)
    uncoupled = uncoupled[(np.abs(uncoupled) <= RADIUS) & (uncoupled.imag >= 0.0)]
    return SlidingProblem(unit, np.stack([p, c]), residues, tail, guesses, uncoupled)


def falling_roots(problem: SlidingProblem, m: float, k: float) -> Complex:
    """`damped_roots` with friction m = mu(V) that falls by k, N s/m."""
    k *= problem.unit
    c, tail = (np.stack([a + m * b, a, np.sqrt(k) * b, k * t]) for a, b, t in (problem.residues, problem.tail))
    return upper_half(all_roots(problem, c, tail, m))


def balance(own: Structure) -> float:
    """Compute f in N0 = F preload / (1 + f m): h_NT / h_NN at rest."""
    rigid = own.stiffness == 0.0
    weight = own.normal * rigid if rigid.any() else own.normal / own.stiffness
    return float((weight @ own.tangential) / (weight @ own.normal))


def steady(own: Structure, friction: Friction, mu: float, V: float, F: float) -> tuple[float, float]:
    """Compute m and k of `falling_roots` in steady sliding."""
    m, held = mu * friction.ratio(V), 1.0 + balance(own) * mu * friction.ratio(V)
    if not held > 0.0 and not friction.constant:
        raise InputError(
            f"mu = {mu:g}: at V = {V:g} m/s it must be below {mu / (1.0 - held):.6g}, where the contact jams"
            " and steady sliding ceases to exist"
        )
    return m, 0.0 if friction.constant else -F * own.preload / held * mu * friction.slope(V)


def falling_point(
    own: Structure, fmax: float, friction: Friction, mu: float, V: float, F: float
) -> tuple[SlidingProblem, Complex]:
    """The problem and its exponents at one point."""
    problem = falling_problem(own, fmax)
    return problem, falling_roots(problem, *steady(own, friction, mu, V, F))


def uncoupled_shape(gaps: Array, distance: Complex, size: Array) -> Complex:
    """One mode alone, or of those with one frequency the combination that leaves all `gaps` (k, n) closed.

    They are the modes whose `distance` (n,) from the exponent is rounding of its terms, `size` (n,).
    """
    q, modes = np.zeros(len(size), dtype=complex), np.flatnonzero(np.abs(distance) <= 64.0 * EPS * size)
    closed = gaps[:, modes] / np.abs(gaps[:, modes]).max(axis=1, initial=1e-300, keepdims=True)
    q[modes] = np.linalg.svd(closed)[2][-1]
    return q


def modal_shape(own: Structure, phi: complex, uncoupled: bool) -> Complex:
    """Modal coordinates of an exponent: those of contact forces that leave the normal gap closed."""
    damping = own.damping + own.d2 * own.stiffness * (np.arange(len(own.stiffness)) >= len(own.frequency))
    n, t, distance = own.normal, own.tangential, own.stiffness + phi * (damping + phi)
    q = np.zeros(len(n), dtype=complex)
    if uncoupled:
        return uncoupled_shape(np.stack([n, t]), distance, own.stiffness + np.abs(phi) ** 2)
    nearest = int(np.argmin(np.where((n != 0.0) | (t != 0.0), np.abs(distance), np.inf)))
    gap, others = distance[nearest], np.arange(len(n)) != nearest
    a, b = ((n * each)[others] / distance[others] for each in (n, t))
    A, B = a.sum(), b.sum()
    normal, tangential = n[nearest] * t[nearest] + gap * B, -(n[nearest] ** 2) - gap * A
    q[others] = (n * normal + t * tangential)[others] / distance[others]
    q[nearest] = n[nearest] * B - t[nearest] * A
    return q


def crossings(
    own: Structure, fmax: float, friction: Friction, values: dict[str, float], name: str, low: float, high: float
) -> Array:
    """`damped_crossings` along one of mu, V and F, the others from `values`, between `low` and `high`."""
    if friction.constant:
        kappa = friction.kinetic_ratio
        if name != "mu" or kappa * high < 1e-12:
            return np.empty((0, 3))
        search = damped_crossings if damped_by_mode(own, fmax) else proportional_crossings
        found = search(own, fmax, kappa * high) / [kappa, 1.0, 1.0]
        return np.asarray(found[found[:, 0] > low])
    problem, f, (kappa, v_d, rational) = falling_problem(own, fmax), balance(own), friction.law
    mu, V, F = (values[each] for each in ("mu", "V", "F"))
    if name == "mu":
        # Without damping every motion grows, to rounding, at any mu above 0.
        r, s, low = friction.ratio(V), -friction.slope(V), max(low, 1e-11 * high)
        high = min(high, (1.0 - 1e-6) / (-f * r)) if f * r < 0.0 else high
        m0, m1, q, power = 0.0, r, F * s, 1.0
    elif name == "V":
        # In terms of g, the share of mu (1 - kappa) that is left.
        m0, m1, q, power = mu * kappa, mu * (1.0 - kappa), F * mu * (1.0 - kappa) / v_d, 1.0 + rational
    else:
        m0, m1, q, power = mu * friction.ratio(V), 0.0, -mu * friction.slope(V), 1.0

    def at(value: float) -> tuple[float, float]:
        one = values | {name: value}
        return steady(own, friction, one["mu"], one["V"], one["F"])

    at(low)
    if q == 0.0 and m1 == 0.0:
        return np.empty((0, 3))
    squared = power == 2.0 and not problem.residues[1].any() and not problem.tail[1].any()
    if squared:
        m1, power = 0.0, 1.0
    form = np.array([m0, m1, f, q * own.preload * problem.unit, power])
    system = problem.poles, problem.residues, problem.tail, form

    def candidates(phi: complex, n: int) -> list[tuple[float, complex, complex]]:
        """Values, with the root x and the other one, from the most real root on."""
        c = np.array(quadratic(phi, n, *system))[::-1]
        roots = np.roots(c / max(np.abs(c).max(), 1e-300))
        roots = roots[np.argsort(np.abs(roots.imag / np.where(roots == 0.0, 1.0, roots)))]
        found = []
        for x, other in zip(roots, roots[::-1] if len(roots) == 2 else 0.0 * roots, strict=True):
            real = np.sqrt(x.real) if squared and x.real > 0.0 else x.real
            if name == "V":
                real = np.nan if not 0.0 < real < 1.0 else v_d * (1.0 / real - 1.0 if rational else -np.log(real))
            found.append((float(real), complex(x), complex(other)))
        return found

    way, poles, p = -1.0 if name == "V" else 1.0, exponents(*problem.poles), problem.poles
    for share in STEPS:
        onsets: list[tuple[float, float, float]] = []
        samples = sample(*system, poles, share)
        # Real exponents enter at 2.
        x = 2.0 * BAND
        n = int(np.argmin(np.abs(p[0] + x * (p[1] + x))))
        for value, root, _ in candidates(complex(x), n):
            if abs(root.imag) <= 1e-9 * abs(root) and low < value <= high:
                beside = min(
                    (each for _, each, _ in candidates(complex(x * (1.0 - 1e-6)), n)), key=lambda z: abs(z - root)
                )
                onsets.append((value, ARC, way * float(np.sign(beside.real - root.real))))
        for start, end, n in brackets(samples, system):
            rising = crossing_function(end, n, *system, 1.0) > 0.0
            if rising == (crossing_function(start, n, *system, 1.0) > 0.0):
                continue
            omega = brentq(crossing_function, start, end, (n, *system, 1.0), xtol=1e-18, rtol=4.0 * EPS)
            for value, _, other in candidates(BAND * place(omega), n)[:1]:
                if low < value <= high:
                    onsets.append((value, omega, 2.0 * way if rising == (other.imag <= 0.0) else -2.0 * way))
        table = np.array(sorted(onsets)).reshape(-1, 3)
        if agree(lambda value: falling_roots(problem, *at(value)), table, low, high):
            return table
    raise UnsolvedError(
        f"flutter onsets: those from {name} = {low:g} to {high:g} do not explain which motions grow below"
        f" fmax = {fmax:g} Hz; other limits or another fmax near it will do"
    )


@dataclass(frozen=True, eq=False)
class SlidingOnsets(ReadOnlyArrays):
    """Where growth rates pass through zero along one parameter of a scene; arrays are read-only.

    Attributes
    ----------
    parameter : {"mu", "V", "F"}
    value, frequency : ndarray, (n,)
        Values of the parameter, ascending, and frequency, Hz.
    change : ndarray of int, (n,)
        1 where a growth rate rises through zero as the parameter rises (onset), -1 where it falls (recovery).
    """

    parameter: str
    value: Array
    frequency: Array
    change: NDArray[np.int_]


def sliding_onsets(scene: Scene, parameter: str, low: float, high: float, fmax: float = 10e3) -> SlidingOnsets:
    """Onsets and recoveries of steady sliding along the static friction, the speed or the load.

    Those within the band, as for `flutter_onsets`: motions that grow without oscillation, or that enter the band
    while they grow, have none. Where friction falls with the speed, the search along mu ends below `high` at the
    friction at which the contact of a structure jams.

    Parameters
    ----------
    scene : Scene
        The scene; its own value of the parameter is ignored, except for the sign of V.
    parameter : {"mu", "V", "F"}
    low, high : float
        Limits of the parameter, 0 <= low < high; speed and load are above 0.
    fmax : float
        Band, Hz.

    Returns
    -------
    SlidingOnsets

    Raises
    ------
    ValueError, ArithmeticError
        For an argument out of range; if the onsets cannot be isolated.
    """
    checks.instance("scene", scene, Scene)
    checks.choice("parameter", parameter, ("mu", "V", "F"))
    limits = {"mu": (0.0, 1e6, "1"), "V": (1e-100, 1e100, "m/s"), "F": (1e-100, 1e100, "N")}[parameter]
    start, band = checks.between("low", low, *limits), checks.band(fmax)
    end = checks.number(
        "high", high, f"above low = {start:g}, up to {limits[1]:g}", lambda x: start < x <= limits[1]
    )
    own = structure_of(scene.rig, scene.drive_theta)
    if scene.V < 0.0 and not isinstance(scene.rig, Rig):
        own = own.mirrored()
    values = {"mu": scene.mu, "V": abs(scene.V), "F": scene.F}
    value, where, change = crossings(own, band, scene.friction, values, parameter, start, end).T
    axis = where <= 1.0
    return SlidingOnsets(parameter, value[axis], band * where[axis], np.sign(change[axis]).astype(int))


def checked_sliding(friction: Friction, V: Any, F: Any) -> tuple[Array | None, Array | None]:
    """Check speed and load, which friction that falls with the speed needs."""
    checks.instance("friction", friction, Friction)
    if not friction.constant and (V is None or F is None):
        missing = "V" if V is None else "F"
        raise InputError(f"{missing} is missing: where friction falls with the speed give V (m/s) and F (N)")
    given = []
    for name, value, allowed in (("V", V, SPEED), ("F", F, LOAD)):
        each = partial(checks.number, name, allowed=allowed, accept=lambda x: 1e-100 <= x <= 1e100)
        given.append(None if value is None else checks.array(name, value, each))
    return given[0], given[1]
