"""The battery as a table: outcomes of each group of cases by method, the nearest check, and what failed."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies.stress.cases import CASES, EXPECTED
from studies.tables import Part, Table
from sweeps import DONE, FAILED

# Outcomes of a case. The expected ones: a run that passes every check, or a refusal. Else it fails, or it is not
# asked of the method, or it is skipped. "pending" stands for points that are not computed yet.
OUTCOMES = (*EXPECTED, "fails", "not asked", "skipped as too expensive", "pending")
PASSES, FAILS, NOT_ASKED, EXPENSIVE, PENDING = map(OUTCOMES.index, ("passes", *OUTCOMES[-4:]))

DAMPING = "fast and exact without numerical damping, paper with its own"


def outcomes(dataset: xr.Dataset) -> NDArray[np.intp]:
    """The place in OUTCOMES of each case and method, (case, method)."""
    status, outcome = (dataset[name].transpose("case", "method").values for name in ("status", "outcome"))
    codes = np.where(np.isfinite(outcome.astype(float)), outcome, FAILS).astype(np.intp)
    return np.where(status == FAILED, FAILS, np.where(status == DONE, codes, PENDING))


def worst(dataset: xr.Dataset) -> tuple[NDArray[Any], NDArray[Any]]:
    """The largest margin of each case and method, -1 where there is none, and its check; cost is near none."""
    margin, checks = dataset["margin"].transpose("case", "method", "check").values, dataset["check"].values
    margin = np.where((checks == "cost") | np.isnan(margin), -1.0, margin)
    return margin.max(axis=-1), checks[margin.argmax(axis=-1)]


def findings(dataset: xr.Dataset) -> list[Part]:
    """A table by groups, why some methods are not asked, and what failed."""
    outcome, (margin, check) = outcomes(dataset), worst(dataset)
    groups, methods = dataset["group"].values, [str(name) for name in dataset["method"].values]
    rows = []
    for group in dict.fromkeys(groups):
        mine, cells = np.flatnonzero(groups == group), []
        for m in range(len(methods)):
            words = [f"{n} {OUTCOMES[code]}" for code, n in enumerate(np.bincount(outcome[mine, m])) if n]
            k = mine[np.argmax(np.where(outcome[mine, m] == PASSES, margin[mine, m], -1.0))]
            if outcome[k, m] == PASSES and margin[k, m] >= 0.01:
                words[0] += f" ({check[k, m]} {margin[k, m]:.2g})"
            cells.append(", ".join(words))
        rows.append([str(group), *cells])
    lines = ["", f"Runs: {DAMPING}."]
    lines.append("In brackets: the check that came nearest to failing, cost apart, in units of its bound. Cases:")
    lines.append('fiv query stress --where "margin > 0.5" --show case,method,check,margin,task')
    reasons = {CASES[str(dataset["case"].values[k])].not_asked[methods[m]]: methods[m]
               for k, m in np.argwhere(outcome == NOT_ASKED)}  # fmt: skip
    lines += [f"Not asked of '{method}': {reason}." for reason, method in reasons.items()]
    failed = np.argwhere(outcome == FAILS)
    so_far = " so far" if np.any(outcome == PENDING) else ""
    lines.append(f"{len(failed)} failed{so_far}:" if len(failed) else f"Nothing failed{so_far}.")
    lines += [_failure(dataset.isel(case=k, method=m)) for k, m in failed]
    return [Table(["", *methods], rows, words=1 + len(methods)), *lines]


def _failure(point: xr.Dataset) -> str:
    """By how much a point failed, or with which error."""
    each = zip(point["check"].values, point["value"].values, point["bound"].values, strict=True)
    wrong = [f"{c}: {value:.3g}, at most {bound:.3g}" for c, value, bound in each
             if np.isfinite(bound) and not value <= bound]  # fmt: skip
    return f"{point['case'].item()}, {point['method'].item()}: {'; '.join(wrong) or point['error'].item()}"
