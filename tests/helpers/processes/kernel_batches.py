"""Batches of 1 to 33 scenes of mixed rigs beside each scene alone, in a process that may die of it.

python -m tests.helpers.processes.kernel_batches guarded stability fast

computes all batches of some of PARTS, with all arrays of kernels laid against guard pages ("guarded") or every
index checked ("checked", where NUMBA_BOUNDSCHECK is 1). It prints for each part how many batches there were, which
states the contact had, how many scenes had errors, and which kernels were called how often. It ends at the first
bit that differs.
"""

from __future__ import annotations

import faulthandler
import json
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest

from fivcore import (
    Rig,
    Scene,
    flutter_onsets,
    flutter_onsets_many,
    glued_frequencies,
    simulate_many,
    sliding_modes,
)
from fivcore.jit import inlined, kernel
from fivcore.stability.secular import sliding_problem
from tests.helpers.processes.guards import all_guarded
from tests.helpers.rigs import workshop_rig
from tests.helpers.runs import assert_same_run

MOST = 33
# 7 to 30 elements of P1, 5 to 90 of P2, 15 to 46 modes kept, and three or four times as many at the onset.
RIGS = [Rig(), *(workshop_rig(seed) for seed in (0, 1, 5, 6, 8, 9)), Rig(contact_position=0.065)]
# Numbers at the ends of what is documented, or next to them.
ENDS = [
    Rig.of(p1_elements=1, p2_elements=1),
    Rig(head_mass=0.0, d1=0.0, d2=0.0),
    Rig(head_mass=1e15),
    Rig(d1=1e6),
    Rig(contact_position=0.15, point_b=1.0),
    Rig.of(p1_elements=40, p2_elements=1, head_mass=5e-324),
]
# V is one of RATIOS times F, m/s per N.
RATIOS, LOADS, FRICTIONS = [1e-12, 1e-3, 1.0, 1e8], [1e-87, 9.0, 1e91], [0.0, 5e-324, 0.2, 2.0, 1e6]


def mixed(place: int) -> Scene:
    """One of MOST scenes, from slow to fast; the next one has another rig."""
    return Scene(
        V=10.0 ** (-3.0 + 2.7 * ((7 * place) % MOST) / MOST),
        theta=[5.0, -5.0, 12.0][place % 3],
        mu=0.05 + 0.3 * ((5 * place) % MOST) / MOST,
        F=[9.0, 2.0][place % 2],
        rig=RIGS[place % len(RIGS)],
    )


