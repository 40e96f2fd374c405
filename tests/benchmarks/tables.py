"""Measured tables as plain data, how they are kept in results/benchmarks.json, and how the READMEs show them.

A README has each between `<!-- benchmarks: PART.TABLE -->` and `<!-- end -->`; numbers are rounded here alone.
"""

from __future__ import annotations

import json
import os
import platform
import re
import subprocess
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from tests import HOME
from tests.docs import readmes

FILE = HOME / "results" / "benchmarks.json"
MARKED = re.compile(r"(<!-- benchmarks: ([\w.]+) -->\n).*?(<!-- end -->)", re.DOTALL)
# Of units that are shown scaled: the largest first.
SCALES = {
    "s": ((1.0, "s"), (1e-3, "ms"), (1e-6, "us"), (1e-9, "ns")),
    "B": ((1e9, "GB"), (1e6, "MB"), (1e3, "kB"), (1.0, "B")),
    "flop/s": ((1e9, "Gflop/s"),),
    "%": ((0.01, "%"),),
}
# The table of the first README: from which table, the second cell of which row, and what that is called there.
SUMMARY = {
    "stability.costs": {
        "flutter onsets, new rig: both bases built": "all flutter onsets of a new rig, one core",
        "growth rates at 251 x 201 (theta, mu)": "growth rates at 251 x 201 points (theta, mu), one core",
    },
    "transient.second": {"2 mm/s": "one simulated second at 2 mm/s, one core"},
    "studies.commands": {
        "`regimes`, 40 x 40, to 0.005": "regimes at 40 x 40 points (V, mu), shares known to 0.005, two cores"
    },
}


class Column(NamedTuple):
    """A column's name, the unit in which its numbers are kept, and how they are rounded."""

    name: str
    unit: str = ""
    form: str = ".3g"


class Table(NamedTuple):
    """Columns and rows; a cell is a text, a number, None, [several of them], or {"mean": ..., "se": ...}."""

    columns: list[Column]
    rows: list[list[Any]]


def machine() -> str:
    """What this is measured on: no name of a host."""
    info = Path("/proc/cpuinfo")
    text = info.read_text(encoding="utf-8") if info.exists() else ""
    (name,) = re.findall(r"^model name\s*: (.*)$", text, re.MULTILINE)[:1] or [platform.machine()]
    wide = " (AVX-512)" if re.search(r"^flags.*\bavx512f\b", text, re.MULTILINE) else ""
    return f"{name.strip()}{wide}, {os.cpu_count()} cores, {platform.system()}"


def git(*arguments: str) -> str:
    """What git answers."""
    return subprocess.run(["git", *arguments], cwd=HOME, check=True, capture_output=True, text=True).stdout.strip()


def provenance() -> dict[str, Any]:
    """Where and when something is measured, and with which code, which must be committed."""
    folders = ("fivcore", "sweeps", "studies", "tests/benchmarks")
    changed = git("status", "--porcelain", "-uall", "--", *(f"{folder}/*.py" for folder in folders))
    if changed:
        raise SystemExit(f"commit first, for the tables name the commit that was measured:\n{changed}")
    versions = {name: version(name) for name in ("NumPy", "SciPy", "Numba")}
    return {
        "machine": machine(),
        "commit": git("rev-parse", "--short=7", "HEAD"),
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "versions": {"Python": platform.python_version()} | versions,
    }


def load() -> dict[str, Any]:
    """All tables that were measured, each with where and when."""
    found: dict[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
    return found


def keep(name: str, entry: dict[str, Any]) -> None:
    """Put one table into the file, which is whole at any time; the others stay as they are."""
    known = dict(sorted(((load() if FILE.exists() else {}) | {name: entry}).items()))
    # A row is a line.
    text = re.sub(r"\n {4,}|\n {3}(?=[\]}])", " ", json.dumps(known, indent=1, ensure_ascii=False))
    temporary = FILE.with_name(f".{FILE.name}.{os.getpid()}.tmp")
    temporary.write_text(text + "\n", encoding="utf-8")
    os.replace(temporary, FILE)


def number(value: float, unit: str, form: str) -> str:
    """A number with its unit, where that is shown beside the number."""
    scales = SCALES.get(unit, ((1.0, ""),))
    last = scales[-1] if value else scales[0]
    scale, name = next((each for each in scales if abs(value) >= 0.9995 * each[0]), last)
    whole = form.endswith("g") and abs(value / scale) >= 1000.0
    return f"{value / scale:{'.0f' if whole else form}} {name}".rstrip()


def cell(value: Any, unit: str, form: str) -> str:
    """A cell as the READMEs show it; a standard error is that of the last digits, in brackets."""
    match value:
        case None:
            return "-"
        case list():
            return " / ".join(cell(each, unit, form) for each in value)
        case {"mean": mean, "se": error}:
            return f"{mean:{form}}({error * 10.0 ** int(form[1:-1]):.0f})"
        case float() | int() if unit or isinstance(value, float):
            return number(value, unit, form)
        case _:
            return str(value)


def markdown(name: str, known: dict[str, Any]) -> str:
    """A table as Markdown, and below it where and when it was measured."""
    if name == "summary":
        cells = [
            (what, _rows(known[table])[row][1]) for table, rows in SUMMARY.items() for row, what in rows.items()
        ]
        return lines(["what", "time"], cells)
    entry = known[name]
    heads = [f"{head}, {unit}" if unit and unit not in SCALES else head for head, unit, _ in entry["columns"]]
    versions = "".join(f", {package} {number}" for package, number in entry["versions"].items())
    where = f"{entry['machine']}{versions}; commit {entry['commit']}, {entry['date']}{entry.get('note', '')}."
    return f"{lines(heads, _rows(entry).values())}\n{where}\n"


def _rows(entry: dict[str, Any]) -> dict[str, list[str]]:
    """A table's rows as texts, by their first cells, which differ or are numbered."""
    found = {}
    for k, row in enumerate(entry["rows"]):
        cells = [cell(value, unit, form) for value, (_, unit, form) in zip(row, entry["columns"], strict=True)]
        found[cells[0] if cells[0] not in found else f"{cells[0]} {k}"] = cells
    return found


def lines(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table's lines."""
    return "".join(f"| {' | '.join(row)} |\n" for row in (heads, ["---" for _ in heads], *rows))


def rendered(text: str, known: dict[str, Any]) -> str:
    """A README whose marked tables are those of the file."""
    return MARKED.sub(lambda found: found[1] + markdown(found[2], known) + found[3], text)


def write() -> None:
    """Write the tables into the READMEs."""
    for name in readmes.NAMES:
        path = HOME / name
        path.write_text(rendered(path.read_text(encoding="utf-8"), load()), encoding="utf-8")
