"""The page's content for each result as plain data: texts, tables, a figure and points."""

from __future__ import annotations

import re
import zlib
from base64 import b64encode
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from studies import registry, results, runner
from studies.plotting import figures
from studies.query.query import query
from studies.report.commands import again, in_python
from studies.report.points import points_of, within
from studies.study import Study
from studies.tables import Part, Table
from sweeps import FAILED, INTERPOLATED_FLAG, STATUS_FLAGS, duration

# Failures that are listed.
MOST_FAILURES = 20
# A cell with more letters is broken into lines; a title of so many has its study's name in the list of sections.
LONG = 32
# Studies of the tool, not of the rig: folded.
FOLDED = ("accuracy", "stress")
PNG = b"\x89PNG\r\n\x1a\n"


def anchor_of(target: str) -> str:
    """The place in the page of what is no study's own name."""
    return "of-" + re.sub(r"[^\w-]", "-", target)


class Broken(NamedTuple):
    """A requested result that cannot be shown, and the line that says why."""

    target: str
    line: str

    @property
    def anchor(self) -> str:
        """Where it stands in the page."""
        return anchor_of(self.target)

    @property
    def title(self) -> str:
        """The name of its file."""
        return Path(self.target).name

    @property
    def reason(self) -> str:
        """The line without its full stop."""
        return self.line.rstrip(".")


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
        What a command calls it: the study's name or file, or the path.
    out : str or Path, optional
        The results folder that was given, unless the target is a path.
    """

    study: Study
    dataset: xr.Dataset
    file: Path
    state: str
    target: str
    out: str | Path | None = None

    @property
    def anchor(self) -> str:
        """Where it stands in the page."""
        own = self.target == self.study.name
        return self.target if own else anchor_of(self.target)

    @property
    def title(self) -> str:
        """The study's title; a map's is its quantity."""
        own = self.target == self.study.name
        return self.study.title if own else str(self.dataset.attrs.get("title", self.file.stem))

    @property
    def short(self) -> str:
        """Its title in the list of sections."""
        short = self.title.partition(":")[0]
        return short if len(short) < LONG or self.target != self.study.name else self.study.name.capitalize()

    @property
    def folded(self) -> bool:
        """Whether it is shown when it is opened."""
        return self.study.name in FOLDED

    @property
    def stands_in(self) -> bool:
        """Whether it is the reference, where a result of one's own is not there."""
        return not results.is_path(self.target) and results.is_reference(self.file)

    def command(self, verb: str) -> str:
        """A command with it, in the results folder that was given."""
        return results.command(verb, self.target, self.out)

    @property
    def seconds(self) -> float:
        """CPU time."""
        return float(np.nansum(self.dataset["wall_time"].values))

    @property
    def made(self) -> str:
        """When it was last computed; of a run that is not at its end the file does not say."""
        last = str(self.dataset.attrs.get("history", "")).splitlines()[-1:] if self.state == "complete" else []
        return " ".join(last).partition(" ")[0]


OVERVIEW = ("study", "points", "failed", "CPU time", "computed")


def overview(result: Result) -> list[str]:
    """The result's row of the overview."""
    return [
        result.title,
        f"{result.dataset['status'].size}",
        f"{np.count_nonzero(result.dataset['status'].values == FAILED)}",
        duration(result.seconds),
        f"{result.made or result.state}{', the reference' if result.stands_in else ''}",
    ]


def shown(result: Result) -> dict[str, Any]:
    """Content of one result; a part that cannot be shown is None, and the entry `no_` + its name says why."""
    commands = again(result.dataset, result.target if registry.is_file(result.target) else "")
    context: dict[str, Any] = {
        "facts": _facts(result),
        "command": commands.whole,
        # Of a study whose axes are too long for a command.
        "toml": f"{result.command('status')} --toml" if commands.point.startswith("fiv run") else None,
    }
    parts: dict[str, Callable[[], Any]] = {
        "figure": lambda: b64encode(_figure(result)).decode(),
        "findings": lambda: _findings(result.study.findings(result.dataset), result.title),
        "points": lambda: points_of(result.dataset, _lines(result, commands.point)),
        "failures": lambda: _failures(result),
    }
    for name, make in parts.items():
        try:
            context |= {name: make(), f"no_{name}": ""}
        except Exception as problem:  # noqa: BLE001 - what a file or a study of one's own lacks, the page says
            context |= {name: None, f"no_{name}": why(problem)}
    return context


