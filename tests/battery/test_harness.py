"""A long run has one seed, counts what all its processes tried, and keeps that in a file."""

import json
import re
import subprocess
import sys

from tests import HOME

TEST = "tests/battery/surfaces/test_spec.py::test_a_unit_without_a_short_factor_is_known_to_14_digits"
COMMAND = [sys.executable, "-m", "pytest", "-m", "battery", "-q", "-n", "1", TEST]


def run(*options):
    return subprocess.run([*COMMAND, *options], cwd=HOME, capture_output=True, text=True)


def test_counts_of_all_processes_are_printed_and_kept(tmp_path):
    file = tmp_path / "battery.json"
    done = run("--hypothesis-seed=7", f"--counts={file}")
    assert done.returncode == 0, done.stdout
    kept = json.loads(file.read_text())
    assert (kept["seed"], kept["passed"], kept["failed"]) == (7, 1, 0)
    assert set(kept["tried"]) == {"SPEC with units"}
    assert kept["tried"]["SPEC with units"] >= 600
    assert "= battery, seed 7 =" in done.stdout
    assert re.search(f"^ *{kept['tried']['SPEC with units']} SPEC with units$", done.stdout, re.MULTILINE)
    assert list(tmp_path.iterdir()) == [file]
