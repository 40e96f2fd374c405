"""Limit cycles of a scene: search by multiple shooting, and the properties of a cycle."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.beams.modes import one_blas_thread
from fivcore.cycles import guesses, shooting
from fivcore.cycles.flow import Flow, Segment
from fivcore.cycles.shooting import Linear
from fivcore.errors import InputError, SceneError, UnsolvedError
from fivcore.jit import Array, Complex
from fivcore.rig import Scene, one_contact
from fivcore.transient.driver import located
from fivcore.transient.exact_kernels import SLIP_RATE, N, T
from fivcore.transient.normalised import State
from fivcore.transient.options import Options, options_of
from fivcore.transient.simulate import request
from fivcore.transient.statistics import SLIP

STATUSES = ("separation", "stick", "slip")
# Negative margin, relative to its largest value, that counts as rounding; most changes of the sequence of
# statuses.
ROUNDING, REPAIRS = 1e-7, 8


@dataclass(frozen=True, eq=False)
class LimitCycle:
    """A periodic motion of a scene.

    Attributes
    ----------
    scene : Scene
    residual : float
        Closure error of the motion, relative to its size.
    flow, segments, plane, monodromy
        Equations of motion, statuses with their initial states, Poincare plane if there are no events, and
        derivative of the return map (`fivcore.cycles.flow`, `fivcore.cycles.shooting`).
    """

    scene: Scene
    residual: float
    flow: Flow
    segments: list[Segment]
    plane: Array
    monodromy: Array

    @property
    def period(self) -> float:
        """Period, s."""
        return float(sum(each.time for each in self.segments))

    @property
    def frequency(self) -> float:
        """Frequency, Hz."""
        return 1.0 / self.period

    @cached_property
    def multipliers(self) -> Complex:
        """Floquet multipliers, (m,), in descending magnitude; the trivial one, 1, is replaced by 0."""
        found = np.linalg.eigvals(self.monodromy).astype(complex)
        return np.asarray(found[np.argsort(-np.abs(found), kind="stable")])

    @property
    def stable(self) -> bool:
        """Whether every small deviation decays."""
        return bool(np.abs(self.multipliers[0]) < 1.0)

    @property
    def states(self) -> list[tuple[str, float]]:
        """Contact statuses in sequence, each with its duration, s."""
        return [(STATUSES[min(each.status, SLIP)], each.time) for each in self.segments]

    @cached_property
    def _series(self) -> Array:
        """Time, velocity of B, N, T, slip rate and state, (6, n), in the scene's units."""
        scene, parts, begun = self.flow.scene, [], 0.0
        for each in self.segments:
            times, z = self.flow.samples(each.status, each.start, each.time)
            laws = np.transpose([self.flow.law(each.status, one)[[N, T, SLIP_RATE]] @ one for one in z.T])
            rows = [self.flow.velocity_B @ z, *laws]
            parts.append(np.vstack([begun + times, *rows, np.full(len(times), min(each.status, SLIP))]))
            begun += each.time
        series = np.hstack(parts)
        series[1:5] *= scene.load * np.array([scene.sense, 1.0, scene.sense, scene.sense])[:, None]
        return series

    @property
    def time(self) -> Array:
        """Times of the series over one period, (n,), s; the time of each status change occurs twice."""
        return self._series[0]

    @property
    def velocity_B(self) -> Array:
        """Velocity of B along x, (n,), m/s."""
        return self._series[1]

    @property
    def normal_force(self) -> Array:
        """N, (n,), N."""
        return self._series[2]

    @property
    def tangential_force(self) -> Array:
        """T, (n,), N."""
        return self._series[3]

    @property
    def slip_velocity(self) -> Array:
        """Velocity of P1's surface relative to P2's along x, (n,), m/s."""
        return self._series[4]

    @property
    def state(self) -> NDArray[np.int8]:
        """0 separation, 1 stick, 2 slip, (n,)."""
        return self._series[5].astype(np.int8)

    @cached_property
    def summary(self) -> dict[str, float]:
        """Results named as in the summary of a `Transient`, and half the range of the velocity of B."""
        time, v, normal, _, slip, _ = self._series
        mean = np.trapezoid(v, time) / self.period
        shares = {
            f"{name}_fraction": sum(s.time for s in self.segments if min(s.status, SLIP) == k) / self.period
            for k, name in enumerate(STATUSES)
        }
        return shares | {
            "frequency": self.frequency,
            "velocity_rms": float(np.sqrt(np.trapezoid((v - mean) ** 2, time) / self.period)),
            "velocity_amplitude": 0.5 * float(np.ptp(v)),
            "mean_normal_force": float(np.trapezoid(normal, time) / self.period),
            "max_normal_force": float(normal.max()),
            "max_slip_speed": float(np.abs(slip).max()),
            "largest_multiplier": float(np.abs(self.multipliers[0])),
        }

    @property
    def final_state(self) -> State:
        """State at the start and end of the period, for `initial` of `simulate`."""
        return self.flow.state(self.segments[0].status, self.segments[0].start)


