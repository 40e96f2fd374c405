"""Progress: a bar on a terminal, a plain line every few seconds elsewhere, nothing with --quiet."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import click

from studies.cli.app import is_set
from studies.cli.output import harmless, tell
from sweeps import Progress, Snapshot, duration

# Between two plain lines, s.
INTERVAL = 5.0
# What the first run takes more of the processor than the second, s: 12.1 less 4.2 of `fiv run fig5`, 14.1 less 6.0
# of `fiv run scenes` (AMD EPYC, Python 3.11).
COMPILING = 8.0
STOPPING = "stopping after what is under way; Ctrl-C again: now"


@contextmanager
def progress(todo: int) -> Iterator[Progress | None]:
    """Yield a callback for `Plan.run` that prints its progress on standard error; None with --quiet."""
    if is_set("quiet") or not todo:
        yield None
    elif sys.stderr.isatty():
        with bar(todo) as callback:
            yield callback
    else:
        yield _Lines()


def words(snapshot: Snapshot) -> list[str]:
    """Failures, rate and time left of a run, as far as they are known."""
    failed = f"{snapshot.failed} failed" if snapshot.failed else ""
    rate = f"{snapshot.rate:.3g} a second" if snapshot.rate > 0.0 else ""
    left = "" if math.isnan(snapshot.left) else f"{duration(snapshot.left)} left"
    return [word for word in (failed, rate, left) if word]


def announce_compiling() -> None:
    """Print a line when the first kernel is compiled, which only the first run of an installation does."""
    if is_set("quiet"):
        return
    from numba.core import event

    class Compiling(event.Listener):
        announced = False

        def on_start(self, happening: object) -> None:
            if not self.announced:
                self.announced = True
                tell(f"compiling once, about {COMPILING:.0f} s")

        def on_end(self, happening: object) -> None:
            pass

    listening = event.install_listener("numba:compile", Compiling())
    click.get_current_context().with_resource(listening)


class _Lines:
    """Print a plain line of progress every INTERVAL seconds."""

    def __init__(self) -> None:
        self._last = time.monotonic()
        self._stopping = False

    def __call__(self, snapshot: Snapshot) -> None:
        if snapshot.stopping and not self._stopping:
            self._stopping = True
            tell(STOPPING)
        # When a batch begins: the line then says which.
        if snapshot.now and time.monotonic() - self._last >= INTERVAL:
            self._last = time.monotonic()
            done = ", ".join([f"{snapshot.done} of {snapshot.todo} done", *words(snapshot)])
            tell(f"{done}; now {snapshot.now[0]}")


@contextmanager
def bar(todo: int) -> Iterator[Progress]:
    """Show a bar in a terminal or a notebook, and remove it at the end."""
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

        def update(snapshot: Snapshot) -> None:
            texts = [STOPPING] if snapshot.stopping else [*words(snapshot), *snapshot.now[:1]]
            text = harmless("  ".join(texts))
            shown.update(task, total=snapshot.todo, completed=snapshot.done, description=text)

        yield update
