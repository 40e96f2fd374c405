"""How a run under stress is judged: each check gives a number and the bound that it must not exceed.

It gives (value, bound), or None where it does not apply. It passes where value <= bound; NaN never does.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import Transient
from fivcore.contact.reduced import ReducedModel, reduced_model
from fivcore.transient import published
from fivcore.transient.normalised import Normalised, energy_at_hand
from fivcore.transient.statistics import SEPARATION, SLIP, STICK
from studies.motion.normalised import SCALED
from studies.stress.ask import Question
from studies.stress.cases import POINT
from studies.stress.runs import Evidence

Array = NDArray[Any]
Judged = tuple[float, float] | None

EPS = float(np.finfo(float).eps)
# Rounding, in units of the largest force, and of a copy, the same motion times a number.
ROUNDING, COPY = 1e-12, 1e-12
SOLVED = 1e-9  # a relation that the published scheme solves for, relative to the terms in it
# Energy unaccounted for: of "exact", what rounding leaves; of "fast", what landing within a step leaves, per
# default step; of "paper", beyond what its own damping and the impacts take.
BALANCE = {"exact": 1e-9, "fast": 0.05, "paper": 0.05}
# The gap, in units of the compliance under the largest force and of what is closed in a step: "fast" meets P2
# within a step, in which its element relaxes; of "paper" what the replay's first order leaves; "exact" rounds, the
# positions of slow modes most. Without an element: what landings and impulses within steps leave of it.
GAP, RIGID_GAP = {"fast": 0.25, "paper": 0.1, "exact": 1e-4}, 4.0
# Mean of N over so many blocks: standard errors that may lie between it and F, and what the head's momentum is.
BLOCKS, ERRORS, MOMENTUM = 40, 5.0, 1e-6
# Thread time per step, in units of that without friction: no state of the contact costs more than all modes do;
# "exact" pays for its events.
COST = {"fast": 3.0, "paper": 3.0, "exact": 10.0}

# What the value of each check is, for a reader; `message` is of a refusal (`ask.not_stated`).
CHECKS = {
    "finite": "numbers that are not finite",
    "normal": "N below zero, in units of the largest",
    "cone": "|T| beyond mu N, in units of the largest N",
    "relaxation": "T off its relaxation towards the cone, in units of it",
    "separation": "force in separation, in units of the largest",
    "direction": "power of friction on slip, in units of the largest force and speed",
    "stick": "slip speed in stick, in units of V",
    "gap": "gap in contact or penetration, in units of the compliance under the largest force",
    "energy": "energy unaccounted for, in units of what is exchanged",
    "mean": "mean N less F where settled, in units of F",
    "copy": "figures of a copy off the original, in units of them",
    "record": "figures that recording changes",
    "cost": "thread time per step, in units of that without friction",
    "message": "what a refusal fails to state",
}


def judged(evidence: Evidence) -> dict[str, tuple[float, float]]:
    """Value and bound of every check that applies. The cost excludes denormal numbers and event storms."""
    results = _contact_law(evidence) | {
        "finite": (_not_finite(evidence), 0.0),
        "gap": _gap(evidence) if evidence.states is None else _exact_gap(evidence),
        "energy": _energy(evidence),
        "mean": None if evidence.long is None else _mean(evidence.long, evidence.question.numbers["F"]),
        "copy": None if evidence.original is None else (_off(evidence, evidence.original), COPY),
        "record": (_changed(evidence), 0.0) if evidence.whole else None,
        "cost": (evidence.cost, COST[evidence.question.method]),
    }
    return {name: each for name, each in results.items() if each is not None}


def _not_finite(evidence: Evidence) -> float:
    run, summary = evidence.run, evidence.summary
    series = (run.time, run.velocity_B, run.normal_force, run.tangential_force, run.slip_velocity)
    # NaN in a summary stands for no value; but a balance there always is.
    values = [np.asarray(value, dtype=float) for value in summary.values() if not isinstance(value, str)]
    wrong = [~np.isfinite(each) for each in series] + [np.isinf(each) for each in values]
    return float(sum(map(np.count_nonzero, wrong)) + np.isnan(summary["energy_residual"]))


def _contact_law(evidence: Evidence) -> dict[str, Judged]:
    """Signorini's and Coulomb's conditions at every step; "paper" relaxes towards the cone.

    Without an element the step of a landing is left out: its mean velocity may differ in sign from the next.
    """
    question, run = evidence.question, evidence.run
    N, T, slip, state = run.normal_force, run.tangential_force, run.slip_velocity, run.state
    mu, V, peak = question.scene.mu, abs(question.numbers["V"]), max(float(np.abs(N).max()), question.numbers["F"])
    separated, landing = state == SEPARATION, np.zeros(len(state), dtype=bool)
    if question.method == "fast" and not question.model.K.any():
        landing[1:] = separated[:-1]
    slips, sticks, bound = (state == SLIP) & ~landing, (state == STICK) & ~landing, ROUNDING
    N_open, T_open = (np.abs(part[separated]).max(initial=0.0) for part in (N, T))
    law: dict[str, Judged] = {
        "normal": (float(max(0.0, -N.min())) / peak, ROUNDING),
        "separation": (float(max(N_open, T_open)) / peak, 0.0),
    }
    if question.method == "paper":
        places = np.flatnonzero(state[1:] == SLIP) + 1
        side, wrong = _relaxation(T, N, mu, places, question.step)
        law["relaxation"] = float(wrong.max(initial=0.0)), SOLVED
        # Once friction has the sign and the size of its law; before, it relaxes.
        slips = places[(np.abs(T[places]) <= mu * N[places]) & (side * T[places] > 0.0)]
        # Its slip speed is read off displacements that grow with the drive.
        bound += 64.0 * EPS * _moved(question, V * float(run.time[-1])) / (question.step * V)
    else:
        law["cone"] = float(max(0.0, (np.abs(T) - mu * N).max())) / peak, ROUNDING
    most, power = peak * float(np.abs(slip).max(initial=0.0)), (T * slip)[slips]
    law["direction"] = float(max(0.0, power.max(initial=0.0))) / most if most > 0.0 else 0.0, ROUNDING
    law["stick"] = float(np.abs(slip[sticks]).max(initial=0.0)) / V, bound
    return law


def _relaxation(T: Array, N: Array, mu: float, slips: Array, step: float) -> tuple[Array, Array]:
    """Towards which side T goes where "paper" slips, and how far it is off its law, relative.

    T nears s mu N by 1 / (1 + r) a step, r = step / tau. The side s is the sign of what sticking would need, which
    is not recorded: that of the two which fits.
    """
    r, before, T, N = step / published.TAU, T[slips - 1], T[slips], N[slips]
    up, down = (np.abs((1.0 + r) * T - before - r * s * mu * N) for s in (1.0, -1.0))
    size = np.abs(T) + np.abs(before) + mu * N
    return np.where(up <= down, 1.0, -1.0), np.minimum(up, down) / np.where(size > 0.0, size, 1.0)


def _moved(question: Question, driven: float) -> float:
    """Displacement of the clamp or the tip, m: nothing in g_T is larger."""
    model, initial = question.model, question.initial
    moved = driven + question.numbers["F"] * float(np.sum(np.abs(model.tangential * model.rest)))
    if initial is not None:
        # The rigid mode's angular frequency is taken as the lowest of the others.
        omega = np.sqrt(model.stiffness)
        omega = np.where(omega > 0.0, omega, omega[omega > 0.0].min())
        moved += float(np.abs(model.tangential) @ (np.abs(initial[0]) + np.abs(initial[1]) / omega))
    return moved


def _gap(evidence: Evidence) -> Judged:
    """By the forces alone (the replay), in units of what the compliance and the surfaces in a step give way."""
    replay, question, run = evidence.replay, evidence.question, evidence.plain
    if replay is None:
        return None
    peak, K = float(run.normal_force.max()) / question.numbers["F"], _usual(question).K
    compliance = float(np.linalg.inv(K)[0, 0]) if K.any() else 0.0
    unit, bound = question.step * replay.closing + compliance * peak, GAP[question.method]
    if not compliance:
        bound = RIGID_GAP
        # An impulse moves the surfaces before the next one brings them back.
        unit += question.step**2 * float(question.model.W[0, 0]) * peak if question.method == "fast" else 0.0
    touching = run.state != SEPARATION
    started = np.logical_or.accumulate(touching | (replay.gap >= 0.0))
    wrong = np.where(touching, np.abs(replay.gap), np.maximum(-replay.gap, 0.0)) * started
    return (float(wrong.max()) / unit if unit > 0.0 else 0.0), bound


def _exact_gap(evidence: Evidence) -> Judged:
    """Error of "exact" by its states: p + tau p' = K^-1 (N, T) along the normal, p = -g_N; open: g_N >= -u_N."""
    run, question, at = evidence.run, evidence.question, evidence.instants
    model, load = question.model, question.numbers["F"]
    assert evidence.states is not None
    opening, rate, gap = evidence.states
    T, N = run.tangential_force / load, run.normal_force / load
    across, tau = np.linalg.inv(model.K)[0], float(model.C[0, 0] / model.K[0, 0])
    sense = float(np.sign(question.numbers["V"]))
    carried = across[0] * N[at] + across[1] * sense * T[at] + opening + tau * rate
    wrong = np.where((run.state != SEPARATION)[at], np.abs(carried), np.maximum(-gap, 0.0))
    unit = float(across[0]) * float(N.max()) + tau * float(np.abs(rate).max())
    return (float(wrong.max()) / unit if unit > 0.0 else 0.0), GAP["exact"]


