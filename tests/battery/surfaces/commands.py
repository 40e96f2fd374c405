"""The command in this process, outside of a test's own fixtures: Hypothesis calls it many times a test."""

import io
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from unittest.mock import patch

from studies.cli.main import main


@dataclass(frozen=True)
class Done:
    """How a command ended and what it said."""

    code: int
    out: str
    err: str


def fiv(folder, *arguments: str) -> Done:
    """Run the command in a folder, through its own entry point."""
    out, err = io.StringIO(), io.StringIO()
    with chdir(folder), patch.object(sys, "argv", ["fiv", *arguments]), redirect_stdout(out), redirect_stderr(err):
        try:
            main()
        except SystemExit as ended:
            return Done(int(ended.code or 0), out.getvalue(), err.getvalue())
    raise AssertionError("the command did not end")


def refusal(done: Done) -> str:
    """The one line of a command that was given wrong input."""
    assert done.code == 2, done
    assert done.out == ""
    assert done.err.startswith("fiv: ")
    assert done.err.endswith("\n")
    assert done.err.count("\n") == 1, done.err
    return done.err.removeprefix("fiv: ").rstrip("\n")
