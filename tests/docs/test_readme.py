"""Every block of code of the READMEs, and of `--help`, runs in the order and the place in which one reads it."""

from __future__ import annotations

import os
import re
import runpy
import shlex
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from textwrap import dedent
from types import SimpleNamespace

import dask
import numpy as np
import pytest
from distributed import Client, LocalCluster
from scipy import io, sparse

import studies
from fivcore import Structure
from studies import registry
from studies.cli.main import fiv as program
from studies.report import section
from tests import HOME
from tests.docs import first_time, generated, readmes

# A study of one's own, a run under SLURM.
(STUDY,) = (block for block in readmes.blocks("python", "studies/README.md") if "STUDY = Study(" in block)
(SLURM,) = (block for block in readmes.blocks("python", "sweeps/README.md") if "SLURMCluster" in block)
FIRST, TEST = readmes.blocks("sh", "README.md")[:2]
ANSWERS = [each.command for each in generated.QUESTIONS]
# What is computed of fewer points or for less time here.
CUT = {
    "member=1:4:4": "member=1,2 --set V=.5,1mm/s --set mu=.2 --set F=9"
    " --set loading_times=.1 --set min_duration=.1",
    "--refine 3": "--refine 1",
    "--samples 256": "--samples 4",
    "--workers 2": "--workers 2 --scheduler threads",
    "fiv fit bench.toml": "fiv fit bench.toml --samples 16 --rounds 1",
    "fiv run scenes": "fiv run scenes --set duration=60ms",
    "fiv run robust": "fiv run robust --set theta=5 --set sobol_samples=4",
    "--quantity regime": "--quantity regime --fix max_duration=.1 --fix min_duration=.02 --fix standard_error=.5",
    "theta=-10:20:61": "theta=-10:20:7",
    "theta=0:20:61": "theta=0:20:5 --samples 8",
    "1e-2:9": "1e-2:3",
    "0.4:9": "0.4:3",
    "Parameter(0.5,": "Parameter(0.02,",
    "duration=0.5": "duration=0.05",
    "duration=0.3": "duration=0.05",
    "scheduler=cluster": "mu=0.2, max_duration=0.1, min_duration=0.02, scheduler=cluster",
}
# Lines that install or clone; what is not run here: the tests themselves, a page that is served for ever, a queue.
PREPARES = ("python3 -m venv", ".venv/bin/python -m pip", "git clone", "cd fiv", ". .venv/bin", "pip install")
ELSEWHERE = (TEST, "fiv report --watch", "fiv report --rig mine", "#SBATCH", "sbatch ")
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
    """A folder with the reference of what is read, and the files that examples say one has."""
    for name in ("fig5", "fig6", "regimes", "robust", "scenes", "stability", "table6"):
        shutil.copytree(HOME / "results" / "reference" / name, tmp_path / "results" / "reference" / name)
    (tmp_path / "results" / "reference" / "rig.svg").touch()
    for text in readmes.blocks("toml", "studies/README.md"):
        (tmp_path / re.match(r"# (\S+\.toml)", text)[1]).write_text(text, encoding="utf-8")
    (tmp_path / "rigs.csv").write_text("p1_length [mm], mu\n50, 0.1\n60, 0.2\n", encoding="utf-8")
    stiffness = sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(24, 24)) * 1e7
    io.mmwrite(tmp_path / "K.mtx", stiffness.tocoo())
    io.mmwrite(tmp_path / "M.mtx", sparse.eye_array(24).tocoo() * 0.01)
    rows = [(node, way) for node in (*range(834, 845), 12) for way in ("UX", "UY")]
    (tmp_path / "rows.txt").write_text(
        "\n".join(f"{845 if node == 844 else node} {way}" for node, way in rows), encoding="utf-8"
    )
    places = [f"{node} {0.01 * k} 0 0" for k, node in enumerate((*range(834, 844), 845, 12))]
    (tmp_path / "nodes.txt").write_text("\n".join(places), encoding="utf-8")
    return tmp_path


