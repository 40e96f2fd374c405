"""Commands from end to end: what they print, what they leave behind, and their exit codes."""

import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

from studies import registry, runner
from studies.asking.sweep import sweep_of
from studies.cli import execution, main, output
from studies.cli.app import fiv
from studies.cli.options import catalogue
from studies.gallery import fig5
from tests import HOME

FILES = ["results/fig5/fig5.nc", "results/fig5/fig5.png"]
OWN = ["results/squares/squares.nc", "results/squares/squares.png"]
THREE = ("run", "fig5", "--set", "mu=0:0.5:3")


def rows(done):
    return json.loads(done.stdout)


@pytest.mark.usefixtures("undrawn")
def test_run_prints_numbers_beside_the_papers_and_the_references(here, tmp_path):
    for name in ("fig5", "scenes", "stick_time"):
        shutil.copytree(HOME / "results" / "reference" / name, f"results/reference/{name}")
    (tmp_path / "results" / "reference" / "rig.svg").touch()
    done = here("query", "fig5", "--limit", "1")
    assert "results/fig5 has no result; this is the reference" in done.stderr
    assert "--limit N prints fewer" not in done.stderr
    assert re.search(r"fiv: \d{4} rows; --limit N prints fewer", here("query", "stick_time").stderr)
    done = here("run", "fig5", "--set", "mu=0:0.5:51")
    assert done.returncode == 0
    assert "0.1112" in done.stdout
    assert "Beside the paper" in done.stdout
    assert "\nfound: Steady sliding flutters from mu = 0.1112 on" in done.stderr
    assert "beside the reference: no difference" in done.stderr  # beyond rounding, by another processor
    assert str(tmp_path / FILES[1]) in done.stderr
    assert "\x1b" not in done.stdout + done.stderr
    done = here("run", "fig5", "--out", "results/reference", "-q")
    assert (done.returncode, "runs only read the reference" in done.stderr) == (2, True)
    # Draws have no partners in the reference's grid.
    point = ("--set", "V=2e-3", "--set", "theta=5", "--set", "F=9", "--samples", "2")
    done = here("run", "scenes", "--scatter", "mu=normal:0.2:0.02", *point)
    assert (done.returncode, "beside the reference" in done.stderr) == (0, False)


def test_bare_fiv_is_help_and_every_command_has_it(here):
    bare = here()
    assert (bare.returncode, bare.stderr) == (0, "")
    assert "\n  status  " in bare.stdout
    assert re.fullmatch(r"fiv \S+ \(commit \S+\)\n", here("--version").stdout)
    assert max(map(len, bare.stdout.splitlines())) <= 80
    for name in main.fiv.commands:
        done = here(name, "--help")
        assert (done.returncode, done.stderr) == (0, "")
        assert max(map(len, done.stdout.splitlines())) <= 80
        assert f"Usage: fiv {name}" in done.stdout
        assert "--verbose" in done.stdout


def test_list_shows_every_study_with_its_time_and_all_of_one(here):
    done = here("list")
    assert all(f"\n{name} " in f"\n{done.stdout}" for name in registry.NAMES)
    assert done.stdout.splitlines()[1].startswith(" " * (len("sensitivity") + 2) + "Does")
    assert "501 points, instantly" in done.stdout
    assert f"2304 points, {output.rough_duration(catalogue()['stick_time']['seconds'])}" in done.stdout
    assert len(here("list", "-q").stdout.splitlines()) == len(registry.NAMES)
    one = here("list", "fig5").stdout
    assert "Paper: Section 3.4.2 and Fig. 5" in one
    assert "p2_thickness" in one


