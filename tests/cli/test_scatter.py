"""Draws and tables in a grid's place, as one types them."""

import re
import tomllib

import pytest
import xarray as xr
from click.shell_completion import ShellComplete

from studies.cli.main import fiv
from tests.helpers.commands import written

pytestmark = pytest.mark.usefixtures("undrawn")
SCATTER = ("--scatter", "mu=normal:0.05:0.02", "--scatter", "p1_thickness=uniform:1.4e-3:1.6e-3", "--seed", "1")


def test_a_scattered_study_from_the_plan_to_the_query(tmp_path, here):
    planned = here("plan", "fig5", *SCATTER, "--samples", "16")
    assert "sweep           fig5-scatter\ngrid            sample 16\npoints          16" in planned.stdout
    assert written(tmp_path) == []
    done = here("run", "fig5", *SCATTER, "--samples", "16")
    cut = "mu: 0.62 % of normal:0.05:0.02 is below 0 and was cut away"
    assert done.returncode == 0, done.stderr
    assert f"fiv: {cut}\n" in done.stderr
    assert done.stdout.startswith("16 draws (sobol, seed 1) of mu, p1_thickness: 16 points computed, 0 failed.\n")
    assert cut in done.stdout
    assert re.search(r"^frequency, mode = 1 .* Hz .*\d$", done.stdout, re.MULTILINE)
    assert written(tmp_path) == ["results/fig5-scatter/fig5-scatter.nc"]
    # More go on from there; the order of the options makes no difference.
    mu, thickness = SCATTER[:2], SCATTER[2:4]
    more = here("plan", "fig5", *thickness, *mu, "--seed", "1", "--samples", "40").stdout
    assert "cached          16\nto do           24" in more
    rows = here("query", "fig5-scatter", "--where", "mu > 0.05 and mode == 1", "--show", "sample,mu,frequency")
    assert len(rows.stdout.splitlines()) == 10
    assert "points          16\ndone            16" in here("status", "fig5-scatter").stdout
    with xr.open_dataset("results/fig5-scatter/fig5-scatter.nc") as data:
        assert data["mu"].attrs["comment"] == cut


def test_a_result_is_made_again(tmp_path, here):
    assert here("run", "fig5", *SCATTER, "--samples", "4", "--set", "theta=7", "-q").returncode == 0
    text = here("status", "fig5-scatter", "--toml").stdout
    asked = tomllib.loads(text)
    assert asked["scatter"] == {"mu": "normal:0.05:0.02", "p1_thickness": "uniform:0.0014:0.0016"}
    assert (asked["study"], asked["samples"], asked["seed"], asked["sampling"]) == ("fig5", 4, 1, "sobol")
    assert asked["settings"]["theta"] == 7.0
    (tmp_path / "again.toml").write_text(text)
    assert here("run", "fig5", "--config", "again.toml", "--out", "there", "-q").returncode == 0
    path = "results/fig5-scatter/fig5-scatter.nc"
    assert "to do           0" in here("plan", path, "--out", "there").stdout
    # Options win.
    assert "sample 8" in here("plan", path, "--samples", "8").stdout
    other = here("run", path, "--seed", "2")
    assert (other.returncode, other.stderr.count("\n")) == (3, 1)
    assert 'sample method = "sobol, seed 1" there, "sobol, seed 2" here; start over' in other.stderr


def test_rows_of_a_table(tmp_path, here):
    (tmp_path / "rigs.csv").write_text("p1_thickness [mm],mu\n1.5,0.2\n1.55,0.25\n")
    done = here("run", "fig5", "--points", "rigs.csv")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("2 rows of a table of p1_thickness, mu: 2 points computed, 0 failed.")
    columns = here(
        "query", "fig5-points", "--where", "mode == 3", "--show", "row,p1_thickness,mu", "--format", "csv"
    )
    assert columns.stdout.split() == ["row,p1_thickness,mu,mode", "1,0.0015,0.2,3", "2,0.00155,0.25,3"]
    asked = tomllib.loads(here("status", "fig5-points", "--toml").stdout)
    assert asked["points"] == {"p1_thickness": [1.5e-3, 1.55e-3], "mu": [0.2, 0.25]}
    assert "to do           2" in here("plan", "results/fig5-points/fig5-points.nc", "--out", "there").stdout
    # A file of a configuration names a table too.
    (tmp_path / "run.toml").write_text('points = "rigs.csv"')
    assert "to do           0" in here("plan", "fig5", "--config", "run.toml").stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--scatter", "mu=normal:0.2:0.02", "--set", "mu=0.1"), "--scatter mu: it is set too"),
        (("--scatter", "mu"), "--scatter 'mu': it must be NAME=DISTRIBUTION, for example mu=normal:0.2:0.02"),
        (("--scatter", "mu=norm:1:2"), "'norm' is none of normal, uniform, lognormal, triangular"),
        (
            ("--scatter", "mo=normal:1:2"),
            "--scatter mo: study fig5 has no axis and no setting of that name; did you",
        ),
        (("--scatter", "mu=normal:1:2", "--scatter", "mu=normal:1:2"), "mu scatters already; give it once"),
        (("--scatter", "mu=normal:1:2", "--samples", "0"), "--samples = 0: it must be a whole number from 1"),
        (("--scatter", "mu=normal:1:2", "--sampling", "grid"), "--sampling = 'grid': it must be one of sobol"),
        (("--samples", "8"), "--samples 8: it says how numbers are drawn; say which with --scatter"),
        (("--points", "bad.csv"), "--points bad.csv: line 3, column mu: 'much': it must be a finite number"),
        (("--points", "none.csv"), "--points none.csv: it cannot be read: No such file or directory"),
        (("--points", "bad.csv", "--scatter", "mu=normal:1:2"), "each says where the points are; leave one out"),
        (("--config", "bad.toml"), "bad.toml: scatter.mu = 1: it must be a text, like 'normal:0.2:0.02'"),
    ],
)
@pytest.mark.parametrize("verb", ["plan", "run"])
def test_wrong_input_is_one_line_and_leaves_nothing(tmp_path, here, verb, arguments, message):
    (tmp_path / "bad.csv").write_text("mu\n0.2\nmuch\n")
    (tmp_path / "bad.toml").write_text("scatter.mu = 1")
    done = here(verb, "fig5", *arguments, "-q")
    assert (done.returncode, done.stdout) == (2, "")
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert written(tmp_path) == ["bad.csv", "bad.toml"]


