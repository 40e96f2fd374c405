"""Table 4: natural frequencies of the two beams glued at their contact."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from fivcore import Rig, glued_frequencies, tune_head_mass
from fivcore.rig import P1, P2
from studies import paper
from studies.plotting import figures
from studies.study import Setting, Study, constants
from studies.tables import Part, Table
from sweeps import Axis, Grid, Sweep, Variable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The contact position at which the paper's frequencies are found again; its text says 80 mm.
FITTING_POSITION = 0.085


def frequencies(points: Mapping[str, Any], *, rig: Rig, text_rig: Rig, theta: float) -> dict[str, Any]:
    """The glued frequencies of the modes asked for, and the paper's where it lists the mode."""
    index = np.asarray(points["mode"]) - 1
    last = int(index.max()) + 1

    def listed(column: tuple[float, ...]) -> np.ndarray:
        padded = np.full(max(last, len(column)), np.nan)
        padded[: len(column)] = column
        return np.asarray(padded[index])

    return {
        "frequency": glued_frequencies(rig, theta, last)[index],
        "frequency_at_text_position": glued_frequencies(text_rig, theta, last)[index],
        "frequency_paper": listed(paper.GLUED_NUMERICAL),
        "frequency_measured": listed(paper.GLUED_MEASURED),
    }


def build(axes: Mapping[str, Axis], settings: Mapping[str, float]) -> Sweep:
    """Both rigs have their head mass tuned, as the paper's was, to the first frequency."""
    theta, first = settings["theta"], settings["first_frequency"]
    modes, most = axes["mode"].values, 3 * (P1.elements + P2.elements) - 1
    outside = modes[(modes < 1) | (modes > most)]
    if len(outside):
        raise ValueError(f"mode = {outside[0]}: it must be a whole number from 1 to {most}")

    def tuned(position: float) -> Rig:
        rig = Rig(contact_position=position)
        try:
            # What is beyond twelve digits is the machine's, and a result belongs to none.
            return replace(rig, head_mass=float(f"{tune_head_mass(rig, theta, first):.12g}"))
        except ValueError as problem:
            raise ValueError(str(problem).replace("frequency", "first_frequency", 1)) from None

    rig, text_rig = tuned(settings["contact_position"]), tuned(paper.CONTACT_POSITION)
    return Sweep(
        "table4",
        frequencies,
        Grid(axes),
        {
            "frequency": Variable("Hz", "natural frequency, model"),
            "frequency_at_text_position": Variable("Hz", "natural frequency, model, contact at 80 mm"),
            "frequency_paper": Variable("Hz", "natural frequency, paper, numerical"),
            "frequency_measured": Variable("Hz", "natural frequency, paper, measured"),
        },
        {"rig": rig, "text_rig": text_rig, "theta": theta},
        title="Natural frequencies of two beams glued at their contact (Table 4)",
    )


def deviation(dataset: xr.Dataset, name: str) -> np.ndarray:
    """Per cent by which a column differs from the paper's numerical one."""
    return np.asarray(100.0 * (dataset[name] / dataset["frequency_paper"] - 1.0))


