"""The loop over segments that all methods share, and the result of a run.

A method has `advance()`, which takes a run to the end of its next segment and leaves samples, rows and long sticks
in `run.segments`. The driver hands them to a `Record` and an `Observer`, which never change a run, and
makes the summary at the end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.errors import DivergenceError, SceneError
from fivcore.friction import COULOMB
from fivcore.jit import Array
from fivcore.rig import Rig, Scene, html_table
from fivcore.transient.exact import ExactRun
from fivcore.transient.fast.run import FastRun
from fivcore.transient.normalised import Normalised, State, energies
from fivcore.transient.observe import PEAK_BAND, Observer, Record
from fivcore.transient.options import Run, RunOptions
from fivcore.transient.published import PaperRun
from fivcore.transient.summary import summarise
from fivcore.transient.until import StoppingRule

METHODS: dict[str, Callable[[Normalised, RunOptions], Run]] = {
    "fast": FastRun,
    "exact": ExactRun,
    "paper": PaperRun,
}


@dataclass(frozen=True, eq=False)
class Transient:
    """Motion of one scene.

    Attributes
    ----------
    scene : Scene
    summary : dict
        The figures listed in `fivcore.transient.summary.summarise`, and where `duration` is an `Until`,
        `standard_error_reached`: False where `most` ended the run.
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
    final_state : State
        State at the end, which `fivcore.simulate` takes as `initial`; for V < 0 that of the mirrored scene.
    """

    scene: Scene
    summary: dict[str, Any]
    time: Array = field(default_factory=lambda: np.zeros(0))
    velocity_B: Array = field(default_factory=lambda: np.zeros(0))
    normal_force: Array = field(default_factory=lambda: np.zeros(0))
    tangential_force: Array = field(default_factory=lambda: np.zeros(0))
    slip_velocity: Array = field(default_factory=lambda: np.zeros(0))
    state: NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, dtype=np.int8))
    final_state: State | None = None

    @property
    def growing(self) -> Array:
        """Frequencies of the growing modes of steady sliding in the reduced model, (m,), Hz.

        Empty unless the method is "fast" with the default cut-off, and the run starts at rest (no `initial`).
        """
        state = self.final_state
        return np.zeros(0) if state is None or state.origin is None else state.origin[1].growing

    def _repr_html_(self) -> str:
        rows = [(name, _short(value)) for name, value in self.summary.items()]
        return html_table("Transient", ("summary", "value (SI)"), rows) + self.scene._repr_html_()


def _short(value: Any) -> str:
    """A figure of a summary for a reader."""
    return f"{len(value)} values" if np.ndim(value) else value if isinstance(value, str) else f"{value:.5g}"


class ObservedRun:
    """One scene under way: its run and its observers."""

    def __init__(self, scene: Scene, normalised: Normalised, options: RunOptions) -> None:
        self._scene, resumed, before = scene, options.resumed, options.last_row
        self.run = resumed.resumed(options) if resumed else METHODS[options.method](normalised, options)
        # The result does not keep the run that it continues, which would keep the one before.
        self.run.options = replace(options, resumed=None, last_row=None)
        (low, high), unit, begun = PEAK_BAND, scene.rig.time_scale, self.run.begun
        end, times = self.run.steps * self.run.step, options.sample_times
        self._observer = Observer(self.run.rate, int((end - begun) * self.run.rate) + 2, (low / unit, high / unit))
        self._rate = options.rows(self.run.step)[1]
        if self._rate:
            times = np.arange(*(np.ceil(t * self._rate * (1.0 - 1e-12)) for t in (begun, end))) / self._rate
        if before is not None:
            # Of the step before, if that was recorded.
            before = before[before[:, 0] > begun - 1.1 * self.run.step]
        self._series = Record(normalised, options.record, times, before)
        # Long sticks that have ended.
        self._sticks = np.empty((0, 2))
        self._rule = None if options.until is None else StoppingRule(self.run, options.until)
        self._given = abs(self.run.stored_energy()) + sum(energies(normalised))

    def observe(self) -> None:
        """Hand the new segments to the observers; raise `DivergenceError` if the motion has blown up."""
        run, observer = self.run, self._observer
        for segment in run.segments:
            self._series.add(segment.rows)
            self._sticks = np.concatenate([self._sticks, segment.sticks])
            observer.add(segment.t, segment.samples, float(run.record["settled_from"][0]))
            if segment.repeated:
                observer.repeat(segment.t[-1], segment.samples[-1], segment.repeated)
        if self._rule is not None:
            self._rule.check(observer)
        # The bound of the energy is a thousand times what has been put in.
        bound = 1e3 * (self._given + abs(float(run.record["work"][0])))
        if not run.flush(1e-150 * min(run.scene.speed_per_load, 1.0)) or not run.stored_energy() <= bound:
            now = segment.t[-1] if len(segment.t) else 0.0
            raise DivergenceError(f"the motion has blown up at t = {now:.6g} s")

    def result(self) -> Transient:
        """The motion, in the scene's own units."""
        summary = summarise(self.run, self._observer, self._sticks)
        if self._rule is not None:
            summary["standard_error_reached"] = self._rule.satisfied
        self.run.segments = ()
        return Transient(
            self._scene,
            summary,
            **self._series.whole(self.run.steps * self.run.step if self._rate else np.inf),
            final_state=State.end_of(Normalised.of(self._scene), self.run, self._series.last),
        )


def located(error: SceneError, scene: Scene) -> SceneError:
    """The error with the scene that it belongs to."""
    text = f"V = {scene.V:g} m/s, theta = {scene.theta:g} degrees, mu = {scene.mu:g}, F = {scene.F:g} N"
    text += "" if scene.friction == COULOMB else f", friction = {scene.friction}"
    text += "" if scene.rig == Rig() else f", rig = {scene.rig}"
    return type(error)(f"{error}; scene {text}", scene).with_traceback(error.__traceback__)


def drive(scene: Scene, normalised: Normalised, options: RunOptions) -> Transient | SceneError:
    """Take a run from start to end; return its result, or the error that it ends with."""
    try:
        job = ObservedRun(scene, normalised, options)
        while not job.run.done:
            job.run.advance()
            job.observe()
        return job.result()
    except SceneError as error:
        return located(error, scene)
