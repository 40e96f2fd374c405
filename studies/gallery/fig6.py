"""Fig. 6: the two modes that coalesce first, in the complex plane, and the mode shape at lock-in."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from fivcore import Rig, SlidingModes, flutter_onsets, node_positions, sliding_modes
from studies import paper
from studies.plotting import figures
from studies.rig import rig_of, rig_settings
from studies.spec import evenly
from studies.study import Study, constants
from studies.tables import Part
from sweeps import Axis, Grid, Sweep, Variable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BAND = 10e3
MU_MAX = 1.0
# The pair is followed from its onset in steps of mu so small that what is nearest to it is itself.
STEP = 2e-4
MOST_STEPS = 20_000
NOTHING = complex(np.nan, np.nan)


def pair(points: Mapping[str, Any], *, rig: Rig, theta: float, fmax: float, mu_end: float) -> dict[str, Any]:
    """Frequency and growth rate of the two modes that lock in first; NaN where they have left the band."""
    mu = points["mu"]
    grid, followed = path(rig, theta, fmax, mu_end)
    found = sliding_modes(rig, theta, mu, fmax)
    frequency, growth = np.full((2, len(mu), 2), np.nan)
    for m, near in enumerate(np.rint(mu / grid[1])):
        both = closest_two(found, m, followed[int(near)])
        if both is not None:
            frequency[m], growth[m] = found.frequency[m, both], found.growth_rate[m, both]
    return {"frequency": frequency, "growth_rate": growth}


@lru_cache(maxsize=8)
def path(rig: Rig, theta: float, fmax: float, mu_end: float) -> tuple[np.ndarray, np.ndarray]:
    """Even values of mu from 0 to `mu_end` or the onset, and the pair's eigenvalues lambda there, (mu, 2)."""
    onsets = flutter_onsets(rig, theta, fmax, MU_MAX)
    onset, square = float(onsets.mu[0]), complex((2.0 * np.pi * onsets.frequency[0]) ** 2)
    last = max(mu_end, onset)
    mu = np.linspace(0.0, last, min(int(np.ceil(last / STEP)), MOST_STEPS) + 1)
    found = sliding_modes(rig, theta, mu, fmax)
    followed = np.full((len(mu), 2), NOTHING)
    start = int(np.abs(mu - onset).argmin())
    for way in (range(start, len(mu)), range(start - 1, -1, -1)):
        here = np.array([square, square]) if way.step > 0 else followed[start]
        for m in way:
            both = closest_two(found, m, here)
            if both is None:
                break
            here = followed[m] = found.eigenvalue[m, both]
    return mu, followed


def closest_two(found: SlidingModes, m: int, near: np.ndarray) -> np.ndarray | None:
    """Which two modes at the m-th mu continue the eigenvalues `near`; none if they are not there.

    The one of lower frequency comes first, after lock-in the decaying one.
    """
    felt = np.nonzero(~found.uncoupled[m] & np.isfinite(found.frequency[m]))[0]
    if len(felt) < 2 or np.isnan(near[0]):
        return None
    values = found.eigenvalue[m, felt]
    cost = np.abs(values[:, None] - near[0]) + np.abs(values - near[1])
    np.fill_diagonal(cost, np.inf)
    first, second = np.unravel_index(cost.argmin(), cost.shape)
    if cost[first, second] > 0.5 * np.abs(near).sum():
        return None
    both = felt[[first, second]]
    frequency, growth = found.frequency[m, both], found.growth_rate[m, both]
    # Once their eigenvalues are a conjugate pair, the frequencies differ by rounding and damping alone.
    pair_values = found.eigenvalue[m, both]
    apart = np.abs(pair_values.imag).max() <= 1e-9 * np.abs(pair_values).max()
    return both[np.lexsort((growth, frequency)) if apart else np.argsort(growth)]


def with_shape(dataset: xr.Dataset, *, rig: Rig, theta: float, fmax: float, mu_end: float) -> xr.Dataset:
    """Add the lock-in point and the shape of the mode that becomes unstable there."""
    onsets = flutter_onsets(rig, theta, fmax, MU_MAX)
    mu, frequency = float(onsets.mu[0]), float(onsets.frequency[0])
    found = sliding_modes(rig, theta, [mu], fmax)
    both = closest_two(found, 0, np.full(2, complex((2.0 * np.pi * frequency) ** 2)))
    assert both is not None
    # At its onset the mode neither grows nor decays, while its partner decays twice as fast as before.
    marginal = both[np.abs(found.growth_rate[0, both]).argmin()]
    shape, position = found.shape[0, marginal], node_positions(rig, theta)
    beam = np.repeat(np.array([1, 2], dtype=np.int8), [rig.p1.elements + 1, rig.p2.elements + 1])
    added: dict[str, Any] = {
        "lock_in_mu": ((), mu, {"units": "1", "long_name": "coefficient of friction at lock-in"}),
        "lock_in_frequency": ((), frequency, {"units": "Hz", "long_name": "frequency at lock-in"}),
        "beam": (
            "node",
            beam,
            {"flag_values": np.array([1, 2], dtype=np.int8), "flag_meanings": "P1 P2", "long_name": "beam"},
        ),
    }
    for axis, name in enumerate("xy"):
        undeformed = {"units": "m", "long_name": f"undeformed position from the contact along {name}"}
        added[f"node_{name}"] = ("node", position[:, axis], undeformed)
        moved = f"displacement along {name} in the unstable mode at lock-in, largest = 1"
        for part, values in (("real", shape[:, axis].real), ("imag", shape[:, axis].imag)):
            about = {"units": "1", "long_name": f"{moved}, {part}{'inary' if part == 'imag' else ''} part"}
            added[f"shape_{name}_{part}"] = ("node", values, about)
    return dataset.assign(added)


