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


class Command(click.Command):
    """A command whose options with an optional value take the next word only if it can be that value."""

    def parse_args(self, context: click.Context, args: list[str]) -> list[str]:
        """Give each such option its value, then parse as usual."""
        optional = {
            name: (option.flag_value, option.type.choices)
            for option in self.params
            if isinstance(option, click.Option) and isinstance(option.type, click.Choice) and not option.is_flag
            for name in option.opts
            if isinstance(option.flag_value, str)
        }
        end = args.index("--") if "--" in args else len(args)
        for k, (name, after) in enumerate(zip(args[:end], [*args[1:], ""], strict=False)):
            if name in optional and after not in optional[name][1]:
                args[k] = f"{name}={optional[name][0]}"
        return super().parse_args(context, args)


def command(name: str, short: str, *options: Any, kind: type[Command] = Command) -> Decorator:
    """A command with its options and those of all commands, and its line in the list of commands."""

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
