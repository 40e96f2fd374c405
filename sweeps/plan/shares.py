"""Shares of a plan, computed by separate jobs, and their merger into one file."""

import json
from collections.abc import Sequence
from dataclasses import replace
from hashlib import blake2b
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from sweeps.errors import InputError, MissingFileError
from sweeps.grid import PENDING
from sweeps.plan.planning import PlanData
from sweeps.storage.assemble import Table
from sweeps.storage.existing import existing
from sweeps.storage.parts import PartSource
from sweeps.storage.store import Store

Planned = TypeVar("Planned", bound=PlanData)


def computations(plan: PlanData) -> NDArray[np.intp]:
    """The requested computations in the order of the sweep's own grid, independent of the file."""
    points, first = plan.alignment(), plan.manifest.representative
    points = points[plan.requested[points]]
    return points if first is None else np.asarray(pd.unique(first[points]))


def share_of(plan: Planned, number: int, count: int) -> Planned:
    """A plan of every `count`-th computation, from the `number`-th on; see `sweeps.Plan.share`."""
    whole = all(isinstance(each, (int, np.integer)) for each in (number, count))
    if not (whole and 1 <= number <= count):
        raise InputError(f"share = {number!r} of {count!r}: it must be K of N, integers with 1 <= K <= N")
    if plan.store is None:
        raise InputError(f"share {number} of {count}: it needs a store, from which shares are merged")
    if plan.sweep.refinement is not None and plan.sweep.refinement.levels:
        raise InputError(
            "share: a refined sweep has no shares, since its results decide what is computed; run it whole"
        )
    if plan.manifest.fresh or plan.adoption is not None:
        raise InputError("share: only a whole run starts over or adopts; choose another folder for the shares")
    mine, manifest = computations(plan)[number - 1 :: count], plan.manifest
    store = Store(plan.store, (int(number), int(count)))
    due = np.zeros_like(plan.due)
    due[mine] = plan.due[mine]
    todo = int(np.count_nonzero(due))
    parts = [each for each in plan.sources if isinstance(each, PartSource)]
    # Shares of one plan need no agreement to have one token.
    identity = [manifest.attributes["fingerprint"].encode(), json.dumps(manifest.grid.groups).encode()]
    identity += [axis.values.tobytes() for axis in manifest.grid.axes.values()]
    token = blake2b(b"\0".join(identity), digest_size=6).hexdigest()
    return replace(
        plan,
        due=due,
        distinct=len(mine),
        todo=todo,
        cached=len(mine) - todo,
        failed=0,
        seconds=plan.seconds * todo / max(plan.todo, 1),
        manifest=replace(manifest, token=token, earlier=manifest.grids if parts else {}),
        version=(*plan.version, *(each.name for each in parts if each.folder == store.parts)),
        whole=False,
        shared=(number, count),
    )


def merged(plan: Planned, files: Sequence[str | Path]) -> tuple[Planned, str]:
    """A plan without computations for the stored shares; and a sentence on missing ones."""
    if plan.store is None:
        raise InputError("merge: it needs a store, the file into which shares are merged")
    stores, sources, tokens = [Store(plan.store)], [*plan.sources], dict(plan.manifest.earlier)
    for store in (each for each in map(Store, files) if each.file != plan.store):
        for place in (store, *store.shares()):
            if place.is_locked():
                raise place.locked_error()
        there = existing(store, plan.sweep.name, json.loads(plan.manifest.attributes["fingerprint"]))
        stores, sources = [*stores, store], sources + (there.sources if there else [])
        tokens |= there.manifest.grids if there and there.manifest else {}
    shares = {each.share for store in stores for each in store.shares() if each.share}
    if not sources:
        raise MissingFileError(f"{plan.store}: no share of it has computed anything yet")
    manifest = replace(plan.manifest, earlier=tokens)
    table, every = Table(manifest, sources), computations(plan)
    pending = table.status[every] == PENDING
    texts = list[str]()
    for count in sorted({count for _, count in shares}):
        numbers = [str(number) for number in range(1, count + 1) if pending[number - 1 :: count].any()]
        texts.append(f"{', '.join(numbers)} of {count}")
    what = f"missing shares: {'; '.join(texts)}" if texts else "it does not say which shares are missing"
    line = f"{what}; {np.count_nonzero(pending)} of {len(every)} computations are pending"
    kept = tuple(each for each in sources if each.name not in table.damaged)
    plan = replace(plan, manifest=manifest, sources=kept, environments=tuple(table.environments), damaged=())
    return replace(plan, due=np.zeros_like(plan.due), todo=0, whole=False), line * bool(pending.any())
