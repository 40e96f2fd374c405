"""Fig. 5: frequencies of the first ten modes of steady sliding against the coefficient of friction."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from fivcore import Rig, flutter_onsets, sliding_modes
from studies import paper
from studies.plotting import figures
from studies.rig import rig_of, rig_settings
from studies.spec import evenly
from studies.study import Study, constants
from studies.tables import Part, Table
from sweeps import Axis, Grid, Sweep, Variable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MODES = 10
BAND = 10e3


def modes(points: Mapping[str, Any], *, rig: Rig, theta: float, fmax: float) -> dict[str, Any]:
    """Frequency and growth rate of the first modes, NaN where the band holds fewer."""
    found = sliding_modes(rig, theta, points["mu"], fmax)
    frequency, growth = np.full((2, len(points["mu"]), MODES), np.nan)
    kept = min(found.frequency.shape[1], MODES)
    frequency[:, :kept], growth[:, :kept] = found.frequency[:, :kept], found.growth_rate[:, :kept]
    return {"frequency": frequency, "growth_rate": growth}


def onsets(rig: Rig, theta: float, fmax: float, largest: float) -> tuple[np.ndarray, np.ndarray]:
    """Friction and frequency of the flutter onsets up to the largest mu, found as roots and not on the grid."""
    if largest == 0.0:
        return np.empty(0), np.empty(0)
    found = flutter_onsets(rig, theta, fmax, largest)
    return found.mu, found.frequency


def with_onsets(dataset: xr.Dataset, *, rig: Rig, theta: float, fmax: float) -> xr.Dataset:
    """Add the onsets of flutter within the range of mu."""
    mu, frequency = onsets(rig, theta, fmax, float(dataset["mu"].max()))
    return dataset.assign(
        onset_mu=("onset", mu, {"units": "1", "long_name": "coefficient of friction at the flutter onset"}),
        onset_frequency=("onset", frequency, {"units": "Hz", "long_name": "frequency at the flutter onset"}),
    )


def build(axes: Mapping[str, Axis], settings: Mapping[str, float]) -> Sweep:
    """The sweep over mu; what cannot be computed is found out here, before anything is planned."""
    rig, theta = rig_of(settings)
    fixed: dict[str, Any] = {"rig": rig, "theta": theta, "fmax": BAND}
    for end in (axes["mu"].values.min(), axes["mu"].values.max()):
        sliding_modes(rig, theta, end, BAND)
    onsets(rig, theta, BAND, float(axes["mu"].values.max()))
    return Sweep(
        "fig5",
        modes,
        Grid(axes),
        {
            "frequency": Variable("Hz", "frequency of the sliding mode", ("mode",)),
            "growth_rate": Variable("s-1", "growth rate of the sliding mode", ("mode",)),
        },
        fixed,
        coords={"mode": Axis(np.arange(1, MODES + 1), "1", "mode, ascending in frequency")},
        title="Modes of steady sliding against friction (Fig. 5)",
        derive=partial(with_onsets, **fixed),
    )


def findings(dataset: xr.Dataset) -> list[Part]:
    """Onsets beside the paper's, and what is unstable at the paper's friction."""
    given = constants(dataset)
    lines: list[Part] = [
        f"Steady sliding, theta = {given['theta']:g} degrees, mu from {float(dataset['mu'].min()):g} to "
        f"{float(dataset['mu'].max()):g} ({dataset.sizes['mu']}), modes below {given['fmax'] / 1e3:g} kHz.",
        "",
    ]
    beside = _paper_onsets(dataset) if paper.is_point(dataset, theta=paper.THETA) else {}
    heading = "paper: first unstable mu on a grid of 0.01" if beside else ""
    found = list(zip(dataset["onset_mu"].values, dataset["onset_frequency"].values, strict=True))
    rows = [
        [
            f"{k + 1}",
            f"{mu:.4f}",
            f"{frequency:.0f}",
            f"{beside[k][0]:.2f}, near {beside[k][1]:.0f} Hz" if k in beside else "",
        ]
        for k, (mu, frequency) in enumerate(found)
    ]
    lines.append(Table(["flutter onset", "mu", "Hz", heading], rows, form="{:>13} {:>8} {:>7}   {}"))
    if not found:
        lines.append("none: steady sliding is stable over this range of mu")
    nearest = dataset.sel(mu=paper.MU, method="nearest")
    growing = nearest["growth_rate"].values > 0.0
    if np.any(growing) and abs(float(nearest["mu"]) - paper.MU) < 0.05:
        pairs = ", ".join(
            f"{f:.0f} Hz (growth {g:.0f} 1/s)"
            for f, g in zip(
                nearest["frequency"].values[growing], nearest["growth_rate"].values[growing], strict=True
            )
        )
        lines += ["", f"Unstable at mu = {float(nearest['mu']):g}: {pairs}."]
    return lines


def draw(dataset: xr.Dataset) -> Figure:
    """Branches over mu as in the paper, unstable ones in colour, and their growth rates below."""
    figure, (top, bottom) = figures.panels(
        2, 1, 15.0, 16.0, sharex=True, gridspec_kw={"height_ratios": (3.0, 1.2)}
    )
    mu = dataset["mu"].values
    frequency, growth = dataset["frequency"].values, dataset["growth_rate"].values
    marker = "." if len(mu) < 3 else None
    for k in range(frequency.shape[1]):
        unstable = growth[:, k] > 0.0
        stable_line = np.where(unstable, np.nan, frequency[:, k])
        top.plot(mu, stable_line / 1e3, marker=marker, color=figures.BLACK)
        # The decaying partner of an unstable mode has nearly its frequency; the unstable one lies on top.
        unstable_line = np.where(unstable, frequency[:, k], np.nan)
        top.plot(mu, unstable_line / 1e3, marker=marker, color=figures.RED, linewidth=2.4, zorder=2.5)
        bottom.plot(mu, np.where(unstable, growth[:, k], np.nan), marker=marker, color=figures.RED)
    top.plot([], [], color=figures.BLACK, label="stable mode")
    top.plot([], [], color=figures.RED, linewidth=2.4, label="unstable mode")

    onset_mu, onset_frequency = dataset["onset_mu"].values, dataset["onset_frequency"].values
    if len(onset_mu):
        top.plot(onset_mu, onset_frequency / 1e3, "o", color=figures.BLUE, label="flutter onset, model", zorder=3)
    for x, y in zip(onset_mu, onset_frequency, strict=True):
        # Beside the unstable branch there is room below it, and above it near the bottom of the band.
        below = y > 0.1 * constants(dataset)["fmax"]
        top.annotate(
            f"μ = {x:.4f}, {y:.0f} Hz",
            (x, y / 1e3),
            (8, -6 if below else 6),
            textcoords="offset points",
            va="top" if below else "bottom",
            color=figures.BLUE,
        )
    if paper.is_point(dataset, theta=paper.THETA):
        there = [onset for onset in paper.ONSETS if onset[0] <= mu.max()]
        if there:
            x, y = np.array(there).T
            top.plot(
                x,
                y / 1e3,
                "D",
                markersize=7,
                markerfacecolor="none",
                color=figures.ORANGE,
                zorder=4,
                label="first unstable μ, paper",
            )
    given = constants(dataset)
    top.set_ylim(0.0, given["fmax"] / 1e3)
    top.set_ylabel("frequency / kHz")
    whose = "" if paper.is_rig(dataset) else " (not the paper's rig)"
    top.set_title(f"Modes of steady sliding, θ = {given['theta']:g}°{whose}")
    top.legend(loc="upper right", ncols=2)
    bottom.set_ylabel("growth rate / (1/s)")
    bottom.set_xlabel("coefficient of friction μ")
    bottom.set_ylim(bottom=0.0)
    return figure


def _paper_onsets(dataset: xr.Dataset) -> dict[int, tuple[float, float]]:
    """The paper's onset nearest in frequency to each of the model's."""
    beside = {}
    for said in paper.ONSETS:
        if len(dataset["onset_frequency"]):
            away = np.abs(np.log(dataset["onset_frequency"].values / said[1]))
            if away.min() < 0.1:
                beside[int(away.argmin())] = said
    return beside


STUDY = Study(
    name="fig5",
    title="Fig. 5: modes of steady sliding against friction",
    question="At which coefficient of friction do modes of the sliding beams coalesce and become unstable?",
    paper="Section 3.4.2 and Fig. 5: below 10 kHz and mu = 0.5 three coalescences, first unstable at "
    "mu = 0.12 (2800 Hz), 0.16 (400 Hz) and 0.23 (7700 Hz).",
    axes={"mu": Axis(evenly(0.0, 0.5, 501), "1", "coefficient of friction")},
    settings=rig_settings(),
    build=build,
    draw=draw,
    findings=findings,
)
