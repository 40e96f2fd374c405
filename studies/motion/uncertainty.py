"""Uncertain parameters: their distributions, and what they do to the stability of steady sliding."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fivcore import BEAM_PARAMETERS, ManyFlutterOnsets, Rig, checks, flutter_onsets_many
from studies.declaring.parameters import RIG, SCENE, suggest
from studies.declaring.spec import converted, finite, typed
from studies.motion.run import BAND
from sweeps import InputError, Sample, quantiles, unit_draws

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[Any]

FORMS = (
    "normal:MEAN:SD | uniform:LOW:HIGH | lognormal:MEDIAN:SIGMA | triangular:LOW:MODE:HIGH | loguniform:LOW:HIGH"
)
KINDS = {form.split(":")[0]: tuple(form.split(":")[1:]) for form in FORMS.split(" | ")}
SCIPYS = "NAME:SHAPES:LOC:SCALE of scipy.stats"
# Numbers that fits find besides: of both beams, and of a structure, with the frequency of mode 3 as `frequency_3`.
OF_FITS = (*BEAM_PARAMETERS, "damping_ratio", "mass_scale", "stiffness_scale", "frequency")
# What a parameter can be at all; outside a distribution is truncated. The ends of theta are excluded.
PHYSICAL = dict.fromkeys(
    (*RIG, "mu", "F", "decay_speed", "ramp", "min_duration", "max_duration", "cutoff", *OF_FITS), (0.0, math.inf)
) | {
    "theta": (math.nextafter(-90.0, 0.0), math.nextafter(90.0, 0.0)),
    **dict.fromkeys(("point_b", "kinetic_ratio"), (0.0, 1.0)),
}
# A distribution of which less is possible is a mistake.
LEAST_LEFT = 0.01
# Parameters that stability depends on.
UNCERTAIN = ("theta", "mu", *(name for name in RIG if name != "point_b" and not name.endswith("_elements")))
# Usual standard deviations, relative to the value: workshop practice (0.1 mm in lengths and positions, 0.01 mm in
# thicknesses and widths), handbook values of steels, damping that is hardly known.
USUAL: Mapping[str, float] = {
    "contact_position": 1.25e-3, "head_mass": 0.01, "d1": 0.2, "d2": 0.2,
    "p1_length": 2e-3, "p1_width": 1e-3, "p1_thickness": 7e-3, "p1_young_modulus": 0.02, "p1_density": 5e-3,
    "p2_length": 7e-4, "p2_width": 7e-4, "p2_thickness": 3.5e-3, "p2_young_modulus": 0.02, "p2_density": 5e-3,
}  # fmt: skip
MU_MAX = 1.0
MOST_SAMPLES = 1 << 20
RESAMPLES = 100


@dataclass(frozen=True, eq=False)
class Distribution:
    """A distribution of SciPy, truncated to the range of its parameter.

    `text` is its form on the command line, in the parameter's units: `normal:0.2:0.02`; `low` and `high` bound the
    parameter.
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
        """The truncated probability."""
        return float(self.whole.cdf(self.low) + self.whole.sf(self.high))

    @property
    def whole_std(self) -> float:
        """The standard deviation before truncation."""
        return float(self.whole.std())

    def cdf(self, values: Any) -> Array:
        """Probabilities of values up to these."""
        begin, end = self.whole.cdf(self.low), self.whole.cdf(self.high)
        return np.asarray(np.clip((self.whole.cdf(values) - begin) / (end - begin), 0.0, 1.0))

    def ppf(self, probability: Any) -> Array:
        """Quantiles."""
        begin, end = self.whole.cdf(self.low), self.whole.cdf(self.high)
        values = self.whole.ppf(begin + np.asarray(probability) * (end - begin))
        return np.asarray(np.clip(values, self.low, self.high))


def is_kind(word: str) -> bool:
    """Whether a word names a distribution: one of FORMS, or a continuous one of `scipy.stats`."""
    return word in KINDS or (word.isidentifier() and bool(_scipys(word)))


def _scipys(word: str) -> tuple[str, ...]:
    """Names of the parameters of a distribution of `scipy.stats`; () if there is none of this name."""
    found = getattr(scipy.stats, word, None)
    if not isinstance(found, scipy.stats.rv_continuous):
        return ()
    return (*filter(None, (found.shapes or "").replace(" ", "").split(",")), "loc", "scale")


