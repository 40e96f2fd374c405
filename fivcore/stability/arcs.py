"""The curves of all flutter onsets in the plane of theta and frequency, followed arc by arc.

On the imaginary axis mu(omega, theta) = -h_NN / h_NT, and an onset is where it is real: the onsets of all
angles are the curves W = Im(h_NN conj h_NT) = 0 of the plane (theta, omega), and mu is explicit on them. Where a
curve turns back in theta, at a fold, an onset and a recovery meet. Arcs are followed by their tangent and by
Newton steps across them (pseudo-arclength continuation).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from fivcore.jit import Array
from fivcore.stability.inclination import Inclination

# Lengths in the plane: frequencies that differ by this share are as far apart as angles that differ by a degree.
SHARE = 0.01
# A step is halved until the tangent turns by less than this (rad) and the correction is below this share of it.
TURN, CORRECTION = 0.3, 0.1
# Steps: the longest, as a share of the interval and in degrees; an arc that needs shorter ones is given up.
LONGEST_SHARE, LONGEST, SHORTEST = 0.5, 0.5, 1e-10
MOST_STEPS = 20_000
DEGREE = np.pi / 180.0
# Newton's method has converged when its steps, once this short, do not shrink to this share of the last.
SHORT, STALLED, MOST_NEWTON = 1e-6, 0.25, 15


@dataclass(frozen=True)
class OnsetPoint:
    """A point of the plane, and how W and mu change about it.

    Attributes
    ----------
    theta, omega, mu : float
        Degrees, units of the band, 1.
    across, along : tuple of float
        Derivatives with respect to theta and omega: of -W, which has the sign of theta Im mu, and of Re mu.
    """

    theta: float
    omega: float
    mu: float
    across: tuple[float, float]
    along: tuple[float, float]

    @property
    def rises(self) -> bool:
        """Whether it is an onset and not a recovery: d Re(phi) / d mu has the sign of d Im(mu) / d omega."""
        return (self.across[1] > 0.0) == (self.theta > 0.0)


@dataclass(frozen=True)
class OnsetPlane:
    """The plane of theta and frequency of one rig, for frictions up to `mu_max`."""

    system: Inclination
    mu_max: float

    def function(self, theta: float, omega: float) -> tuple[float, OnsetPoint]:
        """-W, and the point with its derivatives.

        W is taken free of poles, and divided by sin(2 theta) and by the damping part of lambda: without damping,
        or upright, it would vanish at every frequency.
        """
        value, rate = self.system.on_axis(omega)
        r = self.system.receptance(value, np.radians(theta))
        scale = abs(r.free) ** 2 / value.imag
        normal, coupling = r.normal.conjugate(), r.coupling.conjugate()
        w = scale * (r.normal * coupling).imag
        turn = scale * (r.normal_turn * coupling - r.coupling_turn * normal).imag
        slope = scale * (rate * (r.normal_rate * coupling - r.coupling_rate * normal)).imag
        turn += 2.0 * r.free_turn.real * w
        slope += (2.0 * (rate * r.free_rate).real - rate.imag / value.imag) * w
        tangential = r.sine * r.coupling
        if tangential == 0.0:
            return w, OnsetPoint(theta, omega, np.inf, (turn * DEGREE, slope), (np.nan, np.nan))
        mu = -r.normal / tangential
        _, by_value, by_angle = r.loaded(mu)
        along = (-(by_angle / tangential).real * DEGREE, -(rate * by_value / tangential).real)
        return w, OnsetPoint(theta, omega, mu.real, (turn * DEGREE, slope), along)

    def tangent(self, point: OnsetPoint, heading: Array) -> Array:
        """Unit tangent, on the side of `heading`."""
        across = np.array(point.across) * _unit(point.omega)
        along = np.array([-across[1], across[0]]) / np.hypot(*across)
        return along if along @ heading >= 0.0 else -along

    def correct(self, theta: float, omega: float, direction: Array | None = None) -> OnsetPoint | None:
        """The point of a curve across from a guess, or along a direction from it; none if that fails."""
        last = np.inf
        for _ in range(MOST_NEWTON):
            if not omega > 0.0:
                return None
            unit = _unit(omega)
            w, point = self.function(theta, omega)
            across = np.array(point.across) * unit
            way = across if direction is None else direction
            step = -w / (across @ way) * way
            length = float(np.hypot(*step))
            if not np.isfinite(length):
                return None
            if length < SHORT and length >= STALLED * last:
                return point
            last = length
            theta, omega = theta + step[0] * unit[0], omega + step[1] * unit[1]
        return None

    def between(self, p: OnsetPoint, q: OnsetPoint, passes: Callable[[OnsetPoint], float]) -> OnsetPoint:
        """The point between two neighbours on a curve where `passes`, of opposite sign at them, is zero."""
        chord = np.array([q.theta - p.theta, q.omega - p.omega])
        along = chord / _unit(p.omega)
        normal = np.array([-along[1], along[0]]) / np.hypot(*along)
        known = {0.0: p, 1.0: q}

        def at(share: float) -> float:
            if share not in known:
                point = self.correct(p.theta + share * chord[0], p.omega + share * chord[1], normal)
                if point is None:
                    raise ArithmeticError(f"an onset near theta = {p.theta:.9g} could not be followed")
                known[share] = point
            return passes(known[share])

        share = brentq(at, 0.0, 1.0, xtol=1e-14, rtol=1e-14)
        at(share)
        return known[share]

    def stationary(self, p: OnsetPoint, q: OnsetPoint) -> OnsetPoint | None:
        """Where mu is stationary between two neighbours on a curve, both onsets or both recoveries."""

        def rate(at: OnsetPoint) -> float:
            # d mu / d theta along the curve, times what keeps its sign there.
            return at.along[0] * at.across[1] - at.along[1] * at.across[0]

        return self.between(p, q, rate) if rate(p) * rate(q) < 0.0 else None

    def excess(self, point: OnsetPoint) -> float:
        """Above zero beyond mu_max or the band, or below mu = 0."""
        return max(min(point.mu / self.mu_max - 1.0, 1.0), point.omega - 1.0, min(-point.mu, 1.0))

    def follow(self, start: OnsetPoint, heading: float, left: float, right: float) -> list[OnsetPoint]:
        """A curve from a point at `left` or `right` until it leaves what lies between.

        Parameters
        ----------
        heading : float
            1 to begin towards larger theta, -1 towards smaller.

        Returns
        -------
        list of OnsetPoint
            Folds among them. The last lies at `left` or `right`, at mu_max or at the end of the band.

        Raises
        ------
        ArithmeticError
            If the curve cannot be followed.
        """
        points = [start]
        if self.excess(start) >= 0.0:
            return points
        longest = min(LONGEST_SHARE * (right - left), LONGEST)
        direction, step = self.tangent(start, np.array([heading, 0.0])), 0.5 * longest
        for _ in range(MOST_STEPS):
            here = points[-1]
            there = self._step(here, step * direction)
            if there is None:
                step *= 0.5
                if step < SHORTEST:
                    break
                continue
            fold = (
                [self.between(here, there, lambda at: at.across[1])]
                if here.across[1] * there.across[1] < 0.0
                else []
            )
            for point in (*fold, there):
                inside = self._inside(points[-1], point, left, right)
                points.append(inside)
                if inside is not point:
                    return points
            direction, step = self.tangent(there, direction), min(1.5 * step, longest)
        raise ArithmeticError(f"an onset near theta = {points[-1].theta:.9g} could not be followed")

    def _step(self, here: OnsetPoint, step: Array) -> OnsetPoint | None:
        """The next point of a curve; none if the step is too long for it."""
        unit = _unit(here.omega)
        there = self.correct(here.theta + step[0] * unit[0], here.omega + step[1] * unit[1])
        if there is None:
            return None
        length = np.hypot(*step)
        moved = np.array([there.theta - here.theta, there.omega - here.omega]) / unit - step
        straight = self.tangent(there, step) @ step >= np.cos(TURN) * length
        return there if straight and np.hypot(*moved) <= CORRECTION * length else None

    def _inside(self, last: OnsetPoint, point: OnsetPoint, left: float, right: float) -> OnsetPoint:
        """The point itself if it lies inside, else where the curve leaves after `last`."""
        if not left < point.theta < right:
            edge = left if point.theta <= left else right
            point = replace(self.between(last, point, lambda at: at.theta - edge), theta=edge)
        return point if self.excess(point) <= 0.0 else self.between(last, point, self.excess)


def _unit(omega: float) -> Array:
    """What counts as 1 along both axes of the plane."""
    return np.array([1.0, SHARE * omega])