def build(axes: Mapping[str, Axis], settings: Mapping[str, float]) -> Sweep:
    """Find which two modes coalesce first, and their numbers among all modes without friction."""
    rig, theta = rig_of(settings)
    end = float(axes["mu"].values.max())
    for mu in (axes["mu"].values.min(), end):
        sliding_modes(rig, theta, mu, BAND)
    if not len(flutter_onsets(rig, theta, BAND, MU_MAX).mu):
        raise ValueError(
            f"theta = {theta:g}: no two modes below {BAND / 1e3:g} kHz lock in up to mu = {MU_MAX:g} with these "
            "settings; nearer to theta = 5 and the other defaults they do"
        )
    numbers = closest_two(sliding_modes(rig, theta, [0.0], BAND), 0, path(rig, theta, BAND, end)[1][0])
    if numbers is None:
        raise ValueError(
            f"theta = {theta:g}: the two modes that lock in cannot be followed back to mu = 0 below "
            f"{BAND / 1e3:g} kHz with these settings; nearer to the defaults they can"
        )
    fixed: dict[str, Any] = {"rig": rig, "theta": theta, "fmax": BAND, "mu_end": end}
    return Sweep(
        "fig6",
        pair,
        Grid(axes),
        {
            "frequency": Variable("Hz", "frequency of the sliding mode", ("mode",)),
            "growth_rate": Variable("s-1", "growth rate of the sliding mode", ("mode",)),
        },
        fixed,
        coords={"mode": Axis(numbers + 1, "1", "number of the mode without friction, ascending in frequency")},
        title="Lock-in of two modes of steady sliding (Fig. 6)",
        derive=partial(with_shape, **fixed),
    )


def findings(dataset: xr.Dataset) -> list[Part]:
    """Where the two modes start, where they lock in, and the paper's numbers."""
    start = dataset.isel(mu=0)
    low, high = (float(f) for f in start["frequency"].values)
    modes = dataset["mode"].values
    lines: list[Part] = [
        f"Modes {modes[0]} and {modes[1]}, theta = {constants(dataset)['theta']:g} degrees.",
        f"At mu = {float(start['mu']):g}: {low:.0f} Hz and {high:.0f} Hz.",
        f"Lock-in at mu = {float(dataset['lock_in_mu']):.4f}, {float(dataset['lock_in_frequency']):.0f} Hz.",
    ]
    if paper.is_point(dataset, theta=paper.THETA):
        (mu, frequency), (f5, f6) = paper.ONSETS[0], paper.MODES_5_AND_6
        lines.append(f"Paper: {f5:.0f} and {f6:.0f} Hz without friction, lock-in at {mu:g}, {frequency:.0f} Hz.")
    c, d = _at_contact(dataset)
    lines.append(
        f"In the unstable mode P1's tip moves {abs(c[0]):.2f} along x and {abs(c[1]):.2f} along y, "
        f"P2 under it {abs(d[0]):.3f} and {abs(d[1]):.2f} (largest displacement of the rig = 1)."
    )
    return lines


def draw(dataset: xr.Dataset) -> Figure:
    """Root locus above, the shape at lock-in below."""
    figure, (locus, shape) = figures.panels(2, 1, 15.0, 18.0)
    _draw_locus(locus, dataset)
    _draw_shape(shape, dataset)
    return figure


def _draw_locus(axes: Axes, dataset: xr.Dataset) -> None:
    mu = dataset["mu"].values
    frequency, growth = dataset["frequency"].values, dataset["growth_rate"].values
    for k, (colour, marker) in enumerate([(figures.BLUE, "o"), (figures.RED, "s")]):
        axes.plot(growth[:, k], frequency[:, k], color=colour, label=f"mode {int(dataset['mode'][k])}")
        axes.plot(growth[:1, k], frequency[:1, k], marker, color=colour)
    start, end = float(mu[0]), float(mu[-1])
    axes.plot(
        0.0,
        float(dataset["lock_in_frequency"]),
        "*",
        markersize=11,
        color=figures.BLACK,
        label=f"lock-in, model: μ = {float(dataset['lock_in_mu']):.4f}",
    )
    if paper.is_point(dataset, theta=paper.THETA):
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
    position, shape = _nodes(dataset)
    position *= 1e3
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


def _nodes(dataset: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Undeformed positions, m, and complex displacements of the nodes, (node, 2)."""
    position = np.stack([dataset[f"node_{axis}"].values for axis in "xy"], axis=1)
    real, imag = (
        np.stack([dataset[f"shape_{axis}_{part}"].values for axis in "xy"], axis=1) for part in ("real", "imag")
    )
    return position, real + 1j * imag


def _at_contact(dataset: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Displacement of C and of the node of P2 nearest to the contact."""
    position, shape = _nodes(dataset)
    distance = np.abs(position).sum(axis=1)
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
    axes={"mu": Axis(evenly(0.0, 0.2, 2001), "1", "coefficient of friction")},
    settings=rig_settings(),
    build=build,
    draw=draw,
    findings=findings,
)