def text_of(given: Any, name: str) -> str:
    """Text, as on the command line, of a parameter's distribution, which may be a frozen one of `scipy.stats`."""
    if isinstance(text := getattr(given, "text", given), str):
        return text
    kind = str(getattr(getattr(given, "dist", None), "name", ""))
    try:
        names = _scipys(kind)
        numbers = {"loc": 0.0, "scale": 1.0} | dict(zip(names, given.args, strict=False)) | given.kwds
        parts = [typed(float(numbers[each])) for each in names]
        if not parts:
            raise InputError
    except (AttributeError, TypeError, KeyError, InputError):
        ways = "norm(0.2, 0.02), or a text such as normal:0.2:0.02"
        raise InputError(f"{name} = {given!r}: it must be a frozen distribution of scipy.stats, {ways}") from None
    own = {"norm": ("normal", parts), "uniform": ("uniform", [parts[0], typed(sum(map(float, parts)))])}
    if kind == "loguniform":
        *ends, loc, scale = map(float, parts)
        own[kind] = ("reciprocal", parts) if loc else (kind, [typed(end * scale) for end in ends])
    kind, parts = own.get(kind, (kind, parts))
    return ":".join([kind, *parts])


def parse(text: str, name: str, units: str = "1") -> Distribution:
    """The distribution of a parameter, of a text with plain numbers in `units` or with units of its own.

    An `InputError` names the parameter, the text, what is wrong with it, and the forms.
    """
    try:
        kind, *parts = text.strip().split(":")
        names = KINDS.get(kind) or _scipys(kind)
        if not names:
            raise InputError(f"{kind!r} is none of {', '.join(KINDS)}, nor a continuous one of scipy.stats")
        if len(parts) != len(names):
            raise InputError(f"{kind} takes {len(names)} numbers, not {len(parts)}: {', '.join(names)}")
        if "," in text:
            raise InputError("numbers are separated by ':', not by ','")
        # SIGMA, of logarithms, has no unit, nor have shapes.
        sized = 1 if kind == "lognormal" else len(parts) if kind in KINDS else 0
        if sized:
            parts[:sized] = converted(",".join(parts[:sized]), units).split(",")
        numbers = [finite(part) for part in parts]
        low, high = PHYSICAL.get(re.sub(r"_\d+$", "", name), (-math.inf, math.inf))
        found = Distribution(":".join([kind, *map(typed, numbers)]), _frozen(kind, *numbers), low, high)
        if not 1.0 - found.cut >= LEAST_LEFT:
            raise InputError(f"{100.0 * found.cut:.3g} % of it is beyond what {name} can be, {low:g} to {high:g}")
    except ValueError as problem:
        raise InputError(f"{name} = {text!r}: {problem}; the forms are {FORMS} | {SCIPYS}") from None
    return found


def _frozen(kind: str, *numbers: float) -> Any:
    """SciPy's distribution; an `InputError` for numbers that define none."""
    first, *_, last = numbers
    if kind not in KINDS:
        found = getattr(scipy.stats, kind)(*numbers)
        with np.errstate(invalid="ignore"):
            ends = found.ppf([0.01, 0.5, 0.99])
        if not np.all(np.isfinite(ends)):
            raise InputError("these numbers define no distribution")
        return found
    names = KINDS[kind]
    if kind in ("normal", "lognormal"):
        for name, value in zip(names, numbers, strict=True):
            if not value > 0.0 and name != "MEAN":
                raise InputError(f"{name} must be above 0, not {value:g}")
        return scipy.stats.norm(first, last) if kind == "normal" else scipy.stats.lognorm(last, scale=first)
    if not (first < last and math.isfinite(last - first)):
        raise InputError(f"LOW = {first:g} must be below HIGH = {last:g}, and HIGH - LOW at most 1.8e308")
    if kind == "uniform":
        return scipy.stats.uniform(first, last - first)
    if kind == "loguniform":
        if not first > 0.0:
            raise InputError(f"LOW must be above 0, not {first:g}")
        return scipy.stats.loguniform(first, last)
    if not first <= numbers[1] <= last:
        raise InputError(f"MODE must be from LOW = {first:g} to HIGH = {last:g}, not {numbers[1]:g}")
    return scipy.stats.triang((numbers[1] - first) / (last - first), first, last - first)


def usual(numbers: Mapping[str, Any]) -> dict[str, str]:
    """Default distributions around these numbers of a rig; those that are 0 or not listed are certain."""
    return {
        name: f"normal:{numbers[name]:.12g}:{relative * abs(numbers[name]):.6g}"
        for name, relative in USUAL.items()
        if numbers.get(name, 0.0) != 0.0
    }


def distributions(texts: Mapping[str, str]) -> dict[str, Distribution]:
    """Distributions of parameters that stability depends on; an `InputError` names any other parameter."""
    for name in set(texts) - set(UNCERTAIN):
        near = suggest(name, UNCERTAIN) or f"choose from {', '.join(UNCERTAIN)}"
        raise InputError(f"{name}: stability does not depend on it; {near.strip()}")
    return {name: parse(text, name, (SCENE | RIG)[name].units) for name, text in texts.items()}


def check(samples: int, seed: int, **others: Any) -> None:
    """Refuse a number of draws, a seed or distributions that are out of range."""
    checks.count("samples", samples, MOST_SAMPLES)
    checks.number("seed", seed, "a whole number, 0 or above", lambda value: value == int(value) >= 0)
    distributions(others.get("distributions", {}))


