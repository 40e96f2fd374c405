"""The command line as a user meets it: whole processes, their files, their signals and their exit codes."""

import json
import os
import re
import signal
import subprocess
import sys

import pytest

from tests.helpers.commands import begun, fiv, program, written


def test_run_prints_numbers_and_leaves_file_and_figure(tmp_path):
    done = fiv(tmp_path, "run", "fig5", "--set", "mu=0:0.5:51")
    assert done.returncode == 0
    assert "0.1112  2802" in done.stdout
    assert "onset = 1   2800    2802" in done.stdout
    assert written(tmp_path) == ["results/fig5/fig5.nc", "results/fig5/fig5.png"]
    assert "results/fig5/fig5.nc" in done.stderr
    assert "time to expect" in done.stderr
    # Nothing is drawn or coloured where there is no terminal.
    assert "\x1b" not in done.stdout + done.stderr
    assert "━" not in done.stderr


def test_quiet_leaves_only_data(tmp_path):
    done = fiv(tmp_path, "run", "table4", "-q", "--scheduler", "sync", "--workers", "1", "--yes")
    assert done.returncode == 0
    assert done.stderr == ""
    assert "Largest difference: 0.22 %" in done.stdout


def test_out_says_where(tmp_path):
    assert fiv(tmp_path, "run", "fig6", "--set", "mu=0:0.2:21", "--out", "there").returncode == 0
    assert written(tmp_path) == ["there/fig6/fig6.nc", "there/fig6/fig6.png"]


def test_plot_draws_again_by_name_and_by_path(tmp_path):
    fiv(tmp_path, "run", "fig5", "--set", "mu=0:0.5:26")
    figure = tmp_path / "results" / "fig5" / "fig5.png"
    for target in ("fig5", "results/fig5/fig5.nc"):
        figure.unlink()
        done = fiv(tmp_path, "plot", target)
        assert done.returncode == 0
        assert done.stdout.strip().endswith("fig5.png")
        assert figure.is_file()
    done = fiv(tmp_path, "plot", "results/fig5/fig5.nc", "--out", "there")
    assert done.stdout.strip() == "there/fig5.png"
    assert (tmp_path / "there" / "fig5.png").is_file()


def test_an_empty_file_is_one_line(tmp_path):
    (tmp_path / "empty.nc").touch()
    done = fiv(tmp_path, "plot", "empty.nc")
    assert done.returncode == 2
    assert done.stderr == "fiv: empty.nc: it is damaged or not netCDF\n"


def test_the_module_is_the_command(tmp_path):
    done = fiv(tmp_path, "--version", command=(sys.executable, "-m", "studies"))
    assert done.returncode == 0
    assert done.stdout.startswith("fiv, version ")


def test_verbose_adds_the_traceback(tmp_path):
    done = fiv(tmp_path, "plan", "fig55", "-v")
    assert done.returncode == 2
    assert "Traceback" in done.stderr
    assert done.stderr.strip().splitlines()[-1].startswith("fiv: STUDY = 'fig55'")


def test_a_store_of_something_else_is_exit_3(tmp_path):
    (tmp_path / "results" / "fig5").mkdir(parents=True)
    (tmp_path / "results" / "fig5" / "fig5.nc").write_text("mine")
    done = fiv(tmp_path, "run", "fig5", "-q")
    assert done.returncode == 3
    assert done.stderr.strip().endswith("fig5.nc is damaged or not netCDF; move it away or choose another folder")
    assert (tmp_path / "results" / "fig5" / "fig5.nc").read_text() == "mine"


def test_a_folder_in_place_of_the_figure_is_exit_3(tmp_path):
    (tmp_path / "results" / "table4" / "table4.png").mkdir(parents=True)
    done = fiv(tmp_path, "run", "table4", "-q")
    assert done.returncode == 3
    assert done.stderr.strip().count("\n") == 0
    assert "table4.png could not be written" in done.stderr


def test_a_file_in_place_of_the_folder_is_exit_3(tmp_path):
    (tmp_path / "results").write_text("mine")
    done = fiv(tmp_path, "run", "table4", "-q")
    assert done.returncode == 3
    assert done.stderr.strip().count("\n") == 0
    assert (tmp_path / "results").read_text() == "mine"


def test_failed_points_are_listed_and_exit_1(tmp_path):
    run = ("run", "fig5", "--set", "mu=0:0.5:3", "-q")
    done = fiv(tmp_path, command=program("picky", *run))
    assert done.returncode == 1
    assert "failed: mu = 0.25: ArithmeticError: not this one" in done.stderr
    assert "again, in Python: " in done.stderr
    assert "picky of __main__" in done.stderr
    assert written(tmp_path) == ["results/fig5/fig5.nc", "results/fig5/fig5.png"]
    # What failed is kept as failed, until it is asked for again.
    (tmp_path / "mended").touch()
    assert fiv(tmp_path, command=program("picky", *run)).returncode == 1
    again = fiv(tmp_path, command=program("picky", *run, "--retry-failed"))
    assert again.returncode == 0
    assert "failed" not in again.stderr


def test_verbose_shows_where_a_point_failed(tmp_path):
    done = fiv(tmp_path, command=program("picky", "run", "fig5", "--set", "mu=0:0.5:3", "-v"))
    assert done.returncode == 1
    assert "in picky" in done.stderr


def test_fail_fast_stops_and_keeps_what_was_done(tmp_path):
    done = fiv(tmp_path, command=program("picky", "run", "fig5", "--set", "mu=0:0.5:3", "-q", "--fail-fast"))
    assert done.returncode == 1
    assert done.stderr == "fiv: stopped at the first failure: mu = 0.25: ArithmeticError: not this one\n"
    assert any(name.startswith("results/fig5/fig5.parts/") for name in written(tmp_path))


