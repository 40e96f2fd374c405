"""The command line as a user meets it: its files and exit codes; in whole processes its signals and locks."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace

import dask
import numba
import pytest

from studies import registry
from studies.cli import progress
from studies.gallery import fig5
from sweeps.compute import cluster
from sweeps.task import Task
from tests.helpers.commands import begun, fiv, written

FILES = ["results/fig5/fig5.nc", "results/fig5/fig5.png"]
THREE = ("run", "fig5", "--set", "mu=0:0.5:3")


def picky(points, **constants):
    if (points["mu"] == 0.25).any() and not os.path.exists("mended"):
        raise ArithmeticError("not this one")
    return fig5.modes(points, **constants)


@pytest.fixture
def instead(monkeypatch):
    """Give fig5 another function."""
    return lambda function: monkeypatch.setattr(fig5, "STUDY", replace(fig5.STUDY, function=function))


def test_run_prints_numbers_and_leaves_file_and_figure(tmp_path):
    done = fiv(tmp_path, "run", "fig5", "--set", "mu=0:0.5:51")
    assert done.returncode == 0
    assert "0.1112  2802" in done.stdout
    assert "onset = 1   2800    2802" in done.stdout
    assert written(tmp_path) == FILES
    assert FILES[0] in done.stderr
    assert "estimated time" in done.stderr
    # Nothing is drawn or coloured where there is no terminal.
    assert "\x1b" not in done.stdout + done.stderr
    assert "━" not in done.stderr


def test_quiet_leaves_only_data_and_out_says_where(tmp_path, here):
    done = here("run", "table4", "-q", "--scheduler", "sync", "--workers", "1", "--yes", "--out", "there")
    assert (done.returncode, done.stderr) == (0, "")
    assert "Largest difference: 0.22 %" in done.stdout
    assert written(tmp_path) == ["there/table4/table4.nc", "there/table4/table4.png"]


def test_plot_draws_again_by_name_and_by_path(tmp_path, here):
    here(*THREE)
    for arguments, figure in (
        (["fig5"], FILES[1]),
        ([FILES[0]], FILES[1]),
        ([FILES[0], "--out", "there"], "there/fig5.png"),
    ):
        (tmp_path / figure).unlink(missing_ok=True)
        done = here("plot", *arguments)
        assert (done.returncode, done.stdout.strip()) == (0, figure)
        assert (tmp_path / figure).is_file()


def test_verbose_adds_the_traceback(here):
    done = here("plan", "fig55", "-v")
    assert done.returncode == 2
    assert "Traceback" in done.stderr
    assert done.stderr.strip().splitlines()[-1].startswith("fiv: STUDY = 'fig55'")


@pytest.mark.parametrize(
    ("taken", "message"),
    [
        ("results/table4/table4.nc", "table4.nc is damaged or not netCDF; move it away or choose another"),
        ("results/table4/table4.png/mine", "table4.png could not be written"),
        ("results", ""),
    ],
)
def test_what_stands_in_the_way_is_exit_3_and_stays(tmp_path, here, taken, message):
    (tmp_path / taken).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / taken).write_text("mine")
    done = here("run", "table4", "-q")
    assert (done.returncode, done.stderr.count("\n")) == (3, 1)
    assert message in done.stderr
    assert (tmp_path / taken).read_text() == "mine"


@pytest.mark.usefixtures("undrawn")
def test_failed_points_are_listed_and_exit_1(tmp_path, here, instead):
    instead(picky)
    done = here(*THREE, "-q", "--fail-fast")
    assert done.returncode == 1
    assert done.stderr == "fiv: stopped at the first failure: mu = 0.25: ArithmeticError: not this one\n"
    assert any(name.startswith("results/fig5/fig5.nc.parts/") for name in written(tmp_path))
    done = here(*THREE, "-v")
    assert done.returncode == 1
    assert "failed: mu = 0.25: ArithmeticError: not this one" in done.stderr
    again = "compute one of them again with: fiv run fig5 --set mu=0.25 --scheduler sync --out again"
    assert done.stderr.splitlines()[-1] == again
    assert "in picky" in done.stderr
    assert written(tmp_path) == FILES[:1]
    assert here(*again.partition(": fiv ")[2].split()).returncode == 1
    # The failure is stored until --retry-failed.
    (tmp_path / "mended").touch()
    assert here(*THREE, "-q").returncode == 1
    again = here(*THREE, "-q", "--retry-failed")
    assert again.returncode == 0
    assert "failed" not in again.stderr


def test_a_run_whose_first_points_all_fail_alike_stops(tmp_path, here, instead):
    """And leaves nothing that a corrected function would be refused for."""
    instead(lambda points, **constants: points["nu"])
    done = here("run", "fig5", "-q")
    said = "fiv: stopped, since the first points all failed alike: mu = 0.0: KeyError: 'nu'\n"
    assert (done.returncode, done.stdout, done.stderr) == (1, "", said)
    assert written(tmp_path) == []


@pytest.mark.usefixtures("undrawn")
def test_other_settings_are_exit_3_and_fresh_starts_over(here):
    assert here(*THREE, "-q").returncode == 0
    done = here(*THREE, "-q", "--set", "theta=8")
    assert (done.returncode, done.stderr.count("\n")) == (3, 1)
    assert "fig5.nc has other results: theta = 5.0 there, 8.0 here; start over with fresh (--f" in done.stderr
    fresh = here(*THREE, "-q", "--set", "theta=8", "--fresh")
    assert fresh.returncode == 0
    assert "theta = 8 degrees" in fresh.stdout


def test_ctrl_c_is_exit_130_and_the_same_command_goes_on(tmp_path, here):
    """While it runs its state is told, and a second run is refused."""
    run = ("run", "fig5", "--set", "mu=0:0.5:31", "-q")
    running = begun(tmp_path, *run)
    status = json.loads(here("status", "fig5", "--json").stdout)
    text, second = here("status", "fig5").stdout, here(*run)
    running.send_signal(signal.SIGINT)
    (tmp_path / "go").touch()
    _, said = running.communicate(timeout=60)
    (tmp_path / "go").unlink()
    assert status["state"] == "running"
    assert (status["run"]["pid"], status["run"]["todo"]) == (running.pid, 31)
    assert f"run by          process {running.pid} on " in text
    assert (second.returncode, second.stderr.count("\n")) == (3, 1)
    assert re.search(rf"fig5.nc is being written by process {running.pid} on .*, begun 20", second.stderr)
    assert running.returncode == 130
    kept = re.fullmatch(
        r"fiv: interrupted; (\d+) of 31 points are kept; go on from there with: fiv run fig5 --set mu=0:0.5:31 -q",
        said.strip(),
    )
    assert kept
    status = json.loads(here("status", "fig5", "--json").stdout)
    assert status["state"] == "interrupted"
    assert (status["done"], status["pending"]) == (int(kept[1]), 31 - int(kept[1]))
    again = here(*run[:-1])
    assert again.returncode == 0
    assert f"cached          {kept[1]}" in again.stderr
    assert json.loads(here("status", "fig5", "--json").stdout)["state"] == "complete"
    assert written(tmp_path) == FILES


@pytest.mark.parametrize("module", ["typing", "click", "studies.cli.read"])
def test_ctrl_c_is_exit_130_before_all_is_imported(tmp_path, module):
    program = (
        "import sys\n"
        "class Interrupted:\n"
        "    def find_spec(self, name, *rest):\n"
        f"        if name == {module!r}:\n"
        "            raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupted())\n"
        f"sys.modules.pop({module!r}, None)\n"
        "from studies.cli.main import main\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "fiv: interrupted\n")


@pytest.mark.usefixtures("undrawn")
def test_plain_lines_tell_of_progress_where_there_is_no_terminal(here, monkeypatch):
    compute = Task.compute

    def slowly(self, points):
        time.sleep(0.05 * len(points["mu"]))
        return compute(self, points)

    monkeypatch.setattr(Task, "compute", slowly)
    monkeypatch.setattr(progress, "INTERVAL", 0.05)
    done = here("run", "fig5", "--set", "mu=0:0.5:9", "--scheduler", "sync")
    assert done.returncode == 0
    assert re.search(r"^fiv: \d+ of 9 done, [\d.]+ a second, .* left; now mu = 0", done.stderr, re.MULTILINE)
    assert "\x1b" not in done.stderr


def test_a_scheduler_that_does_not_answer_is_one_line(here, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT", 0.5)
    with dask.config.set({"scheduler-address": "tcp://127.0.0.1:9"}):  # DASK_SCHEDULER_ADDRESS
        done = here("run", "fig5", "--set", "mu=0:0.5:401", "-q")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert done.stderr.startswith("fiv: scheduler = 'tcp://127.0.0.1:9': no Dask scheduler answers there")


def test_help_and_list_import_nothing_heavy_and_compute_nothing(tmp_path):
    program = (
        "import sys\n"
        "from studies.cli.main import main\n"
        "for command in ('--help', 'list'):\n"
        "    sys.argv = ['fiv', command]\n"
        "    try:\n        main()\n    except SystemExit:\n        pass\n"
        "heavy = {'numpy', 'scipy', 'numba', 'dask', 'xarray', 'matplotlib', 'netCDF4'} & set(sys.modules)\n"
        "print(sorted(heavy), file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True)
    assert done.stderr == "[]\n"
    assert all(f"\n{name} " in done.stdout for name in registry.NAMES)


@pytest.mark.usefixtures("undrawn")
def test_a_run_says_once_that_it_compiles(here, instead):
    """Whatever the plan says of the points' own time."""
    kernels = [numba.njit(lambda x: x + 1.0), numba.njit(lambda x: x + 2.0)]

    def compiling(points, **constants):
        for kernel in kernels:
            kernel(1.0)
        return fig5.modes(points, **constants)

    instead(compiling)
    assert here(*THREE).stderr.count("fiv: compiling once, about 8 s\n") == 1
    assert "compiling" not in here(*THREE, "--fresh").stderr


def test_the_standard_error_asked_for_is_a_setting_of_studies_that_run_until_it_is_reached(tmp_path, here):
    place = ["--set", "V=2e-2", "--set", "theta=5", "--set", "mu=0.2", "--set", "F=9"]
    done = here("run", "scenes", *place, "--standard-error", "0.05", "-q")
    assert done.returncode == 0
    assert "until the shares of time are known to 0.05" in done.stdout
    found = here("query", "scenes", "--show", "stick_fraction_se,standard_error", "--format", "json")
    (row,) = json.loads(found.stdout)
    assert 0.0 < row["stick_fraction_se"] <= 0.05 == row["standard_error"]
    done = here("plan", "fig5", "--standard-error", "0.01")
    assert done.returncode == 2
    assert "standard_error" in done.stderr
    done = here(
        "map", "--x", "V=1e-3,2e-3", "--y", "mu=0.1,0.2", "--quantity", "growth_rate", "--standard-error", "1"
    )
    assert (done.returncode, "growth_rate does not depend on it" in done.stderr) == (2, True)
