"""The program `fiv`, to which each command is added by its own module."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any

import click

from studies.cli.errors import InputErrors
from studies.cli.output import show


class BrokenPipe(Exception):  # noqa: N818 - no error where it is the standard output's
    """Something could not be written to; its cause says what. Click would end with 1 for it."""


class Fiv(click.Group):
    """The program, which leaves broken pipes to `main`."""

    def make_context(self, *given: Any, **named: Any) -> click.Context:
        """Read what was typed; --help is printed here."""
        with _pipes():
            return super().make_context(*given, **named)

    def invoke(self, context: click.Context) -> Any:
        """Run a command."""
        with _pipes():
            return super().invoke(context)


@contextmanager
def _pipes() -> Iterator[None]:
    try:
        yield
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
    name: str, short: str, *options: Callable[..., Any], kind: type[click.Command] | None = None
) -> Callable[[Callable[..., Any]], click.Command]:
    """A command with its options, -v and -q, and what the list of commands says of it; wrong input is one line."""
    quiet = click.option("-q", "--quiet", is_flag=True, help="Only data and errors.")
    verbose = click.option("-v", "--verbose", is_flag=True, help="With the traceback of an error.")

    def decorate(function: Callable[..., Any]) -> click.Command:
        @wraps(function)
        def run(quiet: bool, verbose: bool, **arguments: Any) -> None:
            with InputErrors(verbose):
                function(**arguments)

        decorated: Callable[..., Any] = run
        for option in (*reversed(options), verbose, quiet):
            decorated = option(decorated)
        return fiv.command(name, kind, short_help=short)(decorated)

    return decorate


def is_set(flag: str) -> bool:
    """Whether the command under way was given -q ("quiet") or -v ("verbose")."""
    return bool(click.get_current_context().params[flag])


@contextmanager
def warned() -> Iterator[None]:
    """Say warnings about unusual values, and about mixed environments, as the program says things."""
    from studies.plausible import UnusualWarning
    from sweeps import MixedWarning

    ours = UnusualWarning, MixedWarning
    with warnings.catch_warnings(record=True) as caught:
        for category in ours:
            warnings.simplefilter("always", category)
        yield
    for each in caught:
        if issubclass(each.category, ours):
            say(f"fiv: {each.message}")
        else:
            warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)


def say(text: str) -> None:
    """Say something that is no data, unless -q forbids it."""
    if not is_set("quiet"):
        show(text, err=True)
