"""What the READMEs say can be run is run: snippets of Python, commands, and the way of who comes first."""

from __future__ import annotations

import ast
import os
import shlex
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

import studies
from studies import registry
from tests import HOME
from tests.docs import first_time, generated, readmes

# The API, a study of one's own, sweeps of functions of numbers and of arrays, a run under SLURM.
(API,) = readmes.blocks("python", "README.md")
(STUDY,) = readmes.blocks("python", "studies/README.md")
*SWEEPS, SLURM = readmes.blocks("python", "sweeps/README.md")
# How to compute the first figure, to test, to come from nothing, and what one does with a study of one's own; the
# rest are examples, run in their order.
FIRST, TEST, WAY, *EXAMPLES, OWN = (block.rstrip("\n") for block in readmes.blocks("sh"))
COMMANDS = [line.partition("  #")[0].rstrip() for block in EXAMPLES for line in block.splitlines()]
ANSWERS = [each.command for each in generated.QUESTIONS]
# A structure of one's own, by its modes.
PIN = next(block for block in readmes.blocks("toml", "studies/README.md") if block.startswith("# pin.toml"))
# What reads, and needs no more than the results that are kept here.
READING = [line for line in COMMANDS if line.split()[1] in ("plan", "query", "plot") or line == "fiv list fig5"]
# What makes a script of the study of one's own.
MAIN = """
import studies
if __name__ == "__main__":
    print(studies.run(STUDY{}).fiv.summary())
"""
# A queue's commands: a job is a process here.
SBATCH = """#!/bin/sh
nohup bash "$1" > "$1.out" 2>&1 &
echo "Submitted batch job $!"
"""
SCANCEL = """#!/bin/sh
kill "$@" 2> /dev/null || true
"""


@pytest.fixture
def clone(tmp_path, here):
    """An empty folder with the reference, and a structure."""
    (tmp_path / "pin.toml").write_text(PIN)
    shutil.copytree(HOME / "results" / "reference", tmp_path / "results" / "reference")
    return tmp_path