def test_plan_computes_and_writes_nothing_and_takes_the_references_time(here, folder, own, monkeypatch):
    calls = []

    def counted(rig, theta, mu):
        calls.append(len(mu))
        return fig5.modes(rig, theta, mu)

    monkeypatch.setattr(fig5, "STUDY", replace(fig5.STUDY, function=counted))
    done = here("plan", "fig5", "--set", "mu=0:0.5:101")
    assert [f"{word:<15} 101" in done.stdout for word in ("points", "distinct", "to do")] == [True] * 3
    assert "instantly, as the reference took; fiv plan --time measures" in done.stdout
    assert not calls
    assert "as the reference" not in here("plan", "fig5", "--time").stdout
    assert calls
    # Whatever machine has computed the reference.
    known = {"regimes": {"points": 1600, "seconds": 124.1}, "stick_time": {"points": 2304, "seconds": 486.9}}
    monkeypatch.setattr(execution, "catalogue", lambda: known)
    study, plan = runner.plan_map("F=2:30:8", None, "velocity_rms", {"members": 4})
    assert "about 2 s on one core, as the reference took\n" in execution.estimated(study, plan)[1]
    # Of the reference's 8.11 minutes a quarter of the points takes a quarter; so few are measured as too slow.
    plan = sweep_of(fig5.STUDY, {"mu": np.linspace(0.0, 0.5, 576)}).plan()
    for seconds, text in ((np.nan, "about 2 min on one core, as the reference"), (300.0, "about 2 min"),
                          (60.0, "60 s on one core"), (3e3, "50 min on one core")):  # fmt: skip
        assert text in execution.estimated(registry.load("stick_time"), replace(plan, seconds=seconds))[1]
    few = replace(plan, seconds=150.0, todo=288)
    assert "about 61 s" in execution.estimated(registry.load("stick_time"), few)[1]
    assert "unknown" in here("plan", "own.py").stdout
    assert not folder()


@pytest.mark.usefixtures("undrawn")
def test_stored_points_are_not_computed_again_and_other_settings_are_refused(here, folder):
    here("run", "fig5", "--set", "mu=0:0.5:11", "-q")
    planned = here("plan", "fig5", "--set", "mu=0:0.5:21").stdout
    assert "cached          11" in planned
    # Of a part of the stored points the answer is that part, and the file keeps all.
    part = here("run", "fig5", "--set", "mu=0.2,0.3")
    assert "to do           0" in part.stderr
    assert "points        11" in here("status", "fig5").stdout
    done = here(*THREE, "--set", "theta=8", "-q")
    assert done.returncode == 3
    assert "theta = 5.0 there, 8.0 here; choose another folder (--out), or start over (--fresh)" in done.stderr
    fresh = here(*THREE, "--set", "theta=8", "--fresh", "-q")
    assert (fresh.returncode, fresh.stderr) == (0, "")
    assert "θ = 8°" in fresh.stdout


def test_what_a_result_says_is_never_run(here, own, folder):
    """Its own study is presented as any other. (A study through every command: tests/docs/test_readme.py.)"""
    done = here("run", "own.py", "-q")
    assert (done.returncode, done.stderr) == (0, "")
    assert folder() == OWN
    assert rows(here("status", "own.py", "--json"))["done"] == 6
    found = rows(here("query", "own.py", "--where", "y > 10 and kind == 'plain'", "--format", "json"))
    assert [(row["x"], row["y"]) for row in found] == [(3.0, 18.0), (4.0, 32.0)]
    assert here("plot", OWN[0], "--out", "there").stdout == "there/squares.png\n"
    with netCDF4.Dataset(OWN[0], "a") as data:
        data.sweep = str(own)
    registry._registered.clear()
    assert here("plot", OWN[0]).returncode == 0


@pytest.mark.usefixtures("undrawn")
def test_failed_points_are_listed_once_and_exit_1(here, own):
    done = here("run", "own.py", "--set", "x=1,2,3")
    assert done.returncode == 1
    assert done.stdout.count("ValueError: two is too much") == 1
    assert "2 of 6 points failed" in done.stdout
    assert "again with: fiv run own.py --set x=2" in done.stderr
    assert here("run", "own.py", "--set", "x=1,2,3", "-q").returncode == 1
    all_failed = here("run", "own.py", "--set", "x=2", "--out", "two", "-q")
    assert (all_failed.returncode, all_failed.stdout.count("two is too much")) == (1, 1)
    fast = here("run", "own.py", "--set", "x=1,2,3", "--fail-fast", "--out", "fast", "-q")
    assert (fast.returncode, fast.stderr.count("\n")) == (1, 1)
    assert fast.stderr.startswith("fiv: stopped at the first failure: ")
    (own.parent / "mended").touch()
    assert here("run", "own.py", "--set", "x=1,2,3", "--retry-failed", "-q").returncode == 0


