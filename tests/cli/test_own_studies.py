"""Studies that are not predefined: of a file, of an installed package; and what is never run unasked."""

import shutil

import netCDF4
import pytest

import studies
from studies import registry
from sweeps import InputError

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
def file(tmp_path, forgetful):
    path = tmp_path / "my_squares.py"
    path.write_text(FILE)
    return path


@pytest.fixture
def package(tmp_path, monkeypatch, forgetful):
    """An installed package with a study, which has the name of a predefined one, too."""
    home = tmp_path / "site-packages"
    about = home / "squarer-1.0.dist-info"
    about.mkdir(parents=True)
    (home / "squarer.py").write_text(FILE)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: squarer\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[fiv.studies]\nsquares = squarer:STUDY\nfig5 = squarer:STUDY\n")
    monkeypatch.syspath_prepend(home)
    registry.installed.cache_clear()
    yield
    registry.installed.cache_clear()


@pytest.mark.usefixtures("package")
def test_an_installed_study_is_known_by_its_name(here):
    done = here("run", "squares", "--set", "x=1,2,3,4", "-q")
    assert (done.stdout, done.stderr) == ("largest: 16\n", "")
    assert "squares    Squares" in here("list", "squares").stdout
    assert "cached          4" in here("plan", "squares", "--set", "x=2,4,1,3").stdout
    assert "state           complete" in here("status", "squares").stdout
    assert len(here("query", "squares", "--format", "csv").stdout.splitlines()) == 5
    # By its path too, for it is installed.
    assert here("plot", "results/squares/squares.nc").stdout == "results/squares/squares.png\n"
    assert here("report").returncode == 0
    # A predefined study keeps its name.
    assert "Fig. 5" in here("list", "fig5").stdout


def test_what_a_result_says_is_never_run(file, here):
    """A result may come from anybody, and may name any file."""
    assert here("run", "my_squares.py", "-q").returncode == 0
    kept = file.parent / "results" / "squares" / "squares.nc"
    registry._registered.clear()
    for name in ("my_squares.py", str(file), "my_squares"):
        with netCDF4.Dataset(kept, "a") as data:
            data.sweep = name
        with pytest.raises(InputError, match=r"name the file: fiv plot FILE\.py"):
            studies.open(str(kept)).fiv.plot()


@pytest.mark.usefixtures("file")
def test_hints_name_the_file(here):
    done = here("plot", "my_squares.py")
    assert done.returncode == 2
    assert done.stderr.endswith("there is no such file; make it with: fiv run my_squares.py\n")
    assert here("run", "my_squares.py", "-q").stdout == "largest: 9\n"
    # A result elsewhere is drawn by naming both.
    shutil.move("results", "else where")
    assert here("plot", "my_squares.py", "--out", "else where").stdout == "else where/squares/squares.png\n"


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
def test_a_file_that_is_no_study_is_one_line(file, here, text, message):
    file.write_text(text)
    done = here("run", "my_squares.py")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert message in done.stderr
    assert not (file.parent / "results").exists()


def test_there_is_no_such_file(here):
    done = here("status", "none.py")
    assert (done.returncode, done.stderr) == (2, "fiv: none.py: there is no such file\n")
