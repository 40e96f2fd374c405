"""Fig. 11: velocity of point B at an inclination where the rig vibrates and at one where it slides steadily."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from fivcore import Scene, Transient
from studies import paper
from studies.claims import Claim, beside
from studies.gallery.stability.study import largest_growth
from studies.motion import recording, regimes, transients
from studies.motion.jobs import BATCH_MULTIPLE
from studies.plotting import figures, planes
from studies.rig import rig_settings
from studies.study import Setting, Study, constants
from studies.tables import Column, Part, Table
from sweeps import Axis, Variable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours and line styles of the inclinations; of more the figure shows so many, evenly chosen.
LOOKS = ((figures.BLUE, "-"), (figures.ORANGE, "-"), (figures.GREEN, "--"), (figures.BLACK, ":"))
# How long growth or decay is followed from the first slip on, s.
FOLLOWED = 0.1
# Below this share of V the motion has gone, and what remains is rounding.
NOTHING = 1e-9
STABILITY = {
    "mode_growth_rate": Variable("s-1", "growth rate of the fastest-growing mode of steady sliding below 10 kHz"),
    "mode_frequency": Variable("Hz", "frequency of the fastest-growing mode of steady sliding below 10 kHz"),
}
CLAIMS = (
    Claim("dominant_frequency", {"theta": 10.0, "V": paper.ANGLES_SPEED}, paper.ANGLES[10.0], "3.6, measured"),
    Claim("regime", {"theta": 15.0, "V": paper.ANGLES_SPEED}, "steady sliding", "3.6, measured"),
)
VARIABLES = (
    {
        "velocity_B": Variable("m s-1", "velocity of B along x", ("elapsed",), "float32"),
        "spectrum": Variable(
            "m2 s-1", "power spectral density of the velocity of B after settling", ("frequency",), "float32"
        ),
    }
    | STABILITY
    | transients.SUMMARY
)


def histories(
    points: Mapping[str, Any], *, sample_rate: float, record: Sequence[str] = (), **fixed: Any
) -> dict[str, Any]:
    """Velocity of B, its spectrum, the summary figures, linear stability, and further recorded series."""

    def values(run: Transient, series: np.ndarray, times: np.ndarray) -> dict[str, Any]:
        spectrum = transients.spectrum(series, transients.settled(run, times), sample_rate)
        return {"spectrum": spectrum} | dict(zip(STABILITY, fastest(run.scene), strict=True))

    return recording.histories(points, fixed, values, ("velocity_B",), record, sample_rate)


def fastest(scene: Scene) -> tuple[float, float]:
    """Growth rate (1/s) and frequency (Hz) of the mode of steady sliding that grows fastest."""
    growth, frequency, _ = largest_growth(scene.rig, scene.drive_theta, scene.mu, transients.BAND)
    return float(growth), float(frequency)


def findings(dataset: xr.Dataset) -> list[Part]:
    """Motion at each inclination, its linear stability, and the measured motion."""
    fixed = constants(dataset)
    columns: dict[str, Column] = {
        "theta deg": ("theta", "g"),
        "vibration": regimes.kind,
        "dominant Hz": (regimes.dominant_frequency, ".0f"),
        "RMS mm/s": ("velocity_rms", ".3f", 1e3),
        "fastest mode 1/s": ("mode_growth_rate", ".0f"),
        "at Hz": ("mode_frequency", ".0f"),
    }
    return [
        f"Velocity of B, V = {1e3 * fixed['V']:g} mm/s, mu = {fixed['mu']:g}, F = {fixed['F']:g} N, "
        f"{fixed['duration']:g} s, {transients.damping(fixed)}; "
        f"RMS and dominant frequency from {transients.SETTLING:g} s after the first slip on.",
        "",
        Table.of(dataset, "theta", columns),
        "",
        "Fastest mode: the growth rate of steady sliding's least stable mode; below 0 all decay.",
        *beside(dataset, CLAIMS),
    ]


def draw(dataset: xr.Dataset) -> Figure:
    """The histories as in the paper; below, how the vibration grows or dies, and the spectra."""
    fixed = constants(dataset)
    some = transients.some(dataset.sizes["theta"], len(LOOKS))
    layout = [["top", "top"], ["growth", "tones"]]
    figure, panels = figures.mosaic(layout, 17.0, 15.0, height_ratios=(1.0, 1.1))
    top, growth, tones = panels.values()
    for k, (colour, style) in zip(some, LOOKS, strict=False):
        at = dataset.isel(theta=k)
        kind, main = regimes.kind(at), float(regimes.dominant_frequency(at))
        label = f"{planes.named('theta', at['theta'])}: {kind}" + (
            f", dominant {main:.0f} Hz" if main > 0.0 else ""
        )
        if kind == "failed":
            top.plot([], [], color=colour, linestyle=style, label=label)
            continue
        velocity = 1e3 * at["velocity_B"].values.astype(float)
        # A quiet trace would vanish under a loud one.
        above = 3.0 - 1e-3 * float(np.ptp(velocity[len(velocity) // 2 :]))
        figures.trace(top, at["elapsed"].values, velocity, color=colour, label=label, zorder=above)
        _draw_growth(growth, at, colour, float(fixed["V"]))
        tones.plot(at["frequency"] / 1e3, figures.decibels(at["spectrum"]), style, color=colour, linewidth=1.0)
    top.set(xlim=(0.0, fixed["duration"]), xlabel="time since the drive started / s")
    top.set_ylabel("velocity of B / (mm/s)")
    growth.plot([], [], color=figures.RED, linestyle="--", label="growth of the fastest mode of steady sliding")
    growth.set(yscale="log", xlim=(0.0, FOLLOWED), xlabel="time since the first slip / s")
    growth.set_ylabel("velocity of B about its mean,\nlargest in 0.5 ms / (m/s)")
    if paper.is_point(dataset, mu=paper.MU, F=paper.LOAD, V=paper.ANGLES_SPEED):
        look: dict[str, Any] = {"color": figures.RED, "linestyle": ":", "linewidth": 1.4, "zorder": 3.0}
        tones.axvline(paper.ANGLES[10.0] / 1e3, **look, label="paper: measured at 10°")
    tones.set_xlim(0.0, transients.BAND / 1e3)
    tones.set_ylim(bottom=max(tones.get_ylim()[0], tones.get_ylim()[1] - 200.0))
    tones.set(xlabel="frequency / kHz", ylabel="PSD / dB re 1 (m/s)²/Hz")
    figures.letter((top, growth, tones), ("motion", "growth and decay", "spectrum after settling"))
    figures.legend_below(figure, [top, growth, tones], 2)
    where = ", ".join(planes.named(name, fixed[name]) for name in ("V", "mu", "F"))
    title = f"Velocity of B along x, {where}{transients.of_all(some, dataset.sizes['theta'])}"
    figure.suptitle(f"{title}\n{transients.damping(fixed)}")
    return figure


def _draw_growth(axes: Axes, at: xr.Dataset, colour: str, speed: float) -> None:
    """Largest velocity in every half millisecond from the first slip on, and the slope that stability gives."""
    first = float(at["first_slip_time"])
    elapsed = at["elapsed"].values
    if np.isnan(first) or first > elapsed[-1]:
        return
    rest = float(np.mean(at["velocity_B"].values[-len(elapsed) // 4 :].astype(float)))
    since = (elapsed >= first) & (elapsed < first + FOLLOWED)
    time, away = elapsed[since] - first, np.abs(at["velocity_B"].values[since].astype(float) - rest)
    edges = np.unique(np.searchsorted(time, np.arange(0.0, time[-1], FOLLOWED / 200)))
    time, largest = time[edges], np.maximum.reduceat(away, edges)
    axes.plot(time, np.where(largest > NOTHING * abs(speed), largest, np.nan), color=colour)
    rate = float(at["mode_growth_rate"])
    if rate > 0.0:
        # Growth is linear until it comes near what it saturates at.
        last = int(np.argmax(largest >= 0.5 * np.median(largest)))
        ends = np.array([time[last] - 3.0 / rate, time[last]])
    else:
        last = int(np.searchsorted(time, 0.2 * FOLLOWED))
        ends = np.array([time[last], 0.8 * FOLLOWED])
    slope = 2.0 * largest[last] * np.exp(rate * (ends - time[last]))
    axes.plot(ends, slope, color=figures.RED, linestyle="--", zorder=3.0)


STUDY = Study(
    name="fig11",
    title="Fig. 11: velocity of B at 10 and 15 degrees",
    question="At which inclination does the rig vibrate, and at which does it slide steadily, with the published "
    "scheme's numerical damping?",
    paper="Section 3.6, Fig. 11 and Table 6: measured at 2 mm/s, the rig vibrates at 2700 Hz at 10 degrees; at 15 "
    "degrees, as above 12 degrees and at negative angles, it slides steadily.",
    axes={"theta": Axis(np.array(sorted(paper.ANGLES)), "degree", "inclination of P1")},
    settings={"V": Setting(paper.ANGLES_SPEED, "m s-1", "velocity of P2's clamp")}
    | transients.run_settings(1.0, transients.PUBLISHED)
    | {"sample_rate": Setting(40e3, "Hz", "sampling rate of the recorded series")}
    | {name: setting for name, setting in rig_settings().items() if name != "theta"},
    function=histories,
    variables=VARIABLES,
    constants=transients.constants("V", "mu", "F", "sample_rate"),
    coords=transients.series_coords,
    check=transients.check,
    options={"batch_multiple": BATCH_MULTIPLE},
    draw=draw,
    findings=findings,
    record=recording.on_own_times,
)
