"""A study and a request become a sweep, checked before anything is computed."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from fivcore import Structure, checks
from studies.asking import call
from studies.asking.own import compute, of_structure
from studies.asking.points import Points, points_of
from studies.declaring.own import varied
from studies.declaring.parameters import FRICTION, RIG, SCENE, suggest
from studies.motion import scenes, series
from studies.study import Study
from sweeps import Axis, Grid, InputError, Sweep, Variable

SAMPLES, SEED = 1024, 0
# Values of an axis, and draws, that are checked before a run; others fail by themselves.
CHECKED, DRAWS_CHECKED = 10_000, 16
# Arguments of a study's function beside its parameters.
GIVEN = ("rig", "scenes", "chains", "distributions", "record", "times")


def sweep_of(
    study: Study,
    values: Mapping[str, Any] | None = None,
    *,
    rows: Mapping[str, Any] | None = None,
    record: Sequence[str] = (),
    sample_rate: float | None = None,
    samples: int = SAMPLES,
    seed: int = SEED,
    structure: Mapping[str, Any] | None = None,
) -> Sweep:
    """The sweep of a study over the requested points.

    Parameters
    ----------
    study : Study
    values : mapping
        By parameter one value, several, or a distribution with `ppf` and `text` (`studies.motion.uncertainty`).
    rows : mapping of str to array_like, (rows,), optional
        Parameters that vary together, a point in each row.
    record, sample_rate : sequence of str, float
        Series to keep, and their sampling rate, Hz.
    samples, seed : int
        Number of draws, and their seed (`sweeps.Sample`).
    structure : mapping, optional
        `fivcore.Structure.to_dict` of one in place of the rig, whose parameters are left out; theta is 0.

    Raises
    ------
    InputError
        For a parameter or a series that does not exist, or a value out of range.
    """
    for function in (study.function, *study.functions.values()):
        _check_arguments(study, function)
    study, contacts = _of_contacts(of_structure(study, structure), structure)
    points = points_of(study, values or {}, rows or {}, (samples, seed), structure)
    dims = {"followed": points.followed or "followed"}
    outputs = {n: replace(v, dims=tuple(dims.get(d, d) for d in v.dims)) for n, v in study.outputs.items()}
    coords = {**points.inner, **_coords(study, points), **contacts}
    for name in (each for each in record if each.startswith("contact_") and not contacts):
        raise InputError(f"record = {name!r}: it is of a structure with several contacts; leave it out")
    if len(record) or sample_rate is not None:
        kept, elapsed, settings = _recorded(study, tuple(record), sample_rate, points.fixed)
        outputs, coords = {**kept, **outputs}, {**coords, "elapsed": coords.get("elapsed", elapsed)}
        points = replace(points, fixed={**points.fixed, **settings})
    _check(study, points)
    return _declared(study, points, outputs, coords)


def _check_arguments(study: Study, function: Callable[..., Any]) -> None:
    """Refuse a function with an argument that no call can give."""
    known = {*study.parameters, *GIVEN}
    for name, argument in inspect.signature(function).parameters.items():
        if (
            name not in known
            and argument.default is argument.empty
            and argument.kind not in (argument.VAR_POSITIONAL, argument.VAR_KEYWORD)
        ):
            raise InputError(
                f"study {study.name}: its function takes {name!r}, which is no parameter; "
                f"{suggest(name, known)}declare it, or take one of {', '.join(GIVEN)}"
            )


def _declared(study: Study, points: Points, outputs: Mapping[str, Variable], coords: Mapping[str, Axis]) -> Sweep:
    fixed, axes, product = points.fixed, points.grid.axes, tuple(points.grid.axes) == points.grid.dims
    about = {
        name: (fixed[name], parameter.units, parameter.text)
        for name, parameter in study.parameters.items()
        if name in fixed and name not in points.inner
    }
    alone = {name: {name: outputs[name]} for name in study.functions}
    shared = {name: each for name, each in outputs.items() if name not in alone}
    return Sweep(
        study.name,
        _function(study, study.function, points, shared, coords),
        points.grid,
        outputs,
        fixed,
        coords={name: axis for name, axis in coords.items() if name not in axes},
        title=study.title,
        derive=partial(call.finish, study.derive, study.dims, about, study.moves and not _own(study, points)),
        # The modes of P1, of a rig and of an inclination are computed once for neighbours.
        order_by=tuple(n for n in axes if n not in ("V", "mu", "F", *FRICTION)) if product else (),
        request={"fixed": about},
        functions={
            name: _function(study, function, points, alone[name], coords)
            for name, function in study.functions.items()
        },
        **_copies(study, points),
    )


def _of_contacts(study: Study, structure: Mapping[str, Any] | None) -> tuple[Study, dict[str, Axis]]:
    """The study with what a structure with several contacts has besides, and their axis.

    With initial gaps the motion at another load is no copy.
    """
    own = None if structure is None else Structure.from_dict(structure)
    if own is None or not own.several:
        return study, {}
    outputs = dict(study.outputs) | dict(study.by_contact)
    gaps = study.normalised and bool(np.any(own.gap))
    if gaps:
        outputs = {name: replace(each, scale="") for name, each in outputs.items()}
    axis = {"contact": Axis(np.arange(own.contacts), "1", "contact, from 0")} if study.by_contact else {}
    return replace(study, normalised=study.normalised and not gaps, outputs=outputs), axis


def _function(
    study: Study,
    function: Callable[..., Any],
    points: Points,
    outputs: Mapping[str, Variable],
    coords: Mapping[str, Axis],
) -> Callable[..., Any]:
    """The function of a batch that calls one of the study, with the requested numbers of a structure."""
    parameters, times = study.parameters, coords["elapsed"].values if "elapsed" in coords else None
    varying = [n for n in points.grid.axes if n in parameters and n not in study.own]
    common = tuple(n for n in varying if parameters[n].common)
    shapes = {name: tuple(len(coords[dim]) for dim in each.dims) for name, each in outputs.items()}
    names = tuple(name for name in parameters if name not in study.own)
    called = call.Call(function, common, study.normalised, names, shapes, times, points.followed)
    inner, own = partial(call.compute, called), _own(study, points)
    return partial(compute, inner, own) if own else inner


def _own(study: Study, points: Points) -> tuple[str, ...]:
    """The requested numbers of a structure."""
    return tuple(name for name in study.own if name in points.fixed or name in points.grid.axes)


def _copies(study: Study, points: Points) -> dict[str, Any]:
    """How a sweep finds points that are copies of one, and their factors; nothing where there are none."""
    axes, steady = points.grid.axes, not study.moves
    # Along theta and mu alone no steady sliding is a copy.
    if not study.normalised or (steady and {"V", "F", *FRICTION}.isdisjoint(axes)):
        return {}
    numbers = {name: points.fixed[name] for name in (*SCENE, *FRICTION) if name in points.fixed}
    others = tuple(name for name in axes if name not in (*SCENE, *FRICTION, "sample", "row"))
    key = partial(scenes.key, fixed=numbers, others=others, steady=steady)
    return {"key": key, "scale": partial(scenes.factors, fixed=numbers)}


def _coords(study: Study, points: Points) -> dict[str, Axis]:
    """Axes of the outputs' own dimensions; of several rigs the longest, at the ends of each number that varies."""
    if not callable(study.coords):
        return dict(study.coords)
    signature, axes = inspect.signature(study.coords).parameters, points.grid.axes
    given, found, problems = dict[str, Any](), dict[str, Axis](), [""]
    for name in (name for name in signature if name != "rig"):
        if name not in points.fixed:
            raise InputError(f"{name}: it decides the size of the results of study {study.name}; give one value")
        given[name] = points.fixed[name]
    varied = [(name, axes[name].values) for name in RIG if name in axes] if "rig" in signature else []
    for numbers in [{}, *({name: end(values).item()} for name, values in varied for end in (np.min, np.max))]:
        try:
            rig = {"rig": scenes.rig_of({**points.fixed, **numbers})} if "rig" in signature else {}
            each = study.coords(**given, **rig)
        except ValueError as problem:
            problems.append(str(problem))
            continue
        found = {name: max(found.get(name, axis), axis, key=len) for name, axis in each.items()}
    if not found:
        raise InputError(problems[-1])
    return found


