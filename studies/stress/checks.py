"""How a run under stress is judged: each check finds a number and the bound that it must not exceed, and says why.

A check returns (value, bound), or None where it does not apply. It passes where value <= bound; NaN never does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.contact.reduced import reduced_model
from fivcore.transient import published
from fivcore.transient.statistics import SEPARATION, SLIP, STICK
from studies.motion.normalised import SCALED
from studies.stress.case import POINT
from studies.stress.runs import BLOCKS, Evidence

Array = NDArray[Any]
Found = tuple[float, float] | None

# Of what is found by a few operations on numbers of the size of the largest force.
ROUNDING = 1e-12
# A relation that the published scheme solves for, relative to the terms in it.
SOLVED = 1e-9
# Energy unaccounted for: of "exact", what rounding leaves; of "fast", what landing within a step leaves, per
# default step; of "paper", beyond what its own damping and the impacts take.
BALANCE = {"exact": 1e-9, "fast": 0.05, "paper": 0.05}
# What rounding leaves of stored energy, in units of it.
STORED = 16.0 * float(np.finfo(float).eps)
# The gap, in units of the compliance under the largest force and of what is closed in a step: "fast" meets P2
# within a step, in which its element relaxes; of "paper" what the replay's first order leaves; "exact" rounds, the
# positions of slow modes most.
GAP = {"fast": 0.25, "paper": 0.1, "exact": 1e-4}
# Without an element the gap of a lasting contact is what landings and kicks within steps leave of it.
RIGID_GAP = 4.0
# Of an element's relaxation time: after so many of them nothing is left of its last state.
FORGOTTEN = 30.0
# Mean of N over blocks: standard errors that may lie between it and F, and what the head's own momentum may be.
ERRORS, MOMENTUM = 5.0, 1e-6
# A copy is the same motion times a number: one rounding each.
COPY = 1e-12
# Thread time per step, in units of that without friction: no state of the contact costs more than all modes do;
# "exact" pays for its events.
COST = {"fast": 3.0, "paper": 3.0, "exact": 10.0}


def finite(evidence: Evidence) -> Found:
    """How many numbers of the record are not finite, or of the summary infinite; none may be."""
    run, summary = evidence.run, evidence.summary
    series = (run.time, run.velocity_B, run.normal_force, run.tangential_force, run.slip_velocity)
    wrong = sum(int(np.count_nonzero(~np.isfinite(each))) for each in series)
    # NaN in a summary stands for no value; but a balance there always is.
    told = [value for value in summary.values() if not isinstance(value, str)]
    wrong += sum(int(np.count_nonzero(np.isinf(np.asarray(value, dtype=float)))) for value in told)
    return float(wrong + np.isnan(summary["energy_residual"])), 0.0


def normal(evidence: Evidence) -> Found:
    """How far N falls below zero, in units of the largest."""
    N = evidence.run.normal_force
    return float(max(0.0, -N.min())) / _peak(evidence), ROUNDING


def cone(evidence: Evidence) -> Found:
    """How far |T| exceeds mu N, in units of the largest N; not "paper", which relaxes towards the cone."""
    if evidence.question.method == "paper":
        return None
    run = evidence.run
    beyond = np.abs(run.tangential_force) - evidence.question.scene.mu * run.normal_force
    return float(max(0.0, beyond.max())) / _peak(evidence), ROUNDING


def relaxation(evidence: Evidence) -> Found:
    """Whether in slip T nears s mu N by 1 / (1 + r) a step, r = step / tau: "paper" alone."""
    if evidence.question.method != "paper":
        return None
    _, _, wrong = _aimed(evidence)
    return float(wrong.max(initial=0.0)), SOLVED


def _aimed(evidence: Evidence) -> tuple[Array, Array, Array]:
    """For "paper": where it slips, towards which side T goes there, and how far it is off its law, relative.

    The side is the sign of what sticking would need, which is not recorded: that of the two which fits.
    """
    run, mu, r = evidence.run, evidence.question.scene.mu, evidence.question.step / published.TAU
    slips = np.flatnonzero(run.state[1:] == SLIP) + 1
    before, T, N = run.tangential_force[slips - 1], run.tangential_force[slips], run.normal_force[slips]
    up, down = (np.abs((1.0 + r) * T - before - r * s * mu * N) for s in (1.0, -1.0))
    size = np.abs(T) + np.abs(before) + mu * N
    return slips, np.where(up <= down, 1.0, -1.0), np.minimum(up, down) / np.where(size > 0.0, size, 1.0)


def separation(evidence: Evidence) -> Found:
    """The largest force while separated, in units of the largest of all; there is none."""
    run, apart = evidence.run, evidence.run.state == SEPARATION
    N, T = (np.abs(part[apart]).max(initial=0.0) for part in (run.normal_force, run.tangential_force))
    return float(max(N, T)) / _peak(evidence), 0.0


def direction(evidence: Evidence) -> Found:
    """The largest power with which friction drives the slip, in units of the largest force times slip speed.

    "paper": once friction has the sign and the size of its law, |T| <= mu N and s T > 0; before, it relaxes.
    Without an element: not in the step of a landing, whose mean velocity may differ in sign from the one after it.
    """
    run, question = evidence.run, evidence.question
    T, N = run.tangential_force, run.normal_force
    power = T * run.slip_velocity
    counts = run.state == SLIP
    if question.method == "paper":
        slips, side, _ = _aimed(evidence)
        settled = (np.abs(T[slips]) <= question.scene.mu * N[slips]) & (side * T[slips] > 0.0)
        counts = slips[settled]
    else:
        counts &= ~_landing(evidence)
    most = _peak(evidence) * float(np.abs(run.slip_velocity).max(initial=0.0))
    worst = float(max(0.0, power[counts].max(initial=0.0)))
    return worst / most if most > 0.0 else 0.0, ROUNDING


def stick(evidence: Evidence) -> Found:
    """The largest slip speed in stick, in units of V.

    "paper" reads it off displacements that grow with the drive. Without an element: not in the step of a landing,
    of which the mean is told, and which ends in stick.
    """
    question, run = evidence.question, evidence.run
    V = abs(question.numbers["V"])
    sticks = (run.state == STICK) & ~_landing(evidence)
    fastest = float(np.abs(run.slip_velocity[sticks]).max(initial=0.0))
    bound = ROUNDING
    if question.method == "paper":
        # Nothing in g_T is larger than what the clamp or the tip has moved.
        model, load = question.model, question.numbers["F"]
        moved = V * float(run.time[-1]) + load * float(np.sum(np.abs(model.tangential * model.rest)))
        given = question.initial
        if given is not None:
            moved += float(np.abs(model.tangential) @ (np.abs(given[0]) + np.abs(given[1]) / _lowest(model)))
        bound += 64.0 * float(np.finfo(float).eps) * moved / (question.step * V)
    return fastest / V, bound


def gap(evidence: Evidence) -> Found:
    """The largest gap in contact, or penetration elsewhere, by the forces alone (`studies.stress.replay`).

    In units of how far the compliance gives way under the largest force, and of what the surfaces close in a step.
    For "exact" from its own states: in contact the element carries what its compression and its rate say.
    """
    if evidence.states is not None:
        return _exact_gap(evidence)
    replay, question, run = evidence.replay, evidence.question, evidence.plain
    if replay is None:
        return None
    peak, step, model = float(run.normal_force.max()) / question.numbers["F"], question.step, question.model
    unit = step * replay.closing + _compliance(evidence) * peak
    bound = GAP[question.method]
    if not _compliance(evidence):
        bound = RIGID_GAP
        # A kick moves the surfaces before the next one brings them back.
        unit += step**2 * float(model.W[0, 0]) * peak if question.method == "fast" else 0.0
    touching = run.state != SEPARATION
    started = np.logical_or.accumulate(touching | (replay.gap >= 0.0))
    wrong = np.where(touching, np.abs(replay.gap), np.maximum(-replay.gap, 0.0)) * started
    return (float(wrong.max()) / unit if unit > 0.0 else 0.0), bound


def _exact_gap(evidence: Evidence) -> Found:
    """For "exact": p + tau p' = K^-1 (N, T) along the normal, p = -g_N; long after contact g_N >= 0."""
    run, question, states = evidence.run, evidence.question, evidence.states
    assert states is not None
    model, load = question.model, question.numbers["F"]
    T, N = run.tangential_force / load, run.normal_force / load
    sense = float(np.sign(question.numbers["V"]))
    across, tau = np.linalg.inv(model.K)[0], float(model.C[0, 0] / model.K[0, 0])
    at, (opening, rate) = evidence.instants, states
    touching = run.state != SEPARATION
    carried = across[0] * N[at] + across[1] * sense * T[at] + opening + tau * rate
    # How long ago contact was, s; where there was none yet, for ever.
    index = np.arange(len(run.time))
    last = np.maximum.accumulate(np.where(touching, index, -len(index)))
    long_ago = ((index - last) * question.step > FORGOTTEN * tau + 2.0 * question.step)[at]
    wrong = np.where(touching[at], np.abs(carried), np.where(long_ago, np.maximum(-opening, 0.0), 0.0))
    unit = _compliance(evidence) * float(N.max()) + tau * float(np.abs(rate).max())
    return (float(wrong.max()) / unit if unit > 0.0 else 0.0), GAP["exact"]


