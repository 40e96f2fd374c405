"""First guesses of a limit cycle."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fivcore.cycles.flow import PLANE, Flow, Segment
from fivcore.cycles.shooting import plane_at
from fivcore.errors import InputError, UnsolvedError
from fivcore.jit import Array
from fivcore.rig import Scene
from fivcore.transient.exact_kernels import SLIP_DOWN, SLIP_UP
from fivcore.transient.normalised import State
from fivcore.transient.options import Options
from fivcore.transient.simulate import simulate
from fivcore.transient.statistics import STICK

# Events that a trace follows, and most of them in a period.
EVENTS, MOST = 300, 80
# A state returns if it comes so close, in units of the motion's spread; closeness at which the shortest is taken.
RETURNS, SHORTEST, CLOSE = 0.5, 3.0, 1e-6


def status_of(flow: Flow, contact: int, z: Array) -> int:
    """Contact status of a state, with the sense of slip."""
    slips = [each for each in (SLIP_UP, SLIP_DOWN) if flow.margins(each, z)[0][1] > 0.0]
    return contact if contact <= STICK else slips[0] if slips else STICK


def traced(
    flow: Flow, z: Array, status: int, span: float, plane: Array | None = None, about: float | None = None
) -> list[Segment]:
    """Segments from z on, up to EVENTS or a time, s; the last one ends nothing."""
    segments, t, closest = [], 0.0, np.inf
    while len(segments) < EVENTS and t < span and closest > CLOSE:
        event, time, end = flow.to_event(status, z, span - t, plane)
        if not np.isfinite(time):
            break
        segments.append(Segment(status, event, time, z))
        t += time
        after = status if event == PLANE else flow.following(status, event, end)
        z, status = (end if event == PLANE else flow.entry(status, after) @ end), after
        same = [each.start for each in segments[1:] if each.status == status] if about is None else []
        closest = min([np.linalg.norm(z - each) / flow.size(z) for each in same], default=np.inf)
    return [*segments, Segment(status, PLANE, 0.0, z)]


def recurrent(
    flow: Flow, status: int, z: Array, *, span: float | None = None, about: float | None = None
) -> tuple[list[Segment], Array]:
    """The part of the motion from z on that repeats itself best, or after `about` so long, s, and its plane."""
    plane = plane_at(flow, Segment(status, PLANE, 0.0, z))
    span = 3.0 * about if about is not None else span
    segments = traced(flow, z, status, span, None, about)
    if len(segments) < 3:
        segments = traced(flow, z, status, span, plane, about)
    starts, times = np.array([each.start for each in segments]), np.cumsum([0.0, *(s.time for s in segments[:-1])])
    spread = np.linalg.norm(starts - starts.mean(axis=0), axis=1).max() + 1e-12 * flow.size(z)
    first, pairs = (1 if len(segments) > 3 else 0), []
    for i in range(first, len(segments)):
        for j in range(i + 1, min(i + MOST, len(segments))):
            same = segments[i].status == segments[j].status and (i == 0 or segments[i - 1][:2] == segments[j - 1][:2])
            if same and (about is None or abs(times[j] - times[i] - about) < 0.3 * about):
                pairs.append((float(np.linalg.norm(starts[j] - starts[i])) / spread, times[j] - times[i], i, j))
    if not pairs or (best := min(pairs))[0] > RETURNS:
        raise UnsolvedError("limit_cycle: nothing in this motion repeats itself; give another guess")
    near = [pair for pair in pairs if pair[0] <= max(SHORTEST * best[0], 1e-4)]
    _, _, i, j = min(near, key=lambda pair: pair[1])
    found = segments[i:j]
    return found, plane_at(flow, found[0])


def segments_of(
    scene: Scene, flow: Flow, guess: Any, options: Options, duration: float
) -> tuple[list[Segment], Array]:
    """Segments and plane of a guess (`limit_cycle`)."""
    if guess is None:
        return by_run(scene, flow, options, duration)
    if isinstance(guess, State):
        return from_state(flow, guess)
    raise InputError(f"guess = {guess!r}: it must be a LimitCycle, a State, two of them, an amplitude or None")


def from_state(flow: Flow, state: State) -> tuple[list[Segment], Array]:
    """From a state of the scene, in its own units."""
    load = flow.scene.load
    own = State(state.displacement / load, state.velocity / load, state.contact)
    z = flow.of_state(own)
    status = status_of(flow, own.contact, z)
    return recurrent(flow, status, flow.entry(status, status) @ z, span=1e5 * flow.grid)


def by_run(scene: Scene, flow: Flow, options: Options, duration: float) -> tuple[list[Segment], Array]:
    """From the end of a run."""
    run = simulate(scene, duration, options=replace(options, record=False))
    return from_state(flow, run.final_state)
