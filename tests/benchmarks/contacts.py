"""What several contacts cost beside one: two beams that lie on each other, and the rig on a rigid foot."""

from __future__ import annotations

import statistics
import time
from typing import Any

from fivcore import Options, Rig, Scene, Structure, checked_run, flutter_onsets, on_foot
from fivcore.transient.fast.run import FastRun
from fivcore.transient.fast.several import SeveralRun
from tests.benchmarks.stability import median
from tests.benchmarks.tables import Column, Table
from tests.helpers.several import two_beams

# Contacts and friction: steady sliding, or chatter of several contacts.
LINES = ((1, 0.4), (2, 0.4), (5, 0.4), (5, 1.2), (10, 0.4), (10, 1.2), (20, 0.4))
CUTOFF, ROUNDS = 94e3, 25


def started(own: Structure, mu: float) -> Any:
    """A run of `fast` that is compiled and begun."""
    _, scene, options = checked_run(Scene(2e-3, 0.0, mu, 9.0, own), 1.0, Options(cutoff=CUTOFF))
    run = (SeveralRun if own.several else FastRun)(scene, options)
    run.advance()
    return run


def step(run: Any) -> float:
    """Seconds a step of the next segment of a run."""
    first, start = int(run.record["now"][0]), time.process_time()
    run.advance()
    return (time.process_time() - start) / (int(run.record["now"][0]) - first)


def motion() -> Table:
    """Time a step, in turns, and of a simulated second beside one contact's."""
    runs = [started(two_beams(count, 3), mu) for count, mu in LINES]
    taken = list(zip(*([step(run) for run in runs] for _ in range(ROUNDS)), strict=True))
    steps = [statistics.median(each) for each in taken]
    seconds = [one / run.step for one, run in zip(steps, runs, strict=True)]
    rows = [
        [str(count), mu, one, second / seconds[0]]
        for (count, mu), one, second in zip(LINES, steps, seconds, strict=True)
    ]
    return Table([Column("contacts"), Column("mu"), Column("step", "s"), Column("beside one contact")], rows)


def onsets() -> Table:
    """All onsets of the rig on a foot."""
    feet = [on_foot(Rig(), 5.0, nodes, 15e-3) for nodes in (2, 3, 5)]
    rows = [[str(own.contacts), median(lambda own=own: flutter_onsets(own, 0.0), 3)] for own in feet]
    return Table([Column("contacts"), Column("onsets", "s")], rows)


TABLES = {"motion": motion, "onsets": onsets}
