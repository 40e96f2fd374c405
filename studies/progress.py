"""Progress on a terminal; nothing where there is none, and nothing when asked to be quiet."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from sweeps.plan import Progress


@contextmanager
def progress(points: int, quiet: bool) -> Iterator[Progress | None]:
    """A callback for `Plan.run` that draws a bar on standard error."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("points"), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=points)

        def told(done: int, failed: int) -> None:
            bar.advance(task, done)

        yield told
