"""Execute a plan: ask for confirmation, compute, and print numbers, or the state of an interrupted run."""

from __future__ import annotations

import os
import re
import shlex
import signal
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from math import isnan, nan
from typing import TYPE_CHECKING, NoReturn

import click

from studies.cli.app import warned
from studies.cli.options import catalogue
from studies.cli.output import FLAGS, rough_duration, say, show, tell

if TYPE_CHECKING:
    from studies.runner import RunResult
    from studies.study import Study
    from sweeps import Plan, Progress, Snapshot

ASK_SECONDS, ASK_BYTES = 300.0, 1e9  # a run that takes longer or writes more asks first
# A measured time counts if it is below the reference's, or so many times as long: the first points of a run take
# longer than all others.
IMPLAUSIBLE_RATIO = 10.0
# `timed` computes batches of these sizes at these places of the work, until so many s have passed.
TRIAL_SIZES, TRIAL_PLACES = (1, 1, 8, 8, 8, 8, 8, 8), (0.0, 0.5, 0.25, 0.75, 0.125, 0.625, 0.375, 0.875)
MEASURED_SECONDS = 0.15


def estimated(study: Study, planned: Plan) -> tuple[Plan, str]:
    """A plan and its report; its time is the reference's for as many points, or that of an earlier run."""
    entry = {"seconds": nan, "points": 1} | catalogue().get(study.like or study.name, {})
    members = planned.sweep.constants.get("members", 1) if study.like else 1
    points = members * planned.requested_count * planned.todo / max(planned.distinct, 1)
    seconds = entry["seconds"] / entry["points"] * points
    advice = "; fiv plan --time measures" * (not study.like)
    if isnan(seconds) or planned.seconds <= seconds or planned.seconds >= IMPLAUSIBLE_RATIO * seconds:
        return planned, repr(planned)
    planned = replace(planned, seconds=seconds)
    text = f"{rough_duration(seconds)}{' on one core' * (seconds >= 1.0)}, as the reference took{advice}"
    return planned, re.sub(r"(?m)^(estimated time +).*$", lambda line: line[1] + text, repr(planned))


def timed(plan: Plan) -> Plan:
    """A plan with its time on one core, from some of its points, computed now; NaN if all of them fail.

    Their results are discarded. The first batch includes compilation and caches, and counts only if it is the only
    one.
    """
    seconds, spent, due = nan if plan.todo else 0.0, 0.0, plan.due.nonzero()[0]
    # Spread over the work, since costs may differ from end to end.
    for number, (count, place) in enumerate(zip(TRIAL_SIZES, TRIAL_PLACES, strict=True)):
        points = due[int(place * plan.todo) :][:count]
        if not len(points) or spent > MEASURED_SECONDS:
            break
        result = plan.task.compute(plan.manifest.grid.points(points))
        taken = float(result.wall_time.sum())
        spent += taken if number else 0.0
        if (number or plan.todo == 1) and len(result.failures) < len(result):
            # The last batch is the largest, and closest to those of a run.
            seconds = taken / len(points) * plan.todo
    return replace(plan, seconds=seconds)


def with_axes(study: Study, planned: Plan, text: str) -> str:
    """A plan's report with the ends, the unit and the number of values of each parameter that varies."""
    from studies.declaring import labels

    sweep, lines = planned.sweep, list[str]()
    for name, axis in {**sweep.grid.axes, **sweep.coords}.items():
        if name not in study.parameters or axis.values.dtype.kind not in "iuf":
            continue
        unit, factor = labels.READABLE.get(axis.units, (axis.units, 1.0))
        values = [f"{factor * value:.6g}" for value in sorted(axis.values.tolist())]  # draws are in no order
        ends = (" and " if len(values) == 2 else " to ").join(dict.fromkeys([values[0], values[-1]]))
        lines.append(f"  {name:<13} {f'{ends} {unit}'.rstrip()}, {len(values)} value{'s'[: len(values) - 1]}")
    head, grid, rest = re.split(r"(?m)^(grid .*\n)", text, maxsplit=1)
    return head + grid + "".join(f"{line}\n" for line in lines) + rest


