"""Regimes of the motion: the regime of each point of a result, and the regimes that count as vibration."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fivcore import Rig, glued_frequencies
from studies.declaring import labels
from studies.declaring.parameters import RIG
from studies.motion.run import REGIMES
from studies.motion.series import decibels, peak_near, runs_of_true
from sweeps import DONE, FAILED

# What a point of a result can be: in a regime, or without one.
KINDS = (*REGIMES, "failed", "pending")
VIBRATING = ("intermittent", "periodic", "irregular")
STEADY = "steady sliding"
# What the paper calls a periodic steady state: vibration without long sticks.
WITHOUT_STICKS = ("periodic", "irregular")
# A peak within this share of a multiple of the dominant frequency is its harmonic; the median within this share of
# the main line's frequency is its foot.
HARMONIC, FOOT = 0.01, 0.25
HARMONICS = "peak of the spectrum within 1 % of a multiple of the dominant frequency"
HEIGHT = "main line of the spectrum over the median within 25 % of its frequency, dB"


def kinds(dataset: xr.Dataset) -> NDArray[np.intp]:
    """The index in KINDS of each point."""
    status, regime = dataset["status"].values, dataset["regime"].values.astype(float)
    done = (status == DONE) & np.isfinite(regime)
    other = np.where(status == FAILED, KINDS.index("failed"), KINDS.index("pending"))
    return np.where(done, regime, other).astype(np.intp)


def kind(point: xr.Dataset) -> str:
    """The regime of one point in words."""
    return KINDS[int(kinds(point))]


def is_of(codes: Any, *names: str) -> NDArray[np.bool_]:
    """Mark the points in one of the regimes called `names`; `codes` are indices in REGIMES or KINDS."""
    return np.isin(codes, [KINDS.index(name) for name in names])


def dominant_frequency(dataset: xr.Dataset) -> xr.DataArray:
    """Dominant frequency, Hz; NaN for points that do not vibrate, which only show a decaying vibration."""
    frequency: xr.DataArray = dataset["dominant_frequency"]
    return frequency.where(is_of(dataset["regime"].values, *VIBRATING))


def span(dataset: xr.Dataset, chosen: xr.DataArray, name: str) -> str:
    """The least and the greatest value of a parameter at the chosen points, in a reader's unit: "1 to 5"."""
    values = labels.readable(dataset[name]).values[chosen.any([dim for dim in chosen.dims if dim != name]).values]
    return " to ".join(dict.fromkeys(map(labels.number, (values.min(), values.max())))) if len(values) else "-"


def ranges(values: NDArray[Any], chosen: NDArray[np.bool_]) -> str:
    """The chosen inclinations as ranges of neighbours: "-10 to 0.5, 11 to 20 degrees"."""
    texts = [" to ".join(f"{x:g}" for x in np.unique(values[[a, b - 1]])) for a, b in runs_of_true(chosen)]
    return f"{', '.join(texts)} degrees" if texts else "no inclination"


def damping_text(dataset: xr.Dataset) -> str:
    """The damping of a result in words: d1 and d2 where the paper has others, and the numerical damping."""
    own = [name for name in ("d1", "d2") if name in dataset.coords and not dataset[name].ndim]
    changed = [labels.named(name, dataset[name]) for name in own if dataset[name] != RIG[name].default]
    published = "numerical_damping" in dataset.coords and str(dataset["numerical_damping"].values) == "published"
    numerical = f"{'with' if published else 'without'} the published scheme's numerical damping"
    return ", ".join([*changed, numerical])


def lines_of(dataset: xr.Dataset) -> dict[str, Any]:
    """Harmonics and the height of the main line at each V: dimensions, values, units and text."""
    points = [dataset.isel(V=k) for k in range(dataset.sizes["V"])]
    return {
        "harmonic": ("harmonic", [2, 3], "1", "order of the harmonic"),
        "harmonic_frequency": (("V", "harmonic"), [*map(harmonics, points)], "Hz", HARMONICS),
        "line_height_dB": ("V", [*map(line_height, points)], "1", HEIGHT),
    }


def glued_modes(rig: Rig, theta: float) -> dict[str, Any]:
    """The natural frequencies of the rig glued at its contact."""
    # Each element has three freedoms, one of P1 is held at A and two are glued.
    frequency = glued_frequencies(rig, theta, min(8, 3 * (rig.p1.elements + rig.p2.elements) - 1))
    text = "of the rig glued at its contact"
    return {
        "glued_mode": ("glued_mode", np.arange(1, len(frequency) + 1), "1", f"mode {text}"),
        "glued_frequency": ("glued_mode", frequency, "Hz", f"natural frequency {text}"),
    }


def line_height(point: xr.Dataset) -> float:
    """Height of the highest spectral line above the level around it, dB; NaN without vibration."""
    main, frequency = float(dominant_frequency(point)), point["frequency"].values
    near = point["spectrum_vibrating"].values[np.abs(frequency - main) <= FOOT * main]
    return float(np.ptp(decibels([near.max(), np.median(near)]))) if near.size else np.nan


def harmonics(point: xr.Dataset) -> list[float]:
    """The second and the third harmonic of the dominant frequency, Hz."""
    main, spectrum = float(dominant_frequency(point)), point["spectrum_vibrating"].values
    return [peak_near(point["frequency"].values, spectrum, order * main, HARMONIC) for order in (2, 3)]
