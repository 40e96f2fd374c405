"""The call of a study's function for a batch of points, and additions to the finished dataset."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fivcore import SceneError
from studies.answering.results import is_usual, settled, structure_in
from studies.declaring.parameters import FRICTION, RIG, SCENE
from studies.motion import scenes
from studies.motion.above import with_growth_above
from sweeps import InputError

if TYPE_CHECKING:
    import xarray as xr


def named(signature: Mapping[str, inspect.Parameter], values: Mapping[str, Any]) -> dict[str, Any]:
    """The values that a signature names; all of them for ``**others``."""
    takes_rest = any(parameter.kind is inspect.Parameter.VAR_KEYWORD for parameter in signature.values())
    return {name: value for name, value in values.items() if takes_rest or name in signature}


def steps(numbers: Mapping[str, Any], followed: str) -> list[dict[str, Any]]:
    """The numbers at each value of the followed parameter."""
    return [{**numbers, followed: value} for value in numbers[followed]] if followed else [{**numbers}]


@dataclass(frozen=True, eq=False)
class Call:
    """The call of a study's function for a batch of points."""

    function: Callable[..., Mapping[str, Any]]
    common: tuple[str, ...]  # parameters that vary and that all points of one call share
    normalised: bool
    parameters: tuple[str, ...]
    shapes: Mapping[str, tuple[int, ...]]  # of each output at a point
    times: NDArray[Any] | None  # of recorded series, s
    followed: str = ""

    def arguments(self, numbers: Mapping[str, Any], count: int) -> dict[str, Any]:
        """Arguments of the function for `count` points."""
        signature = inspect.signature(self.function).parameters
        moves = not signature.keys().isdisjoint({"scenes", "chains"})
        if self.normalised:
            scaled = scenes.normalised(numbers, count, steady=not moves)
            numbers = {**numbers, **{name: column for name, column in scaled.items() if name in numbers}}
        own: dict[str, Any] = {"record": (), "distributions": {}, **numbers, "times": self.times}
        if "rig" in signature:
            own["rig"] = scenes.rig_of(numbers)
        if moves:
            chains = [scenes.scenes_of(each, count) for each in steps(numbers, self.followed)]
            own |= {"scenes": chains[0], "chains": [*zip(*chains, strict=True)]}
        # What a rig and scenes consist of goes to those who name it.
        parts = {*RIG, *(SCENE | FRICTION if moves else ())}
        rest = {name: value for name, value in numbers.items() if name in self.parameters and name not in parts}
        return {name: value for name, value in own.items() if name in signature} | named(signature, rest)


def compute(call: Call, points: Mapping[str, Any], **fixed: Any) -> dict[str, Any]:
    """Call a study's function for each group of points that share the common parameters, and join the results."""
    count = len(next(iter(points.values())))
    groups = _groups({name: points[name] for name in call.common}, count)
    joined: dict[str, Any] = {"error": np.full(count, None)}
    done = False
    for common, chosen in groups:
        own = {name: values[chosen] for name, values in points.items()}
        try:
            found = _computed(call, {**fixed, **own, **common}, own)
        except BatchError as problem:
            # Every point fails: the engine would hide the mistake, since batches of a single point succeed.
            found = {"error": [problem] * len(next(iter(own.values())))}
        except (ValueError, ArithmeticError, SceneError) as problem:
            joined["error"][chosen] = _without_scene(problem) if call.normalised else problem
            continue
        if len(groups) == 1:
            return found
        done = True
        for name, value in found.items():
            part = np.asarray(value)
            joined.setdefault(name, np.zeros((count, *part.shape[1:]), part.dtype))[chosen] = part
    if not done:
        raise joined["error"][0] from None
    return joined | {"error": joined["error"].tolist()}


def _computed(call: Call, numbers: Mapping[str, Any], points: Mapping[str, Any]) -> dict[str, Any]:
    """Call the function for points with the same common parameters; outputs in the declared shapes."""
    count = len(next(iter(points.values())))
    given = call.arguments(numbers, count)
    found = dict(call.function(**given))
    if call.normalised and "error" in found:
        found["error"] = [_without_scene(each) for each in found["error"]]
    # Without an argument that varies all points have one result, as those of a table that repeat.
    repeats = given.keys().isdisjoint({"scenes", "chains", *(points.keys() - {*call.common})})
    return {name: _padded(name, v, count, call.shapes.get(name), repeats) for name, v in found.items()}


def _without_scene(problem: Any) -> Any:
    """The error of a scaled scene without that scene, whose numbers are not those of the point."""
    text = str(problem).rpartition("; scene V = ")[0]
    return type(problem)(text, problem.scene) if isinstance(problem, SceneError) and text else problem


def _groups(common: Mapping[str, NDArray[Any]], count: int) -> Sequence[tuple[dict[str, Any], Any]]:
    """Values of the common parameters of each group of points, in order of appearance, and its points."""
    if not common:
        return [({}, slice(None))]
    places: dict[tuple[Any, ...], list[int]] = {}
    for k, row in enumerate(zip(*(values.tolist() for values in common.values()), strict=True)):
        places.setdefault(row, []).append(k)
    return [(dict(zip(common, row, strict=True)), np.array(chosen)) for row, chosen in places.items()]


class BatchError(ValueError):
    """A study's function returned one value for several points."""


def _padded(name: str, value: Any, count: int, shape: tuple[int, ...] | None, repeats: bool) -> Any:
    """An output of the declared shape, filled with NaN where the function returned fewer entries."""
    if shape is None:
        return value
    values = np.asarray(value)
    if not values.ndim:
        return values.reshape(1) if count == 1 else values  # the engine then asks for one point at a time
    if len(values) == 1 < count:
        if not repeats:
            raise BatchError(f"1 value for {count} points; return an array with one entry for each point")
        values = np.repeat(values, count, axis=0)
    missing = [(0, 0), *((0, full - size) for full, size in zip(shape, values.shape[1:], strict=True))]
    if not any(more for _, more in missing):
        return values
    if min(more for _, more in missing) < 0:
        raise InputError(f"{name}: {values.shape[1:]} values at a point, for which the file has room for {shape}")
    return np.pad(values.astype(float), missing, constant_values=np.nan)


def finish(derive: Any, dims: Any, about: Mapping[str, Any], moves: bool, dataset: xr.Dataset) -> xr.Dataset:
    """Add fixed parameters as scalar coordinates, and what the study derives on its own dimensions.

    A study of moving scenes also gets the unstable modes above the band.
    """
    dataset = settled(dataset, about)
    dataset = with_growth_above(dataset, structure_in(dataset) or None) if moves else dataset
    return derive(dataset) if derive is not None and is_usual(dataset, dims) else dataset