def energy(evidence: Evidence) -> Found:
    """Energy unaccounted for, in units of what was exchanged.

    "fast": what landing and taking off within a step leaves, which grows with it. "paper": its own damping and its
    impacts are not in its balance; the replay says what they take, and what is left over counts. All of them: what
    rounding leaves of the stored energy, where hardly any is exchanged.
    """
    question, run = evidence.question, evidence.run
    full = reduced_model(question.rig, question.theta) if question.method == "paper" else question.model
    stored = float(np.sum(full.stiffness * full.rest**2))
    load, step = question.numbers["F"], question.step
    T, slip = run.tangential_force / load, run.slip_velocity / load
    pace = question.numbers["V"] / load * np.minimum(run.time / max(question.ramp, 1e-300), 1.0)
    work, friction = step * float(T @ pace), -step * float(T @ slip)
    residual, bound = float(run.summary["energy_residual"]), BALANCE[question.method]
    if question.method != "paper":
        residual = max(residual, float(evidence.summary["energy_residual"]))
    exchanged = abs(work) + abs(friction)
    if question.method == "fast":
        bound *= max(step / question.model.default_step, 1.0)
    if question.method == "paper":
        if evidence.replay is None:
            return None
        taken = evidence.replay.added + evidence.replay.struck
        lost = friction + evidence.replay.damped
        given = work + evidence.replay.carried
        exchanged = abs(given) + abs(lost) + abs(given - lost - taken)
        residual = abs(residual - abs(taken) / max(exchanged, 1e-300))
    floor = STORED * stored / exchanged if exchanged > 0.0 else 0.0
    return residual, bound + floor


