"""Progress: a bar on a terminal, a plain line every few seconds elsewhere, nothing when asked to be quiet."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import click

from sweeps import Snapshot
from sweeps.monitor import Progress
from sweeps.plan import duration

# Between two plain lines, s.
INTERVAL = 5.0
# Of the batches under way, in characters.
WIDTH = 48
STOPPING = "stopping: what is under way is finished and kept; Ctrl-C again stops at once"


@contextmanager
def progress(todo: int, quiet: bool) -> Iterator[Progress | None]:
    """A callback for `Plan.run` that tells on standard error how far it is."""
    if quiet or not todo:
        yield None
    elif sys.stderr.isatty():
        with _bar(todo) as told:
            yield told
    else:
        yield _Lines()


def line(snapshot: Snapshot) -> str:
    """The state of a run in one line."""
    left = "" if math.isnan(snapshot.left) else f", {duration(snapshot.left)} left"
    failed = f", {snapshot.failed} failed" if snapshot.failed else ""
    now = f"; now {snapshot.now[0]}" if snapshot.now else ""
    return f"{snapshot.done} of {snapshot.todo} done{failed}, {snapshot.rate:.3g} a second{left}{now}"


class _Lines:
    """A line now and then."""

    def __init__(self) -> None:
        self._last = time.monotonic()
        self._stopping = False

    def __call__(self, snapshot: Snapshot) -> None:
        if snapshot.stopping and not self._stopping:
            self._stopping = True
            click.echo(f"fiv: {STOPPING}", err=True)
        # When a batch begins: the line then says which.
        if snapshot.now and time.monotonic() - self._last >= INTERVAL:
            self._last = time.monotonic()
            click.echo(f"fiv: {line(snapshot)}", err=True)


@contextmanager
def _bar(todo: int) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (BarColumn(24), MofNCompleteColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=todo)

        def told(snapshot: Snapshot) -> None:
            left = "" if math.isnan(snapshot.left) else f"{duration(snapshot.left)} left"
            failed = f"[red]{snapshot.failed} failed[/red]" if snapshot.failed else ""
            now = snapshot.now[0][:WIDTH] if snapshot.now else ""
            words = [STOPPING] if snapshot.stopping else [failed, f"{snapshot.rate:.3g}/s", left, now]
            bar.update(task, completed=snapshot.done, description="  ".join(w for w in words if w))

        yield told
