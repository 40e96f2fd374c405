"""The command that tells whether an installation works: check."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import click

from studies.cli.app import command
from studies.cli.errors import SOME_FAILED
from studies.cli.output import show

AGAIN = "install anew into an empty environment and check again; if that fails too, report these lines"


@command("check", "Whether the installation computes, stores and draws as it should.")
def check() -> None:
    """Whether the installation computes, stores and draws as it should: a minute, most of it to compile.

    Each line says what was checked, what was found and its bound. Nothing is left behind but compiled kernels.
    """
    from studies import check as installation
    from studies.cli.progress import announce_compiling

    show(installation.machine())
    announce_compiling()
    failed = count = 0
    with tempfile.TemporaryDirectory() as folder:
        for each in installation.checks(Path(folder)):
            failed, count = failed + (not each.passed), count + 1
            colour, verdict = ("green", "ok") if each.passed else ("red", "FAILED")
            line = f"{each.what:<52} {each.found:<25} {each.bound:<16}"
            show(f"{line} ", mark=click.style(verdict, fg=colour, bold=True))
    if failed:
        show(f"{failed} of {count} checks failed: {AGAIN}")
        sys.exit(SOME_FAILED)
    show("all is well")
