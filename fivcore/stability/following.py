"""Modes of steady sliding that keep their numbers along friction.

Mode a at one friction and mode b at the next are compared by a modal assurance criterion with the right vectors x
and the left vectors y of both, (p + c phi + phi^2) x = (n + mu t) N with n x = 0, and (p + c phi + phi^2) y = n A
with (n + mu t) y = 0:

    P_ab = S_ab S_ba / (S_aa S_bb),    S_ab = y_a (c + phi_a + phi_b) x_b

It does not depend on how vectors are scaled, is 1 or 0 at equal friction, and its rows sum to 1 over all modes. Of
two modes about to lock in, right vectors alone are nearly parallel. A cell of friction in which P leaves a mode
without a partner is halved up to HALVINGS times. What is without one then coalesces, and is linked by its
exponents, ties in the order of `sliding_modes`: of two modes the lower one becomes the decaying one, and the
decaying one the lower where they part.

The cells are those of friction, not of a request, so that numbers depend on the structure alone. A veering or a
locking-in within a cell across which the vectors persist counts as a crossing.
"""

from __future__ import annotations

from bisect import bisect_right
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from fivcore.errors import InputError
from fivcore.friction import COULOMB
from fivcore.jit import Array, Complex
from fivcore.rig import ContactModel
from fivcore.stability.exponents import band_modes
from fivcore.stability.several import closed_contacts
from fivcore.stability.sliding import SlidingModes, sliding_modes
from fivcore.structure import modal_structure

# Cells begin at FIRST and grow by GROWTH, in groups of STEP; one is halved at most HALVINGS times, all together at
# most MOST times.
FIRST, GROWTH, STEP, HALVINGS, MOST = 1e-3, 1.05, 48, 10, 2000
# Two modes are one where P is so near to 1, or where friction changes the exponent by no more than SAME of it.
# Exponents whose squares differ by more than FAR of them, or of SLOW squared, are of two modes; a tie is decided
# by a share TIE.
NEAR, SAME, FAR, SLOW, TIE = 0.5, 1e-9, 0.3, 0.02, 1e-2


@dataclass(frozen=True, eq=False)
class _Point:
    """Exponents at a friction, (modes,), in units of the band, and their vectors, (modes, n), right and left."""

    mu: float
    phi: Complex
    right: Complex
    left: Complex
    damping: Array

    def overlap(self, other: _Point) -> Complex:
        """S_ab of left vectors here and right vectors there."""
        both = self.left @ other.right.T
        return np.asarray(self.phi[:, None] * both + both * other.phi + (self.left * self.damping) @ other.right.T)

    @cached_property
    def own(self) -> Complex:
        """S_aa."""
        return np.sum(self.left * (self.damping + 2.0 * self.phi[:, None]) * self.right, axis=1)


class _Follower:
    """Modes of one structure, at one load, along friction."""

    def __init__(self, rig: ContactModel, theta: float, fmax: float, F: float | None) -> None:
        self.rig, self.theta, self.fmax, self.F = rig, theta, fmax, F
        self.own, self.omega = modal_structure(rig, theta), 2.0 * np.pi * fmax
        if not rig.several:
            self.p, self.c, (self.n, self.t) = band_modes(self.own, fmax).few
            return
        m, p = len(self.own.frequency), self.own.stiffness
        # Static modes have the damping of Rayleigh's law, as in `exponents`.
        damping = self.own.damping + self.own.d2 * p * (np.arange(len(p)) >= m)
        self.p, self.c = p / self.omega**2, damping / self.omega
        self.n, self.t = self.own.normal, self.own.tangential

    def points(self, mu: Array) -> list[_Point]:
        """Those of the frictions at which there is steady sliding."""
        if not self.rig.several:
            return self.of(sliding_modes(self.rig, self.theta, mu, self.fmax))
        found = []
        for each in mu.tolist():
            with suppress(InputError):
                found += self.of(sliding_modes(self.rig, self.theta, [each], self.fmax, F=self.F))
        return found

    def of(self, modes: SlidingModes) -> list[_Point]:
        """Points of modes over friction, (points,)."""
        phi = (modes.growth_rate + 2j * np.pi * modes.frequency) / self.omega
        rows = zip(modes.mu.tolist(), phi, modes.uncoupled, np.isfinite(phi), strict=True)
        return [self._point(mu, each[listed], alone[listed]) for mu, each, alone, listed in rows]

    def _point(self, mu: float, phi: Complex, alone: Any) -> _Point:
        n, t, factor = np.atleast_2d(self.n), np.atleast_2d(self.t), np.ones(1)
        if self.rig.several:
            closed = list(closed_contacts(self.own, COULOMB, mu, None, self.F))
            n, t, factor = n[closed], t[closed], self.own.friction[closed]
        push = n + (mu * factor)[:, None] * t
        with np.errstate(all="ignore"):
            soft = 1.0 / (self.p + phi[:, None] * (self.c + phi[:, None]))
            # The vectors of a mode that moves no contact are not of this form.
            soft[alone] = np.nan
            left = right = np.ones((len(phi), 1))
            if len(n) > 1:
                u, _, v = np.linalg.svd(np.nan_to_num((n * soft[:, None]) @ push.T))
                left, right = u[:, :, -1].conj(), v[:, -1].conj()
            return _Point(mu, phi, soft * (right @ push), soft * (left @ n), self.c)


