"""A study at points that are no grid: drawn from distributions, or the rows of a table.

It is a sweep of its own, with a file of its own, and what it shows is the same for every study: how its numbers
scatter, and with what.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from studies import registry
from studies.scatter import distributions, function
from studies.scatter.findings import findings
from studies.scatter.table import columns_of, table
from studies.study import Study, deferred, suggest
from sweeps import Axis, Grid, InputError, Sample, Sweep, check_size

if TYPE_CHECKING:
    import xarray as xr

SCATTER, POINTS = registry.SUFFIXES
SAMPLES, SEED, SAMPLING = 1024, 0, "sobol"
# Whole numbers up to this one are floats too.
MOST_EXACT = 2**53
ROW = "row"
# Of so many drawn rigs one must be possible; of a table's rigs as many are checked in full.
TRIED, CHECKED = 16, 100


def named(study: Study, scatter: Any, points: Any) -> str:
    """The name of a study at scattered points, or at its own where none are asked for."""
    own = scatter and not study.scatters
    return f"{study.name}{SCATTER if own else POINTS if points else ''}"


def derived(study: Study, suffix: str) -> Study:
    """The study at scattered points as a result's name finds it: it shows a result, and makes none."""
    return _derived(study, suffix, partial(_refused, study.name))


def nameless(name: str, suffix: str) -> Study:
    """The same where the study is of a file that nobody has named: what a result shows needs nothing of it."""
    build = partial(_refused, name)
    return derived(Study(name, name, "", "", {}, {}, deferred(""), findings, build=build), suffix)


def _refused(name: str, axes: Mapping[str, Axis], settings: Mapping[str, Any]) -> Sweep:
    raise InputError(
        f"STUDY: say where its points are: fiv run {name} --scatter NAME=DISTRIBUTION, or --points FILE.csv; "
        "or name the file of a result, to make it again"
    )


def scattered(
    study: Study,
    values: Mapping[str, Any],
    scatter: Mapping[str, str] | None = None,
    samples: int | None = None,
    seed: int | None = None,
    sampling: str | None = None,
    points: str | Path | Mapping[str, Any] | None = None,
) -> Study:
    """The study at the points that are asked for, or as it is where none are.

    Parameters
    ----------
    study : Study
    values : mapping
        Values of other axes and settings; they may not be scattered too.
    scatter : mapping of str to str, optional
        Distributions of axes and settings: `normal:0.2:0.02`.
    samples, seed : int, optional
        By default 1024 and 0.
    sampling : str, optional
        "sobol", "latin" or "random".
    points : path or mapping, optional
        A CSV file, or columns by name.

    Raises
    ------
    InputError
        If arguments exclude each other, or a name cannot be scattered.
    """
    if study.scatters and points is None:
        return _by_itself(study, scatter or {}, {"samples": samples, "seed": seed}, sampling)
    if not scatter:
        for name, value in (("samples", samples), ("seed", seed), ("sampling", sampling)):
            if value is not None:
                raise InputError(f"--{name} {value}: it says how numbers are drawn; say which with --scatter")
        if points is None:
            return study
    if scatter and points is not None:
        raise InputError("--scatter and --points: each says where the points are; leave one out")
    if study.function is None:
        if registry.parted(study.name)[1]:
            study.sweep({})
        raise InputError(f"study {study.name} is not one function of its axes: its points cannot be scattered")
    if scatter:
        return _of_distributions(
            study,
            values,
            scatter,
            SAMPLES if samples is None else samples,
            SEED if seed is None else seed,
            sampling or SAMPLING,
        )
    assert points is not None
    return _of_table(study, values, points)


def _by_itself(
    study: Study, scatter: Mapping[str, str], counts: Mapping[str, int | None], sampling: str | None
) -> Study:
    """A study that scatters numbers by itself, with these distributions, where some are given, and counts."""
    if sampling not in (None, SAMPLING):
        raise InputError(f"--sampling {sampling}: study {study.name} draws by {SAMPLING} alone; leave it out")
    settings = dict(study.settings)
    for name, value in counts.items():
        if value is not None:
            if not 0 <= value <= MOST_EXACT:
                raise InputError(f"--{name} {value}: it must be from 0 to {MOST_EXACT}")
            settings[name] = replace(settings[name], value=float(value))
    if not scatter:
        return replace(study, settings=settings)
    assert study.build is not None
    texts = {name: distributions.parse(text, name).text for name, text in scatter.items()}
    request = {**study.request, "scatter": texts}
    return replace(study, settings=settings, build=partial(_built, study.build, texts), request=request)


def _built(
    build: Callable[..., Sweep],
    scatter: Mapping[str, str],
    axes: Mapping[str, Axis],
    settings: Mapping[str, Any],
) -> Sweep:
    return build(axes, {**settings, "scatter": scatter})