def findings(dataset: xr.Dataset) -> list[Part]:
    """The table, with the deviations, and what it says about the contact's position."""
    config = constants(dataset)
    here, text = deviation(dataset, "frequency"), deviation(dataset, "frequency_at_text_position")
    position, text_position = (1e3 * config[r]["contact_position"] for r in ("rig", "text_rig"))
    rows = []
    for k, mode in enumerate(dataset["mode"].values):
        row = [float(dataset[n][k]) for n in ("frequency_measured", "frequency_paper", "frequency")]
        other = float(dataset["frequency_at_text_position"][k])
        rows.append(
            [
                f"{mode}",
                *(_number(value, digits) for value, digits in zip(row, (0, 0, 1), strict=True)),
                _number(here[k], 2),
                _number(other, 1),
                _number(text[k], 2),
            ]
        )
    heads = ["mode", "measured", "paper", f"at {position:g} mm", "diff %", f"at {text_position:g} mm", "diff %"]
    lines: list[Part] = [
        f"Glued modes, theta = {config['theta']:g} degrees; frequencies in Hz, differences from the paper's "
        "numerical column.",
        f"Head mass tuned to the first frequency: {config['rig']['head_mass']:.4f} kg at {position:g} mm, "
        f"{config['text_rig']['head_mass']:.4f} kg at {text_position:g} mm.",
        "",
        Table(heads, rows, form="{:>4} {:>9} {:>8} {:>12} {:>7} {:>12} {:>7}"),
    ]
    if np.any(np.isfinite(here)):
        lines += [
            "",
            f"Largest difference: {np.nanmax(np.abs(here)):.2f} % with the contact at {position:g} mm, "
            f"{np.nanmax(np.abs(text)):.1f} % at {text_position:g} mm.",
        ]
        if config["theta"] == paper.THETA and np.nanmax(np.abs(text)) > 1.0:
            lines.append(
                f"A contact at {text_position:g} mm, the position given in the paper's text, does not give "
                "the paper's Table 4."
            )
    return lines


def draw(dataset: xr.Dataset) -> Figure:
    """Frequencies side by side, and below them the deviations from the paper's numerical column."""
    config = constants(dataset)
    position, text_position = (1e3 * config[r]["contact_position"] for r in ("rig", "text_rig"))
    figure, (top, bottom) = figures.panels(2, 1, 15.0, 13.0, sharex=True)
    mode = dataset["mode"].values
    columns = [
        ("frequency_measured", "paper, measured", figures.BLACK, "x", -0.24),
        ("frequency_paper", "paper, numerical", figures.GREY, "s", 0.0),
        ("frequency", f"model, contact at {position:g} mm", figures.BLUE, "o", 0.0),
        ("frequency_at_text_position", f"model, contact at {text_position:g} mm", figures.ORANGE, "^", 0.24),
    ]
    for name, label, colour, marker, shift in columns:
        filled = colour if marker == "x" else "none"
        top.plot(mode, dataset[name], marker, color=colour, markerfacecolor=filled, label=label)
        if name != "frequency_paper":
            values = deviation(dataset, name)
            bottom.bar(mode + shift, values, 0.22, color=colour, label=label)
    top.set_yscale("log")
    top.set_ylabel("natural frequency / Hz")
    top.legend(loc="lower right")
    top.set_title(f"Beams glued at the contact, θ = {config['theta']:g}°")
    largest = {
        name: np.nanmax(np.abs(deviation(dataset, name)), initial=0.0)
        for name in ("frequency", "frequency_at_text_position")
    }
    bottom.set_title(
        f"largest difference: {largest['frequency']:.2f} % at {position:g} mm, "
        f"{largest['frequency_at_text_position']:.1f} % at {text_position:g} mm"
    )
    bottom.axhline(0.0, color=figures.GREY, linewidth=0.8)
    bottom.set_ylabel("difference from the paper's\nnumerical column / %")
    bottom.set_xlabel("mode")
    bottom.set_xticks(mode)
    return figure


def _number(value: float, digits: int) -> str:
    # Zero has no sign, whatever rounding has left of it.
    return "-" if np.isnan(value) else f"{round(value, digits) + 0.0:.{digits}f}"


STUDY = Study(
    name="table4",
    title="Table 4: natural frequencies of the glued beams",
    question="Does the model of the rig, glued at the contact, have the paper's natural frequencies?",
    paper="Section 3.3 and Table 4: eight modes below 10 kHz, computed and measured, at most 4 % apart; "
    "the head mass is tuned to a first frequency of 16 Hz.",
    axes={"mode": Axis(np.arange(1, 9), "1", "mode")},
    settings={
        "theta": Setting(paper.THETA, "degree", "inclination of P1"),
        "contact_position": Setting(FITTING_POSITION, "m", "distance of the contact from P2's clamp"),
        "first_frequency": Setting(paper.FIRST_GLUED, "Hz", "frequency the head mass is tuned to"),
    },
    build=build,
    draw=draw,
    findings=findings,
)
