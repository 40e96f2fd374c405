"""Fig. 11: velocity of point B at an inclination where the rig vibrates and at one where it slides steadily."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import xarray as xr

from fivcore import Scene, Transient
from studies import paper
from studies.answering.claims import is_papers_point
from studies.declaring import labels
from studies.declaring.parameters import RUN, published
from studies.motion import regimes, run, series
from studies.motion.stability import LEAST_STABLE, least_stable
from studies.plotting import figures, planes, signals
from studies.study import Claim, Parameter, Study
from sweeps import Variable

# Colours and line styles of the inclinations, of more an evenly spaced subset; depth of the spectra, dB.
LOOKS = ((figures.BLUE, "-"), (figures.ORANGE, "-"), (figures.GREEN, "--"), (figures.BLACK, ":"))
DEPTH = 200.0
OUTPUTS = {
    "velocity_B": Variable("m s-1", "velocity of B along x", ("elapsed",), "float32"),
    "spectrum": Variable("m2 s-1", "power spectral density of the velocity of B after settling", ("frequency",),
                         "float32"),
    **LEAST_STABLE, **run.SUMMARY,
}  # fmt: skip
CLAIMS = (
    Claim("dominant_frequency", {"theta": 10.0, "V": paper.ANGLES_SPEED}, paper.ANGLES[10.0], "3.6, measured"),
    Claim("regime", {"theta": 15.0, "V": paper.ANGLES_SPEED}, "steady sliding", "3.6, measured"),
)


def histories(
    scenes: Sequence[Scene], duration: float, sample_rate: float, record: Sequence[str], **options: Any
) -> dict[str, Any]:
    """Velocity of B, its spectrum, the summary and the linear stability of each scene."""

    def values(motion: Transient, velocity: np.ndarray, times: np.ndarray) -> dict[str, Any]:
        spectrum = series.spectrum(velocity, series.after_settling(motion, times), sample_rate)
        return {"spectrum": spectrum} | dict(zip(LEAST_STABLE, least_stable(motion.scene), strict=True))

    lengths: dict[str, Any] = {"duration": duration, "sample_rate": sample_rate}
    return series.histories(scenes, values, ("velocity_B",), record, **lengths, run=options)


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Motion and linear stability at each inclination."""
    points = [dataset.isel(theta=k) for k in range(dataset.sizes["theta"])]
    kinds = ", ".join(f"{labels.number(float(p['theta']))}° {regimes.kind(p)}" for p in points)
    yield f"Motion by inclination, {regimes.damping_text(dataset)}: {kinds}."
    names = ["theta", "regime", "dominant_frequency", "velocity_rms", "mode_growth_rate", "mode_frequency"]
    table = dataset.assign(dominant_frequency=regimes.dominant_frequency(dataset))
    yield "Motion and the least stable mode of steady sliding", labels.frame(table, names)


def draw(dataset: xr.Dataset) -> figures.Figure:
    """The histories as in the paper; below, how the vibration grows or decays, and the spectra."""
    chosen, layout = planes.subset(dataset.sizes["theta"], len(LOOKS)), [["top", "top"], ["growth", "tones"]]
    figure, panels = figures.mosaic(layout, 5.5, 6.5)
    top, growth, tones = panels.values()
    for k, (colour, style) in zip(chosen, LOOKS, strict=False):
        point = dataset.isel(theta=k)
        kind, main = regimes.kind(point), float(regimes.dominant_frequency(point))
        text = f"{labels.named('theta', point['theta'])}: {kind}" + f", dominant {main:.0f} Hz" * (main > 0.0)
        if kind == "failed":
            top.plot([], [], color=colour, linestyle=style, label=text)
            continue
        velocity = 1e3 * point["velocity_B"].values.astype(float)
        # A quiet trace would vanish under a loud one.
        above = 3.0 - 1e-3 * float(np.ptp(velocity[len(velocity) // 2 :]))
        figures.trace(top, point["elapsed"].values, velocity, color=colour, label=text, zorder=above)
        signals.growth(growth, point, colour)
        signals.spectrum(
            tones, point["frequency"], point["spectrum"], color=colour, linestyle=style, linewidth=1.0
        )
    top.set(xlim=(0.0, float(dataset["duration"])), xlabel="time since the drive started / s")
    top.set_ylabel("velocity of B / (mm/s)")
    growth.plot([], [], "--", color=figures.RED, label="growth of the least stable mode of steady sliding")
    growth.set(yscale="log", xlim=(0.0, signals.SLOPE), xlabel="time since the first slip / s")
    growth.set_ylabel("velocity of B about its mean,\nlargest in 0.5 ms / (m/s)")
    if is_papers_point(dataset, mu=paper.MU, F=paper.LOAD, V=paper.ANGLES_SPEED):
        signals.mark_lines(tones, [paper.ANGLES[10.0]], ":", "measured at 10°")
    signals.finish_spectra(tones, DEPTH)
    figures.entitle((top, growth, tones), ("motion", "growth and decay", "spectrum after settling"))
    figures.legend_below(figure, [top, growth, tones], 2)
    figure.suptitle(f"Velocity of B along x{planes.of_all(chosen, dataset.sizes['theta'], 'angles')}")
    return figure


STUDY = Study(
    name="fig11",
    title="Fig. 11: velocity of B at 10 and 15 degrees",
    question="At which inclination does the rig vibrate, and at which does it slide steadily, with the published "
    "scheme's numerical damping?",
    paper="Section 3.6, Fig. 11 and Table 6: measured at 2 mm/s, the rig vibrates at 2700 Hz at 10 degrees; at 15 "
    "degrees, as above 12 degrees and at negative angles, it slides steadily.",
    parameters={
        "theta": Parameter(np.array(sorted(paper.ANGLES)), "degree", "inclination of P1"),
        "duration": Parameter(1.0, "s", "simulated time", common=True),
        "sample_rate": Parameter(40e3, "Hz", "sampling rate of the series", common=True),
    }
    | published(RUN),
    outputs=OUTPUTS, function=histories, coords=series.coords, check=run.check, summary=summarise, figure=draw,
    claims=CLAIMS, chaotic=True, beams=True,
)  # fmt: skip