def _of_distributions(
    study: Study, values: Mapping[str, Any], scatter: Mapping[str, str], samples: int, seed: int, sampling: str
) -> Study:
    columns = columns_of(study)
    for name in scatter:
        _check_scattered(study, name)
    _check_apart(values, scatter, "--scatter")
    # In the study's order, so that the order of options changes nothing.
    drawn = {name: distributions.parse(scatter[name], name) for name in columns if name in scatter}
    units = {name: (columns[name].units, columns[name].long_name) for name in drawn}
    try:
        grid = Sample(drawn, samples, sampling, seed, units=units)
    except InputError as problem:
        text = str(problem).replace("Sample: count", "--samples").replace("Sample: method", "--sampling")
        raise InputError(text.replace("Sample: seed", "--seed").removeprefix("Sample: ")) from None
    attributes = {
        name: {"distribution": each.text, "cut_away": each.cut, "comment": each.cut_note(name)}
        for name, each in drawn.items()
    }
    request = {"scatter": {name: each.text for name, each in drawn.items()}, "seed": seed, "sampling": sampling}
    return _at(study, grid, SCATTER, request, attributes)


def cut_notes(scatter: Mapping[str, str]) -> list[str]:
    """A line for each distribution that is cut to physical values, with the share that is lost."""
    return [line for name, text in scatter.items() if (line := distributions.parse(text, name).cut_note(name))]


def _of_table(study: Study, values: Mapping[str, Any], points: str | Path | Mapping[str, Any]) -> Study:
    columns, read = columns_of(study), table(study, points)
    _check_apart(values, read.columns, "--points")
    axes = {ROW: Axis(np.arange(1, len(read.places) + 1), long_name="row of the table")}
    axes |= {name: Axis(each, columns[name].units, columns[name].long_name) for name, each in read.columns.items()}
    grid = Grid(axes, zipped=tuple(axes), sampling={"method": "a table"})
    return _at(study, grid, POINTS, {"points": list(read.columns)}, {}, read.places)


def _check_scattered(study: Study, name: str) -> None:
    columns = columns_of(study)
    if name not in columns:
        near = suggest(name, list(columns)) or f"there are {', '.join(columns)}"
        raise InputError(
            f"--scatter {name}: study {study.name} has no axis and no setting of that name; {near.strip()}"
        )
    if name in study.texts:
        words = ", ".join(study.texts[name][:5])
        raise InputError(f"--scatter {name}: it is one of {words}, and no number; choose some with --set")
    if name.endswith("_elements") or (name in study.axes and study.axes[name].values.dtype.kind == "i"):
        raise InputError(f"--scatter {name}: it is a whole number; choose some with --set or --points")


def _check_apart(values: Mapping[str, Any], names: Mapping[str, Any], option: str) -> None:
    for name in names:
        if name in values:
            raise InputError(f"{option} {name}: it is set too, by --set or --config; give one of the two")


def _at(
    study: Study,
    grid: Grid,
    suffix: str,
    request: Mapping[str, Any],
    attributes: Mapping[str, Mapping[str, Any]],
    places: Sequence[str] = (),
) -> Study:
    """The study at the points of a grid; what scatters is neither an axis nor a setting of it."""
    made = _derived(study, suffix, partial(_sweep, study, grid, suffix, attributes, places))
    return replace(
        made,
        axes={name: each for name, each in study.axes.items() if name not in grid.axes},
        settings={name: each for name, each in study.settings.items() if name not in grid.axes},
        request=request,
        record=None if study.record is None else partial(_recorded, study, tuple(grid.axes)),
    )


def _derived(study: Study, suffix: str, build: Callable[..., Sweep]) -> Study:
    how = "at scattered points" if suffix == SCATTER else "at the rows of a table"
    return Study(
        name=f"{study.name}{suffix}",
        title=f"{study.title}, {how}",
        question=study.question,
        paper=study.paper,
        axes=study.axes,
        settings=study.settings,
        draw=deferred("studies.scatter.figure:draw"),
        findings=findings,
        build=build,
    )


def _recorded(
    study: Study,
    scattered: Sequence[str],
    made: Study,
    values: Mapping[str, Any],
    names: Sequence[str],
    sample_rate: float | None,
) -> Sweep:
    """The sweep that keeps series too: of one length, so what makes their times may not scatter."""
    for name in ("duration", "sample_rate"):
        if name in scattered:
            raise InputError(f"record = {', '.join(names)}: series need one {name}, and that scatters; set it")
    assert study.record is not None
    return study.record(made, values, names, sample_rate)


