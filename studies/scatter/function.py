"""Function of a sweep at scattered points: the study's own, for each row of its scattered settings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Points = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Base:
    """Functions and names of a study that its scattered points need.

    Attributes
    ----------
    function, constants : callable
        The study's.
    axes, settings : tuple of str
        What the function gets as points, and what its constants are made of.
    scattered : tuple of str
        The settings that differ from point to point.
    """

    function: Callable[..., Mapping[str, Any]]
    constants: Callable[[Mapping[str, Any]], Mapping[str, Any]]
    axes: tuple[str, ...]
    settings: tuple[str, ...]
    scattered: tuple[str, ...]


def computed(base: Base, points: Points, **constants: Any) -> dict[str, Any]:
    """The results of a batch; points that agree in their scattered settings are computed together.

    `constants` are the other settings, and whatever else the function is to get.
    """
    settings = {name: value for name, value in constants.items() if name in base.settings}
    more = {name: value for name, value in constants.items() if name not in base.settings}
    places: list[int] = []
    results: list[Mapping[str, Any]] = []
    failures: dict[int, Exception] = {}
    for row, together in _groups(points, base.scattered):
        own = settings | row
        for some in _pieces(base, points, own, more, together, failures):
            places += some[0]
            results.append(some[1])
    if not results:
        raise next(iter(failures.values()))
    whole = _in_order(results, places, len(next(iter(points.values()))))
    for place, problem in failures.items():
        whole["error"][place] = problem
    return whole


def _groups(points: Points, names: Sequence[str]) -> Iterator[tuple[dict[str, Any], list[int]]]:
    """Each row of some columns with the places where it stands."""
    count = len(next(iter(points.values())))
    places: dict[tuple[Any, ...], list[int]] = {}
    columns = [points[name].tolist() for name in names]
    for place, row in enumerate(zip(*columns, strict=True) if columns else [()] * count):
        places.setdefault(row, []).append(place)
    for row, together in places.items():
        yield dict(zip(names, row, strict=True)), together


def _pieces(
    base: Base,
    points: Points,
    settings: Mapping[str, Any],
    more: Mapping[str, Any],
    together: list[int],
    failures: dict[int, Exception],
) -> Iterator[tuple[list[int], Mapping[str, Any]]]:
    """Results with their places; where a call fails, those of its halves, down to the points that fail."""
    try:
        chosen = {name: points[name][together] for name in base.axes}
        yield together, base.function(chosen, **{**base.constants(settings), **more})
    except Exception as problem:  # noqa: BLE001 - what a point raises is its outcome
        if len(together) == 1:
            failures[together[0]] = problem
            return
        middle = len(together) // 2
        for half in (together[:middle], together[middle:]):
            yield from _pieces(base, points, settings, more, half, failures)


def _in_order(results: Sequence[Mapping[str, Any]], places: list[int], count: int) -> dict[str, Any]:
    """Results of pieces of a batch as those of the batch; a point that failed has those of another."""
    source = np.zeros(count, dtype=np.intp)
    source[places] = np.arange(len(places))
    whole: dict[str, Any] = {
        name: np.concatenate([np.asarray(each[name]) for each in results])[source]
        for name in results[0]
        if name != "error"
    }
    errors: list[Any] = []
    for each in results:
        own = each.get("error")
        errors += [None] * _rows(each) if own is None else list(own)
    return whole | {"error": [errors[k] for k in source]}


def _rows(results: Mapping[str, Any]) -> int:
    return next(len(each) for name, each in results.items() if name != "error")


def of_axes(function: Callable[[Points], Any], axes: tuple[str, ...], points: Points) -> Any:
    """Call a study's function of points with its own axes only."""
    return function({name: points[name] for name in axes})


def keys(
    function: Callable[[Points], Any], axes: tuple[str, ...], scattered: tuple[str, ...], points: Points
) -> NDArray[Any]:
    """A study's key, and the scattered settings beside it: rigs of other numbers are other computations."""
    own = np.asarray(of_axes(function, axes, points))
    columns = [own] if own.ndim == 1 else list(own.T)
    return np.column_stack([*columns, *(points[name] for name in scattered)])
