"""Figures of modes over friction; `modes_figure` draws results of `fivcore.assembled_modes`."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from studies.motion.run import BAND
from studies.plotting import figures
from sweeps import InputError

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fivcore import AssembledModes, FollowedModes

# Half the longest step of lambda along a branch, by the largest lambda.
JUMP = 0.1
# Markers of the first onsets, and of all further ones.
MARKERS = "os^vpP."
NAMED = len(MARKERS) - 1
STABLE: Any = {"color": figures.BLACK, "label": "stable mode"}
# The decaying partner of an unstable mode has nearly its frequency; the unstable one lies on top.
UNSTABLE: Any = STABLE | {"color": figures.RED, "label": "unstable mode", "linewidth": 2.4, "zorder": 2.5}


def modes_figure(
    modes: AssembledModes | FollowedModes, onsets: Any = (), parameter: str = "coefficient of friction μ"
) -> Figure:
    """Draw frequencies and growth rates of `modes` over two or more values of what `parameter` names.

    `onsets`, as `fivcore.assembled_onsets` returns them, are marked. Curves are the modes that
    `fivcore.modes_along` has followed; of `fivcore.assembled_modes` those whose eigenvalues are nearest at
    neighbouring values of mu are linked. The figure's method `savefig` writes it to a file.
    """
    name = "values" if hasattr(modes, "values") else "mu"
    given = getattr(modes, name)
    if given.ndim != 1 or len(given) < 2:
        raise InputError(f"modes.{name} of shape {given.shape}: it must be (n,), with n of at least 2")
    order = np.argsort(given)
    mu, lam = given[order], (modes.growth_rate + 2j * np.pi * modes.frequency)[order]
    most, reach = (float(np.nanmax(each, initial=0.0)) for each in (lam.real, JUMP * abs(lam)))
    # Empty columns let a branch end, and another begin, at the cost of `reach` each.
    lam = np.pad(lam, ((0, 0), (0, lam.shape[1])), constant_values=complex(np.nan, np.nan))
    for one, other in pairwise(lam) if name == "mu" else ():
        cost, gone = abs(one[:, None] - other), np.isnan(one)[:, None] & np.isnan(other)
        other[:] = other[linear_sum_assignment(np.where(gone, 0.0, np.nan_to_num(cost, nan=reach)))[1]]
    frequency, growth = lam.imag / (2.0 * np.pi), lam.real
    with figures.style():
        figure, (top, bottom) = figures.panels(2, 1, 8.5, 5.5, sharex=True)
        bottom.plot(mu, growth, **STABLE)
        draw_branches(top, bottom, mu, frequency, growth)
        top.set(ylim=(0.0, 1.05 * np.nanmax(frequency, initial=1e-9)), ylabel="frequency / Hz")
        bottom.set(xlabel=parameter, xlim=mu[[0, -1]], ylabel="growth rate / (1/s)")
        if most:
            bottom.set_ylim(-most, 1.1 * most)
        bottom.axhline(0.0, color=figures.GREY, linewidth=0.8)
        mark_onsets(top, *(onsets or ((), ())))
        name_growing(bottom, mu[-1], frequency[-1], growth[-1])
        figures.entitle((top, bottom), ("frequency", "growth rate"))
        figures.legend_below(figure, [top], 3)
        figures.finish(figure)
    return figure


def draw_result(top: Axes, bottom: Axes, dataset: xr.Dataset) -> None:
    """Draw branches in kHz and growth rates of a result over mu, with its onsets, recoveries and divergence."""
    mu, frequency, growth = (dataset[name].values for name in ("mu", "frequency", "growth_rate"))
    draw_branches(top, bottom, mu, frequency, growth, 1e3, "." if len(mu) < 3 else None)
    name_growing(bottom, mu[-1], frequency[-1], growth[-1])
    top.set(ylim=(0.0, min(1e-3 * BAND, max(0.1, 1.3e-3 * np.nanmax(frequency, initial=0.0)))))
    mark_onsets(top, dataset["onset_mu"].values, dataset["onset_frequency"].values, 1e3)
    mark_recoveries(top, dataset["recovery_mu"].values, 1e-3 * dataset["recovery_frequency"].values)
    mark_divergence((top, bottom), float(dataset["divergence_mu"]))


def draw_branches(
    top: Axes, bottom: Axes, mu: Any, frequency: Any, growth: Any, unit: float = 1.0, marker: str | None = None
) -> None:
    """Draw frequencies, in `unit` Hz, and growth rates over mu, unstable modes in colour."""
    grows = growth > 0.0
    top.plot(mu, frequency / unit, marker=marker, **STABLE)
    top.plot(mu, np.where(grows, frequency / unit, np.nan), marker=marker, **UNSTABLE)
    bottom.plot(mu, np.where(grows, growth, np.nan), marker=marker, **UNSTABLE)
    # A line of one point is invisible.
    beside = np.pad(grows, ((1, 1), (0, 0)))
    alone = grows & ~beside[:-2] & ~beside[2:]
    for axes, values in ((top, frequency / unit), (bottom, growth)) if alone.any() else ():
        axes.plot(mu, np.where(alone, values, np.nan), ".", **UNSTABLE)


def name_growing(axes: Axes, mu: float, hertz: Any, rates: Any) -> None:
    """Write the frequency of each unstable mode at the end of its branch, if there is room."""
    pixels = figures.points("font.size") / 72.0 * axes.figure.dpi
    last, apart = np.inf, pixels / axes.get_window_extent().height * float(np.ptp(axes.get_ylim()))
    place: dict[str, Any] = {"xytext": (4, 0), "textcoords": "offset points", "va": "center"}
    for rate, each in sorted(((r, f) for r, f in zip(rates, hertz, strict=True) if r > 0.0), reverse=True):
        if last - rate >= apart:
            axes.annotate(_hertz(each), (mu, last := rate), **place, color=figures.RED)


def mark_onsets(axes: Axes, mu: Any, hertz: Any, unit: float = 1.0) -> None:
    """Mark flutter onsets, in Hz, on an axis of frequency in `unit` Hz."""
    for k, (at, each) in enumerate(zip(mu, hertz, strict=True)):
        # In words below, where they hide no branch.
        text = f"flutter onset at μ = {at:.4f}, {_hertz(each)}" if k < NAMED else "further flutter onsets"
        marker = MARKERS[min(k, NAMED)]
        axes.plot(at, each / unit, marker, color=figures.BLUE, markersize=5.0, label=text, zorder=3)


def mark_recoveries(axes: Axes, mu: Any, hertz: Any) -> None:
    """Mark recoveries, on an axis of frequency in the unit of `hertz`."""
    if len(mu):
        look: Any = {"markerfacecolor": "white", "color": figures.BLUE, "zorder": 3}
        axes.plot(mu, hertz, "o", label="recovery", **look)


def mark_divergence(panels: Iterable[Axes], mu: float) -> None:
    """Mark the friction at which motion begins to grow without oscillation; nothing if `mu` is NaN."""
    for k, axes in enumerate(panels if np.isfinite(mu) else ()):
        label = "" if k else f"divergence from μ = {mu:.4f}"
        axes.axvline(mu, color=figures.GREEN, linestyle="--", label=label or None)


def _hertz(frequency: float) -> str:
    return f"{frequency:.0f} Hz" if frequency >= 100.0 else f"{frequency:.4g} Hz"
