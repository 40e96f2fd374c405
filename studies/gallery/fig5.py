"""Fig. 5: frequencies of the first ten modes of steady sliding against the coefficient of friction."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from fivcore import Rig, flutter_onsets, sliding_modes
from studies import paper, summary
from studies.claims import Claim, is_papers_point, rig_text
from studies.motion.run import BAND
from studies.plotting import figures
from studies.plotting.modes import STABLE, UNSTABLE, mark_onsets, name_growing
from studies.results import rig_of
from studies.spec import evenly
from studies.study import Parameter, Study
from sweeps import Axis

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MODES = 10
OUTPUTS = {
    "frequency": ("Hz", "frequency of the sliding mode", "mode"),
    "growth_rate": ("s-1", "growth rate of the sliding mode", "mode"),
}
# The paper's onsets are the first unstable values on a grid of mu with a step of 0.01.
CLAIMS = tuple(
    Claim(name, {"onset": k}, value, "3.4.2, steps of 0.01" if name == "onset_mu" else "3.4.2")
    for k, onset in enumerate(paper.ONSETS)
    for name, value in zip(("onset_mu", "onset_frequency"), onset, strict=True)
)


def modes(rig: Rig, theta: float, mu: np.ndarray) -> dict[str, np.ndarray]:
    """Frequency and growth rate of the first modes of steady sliding below 10 kHz."""
    modes = sliding_modes(rig, theta, mu, BAND)
    return {"frequency": modes.frequency[..., :MODES], "growth_rate": modes.growth_rate[..., :MODES]}


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Add the flutter onsets within the range of mu, computed as roots and not on the grid."""
    largest = float(dataset["mu"].max())
    onsets = flutter_onsets(rig_of(dataset), float(dataset["theta"]), BAND, largest) if largest else None
    mu, frequency = (onsets.mu, onsets.frequency) if onsets else np.empty((2, 0))
    return dataset.assign(
        onset_mu=("onset", mu, {"units": "1", "long_name": "coefficient of friction at the flutter onset"}),
        onset_frequency=("onset", frequency, {"units": "Hz", "long_name": "frequency at the flutter onset"}),
    )


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """The onsets, and the unstable modes at the paper's friction."""
    ends = f"{float(dataset['mu'].min()):g} to {float(dataset['mu'].max()):g}"
    if not dataset.sizes["onset"]:
        yield f"Steady sliding is stable for mu from {ends}, modes below {BAND / 1e3:g} kHz."
        return
    first, count = (float(dataset["onset_mu"][0]), float(dataset["onset_frequency"][0])), dataset.sizes["onset"]
    yield (
        f"Steady sliding flutters from mu = {first[0]:.4f} on, at {first[1]:.0f} Hz; "
        f"{count} onset{'s' * (count > 1)} for mu from {ends}, modes below {BAND / 1e3:g} kHz."
    )
    yield "Flutter onsets", summary.frame(dataset, ["onset_mu", "onset_frequency"])
    near = dataset.sel(mu=paper.MU, method="nearest")
    unstable = near.isel(mode=np.flatnonzero(near["growth_rate"] > 0.0))
    if unstable.sizes["mode"]:
        caption = f"Unstable modes at mu = {float(near['mu']):g}"
        yield caption, summary.frame(unstable, ["mode", "frequency", "growth_rate"])


def draw(dataset: xr.Dataset) -> Figure:
    """Branches over mu as in the paper, unstable ones in colour, and their growth rates below."""
    figure, (top, bottom) = figures.panels(
        2, 1, 15.0, 16.0, sharex=True, gridspec_kw={"height_ratios": (3.0, 1.5)}
    )
    mu, frequency, growth = dataset["mu"], 1e-3 * dataset["frequency"], dataset["growth_rate"]
    marker = "." if len(mu) < 3 else None
    top.plot(mu, frequency.where(~(growth > 0.0)), marker=marker, color=figures.BLACK)
    top.plot(mu, frequency.where(growth > 0.0), marker=marker, **UNSTABLE)
    bottom.plot(mu, growth.where(growth > 0.0), marker=marker, color=figures.RED)
    name_growing(bottom, float(mu[-1]), dataset["frequency"].values[-1], growth.values[-1])
    top.plot([], [], **STABLE)
    top.set(ylim=(0.0, BAND / 1e3), ylabel="frequency / kHz")
    mark_onsets(top, dataset["onset_mu"].values, dataset["onset_frequency"].values, 1e3)
    papers = is_papers_point(dataset, theta=paper.THETA)
    claimed = np.array([onset for onset in paper.ONSETS if papers and onset[0] <= mu.max()]).reshape(-1, 2).T
    if claimed.size:
        look: dict[str, Any] = {"markersize": 7, "markerfacecolor": "none", "color": figures.ORANGE, "zorder": 4}
        top.plot(claimed[0], claimed[1] / 1e3, "D", label="first unstable μ, paper", **look)
    figures.letter((top, bottom), ("frequency", "growth rate of unstable modes"))
    figures.legend_below(figure, [top], 2)
    figure.suptitle(f"Modes of steady sliding, θ = {float(dataset['theta']):g}°{rig_text(dataset)}")
    bottom.set(ylabel="growth rate / (1/s)", xlabel="coefficient of friction μ")
    bottom.set_ylim(bottom=0.0)
    return figure


STUDY = Study(
    name="fig5",
    title="Fig. 5: modes of steady sliding against friction",
    question="At which coefficient of friction do modes of the sliding beams coalesce and become unstable?",
    paper="Section 3.4.2 and Fig. 5: below 10 kHz and mu = 0.5 three coalescences, first unstable at "
    "mu = 0.12 (2800 Hz), 0.16 (400 Hz) and 0.23 (7700 Hz).",
    parameters={"mu": Parameter(evenly(0.0, 0.5, 501), "1", "coefficient of friction")},
    outputs=OUTPUTS,
    function=modes,
    coords={"mode": Axis(np.arange(1, MODES + 1), "1", "mode, ascending in frequency")},
    derive=derive,
    summary=summarise,
    figure=draw,
    claims=CLAIMS,
)
