"""Fig. 6: the two modes that coalesce first, in the complex plane, and the mode shape at lock-in."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from fivcore import Rig, SlidingModes, checks, flutter_onsets, node_positions, sliding_modes
from studies import paper
from studies.claims import Claim, beside
from studies.gallery import fig5
from studies.plotting import figures
from studies.rig import rig_settings
from studies.spec import evenly
from studies.study import Study, constants
from studies.tables import Column, Part, Table
from sweeps import Axis, InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The pair is followed from its onset, at most at MU_MAX, in steps of mu so small that what is nearest to it is
# itself; as far as needed, in whole intervals, so that few paths serve all batches.
MU_MAX, STEP, INTERVAL, MOST_MU = 1.0, 2e-4, 0.2, 4.0
CLAIMS = (
    Claim("frequency", {"mode": 5, "mu": 0.0}, paper.MODES_5_AND_6[0], "3.4.2, Fig. 6a"),
    Claim("frequency", {"mode": 6, "mu": 0.0}, paper.MODES_5_AND_6[1], "3.4.2, Fig. 6a"),
    Claim("lock_in_mu", {}, paper.ONSETS[0][0], "3.4.2, steps of 0.01"),
    Claim("lock_in_frequency", {}, paper.ONSETS[0][1], "3.4.2"),
)


def pair(points: Mapping[str, Any], *, rig: Rig, theta: float, fmax: float) -> dict[str, Any]:
    """Frequency and growth rate of the two modes that lock in first; NaN where they have left the band."""
    mu = points["mu"]
    followed = path(rig, theta, fmax, int(np.ceil(mu.max() / INTERVAL)))
    modes = sliding_modes(rig, theta, mu, fmax)
    frequency, growth = np.full((2, len(mu), 2), np.nan)
    for m, near in enumerate(np.rint(mu / STEP)):
        both = closest_two(modes, m, followed[int(near)])
        if both is not None:
            frequency[m], growth[m] = modes.frequency[m, both], modes.growth_rate[m, both]
    return {"frequency": frequency, "growth_rate": growth}


@lru_cache(maxsize=8)
def lock_in(rig: Rig, theta: float, fmax: float) -> tuple[float, float]:
    """Friction and frequency at which the first two modes lock in; `ValueError` if no two do."""
    onsets = flutter_onsets(rig, theta, fmax, MU_MAX)
    if not len(onsets.mu):
        raise InputError(
            f"theta = {theta:g}: no two modes below {fmax / 1e3:g} kHz lock in up to mu = {MU_MAX:g} with these "
            f"settings; nearer to theta = {paper.THETA:g} and the other defaults they do"
        )
    return float(onsets.mu[0]), float(onsets.frequency[0])


@lru_cache(maxsize=8)
def path(rig: Rig, theta: float, fmax: float, intervals: int) -> np.ndarray:
    """The pair's eigenvalues lambda at multiples of STEP, (mu, 2), over so many intervals or to its onset."""
    onset, frequency = lock_in(rig, theta, fmax)
    mu = STEP * np.arange(round(max(intervals, np.ceil(onset / INTERVAL)) * INTERVAL / STEP) + 1)
    modes = sliding_modes(rig, theta, mu, fmax)
    followed = np.full((len(mu), 2), complex(np.nan, np.nan))
    start = int(np.abs(mu - onset).argmin())
    for way in (range(start, len(mu)), range(start - 1, -1, -1)):
        here = np.full(2, at_onset(frequency)) if way.step > 0 else followed[start]
        for m in way:
            both = closest_two(modes, m, here)
            if both is None:
                break
            here = followed[m] = modes.eigenvalue[m, both]
    return followed


def at_onset(frequency: float) -> complex:
    """Eigenvalue lambda of the two modes where they lock in."""
    return complex((2.0 * np.pi * frequency) ** 2)