def _recorded(
    study: Study, names: tuple[str, ...], sample_rate: float | None, fixed: Mapping[str, Any]
) -> tuple[dict[str, Variable], Axis, dict[str, Any]]:
    """Variables of requested series, their times, and the constants that they need."""
    if "record" not in study.takes:
        raise InputError(f"record = {', '.join(names)}: study {study.name} records no series; study scenes does")
    if not names:
        raise InputError(f"sample_rate = {sample_rate!r}: it is for recorded series; give record")
    for name in (name for name in names if name not in series.SERIES):
        near = suggest(name, series.SERIES)
        raise InputError(f"record = {name!r}: no such series; {near}the series are {', '.join(series.SERIES)}")
    for name in ("duration", "sample_rate"):
        if name in study.parameters and name not in fixed:
            raise InputError(f"{name}: recorded series need one value of it")
    if sample_rate is not None and fixed.get("sample_rate", sample_rate) != sample_rate:
        text = f"it is set to {fixed['sample_rate']:g}; give one of the two"
        raise InputError(f"sample_rate = {sample_rate!r}: {text}")
    rate = fixed.get("sample_rate", series.SAMPLE_RATE if sample_rate is None else sample_rate)
    duration = fixed.get("duration") or series.DURATION
    try:
        times = series.even_times(duration, rate)
    except ValueError as problem:
        raise InputError(str(problem)) from None
    kept = {name: each for name, each in series.SERIES.items() if name in names}  # their order changes nothing
    if study.normalised:
        kept = {name: replace(each, scale=series.FACTORS.get(name, "")) for name, each in kept.items()}
    added = tuple(name for name in kept if name not in study.outputs)
    return kept, times, {"duration": duration, "sample_rate": float(rate), "record": added}


