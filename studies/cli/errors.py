"""Exit codes, and the one line that a command prints for wrong input.

The module imports nothing heavy, so that `fiv --help` answers at once.
"""

from __future__ import annotations

import select
import sys
from traceback import format_exception
from typing import Any

import click

from studies.cli.output import show

SOME_FAILED, WRONG_INPUT, STORE_TAKEN, INTERNAL, INTERRUPTED = 1, 2, 3, 70, 130
# What `main` says in one line, whichever library raises it.
ONE_LINE = (MemoryError, RecursionError, OSError)


class InputErrors:
    """Turn input errors of the packages into usage errors of one line."""

    def __init__(self, verbose: bool) -> None:
        self.verbose = verbose

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, problem: BaseException | None, traceback: Any) -> None:
        if not isinstance(problem, (ValueError, ArithmeticError, *ONE_LINE)):
            return
        # Imported here because they are slow: whatever raised their errors has imported them already.
        import fivcore
        import sweeps

        ours = isinstance(problem, (fivcore.InputError, fivcore.UnsolvedError, sweeps.InputError))
        if self.verbose and (ours or isinstance(problem, ONE_LINE)):
            show_traceback(problem)
        if ours:
            raise click.UsageError(str(problem)) from None


def show_traceback(problem: BaseException) -> None:
    """Where something was raised."""
    show("".join(format_exception(problem)).rstrip("\n"), err=True)


def is_unread() -> bool:
    """Whether the reader of the standard output has closed it."""
    poll = select.poll()
    poll.register(sys.stdout.fileno(), 0)
    return any(events & select.POLLERR for _, events in poll.poll(0))