def closest_two(modes: SlidingModes, m: int, near: np.ndarray) -> np.ndarray | None:
    """Which two modes at the m-th mu continue the eigenvalues `near`; none if they are not there.

    The one of lower frequency comes first, after lock-in the decaying one.
    """
    coupled = np.nonzero(~modes.uncoupled[m] & np.isfinite(modes.frequency[m]))[0]
    if len(coupled) < 2 or np.isnan(near[0]):
        return None
    values = modes.eigenvalue[m, coupled]
    cost = np.abs(values[:, None] - near[0]) + np.abs(values - near[1])
    np.fill_diagonal(cost, np.inf)
    first, second = np.unravel_index(cost.argmin(), cost.shape)
    if cost[first, second] > 0.5 * np.abs(near).sum():
        return None
    both = coupled[[first, second]]
    frequency, growth = modes.frequency[m, both], modes.growth_rate[m, both]
    # Once their eigenvalues are a conjugate pair, the frequencies differ by rounding and damping alone.
    pair_values = modes.eigenvalue[m, both]
    apart = np.abs(pair_values.imag).max() <= 1e-9 * np.abs(pair_values).max()
    return both[np.lexsort((growth, frequency)) if apart else np.argsort(growth)]


def with_shape(dataset: xr.Dataset, *, rig: Rig, theta: float, fmax: float) -> xr.Dataset:
    """Add the lock-in point and the shape of the mode that becomes unstable there."""
    mu, frequency = lock_in(rig, theta, fmax)
    modes = sliding_modes(rig, theta, [mu], fmax)
    both = closest_two(modes, 0, np.full(2, at_onset(frequency)))
    assert both is not None
    # At its onset the mode neither grows nor decays, while its partner decays twice as fast as before.
    marginal = both[np.abs(modes.growth_rate[0, both]).argmin()]
    shape, position = modes.shape[0, marginal], node_positions(rig, theta)
    numbers = np.array([1, 2], dtype=np.int8)
    beam = np.repeat(numbers, [rig.p1.elements + 1, rig.p2.elements + 1])
    flags = {"flag_values": numbers, "flag_meanings": "P1 P2", "long_name": "beam"}
    added: dict[str, Any] = {
        "lock_in_mu": ((), mu, {"units": "1", "long_name": "coefficient of friction at lock-in"}),
        "lock_in_frequency": ((), frequency, {"units": "Hz", "long_name": "frequency at lock-in"}),
        "beam": ("node", beam, flags),
    }
    for axis, name in enumerate("xy"):
        undeformed = {"units": "m", "long_name": f"undeformed position from the contact along {name}"}
        added[f"node_{name}"] = ("node", position[:, axis], undeformed)
        moved = f"displacement along {name} in the unstable mode at lock-in, largest = 1"
        for part, values in (("real", shape[:, axis].real), ("imag", shape[:, axis].imag)):
            about = {"units": "1", "long_name": f"{moved}, {part}{'inary' if part == 'imag' else ''} part"}
            added[f"shape_{name}_{part}"] = ("node", values, about)
    return dataset.assign(added)


def check(axes: Mapping[str, Axis], fixed: Mapping[str, Any]) -> None:
    """Refuse frictions to which the pair is not followed."""
    for mu in axes["mu"].values[[0, -1]]:
        checks.between("mu", mu, 0.0, MOST_MU, "a coefficient of friction")


def mode_numbers(*, rig: Rig, theta: float, fmax: float) -> dict[str, Axis]:
    """The axis of the two modes, by their numbers among all modes without friction."""
    numbers = closest_two(sliding_modes(rig, theta, [0.0], fmax), 0, path(rig, theta, fmax, 1)[0])
    if numbers is None:
        raise InputError(
            f"theta = {theta:g}: the two modes that lock in cannot be followed back to mu = 0 below "
            f"{fmax / 1e3:g} kHz with these settings; nearer to the defaults they can"
        )
    return {"mode": Axis(numbers + 1, "1", "number of the mode without friction, ascending in frequency")}


def findings(dataset: xr.Dataset) -> list[Part]:
    """Where the two modes start, where they lock in, and how the contact moves in the unstable one."""
    start = dataset.isel(mu=0)
    columns: dict[str, Column] = {
        "mode": ("mode", "g"),
        f"Hz at mu = {float(start['mu']):g}": ("frequency", ".0f"),
    }
    moved = []
    for beam, name in ((1, "P1's tip"), (2, "P2 under it")):
        position, shape = _nodes(dataset, beam)
        nearest = np.abs(position).sum(axis=0).argmin()
        moved.append([name, *(f"{abs(each):.3f}" for each in shape[:, nearest])])
    return [
        f"Two modes of steady sliding, theta = {constants(dataset)['theta']:g} degrees: lock-in at mu = "
        f"{float(dataset['lock_in_mu']):.4f}, {float(dataset['lock_in_frequency']):.0f} Hz.",
        "",
        Table.of(start, "mode", columns),
        "",
        "The contact in the unstable mode at lock-in; the largest displacement of the rig is 1.",
        Table(["of", "along x", "along y"], moved, words=1),
        *beside(dataset, CLAIMS),
    ]


