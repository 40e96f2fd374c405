"""Fig. 7: velocity of point B in time, and its spectrum, at three speeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from fivcore import Scene, Transient, glued_frequencies
from studies import paper
from studies.answering.claims import is_papers_point
from studies.answering.measured import Signal
from studies.answering.results import rig_of
from studies.declaring import labels
from studies.declaring.parameters import RUN, published
from studies.motion import regimes, run, series
from studies.plotting import figures, planes
from studies.study import Claim, Parameter, Study
from sweeps import Variable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Rows of the figure; of more speeds an evenly spaced subset.
MOST_ROWS = 6
# Depth of the spectra drawn, dB.
DEPTH = 100.0
# A peak within this share of a multiple of the dominant frequency is its harmonic.
HARMONIC = 0.01
# The foot of the main line is the median within this share of its frequency.
FOOT = 0.25
SPECTRA = {
    "spectrum": "power spectral density of the velocity of B after settling",
    "spectrum_vibrating": "power spectral density of the velocity of B after settling, outside long sticks",
    "spectrum_stuck": "power spectral density of the velocity of B within long sticks",
}
OUTPUTS = (
    {
        "velocity_B": Variable("m s-1", "velocity of B along x", ("elapsed",), "float32", digits=3),
        "long_stick": Variable("1", "within a long stick", ("elapsed",), "int8", flags={0: "no", 1: "yes"}),
    }
    | {name: Variable("m2 s-1", text, ("frequency",), "float32") for name, text in SPECTRA.items()}
    | run.SUMMARY
)
CLAIMS = (
    *(Claim("regime", {"V": V}, kind, "2 and 3.5.3") for V, kind in paper.VIBRATION.items()),
    # A periodic motion has an autocorrelation of 1, and of its lines the paper gives no width.
    Claim("periodicity", {"V": max(paper.SPEEDS)}, 1.0, "2 and 3.5.3"),
    Claim("line_height_dB", {"V": max(paper.SPEEDS)}, np.nan, "no number"),
    *(Claim("dominant_frequency", {"V": V}, paper.SIMULATED_LINE, "3.5.3") for V in paper.SPEEDS),
)


def histories(
    scenes: Sequence[Scene], duration: float, sample_rate: float, record: Sequence[str], **options: Any
) -> dict[str, Any]:
    """Velocity of B, its spectra and the summary of each scene."""

    def values(motion: Transient, velocity: np.ndarray, times: np.ndarray) -> dict[str, Any]:
        stuck, settled = series.long_sticks(motion, times), series.after_settling(motion, times)
        # Long sticks of the start count too: at 2 mm/s there are no others.
        parts = (settled, settled & ~stuck, stuck)
        spectra = [series.spectrum(velocity, part, sample_rate) for part in parts]
        return {"long_stick": stuck} | dict(zip(SPECTRA, spectra, strict=True))

    lengths: dict[str, Any] = {"duration": duration, "sample_rate": sample_rate}
    return series.histories(scenes, values, ("velocity_B", "state"), record, **lengths, run=options)


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Add the modes of the glued rig, which ring while it sticks, and the harmonics of the dominant frequency."""
    rig = rig_of(dataset)
    # Each element has three freedoms, one of P1 is held at A and two are glued.
    count = min(8, 3 * (rig.p1.elements + rig.p2.elements) - 1)
    frequency = glued_frequencies(rig, float(dataset["theta"]), count)
    about = {"units": "Hz", "long_name": "natural frequency of the rig glued at its contact"}
    harmonics = [[_harmonic(dataset.isel(V=k), order) for order in (2, 3)] for k in range(dataset.sizes["V"])]
    text = "peak of the spectrum within 1 % of a multiple of the dominant frequency"
    height = {
        "units": "1",
        "long_name": "main line of the spectrum over the median within 25 % of its frequency, dB",
    }
    return dataset.assign_coords(
        harmonic=("harmonic", [2, 3], {"units": "1", "long_name": "order of the harmonic"})
    ).assign(
        glued_frequency=("glued_mode", frequency, about),
        harmonic_frequency=(("V", "harmonic"), harmonics, {"units": "Hz", "long_name": text}),
        line_height_dB=("V", [_line_height(dataset.isel(V=k)) for k in range(dataset.sizes["V"])], height),
    )