def _sweep(
    study: Study,
    grid: Grid,
    suffix: str,
    attributes: Mapping[str, Mapping[str, Any]],
    places: Sequence[str],
    axes: Mapping[str, Axis],
    settings: Mapping[str, Any],
) -> Sweep:
    """The sweep over the points of `grid` times the study's other axes."""
    assert study.function is not None
    own = tuple(study.axes)
    scattered = tuple(name for name in grid.axes if name in study.settings)
    skip = None if study.skip is None else partial(function.of_axes, study.skip, own)
    whole = Grid({**grid.axes, **axes}, grid.groups[0], skip, grid.sampling)
    check_size(whole)
    base = function.Base(study.function, study.constants, own, (*settings, *scattered), scattered)
    options = dict(study.options)
    if options.get("key"):
        options["key"] = partial(function.keys, options["key"], own, scattered)
    if options.get("scale"):
        options["scale"] = partial(function.of_axes, options["scale"], own)
    if scattered:
        # The points of one rig are neighbours in the grid's own order.
        options.pop("order_by", None)
    return Sweep(
        f"{study.name}{suffix}",
        partial(function.computed, base),
        whole,
        study.variables,
        dict(settings),
        coords=_checked(study, grid, {**grid.axes, **axes}, settings, scattered, places),
        code=("fivcore",),
        title=f"{study.title}, {len(next(iter(grid.axes.values())))} points",
        derive=partial(_with_attributes, attributes=attributes) if attributes else None,
        **options,
    )


def _checked(
    study: Study,
    grid: Grid,
    axes: Mapping[str, Axis],
    settings: Mapping[str, Any],
    scattered: Sequence[str],
    places: Sequence[str],
) -> Mapping[str, Axis]:
    """The coordinates of the study's variables, once all that can be checked beforehand is."""
    every = _constants(study, grid, settings, scattered, places)
    made = [study.coords(**own) if callable(study.coords) else study.coords for own in every]
    if not all(_same(made[0], each) for each in made):
        raise InputError(
            f"{', '.join(scattered)}: it decides the shape of what study {study.name} gives, so it cannot scatter"
        )
    if study.check is not None:
        try:
            study.check(_axes_at(study, grid, axes, slice(None)), every[0])
        except ValueError as problem:
            # A table's rows are at fault one by one, if at all.
            if not places:
                raise InputError(str(problem)) from None
            _check_rows(study, grid, axes, every, places)
            raise InputError(str(problem)) from None
        if scattered:
            _check_rows(study, grid, axes, every, places[:CHECKED])
    return made[0]


def _constants(
    study: Study, grid: Grid, settings: Mapping[str, Any], scattered: Sequence[str], places: Sequence[str]
) -> list[Mapping[str, Any]]:
    """The constants of each row of a table, or of the draws that can be; one where no setting scatters."""
    rows = list(zip(*(grid.axes[name].values.tolist() for name in scattered), strict=True)) if scattered else [()]
    constants = list[Mapping[str, Any]]()
    for k, row in enumerate(rows if places or callable(study.coords) else rows[:TRIED]):
        try:
            constants.append(dict(study.constants({**settings, **dict(zip(scattered, row, strict=True))})))
        except ValueError as problem:
            if places and scattered:
                raise InputError(f"{places[k]}: {problem}") from None
            if not constants and k == min(TRIED, len(rows)) - 1:
                raise InputError(str(problem)) from None
    return constants


def _axes_at(study: Study, grid: Grid, axes: Mapping[str, Axis], chosen: Any) -> dict[str, Axis]:
    """The study's axes with the values of some of the grid's rows."""
    return {
        name: replace(axes[name], values=np.unique(axes[name].values[chosen])) if name in grid.axes else axes[name]
        for name in study.axes
    }


def _check_rows(
    study: Study,
    grid: Grid,
    axes: Mapping[str, Axis],
    every: Sequence[Mapping[str, Any]],
    places: Sequence[str],
) -> None:
    """The study's own check of each row of a table, which names the line."""
    assert study.check is not None
    for k, place in enumerate(places):
        try:
            study.check(_axes_at(study, grid, axes, [k]), every[k % len(every)])
        except ValueError as problem:
            raise InputError(f"{place}: {problem}") from None


def _same(one: Mapping[str, Axis], other: Mapping[str, Axis]) -> bool:
    return one.keys() == other.keys() and all(np.array_equal(one[n].values, other[n].values) for n in one)


def _with_attributes(dataset: xr.Dataset, *, attributes: Mapping[str, Mapping[str, Any]]) -> xr.Dataset:
    """Say of each draw how it is distributed, and what share was cut away."""
    for name, each in attributes.items():
        dataset[name].attrs |= {key: value for key, value in each.items() if value != ""}
    return dataset
