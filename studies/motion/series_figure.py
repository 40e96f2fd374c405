"""How recorded series are drawn: each over time, and its spectrum once the motion has begun."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from scipy import signal

from studies.motion import recording, transients
from studies.plotting import figures, planes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from studies.study import Study

# Rows of panels; of more series and points some are shown.
MOST = 6
# The start of a run is left out of its spectrum, as a share of it; segments of the spectrum a run.
BEGUN, SEGMENTS = 0.3, 8
HIGHEST = 10e3
LABELS = {
    "velocity_B": ("velocity of B", "mm/s", 1e3),
    "normal_force": ("N", "N", 1.0),
    "tangential_force": ("T", "N", 1.0),
    "slip_velocity": ("slip velocity", "mm/s", 1e3),
}


def names(study: Study, dataset: xr.Dataset) -> list[str]:
    """The series of a result that its study's own figure does not show."""
    recorded = [name for name in recording.SERIES if name in LABELS and name in dataset]
    return [name for name in recorded if name not in study.variables and "elapsed" in dataset[name].dims]


def draw(dataset: xr.Dataset, series: Sequence[str]) -> Figure:
    """A row for each point and series: over time, and its power spectral density."""
    along = [name for name in dataset[series[0]].dims if name != "elapsed"]
    points = dataset.stack(point=along)
    chosen = transients.some(points.sizes["point"], max(1, MOST // len(series)))
    rows = [(points.isel(point=k), name) for k in chosen for name in series][:MOST]
    figure, panels = figures.panels(len(rows), 2, 17.0, 3.0 + 3.6 * len(rows), width_ratios=(2, 1))
    elapsed = dataset["elapsed"].values
    rate = 1.0 / float(elapsed[1] - elapsed[0])
    for (at, name), left, right in zip(rows, panels[::2], panels[1::2], strict=True):
        text, unit, factor = LABELS[name]
        values = factor * at[name].values.astype(float)
        figures.trace(left, elapsed, values, color=figures.BLUE)
        left.set(ylabel=f"{text} / ({unit})" if "/" in unit else f"{text} / {unit}")
        left.set_title(_point(at), loc="left", fontsize=9.0)
        begun = values[int(BEGUN * len(values)) :]
        if np.isfinite(begun).all() and len(begun) >= 2 * SEGMENTS:
            frequency, power = signal.welch(begun, rate, nperseg=2 * len(begun) // SEGMENTS)
            seen = frequency <= min(HIGHEST, 0.5 * rate)
            right.plot(1e-3 * frequency[seen], figures.decibels(power[seen]), color=figures.BLUE, linewidth=0.8)
        right.set(ylabel=f"dB re ({unit})²/Hz")
    panels[-2].set_xlabel("time / s")
    panels[-1].set_xlabel("frequency / kHz")
    figure.suptitle(f"Recorded series{transients.of_all(chosen, points.sizes['point'])}")
    return figure


def _point(at: xr.Dataset) -> str:
    """The point of a row, by the axes that a reader knows."""
    return ", ".join(planes.named(str(name), at[name]) for name in at.coords if str(name) in planes.SYMBOLS)
