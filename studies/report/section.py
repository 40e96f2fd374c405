"""One result of the report page: question, figure, numbers, cost, command, its points, and its plane of scenes."""

from __future__ import annotations

import re
from base64 import b64encode
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import xarray as xr

from studies.plotting import figures
from studies.report.commands import again
from studies.report.markup import Content, Markup, data, tag
from studies.report.parts import command, table, told
from studies.report.points import Points, points_of
from studies.study import Study
from sweeps import INTERPOLATED_FLAG, STATUS_FLAGS, duration

STATUS = tuple((STATUS_FLAGS | INTERPOLATED_FLAG).values())
FAILED = STATUS.index("failed")
STATES = {"running": "still going on", "interrupted": "interrupted"}
# Failures that are listed.
MOST_FAILURES = 20
# What a file may lack that is not whole, or not of this code.
UNUSABLE = (KeyError, ValueError, IndexError, TypeError, ArithmeticError)


@dataclass(frozen=True, eq=False)
class Result:
    """A result to be shown.

    Attributes
    ----------
    study : Study
    dataset : xarray.Dataset
    file : Path
    state : str
        "complete", "running" or "interrupted".
    target : str
        What a command calls it: the study's name, or the path.
    """

    study: Study
    dataset: xr.Dataset
    file: Path
    state: str
    target: str

    @property
    def anchor(self) -> str:
        """Where it stands in the page."""
        own = self.target == self.study.name
        return self.study.name if own else "of-" + re.sub(r"[^\w-]", "-", self.target)

    @property
    def title(self) -> str:
        """What it is called: of a map what it shows."""
        own = self.target == self.study.name
        return self.study.title if own else str(self.dataset.attrs.get("title", self.file.stem))

    @property
    def counts(self) -> dict[str, int]:
        """How many points have which status, without those that there are none of."""
        codes = self.dataset["status"].values
        found = {word: int(np.count_nonzero(codes == code)) for code, word in enumerate(STATUS)}
        return {word: count for word, count in found.items() if count}

    @property
    def seconds(self) -> float:
        """Time of computing."""
        return float(np.nansum(self.dataset["wall_time"].values))

    @property
    def made(self) -> str:
        """When it was last computed; of a run that is not at its end the file does not say."""
        last = str(self.dataset.attrs.get("history", "")).splitlines()[-1:] if self.state == "complete" else []
        moment = last[0].split()[0] if last and last[0].split() else ""
        return re.sub(r"^(\d{4}-\d\d-\d\d)T(\d\d:\d\d):\d\dZ$", r"\1 \2 UTC", moment)


def section(result: Result) -> Markup:
    """All of one result."""
    made_again = again(result.dataset)
    whole = made_again.whole if made_again else ""
    parts: list[Content] = [
        tag("h2", result.title, id=f"{result.anchor}-title"),
        tag("p", result.study.question, class_="question"),
        tag("p", tag("strong", "The paper: "), result.study.paper, class_="paper"),
    ]
    if result.state != "complete":
        parts.append(
            tag(
                "p",
                f"This run is {STATES[result.state]}: here is what was finished.",
                class_="note",
            )
        )
    parts += [_figure(result), tag("h3", "Numbers beside the paper's"), _findings(result)]
    try:
        points = points_of(result.dataset, made_again.point if made_again else "")
    except UNUSABLE as problem:
        parts.append(tag("p", f"Its points cannot be shown: {_reason(problem)}.", class_="note"))
    else:
        if "plane" in points.data:
            parts += [tag("h3", "Every scene of the plane", class_="screen"), _plane(result)]
        parts += [tag("h3", "All points", class_="screen"), _points(result, points)]
    parts += [_failures(result), tag("h3", "Cost and origin"), _cost(result), tag("h3", "Make it again")]
    parts.append(
        command(whole)
        if whole
        else tag(
            "p",
            "No single command gives this result: its configuration stands in the file, attribute ",
            tag("code", "configuration"),
            ".",
        )
    )
    return tag("section", *parts, id=result.anchor, aria_labelledby=f"{result.anchor}-title")


def _findings(result: Result) -> Content:
    try:
        return told(result.study.findings(result.dataset), result.title)
    except UNUSABLE as problem:
        return tag("p", f"They cannot be told of what is there: {_reason(problem)}.", class_="note")


