"""How likely steady sliding is unstable where a rig's numbers scatter, and which of them decide its onset."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from fivcore import ManyFlutterOnsets, Rig, checks, flutter_onsets_many
from studies.motion import transients
from studies.plotting import planes
from studies.rig import rig_settings
from studies.scatter import distributions
from studies.scatter.distributions import Scatter
from studies.tables import Table
from sweeps import InputError, Sample, quantiles, unit_draws

Array = NDArray[Any]

# Numbers that can scatter: whatever stability depends on.
NUMBERS = tuple(name for name in (*rig_settings(), "mu") if name != "point_b" and not name.endswith("_elements"))
# The scatter where nobody states another, as standard deviations relative to the value: careful workshop practice
# (a tenth of a millimetre in lengths and positions, a hundredth in thicknesses and widths), handbook values of
# steels, damping that is hardly known.
USUAL: Mapping[str, float] = {
    "contact_position": 1.25e-3,
    "head_mass": 0.01,
    "d1": 0.2,
    "d2": 0.2,
    "p1_length": 2e-3,
    "p1_width": 1e-3,
    "p1_thickness": 7e-3,
    "p1_young_modulus": 0.02,
    "p1_density": 5e-3,
    "p2_length": 7e-4,
    "p2_width": 7e-4,
    "p2_thickness": 3.5e-3,
    "p2_young_modulus": 0.02,
    "p2_density": 5e-3,
}
# Largest friction of interest where none is given.
MU_MAX = 1.0
CONFIDENCE = 0.95
MOST_SAMPLES = 1 << 20
# Of the bootstrap.
RESAMPLES = 100


def usual(numbers: Mapping[str, float]) -> dict[str, str]:
    """The usual scatter about these numbers, as one writes it; what is 0, or not among them, does not scatter."""
    return {
        name: f"normal:{numbers[name]:.12g}:{share * abs(numbers[name]):.6g}"
        for name, share in USUAL.items()
        if numbers.get(name, 0.0) != 0.0
    }


def counted(settings: Mapping[str, Any]) -> dict[str, int]:
    """How many rigs are drawn and from which seed, checked."""
    samples = checks.count("samples", settings["samples"], MOST_SAMPLES)
    seed = checks.number("seed", settings["seed"], "a whole number, 0 or above", lambda x: x == int(x) >= 0)
    return {"samples": samples, "seed": int(seed)}


def scatters(texts: Mapping[str, str]) -> dict[str, Scatter]:
    """The distributions that texts stand for, by the numbers that scatter; an `InputError` names what cannot."""
    from studies.study import suggest

    for name in texts:
        if name not in NUMBERS:
            near = suggest(name, list(NUMBERS))
            raise InputError(f"--scatter {name}: it cannot scatter here; {near}what can is {', '.join(NUMBERS)}")
    return {name: distributions.parse(text, name) for name, text in texts.items()}


def onsets(rig: Rig, numbers: Mapping[str, Any], mu_max: float = MU_MAX) -> ManyFlutterOnsets:
    """Onsets and recoveries of many rigs, in which some numbers are not those of `rig`; theta is one of them."""
    named = {name: each for name, each in numbers.items() if name != "mu"}
    return flutter_onsets_many(named, transients.BAND, mu_max, rig)


def lowest(table: ManyFlutterOnsets, otherwise: float) -> tuple[Array, Array]:
    """Lowest friction from which a pair grows in the band and its frequency, Hz, there, for each rig.

    That is at an onset or at the top of the band, which a pair enters already growing; where there is neither,
    `otherwise` and NaN.
    """
    onset, frequency, entry = (
        np.append(each, np.full((len(each), 1), np.nan), axis=1)[:, 0]
        for each in (table.mu, table.frequency, table.entry_mu)
    )
    mu, enters = np.fmin(onset, entry), ~(onset <= entry) & np.isfinite(entry)
    return np.where(np.isnan(mu), otherwise, mu), np.where(enters, transients.BAND, frequency)


def unstable_share(rig: Rig, numbers: Mapping[str, Any], mu: Array) -> Array:
    """Share of rigs that are unstable at each friction.

    Parameters
    ----------
    rig : Rig
    numbers : mapping of str to (float or ndarray)
        In which rigs differ from `rig`, (n,), and theta.
    mu : ndarray, (m,) or (n, 1)
        The same frictions for all rigs, or each rig's own.

    Returns
    -------
    ndarray, (m,) or (1,)
    """
    table = onsets(rig, numbers, max(float(np.max(mu)), 1e-12))
    return np.asarray(table.unstable(mu).mean(axis=0))


def wilson(share: Any, count: int, confidence: float = CONFIDENCE) -> tuple[Array, Array]:
    """Wilson's interval of a probability, where `share` of so many independent draws say yes.

    Wilson, J. Amer. Statist. Assoc. 22, 1927, 209-212. Of Sobol points, which scatter less, it is too wide.
    """
    share = np.asarray(share, dtype=float)
    z2 = float(stats.norm.ppf(0.5 + 0.5 * confidence)) ** 2
    middle = (share + 0.5 * z2 / count) / (1.0 + z2 / count)
    reach = np.sqrt(z2 * (share * (1.0 - share) / count + 0.25 * z2 / count**2)) / (1.0 + z2 / count)
    return np.clip(middle - reach, 0.0, share), np.clip(middle + reach, share, 1.0)


def sobol_indices(
    function: Callable[[dict[str, Array]], Array], scatter: Mapping[str, Scatter], count: int, seed: int
) -> Array:
    """Sobol indices of a function of scattered numbers, with their standard errors.

    First: the share of the variance that goes if this number alone is known; total: what stays if all others are
    (estimators of Saltelli et al., Comput. Phys. Commun. 181, 2010, 259-270). Both are 0 where nothing varies.

    Parameters
    ----------
    function : callable
        `function(numbers)` gives a value for each entry of the arrays in `numbers`, never NaN.
    scatter : mapping of str to Scatter
    count, seed : int
        A power of 2; the function is evaluated at count (numbers + 2) points.

    Returns
    -------
    ndarray, (4, numbers)
        First indices, total indices, and the bootstrap's standard errors of both.
    """
    n = len(scatter)
    shares = unit_draws(2 * n, count, "sobol", seed)
    a, b = (
        np.stack([quantiles(*pair) for pair in zip(scatter.values(), part, strict=True)])
        for part in np.split(shares.T, 2)
    )
    # A with one row after the other of B.
    mixed = np.where(np.eye(n, dtype=bool)[:, :, None], b, a)
    every = np.concatenate([a, b, *mixed], axis=1)
    values = function(dict(zip(scatter, every, strict=True))).reshape(n + 2, count)
    if n == 1:
        # What varies at all varies by this number. (SciPy to 1.17 fails at a single one.)
        return np.array([[1.0], [1.0], [0.0], [0.0]]) * float(np.ptp(values) > 0.0)

    def indices(chosen: Array) -> Array:
        f = values[:, chosen]
        indices = stats.sobol_indices(func={"f_A": f[:1], "f_B": f[1:2], "f_AB": f[2:, None]}, n=count)
        return np.stack([np.atleast_1d(indices.first_order), np.atleast_1d(indices.total_order)])

    rng = np.random.default_rng(seed)
    again = [indices(rng.integers(0, count, count)) for _ in range(RESAMPLES)]
    return np.concatenate([indices(np.arange(count)), np.std(again, axis=0)])


def table(texts: Mapping[str, str]) -> Table:
    """How numbers scatter: distribution, standard deviation, and what is cut away as no rig can have it."""
    rows = []
    for name, each in scatters(texts).items():
        spread = float(each.whole.std() / abs(each.whole.mean())) if each.whole.mean() else math.inf
        cut = f"{100.0 * each.cut:.2g} %" if each.cut else "0"
        rows.append([planes.name(name), each.text, f"{100.0 * spread:.2g} %", cut])
    return Table(["number that scatters", "distribution", "standard deviation", "cut away"], rows, words=2)


def sample(texts: Mapping[str, str], count: int, seed: int, method: str = "sobol") -> dict[str, Array]:
    """Draws of the numbers that scatter, (count,) each."""
    return dict(_sample(tuple(sorted(texts.items())), count, seed, method))


@lru_cache(maxsize=8)
def _sample(texts: tuple[tuple[str, str], ...], count: int, seed: int, method: str) -> dict[str, Array]:
    grid = Sample(scatters(dict(texts)), count, method, seed)
    return {name: grid.axes[name].values for name, _ in texts}
