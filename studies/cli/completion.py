"""Completion of names in a shell: studies, axes, settings, series, quantities and columns.

Any error while names are looked up yields no names: a shell cannot show it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import redirect_stdout
from glob import escape, glob
from importlib import import_module
from io import StringIO
from itertools import chain

import click
from click.shell_completion import CompletionItem

from studies.cli.errors import WRONG_INPUT
from studies.cli.output import show

SHELLS = ("bash", "zsh", "fish")
Completer = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def script(program: click.Command, shell: str) -> str:
    """The script by which a shell asks `fiv` for completions."""
    from click.shell_completion import get_completion_class

    kind = get_completion_class(shell)
    assert kind is not None
    return kind(program, {}, "fiv", "_FIV_COMPLETE").source()


def answer(program: click.Command, asked: str) -> int:
    """Answer a shell that asks what may come next; the exit code."""
    from click.shell_completion import shell_complete

    try:
        answered = shell_complete(program, {}, "fiv", "_FIV_COMPLETE", asked) == 0
    except (LookupError, ValueError):
        answered = False
    if not answered:
        show(
            f"fiv: _FIV_COMPLETE = {asked!r}: it is for shells; they set COMP_WORDS, and COMP_CWORD to a number",
            err=True,
        )
    return 0 if answered else WRONG_INPUT


def _offering(
    names: Callable[[click.Context], Iterable[str]], *, end: str = "", listed: bool = False, signed: bool = False
) -> Completer:
    """Complete names and append `end`; `listed`: the last entry of a list; `signed`: also after a minus."""

    def complete(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
        before, comma, begun = incomplete.rpartition(",") if listed else ("", "", incomplete)
        sign = "-" if signed and begun.startswith("-") else ""
        begun = begun.removeprefix(sign)
        try:
            every = list(names(context))
        except Exception:  # noqa: BLE001 - a shell cannot show it
            return []
        return [
            CompletionItem(f"{before}{comma}{sign}{name}{end}")
            for name in every
            if name.startswith(begun) and name.isprintable()
        ]

    return complete


def _argument(context: click.Context, name: str) -> str:
    """The command's argument; click keeps it in `args` while an option still lacks its value."""
    value: str | None = context.params.get(name)
    return context.args[0] if value is None else value


def study(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete a study or a Python file; if none begins so, any file."""
    from studies.registry import names

    matching = [name for name in names() if name.startswith(incomplete)] + sorted(
        glob(f"{escape(incomplete)}*.py")
    )
    return [*map(CompletionItem, filter(str.isprintable, matching))] or [CompletionItem(incomplete, type="file")]


def _settable(context: click.Context) -> Iterable[str]:
    from studies import registry

    with redirect_stdout(StringIO()):  # a study's file may print
        study = registry.resolve(_argument(context, "study"))
    return [*study.axes, *study.settings]


def _scattered(context: click.Context) -> Iterable[str]:
    from studies import registry

    with redirect_stdout(StringIO()):
        study = registry.resolve(_argument(context, "study"))
    return [name for name in (*study.axes, *study.settings) if name not in study.texts]


def _of(module: str, *attributes: str) -> Callable[[click.Context], Iterable[str]]:
    """The keys of a module's tables; the module is imported when a shell asks for them."""
    return lambda context: chain(*(getattr(import_module(module), attribute) for attribute in attributes))


def _columns(context: click.Context) -> Iterable[str]:
    from studies import results

    with results.open_dataset(_argument(context, "target"), context.params.get("out")) as dataset:
        return [str(name) for name in (*dataset.coords, *dataset.data_vars)]


SETTABLE = _offering(_settable, end="=")
SCATTERED = _offering(_scattered, end="=")
SERIES_LIST = _offering(_of("studies.motion.recording", "SERIES"), listed=True)
MAP_AXIS = _offering(_of("studies.maps.quantities", "AXES"), end="=")
MAP_SETTING = _offering(_of("studies.maps.quantities", "AXES", "RUN"), end="=")
QUANTITY = _offering(_of("studies.maps.quantities", "QUANTITIES"))
COLUMNS = _offering(_columns, listed=True)
SORTED_COLUMNS = _offering(_columns, listed=True, signed=True)


class SignedCommand(click.Command):
    """A command that also completes an option's value that begins with a minus, as in `--sort -V`."""

    def parse_args(self, context: click.Context, args: list[str]) -> list[str]:
        """Store the last word before the incomplete one, which click does not pass to `shell_complete`."""
        context.meta["fiv.last"] = args[-1] if args else ""
        return super().parse_args(context, args)

    def shell_complete(self, context: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete the value of the option that lacks one; otherwise complete options."""
        options = (each for each in self.params if isinstance(each, click.Option) and not each.is_flag)
        for option in options:
            if context.meta["fiv.last"] in option.opts:
                return option.shell_complete(context, incomplete)
        return super().shell_complete(context, incomplete)
