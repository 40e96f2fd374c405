"""The points of a request: parameters that vary, ranges that the function takes whole, and fixed ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import Rig, SceneError, Structure, checks, flutter_onsets, painleve_mu
from studies import paper
from studies.declaring.parameters import RIG, SCENE, Parameter
from studies.study import FOLLOW, Study
from sweeps import Axis, Grid, InputError, Sample, check_size

# Largest friction at which the first onset of a structure is sought.
MOST_FRICTION = 10.0


@dataclass(frozen=True, eq=False)
class Points:
    """The points at which a study is computed.

    `inner` has the ranges that are dimensions of the outputs, `fixed` the constants, `followed` is the parameter
    that chains of scenes follow, "" without chains.
    """

    grid: Grid
    inner: Mapping[str, Axis]
    fixed: Mapping[str, Any]
    followed: str


def points_of(
    study: Study, values: Mapping[str, Any], rows: Mapping[str, Any], draws: tuple[int, int], structure: Any
) -> Points:
    """The points of a request (see `asking.sweep.sweep_of`); `draws` are their number and seed."""
    requested = {name: study.parameter(name).read(name, value) for name, value in values.items()}
    columns = {name: _column(study, name, column) for name, column in rows.items()}
    for name in columns:
        if name in requested:
            raise InputError(f"{name}: it is a column of the points already; give one of the two")
    parameters, fixed = study.parameters, dict[str, Any]()
    if structure is not None:
        own = Structure.from_dict(structure)
        parameters = _without_beams(study, {**requested, **columns}, own)
        fixed["structure"] = {"name": repr(own), **own.to_dict()}
    # In the study's order, so that the order of a request changes nothing.
    chosen = {name: requested.get(name, p.default) for name, p in parameters.items() if name not in columns}
    drawn = {name: value for name, value in requested.items() if hasattr(value, "ppf")}
    if study.scatter is not None and not drawn:
        drawn = dict(study.scatter({name: value for name, value in chosen.items() if not np.ndim(value)}))
    if drawn and "distributions" in study.takes:
        fixed["distributions"] = {name: draw.text for name, draw in drawn.items()}
        # The nominal rig is in the middle of the uncertain ones.
        chosen |= {name: float(f"{draw.ppf(0.5):.6g}") for name, draw in drawn.items()}
        drawn = {}
    followed = ""
    if "chains" in study.takes:
        followed, beside = _followed(study, chosen, requested)
        chosen |= beside
    names = [followed] if followed else [name for name in chosen if study.parameters[name].inner]
    inner = {name: study.parameters[name].axis(chosen[name]) for name in names}
    single = {name: value for name, value in chosen.items() if name not in inner and name not in drawn}
    axes = {name: study.parameters[name].axis(value) for name, value in single.items() if np.ndim(value)}
    fixed |= {name: value for name, value in single.items() if name not in axes}
    fixed |= {name: axis.values.tolist() for name, axis in inner.items()}
    if not (axes or drawn or columns):
        first = next(name for name in fixed if name in study.parameters)
        axes = {first: study.parameters[first].axis(fixed.pop(first))}
    return Points(_grid(study.parameters, axes, drawn, columns, draws), inner, fixed, followed)


def _column(study: Study, name: str, values: Any) -> NDArray[Any]:
    """The values of a column, in their order."""
    parameter = study.parameter(name)
    if parameter.inner:
        raise InputError(f"points: {name}: study {study.name} takes its values together; give a range of it")
    return np.array([np.ravel(parameter.read(name, value))[0] for value in np.asarray(values).tolist()])


def _grid(parameters: Mapping[str, Parameter], axes: Any, drawn: Any, columns: Any, draws: Any) -> Grid:
    """The product of axes, draws, or rows of a table, with as many points as a plan may have."""
    if drawn and columns:
        raise InputError("points: distributions and a table both say where the points are; leave one out")
    if drawn:
        units = {name: (parameters[name].units, parameters[name].text) for name in drawn}
        grid: Grid = Sample(drawn, draws[0], seed=draws[1], units=units, axes=axes)
    elif columns:
        number = Axis(np.arange(1, len(next(iter(columns.values()))) + 1), long_name="row of the table")
        table = {"row": number} | {name: parameters[name].axis(values) for name, values in columns.items()}
        grid = Grid({**table, **axes}, zipped=tuple(table), sampling={"method": "a table"})
    else:
        grid = Grid(axes)
    check_size(grid)
    return grid


def _followed(study: Study, chosen: Mapping[str, Any], requested: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """The parameter that chains of scenes follow, and one value of each that is a range only if followed."""
    name, values = chosen[FOLLOW], dict[str, Any]()
    if np.ndim(name):
        raise InputError(f"{FOLLOW} = {', '.join(name)}: give one; run the study once for each")
    if len(np.ravel(chosen.get(name, 0.0))) < 2:
        raise InputError(f"{name}: it is followed; give several values of it, as {name}=START:STOP:COUNT")
    for other in (n for n, parameter in study.parameters.items() if parameter.inner and n != name):
        value = np.ravel(requested.get(other, SCENE[other].default))
        if len(value) > 1:
            raise InputError(f"{other}: {name} is followed; give one value of {other}, or {FOLLOW}={other}")
        values[other] = value[0].item()
    return str(name), values


def _without_beams(study: Study, requested: Mapping[str, Any], own: Structure) -> dict[str, Parameter]:
    """The parameters for a user's structure: theta is 0, and the numbers of the rig are left out.

    A default range of mu is scaled with the first onset of the structure relative to that of the paper's rig.
    """
    if not study.takes_structure:
        raise InputError(
            f"rig: study {study.name} is about the paper's beams and takes no structure; fiv list marks the "
            "studies that do"
        )
    for name, value in requested.items():
        plain = value.item() if isinstance(value, np.ndarray) and value.size == 1 else value
        text = f"{name} = {getattr(value, 'text', None) or checks.short(plain)}"
        if name in RIG and name not in study.own:
            raise InputError(f"{text}: a structure has no such number; leave it out, or change its file")
        if name == "theta" and (hasattr(value, "ppf") or np.any(value)):
            raise InputError(f"{text}: the inclination of a structure is part of its modes; leave it out")
    without = {*RIG, *study.own}.difference(requested)
    left = {name: parameter for name, parameter in study.parameters.items() if name not in without}
    if theta := left.get("theta"):
        left["theta"] = replace(theta, default=np.zeros(1) if theta.is_axis else 0.0)
    mu = left.get("mu")
    if mu and np.ndim(mu.default) and "mu" not in requested:
        left["mu"] = replace(mu, default=mu.default * _scale_of_friction(own, float(np.max(mu.default))))
    if cutoff := left.get("cutoff"):
        left["cutoff"] = replace(cutoff, default=None)  # another default is for the paper's beams
    return left


def _scale_of_friction(own: Structure, most: float) -> float:
    """The first onset of a structure, flutter or divergence, over that of the paper's rig; 1 without one.

    Multiplied by `most` it stays below the friction at which the contact force is no longer unique.
    """
    papers, limit = flutter_onsets(Rig(), paper.THETA).mu[0], np.inf
    try:
        # With initial gaps the load decides which contacts are closed.
        found = flutter_onsets(own, 0.0, mu_max=MOST_FRICTION, F=paper.LOAD)
        limit = painleve_mu(own, 0.0)
    except (ArithmeticError, SceneError):
        return 1.0
    first = min([*found.mu, *found.entry_mu, np.nan_to_num(found.divergence_mu, nan=np.inf)])
    ratio = min(first / papers if np.isfinite(first) else 1.0, 0.9 * limit / most)
    return float(f"{ratio:.3g}")
