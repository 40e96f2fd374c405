"""Lines of spectra: harmonics of the dominant frequency, the height of the main line, and glued modes."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from fivcore import Rig, glued_frequencies
from studies.motion import regimes, series

# A peak within this share of a multiple of the dominant frequency is its harmonic; the median within this share of
# the main line's frequency is its foot.
HARMONIC, FOOT = 0.01, 0.25
HARMONICS = "peak of the spectrum within 1 % of a multiple of the dominant frequency"
HEIGHT = "main line of the spectrum over the median within 25 % of its frequency, dB"


def of_points(dataset: xr.Dataset) -> dict[str, Any]:
    """Harmonics and the height of the main line at each V: dimensions, values, units and text."""
    points = [dataset.isel(V=k) for k in range(dataset.sizes["V"])]
    return {
        "harmonic": ("harmonic", [2, 3], "1", "order of the harmonic"),
        "harmonic_frequency": (("V", "harmonic"), [*map(harmonics, points)], "Hz", HARMONICS),
        "line_height_dB": ("V", [*map(line_height, points)], "1", HEIGHT),
    }


def glued(rig: Rig, theta: float) -> dict[str, Any]:
    """The natural frequencies of the rig glued at its contact."""
    # Each element has three freedoms, one of P1 is held at A and two are glued.
    frequency = glued_frequencies(rig, theta, min(8, 3 * (rig.p1.elements + rig.p2.elements) - 1))
    return {
        "glued_frequency": ("glued_mode", frequency, "Hz", "natural frequency of the rig glued at its contact")
    }


def line_height(point: xr.Dataset) -> float:
    """Height of the main line over its foot, dB: how sharp it is; NaN without vibration."""
    main, frequency = float(regimes.dominant_frequency(point)), point["frequency"].values
    near = point["spectrum_vibrating"].values[np.abs(frequency - main) <= FOOT * main]
    return float(np.ptp(series.decibels([near.max(), np.median(near)]))) if near.size else np.nan


def harmonics(point: xr.Dataset) -> list[float]:
    """The second and the third harmonic of the dominant frequency, Hz."""
    main, spectrum = float(regimes.dominant_frequency(point)), point["spectrum_vibrating"].values
    return [series.peak_near(point["frequency"].values, spectrum, order * main, HARMONIC) for order in (2, 3)]
