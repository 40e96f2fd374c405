"""Fig. 7: velocity of point B in time, and its spectrum, at three speeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from fivcore import Rig, Transient, glued_frequencies
from studies import paper
from studies.motion import recording, regimes, transients
from studies.motion.jobs import BATCH_MULTIPLE, Job, outcomes
from studies.plotting import figures
from studies.rig import rig_of, rig_settings
from studies.study import Setting, Study, constants
from studies.tables import Part, Table
from sweeps import Axis, Grid, Sweep, Variable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Rows of the figure; of more speeds it shows so many, evenly chosen.
MOST_ROWS = 6
# Depth of the spectra shown, in powers of ten.
DECADES = 10.0
SPECTRA = {
    "spectrum": "power spectral density of the velocity of B after settling",
    "spectrum_vibrating": "power spectral density of the velocity of B after settling, outside long sticks",
    "spectrum_stuck": "power spectral density of the velocity of B within long sticks",
}


VARIABLES = (
    {
        "velocity_B": Variable("m s-1", "velocity of B along x", ("elapsed",), "float32", digits=3),
        "long_stick": Variable(
            "1", "whether within a long stick", ("elapsed",), "int8", flags={0: "no", 1: "yes"}
        ),
    }
    | {name: Variable("m2 s-1", text, ("frequency",), "float32") for name, text in SPECTRA.items()}
    | transients.SUMMARY
)


def histories(
    points: Mapping[str, Any], *, sample_rate: float, record: Sequence[str] = (), **fixed: Any
) -> dict[str, Any]:
    """Velocity of B, its spectra, the summary figures and what else is recorded of each point's motion."""
    times = transients.even_times(fixed["duration"], sample_rate).values

    own = {"record": ("velocity_B", "state"), "sample_rate": transients.OVERSAMPLING * sample_rate}

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        run = runs[0]
        series = transients.velocity(run, times, sample_rate)
        stuck, settled = transients.long_sticks(run, times), transients.settled(run, times)
        # Long sticks of the start count too: at 2 mm/s there are no others.
        chosen = (settled, settled & ~stuck, stuck)
        spectra = [transients.spectrum(series, flags, sample_rate) for flags in chosen]
        return (
            {"velocity_B": series, "long_stick": stuck}
            | dict(zip(SPECTRA, spectra, strict=True))
            | recording.series(runs[-1], record)
            | transients.figures_of(run)
        )

    every = transients.scenes(points, fixed)
    return outcomes([recording.jobs(scene, fixed, own, record, times) for scene in every], values)


def finish(dataset: xr.Dataset, *, rig: Rig, theta: float) -> xr.Dataset:
    """Add the modes of the glued rig, which ring while it sticks."""
    # Each element has three freedoms, one of P1 is held at A and two are glued.
    count = min(8, 3 * (rig.p1.elements + rig.p2.elements) - 1)
    frequency = glued_frequencies(rig, theta, count)
    about = {"units": "Hz", "long_name": "natural frequency of the rig glued at its contact"}
    return dataset.assign(glued_frequency=("glued_mode", frequency, about))


def build(axes: Mapping[str, Axis], settings: Mapping[str, float]) -> Sweep:
    """The sweep over V."""
    rig, theta = rig_of(settings)
    fixed = transients.held(settings, rig, "theta", "mu", "F")
    sample_rate = settings["sample_rate"]
    grid = Grid(axes)
    transients.check(axes, fixed | {"sample_rate": sample_rate})
    return Sweep(
        "fig7",
        histories,
        grid,
        VARIABLES,
        fixed | {"sample_rate": sample_rate},
        coords={
            "elapsed": transients.even_times(settings["duration"], sample_rate),
            "frequency": transients.frequencies(sample_rate),
        },
        title="Velocity of B at several speeds (Fig. 7)",
        derive=partial(finish, rig=rig, theta=theta),
        batch_multiple=BATCH_MULTIPLE,
    )


