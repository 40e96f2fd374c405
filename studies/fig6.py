"""Fig. 6: the two modes that coalesce first, in the complex plane, and the mode shape at lock-in."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fivcore import Rig, flutter_onsets, node_positions, sliding_modes
from studies import figures, paper
from studies.study import Study, constants, is_papers, rig_of, rig_settings
from sweeps import Axis, Grid, Sweep, Variable

BAND = 10e3
MU_MAX = 1.0


def pair(points: Mapping[str, Any], *, rig: Rig, theta: float, fmax: float, first: int) -> dict[str, Any]:
    """Frequency and growth rate of the modes number `first` and `first` + 1."""
    found = sliding_modes(rig, theta, points["mu"], fmax)
    kept = slice(first - 1, first + 1)
    return {"frequency": found.frequency[:, kept], "growth_rate": found.growth_rate[:, kept]}


def with_shape(dataset: xr.Dataset, *, rig: Rig, theta: float, fmax: float, first: int) -> xr.Dataset:
    """Add the lock-in point and the shape of the mode that becomes unstable there."""
    onsets = flutter_onsets(rig, theta, fmax, MU_MAX)
    mu, frequency = float(onsets.mu[0]), float(onsets.frequency[0])
    found = sliding_modes(rig, theta, mu, fmax)
    # At its onset the mode neither grows nor decays, while its partner decays twice as fast as before.
    candidates = np.abs(found.frequency - frequency) < 1e-2 * frequency
    marginal = int(np.argmin(np.where(candidates, np.abs(found.growth_rate), np.inf)))
    shape = found.shape[marginal]
    positions = node_positions(rig, theta)
    beam = np.repeat(np.array([1, 2], dtype=np.int8), [rig.p1.elements + 1, rig.p2.elements + 1])
    names = {"units": "1", "long_name": "displacement in the unstable mode, largest = 1"}
    return dataset.assign_coords(
        direction=("direction", np.array(["x", "y"]), {"long_name": "direction of the displacement"}),
    ).assign(
        lock_in_mu=((), mu, {"units": "1", "long_name": "coefficient of friction at lock-in"}),
        lock_in_frequency=((), frequency, {"units": "Hz", "long_name": "frequency at lock-in"}),
        shape_real=(("node", "direction"), shape[:, :2].real, names | {"comment": "real part"}),
        shape_imag=(("node", "direction"), shape[:, :2].imag, names | {"comment": "imaginary part"}),
        position=(
            ("node", "direction"),
            positions,
            {"units": "m", "long_name": "undeformed position from the contact"},
        ),
        beam=("node", beam, {"long_name": "beam the node belongs to", "units": "1"}),
    )


def build(axes: Mapping[str, Axis], settings: Mapping[str, float]) -> Sweep:
    """Find which two modes coalesce first, from the frequencies without friction on either side."""
    rig, theta = rig_of(settings)
    for end in (axes["mu"].values.min(), axes["mu"].values.max()):
        sliding_modes(rig, theta, end, BAND)
    onsets = flutter_onsets(rig, theta, BAND, MU_MAX)
    if not len(onsets.mu):
        raise ValueError(
            f"theta = {theta:g}: no modes below {BAND / 1e3:g} kHz coalesce up to mu = {MU_MAX:g}; "
            "with these settings choose an angle whose tangent is positive and below mu"
        )
    without_friction = sliding_modes(rig, theta, 0.0, BAND).frequency
    first = max(1, int(np.count_nonzero(without_friction < onsets.frequency[0])))
    fixed: dict[str, Any] = {"rig": rig, "theta": theta, "fmax": BAND, "first": first}
    return Sweep(
        "fig6",
        pair,
        Grid(axes),
        {
            "frequency": Variable("Hz", "frequency of the sliding mode", ("mode",)),
            "growth_rate": Variable("s-1", "growth rate of the sliding mode", ("mode",)),
        },
        fixed,
        coords={"mode": Axis([first, first + 1], "1", "mode, ascending in frequency")},
        title="Lock-in of two modes of steady sliding (Fig. 6)",
        derive=partial(with_shape, **fixed),
    )


def report(dataset: xr.Dataset) -> str:
    """Where the two modes start, where they lock in, and the paper's numbers."""
    start = dataset.isel(mu=0)
    low, high = (float(f) for f in start["frequency"].values)
    modes = dataset["mode"].values
    lines = [
        f"Modes {modes[0]} and {modes[1]}, theta = {constants(dataset)['theta']:g} degrees.",
        f"At mu = {float(start['mu']):g}: {low:.0f} Hz and {high:.0f} Hz.",
        f"Lock-in at mu = {float(dataset['lock_in_mu']):.4f}, {float(dataset['lock_in_frequency']):.0f} Hz.",
    ]
    if is_papers(dataset):
        (mu, frequency), (f5, f6) = paper.ONSETS[0], paper.MODES_5_AND_6
        lines.append(f"Paper: {f5:.0f} and {f6:.0f} Hz without friction, lock-in at {mu:g}, {frequency:.0f} Hz.")
    c, d = _at_contact(dataset)
    lines.append(
        f"In the unstable mode P1's tip moves {abs(c[0]):.2f} along x and {abs(c[1]):.2f} along y, "
        f"P2 under it {abs(d[0]):.3f} and {abs(d[1]):.2f} (largest displacement of the rig = 1)."
    )
    return "\n".join(lines)


