"""A long run has one seed, counts what all its processes tried, and keeps that in a file."""

import json
import re
import subprocess
import sys

from tests import HOME

TESTS = ["test_a_unit_without_a_short_factor", "test_a_damaged_distribution_is_one_line"]
COMMAND = [sys.executable, "-m", "pytest", "-m", "battery", "-q", "-k", " or ".join(TESTS), "tests/battery"]


def run(*options):
    return subprocess.run([*COMMAND, *options], cwd=HOME, capture_output=True, text=True)


def test_counts_of_all_processes_are_printed_and_kept(tmp_path):
    file = tmp_path / "battery.json"
    done = run("--hypothesis-seed=7", "--counts", str(file))
    assert done.returncode == 0, done.stdout
    kept = json.loads(file.read_text())
    assert (kept["seed"], kept["passed"], kept["failed"]) == (7, 2, 0)
    assert set(kept["tried"]) == {"SPEC with units", "distributions"}
    assert min(kept["tried"].values()) > 500
    assert "= battery, seed 7 =" in done.stdout
    for what, count in kept["tried"].items():
        assert re.search(rf"^ *{count:,} {what}$".replace(",", " "), done.stdout, re.MULTILINE)
    assert list(tmp_path.iterdir()) == [file]