def test_a_name_without_points(tmp_path, here):
    done = here("run", "fig5-scatter")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "fiv run fig5 --scatter NAME=DISTRIBUTION, or --points FILE.csv" in done.stderr
    done = here("query", "fig5-points")
    assert done.stderr.endswith("there is no such file; make it with: fiv run fig5 --points FILE.csv\n")
    assert "did you mean fig5?" in here("status", "fig55-scatter").stderr
    assert written(tmp_path) == []


def test_names_are_completed():
    def offered(*before):
        return [
            i.value
            for i in ShellComplete(fiv, {}, "fiv", "_FIV_COMPLETE").get_completions([*before[:-1]], before[-1])
        ]

    assert offered("run", "fig5", "--scatter", "m") == ["mu="]
    assert offered("run", "scenes", "--scatter", "nu") == []
    assert offered("run", "scenes", "--set", "nu") == ["numerical_damping="]


def test_a_map_of_probability_scatters_what_it_is_told(tmp_path, here):
    plane = ("--x", "theta=5:6:2", "--y", "mu=0.1:0.2:3", "--quantity", "probability_unstable", "--samples", "32")
    done = here("map", *plane, "--scatter", "p1_length=normal:50:0.1mm", "--scatter", "d1=normal:50:40")
    assert done.returncode == 0, done.stderr
    assert "fiv: d1: 11 % of normal:50:40 is below 0 and was cut away" in done.stderr
    assert "length of P1            normal:0.05:0.0001" in done.stdout
    assert "Each point is a share of 32 rigs, seed 0" in done.stdout
    name = "probability_unstable-theta-mu-samples=32-d1=normal:50:40-p1_length=normal:50:0.1mm.nc"
    assert written(tmp_path) == [f"results/map/{name}"]
    # The same with more rigs, without a scatter, and along one axis are other files.
    assert here("map", *plane[:-1], "16").returncode == 0
    assert here("map", "--x", "mu=0.1:0.12:3", *plane[4:], "--seed", "3").returncode == 0
    assert len(written(tmp_path)) == 3
    wrong = here("map", *plane, "--scatter", "theta=normal:5:1")
    assert (wrong.returncode, wrong.stderr) == (
        2, "fiv: --scatter theta: it is an axis of this map; leave it out\n"
    )  # fmt: skip
    assert here("map", *plane, "--scatter", "p1_lenght=normal:5:1").stderr.startswith(
        "fiv: --scatter p1_lenght: it cannot scatter here; did you mean p1_length?"
    )


def test_the_study_of_scattered_rigs_scatters_what_it_is_told(here):
    small = ("--set", "theta=5", "--set", "mu=0.1,0.12", "--set", "sobol_samples=4", "--samples", "16")
    done = here("run", "robust", "--scatter", "p1_length=normal:50:0.1mm", *small)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("16 rigs, theta from 5 to 5 degrees")
    text = here("status", "robust", "--toml").stdout
    asked = tomllib.loads(text)
    assert asked["scatter"] == {"p1_length": "normal:0.05:0.0001"}
    assert asked["axes"] == {"theta": [5.0], "mu": [0.1, 0.12]}
    assert asked["settings"]["samples"] == 16.0
    again = here("plan", "results/robust/robust.nc")
    assert "to do           0" in again.stdout, again.stderr
    other = here("run", "robust", *small)
    assert other.returncode == 3
    assert "scatter.contact_position = nothing there" in other.stderr
    axis = here("run", "robust", "--scatter", "theta=normal:5:1")
    assert (axis.returncode, axis.stderr.count("\n")) == (2, 1)
    rows = here("query", "robust", "--where", "onset_mu < 0.1112", "--show", "sample,p1_length,onset_mu")
    assert 1 < len(rows.stdout.splitlines()) < 17