def extreme(place: int) -> Scene:
    """One of MOST scenes whose numbers are as small or as large as they may be."""
    rig, theta = ENDS[place % len(ENDS)], [5.0, -89.9, 0.0, 89.9][place // 2 % 4]
    ratio, load = RATIOS[place % len(RATIOS)], LOADS[place // 3 % len(LOADS)]
    return Scene(ratio * load, theta, FRICTIONS[place % len(FRICTIONS)], load, rig)


RECORDED = {"record": True, "sample_rate": 200e3, "settle": 0.0, "min_stick": 1e-5}
ABRUPT = RECORDED | {"ramp": 0.0}
# Of each part of the motions: its scenes, the shortest duration and by how much the next is longer, s, options.
MOTIONS: dict[str, tuple[Callable[[int], Scene], float, float, dict[str, Any]]] = {
    "fast": (mixed, 0.012, 1e-4, RECORDED),
    "fast, extreme": (extreme, 2e-3, 1e-5, RECORDED),
    "fast, no element": (mixed, 4e-3, 1e-4, ABRUPT | {"termination": "none"}),
    "fast, moving contact": (mixed, 3e-4, 5e-6, ABRUPT | {"contact_motion": 1}),
    "exact": (mixed, 5e-5, 2e-6, ABRUPT | {"method": "exact"}),
    "paper": (mixed, 2e-4, 2e-6, ABRUPT | {"method": "paper"}),
    "paper, moving contact": (mixed, 1e-4, 1e-6, ABRUPT | {"method": "paper", "contact_motion": 1}),
}
PARTS = ["stability", *MOTIONS]


def batches() -> list[list[int]]:
    """Scenes of each batch, by their places: of every number from 1 to MOST, each with others in front."""
    return [[(place + count) % MOST for place in range(count)] for count in range(1, MOST + 1)]


def motions(part: str, guard: Any) -> dict[str, Any]:
    """Batches of scenes in motion."""
    scene, shortest, longer, given = MOTIONS[part]
    durations = [shortest + longer * place for place in range(MOST)]
    alone = [simulate_many([scene(place)], durations[place], **given)[0] for place in range(MOST)]
    for places in batches():
        with guard():
            runs = simulate_many([scene(k) for k in places], [durations[k] for k in places], **given)
        for k, run in zip(places, runs, strict=True):
            one = alone[k]
            if isinstance(one, Exception) or isinstance(run, Exception):
                assert (type(one), str(one)) == (type(run), str(run))
            else:
                assert_same_run(run, one)
    moved = [run for run in alone if not isinstance(run, Exception)]
    states = sorted({int(state) for run in moved for state in run.state})
    return {"states": states, "errors": len(alone) - len(moved)}


def same(one: Any, other: Any) -> None:
    """Fail unless rows of numbers have the same bits, but for numbers missing at the end."""
    one, other = (np.asarray(row)[~np.isnan(row)] for row in (one, other))
    assert one.tobytes() == other.tobytes(), (one, other)


def numbers_of(place: int) -> dict[str, float]:
    """Numbers of a rig for `flutter_onsets_many`."""
    share = place / MOST
    return {"theta": -60.0 + 120.0 * share, "p1_length": 0.04 + 0.03 * share, "head_mass": 5.0 * share}


def stability(guard: Any) -> dict[str, Any]:
    """Batches of points of stability: of one rig where a function takes one, and of many."""
    for places in batches():
        rig, count = RIGS[len(places) % len(RIGS)], len(places)
        theta, mu = (np.array([getattr(mixed(k), name) for k in places]) for name in ("theta", "mu"))
        # Two of them are friction that is none and friction beyond what there is.
        mu[[0, -1]] = 0.0, 10.0
        many = [numbers_of(k) for k in places]
        table = {name: [row[name] for row in many] for name in many[0]}

        def computed(theta: Any, mu: Any, table: Any, modes: int, rig: Rig = rig) -> list[Any]:
            one = sliding_modes(rig, theta, mu, 8e3)
            onsets = flutter_onsets_many(table, rig=rig)
            found = flutter_onsets(rig, np.ravel(theta)[0], 8e3)
            glued = glued_frequencies(rig, np.ravel(theta)[0], modes)
            return [one.frequency, one.growth_rate, onsets.mu, onsets.recovery_mu, found.mu, glued]

        alone = [computed(theta[k], mu[k], many[k], 1) for k in range(count)]
        sliding_problem.cache_clear()
        with guard():
            *rows, onsets, glued = computed(theta, mu, table, count)
        for k, (*own, _, _) in enumerate(alone):
            for row, value in zip(rows, own, strict=True):
                same(row[k], np.ravel(value))
        same(onsets, alone[0][4])
        same(glued[0], alone[0][5])
    return {}


@inlined
def read(x: Any, place: int) -> float:
    """A number of an array, or one that is not in it."""
    return x[place]


@kernel
def direct(x: Any, place: int) -> float:
    """The same by a kernel."""
    return x[place]


@kernel
def indirect(x: Any, place: int) -> float:
    """The same by a function within a kernel."""
    return read(x, place)


def prove_checks() -> None:
    """Fail unless an index that is none raises an error, as the kernels of the solver are compiled here."""
    for function in (direct, indirect):
        assert function(np.zeros(3), 2) == 0.0
        with pytest.raises(IndexError):
            function(np.zeros(3), 3)


def main(how: str, *parts: str) -> None:
    """Compute the parts and print what was done, a line each."""
    faulthandler.enable()
    if how == "checked":
        prove_checks()
    for part in parts:
        calls: Counter[str] = Counter()
        with pytest.MonkeyPatch.context() as patch:

            def guard(patch: Any = patch, calls: Counter[str] = calls) -> Any:
                return all_guarded(patch, calls) if how == "guarded" else nullcontext()

            told = stability(guard) if part == "stability" else motions(part, guard)
        print(json.dumps({"part": part, "batches": len(batches()), "calls": calls, **told}), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
