"""What is wrong input, what is a fault of our own, and who is told of it."""

import os
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import sweeps
from fivcore import InputError, UnsolvedError
from studies.cli import execution
from studies.gallery import fig5
from sweeps.compute.run import _Local


def fails(problem):
    """A function that raises in a check of ours, or within a library."""

    def check(*given, **named):
        raise problem

    def library(*given, **named):
        return np.zeros(3) + np.zeros(4)

    return check if problem else library


@pytest.mark.parametrize(
    ("problem", "code", "last"),
    [
        (sweeps.MissingFileError("a.nc: there is no such file"), 2, "fiv: a.nc: there is no such file"),
        (InputError("mu = 9: it must be less"), 2, "fiv: mu = 9: it must be less"),
        (UnsolvedError("theta = 9: a branch is lost"), 2, "fiv: theta = 9: a branch is lost"),
        (MemoryError("no 9 GiB"), 2, "fiv: out of memory: no 9 GiB; ask for less"),
        (RecursionError("depth"), 2, "fiv: something is nested too deeply; -v shows where"),
        (OSError(36, "File name too long", "a" * 9), 3, "fiv: aaaaaaaaa: File name too long"),
        (sweeps.ClusterLostError("the scheduler is gone"), 3, "fiv: the scheduler is gone"),
        (sweeps.SweepStoppedError("stopped"), 1, "fiv: stopped"),
        (ValueError("mu = 9"), 70, "fiv: internal error: ValueError; please report it with the lines above"),
        (None, 70, "fiv: internal error: ValueError; please report it with the lines above"),
        (KeyError("mu"), 70, "fiv: internal error: KeyError; please report it with the lines above"),
    ],
)
def test_a_fault_of_ours_is_not_told_as_wrong_input(here, monkeypatch, problem, code, last):
    monkeypatch.setattr(type(fig5.STUDY), "sweep", fails(problem))
    done = here("plan", "fig5")
    assert done.returncode == code
    assert done.stderr.splitlines()[-1] == last
    assert ("Traceback" in done.stderr) == (code == 70)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (["status", "fig5", "\n"], r"fiv: Got unexpected extra argument (\n)"),
        (["plan", "fig5", "--config", "\n"], r"fiv: --config \n: it cannot be read: No such file or directory"),
        (["plan", "/"], "fiv: /: it is the root of all folders, and no file"),
        (
            ["plan", "robust", "--samples", "9" * 400],
            f"fiv: --samples {'9' * 400}: it must be from 0 to 9007199254740992",
        ),
    ],
)
def test_words_that_hypothesis_wrote(here, line, told):
    done = here(*line)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"{told}\n")


def test_a_figure_that_fails_is_a_fault_of_ours(here, monkeypatch):
    here("run", "table4", "-q")
    monkeypatch.setattr("studies.runner.plot", fails(None))
    assert here("plot", "table4").returncode == 70


def test_a_pipe_that_is_not_standard_output_is_an_error(here, monkeypatch):
    """A cluster's socket, say."""
    monkeypatch.setattr("studies.cli.main.is_unread", lambda: False)
    monkeypatch.setattr(type(fig5.STUDY), "sweep", fails(BrokenPipeError(32, "Broken pipe")))
    done = here("plan", "fig5")
    assert done.returncode == 70
    assert "BrokenPipeError: [Errno 32] Broken pipe" in done.stderr


