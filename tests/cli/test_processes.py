"""Signals, locks, terminals and imports: the command as a process of its own."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from studies.cli import progress
from sweeps import Snapshot, Store
from sweeps.task import Task

pty = pytest.importorskip("pty")  # Windows lacks it, and the signals of all that follows

FIV = str(Path(sys.executable).with_name("fiv"))
# The command with batches that take their time, and after the first six wait until there is a file `go`; what they
# compute, and so the store, is the study's own.
SLOW = """
import itertools, os, signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
from studies.cli.main import main
from sweeps.task import Task
compute, calls = Task.compute, itertools.count()
def slowly(self, points):
    late = next(calls) > 5
    while late and not os.path.exists('go'):
        time.sleep(0.02)
    time.sleep(0.1 * len(points['x']))
    return compute(self, points)
Task.compute = slowly
sys.argv = ['fiv', *sys.argv[1:]]
main()
"""


def begun(folder, *arguments):
    """A slow run of a study, once it has finished its first batches."""
    command = [sys.executable, "-c", SLOW, *arguments]
    running = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + 60.0
    store = Store(folder / "results" / "squares" / "squares.nc")
    while len(store.part_names()) < 4:
        assert running.poll() is None
        assert time.monotonic() < until
        time.sleep(0.02)
    return running


def test_ctrl_c_is_exit_130_and_the_same_command_goes_on(tmp_path, own, here):
    """Other shells see the run meanwhile, and a second run is refused."""
    run = ("run", "own.py", "--set", "x=3:33:31", "--set", "kind=plain", "-q")
    running = begun(tmp_path, *run)
    status = json.loads(here("status", "squares", "--json").stdout)
    text, second = here("status", "squares").stdout, here(*run)
    running.send_signal(signal.SIGINT)
    (tmp_path / "go").touch()
    _, said = running.communicate(timeout=120)
    (tmp_path / "go").unlink()
    assert status["state"] == "running"
    assert (status["run"]["pid"], status["run"]["todo"]) == (running.pid, 31)
    assert f"process {running.pid} on " in text
    assert (second.returncode, second.stderr.count("\n")) == (3, 1)
    assert re.search(rf"squares.nc is being written by process {running.pid} on .*, begun 20", second.stderr)
    assert running.returncode == 130
    again = "go on from there with: fiv run own.py --set x=3:33:31 --set kind=plain -q"
    stored = re.fullmatch(rf"fiv: interrupted; (\d+) of 31 computations are stored; {again}", said.strip())
    assert stored
    assert here("status").stdout.splitlines()[1].split()[:7] == [
        "squares",
        "own",
        "study",
        stored[1],
        "of",
        "31",
        "interrupted",
    ]
    # One counting: of the message, of the plan and of the status.
    assert f"cached          {stored[1]} of these are stored already\n" in here("plan", *run[1:-1]).stdout
    assert json.loads(here("status", "squares", "--json").stdout)["done"] == int(stored[1])
    assert here(*run).returncode == 0
    assert json.loads(here("status", "squares", "--json").stdout)["state"] == "complete"


EARLY = """
import sys
class Interrupted:
    def find_spec(self, name, *rest):
        if name == sys.argv[1]:
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupted())
sys.modules.pop(sys.argv[1], None)
from studies.cli.main import main
main()
"""


@pytest.mark.parametrize("module", ["typing", "click", "studies.cli.read"])
def test_ctrl_c_is_exit_130_before_all_is_imported(tmp_path, module):
    done = subprocess.run([sys.executable, "-c", EARLY, module], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "fiv: interrupted\n")


def test_help_and_lists_import_nothing_heavy(tmp_path):
    heavy = ["numpy", "scipy", "numba", "dask", "xarray", "pandas", "matplotlib", "netCDF4", "sweeps"]
    program = (
        "import sys\nfrom studies.cli.main import main\nfor sys.argv[1:] in (['--help'], ['list']):\n"
        "    try:\n        main()\n    except SystemExit:\n        pass\n"
        f"print([name for name in {heavy} if name in sys.modules], file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True)
    assert done.stderr == "[]\n"
    assert "\nfig5 " in done.stdout


def on_terminal(folder, answer, *arguments):
    """Exit code and text of a command on a terminal, at which somebody types an answer."""
    leader, follower = pty.openpty()
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "120", "FIV_RESULTS": "results"}
    streams = {"stdin": follower, "stdout": follower, "stderr": follower}
    running = subprocess.Popen([FIV, *arguments], cwd=folder, env=environment, **streams)
    os.close(follower)
    os.write(leader, answer)
    text = b""
    with suppress(OSError):  # nobody writes any more
        while part := os.read(leader, 4096):
            text += part
    os.close(leader)
    return running.wait(timeout=120), text.decode()


@pytest.mark.parametrize(("answer", "code"), [(b"n\n", 130), pytest.param(b"y\n", 0, marks=pytest.mark.slow)])
def test_an_unusual_value_asks_on_a_terminal(tmp_path, answer, code):
    run = ("run", "fig5", "--set", "p1_length=50", "--set", "mu=0.1,0.2")
    ended, text = on_terminal(tmp_path, answer, *run)
    assert ended == code
    assert text.index("p1_length = 50 m is unusual") < text.index("Go ahead?")
    assert (tmp_path / "results").exists() == (code == 0)
    if code == 0:
        assert on_terminal(tmp_path, b"", *run, "--fresh", "--yes")[0] == 0


def test_a_bar_shows_counts_time_and_the_batch(monkeypatch, capsys):
    for name, value in {"TTY_COMPATIBLE": "1", "FORCE_COLOR": "1", "TERM": "xterm", "COLUMNS": "160"}.items():
        monkeypatch.setenv(name, value)
    with progress.bar(2) as callback:
        callback(Snapshot(2, 0, 0, 0.0, 0.0, float("nan"), ("mu = 0.1",), False))
        callback(Snapshot(2, 1, 1, 1.0, 1.0, 1.0, ("\x1b]0;owned [red]not red[/red]",), False))
    said = capsys.readouterr().err
    assert "1/2" in said
    assert "0:00:0" in said
    assert "1 failed  1.00 a second  1 s left  \\x1b]0;owned [red]not red[/red]" in said


def test_plain_lines_report_progress_where_there_is_no_terminal(here, own, monkeypatch):
    compute = Task.compute
    monkeypatch.setattr(Task, "compute", lambda self, points: time.sleep(0.1) or compute(self, points))
    monkeypatch.setattr(progress, "INTERVAL", 0.05)
    done = here("run", "own.py", "--set", "x=3:9:9", "--scheduler", "sync")
    assert re.search(r"^fiv: \d+ of 18 done, [\d.]+ a second, .* left; now x = \d", done.stderr, re.MULTILINE)


@pytest.mark.parametrize(
    ("options", "often"), [("", "in every run, since no folder"), ("cache=True", "once for this")]
)
def test_compiling_is_announced_once_and_how_often_it_happens(here, own, options, often):
    kernels = (
        f"    import numba\n    [numba.njit({options})(lambda x: x + k)(1.0) for k in range(2)]\n    return {{"
    )
    own.write_text(own.read_text().replace("    return {", kernels))
    assert here("run", "own.py").stderr.count(f"fiv: compiling, {often}") == 1


def test_a_shell_completes_commands_options_and_studies(tmp_path):
    for words, found in (
        ("run fig1", "fig11"),
        ("run fig5 --sched", "--scheduler"),
        ("query fig5 --format c", "csv"),
    ):
        shell = {
            "_FIV_COMPLETE": "bash_complete",
            "COMP_WORDS": f"fiv {words}",
            "COMP_CWORD": str(words.count(" ") + 1),
        }
        done = subprocess.run([FIV], cwd=tmp_path, env=os.environ | shell, capture_output=True, text=True)
        assert (done.stdout, done.stderr) == (f"plain,{found}\n", "")
