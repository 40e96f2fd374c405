"""Fig. 5: frequencies of the modes of steady sliding below 10 kHz against the coefficient of friction."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from fivcore import Rig, Structure, followed_modes, sliding_modes
from studies import paper
from studies.answering.claims import is_papers_point, rig_text
from studies.answering.results import rig_of, with_variables
from studies.declaring import labels
from studies.declaring.spec import evenly
from studies.motion.run import BAND
from studies.motion.stability import MODES
from studies.physics.onsets import crossings
from studies.plotting import figures, planes
from studies.plotting import modes as branches
from studies.study import Claim, Parameter, Study
from sweeps import Axis

# A file has room for so many modes that enter the band as friction rises, and by which its rigs differ.
ROOM = 10
OUTPUTS = MODES
# The paper's onsets are the first unstable values on a grid of mu with a step of 0.01.
CLAIMS = tuple(
    Claim(name, {"onset": k}, value, "3.4.2, steps of 0.01" if name == "onset_mu" else "3.4.2")
    for k, onset in enumerate(paper.ONSETS, 1)
    for name, value in zip(("onset_mu", "onset_frequency"), onset, strict=True)
)


def coords(rig: Rig | Structure) -> dict[str, Axis]:
    """The modes, numbered from 1."""
    count = sliding_modes(rig, 0.0, 0.0, BAND).frequency.size
    return {
        "mode": Axis(np.arange(1, ROOM * (count // ROOM + 2) + 1), "1", "mode, by its frequency without friction")
    }


def modes(rig: Rig, theta: float, mu: np.ndarray) -> dict[str, np.ndarray]:
    """Frequency and growth rate of all modes of steady sliding below 10 kHz; a mode keeps its number along mu."""
    modes = followed_modes(rig, theta, mu, BAND)
    return {"frequency": modes.frequency, "growth_rate": modes.growth_rate}


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Add onsets, recoveries and divergence within the range of mu, computed as roots and not on the grid."""
    return with_variables(dataset, crossings(rig_of(dataset), dataset["theta"].item(), dataset["mu"].values.max()))


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Onsets, recoveries and divergence, and the unstable modes at the paper's friction."""
    where = "for mu from {:g} to {:g}, modes below 10 kHz".format(*dataset["mu"].values[[0, -1]])
    count, diverges = dataset.sizes["onset"], float(dataset["divergence_mu"])
    grows = (dataset["growth_rate"] > 0.0).any("mode").values
    if count:
        mu, hertz = (float(dataset[f"onset_{name}"][0]) for name in ("mu", "frequency"))
        text = f"{count} onset{'s' * (count > 1)} {where}"
        yield f"Steady sliding flutters from mu = {mu:.4f} on, at {hertz:.0f} Hz; {text}."
    elif not grows.any():
        yield f"Steady sliding is stable {where}."
    elif np.isnan(diverges):
        yield f"No flutter onset {where}, though some of them grow."
    if np.isfinite(diverges):
        yield f"The contact jams: a mode grows without oscillation from mu = {diverges:.4f} on."
    for kind, caption in {"onset": "Flutter onsets", "recovery": "Recoveries"}.items():
        if dataset.sizes[kind]:
            yield caption, labels.frame(dataset, [f"{kind}_mu", f"{kind}_frequency"])
    # At the paper's friction, and at the largest at which any grows.
    papers = int(np.abs(dataset["mu"].values - paper.MU).argmin())
    for k in dict.fromkeys([papers, *np.flatnonzero(grows)[-1:].tolist()]):
        unstable = dataset.isel(mu=k, mode=np.flatnonzero(dataset["growth_rate"][k] > 0.0))
        if unstable.sizes["mode"]:
            yield f"Unstable modes at mu = {unstable['mu'].item():g}", labels.frame(unstable, ["mode", *OUTPUTS])


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Branches over mu as in the paper, unstable ones in colour, and their growth rates below."""
    figure, (top, bottom) = figures.panels(2, 1, 8.5, 4.5, sharex=True)
    mu, frequency, growth = (dataset[name].values for name in ("mu", "frequency", "growth_rate"))
    branches.draw_branches(top, bottom, mu, frequency, growth, 1e3, "." if len(mu) < 3 else None)
    branches.name_growing(bottom, mu[-1], frequency[-1], growth[-1])
    top.set(
        ylim=(0.0, min(1e-3 * BAND, max(0.1, 1.3e-3 * np.nanmax(frequency, initial=0.0)))),
        ylabel="frequency / kHz",
    )
    branches.mark_onsets(top, dataset["onset_mu"].values, dataset["onset_frequency"].values, 1e3)
    branches.mark_recoveries(top, dataset["recovery_mu"].values, 1e-3 * dataset["recovery_frequency"].values)
    branches.mark_divergence((top, bottom), float(dataset["divergence_mu"]))
    if is_papers_point(dataset, theta=paper.THETA):
        look = planes.PAPER["first unstable μ"] | {"color": figures.ORANGE, "markerfacecolor": "none"}
        planes.marks(top, [(mu, 1e-3 * hertz) for mu, hertz in paper.ONSETS], **look | {"markeredgecolor": None})
    figures.letter((top, bottom), ("frequency", "growth rate of unstable modes"))
    figures.legend_below(figure, [top], 3)
    figure.suptitle(f"Modes of steady sliding{rig_text(dataset)}")
    bottom.set(ylabel="growth rate / (1/s)", xlabel="coefficient of friction μ", ylim=(0.0, None))
    return figure


STUDY = Study(
    name="fig5",
    title="Fig. 5: modes of steady sliding against friction",
    question="At which coefficient of friction do modes of the sliding beams coalesce and become unstable?",
    paper="Section 3.4.2 and Fig. 5: below 10 kHz and mu = 0.5 three coalescences, first unstable at "
    "mu = 0.12 (2800 Hz), 0.16 (400 Hz) and 0.23 (7700 Hz).",
    parameters={"mu": Parameter(evenly(0.0, 0.5, 501), "1", "coefficient of friction")},
    outputs=OUTPUTS, function=modes, coords=coords, derive=derive, summary=summarise, figure=draw, claims=CLAIMS,
)  # fmt: skip
