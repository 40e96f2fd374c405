"""What is gathered of a run before it is judged: records, a replay, copies and cost."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import Transient
from fivcore.transient.exact import states_at
from fivcore.transient.normalised import Normalised, State
from studies.stress.case import POINT, Case
from studies.stress.questions import Question
from studies.stress.replay import Replay, replayed

Array = NDArray[np.float64]

# Rows of a record of every step; what is longer is recorded from its beginning.
MOST_ROWS = 2_000_000
# From this duration on the mean of N is looked at, over blocks of this number, s.
LONG, BLOCKS = 1.0, 40
# Instants at which the states of "exact" are compared with its forces.
INSTANTS = 2000
# Steps over which the cost of "fast" is measured: enough to be told from its start, and no more than that.
COST_STEPS = (200_000, 10_000_000)
# A run is timed again unless it takes less than so many times what it should: one slow moment is the machine's.
ATTEMPTS, ENOUGH = 4, 2.0


@dataclass(frozen=True, eq=False)
class Evidence:
    """One run and what was found out about it.

    Attributes
    ----------
    question : Question
    run : Transient
        Recorded at every step, from the beginning as far as MOST_ROWS go.
    summary : mapping
        Of the whole run, not recorded; of a long one, recorded coarsely.
    whole : bool
        Whether `run` is as long as that.
    settled : Transient or None
        Of a run of LONG or more: all of it, recorded coarsely.
    plain : Transient
        As `run`, but all of it with the modes that the question's model has.
    replay : Replay or None
        Of `plain`; None where forces are no kicks or the contact point moves.
    states : ndarray, (2, k), or None
        For "exact": at k instants g_N (first row) and g_N' (second), per N of load.
    instants : ndarray of int, (k,)
        Their places in the record.
    copied : mapping or None
        Summary of the operating point, of a case that is a copy of it.
    cost : float
        Thread time per step in units of what the same modes take without friction.
    """

    question: Question
    run: Transient
    summary: Mapping[str, Any]
    whole: bool
    settled: Transient | None
    plain: Transient
    replay: Replay | None
    states: Array | None
    instants: NDArray[np.intp]
    copied: Mapping[str, Any] | None
    cost: float


def gathered(question: Question, original: Question | None) -> Evidence:
    """Run a question in all ways that judging it needs.

    Parameters
    ----------
    question : Question
    original : Question or None
        Of which it is a copy.
    """
    most = min(question.duration, MOST_ROWS * question.step)
    every = {"record": True, "sample_rate": min(1.0 / question.step, 1e9)}
    settled = None
    if question.duration >= LONG:
        settled = question.ask(record=True, sample_rate=MOST_ROWS / question.duration)
    # From the start on, so that short runs have figures too.
    summary = settled.summary if settled else question.ask(settle=0.0).summary
    run = question.ask(most, settle=0.0, **every)
    plain = question.ask(most, settle=0.0, **every, **question.plain_cutoff) if question.refines_onset else run
    replay, states, instants = None, None, np.zeros(0, dtype=np.intp)
    if question.method == "exact":
        instants = np.unique(np.linspace(0, len(run.time) - 1, INSTANTS).astype(int))
        states = _gaps(question, run.time[instants])
    elif "contact_motion" not in question.options:
        load, sense = question.numbers["F"], float(np.sign(question.numbers["V"]))
        replay = replayed(question, plain.time, plain.normal_force / load, sense * plain.tangential_force / load)
    return Evidence(
        question,
        run,
        summary,
        most == question.duration and settled is None,
        settled,
        plain,
        replay,
        states,
        instants,
        None if original is None else original.ask(settle=0.0).summary,
        cost(question),
    )


def original_of(case: Case, question: Question) -> Question | None:
    """The operating point, where a case is that in another size or in a mirror."""
    return replace(question, numbers=dict(POINT)) if case.copy else None


def _gaps(question: Question, times: Array) -> Array:
    """g_N and its rate at given times, from the states of "exact" itself."""
    scene, model, given = Normalised.of(question.scene), question.model, question.initial
    initial = None if given is None else State(given[0] / scene.load, given[1] / scene.load, given[2])
    states = states_at(scene, times, ramp=question.ramp, cutoff=question.options.get("cutoff"), initial=initial)
    n = len(model.rest)
    gap = (states[:, :n] + model.rest) @ model.normal
    return np.stack([gap, states[:, n:] @ model.normal])


def cost(question: Question) -> float:
    """Thread time per step, in units of what the same modes take without friction, where nothing happens.

    The least of several attempts at both, with the time that a run takes to begin taken off.
    """
    duration = question.duration
    if question.method == "fast" and "contact_motion" not in question.options:
        low, high = (steps * question.step for steps in COST_STEPS)
        duration = min(max(duration, low), high)
    # The finer onset of "fast" is left out of both: how long it lasts is the scene's.
    question = replace(question, options={"end_early": False, **question.options, **question.plain_cutoff})
    quiet = replace(question, numbers={**question.numbers, "mu": 0.0}, start="")
    # Nothing happens in it, so a part of it tells as much.
    part = 1.0 if question.method == "fast" else 0.25
    busy, calm = np.inf, np.inf
    for _ in range(ATTEMPTS):
        busy = min(busy, _seconds(question, duration) - _seconds(question, question.step))
        calm = min(calm, (_seconds(quiet, part * duration) - _seconds(quiet, quiet.step)) / part)
        if busy <= ENOUGH * calm:
            break
    return float(busy / max(calm, 1e-9))


def _seconds(question: Question, duration: float) -> float:
    """What a run costs this thread."""
    begin = time.thread_time()
    question.ask(duration)
    return time.thread_time() - begin