def _check(study: Study, points: Points) -> None:
    """Build the rig or the scene at the values of each dimension, the others at their first ones."""
    grid, fixed = points.grid, dict(points.fixed)
    if "structure" in fixed:
        fixed["structure"] = scenes.rig_of(fixed)
    problems: list[Exception] = []
    for row, (place, numbers) in enumerate(_rows(grid)):
        try:
            for each in call.steps({**fixed, **numbers}, points.followed):
                _build(study, each)
        except ValueError as problem:
            if grid.dims[0] != "sample":
                raise InputError(f"{place}{problem}") from None
            problems.append(problem)
            if len(problems) == row + 1 == min(DRAWS_CHECKED, grid.shape[0]):
                raise InputError(str(problem)) from None
    if study.check is not None:
        signature = inspect.signature(study.check).parameters
        values = {**fixed, **{name: axis.values for name, axis in {**grid.axes, **points.inner}.items()}}
        if "rig" in signature:
            numbers = {name: np.ravel(value)[0].item() for name, value in values.items() if name in RIG}
            values["rig"] = scenes.rig_of({"structure": values.get("structure"), **numbers})
        try:
            study.check(**call.named(signature, values))
        except ValueError as problem:
            raise InputError(str(problem)) from problem


def _rows(grid: Grid) -> Iterator[tuple[str, dict[str, Any]]]:
    """Parameters at each value of each dimension, the others at their first; rows of a table with their number."""
    first = {name: axis.values[0].item() for name, axis in grid.axes.items()}
    for group in grid.groups:
        for k in range(min(len(grid.axes[group[0]]), CHECKED)):
            place = f"points: row {k + 1}: " if group[0] == "row" else ""
            yield place, {**first, **{name: grid.axes[name].values[k].item() for name in group}}


def _build(study: Study, numbers: Mapping[str, Any]) -> None:
    if own := {name: numbers[name] for name in study.own if name in numbers}:
        numbers = {**numbers, "structure": varied(numbers["structure"], own)}
    if study.moves or study.normalised:
        scenes.scene_of(numbers)
    elif "rig" in study.takes:
        scenes.rig_of(numbers)
    for name, check in (("theta", checks.theta_degrees), ("mu", checks.friction)):
        if name in numbers and np.ndim(numbers[name]) == 0:
            check(numbers[name])
