"""Base class of all runs: step grid and record; for "exact" and "paper" also the buffers of a segment."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy, deepcopy
from typing import Any

import numpy as np

from fivcore.contact.reduced import INTERVAL, ReducedModel
from fivcore.jit import Array
from fivcore.transient.normalised import Normalised
from fivcore.transient.options import RunOptions
from fivcore.transient.statistics import SAMPLE, Segment, count_in, first_counted, room_for_sticks


def duplicate(run: Any) -> Any:
    """A copy of a run with its own arrays, which continues identically."""
    other = copy(run)
    own = {name: deepcopy(part) for name, part in vars(run).items() if isinstance(part, (np.ndarray, tuple))}
    vars(other).update(own)
    return other


class Run:
    """One run in progress, normalised (F = 1), with `step`, s, start time `begun`, s, and sampling `rate`, Hz.

    The run ends after `steps` steps; the next segment does not pass step `pause`. Each method provides `model`
    (the one in use), `stored_energy()` of modes, springs and load, `state()`, and `flush(floor)`, which sets
    values below a floor to zero and returns whether all are finite. A segment of "exact" or "paper" has `length`
    steps and does not pass step `_cut`; `_take(first, last, samples, rows, sticks)` takes the steps and fills the
    buffers, whose values refer to the fraction `READ_AT` of a step.
    """

    READ_AT = 1.0
    # Whether steady sliding may still be proved.
    may_settle, begun = False, 0.0
    _cut, _first_energy, row_size = -1, 0.0, 6
    model: ReducedModel
    _take: Any
    stored_energy: Any
    flush: Any
    state: Any

    def resumed(self, options: RunOptions) -> Any:
        """Return a run that continues this one after its end."""
        run = duplicate(self)
        run.options, run.begun = options, run.time
        run.pause = run.steps = run.now + max(round(options.duration / run.step), 1)
        options.record_of(run.scene, None, run.record, run.begun)
        run.record["row_every"] = options.rows(run.step)[0]
        if "settle" in run.record.dtype.names:
            run.record["settle"] = first_counted(run.record["settled_from"][0], run.step, run.READ_AT)
        run._first_energy = run.stored_energy()
        return run

    def __init__(self, scene: Normalised, options: RunOptions, step: float, length: float, fields: Any) -> None:
        self.scene, self.options, self.step = scene, options, step
        # The run stops at step `pause`, which may be moved.
        self.pause = self.steps = max(round(options.duration / step), 1)
        self._length = max(int(length), 1)
        every = max(round(INTERVAL * scene.rig.time_scale / step), 1)
        self.rate = 1.0 / (every * step)
        self.segments: Iterable[Segment] = []
        self.record = options.record_of(scene, fields)
        self.record["contact"] = options.contact
        self.record["sample_every"] = every
        self.record["row_every"] = options.rows(step)[0]

    @property
    def models(self) -> list[tuple[float | None, ReducedModel]]:
        """All models of the run, each with its requested cut-off."""
        return [(self.options.cutoff, self.model)]

    @property
    def growing(self) -> Array:
        """Frequencies of growing motions about steady sliding, Hz; empty where none are sought."""
        return np.zeros(0)

    @property
    def now(self) -> int:
        """Steps of the run that have been taken."""
        return int(self.record["now"][0])

    @property
    def done(self) -> bool:
        """Whether the run has come to its end."""
        return self.now >= self.steps

    @property
    def time(self) -> float:
        """Time up to which the run has come, s."""
        return self.now * self.step

    def advance(self) -> None:
        """Advance to the end of the next segment and store its samples, rows and sticks in `segments`."""
        record, step, now = self.record, self.step, self.now
        last = min(now + self._length, self.pause, self._cut if now < self._cut else self.steps)
        every = int(record["sample_every"][0])
        samples = np.empty((count_in(now, last, every), SAMPLE))
        rows = np.empty((count_in(now, last, int(record["row_every"][0])), self.row_size))
        # A step of "exact" may hold more than one event.
        room = room_for_sticks(now * step, last * step, float(record["least_stick"][0]), min(step, 1e-7))
        sticks = np.empty((room, 2))
        record["samples"] = record["rows"] = record["sticks"] = 0
        record["stick_room"] = room
        self._take(now, last, samples, rows, sticks)
        record["now"] = last
        t = np.asarray((np.arange(-(-now // every), -(-last // every)) * every + self.READ_AT) * step)
        self.segments = [Segment(t, samples, sticks[: int(record["sticks"][0])].copy(), rows)]

    def released_energy(self) -> float:
        """Decrease of the stored energy since the start, normalised."""
        return float(self._first_energy - self.stored_energy())