def draw(dataset: xr.Dataset) -> Figure:
    """Root locus above, the shape at lock-in below."""
    figure, (locus, shape) = figures.panels(2, 1, 17.0, 15.0, gridspec_kw={"height_ratios": (1.5, 1.0)})
    _draw_locus(locus, dataset)
    _draw_shape(shape, dataset)
    return figure


def _draw_locus(axes: Axes, dataset: xr.Dataset) -> None:
    mu, frequency, growth = (dataset[name].values for name in ("mu", "frequency", "growth_rate"))
    numbers, theta = dataset["mode"].values, constants(dataset)["theta"]
    for k, (colour, marker) in enumerate(((figures.BLUE, "o"), (figures.RED, "s"))):
        label = f"mode {numbers[k]}, marked at μ = {mu[0]:g}"
        axes.plot(growth[:, k], frequency[:, k], marker=marker, markevery=[0], color=colour, label=label)
    here, hertz = float(dataset["lock_in_mu"]), float(dataset["lock_in_frequency"])
    axes.plot(0.0, hertz, "*", markersize=11, color=figures.BLACK, label=f"lock-in, model: μ = {here:.4f}")
    if paper.is_point(dataset, theta=paper.THETA):
        there, hertz = paper.ONSETS[0]
        paper_look: dict[str, Any] = {"marker": "D", "linestyle": "", "color": figures.ORANGE}
        axes.plot([0.0, 0.0], paper.MODES_5_AND_6, **paper_look, markerfacecolor="none", label="paper: μ = 0")
        axes.plot(0.0, hertz, **paper_look, label=f"lock-in, paper: μ = {there:g}")
    axes.axvline(0.0, color=figures.GREY, linewidth=0.8)
    axes.set(xlabel="growth rate / (1/s)", ylabel="frequency / Hz")
    modes = " and ".join(map(str, numbers))
    title = f"(a) root locus of modes {modes}, μ from {mu[0]:g} to {mu[-1]:g}, θ = {theta:g}°"
    axes.set_title(title, loc="left", fontsize=9.0)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _draw_shape(axes: Axes, dataset: xr.Dataset) -> None:
    """The shape at the phase of its largest displacement, as it is stored, and faintly through its period.

    Displacements are small beside the beams, or P1's tip would seem to be within P2 where that curves.
    """
    scale = 40.0 * float(np.ptp(dataset["node_x"].values))
    faint: dict[str, Any] = {"color": figures.GREY, "linewidth": 0.6}
    dashed: dict[str, Any] = {"color": figures.BLACK, "linewidth": 0.8, "linestyle": "--"}
    for number, colour in ((1, figures.RED), (2, figures.BLUE)):
        position, shape = _nodes(dataset, number)
        for phase in np.linspace(0.0, np.pi, 7)[1:]:
            axes.plot(*(1e3 * position + scale * (shape * np.exp(1j * phase)).real), alpha=0.5, **faint)
        axes.plot(*(1e3 * position), **dashed)
        axes.plot(*(1e3 * position + scale * shape.real), color=colour, linewidth=2.0, label=f"P{number}")
    axes.plot([], [], **dashed, label="undeformed")
    axes.plot([], [], **faint, label="other phases")
    axes.set_aspect("equal")
    axes.set(xlabel="x from the contact / mm", ylabel="y / mm")
    frequency = float(dataset["lock_in_frequency"])
    title = f"(b) unstable mode at lock-in, {frequency:.0f} Hz (displacement not to scale)"
    axes.set_title(title, loc="left", fontsize=9.0)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _nodes(dataset: xr.Dataset, beam: int) -> tuple[np.ndarray, np.ndarray]:
    """Undeformed positions, m, and complex displacements of the nodes of a beam, (2, node)."""
    own = dataset.isel(node=np.flatnonzero(dataset["beam"].values == beam))
    position, real, imaginary = (
        np.stack([own[name.format(axis)].values for axis in "xy"])
        for name in ("node_{}", "shape_{}_real", "shape_{}_imag")
    )
    return position, real + 1j * imaginary


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
    function=pair,
    variables=fig5.VARIABLES,
    constants=fig5.constants_of,
    coords=mode_numbers,
    check=check,
    derive=with_shape,
    draw=draw,
    findings=findings,
)
