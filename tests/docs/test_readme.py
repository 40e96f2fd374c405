"""What the README says can be run is run: snippets of Python, commands, and the way of who comes first."""

from __future__ import annotations

import ast
import os
import re
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from tests import HOME
from tests.docs import first_time

README = (HOME / "README.md").read_text()
PYTHON = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
# How to compute the first figure, to test, and to come from nothing; the rest are examples, run in their order.
FIRST, TEST, WAY, *EXAMPLES = re.findall(r"```sh\n(.*?)\n```", README, re.DOTALL)
COMMANDS = [line.partition("  #")[0].rstrip() for block in EXAMPLES for line in block.splitlines()]
# What reads, and needs no more than the results that are kept here.
READING = [line for line in COMMANDS if line.split()[1] in ("plan", "query", "plot") or line == "fiv list fig5"]
# A queue's commands: a job is a process here.
SBATCH = """#!/bin/sh
nohup bash "$1" > "$1.out" 2>&1 &
echo "Submitted batch job $!"
"""
SCANCEL = """#!/bin/sh
kill "$@" 2> /dev/null || true
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty folder with the results that are kept here, and commands that find this environment's `fiv`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FIV_RESULTS", raising=False)
    monkeypatch.setenv("PATH", os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
    shutil.copytree(HOME / "results", tmp_path / "results")
    return tmp_path


def run(*command, **options):
    done = subprocess.run(command, capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_example_is_a_command_of_fiv():
    assert len(COMMANDS) > 15
    assert len(READING) == 8
    for line in COMMANDS:
        assert line.startswith("fiv "), line
    used = {line.split()[1] for line in COMMANDS} | {line.split()[1] for line in first_time.lines()[2:]}
    assert used == {"list", "plan", "run", "status", "plot", "query", "map", "report"}


def test_the_api_in_ten_lines(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FIV_RESULTS", raising=False)
    assert (
        len([each for each in ast.parse(PYTHON[0]).body if not isinstance(each, (ast.Import, ast.ImportFrom))])
        == 10
    )
    names: dict = {}
    exec(PYTHON[0], names)
    unstable = names["modes"].frequency[names["modes"].unstable]
    assert [round(f) for f in unstable] == [398, 2794]
    assert len(names["data"]["mu"]) == 3
    assert len(names["several"]) == 3
    assert names["motion"].time[-1] == pytest.approx(0.5, rel=1e-4)


def test_a_study_of_ones_own(tmp_path):
    (tmp_path / "mine.py").write_text(PYTHON[1])
    first = run(sys.executable, "mine.py", cwd=tmp_path)
    assert "head mass kg   mm/s" in first
    assert len(first.splitlines()) == 5
    folder = tmp_path / "results" / "head_mass"
    assert {path.name for path in folder.iterdir()} == {"head_mass.nc", "head_mass.png"}
    computed = (folder / "head_mass.nc").read_bytes()
    assert run(sys.executable, "mine.py", cwd=tmp_path) == first
    assert (folder / "head_mass.nc").read_bytes() == computed
    rows = run(sys.executable, "-m", "studies", "query", "head_mass", "--where", "V == 5e-3", cwd=tmp_path)
    assert len(rows.splitlines()) == 5
    said = re.search(r"# (studies\.run\(STUDY, .*\)) for another", PYTHON[1])
    assert said
    (tmp_path / "mine.py").write_text(PYTHON[1].replace("studies.run(STUDY)", said[1]))
    assert len(run(sys.executable, "mine.py", cwd=tmp_path).splitlines()) == 5
    assert (tmp_path / "longer" / "head_mass" / "head_mass.nc").exists()
    plot = subprocess.run(
        [sys.executable, "-m", "studies", "plot", "head_mass"], cwd=tmp_path, capture_output=True
    )
    assert plot.returncode == 2
    assert b"'head_mass' is no study of fiv, which can query it" in plot.stderr


def test_a_sweep_of_ones_own_runs_and_resumes(tmp_path):
    (tmp_path / "mine.py").write_text(PYTHON[2] + "print(data['x'].sizes)\n")
    first, second = (run(sys.executable, "mine.py", cwd=tmp_path) for _ in range(2))
    assert "to do           202" in first
    assert "to do           0" in second
    assert "{'t': 101, 'a': 2}" in second
    # What the script does besides is no part of the function.
    (tmp_path / "mine.py").write_text(PYTHON[2] + "print(data['x'].max())\n")
    assert "to do           0" in run(sys.executable, "mine.py", cwd=tmp_path)


@pytest.mark.slow
def test_a_run_under_slurm(tmp_path, monkeypatch):
    """With a queue that starts every job at once on this machine."""
    assert len(PYTHON) == 4
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        path = tmp_path / "bin" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", os.pathsep.join([str(tmp_path / "bin"), os.environ["PATH"]]))
    smaller = PYTHON[3].replace("cores=8, processes=8", "cores=1, processes=1").replace("jobs=4", "jobs=2")
    smaller = smaller.replace("5e-3]", '5e-3], "mu": [0.2, 0.3]').replace("16GB", "2GB")
    (tmp_path / "run.py").write_text(smaller)
    assert "to do" in run(sys.executable, "run.py", cwd=tmp_path, timeout=300)
    rows = run(
        sys.executable,
        "-m",
        "studies",
        "query",
        "regimes",
        "--out",
        "on-slurm",
        "--show",
        "V,mu,status",
        cwd=tmp_path,
    )
    assert rows.count("done") == 6


@pytest.mark.parametrize("line", READING)
def test_what_reads(line, here):
    assert run("bash", "-euo", "pipefail", "-c", line) or ">" in line


@pytest.mark.slow
def test_every_example_in_its_order(here):
    """Some minutes."""
    run("bash", "-euo", "pipefail", "-c", "\n".join(COMMANDS))
    for name in ("elsewhere/fig5/fig5.nc", "series/scenes/scenes.png", "results/map/regime-V-mu.png", "lines.csv"):
        assert (here / name).stat().st_size > (100 if name.endswith("csv") else 10_000)


@pytest.mark.slow
def test_the_first_time(tmp_path):
    """From an empty folder, everything installed anew."""
    taken = first_time.walk(tmp_path)
    assert list(taken) == first_time.lines()
    assert sum(taken.values()) < 600.0
    results = tmp_path / "fiv" / "results"
    assert (results / "map" / "growth_rate-theta-mu.nc").stat().st_size > 10_000
    assert (results / "report.html").stat().st_size > 1_000_000
