"""Execute a plan, and print its numbers, its failures, or the points stored before an interrupt."""

from __future__ import annotations

import os
import shlex
import signal
import sys
from contextlib import suppress
from math import isnan
from typing import TYPE_CHECKING, NoReturn

import click

from studies.cli import output
from studies.cli.app import is_set, say, warned
from studies.cli.errors import INTERRUPTED, SOME_FAILED, STORE_TAKEN
from studies.cli.output import show, tell

if TYPE_CHECKING:
    import xarray as xr

    from sweeps import Plan, Status

# A run that takes longer or writes more asks first; so many failed points are listed.
ASK_SECONDS, ASK_BYTES, LISTED = 300.0, 1e9, 20


def execute(planned: Plan, scheduler: str | None, workers: int | None, fail_fast: bool, yes: bool) -> None:
    """Show a plan, ask for confirmation where it takes long, execute it, and print its findings."""
    import dask

    from studies import results, runner
    from studies.cli.progress import progress
    from sweeps import AbandonedError, ClusterLostError

    preload = [*dask.config.get("distributed.worker.preload", []), output.__name__]
    backend = runner.backend(scheduler, workers)
    asking = not yes and sys.stdin.isatty()
    if asking and isnan(planned.seconds):
        planned = planned.timed()
    say(repr(planned))
    # NaN, where no point gives an estimate, asks too.
    large = not planned.most_seconds <= ASK_SECONDS or (planned.todo and planned.bytes > ASK_BYTES)
    if large and asking and not click.confirm("Go ahead?", err=True):
        tell("nothing was done")
        sys.exit(INTERRUPTED)
    try:
        with (
            dask.config.set({"distributed.worker.preload": preload}),
            results.reading(planned.store),
            warned(),
            progress(planned.todo) as callback,
        ):
            finished = runner.execute(planned, *backend, callback, fail_fast=fail_fast)
    except KeyboardInterrupt as interrupt:
        # A further interrupt must not cut the message short.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        _leave_interrupted(planned, isinstance(interrupt, AbandonedError))
    except ClusterLostError as lost:
        tell(f"{lost}{_kept(planned)}")
        sys.exit(STORE_TAKEN)
    show(finished.study.report(finished.dataset))
    say("\nwritten: " + "\n         ".join(map(str, [finished.file, *finished.figures])))
    if not is_set("quiet") and (beside := finished.beside_reference()):
        say(beside)
    if finished.failed:
        _list_failures(finished.dataset)
        sys.exit(SOME_FAILED)


def _leave_interrupted(planned: Plan, abandoned: bool) -> NoReturn:
    """Print how many points are stored, and exit without waiting for threads that still compute."""
    tell(f"interrupted{_kept(planned)}")
    if abandoned:
        sys.stdout.flush()
        os._exit(INTERRUPTED)
    sys.exit(INTERRUPTED)


def _kept(planned: Plan) -> str:
    """Say what a run that ended early has kept, and how to go on; "" where its folder cannot be read."""
    from sweeps import status

    with suppress(Exception):
        # Whatever the store is like now, the run ends as it was to.
        found = status(str(planned.store))
        if count := found.done + found.failed:
            return f"; {count} of {found.points} points are kept; go on from there with: {typed('--fresh')}"
        return f"; nothing was finished; again with: {typed()}"
    return ""


def typed(*without: str) -> str:
    """The command of this process, as one would type it, without some of its options."""
    return shlex.join(["fiv", *(each for each in sys.argv[1:] if each not in without)])


def _list_failures(dataset: xr.Dataset) -> None:
    """Print failed points, each with its reason, and how to reproduce the first."""
    from sweeps import FAILED

    places = list(zip(*(dataset["status"].values == FAILED).nonzero(), strict=True))
    for place in places[:LISTED]:
        at = dict(zip(dataset["status"].dims, place, strict=True))
        point = dataset.isel(at)
        where = ", ".join(f"{dim} = {point[dim].item()}" for dim in at)
        why = point["error"].item() if "error" in point else "its reason is not in the file"
        show(f"failed: {where}: {why}", err=True)
    if len(places) > LISTED:
        show(f"failed: and {len(places) - LISTED} more", err=True)
    if "reproduce" in dataset and dataset.sizes["failure"]:
        if is_set("verbose"):
            show(dataset["traceback"].values[0], err=True)
        if again := dataset["reproduce"].values[0]:
            show(f"compute one of them again with: {again}", err=True)


def status_text(status: Status) -> str:
    """A status as lines."""
    from sweeps import duration

    rows: list[tuple[str, object]] = [("file", status.file), ("state", status.state), ("points", status.points)]
    rows += [(name, getattr(status, name)) for name in ("done", "failed", "pending", "skipped")]
    if status.state == "incomplete":
        rows[-2] = ("pending", f"{status.pending}, which no run has requested")
    if status.interpolated:
        rows.append(("interpolated", status.interpolated))
    run = status.run
    if "pid" in run:
        begun = run.get("started", "just now")
        rows.append(("run by", f"process {run['pid']} on {run['host']}, begun {begun}"))
    if "todo" in run:
        rows.append(("this run", f"{run['done']} of {run['todo']} computations, {run['rate']:.3g} a second"))
        if not isnan(run["left"]):
            rows.append(("time left", duration(run["left"])))
        rows += [("now", what) for what in run["now"]]
    return "\n".join(f"{name:<15} {text}" for name, text in rows)