def mean(evidence: Evidence) -> Found:
    """Mean N against F where the motion has settled, in units of F; the bound is the scatter of its blocks."""
    run = evidence.settled
    if run is None:
        return None
    F, summary = evidence.question.numbers["F"], run.summary
    first = summary["first_slip_time"]
    since = 0.0 if np.isnan(first) else first + 0.1
    N = run.normal_force[run.time >= since]
    blocks = np.array([block.mean() for block in np.array_split(N, BLOCKS)])
    scatter = float(blocks.std(ddof=1)) / np.sqrt(BLOCKS) / F
    return abs(summary["mean_normal_force"] / F - 1.0), ERRORS * scatter + MOMENTUM


def copy(evidence: Evidence) -> Found:
    """How far a copy's figures are from those of the operating point, scaled."""
    if evidence.copied is None:
        return None
    question = evidence.question
    factor = question.numbers["F"] / POINT["F"]
    worst = 0.0
    for name, original in evidence.copied.items():
        own = evidence.summary[name]
        if isinstance(original, str):
            worst = max(worst, 0.0 if own == original else np.inf)
            continue
        scale = factor if name in SCALED else 1.0
        there, here = (np.atleast_1d(np.asarray(value, dtype=float)) for value in (original, own))
        if there.shape != here.shape or not np.array_equal(np.isnan(there), np.isnan(here)):
            return np.inf, COPY
        size = np.where(np.abs(there) > 0.0, np.abs(scale * there), 1.0)
        worst = max(worst, float(np.nanmax(np.abs(here - scale * there) / size, initial=0.0)))
    return worst, COPY


