"""What goes wrong: exit codes, one clear line, and the traceback of what is a fault of this project's own.

Nothing heavy is imported: `fiv --help` answers at once.
"""

from __future__ import annotations

import dis
import select
import sys
import sysconfig
from pathlib import Path
from traceback import print_exception
from typing import Any

import click

SOME_FAILED, WRONG_INPUT, STORE_TAKEN, INTERNAL, INTERRUPTED = 1, 2, 3, 70, 130
OURS = ("fivcore", "sweeps", "studies")
LIBRARIES = {Path(sysconfig.get_path(name)) for name in ("stdlib", "platstdlib", "purelib", "platlib")}


class InputErrors:
    """Turn what the checks of input raise into a usage error of one line."""

    def __init__(self, verbose: bool) -> None:
        self.verbose = verbose

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, problem: BaseException | None, traceback: Any) -> None:
        if isinstance(problem, (ValueError, ArithmeticError, FileNotFoundError)) and is_told(problem):
            if self.verbose:
                print_exception(problem)
            raise click.UsageError(str(problem)) from None


def is_told(problem: BaseException) -> bool:
    """Whether a check found the problem: a `raise` of this project or of a study of one's own.

    What Python or a library raises of itself, while the code of this project runs, is a fault of that code.
    """
    traceback = problem.__traceback__
    while traceback is not None and traceback.tb_next is not None:
        traceback = traceback.tb_next
    if traceback is None:
        return False
    code, home = traceback.tb_frame.f_code, str(traceback.tb_frame.f_globals.get("__name__")).partition(".")[0]
    is_own = home in OURS or LIBRARIES.isdisjoint(Path(code.co_filename).parents)
    return is_own and dis.opname[code.co_code[traceback.tb_lasti]] == "RAISE_VARARGS"


def is_unread() -> bool:
    """Whether whoever read the standard output has gone."""
    poll = select.poll()
    poll.register(sys.stdout.fileno(), 0)
    return any(events & select.POLLERR for _, events in poll.poll(0))
