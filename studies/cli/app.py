"""The program `fiv`, to which modules add their commands."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import click

from studies.cli.output import FLAGS, show


def _print_help(context: click.Context, option: click.Parameter, given: bool) -> None:
    if given and not context.resilient_parsing:
        show(context.get_help())
        context.exit()


def _print_version(context: click.Context, option: click.Parameter, given: bool) -> None:
    if given and not context.resilient_parsing:
        from sweeps import source

        show(source("studies"))
        context.exit()


def _set_flag(context: click.Context, option: click.Parameter, given: bool) -> None:
    FLAGS[str(option.name)] = given


Decorator = Callable[[Callable[..., Any]], click.Command]
EAGER: dict[str, Any] = {"is_flag": True, "is_eager": True, "expose_value": False}
HELP = click.option("-h", "--help", **EAGER, callback=_print_help, help="Print this and exit.")
VERBOSE = click.option("-v", "--verbose", **EAGER, callback=_set_flag, help="With the traceback of an error.")
QUIET = click.option("-q", "--quiet", **EAGER, callback=_set_flag, help="Only data and errors.")


@click.group(invoke_without_command=True, add_help_option=False)
@click.option("--version", **EAGER, callback=_print_version, help="Print version and commit, and exit.")
@HELP
@click.pass_context
def fiv(context: click.Context) -> None:
    """Studies of friction-induced vibration: two beams in frictional point contact.

    \b
    fiv list                                        your results, and the studies
    fiv run fig5                                    compute, store and draw one
    fiv run fig5 --set theta=8 --out elsewhere      at another inclination
    fiv rig mine --set p1_length=60mm               name a rig, for --rig mine
    fiv status                                      your results
    fiv query regimes --where 'mu > 0.2' --limit 5  rows of a result
    fiv map --x theta=-10:20:61 --y mu=0:0.5:51 --quantity growth_rate
    fiv report                                      one HTML page of every result

    A shell completes commands, options and studies after: eval "$(_FIV_COMPLETE=bash_source fiv)", or zsh_source.
    """  # noqa: D301 - the backspace tells click to keep the lines
    if context.invoked_subcommand is None:
        show(context.get_help())


def command(name: str, short: str, *options: Any, kind: type[click.Command] | None = None) -> Decorator:
    """Add a command with its options, the options of all commands, and its line in the list of commands."""

    def decorate(function: Callable[..., Any]) -> click.Command:
        for option in reversed((*options, VERBOSE, QUIET, HELP)):
            function = option(function)
        return fiv.command(name, kind, short_help=short, add_help_option=False)(function)

    return decorate


@contextmanager
def warned(report: Callable[[str], None]) -> Iterator[None]:
    """Report warnings as lines, such as those on unusual values, mixed environments, and libraries."""
    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = lambda text, *_: report(f"fiv: {text}")
        yield
