"""The command line. Data goes to standard output, everything else to standard error."""

from __future__ import annotations

import errno
import os
import sys
from traceback import print_exception
from typing import NoReturn

import click

from studies.cli import check, compute, read  # noqa: F401 - they add their commands
from studies.cli.app import BrokenPipe, fiv
from studies.cli.errors import INTERNAL, INTERRUPTED, SOME_FAILED, STORE_TAKEN, WRONG_INPUT, is_unread


def main() -> NoReturn:
    """Entry point: exit codes as documented, errors in one line."""
    try:
        code = fiv.main(prog_name="fiv", standalone_mode=False)
        sys.stdout.flush()
    except click.exceptions.Exit as stop:
        code = stop.exit_code
    except (click.Abort, KeyboardInterrupt):
        click.echo("fiv: interrupted", err=True)
        code = INTERRUPTED
    except click.ClickException as problem:
        click.echo(f"fiv: {problem.format_message()}", err=True)
        code = WRONG_INPUT
    except Exception as problem:  # noqa: BLE001 - each has its exit code
        code = _code_of(problem)
    sys.exit(code if isinstance(code, int) else 0)


def _code_of(problem: Exception) -> int:
    """Say in one line what went wrong; of a fault of our own, with its traceback."""
    # Imported here: most runs need no sweeps to fail.
    from sweeps import InputError, StoreError, SweepStoppedError

    broken = isinstance(problem, (BrokenPipe, BrokenPipeError))
    if is_unread() if broken else isinstance(problem, OSError) and _is_of_output(problem):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if broken:
            return 0  # whoever read has enough
        assert isinstance(problem, OSError)
        click.echo(f"fiv: standard output could not be written: {problem.strerror}", err=True)
        return STORE_TAKEN
    for kind, code in ((InputError, WRONG_INPUT), (StoreError, STORE_TAKEN), (SweepStoppedError, SOME_FAILED)):
        if isinstance(problem, kind):
            click.echo(f"fiv: {problem}", err=True)
            return code
    if isinstance(problem, MemoryError):
        click.echo(f"fiv: out of memory: {problem or 'nothing more could be allocated'}; ask for less", err=True)
        return WRONG_INPUT
    print_exception(problem)
    click.echo(f"fiv: internal error: {type(problem).__name__}; please report it with the lines above", err=True)
    return INTERNAL


def _is_of_output(problem: OSError) -> bool:
    """Whether the standard output could not be written: no file is named, and its device failed or is full."""
    return problem.filename is None and problem.errno in (errno.ENOSPC, errno.EIO, errno.EFBIG, errno.EDQUOT)
