"""The loop over segments that all methods share, and the result of a run.

A method has `advance(runs)`, which takes each run to the end of its next segment and leaves samples, rows and long
sticks in `run.segments`. The driver hands them to the observers (`Record`, `Monitor`) and makes the summary at the
end. Observers never change a run.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.errors import ContactError, DivergenceError, SceneError
from fivcore.jit import Array
from fivcore.rig import Rig, Scene
from fivcore.transient.exact import ExactRun
from fivcore.transient.fast import FastRun
from fivcore.transient.normalised import Normalised
from fivcore.transient.options import Options
from fivcore.transient.published import PaperRun
from fivcore.transient.record import Record
from fivcore.transient.spectra import Monitor
from fivcore.transient.summary import summarise

# Runs under way at once: their segments and records are in memory together.
AT_ONCE = 32
# A run has diverged when its energy is this many times the energy put in.
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
        s since the drive started; this and the following are empty unless recorded.
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
        self._sticks = np.empty((0, 2))
        # Slip rate in the last quarter of the run, smallest and largest.
        self._late = np.full(2, np.nan)
        self._settled_early = False
        model, speed = self.run.model, normalised.speed_per_load
        self._floor = 1e-150 * min(speed, 1.0)
        self._given = abs(self.run.stored_energy()) + float(np.sum(model.stiffness * model.rest**2))
        self._given += speed**2 * float(np.sum(model.inertia**2))

    def observe(self) -> None:
        """Hand the new segments to the observers; raise `DivergenceError` if the motion has blown up."""
        run, monitor = self.run, self._monitor
        for segment in run.segments:
            self._record.add(segment.rows)
            self._sticks = np.concatenate([self._sticks, segment.sticks])
            if not len(segment.t):
                continue
            velocity, slip_rate, force = segment.samples.T
            monitor.add(segment.t, velocity, force, slip_rate, float(run.record["settled_from"][0]))
            monitor.process(*self._long_sticks())
            if segment.further:
                self._settled_early = True
                monitor.repeat(segment.t[-1], velocity[-1], force[-1], slip_rate[-1], segment.further)
            start = 0.75 * self.options.duration - segment.further / run.rate
            late = slip_rate[np.searchsorted(segment.t, start) :]
            if len(late):
                self._late = np.array([np.fmin(self._late[0], late.min()), np.fmax(self._late[1], late.max())])
        work = abs(float(run.record["work"][0]))
        if not run.calm(self._floor) or not run.stored_energy() <= DIVERGED * (self._given + work):
            now = segment.t[-1] if len(segment.t) else 0.0
            raise DivergenceError(f"the motion has blown up at t = {now:.6g} s")

    def _long_sticks(self) -> tuple[Array, float]:
        """Long sticks, a running one included, and the time from which on they are not known yet."""
        record = self.run.record[0]
        if np.isnan(record["first_slip"]):
            return np.array([[0.0, np.inf]]), np.inf
        begun = float(record["stick_start"])
        if not begun >= 0.0:
            return self._sticks, np.inf
        if self.run.time - begun >= record["least_stick"]:
            return np.vstack([self._sticks, [begun, np.inf]]), np.inf
        return self._sticks, begun

    def result(self) -> Transient:
        """The motion, in the scene's own units."""
        run = self.run
        self._monitor.close(self._long_sticks()[0])
        summary = summarise(
            self.normalised,
            run.record[0],
            self._monitor,
            self._sticks,
            duration=run.steps * run.step,
            ramp=self.options.ramp,
            steadiness=float(0.5 * np.ptp(self._late) / self.normalised.speed_per_load),
            released=run.released_energy(),
            settled_early=self._settled_early,
        )
        return Transient(self.scene, summary, **self._record.whole())


def drive(
    requests: Sequence[tuple[Scene, Normalised, Options]],
) -> list[Transient | ContactError | DivergenceError]:
    """Take runs of one method from start to end; return the result of each, or the error that it ends with."""
    results: list[Any] = [None] * len(requests)
    waiting = deque(range(len(requests)))
    jobs: dict[int, Job] = {}
    # These may raise while they advance: each is advanced by itself, so that the others go on.
    alone = any(options.method != "fast" or options.contact_motion for _, _, options in requests)
    while waiting or jobs:
        while waiting and len(jobs) < AT_ONCE:
            k = waiting.popleft()
            try:
                jobs[k] = Job(*requests[k])
            except SceneError as error:
                results[k] = _located(error, requests[k][0])
        if jobs and not alone:
            FastRun.advance([job.run for job in jobs.values()])
        for k, job in list(jobs.items()):
            try:
                if alone:
                    job.run.advance([job.run])
                job.observe()
                if not job.run.done:
                    continue
                results[k] = job.result()
            except SceneError as error:
                results[k] = _located(error, job.scene)
            del jobs[k]
    return results


def _located(error: SceneError, scene: Scene) -> SceneError:
    """The error with its scene; the rig is named only where it is not the paper's."""
    rig = "" if scene.rig == Rig() else f", rig = {scene.rig}"
    text = f"scene V = {scene.V:g} m/s, theta = {scene.theta:g} degrees, mu = {scene.mu:g}, F = {scene.F:g} N{rig}"
    return type(error)(f"{error}; {text}", scene).with_traceback(error.__traceback__)
