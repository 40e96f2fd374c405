"""Figures over the inclination: unstable intervals, regimes of realisations, and the paper's points and text."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from studies import paper
from studies.declaring import labels, spec
from studies.motion import regimes
from studies.physics.onsets import BRANCHES
from studies.plotting import figures, planes

# The paper's statements on frequencies, by inclination, and their markers.
PAPER: dict[str, tuple[Any, str]] = {
    "dominant, measured": (paper.ANGLES_MEASURED, "D"),
    "dominant, simulated": (paper.ANGLES_SIMULATED, "x"),
    "unstable pair": (paper.ANGLES_UNSTABLE, "^"),
}
# Frequencies further apart than by this factor lie in bands of their own; panels for them.
APART, MOST = 1.5, 3
STYLES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (1.3, 1.3)), (0, (6, 1.5, 1.3, 1.5)))


def points(axes: figures.Axes, array: xr.DataArray, label: str, **look: Any) -> None:
    """Markers over the inclination, with a label in the legend if a value is finite."""
    x, y = xr.broadcast(array["theta"], array)
    options: dict[str, Any] = {"linestyle": "", "marker": "o", "color": figures.BLACK, "markersize": 3.0} | look
    figures.curve(axes, np.ravel(x), np.ravel(y), label=label, **options)


def bands(frequencies: Any) -> list[tuple[float, float]]:
    """Ends of the bands, far apart, in which frequencies lie, the highest first; of too many the whole range."""
    known = np.unique(np.asarray(frequencies)[np.isfinite(frequencies)])
    parts = np.split(known, np.flatnonzero(known[1:] > APART * known[:-1]) + 1) if len(known) else []
    parts = parts if len(parts) <= MOST else [known]
    return [(0.95 * part[0], 1.05 * part[-1]) for part in reversed(parts)] or [(0.0, 10.0)]


def paper_frequencies(axes: figures.Axes, theta: Any) -> None:
    """The frequencies in the paper's text, in kHz."""
    look: dict[str, Any] = {"markerfacecolor": "none", "color": figures.RED, "zorder": 4.0}
    # Each within the one before, for many lie on one spot.
    for (text, (of, marker)), size in zip(PAPER.items(), (10.0, 4.5, 7.0), strict=True):
        places = [(x, 1e-3 * f) for x in of if x in theta for f in np.ravel(of[x])]
        if places:
            axes.plot(*zip(*places, strict=True), marker, markersize=size, label=f"paper: {text}", **look)


def regime_strips(axes: figures.Axes, dataset: xr.Dataset, papers: bool) -> None:
    """Fractions of the regimes among realisations, with unstable intervals above and the paper's text below."""
    theta = dataset["theta"].values
    ends, kinds = spec.edges(theta), regimes.kinds(dataset)[:, None]
    codes = np.where(kinds < planes.FAILED, dataset["member_regime"].values, kinds).astype(int)
    shares = {regimes.KINDS[code]: 0.8 * (codes == code).mean(axis=1) for code in np.unique(codes)}
    planes.stack(axes, ends, shares, [planes.COLOURS[code] for code in np.unique(codes)])
    if papers:
        steady = np.any([(low < theta) & (theta < high) for low, high in paper.STEADY_ANGLES], axis=0)
        bars: dict[str, Any] = {"base": -1.0, "linewidth": 0.0, "edgecolor": figures.GREY}
        colour = planes.COLOURS[regimes.KINDS.index(regimes.STEADY)]
        planes.stack(axes, ends, {"": 0.8 * steady}, [colour], **bars, label=None)
        vibrates = 0.8 * np.isin(theta, [*paper.ANGLES_MEASURED])
        planes.stack(axes, ends, {"paper: vibrates": vibrates}, ["white"], **bars, hatch="//////")
    windows = dataset[["window_from", "window_to", "window_peak_frequency"]].to_array().values.T
    for k, (low, high, hertz) in enumerate(windows):
        less, more = "< " * bool(low <= theta[0]), "> " * bool(high >= theta[-1])
        text = f"unstable, {less}{low:.2f}° to {more}{high:.2f}°, {hertz:.0f} Hz"
        look: dict[str, Any] = {
            "color": "white",
            "edgecolor": figures.COLOURS[k % len(figures.COLOURS)],
            "linewidth": 1.4,
        }
        axes.barh(1.25 + 0.5 * k, high - low, 0.36, left=low, **look, label=text)
    top = 1.0 + 0.5 * max(len(windows), 1)
    axes.set_yticks([-0.6, 0.4, 0.5 * (1.0 + top)], ["paper's text", "realisations", "unstable"])
    axes.grid(False)
    axes.set_xlabel(labels.label(dataset["theta"]))
    axes.axis((ends[0], ends[-1], -1.1 if papers else -0.1, top))


def onset_branches(axes: figures.Axes, dataset: xr.Dataset) -> None:
    """Branches of onsets and of recoveries, up to their ends."""
    from matplotlib.patheffects import withStroke

    number, count = dataset["trace_branch"].values, 0
    for (dim, (kind, _)), colour in zip(BRANCHES.items(), (figures.BLACK, figures.RED), strict=True):
        for k, frequency in enumerate(dataset[f"{dim}_lowest_frequency"].values):
            chosen, count = np.flatnonzero(number == count), count + 1
            look: dict[str, Any] = {"color": colour, "linestyle": STYLES[k % len(STYLES)], "linewidth": 1.4}
            look |= {"marker": "." if len(chosen) == 1 else "", "label": f"{kind}, {frequency:.0f} Hz"}
            places = dataset["trace_theta"].values[chosen], dataset["trace_mu"].values[chosen]
            axes.plot(*places, path_effects=[withStroke(linewidth=2.8, foreground="white")], **look)


def paper_plane(axes: figures.Axes) -> None:
    """The paper's onsets, and the inclinations at its friction at which the rig vibrates or slides steadily."""
    slides = [(theta, paper.MU) for theta, frequency in paper.ANGLES.items() if np.isnan(frequency)]
    planes.marks(axes, [(paper.THETA, mu) for mu, _ in paper.ONSETS], **planes.PAPER["first unstable μ"])
    planes.marks(
        axes, [(theta, paper.MU) for theta in sorted(paper.ANGLES_MEASURED)], **planes.PAPER["vibrates (measured)"]
    )
    planes.marks(axes, slides, **planes.PAPER["slides steadily (measured)"])
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    for ends in np.clip(paper.STEADY_ANGLES, left, right):
        if ends[0] < ends[1] and low <= paper.MU <= high:
            axes.plot(ends, [paper.MU] * 2, color=figures.BLUE, linewidth=2.0, zorder=3.5)
