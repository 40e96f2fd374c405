"""The scene of a point of a result and the options of its run, ready for `fivcore.simulate`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from fivcore import Scene, Until
from studies.maps.quantities import AXES
from studies.motion import ensembles, normalised, recording, transients
from studies.query.columns import Columns, hint
from studies.query.nearest import nearest
from studies.rig import rig_of
from studies.study import constants
from sweeps import InputError

if TYPE_CHECKING:
    import xarray as xr

# Whose points are more than a scene: methods and their settings, and cases that are refused.
OTHERWISE = ("accuracy", "stress")
# Studies that record the motion that their figures are taken from, at so many times the rate that they keep.
RECORDED = ("fig7", "fig11")


def scene(dataset: xr.Dataset, **point: float) -> Scene:
    """The scene behind a point.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of a study or a map, or a part of one.
    **point
        Values of the axes, in the file's units; each finds the nearest that the axis has (`query.nearest`). An
        axis with one value need not be named, nor one that makes no difference to the scene (mode, member).

    Returns
    -------
    fivcore.Scene
        What neither the axes nor the file's configuration say, because the result does not depend on it, is the
        paper's: V and F of a study of stability.

    Raises
    ------
    ValueError
        Naming the axis; or if the points of the study are no scenes.
    """
    every = Columns(dataset)
    name = str(dataset.attrs.get("sweep"))
    if name in OTHERWISE or not {"rig", *AXES} & {*every.configuration["constants"], *every.axes}:
        raise InputError(f"scene: the points of study {name} are not scenes")
    numbers = {each: setting.value for each, setting in AXES.items()}
    numbers |= {each: float(value) for each, value in every.settings.items() if each in AXES}
    numbers |= {each: float(value) for each, value in _values(every, point).items() if each in AXES}
    rig, theta = rig_of(numbers)
    return Scene(V=numbers["V"], theta=theta, mu=numbers["mu"], F=numbers["F"], rig=rig)


def run_options(dataset: xr.Dataset, **point: float) -> dict[str, Any]:
    """How the scene of a point was run: `simulate(scene(dataset, **point), **run_options(dataset, **point))`.

    Parameters
    ----------
    dataset : xarray.Dataset
    **point
        As for `scene`. Where a point is an ensemble of runs, `member` says which of them, from 1 on; by default 1.

    Returns
    -------
    dict
        Keyword arguments of `fivcore.simulate`, `duration` among them.

    Raises
    ------
    ValueError
        Naming what is wrong; or if the study has no motion in time.
    """
    own = scene(dataset, **{name: value for name, value in point.items() if name != "member"})
    fixed = constants(dataset)
    if "method" not in fixed:
        raise InputError(f"run_options: study {dataset.attrs.get('sweep')} has no motion in time")
    ramp = fixed["ramp"]
    if "duration" in fixed:
        if "member" in point:
            raise InputError(f"member = {point['member']}: each point of this study is one run")
        duration, member = fixed["duration"] or ensembles.until(fixed), 1.0
    else:
        member = _member(Columns(dataset), fixed, point)
        duration = _own_duration(dataset, own, fixed, member)
    options: dict[str, Any] = {
        "duration": duration,
        "method": fixed["method"],
        "ramp": ensembles.ramp_of(member, ramp),
        "cutoff": fixed["cutoff"] or None,
        "leap": bool(fixed.get("leap", True)),
    }
    options |= {name: fixed[name] for name in ("settle", "numerical_damping") if fixed.get(name) is not None}
    if dataset.attrs["sweep"] in RECORDED:
        options |= {"record": True, "sample_rate": transients.OVERSAMPLING * fixed["sample_rate"]}
    elif "record" in fixed:
        times = transients.even_times(fixed["duration"], fixed["sample_rate"]).values
        options |= recording.options(fixed["record"], times)
    return options


def _values(every: Columns, point: Mapping[str, float]) -> dict[str, Any]:
    """The value of each axis at a point, where it has one."""
    for name, value in point.items():
        if name not in every.axes:
            raise InputError(f"{name} = {value}: there is no such axis; {hint(name, every.axes)}")
    chosen = {n: _nearest(n, np.atleast_1d(every.dataset[n].values), value) for n, value in point.items()}
    # What varies together with an axis follows from that.
    along = {name: value for name, value in chosen.items() if every.dataset[name].dims == (name,)}
    left = every.dataset[list(every.axes)].sel(along)
    for name in [name for name in every.axes if name not in chosen]:
        values = np.atleast_1d(left[name].values)
        if len(values) == 1:
            chosen[name] = values[0]
        elif name in AXES:
            raise InputError(f"{name}: give one of its {len(values)} values, from {values[0]} to {values[-1]}")
    return chosen


def _nearest(name: str, values: Any, number: Any) -> Any:
    if np.ndim(number) or not {np.asarray(number).dtype.kind, values.dtype.kind} <= set("iuf"):
        raise InputError(f"{name} = {number!r}: it must be one number")
    value, near = nearest(values, float(number))
    if not near:
        raise InputError(f"{name} = {number}: the axis has no such value; the nearest is {value}")
    return value


def _member(every: Columns, fixed: Mapping[str, Any], point: Mapping[str, float]) -> float:
    """The number of a run within its ensemble."""
    if "member" in every.axes:
        values = np.atleast_1d(every.dataset["member"].values)
        return float(_nearest("member", values, point.get("member", values[0])))
    member, most = point.get("member", 1), fixed["members"]
    if member not in range(1, int(most) + 1):
        raise InputError(f"member = {member}: it must be a whole number from 1 to {most}")
    return float(member)


def _own_duration(dataset: xr.Dataset, own: Scene, fixed: Mapping[str, Any], member: float) -> float | Until:
    """How long a repeat run lasted, s, or what ended it: as its study decided for the normalised scene."""
    if dataset.attrs["sweep"] != "stick_time":
        return ensembles.own_duration(own, fixed["ramp"], fixed)
    (scene,) = normalised.scenes({name: np.array([getattr(own, name)]) for name in transients.SCENE}, own.rig)
    return ensembles.own_duration(scene, ensembles.ramp_of(member, fixed["ramp"]), fixed)