@pytest.mark.usefixtures("undrawn")
def test_a_failed_point_of_a_predefined_study_comes_with_its_command(here, monkeypatch):
    def picky(rig, theta, mu):
        if np.any(mu == 0.25) and not os.path.exists("mended"):
            raise ArithmeticError("not this one")
        return fig5.modes(rig, theta, mu)

    monkeypatch.setattr(fig5, "STUDY", replace(fig5.STUDY, function=picky))
    done = here(*THREE, "-v")
    assert done.returncode == 1
    assert "in picky" in done.stderr
    again = done.stderr.splitlines()[-1].partition("again with: fiv ")[2]
    assert again.startswith("run fig5 --set mu=0.25 --scheduler sync --out again")
    assert here(*again.split()).returncode == 1
    # Parameters that have one value are in it too.
    other = here(*THREE, "--set", "theta=6", "--set", "p1_length=60mm", "--out", "other", "-q")
    again = other.stderr.splitlines()[-1].partition("again with: fiv ")[2]
    assert again.startswith("run fig5 --set mu=0.25 --set theta=6 --set p1_length=0.06 --scheduler sync")
    assert here(*again.split()).returncode == 1
    Path("mended").touch()
    assert here(*THREE, "-q").returncode == 1
    assert here(*THREE, "-q", "--retry-failed").returncode == 0


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    "options",
    [
        ("--scatter", "p1_length=normal:50:0.1mm", "--set", "mu=0.1,0.2", "--samples", "4", "--seed", "3"),
        ("--points", "points.csv"),
        ("--config", "run.toml"),
    ],
)
def test_a_result_is_made_again_bit_for_bit(here, options, tmp_path):
    (tmp_path / "points.csv").write_text("p1_length [mm], mu\n50, 0.1\n60, 0.2\n")
    (tmp_path / "run.toml").write_text('set = {theta = "8deg", mu = [0.1, 0.2]}\nscheduler = "sync"\n')
    assert here("run", "fig5", *options, "-q").returncode == 0
    assert here("run", FILES[0], "--out", "again", "-q").returncode == 0
    one, other = (xr.open_dataset(f"{place}/fig5/fig5.nc") for place in ("results", "again"))
    with one, other:
        xr.testing.assert_identical(
            one.drop_attrs().drop_vars("wall_time"), other.drop_attrs().drop_vars("wall_time")
        )
        names = ("axes", "constants", "request")
        kept = [json.loads(data.attrs["configuration"]) for data in (one, other)]
        assert [each["request"].pop("command").split()[:3] for each in kept] == [
            ["fiv", "run", "fig5"],
            ["fiv", "run", FILES[0]],
        ]
        assert [kept[0].get(name) for name in names] == [kept[1].get(name) for name in names]


def test_options_win_over_a_file_and_a_draw_may_be_a_value(here, tmp_path):
    (tmp_path / "run.toml").write_text('study = "fig5"\n[set]\nmu = "0:0.5:3"\ntheta = 8\n')
    assert "grid            mu 1\n" in here("plan", "fig5", "--config", "run.toml", "--set", "mu=0.1").stdout
    assert "STUDY is table4" in here("plan", "table4", "--config", "run.toml").stderr
    plans = [here("plan", "fig5", name, "theta=normal:5:1", "--samples", "4") for name in ("--set", "--scatter")]
    assert plans[0].stdout == plans[1].stdout
    assert "sample 4" in plans[0].stdout