def test_other_settings_are_exit_3_and_fresh_starts_over(tmp_path):
    run = ("run", "fig5", "--set", "mu=0:0.5:3", "-q")
    assert fiv(tmp_path, *run).returncode == 0
    before = (tmp_path / "results" / "fig5" / "fig5.nc").read_bytes()
    done = fiv(tmp_path, *run, "--set", "theta=8")
    assert done.returncode == 3
    assert done.stderr.strip().count("\n") == 0
    assert (
        "fig5.nc holds something else: theta = 5.0 there, 8.0 here; start over with fresh (--fresh)" in done.stderr
    )
    assert (tmp_path / "results" / "fig5" / "fig5.nc").read_bytes() == before
    fresh = fiv(tmp_path, *run, "--set", "theta=8", "--fresh")
    assert fresh.returncode == 0
    assert "theta = 8 degrees" in fresh.stdout


def test_ctrl_c_is_exit_130_and_the_same_command_goes_on(tmp_path):
    run = ("run", "fig5", "--set", "mu=0:0.5:31", "-q")
    running = begun(tmp_path, *run)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=60)
    assert running.returncode == 130
    kept = re.fullmatch(
        r"fiv: interrupted; (\d+) of 31 points are kept; go on from there with: fiv run fig5 --set mu=0:0.5:31 -q",
        said.strip(),
    )
    assert kept
    status = json.loads(fiv(tmp_path, "status", "fig5", "--json").stdout)
    assert status["state"] == "interrupted"
    assert status["done"] == int(kept[1])
    assert status["pending"] == 31 - int(kept[1])
    again = fiv(tmp_path, command=program("slow", *run[:-1]))
    assert again.returncode == 0
    assert f"cached          {kept[1]}" in again.stderr
    assert json.loads(fiv(tmp_path, "status", "fig5", "--json").stdout)["state"] == "complete"
    assert written(tmp_path) == ["results/fig5/fig5.nc", "results/fig5/fig5.png"]


def test_status_and_a_second_run_while_the_first_goes_on(tmp_path):
    run = ("run", "fig5", "--set", "mu=0:0.5:51")
    running = begun(tmp_path, *run)
    status = json.loads(fiv(tmp_path, "status", "fig5", "--json").stdout)
    text = fiv(tmp_path, "status", "fig5").stdout
    second = fiv(tmp_path, command=program("slow", *run, "-q"))
    _, said = running.communicate(timeout=60)
    assert running.returncode == 0, said
    assert status["state"] == "running"
    assert status["run"]["pid"] == running.pid
    assert status["run"]["todo"] == 51
    assert f"run by          process {running.pid} on " in text
    assert second.returncode == 3
    assert re.search(rf"fig5.nc is being written by process {running.pid} on .*, begun 20", second.stderr)
    assert second.stderr.strip().count("\n") == 0


def test_plain_lines_tell_of_progress_where_there_is_no_terminal(tmp_path):
    arguments = ("run", "fig5", "--set", "mu=0:0.5:9", "--scheduler", "sync")
    done = fiv(tmp_path, command=program("slow", *arguments))
    assert done.returncode == 0
    assert re.search(r"^fiv: \d+ of 9 done, [\d.]+ a second, .* left; now mu = 0", done.stderr, re.MULTILINE)
    assert "\x1b" not in done.stderr


@pytest.mark.slow
def test_workers_are_processes(tmp_path):
    done = fiv(tmp_path, "run", "fig5", "--set", "mu=0:0.5:2001", "--workers", "2", "-q")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    threads = fiv(tmp_path, "run", "fig5", "--set", "mu=0:0.5:2001", "-q", "--out", "there")
    assert threads.stdout == done.stdout


def test_a_scheduler_that_does_not_answer_is_one_line(tmp_path):
    environment = {k: v for k, v in os.environ.items() if k != "FIV_RESULTS"}
    environment["DASK_SCHEDULER_ADDRESS"] = "tcp://127.0.0.1:9"
    # Less patient than it is.
    impatient = (
        "import sys\nfrom sweeps.compute import cluster\nfrom studies.cli.main import main\n"
        "cluster.PATIENCE = 2.0\n"
        "sys.argv = ['fiv', 'run', 'fig5', '--set', 'mu=0:0.5:401', '-q']\nmain()"
    )
    run = [sys.executable, "-c", impatient]
    done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, env=environment)
    assert done.returncode == 2
    assert done.stderr.startswith("fiv: scheduler = 'tcp://127.0.0.1:9': no Dask scheduler answers there")
    assert done.stderr.strip().count("\n") == 0


def test_help_imports_nothing_heavy(tmp_path):
    program = (
        "import sys\n"
        "from studies.cli.main import main\n"
        "sys.argv = ['fiv', '--help']\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'scipy', 'numba', 'dask', 'xarray', 'matplotlib', 'netCDF4'} & set(sys.modules)\n"
        "print(sorted(heavy), file=sys.stderr)\n"
    )
    assert fiv(tmp_path, "-c", program, command=(sys.executable,)).stderr.strip() == "[]"


def test_a_first_run_says_that_it_compiles(tmp_path, monkeypatch):
    """Whatever the plan says of the points' own time."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    run = ("run", "fig5", "--set", "mu=0.1,0.2")
    assert "fiv: compiling once, about 8 s\n" in fiv(tmp_path, *run).stderr
    assert "compiling" not in fiv(tmp_path, *run, "--fresh").stderr
