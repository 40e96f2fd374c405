"""The commands that compute: plan, run and map.

Heavy packages are imported inside the commands, so that `fiv --help` answers at once.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from studies.cli.app import command, say, warned
from studies.cli.execution import execute
from studies.cli.options import HOW, MAP, STUDY, WHAT, MapCommand
from studies.cli.output import show

if TYPE_CHECKING:
    from studies.config import Config
    from sweeps import Plan

TIME = click.option("--time", "timed", is_flag=True, help="Compute a few points now, to estimate the time of all.")


@command("plan", "Dry run: what a run would compute and cost.", STUDY, *WHAT, TIME)
def show_plan(study: str, timed: bool, **what: Any) -> None:
    """Dry run: what a run would compute, store and cost. Nothing is written, and without --time nothing computed.

    \b
    fiv plan fig5 --set mu=0:0.5:2001
    fiv plan scenes --set V=log:1e-3:1e-2:10 --record velocity_B
    """  # noqa: D301 - the backspace tells click to keep the lines
    planned, _ = _planned(study, **what)
    show(repr(planned.timed() if timed else planned))


@command("run", "Compute a study, store it, draw it, print its numbers.", STUDY, *WHAT, *HOW)
def run(study: str, scheduler: str | None, workers: int | None, fail_fast: bool, yes: bool, **what: Any) -> None:
    """Compute a study, store it as netCDF, draw its figure, and print its numbers beside the paper's.

    \b
    fiv run fig5
    fiv run fig5 --set theta=8 --set p1_length=0.06 --out elsewhere
    fiv run scenes --set V=1e-3,2e-3 --record velocity_B,normal_force --sample-rate 50e3 --out series
    fiv run fig5 --scatter mu=normal:0.2:0.02 --scatter p1_thickness=uniform:1.9e-3:2.1e-3 --samples 256
    fiv run fig5 --points rigs.csv

    Points that the results folder holds already are not computed again. Ctrl-C finishes the points under way and
    stores them; the same command goes on from there.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies.cli.progress import announce_compiling

    announce_compiling()
    planned, config = _planned(study, scheduler=scheduler, workers=workers, writing=True, **what)
    execute(planned, config.scheduler, config.workers, fail_fast, yes)


@command("map", "One quantity over any two axes, or along one, stored and drawn.", *MAP, *HOW, kind=MapCommand)
def draw_map(
    x: str,
    y: str | None,
    fixed: tuple[str, ...],
    quantity: str,
    halvings: int,
    tolerance: float | None,
    scatter: tuple[str, ...],
    samples: int | None,
    seed: int | None,
    standard_error: float | None,
    out: str | None,
    fresh: bool,
    retry_failed: bool,
    strict: bool,
    **how: Any,
) -> None:
    """Map one quantity over any two axes of the rig or its operation, or along one; store it and draw it.

    \b
    fiv map --x theta=-10:20:9 --y mu=0:0.5:9 --quantity growth_rate --refine 3
    fiv map --x V=log:2e-4:1e-2:9 --y mu=0.01:0.4:9 --quantity regime --refine 3 --fix theta=8
    fiv map --x theta=0:20:61 --y mu=0:0.5:51 --quantity probability_unstable --scatter p1_length=normal:0.05:1e-4

    With --refine the SPECs give a coarse lattice; the map has 2^N times as many intervals, and is computed where
    it changes.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import runner
    from studies.cli.progress import announce_compiling
    from studies.maps import maps
    from studies.scatter.study import cut_notes
    from sweeps import check_free

    announce_compiling()
    for name, value in (("standard_error", standard_error), ("samples", samples), ("seed", seed)):
        if value is not None:
            fixed = (*fixed, f"{name}={value!r}")
    drawn = _drawn(scatter)
    constants = maps.fixed_of(fixed)
    plane = maps.plane_of(x, y or maps.line_along(x, quantity, constants), halvings)
    sweep = maps.sweep_of(plane, quantity, constants, halvings, tolerance, drawn)
    with warned():
        sweep = replace(sweep, remark=runner.remark(maps.unusual_in(plane, quantity, constants), strict=strict))
    file = maps.file_of(plane, quantity, out, constants, drawn)
    check_free(file)
    for line in cut_notes(drawn):
        say(f"fiv: {line}")
    execute(sweep.plan(file, fresh=fresh, retry_failed=retry_failed, strict=strict), **how)


def _drawn(scatter: tuple[str, ...]) -> dict[str, str]:
    """Distributions of --scatter by the name that each scatters."""
    from studies import spec
    from sweeps import InputError

    drawn = dict[str, str]()
    for text in scatter:
        own, distribution = spec.split(text, "--scatter", "NAME=DISTRIBUTION, for example mu=normal:0.2:0.02")
        if own in drawn:
            raise InputError(f"--scatter {text!r}: {own} scatters already; give it once")
        drawn[own] = distribution
    return drawn


def _planned(
    study: str,
    assignments: tuple[str, ...],
    config_file: str | None,
    out: str | None,
    record: str | None,
    sample_rate: float | None,
    standard_error: float | None,
    fresh: bool,
    retry_failed: bool,
    strict: bool,
    scatter: tuple[str, ...] = (),
    samples: int | None = None,
    seed: int | None = None,
    sampling: str | None = None,
    points: str | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    writing: bool = False,
) -> tuple[Plan, Config]:
    """Plan a study from options; wrong input is refused here, before anything is written.

    Options come before the configuration's file, and that before the configuration of a result given as STUDY.
    """
    from studies import config, registry, results, runner, spec
    from studies.scatter.study import cut_notes, named
    from sweeps import InputError, check_free

    names = () if record is None else tuple(name.strip() for name in record.split(","))
    where = (_drawn(scatter), samples, seed, sampling, points)
    requested = config.Config("", {}, {}, names, sample_rate, *where, scheduler, workers)
    if config_file is not None:
        requested = requested.over(config.read(config_file))
    name = study
    if results.is_path(study):
        with results.reading(results.results_file(study)):
            requested = requested.over(made := config.of_result(results.open_dataset(study), study))
        name = made.study
    one = registry.resolve(name)
    if requested.study not in ("", one.name, study):
        raise InputError(
            f"--config {config_file}: study = {requested.study!r}: STUDY is {one.name}; leave one out"
        )
    options: dict[str, Any] = {}
    config.check_counts(one, {**requested.axes, **dict(map(spec.split, assignments))})
    if standard_error is not None:
        assignments = (*assignments, f"standard_error={standard_error!r}")
    for text in assignments:
        axis, values = spec.assignment(text, one.texts, one.units)
        if axis in options:
            raise InputError(f"--set {text!r}: {axis} is set already; give all its values at once")
        options[axis] = values
    if writing:
        check_free(results.file_of(named(one, requested.scatter, requested.points), out))
    values = requested.values_of(one) | options
    series: dict[str, Any] = {"record": requested.record, "sample_rate": requested.sample_rate}
    how: dict[str, Any] = {"fresh": fresh, "retry_failed": retry_failed, "strict": strict}
    with warned():
        planned = runner.plan(one, values, out, **how, **series, **requested.where)
    for line in cut_notes(requested.scatter):
        say(f"fiv: {line}")
    return planned, requested
