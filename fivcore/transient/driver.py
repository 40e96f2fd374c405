"""Loop over segments that all methods share, stopping rule, and the result of a run.

`advance()` of a method takes a run to the end of its next segment and stores samples, rows and long sticks in
`run.segments`. The driver passes them to a `Record` and an `Observer`, which never change a run, and builds the
summary at the end.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.errors import DivergenceError, SceneError
from fivcore.friction import COULOMB
from fivcore.jit import Array
from fivcore.rig import Rig, Scene, html_table
from fivcore.transient import observe
from fivcore.transient.exact import ExactRun
from fivcore.transient.fast.layout import MAX_SKIP
from fivcore.transient.fast.run import FastRun
from fivcore.transient.fast.several import SeveralRun
from fivcore.transient.fast.steady import NEARLY_STEADY
from fivcore.transient.normalised import Normalised, State, energies, loading_time
from fivcore.transient.observe import PEAK_BAND, Observer, Record, degrees_of_freedom, errors_of_means
from fivcore.transient.options import RunOptions, Until
from fivcore.transient.published import PaperRun
from fivcore.transient.stepped import Run
from fivcore.transient.summary import SLIP_DRIVE, STEADY_SPREAD, summarise

# The last one applies to "fast" with several contacts.
METHODS: dict[str, Any] = {"fast": FastRun, "exact": ExactRun, "paper": PaperRun, "several": SeveralRun}
# Each check is later than the last by this factor of the time since settling.
LATER = 1.25


@dataclass(frozen=True, eq=False)
class Transient:
    """Motion of one scene.

    Attributes
    ----------
    scene : Scene
    summary : dict
        The results listed in `fivcore.transient.summary.summarise`, and if `duration` is an `Until`,
        `standard_error_reached`, which is False if `most` ended the run.
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
    contact_normal_force, contact_tangential_force, contact_slip_velocity, contact_state : ndarray, (n, c)
        Series of each of several contacts. `normal_force` and `tangential_force` are then sums, `slip_velocity` is
        that of the fastest contact, and `state` is separation if no contact is closed, slip if one slips,
        otherwise stick.
    final_state : State
        State at the end, for `initial` of `fivcore.simulate`; for V < 0 that of the mirrored scene.
    """

    scene: Scene
    summary: dict[str, Any]
    time: Array = field(default_factory=lambda: np.zeros(0))
    velocity_B: Array = field(default_factory=lambda: np.zeros(0))
    normal_force: Array = field(default_factory=lambda: np.zeros(0))
    tangential_force: Array = field(default_factory=lambda: np.zeros(0))
    slip_velocity: Array = field(default_factory=lambda: np.zeros(0))
    state: NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, dtype=np.int8))
    contact_normal_force: Array = field(default_factory=lambda: np.zeros((0, 0)))
    contact_tangential_force: Array = field(default_factory=lambda: np.zeros((0, 0)))
    contact_slip_velocity: Array = field(default_factory=lambda: np.zeros((0, 0)))
    contact_state: NDArray[np.int8] = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int8))
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
    """Format a value of a summary."""
    return f"{len(value)} values" if np.ndim(value) else value if isinstance(value, str) else f"{value:.5g}"


class StoppingRule:
    """Stopping rule of a run; `satisfied` tells whether its shares were certain enough at the last check."""

    def __init__(self, run: Run, until: Until) -> None:
        self._run, self._until, self.satisfied = run, until, False
        self._loading_time = loading_time(run.scene)
        self._stuck = SLIP_DRIVE * self._loading_time + (0.5 * run.options.ramp if run.begun == 0.0 else 0.0)
        self._plan()

    def _plan(self) -> None:
        """Set the next check of the run, where samples and segments end together."""
        run, record, grid = self._run, self._run.record, MAX_SKIP / self._run.rate
        start, time = run.begun, max(self._until.least, self._stuck, grid)
        if not np.isnan(record["first_slip"][0]):
            start = float(record["settled_from"][0])
            time = max(self._until.least / LATER, observe.LOADING_TIMES * self._loading_time, grid / LATER)
        while start + time <= run.time + 0.5 * grid:
            time *= LATER
        run.pause = min(round(np.ceil((start + time) / grid) * grid / run.step), run.steps)

    def check(self, observer: Observer) -> None:
        """At a pause, end the run or continue it."""
        run = self._run
        if run.time < (run.pause - 0.5) * run.step:
            return
        before, self.satisfied = self.satisfied, observer.repeated > 0 or self._is_known(observer)
        moves = not np.isnan(run.record["first_slip"][0])
        if self.satisfied and (before or not moves):
            run.steps = run.pause
        elif run.pause < run.steps:
            self._plan()

    def _is_known(self, observer: Observer) -> bool:
        run = self._run
        if np.isnan(run.record["first_slip"][0]):
            return bool(run.time - run.begun >= self._stuck)
        unit = run.scene.rig.time_scale
        observed = run.time - float(run.record["settled_from"][0])
        errors = errors_of_means(observer.shares(), degrees_of_freedom(observed / unit, self._loading_time / unit))
        if errors.any():
            return bool(np.all(errors <= self._until.standard_error))
        # Pure slip: as long as permanent sliding may still be proved, a vibration may be growing slowly.
        spread = observer.spread(run.begun + 0.75 * (run.time - run.begun)) / run.scene.speed_per_load
        return bool(spread < (NEARLY_STEADY if run.may_settle else STEADY_SPREAD))


class ObservedRun:
    """A run in progress and its observers."""

    def __init__(self, scene: Scene, normalised: Normalised, options: RunOptions) -> None:
        self._scene, resumed, before = scene, options.resumed, options.last_row
        made = METHODS["several" if scene.rig.several else options.method]
        self.run: Run = resumed.resumed(options) if resumed else made(normalised, options)
        # The result does not refer to the previous run, which would refer to the one before it.
        self.run.options = replace(options, resumed=None, last_row=None)
        (low, high), unit, begun = PEAK_BAND, scene.rig.time_scale, self.run.begun
        end, times = self.run.steps * self.run.step, options.sample_times
        self._observer = Observer(self.run.rate, int((end - begun) * self.run.rate) + 2, (low / unit, high / unit))
        self._rate = options.rows(self.run.step)[1]
        if self._rate:
            times = np.arange(*(np.ceil(t * self._rate * (1.0 - 1e-12)) for t in (begun, end))) / self._rate
        if before is not None:
            # The previous step, if recorded.
            before = before[before[:, 0] > begun - 1.1 * self.run.step]
        self._series = Record(normalised, options.record, times, before)
        # Long sticks that ended.
        self._sticks = np.empty((0, 2))
        self._rule = None if options.until is None else StoppingRule(self.run, options.until)
        self._given = abs(self.run.stored_energy()) + sum(energies(normalised))

    def observe(self) -> None:
        """Pass the new segments to the observers; raise `DivergenceError` if the motion has diverged."""
        run, observer = self.run, self._observer
        for segment in run.segments:
            self._series.add(segment.rows)
            self._sticks = np.concatenate([self._sticks, segment.sticks])
            observer.add(segment.t, segment.samples, float(run.record["settled_from"][0]))
            if segment.repeated:
                observer.repeat(segment.t[-1], segment.samples[-1], segment.repeated)
        if self._rule is not None:
            self._rule.check(observer)
        # The energy may not exceed a thousand times the energy supplied.
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
        series = self._series.whole(self.run.steps * self.run.step if self._rate else np.inf)
        state = State.end_of(Normalised.of(self._scene), self.run, self._series.last)
        return Transient(self._scene, summary, **series, final_state=state)


def located(error: SceneError, scene: Scene) -> SceneError:
    """Add the scene to an error."""
    text = f"V = {scene.V:g} m/s, theta = {scene.theta:g} degrees, mu = {scene.mu:g}, F = {scene.F:g} N"
    text += "" if scene.friction == COULOMB else f", friction = {scene.friction}"
    text += "" if scene.rig == Rig() else f", rig = {scene.rig}"
    return type(error)(f"{error}; scene {text}", scene).with_traceback(error.__traceback__)


def drive(scene: Scene, normalised: Normalised, options: RunOptions) -> Transient | SceneError:
    """Run a scene from start to end; return its result or the error that ended it."""
    try:
        job = ObservedRun(scene, normalised, options)
        while not job.run.done:
            job.run.advance()
            job.observe()
        return job.result()
    except SceneError as error:
        return located(error, scene)
