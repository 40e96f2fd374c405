"""Rounds of a fit: sweeps over draws, each of which adds draws to the file of the previous rounds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtr

from fivcore import SceneError
from studies.answering.results import FITS
from studies.asking.sweep import sweep_of
from studies.declaring.own import varied
from studies.fitting import sampling
from studies.fitting.problem import Model, Problem, Source
from sweeps import Axis, Grid, InputError, Sweep, Variable

if TYPE_CHECKING:
    import xarray as xr

    from fivcore import Structure
    from sweeps import Plan, Progress

    Watch = Callable[[Plan], AbstractContextManager[Progress | None]]

# What a file says of a target.
STATED = ("name", "value", "within", "codes")
# Digits of a draw, which are the same on every processor.
DIGITS = 9


def run(problem: Problem, file: Path, how: tuple[Any, Any], watch: Watch, *, fresh: bool = False) -> xr.Dataset:
    """Run each round on the back end `how` within `watch(plan)`, which shows progress; return the whole result.

    Rounds in the file are kept. An `InputError` if all draws of the first round fail.
    """
    start, likelihoods = first(problem), np.zeros(0)
    for number in range(problem.rounds):
        z = sampling.replay(start, likelihoods, problem.samples, problem.seed)[1]
        planned = sweep_of_draws(problem, start, z).plan(file, fresh=fresh and not number)
        with watch(planned) as progress:
            dataset = planned.run(*how, progress)
        likelihoods = log_likelihood(problem, dataset)
        if not np.isfinite(likelihoods).any():
            file.unlink(missing_ok=True)
            never = [t.name for t in problem.model.targets if not np.isfinite(_misfit(t, dataset)).any()]
            why = f"no draw gives a value of {', '.join(never)}, or fulfils it"
            why = why if never else "no draw gives values of all targets"
            raise InputError(f"no draw of {len(z)} survives: {why}; change the priors")
    return dataset


def first(problem: Problem) -> sampling.Proposal:
    """The first proposal: around a least-squares solution of the smooth targets, else the prior."""
    smooth = [t for t in problem.model.targets if not (t.codes or problem.model.sources[t.source].study.chaotic)]
    d = len(problem.priors)
    if smooth:
        part = replace(problem.model, targets=smooth)

        def misfits(z: Any) -> Any:
            try:
                found = predict(numbers(problem, z), model=part)
            except (ValueError, ArithmeticError, SceneError):
                if len(z) > 1:
                    return np.concatenate([misfits(each[None]) for each in z])
                return np.full((1, len(smooth)), np.nan)
            return np.stack([(found[t.name] - t.value) / t.within for t in smooth], axis=1)

        if (found := sampling.best(misfits, d)) is not None:
            return sampling.around(*found)
    return (sampling.prior(d),)


def numbers(problem: Problem, z: Any) -> dict[str, Any]:
    """Unknowns at points of the standard normal prior, (n, d)."""
    columns = [prior.ppf(ndtr(column)) for prior, column in zip(problem.priors.values(), z.T, strict=True)]
    digits = [np.array([float(f"{value:.{DIGITS}g}") for value in column]) for column in columns]
    return dict(zip(problem.priors, digits, strict=True))


def sweep_of_draws(problem: Problem, start: sampling.Proposal, z: Any) -> Sweep:
    """The sweep over the draws of all rounds so far, (n, d)."""
    draws = {"draw": Axis(np.arange(len(z)), long_name="number of the draw")}
    draws |= {name: Axis(column, *problem.axes[name]) for name, column in numbers(problem, z).items()}
    draws["round"] = Axis(1 + np.arange(len(z)) // problem.samples, long_name="round")
    priors = {name: prior.described for name, prior in problem.priors.items()}
    variables = {t.name: Variable(t.units, t.text) for t in problem.model.targets}
    estimated = [t for t in problem.model.targets if t.has_error]
    variables |= {f"{t.name}_se": Variable(t.units, f"standard error: {t.text}") for t in estimated}
    stated: dict[str, Any] = {
        "unknown": {name: prior.text for name, prior in problem.priors.items()},
        "targets": [{k: getattr(t, k) for k in STATED} for t in problem.model.targets],
        "studies": [[each.study.name, each.values] for each in problem.model.sources],
        "samples": problem.samples, "seed": problem.seed,
    }  # fmt: skip
    return Sweep(
        f"{FITS}_{problem.name}",
        partial(predict, model=problem.model),
        Grid(draws, zipped=tuple(draws), sampling={"method": f"rounds, seed {problem.seed}", **priors}),
        variables,
        stated,
        title=f"Fit: {problem.name}",
        derive=partial(weighted, problem, start),
    )


def predict(points: Mapping[str, Any], *, model: Model, **stated: Any) -> dict[str, Any]:
    """The prediction of each target at each draw, its standard error if a study gives one, and errors."""
    of_studies = {name for source in model.sources for name in source.unknowns.values()}
    own = points.keys() - of_studies - {"draw", "round"}
    count, structure = len(next(iter(points.values()))), model.structure
    if own and count > 1:
        # Each draw has its own structure.
        each = [predict({k: v[[n]] for k, v in points.items()}, model=model) for n in range(count)]
        return {name: np.concatenate([row[name] for row in each]) for name in each[0]}
    if structure is not None:
        structure = varied(structure, {name: points[name].item() for name in own})
    data = [_outputs(source, points, structure) for source in model.sources]
    errors = [np.concatenate([np.ravel(each["error"][k]) for each in data]) for k in range(count)]
    found: dict[str, Any] = {"error": [next((RuntimeError(text) for text in row if text), None) for row in errors]}
    for target in model.targets:
        for end in ("", "_se")[: 1 + target.has_error]:
            array = data[target.source][f"{target.output}{end}"].sel(target.chosen)
            if target.codes:
                array = array.isin(target.codes).mean([dim for dim in array.dims if dim == "member"])
            found[f"{target.name}{end}"] = array.values.reshape(count, -1)[:, target.entry]
    return found


def _outputs(source: Source, points: Mapping[str, Any], structure: Structure | None) -> xr.Dataset:
    """The outputs of a source at draws, along the first dimension, `row`."""
    rows = {parameter: points[name] for parameter, name in source.unknowns.items()}
    own = None if structure is None else structure.to_dict()
    try:
        sweep = sweep_of(source.study, source.values, rows=rows, structure=own)
    except InputError as problem:
        raise InputError(str(problem).removeprefix("points: row 1: ")) from None
    found = sweep.plan().run("sync")
    return found if rows else found.expand_dims("row")


def _misfit(target: Any, data: xr.Dataset) -> Any:
    """The logarithm of a target's likelihood at each draw; -inf without a value."""
    values = data[target.name].values
    with np.errstate(divide="ignore"):
        if target.codes:
            return np.log(np.nan_to_num(values))
        error = data[f"{target.name}_se"].values if target.has_error else 0.0
        spread = np.hypot(target.within, np.nan_to_num(error))
        return np.nan_to_num(-0.5 * ((values - target.value) / spread) ** 2, nan=-np.inf) - np.log(spread)


def log_likelihood(problem: Problem, dataset: xr.Dataset) -> Any:
    """The logarithm of the likelihood of each draw, up to a constant; -inf where a target has no value."""
    return np.sum([_misfit(target, dataset) for target in problem.model.targets], axis=0)


def weighted(problem: Problem, start: sampling.Proposal, dataset: xr.Dataset) -> xr.Dataset:
    """The dataset with the weight of each draw in the posterior; their sum is 1."""
    weights, _ = sampling.replay(start, log_likelihood(problem, dataset), problem.samples, problem.seed)
    about = {"long_name": "weight of the draw in the posterior", "units": "1"}
    return dataset.assign(weight=("draw", weights, about))
