"""Predefined studies of the paper, from Python: `studies.run("fig5")`, `studies.map(...)`, `studies.open("fig5")`.

A rig with a name, `studies.rig("mine", p1_length="60mm")`, has results of its own: `studies.run(..., rig="mine")`.

Their datasets have the accessor `.fiv` (`studies.query.accessor`). The command line starts from here, so nothing
heavy is imported before it is used.
"""

from __future__ import annotations

from warnings import warn

# Not typing's, which is slow to import: the command line answers to Ctrl-C only once it has begun.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path
    from typing import Any

    import pandas as pd
    import xarray as xr

    from studies.asking.rigs import AnyRig, NamedRig
    from studies.study import Study
    from sweeps import Plan, Progress

# Two shadow built-ins, in this module only.
__all__ = ["compare", "fit", "map", "measure", "open", "rig", "run"]


def run(
    study: str | Study,
    *,
    record: Sequence[str] = (),
    sample_rate: float | str | None = None,
    scheduler: Any = None,
    workers: int | None = None,
    progress: bool | Progress | None = None,
    out: str | Path | None = None,
    fresh: bool = False,
    retry_failed: bool = False,
    samples: int | None = None,
    seed: int | None = None,
    points: str | Path | Mapping[str, Any] | pd.DataFrame | None = None,
    rig: AnyRig | None = None,
    **parameters: Any,
) -> xr.Dataset:
    """Run a study, store its netCDF file and figure in the results folder, and return its dataset.

    Parameters
    ----------
    study : str or Study
        A name that `fiv list` prints, the path of a FILE.py, or a `studies.study.Study`.
    record, sample_rate : sequence of str, float or str
        Time series to keep, such as "velocity_B", and their sampling rate, in Hz or as "20kHz".
    scheduler, workers : object, int
        "threads" (the default), "sync", a Dask scheduler's address, or what `sweeps.Plan.run` takes besides: a
        Dask client or cluster, an executor; number of processes, or of threads.
    progress : bool or callable
        True shows a bar; a callable gets a `sweeps.Snapshot` now and then.
    out : path
        The results folder, by default FIV_RESULTS or `results`.
    fresh, retry_failed : bool
        Start over, instead of computing missing points; compute failed points again, too.
    samples, seed : int
        Number of draws, and their seed; by default 1024 and 0.
    points : path, mapping or pandas.DataFrame
        Rows to compute instead of a grid: a CSV file, or columns by name.
    rig : str, NamedRig, fivcore.Rig, Structure or path
        The name of a rig (`studies.rig`) or itself, in whose folder the results then lie; or in place of the
        paper's rig a `fivcore.Rig`, a `fivcore.Structure`, its TOML file, a result of it, or a TOML file with a
        table [set]. A path has a suffix or a slash. A parameter over which the study has a range keeps that.
    **parameters
        A number in SI, a word, a list, a frozen distribution of `scipy.stats`, or text as on the command line:
        ``V="1,2mm/s"``, ``mu="0:0.5:101"``, ``p1_length="normal:50:0.1mm"``.

    A wrong name or value is a `ValueError`, an unusable folder a `sweeps.StoreError`; nothing is written then.
    """
    from studies import registry, runner
    from studies.asking import rigs
    from studies.asking.request import Request

    one = registry.resolve(study)
    request = Request("", parameters, points, tuple(record), sample_rate, samples, seed)
    request, place = rigs.requested(rig, request, one, out)
    plan = runner.plan(one, request, place, fresh=fresh, retry_failed=retry_failed)
    return _executed(one, plan, scheduler, workers, progress)


def map(
    x: str,
    y: str | None = None,
    quantity: str | Sequence[str] = "growth_rate",
    *,
    fix: Mapping[str, Any] | None = None,
    refine: int = 0,
    tolerance: float | None = None,
    **options: Any,
) -> xr.Dataset:
    """Map quantities over two parameters, or along one, store them with a figure, and return the dataset.

    `x` and `y` are as on the command line, ``"theta=-10:20:61"``; `quantity` has one or several names of `fiv map
    --help`; `fix` has other parameters, as `run` takes them: ``{"theta": 8, "p1_length": "60mm"}``. Intervals are
    halved `refine` times where the quantity changes, and interpolated where the estimated error is at most
    `tolerance`, relative to the range of the values. Other options, such as `rig`, and errors are those of `run`.
    """
    from studies import runner

    how = [options.pop(name, None) for name in ("scheduler", "workers", "progress")]
    one, planned = runner.plan_map(x, y, quantity, fix, refine=refine, tolerance=tolerance, **options)
    return _executed(one, planned, *how)


def fit(
    problem: str | Path | Mapping[str, Any],
    *,
    samples: int | None = None,
    rounds: int | None = None,
    rig: AnyRig | None = None,
    out: str | Path | None = None,
    fresh: bool = False,
    scheduler: Any = None,
    workers: int | None = None,
    progress: bool | Progress | None = None,
) -> xr.Dataset:
    """Find the parameters that give what was observed, store weighted draws with a figure, and return the dataset.

    `problem` is the path of a TOML file as `fiv fit --help` describes it, or a dict like its content. There are
    `rounds` rounds of `samples` draws each, by default 4 of 128; other options and errors are those of `run`. The
    dataset has along `draw` each unknown, the `round`, the `weight` and the prediction of each target.
    """
    from functools import partial

    from studies import registry, runner
    from studies.answering import results
    from studies.asking import rigs
    from studies.fitting import presentation
    from studies.fitting.problem import read
    from studies.fitting.rounds import run as fitted
    from studies.query import accessor  # noqa: F401 - with the accessor .fiv

    own, place = rigs.found(rig, out)
    one, watch = read(problem, registry.resolve, own, samples=samples, rounds=rounds), partial(_callback, progress)
    file = results.file_of_fit(one.name, place)
    dataset = fitted(one, file, runner.backend(scheduler, workers), watch, fresh=fresh)
    runner.plot(presentation.study(dataset), dataset, file)
    return dataset


