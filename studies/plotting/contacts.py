"""Figure of the state of several contacts, over time and along the contacts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from studies.declaring import labels
from studies.motion.run import STATES
from studies.plotting import figures, planes
from sweeps import DONE

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

# As in other figures: separation, stick, slip.
COLOURS = tuple(planes.STATE_COLOURS[name] for name in STATES)
# Columns in a picture of all of a run, samples in one of its end; contacts that are all numbered.
WIDE, CLOSE, NUMBERED = 1500, 300, 12


def draw(dataset: xr.Dataset) -> Figure:
    """Draw the recorded `contact_state` of the first computed point, whole and at its end, and fractions of time.

    The colour of a pixel column is the mean over its samples, so that short states remain visible.
    """
    from matplotlib.colors import to_rgb
    from matplotlib.ticker import MaxNLocator

    status = dataset["status"]
    first = np.unravel_index(np.argmax(status.values == DONE), status.shape)
    point = dataset.isel(dict(zip(status.dims, first, strict=True)))
    state, elapsed = point["contact_state"].transpose("contact", "elapsed").values, point["elapsed"].values
    figure, (whole, close, shares) = figures.panels(1, 3, 6.0, sharey=True)
    colours = np.array([to_rgb(colour) for colour in COLOURS])[np.clip(state, 0, len(COLOURS) - 1).astype(int)]
    step = elapsed[1] - elapsed[0] if len(elapsed) > 1 else 1.0
    for axes, begin in ((whole, 0), (close, max(len(elapsed) - CLOSE, 0))):
        starts = np.unique(np.linspace(begin, len(elapsed), WIDE + 1).astype(int)[:-1])
        counts = np.diff(starts, append=len(elapsed))
        mixed = np.add.reduceat(colours, starts, axis=1) / counts[:, None]
        edges = 1e3 * np.append(elapsed[starts], elapsed[-1] + step)
        axes.pcolormesh(edges, np.arange(len(state) + 1) - 0.5, mixed, rasterized=True)
        axes.set(xlabel="time / ms", xlim=(edges[0], edges[-1]))
        axes.locator_params(axis="x", nbins=5)
        axes.grid(visible=False)
    left = np.zeros(len(state))
    for name, colour in zip(STATES, COLOURS, strict=True):
        share = point[f"contact_{name}_fraction"].values
        shares.barh(np.arange(len(state)), share, left=left, color=colour, edgecolor=figures.GREY, label=name)
        left = left + share
    shares.set(xlabel="fraction of time", xlim=(0.0, 1.0))
    whole.set(ylabel="contact", ylim=(-0.5, len(state) - 0.5))
    whole.yaxis.set_major_locator(MaxNLocator(NUMBERED, integer=True))
    figures.entitle((whole, close, shares), ("all of the run", "its end", "fractions of time"))
    figures.legend_below(figure, [shares])
    place = ", ".join(labels.named(str(dim), point[dim]) for dim in status.dims)
    more = f"; one of {status.size} points" if status.size > 1 else ""
    figure.suptitle(f"Contacts at {place}{more}")
    return figure
