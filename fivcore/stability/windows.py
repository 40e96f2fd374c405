"""Windows of inclination in which steady sliding is unstable, at one coefficient of friction."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from fivcore import checks
from fivcore.jit import Array
from fivcore.rig import Rig
from fivcore.stability.arcs import OnsetPlane, OnsetPoint
from fivcore.stability.curves import Branch, branches
from fivcore.stability.growing import Follower, GrowingMode
from fivcore.stability.inclination import inclination
from fivcore.stability.problem import MOST_REPORTED, sliding_problem
from fivcore.stability.sliding import sliding_modes

# Angles at which all growing modes and all onsets are known, degrees apart at most.
SPACING = 0.5
# Onsets are followed up to so many times the friction asked for, to see what dips to it between two angles.
HEADROOM = 4.0
# Degrees inside a window's end, where the mode that begins or ends there is told from others.
INSIDE = 1e-7
# Where a mode ceases to oscillate, Im phi falls as the root of the distance in theta: at the last angle known it
# is still about 1e-6 of |phi|.
CEASED = 1e-4
# Two eigenvalues at one angle are the same if they agree to this share.
SAME = 1e-6


@dataclass(frozen=True, eq=False)
class UnstableWindows:
    """Intervals of theta in which a mode pair grows, ascending in frequency, then in theta; arrays are read-only.

    Attributes
    ----------
    theta_from, theta_to : ndarray, (n,)
        Ends, degrees.
    frequency_from, frequency_to : ndarray, (n,)
        Frequency of the growing mode there, Hz. At fmax it goes on growing beyond the band; at 0 it ceases to
        oscillate and diverges.
    open_from, open_to : ndarray of bool, (n,)
        Whether the window goes on beyond what was asked.
    peak_growth_rate, peak_theta, peak_frequency : ndarray, (n,)
        Where the mode grows fastest: 1/s, degrees, Hz.
    """

    theta_from: Array
    theta_to: Array
    frequency_from: Array
    frequency_to: Array
    open_from: NDArray[np.bool_]
    open_to: NDArray[np.bool_]
    peak_growth_rate: Array
    peak_theta: Array
    peak_frequency: Array

    def __post_init__(self) -> None:
        for part in vars(self).values():
            part.setflags(write=False)


@dataclass(eq=False)
class Sight:
    """A growing mode known at an angle of its own; at a window's end, `crossing` is the mode at its onset."""

    mode: GrowingMode
    crossing: GrowingMode | None = None
    used: bool = False

    def ends(self, way: float) -> bool:
        """Whether the window ends here, upwards in theta (`way` = 1) or downwards (-1)."""
        return self.crossing is not None and way * (self.crossing.theta - self.mode.theta) > 0.0

    def is_at(self, mode: GrowingMode) -> bool:
        """Whether a mode is the one that begins or ends here, so close to its onset that it grows by rounding."""
        onset = self.crossing
        if onset is None or abs(mode.theta - onset.theta) > INSIDE:
            return False
        return abs(mode.value - onset.value) <= 1e-3 * abs(onset.value)


def unstable_windows(
    rig: Rig, mu: float, theta_min: float, theta_max: float, fmax: float = 10e3
) -> UnstableWindows:
    """Intervals of theta in which a pair of modes of steady sliding (V > 0) is unstable at one friction.

    A window opens or closes where a branch of onsets or recoveries passes `mu` (`onset_curves`), and besides where
    a growing mode enters or leaves the band, or begins or ceases to oscillate. Each mode is followed from end to
    end, so that windows which overlap are told apart.

    Parameters
    ----------
    rig : Rig
    mu : float
        Coefficient of friction.
    theta_min, theta_max : float
        Degrees.
    fmax : float
        Band, Hz.

    Returns
    -------
    UnstableWindows

    Raises
    ------
    ValueError
        For an argument out of range.
    ArithmeticError
        If onsets cannot be told apart or a mode cannot be followed.

    Notes
    -----
    No mode that grows at one of the angles at which all are known, half a degree apart at most, is missed. Between
    two of them a window is seen if the branch of onsets it belongs to reaches one of them below four times `mu`;
    not, if a mode that grows violently enters the band and leaves it there without an onset. Growth without
    oscillation (divergence) makes no window; `sliding_modes` at the theta in question has it.
    """
    checks.instance("rig", rig, Rig)
    friction = checks.friction(mu)
    first = checks.number("theta_min", theta_min, "an angle between -90 and 90 degrees", lambda x: abs(x) < 90.0)
    last = checks.number(
        "theta_max", theta_max, f"above theta_min = {first:g} and below 90 degrees", lambda x: first < x < 90.0
    )
    band = checks.band(fmax)
    unit = 2.0 * np.pi * band
    most = MOST_REPORTED * sliding_problem(rig, first, band).unit / unit**2
    follower = Follower(inclination(rig, band), friction, most)
    angles = np.linspace(first, last, int(np.ceil((last - first) / SPACING)) + 1)

    sights = _growing(rig, angles, band, follower)
    if friction > 0.0:
        plane = OnsetPlane(follower.system, min(HEADROOM * friction, 1e6))
        found = branches(rig, angles, band, plane.mu_max)
        ends = _ends(follower, [end for branch in found for end in _crossings(plane, branch, friction)])
        sights = [sight for sight in sights if not any(end.is_at(sight.mode) for end in ends)] + ends
    windows = _windows(follower, angles, sights)
    windows.sort(key=lambda modes: (_turning(modes[0]), modes[0].theta))
    begin, end, peak = (
        np.array([(mode.theta, band * _turning(mode), unit * mode.phi.real) for mode in each]).reshape(-1, 3).T
        for each in (
            [modes[0] for modes in windows],
            [modes[-1] for modes in windows],
            [_peak(follower, modes) for modes in windows],
        )
    )
    return UnstableWindows(
        theta_from=begin[0],
        theta_to=end[0],
        frequency_from=begin[1],
        frequency_to=end[1],
        open_from=begin[0] == first,
        open_to=end[0] == last,
        peak_growth_rate=peak[2],
        peak_theta=peak[0],
        peak_frequency=peak[1],
    )


