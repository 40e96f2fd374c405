"""Limit cycles: near a run, on the edge between two motions, and along branches over a parameter."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import fivcore
from fivcore import CycleBranch, LimitCycle, Rig, Scene, SceneError, State, Transient, checks, limit_cycle
from studies.declaring.parameters import Parameter, rig_numbers
from studies.motion import following, knock, regimes, run, starts
from studies.motion.jobs import Job, run_all
from studies.physics.phases import SAMPLES, SEPARATION, SERIES
from sweeps import Axis, Variable

FORCES = ("normal_force", "tangential_force", "slip_velocity")
# A run of so many seconds finds a cycle at this d2, s; it is followed from there to that of the rig.
SEARCH, SOUGHT = 1.0, 1.5e-7
# Samples of a cycle that a motion is compared with; it is near up to this share of their deviations.
COMPARED, NEAR = 64, 0.5
# States of a vibration from which the edge is sought in turn.
TRIES = 4
FOLLOWED = "most points over which a limit cycle is followed; 0: none is sought"
SETTINGS = {"most": Parameter(30, "1", FOLLOWED, common=True)}
CYCLE_SERIES = {
    f"cycle_{name}": Variable(each.units, f"{each.long_name}, on the limit cycle", ("phase",), "float32")
    for name, each in SERIES.items()
}
CYCLE = {
    "cycle_frequency": Variable("Hz", "frequency of the limit cycle"),
    "cycle_max_normal_force": Variable("N", "largest normal force on the limit cycle"),
    "cycle_max_slip_speed": Variable("m s-1", "largest slip speed on the limit cycle"),
    "cycle_multiplier": Variable("1", "largest Floquet multiplier of the limit cycle, in magnitude"),
    "cycle_near": Variable("1", "part of the overview, from the first slip on, that is near the limit cycle"),
    "cycle_d2": Variable("s", "d2 nearest to that of the rig to which the limit cycle is followed"),
}
# Settings of the search for a threshold that keep their usual values.
KNOCK = {name: knock.PARAMETERS[name].default for name in ("largest_knock", "resolution")}
# What is kept of each cycle.
KEPT = ("value", "frequency", "rms", "multiplier", "branch")
# Places that are kept, and onsets.
PLACES, ONSETS = 96, 8
BRANCH = {
    "cycle_value": Variable("1", "value of the followed parameter, in its units", ("number",)),
    "cycle_branch": Variable("1", "number of the branch", ("number",)),
    "cycle_frequency": Variable("Hz", "frequency of the limit cycle", ("number",), digits=9),
    "cycle_rms": Variable("m s-1", "RMS of the velocity of B on the limit cycle", ("number",), digits=9),
    "cycle_multiplier": Variable("1", "largest Floquet multiplier, in magnitude", ("number",), digits=9),
}
PLACE = {
    "place_value": Variable("1", "value of the followed parameter where a branch changes", ("place",)),
    "place_text": Variable("1", "what happens there", ("place",), "str"),
    "place_number": Variable("1", "index of the cycle there", ("place",)),
}
BRANCHES = {n: v for n, v in following.OUTPUTS.items() if n not in ("extremum", "mapping_error")} | {
    **{n: replace(v, dims=("followed",), scale="") for n, v in knock.OUTPUTS.items()},
    **BRANCH, **PLACE,
    "onset_value": Variable("1", "onset of flutter of steady sliding", ("onset",)),
}  # fmt: skip


def followed(scene: Scene, cutoff: float | None, most: int) -> tuple[LimitCycle | None, float]:
    """The limit cycle of a scene, or None, and the d2 to which it was followed.

    The search starts from a run without long sticks; of beams, from one at d2 = SOUGHT, where runs are nearest to
    periodic.
    """
    own = getattr(scene.rig, "d2", np.nan)
    first = replace(scene, rig=replace(scene.rig, d2=SOUGHT)) if isinstance(scene.rig, Rig) else scene
    duration = SEARCH * scene.rig.time_scale
    try:
        (motion,) = run_all([Job(first, duration, {"cutoff": cutoff})])
        if isinstance(motion, SceneError) or motion.summary["regime"] not in regimes.WITHOUT_STICKS:
            return None, np.nan
        cycle = limit_cycle(first, duration=duration, cutoff=cutoff)
        if own == SOUGHT or not np.isfinite(own):
            return cycle, own
        branch = fivcore.follow_cycle(cycle, "d2", own, most=most)
        nearest = int(np.abs(branch.values - own).argmin())
        if not branch.values.min() <= own <= branch.values.max():
            return None, float(branch.values[nearest])
        return limit_cycle(scene, branch.cycles[nearest]), own
    except (fivcore.UnsolvedError, SceneError):
        return None, np.nan


def on_edge(scene: Scene, ends: Sequence[State] | None, hold: float, model: dict[str, Any]) -> LimitCycle | None:
    """The cycle on the edge between vibration and sliding, or the cycle of a run; None if none is found.

    The edge between sliding and a state of the vibration may be hard to reach, so further states are tried in
    turn.
    """
    for _ in range(TRIES if ends else 1):
        try:
            if ends:
                (motion,) = run_all([Job(scene, 2.0 * hold, {"initial": ends[0], **model})])
                if isinstance(motion, SceneError) or motion.final_state is None:
                    return None
                ends = [motion.final_state, ends[1]]
            return limit_cycle(scene, ends and (ends[0], ends[1]), duration=2.0 * hold, **model)
        except (fivcore.UnsolvedError, SceneError):
            continue
    return None


def values(
    scene: Scene, motion: Transient, most: int, numerical_damping: str, cutoff: float | None
) -> dict[str, Any]:
    """CYCLE and CYCLE_SERIES of a scene, from the longest stick on; NaN without a cycle."""
    damped = replace(scene, rig=fivcore.with_numerical_damping(scene.rig, run.METHOD, numerical_damping))
    cycle, d2 = followed(damped, cutoff, most) if most else (None, np.nan)
    values: dict[str, Any] = dict.fromkeys(CYCLE, np.nan) | {"cycle_d2": d2}
    if cycle is None:
        return values | {name: np.full(SAMPLES, np.nan) for name in CYCLE_SERIES}
    begins = np.cumsum([0.0, *(time for _, time in cycle.states)])
    stick = max(range(len(cycle.states)), key=lambda k: (cycle.states[k][0] == "stick", cycle.states[k][1]))
    time = (begins[stick] + cycle.period * np.arange(SAMPLES) / SAMPLES) % cycle.period
    N, T, slip = (np.interp(time, cycle.time, getattr(cycle, name)) for name in FORCES)
    state = cycle.state[np.searchsorted(cycle.time, time, side="right") - 1]
    ratio = np.divide(T, N, out=np.zeros_like(N), where=state != SEPARATION)
    moved = np.cumsum(slip) * cycle.period / SAMPLES
    summary = {name: cycle.summary[name.removeprefix("cycle_")] for name in list(CYCLE)[:3]}
    summary |= {"cycle_multiplier": cycle.summary["largest_multiplier"], "cycle_near": near(motion, cycle)}
    return values | summary | dict(zip(CYCLE_SERIES, (N, ratio, slip, moved - moved[0], state), strict=True))


def near(motion: Transient, cycle: LimitCycle) -> float:
    """Fraction of time in which a motion is near a cycle.

    A period is near it if normal force and velocity of B differ from the cycle's, at the best phase, by less than
    NEAR of their standard deviations on the cycle (root mean square).
    """
    step, names = cycle.period / COMPARED, ("normal_force", "velocity_B")
    times = np.arange(motion.summary["first_slip_time"], motion.time[-1], step)
    moved = np.stack([np.interp(times, motion.time, getattr(motion, name)) for name in names])
    one = np.stack([np.interp(step * np.arange(COMPARED), cycle.time, getattr(cycle, name)) for name in names])
    middle, spread = one.mean(axis=1, keepdims=True), one.std(axis=1, keepdims=True)
    one = (one - middle) / spread
    parts = np.lib.stride_tricks.sliding_window_view((moved - middle) / spread, COMPARED, axis=1)
    parts = parts[:, :: COMPARED // 8]
    # Products of each part with the cycle at all phases.
    products = np.fft.irfft(np.fft.rfft(parts) * np.fft.rfft(one).conj()[:, None], COMPARED).sum(axis=0)
    squares = (parts**2).sum(axis=(0, 2)) + (one**2).sum() - 2.0 * products.max(axis=-1)
    return float(np.mean(squares < NEAR**2 * len(names) * COMPARED))


def of_chain(
    chain: Sequence[Scene], regime: Any, name: str, hold: float, most: int, edges: int, how: dict[str, Any]
) -> dict[str, Any]:
    """Thresholds and branches, from the edge between two stable motions and from a periodic vibration."""
    model = {key: how[key] for key in ("cutoff", "numerical_damping")}
    ends, vibrates = [value_of(chain[k], name) for k in (0, -1)], regimes.is_of(regime, *regimes.VIBRATING)
    both, periodic = vibrates[:, 1] != vibrates[:, 0], regimes.is_of(regime, "periodic")[:, 0]
    thresholds = {key: np.full(len(chain), np.nan) for key in knock.OUTPUTS}
    tried: list[tuple[int, Any]] = []
    for k in spread(np.flatnonzero(both), edges):
        scene, options = chain[k], model | {"duration": None, "step": None}
        for key, value in knock.threshold(scene, KNOCK["largest_knock"], KNOCK["resolution"], options).items():
            thresholds[key][k] = value
        if np.isfinite(hit := thresholds["knock_threshold"][k]):
            tried.append((k, starts.knocked(scene, 1.5 * hit, 0.0)))
    usual = periodic if periodic.any() or tried else vibrates[:, 0]
    tried += [(k, None) for k in spread(np.flatnonzero(usual), 1)]
    branches, places = list[Any](), list[tuple[float, str, int]]()
    for k, guess in tried:
        at = value_of(chain[k], name)
        # A branch that passes here already, of stable cycles in the case of a run, is this one.
        if any(passes(branch, at, guess is None) for branch in branches):
            continue
        cycle = on_edge(chain[k], guess, hold, model)
        if cycle is None:
            continue
        (back, before), (forth, after) = (side(cycle, name, at, end, most) for end in ends)
        first = sum(map(len, branches)) + len(before) - 1
        places += [(value, text, first - index) for value, text, index in places_of(back, ends)]
        places += [(value, text, first + index) for value, text, index in places_of(forth, ends)]
        branches.append(np.array([*before[::-1], *after[1:]]))
    rows = [np.column_stack([branch, np.full(len(branch), j + 1.0)]) for j, branch in enumerate(branches)]
    table = np.vstack([*rows, np.full(((edges + 1) * 2 * most - sum(map(len, rows)), 5), np.nan)])
    padded = [*sorted(places), *[(np.nan, "", np.nan)] * PLACES][:PLACES]
    onsets = np.full(ONSETS, np.nan)
    if name in ("mu", "V", "F"):
        crossed = fivcore.sliding_onsets(chain[0], name, max(ends[0], 1e-12), ends[1], run.BAND)
        rising = crossed.value[crossed.change > 0][:ONSETS]
        onsets[: len(rising)] = rising
    kept = {f"cycle_{key}": column for key, column in zip(KEPT, table.T, strict=True)}
    columns = zip(PLACE, "fOf", zip(*padded, strict=True), strict=True)
    kept |= {key: np.array(column, dtype=kind) for key, kind, column in columns}
    return thresholds | kept | {"onset_value": onsets}


def places_of(branch: CycleBranch, ends: Sequence[float]) -> Iterator[tuple[float, str, int]]:
    """Special points of a branch, the index of the cycle at each, and why the branch ends in the range."""
    values, k = np.asarray(branch.values), 0
    for value, text in branch.places:
        across = np.flatnonzero((values[k + 1 :] - value) * (values[k:-1] - value) <= 0.0)
        k += int(np.abs(values[k:] - value).argmin() if text == "fold" or not len(across) else across[0])
        yield float(value), text, k
    if min(ends) < values[-1] < max(ends) and not branch.end.startswith(("birth", branch.parameter)):
        reason = re.sub(rf" (at|beyond) {branch.parameter} = [^\s,]+", "", branch.end)
        yield float(values[-1]), f"end: {reason}", len(values) - 1


def value_of(scene: Scene, name: str) -> float:
    """The value of a parameter of a scene."""
    numbers = rig_numbers(scene.rig) if isinstance(scene.rig, Rig) else {}
    return float((vars(scene) | vars(scene.friction) | numbers)[name])


def spread(places: Any, count: int) -> list[int]:
    """At most `count` of the indices, evenly selected."""
    shares = np.linspace(0.0, len(places) - 1.0, count + 2)[1:-1] if len(places) else ()
    return [*dict.fromkeys(int(places[round(share)]) for share in shares)]


def side(cycle: LimitCycle, name: str, at: float, end: float, most: int) -> tuple[CycleBranch, list[Any]]:
    """One side of a branch: parameter, frequency, RMS and largest multiplier of its cycles."""
    branch = CycleBranch(name, np.array([at]), [cycle], [], name)
    if end != at:
        branch = fivcore.follow_cycle(cycle, name, end, most=most)
    kept = [
        (float(value), one.frequency, one.summary["velocity_rms"], one.summary["largest_multiplier"])
        for value, one in zip(branch.values, branch.cycles, strict=True)
    ]
    return branch, kept


def passes(branch: Any, value: float, stable: bool) -> bool:
    """Whether a branch passes a value of the parameter; with `stable`, whether it does so with a stable cycle."""
    across = (branch[1:, 0] - value) * (branch[:-1, 0] - value) <= 0.0
    return bool(np.any(across & (branch[1:, 3] < 1.0) if stable else across))


def coords(most: int, edges: int) -> dict[str, Axis]:
    """The dimensions of branches, their special points, and onsets."""
    checks.count("most", most, 1000)
    checks.count("edges", edges, 20)
    sizes = {"number": (edges + 1) * 2 * most, "place": PLACES, "onset": ONSETS}
    axes = {name: Axis(np.arange(1, size + 1), "1", f"number of a {name}") for name, size in sizes.items()}
    return {"direction": following.COORDS["direction"]} | axes