def run(*command, **options):
    done = subprocess.run(command, capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def fiv(forgetful, here):
    """Output of a line with the command, run as another process would."""

    def run(line):
        registry._registered.clear()
        done = here(*shlex.split(line)[1:])
        assert done.returncode == 0, (line, done.stderr)
        return done.stdout

    return run


def commands(block):
    """The commands of `fiv` in a block of a shell; every other line is one that prepares."""
    for line in block.replace("\\\n", " ").splitlines():
        for each in re.split(r"&&|  #", line) if not line.strip().startswith("#") else ():
            command = each.strip()
            if command.startswith(("fiv ", ".venv/bin/fiv ")):
                yield re.split(r"\s{2,}", command.removeprefix(".venv/bin/"))[0]
            else:
                assert command.startswith(PREPARES) or "  #" in line, command


BLOCKS = [text for name in readmes.NAMES for kind, text in readmes.every(name) if kind == "sh" and text != TEST]
BLOCKS = [text for text in BLOCKS if not any(each in text for each in ELSEWHERE[2:])]
READ = {command for text in BLOCKS for command in commands(text)}


def cut(text):
    for whole, part in CUT.items():
        text = text.replace(whole, part)
    return text


@pytest.fixture
def reader(clone, fiv, undrawn, monkeypatch):
    """Runs a block as it stands there, but for CUT; returns what it prints, or its names."""
    monkeypatch.setattr(section, "images", lambda _: [])

    def play(language, text):
        if any(each in text for each in ELSEWHERE[2:]) or text in ELSEWHERE:
            return None
        if language == "csv":
            Path("modes.csv").write_text(text, encoding="utf-8")
            return None
        if language == "toml":
            name = re.match(r"# (\S+\.toml)", text)[1]
            Path(name).write_text(text, encoding="utf-8")
            # Of a structure, or of a fit, which the command reads.
            return None if "[[target]]" in text else Structure.read(name)
        if language == "sh":
            printed = []
            for line in commands(text):
                command, *file = re.split(r" > (?=\S+$)", line)
                if command not in ELSEWHERE:
                    printed.append(fiv(cut(command)))
                    for each in file:
                        Path(each).write_text(printed[-1], encoding="utf-8")
            return printed
        assert language == "python"
        file = Path("head_mass.py" if "STUDY = Study(" in text else f"block{len(text)}.py")
        file.write_text(cut(text), encoding="utf-8")
        return runpy.run_path(str(file), run_name="__main__")

    return play


def test_the_readme_of_the_project(reader):
    (_, first), (_, tests), *others = readmes.every("README.md")
    assert tests == TEST
    assert "0.1112" in reader("sh", first)[0]
    *_, names = (reader(*each) for each in others)
    # What the command has computed is not computed again by the script in the same folder.
    assert [round(f) for f in names["modes"].frequency[names["modes"].unstable]] == [398, 2794]
    assert (len(names["data"]["mu"]), len(names["several"])) == (3, 3)
    assert Path("results/report.html").stat().st_size > 10_000
    assert studies.open("growth_rate-theta-mu").sizes == {"theta": 17, "mu": 17}


def test_the_readme_of_the_engine(reader, monkeypatch):
    clusters = []

    class Cluster(LocalCluster):
        """In the place of SLURM's, with a worker in this process."""

        def __init__(self, **how):
            assert {"cores", "processes", "memory", "walltime", "worker_extra_args"} == how.keys()
            clusters.append(self)
            super().__init__(n_workers=0, threads_per_worker=1, processes=False, dashboard_address=None)

        def adapt(self, minimum_jobs, maximum_jobs):
            self.scale(1)

    monkeypatch.setitem(sys.modules, "dask_jobqueue", SimpleNamespace(SLURMCluster=Cluster))
    with dask.config.set({"distributed.worker.profile.enabled": False}):
        names = [reader(*each) for each in readmes.every("sweeps/README.md")]
    assert len(clusters) == 1
    data = studies.open("regimes", "on-slurm")
    assert (data["status"] == 1).all()
    assert data["V"].values.tolist() == [1e-3, 2e-3, 5e-3]
    first = next(each["data"] for each in names if each and "data" in each)
    np.testing.assert_array_equal(first["x"], 2.0 ** -np.outer([0.0, 0.5, 1.0], [1.0, 3.0]))
    # "Run it again and nothing is computed."
    again = reader("python", next(text for _, text in readmes.every("sweeps/README.md")))
    assert again["plan"].todo == 0


def test_the_readme_of_the_studies(reader, clone):
    """With a study of one's own in every command: each line as it is printed; all are one computation."""
    *blocks, own = readmes.every("studies/README.md")
    Path("pin.toml").unlink()  # a block of this README is its text
    for each in blocks:
        reader(*each)
    assert Path("lines.csv").read_text(encoding="utf-8").startswith("theta,regime\n")
    listed, planned, report, state, rows, drawn, page = reader(*own)
    assert "Does a heavier head calm the rig?" in listed
    assert "V 3 x head_mass 3" in planned
    assert "The rig vibrates least with" in report
    assert "complete" in state
    assert len(rows.splitlines()) == 4
    assert drawn.strip() == "results/head_mass/head_mass.png"
    whole = (clone / page.strip()).read_text()
    assert "Does a heavier head calm the rig?" in whole
    # Its name finds its results; its file is not run for them, and its figure is the general one.
    assert reader("sh", "fiv query head_mass --where 'V == 5e-3'") == [rows]
    reader("sh", "fiv plot head_mass")
    # The command that the page prints computes it again.
    again = re.search(r"<dt>again</dt><dd>(fiv run head_mass.py [^<]*)</dd>", whole)[1]
    assert "The rig vibrates least with" in reader("sh", f"{again} --fresh")[0]


def helped():
    """The commands that each `--help` shows, in their order, and the results that they take for granted."""
    granted = {"run": ["other/fig5"], "status": ["elsewhere/scenes"], "plot": ["elsewhere/fig5"]}
    granted["report"] = ["results/regimes"]
    for name, command in (("fiv", program), *program.commands.items()):
        text = re.sub(r"\\\n\s*", " ", command.help)
        lines = [line.strip() for line in text.splitlines()]
        if found := [line for line in lines if re.match(r"fiv \w", line)]:
            yield pytest.param("\n".join(found), granted.get(name, []), id=name)


@pytest.mark.parametrize(("block", "granted"), [*helped()])
def test_the_commands_of_the_help(reader, block, granted):
    for place in granted:
        shutil.copytree(HOME / "results" / "reference" / Path(place).name, place)
    found = [*commands(block)]
    assert len(found) == len(block.splitlines())
    # What stands in a README, too, is run there.
    reader("sh", "\n".join(command for command in found if command not in READ))


def test_the_recipes_of_the_help_of_structure(clone):
    """With stand-ins of the libraries that read the files of Nastran and Ansys."""
    K, M = (sparse.csr_array(io.mmread(clone / name)) for name in ("K.mtx", "M.mtx"))
    load_km = SimpleNamespace(load_km=lambda sort: (np.ones((24, 2), int), sparse.triu(K), sparse.triu(M)))
    names = {"read_op4": lambda _: {"MAA": SimpleNamespace(data=M), "KAA": SimpleNamespace(data=K)}}
    names |= {"reader": SimpleNamespace(read_binary=lambda _: load_km), "np": np, "triu": sparse.triu}
    names |= {"csr_array": sparse.csr_array, "mmwrite": io.mmwrite}
    recipes = [text for text in re.split(r"\n\n|\x08\n", program.commands["structure"].help) if "mmwrite(" in text]
    assert len(recipes) == 2
    for text in recipes:
        for name in ("K.mtx", "M.mtx"):
            (clone / name).unlink()
        exec(dedent(text), dict(names))
        for name, matrix in (("K.mtx", K), ("M.mtx", M)):
            assert abs(sparse.csr_array(io.mmread(clone / name)) - matrix).max() == 0.0


def test_any_scheduler_a_dataframe_and_a_distribution_go_to_a_study_as_to_a_sweep(clone, undrawn):
    import pandas as pd
    from scipy import stats

    table = pd.DataFrame({"mu": [0.1, 0.2], "p1_length": [0.05, 0.06]}, index=[7, 3])
    local = LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None)
    with local as cluster, Client(cluster) as client:
        found = [
            studies.run("fig5", points=table, scheduler=each, out=f"out{k}")
            for k, each in enumerate((client, cluster, cluster.scheduler_address, "sync"))
        ]
    for each in found:
        np.testing.assert_array_equal(each["growth_rate"], found[-1]["growth_rate"])
        assert each["p1_length"].values.tolist() == [0.05, 0.06]
    typed = studies.run("fig5", theta="normal:5:0.5", samples=4, mu=[0.1, 0.2], out="typed")
    frozen = studies.run("fig5", theta=stats.norm(5.0, 0.5), samples=4, mu=[0.1, 0.2], out="typed")
    np.testing.assert_array_equal(typed["frequency"], frozen["frequency"])