def _growing(rig: Rig, angles: Array, band: float, follower: Follower) -> list[Sight]:
    """Every mode that grows at one of the angles."""
    found = sliding_modes(rig, angles, follower.mu, band)
    growing = found.unstable & (found.frequency > 0.0)
    values = found.eigenvalue / (2.0 * np.pi * band) ** 2
    return [Sight(follower.mode(float(angles[k]), complex(values[k, j]))) for k, j in np.argwhere(growing)]


def _crossings(plane: OnsetPlane, branch: Branch, mu: float) -> list[tuple[OnsetPoint, float]]:
    """Where a branch passes `mu`, and on which side in theta a mode grows: 1 above, -1 below."""
    found = []
    for p, q in pairwise(branch.points):
        ends = [p, q]
        if (p.mu > mu) == (q.mu > mu):
            extreme = plane.stationary(p, q)
            if extreme is None or (extreme.mu > mu) == (p.mu > mu):
                continue
            ends = [p, extreme, q]
        passed = [plane.between(a, b, lambda at: at.mu - mu) for a, b in pairwise(ends)]
        if passed[-1].theta - passed[0].theta > 4.0 * INSIDE or len(passed) == 1:
            sides = [1.0 if (a.mu > mu) == branch.rises else -1.0 for a in ends[:-1]]
            found += list(zip(passed, sides, strict=True))
    return found


def _ends(follower: Follower, crossings: list[tuple[OnsetPoint, float]]) -> list[Sight]:
    """The growing mode just inside each end of a window."""
    sights = []
    for point, side in crossings:
        onset = follower.mode(point.theta, follower.system.on_axis(point.omega)[0])
        inside = follower.step(onset, point.theta + side * INSIDE, leaving=True)
        if inside is None:
            raise ArithmeticError(f"mu = {follower.mu:g}: a growing mode is lost at theta = {point.theta:.9g}")
        sights.append(Sight(inside, onset))
    return sights


def _windows(follower: Follower, angles: Array, sights: list[Sight]) -> list[list[GrowingMode]]:
    """The modes of each window, ascending in theta, from end to end; every sight belongs to one."""
    stops: dict[float, list[Sight]] = {angle: [] for angle in angles.tolist()}
    for sight in sights:
        stops.setdefault(sight.mode.theta, []).append(sight)
    complete = frozenset(angles.tolist())
    windows = []
    for sight in sorted(sights, key=lambda sight: sight.mode.theta):
        if not sight.used:
            sight.used = True
            below, above = (_followed(follower, sight, way, stops, complete) for way in (-1.0, 1.0))
            windows.append(below[:0:-1] + above)
    return windows


def _followed(
    follower: Follower, start: Sight, way: float, stops: dict[float, list[Sight]], complete: frozenset[float]
) -> list[GrowingMode]:
    """A growing mode from a sight to its window's end, upwards in theta (`way` = 1) or downwards (-1)."""
    modes, sight = [start.mode], start
    for theta in sorted(stops, key=lambda stop: way * stop):
        if way * (theta - start.mode.theta) <= 0.0:
            continue
        if sight.ends(way):
            break
        modes += follower.path(modes[-1], theta)[1:]
        here = modes[-1]
        if here.theta != theta:
            return modes
        met = [each for each in stops[theta] if not each.used and _same(each.mode, here)]
        if met:
            sight = met[0]
            sight.used = True
        elif theta in complete:
            raise ArithmeticError(f"mu = {follower.mu:g}: a growing mode is lost at theta = {theta:.9g}")
    return [*modes, sight.crossing] if sight.crossing is not None and sight.ends(way) else modes


def _same(one: GrowingMode, other: GrowingMode) -> bool:
    return abs(one.value - other.value) <= SAME * abs(other.value)


def _turning(mode: GrowingMode) -> float:
    """Frequency in units of the band; 0 where it ceases to oscillate."""
    return mode.phi.imag if mode.phi.imag > CEASED * abs(mode.phi) else 0.0


def _peak(follower: Follower, modes: list[GrowingMode]) -> GrowingMode:
    """Where the mode grows fastest: between the neighbours of the fastest known, if it is stationary there."""
    best = max(range(len(modes)), key=lambda k: modes[k].phi.real)
    for a, b in pairwise(modes[max(best - 1, 0) : best + 2]):
        if follower.growth_slope(a) > 0.0 > follower.growth_slope(b):
            return _stationary(follower, a, b)
    return modes[best]


def _stationary(follower: Follower, a: GrowingMode, b: GrowingMode) -> GrowingMode:
    def at(theta: float) -> GrowingMode:
        return follower.path(a, theta)[-1]

    return at(brentq(lambda theta: follower.growth_slope(at(theta)), a.theta, b.theta, xtol=1e-10))
