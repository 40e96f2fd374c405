"""Progress: a bar on a terminal, a plain line every few seconds elsewhere, nothing when asked to be quiet."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import click

from studies.cli.app import is_set
from studies.cli.output import harmless, show
from sweeps import Progress, Snapshot, duration

# Between two plain lines, s.
INTERVAL = 5.0
# What the first run takes more of the processor than the second, s: 12.1 less 4.2 of `fiv run fig5`, 14.1 less 6.0
# of `fiv run scenes` (AMD EPYC, Python 3.11).
COMPILING = 8.0
STOPPING = "stopping after what is under way; Ctrl-C again: now"


@contextmanager
def progress(todo: int) -> Iterator[Progress | None]:
    """A callback for `Plan.run` that tells on standard error how far it is."""
    if is_set("quiet") or not todo:
        yield None
    elif sys.stderr.isatty():
        with bar(todo) as told:
            yield told
    else:
        yield _Lines()


def words(snapshot: Snapshot) -> list[str]:
    """How a run goes: failures, rate, and the time that is left, as far as there are any."""
    failed = f"{snapshot.failed} failed" if snapshot.failed else ""
    rate = f"{snapshot.rate:.3g} a second" if snapshot.rate > 0.0 else ""
    left = "" if math.isnan(snapshot.left) else f"{duration(snapshot.left)} left"
    return [word for word in (failed, rate, left) if word]


def tell_compiling() -> None:
    """Say once, until the command ends, that kernels are compiled: no run of this installation has done so."""
    if is_set("quiet"):
        return
    from numba.core import event

    class Compiling(event.Listener):
        told = False

        def on_start(self, happening: object) -> None:
            if not self.told:
                self.told = True
                show(f"fiv: compiling once, about {COMPILING:.0f} s", err=True)

        def on_end(self, happening: object) -> None:
            pass

    listening = event.install_listener("numba:compile", Compiling())
    click.get_current_context().with_resource(listening)


class _Lines:
    """A line now and then."""

    def __init__(self) -> None:
        self._last = time.monotonic()
        self._stopping = False

    def __call__(self, snapshot: Snapshot) -> None:
        if snapshot.stopping and not self._stopping:
            self._stopping = True
            show(f"fiv: {STOPPING}", err=True)
        # When a batch begins: the line then says which.
        if snapshot.now and time.monotonic() - self._last >= INTERVAL:
            self._last = time.monotonic()
            done = ", ".join([f"{snapshot.done} of {snapshot.todo} done", *words(snapshot)])
            show(f"fiv: {done}; now {snapshot.now[0]}", err=True)


@contextmanager
def bar(todo: int) -> Iterator[Progress]:
    """A bar that goes when it is done, in a terminal or a notebook."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.table import Column

    count = Column(no_wrap=True, min_width=2 * len(str(todo)) + 1)
    rest = Column(ratio=1, no_wrap=True, overflow="ellipsis")
    columns = (
        BarColumn(16),
        MofNCompleteColumn(table_column=count),
        TextColumn("{task.description}", markup=False, table_column=rest),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True, expand=True) as shown:
        task = shown.add_task("", total=todo)

        def tell(snapshot: Snapshot) -> None:
            texts = [STOPPING] if snapshot.stopping else [*words(snapshot), *snapshot.now[:1]]
            text = harmless("  ".join(texts))
            shown.update(task, total=snapshot.todo, completed=snapshot.done, description=text)

        yield tell