def _energy(evidence: Evidence) -> Judged:
    """Judge the energy residual; that of "fast" is what landing and taking off within a step leaves.

    Of "paper": its own damping and its impacts are not in its balance; the replay says what they take, and what is
    left over counts.
    """
    question, run, replay = evidence.question, evidence.run, evidence.replay
    residual, bound = float(run.summary["energy_residual"]), BALANCE[question.method]
    if question.method != "paper":
        bound *= max(question.step / question.model.default_step, 1.0) if question.method == "fast" else 1.0
        return max(residual, float(evidence.summary["energy_residual"])), bound
    if replay is None:
        return None
    load, step = question.numbers["F"], question.step
    T, slip = run.tangential_force / load, run.slip_velocity / load
    drive = question.numbers["V"] / load * np.minimum(run.time / max(question.ramp, 1e-300), 1.0)
    work, friction = step * float(T @ drive), -step * float(T @ slip)
    taken, given, lost = replay.added + replay.struck, work + replay.carried, friction + replay.damped
    exchanged = abs(given) + abs(lost) + abs(given - lost - taken)
    exchanged = max(exchanged, energy_at_hand(Normalised.of(question.scene), question.state))
    return abs(residual - abs(taken) / exchanged), bound


def _mean(run: Transient, F: float) -> Judged:
    """Mean N against F where the motion has settled; the bound is the scatter of blocks."""
    first = run.summary["first_slip_time"]
    N = run.normal_force[run.time >= (0.0 if np.isnan(first) else first + 0.1)]
    blocks = np.array([block.mean() for block in np.array_split(N, BLOCKS)])
    scatter = float(blocks.std(ddof=1)) / np.sqrt(BLOCKS) / F
    return abs(run.summary["mean_normal_force"] / F - 1.0), ERRORS * scatter + MOMENTUM


