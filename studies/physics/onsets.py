"""Flutter onsets: branches over the inclination, changes with the rig, and the first pair that locks in."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import xarray as xr

import fivcore
from fivcore import OnsetCurves, OnsetSensitivity, Rig, SlidingModes, flutter_onsets, onset_curves, sliding_modes
from studies import paper
from studies.declaring.own import parameters, varied
from studies.declaring.parameters import rig_numbers
from studies.motion.run import BAND
from studies.motion.scenes import rig_of
from studies.motion.stability import first_onsets, friction_in, with_flags, with_unstable_intervals
from studies.motion.uncertainty import UNCERTAIN
from sweeps import InputError, Variable

ENDS = ("range", "mu_max", "fmax", "fold")
TRACED = {"theta": "degree", "mu": "1", "frequency": "Hz"}
# Branches: dimension, name of their variables, description.
BRANCHES = {"pair": ("onset", "the pair's flutter onset"), "recovery": ("recovery", "a pair's recovery")}
# Relative change of a parameter. Friction is a function of frequency, which tells onsets apart: further than SAME
# from the predicted frequency an onset may be another, born where this one met a recovery.
PAIRS, STEP, SAME = 3, 0.01, 0.01
# Onsets have derivatives by all that stability depends on but mu.
VARIED = tuple(name for name in UNCERTAIN if name != "mu")
SENSITIVITIES = {
    "onset_mu": ("1", "coefficient of friction at the pair's flutter onset", "pair"),
    "onset_frequency": ("Hz", "frequency at the pair's flutter onset", "pair"),
    "elasticity_mu": ("1", "relative change of onset_mu for that of the parameter", "pair"),
    "elasticity_frequency": ("1", "relative change of onset_frequency for that of the parameter", "pair"),
    "change_mu": ("1", "change of onset_mu when the parameter is 1 % larger, solved again", "pair"),
    "change_frequency": ("Hz", "change of onset_frequency when the parameter is 1 % larger, solved again", "pair"),
    "fold": Variable("1", "whether the onset meets a recovery", ("pair",), "int8", flags={0: "no", 1: "yes"}),
}
# The pair is followed from its onset, in steps so small that it is nearest to itself, over whole intervals of mu.
MU_MAX, MU_STEP, INTERVAL, MOST_MU = 1.0, 2e-4, 0.2, 4.0


def with_branches(dataset: xr.Dataset, rig: Any) -> xr.Dataset:
    """Add branches of onsets and recoveries over theta, unstable intervals at the paper's friction, and the bound.

    Where branches or intervals cannot be separated they are left out, and a `comment` gives the reason.
    """
    theta, mu, comment = dataset["theta"].values, dataset["mu"].values, ""
    curves = OnsetCurves((), (), theta, *np.empty((4, len(theta), 0)))
    if not isinstance(rig, Rig):
        comment = "a structure has one inclination"
    elif friction_in(dataset).kinetic_ratio != 1.0:
        comment = "friction depends on the speed"
    elif mu.max() > 0.0:
        try:
            curves = onset_curves(rig, theta, BAND, float(mu.max()))
        except ArithmeticError as problem:
            comment = str(problem)
    friction, tangent = float(np.clip(paper.MU, mu.min(), mu.max())), np.tan(np.radians(theta))
    dataset = with_unstable_intervals(dataset, rig, friction)
    added = branches("pair", curves.onsets, curves.mu, curves.frequency)
    added |= branches("recovery", curves.recoveries, curves.recovery_mu, curves.recovery_frequency)
    # The lowest onset at each angle, NaN where there is none.
    table = np.pad([curves.mu, curves.frequency], ((0, 0), (0, 0), (0, 1)), constant_values=np.nan)
    first = np.where(np.isnan(table[0]), np.inf, table[0]).argmin(axis=1)
    lowest = table[:, np.arange(len(theta)), first]
    if comment:
        lowest = np.array(first_onsets(dataset, rig)[1:])
    text = "at the lowest flutter onset; pairs that enter the band unstable are not counted"
    added["onset_mu"] = "theta", lowest[0], "1", f"coefficient of friction {text}"
    added["onset_frequency"] = "theta", lowest[1], "Hz", f"frequency {text}"
    added["bound_mu"] = "theta", np.where(tangent > 0.0, tangent, np.nan), "1", "tan(theta), if above 0"
    added["window_mu"] = (), friction, "1", "coefficient of friction of the unstable intervals"
    # The branches as they were followed, to their ends, one after the other.
    traces = (*curves.onsets, *curves.recoveries)
    number = np.repeat(np.arange(len(traces), dtype=np.int16), [len(curve.theta) for curve in traces])
    added["trace"] = "trace", np.arange(1, len(number) + 1), "1", "number of the point of a branch"
    added["trace_branch"] = "trace", number, "1", "number of the branch, from 0; onsets first"
    for name, units in TRACED.items():
        values = np.concatenate([np.empty(0), *(getattr(curve, name) for curve in traces)])
        added[f"trace_{name}"] = "trace", np.float32(values), units, f"{name} along the branches"
    for name, (dims, values, units, text) in added.items():
        dataset[name] = dims, values, {"units": units, "long_name": text}
    dataset = dataset.assign_coords({dim: dataset[f"{dim}_lowest_frequency"] for dim in BRANCHES})
    if comment:
        dataset["pair_onset_mu"].attrs["comment"] = comment
    return with_flags(dataset, ENDS, *(f"{dim}_{end}" for dim in BRANCHES for end in ("begins", "ends")))


def branches(dim: str, curves: Any, mu: np.ndarray, frequency: np.ndarray) -> dict[str, Any]:
    """Branches at the angles of the grid, the minimum of each, and the kinds of its ends."""
    kind, text = BRANCHES[dim]
    added: dict[str, Any] = {
        f"pair_{kind}_mu": (("theta", dim), mu, "1", f"coefficient of friction at {text}"),
        f"pair_{kind}_frequency": (("theta", dim), frequency, "Hz", f"frequency at {text}"),
    }
    places = np.array([curve.lowest for curve in curves]).reshape(-1, 3).T
    for (name, units), values in zip(TRACED.items(), places, strict=True):
        added[f"{dim}_lowest_{name}"] = (dim, values, units, f"{name} where {text} is lowest in mu")
    for k, name in enumerate(("begins", "ends")):
        codes = np.array([ENDS.index(curve.ends[k]) for curve in curves], dtype=np.int8)
        added[f"{dim}_{name}"] = (dim, codes, "1", f"where {text} {name} as theta rises")
    return added


@lru_cache(maxsize=8)
def pairs_at(rig: Any, theta: float, start: float, mu_max: float) -> tuple[OnsetSensitivity, np.ndarray]:
    """All onsets at `theta`, and the index of each pair, numbered by `start`, among them; -1 for no onset.

    The pairs of a structure are its first onsets.
    """
    if not isinstance(rig, Rig):
        onsets = fivcore.onset_sensitivity(rig, theta, BAND, mu_max)
        return onsets, np.where(np.arange(PAIRS) < len(onsets.mu), np.arange(PAIRS), -1)
    angles = np.unique([start, theta])
    branches = onset_curves(rig, angles, BAND, mu_max).mu
    first, last = branches[np.searchsorted(angles, [start, theta])]
    onsets, places = fivcore.onset_sensitivity(rig, theta, BAND, mu_max), np.full(PAIRS, -1)
    for pair, branch in enumerate(np.argsort(first)[:PAIRS]):
        # At the given angles the curves have the bits of `flutter_onsets`.
        if np.isfinite(first[branch]) and last[branch] in onsets.mu:
            places[pair] = np.flatnonzero(onsets.mu == last[branch])[0]
    return onsets, places


def sensitivities(rig: Rig, theta: Any, parameter: Any, pairs_theta: float, mu_max: float) -> dict[str, Any]:
    """The outputs at each point; NaN for a pair without an onset, so for all at theta <= 0."""
    results = {name: np.full((len(theta), PAIRS), 0.0 if name == "fold" else np.nan) for name in SENSITIVITIES}
    for row, (angle, name) in enumerate(zip(theta.tolist(), parameter.tolist(), strict=True)):
        onsets, places = pairs_at(rig, angle, pairs_theta, mu_max)
        mu, frequency = changed(rig, angle, name, onsets, mu_max)
        normalised = onsets.mu_normalised[name], onsets.frequency_normalised[name]
        changes = mu - onsets.mu, frequency - onsets.frequency
        values = onsets.mu, onsets.frequency, *normalised, *changes, onsets.fold
        for output, value in zip(SENSITIVITIES, values, strict=True):
            results[output][row, places >= 0] = value[places[places >= 0]]
    return results


def changed(rig: Any, theta: float, name: str, onsets: OnsetSensitivity, mu_max: float) -> tuple[Any, Any]:
    """Friction and frequency of the onsets after a parameter has grown by 1 %.

    NaN where no onset lies within SAME of the frequency that the derivative predicts, or where no such rig exists.
    """
    mu, frequency = np.full((2, len(onsets.mu)), np.nan)
    with suppress(InputError):
        # An onset may rise beyond the friction of interest.
        after = flutter_onsets(*larger(rig, theta, name), BAND, 2.0 * mu_max)
        predicted = onsets.frequency * (1.0 + STEP * np.nan_to_num(onsets.frequency_normalised[name]))
        away = np.abs(np.log(after.frequency[:, None] / predicted))
        j, k = np.nonzero((away == away.min(0, initial=SAME)) & (away == away.min(1, initial=SAME, keepdims=True)))
        mu[k], frequency[k] = after.mu[j], after.frequency[j]
    return mu, frequency


def larger(rig: Any, theta: float, name: str) -> tuple[Any, float]:
    """The rig and the inclination after one parameter has grown by 1 %; a direction is turned by 0.01 rad."""
    if not isinstance(rig, Rig):
        if name == "direction":
            n, t, c, s = rig.normal, rig.tangential, np.cos(STEP), np.sin(STEP)
            return replace(rig, normal=c * n - s * t, tangential=s * n + c * t), theta
        # Whatever its law of damping, the others are kept.
        kept = {n: p.default for n, p in parameters(rig).items() if re.fullmatch(r"(frequency|damping)_\d+", n)}
        return varied(rig, kept | {name: kept[name] * (1.0 + STEP)}), theta
    numbers = rig_numbers(rig) | {"theta": theta}
    numbers[name] *= 1.0 + STEP
    return rig_of(numbers), numbers["theta"]


def pair(rig: Rig, theta: float, mu: np.ndarray) -> dict[str, np.ndarray]:
    """Frequency and growth rate of the two modes that lock in first; NaN where they are above the band."""
    followed = path(rig, theta, int(np.ceil(mu.max() / INTERVAL)))
    modes = sliding_modes(rig, theta, mu, BAND)
    frequency, growth = np.full((2, len(mu), 2), np.nan)
    for m, near in enumerate(np.rint(mu / MU_STEP)):
        if len(both := closest_two(modes, m, followed[int(near)])):
            frequency[m], growth[m] = modes.frequency[m, both], modes.growth_rate[m, both]
    return {"frequency": frequency, "growth_rate": growth}


def lock_in(rig: Rig, theta: float) -> tuple[float, float, np.ndarray]:
    """Coefficient of friction, frequency and both eigenvalues where the first two modes lock in."""
    found = flutter_onsets(rig, theta, BAND, MU_MAX)
    if not len(found.mu):
        raise InputError(f"theta = {theta:g}: no two modes below {BAND:g} Hz lock in up to mu = {MU_MAX:g}")
    frequency = float(found.frequency[0])
    return float(found.mu[0]), frequency, np.full(2, complex((2.0 * np.pi * frequency) ** 2))


@lru_cache(maxsize=8)
def path(rig: Rig, theta: float, intervals: int) -> np.ndarray:
    """Eigenvalues lambda of the pair at multiples of MU_STEP, (mu, 2), over some intervals or to its onset."""
    onset, _, near = lock_in(rig, theta)
    mu = MU_STEP * np.arange(round(max(intervals, np.ceil(onset / INTERVAL)) * INTERVAL / MU_STEP) + 1)
    modes, start = sliding_modes(rig, theta, mu, BAND), int(np.abs(mu - onset).argmin())
    followed = np.full((len(mu), 2), complex(np.nan, np.nan))
    for way in (range(start, len(mu)), range(start - 1, -1, -1)):
        for m in way:
            if not len(both := closest_two(modes, m, near)):
                break
            near = followed[m] = modes.eigenvalue[m, both]
        near = followed[start]
    return followed


def closest_two(modes: SlidingModes, m: int, near: np.ndarray) -> np.ndarray:
    """The two modes at the m-th mu nearest to `near`, lower one first; of a conjugate pair the decaying one."""
    coupled = np.nonzero(~modes.uncoupled[m] & np.isfinite(modes.frequency[m]))[0]
    values = modes.eigenvalue[m, coupled]
    cost = np.abs(values[:, None] - near[0]) + np.abs(values - near[1])
    np.fill_diagonal(cost, np.inf)
    if len(coupled) < 2 or not cost.min() <= 0.5 * np.abs(near).sum():
        return coupled[:0]
    both = coupled[list(np.unravel_index(cost.argmin(), cost.shape))]
    values = modes.eigenvalue[m, both]
    conjugate = np.abs(values.imag).max() > 1e-9 * np.abs(values).max()
    return np.asarray(both[np.argsort((modes.growth_rate if conjugate else modes.frequency)[m, both])])


def crossings(rig: Any, theta: float, mu_max: float) -> dict[str, Any]:
    """Onsets, recoveries and divergence up to a friction, as variables: dimensions, values, units and text."""
    found = flutter_onsets(rig, theta, BAND, max(mu_max, 1e-12))  # without friction nothing grows
    text = "coefficient of friction from which a mode grows without oscillation (divergence)"
    added: dict[str, Any] = {"divergence_mu": ((), found.divergence_mu, "1", text)}
    for kind, name, mu, frequency in (
        ("onset", "flutter onset", found.mu, found.frequency),
        ("recovery", "recovery", found.recovery_mu, found.recovery_frequency),
    ):
        added[kind] = kind, np.arange(1, len(mu) + 1), "1", f"number of the {name}, ascending in mu"
        added[f"{kind}_mu"] = kind, mu, "1", f"coefficient of friction at the {name}"
        added[f"{kind}_frequency"] = kind, frequency, "Hz", f"frequency at the {name}"
    return added
