"""The only loop over segments: runs of any method, what is observed of them, and their results.

A method has `advance(runs)`, which takes each run to the end of its next segment and leaves in `run.segments` what
was sampled, recorded and listed there. The driver shows the segments to the observers (record, spectra, quantiles)
and makes the summary at the end. Observers see a run and never change it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.errors import ContactError, DivergenceError
from fivcore.jit import Array
from fivcore.rig import Rig, Scene
from fivcore.transient.exact import ExactRun
from fivcore.transient.fast import FastRun
from fivcore.transient.normalised import Normalised
from fivcore.transient.options import Options
from fivcore.transient.published import PaperRun
from fivcore.transient.record import Record
from fivcore.transient.segment import Segment
from fivcore.transient.spectra import Monitor
from fivcore.transient.summary import Outcome, summarise

# Runs that are under way at once: their segments and records are in memory together.
AT_ONCE = 32
# A run has diverged when its energy is that many times what it was given.
DIVERGED = 1e3
METHODS: dict[str, Any] = {"fast": FastRun, "exact": ExactRun, "paper": PaperRun}


@dataclass(frozen=True, eq=False)
class Transient:
    """Motion of one scene.

    Attributes
    ----------
    scene : Scene
    summary : dict
        The figures listed in `fivcore.transient.summary.summarise`.
    time : ndarray, (n,)
        s since the drive started; this and the following only as far as they were recorded.
    velocity_B : ndarray, (n,)
        Velocity of B along x, m/s.
    normal_force, tangential_force : ndarray, (n,)
        Contact force on P1, N.
    slip_velocity : ndarray, (n,)
        Velocity along x of P1's surface relative to P2's, m/s.
    state : ndarray of int8, (n,)
        0 separation, 1 stick, 2 slip.
    """

    scene: Scene
    summary: dict[str, Any]
    time: Array = field(default_factory=lambda: np.zeros(0))
    velocity_B: Array = field(default_factory=lambda: np.zeros(0))
    normal_force: Array = field(default_factory=lambda: np.zeros(0))
    tangential_force: Array = field(default_factory=lambda: np.zeros(0))
    slip_velocity: Array = field(default_factory=lambda: np.zeros(0))
    state: NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, dtype=np.int8))


class Job:
    """One scene under way: its run and its observers."""

    def __init__(self, scene: Scene, normalised: Normalised, options: Options) -> None:
        self.scene, self.normalised, self.options = scene, normalised, options
        self.run = METHODS[options.method](normalised, options)
        self._monitor = Monitor(self.run.rate)
        self._record = Record(normalised, options.record, options.sample_times)
        self._sticks = [np.empty((0, 2))]
        self._late = np.full(2, np.nan)
        self._ended_early = False
        model, speed = self.run.model, normalised.speed_per_load
        self._floor = 1e-150 * min(speed, 1.0)
        self._given = abs(self.run.stored_energy()) + float(np.sum(model.stiffness * model.rest**2))
        self._given += speed**2 * float(np.sum(model.inertia**2))

    def observe(self) -> None:
        """Show the observers what the run has left behind.

        Raises
        ------
        DivergenceError
            If the motion has left the range of numbers.
        """
        for segment in self.run.segments:
            self._record.add(segment.rows)
            self._see(segment)
        work = abs(float(self.run.record["work"][0]))
        if not self.run.calm(self._floor) or not self.run.stored_energy() <= DIVERGED * (self._given + work):
            now = segment.t[-1] if len(segment.t) else 0.0
            raise DivergenceError(f"the motion has blown up at t = {now:.6g} s")

    def _see(self, segment: Segment) -> None:
        self._sticks.append(segment.sticks)
        if not len(segment.t):
            return
        record, monitor = self.run.record, self._monitor
        monitor.add(
            segment.t, segment.velocity, segment.force, segment.slip_rate, float(record["settled_from"][0])
        )
        monitor.process(*self._long_sticks())
        if segment.further:
            self._ended_early = True
            velocity, slip_rate, force = segment.samples[-1].tolist()
            monitor.repeat(float(segment.t[-1]), velocity, force, slip_rate, segment.further)
        start = 0.75 * self.options.duration - segment.further / self.run.rate
        late = segment.slip_rate[np.searchsorted(segment.t, start) :]
        if len(late):
            self._late = np.array([np.fmin(self._late[0], late.min()), np.fmax(self._late[1], late.max())])

    def _long_sticks(self) -> tuple[Array, float]:
        """Long sticks, a running one included, and from when on it is not known yet."""
        record, ended = self.run.record[0], np.concatenate(self._sticks)
        self._sticks = [ended]
        if np.isnan(record["first_slip"]):
            return np.array([[0.0, np.inf]]), np.inf
        begun = float(record["stick_start"])
        if not begun >= 0.0:
            return ended, np.inf
        if self.run.time - begun >= record["least_stick"]:
            return np.vstack([ended, [begun, np.inf]]), np.inf
        return ended, begun

    def result(self) -> Transient:
        """The motion, in the scene's own units."""
        run, options = self.run, self.options
        self._monitor.close(self._long_sticks()[0])
        steadiness = float(0.5 * (self._late[1] - self._late[0]) / self.normalised.speed_per_load)
        outcome = Outcome(
            run.steps * run.step, options.ramp, np.concatenate(self._sticks), steadiness, run.released_energy(),
            self._ended_early,
        )  # fmt: skip
        return Transient(
            self.scene, summarise(self.normalised, run.record[0], self._monitor, outcome), **self._record.whole()
        )


def drive(
    asked: Sequence[tuple[Scene, Normalised, Options]],
) -> list[Transient | ContactError | DivergenceError | ValueError]:
    """Take runs of one method from their start to their end; what each comes to, or the error it ends with."""
    results: list[Any] = [None] * len(asked)
    waiting = deque(range(len(asked)))
    jobs: dict[int, Job] = {}
    while waiting or jobs:
        while waiting and len(jobs) < AT_ONCE:
            k = waiting.popleft()
            try:
                jobs[k] = Job(*asked[k])
            except (ContactError, DivergenceError, ValueError) as error:
                results[k] = _of(error, asked[k][0])
        if jobs:
            runs = [job.run for job in jobs.values()]
            type(runs[0]).advance(runs)
        for k, job in list(jobs.items()):
            try:
                job.observe()
                if not job.run.done:
                    continue
                results[k] = job.result()
            except (ContactError, DivergenceError) as error:
                results[k] = _of(error, job.scene)
            del jobs[k]
    return results


def _of(error: Exception, scene: Scene) -> Exception:
    """The error with the scene it belongs to, and the traceback of where it was raised."""
    if isinstance(error, (ContactError, DivergenceError)):
        return type(error)(f"{error}; {_named(scene)}", scene).with_traceback(error.__traceback__)
    return error


def _named(scene: Scene) -> str:
    """A scene in one line; its rig only where it is not the paper's."""
    rig = "" if scene.rig == Rig() else f", rig = {scene.rig}"
    return f"scene V = {scene.V:g} m/s, theta = {scene.theta:g} degrees, mu = {scene.mu:g}, F = {scene.F:g} N{rig}"
