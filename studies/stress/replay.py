"""What recorded contact forces do: the modes moved a second time, by the forces alone.

A record tells N and T at every step, not where the surfaces are. But between the forces the modes move freely, so
the forces alone give the motion again, with no contact law anywhere: the forces of every record, the drive of P2's
clamp, and the element in place of the modes that were not kept as what it is, C = tau K, so that u relaxes to
K^-1 (N, T) whatever the contact does. A method's contact law is then judged by what its forces do: they may leave
no gap while they act and none below zero while they do not, and take no more energy than they tell.

In canonical units (F = 1, V > 0). For "fast" the forces are kicks, as its own are. For "paper" the modes move
exactly, with the damping that the scheme has itself (`transient.published`) added to theirs; the error is of the
first order in its step, some thousandths of the compliance of the modes above the usual cut-off.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from fivcore.beams.free_motion import propagator
from fivcore.contact.impulse import Impulse
from fivcore.contact.reduced import ReducedModel, full_model
from fivcore.jit import kernel
from fivcore.transient.published import BETA2
from studies.stress.questions import Question

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Replay:
    """What the recorded forces did, per N of load.

    Attributes
    ----------
    gap : ndarray, (n,)
        g_N + u_N at each record, m: zero in contact, above it elsewhere.
    closing : float
        Largest speed at which the surfaces approach, m/s.
    damped, added : float
        What the modes lost to their own damping and to that which the scheme adds, J.
    struck : float
        What the normal force took out of the modes, J.
    carried : float
        Work of the clamp's acceleration on the modes, J.
    """

    gap: Array
    closing: float
    damped: float
    added: float
    struck: float
    carried: float


@kernel
def _moved(
    flow: Any, forced: Any, held: bool, normal: Any, tangential: Any, losses: Any, q: Any, v: Any,
    step: float, N: Any, T: Any, out: Any,
) -> tuple[float, float]:  # fmt: skip
    """Move the modes a step for each force, which is a kick before the step, or held over it.

    `forced` is what a unit of force times step adds to q and v. `out` receives g_N at each record and the mean of
    its rate there: before a kick, or after a step with its force held. Returns what is lost to both kinds of
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
    """Move the modes by a record of every step.

    Parameters
    ----------
    question : Question
        Of a run with a frozen contact point, all of it with `question.model`; not of "exact", whose forces vary
        within a step.
    time : ndarray, (n,)
        s, evenly spaced by the method's step.
    N, T : ndarray, (n,)
        Contact forces per N of load; T as for V > 0.
    """
    model, step = question.model, float(time[-1] - time[0]) / (len(time) - 1)
    # The scheme finds its force for the end of a step and lets it act on all of it; a kick acts at its middle.
    held = question.method == "paper"
    added = (BETA2 - 0.5) * step * model.stiffness if held else np.zeros_like(model.stiffness)
    damping, losses = model.damping + added, np.stack([model.damping, added])
    flow = propagator(model.stiffness, damping, step)
    forced = _answer(model.stiffness, damping, flow, step) if held else flow[1::2].copy()
    q, v, u = _first(question)
    ramp, pace = question.ramp, abs(question.numbers["V"]) / question.numbers["F"]
    begun = q
    if not held:
        a, b, c, d = propagator(model.stiffness, damping, float(time[0]))
        q, v = a * q + b * v, c * q + d * v
    # While the clamp accelerates, the modes move about where that pushes them; what it still has to give when the
    # last whole step of that is over comes at once.
    ends = int(np.searchsorted(time, ramp * (1.0 + 1e-12), side="right"))
    push = model.inertia * pace
    shift = np.zeros_like(q)
    if ends:
        elastic = model.stiffness > 0.0
        shift[elastic] = push[elastic] / ramp / model.stiffness[elastic]
    out, lost = np.empty((2, len(time))), np.zeros(2)
    fixed = (flow, forced, held, model.normal, model.tangential, losses)
    q = q - shift
    lost += _moved(*fixed, q, v, step, N[:ends], T[:ends], out[:, :ends])
    q = q + shift
    carried = float((model.stiffness * shift) @ (q - begun))
    if ends < len(time):
        late = push * (1.0 - float(time[ends - 1]) / ramp) if ends else push
        carried += float(late @ (v + 0.5 * late))
        v = v + late
        lost += _moved(*fixed, q, v, step, N[ends:], T[ends:], out[:, ends:])
    # Kicks see less of the modes' flexibility than a lasting force does; their element has it instead.
    kicks = model.impulse(step)
    missed = float(kicks.defect[0, 0])
    element = _crept(kicks, N, T, u + missed, step, float(time[0]))
    gap = out[0] + float(model.normal @ model.rest) - missed + element
    # The work of the load's share of N is what the gap has changed by, which in contact is nothing.
    apart = np.where(N[[0, -1]] == 0.0, gap[[0, -1]], 0.0)
    struck = -step * float((N - 1.0) @ out[1]) - float(apart[1] - apart[0])
    return Replay(gap, float(-out[1].min(initial=0.0)), float(lost[0]), float(lost[1]), struck, carried)


def _answer(stiffness: Array, damping: Array, flow: Array, step: float) -> Array:
    """What a force held over a step adds to q and v, for a unit of force times step."""
    elastic = stiffness > 0.0
    moved = np.full_like(stiffness, 0.5 * step)
    moved[elastic] = (1.0 - flow[0, elastic]) / (stiffness[elastic] * step)
    return np.stack([moved, flow[1] / step])


def _first(question: Question) -> tuple[Array, Array, float]:
    """Modal displacements from rest under the load, velocities, and the element's normal state."""
    model, load = question.model, question.numbers["F"]
    given = question.initial
    if given is None:
        # At rest N = 1: the element is as far compressed as that asks.
        at_rest = -float(model.normal @ model.rest)
        return np.zeros(len(model.rest)), np.zeros(len(model.rest)), at_rest
    q, v = (part / load for part in given[:2])
    dropped = ~model.kept
    full = full_model(question.rig, question.theta)
    return q[model.kept] - model.rest, v[model.kept], float(full.normal[dropped] @ q[dropped])


def _free(model: ReducedModel, damping: Array, q: Array, v: Array, time: float) -> tuple[Array, Array]:
    a, b, c, d = propagator(model.stiffness, damping, time)
    return a * q + b * v, c * q + d * v


def _crept(kicks: Impulse, N: Array, T: Array, first: float, step: float, begin: float) -> Array:
    """u_N at each record: it relaxes towards what the forces, constant over each step, would hold."""
    if not kicks.stiffness.any():
        return np.zeros(len(N))
    across = np.linalg.inv(kicks.stiffness)[0]
    held = across[0] * N + across[1] * T
    tau = float(kicks.damping[0, 0] / kicks.stiffness[0, 0])
    if tau == 0.0:
        return np.asarray(held)
    # Over the part of a step before its record, and over what is left of it.
    before, after = np.exp(-begin / tau), np.exp(-(step - begin) / tau)
    left, _ = lfilter([1.0 - before * after], [1.0, -before * after], held, zi=[before * after * first])
    start = np.concatenate([[first], left[:-1]])
    return np.asarray(held + (start - held) * before)
