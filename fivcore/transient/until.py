"""Runs that end when their shares of time are known well enough."""

from __future__ import annotations

import numpy as np

from fivcore.transient.fast.layout import MAX_SKIP
from fivcore.transient.fast.steady import NEARLY_STEADY
from fivcore.transient.normalised import loading_time
from fivcore.transient.observe import LOADING_TIMES, Observer, degrees_of_freedom, errors_of_means
from fivcore.transient.options import Run, Until
from fivcore.transient.summary import SLIP_DRIVE, STEADY_SPREAD

# Each check is later than the last by this factor of the time since settling.
LATER = 1.25


class StoppingRule:
    """Ends a run in time: `satisfied` says whether its shares were certain enough at the last check."""

    def __init__(self, run: Run, until: Until) -> None:
        self._run, self._until, self.satisfied = run, until, False
        self._loading_time = loading_time(run.scene)
        self._stuck = SLIP_DRIVE * self._loading_time + (0.5 * run.options.ramp if run.begun == 0.0 else 0.0)
        self._plan()

    def _plan(self) -> None:
        """Let the run go on to the next check, where samples and segments end together."""
        run, record, grid = self._run, self._run.record, MAX_SKIP / self._run.rate
        start, time = run.begun, max(self._until.least, self._stuck, grid)
        if not np.isnan(record["first_slip"][0]):
            start = float(record["settled_from"][0])
            time = max(self._until.least / LATER, LOADING_TIMES * self._loading_time, grid / LATER)
        while start + time <= run.time + 0.5 * grid:
            time *= LATER
        run.pause = min(round(np.ceil((start + time) / grid) * grid / run.step), run.steps)

    def check(self, observer: Observer) -> None:
        """Where the run pauses, end it or let it go on."""
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
        # Nothing but slip: where a proof that it lasts can still come, a vibration may grow slowly.
        spread = observer.spread(run.begun + 0.75 * (run.time - run.begun)) / run.scene.speed_per_load
        return bool(spread < (NEARLY_STEADY if run.may_settle else STEADY_SPREAD))