def _line_height(point: xr.Dataset) -> float:
    """Height of the main line over its foot, dB: how sharp it is; NaN without vibration."""
    main, frequency = float(regimes.dominant_frequency(point)), point["frequency"].values
    near = point["spectrum_vibrating"].values[np.abs(frequency - main) <= FOOT * main]
    return float(np.ptp(series.decibels([near.max(), np.median(near)]))) if near.size else np.nan


def _harmonic(point: xr.Dataset, order: int) -> float:
    target = order * float(regimes.dominant_frequency(point))
    return series.peak_near(point["frequency"].values, point["spectrum_vibrating"].values, target, HARMONIC)


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Kind of vibration, spectral peaks and long sticks."""
    kinds = ", ".join(
        f"{regimes.kind(point)} at {labels.named('V', point['V'])[4:]}" for point in _points(dataset)
    )
    yield f"The vibration is {kinds}, {regimes.damping_text(dataset)}."
    yield (
        f"Statistics and spectra start {run.SETTLING:g} s after the first slip; periodicity is the "
        "autocorrelation after 20 periods, line height that of the main line over the median around it."
    )
    shares = [f"{state}_fraction" for state in ("stick", "slip", "separation")]
    named = ["V", "regime", *shares, "velocity_rms", "periodicity", "line_height_dB"]
    yield "Motion", labels.frame(dataset, named)
    yield (
        "Begin and long sticks",
        labels.frame(dataset, ["V", "first_slip_time", "first_separation_time", "long_sticks", "mean_stick_time"]),
    )
    peaks = labels.frame(
        dataset.assign(dominant_frequency=regimes.dominant_frequency(dataset)), ["V", "dominant_frequency"]
    )
    for k, order in enumerate(dataset["harmonic"].values):
        peaks[f"harmonic {order} Hz"] = dataset["harmonic_frequency"].isel(harmonic=k).values
    for target in paper.OTHER_LINES:
        peaks[f"stuck, near {target:.0f} Hz"] = [
            series.peak_near(point["frequency"].values, point["spectrum_stuck"].values, target, 0.08)
            for point in _points(dataset)
        ]
    yield "Spectral peaks: while vibrating, and within long sticks, where the glued rig rings", peaks


def _points(dataset: xr.Dataset) -> list[xr.Dataset]:
    return [dataset.isel(V=k) for k in range(dataset.sizes["V"])]


def draw(dataset: xr.Dataset, measured: Signal | None = None) -> Figure:
    """Time on the left and spectra on the right, a row for each speed, as in the paper; `measured` in a last."""
    rows = planes.subset(dataset.sizes["V"], MOST_ROWS)
    shared: dict[str, Any] = {"sharex": "col", "sharey": "col", "gridspec_kw": {"width_ratios": (1.35, 1.0)}}
    count = len(rows) + (measured is not None)
    figure, panels = figures.panels(count, 2, 18.0, 3.2 + 4.6 * count, **shared)
    if measured is not None:
        _draw_measured(panels, measured)
    papers = is_papers_point(dataset, mu=paper.MU, F=paper.LOAD, theta=paper.THETA)
    for k, left, right in zip(rows, panels[::2], panels[1::2], strict=False):
        _draw_speed(left, right, dataset.isel(V=k))
        for lines, style, text in (
            (paper.LINES, "--", "paper: dominant frequency and harmonics"),
            (paper.OTHER_LINES, ":", "paper: other peaks"),
        ):
            for f in lines if papers and float(dataset["V"][k]) in paper.SPEEDS else ():
                right.axvline(f / 1e3, color=figures.RED, linestyle=style, linewidth=1.0, zorder=1.5, label=text)
    panels[0].set_xlim(0.0, float(dataset["duration"]))
    top = panels[1].get_ylim()[1]
    panels[1].set(xlim=(0.0, run.BAND / 1e3), ylim=(top - DEPTH, top))
    panels[-2].set_xlabel("time since the drive started / s")
    panels[-1].set_xlabel("frequency / kHz")
    figures.legend_below(figure, panels, 3)
    where = ", ".join(labels.named(name, dataset[name]) for name in ("theta", "mu", "F"))
    title = f"Velocity of B along x, {where}{planes.of_all(rows, dataset.sizes['V'])}"
    figure.suptitle(f"{title}\n{regimes.damping_text(dataset)}")
    return figure


def _draw_speed(left: Axes, right: Axes, point: xr.Dataset) -> None:
    """One row; the panels of a speed that failed stay empty."""
    kind, main = regimes.kind(point), float(point["dominant_frequency"])
    left.set_title(f"{labels.named('V', point['V'])}: {kind}", loc="left")
    left.set_ylabel("velocity of B / (mm/s)")
    right.set_ylabel("PSD / dB re 1 (m/s)²/Hz")
    if kind == "failed":
        return
    elapsed, frequency = point["elapsed"].values, point["frequency"].values / 1e3
    figures.trace(left, elapsed, 1e3 * point["velocity_B"].values.astype(float), color=figures.BLUE)
    sticks = series.runs_of_true(point["long_stick"].values == 1.0)
    spans = [(elapsed[begin], elapsed[end - 1] - elapsed[begin]) for begin, end in sticks]
    # Without snapping, which may hide what is narrower than a pixel.
    look: dict[str, Any] = {"snap": False, "color": figures.BLACK, "linewidth": 0.0, "label": "long stick"}
    left.broken_barh(spans, (0.0, 0.045), transform=left.get_xaxis_transform(), **look)
    right.plot(
        frequency, series.decibels(point["spectrum"]), color=figures.BLUE, linewidth=1.0, label="after settling"
    )
    stuck = series.decibels(point["spectrum_stuck"])
    right.plot(frequency, stuck, color=figures.BLACK, linewidth=0.8, label="within long sticks")
    if np.isfinite(main):
        right.set_title(f"dominant frequency {main:.0f} Hz", loc="left")


def _draw_measured(panels: Sequence[Axes], signal: Signal) -> None:
    """A measured `velocity` in the last row of panels, mm/s, and its spectrum in all of the right column."""
    time, frequency = np.arange(len(signal.values)) / signal.rate, series.frequencies(signal.rate).values / 1e3
    power = series.decibels(series.spectrum(signal.values, np.ones(len(time), dtype=bool), signal.rate))
    panels[-2].set_title(f"measured: {signal.name}", loc="left")
    panels[-2].set_ylabel("velocity / (mm/s)")
    figures.trace(panels[-2], time, 1e3 * signal.values, color=figures.ORANGE)
    for right in panels[1::2]:
        right.plot(frequency, power, color=figures.ORANGE, linewidth=0.8, label="measured")


STUDY = Study(
    name="fig7",
    title="Fig. 7: velocity of B in time and its spectrum",
    question="How does point B vibrate at 1, 2 and 5 mm/s, in time and in frequency, with the published scheme's "
    "numerical damping?",
    paper="Sections 2 and 3.5.3, Figs. 2, 3 and 7: intermittent vibration at 1 and 2 mm/s, periodic at 5 mm/s; a "
    "dominant frequency of 2700 Hz with harmonics at 5400 and 8100 Hz, others at 2080 and 6500 Hz. "
    "Section 3.5.4.2: sticking phases half as long at 2 mm/s as at 1 mm/s.",
    parameters={
        "V": Parameter(np.array(paper.SPEEDS), "m s-1", "speed of the drive"),
        "duration": Parameter(2.5, "s", "simulated time", common=True),
        "sample_rate": Parameter(25e3, "Hz", "sampling rate of the series", common=True),
    }
    | published(RUN),
    outputs=OUTPUTS, function=histories, coords=series.coords, check=run.check, derive=derive, summary=summarise,
    figure=draw, claims=CLAIMS, chaotic=True, beams=True,
)  # fmt: skip
