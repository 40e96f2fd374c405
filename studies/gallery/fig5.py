"""Fig. 5: frequencies of the modes of steady sliding below 10 kHz against the coefficient of friction."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from fivcore import Rig, followed_modes
from studies import paper
from studies.answering.claims import is_papers_point, rig_text
from studies.answering.results import rig_of, with_variables
from studies.declaring import labels
from studies.declaring.spec import evenly
from studies.motion.run import BAND
from studies.motion.stability import MODES, mode_numbers
from studies.physics.onsets import crossings
from studies.plotting import figures, planes
from studies.plotting import modes as branches
from studies.study import Claim, Parameter, Study

# The paper's onsets are the first unstable values on a grid of mu with a step of 0.01.
CLAIMS = tuple(
    Claim(name, {"onset": k}, value, "3.4.2, steps of 0.01" if name == "onset_mu" else "3.4.2")
    for k, onset in enumerate(paper.ONSETS, 1)
    for name, value in zip(("onset_mu", "onset_frequency"), onset, strict=True)
)


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
        if (early := dataset["mu"].values[grows & (dataset["mu"].values < mu)]).size:
            yield f"It is unstable from mu = {early[0]:g} on: modes whose onset is above 10 kHz grow there."
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
            yield f"Unstable modes at mu = {unstable['mu'].item():g}", labels.frame(unstable, ["mode", *MODES])


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Branches over mu as in the paper, unstable ones in colour, and their growth rates below."""
    figure, (top, bottom) = figures.panels(2, 1, 8.5, 4.5, sharex=True)
    branches.draw_result(top, bottom, dataset)
    if is_papers_point(dataset, theta=paper.THETA):
        onsets = [(mu, 1e-3 * hertz) for mu, hertz in paper.ONSETS]
        planes.marks(top, onsets, **planes.PAPER["first unstable μ"])
    if dataset.sizes["mu"] > 1:
        bottom.set_xlim(*dataset["mu"].values[[0, -1]])
    figures.entitle((top, bottom), ("frequency", "growth rate of unstable modes"))
    figures.legend_below(figure, [top], 3)
    figure.suptitle(f"Modes of steady sliding{rig_text(dataset)}")
    top.set_ylabel("frequency / kHz")
    bottom.set(ylabel="growth rate / (1/s)", xlabel="coefficient of friction μ", ylim=(0.0, None))
    return figure


STUDY = Study(
    name="fig5",
    title="Fig. 5: modes of steady sliding against friction",
    question="At which coefficient of friction do modes of the sliding beams coalesce and become unstable?",
    paper="Section 3.4.2 and Fig. 5: below 10 kHz and mu = 0.5 three coalescences, first unstable at "
    "mu = 0.12 (2800 Hz), 0.16 (400 Hz) and 0.23 (7700 Hz).",
    parameters={"mu": Parameter(evenly(0.0, 0.5, 501), "1", "coefficient of friction")},
    outputs=MODES, function=modes, coords=mode_numbers,
    derive=derive, summary=summarise, figure=draw, claims=CLAIMS, roles=("first", "modes"),
)  # fmt: skip