def draws(texts: Mapping[str, str], count: int, seed: int) -> dict[str, Array]:
    """Draws of the uncertain parameters, (count,) each."""
    grid = Sample(distributions(dict(sorted(texts.items()))), count, "sobol", seed)
    return {name: grid.axes[name].values for name in texts}


def table(texts: Mapping[str, str]) -> pd.DataFrame:
    """Uncertain parameters with their distributions, relative standard deviations and truncated probabilities."""
    import pandas as pd

    rows = []
    for name, distribution in distributions(texts).items():
        mean = float(distribution.whole.mean())
        relative = 100.0 * distribution.whole_std / abs(mean) if mean else math.nan
        rows.append(((SCENE | RIG)[name].text, distribution.text, relative, 100.0 * distribution.cut))
    return pd.DataFrame(rows, columns=["parameter", "distribution", "SD %", "truncated %"])


def onsets(rig: Rig, numbers: Mapping[str, Any], mu_max: float = MU_MAX) -> ManyFlutterOnsets:
    """Onsets and recoveries of many rigs, which differ from `rig` in some numbers or in theta."""
    return flutter_onsets_many({k: v for k, v in numbers.items() if k != "mu"}, BAND, mu_max, rig)


def lowest(table: ManyFlutterOnsets, otherwise: float) -> tuple[Array, Array]:
    """Lowest friction at which a mode of each rig becomes unstable in the band, and its frequency, Hz.

    It is an onset, or the friction at which an unstable mode enters the band from above. Without either the values
    are `otherwise` and NaN.
    """
    onset, frequency, entry = (
        np.append(values, np.full((len(values), 1), np.nan), axis=1)[:, 0]
        for values in (table.mu, table.frequency, table.entry_mu)
    )
    mu, enters = np.fmin(onset, entry), ~(onset <= entry) & np.isfinite(entry)
    return np.where(np.isnan(mu), otherwise, mu), np.where(enters, BAND, frequency)


def unstable_share(rig: Rig, numbers: Mapping[str, Any], mu: Array) -> Array:
    """Fraction of rigs (see `onsets`) that are unstable at each friction, (m,), or each at its own, (rigs, 1)."""
    return np.asarray(onsets(rig, numbers, max(float(np.max(mu)), 1e-12)).unstable(mu).mean(axis=0))


def wilson(share: Any, count: int, confidence: float = 0.95) -> tuple[Array, Array]:
    """Wilson's interval of a probability, of the fraction of `count` independent draws.

    Wilson, J. Amer. Statist. Assoc. 22, 1927, 209-212. For Sobol points, which vary less, it is too wide.
    """
    share = np.asarray(share, dtype=float)
    z2 = float(scipy.stats.norm.ppf(0.5 + 0.5 * confidence)) ** 2
    middle = (share + 0.5 * z2 / count) / (1.0 + z2 / count)
    half = np.sqrt(z2 * (share * (1.0 - share) / count + 0.25 * z2 / count**2)) / (1.0 + z2 / count)
    return np.clip(middle - half, 0.0, share), np.clip(middle + half, share, 1.0)


def sobol_indices(
    function: Callable[[dict[str, Array]], Array], uncertain: Mapping[str, Distribution], count: int, seed: int
) -> Array:
    """First and total Sobol indices with standard errors by bootstrap, (4, parameters); 0 for a constant function.

    Estimators of Saltelli et al., Comput. Phys. Commun. 181, 2010, 259-270. `function(numbers)` gives a value, not
    NaN, for each of the count (parameters + 2) entries of the arrays in `numbers`; `count` is a power of 2.
    """
    n = len(uncertain)
    halves = np.split(unit_draws(2 * n, count, "sobol", seed).T, 2)
    a, b = (np.stack([quantiles(*pair) for pair in zip(uncertain.values(), half, strict=True)]) for half in halves)
    # A with one row after the other of B.
    mixed = np.where(np.eye(n, dtype=bool)[:, :, None], b, a)
    points = np.concatenate([a, b, *mixed], axis=1)
    values = function(dict(zip(uncertain, points, strict=True))).reshape(n + 2, count)
    if n == 1:
        # The whole variance is this parameter's. (SciPy to 1.17 fails at a single one.)
        return np.array([[1.0], [1.0], [0.0], [0.0]]) * float(np.ptp(values) > 0.0)

    def indices(chosen: Array) -> Array:
        f = values[:, chosen]
        found = scipy.stats.sobol_indices(func={"f_A": f[:1], "f_B": f[1:2], "f_AB": f[2:, None]}, n=count)
        return np.stack([np.atleast_1d(found.first_order), np.atleast_1d(found.total_order)])

    rng = np.random.default_rng(seed)
    again = [indices(rng.integers(0, count, count)) for _ in range(RESAMPLES)]
    return np.concatenate([indices(np.arange(count)), np.std(again, axis=0)])
