"""Points drawn from distributions, in a grid's place: along `sample`, with the draws as coordinates."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps.errors import InputError
from sweeps.grid import Axis, Grid, check_names

METHODS = ("sobol", "latin", "random")
DIM = "sample"
# Significant digits of a draw: quantile functions differ by rounding from one processor or library to the next.
DIGITS = 12
MOST = 1 << 24


@dataclass(frozen=True, eq=False)
class Sample:
    """Independent draws, one from each distribution, along the dimension `sample`.

    Parameters
    ----------
    distributions : mapping of str to distribution
        Anything with a quantile function `ppf`, above all frozen distributions of `scipy.stats`.
    count : int
        How many; of "sobol" a power of 2 is the most evenly spread.
    method : str
        "sobol": scrambled Sobol points, of which a longer sample begins with the shorter, as it does with "random":
        independent numbers. "latin": a Latin hypercube, which does not grow.
    seed : int
    axes : mapping of str to Axis
        Axes besides: every draw is combined with each of their points.
    about : mapping of str to (str, str)
        Units and long name of each draw.
    """

    distributions: Mapping[str, Any]
    count: int
    method: str = "sobol"
    seed: int = 0
    axes: Mapping[str, Axis] = field(default_factory=dict)
    about: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.distributions:
            raise InputError("Sample: distributions = {}: there must be at least one")
        for name, each in self.distributions.items():
            if not callable(getattr(each, "ppf", None)):
                raise InputError(
                    f"Sample: {name} = {each!r}: it must be a distribution, like scipy.stats.norm(0, 1)"
                )
        if not (isinstance(self.count, int) and 1 <= self.count <= MOST):
            raise InputError(f"Sample: count = {self.count!r}: it must be a whole number from 1 to {MOST}")
        if self.method not in METHODS:
            raise InputError(f"Sample: method = {self.method!r}: it must be one of {', '.join(METHODS)}")
        if not (isinstance(self.seed, int) and self.seed >= 0):
            raise InputError(f"Sample: seed = {self.seed!r}: it must be a whole number, 0 or above")
        check_names("Sample: axes", self.axes, Axis)

    def draws(self) -> dict[str, NDArray[np.float64]]:
        """The draws, (count,) each."""
        shares = unit_draws(len(self.distributions), self.count, self.method, self.seed)
        return {
            name: quantiles(each, column)
            for (name, each), column in zip(self.distributions.items(), shares.T, strict=True)
        }

    def grid(self) -> Grid:
        """The grid of these points."""
        about = {name: self.about.get(name, ("1", "")) for name in self.distributions}
        axes = {DIM: Axis(np.arange(self.count), long_name="number of the draw")}
        axes |= {name: Axis(values, *about[name]) for name, values in self.draws().items()}
        return Grid(axes | dict(self.axes), zipped=tuple(axes))


def unit_draws(dimensions: int, count: int, method: str, seed: int) -> NDArray[np.float64]:
    """Points of the unit cube, (count, dimensions), none on its faces."""
    # Slow to import, and most sweeps draw nothing.
    from scipy.stats import qmc

    if method == "sobol":
        with warnings.catch_warnings():
            # A count that is no power of 2 is allowed.
            warnings.simplefilter("ignore", UserWarning)
            points = qmc.Sobol(dimensions, seed=seed).random(count)
    elif method == "latin":
        points = qmc.LatinHypercube(dimensions, seed=seed).random(count)
    else:
        points = np.random.default_rng(seed).random((count, dimensions))
    tiny = np.finfo(float).eps
    return np.asarray(np.clip(points, tiny, 1.0 - tiny))


def quantiles(distribution: Any, shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values of a distribution, to DIGITS."""
    values = np.asarray(distribution.ppf(shares), dtype=float)
    return np.array([float(f"{value:.{DIGITS}g}") for value in values])
