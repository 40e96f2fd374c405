"""Evidence of a run before it is judged: records, a replay, the operating point, cost.

The replay moves the modes again by the recorded forces alone: a record has N and T at every step, not where the
surfaces are, but between the forces the modes move freely. No contact law is in it: only the forces, the drive of
P2's clamp, and the element in place of the modes that were not kept as what it is, C = tau K, so that u relaxes to
K^-1 (N, T) whatever the contact does. A method's contact law is then judged by what its forces do: they may leave
no gap while they act and none below zero while they do not, and take no more energy than they account for.

In normalised units (F = 1, V > 0). For "fast" the forces are impulses, as its own are. For "paper" the modes move
exactly, with the damping that the scheme has itself (`transient.published`) added to theirs; the error is of the
first order in its step, some thousandths of the compliance of the modes above the usual cut-off.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from fivcore import Transient
from fivcore.beams.modes import propagator
from fivcore.contact.impulse import Impulse
from fivcore.contact.reduced import full_model
from fivcore.jit import kernel
from fivcore.transient.exact import states_at
from fivcore.transient.normalised import Normalised
from fivcore.transient.published import BETA2
from studies.stress.ask import Question
from studies.stress.cases import POINT

Array = NDArray[np.float64]

MOST_ROWS = 2_000_000  # of a record of every step; what is longer is recorded from its beginning
LONG = 1.0  # from this duration on the mean of N is judged, s
INSTANTS = 2000  # at which the states of "exact" are compared with its forces
# Steps over which the cost of "fast" is measured: enough to outweigh its start, and no more than that.
COST_STEPS = (200_000, 10_000_000)
# A run is timed again unless it takes less than so many times what it should: one slow moment is the machine's.
ATTEMPTS, ENOUGH = 4, 2.0


@dataclass(frozen=True, eq=False)
class Replay:
    """Motion of the modes under the recorded forces, per N of load."""

    gap: Array  # g_N + u_N at each record, m: zero in contact, above it elsewhere
    closing: float  # largest speed at which the surfaces approach, m/s
    damped: float  # what the modes lost to their own damping, J
    added: float  # and to that which the scheme adds, J
    struck: float  # what the normal force took out of the modes, J
    carried: float  # work of the clamp's acceleration on the modes, J


@dataclass(frozen=True, eq=False)
class Evidence:
    """One run with its records, replay and cost."""

    question: Question
    run: Transient  # recorded at every step, from the beginning as far as MOST_ROWS go
    summary: Mapping[str, Any]  # of the whole run, not recorded; of a long one, recorded coarsely
    whole: bool  # whether `run` is as long as that
    long: Transient | None  # of a run of LONG or more: all of it, recorded coarsely
    plain: Transient  # as `run`, but all of it with the modes that the question's model has
    replay: Replay | None  # of `plain`; none for "exact", and where the contact point moves
    instants: NDArray[np.intp]  # for "exact": places in the record
    states: Array | None  # for "exact": g_N, its rate and g_N + u_N there (rows), per N of load
    original: Mapping[str, Any] | None  # of a case that is a copy of the operating point: the summary of that
    cost: float  # thread time per step in units of what the same modes take without friction


def gathered(question: Question, is_copy: bool = False) -> Evidence:
    """Run a question in all ways that judging it needs."""
    most = min(question.duration, MOST_ROWS * question.step)
    # From the start on, so that short runs have figures too.
    every = {"record": True, "sample_rate": min(1.0 / question.step, 1e9), "settle": 0.0}
    long = None
    if question.duration >= LONG:
        long = question.ask(record=True, sample_rate=MOST_ROWS / question.duration)
    summary = long.summary if long else question.ask(settle=0.0).summary
    run = question.ask(most, **every)
    plain = question.ask(most, **every, **question.plain_cutoff) if question.plain_cutoff else run
    replay, states, instants = None, None, np.zeros(0, dtype=np.intp)
    if question.method == "exact":
        instants = np.unique(np.linspace(0, len(run.time) - 1, INSTANTS).astype(int))
        scene, model = Normalised.of(question.scene), question.model
        own: dict[str, Any] = {"cutoff": question.options.get("cutoff"), "ramp": question.ramp}
        own["initial"] = question.state
        n = len(model.rest)
        q, v, u = np.split(states_at(scene, run.time[instants], **own), [n, 2 * n], axis=1)
        states = np.stack([(q + model.rest) @ model.normal, v @ model.normal, q @ model.normal + u[:, 0]])
    elif "contact_motion" not in question.options:
        load, sense = question.numbers["F"], float(np.sign(question.numbers["V"]))
        replay = replayed(question, plain.time, plain.normal_force / load, sense * plain.tangential_force / load)
    original = question.changed(**POINT).ask(settle=0.0).summary if is_copy else None
    whole, cost = most == question.duration and long is None, _cost(question)
    return Evidence(question, run, summary, whole, long, plain, replay, instants, states, original, cost)


def _cost(question: Question) -> float:
    """Thread time per step, in units of what the same modes take without friction, where nothing happens.

    The least of several attempts at both, with the time that a run takes to begin taken off.
    """
    duration = question.duration
    if question.method == "fast" and "contact_motion" not in question.options:
        low, high = (steps * question.step for steps in COST_STEPS)
        duration = min(max(duration, low), high)
    # The finer onset of "fast" is left out of both: how long it lasts is the scene's.
    question = question.changed(**{"end_early": False} | dict(question.options) | question.plain_cutoff)
    quiet = replace(question.changed(mu=0.0), start="")
    # Nothing happens in it, so a part of it tells as much.
    part = 1.0 if question.method == "fast" else 0.25

    def seconds(run: Question, duration: float) -> float:
        begin = time.thread_time()
        run.ask(duration)
        return time.thread_time() - begin

    busy, calm = np.inf, np.inf
    for _ in range(ATTEMPTS):
        busy = min(busy, seconds(question, duration) - seconds(question, question.step))
        calm = min(calm, (seconds(quiet, part * duration) - seconds(quiet, quiet.step)) / part)
        if busy <= ENOUGH * calm:
            break
    return float(busy / max(calm, 1e-9))


@kernel
def _moved(
    flow: Any, forced: Any, held: bool, normal: Any, tangential: Any, losses: Any, q: Any, v: Any,
    step: float, N: Any, T: Any, out: Any,
) -> tuple[float, float]:  # fmt: skip
    """Move the modes a step for each force, which is an impulse before the step, or held over it.

    `forced` is what a unit of force times step adds to q and v. `out` receives g_N at each record and the mean of
    its rate there: before an impulse, or after a step with its force held. Returns what is lost to both kinds of
    damping, (2, n) in `losses`.
    """
    n = q.shape[0]
    first, second = 0.0, 0.0
    for i in range(N.shape[0]):
        hN, hT = step * (N[i] - 1.0), step * T[i]
        gap, rate, own, other = 0.0, 0.0, 0.0, 0.0
        for j in range(n):
            was, before = q[j], v[j]
            push = normal[j] * hN + tangential[j] * hT
            x = flow[0, j] * was + flow[1, j] * before + forced[0, j] * push
            y = flow[2, j] * was + flow[3, j] * before + forced[1, j] * push
            mean = 0.5 * (before + y) if held else before + 0.5 * push
            gap += normal[j] * (x if held else was)
            rate += normal[j] * mean
            own += losses[0, j] * mean * mean
            other += losses[1, j] * mean * mean
            q[j], v[j] = x, y
        out[0, i], out[1, i] = gap, rate
        first += step * own
        second += step * other
    return first, second


def replayed(question: Question, time: Array, N: Array, T: Array) -> Replay:
    """Move the modes by a record of every step: time (s), and forces per N of load, T as for V > 0, all (n,).

    All of the run must be with `question.model` and a frozen contact point; not of "exact", whose forces vary
    within a step.
    """
    model, step = question.model, float(time[-1] - time[0]) / (len(time) - 1)
    elastic = model.stiffness > 0.0
    # The scheme finds its force for the end of a step and lets it act on all of it; an impulse acts at its middle.
    held = question.method == "paper"
    added = (BETA2 - 0.5) * step * model.stiffness if held else np.zeros_like(model.stiffness)
    flow = propagator(model.stiffness, model.damping + added, step)
    forced = flow[1::2].copy()
    if held:
        moved = np.full_like(model.stiffness, 0.5 * step)
        moved[elastic] = (1.0 - flow[0, elastic]) / (model.stiffness[elastic] * step)
        forced = np.stack([moved, flow[1] / step])
    load, initial, dropped = question.numbers["F"], question.initial, ~model.kept
    # From rest under the load, where N = 1: the element is as far compressed as that asks.
    q, v, u = np.zeros(len(model.rest)), np.zeros(len(model.rest)), -float(model.normal @ model.rest)
    if initial is not None:
        first = initial[0] / load
        q, v = first[model.kept] - model.rest, (initial[1] / load)[model.kept]
        u = float(full_model(question.rig, question.theta).normal[dropped] @ first[dropped])
    ramp, speed_per_load = question.ramp, abs(question.numbers["V"]) / load
    begun = q
    if not held:
        a, b, c, d = propagator(model.stiffness, model.damping + added, float(time[0]))
        q, v = a * q + b * v, c * q + d * v
    # While the clamp accelerates, the modes move about where that pushes them; what it still has to give when the
    # last whole step of that is over comes at once.
    ends = int(np.searchsorted(time, ramp * (1.0 + 1e-12), side="right"))
    push = model.inertia * speed_per_load
    shift = np.zeros_like(q)
    if ends:
        shift[elastic] = push[elastic] / ramp / model.stiffness[elastic]
    out, lost = np.empty((2, len(time))), np.zeros(2)
    fixed = (flow, forced, held, model.normal, model.tangential, np.stack([model.damping, added]))
    q = q - shift
    lost += _moved(*fixed, q, v, step, N[:ends], T[:ends], out[:, :ends])
    q = q + shift
    carried = float((model.stiffness * shift) @ (q - begun))
    if ends < len(time):
        late = push * (1.0 - float(time[ends - 1]) / ramp) if ends else push
        carried += float(late @ (v + 0.5 * late))
        v = v + late
        lost += _moved(*fixed, q, v, step, N[ends:], T[ends:], out[:, ends:])
    # Impulses see less of the modes' flexibility than a lasting force does; their element has it instead.
    impulse = model.impulse(step)
    defect = float(impulse.defect[0, 0])
    element = _relaxed(impulse, N, T, u + defect, step, float(time[0]))
    gap = out[0] + float(model.normal @ model.rest) - defect + element
    # The work of the load's share of N is what the gap has changed by, which in contact is nothing.
    separated = np.where(N[[0, -1]] == 0.0, gap[[0, -1]], 0.0)
    struck = -step * float((N - 1.0) @ out[1]) - float(separated[1] - separated[0])
    return Replay(gap, float(-out[1].min(initial=0.0)), float(lost[0]), float(lost[1]), struck, carried)


def _relaxed(impulse: Impulse, N: Array, T: Array, first: float, step: float, begin: float) -> Array:
    """u_N at each record: it relaxes towards what the forces, constant over each step, would hold."""
    if not impulse.stiffness.any():
        return np.zeros(len(N))
    across = np.linalg.inv(impulse.stiffness)[0]
    held = across[0] * N + across[1] * T
    tau = float(impulse.damping[0, 0] / impulse.stiffness[0, 0])
    if tau == 0.0:
        return np.asarray(held)
    # Over the part of a step before its record, and over what is left of it.
    before, after = np.exp(-begin / tau), np.exp(-(step - begin) / tau)
    left, _ = lfilter([1.0 - before * after], [1.0, -before * after], held, zi=[before * after * first])
    start = np.concatenate([[first], left[:-1]])
    return np.asarray(held + (start - held) * before)