def record(evidence: Evidence) -> Found:
    """How many figures a record changes; none."""
    if not evidence.whole:
        return None
    return float(
        sum(not _same(evidence.run.summary[name], value) for name, value in evidence.summary.items())
    ), 0.0


def cost(evidence: Evidence) -> Found:
    """Thread time per step, in units of that without friction: no denormals, no event storms."""
    return evidence.cost, COST[evidence.question.method]


CHECKS: Mapping[str, tuple[Callable[[Evidence], Found] | None, str]] = {
    "finite": (finite, "numbers that are not finite"),
    "normal": (normal, "N below zero, in units of the largest"),
    "cone": (cone, "|T| beyond mu N, in units of the largest N"),
    "relaxation": (relaxation, "T off its relaxation towards the cone, in units of it"),
    "separation": (separation, "force in separation, in units of the largest"),
    "direction": (direction, "power of friction on slip, in units of the largest force and speed"),
    "stick": (stick, "slip speed in stick, in units of V"),
    "gap": (gap, "gap in contact or penetration, in units of the compliance under the largest force"),
    "energy": (energy, "energy unaccounted for, in units of what is exchanged"),
    "mean": (mean, "mean N less F where settled, in units of F"),
    "copy": (copy, "figures of a copy off the original, in units of them"),
    "record": (record, "figures that recording changes"),
    "cost": (cost, "thread time per step, in units of that without friction"),
    "message": (None, "what a refusal fails to state"),
}


def judged(evidence: Evidence) -> dict[str, tuple[float, float]]:
    """Every check that applies: value and bound."""
    found = {name: check(evidence) for name, (check, _) in CHECKS.items() if check is not None}
    return {name: each for name, each in found.items() if each is not None}


def passes(value: float, bound: float) -> bool:
    """Whether a check has passed."""
    return bool(value <= bound)


def _landing(evidence: Evidence) -> Array:
    """Steps in which rigid surfaces meet."""
    found = np.zeros(len(evidence.run.state), dtype=bool)
    if evidence.question.method == "fast" and not evidence.question.model.K.any():
        found[1:] = evidence.run.state[:-1] == SEPARATION
    return found


def _peak(evidence: Evidence) -> float:
    return max(float(np.abs(evidence.run.normal_force).max()), evidence.question.numbers["F"])


def _compliance(evidence: Evidence) -> float:
    """Static flexibility along the normal of what stands for the modes that are not kept, m/N.

    Of what keeps all, that of the modes above the usual cut-off.
    """
    question = evidence.question
    usual = question.method == "paper"
    model = reduced_model(question.rig, question.theta) if usual else question.model
    return float(np.linalg.inv(model.K)[0, 0]) if model.K.any() else 0.0


def _lowest(model: Any) -> Array:
    """Angular frequencies, the rigid mode's taken as the lowest of the others."""
    omega = np.sqrt(model.stiffness)
    return np.asarray(np.where(omega > 0.0, omega, omega[omega > 0.0].min()))


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, str) or isinstance(other, str):
        return bool(one == other)
    return bool(np.array_equal(np.asarray(one, dtype=float), np.asarray(other, dtype=float), equal_nan=True))