@pytest.mark.slow
def test_a_study_of_ones_own_as_a_script(tmp_path, fiv):
    """It finds what the command has computed, and the command what it has, with other values."""
    script, result = tmp_path / "head_mass.py", tmp_path / "results" / "head_mass" / "head_mass.nc"
    script.write_text(STUDY + MAIN.format(""), encoding="utf-8")
    fiv("fiv run head_mass.py")
    computed = result.read_bytes()
    assert "The rig vibrates least with" in run(sys.executable, script.name)
    assert result.read_bytes() == computed
    script.write_text(STUDY + MAIN.format(", duration=1.0, out='longer'"), encoding="utf-8")
    assert "at duration = 1 s" in run(sys.executable, script.name).lower()
    assert "to do           0" in fiv("fiv plan head_mass.py --set duration=1.0 --out longer")


@pytest.mark.slow
def test_a_run_under_slurm(tmp_path, monkeypatch):
    """With a queue that starts every job at once on this machine."""
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        path = tmp_path / "bin" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", os.pathsep.join([str(tmp_path / "bin"), os.environ["PATH"]]))
    smaller = SLURM.replace("cores=8, processes=8", "cores=1, processes=1").replace("jobs=4", "jobs=2")
    smaller = smaller.replace("5e-3]", "5e-3], mu=[0.2, 0.3]").replace("16GB", "2GB")
    (tmp_path / "run.py").write_text(smaller, encoding="utf-8")
    run(sys.executable, "run.py", cwd=tmp_path, timeout=300)
    shown = ("--out", "on-slurm", "--show", "V,mu,status")
    rows = run(sys.executable, "-m", "studies", "query", "regimes", *shown, cwd=tmp_path)
    assert rows.count("done") == 6


