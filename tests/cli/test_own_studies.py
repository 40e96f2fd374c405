"""Studies that are not predefined: of a file, of an installed package; and what is never run unasked."""

import os
import shutil
import sys
import textwrap

import netCDF4
import pytest

import studies
from studies import registry
from sweeps import InputError
from tests.helpers.commands import fiv

FILE = """
import numpy as np
from studies.study import Study
from sweeps import Axis, Grid, Sweep, Variable

def squares(points):
    return {"y": points["x"] ** 2}

def build(axes, settings):
    return Sweep("squares", squares, Grid(axes), {"y": Variable("m", "square")})

def draw(data):
    import matplotlib.pyplot as plt
    figure, axes = plt.subplots()
    data["y"].plot(ax=axes)
    return figure

STUDY = Study(
    name="squares", title="Squares", question="How large are squares?", paper="Nothing.",
    axes={"x": Axis([1.0, 2.0, 3.0], "m", "side")}, settings={}, build=build, draw=draw,
    findings=lambda data: [f"largest: {float(data['y'].max()):g}"],
)
"""


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(registry, "_given", {})
    before = set(sys.modules)
    path = tmp_path / "my_squares.py"
    path.write_text(FILE)
    yield path
    for name in set(sys.modules) - before:
        if getattr(sys.modules[name], "__file__", None) == str(path):
            del sys.modules[name]


@pytest.fixture
def package(tmp_path, monkeypatch):
    """An installed package with a study, on the path of this process and of others."""
    home = tmp_path / "site-packages"
    (home / "squarer-1.0.dist-info").mkdir(parents=True)
    (home / "squarer.py").write_text(FILE)
    (home / "squarer-1.0.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: squarer\nVersion: 1.0\n"
    )
    points = "[fiv.studies]\nsquares = squarer:STUDY\nfig5 = squarer:STUDY\n"
    (home / "squarer-1.0.dist-info" / "entry_points.txt").write_text(points)
    monkeypatch.setenv("PYTHONPATH", str(home), prepend=os.pathsep)
    return tmp_path


def test_an_installed_study_is_known_by_its_name(package):
    done = fiv(package, "run", "squares", "--set", "x=1,2,3,4", "-q")
    assert done.stdout == "largest: 16\n"
    assert done.stderr == ""
    assert "squares    Squares" in fiv(package, "list", "squares").stdout
    assert "cached          4" in fiv(package, "plan", "squares", "--set", "x=2,4,1,3").stdout
    assert "state           complete" in fiv(package, "status", "squares").stdout
    assert len(fiv(package, "query", "squares", "--format", "csv").stdout.splitlines()) == 5
    # By its path too, for it is installed.
    assert fiv(package, "plot", "results/squares/squares.nc").stdout == "results/squares/squares.png\n"
    assert fiv(package, "report").returncode == 0
    # A predefined study keeps its name.
    assert "Fig. 5" in fiv(package, "list", "fig5").stdout


def test_what_a_result_says_is_never_run(file, monkeypatch):
    """A result may come from anybody, and may name any file."""
    monkeypatch.chdir(file.parent)
    studies.run(studies.registry.resolve("my_squares.py"))
    kept = file.parent / "results" / "squares" / "squares.nc"
    registry._given.clear()
    for name in ("my_squares.py", str(file), "my_squares"):
        with netCDF4.Dataset(kept, "a") as data:
            data.sweep = name
        with pytest.raises(InputError, match=r"name the file: fiv plot FILE\.py"):
            studies.open(str(kept)).fiv.plot()


def test_hints_name_the_file(file):
    done = fiv(file.parent, "plot", "my_squares.py")
    assert done.returncode == 2
    assert done.stderr.endswith("there is no such file; make it with: fiv run my_squares.py\n")
    assert fiv(file.parent, "run", "my_squares.py", "-q").stdout == "largest: 9\n"
    # A result elsewhere is drawn by naming both.
    shutil.move(file.parent / "results", file.parent / "else where")
    done = fiv(file.parent, "plot", "my_squares.py", "--out", "else where")
    assert done.stdout == "else where/squares/squares.png\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "my_squares.py: it defines no study; it must have one called STUDY"),
        ("raise RuntimeError('mine')", "my_squares.py: it cannot be loaded: RuntimeError: mine"),
        (
            FILE.replace('name="squares"', 'name="fig5"'),
            "a predefined study is called 'fig5'; choose another name",
        ),
        (FILE.replace('name="squares"', 'name="../x"'), "a study cannot be called '../x'; use letters"),
        (FILE.replace('Sweep("squares"', 'Sweep("circles"'), "build: the sweep is called 'circles'"),
    ],
)
def test_a_file_that_is_no_study_is_one_line(file, text, message):
    file.write_text(textwrap.dedent(text))
    done = fiv(file.parent, "run", "my_squares.py")
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (file.parent / "results").exists()


def test_there_is_no_such_file(tmp_path):
    done = fiv(tmp_path, "status", "none.py")
    assert (done.returncode, done.stderr) == (2, "fiv: none.py: there is no such file\n")
