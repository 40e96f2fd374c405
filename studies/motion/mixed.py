"""Detect realisations that follow different motions, and describe each motion.

The mean over such realisations and its standard error describe none of the motions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import fdtrc

from fivcore import STEADY_SHARE, STEADY_SPREAD, observe
from studies.declaring import labels
from studies.motion.regimes import STEADY, is_of
from sweeps import DONE

# Quantities by which motions are told apart, and the probability of telling one motion for several at a point: in
# a result of a thousand points it is 1 %. At most so many motions are told apart.
QUANTITIES, LEVEL, MOST = ("stick_fraction", "velocity_rms"), 1e-5, 4
# Points that are named, and what `fiv query` shows of all.
NAMED = 3
SHOWN = ("motion_share", "motion_regime", *(f"motion_{name}" for name in QUANTITIES))


def motions(found: Mapping[str, NDArray[Any]], V: float) -> list[NDArray[np.intp]]:
    """Indices of the realisations of each motion, ascending; the most frequent motion comes first.

    The homogeneity of the realisations is tested with each of QUANTITIES (`chance`). Realisations that are not
    homogeneous are split in two by the quantity with the lowest probability, and both parts are tested again.

    Parameters
    ----------
    found : mapping of str to ndarray, (n,)
        Regime, QUANTITIES and their standard errors of each realisation; those without a value follow none.
    V : float
        Speed of the drive, m/s. Differences too small for the regimes to tell are none.
    """
    rest = is_of(found["regime"], "stuck", STEADY)
    samples = []
    for name, least in zip(QUANTITIES, (1.0 - STEADY_SHARE, STEADY_SPREAD * abs(V)), strict=True):
        # What is left of a decay is no property of rest.
        x = np.where(rest, 0.0, found[name]) if name == "velocity_rms" else found[name].astype(float)
        error = np.where(rest, 0.0, found[f"{name}_se"])
        unknown = np.isnan(error) & np.isfinite(x)
        if unknown.any():
            # Runs too short to know their error: that of one motion.
            error[unknown] = x[unknown].std(ddof=1) if unknown.sum() > 1 else abs(x[unknown])
        samples.append((x, np.hypot(error, least)))
    parts = [np.flatnonzero(np.all([np.isfinite(x) for x, _ in samples], axis=0))]
    whole: list[NDArray[np.intp]] = []
    while parts:
        part = parts.pop(0)
        chances = [chance(x[part], error[part]) for x, error in samples]
        if min(chances) < LEVEL / len(samples) and len(parts) + len(whole) + 1 < MOST:
            x, error = samples[int(np.argmin(chances))]
            parts += cut(part, x, error)
        elif len(part):
            whole.append(part)
    return sorted(whole, key=lambda part: (-len(part), part[0]))


def chance(x: NDArray[Any], error: NDArray[Any]) -> float:
    """Probability that values of one motion, with these standard errors, differ at least as much.

    With the standard deviation s of n values and their mean squared standard error e^2, s^2 / e^2 has Fisher's F
    distribution where all follow one motion, with n - 1 and at least n FEWEST degrees of freedom.
    """
    n = len(x)
    return float(fdtrc(n - 1.0, observe.FEWEST * n, x.var(ddof=1) / np.mean(error**2))) if n > 1 else 1.0


def cut(part: NDArray[np.intp], x: NDArray[Any], error: NDArray[Any]) -> list[NDArray[np.intp]]:
    """Split realisations between two neighbours so that the weighted squares about both means are least."""
    order = part[np.argsort(x[part], kind="stable")]
    # Of values and squares from the lowest and from the highest value on; about the middle nothing cancels.
    y, weight = x[order] - np.median(x[order]), error[order] ** -2.0
    below, above = (
        np.cumsum([w, w * z, w * z * z], axis=1)[:, :-1] for w, z in ((weight, y), (weight[::-1], y[::-1]))
    )
    squares = [sums[2] - sums[1] ** 2 / sums[0] for sums in (below, above[:, ::-1])]
    place = int(np.argmin(squares[0] + squares[1])) + 1
    return [np.sort(order[:place]), np.sort(order[place:])]


def several(dataset: xr.Dataset) -> xr.DataArray:
    """Mark computed points whose realisations follow different motions; none in a result without the data."""
    done: xr.DataArray = dataset["status"] == DONE
    return done & (dataset["motions"] > 1) if "motions" in dataset else xr.zeros_like(done)


def told(dataset: xr.Dataset, named: int = NAMED) -> Iterator[str]:
    """Yield a sentence on the points whose realisations follow different motions, and on those motions."""
    places = np.argwhere(several(dataset).values)
    if len(places):
        dims, sizes = dataset["status"].dims, dataset["status"].sizes
        points = [dataset.isel(dict(zip(dims, place, strict=True))) for place in places[:named]]
        vary = [str(dim) for dim in dims if sizes[dim] > 1]
        where = [", ".join(labels.named(dim, point[dim]) for dim in vary) for point in points]
        each = [": ".join(filter(None, pair)) for pair in zip(where, map(motions_text, points), strict=True)]
        more = f"; and {len(places) - named} more" * (named > 0) * (len(places) > named)
        yield (
            f"At {len(places)} of {dataset['status'].size} points the realisations follow different motions, so"
            f" that a mean describes none of them{': ' * bool(each)}{'; '.join(each)}{more}."
            f" All motions: fiv query, --show {','.join(SHOWN)} --where 'motions > 1 and motion <= motions'."
        )


def motions_text(point: xr.Dataset) -> str:
    """The motions of a point: "7 of 12 irregular (stick 0.71, RMS 5.1 mm/s), 5 steady sliding (stick 0)"."""
    members, texts = float(point["members"]), list[str]()
    words, (unit, factor) = labels.words(point["motion_regime"]), labels.unit_of(point["motion_velocity_rms"])
    for k in np.flatnonzero(np.isfinite(point["motion_share"].values)):
        stick, rms = (float(point[f"motion_{name}"][k]) for name in QUANTITIES)
        count, of = round(members * float(point["motion_share"][k])), f" of {members:g}" * (not texts)
        text = f", RMS {factor * rms:.3g} {unit}" if words[k] not in ("stuck", STEADY) else ""
        texts.append(f"{count}{of} {words[k]} (stick {stick:.3g}{text})")
    return ", ".join(texts)
