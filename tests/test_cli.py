"""The command line as a user meets it: every command, every message, every exit code."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from studies import registry

FIV = str(Path(sys.executable).with_name("fiv"))


def fiv(folder, *arguments, command=(FIV,)):
    environment = {k: v for k, v in os.environ.items() if k != "FIV_RESULTS"}
    return subprocess.run([*command, *arguments], cwd=folder, capture_output=True, text=True, env=environment)


def written(folder) -> list[str]:
    return sorted(str(p.relative_to(folder)) for p in Path(folder).rglob("*") if p.is_file())


def test_run_prints_numbers_and_leaves_file_and_figure(tmp_path):
    done = fiv(tmp_path, "run", "fig5", "--set", "mu=0:0.5:51")
    assert done.returncode == 0
    assert "0.1112    2802" in done.stdout
    assert "0.12, near 2800 Hz" in done.stdout
    assert written(tmp_path) == ["results/fig5/fig5.nc", "results/fig5/fig5.png"]
    assert "results/fig5/fig5.nc" in done.stderr
    assert "time to expect" in done.stderr


def test_quiet_leaves_only_data(tmp_path):
    done = fiv(tmp_path, "run", "table4", "-q", "--scheduler", "sync", "--workers", "1", "--yes")
    assert done.returncode == 0
    assert done.stderr == ""
    assert "Largest difference: 0.22 %" in done.stdout


def test_out_says_where(tmp_path):
    assert fiv(tmp_path, "run", "fig6", "--set", "mu=0:0.2:21", "--out", "there").returncode == 0
    assert written(tmp_path) == ["there/fig6/fig6.nc", "there/fig6/fig6.png"]


def test_plan_writes_nothing(tmp_path):
    done = fiv(tmp_path, "plan", "fig5", "--set", "mu=0:0.5:101")
    assert done.returncode == 0
    for line in ("points          101", "distinct        101", "cached          0", "to do           101"):
        assert line in done.stdout
    assert "time to expect" in done.stdout
    assert written(tmp_path) == []


def test_list_shows_every_study(tmp_path):
    done = fiv(tmp_path, "list")
    assert done.returncode == 0
    for name in registry.NAMES:
        assert name in done.stdout
    assert "501 points, about" in done.stdout
    assert done.stdout.count("?") == len(registry.NAMES)
    assert len(done.stdout.splitlines()) == 3 * len(registry.NAMES)


def test_list_tells_all_of_one_study(tmp_path):
    done = fiv(tmp_path, "list", "fig5")
    assert done.returncode == 0
    assert "Paper: Section 3.4.2 and Fig. 5" in done.stdout
    assert "axis     mu                0 to 0.5 (501)         coefficient of friction" in done.stdout
    assert "setting  p2_thickness      0.003 m                thickness of P2" in done.stdout


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


@pytest.mark.parametrize("command", [[], ["list"], ["plan"], ["run"], ["plot"]])
def test_every_command_has_help(tmp_path, command):
    done = fiv(tmp_path, *command, "--help")
    assert done.returncode == 0
    assert "Usage: fiv" in done.stdout
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "fig55"], "fiv: STUDY = 'fig55': there is no such study; did you mean fig5?"),
        (["run", "fig5", "--set", "mo=0.2"], "fiv: mo: study fig5 has no such axis; did you mean mu?"),
        (
            ["run", "fig5", "--set", "mu=0:0.5"],
            "fiv: mu = '0:0.5': a range must be start:stop:count; the forms are ",
        ),
        (["run", "fig5", "--set", "mu"], "fiv: --set 'mu': it must be AXIS=SPEC, for example mu=0:0.5:101"),
        (["run", "fig5", "--set", "mu=-0.1"], "fiv: mu = -0.1: it must be a number from 0 to"),
        (["run", "fig5", "--set", "mu=nan"], "fiv: mu = 'nan': 'nan' must be a finite number"),
        (["run", "fig5", "--set", "mu=0.1", "--set", "mu=0.2"], "fiv: --set 'mu=0.2': mu is set already"),
        (["run", "fig5", "--set", "theta=90"], "fiv: theta = 90.0: it must be a single angle between -90 and 90"),
        (["run", "fig5", "--set", "contact_position=0.2"], "fiv: contact_position = 0.2: it must be above 0"),
        (["run", "fig5", "--set", "head_mass=-1"], "fiv: head_mass = -1.0: it must be a number from 0 to"),
        (["run", "fig5", "--set", "p1_length=-0.05"], "fiv: p1_length = -0.05: it must be a number from 1e-09 to"),
        (["run", "fig6", "--set", "p2_elements=0"], "fiv: p2_elements = 0.0: it must be a whole number from 1 to"),
        (["run", "fig5", "--set", "p1_density=nan"], "fiv: p1_density = 'nan': 'nan' must be a finite number"),
        (["run", "table4", "--set", "mode=0"], "fiv: mode = 0: it must be a whole number from 1 to 359"),
        (["run", "table4", "--set", "mode=400"], "fiv: mode = 400: it must be a whole number from 1 to 359"),
        (["run", "fig5", "--scheduler", "cloud"], "fiv: --scheduler 'cloud': it must be threads or sync"),
        (["run", "fig5", "--workers", "0"], "fiv: Invalid value for '--workers': 0 is not in the range x>=1."),
        (["list", "fig55"], "fiv: STUDY = 'fig55': there is no such study; did you mean fig5?"),
        (["run"], "fiv: Missing argument 'STUDY'."),
        (["rum", "fig5"], "fiv: No such command 'rum'."),
        (["plan", "fig5", "--set", "=3"], "fiv: --set '=3': it must be AXIS=SPEC"),
        (["plot", "fig5"], "results/fig5/fig5.nc: there is no such file; make it with: fiv run fig5"),
        (["run", "fig5", "--set", "theta=5,6"], "fiv: theta = 5, 6: study fig5 holds it fixed, so it must be one"),
        (["run", "fig6", "--set", "theta=-5"], "fiv: theta = -5: no two modes below 10 kHz lock in up to mu = 1"),
        (
            ["plan", "fig6", "--set", "d2=1e-3"],
            "fiv: theta = 5: the two modes that lock in cannot be followed back",
        ),
        (["plot", "none.nc"], "fiv: none.nc: there is no such file"),
    ],
)
def test_wrong_input_is_one_clear_line(tmp_path, arguments, message):
    done = fiv(tmp_path, *arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.strip().count("\n") == 0
    assert done.stdout == ""
    assert written(tmp_path) == []


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
    program = (
        "import sys, studies.fig5 as f\n"
        "from studies.cli import main\n"
        "whole = f.modes\n"
        "def picky(points, **constants):\n"
        "    if (points['mu'] == 0.25).any():\n"
        "        raise ArithmeticError('not this one')\n"
        "    return whole(points, **constants)\n"
        "f.modes = picky\n"
        "sys.argv = ['fiv', 'run', 'fig5', '--set', 'mu=0:0.5:3', '-q']\n"
        "main()\n"
    )
    done = fiv(tmp_path, "-c", program, command=(sys.executable,))
    assert done.returncode == 1
    assert "failed: mu = 0.25: ArithmeticError: not this one" in done.stderr
    assert written(tmp_path) == ["results/fig5/fig5.nc", "results/fig5/fig5.png"]


def test_ctrl_c_is_exit_130_and_leaves_nothing_half_done(tmp_path):
    program = (
        "import sys, time, studies.fig5 as f\n"
        "from studies.cli import main\n"
        "def slow(points, **constants):\n"
        "    print('working', flush=True)\n"
        "    time.sleep(0.2)\n"
        "f.modes = slow\n"
        "sys.argv = ['fiv', 'run', 'fig5', '-q', '--workers', '1']\n"
        "main()\n"
    )
    running = subprocess.Popen(
        [sys.executable, "-c", program], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert running.stdout.readline() == "working\n"
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=60)
    assert running.returncode == 130
    assert said.strip() == "fiv: interrupted"
    assert written(tmp_path) == []


def test_help_imports_nothing_heavy(tmp_path):
    program = (
        "import sys\n"
        "from studies.cli import main\n"
        "sys.argv = ['fiv', '--help']\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'scipy', 'numba', 'dask', 'xarray', 'matplotlib', 'netCDF4'} & set(sys.modules)\n"
        "print(sorted(heavy), file=sys.stderr)\n"
    )
    assert fiv(tmp_path, "-c", program, command=(sys.executable,)).stderr.strip() == "[]"
