"""Points drawn from distributions: a grid whose axes vary together along `sample`, one point for each draw."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps.errors import HINT_EITHER, InputError, StoreError
from sweeps.grid import Axis, Grid, check_counts

DIM = "sample"
# Significant digits of a draw: quantile functions differ by rounding from one processor or library to the next.
DIGITS = 12
MOST = 1 << 24
# Of a scrambled Sobol point; half of the last one keeps it off the faces of the cube.
BITS = 30
# Quantile levels that identify a distribution without a description.
LEVELS = (0.001, 0.1, 0.25, 0.5, 0.75, 0.9, 0.999)


def Sample(
    distributions: Mapping[str, Any],
    count: int,
    method: str = "sobol",
    seed: int = 0,
    *,
    axes: Mapping[str, Axis] | None = None,
    units: Mapping[str, tuple[str, str]] | None = None,
) -> Grid:
    """A grid of independent draws, one from each distribution, along the dimension `sample`.

    A sweep of more draws extends the file of fewer; the draws are coordinates in it.

    Parameters
    ----------
    distributions : mapping of str to distribution
        Anything with a quantile function `ppf`, like frozen distributions of `scipy.stats`. Their order counts.
    count, seed : int
        How many, most evenly spread if a power of 2.
    method : str
        "sobol", the only one: scrambled Sobol points, of which a longer sample begins with the shorter.
    axes : mapping of str to Axis, optional
        Axes besides: every draw is combined with each of their points.
    units : mapping of str to (str, str), optional
        Units and long name of each draw.
    """
    if not distributions:
        raise InputError("Sample: distributions = {}: there must be at least one")
    for name, each in distributions.items():
        if not callable(getattr(each, "ppf", None)):
            raise InputError(f"Sample: {name} = {each!r}: it must be a distribution, like scipy.stats.norm(0, 1)")
        if name == DIM:
            raise InputError(f"Sample: {DIM} is the number of the draw; call the distribution otherwise")
    for what, given, least, most in (("count", count, 1, MOST), ("seed", seed, 0, math.inf)):
        whole = isinstance(given, (int, np.integer)) and not isinstance(given, bool)
        if not (whole and least <= given <= most):
            raise InputError(f"Sample: {what} = {given!r}: it must be a whole number from {least} to {most}")
    check_counts({DIM: count} | {name: len(axis) for name, axis in (axes or {}).items()})
    probabilities = unit_draws(len(distributions), count, method, seed)
    draws: dict[str, Axis] = {}
    for (name, each), column in zip(distributions.items(), probabilities.T, strict=True):
        values = quantiles(each, column)
        if not np.all(np.isfinite(values)):
            raise InputError(f"Sample: {name} = {distribution_text(each)}: it gives a draw that is not finite")
        draws[name] = Axis(values, *(units or {}).get(name, ("1", "")))
    sampling = {
        "method": f"{method}, seed {seed}",
        **{k: distribution_text(each) for k, each in distributions.items()},
    }
    number = Axis(np.arange(count), long_name="number of the draw")
    return Grid({DIM: number, **draws, **(axes or {})}, zipped=(DIM, *draws), sampling=sampling)


def unit_draws(dimensions: int, count: int, method: str, seed: int) -> NDArray[np.float64]:
    """Scrambled Sobol points of the unit cube, (count, dimensions), none on its faces."""
    from scipy.stats import qmc  # slow to import, and most sweeps draw nothing

    if method != "sobol":
        raise InputError(f"Sample: method = {method!r}: it must be 'sobol'")
    points = qmc.Sobol(dimensions, seed=seed, bits=BITS).random_base2((int(count) - 1).bit_length())[:count]
    return np.asarray(points + 0.5**BITS / 2.0)


def quantiles(distribution: Any, probabilities: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values of a distribution, to DIGITS."""
    values = np.asarray(distribution.ppf(probabilities), dtype=float)
    return np.array([float(f"{value:.{DIGITS}g}") for value in values])


def distribution_text(distribution: Any) -> str:
    """Text that identifies a distribution: its own `described`, SciPy's name and arguments, or quantiles."""
    named: Any = getattr(distribution, "dist", None)
    if isinstance(own := getattr(distribution, "described", None), str):
        return own
    if hasattr(named, "name") and hasattr(distribution, "args") and hasattr(distribution, "kwds"):
        keywords = [f"{key}={np.asarray(each).tolist()!r}" for key, each in sorted(distribution.kwds.items())]
        places = [repr(np.asarray(each).tolist()) for each in distribution.args]
        return f"{named.name}({', '.join([*places, *keywords])})"
    return f"quantiles {quantiles(distribution, np.array(LEVELS)).tolist()}"


def check_same_draws(file: Path, present: Grid, requested: Grid) -> None:
    """Refuse to add draws to a file with other draws of the same numbers; grids without draws pass."""
    number, *names = requested.groups[0] if requested.sampling else [""]
    for name in names:
        count = min(len(present.axes[name]), len(requested.axes[name]))
        there, here = present.axes[name].values[:count], requested.axes[name].values[:count]
        for k in np.flatnonzero(there != here)[:1]:
            differ = f"{name} = {there[k]} there, {here[k]} here, at {number} = {requested.axes[number].values[k]}"
            raise StoreError(f"{file} has other points: {differ}; {HINT_EITHER}")
