"""How a number scatters, as one writes it, `normal:0.2:0.02`, and cut to what is physical."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from fivcore.rig import BEAM_NUMBERS, RIG_NUMBERS
from studies.spec import converted, finite, typed
from sweeps import InputError

FORMS = "normal:MEAN:SD | uniform:LOW:HIGH | lognormal:MEDIAN:SIGMA | triangular:LOW:MODE:HIGH"
POSITIVE, ANY = (0.0, math.inf), (-math.inf, math.inf)
# What a number of a rig or a scene can be at all; a study's own numbers are not known here.
PHYSICAL = {
    **{name: POSITIVE for name in ("mu", "F", "duration", "ramp", "most", "least", "cutoff", "sample_rate")},
    **{name: POSITIVE for name in RIG_NUMBERS},
    **{f"{beam}_{name}": POSITIVE for beam in ("p1", "p2") for name in BEAM_NUMBERS},
    # Both excluded.
    "theta": (math.nextafter(-90.0, 0.0), math.nextafter(90.0, 0.0)),
    "point_b": (0.0, 1.0),
}
# A distribution of which less is left is not meant so.
LEAST_LEFT = 0.01


@dataclass(frozen=True, eq=False)
class Scatter:
    """A distribution, cut to an interval outside which its number cannot be.

    Attributes
    ----------
    text : str
        As one writes it: `normal:0.2:0.02`.
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
    def described(self) -> str:
        """Text that identifies the distribution: its definition and its bounds."""
        return f"{self.text} from {self.low:g} to {self.high:g}"

    @property
    def cut(self) -> float:
        """The share of the distribution that was cut away."""
        return float(self.whole.cdf(self.low) + self.whole.sf(self.high))

    def cut_note(self, name: str) -> str:
        """The share that was cut away, in words; "" for less than one in a million."""
        if self.cut < 1e-6:
            return ""
        sides = [f"below {self.low:g}"] if self.whole.cdf(self.low) > 0.0 else []
        sides += [f"above {self.high:g}"] if self.whole.sf(self.high) > 0.0 else []
        return f"{name}: {100.0 * self.cut:.2g} % of {self.text} is {' or '.join(sides)} and was cut away"

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
        raise InputError(f"MODE must be from LOW = {low:g} to HIGH = {high:g}, not {mode:g}")
    return stats.triang((mode - low) / (high - low), low, high - low)


UNITS = {"V": "m s-1", "theta": "degree", "mu": "1", "F": "N"} | {
    name: units for name, (units, _) in (RIG_NUMBERS | BEAM_NUMBERS).items()
}
# Each kind with how many numbers it takes.
KINDS: Mapping[str, tuple[int, Callable[..., Any]]] = {
    "normal": (2, _normal),
    "uniform": (2, _uniform),
    "lognormal": (2, _lognormal),
    "triangular": (3, _triangular),
}


def physical(name: str) -> tuple[float, float]:
    """The least and the greatest that the number called `name` can be."""
    return PHYSICAL.get(name, ANY)


def units_of(name: str) -> str:
    """Units of the number called `name`; "" for one that is not of a rig or a scene."""
    return UNITS.get(name.removeprefix("p1_").removeprefix("p2_"), "")


def parse(text: str, name: str) -> Scatter:
    """The distribution that a text stands for, of the number called `name`; an `InputError` names both."""
    try:
        kind, *parts = text.strip().split(":")
        if kind not in KINDS:
            raise InputError(f"{kind!r} is none of {', '.join(KINDS)}")
        count, make = KINDS[kind]
        if len(parts) != count:
            raise InputError(f"{kind} takes {count} numbers, not {len(parts)}")
        if "," in text:
            raise InputError("',' separates no numbers here, ':' does")
        low, high = physical(name)
        # The SIGMA of logarithms has no unit.
        sized = 1 if kind == "lognormal" else count
        parts[:sized] = converted(",".join(parts[:sized]), units_of(name)).split(",")
        numbers = [finite(part) for part in parts]
        # One distribution has one text, however its numbers were typed.
        scatter = Scatter(":".join([kind, *map(typed, numbers)]), make(*numbers), low, high)
        if not 1.0 - scatter.cut >= LEAST_LEFT:
            raise InputError(
                f"{100.0 * scatter.cut:.3g} % of it is beyond what {name} can be, {low:g} to {high:g}"
            )
    except ValueError as problem:
        raise InputError(f"{name} = {text!r}: {problem}; the forms are {FORMS}") from None
    return scatter


def _positive(what: str, value: float) -> None:
    if not value > 0.0:
        raise InputError(f"{what} must be above 0, not {value:g}")


def _ascending(low: tuple[str, float], high: tuple[str, float]) -> None:
    if not low[1] < high[1]:
        raise InputError(f"{low[0]} = {low[1]:g} must be below {high[0]} = {high[1]:g}")
    if math.isinf(high[1] - low[1]):
        most = sys.float_info.max
        raise InputError(f"{high[0]} - {low[0]} must be at most {most:.3g}, not {high[1]:g} - {low[1]:g}")
