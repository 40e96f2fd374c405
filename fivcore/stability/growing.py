"""One growing mode of steady sliding, followed over the inclination at constant friction.

The eigenvalue lambda(theta) is a root of f = h_NN + mu h_NT. Where two meet it has a square-root branch point, at
an onset without damping for one, so that a step is guessed from a quadratic in lambda and not from the tangent;
Newton's method ends it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fivcore.stability.inclination import Inclination

# A step is halved until the correction is below this share of it, and it moves lambda by less than this share.
CORRECTION, REACH = 0.05, 0.2
ROUNDING = 1e-10
# Close to a branch point the two solutions of the quadratic differ by less than this factor.
ALIKE = 100.0
# Degrees; an end is known to the shortest step.
LONGEST, SHORTEST = 1.0, 1e-11
SHORT, STALLED, MOST_NEWTON = 1e-6, 0.25, 20
# What turns less than this, as a share of |phi|, has ceased to oscillate.
STILL = 1e-6


@dataclass(frozen=True)
class GrowingMode:
    """A mode at one angle: theta in degrees, lambda and phi (of its two with Im phi >= 0) in units of the band."""

    theta: float
    value: complex
    phi: complex

    @property
    def oscillates(self) -> bool:
        """Whether it does not merely diverge."""
        return self.phi.imag > STILL * abs(self.phi)


@dataclass(frozen=True)
class Follower:
    """Follows modes of one rig at one friction, as far as they belong to a result.

    Attributes
    ----------
    system : Inclination
    mu : float
    most : float
        Largest |lambda| that does.
    """

    system: Inclination
    mu: float
    most: float

    def mode(self, theta: float, value: complex) -> GrowingMode:
        """The mode of an eigenvalue."""
        half = 0.5 * (self.system.d1 + self.system.d2 * value)
        root = complex(np.sqrt(complex(half * half - value)))
        return GrowingMode(theta, value, max(-half + root, -half - root, key=lambda phi: phi.imag))

    def function(self, theta: float, value: complex) -> tuple[complex, complex, complex]:
        """The value of f and its derivatives with respect to lambda and to theta in degrees."""
        f, rate, turn = self.system.receptance(value, np.radians(theta)).loaded(self.mu)
        return f, rate, np.radians(1.0) * turn

    def growth_slope(self, mode: GrowingMode) -> float:
        """How the growth rate changes with theta, per degree."""
        _, rate, turn = self.function(mode.theta, mode.value)
        d1, d2 = self.system.d1, self.system.d2
        by_value = -(1.0 + d2 * mode.phi) / (2.0 * mode.phi + d1 + d2 * mode.value)
        return float((-by_value * turn / rate).real)

    def step(self, mode: GrowingMode, theta: float, *, leaving: bool = False) -> GrowingMode | None:
        """The same mode at another angle; none if that is too far.

        From an onset (`leaving`) two modes lead away, and the one that grows is meant.
        """
        _, rate, turn = self.function(mode.theta, mode.value)
        nudge = 1e-6 * mode.value
        bend = (self.function(mode.theta, mode.value + nudge)[1] - rate) / nudge
        root = complex(np.sqrt(rate * rate - 2.0 * bend * turn * (theta - mode.theta)))
        if abs(root - rate) > abs(root + rate):
            root = -root
        # The small solution of the quadratic without cancellation, and the large one.
        ways = [-2.0 * turn * (theta - mode.theta) / (rate + root), -(rate + root) / bend]
        guess = mode.value + ways[0]
        if leaving and abs(ways[1]) < ALIKE * abs(ways[0]):
            guess = max((mode.value + way for way in ways), key=lambda value: self.mode(theta, value).phi.real)
        value = self._solve(theta, guess)
        if value is None or abs(value - mode.value) > REACH * abs(mode.value):
            return None
        sure = abs(value - guess) <= CORRECTION * abs(guess - mode.value) + ROUNDING * abs(value)
        return self.mode(theta, value) if sure else None

    def path(self, start: GrowingMode, theta: float) -> list[GrowingMode]:
        """The mode from its own angle to `theta`, or to where it leaves the band or ceases to oscillate.

        Raises
        ------
        ArithmeticError
            If it cannot be followed.
        """
        modes, step = [start], theta - start.theta
        while modes[-1].theta != theta:
            here = modes[-1]
            rest = theta - here.theta
            step = float(np.copysign(min(abs(step), LONGEST), rest))
            there = self.step(here, theta if abs(step) >= abs(rest) else here.theta + step)
            if there is not None and self._belongs(there):
                modes.append(there)
                step *= 2.0
            elif abs(step) > SHORTEST:
                step *= 0.5
            elif there is None and here.phi.imag > 1e-3 * abs(here.phi):
                raise ArithmeticError(f"mu = {self.mu:g}: a growing mode is lost at theta = {here.theta:.9g}")
            else:
                break
        return modes

    def _belongs(self, mode: GrowingMode) -> bool:
        return mode.oscillates and mode.phi.imag <= 1.0 and abs(mode.value) <= self.most

    def _solve(self, theta: float, value: complex) -> complex | None:
        last = np.inf
        for _ in range(MOST_NEWTON):
            f, rate, _ = self.function(theta, value)
            move = f / rate
            value -= move
            if abs(move) < SHORT * abs(value) and abs(move) >= STALLED * last:
                return value
            last = abs(move)
        return None
