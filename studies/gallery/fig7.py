"""Fig. 7: velocity of point B in time, and its spectrum, at three speeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import xarray as xr

from fivcore import Scene, Transient
from studies import paper
from studies.answering.claims import is_papers_point
from studies.answering.measured import Signal
from studies.answering.results import rig_of, with_variables
from studies.declaring import labels
from studies.declaring.parameters import RUN, published
from studies.motion import regimes, run, series
from studies.plotting import figures, planes, signals
from studies.study import Claim, Parameter, Study
from sweeps import Variable

# Rows of the figure, of more speeds an evenly spaced subset; depth of the spectra, dB.
MOST_ROWS, DEPTH = 6, 100.0
SPECTRA = {
    "spectrum": "power spectral density of the velocity of B after settling",
    "spectrum_vibrating": "power spectral density of the velocity of B after settling, outside long sticks",
    "spectrum_stuck": "power spectral density of the velocity of B within long sticks",
}
OUTPUTS = {
    "velocity_B": Variable("m s-1", "velocity of B along x", ("elapsed",), "float32", digits=3),
    "long_stick": Variable("1", "within a long stick", ("elapsed",), "int8", flags={0: "no", 1: "yes"}),
    **{name: Variable("m2 s-1", text, ("frequency",), "float32") for name, text in SPECTRA.items()},
    **run.SUMMARY,
}
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
    """Add the modes of the rig with its contact glued, which ring while it sticks, and the spectral lines."""
    glued = regimes.glued_modes(rig_of(dataset), float(dataset["theta"]))
    return with_variables(dataset, regimes.lines_of(dataset) | glued)


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Kind of vibration, spectral peaks and long sticks."""
    points = [dataset.isel(V=k) for k in range(dataset.sizes["V"])]
    kinds = ", ".join(f"{regimes.kind(point)} at {labels.named('V', point['V'])[4:]}" for point in points)
    yield f"The vibration is {kinds}, {regimes.damping_text(dataset)}."
    yield (
        f"Statistics and spectra start {run.SETTLING:g} s after the first slip; periodicity is the "
        "autocorrelation after 20 periods, line height that of the main line over the median around it."
    )
    names = "regime stick_fraction slip_fraction separation_fraction velocity_rms periodicity line_height_dB"
    yield "Motion", labels.frame(dataset, ["V", *names.split()])
    names = "first_slip_time first_separation_time long_sticks mean_stick_time"
    yield "Begin and long sticks", labels.frame(dataset, ["V", *names.split()])
    table = dataset.assign(dominant_frequency=regimes.dominant_frequency(dataset))
    peaks = labels.frame(table, ["V", "dominant_frequency"])
    for k, order in enumerate(dataset["harmonic"].values):
        peaks[f"harmonic {order} Hz"] = dataset["harmonic_frequency"].isel(harmonic=k).values
    for target in paper.OTHER_LINES:
        spectra = [(point["frequency"].values, point["spectrum_stuck"].values) for point in points]
        peaks[f"stuck, near {target:.0f} Hz"] = [series.peak_near(*each, target, 0.08) for each in spectra]
    yield "Spectral peaks: while vibrating, and within long sticks, where the glued rig rings", peaks


def draw(dataset: xr.Dataset, measured: Signal | None = None) -> figures.Figure:
    """Series on the left, spectra on the right, a row for each speed as in the paper; `measured` in a last."""
    rows = planes.subset(dataset.sizes["V"], MOST_ROWS)
    figure, panels = signals.series_panels(len(rows) + (measured is not None))
    if measured is not None:
        _draw_measured(panels, measured)
    papers = is_papers_point(dataset, mu=paper.MU, F=paper.LOAD, theta=paper.THETA)
    for k, (left, part, right) in zip(rows, panels, strict=False):
        _draw_speed(left, part, right, dataset.isel(V=k))
        if papers and float(dataset["V"][k]) in paper.SPEEDS:
            signals.mark_lines(right, paper.LINES, "--", "dominant frequency and harmonics")
            signals.mark_lines(right, paper.OTHER_LINES, ":", "other peaks")
    signals.compare(panels, float(dataset["duration"]), DEPTH)
    figures.legend_below(figure, [axes for row in panels for axes in row], 3)
    figure.suptitle(f"Velocity of B along x{planes.of_all(rows, dataset.sizes['V'], 'speeds')}")
    return figure


def _draw_speed(left: figures.Axes, part: figures.Axes, right: figures.Axes, point: xr.Dataset) -> None:
    """One row; the panels of a speed that failed stay empty."""
    kind, main = regimes.kind(point), float(point["dominant_frequency"])
    left.set_title(f"{labels.named('V', point['V'])}: {kind}", loc="left")
    if kind == "failed":
        return
    elapsed, frequency = point["elapsed"].values, point["frequency"]
    velocity = 1e3 * point["velocity_B"].values.astype(float)
    figures.trace(left, elapsed, velocity, color=figures.BLUE)
    signals.mark_parts(left, elapsed, point["long_stick"].values == 1.0, "long stick")
    signals.spectrum(right, frequency, point["spectrum"], linewidth=1.0, label="after settling")
    signals.spectrum(right, frequency, point["spectrum_stuck"], color=figures.BLACK, label="within long sticks")
    if np.isfinite(main):
        signals.periods(part, elapsed, velocity, main, color=figures.BLUE)
        right.set_title(f"{main:.0f} Hz dominates", loc="left")


def _draw_measured(panels: Sequence[Sequence[figures.Axes]], signal: Signal) -> None:
    """A measured `velocity` in the last row of panels, mm/s, and its spectrum in all of the right column."""
    time, frequency = np.arange(len(signal.values)) / signal.rate, series.frequencies(signal.rate).values
    power = series.spectrum(signal.values, np.ones(len(time), dtype=bool), signal.rate)
    left, part, _ = panels[-1]
    left.set_title(f"measured: {signal.name}", loc="left")
    figures.trace(left, time, 1e3 * signal.values, color=figures.ORANGE)
    signals.periods(part, time, 1e3 * signal.values, float(frequency[np.nanargmax(power)]), color=figures.ORANGE)
    for _, _, right in panels:
        signals.spectrum(right, frequency, power, color=figures.ORANGE, label="measured")


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
    figure=draw, claims=CLAIMS, chaotic=True, beams=True, roles=("measured",),
)  # fmt: skip