def why(problem: Exception) -> str:
    """The reason of an exception in one line."""
    text = f"it lacks {problem.args[0]}" if isinstance(problem, KeyError) and problem.args else str(problem)
    return " ".join(text.split()).rstrip(".") or type(problem).__name__


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], caption: str) -> dict[str, Any]:
    """A table with the class of each column; the caption is for those who cannot see it."""
    looks = [_look(cells) for _, *cells in zip(heads, *rows, strict=True)]
    return {"caption": caption, "heads": heads, "rows": rows, "looks": ["text", *looks[1:]]}


def _look(cells: Sequence[str]) -> str:
    """Numbers, and what stands for none, are flush right, words flush left; long ones are broken into lines."""
    if all(cell in ("", "-") or cell.lstrip("<>+- ")[:1].isdigit() for cell in cells):
        return ""
    return "text long" if max(map(len, cells)) > LONG else "text"


def _lines(result: Result, point: str) -> dict[str, str]:
    """Command lines and Python that compute a point of a plane again, and make its scene."""
    out = f", {str(result.out)!r}" if result.out else ""
    python = in_python(result.dataset, f"studies.open({result.target!r}{out})")
    # What is at a point at many values of an axis has no scene of its own.
    scene = {} if within(result.dataset) else {"Its scene, in Python": python}
    return ({"This point again": point} if point else {}) | scene


def _figure(result: Result) -> bytes:
    """The figure beside the file if it shows what the file holds, else one drawn anew."""
    beside = result.file.with_suffix(".png")
    if beside.is_file():
        image = beside.read_bytes()
        if is_whole(image) and figures.shows(image, figures.data_digest(result.dataset)):
            return image
    return runner.image(result.study, result.dataset, whose=result.file.name)


def is_whole(image: bytes) -> bool:
    """Whether an image is a PNG file with all its chunks, each of which has its check sum."""
    at, kind = len(PNG), b""
    while image.startswith(PNG) and kind != b"IEND" and at < len(image):
        kind, end = image[at + 4 : at + 8], at + 8 + int.from_bytes(image[at : at + 4])
        if zlib.crc32(image[at + 4 : end]).to_bytes(4) != image[end : end + 4]:
            return False
        at = end + 4
    return kind == b"IEND"


def _findings(parts: Iterable[Part], title: str) -> list[Any]:
    """A study's report: tables, and paragraphs of lines, which an empty one ends."""
    content: list[Any] = []
    for is_line, block in groupby(parts, lambda part: isinstance(part, str) and part != ""):
        if is_line:
            content.append("\n".join(map(str, block)))
            continue
        tables = (each for each in block if isinstance(each, Table))
        content += [
            table(each.heads, each.rows, f"{title}: by {each.heads[0] or each.heads[1]}") for each in tables
        ]
    return content


def _failures(result: Result) -> dict[str, Any] | None:
    """The first points that failed, and why, whether they are in the table of points or not."""
    total = int((result.dataset["status"] == FAILED).sum())
    heads = [*map(str, result.dataset["status"].dims), "error"]
    if not total:
        return None
    rows = query(result.dataset, "status == 'failed'", show=heads, limit=MOST_FAILURES).astype(str)
    return {"total": total, "table": table(heads, rows.to_numpy().tolist(), f"{result.title}: what failed")}


def _facts(result: Result) -> dict[str, str]:
    codes = result.dataset["status"].values
    counts = {word: np.count_nonzero(codes == code) for code, word in (STATUS_FLAGS | INTERPOLATED_FLAG).items()}
    points = ", ".join(f"{count} {word}" for word, count in counts.items() if count)
    return {
        "points": f"{codes.size} ({points})" if points else "none",
        "CPU time": duration(result.seconds),
        "computed": result.made or "not at its end",
        "by": str(result.dataset.attrs.get("source", "unknown")),
        "file": f"{result.file.parent.name}/{result.file.name}",
    }
