"""How a number scatters, as one writes it, `normal:0.2:0.02`, and cut to what is physical."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from studies.spec import finite
from sweeps import InputError

FORMS = "normal:MEAN:SD | uniform:LOW:HIGH | lognormal:MEDIAN:SIGMA | triangular:LOW:MODE:HIGH"
# What a number of a rig or a scene can be at all; whatever is not named here is positive.
PHYSICAL = {
    "theta": (-90.0, 90.0),
    "mu": (0.0, math.inf),
    "head_mass": (0.0, math.inf),
    "d1": (0.0, math.inf),
    "d2": (0.0, math.inf),
    "point_b": (0.0, 1.0),
    "V": (-math.inf, math.inf),
}
POSITIVE = (0.0, math.inf)
# A distribution of which less is left is not meant so.
LEAST_LEFT = 0.01


@dataclass(frozen=True, eq=False)
class Scatter:
    """A distribution, cut to an interval outside which its number cannot be.

    Attributes
    ----------
    text : str
        As one writes it.
    whole : distribution
        Frozen, of `scipy.stats`.
    low, high : float
        The interval.
    """

    text: str
    whole: Any
    low: float
    high: float

    @property
    def cut(self) -> float:
        """The share of the distribution that was cut away."""
        return float(self.whole.cdf(self.low) + self.whole.sf(self.high))

    def ppf(self, share: Any) -> NDArray[np.float64]:
        """Quantiles of what is left."""
        begin, end = self.whole.cdf(self.low), self.whole.cdf(self.high)
        return np.asarray(np.clip(self.whole.ppf(begin + np.asarray(share) * (end - begin)), self.low, self.high))

    def cdf(self, value: Any) -> NDArray[np.float64]:
        """Its distribution function."""
        begin, end = self.whole.cdf(self.low), self.whole.cdf(self.high)
        return np.asarray(np.clip((self.whole.cdf(value) - begin) / (end - begin), 0.0, 1.0))


def _normal(mean: float, deviation: float) -> Any:
    _positive("SD", deviation)
    return stats.norm(mean, deviation)


def _uniform(low: float, high: float) -> Any:
    _ascending(("LOW", low), ("HIGH", high))
    return stats.uniform(low, high - low)


def _lognormal(median: float, sigma: float) -> Any:
    _positive("MEDIAN", median)
    _positive("SIGMA", sigma)
    return stats.lognorm(sigma, scale=median)


def _triangular(low: float, mode: float, high: float) -> Any:
    _ascending(("LOW", low), ("HIGH", high))
    if not low <= mode <= high:
        raise ValueError(f"MODE must be from LOW = {low:g} to HIGH = {high:g}, not {mode:g}")
    return stats.triang((mode - low) / (high - low), low, high - low)


# Each kind with how many numbers it takes.
KINDS: Mapping[str, tuple[int, Callable[..., Any]]] = {
    "normal": (2, _normal),
    "uniform": (2, _uniform),
    "lognormal": (2, _lognormal),
    "triangular": (3, _triangular),
}


def parse(text: str, name: str) -> Scatter:
    """The distribution that a text stands for, of the number called `name`; an `InputError` names both."""
    try:
        kind, *parts = text.strip().split(":")
        if kind not in KINDS:
            raise ValueError(f"{kind!r} is none of {', '.join(KINDS)}")
        count, make = KINDS[kind]
        if len(parts) != count:
            raise ValueError(f"{kind} takes {count} numbers, not {len(parts)}")
        low, high = PHYSICAL.get(name, POSITIVE)
        scatter = Scatter(text.strip(), make(*map(finite, parts)), low, high)
        if not 1.0 - scatter.cut >= LEAST_LEFT:
            raise ValueError(
                f"{100.0 * scatter.cut:.3g} % of it is beyond what {name} can be, {low:g} to {high:g}"
            )
    except ValueError as problem:
        raise InputError(f"{name} = {text!r}: {problem}; the forms are {FORMS}") from None
    return scatter


def _positive(what: str, value: float) -> None:
    if not value > 0.0:
        raise ValueError(f"{what} must be above 0, not {value:g}")


def _ascending(low: tuple[str, float], high: tuple[str, float]) -> None:
    if not low[1] < high[1]:
        raise ValueError(f"{low[0]} = {low[1]:g} must be below {high[0]} = {high[1]:g}")
