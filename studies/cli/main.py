"""The command line. Data goes to standard output, everything else to standard error."""

from __future__ import annotations

import os
import sys

try:
    import errno
    import re
    from typing import NoReturn

    import click

    from studies.cli import check, compute, read  # noqa: F401 - they add their commands
    from studies.cli.app import BrokenPipe, fiv
    from studies.cli.completion import answer
    from studies.cli.errors import (
        INTERNAL,
        INTERRUPTED,
        SOME_FAILED,
        STORE_TAKEN,
        WRONG_INPUT,
        is_unread,
        show_traceback,
    )
    from studies.cli.output import streams, tell
except KeyboardInterrupt:
    # In the first tenth of a second. What says so otherwise is not there yet.
    os.write(2, b"fiv: interrupted\n")
    sys.exit(130)

FAILED_DEVICE = (errno.ENOSPC, errno.EIO, errno.EFBIG, errno.EDQUOT, errno.EBADF)


def main() -> NoReturn:
    """Entry point: exit codes as documented, errors in one line."""
    with streams():
        code = _run()
    sys.exit(code if isinstance(code, int) else 0)


def _run() -> object:
    """Run the command; its exit code."""
    try:
        if asked := os.environ.get("_FIV_COMPLETE"):
            return answer(fiv, asked)
        _check_names()
        code: object = fiv.main(prog_name="fiv", standalone_mode=False)
        sys.stdout.flush()
    except click.exceptions.Exit as stop:
        code = stop.exit_code
    except (click.Abort, KeyboardInterrupt):
        tell("interrupted")
        code = INTERRUPTED
    except click.ClickException as problem:
        tell(problem.format_message())
        code = WRONG_INPUT
    except Exception as problem:  # noqa: BLE001 - each has its exit code
        code = _code_of(problem)
    return code


def _check_names() -> None:
    """Refuse names that are no text in the encoding of the file system: netCDF files and pages have UTF-8."""
    try:
        folder = os.getcwd()
    except FileNotFoundError:
        raise click.UsageError("the current folder is gone; change to another") from None
    for text in (*sys.argv[1:], os.environ.get("FIV_RESULTS", ""), folder):
        if re.search("[\ud800-\udfff]", text):
            encoding = sys.getfilesystemencoding()
            raise click.UsageError(f"{text}: it is no text in {encoding}, this system's encoding; rename it")


def _code_of(problem: Exception) -> int:
    """Say in one line what went wrong; of a fault of our own, with its traceback."""
    # Imported here: most runs need no sweeps to fail.
    from sweeps import ClusterLostError, InputError, StoreError, SweepStoppedError

    broken = isinstance(problem, (BrokenPipe, BrokenPipeError))
    if is_unread() if broken else isinstance(problem, OSError) and _is_of_output(problem):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if broken:
            return 0  # whoever read has enough
        assert isinstance(problem, OSError)
        tell(f"standard output could not be written: {problem.strerror}")
        return STORE_TAKEN
    for kind, code in (
        (InputError, WRONG_INPUT),
        (StoreError, STORE_TAKEN),
        (ClusterLostError, STORE_TAKEN),
        (SweepStoppedError, SOME_FAILED),
    ):
        if isinstance(problem, kind):
            tell(str(problem))
            return code
    if isinstance(problem, MemoryError):
        tell(f"out of memory: {problem or 'nothing more could be allocated'}; ask for less")
        return WRONG_INPUT
    if isinstance(problem, RecursionError):
        tell("something is nested too deeply; -v shows where")
        return WRONG_INPUT
    if isinstance(problem, OSError) and problem.filename is not None:
        tell(f"{problem.filename}: {problem.strerror}")
        return STORE_TAKEN
    show_traceback(problem)
    tell(f"internal error: {type(problem).__name__}; please report it with the lines above")
    return INTERNAL


def _is_of_output(problem: OSError) -> bool:
    """Whether the standard output could not be written: no file is named, and its device failed or is full."""
    return problem.filename is None and problem.errno in FAILED_DEVICE
