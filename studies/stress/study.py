"""A battery of hard cases for each method: tasks, outcomes, and margins of the checks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import ContactError, DivergenceError
from studies.declaring.parameters import Parameter
from studies.plotting import figures
from studies.stress.cases import CASES, EXPECTED, METHODS, PASSES, TOO_EXPENSIVE, Case
from studies.stress.checks import CHECKS, collect, evaluate, not_stated, spec_of
from studies.study import Study
from sweeps import DONE, FAILED, Axis, Variable

# Outcomes: those of EXPECTED are a run that passes every check, or a refusal.
OUTCOMES = (*EXPECTED, "fails", "not applicable", "skipped as too expensive", "pending")
FAILS, NOT_APPLICABLE, EXPENSIVE, PENDING = range(len(EXPECTED), len(OUTCOMES))
DAMPING = "fast and exact without numerical damping, paper with its own"
OUTPUTS = {
    "outcome": Variable("1", "outcome", (), "int8", flags=dict(enumerate(OUTCOMES[:-1]))),
    "passed": Variable("1", "whether the outcome and each check are right", (), "int8", flags={0: "no", 1: "yes"}),
    "value": ("1", "value of each check", "check"),
    "bound": ("1", "largest allowed value of each check", "check"),
}
# Margins that a summary lists; in the figure smaller ones are drawn as LEAST, refusals and failures above 1.
LISTED, LEAST, REFUSED, BROKEN = 12, 1e-6, 100.0, 1e5
TICKS = {LEAST: "≤ 10⁻⁶", 1e-4: "10⁻⁴", 1e-2: "10⁻²", 1.0: "1", REFUSED: "refused", BROKEN: "failed"}
# How the figure calls groups of cases, and what checks compare.
WORDS = {
    "step": "time step", "friction": "coefficient of friction", "angle": "inclination", "speed": "drive speed",
    "grazing": "grazing contact", "release": "release of preload", "catch": "hard impact",
    "first state": "initial state", "rig": "geometry, material, mass", "damping": "structural damping",
    "drive": "start of the drive", "long": "long run", "cut-off": "cut-off frequency", "finite": "finite values",
    "normal": "compressive normal force", "cone": "Coulomb's limit, |T| ≤ μN",
    "relaxation": "relaxation of T to the limit", "separation": "no force if separated",
    "direction": "friction dissipates", "stick": "no slip in stick", "gap": "no penetration or gap",
    "energy": "energy balance", "mean": "mean normal force F", "copy": "similar scenes agree",
    "record": "recording", "message": "message of a refusal",
}  # fmt: skip
STYLES = {"fast": ("o", figures.BLUE), "exact": ("^", figures.ORANGE), "paper": ("s", figures.BLACK)}


def battery(case: Any, method: Any) -> dict[str, Any]:
    """Run each case with its method."""
    rows = list(map(run_case, map(CASES.__getitem__, case.tolist()), method.tolist()))
    return dict(zip(OUTPUTS, map(list, zip(*rows, strict=True)), strict=True))


def run_case(case: Case, method: str) -> tuple[int, int, Any, Any]:
    """Outcome of a case with a method, whether it passed, and value and bound of each check."""
    expected, nan = case.expectation(method), np.full(len(CHECKS), np.nan)
    if method in case.excluded or method in TOO_EXPENSIVE.get(case.name, ()):
        return NOT_APPLICABLE if method in case.excluded else EXPENSIVE, 1, nan, nan
    spec, value = spec_of(case, method)
    try:
        passes = expected == PASSES
        checks = evaluate(collect(spec, case.copy)) if passes else not_stated(case, spec, value, expected)
    except (ValueError, ContactError, DivergenceError) as refusal:
        raise AssertionError(f"{case.name}, {method}: {type(refusal).__name__}: {refusal}") from refusal
    good = all(value <= bound for value, bound in checks.values())
    values, bounds = np.array([checks.get(name, (np.nan, np.nan)) for name in CHECKS]).T
    return EXPECTED.index(expected) if good else FAILS, int(good), values, bounds


def describe(data: xr.Dataset) -> xr.Dataset:
    """Add the task, the expected outcome, and the margin of each check, value over bound."""
    cases, methods = [CASES[name] for name in data["case"].values.tolist()], data["method"].values.tolist()
    expected = np.array([[EXPECTED.index(case.expectation(m)) for m in methods] for case in cases], dtype=np.int8)
    about = {"long_name": "expected outcome where the case applies", "flag_meanings": " ".join(EXPECTED)}
    # Where nothing is allowed, anything is infinitely much.
    margin = (data["value"] / data["bound"]).where((data["bound"] != 0.0) | (data["value"] != 0.0), 0.0)
    margin.attrs = {"units": "1", "long_name": "value of each check over its bound; above 1 it fails"}
    return data.assign(
        group=("case", [case.group for case in cases], {"long_name": "group of the case"}),
        task=("case", [case.task for case in cases], {"long_name": "task, where the name does not say it"}),
        about=("check", [CHECKS[name] for name in data["check"].values], {"long_name": "quantity of the check"}),
        expected=(("case", "method"), expected, about | {"flag_values": np.arange(len(EXPECTED), dtype=np.int8)}),
        margin=margin,
    )


def outcomes(data: xr.Dataset) -> xr.DataArray:
    """The index in OUTCOMES of each case and method."""
    codes = data["outcome"].where(data["status"] == DONE, PENDING).where(data["status"] != FAILED, FAILS)
    return codes.fillna(PENDING).astype(int).rename("code")


def summary(data: xr.Dataset) -> Iterator[Any]:
    """The number of expected outcomes, the checks nearest to their bounds, and cases that do not apply."""
    frame = outcomes(data).to_dataframe().reset_index()
    failed, ran = (int((frame["code"] == FAILS).sum()), int((frame["code"] <= FAILS).sum()))
    yield f"{failed or 'None'} of {ran} runs and refusals failed: {DAMPING}."
    words = frame["code"].map(dict(enumerate(OUTCOMES))).rename("outcome")
    yield "Cases by outcome", pd.crosstab(words, frame["method"]).reset_index()
    margin = data["margin"].where(data["value"].notnull() | data["bound"].isnull(), np.inf)
    margins = margin.to_dataframe("margin")["margin"]
    yield "Checks nearest to failing", margins.nlargest(max(LISTED, failed)).reset_index()
    for method, reason in sorted({pair for case in CASES.values() for pair in case.excluded.items()}):
        yield f"Some cases do not apply to '{method}': {reason}."


def figure(data: xr.Dataset) -> Any:
    """Above, the worst check of each case, or its refusal or failure; below, all checks of each case."""
    code, nearest = outcomes(data), data["margin"].max("check")
    nearest = nearest.where(code == 0, REFUSED).where(code != FAILS, BROKEN).where(code <= FAILS)
    rows, failed = [len(set(data["group"].values)) + 1, data.sizes["check"]], int((code == FAILS).sum()) or "none"
    figure, panels = figures.panels(2, 1, *(1.0 + 0.55 * row for row in rows), sharex=True)
    _draw_strips(panels[0], nearest.assign_coords(group=data["group"]), "group")
    _draw_strips(panels[1], data["margin"], "check")
    figures.entitle(panels, ("cases: the check that came nearest to failing", "checks of all cases"))
    panels[1].set_xlabel("deviation / allowed deviation")
    figure.suptitle(f"{data.sizes['case']} cases under stress, {DAMPING}: {failed} failed")
    figures.legend_below(figure, panels)
    return figure


def _draw_strips(axes: Any, values: xr.DataArray, name: str) -> None:
    """The points of each method beside each value of a coordinate, one row below the other."""
    frame = values.clip(LEAST, BROKEN).to_dataframe("x").reset_index().dropna(subset="x")
    labels = list(dict.fromkeys(values[name].values.tolist()))
    for k, method in enumerate(METHODS):
        points, (marker, color) = frame[frame["method"] == method], STYLES[method]
        scatter = 0.16 * (np.arange(len(points)) * 0.618034 % 1.0 - 0.5)
        y = points[name].map(labels.index) + 0.25 * (k - 1) + scatter
        axes.plot(points["x"], y, marker, color=color, label=method, ms=4, mfc="none", mew=0.7)
    axes.axvline(1.0, color=figures.RED, linestyle="--", label="bound")
    axes.set(xscale="log", xlim=(0.5 * LEAST, 2.0 * BROKEN), ylim=(len(labels) - 0.5, -0.5))
    axes.set(xticks=list(TICKS), xticklabels=TICKS.values())
    figures.name_rows(axes, [WORDS.get(each, each) for each in labels])
    axes.minorticks_off()


STUDY = Study(
    "stress",
    "What each method does under stress",
    "Does each method do what it should at and beyond physical limits, and refuse what it cannot do?",
    {"case": Parameter(np.array(list(CASES)), "1", "case"), "method": Parameter(np.array(METHODS), "1", DAMPING)},
    OUTPUTS,
    battery,
    paper="Section 3.3 gives the step and the constants of the published scheme, from which its limits follow.",
    derive=describe, summary=summary, figure=figure,
    coords={"check": Axis(list(CHECKS), long_name="check")},
    chaotic=True, beams=True,
)  # fmt: skip
