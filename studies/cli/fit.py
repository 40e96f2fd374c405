"""The command that finds the parameters which give what was observed. Heavy packages are imported inside it."""

from __future__ import annotations

from typing import Any

import click

from studies.cli.app import command, warned
from studies.cli.execution import report, watched
from studies.cli.options import HOW, RIG, STORED
from studies.cli.output import say
from studies.cli.progress import announce_compiling

FILE = click.argument("file", metavar="FILE.toml")
DRAWS = (
    click.option("--samples", type=int, metavar="N", help="Draws of each round; default: 128."),
    click.option("--rounds", type=int, metavar="K", help="Number of rounds; default: 4. More are added to those."),
)


@command("fit", "Find parameters from measurements.", FILE, RIG, *DRAWS, *STORED[:2], *HOW[:2])
def fit(
    file: str,
    rig: str | None,
    out: str | None,
    fresh: bool,
    scheduler: str | None,
    workers: int | None,
    **draws: Any,
) -> None:
    """Find the parameters that give what was observed: weighted draws, medians and intervals, a figure of pairs.

    \b
    fiv fit bench.toml

    FILE.toml has under [unknown] NAME = a distribution as for --scatter (`length` is of both beams, `p1_length` of
    one), and tables [[target]]. A target is an `output` with its measured `value`, and `within`, one standard
    deviation of a normal error; or `is`, a word for it, "intermittent" or "not intermittent". A `study` computes
    it where its parameters are as in `at`; without one it is a quantity of fiv map. [set] has parameters of all
    studies. `rig` is the file of a structure, of which d1, d2, damping_ratio, mass_scale, stiffness_scale and
    frequency_K, that of its mode K, can be unknown.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import registry, runner
    from studies.answering import results
    from studies.asking import rigs
    from studies.fitting import presentation, problem, rounds
    from sweeps import check_free

    announce_compiling()
    one, folder = rigs.found(rig, out)
    with warned(say):
        read = problem.read(file, registry.resolve, one, **draws)
    check_free(place := results.file_of_fit(read.name, folder))
    dataset = rounds.run(read, place, runner.backend(scheduler, workers), watched, fresh=fresh)
    study = presentation.study(dataset)
    report(study, runner.RunResult(study, dataset, place, runner.plot(study, dataset, place)))