def _executed(study: Study, planned: Plan, scheduler: Any, workers: Any, progress: Any) -> xr.Dataset:
    from studies import runner
    from studies.query import accessor  # noqa: F401 - with the accessor .fiv

    with _callback(progress, planned) as callback:
        return runner.execute(study, planned, *runner.backend(scheduler, workers), callback).dataset


def _callback(progress: Any, planned: Plan) -> AbstractContextManager[Progress | None]:
    from contextlib import nullcontext

    from studies.cli.progress import bar

    return bar(planned.todo) if progress is True else nullcontext(progress or None)


def measure(
    path: str | Path,
    *,
    unit: str | None = None,
    rate: float | str | None = None,
    channel: int | str | None = None,
    band: tuple[float, float] = (200.0, 10e3),
) -> dict[str, Any]:
    """Look at one measured signal as at the velocity of B of a run; nothing is integrated.

    The file is CSV or other text, WAV, a universal file with data sets 58, or MATLAB up to v7. `unit` is that of
    its numbers, or with a number what 1 in it is, "50mm/s"; `rate` is in Hz or "50kHz"; `channel` is a name or a
    number, from 1. The dominant frequency is in the `band`, Hz.

    The names are those of a `Transient.summary`, `dominant_frequency`, `periodicity`, `velocity_rms` and its `_se`
    (`signal_rms` where the unit is none of speed), but in the signal's own `unit`. A signal does not know the
    contact: in place of long sticks it has quiet spells (`studies.answering.measured`), with `quiet_fraction`,
    `quiet_times`, `quiet_starts`, s, and `quiet_frequency`, Hz. `line_frequencies` outside of them are in Hz,
    `line_levels` in dB below the strongest. Above 5 samples in a period of the band's end the signal is decimated,
    to `analysed_rate`. A standard error is NaN where the signal is shorter than 16 cycles of spell and burst, that
    of `mean_quiet_time` with fewer than 12 spells. An `InputError` says what is wrong with a file or missing.
    """
    from studies.answering import measured

    return measured.statistics(measured.read(path, unit, rate, channel), band)


def rig(
    name: str, source: AnyRig | None = None, *, out: str | Path | None = None, **numbers: float | str
) -> NamedRig:
    """Name a rig, so that its results lie in a folder of their own; or get one by its name.

    Parameters
    ----------
    name : str
        Letters, digits, _ and -.
    source : str, path, NamedRig, fivcore.Rig or Structure, optional
        Where its numbers or its structure come from: another rig, a TOML file with a table [set], a structure or
        its file. Without source and numbers the rig must exist.
    out : path
        The results folder, by default FIV_RESULTS or `results`; the rig is kept there as NAME/rig.toml.
    **numbers
        In SI or as text: ``p1_length="60mm"``; also where it usually runs: ``mu=0.4``, ``F="20N"``, ``V="1mm/s"``.

    Returns
    -------
    NamedRig
        With `.name`, `.folder`, `.numbers` of its own, `.results` by name and `.title`; the other functions take
        it as they take its name.

    A wrong name or number is a `ValueError`, and so is another number for a rig that has results.
    """
    from studies import registry
    from studies.asking import rigs

    if source is None and not numbers:
        return rigs.named(name, out)
    return rigs.define(name, source, numbers, out, taken=registry.names())[0]


def compare(
    a: str | NamedRig, b: str | NamedRig, *, out: str | Path | None = None, progress: bool | Progress | None = None
) -> xr.Dataset:
    """Steady sliding of two rigs beside each other, along `rig`, and their figure in results/compare.

    A rig is given by its name or itself; ``"paper"`` is the paper's. The study `fig5` of each is computed if its
    folder lacks it. A structure has no number of the beams, where it has NaN; numbers of modes and onsets are
    padded with NaN as well.
    """
    from studies.query import accessor  # noqa: F401 - with the accessor .fiv
    from studies.query import compare as comparing

    def execute(study: Study, planned: Plan) -> xr.Dataset:
        return _executed(study, planned, None, None, progress)

    own, pair, _ = comparing.compared(a, b, out, execute, lambda line: warn(line, stacklevel=4))
    comparing.drawn(own, pair, out)
    return comparing.joined(pair)


def open(name: str | Path, out: str | Path | None = None, *, rig: str | NamedRig | None = None) -> xr.Dataset:
    """Open a result by its name in the results folder, else with a warning in the reference, or by its path.

    `rig` is the name of the rig whose result it is, or itself.
    """
    from studies.answering import results
    from studies.asking import rigs
    from studies.query import accessor  # noqa: F401 - with the accessor .fiv

    out = rigs.place(rig, results.existing(out))
    dataset = results.open_dataset(name, out)
    if notice := results.notice(name, out):
        warn(notice, stacklevel=2)
    return dataset
