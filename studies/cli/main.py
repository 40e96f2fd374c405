"""The command line. Data goes to standard output, everything else to standard error."""

from __future__ import annotations

import os
import sys
from typing import NoReturn

import click

from studies.cli import compute as commands_compute
from studies.cli import read as commands_read
from studies.cli.app import fiv
from studies.cli.options import INTERRUPTED, SOME_FAILED, STORE_TAKEN, WRONG_INPUT

__all__ = ["commands_compute", "commands_read", "fiv", "main"]


def main() -> NoReturn:
    """Entry point: exit codes as documented, errors in one line."""
    try:
        code = fiv.main(prog_name="fiv", standalone_mode=False)
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read has enough; what is still in the buffer goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    except OSError as problem:
        if problem.filename is not None:
            raise
        click.echo(f"fiv: standard output could not be written: {problem.strerror}", err=True)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = STORE_TAKEN
    except click.exceptions.Exit as stop:
        code = stop.exit_code
    except (click.Abort, KeyboardInterrupt):
        click.echo("fiv: interrupted", err=True)
        code = INTERRUPTED
    except click.ClickException as problem:
        click.echo(f"fiv: {problem.format_message()}", err=True)
        code = WRONG_INPUT
    except Exception as problem:
        # Imported here: most runs need no sweeps to fail.
        from sweeps import StoreError, SweepStoppedError

        if not isinstance(problem, (StoreError, SweepStoppedError)):
            raise
        click.echo(f"fiv: {problem}", err=True)
        code = STORE_TAKEN if isinstance(problem, StoreError) else SOME_FAILED
    sys.exit(code if isinstance(code, int) else 0)