def findings(dataset: xr.Dataset) -> list[Part]:
    """Kind of vibration, lines of the spectra and long sticks, beside the paper's."""
    given, text = constants(dataset), transients.text
    papers = paper.is_point(dataset, mu=paper.MU, F=paper.LOAD, theta=paper.THETA)
    lines: list[Part] = [
        f"Velocity of B, theta = {given['theta']:g} degrees, mu = {given['mu']:g}, F = {given['F']:g} N, "
        f"{given['duration']:g} s. Shares of time, RMS and spectra: from {transients.SETTLING:g} s after the "
        "first slip on.",
        "",
    ]
    rows, tones = [], []
    for k, speed in enumerate(dataset["V"].values):
        at = dataset.isel(V=k)
        said = paper.VIBRATION.get(speed, "-") if papers else "-"
        rows.append(
            [
                f"{1e3 * speed:.4g}",
                regimes.kind(at),
                said,
                *(text(at[f"{name}_fraction"], 3) for name in transients.STATES[1:] + transients.STATES[:1]),
                text(at["velocity_rms"], 1, 1e3),
                text(at["first_slip_time"], 1, 1e3),
                text(at["first_separation_time"], 1, 1e3),
                text(at["long_sticks"], 0),
                text(at["mean_stick_time"], 1, 1e3),
            ]
        )
        free, stuck = (_peaks(at, name, dataset) for name in ("spectrum_vibrating", "spectrum_stuck"))
        main = [text(at["dominant_frequency"], 0), *(text(f, 0) for f in free[1:])]
        tones.append([f"{1e3 * speed:.4g}", *main, *(text(f, 0) for f in stuck)])
    heads = ["V mm/s", "vibration", "paper", "stick", "slip", "separation", "RMS mm/s", "first slip ms"]
    lines.append(Table([*heads, "separation ms", "long sticks", "mean ms"], rows))
    printed = [f"{f:.0f}" for f in (*paper.LINES, *paper.OTHER_LINES)]
    lines += ["", "Lines of the spectra, Hz: three while vibrating, two within long sticks."]
    tones += [["paper", *printed]] if papers else []
    lines.append(Table(["V mm/s", "main", "2nd", "3rd", "stuck", "stuck"], tones))
    glued = dataset["glued_frequency"].values
    near = [glued[np.abs(glued - f).argmin()] for f in paper.OTHER_LINES]
    lines.append(
        f"Glued modes of this rig nearest to the paper's other lines: {near[0]:.0f} and {near[1]:.0f} Hz."
    )
    return lines + (_differences(dataset) if papers else [])


def _peaks(at: xr.Dataset, name: str, dataset: xr.Dataset) -> list[float]:
    """Frequencies nearest to the paper's lines of that kind, Hz."""
    targets: tuple[float, ...] = paper.OTHER_LINES
    main = float(at["dominant_frequency"])
    if name == "spectrum_vibrating":
        targets = tuple(k * main for k in (1, 2, 3))
    frequency = dataset["frequency"].values
    return [transients.line_near(frequency, at[name].values, target) for target in targets]


def _differences(dataset: xr.Dataset) -> list[Part]:
    """Where the model and the paper part."""
    lines: list[Part] = [""]
    speeds = dataset["V"].values
    for k, speed in enumerate(speeds):
        at = dataset.isel(V=k)
        regime, said = regimes.kind(at), paper.VIBRATION.get(speed)
        main = float(at["dominant_frequency"])
        if np.isfinite(main):
            away = 100.0 * (main / paper.SIMULATED_LINE - 1.0)
            lines.append(
                f"{1e3 * speed:.4g} mm/s: main line {main:.0f} Hz, {away:+.1f} % from the paper's "
                f"{paper.SIMULATED_LINE:.0f} Hz."
            )
        if said == "intermittent" and regime in ("periodic", "irregular"):
            last = dataset["elapsed"].values[at["long_stick"].values == 1.0]
            until = f"; the last long stick ends at {last[-1]:.3f} s" if len(last) else ""
            lines.append(
                f"{1e3 * speed:.4g} mm/s: the paper sees intermittence; here it does not last ({regime}){until}."
            )
        if said == "periodic" and regime == "irregular" and np.isfinite(at["coherence"]):
            lines.append(
                f"{1e3 * speed:.4g} mm/s: periodic to the paper; here one frequency dominates, but after 20 "
                f"periods the autocorrelation is {float(at['coherence']):.2f}."
            )
    slow, fast = (np.flatnonzero(speeds == speed) for speed in (1e-3, 2e-3))
    if len(slow) and len(fast):
        both = dataset["mean_stick_time"].values[[fast[0], slow[0]]]
        counts = dataset["long_sticks"].values[[fast[0], slow[0]]]
        if np.all(np.isfinite(both)):
            lines.append(
                f"Mean long stick at 2 mm/s over that at 1 mm/s: {both[0] / both[1]:.2f} "
                f"({1e3 * both[0]:.1f} ms of {counts[0]:.0f}, {1e3 * both[1]:.1f} ms of {counts[1]:.0f}); "
                f"paper {paper.STICK_RATIO:g}."
            )
    return lines