# Newton's method may overflow from a poor guess.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
@one_blas_thread()
def limit_cycle(scene: Scene, guess: Any = None, *, options: Options | None = None, **keywords: Any) -> LimitCycle:
    """Find a limit cycle of a scene, stable or not, of the reduced model of `simulate`.

    The search has no time step. Runs by "exact" stay on the cycle, and runs by "fast" converge to it with the
    step.

    Parameters
    ----------
    scene : Scene
    guess : LimitCycle, State, (State, State) or float, optional
        - `LimitCycle`: cycle of a neighbouring scene, whose options are used unless others are given.
        - `State`: a state near the cycle.
        - Two states, of which one leads to vibration and the other to sliding: bisection finds the cycle between.
        - float: amplitude, m/s, of the velocity of B in the fastest growing mode of steady sliding.
        - Default: the windows of a run that recur best.
    options, **keywords
        As for `simulate`, and `duration`, s, of a run that a guess needs (default: 0.5 s, for a structure times
        `time_scale`).

    Returns
    -------
    LimitCycle

    Raises
    ------
    ValueError, ContactError, DivergenceError
        As `fivcore.simulate`.
    UnsolvedError
        If no motion near the guess recurs, or if Newton's method does not converge; its subclass
        `NoVibrationError` if the run that gives a guess ends stuck or in steady sliding.
    """
    duration = keywords.pop("duration", 0.5 * scene.rig.time_scale)
    if isinstance(guess, LimitCycle) and options is None and not keywords:
        options = guess.flow.options
    given = options_of(options, keywords)
    if given.method != "fast":
        raise InputError(f"method = {given.method!r}: a limit cycle is that of the reduced model; leave it out")
    one_contact(scene.rig, "a limit cycle is followed from one contact's event to the next")
    try:
        flow = flow_of(scene, given)
        if isinstance(guess, LimitCycle):
            return closed(scene, flow, [(guess.segments, guess.plane)])
        return closed(scene, flow, guesses.guesses_of(scene, flow, guess, given, duration))
    except SceneError as error:
        raise located(error, scene) from None


def flow_of(scene: Scene, options: Options, like: Flow | None = None) -> Flow:
    """The flow of a scene with options of `simulate`."""
    return Flow(request(scene, 1.0, replace(options, initial=None))[1], options, like)


def closed(scene: Scene, flow: Flow, tries: Iterable[guesses.Guess]) -> LimitCycle:
    """The first cycle found from the guesses whose statuses satisfy their margins."""
    first: list[Segment] = []
    count = -1
    for segments, plane in tries:
        first, count = first or segments, count + 1
        for attempt in range(REPAIRS):
            if solved := shooting.solve(flow, segments, plane):
                cycle = made(scene, flow, *solved, plane)
                segments = shooting.primitive(cycle.segments)
                if len(segments) < len(cycle.segments):
                    continue
                if violation(cycle) is None:
                    return cycle
            elif attempt:
                break
            longest, period = max(segments, key=lambda each: each.time), sum(each.time for each in segments)
            try:
                segments, plane = guesses.recurrent(flow, longest.status, longest.start, about=period)[0]
            except UnsolvedError:
                break
    text = f"limit_cycle: Newton's method did not converge from {described(first)}"
    raise UnsolvedError(f"{text}, nor from {count} other guesses; give another")


def made(scene: Scene, flow: Flow, segments: list[Segment], linear: Linear, plane: Array) -> LimitCycle:
    """A cycle of closed segments."""
    return LimitCycle(scene, linear.residual, flow, segments, plane, linear.monodromy)


def described(segments: list[Segment]) -> str:
    """Statuses and durations of segments."""
    parts = [f"{STATUSES[min(each.status, SLIP)]} {1e6 * each.time:.4g}" for each in segments]
    return f"{', '.join(parts[:8])}{', ...' if len(parts) > 8 else ''} us"


def violation(cycle: LimitCycle) -> tuple[int, int, float] | None:
    """Segment and index of the most negative margin, and its value relative to its largest; None without one."""
    worst: tuple[int, int, float] | None = None
    for i, each in enumerate(cycle.segments):
        if each.time <= 0.0:
            return i, each.event, each.time / cycle.period
        for k, least in enumerate(least_margins(cycle.flow, each)):
            if least < -ROUNDING and (worst is None or least < worst[2]):
                worst = i, k, least
    return worst


def least_margins(flow: Flow, segment: Segment) -> list[float]:
    """Smallest value of each margin within a segment, by parabolas between samples, relative to its largest."""
    _, z = flow.samples(segment.status, segment.start, segment.time)
    values = flow.along(segment.status, z)
    return [float(row.min() / max(np.abs(row).max(), 1e-300)) for row in values]
