"""Table 4: natural frequencies of the two beams glued at their contact."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from fivcore import Rig, checks, glued_frequencies, tune_head_mass
from studies import paper
from studies.declaring import labels
from studies.declaring.labels import number
from studies.declaring.parameters import RIG, SCENE, Parameter
from studies.plotting import figures
from studies.study import Study

OUTPUTS = {
    "frequency": ("Hz", "natural frequency, model"),
    "frequency_at_text_position": ("Hz", "natural frequency, model, contact at 80 mm"),
    "frequency_paper": ("Hz", "natural frequency, paper, numerical"),
    "frequency_measured": ("Hz", "natural frequency, paper, measured"),
}
COLOURS = (figures.BLACK, figures.BLUE, figures.ORANGE)
LISTED = len(paper.GLUED_NUMERICAL)


def tuned(contact_position: float, theta: float, first_frequency: float) -> Rig:
    """The paper's rig with its head mass tuned to the first frequency and rounded to twelve digits."""
    rig = Rig(contact_position=contact_position)
    return replace(rig, head_mass=float(f"{tune_head_mass(rig, theta, first_frequency):.12g}"))


def frequencies(mode: Any, theta: float, contact_position: float, first_frequency: float) -> dict[str, Any]:
    """Glued frequencies of the modes, and the paper's where it lists the mode."""
    rigs = (tuned(position, theta, first_frequency) for position in (contact_position, paper.CONTACT_POSITION))
    model = [glued_frequencies(rig, theta, int(mode.max())) for rig in rigs]
    papers = [np.append(of, np.full(mode.max(), np.nan)) for of in (paper.GLUED_NUMERICAL, paper.GLUED_MEASURED)]
    return {name: column[mode - 1] for name, column in zip(OUTPUTS, (*model, *papers), strict=True)}


def check(mode: Any) -> None:
    """Refuse more modes than the model has: three for each element, less one for the glued contact."""
    for end in (np.min(mode), np.max(mode)):
        checks.count("mode", end, 3 * (Rig().p1.elements + Rig().p2.elements) - 1)


def deviations(dataset: xr.Dataset) -> dict[str, xr.DataArray]:
    """Deviations of the other columns from the paper's numerical one, %."""
    fit, text = (f"model at {1e3 * float(x):g} mm" for x in (dataset["contact_position"], paper.CONTACT_POSITION))
    ends = {"paper, measured": "_measured", fit: "", text: "_at_text_position"}
    return {k: 100.0 * (dataset[f"frequency{end}"] / dataset["frequency_paper"] - 1.0) for k, end in ends.items()}


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """The paper's table beside the model's, for both positions of the contact."""
    columns, theta = deviations(dataset), float(dataset["theta"])
    worst = ", ".join(f"{text} {float(abs(column).max()):.3g} %" for text, column in columns.items())
    yield f"Largest deviations from the paper's computed frequencies: {worst}."
    rig = tuned(float(dataset["contact_position"]), theta, float(dataset["first_frequency"]))
    more = f"{glued_frequencies(rig, theta, LISTED + 1)[-1]:.0f} Hz"
    yield f"Tuned head mass: {rig.head_mass:.4f} kg. The paper lacks the model's mode {LISTED + 1}, {more}."
    table = labels.frame(dataset, ["mode", *(list(OUTPUTS)[k] for k in (2, 3, 0, 1))])
    yield "Frequencies / Hz", table.set_axis(["mode", "paper, computed", *columns], axis=1)


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Deviations from the paper's numerical column, whose frequencies are written at the modes."""
    figure, (axes,) = figures.panels(1, 1, 7.0)
    mode, hertz = dataset["mode"].values, dataset["frequency_paper"].values
    for k, (text, column) in enumerate(deviations(dataset).items()):
        axes.bar(mode + 0.24 * k - 0.24, column, 0.22, color=COLOURS[k], label=text)
    axes.set_xticks(mode, [f"{k}\n{number(f)}" for k, f in zip(mode, hertz, strict=True)])
    figure.suptitle("Beams glued at the contact: deviation from the paper's computed frequencies")
    axes.set_ylabel("deviation / %")
    axes.set_xlabel("mode, and the paper's computed frequency / Hz")
    figures.legend_below(figure, [axes])
    return figure


STUDY = Study(
    name="table4",
    title="Table 4: natural frequencies of the glued beams",
    question="Does the model of the rig, glued at the contact, have the paper's natural frequencies?",
    paper="Section 3.3, Table 4: eight modes below 10 kHz, at most 4 % from the measured ones, the first 16 Hz.",
    parameters={
        "mode": Parameter(np.arange(1, LISTED + 1), "1", "mode"),
        "theta": replace(SCENE["theta"], common=True),
        "contact_position": replace(RIG["contact_position"], default=0.085),  # the fitted one; the text's is 80 mm
        "first_frequency": Parameter(paper.FIRST_GLUED, "Hz", "frequency of the tuned head mass", common=True),
    },
    outputs=OUTPUTS, function=frequencies, summary=summarise, figure=draw, check=check, beams=True,
)  # fmt: skip
