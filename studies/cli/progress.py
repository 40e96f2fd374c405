"""Progress: a bar on a terminal, a plain line every few seconds elsewhere, nothing with --quiet."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from studies.cli.output import FLAGS, harmless, tell

if TYPE_CHECKING:
    from sweeps import Progress, Snapshot

INTERVAL = 5.0  # between two plain lines, s
# What the first run takes more than the second, s: `fiv run fig5` of an AMD EPYC 8, on a busy one 20.
COMPILING = "up to 20 s"
STOPPING = "stopping after the computations in progress; press Ctrl-C again to stop now"


@contextmanager
def progress(todo: int) -> Iterator[Progress | None]:
    """Yield a callback for `Plan.run` that prints its progress on standard error; None with --quiet."""
    if FLAGS["quiet"] or not todo:
        yield None
    elif sys.stderr.isatty():
        with bar(todo) as callback:
            yield callback
    else:
        yield _lines()


def progress_lines(snapshot: Snapshot) -> list[str]:
    """Failures, rate and remaining time of a run, as far as they are known."""
    from sweeps import duration

    texts = [f"{snapshot.failed} failed"] if snapshot.failed else []
    texts += [f"{snapshot.rate:.{0 if snapshot.rate > 100.0 else 2}f} a second"] if snapshot.rate > 0.0 else []
    return [*texts, f"{duration(snapshot.left)} left"] if snapshot.left >= 0.0 else texts


def announce_compiling() -> None:
    """Print a line when the first kernel is compiled, once for an installation that caches it."""
    from numba.core import caching, event

    class Compiling(event.Listener):
        announced = False

        def on_start(self, happening: Any) -> None:
            if not self.announced:
                kept = not isinstance(happening.data["dispatcher"]._cache, caching.NullCache)
                every = "in every run, since no folder keeps compiled code (NUMBA_CACHE_DIR can name one)"
                tell(f"compiling, {'once for this installation' if kept else every}: {COMPILING}")
            self.announced = True

        def on_end(self, happening: object) -> None: ...

    if not FLAGS["quiet"]:
        click.get_current_context().with_resource(event.install_listener("numba:compile", Compiling()))


def _lines() -> Progress:
    """A callback that prints a plain line every INTERVAL seconds."""
    last, stopping = time.monotonic(), False

    def update(snapshot: Snapshot) -> None:
        nonlocal last, stopping
        if snapshot.stopping and not stopping:
            tell(STOPPING)
        stopping = snapshot.stopping
        # When a batch begins: the line then names it.
        if snapshot.now and time.monotonic() - last >= INTERVAL:
            last = time.monotonic()
            done = ", ".join([f"{snapshot.done} of {snapshot.todo} done", *progress_lines(snapshot)])
            tell(f"{done}; now {snapshot.now[0]}")

    return update


@contextmanager
def bar(todo: int) -> Iterator[Progress]:
    """Show a bar in a terminal or a notebook, and remove it at the end."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.table import Column

    text = TextColumn("{task.description}", markup=False, table_column=Column(ratio=1, no_wrap=True))
    columns = BarColumn(16), MofNCompleteColumn(), TimeElapsedColumn(), text
    with Progress(*columns, console=Console(stderr=True), transient=True, expand=True) as display:
        task = display.add_task("", total=todo)

        def update(snapshot: Snapshot) -> None:
            texts = [STOPPING] if snapshot.stopping else [*progress_lines(snapshot), *snapshot.now[:1]]
            line = harmless("  ".join(texts))
            display.update(task, total=snapshot.todo, completed=snapshot.done, description=line)

        yield update
