"""What is wrong input, what is a fault of our own, and who is told of it."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import sweeps
from fivcore import InputError, UnsolvedError
from studies.cli import execution
from studies.gallery import fig5


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


@pytest.mark.parametrize("where", ["check", "constants"])
def test_a_check_of_a_study_may_raise_any_value_error(where):
    study = replace(fig5.STUDY, **{where: fails(ValueError("mu = 9: it must be less"))})
    with pytest.raises(sweeps.InputError, match=r"^mu = 9: it must be less$"):
        study.sweep({})
