"""Figure of two rigs over friction: frequencies, growth rates and onsets, with a colour for each rig."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.plotting import figures

if TYPE_CHECKING:
    import xarray as xr

# Line and marker of each rig: told apart in grey too.
LOOKS: Any = (
    {"color": figures.BLUE, "linestyle": "-", "marker": "o"},
    {"color": figures.ORANGE, "linestyle": (0, (4, 1.5)), "marker": "s"},
)
THIN, THICK = 0.7, 2.2


def draw(pair: Mapping[str, xr.Dataset], note: str) -> figures.Figure:
    """Draw results of study fig5 by the names of their rigs, with a `note` on the settings below."""
    figure, (top, bottom) = figures.panels(2, 1, 8.5, 5.5, sharex=True)
    for (name, data), look in zip(pair.items(), LOOKS, strict=True):
        line = {key: value for key, value in look.items() if key != "marker"}
        mu, frequency, growth = (data[each].values for each in ("mu", "frequency", "growth_rate"))
        grows = growth > 0.0
        top.plot(mu, 1e-3 * frequency, **line, linewidth=THIN, label=_once(name, frequency))
        unstable, label = np.where(grows, 1e-3 * frequency, np.nan), f"{name}, unstable" if grows.any() else "_"
        top.plot(mu, unstable, **line, linewidth=THICK, label=_once(label, frequency))
        bottom.plot(mu, np.where(grows, growth, np.nan), **line, linewidth=1.4)
        point: Any = {"linestyle": "none", "markersize": 5.0, "zorder": 3, "marker": look["marker"]}
        point |= {"color": look["color"], "markeredgecolor": figures.BLACK, "markeredgewidth": 0.6}
        if data.sizes["onset"]:
            top.plot(data["onset_mu"], 1e-3 * data["onset_frequency"], **point, label=f"{name}, onset")
            bottom.plot(data["onset_mu"], 0.0 * data["onset_mu"], **point, clip_on=False)
        if np.isfinite(jams := float(data["divergence_mu"])):
            dotted: Any = {"color": look["color"], "linestyle": ":"}
            top.axvline(jams, **dotted, label=f"{name} jams")
            bottom.axvline(jams, **dotted)
    ends = [data["mu"].values[[0, -1]] for data in pair.values()]
    top.set(ylim=(0.0, None), xlim=(min(end[0] for end in ends), max(end[1] for end in ends)))
    top.set(ylabel="frequency / kHz")
    bottom.set(xlabel="coefficient of friction μ", ylabel="growth rate / (1/s)", ylim=(0.0, None))
    figures.entitle((top, bottom), ("frequency", "growth rate of unstable modes"))
    figures.legend_below(figure, [top], 3)
    figure.suptitle(f"Steady sliding of the rigs {' and '.join(pair)}")
    return figures.finish(figure, note)


def _once(label: str, curves: Any) -> list[str]:
    """A label for the first of several curves."""
    return [label, *["_"] * (curves.shape[1] - 1)]
