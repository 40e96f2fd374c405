"""The battery as tables: what came of each case by each method, how near checks came to failing, what failed."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies.stress.case import APART, CAME, DEAR, FAILS, METHODS, PASSES, PENDING
from studies.stress.cases import CASES, GROUPS
from studies.stress.questions import MOST_SECONDS
from studies.tables import Part, Table, apart
from sweeps import DONE, FAILED

# Of a check's bound, what is told in a table rather than called nothing.
LEAST = 1e-3


def findings(dataset: xr.Dataset) -> list[Part]:
    """Tables by group, margins by check, and what failed."""
    outcome = outcomes(dataset)
    parts = (_groups(dataset, outcome), _counts(dataset, outcome), _margins(dataset), _failed(dataset, outcome))
    return apart(parts)


def outcomes(dataset: xr.Dataset) -> NDArray[np.intp]:
    """Of each case and method the place of its outcome in `studies.stress_words.CAME`, (case, method)."""
    status, came = (dataset[name].transpose("case", "method").values for name in ("status", "came"))
    found = np.where(np.isfinite(came.astype(float)), came, FAILS).astype(np.intp)
    found = np.where(status == DONE, found, PENDING)
    return np.asarray(np.where(status == FAILED, FAILS, found), dtype=np.intp)


def worst(dataset: xr.Dataset) -> tuple[NDArray[Any], NDArray[Any]]:
    """The largest margin of each case and method, and the place of its check; cost apart, for it is near none."""
    margin = dataset["margin"].transpose("case", "method", "check").values
    margin = np.where(dataset["check"].values == "cost", np.nan, margin)
    told = np.where(np.isnan(margin), -1.0, margin)
    place = told.argmax(axis=-1)
    return np.take_along_axis(told, place[..., None], -1)[..., 0], place


def _groups(dataset: xr.Dataset, outcome: NDArray[np.intp]) -> list[Part]:
    """A table for each group of cases."""
    names, groups = dataset["case_name"].values, dataset["group"].values
    numbers, methods = dataset["case"].values.astype(int), dataset["method_name"].values
    margin, place = worst(dataset)
    checks = dataset["check"].values
    lines: list[Part] = []
    for group in (each for each in GROUPS if each in groups):
        rows = []
        for k in np.flatnonzero(groups == group):
            cells = []
            for m in range(len(methods)):
                word = CAME[outcome[k, m]]
                told = word == PASSES and margin[k, m] >= LEAST
                cells.append(f"{word}, {checks[place[k, m]]} {margin[k, m]:.2g}" if told else word)
            rows.append([f"{numbers[k]}", names[k], *cells])
        lines += [f"{group}:", Table(["", "case", *methods], rows), ""]
    return lines[:-1]


def _counts(dataset: xr.Dataset, outcome: NDArray[np.intp]) -> list[Part]:
    """How much came of each kind, by method."""
    methods = dataset["method_name"].values
    rows = [
        [word, *(f"{np.count_nonzero(outcome[:, m] == code)}" for m in range(len(methods)))]
        for code, word in enumerate(CAME)
        if np.any(outcome == code)
    ]
    lines: list[Part] = [
        f"{outcome.shape[0]} cases. Refusals are those expected. Beside a pass stands the check that came nearest "
        f"to failing, cost apart, in units of what it may be, from {LEAST:g} on.",
        "",
        Table(["came", *methods], rows),
    ]
    if np.any(outcome == DEAR):
        lines.append(f"Too dear: more than {MOST_SECONDS:g} s on a core that takes 1 ns a mode and step.")
    reasons: dict[str, str] = {}
    for number, m in zip(*np.nonzero(outcome == APART), strict=True):
        case = CASES[int(dataset["case"].values[number]) - 1]
        method = METHODS[int(dataset["method"].values[m])]
        reasons.setdefault(case.apart[method], method)
    lines += [f"Not asked of '{method}': {reason}." for reason, method in reasons.items()]
    return lines


def _margins(dataset: xr.Dataset) -> list[Part]:
    """For each check and method the largest margin, and where."""
    margin = dataset["margin"].transpose("check", "method", "case").values
    methods, names = dataset["method_name"].values, dataset["case_name"].values
    rows, told = [], []
    for c, check in enumerate(dataset["check"].values):
        if not np.isfinite(margin[c]).any():
            continue
        cells = []
        for m in range(len(methods)):
            known = np.where(np.isnan(margin[c, m]), -1.0, margin[c, m])
            k = int(known.argmax())
            where = f" ({names[k]})" if known[k] > 0.0 else ""
            cells.append("-" if known[k] < 0.0 else f"{max(known[k], 0.0):.2g}{where}")
        rows.append([str(check), *cells])
        told.append(f"{check}: {dataset['about'].values[c]}.")
    head = "The largest of each check, in units of what it may be, and where; above 1 it fails."
    return [head, Table(["check", *methods], rows), "", *told] if rows else []


def _failed(dataset: xr.Dataset, outcome: NDArray[np.intp]) -> list[str]:
    """What failed, and by how much."""
    places = np.argwhere(outcome == FAILS)
    if not len(places):
        return ["Nothing failed." if not np.any(outcome == PENDING) else "Nothing has failed so far."]
    lines = [f"{len(places)} failed:"]
    checks = dataset["check"].values
    for k, m in places:
        at = dataset.isel(case=k, method=m)
        value, bound = at["value"].values, at["bound"].values
        wrong = [c for c in range(len(checks)) if np.isfinite(bound[c]) and not value[c] <= bound[c]]
        told = "; ".join(f"{checks[c]}: {value[c]:.3g}, at most {bound[c]:.3g}" for c in wrong)
        error = "" if told else str(at["error"].values)
        who = f"{int(at['case'])} {at['case_name'].item()}, {at['method_name'].item()}"
        lines.append(f"{who}: {told or error}")
    return lines
