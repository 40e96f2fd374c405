"""Modes of steady sliding that keep their numbers along friction, or along any other parameter.

Mode a at one place of the path and mode b at another are compared by a modal assurance criterion with the right
vectors x and the left vectors y of both, (p + c phi + phi^2) x = (n + mu t) N with n x = 0, and
(p + c phi + phi^2) y = n A with (n + mu t) y = 0:

    P_ab = S_ab S_ba / (S_aa S_bb),    S_ab = y_a (c + phi_a + phi_b) x_b

It does not depend on how vectors are scaled, is 1 or 0 at the same place, and its rows sum to 1 over all modes. Of
two modes about to lock in, right vectors alone are nearly parallel. Along friction with one contact no vectors are
needed: S_ab is (mu_a - mu_b) h_NT(phi_a) / (phi_a - phi_b), so that P_ab is the product of both slopes
d phi / d mu over the square of the slope between the two exponents.

Along another parameter the modes of the open structure change, too. Then vectors are compared as displacements: of
a rig's nodes, along and across each beam, weighted with their masses; of a structure with positions, of its nodes.
They are orthonormalised, by the nearest orthonormal vectors. Modes of a structure without positions are those
with the same rows of gaps, load and output.

A cell of the path in which P leaves a mode without a partner is halved up to HALVINGS times. What is without one
then coalesces, and is linked by its exponents, ties in the order of `sliding_modes`: of two modes the lower one
becomes the decaying one, and the decaying one the lower where they part.

The cells are those of friction, not of a request, so that numbers depend on the structure alone. A veering or a
locking-in within a cell across which the vectors persist counts as a crossing.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from fivcore import checks
from fivcore.beams.modes import rig_bases
from fivcore.errors import InputError
from fivcore.friction import COULOMB
from fivcore.jit import Array, Complex, ReadOnlyArrays
from fivcore.rig import ContactModel, Rig
from fivcore.stability.exponents import band_modes
from fivcore.stability.several import closed_contacts
from fivcore.stability.sliding import SlidingModes, sliding_modes
from fivcore.structure import Structure, modal_structure

# Cells of friction begin at FIRST and grow by GROWTH; one is halved at most HALVINGS times, into at most MOST
# (`python -m tests.benchmarks.following`).
FIRST, GROWTH, HALVINGS, MOST = 5e-3, 1.2, 10, 200
# Two modes are one where P is so near to 1, or where the exponent changes by no more than SAME of it.
# Exponents whose squares differ by more than FAR of them, or of SLOW squared, are of two modes; a tie is decided
# by a share TIE.
NEAR, SAME, FAR, SLOW, TIE = 0.5, 1e-9, 0.3, 0.02, 1e-2
# Open modes of a rig up to so many times the band squared take part in the comparison of vectors; the least
# distance of an exponent from that of an open mode.
OPEN, TINY = 9.0, 1e-14
LISTED = ("frequency", "growth_rate", "eigenvalue", "uncoupled")


@dataclass(frozen=True, eq=False)
class _BySlope:
    """Exponents at a friction, (modes,), in units of the band, and their slopes d phi / d mu.

    Of points with as many modes all may have a leading dimension.
    """

    place: Any
    phi: Complex
    slope: Complex

    def same(self, other: _BySlope) -> Complex:
        """P_ab of modes here and there."""
        between = (self.phi[..., None] - other.phi[..., None, :]) / np.subtract(self.place, other.place)[
            ..., None, None
        ]
        return np.asarray(self.slope[..., None] * other.slope[..., None, :] / between**2)


@dataclass(frozen=True, eq=False)
class _ByVectors:
    """Exponents at a place of the path, S_aa, and right and left vectors, (modes, coordinates); `damped`: c y."""

    place: float
    phi: Complex
    own: Complex
    right: Complex
    left: Complex
    damped: Complex

    def overlap(self, other: _ByVectors) -> Complex:
        """S_ab of left vectors here and right vectors there."""
        both = (self.phi[:, None] + other.phi) * (self.left @ other.right.T)
        return np.asarray(both + self.damped @ other.right.T)

    def same(self, other: _ByVectors) -> Complex:
        """P_ab of modes here and there."""
        return np.asarray(self.overlap(other) * other.overlap(self).T / (self.own[:, None] * other.own))


class _AlongFriction:
    """Modes of one structure with one contact along friction."""

    def __init__(self, rig: ContactModel, theta: float, fmax: float) -> None:
        self.rig, self.theta, self.fmax, self.omega = rig, theta, fmax, 2.0 * np.pi * fmax
        self.p, self.c, (n, t) = band_modes(modal_structure(rig, theta), fmax).few
        self.rows = np.stack([n * n, n * t], axis=1)

    def points(self, mu: Any) -> list[_BySlope]:
        """Those of frictions."""
        return self.of(sliding_modes(self.rig, self.theta, mu, self.fmax))

    def of(self, modes: SlidingModes) -> list[_BySlope]:
        """Points of modes over friction, (points,)."""
        phi, mu = (modes.growth_rate + 2j * np.pi * modes.frequency) / self.omega, modes.mu[:, None]
        with np.errstate(all="ignore"):
            soft = 1.0 / (self.p + phi[..., None] * (self.c + phi[..., None]))
            # The slope of f is - sum (c + 2 phi) soft^2 (n n + mu n t).
            by_phi, by_damping = soft**2 @ self.rows, soft**2 @ (self.c[:, None] * self.rows)
            fall = 2.0 * phi[..., None] * by_phi + by_damping
            slope = (soft @ self.rows[:, 1]) / (fall[..., 0] + mu * fall[..., 1])
        # A mode that moves no contact has none.
        slope[modes.uncoupled] = np.nan
        listed = np.count_nonzero(np.isfinite(phi), axis=1).tolist()
        each = zip(modes.mu.tolist(), phi, slope, listed, strict=True)
        return [_BySlope(place, one[:m], other[:m]) for place, one, other, m in each]


class _AlongAny:
    """Modes of the models that `at` gives at the places of a path: rig, theta, mu and perhaps F."""

    def __init__(self, at: Callable[[float], Sequence[Any]], fmax: float, *, fixed: bool = False) -> None:
        self.at, self.fmax, self.fixed, self.omega = at, fmax, fixed, 2.0 * np.pi * fmax
        self.first: Any = None
        self.solved = dict[float, SlidingModes]()

    def points(self, places: Any) -> list[Any]:
        """Those of the places at which there is steady sliding."""
        found = []
        for place in map(float, places):
            rig, theta, mu, *load = self.at(place)
            with suppress(*([InputError] if rig.several else [])):
                modes = sliding_modes(rig, theta, [mu], self.fmax, F=load[0] if load else None)
                self.solved[place] = modes
                found.append(self.point(place, modes, 0))
        return found

    def of(self, modes: SlidingModes) -> list[Any]:
        """Points of modes over friction, (points,)."""
        return [self.point(mu, modes, k) for k, mu in enumerate(modes.mu.tolist())]

    def point(self, place: float, modes: SlidingModes, k: int) -> _ByVectors:
        """The point of the modes at the k-th friction."""
        theta, mu, listed = float(modes.theta[k]), float(modes.mu[k]), np.isfinite(modes.frequency[k])
        phi = ((modes.growth_rate + 2j * np.pi * modes.frequency) / self.omega)[k, listed]
        own, F = modal_structure(modes.rig, theta), None if modes.F is None else float(np.ravel(modes.F)[k])
        # Static modes have the damping of Rayleigh's law, as in `exponents`.
        p, far = own.stiffness, np.arange(len(own.stiffness)) >= len(own.frequency)
        near = p <= OPEN * self.omega**2 if isinstance(modes.rig, Rig) else ~far | (own.shapes is None)
        p, c = (p / self.omega**2)[near], ((own.damping + own.d2 * p * far) / self.omega)[near]
        n, t = np.atleast_2d(own.normal)[:, near], np.atleast_2d(own.tangential)[:, near]
        factor = np.ones(1)
        if own.several:
            closed = list(closed_contacts(own, COULOMB, mu, None, F))
            n, t, factor = n[closed], t[closed], own.friction[closed]
        push, distance = n + (mu * factor)[:, None] * t, p + phi[:, None] * (c + phi[:, None])
        # An open mode that moves no contact has its own exponent, but for rounding.
        soft = 1.0 / np.where(np.abs(distance) > TINY, distance, TINY)
        left = right = np.ones((len(phi), 1))
        if len(n) > 1:
            u, _, v = np.linalg.svd((n * soft[:, None]) @ push.T)
            left, right = u[:, :, -1].conj(), v[:, -1].conj()
        left, right = (np.asarray(soft * each, complex) for each in (left @ n, right @ push))
        for mode in np.flatnonzero(modes.uncoupled[k, listed]).tolist():
            left[mode] = right[mode] = np.arange(len(p)) == np.abs(distance[mode]).argmin()
        squares = np.sum(left * (c + 2.0 * phi[:, None]) * right, axis=1)
        vectors: Any = right, left, left * c
        if not self.fixed:
            seen = self.coordinates(modes.rig, theta, own, near).T
            vectors = [each @ seen for each in vectors]
        return _ByVectors(place, phi, squares, *vectors)

    def coordinates(self, rig: ContactModel, theta: float, own: Structure, near: Any) -> Array:
        """The open modes in coordinates that mean the same motion all along the path, (coordinates, n)."""
        if isinstance(rig, Rig):
            shapes = _beam_shapes(rig, theta)[:, near]
        elif own.shapes is not None:
            shapes = own.shapes.reshape(-1, own.shapes.shape[-1])
        else:
            return self.alike(own)[:, near]
        u, _, v = np.linalg.svd(shapes, full_matrices=False)
        return np.asarray(u @ v)

    def alike(self, own: Structure) -> Array:
        """The modes of a structure in the order and with the signs of those at the first place, (n, n)."""
        rows = [
            np.atleast_2d(getattr(own, name)) for name in ("normal", "tangential", "load", "output", "inertia")
        ]
        table = np.concatenate([each / max(np.abs(each).max(), 1e-300) for each in rows])
        self.first = table if self.first is None else self.first
        if table.shape != self.first.shape:
            raise InputError(
                f"rig: {table.shape[1]} modes, and {self.first.shape[1]} at the first value; it must have as many"
                " at all, or positions of nodes"
            )
        away = [np.abs(self.first[..., None] - sign * table[:, None]).sum(axis=0) for sign in (1.0, -1.0)]
        first, here = linear_sum_assignment(np.minimum(*away))
        found = np.zeros((len(first), len(first)))
        found[first, here] = np.where(away[0] <= away[1], 1.0, -1.0)[first, here]
        return found


def _beam_shapes(rig: Rig, theta: float) -> Array:
    """Displacement of the nodes along and across each beam, times the root of their mass, (2 nodes, n)."""
    sine, cosine = np.sin(np.radians(theta)), np.cos(np.radians(theta))
    turns = np.array([[-sine, -cosine], [cosine, -sine]]), np.eye(2)
    blocks = []
    for beam, basis, turn, head in zip(
        (rig.p1, rig.p2), rig_bases(rig, theta), turns, (rig.head_mass, 0.0), strict=True
    ):
        mass = np.full(beam.elements + 1, beam.mass / beam.elements)
        mass[[0, -1]] *= 0.5
        mass[0] += head
        shapes = np.einsum("ij,kjn->kin", turn, basis.shapes[:, :2]) * np.sqrt(mass)[:, None, None]
        blocks.append(shapes.reshape(-1, shapes.shape[-1]))
    upper, lower = (block.shape[1] for block in blocks)
    return np.concatenate([np.pad(blocks[0], ((0, 0), (0, lower))), np.pad(blocks[1], ((0, 0), (upper, 0)))])


def _costs(one: Any, other: Any) -> Array:
    """How far P is from 1, (..., modes, modes); at most 1."""
    with np.errstate(all="ignore"):
        same = np.abs(one.same(other) - 1.0)
    away = np.abs(one.phi[..., None] - other.phi[..., None, :])
    size = np.maximum(np.abs(one.phi)[..., None], np.abs(other.phi)[..., None, :])
    return np.asarray(np.where(away <= SAME * size, 0.0, np.where(same < 1.0, same, 1.0)))


def _link(one: Any, other: Any, *, last: bool) -> tuple[Any, bool]:
    """Place in `one` of each mode of `other`, -1 for none, and whether none is in doubt; `last`: by exponents."""
    cost = _costs(one, other)
    rows, columns = linear_sum_assignment(cost)
    sure = cost[rows, columns] < NEAR
    found = np.full(len(other.phi), -1)
    found[columns[sure]] = rows[sure]
    free, new = np.setdiff1d(np.arange(len(one.phi)), rows[sure]), np.flatnonzero(found < 0)
    if last and len(free) and len(new):
        # The highest or fastest growing first, as a pair that ceases to oscillate has a growing one.
        free, new = free[::-1], new[::-1]
        size = np.maximum(np.abs(one.phi[free, None]), np.abs(other.phi[new]))
        # Squares pass through zero, where a mode ceases to oscillate.
        apart = np.abs(one.phi[free, None] ** 2 - other.phi[new] ** 2) / np.maximum(size, SLOW) ** 2
        tie = 1.0 + TIE * np.abs(np.arange(len(free))[:, None] - np.arange(len(new)))
        rows, columns = linear_sum_assignment(np.minimum(apart, FAR) * tie)
        near = apart[rows, columns] < FAR
        found[new[columns[near]]] = free[rows[near]]
    return found, not (len(free) or len(new))


def _links(pairs: Sequence[tuple[Any, Any]]) -> list[Any]:
    """`_link` of each pair, None of those in doubt."""
    groups, found = dict[int, list[int]](), list[Any]([None] * len(pairs))
    for k, (one, other) in enumerate(pairs):
        if len(one.phi) == len(other.phi):
            groups.setdefault(len(one.phi) if isinstance(one, _BySlope) else -k - 1, []).append(k)
    for size, at in groups.items():
        if not len(pairs[at[0]][0].phi):
            for k in at:
                found[k] = np.empty(0, dtype=np.intp)
            continue
        cost = _costs(
            *(_stacked([pairs[k][side] for k in at]) if size > 0 else pairs[at[0]][side] for side in (0, 1))
        )
        cost = np.reshape(cost, (len(at), *cost.shape[-2:]))
        # Where each has its nearest partner, these are those of the assignment.
        nearest, near = cost.argmin(axis=-2), (cost.min(axis=-2, initial=1.0) < NEAR).all(axis=-1)
        whole = (np.sort(nearest, axis=-1) == np.arange(nearest.shape[-1])).all(axis=-1)
        for j in np.flatnonzero(near).tolist():
            links, sure = (nearest[j], True) if whole[j] else _link(*pairs[at[j]], last=False)
            found[at[j]] = links if sure else None
    return found


def _stacked(points: Sequence[_BySlope]) -> _BySlope:
    return _BySlope(*(np.array([getattr(point, name) for point in points]) for name in ("place", "phi", "slope")))


@dataclass(frozen=True, eq=False)
class _Path:
    """Points along a path, ascending, the numbers of their modes, and how many there are up to each point."""

    follower: Any
    places: list[float]
    points: list[Any]
    numbers: list[Any]
    counts: list[int]

    def at(self, points: Sequence[Any]) -> Iterator[Any]:
        """Numbers of the modes of any points, from those of the points beside them."""
        before = [bisect_right(self.places, point.place) - 1 for point in points]
        pairs = [(self.points[k], point) for k, point in zip(before, points, strict=True)]
        for (_, point), k, links in zip(pairs, before, _links(pairs), strict=True):
            yield self._at(point, k) if links is None else self.numbers[k][links]

    def _at(self, point: Any, place: int) -> Any:
        own = _numbered(self.numbers[place], _link(self.points[place], point, last=True)[0])
        if (own < 0).any() and place + 1 < len(self.places):
            # They enter the band before the next point.
            place += 1
            back, _ = _link(point, self.points[place], last=True)
            for here, number in zip(back.tolist(), self.numbers[place].tolist(), strict=True):
                if own[here] < 0 <= here and number not in own:
                    own[here] = number
        own[own < 0] = self.counts[place] + np.arange(np.sum(own < 0))
        return own


def _numbered(numbers: Any, links: Any) -> Any:
    return np.where(links < 0, -1, np.append(numbers, -1)[links])


def _traced(follower: Any, places: list[float], begin: Callable[[float], Any] | None = None) -> _Path:
    """The path over cells between `places`; `begin` gives the numbers at the first point, ascending by default."""
    points, more = follower.points(places), dict.fromkeys(range(len(places)), MOST)
    links = dict[tuple[float, float], Any]()
    for halving in range(HALVINGS + 1):
        pairs = [each for each in pairwise(points) if (each[0].place, each[1].place) not in links]
        doubtful = list[float]()
        for (one, other), found in zip(pairs, _links(pairs), strict=True):
            cell, middle = bisect_right(places, one.place), 0.5 * (one.place + other.place)
            if found is None and halving < HALVINGS and more[cell] and one.place < middle < other.place:
                more[cell] -= 1
                doubtful.append(middle)
            else:
                links[one.place, other.place] = _link(one, other, last=True)[0] if found is None else found
        if not doubtful:
            break
        points = sorted([*points, *follower.points(doubtful)], key=lambda point: point.place)
    numbers = [np.asarray(begin(points[0].place)) if begin else np.arange(len(points[0].phi))] if points else []
    counts = [int(numbers[0].max(initial=-1)) + 1] if points else []
    for one, other in pairwise(points):
        # Where there is no steady sliding at a middle, the cell stays as it is.
        found = links[one.place, other.place]
        own = _numbered(numbers[-1], found) if (found < 0).any() else numbers[-1][found]
        counts.append(counts[-1] + int(np.sum(own < 0)))
        own[own < 0] = np.arange(counts[-2], counts[-1])
        numbers.append(own)
    return _Path(follower, [point.place for point in points], points, numbers, counts)


@lru_cache(maxsize=16)
def _along_friction(rig: ContactModel, theta: float, fmax: float, F: float | None, cells: int) -> _Path:
    """The path from no friction over so many cells."""
    places = [0.0, *(FIRST * GROWTH ** np.arange(cells)).tolist()]
    if rig.several:
        return _traced(_AlongAny(lambda mu: (rig, theta, mu, F), fmax, fixed=True), places)
    return _traced(_AlongFriction(rig, theta, fmax), places)


def followed_modes(
    rig: ContactModel, theta: Any, mu: Any, fmax: float = 10e3, *, F: float | None = None
) -> SlidingModes:
    """`sliding_modes`, each mode in the place of its number, which it keeps along mu.

    Modes are numbered without friction, ascending in frequency, and followed from there; one that enters the band
    later has a later number. Of two modes that lock in the lower becomes the decaying one. A mode keeps its number
    whatever other values of mu are requested. What a mode is after two locked in and parted again is a convention.

    Parameters
    ----------
    rig, theta, mu, fmax :
        As for `sliding_modes`.
    F : float, optional
        Load, N; of several contacts with initial gaps it decides which are closed.

    Returns
    -------
    SlidingModes
        With NaN where a number has no mode.

    Raises
    ------
    ValueError
        For an argument out of range.
    """
    modes = sliding_modes(rig, theta, mu, fmax, F=F)
    numbers = _numbers(modes, F)
    place, listed = np.nonzero(numbers >= 0)
    count, parts = int(numbers.max(initial=-1)) + 1, dict[str, Any]()
    for name in LISTED:
        values = getattr(modes, name).reshape(numbers.shape)
        table = np.full((len(values), count), 0 if name == "uncoupled" else np.nan, values.dtype)
        table[place, numbers[place, listed]] = values[place, listed]
        parts[name] = table.reshape(*modes.mu.shape, count)
    return replace(modes, **parts)


def _numbers(modes: SlidingModes, F: float | None) -> Any:
    """Numbers of the modes, (points, modes), -1 for none."""
    flat: dict[str, Any] = {
        name: getattr(modes, name).reshape(modes.mu.size, modes.frequency.shape[-1]) for name in LISTED
    }
    flat |= {"mu": modes.mu.ravel(), "theta": modes.theta.ravel()}
    numbers = np.full(flat["frequency"].shape, -1)
    for angle in np.unique(flat["theta"]).tolist():
        at = np.flatnonzero(flat["theta"] == angle)
        cells = int(np.ceil(np.log(max(flat["mu"][at].max() / FIRST, 1.0)) / np.log(GROWTH))) + 1
        path = _along_friction(modes.rig, angle, modes.fmax, F, cells)
        here: Any = {name: each[at] for name, each in flat.items()}
        for k, own in zip(at.tolist(), path.at(path.follower.of(replace(modes, **here))), strict=True):
            numbers[k, : len(own)] = own
    return numbers


@dataclass(frozen=True, eq=False)
class FollowedModes(ReadOnlyArrays):
    """Modes of steady sliding along any parameter, each in the place of its number; missing ones are NaN.

    Attributes
    ----------
    values : ndarray, (n,)
    frequency, growth_rate : ndarray, (n, modes)
        Hz and 1/s, as of `SlidingModes`.
    """

    values: Array
    frequency: Array
    growth_rate: Array


def modes_along(at: Callable[[float], Sequence[Any]], values: Any, fmax: float = 10e3) -> FollowedModes:
    """Modes of steady sliding along any parameter: an inclination, a load, a number of a rig or of a structure.

    At the first value modes have the numbers of `followed_modes`. From there they are followed, in the order of
    the values; between two of them the parameter takes on further values where modes are in doubt.

    Parameters
    ----------
    at : callable
        `at(value)` returns rig, theta, mu and perhaps F, as for `followed_modes`. Rigs have the same numbers of
        elements; structures keep the numbers of their nodes, or of their modes if they have no positions.
    values : array_like, (n,)
        Of the parameter, ascending or descending.
    fmax : float
        Band, Hz.

    Returns
    -------
    FollowedModes

    Raises
    ------
    ValueError
        For an argument out of range.

    Examples
    --------
    >>> modes_along(lambda theta: (Rig(), theta, 0.1), [0.0, 5.0, 10.0]).frequency  # doctest: +SKIP
    """
    band, given = checks.band(fmax), checks.array("values", values, float)
    if given.ndim != 1 or not given.size or not (np.all(np.diff(given) > 0.0) or np.all(np.diff(given) < 0.0)):
        raise InputError(f"values of shape {given.shape}: they must be (n,), ascending or descending")
    # Along the path places ascend.
    sign = 1.0 if given[-1] >= given[0] else -1.0
    follower = _AlongAny(lambda place: at(sign * place), band)

    def begin(place: float) -> Any:
        modes, F = follower.solved[place], at(sign * place)[3:]
        return _numbers(modes, *(F or [None]))[0, np.isfinite(modes.frequency[0])]

    path = _traced(follower, (sign * given).tolist(), begin)
    table = np.full((2, len(given), max(path.counts, default=0)), np.nan)
    for place, own in zip(path.places, path.numbers, strict=True):
        for k in np.flatnonzero(sign * given == place):
            modes = follower.solved[place]
            table[:, k, own] = np.stack([modes.frequency, modes.growth_rate])[:, 0, : len(own)]
    return FollowedModes(given, *table)