@pytest.mark.usefixtures("undrawn")
def test_status_without_a_name_is_a_table_of_the_folder(here, own, folder):
    assert here("status").stdout == "results has no results; begin with: fiv run fig5\n"
    here("run", "own.py", "-q")
    here("run", "fig5", "--set", "mu=0.1,0.2", "-q")
    os.makedirs("results/broken")
    Path("results/broken/broken.nc").write_text("mine", encoding="utf-8")
    cells = [re.split(r"  +", line) for line in here("status").stdout.splitlines()]
    assert cells[0] == ["name", "kind", "points", "state", "size", "date", "age"]
    assert [row[:4] for row in cells[1:]] == [
        ["broken", "own study", "-", "unreadable"],
        ["fig5", "study", "2", "complete"],
        ["squares", "own study", "6", "complete"],
    ]
    assert [row["name"] for row in rows(here("status", "--json"))] == ["broken", "fig5", "squares"]
    assert here("list").stdout.startswith("Your results in results:\nname ")


@pytest.mark.usefixtures("undrawn")
def test_results_are_named_where_a_study_is(here, own):
    here("map", "--x", "theta=1:5:2", "--quantity", "glued_frequency_1", "-q")
    here("run", "own.py", "-q")
    assert "cached          2" in here("plan", "glued-theta").stdout
    assert "2 points" in here("list", "glued-theta").stdout
    assert "Squares" in here("list", "squares").stdout


@pytest.mark.usefixtures("undrawn")
def test_an_installed_study_is_known_by_its_name(here, own, tmp_path, monkeypatch):
    about = tmp_path / "site" / "owner-1.0.dist-info"
    about.mkdir(parents=True)
    shutil.copy(own, about.parent / "owner.py")
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: owner\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[fiv.studies]\nsquares = owner:STUDY\nfig5 = owner:STUDY\n")
    monkeypatch.syspath_prepend(about.parent)
    monkeypatch.setattr(registry, "installed", registry.installed.__wrapped__)
    assert here("list").stdout.count("Squares") == 1  # a predefined study keeps its name
    assert here("run", "squares", "-q").returncode == 0


def test_what_moves_is_written_and_other_studies_say_which_can(here, monkeypatch, tmp_path):
    monkeypatch.setattr("studies.plotting.moving.FILMED", 2)
    for name in ("fig6", "fig5"):
        file = tmp_path / "results" / name / f"{name}.nc"
        file.parent.mkdir(parents=True)
        shutil.copy(HOME / "results" / "reference" / name / file.name, file)
    done = here("plot", "fig6", "--animate", "--vtu")
    assert (done.returncode, done.stdout) == (0, "results/fig6/fig6.gif\nresults/fig6/fig6.pvd\n")
    series = (tmp_path / "results" / "fig6" / "fig6.pvd").read_text()
    named = re.findall(r'file="([^"]+)"', series)
    assert len(named) == len({*named}) == 48
    assert all((tmp_path / "results" / "fig6" / name).is_file() for name in named)
    done = here("plot", "--animate", "fig6", "--out", "first")
    assert (done.returncode, "compute it with: fiv run fig6" in done.stderr) == (2, True)
    done = here("plot", "fig5", "--animate")
    assert (done.returncode, done.stdout) == (2, "")
    assert "fig5: the study has no animation; fig6, contact have one" in done.stderr


def optional_values():
    """Each option whose value may be left out, with its command."""
    for name, one in fiv.commands.items():
        yield from ((name, each) for each in one.params if isinstance(getattr(each, "flag_value", None), str))


@pytest.mark.parametrize(("name", "option"), [*optional_values()])
def test_an_option_whose_value_may_be_left_out_takes_no_argument(name, option):
    for word in option.type.choices:
        for before in ([], [word]):
            words = [option.opts[0], *before, "fig6"]
            given = fiv.commands[name].make_context(name, words, resilient_parsing=True)
            assert given.args == []
            assert given.params[option.name] == (before[0] if before else option.flag_value)
            assert "fig6" in given.params.values()