def draw(dataset: xr.Dataset) -> Figure:
    """As in the paper: time on the left, spectra on the right, a row for each speed."""
    given = constants(dataset)
    rows = transients.some(dataset.sizes["V"], MOST_ROWS)
    figure, panels = figures.panels(
        len(rows),
        2,
        18.0,
        2.2 + 4.6 * len(rows),
        sharex="col",
        sharey="col",
        gridspec_kw={"width_ratios": (1.35, 1.0)},
    )
    elapsed, frequency = dataset["elapsed"].values, dataset["frequency"].values / 1e3
    papers = paper.is_point(dataset, mu=paper.MU, F=paper.LOAD, theta=paper.THETA)
    for k, left, right in zip(rows, panels[::2], panels[1::2], strict=True):
        at = dataset.isel(V=k)
        name = regimes.kind(at)
        left.set_title(f"V = {1e3 * float(at['V']):.4g} mm/s: {name}", loc="left")
        left.set_ylabel("velocity of B / (mm/s)")
        right.set_ylabel("PSD / dB re 1 (m/s)²/Hz")
        if name == "failed":
            continue
        figures.trace(left, elapsed, 1e3 * at["velocity_B"].values.astype(float), color=figures.BLUE)
        sticks = transients.stretches(at["long_stick"].values == 1.0)
        left.broken_barh(
            [(elapsed[begin], elapsed[end - 1] - elapsed[begin]) for begin, end in sticks],
            (0.0, 0.045),
            snap=False,  # or what is narrower than a pixel may vanish
            transform=left.get_xaxis_transform(),
            color=figures.BLACK,
            linewidth=0.0,
            label="long stick",
        )
        for line, colour, width, label in (
            ("spectrum", figures.BLUE, 1.0, "after settling"),
            ("spectrum_stuck", figures.BLACK, 0.8, "within long sticks"),
        ):
            right.plot(frequency, _decibels(at[line].values), color=colour, linewidth=width, label=label)
        main = float(at["dominant_frequency"])
        if np.isfinite(main):
            right.set_title(f"main line {main:.0f} Hz", loc="left")
    for right in panels[1::2] if papers else ():
        for lines, style, label in (
            (paper.LINES, "--", "paper: main line and harmonics"),
            (paper.OTHER_LINES, ":", "paper: other lines"),
        ):
            for f in lines:
                right.axvline(f / 1e3, color=figures.RED, linestyle=style, linewidth=1.0, zorder=1.5, label=label)
    panels[0].set_xlim(0.0, given["duration"])
    panels[1].set_xlim(0.0, transients.BAND / 1e3)
    top = panels[1].get_ylim()[1]
    panels[1].set_ylim(top - DECADES * 10.0, top)
    panels[-2].set_xlabel("time since the drive started / s")
    panels[-1].set_xlabel("frequency / kHz")
    figures.legend_below(figure, panels, 3)
    figure.suptitle(
        f"Velocity of B along x, θ = {given['theta']:g}°, μ = {given['mu']:g}, F = {given['F']:g} N"
        + transients.of_all(rows, dataset.sizes["V"])
    )
    return figure


def _decibels(power: np.ndarray) -> np.ndarray:
    return np.asarray(10.0 * np.log10(np.maximum(power.astype(float), 1e-30)))


STUDY = Study(
    name="fig7",
    title="Fig. 7: velocity of B in time and its spectrum",
    question="How does point B vibrate at 1, 2 and 5 mm/s, in time and in frequency?",
    paper="Sections 2 and 3.5.3, Figs. 2, 3 and 7: intermittent vibration at 1 and 2 mm/s, periodic at 5 mm/s; a "
    "main line at 2700 Hz with harmonics at 5400 and 8100 Hz, others at 2080 and 6500 Hz. Section 3.5.4.2: "
    "sticking phases half as long at 2 mm/s as at 1 mm/s.",
    axes={"V": Axis(np.array(paper.SPEEDS), "m s-1", "velocity of P2's clamp")},
    settings=transients.run_settings(2.5)
    | {"sample_rate": Setting(25e3, "Hz", "of the series kept")}
    | rig_settings(),
    build=build,
    draw=draw,
    findings=findings,
    record=recording.on_own_times,
)
