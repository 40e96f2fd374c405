"""The tests with the lowest and with the newest versions of what the project needs, on every Python there is.

    python -m tests.floors [--python 3.11] [--kind floors] [-- tests/sweeps tests/cli -x]

Every pair has a virtual environment of its own, which is removed again. What is behind `--` goes to pytest;
without it the quick tests run, as README.md has them. The lowest versions are those of pyproject.toml's
dependencies, or the first after them of which there is a wheel for that Python; what only the tests need is the
newest. results/versions.json keeps the last outcome of every pair,
with the tests that were run: all but those of that file itself.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import xml.etree.ElementTree as xml
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.version import Version

from tests import HOME

PYTHONS = ("3.11", "3.12", "3.13", "3.14", "3.15")
KINDS = ("floors", "newest")
FILE = HOME / "results" / "versions.json"
# A file that says how it was with other lowest versions is not yet what its tests ask for.
OWN = "--ignore=tests/docs/test_versions.py"
# In the environment of the tests: its packages with their versions.
LISTED = "import importlib.metadata as m, json, sys; print(json.dumps({n: m.version(n) for n in sys.argv[1:]}))"

Row = dict[str, Any]


def dependencies() -> list[Requirement]:
    """What pyproject.toml says that the project needs."""
    project = tomllib.loads((HOME / "pyproject.toml").read_text())["project"]
    return [Requirement(text) for text in project["dependencies"]]


def floors(requirements: Iterable[Requirement]) -> dict[str, str]:
    """The lowest version of each, by name."""
    lowest = {}
    for each in requirements:
        (lowest[each.name],) = [bound.version for bound in each.specifier if bound.operator == ">="]
    return lowest


def lowest_wheel(requirement: Requirement, listed: str, has_wheel: Callable[[str], bool]) -> str:
    """The lowest version that a requirement allows, of those that pip lists, of which there is a wheel."""
    (versions,) = re.findall("^Available versions: (.*)$", listed, re.MULTILINE)
    allowed = sorted(requirement.specifier.filter(versions.split(", ")), key=Version)
    return next(filter(has_wheel, allowed))


def merged(rows: Iterable[Row], new: Row) -> list[Row]:
    """The rows with a new one in place of that of its Python and kind."""
    pairs = {(row["python"], row["kind"]): row for row in [*rows, new]}
    return [pairs[pair] for pair in sorted(pairs, key=lambda pair: (PYTHONS.index(pair[0]), pair[1]))]


def keep(new: Row, file: Path = FILE) -> None:
    """Put a row into the file, which is whole at any time."""
    rows = json.loads(file.read_text()) if file.exists() else []
    temporary = file.with_suffix(".json.tmp")
    temporary.write_text(json.dumps(merged(rows, new), indent=1) + "\n")
    os.replace(temporary, file)


def interpreter(python: str) -> str | None:
    """The Python of that version on the path that can be started, if there is one."""
    found = shutil.which(f"python{python}")
    if found is None or subprocess.run([found, "-c", ""], capture_output=True).returncode:
        return None
    return found


def outcome(python: str, kind: str, tests: Sequence[str]) -> Row:
    """Install and test; what came of it."""
    row: Row = {"python": python, "kind": kind, "date": datetime.now(UTC).date().isoformat(), "commit": commit()}
    found = interpreter(python)
    if found is None:
        return row | {"outcome": "this Python is missing"}
    with tempfile.TemporaryDirectory(prefix="floors-") as folder:
        home = Path(folder)
        own = str(home / "venv" / "bin" / "python")
        subprocess.run([found, "-m", "venv", str(home / "venv")], check=True)
        if problem := installed(own, home, kind):
            return row | {"outcome": f"it cannot be installed: {problem}"}
        names = [each.name for each in dependencies()]
        listed = subprocess.run([own, "-c", LISTED, *names], check=True, capture_output=True, text=True)
        row |= {"versions": json.loads(listed.stdout), "tests": ["python", "-m", "pytest", OWN, *tests]}
        # Kernels of one version of numba are of no use to another.
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        environment |= {"NUMBA_CACHE_DIR": str(home / "kernels")}
        report = home / "report.xml"
        command = [own, *row["tests"][1:], f"--junitxml={report}"]
        code = subprocess.run(command, cwd=HOME, env=environment).returncode
        counts = counted(report) if report.exists() else {}
    return row | counts | {"outcome": "passed" if code == 0 else f"pytest ended with {code}"}


def installed(python: str, home: Path, kind: str) -> str:
    """Install the project with its tests' tools; what pip said last where it failed, else ""."""
    needed = dependencies()
    pip = [python, "-m", "pip", "--disable-pip-version-check"]
    # Where there is no wheel of so low a version for this Python, there is none to build either.
    wheels = ["--quiet", "--only-binary", ",".join(each.name for each in needed)]
    command = [*pip, "install", *wheels]
    if kind == "floors":
        constraints = home / "floors.txt"
        with constraints.open("w") as file:
            for each in needed:
                index = [*pip, "index", "versions", each.name]
                listed = subprocess.run(index, check=True, capture_output=True, text=True).stdout
                tried = [*pip, "download", *wheels, "--no-deps", "--dest", str(home / "wheels")]
                lowest = lowest_wheel(each, listed, partial(_can_be_had, tried, each.name))
                print(f"{each.name}=={lowest}", file=file)
        command += ["--constraint", str(constraints)]
    done = subprocess.run([*command, "-e", f"{HOME}[test]"], capture_output=True, text=True)
    return done.stderr.strip().splitlines()[-1] if done.returncode else ""


def _can_be_had(command: Sequence[str], name: str, version: str) -> bool:
    return subprocess.run([*command, f"{name}=={version}"], capture_output=True).returncode == 0


def counted(report: Path) -> dict[str, int]:
    """How many tests passed, failed and were skipped."""
    suites = list(xml.parse(report).getroot().iter("testsuite"))  # noqa: S314 - pytest wrote it
    names = ("tests", "failures", "errors", "skipped")
    total, failures, errors, skipped = (sum(int(suite.get(name, 0)) for suite in suites) for name in names)
    return {"passed": total - failures - errors - skipped, "failed": failures + errors, "skipped": skipped}


def commit() -> str:
    """The commit that is tested; outcomes that were kept since change nothing of it."""

    def git(*arguments: str) -> str:
        command = ["git", *arguments]
        return subprocess.run(command, cwd=HOME, check=True, capture_output=True, text=True).stdout.strip()

    changed = git("status", "--porcelain", "--", ".", f":!{FILE.relative_to(HOME)}")
    return git("rev-parse", "--short=12", "HEAD") + ("-dirty" if changed else "")


def main() -> None:
    """Test the pairs that are asked for, and keep each outcome."""
    parser = argparse.ArgumentParser(prog="python -m tests.floors", description=__doc__.splitlines()[0])
    parser.add_argument("--python", choices=PYTHONS, action="append", help="by default all")
    parser.add_argument("--kind", choices=KINDS, action="append", help="by default both")
    parser.add_argument("tests", nargs="*", help="arguments of pytest, behind --")
    given = parser.parse_args()
    rows = []
    for python in given.python or PYTHONS:
        for kind in given.kind or KINDS:
            rows.append(outcome(python, kind, given.tests))
            keep(rows[-1])
            print(f"Python {python}, {kind}: {rows[-1]['outcome']}", flush=True)
    sys.exit(any(row.get("failed") or row["outcome"].startswith("pytest") for row in rows))


if __name__ == "__main__":
    main()