def _links(one: _Point, other: _Point, *, last: bool) -> tuple[Any, bool]:
    """Place in `one` of each mode of `other`, -1 for none, and whether none is in doubt; `last`: by exponents."""
    with np.errstate(all="ignore"):
        same = one.overlap(other) * other.overlap(one).T / (one.own[:, None] * other.own)
    away = np.abs(one.phi[:, None] - other.phi)
    size = np.maximum(np.abs(one.phi)[:, None], np.abs(other.phi))
    cost = np.nan_to_num(np.where(away <= SAME * size, 0.0, np.abs(same - 1.0)), nan=1.0)
    rows, columns = linear_sum_assignment(np.minimum(cost, 1.0))
    sure = cost[rows, columns] < NEAR
    found = np.full(len(other.phi), -1)
    found[columns[sure]] = rows[sure]
    free, new = np.setdiff1d(np.arange(len(one.phi)), rows[sure]), np.flatnonzero(found < 0)
    if last and len(free) and len(new):
        # The highest or fastest growing first, as a pair that ceases to oscillate has a growing one.
        free, new = free[::-1], new[::-1]
        # Squares pass through zero, where a mode ceases to oscillate.
        apart = (
            np.abs(one.phi[free, None] ** 2 - other.phi[new] ** 2) / np.maximum(size[np.ix_(free, new)], SLOW) ** 2
        )
        tie = 1.0 + TIE * np.abs(np.arange(len(free))[:, None] - np.arange(len(new)))
        rows, columns = linear_sum_assignment(np.minimum(apart, FAR) * tie)
        near = apart[rows, columns] < FAR
        found[new[columns[near]]] = free[rows[near]]
    return found, not (len(free) or len(new))


@dataclass(frozen=True, eq=False)
class _Path:
    """Points along friction, ascending, the numbers of their modes, and how many there are up to each point."""

    follower: _Follower
    mu: list[float]
    points: list[_Point]
    numbers: list[Any]
    counts: list[int]

    def at(self, point: _Point) -> Any:
        """Numbers of the modes of any point, from those of the points beside it."""
        place = bisect_right(self.mu, point.mu) - 1
        own = _numbered(self.numbers[place], _links(self.points[place], point, last=True)[0])
        if (own < 0).any() and place + 1 < len(self.mu):
            # They enter the band before the next point.
            place += 1
            back, _ = _links(point, self.points[place], last=True)
            for here, number in zip(back.tolist(), self.numbers[place].tolist(), strict=True):
                if own[here] < 0 <= here and number not in own:
                    own[here] = number
        own[own < 0] = self.counts[place] + np.arange(np.sum(own < 0))
        return own


def _numbered(numbers: Any, links: Any) -> Any:
    return np.where(links < 0, -1, np.append(numbers, -1)[links])


@lru_cache(maxsize=16)
def _path(rig: ContactModel, theta: float, fmax: float, F: float | None, cells: int) -> _Path:
    """The path from no friction over so many cells."""
    follower = _Follower(rig, theta, fmax, F)
    points, more = follower.points(np.append(0.0, FIRST * GROWTH ** np.arange(cells))), MOST
    links = dict[tuple[float, float], Any]()
    for halving in range(HALVINGS + 1):
        doubtful = list[float]()
        for one, other in pairwise(points):
            if (one.mu, other.mu) not in links:
                last = halving == HALVINGS or len(doubtful) >= more
                found, sure = _links(one, other, last=last)
                if sure or last:
                    links[one.mu, other.mu] = found
                else:
                    doubtful.append(0.5 * (one.mu + other.mu))
        more -= len(doubtful)
        points = sorted([*points, *follower.points(np.array(doubtful))], key=lambda point: point.mu)
    numbers, counts = [np.arange(len(points[0].phi))], [len(points[0].phi)]
    for one, other in pairwise(points):
        own = _numbered(numbers[-1], links[one.mu, other.mu])
        counts.append(counts[-1] + int(np.sum(own < 0)))
        own[own < 0] = np.arange(counts[-2], counts[-1])
        numbers.append(own)
    return _Path(follower, [point.mu for point in points], points, numbers, counts)


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
    parts = {name: getattr(modes, name) for name in ("frequency", "growth_rate", "eigenvalue", "uncoupled")}
    flat = replace(
        modes,
        **{name: each.reshape(modes.mu.size, each.shape[-1]) for name, each in parts.items()},
        mu=modes.mu.ravel(), theta=modes.theta.ravel(),
    )  # fmt: skip
    numbers = np.full(flat.frequency.shape, -1)
    for angle in np.unique(flat.theta).tolist():
        at = np.flatnonzero(flat.theta == angle)
        groups = np.log(max(flat.mu[at].max() / FIRST, GROWTH)) / np.log(GROWTH) / STEP
        path = _path(rig, angle, modes.fmax, F, STEP * int(np.ceil(groups)) + 1)
        here = replace(flat, mu=flat.mu[at], **{name: getattr(flat, name)[at] for name in parts})
        for k, point in zip(at.tolist(), path.follower.of(here), strict=True):
            numbers[k, np.isfinite(flat.frequency[k])] = path.at(point)
    place, listed = np.nonzero(numbers >= 0)
    count = int(numbers.max(initial=-1)) + 1
    for name in parts:
        values = getattr(flat, name)
        table = np.full((len(values), count), 0 if name == "uncoupled" else np.nan, values.dtype)
        table[place, numbers[place, listed]] = values[place, listed]
        parts[name] = table.reshape(*modes.mu.shape, count)
    return replace(modes, **parts)