def test_who_has_read_enough_may_go():
    """Whether what is left is much or little."""
    for shell in ("fiv list -q | true", "fiv completion bash | head -n 1 > /dev/null"):
        script = f'PATH="{os.path.dirname(sys.executable)}:$PATH"; set -o pipefail; {shell}'
        done = subprocess.run(["bash", "-c", script], capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")


def test_hints_repeat_the_folder(here):
    where = ("--out", "my results")
    for arguments, hint in (
        (("plot", "fig5", *where), "make it with: fiv run fig5 --out 'my results'"),
        (("query", "fig5", *where), "make it with: fiv run fig5 --out 'my results'"),
        (("report", *where), "begin with: fiv run table4 --out 'my results'"),
        (("plot", "fig5"), "make it with: fiv run fig5"),
    ):
        done = here(*arguments)
        assert done.returncode == 2
        assert done.stderr.endswith(f"{hint}\n")


@pytest.mark.parametrize(
    ("arguments", "command"),
    [
        (["run", "fig5", "--set", "mu=0:0.5:31", "--out", "my results"], "--set mu=0:0.5:31 --out 'my results'"),
        (["run", "fig5", "--fresh", "--workers", "2"], "--workers 2"),
    ],
)
def test_what_goes_on_is_the_command_but_for_what_starts_over(monkeypatch, arguments, command):
    monkeypatch.setattr(sys, "argv", ["/somewhere/fiv", *arguments])
    assert execution.typed("--fresh") == f"fiv run fig5 {command}"


NOBODY = "~nobody-of-this-name/place"
LONG = 300 * "a"


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("plan", "fig5", "--out", NOBODY), 2, f"{NOBODY}: ~nobody-of-this-name has no home folder"),
        (("plot", f"{NOBODY}.nc"), 2, f"{NOBODY}.nc: ~nobody-of-this-name has no home folder"),
        (("list", f"{NOBODY}.py"), 2, f"{NOBODY}.py: ~nobody-of-this-name has no home folder"),
        (("plan", "fig5", "--config", NOBODY), 2, f"--config {NOBODY}: {NOBODY}: ~nobody"),
        (("plan", "fig5", "--points", NOBODY), 2, f"{NOBODY}: ~nobody-of-this-name has no home folder"),
        (("status", "fig5", "--out", LONG), 3, ": File name too long\n"),
        (("query", f"{LONG}.nc"), 3, ": File name too long\n"),
        (("list", f"{LONG}.py"), 3, f"{LONG}.py: File name too long"),
        (("plan", "fig5", "--out", "\udcff"), 2, r"\udcff: it is no text in utf-8"),
    ],
)
def test_names_that_no_file_can_have(here, arguments, code, said):
    done = here(*arguments)
    assert done.returncode == code
    assert said in done.stderr
    assert done.stderr.startswith("fiv: ")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("command", "redirected", "code", "last"),
    [
        ("completion bash", ">&-", 3, "fiv: standard output could not be written: Bad file descriptor\n"),
        ("completion bash", "1< /dev/null", 3, "fiv: standard output could not be written: Bad file descriptor\n"),
        ("--help", "> /dev/full", 3, "fiv: standard output could not be written: No space left on device\n"),
        ("--help", "| true", 0, ""),
        ("list -q", "<&- > /dev/null", 0, ""),
        ("list nothing", "2>&-", 2, ""),
        ("list nothing", "2> /dev/full", 2, ""),
        ("list nothing", "2>&1 > /dev/null | true", 2, ""),
    ],
)
def test_streams_that_are_closed_or_full(command, redirected, code, last):
    script = f"set -o pipefail; {sys.executable} -m studies {command} {redirected}"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (code, last)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("after", "said"), [(0, "nothing was finished; again with: fiv run"), (1, "3 of 5 points are kept; go on")]
)
def test_a_lost_cluster_is_no_wrong_input(here, monkeypatch, after, said):
    """The message says how many points are kept."""
    whole = _Local.submit
    monkeypatch.setattr("sweeps.plan.batches.BATCH_BYTES", 1.0)

    def submit(self, name, points):
        if len(sweeps.Store("results/fig5/fig5.nc").part_names()) >= after:
            raise sweeps.ClusterLostError("the scheduler does not answer any more")
        return whole(self, name, points)

    monkeypatch.setattr(_Local, "submit", submit)
    run = ("run", "fig5", "--set", "mu=0.1:0.2:5", "--set", "theta=6", "--scheduler", "sync")
    done = here(*run)
    assert done.returncode == 3
    assert re.search(f"^fiv: the scheduler does not answer any more; {said}", done.stderr, re.MULTILINE)
    monkeypatch.setattr(_Local, "submit", whole)
    assert here(*run).returncode == 0


@pytest.mark.parametrize("where", ["check", "constants"])
def test_a_check_of_a_study_may_raise_any_value_error(where):
    study = replace(fig5.STUDY, **{where: fails(ValueError("mu = 9: it must be less"))})
    with pytest.raises(sweeps.InputError, match=r"^mu = 9: it must be less$"):
        study.sweep({})
