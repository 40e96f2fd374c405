"""Stability of steady sliding with several contacts: exponents from a dense eigenproblem, onsets by counting.

Let c contacts with rows n and t be closed in steady sliding (`statics.sliding`; since friction tilts a body, they
may differ from those that the load closes at rest). Perturbations N' of their normal forces enforce n q = 0, and
T' = D N' + k t q', with the coefficients of friction D and their slopes k, N s/m, with falling speed:

    (p + c phi + phi^2) q = (n^T + t^T D) N' + phi t^T k t q,    n q = 0

The inverse at a real shift is a diagonal matrix minus one of rank c (2 c with k), whose eigenvalues LAPACK
computes. Without k and with Rayleigh damping the equation can be written for the undamped eigenvalue lambda, as in
`exponents`, and modes far above the band are compressed by block Lanczos from all rows (`contact.compression`).

An onset is a change of the number of growing exponents along mu. Growing exponents are counted at CELLS + 1
values. If the number changes by one within a cell, that exponent is followed to the zero of its growth rate; if it
changes by more, the cell is halved. The largest negative rate is followed to a maximum between the values. Growth
within less than a cell is missed if this rate has no maximum beside it.

If the set of closed contacts changes along mu, all exponents jump. Such values are bisected to rounding, onsets
are counted in each interval between them, and a change after which more modes grow is itself an onset. A set of
closed contacts that exists for less than a cell may be missed. The search ends where steady sliding ends: where
the contacts jam, or where more than one set of closed contacts is possible.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from fivcore.beams.modes import EPS
from fivcore.contact.compression import FAR, compressed
from fivcore.errors import InputError, UnsolvedError
from fivcore.friction import COULOMB, Friction
from fivcore.jit import Array, Complex
from fivcore.stability.exponents import LARGEST_PHI, eigenvalues, pair
from fivcore.statics import sliding, sliding_forces
from fivcore.structure import Structure

# Number of cells of mu, and the shortest cell relative to mu_max; relative change of a rate that counts as
# rounding; growth relative to |phi| that counts as rounding without damping; number of modes per row that replace
# far modes.
CELLS, SHORTEST_CELL, FLAT, NEUTRAL, BLOCKS = 96, 1e-6, 1e-6, 1e-7, 3
# A change of the closed contacts is bisected to the former fraction of a parameter's range; the new set is
# determined the latter fraction beyond it, because rounding decides at the change itself. A fraction of the last
# piece before the end of steady sliding is omitted, since forces become infinite there. Largest number of pieces;
# relative offset in mu on both sides of such an onset.
CHANGE, AHEAD, END, MOST_PIECES, ASIDE = 1e-13, 1e-8, 1e-6, 500, 1e-6
# Real shift of the inversion.
SHIFT = 1.3

# Indices of the closed contacts, ascending, from 0.
Closed = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class SlidingContacts:
    """Modes of a structure and the contacts that slide, in units of omega, 2 pi fmax in rad/s.

    Attributes
    ----------
    p, c : ndarray, (n,)
    normal, tangential : ndarray, (c, n)
        Of the contacts that are closed.
    friction : ndarray, (c,)
        Factors of mu.
    rayleigh : (float, float) or None
        None with modal damping.
    """

    omega: float
    p: Array
    c: Array
    normal: Array
    tangential: Array
    friction: Array
    rayleigh: tuple[float, float] | None

    def exponents(self, mu: float, k: Array | None = None) -> Complex:
        """All phi of the band with Im >= 0, (any,); `k`, (c,), N s/m, is the negative slope of friction."""
        n, t = self.normal, self.tangential
        push = n + (mu * self.friction)[:, None] * t
        if self.rayleigh and k is None:
            d = 1.0 / (self.p + SHIFT)
            held = solved((n * d) @ push.T, n * d)
            inverse = np.diag(d) - d[:, None] * (push.T @ held)
            values = eigenvalues(inverse[None], np.array([-SHIFT]))[0]
            # Constraints have no finite eigenvalue.
            values = values[np.abs(values) < 1e3 * (1.0 + np.abs(values).min())]
            d1, d2 = self.rayleigh
            phi = pair(values, d1 + d2 * values).ravel()
        else:
            phi = self._damped(push, np.zeros(len(n)) if k is None else self.omega * k)
        phi = phi[(phi.imag >= 0.0) & (phi.imag <= 1.0) & (np.abs(phi) <= LARGEST_PHI)]
        if not self.c.any() and k is None:
            phi.real[np.abs(phi.real) <= NEUTRAL * np.abs(phi)] = 0.0
        return np.asarray(phi[np.lexsort((phi.real, phi.imag))])

    def _damped(self, push: Array, k: Array) -> Complex:
        """All phi, as eigenvalues of (q, v) for given (x, y), of `exponents.damped_inverse`."""
        n, t, c, m = self.normal, self.tangential, self.c, len(self.p)
        d, x, fall = 1.0 / (self.p + SHIFT * (c + SHIFT)), np.eye(m, 2 * m), k[:, None] * t
        soft = -d[:, None] * np.hstack([np.diag(c + SHIFT), np.eye(m)])
        matrix = np.block([
            [(n * d) @ push.T, (n * d) @ t.T],
            [-SHIFT * (fall * d) @ push.T, np.eye(len(n)) - SHIFT * (fall * d) @ t.T],
        ])  # fmt: skip
        forces = solved(matrix, np.vstack([-n @ soft, fall @ (SHIFT * soft + x)]))
        q = soft + d[:, None] * (np.vstack([push, t]).T @ forces)
        return eigenvalues(np.vstack([q, SHIFT * q + x])[None], np.array([SHIFT]))[0]

    def shape(self, phi: complex, mu: float, k: Array | None = None) -> Complex:
        """Modal coordinates of an exponent, (n,): response to the forces that keep the normal gaps closed."""
        n, t = self.normal, self.tangential
        d = 1.0 / (self.p + phi * (self.c + phi))
        fall = np.zeros(len(n)) if k is None else phi * self.omega * k
        # T' = D N' + fall t q, eliminated.
        inner = np.eye(len(n)) - fall[:, None] * ((t * d) @ t.T)
        tangential = np.linalg.solve(inner, np.diag(mu * self.friction) + fall[:, None] * ((t * d) @ n.T))
        push = n.T + t.T @ tangential
        return np.asarray(d * (push @ np.linalg.svd((n * d) @ push)[2][-1].conj()))


def solved(matrix: Array, right: Array) -> Array:
    """Forces that keep contacts closed; if they are not unique (more contacts than motions), the smallest."""
    # Rows and columns are scaled.
    rows = np.abs(matrix).max(axis=1, keepdims=True)
    columns = np.abs(matrix / rows).max(axis=0)
    found = np.linalg.lstsq(matrix / rows / columns, right / rows, rcond=1e-13)[0]
    return np.asarray(found / columns[:, None])


def push(own: Structure, mu: float) -> Array:
    """Modal response to normal forces and their friction, (c, n)."""
    return np.asarray(own.normal + (mu * own.friction)[:, None] * own.tangential)


def sliding_contacts(own: Structure, fmax: float, closed: Closed, whole: bool = False) -> SlidingContacts:
    """The closed contacts of a structure with its modes; `whole` keeps all modes without compression."""
    places = list(closed)
    omega = 2.0 * np.pi * fmax
    rows = np.vstack([own.normal[places], own.tangential[places]]) / omega
    rayleigh = None if own.rayleigh is None else (own.d1 / omega, own.d2 * omega)
    p, c = own.stiffness / omega**2, own.damping / omega
    if rayleigh:
        c = rayleigh[0] + rayleigh[1] * p
    if rayleigh and not whole:
        p, c, rows = compressed(p, c, rows, p > FAR, BLOCKS)
    normal, tangential = np.split(rows, 2)
    return SlidingContacts(omega, p, c, normal, tangential, own.friction[places], rayleigh)


def steady_forces(own: Structure, mu: float, F: float | None = None) -> Array:
    """Normal forces, N, (c,), in steady sliding with friction mu under the load F, N; 0: the contact is open.

    Raises
    ------
    ValueError
        If steady sliding does not exist or is not unique; the message names the smallest such mu.
    """
    if F is None and own.gap.any():
        raise InputError("F is missing: with initial gaps it decides which contacts are closed; give F (N)")

    def found(mu: float) -> list[tuple[Array, Array]]:
        return sliding(own.stiffness, own.normal, push(own, mu), (1.0 if F is None else F) * own.load, own.gap)

    balanced = found(mu)
    if len(balanced) == 1 and balanced[0][0].any():
        return balanced[0][0]
    own.equilibrium(1.0 if F is None else F)
    low, high = 0.0, mu
    while low < (middle := 0.5 * (low + high)) < high:
        one = found(middle)
        low, high = (middle, high) if len(one) == 1 and one[0][0].any() else (low, middle)
    ways = " or ".join(str(np.flatnonzero(forces).tolist()) for forces, _ in balanced)
    what = f"{ways} of the contacts, from 0, may be closed" if ways else "the contacts jam, and none exists"
    raise InputError(f"mu = {mu:g}: no unique steady sliding from mu = {high:.6g} on: {what}")


def closed_contacts(
    own: Structure, friction: Friction, mu: float, V: float | None = None, F: float | None = None
) -> Closed:
    """Indices of the contacts that are closed in steady sliding."""
    return tuple(np.flatnonzero(steady_forces(own, mu * friction.ratio(V or 0.0), F)).tolist())


def sliding_points(
    own: Structure, friction: Friction, closed: Closed, mu: float, V: float | None, F: float | None
) -> tuple[float, Array | None]:
    """Friction mu(V) and its negative slope k, N s/m, for each closed contact; None if it does not fall."""
    m, places = mu * friction.ratio(V or 0.0), list(closed)
    if friction.constant:
        return m, None
    there = np.isin(np.arange(own.contacts), places)
    forces = sliding_forces(own.stiffness, own.normal, push(own, m), (F or 1.0) * own.load, own.gap, there)
    return m, -mu * friction.slope(V or 0.0) * (own.friction * forces)[places]


def exponents_at(own: Structure, fmax: float, friction: Friction) -> Callable[..., Complex]:
    """The exponents, in units of 2 pi fmax, as a function of mu, V, m/s, and F, N, and of the closed contacts.

    Without the last these are those of steady sliding.
    """
    contacts = lru_cache(maxsize=8)(partial(sliding_contacts, own, fmax))

    def at(mu: float, V: float | None, F: float | None, closed: Closed | None = None) -> Complex:
        closed = closed or closed_contacts(own, friction, mu, V, F)
        return contacts(closed).exponents(*sliding_points(own, friction, closed, mu, V, F))

    return at


def shape_of_several(
    own: Any, fmax: float, phi: complex, friction: Friction, mu: float, V: float | None, F: float | None
) -> Complex:
    """Modal coordinates of an exponent, 1/s, of a structure with several contacts, (n,)."""
    closed = closed_contacts(own, friction, mu, V, F)
    contacts = sliding_contacts(own, fmax, closed, whole=True)
    return contacts.shape(phi / contacts.omega, *sliding_points(own, friction, closed, mu, V, F))


def crossings(
    at: Callable[[float], Complex], grid: list[float]
) -> tuple[list[Any], list[Any], list[float], float]:
    """Onsets and recoveries, (mu, frequency in units of the band) each, entries, and where divergence begins.

    mu may be any parameter of the exponents; they are counted on the `grid`, which ascends.
    """

    @cache
    def modes(mu: float) -> tuple[Array, Complex, int]:
        """Growth rates of oscillating modes, the modes, and the number of real growing ones."""
        phi = at(mu)
        moving = _moving(phi)
        return moving.real, moving, int(np.sum((phi.imag == 0.0) & (phi.real > 0.0)))

    def rate(mu: float, place: int) -> float:
        rates = modes(mu)[0]
        # Neutral modes do not count as growing.
        return float(rates[place]) if place < len(rates) and rates[place] != 0.0 else -1.0

    def count(mu: float) -> int:
        return int(np.sum(modes(mu)[0] > 0.0))

    places, most = list(grid), grid[-1]
    for low, middle, high in zip(grid, grid[1:], grid[2:], strict=False):
        place = count(middle)
        if (
            count(low) == place == count(high)
            and rate(low, place) < rate(middle, place) > rate(high, place) > -1.0
            # A rate that is constant to rounding has no maximum.
            and rate(middle, place) - min(rate(low, place), rate(high, place)) > FLAT * abs(rate(middle, place))
        ):
            best = minimize_scalar(lambda mu, k=place: -rate(mu, k), bounds=(low, high), method="bounded")
            if -best.fun > 0.0:
                places.append(float(best.x))
    cells = list(pairwise(sorted(places)))
    onsets, recoveries, entries = list[Any](), list[Any](), list[float]()
    while cells:
        low, high = cells.pop()
        change = count(high) - count(low)
        if abs(change) > 1 and high - low > SHORTEST_CELL * most:
            cells += [(low, 0.5 * (low + high)), (0.5 * (low + high), high)]
            continue
        for place in range(min(count(low), count(high)), max(count(low), count(high))):
            mu = brentq(rate, low, high, (place,), xtol=1e-14 * most, rtol=4.0 * EPS)
            step = 1e-13 * most
            # The side on which it grows.
            while not rate(inside := float(np.clip(mu + np.sign(change) * step, low, high)), place) > 0.0:
                step *= 4.0
            growing = modes(inside)[1][place]
            if growing.real > 1e-4 * abs(growing):
                entries += [mu] if change > 0 else []
            else:
                (onsets if change > 0 else recoveries).append((mu, float(growing.imag)))
    real = [mu for mu in grid if modes(mu)[2]]
    divergence = np.nan
    if real:
        high, low = real[0], max([mu for mu in grid if mu < real[0]], default=grid[0])
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if modes(middle)[2] else (middle, high)
        divergence = high
    return sorted(onsets), sorted(recoveries), sorted(entries), divergence


def _moving(phi: Complex) -> Complex:
    """Oscillating exponents in descending order of growth rate."""
    moving = phi[phi.imag > 0.0]
    return np.asarray(moving[np.argsort(-moving.real)])


def pieces_of(
    closed_at: Callable[[float], Closed], grid: list[float]
) -> tuple[list[tuple[Closed, list[float]]], float]:
    """Pieces of the grid with the closed contacts of each, and the end of steady sliding, or NaN."""

    def closed(value: float) -> Closed | None:
        try:
            return closed_at(value)
        except InputError:
            return None

    pieces = [(closed_at(grid[0]), grid[:1])]
    for value in grid[1:]:
        while closed(value) != pieces[-1][0]:
            here, values = pieces[-1]
            low, high = values[-1], value
            while high - low > CHANGE * grid[-1] and low < (middle := 0.5 * (low + high)) < high:
                low, high = (middle, high) if closed(middle) == here else (low, middle)
            there, start = closed(ahead := min(high + AHEAD * grid[-1], value)), values[-1]
            if there is None:
                values += [low - END * (low - start)] if low > start else []
                return pieces, high
            values += [low] if low > start else []
            if there == here:
                values.append(ahead)
            else:
                pieces.append((there, [high, ahead] if high < ahead < value else [high]))
            if len(pieces) > MOST_PIECES:
                raise UnsolvedError(f"closed contacts change more than {MOST_PIECES} times up to {high:g}")
            if ahead == value:
                break
        if value > pieces[-1][1][-1]:
            pieces[-1][1].append(value)
    return pieces, np.nan


def _with(at: Callable[[float, Closed], Complex], closed: Closed, value: float) -> Complex:
    return at(value, closed)


def crossings_in_pieces(
    at: Callable[[float, Closed], Complex], closed_at: Callable[[float], Closed], grid: list[float]
) -> tuple[list[Any], list[Any], list[float], float]:
    """`crossings` with a changing set of closed contacts; the end of steady sliding counts as divergence."""
    (pieces, end), before = pieces_of(closed_at, grid), np.empty(0, dtype=complex)
    onsets, recoveries, entries, divergence = list[Any](), list[Any](), list[float](), end
    for place, (closed, values) in enumerate(pieces):
        found = crossings(partial(_with, at, closed), values)
        first, last = (_moving(at(value, closed)) for value in (values[0], values[-1]))
        first, last = first[first.real > 0.0], last[last.real > 0.0]
        if place:
            onsets += [(values[0], float(phi.imag)) for phi in first[len(before) :]]
            recoveries += [(values[0], float(phi.imag)) for phi in before[len(first) :]]
        before, onsets, recoveries = last, onsets + found[0], recoveries + found[1]
        entries, divergence = entries + found[2], float(np.fmin(divergence, found[3]))
    return sorted(onsets), sorted(recoveries), sorted(entries), divergence


def onsets_of_several(
    own: Structure, fmax: float, mu_max: float, friction: Friction, V: Any, F: Any
) -> tuple[Array, Array, Array, Array, Array, float]:
    """Onsets and recoveries, mu and Hz each, entries and divergence, of a structure with several contacts."""
    given = dict(zip("VF", [None if each is None else float(each) for each in (V, F)], strict=True))
    grid = np.linspace(0.0, mu_max, CELLS + 1).tolist()
    *found, entries, divergence = _along(own, fmax, friction, given, "mu", grid)
    tables = [np.array(each).reshape(-1, 2) * [1.0, fmax] for each in found]
    return *(column.copy() for table in tables for column in table.T), np.array(entries), divergence


def onsets_along(
    own: Structure, fmax: float, friction: Friction, values: dict[str, float], name: str, low: float, high: float
) -> Array:
    """`falling.falling_crossings` of a structure with several contacts: value, frequency over fmax, 1 or -1."""
    grid = np.geomspace(low, high, CELLS + 1) if low > 0.0 else np.linspace(low, high, CELLS + 1)
    onsets, recoveries, *_ = _along(own, fmax, friction, values, name, grid.tolist())
    found = [(*each, sign) for each, sign in [(each, 1) for each in onsets] + [(each, -1) for each in recoveries]]
    return np.array(sorted(found)).reshape(-1, 3)


def _along(
    own: Structure, fmax: float, friction: Friction, values: dict[str, Any], name: str, grid: list[float]
) -> Any:
    """`crossings_in_pieces` along one of mu, V and F."""
    at = exponents_at(own, fmax, friction)
    return crossings_in_pieces(
        lambda value, closed: at(**values | {name: value}, closed=closed),
        lambda value: closed_contacts(own, friction, **values | {name: value}),
        grid,
    )


def sides(own: Structure, soft: Any, mu: float) -> tuple[Any, Any, Any, Any, Any]:
    """Row of the gap that an exponent keeps closed, (n,), the force row, and their derivatives.

    `soft` is the modal response 1 / (p + c phi + phi^2). The next two results are the derivatives of both rows as
    the normal and tangential directions rotate; the last is that of the force row by mu. With several contacts the
    rows are the combinations of closed gaps and of forces with the smallest response; NaN if the set of contacts
    changes.
    """
    if own.gap is None:
        n, t = own.normal, own.tangential
        return n, n + mu * t, -t, mu * n - t, t
    before, closed = (closed_contacts(own, COULOMB, mu * (1.0 + side * ASIDE)) for side in (-1, 1))
    contacts = sliding_contacts(own, 1.0 / (2.0 * np.pi), closed, whole=True)
    n, t, factors = contacts.normal, contacts.tangential, contacts.friction[:, None]
    left, _, right = np.linalg.svd((n * soft) @ (n + mu * factors * t).T)
    gap, force = left[:, -1].conj() * (1.0 if before == closed else np.nan), right[-1].conj()
    return gap @ n, force @ (n + mu * factors * t), -gap @ t, force @ (mu * factors * n - t), force @ (factors * t)