@figures.styled
def draw(dataset: xr.Dataset) -> Figure:
    """Root locus above, the shape at lock-in below."""
    figure, (locus, shape) = figures.panels(2, 1, 15.0, 18.0)
    _draw_locus(locus, dataset)
    _draw_shape(shape, dataset)
    return figure


def _draw_locus(axes: Axes, dataset: xr.Dataset) -> None:
    mu = dataset["mu"].values
    # After lock-in the two have nearly one frequency; the branches are told apart by their growth.
    frequency, growth = dataset["frequency"].values, dataset["growth_rate"].values
    locked = mu >= float(dataset["lock_in_mu"])
    for k, (colour, marker) in enumerate([(figures.BLUE, "o"), (figures.RED, "s")]):
        own_f = np.where(locked, frequency[np.arange(len(mu)), _by_growth(growth, k)], frequency[:, k])
        own_g = np.where(locked, growth[np.arange(len(mu)), _by_growth(growth, k)], growth[:, k])
        mode = int(dataset["mode"][k])
        axes.plot(own_g, own_f, color=colour, label=f"mode {mode}")
        axes.plot(own_g[:1], own_f[:1], marker, color=colour)
    start, end = float(mu[0]), float(mu[-1])
    axes.plot(
        0.0,
        float(dataset["lock_in_frequency"]),
        "*",
        markersize=11,
        color=figures.BLACK,
        label=f"lock-in, model: μ = {float(dataset['lock_in_mu']):.4f}",
    )
    if is_papers(dataset):
        axes.plot(
            [0.0, 0.0],
            paper.MODES_5_AND_6,
            "D",
            markerfacecolor="none",
            color=figures.ORANGE,
            label="paper: μ = 0",
        )
        axes.plot(
            0.0, paper.ONSETS[0][1], "D", color=figures.ORANGE, label=f"lock-in, paper: μ = {paper.ONSETS[0][0]:g}"
        )
    axes.axvline(0.0, color=figures.GREY, linewidth=0.8)
    axes.set_xlabel("growth rate / (1/s)")
    axes.set_ylabel("frequency / Hz")
    modes, theta = " and ".join(map(str, dataset["mode"].values)), constants(dataset)["theta"]
    axes.set_title(f"root locus of modes {modes}, μ from {start:g} to {end:g}, θ = {theta:g}°")
    axes.legend(loc="upper left")


def _draw_shape(axes: Axes, dataset: xr.Dataset) -> None:
    position = 1e3 * dataset["position"].values
    shape = dataset["shape_real"].values + 1j * dataset["shape_imag"].values
    beam = dataset["beam"].values
    scale = 0.12 * float(np.ptp(position[:, 0]))
    # A complex mode is drawn at the phase of its largest displacement, and faintly through its period.
    for phase in np.linspace(0.0, np.pi, 7)[1:]:
        moved = position + scale * (shape * np.exp(1j * phase)).real
        for number in (1, 2):
            axes.plot(*moved[beam == number].T, color=figures.GREY, linewidth=0.6, alpha=0.5)
    for number, colour in ((1, figures.RED), (2, figures.BLUE)):
        part = beam == number
        axes.plot(*position[part].T, color=figures.BLACK, linewidth=0.8, linestyle="--")
        moved = position[part] + scale * shape[part].real
        axes.plot(*moved.T, color=colour, linewidth=2.0, label=f"P{number}")
    axes.plot([], [], color=figures.BLACK, linewidth=0.8, linestyle="--", label="undeformed")
    axes.plot([], [], color=figures.GREY, linewidth=0.6, label="other phases")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x from the contact / mm")
    axes.set_ylabel("y / mm")
    axes.set_title(
        f"unstable mode at lock-in, {float(dataset['lock_in_frequency']):.0f} Hz (displacement not to scale)"
    )
    axes.legend(loc="upper right")


def _by_growth(growth: np.ndarray, rank: int) -> np.ndarray:
    return np.asarray(np.argsort(growth, axis=1, kind="stable")[:, rank])


def _at_contact(dataset: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Displacement of C and of the node of P2 nearest to the contact."""
    shape = dataset["shape_real"].values + 1j * dataset["shape_imag"].values
    distance = np.abs(dataset["position"].values).sum(axis=1)
    beam = dataset["beam"].values
    c, d = (shape[np.argmin(np.where(beam == number, distance, np.inf))] for number in (1, 2))
    return c, d


STUDY = Study(
    name="fig6",
    title="Fig. 6: lock-in of two modes, and the unstable shape",
    question="How do the two modes that coalesce first move in the complex plane, and what does the unstable "
    "mode look like?",
    paper="Section 3.4.2 and Fig. 6: modes 5 and 6, near 2500 and 3100 Hz without friction, approach along the "
    "imaginary axis, lock in at mu = 0.12 near 2800 Hz and part in growth rate; at lock-in normal and "
    "tangential motion of the contact are strongly coupled.",
    axes={"mu": Axis(np.linspace(0.0, 0.2, 2001), "1", "coefficient of friction")},
    settings=rig_settings("theta", "contact_position", "head_mass", "d1", "d2"),
    build=build,
    draw=draw,
    report=report,
)
