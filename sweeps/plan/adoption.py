"""Adoption: results of other code become results of the present code if repeated computations agree."""

import secrets
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps.errors import InputError, StoreError
from sweeps.grid import DONE
from sweeps.storage.assemble import Table

# A variable X has its standard error X_se beside it; two values agree within so many combined ones.
ERROR, MOST_ERRORS = "_se", 4.0
# A share of the points, for which a message says how probably a change there would have been found.
SHARE = 0.1


@dataclass(frozen=True)
class Adopt:
    """How stored results are adopted: number of repetitions, seed of the choice, and whether bits must agree.

    Variables in `measured`, such as computing times, depend on the machine and are not compared.
    """

    count: int
    seed: int | None = None
    exact: bool = False
    measured: tuple[str, ...] = ()


@dataclass(frozen=True)
class Adoption:
    """The stored computations that a plan repeats, and their rule."""

    points: NDArray[np.intp]
    stored: int
    rule: Adopt

    def __str__(self) -> str:
        text = f"{len(self.points)} of {self.stored} stored computations are repeated first"
        return f"{text} (seed {self.rule.seed})"


def choose(adopt: Any, table: Table) -> Adoption:
    """Choose one stored computation at random from each of `count` equal stretches of the grid."""
    adopt = adopt if isinstance(adopt, Adopt) else Adopt(adopt)
    count = adopt.count
    if not isinstance(count, (int, np.integer)) or isinstance(count, bool) or count < 1:
        raise InputError(f"adopt = {count!r}: it must be the number of points to compute again, 1 or above")
    stored = np.flatnonzero((table.status == DONE) & ~table.is_copy)
    if not len(stored):
        raise StoreError("adopt: no point is stored that could be computed again")
    seed = secrets.randbelow(1 << 32) if adopt.seed is None else adopt.seed
    ends = np.arange(min(count, len(stored)) + 1) * len(stored) // min(count, len(stored))
    points = stored[np.random.default_rng(seed).integers(ends[:-1], ends[1:])]
    return Adoption(points, len(stored), replace(adopt, seed=seed))


def confirm(adoption: Adoption, before: Table, after: Table) -> str:
    """A sentence on the agreement of repeated with stored computations; a StoreError names one that differs."""
    differing = {name for point in adoption.points.tolist() for name in _compared(adoption, before, after, point)}
    names, count = before.manifest.variables, len(adoption.points)
    errors = {name + ERROR for name in names}
    skipped = sorted(name for name in differing if name + ERROR not in names and name not in errors)
    found = 1.0 if count == adoption.stored else 1.0 - (1.0 - SHARE) ** count
    line = f"{count} of {adoption.stored} computations, repeated with other code, agree "
    line += f"within {MOST_ERRORS:g} standard errors" if differing else "in all bits"
    line += f" (seed {adoption.rule.seed}; a change at {100 * SHARE:g} % of the points would have been found"
    line += f" with a probability of {100.0 * found:.3g} %)"
    return line + (f"; without a standard error, so not compared: {', '.join(skipped)}" if skipped else "")


def _compared(adoption: Adoption, before: Table, after: Table, point: int) -> list[str]:
    """The variables of a computation that differ within their standard errors; else a StoreError."""
    place = ", ".join(f"{k} = {v[0]}" for k, v in before.manifest.grid.points(np.array([point])).items())
    refused = f"the results are not adopted, and nothing has changed: at {place}"
    if after.status[point] != DONE:
        raise StoreError(f"{refused} the computation fails now: {after.reasons()[point].error}")
    names, row = [n for n in before.manifest.variables if n not in adoption.rule.measured], slice(point, point + 1)
    both = {name: [np.asarray(table.values(name, row)[0]) for table in (before, after)] for name in names}
    differ = [name for name, (a, b) in both.items() if not _equal_entries(a, b).all()]
    # A run whose statistics differ, though within their errors, is chaotic: nothing of it has the same bits.
    errors = {name: both[name + ERROR] for name in differ if name + ERROR in names and not adoption.rule.exact}
    for name in differ:
        a, b = both[name]
        if name in errors:
            unit = np.hypot(*errors[name]) + np.finfo(float).tiny
            agree = bool(np.all((np.abs(a - b) <= MOST_ERRORS * unit) | (np.isnan(a) & np.isnan(b))))
        else:
            agree = bool(errors)
        if not agree:
            at = tuple(np.argwhere(~_equal_entries(a, b))[0].tolist())
            far = f", {np.nanmax(np.abs(a - b) / unit):.3g} standard errors apart" if name in errors else ""
            entry = f"{name}[{', '.join(map(str, at))}]" if at else name
            values = f"{a[at].item()!r} there, {b[at].item()!r} with the present code"
            raise StoreError(f"{refused} {entry} = {values}{far}")
    return differ


def changed(names: Iterable[str], before: Table, after: Table) -> str:
    """The first value of some variables whose bits have changed; "" if there is none."""
    grid = before.manifest.grid
    for index in grid.blocks():
        rows = slice(int(index[0]), int(index[-1]) + 1)
        done = before.status[rows] == DONE
        for name in names:
            a, b = (np.asarray(table.values(name, rows)) for table in (before, after))
            same = _equal_entries(a, b).reshape(len(done), -1)
            wrong = done & ~(same.all(axis=1) & (after.status[rows] == DONE))
            if wrong.any():
                row = int(np.argmax(wrong))
                entry = int(np.argmin(same[row]))
                values = [each.reshape(len(done), -1)[row, entry].item() for each in (a, b)]
                place = ", ".join(f"{k} = {v[0]}" for k, v in grid.points(index[row : row + 1]).items())
                return f"at {place} {name} = {values[0]!r} there, {values[1]!r} with the present code"
    return ""


def _equal_entries(a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.bool_]:
    return np.asarray((a == b) | ((a != a) & (b != b)))
