"""The program `fiv`, to which each command is added by its own module."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click


class BrokenPipe(Exception):  # noqa: N818 - no error where it is the standard output's
    """Something could not be written to; its cause says what. Click would end with 1 for it."""


class Fiv(click.Group):
    """The program, which leaves broken pipes to `main`."""

    def invoke(self, context: click.Context) -> Any:
        """Run a command."""
        try:
            return super().invoke(context)
        except BrokenPipeError as problem:
            raise BrokenPipe(str(problem)) from problem


@click.group(cls=Fiv, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="fiv", prog_name="fiv")
def fiv() -> None:
    """Studies of friction-induced vibration: two beams in frictional point contact.

    \b
    fiv list                                             what there is
    fiv run fig5                                         compute, store and draw a study
    fiv run fig5 --set theta=8 --out elsewhere           the same for another inclination
    fiv query regimes --where 'mu > 0.2' --limit 5       rows of a result
    fiv map --x theta=-10:20:61 --y mu=0:0.5:51 --quantity growth_rate
    fiv report                                           one HTML page of every result
    """  # noqa: D301 - the backspace tells click to keep the lines


def command(
    name: str, short: str, kind: type[click.Command] | None = None
) -> Callable[[Callable[..., Any]], click.Command]:
    """A command with -v and -q, and what the list of commands says of it."""

    def decorate(function: Callable[..., Any]) -> click.Command:
        quiet = click.option("-q", "--quiet", is_flag=True, help="Only data and errors.")
        verbose = click.option("-v", "--verbose", is_flag=True, help="With the traceback of an error.")
        return fiv.command(name, kind, short_help=short)(quiet(verbose(function)))

    return decorate