def _off(evidence: Evidence, originals: Mapping[str, Any]) -> float:
    """How far a copy's figures are from those of the original, scaled."""
    worst = 0.0
    for name, original in originals.items():
        own = evidence.summary[name]
        if isinstance(original, str):
            worst = max(worst, 0.0 if own == original else np.inf)
            continue
        scale = evidence.question.numbers["F"] / POINT["F"] if name in SCALED else 1.0
        there, here = (np.atleast_1d(np.asarray(value, dtype=float)) for value in (original, own))
        if there.shape != here.shape or not np.array_equal(np.isnan(there), np.isnan(here)):
            return np.inf
        size = np.where(np.abs(there) > 0.0, np.abs(scale * there), 1.0)
        worst = max(worst, float(np.nanmax(np.abs(here - scale * there) / size, initial=0.0)))
    return worst


def _changed(evidence: Evidence) -> float:
    """How many figures a record changes."""
    pairs = [(evidence.run.summary[name], value) for name, value in evidence.summary.items()]
    same = [a == b if isinstance(b, str) else np.array_equal(a, b, equal_nan=True) for a, b in pairs]
    return float(len(same) - sum(same))


def _usual(question: Question) -> ReducedModel:
    """The question's model; of "paper", which keeps all modes, the one with the usual cut-off."""
    return reduced_model(question.rig, question.theta) if question.method == "paper" else question.model
