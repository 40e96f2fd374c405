"""A battery that tries to break each method: what was asked, what came, and how near each check was to failing."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fivcore import ContactError, DivergenceError
from studies.motion import transients
from studies.stress.case import APART, CAME, DEAR, EXPECTATIONS, FAILS, METHODS, PASSES, Case
from studies.stress.cases import CASES
from studies.stress.checks import CHECKS, judged, passes
from studies.stress.figure import draw
from studies.stress.findings import findings
from studies.stress.questions import question_of, too_dear
from studies.stress.refusals import missing
from studies.stress.runs import gathered, original_of
from studies.study import Study
from sweeps import Axis, Grid, Sweep, Variable

VARIABLES = {
    "came": Variable("1", "what came", (), "int8", flags=dict(enumerate(CAME[:-1]))),
    "passed": Variable(
        "1",
        "whether what came is what was expected, and every check passed",
        (),
        "int8",
        flags={0: "no", 1: "yes"},
    ),
    "value": Variable("1", "what each check found", ("check",)),
    "bound": Variable("1", "what it may be", ("check",)),
}


class UnexpectedError(AssertionError):
    """What a method did that it should not have done, of which there are no numbers."""


def battery(points: Mapping[str, Any]) -> dict[str, Any]:
    """Put each case to its method."""
    every = list(zip(points["case"].tolist(), points["method"].tolist(), strict=True))
    found: list[tuple[int, int, NDArray[Any], NDArray[Any]]] = []
    errors: list[Exception | None] = []
    taken = np.zeros(len(every))
    nothing = np.full(len(CHECKS), np.nan)
    for k, (case, method) in enumerate(every):
        start = time.perf_counter()
        try:
            found.append(put(CASES[case - 1], METHODS[method]))
            errors.append(None)
        except Exception as problem:  # whatever it is, it is the method's failure
            if len(every) == 1:
                raise
            found.append((FAILS, 0, nothing, nothing))
            errors.append(problem)
        taken[k] = time.perf_counter() - start
    columns = [np.array(column) for column in zip(*found, strict=True)]
    return dict(zip(VARIABLES, columns, strict=True)) | {"error": errors, "wall_time": taken}


def put(case: Case, method: str) -> tuple[int, int, NDArray[Any], NDArray[Any]]:
    """Put a case to a method: what came, whether it passed, and value and bound of each check.

    Raises
    ------
    UnexpectedError
        If it refused what it should do or did what it should refuse; any other error passes through.
    """
    values, bounds = np.full((2, len(CHECKS)), np.nan)
    if method in case.apart:
        return APART, 1, values, bounds
    expected = case.expectation(method)
    question, asked = question_of(case, method)
    if expected == PASSES:
        if too_dear(question):
            return DEAR, 1, values, bounds
        try:
            found = judged(gathered(question, original_of(case, question)))
        except (ValueError, ContactError, DivergenceError) as refusal:
            raise UnexpectedError(f"{case.name}, {method}: {type(refusal).__name__}: {refusal}") from refusal
    else:
        found = {"message": (missing(case, question, asked, expected), 0.0)}
    for k, name in enumerate(CHECKS):
        values[k], bounds[k] = found.get(name, (np.nan, np.nan))
    good = all(passes(*each) for each in found.values())
    return EXPECTATIONS.index(expected) if good else FAILS, int(good), values, bounds


def labelled(dataset: xr.Dataset) -> xr.Dataset:
    """Say in words what the numbers of cases, methods and outcomes stand for, and what was asked and expected."""
    cases = [CASES[int(number) - 1] for number in dataset["case"].values]
    methods = [METHODS[int(number)] for number in dataset["method"].values]
    words = {
        "case_name": ("case", [case.name for case in cases], "name of the case"),
        "group": ("case", [case.group for case in cases], "group of the case"),
        "asked": ("case", [case.asks for case in cases], "what is asked"),
        "method_name": ("method", methods, "name of the method"),
        "about": ("check", [about for _, about in CHECKS.values()], "what the check finds"),
    }
    for name, (dim, texts, long_name) in words.items():
        dataset[name] = (dim, np.array(texts), {"long_name": long_name})
    expected = [[EXPECTATIONS.index(case.expectation(method)) for method in methods] for case in cases]
    about = {"long_name": "what is expected where it is asked"}
    dataset["expected"] = (("case", "method"), np.array(expected, dtype=np.int8), about)
    value, bound = dataset["value"].values, dataset["bound"].values
    with np.errstate(divide="ignore", invalid="ignore"):
        # Where nothing is allowed, anything is infinitely much.
        margin = np.where((bound == 0.0) & (value == 0.0), 0.0, value / bound)
    about = {"units": "1", "long_name": "what each check found in units of what it may be; above 1 it fails"}
    dataset["margin"] = (dataset["value"].dims, margin, about)
    return transients.with_flags(dataset, expected=EXPECTATIONS)


def build(axes: Mapping[str, Axis], settings: Mapping[str, float]) -> Sweep:
    """The sweep over cases and methods.

    Raises
    ------
    ValueError
        For a number that no case or method has.
    """
    for name, low, high in (("case", 1, len(CASES)), ("method", 0, len(METHODS) - 1)):
        for value in axes[name].values:
            if not low <= value <= high:
                raise ValueError(
                    f"{name} = {value}: it must be from {low} to {high}; fiv list stress tells which is which"
                )
    return Sweep(
        "stress",
        battery,
        Grid({name: axes[name] for name in ("case", "method")}),
        VARIABLES,
        coords={"check": Axis(np.array(list(CHECKS)), long_name="check")},
        title="What each method does under stress",
        derive=labelled,
    )


def _listed() -> str:
    """Numbers of the cases, by group, for a reader who wants some of them."""
    first: dict[str, list[int]] = {}
    for number, case in enumerate(CASES, 1):
        first.setdefault(case.group, []).append(number)
    return ", ".join(f"{group} {min(numbers)} to {max(numbers)}" for group, numbers in first.items())


STUDY = Study(
    name="stress",
    title="What each method does under stress",
    question="Does each method do what it should at and past the edges of sense, and refuse what it cannot do?",
    paper="Section 3.3 gives the step and the constants of the published scheme, from which its limits follow; no "
    "such test is in the paper.",
    axes={
        "case": Axis(np.arange(1, len(CASES) + 1), "1", f"case, by its number in case_name: {_listed()}"),
        "method": Axis(np.arange(len(METHODS)), "1", "method, by its number in method_name"),
    },
    settings={},
    build=build,
    draw=draw,
    findings=findings,
)
