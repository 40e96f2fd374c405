"""First guesses of a limit cycle."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from fivcore.checks import short
from fivcore.cycles.flow import PLANE, Flow, Segment
from fivcore.cycles.shooting import plane_at
from fivcore.errors import InputError, NoVibrationError, UnsolvedError
from fivcore.jit import Array
from fivcore.rig import Scene
from fivcore.transient.exact_kernels import SLIP_UP
from fivcore.transient.normalised import State
from fivcore.transient.options import Options
from fivcore.transient.simulate import simulate_many
from fivcore.transient.statistics import STICK

# Number of events of a trace, and largest number in a period.
EVENTS, MOST = 300, 80
# Distance, relative to the spread of the motion, at which a state recurs; factor within which the shortest period
# wins.
RETURNS, SHORTEST, CLOSE = 0.5, 3.0, 1e-6
# Segments of a cycle, and the plane at which a cycle without events closes; number of guesses tried.
Guess = tuple[list[Segment], Array]
TRIES = 12
# Signals that are compared in windows of a run, window length in periods, term added to their spread so that quiet
# windows do not come first, fraction of the run before them, number of windows, and guesses from each window.
SIGNALS = ("velocity_B", "normal_force", "slip_velocity")
WINDOW, QUIET, SETTLED, WINDOWS, PAIRS = 4.0, 0.2, 0.3, 40, 3
# Fraction of the time until two motions on either side of an edge separate.
BEFORE = 0.7


def traced(
    flow: Flow, z: Array, status: int, span: float, plane: Array | None = None, about: float | None = None
) -> list[Segment]:
    """Segments from z on, up to EVENTS or a time, s; the last one is incomplete."""
    segments: list[Segment] = []
    t, closest = 0.0, np.inf
    while len(segments) < EVENTS and t < span and closest > CLOSE:
        if (found := flow.to_event(status, z, span - t, plane)) is None:
            break
        segment, status, z = found
        segments.append(segment)
        t += segment.time
        same = [each.start for each in segments[1:] if each.status == status] if about is None else []
        closest = min([float(np.linalg.norm(z - each) / flow.size(z)) for each in same], default=np.inf)
    return [*segments, Segment(status, PLANE, 0.0, z)]


def recurrent(flow: Flow, status: int, z: Array, *, span: float = 0.0, about: float | None = None) -> list[Guess]:
    """Parts of the motion from z that nearly recur, the best first; `about` is an approximate period, s."""
    plane = plane_at(flow, Segment(status, PLANE, 0.0, z))
    span = span or 3.0 * (about or 0.0)
    segments = traced(flow, z, status, span, None, about)
    if len(segments) < 3:
        segments = traced(flow, z, status, span, plane, about)
    starts, times = np.array([each.start for each in segments]), np.cumsum([0.0, *(s.time for s in segments[:-1])])
    spread = np.linalg.norm(starts - starts.mean(axis=0), axis=1).max() + 1e-12 * flow.size(z)
    first, pairs = (1 if len(segments) > 3 else 0), []
    for i in range(first, len(segments)):
        for j in range(i + 1, min(i + MOST, len(segments))):
            same = segments[i].status == segments[j].status and (
                i == 0 or segments[i - 1][:2] == segments[j - 1][:2]
            )
            period = times[j] - times[i]
            if same and period > flow.grid and (about is None or abs(period - about) < 0.3 * about):
                pairs.append((float(np.linalg.norm(starts[j] - starts[i])) / spread, period, i, j))
    pairs.sort()
    if not pairs or pairs[0][0] > RETURNS:
        raise UnsolvedError("limit_cycle: nothing in this motion repeats itself; give another guess")
    near = [pair for pair in pairs if pair[0] <= max(SHORTEST * pairs[0][0], 1e-4)]
    pairs.remove(shortest := min(near, key=lambda pair: pair[1]))
    return [(segments[i:j], plane_at(flow, segments[i])) for _, _, i, j in [shortest, *pairs][:TRIES]]


def guesses_of(scene: Scene, flow: Flow, guess: Any, options: Options, duration: float) -> Iterable[Guess]:
    """Initial guesses from the argument `guess` of `limit_cycle`, the best first."""
    if guess is None:
        return by_run(scene, flow, options, duration)
    if isinstance(guess, State):
        return from_state(flow, guess)
    if isinstance(guess, tuple) and len(guess) == 2 and all(isinstance(each, State) for each in guess):
        return from_state(flow, *on_edge(scene, guess, options, duration))
    if isinstance(guess, (int, float)) and guess > 0.0:
        return of_mode(flow, float(guess))
    text = "it must be a LimitCycle, a State, two of them, an amplitude above 0 (m/s) or None"
    raise InputError(f"guess = {short(guess)}: {text}")


def from_state(flow: Flow, state: Any, about: float | None = None) -> list[Guess]:
    """Guesses from a state of the scene, in its units, with an approximate period, s."""
    span = 1e5 * flow.grid if about is None else 30.0 * about
    return recurrent(flow, *flow.of_state(state), span=span, about=about)


def motion(scene: Scene, duration: float, options: Options) -> Any:
    """A run without `FixedContactWarning`."""
    (found,) = simulate_many([scene], duration, options=options)
    if isinstance(found, Exception):
        raise found
    return found


def by_run(scene: Scene, flow: Flow, options: Options, duration: float) -> Iterator[Guess]:
    """Guesses from the end of a run, unless it is irregular, and from the windows that recur best."""
    given = replace(options, record=SIGNALS, skip_sticks=False)
    run = motion(scene, duration, options=given)
    regime, frequency = run.summary["regime"], float(run.summary["dominant_frequency"])
    if regime not in ("periodic", "irregular", "intermittent") or not np.isfinite(frequency):
        error = NoVibrationError if regime in ("stuck", "steady sliding") else UnsolvedError
        raise error(f"limit_cycle: after {duration:g} s the motion is {regime!r}; give a guess or a duration")
    if regime != "irregular":
        yield from from_state(flow, run.final_state)
    for start, lag in windows(run, frequency):
        state = motion(scene, start, options=replace(given, record=False)).final_state
        try:
            yield from from_state(flow, state, lag)[:PAIRS]
        except UnsolvedError:
            continue


def windows(run: Any, frequency: float) -> list[tuple[float, float]]:
    """Starts of the windows of a run that recur best, and their periods, s."""
    late = run.time > SETTLED * run.time[-1]
    time, rows = run.time[late], np.stack([getattr(run, name)[late] for name in SIGNALS])
    rows = (rows - rows.mean(axis=1, keepdims=True)) / (rows.std(axis=1, keepdims=True) + 1e-300)
    span = 1.0 / (frequency * float(time[1] - time[0]))
    length, found = round(WINDOW * span), []

    def mean(row: Array) -> Array:
        total = np.cumsum(row)
        return np.asarray((total[length:] - total[:-length]) / length)

    spread = np.sum([mean(row**2) - mean(row) ** 2 for row in rows], axis=0) + QUIET
    for lag in range(int(0.7 * span), int(1.4 * span) + 2):
        missed = mean(((rows[:, lag:] - rows[:, :-lag]) ** 2).sum(axis=0))
        missed /= spread[: len(missed)]
        for first in range(0, len(missed), 2 * length):
            k = first + int(np.argmin(missed[first : first + 2 * length]))
            found.append((float(missed[k]), float(time[k]), lag * float(time[1] - time[0])))
    best: dict[int, tuple[float, float]] = {}
    for _, start, period in sorted(found):
        best.setdefault(round(start * frequency / WINDOW), (start, period))
    return list(best.values())[:WINDOWS]


def of_mode(flow: Flow, amplitude: float) -> list[Guess]:
    """Guess from the fastest growing mode of steady sliding, with an amplitude of the velocity of B, m/s."""
    status, z = SLIP_UP, np.eye(len(flow.velocity_B))[-1]
    for _ in range(50):
        field = flow.field(status, z)
        change = np.linalg.lstsq(field[:-1, :-1], (field @ z)[:-1], rcond=1e-14)[0]
        z[:-1] -= change
        if np.linalg.norm(change) <= 1e-12 * flow.size(z):
            break
    values, vectors = np.linalg.eig(flow.field(status, z)[:-1, :-1])
    vibrates = np.flatnonzero(values.imag > 0.0)
    mode = vectors[:, vibrates[np.argmax(values[vibrates].real)]]
    z[:-1] += (amplitude / flow.scene.load * mode / abs(flow.velocity_B[:-1] @ mode)).real
    z[:-1] = (flow.entry(STICK, status, z) @ z)[:-1]
    return recurrent(flow, status, z, span=1e5 * flow.grid)


def on_edge(scene: Scene, ends: tuple[State, State], options: Options, duration: float) -> tuple[State, float]:
    """A state on the basin boundary between the motions from two states, and its period, s."""
    place, change = (np.stack([each.displacement, each.velocity]) for each in ends)
    change, options = change - place, replace(options, settle=0.7 * duration)

    def run(share: float, time: float = duration, **series: Any) -> Any:
        start = State.of(scene, *(place + share * change))
        return motion(scene, time, options=replace(options, initial=start, **series))

    (first, last), low, high = (run(share).summary["velocity_rms"] for share in (0.0, 1.0)), 0.0, 1.0
    if not max(first, last) > 2.0 * min(first, last):
        raise UnsolvedError(f"limit_cycle: both states lead to one motion, of {first:.3g} and {last:.3g} m/s RMS")
    while high - low > 4e-16 * high:
        middle = 0.5 * (low + high)
        nearer = abs(run(middle).summary["velocity_rms"] - first) < abs(first - last) / 2.0
        low, high = (middle, high) if nearer else (low, middle)
    one, other = (run(share, record=("velocity_B",)) for share in (low, high))
    apart = np.abs(one.velocity_B - other.velocity_B) > 1e-2 * np.abs(one.velocity_B).max()
    part = one.time[np.argmax(apart)] if apart.any() else duration
    near = run(low, BEFORE * float(part), settle=0.3 * part)
    return near.final_state, 1.0 / near.summary["dominant_frequency"]
