"""Branches of limit cycles over a parameter, from the edge between two motions and from a vibration."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fivcore import CycleBranch, LimitCycle, Rig, Scene, checks, follow_cycle, sliding_onsets
from studies.declaring.parameters import rig_numbers
from studies.motion import following, knock, regimes, run, starts
from studies.physics.cycles import on_edge
from sweeps import Axis, Variable

# Settings of the search for a threshold that keep their usual values.
KNOCK = {name: knock.PARAMETERS[name].default for name in ("largest_knock", "resolution")}
# What is kept of each cycle.
KEPT = ("value", "frequency", "rms", "multiplier", "branch")
# Places that are kept, and onsets.
PLACES, ONSETS = 96, 8
CYCLE = {
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
OUTPUTS = {n: v for n, v in following.OUTPUTS.items() if n not in ("extremum", "mapping_error")} | {
    **{n: replace(v, dims=("followed",), scale="") for n, v in knock.OUTPUTS.items()},
    **CYCLE, **PLACE,
    "onset_value": Variable("1", "onset of flutter of steady sliding", ("onset",)),
}  # fmt: skip


def of_chain(
    chain: Sequence[Scene], regime: Any, name: str, hold: float, most: int, edges: int, how: dict[str, Any]
) -> dict[str, Any]:
    """Thresholds and branches, from the edge where two motions are stable, and from a periodic vibration."""
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
        crossed = sliding_onsets(chain[0], name, max(ends[0], 1e-12), ends[1], run.BAND)
        rising = crossed.value[crossed.change > 0][:ONSETS]
        onsets[: len(rising)] = rising
    kept = {f"cycle_{key}": column for key, column in zip(KEPT, table.T, strict=True)}
    columns = zip(PLACE, "fOf", zip(*padded, strict=True), strict=True)
    kept |= {key: np.array(column, dtype=kind) for key, kind, column in columns}
    return thresholds | kept | {"onset_value": onsets}


def places_of(branch: CycleBranch, ends: Sequence[float]) -> Iterator[tuple[float, str, int]]:
    """Places on a branch with the index of the cycle there, and why it ends within the range."""
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
    """At most `count` of the places, evenly within them."""
    shares = np.linspace(0.0, len(places) - 1.0, count + 2)[1:-1] if len(places) else ()
    return [*dict.fromkeys(int(places[round(share)]) for share in shares)]


def side(cycle: LimitCycle, name: str, at: float, end: float, most: int) -> tuple[CycleBranch, list[Any]]:
    """The branch to one side and what is kept of its cycles: parameter, frequency, RMS and largest multiplier."""
    branch = CycleBranch(name, np.array([at]), [cycle], [], name)
    if end != at:
        branch = follow_cycle(cycle, name, end, most=most)
    kept = [
        (float(value), one.frequency, one.summary["velocity_rms"], one.summary["largest_multiplier"])
        for value, one in zip(branch.values, branch.cycles, strict=True)
    ]
    return branch, kept


def passes(branch: Any, value: float, stable: bool) -> bool:
    """Whether a branch passes a value of the parameter, or with `stable` does so with a stable cycle."""
    across = (branch[1:, 0] - value) * (branch[:-1, 0] - value) <= 0.0
    return bool(np.any(across & (branch[1:, 3] < 1.0) if stable else across))


def coords(most: int, edges: int) -> dict[str, Axis]:
    """The dimensions of branches, of places and of onsets."""
    checks.count("most", most, 1000)
    checks.count("edges", edges, 20)
    sizes = {"number": (edges + 1) * 2 * most, "place": PLACES, "onset": ONSETS}
    axes = {name: Axis(np.arange(1, size + 1), "1", f"number of a {name}") for name, size in sizes.items()}
    return {"direction": following.COORDS["direction"]} | axes
