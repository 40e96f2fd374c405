"""What a run is asked for in a file: read, overruled by options, and printed of a result."""

import shutil
import tomllib

import netCDF4
import numpy as np
import pytest
import xarray as xr

from tests import HOME
from tests.docs import readmes
from tests.helpers.commands import written

FILE = """
scheduler = "sync"
record = ["velocity_B"]
sample_rate = 10e3
[axes]
V = "2e-3,5e-3"
mu = [0.2, 0.3]
theta = 8
F = 9.0
[settings]
duration = 0.05
"""


pytestmark = pytest.mark.usefixtures("undrawn")


def same(one, other):
    """Values bit for bit; only computing times may differ."""
    with xr.open_dataset(one) as a, xr.open_dataset(other) as b:
        assert set(a.variables) == set(b.variables)
        for name in set(a.variables) - {"wall_time"}:
            np.testing.assert_array_equal(a[name].values, b[name].values, err_msg=str(name))
            assert str(a[name].attrs) == str(b[name].attrs)
        return a["status"].size


def test_a_result_prints_what_makes_it_again(tmp_path, here):
    spec = ("--set", "mu=0:0.5:26", "--set", "p1_length=0.06", "--set", "theta=0.1")
    assert here("run", "fig5", *spec, "-q").returncode == 0
    text = here("status", "fig5", "--toml").stdout
    assert tomllib.loads(text)["axes"] == {"mu": "0:0.5:26"}
    (tmp_path / "again.toml").write_text(text)
    assert here("run", "fig5", "--config", "again.toml", "--out", "there", "-q").returncode == 0
    assert same("results/fig5/fig5.nc", "there/fig5/fig5.nc") == 26
    # A result's path says it too.
    assert here("run", "results/fig5/fig5.nc", "--out", "third", "-q").returncode == 0
    assert same("results/fig5/fig5.nc", "third/fig5/fig5.nc") == 26
    assert "to do           0" in here("plan", "third/fig5/fig5.nc", "--out", "there").stdout
    # A file says more than a result.
    (tmp_path / "again.toml").write_text("settings.theta = 90")
    assert "theta = 90" in here("plan", "third/fig5/fig5.nc", "--config", "again.toml").stderr


def test_series_are_made_again_too(tmp_path, here):
    (tmp_path / "run.toml").write_text(FILE)
    assert here("run", "scenes", "--config", "run.toml", "-q").returncode == 0
    (tmp_path / "again.toml").write_text(here("status", "scenes", "--toml").stdout)
    again = tomllib.loads((tmp_path / "again.toml").read_text())
    assert again["axes"] == {"V": [2e-3, 5e-3], "theta": [8.0], "mu": [0.2, 0.3], "F": [9.0]}
    assert (again["record"], again["sample_rate"]) == (["velocity_B"], 10e3)
    assert here("run", "scenes", "--config", "again.toml", "--out", "there", "-q").returncode == 0
    assert same("results/scenes/scenes.nc", "there/scenes/scenes.nc") == 4


def test_options_win(tmp_path, here):
    (tmp_path / "run.toml").write_text(FILE)
    planned = here("plan", "scenes", "--config", "run.toml", "--set", "mu=0.1,0.2,0.3").stdout
    assert "grid            V 2 x theta 1 x mu 3 x F 1" in planned
    done = here("run", "scenes", "--config", "run.toml", "--scheduler", "cloud")
    assert "scheduler = 'cloud': it must be" in done.stderr
    assert written(tmp_path) == ["run.toml"]


def test_the_readmes_file(tmp_path, here):
    (text,) = readmes.blocks("toml")
    (tmp_path / "grid.toml").write_text(text)
    assert "points          160" in here("plan", "scenes", "--config", "grid.toml").stdout


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("axis = 1", "run.toml: axis: there is no such key; did you mean axes? the keys are study, axes"),
        ("axes = 1", "run.toml: axes = 1: it must be a table"),
        ("workers = true", "run.toml: workers = True: it must be a whole number"),
        ("record = 1", "run.toml: record = 1: it must be a list of texts"),
        ("record = [1]", "run.toml: record = [1]: it must be a list of texts"),
        ("axes.mu = true", "run.toml: mu = True: it must be a number, SPEC or a list"),
        ("axes.mo = 1", "axes.mo: study fig5 has nothing of that name there; did you mean mu? there are mu"),
        ("settings.mu = 1", "settings.mu: of study fig5 it is one of the axes; write it there"),
        ("axes.mu = '0:1'", "mu = '0:1': a range must be start:stop:count"),
        ("axes.mu = [0.1, 'a']", "it must be a number or a list of numbers"),
        ("study = 'fig6'", "study = 'fig6': STUDY is fig5; leave one out"),
        ("workers = 0", "workers = 0"),
        ("x y", "run.toml: it is not TOML: "),
    ],
)
def test_a_wrong_file_is_one_line(tmp_path, here, text, message):
    (tmp_path / "run.toml").write_text(text)
    done = here("run", "fig5", "--config", "run.toml")
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert written(tmp_path) == ["run.toml"]


def test_no_such_file_and_a_result_that_does_not_say_it(tmp_path, here):
    assert here("run", "fig5", "--config", "none.toml").stderr == (
        "fiv: --config none.toml: it cannot be read: No such file or directory\n"
    )
    shutil.copy(HOME / "results" / "reference" / "table4" / "table4.nc", tmp_path / "old.nc")
    with netCDF4.Dataset(tmp_path / "old.nc", "a") as file:
        file.configuration = '{"name": "table4", "axes": {}, "constants": {"theta": 5.0}}'
    done = here("run", "old.nc")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "old.nc: it does not say what it was asked for" in done.stderr