def execute(
    study: Study, planned: Plan, how: tuple[str | None, int | None], fail_fast: bool, yes: bool, lines: list[str]
) -> None:
    """Show a plan and warnings, ask if it is long or unusual, execute it, and print its numbers."""
    from studies import runner

    backend = runner.backend(*how)
    asking = not yes and sys.stdin.isatty()
    planned, text = estimated(study, planned)
    if asking and isnan(planned.seconds):
        planned = timed(planned)
        text = repr(planned)
    say(with_axes(study, planned, text), *lines)
    # NaN, where no point gives an estimate, asks too.
    large = not planned.most_seconds <= ASK_SECONDS or (planned.todo and planned.bytes > ASK_BYTES)
    if asking and (large or planned.sweep.remark) and not click.confirm("Go ahead?", err=True):
        tell("nothing was done")
        sys.exit(130)
    with watched(planned) as last:
        if planned.shared:
            planned.run(*backend, last, fail_fast=fail_fast)
            failed = last.snapshot.failed if last.snapshot else 0
            say(f"share {'{} of {}'.format(*planned.shared)} is computed, {failed} failed")
            sys.exit(1 if failed else 0)
        finished = runner.execute(study, planned, *backend, last, fail_fast=fail_fast)
    report(study, finished, planned.adopted, planned.sweep.remark)


@contextmanager
def watched(planned: Plan) -> Iterator[_Last]:
    """Show the progress of a plan that is executed in this context; report what is stored if it is interrupted."""
    from studies.answering import results
    from studies.cli.progress import progress
    from sweeps import ClusterLostError, FailedPointsWarning

    last = _Last()
    try:
        with results.damage_as_error(planned.store), warned(say), progress(planned.todo) as last.callback:
            warnings.simplefilter("ignore", FailedPointsWarning)  # they are listed later
            yield last
    except KeyboardInterrupt as interrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a further interrupt would cut the message short
        tell(f"interrupted{last.stored(planned)}")
        if type(interrupt).__name__ == "AbandonedError":
            os._exit(130)  # threads still compute, for which an exit would wait
        sys.exit(130)
    except ClusterLostError as lost:
        tell(f"{lost}{last.stored(planned)}")
        sys.exit(3)


def report(study: Study, finished: RunResult, adopted: str = "", remark: str = "") -> NoReturn:
    """Print the numbers, differences and failures of a finished run; end with its exit code."""
    from studies.answering import summary

    parts = [*summary.parts(study, finished.dataset)]
    show(summary.text(parts))
    if adopted:
        say(f"\nadopted: {adopted}")
    say("\nwritten: " + "\n         ".join(map(str, [finished.file, *finished.figures])))
    if any("differs" in [*part[1].get("deviation", ())] for part in parts if not isinstance(part, str)):
        say("why some differ: results/README.md, What differs from the paper, and why")
    # The first part is of the operating point.
    say(*(summary.text([f"found: {part}"]) for part in parts[1:2] if isinstance(part, str)))
    if remark:
        say(f"fiv: {remark}")
    if moved := finished.fixed_contact():
        say(f"fiv: {moved}")
    if not FLAGS["quiet"] and (beside := finished.beside_reference()):
        say(beside)
    if "reproduce" in finished.dataset and finished.dataset.sizes["failure"]:
        if FLAGS["verbose"]:
            show(finished.dataset["traceback"].values[0], err=True)
        if again := finished.dataset["reproduce"].values[0]:
            show(f"compute one of the failed points again with: {again}", err=True)
    sys.exit(1 if finished.failed else 0)


class _Last:
    """Passes snapshots on and keeps the last one, for the report of a run that ends early."""

    callback: Progress | None = None
    snapshot: Snapshot | None = None

    def __call__(self, snapshot: Snapshot) -> None:
        self.snapshot = snapshot
        if self.callback is not None:
            self.callback(snapshot)

    def stored(self, planned: Plan) -> str:
        """The number of stored computations, and the command that continues."""
        now = self.snapshot
        done, todo = (now.done, now.todo) if now else (planned.cached, planned.cached + planned.todo)
        if not done:
            return f"; nothing was finished; again with: {typed_command()}"
        stored = f"{done} of {todo} computations are stored"
        return f"; {stored}; go on from there with: {typed_command('--fresh')}"


def typed_command(*without: str) -> str:
    """The command line of this process without some of its options."""
    return shlex.join(["fiv", *(word for word in sys.argv[1:] if word not in without)])