def run(*command, **options):
    done = subprocess.run(command, capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_example_is_a_command_of_fiv():
    assert len(COMMANDS) > 15
    for line in COMMANDS:
        assert line.startswith("fiv "), line
    used = {line.split()[1] for line in COMMANDS} | {line.split()[1] for line in first_time.lines()[2:]}
    assert used == {"list", "plan", "run", "status", "plot", "query", "map", "report", "structure"}


def test_the_api_in_ten_lines(here):
    statements = ast.parse(API).body
    assert len([line for line in statements if not isinstance(line, (ast.Import, ast.ImportFrom))]) == 10
    names: dict = {}
    exec(API, names)
    unstable = names["modes"].frequency[names["modes"].unstable]
    assert [round(f) for f in unstable] == [398, 2794]
    assert len(names["data"]["mu"]) == 3
    assert len(names["several"]) == 3
    assert names["motion"].time[-1] == pytest.approx(0.5, rel=1e-4)


@pytest.fixture
def fiv(forgetful, here):
    """Output of a line with the command, run as another process would."""

    def run(line):
        registry._registered.clear()
        done = here(*shlex.split(line)[1:])
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


def test_a_study_of_ones_own_in_every_command(tmp_path, fiv):
    """Each line as it is printed, in the order of its README; all are one computation."""
    (tmp_path / "head_mass.py").write_text(STUDY)
    listed, planned, report, state, rows, drawn, page = map(fiv, OWN.split("\n"))
    assert "Does a heavier head calm the rig?" in listed
    assert "V 3 x head_mass 3" in planned
    assert "The rig vibrates least with" in report
    assert "complete" in state
    assert len(rows.splitlines()) == 4
    assert drawn.strip() == "results/head_mass/head_mass.svg"
    files = [path.name for path in (tmp_path / "results" / "head_mass").iterdir() if path.suffix != ".lock"]
    assert sorted(files) == ["head_mass.nc", "head_mass.png", "head_mass.svg"]
    assert "Does a heavier head calm the rig?" in (tmp_path / page.strip()).read_text()
    # Its name finds its results; its file is not run for them, and its figure is the general one.
    assert fiv("fiv query head_mass --where 'V == 5e-3'") == rows
    fiv("fiv plot head_mass")


@pytest.mark.slow
def test_a_study_of_ones_own_as_a_script(tmp_path, fiv):
    """It finds what the command has computed, and the command what it has, with other values."""
    script, result = tmp_path / "head_mass.py", tmp_path / "results" / "head_mass" / "head_mass.nc"
    script.write_text(STUDY + MAIN.format(""))
    fiv("fiv run head_mass.py")
    computed = result.read_bytes()
    assert "The rig vibrates least with" in run(sys.executable, script.name)
    assert result.read_bytes() == computed
    script.write_text(STUDY + MAIN.format(", duration=1.0, out='longer'"))
    assert "at duration = 1 s" in run(sys.executable, script.name).lower()
    assert "to do           0" in fiv("fiv plan head_mass.py --set duration=1.0 --out longer")


def test_a_study_takes_twenty_lines_and_a_sweep_ten():
    for text, most in ((STUDY, 20), (SWEEPS[0], 10)):
        assert len([line for line in text.splitlines() if line]) <= most


@pytest.mark.parametrize(
    ("script", "todo", "sizes"), [(SWEEPS[0], 6, "{'t': 3, 'rate': 2}"), (SWEEPS[1], 202, "{'t': 101, 'a': 2}")]
)
def test_a_sweep_of_ones_own_runs_and_resumes(tmp_path, script, todo, sizes):
    (tmp_path / "mine.py").write_text(script + "print(plan)\n")
    assert f"to do           {todo}" in run(sys.executable, "mine.py", cwd=tmp_path)
    # Other statements of the script are not part of the function.
    (tmp_path / "mine.py").write_text(script + "print(plan, dict(data['x'].sizes))\n")
    again = run(sys.executable, "mine.py", cwd=tmp_path)
    assert "to do           0" in again
    assert again.endswith(f" {sizes}\n")


@pytest.mark.slow
def test_a_run_under_slurm(tmp_path, monkeypatch):
    """With a queue that starts every job at once on this machine."""
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        path = tmp_path / "bin" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", os.pathsep.join([str(tmp_path / "bin"), os.environ["PATH"]]))
    smaller = SLURM.replace("cores=8, processes=8", "cores=1, processes=1").replace("jobs=4", "jobs=2")
    smaller = smaller.replace("5e-3]", '5e-3], "mu": [0.2, 0.3]').replace("16GB", "2GB")
    (tmp_path / "run.py").write_text(smaller)
    assert "to do" in run(sys.executable, "run.py", cwd=tmp_path, timeout=300)
    shown = ("--out", "on-slurm", "--show", "V,mu,status")
    rows = run(sys.executable, "-m", "studies", "query", "regimes", *shown, cwd=tmp_path)
    assert rows.count("done") == 6


@pytest.mark.usefixtures("clone")
def test_what_reads(here):
    for line in READING:
        _, *arguments = shlex.split(line.replace(" > lines.csv", ""))
        done = here(*arguments)
        assert done.returncode == 0, done.stderr
        assert len(done.stdout.splitlines()) >= (1 if arguments[0] == "plot" else 3), line


@pytest.mark.usefixtures("clone")
@pytest.mark.parametrize("line", [line for line in ANSWERS if not line.startswith("fiv map")])
def test_a_command_that_answers_a_question(here, line):
    """Runs are planned alone: tests of the gallery compute them, and the answers are those of the reference."""
    done = here(*shlex.split(line.replace("fiv run", "fiv plan"))[1:])
    assert done.returncode == 0, done.stderr
    assert ("points" in done.stdout) == line.startswith("fiv run")


@pytest.mark.slow
def test_the_loudest_load(here):
    line = next(line for line in ANSWERS if "velocity_rms" in line)
    assert here(*shlex.split(line)[1:], "-q").returncode == 0
    speed = 1e3 * studies.open("motion-F-members4")["velocity_rms"].squeeze()
    assert speed.sel(F=[18.0, 22.0]).values == pytest.approx(9.5, abs=0.2)
    assert float(speed.drop_sel(F=[18.0, 22.0]).max()) < 9.3


@pytest.mark.slow
def test_every_example_in_its_order(clone, monkeypatch):
    """Some minutes."""
    monkeypatch.setenv("PATH", os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
    run("bash", "-euo", "pipefail", "-c", "\n".join(COMMANDS))
    for name in ("elsewhere/fig5/fig5.nc", "series/scenes/scenes.png", "results/map/regime-V-mu.png", "lines.csv"):
        assert (clone / name).stat().st_size > (100 if name.endswith("csv") else 10_000)


@pytest.mark.slow
def test_the_first_time(tmp_path):
    """From an empty folder, everything installed anew."""
    begin = time.perf_counter()
    home = first_time.walk(tmp_path)
    assert time.perf_counter() - begin < 600.0
    assert (home / "results" / "map" / "growth_rate-theta-mu.nc").stat().st_size > 10_000
    assert 1e6 < (home / "results" / "report.html").stat().st_size < 3e6
    # All that the packages have is installed with them.
    (installed,) = home.glob(".venv/lib/python*/site-packages")
    for package in ("fivcore", "sweeps", "studies"):
        files = [path for path in (home / package).rglob("*") if path.is_file() and path.suffix != ".pyc"]
        assert files
        assert not [path for path in files if not (installed / path.relative_to(home)).is_file()]
    fiv = home / ".venv" / "bin" / "fiv"
    assert run(fiv, "check", cwd=tmp_path, env=first_time.environment()).endswith("all is well\n")
