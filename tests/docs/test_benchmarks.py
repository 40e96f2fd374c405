"""Measured tables of the READMEs are those of results/benchmarks.json, with where and when each was measured."""

import json
import re
import subprocess
import sys

import pytest

from tests import HOME
from tests.benchmarks import __main__ as benchmarks
from tests.benchmarks import tables
from tests.docs import readmes

KNOWN = tables.load()
MARKED = [found[2] for text in readmes.TEXTS.values() for found in tables.MARKED.finditer(text)]
TABLE = re.compile(r"^\|.*\|\n\| ---.*\n(?:\|.*\|\n)+", re.MULTILINE)
# A number with its unit in a cell, or the unit in a head.
MEASURED = re.compile(
    r"\| [\d.]+ (?:[num]?s|min|[kMG]?B|Gflop/s) \||^\|.*(?:, [mu]?s|s per s|seconds|\bMB)\b.*\|\n\| ---"
)
# `tests.docs.test_numbers.accuracy` compares it with the reference.
ACCURACY = "| setting | s per s | until known, s |"


def unmarked(text: str) -> list[str]:
    """Heads of measured tables outside of markers."""
    found = TABLE.findall(tables.MARKED.sub("", text))
    return [each.partition("\n")[0] for each in found if MEASURED.search(each)]


@pytest.mark.parametrize("name", readmes.NAMES)
def test_a_readmes_tables_are_those_of_the_file(name):
    text = readmes.TEXTS[name]
    assert tables.rendered(text, KNOWN) == text, "write them again: python -m tests.benchmarks --tables"
    assert text.count("<!-- benchmarks: ") == text.count("<!-- end -->") == len(tables.MARKED.findall(text))


@pytest.mark.parametrize("name", readmes.NAMES)
def test_no_measured_table_is_typed(name):
    assert [head for head in unmarked(readmes.TEXTS[name]) if not head.startswith(ACCURACY)] == []


def test_every_table_stands_in_one_place_and_is_one_of_a_part():
    assert len(MARKED) == len(set(MARKED))
    assert set(MARKED) - {"summary"} <= set(KNOWN)
    assert set(KNOWN) <= set(benchmarks.chosen([]))


@pytest.mark.parametrize("name", KNOWN)
def test_a_table_says_where_and_when_it_was_measured(name):
    entry = KNOWN[name]
    assert re.fullmatch(r"[\w() -]+, \d+ cores, \w+", entry["machine"])
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", entry["date"])
    assert re.fullmatch(r"[0-9a-f]{7,40}", entry["commit"])
    assert all(len(row) == len(entry["columns"]) for row in entry["rows"])
    if not (HOME / ".git").exists() or tables.git("rev-parse", "--is-shallow-repository") == "true":
        pytest.skip("git alone knows the history")
    tables.git("merge-base", "--is-ancestor", entry["commit"], "HEAD")


def test_a_table_is_measured_as_it_is_kept():
    command = [sys.executable, "-m", "tests.benchmarks", "stability.errors", "--print"]
    done = subprocess.run(command, cwd=HOME, check=True, capture_output=True, text=True)
    found = json.loads(done.stdout)
    assert found["columns"] == KNOWN["stability.errors"]["columns"]
    assert [what for what, _ in found["rows"]] == [what for what, _ in KNOWN["stability.errors"]["rows"]]
    assert all(0.0 <= error < 1e-11 for _, error in found["rows"])


def test_what_is_kept_takes_the_place_of_one_table_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "FILE", tmp_path / "benchmarks.json")
    tables.keep("a.b", {"rows": [[1.0 / 3.0, "x"]]})
    tables.keep("a.a", {"rows": []})
    tables.keep("a.b", {"rows": [[2.0 / 3.0, None]]})
    before = tables.FILE.read_text()
    with pytest.raises(TypeError):
        tables.keep("a.a", {"rows": [object()]})
    assert tables.FILE.read_text() == before
    assert tables.load() == {"a.a": {"rows": []}, "a.b": {"rows": [[2.0 / 3.0, None]]}}
    assert [path.name for path in tmp_path.iterdir()] == ["benchmarks.json"]


def test_only_committed_code_is_measured(monkeypatch):
    monkeypatch.setattr(tables, "git", lambda *arguments: " M fivcore/rig.py" if arguments[0] == "status" else "")
    with pytest.raises(SystemExit, match=r"commit first[^\0]*fivcore/rig\.py"):
        tables.provenance()


def test_parts_and_tables_are_chosen_by_name():
    assert benchmarks.chosen(["stability.errors", "kernel"]) == [
        "stability.errors",
        "kernel.steps",
        "kernel.first",
    ]
    with pytest.raises(SystemExit, match="PART = 'speed': it must be one of stability, "):
        benchmarks.chosen(["speed"])


@pytest.mark.parametrize(
    ("value", "unit", "form", "shown"),
    [
        (0.010901234, "s", ".3g", "10.9 ms"),
        (0.9999, "s", ".3g", "1 s"),
        (8613.4, "s", ".3g", "8613 s"),
        (7.6e-6, "s", ".3g", "7.6 us"),
        (0.0, "s", ".3g", "0 s"),
        (2.253e9, "B", ".3g", "2.25 GB"),
        (0.08912, "%", ".1f", "8.9 %"),
        (1.0194, "", ".3f", "1.019"),
        (14300, "", ".3g", "14300"),
        (None, "s", ".3g", "-"),
        ([2590.2, 2579.4], "Hz", ".0f", "2590 / 2579"),
        ({"mean": 0.9261, "se": 0.00082}, "", ".3f", "0.926(1)"),
    ],
)
def test_numbers_are_rounded(value, unit, form, shown):
    assert tables.cell(value, unit, form) == shown
