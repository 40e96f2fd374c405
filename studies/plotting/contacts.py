"""Who sticks, slips and is open, over time and along the contacts of a structure with several."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from studies.motion.run import STATES
from studies.plotting import figures

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

COLOURS = ("#ffffff", figures.BLUE, figures.ORANGE)
# Samples in a picture of all of a run, and of its end.
WIDE, CLOSE = 1500, 300


def draw(dataset: xr.Dataset) -> Figure:
    """The recorded `contact_state` of the first point, all of it and its end, and shares of time."""
    from matplotlib.colors import ListedColormap

    point = dataset.isel({dim: 0 for dim in dataset["status"].dims})
    state, elapsed = point["contact_state"].transpose("contact", "elapsed").values, point["elapsed"].values
    figure, (whole, close, shares) = figures.panels(1, 3, 27.0, 7.5)
    every = max(len(elapsed) // WIDE, 1)
    for axes, part in ((whole, slice(None, None, every)), (close, slice(-CLOSE, None))):
        time, seen = 1e3 * elapsed[part], state[:, part]
        edges = np.append(time, 2.0 * time[-1] - time[-2]) if len(time) > 1 else np.array([0.0, 1.0])
        rows = np.arange(len(seen) + 1) - 0.5
        axes.pcolormesh(edges, rows, seen, cmap=ListedColormap(COLOURS), vmin=-0.5, vmax=2.5, rasterized=True)
        axes.set(xlabel="time / ms", ylabel="contact", yticks=np.arange(len(seen)))
        axes.locator_params(axis="x", nbins=5)
        axes.grid(visible=False)
    left = np.zeros(len(state))
    for name, colour in zip(STATES, COLOURS, strict=True):
        share = point[f"contact_{name}_fraction"].values
        shares.barh(np.arange(len(state)), share, left=left, color=colour, edgecolor=figures.GREY, label=name)
        left = left + share
    shares.set(xlabel="share of time", xlim=(0.0, 1.0), yticks=np.arange(len(state)))
    figures.letter((whole, close, shares), ("all of the run", "its end", "shares of time"))
    figures.legend_below(figure, [shares])
    return figure
