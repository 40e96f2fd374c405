"""Linear stability of steady sliding: growth rates, first onsets, least stable modes, unstable intervals."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import fivcore
from fivcore import FlutterOnsets, Friction, Rig, Scene, Structure, flutter_onsets, model_exponents, sliding_modes
from studies.declaring import labels
from studies.declaring.labels import number
from studies.declaring.parameters import FRICTION, SLIDING
from studies.motion.run import BAND
from studies.motion.scenes import friction_of
from sweeps import Axis, Variable

Array = NDArray[Any]

# Where friction falls steeply a pair becomes two exponents that do not oscillate: they are listed up to so many
# times the size that those of a band have.
FAR = 5.0

# Variables of the modes of steady sliding, and of a scene's least stable one.
MODES = {
    "frequency": ("Hz", "frequency of the sliding mode", "mode"),
    "growth_rate": ("s-1", "growth rate of the sliding mode", "mode"),
}
# A file has room for so many modes that enter the band as friction rises, and by which its rigs differ.
ROOM = 10
LEAST_STABLE = {
    "mode_growth_rate": Variable("s-1", "growth rate of the least stable mode of steady sliding below 10 kHz"),
    "mode_frequency": Variable("Hz", "frequency of the least stable mode of steady sliding below 10 kHz"),
}
# Variables of `linear_stability`.
SLIDING_MODE = "steady sliding's least stable mode below 10 kHz"
MODEL_MODE = "the least stable mode of all that are simulated"
LINEAR = {
    "growth_rate": Variable("s-1", f"growth rate of {SLIDING_MODE}", (), "float32", 6),
    "growth_frequency": Variable("Hz", f"frequency of {SLIDING_MODE}", (), "float32", 6),
    "unstable_modes": Variable("1", "number of unstable modes of steady sliding below 10 kHz", (), "int16"),
    "model_growth_rate": Variable("s-1", f"growth rate of {MODEL_MODE}", (), "float32", 6),
    "model_growth_frequency": Variable("Hz", f"frequency of {MODEL_MODE}", (), "float32", 6),
}
# Variables of so many unstable pairs of a scene: the paper's rig has two at mu = 0.2, at most four up to mu = 2.
PAIRS = 8
UNSTABLE_PAIRS = {
    "unstable_modes": LINEAR["unstable_modes"],
    "frequency": Variable("Hz", "frequency of the unstable pair of steady sliding", ("pair",)),
    "growth_rate": Variable("s-1", "growth rate of the unstable pair of steady sliding", ("pair",)),
}
# How an interval ends: its pair becomes stable, leaves the band or oscillates no more; or the range ends.
ENDS = ("pair restabilises", "end of the range")
# Variables of the intervals, window_NAME: field of `fivcore.UnstableWindows`, units and meaning.
INTERVALS = {
    "from": ("theta_from", "degree", "inclination from which a pair is unstable"),
    "to": ("theta_to", "degree", "inclination up to which the pair is unstable"),
    "frequency_from": ("frequency_from", "Hz", "frequency of the pair where the unstable interval begins"),
    "frequency_to": ("frequency_to", "Hz", "frequency of the pair where the unstable interval ends"),
    "open_from": ("open_from", "1", "what the unstable interval begins with"),
    "open_to": ("open_to", "1", "what the unstable interval ends with"),
    "peak_growth_rate": ("peak_growth_rate", "s-1", "largest growth rate of the pair in the unstable interval"),
    "peak_theta": ("peak_theta", "degree", "inclination of the largest growth rate"),
    "peak_frequency": ("peak_frequency", "Hz", "frequency of the pair at its largest growth rate"),
}
MIRRORED = {"from": "to", "to": "from"}


def mode_numbers(rig: Rig | Structure) -> dict[str, Axis]:
    """The numbers of the modes."""
    count = sliding_modes(rig, 0.0, 0.0, BAND).frequency.size
    return {
        "mode": Axis(np.arange(1, ROOM * (count // ROOM + 2) + 1), "1", "mode, by its frequency without friction")
    }


def largest_growth(rig: Any, theta: Any, mu: Any, fmax: float = BAND, **law: Any) -> tuple[Array, Array, Array]:
    """Growth rate and frequency of the least stable mode, and the number of unstable modes, with V > 0.

    `rig` is a Rig, or a Structure, for which theta must be 0. theta, mu and `law` (`sliding_of`) broadcast; only
    modes below `fmax` count. 1/s and Hz, NaN where the band has no mode; a pair of one growing and one decaying
    mode counts once.
    """
    if isinstance(rig, Structure):
        mu, theta = np.broadcast_arrays(mu, theta)[0], 0.0
    falls = "friction" in law and not law["friction"].constant
    modes = sliding_modes(rig, theta, mu, FAR * fmax if falls else fmax, **law)
    inside = np.isfinite(modes.growth_rate) & ((modes.frequency <= fmax) | (not falls))
    growth = np.where(inside, modes.growth_rate, -np.inf)
    if not growth.shape[-1]:
        nothing = np.full(growth.shape[:-1], np.nan)
        return nothing, nothing.copy(), np.zeros(growth.shape[:-1], dtype=int)
    top = growth.argmax(axis=-1)[..., None]
    rate, frequency = (np.take_along_axis(of, top, -1)[..., 0] for of in (modes.growth_rate, modes.frequency))
    rate = np.where(inside.any(axis=-1), rate, np.nan)
    return rate, np.where(np.isnan(rate), np.nan, frequency), np.count_nonzero(modes.unstable & inside, axis=-1)


def growths(rig: Any, theta: Any, mu: Any, **sliding: Any) -> tuple[Array, ...]:
    """`largest_growth` at points with values of `parameters.SLIDING`, together for each law of friction."""
    if np.all(np.equal(sliding["kinetic_ratio"], 1.0)):
        return largest_growth(rig, theta, mu)
    columns = np.broadcast_arrays(theta, mu, *(sliding[name] for name in SLIDING))
    theta, mu, V, F, *laws = (column.ravel() for column in columns)
    groups: dict[Any, list[int]] = {}
    for k, law in enumerate(zip(*(column.tolist() for column in laws), strict=True)):
        groups.setdefault(law, []).append(k)
    found = np.empty((3, len(mu)))
    for law, at in groups.items():
        friction = friction_of(dict(zip(FRICTION, law, strict=True)))
        found[:, at] = largest_growth(rig, theta[at], mu[at], friction=friction, V=V[at], F=F[at])
    return tuple(found.reshape(3, *columns[0].shape))


def first_growth(rig: Any, theta: float, fmax: float, largest: float, **law: Any) -> tuple[float, float]:
    """Lowest mu up to `largest` from which a pair below `fmax` is unstable, and its frequency, Hz; or NaN.

    It is a flutter onset, or the mu at which an unstable pair enters the band from above. `law`: as `sliding_of`.
    """
    return first_of(flutter_onsets(rig, theta, fmax, largest, **law), fmax)


def first_of(found: FlutterOnsets, fmax: float) -> tuple[float, float]:
    """The lowest mu of the onsets and of the pairs that enter the band; see `first_growth`."""
    onsets = zip(found.mu.tolist(), found.frequency.tolist(), strict=True)
    return min((*onsets, *((mu, fmax) for mu in found.entry_mu.tolist())), default=(np.nan, np.nan))


def least_stable(scene: Scene) -> tuple[float, float]:
    """Growth rate (1/s) and frequency (Hz) of the least stable mode of steady sliding below 10 kHz."""
    growth, frequency, _ = largest_growth(scene.rig, scene.drive_theta, scene.mu, **sliding_of(scene))
    return float(growth), float(frequency)


def unstable_pairs(scene: Scene) -> dict[str, Any]:
    """Number of unstable pairs; frequency and growth rate of the least stable ones, ascending in frequency."""
    modes = sliding_modes(scene.rig, scene.drive_theta, scene.mu, BAND, **sliding_of(scene))
    unstable = np.flatnonzero(modes.unstable)
    least_stable = np.argsort(-modes.growth_rate[unstable], kind="stable")[:PAIRS]
    chosen = np.sort(unstable[least_stable])  # modes ascend in frequency
    frequency, growth = np.full((2, PAIRS), np.nan)
    frequency[: len(chosen)], growth[: len(chosen)] = modes.frequency[chosen], modes.growth_rate[chosen]
    return {"unstable_modes": len(unstable), "frequency": frequency, "growth_rate": growth}


def linear_stability(scene: Scene, cutoff: float | None, numerical_damping: str) -> dict[str, Any]:
    """Linear stability of steady sliding, for all modes in the band and for the simulated model.

    The growth rates of the simulated model depend on its numerical damping and its cut-off. A scene that vibrates
    although all its modes are stable is subcritical.
    """
    rate, frequency, unstable = largest_growth(scene.rig, scene.drive_theta, scene.mu, **sliding_of(scene))
    found, model_rate, model_frequency = model_exponents(scene, cutoff, numerical_damping), np.nan, np.nan
    if len(found):
        top = found[np.argmax(found.real)]
        model_rate, model_frequency = float(top.real), abs(float(top.imag)) / (2.0 * np.pi)
    values = {"growth_rate": rate, "growth_frequency": frequency, "unstable_modes": unstable}
    return values | {"model_growth_rate": model_rate, "model_growth_frequency": model_frequency}


def sliding_of(scene: Scene) -> dict[str, Any]:
    """Arguments of `sliding_modes` and `flutter_onsets` for the law of friction of a scene."""
    return {"friction": scene.friction, "V": abs(scene.V), "F": scene.F}


def friction_in(dataset: xr.Dataset) -> Friction:
    """The law of friction of a result that has only one."""
    return friction_of({name: dataset[name].item() for name in FRICTION if name in dataset.coords})


def first_onsets(dataset: xr.Dataset, rig: Any) -> tuple[tuple[Any, ...], Array, Array]:
    """`first_growth` up to the largest mu along theta, and along V and F if they matter: dimensions and values."""
    law, largest = friction_in(dataset), float(dataset["mu"].max())
    alike = law.constant and not np.any(getattr(rig, "gap", None))
    names = ("theta",) if alike else ("theta", "V", "F")
    columns = xr.broadcast(*(dataset[name].reset_coords(drop=True) for name in names))
    points, found = (
        np.stack([column.values.ravel() for column in columns], axis=1),
        np.full((columns[0].size, 2), np.nan),
    )
    for k, (theta, *values) in enumerate(points.tolist() if largest > 0.0 else ()):
        how = {"friction": law, **dict(zip(names[1:], map(abs, values), strict=True))}
        turned = -theta if values and values[0] < 0.0 else theta
        found[k] = first_growth(rig, turned, BAND, largest, **how)
    return columns[0].dims, *found.T.reshape(2, *columns[0].shape)


def with_unstable_intervals(dataset: xr.Dataset, rig: Rig, mu: float, V: float = 1.0) -> xr.Dataset:
    """Add the unstable intervals within the range of theta as `window_*`, ascending in frequency, then theta.

    Where they cannot be computed the result has no intervals, and the `comment` of `window_from` gives the reason.
    """
    theta, comment, law = dataset["theta"].values, "", friction_in(dataset)
    try:
        if not law.constant:
            raise ArithmeticError("friction falls with the speed")
        values = unstable_intervals(rig, mu * law.ratio(V), V, float(theta.min()), float(theta.max()))
    except ArithmeticError as problem:
        values, comment = _none(), str(problem)
    number = np.arange(1, len(values["from"]) + 1)
    dataset = dataset.assign_coords(
        window=("window", number, {"units": "1", "long_name": "number of the unstable interval"})
    ).assign(
        {
            f"window_{name}": ("window", values[name], {"units": units, "long_name": text})
            for name, (_, units, text) in INTERVALS.items()
        }
    )
    if comment:
        dataset["window_from"].attrs["comment"] = comment
    return with_flags(dataset, ENDS, "window_open_from", "window_open_to")


def unstable_intervals(rig: Rig, mu: float, V: float, low: float, high: float) -> dict[str, Array]:
    """The variables of INTERVALS between two inclinations, degrees; a single inclination has none.

    Only the sign of V matters: with V < 0 they are those of -theta. A search that needs too many intervals raises
    `ArithmeticError`.
    """
    if low == high:
        return _none()
    found = fivcore.unstable_windows(rig, mu, *((low, high) if V > 0.0 else (-high, -low)), BAND)
    values = {name: np.asarray(getattr(found, field)) for name, (field, _, _) in INTERVALS.items()}
    if V < 0.0:
        # In the mirror an interval begins where it ended; 0 - theta, for -theta makes -0 of 0.
        values = {name: values["_".join(MIRRORED.get(part, part) for part in name.split("_"))] for name in values}
        values |= {name: 0.0 - values[name] for name in ("from", "to", "peak_theta")}
    order = np.lexsort((values["from"], values["frequency_from"]))
    return {name: value[order].astype(np.int8 if "open" in name else float) for name, value in values.items()}


def _none() -> dict[str, Array]:
    return {name: np.empty(0, np.int8 if "open" in name else float) for name in INTERVALS}


def with_flags(dataset: xr.Dataset, words: tuple[str, ...], *names: str) -> xr.Dataset:
    """Add the meanings of integer codes to derived variables."""
    for name in names:
        attributes = dataset[name].attrs
        attributes.pop("units", None)
        attributes["flag_values"] = np.arange(len(words), dtype=np.int8)
        attributes["flag_meanings"] = " ".join(word.replace(" ", "_") for word in words)
    return dataset


def intervals_summary(dataset: xr.Dataset, mu: float) -> Iterator[Any]:
    """The unstable intervals as a table; a bound with < or > is an end of the range."""
    theta, comment = dataset["theta"].values, dataset["window_from"].attrs.get("comment", "")
    where = f"at mu = {mu:g}, theta from {theta.min():g} to {theta.max():g} degrees"
    if len(theta) == 1:
        yield "A single inclination has no unstable interval; give a range of theta."
    elif comment:
        yield f"Unstable intervals {where} could not be computed: {comment}."
    elif not dataset.sizes["window"]:
        yield f"No pair is unstable {where}."
    else:
        names = [f"window_{name}" for name in INTERVALS if "open" not in name]
        table = labels.frame(dataset, names, along="window")
        table.columns = ["from °", "to °", "from Hz", "to Hz", "largest growth 1/s", "at °", "at Hz"]
        for head, mark in (("from °", "< "), ("to °", "> ")):
            cut = dataset[f"window_open_{head[:-2]}"].values == ENDS.index("end of the range")
            table[head] = np.where(cut, mark, "") + table[head].map(number).to_numpy(dtype=str)
        yield f"Unstable intervals {where}, computed as roots", table
