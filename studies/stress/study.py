"""A battery that tries to break each method: the tasks, the outcomes, and how near each check was to failing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fivcore import ContactError, DivergenceError
from studies.motion import transients
from studies.stress.ask import not_stated, question_of
from studies.stress.cases import CASES, EXPECTED, METHODS, PASSES, TOO_EXPENSIVE, Case
from studies.stress.checks import CHECKS, judged
from studies.stress.findings import DAMPING, EXPENSIVE, FAILS, NOT_ASKED, OUTCOMES, findings
from studies.stress.runs import gathered
from studies.study import Study, deferred
from sweeps import Axis, Variable

TITLE = "What each method does under stress"
PASSED = "whether the outcome is the expected one, and every check passed"
VARIABLES = {
    "outcome": Variable("1", "outcome", (), "int8", flags=dict(enumerate(OUTCOMES[:-1]))),
    "passed": Variable("1", PASSED, (), "int8", flags={0: "no", 1: "yes"}),
    "value": Variable("1", "value of each check", ("check",)),
    "bound": Variable("1", "largest allowed value of each check", ("check",)),
}
NOTHING = np.full(len(CHECKS), np.nan)
Answer = tuple[int, int, NDArray[Any], NDArray[Any]]


def battery(points: Mapping[str, Any]) -> dict[str, Any]:
    """Put each case to its method."""
    pairs = zip(points["case"].tolist(), points["method"].tolist(), strict=True)
    rows = [put(CASES[case], method) for case, method in pairs]
    return dict(zip(VARIABLES, map(list, zip(*rows, strict=True)), strict=True))


def put(case: Case, method: str) -> Answer:
    """Put a case to a method: its outcome, whether it passed, and value and bound of each check.

    Raises AssertionError if the method refused what it should do, or did what it should refuse.
    """
    expected = case.expectation(method)
    if method in case.not_asked or method in TOO_EXPENSIVE.get(case.name, ()):
        return NOT_ASKED if method in case.not_asked else EXPENSIVE, 1, NOTHING, NOTHING
    question, value = question_of(case, method)
    if expected == PASSES:
        try:
            results = judged(gathered(question, case.copy))
        except (ValueError, ContactError, DivergenceError) as refusal:
            raise AssertionError(f"{case.name}, {method}: {type(refusal).__name__}: {refusal}") from refusal
    else:
        results = {"message": (not_stated(case, question, value, expected), 0.0)}
    values, bounds = np.array([results.get(name, (np.nan, np.nan)) for name in CHECKS]).T
    good = all(value <= bound for value, bound in results.values())
    return EXPECTED.index(expected) if good else FAILS, int(good), values, bounds


def described(dataset: xr.Dataset) -> xr.Dataset:
    """Add the task, the expected outcome, and the margin of each check: its value over its bound."""
    cases = [CASES[str(name)] for name in dataset["case"].values]
    expected = [[EXPECTED.index(case.expectation(str(m))) for m in dataset["method"].values] for case in cases]
    value, bound = dataset["value"].values, dataset["bound"].values
    with np.errstate(divide="ignore", invalid="ignore"):
        # Where nothing is allowed, anything is infinitely much.
        margin = np.where((bound == 0.0) & (value == 0.0), 0.0, value / bound)
    about = {"units": "1", "long_name": "value of each check over its bound; above 1 it fails"}
    codes, point = np.array(expected, dtype=np.int8), ("case", "method")
    dataset = dataset.assign(
        group=("case", [case.group for case in cases], {"long_name": "group of the case"}),
        task=("case", [case.asks for case in cases], {"long_name": "task"}),
        about=("check", list(CHECKS.values()), {"long_name": "quantity of the check"}),
        expected=(point, codes, {"long_name": "expected outcome where the case is asked of the method"}),
        margin=((*point, "check"), margin, about),
    )
    return transients.with_flags(dataset, expected=EXPECTED)


STUDY = Study(
    name="stress",
    title=TITLE,
    question="Does each method do what it should at and beyond physical limits, and refuse what it cannot do?",
    paper="Section 3.3 gives the step and the constants of the published scheme, from which its limits follow; no "
    "such test is in the paper.",
    axes={"case": Axis(list(CASES), long_name="case"), "method": Axis(METHODS, long_name=f"method: {DAMPING}")},
    settings={},
    function=battery,
    variables=VARIABLES,
    coords={"check": Axis(list(CHECKS), long_name="check")},
    derive=described,
    draw=deferred("studies.stress.figure:draw"),
    findings=findings,
)