@pytest.mark.usefixtures("clone")
@pytest.mark.parametrize("line", [line for line in ANSWERS if line.startswith("fiv run")])
def test_a_command_that_answers_a_question(here, line):
    """Runs are planned alone: tests of the gallery compute them, and the answers are those of the reference."""
    done = here(*shlex.split(line.replace("fiv run", "fiv plan"))[1:])
    assert done.returncode == 0, done.stderr
    assert "points" in done.stdout


@pytest.mark.slow
def test_the_loudest_load(here):
    line = next(line for line in ANSWERS if "velocity_rms" in line)
    assert here(*shlex.split(line)[1:], "-q").returncode == 0
    speed = 1e3 * studies.open("motion-F-members4")["velocity_rms"].squeeze()
    assert speed.sel(F=[18.0, 22.0]).values == pytest.approx(9.5, abs=0.2)
    assert float(speed.drop_sel(F=[18.0, 22.0]).max()) < 9.3


@pytest.mark.slow
def test_every_block_from_a_fresh_clone(tmp_path):
    """Everything installed anew, then each block of each README as it stands there; half an hour."""
    run("git", "clone", "-q", str(HOME), "fiv", cwd=tmp_path)
    home, environment = tmp_path / "fiv", first_time.environment()
    environment["PATH"] = os.pathsep.join([str(home / ".venv" / "bin"), environment["PATH"]])
    shutil.copy(HOME / "tests" / "cli" / "pin_angle.py", home)
    for name in readmes.NAMES:
        for k, (language, text) in enumerate(readmes.every(name)):
            if text == TEST or "SLURMCluster" in text or any(each in text for each in ELSEWHERE[2:]):
                continue
            if "git clone" in text:
                (tmp_path / "anew").mkdir()
                again = first_time.walk(tmp_path / "anew")
                assert (again / "results" / "map" / "growth_rate-theta-mu.nc").stat().st_size > 10_000
                assert 1e6 < (again / "results" / "report.html").stat().st_size < 3e6
            elif language == "sh":
                run("bash", "-euo", "pipefail", "-c", text, cwd=home, env=environment)
            elif language == "toml":
                (home / re.match(r"# (\S+\.toml)", text)[1]).write_text(text, encoding="utf-8")
            else:
                file = "head_mass.py" if "STUDY = Study(" in text else f"block{len(name)}{k}.py"
                (home / file).write_text(text, encoding="utf-8")
                run("python", file, cwd=home, env=environment)
    # All that the packages have is installed with them.
    (installed,) = home.glob(".venv/lib/python*/site-packages")
    for package in ("fivcore", "sweeps", "studies"):
        # What scripts in the clone have compiled lies there, too.
        files = [
            path for path in (home / package).rglob("*") if path.is_file() and "__pycache__" not in path.parts
        ]
        assert files
        assert not [path for path in files if not (installed / path.relative_to(home)).is_file()]
    assert run("fiv", "check", cwd=tmp_path, env=environment).endswith("all is well\n")
