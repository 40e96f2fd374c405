"""Fig. 5: frequencies of the first ten modes of steady sliding against the coefficient of friction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from fivcore import Rig, flutter_onsets, sliding_modes
from studies import paper
from studies.claims import Claim, beside
from studies.plotting import figures
from studies.rig import rig_of, rig_settings
from studies.spec import evenly
from studies.study import Study, constants
from studies.tables import Part, Table
from sweeps import Axis, Variable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MODES = 10
# The paper's stability analysis ends here, Hz.
BAND = 10e3
# The paper's onsets are the first unstable values on a grid of mu with a step of 0.01.
CLAIMS = tuple(
    Claim(name, {"onset": k}, value, "3.4.2, steps of 0.01" if name == "onset_mu" else "3.4.2")
    for k, onset in enumerate(paper.ONSETS)
    for name, value in zip(("onset_mu", "onset_frequency"), onset, strict=True)
)
VARIABLES = {
    "frequency": Variable("Hz", "frequency of the sliding mode", ("mode",)),
    "growth_rate": Variable("s-1", "growth rate of the sliding mode", ("mode",)),
}


def modes(points: Mapping[str, Any], *, rig: Rig, theta: float, fmax: float) -> dict[str, Any]:
    """Frequency and growth rate of the first modes, NaN where the band holds fewer."""
    modes = sliding_modes(rig, theta, points["mu"], fmax)
    frequency, growth = np.full((2, len(points["mu"]), MODES), np.nan)
    count = min(modes.frequency.shape[1], MODES)
    frequency[:, :count], growth[:, :count] = modes.frequency[:, :count], modes.growth_rate[:, :count]
    return {"frequency": frequency, "growth_rate": growth}


def onsets(rig: Rig, theta: float, fmax: float, largest: float) -> tuple[np.ndarray, np.ndarray]:
    """Friction and frequency of the flutter onsets up to the largest mu, computed as roots and not on the grid."""
    if largest == 0.0:
        return np.empty(0), np.empty(0)
    onsets = flutter_onsets(rig, theta, fmax, largest)
    return onsets.mu, onsets.frequency


def with_onsets(dataset: xr.Dataset, *, rig: Rig, theta: float, fmax: float) -> xr.Dataset:
    """Add the onsets of flutter within the range of mu."""
    mu, frequency = onsets(rig, theta, fmax, float(dataset["mu"].max()))
    return dataset.assign(
        onset_mu=("onset", mu, {"units": "1", "long_name": "coefficient of friction at the flutter onset"}),
        onset_frequency=("onset", frequency, {"units": "Hz", "long_name": "frequency at the flutter onset"}),
    )


def constants_of(settings: Mapping[str, float]) -> dict[str, Any]:
    """The rig, its inclination and the band."""
    rig, theta = rig_of(settings)
    return {"rig": rig, "theta": theta, "fmax": BAND}


def check(axes: Mapping[str, Axis], fixed: Mapping[str, Any]) -> None:
    """Compute both ends of mu and the onsets, which raise ValueError for what cannot be."""
    ends = axes["mu"].values[[0, -1]]
    sliding_modes(fixed["rig"], fixed["theta"], ends, fixed["fmax"])
    onsets(**fixed, largest=float(ends[1]))


def findings(dataset: xr.Dataset) -> list[Part]:
    """Onsets beside the paper's, and what is unstable at the paper's friction."""
    fixed, ends = constants(dataset), dataset["mu"].values[[0, -1]]
    lines: list[Part] = [
        f"Steady sliding, theta = {fixed['theta']:g} degrees, mu from {ends[0]:g} to {ends[1]:g} "
        f"({dataset.sizes['mu']}), modes below {fixed['fmax'] / 1e3:g} kHz.",
        "",
    ]
    if dataset.sizes["onset"]:
        lines.append(
            Table.of(
                dataset, "onset", {"flutter onset at mu": ("onset_mu", ".4f"), "Hz": ("onset_frequency", ".0f")}
            )
        )
    else:
        lines.append("No flutter onset: steady sliding is stable over this range of mu.")
    nearest = dataset.sel(mu=paper.MU, method="nearest")
    growing = nearest.isel(mode=np.flatnonzero(nearest["growth_rate"] > 0.0))
    if growing.sizes["mode"] and abs(float(nearest["mu"]) - paper.MU) < 0.05:
        head = f"unstable mode at mu = {float(nearest['mu']):g}"
        columns = {head: ("mode", "g"), "Hz": ("frequency", ".0f"), "growth 1/s": ("growth_rate", ".0f")}
        lines += ["", Table.of(growing, "mode", columns)]
    return lines + beside(dataset, CLAIMS)


def draw(dataset: xr.Dataset) -> Figure:
    """Branches over mu as in the paper, unstable ones in colour, and their growth rates below."""
    fixed = constants(dataset)
    figure, (top, bottom) = figures.panels(
        2, 1, 15.0, 16.0, sharex=True, gridspec_kw={"height_ratios": (3.0, 1.5)}
    )
    mu, frequency, growth = dataset["mu"], 1e-3 * dataset["frequency"], dataset["growth_rate"]
    marker = "." if len(mu) < 3 else None
    # The decaying partner of an unstable mode has nearly its frequency; the unstable one lies on top.
    unstable: dict[str, Any] = {"color": figures.RED, "linewidth": 2.4, "zorder": 2.5}
    top.plot(mu, frequency.where(~(growth > 0.0)), marker=marker, color=figures.BLACK)
    top.plot(mu, frequency.where(growth > 0.0), marker=marker, **unstable)
    bottom.plot(mu, growth.where(growth > 0.0), marker=marker, color=figures.RED)
    for hertz, rate in zip(dataset["frequency"].values[-1], growth.values[-1], strict=True):
        if rate > 0.0:
            place: dict[str, Any] = {"xytext": (4, 0), "textcoords": "offset points", "va": "center"}
            bottom.annotate(f"{hertz:.0f} Hz", (float(mu[-1]), rate), **place, color=figures.RED, fontsize=8.0)
    top.plot([], [], color=figures.BLACK, label="stable mode")
    top.plot([], [], **unstable, label="unstable mode")
    onset = list(zip(dataset["onset_mu"].values, dataset["onset_frequency"].values, strict=True))
    if onset:
        x, y = np.array(onset).T
        top.plot(x, y / 1e3, "o", color=figures.BLUE, label="flutter onset, model", zorder=3)
    for x, y in onset:
        # Beside the unstable branch there is room below it, and above it near the bottom of the band.
        side, offset = ("top", -6) if y > 0.1 * fixed["fmax"] else ("bottom", 6)
        text = f"μ = {x:.4f}, {y:.0f} Hz"
        top.annotate(text, (x, y / 1e3), (8, offset), textcoords="offset points", va=side, color=figures.BLUE)
    claimed = [each for each in paper.ONSETS if each[0] <= mu.max()]
    if claimed and paper.is_point(dataset, theta=paper.THETA):
        x, y = np.array(claimed).T
        look: dict[str, Any] = {"markersize": 7, "markerfacecolor": "none", "color": figures.ORANGE, "zorder": 4}
        top.plot(x, y / 1e3, "D", label="first unstable μ, paper", **look)
    whose = "" if paper.is_rig(dataset) else " (not the paper's rig)"
    top.set(ylim=(0.0, fixed["fmax"] / 1e3), ylabel="frequency / kHz")
    figures.letter((top, bottom), ("frequency", "growth rate of what is unstable"))
    figures.legend_below(figure, [top], 2)
    figure.suptitle(f"Modes of steady sliding, θ = {fixed['theta']:g}°{whose}")
    bottom.set(ylabel="growth rate / (1/s)", xlabel="coefficient of friction μ")
    bottom.set_ylim(bottom=0.0)
    return figure


STUDY = Study(
    name="fig5",
    title="Fig. 5: modes of steady sliding against friction",
    question="At which coefficient of friction do modes of the sliding beams coalesce and become unstable?",
    paper="Section 3.4.2 and Fig. 5: below 10 kHz and mu = 0.5 three coalescences, first unstable at "
    "mu = 0.12 (2800 Hz), 0.16 (400 Hz) and 0.23 (7700 Hz).",
    axes={"mu": Axis(evenly(0.0, 0.5, 501), "1", "coefficient of friction")},
    settings=rig_settings(),
    function=modes,
    variables=VARIABLES,
    constants=constants_of,
    coords={"mode": Axis(np.arange(1, MODES + 1), "1", "mode, ascending in frequency")},
    check=check,
    derive=with_onsets,
    draw=draw,
    findings=findings,
)