def _figure(result: Result) -> Markup:
    try:
        image = b64encode(_png(result)).decode()
    except UNUSABLE as problem:
        return tag("p", f"There is no figure: {_reason(problem)}.", class_="note")
    alt = f"Figure of {result.title}. {result.study.question} The numbers below say what it shows."
    return tag("figure", tag("img", src=f"data:image/png;base64,{image}", alt=alt, decoding="async"))


def _png(result: Result) -> bytes:
    """The figure beside the file, or drawn anew."""
    beside = result.file.with_suffix(".png")
    if beside.is_file() and result.state == "complete":
        return beside.read_bytes()
    drawn = BytesIO()
    with figures.style():
        result.study.draw(result.dataset).savefig(drawn, format="png", dpi=200)
    return drawn.getvalue()


def _plane(result: Result) -> Markup:
    name = result.anchor
    picture = tag(
        "canvas",
        tabindex="0",
        role="application",
        aria_label=f"Map of {result.title}: point at a cell, or move with the arrow keys",
        aria_describedby=f"{name}-said",
    )
    beside = [
        tag("div", picture, tag("div", class_="legend")),
        tag("div", class_="cell"),
    ]
    hint = "Point at a cell, touch it, or move with the arrow keys: it tells its scene, what was found, and how "
    hint += "to simulate it. A click holds it."
    return tag(
        "div",
        tag("p", hint, class_="hint"),
        tag("div", class_="choose"),
        tag("p", id=f"{name}-said", class_="said hidden", role="status"),
        tag("div", beside, class_="beside"),
        tag("noscript", tag("p", "The map needs the page's script; the figure above shows the plane too.")),
        class_="plane",
        data_of=f"{name}-data",
    )


def _points(result: Result, points: Points) -> Markup:
    """The table that the page's script fills, and what of the points it holds."""
    size = f"{points.total} points"
    if points.embedded < points.total:
        every = " and ".join(f"{_ordinal(stride)} value of {axis}" for axis, stride in points.strides.items())
        size = f"{points.embedded} of {points.total} points, every {every}, to keep this page small"
    query = f"fiv query {result.target} --where 'status == \"done\"' --format csv"
    return tag(
        "details",
        tag("summary", f"Table of {size}"),
        tag("p", "All of them, and more of each: "),
        command(query),
        tag("div", class_="points", data_of=f"{result.anchor}-data"),
        tag("noscript", tag("p", "The table needs the page's script.")),
        data(f"{result.anchor}-data", points.data),
    )


def _failures(result: Result) -> Content:
    """What failed, where, and why; whether it is in the table of points or not."""
    status = result.dataset["status"]
    places = np.argwhere(status.values == FAILED)
    if not len(places):
        return ""
    rows = []
    for place in places[:MOST_FAILURES]:
        at = result.dataset.isel(dict(zip(status.dims, place, strict=True)))
        rows.append([*(f"{at[dim].item()}" for dim in status.dims), str(at["error"].item())])
    heads = [*map(str, status.dims), "error"]
    left = len(places) - len(rows)
    more = (
        [
            tag("p", f"and {left} more: "),
            command(f"fiv query {result.target} --where 'status == \"failed\"' --show error"),
        ]
        if left
        else []
    )
    return [tag("h3", f"{len(places)} failed"), table(heads, rows, f"{result.title}: what failed"), *more]


def _cost(result: Result) -> Markup:
    counts = result.counts
    points = ", ".join(f"{count} {word}" for word, count in counts.items())
    facts = {
        "points": f"{result.dataset['status'].size} ({points})" if counts else "none",
        "time of computing": duration(result.seconds),
        "computed": result.made or "not at its end",
        "by": str(result.dataset.attrs.get("source", "unknown")),
        "file": f"{result.file.parent.name}/{result.file.name}",
    }
    return tag("dl", [[tag("dt", name), tag("dd", value)] for name, value in facts.items()], class_="facts")


def _ordinal(number: int) -> str:
    return {2: "second", 3: "third"}.get(number, f"{number}th")


def _reason(problem: Exception) -> str:
    return f"it lacks {problem}" if isinstance(problem, KeyError) else str(problem)
