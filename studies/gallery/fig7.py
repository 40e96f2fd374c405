"""Fig. 7: velocity of point B in time, and its spectrum, at three speeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from fivcore import Rig, Transient, glued_frequencies
from studies import paper
from studies.claims import Claim, beside
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
CLAIMS = (
    *(Claim("regime", {"V": V}, kind, "2 and 3.5.3") for V, kind in paper.VIBRATION.items()),
    *(Claim("dominant_frequency", {"V": V}, paper.SIMULATED_LINE, "3.5.3") for V in paper.SPEEDS),
)


def histories(
    points: Mapping[str, Any], *, sample_rate: float, record: Sequence[str] = (), **fixed: Any
) -> dict[str, Any]:
    """Velocity of B, its spectra, the summary figures and what else is recorded of each point's motion."""

    def values(run: Transient, series: np.ndarray, times: np.ndarray) -> dict[str, Any]:
        stuck, settled = transients.long_sticks(run, times), transients.settled(run, times)
        # Long sticks of the start count too: at 2 mm/s there are no others.
        spectra = [transients.spectrum(series, each, sample_rate) for each in (settled, settled & ~stuck, stuck)]
        return {"long_stick": stuck} | dict(zip(SPECTRA, spectra, strict=True))

    return recording.histories(points, fixed, values, ("velocity_B", "state"), record, sample_rate)


def with_glued_modes(dataset: xr.Dataset, *, rig: Rig, theta: float, **_: Any) -> xr.Dataset:
    """Add the modes of the glued rig, which ring while it sticks."""
    # Each element has three freedoms, one of P1 is held at A and two are glued.
    count = min(8, 3 * (rig.p1.elements + rig.p2.elements) - 1)
    frequency = glued_frequencies(rig, theta, count)
    about = {"units": "Hz", "long_name": "natural frequency of the rig glued at its contact"}
    return dataset.assign(glued_frequency=("glued_mode", frequency, about))


def findings(dataset: xr.Dataset) -> list[Part]:
    """Kind of vibration, peaks of the spectra and long sticks, beside the paper's."""
    fixed, glued = constants(dataset), dataset["glued_frequency"].values
    near = [f"{glued[np.abs(glued - f).argmin()]:.0f} Hz nearest to {f:.0f}" for f in paper.OTHER_LINES]
    speed: dict[str, Column] = {"V mm/s": ("V", ".4g", 1e3)}
    motion: dict[str, Column] = {
        "vibration": regimes.kind,
        **regimes.SHARES,
        "RMS mm/s": ("velocity_rms", ".1f", 1e3),
        "coherence": ("coherence", ".2f"),
        "first slip ms": ("first_slip_time", ".1f", 1e3),
        "separation ms": ("first_separation_time", ".1f", 1e3),
        "long sticks": ("long_sticks", ".0f"),
        "mean ms": ("mean_stick_time", ".1f", 1e3),
        "last ends s": (_last_stick, ".3f"),
    }
    lines: dict[str, Column] = {
        "dominant": (regimes.dominant_frequency, ".0f"),
        "2nd": (lambda at: _line(at, "spectrum_vibrating", 2.0 * float(regimes.dominant_frequency(at))), ".0f"),
        "3rd": (lambda at: _line(at, "spectrum_vibrating", 3.0 * float(regimes.dominant_frequency(at))), ".0f"),
    }
    for f in paper.OTHER_LINES:
        lines[f"stuck, about {f:.0f}"] = (partial(_line, spectrum="spectrum_stuck", about=f), ".0f")
    tones = Table.of(dataset, "V", speed | lines)
    if paper.is_point(dataset, mu=paper.MU, F=paper.LOAD, theta=paper.THETA):
        measured = [f"{f:.0f}" for f in (*paper.LINES, *paper.OTHER_LINES)]
        tones = Table(tones.heads, [*tones.rows, ["paper", *measured]])
    return [
        f"Velocity of B, theta = {fixed['theta']:g} degrees, mu = {fixed['mu']:g}, F = {fixed['F']:g} N, "
        f"{fixed['duration']:g} s, {transients.damping(fixed)}; "
        f"shares of time, RMS, coherence (autocorrelation after 20 periods) and spectra "
        f"from {transients.SETTLING:g} s after the first slip on.",
        "",
        Table.of(dataset, "V", speed | motion),
        "",
        "Peaks of the spectra, Hz: three while vibrating, two within long sticks, where the glued rig rings "
        f"(modes: {', '.join(near)}).",
        tones,
        *beside(dataset, CLAIMS),
    ]


def _line(at: xr.Dataset, spectrum: str, about: float) -> float:
    return transients.line_near(at["frequency"].values, at[spectrum].values, about)


def _last_stick(at: xr.Dataset) -> float:
    """When the last long stick ends, s."""
    inside = at["elapsed"].values[at["long_stick"].values == 1.0]
    return float(inside[-1]) if len(inside) else np.nan


def draw(dataset: xr.Dataset) -> Figure:
    """Draw time on the left and spectra on the right, a row for each speed, as the paper does."""
    fixed = constants(dataset)
    rows = transients.some(dataset.sizes["V"], MOST_ROWS)
    size: dict[str, Any] = {"width": 18.0, "height": 2.2 + 4.6 * len(rows)}
    shared: dict[str, Any] = {"sharex": "col", "sharey": "col", "gridspec_kw": {"width_ratios": (1.35, 1.0)}}
    figure, panels = figures.panels(len(rows), 2, **size, **shared)
    papers = paper.is_point(dataset, mu=paper.MU, F=paper.LOAD, theta=paper.THETA)
    for k, left, right in zip(rows, panels[::2], panels[1::2], strict=True):
        _draw_speed(left, right, dataset.isel(V=k))
        for lines, style, label in (
            (paper.LINES, "--", "paper: dominant frequency and harmonics"),
            (paper.OTHER_LINES, ":", "paper: other peaks"),
        ):
            for f in lines if papers and float(dataset["V"][k]) in paper.SPEEDS else ():
                right.axvline(f / 1e3, color=figures.RED, linestyle=style, linewidth=1.0, zorder=1.5, label=label)
    panels[0].set_xlim(0.0, fixed["duration"])
    top = panels[1].get_ylim()[1]
    panels[1].set(xlim=(0.0, transients.BAND / 1e3), ylim=(top - DECADES * 10.0, top))
    panels[-2].set_xlabel("time since the drive started / s")
    panels[-1].set_xlabel("frequency / kHz")
    figures.legend_below(figure, panels, 3)
    where = ", ".join(planes.named(name, fixed[name]) for name in ("theta", "mu", "F"))
    title = f"Velocity of B along x, {where}{transients.of_all(rows, dataset.sizes['V'])}"
    figure.suptitle(f"{title}\n{transients.damping(fixed)}")
    return figure


def _draw_speed(left: Axes, right: Axes, at: xr.Dataset) -> None:
    """One row; the panels of a speed that failed stay empty."""
    kind, main = regimes.kind(at), float(at["dominant_frequency"])
    left.set_title(f"{planes.named('V', at['V'])}: {kind}", loc="left")
    left.set_ylabel("velocity of B / (mm/s)")
    right.set_ylabel("PSD / dB re 1 (m/s)²/Hz")
    if kind == "failed":
        return
    elapsed, frequency = at["elapsed"].values, at["frequency"].values / 1e3
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
    settled, stuck = (figures.decibels(at[name]) for name in ("spectrum", "spectrum_stuck"))
    right.plot(frequency, settled, color=figures.BLUE, linewidth=1.0, label="after settling")
    right.plot(frequency, stuck, color=figures.BLACK, linewidth=0.8, label="within long sticks")
    if np.isfinite(main):
        right.set_title(f"dominant frequency {main:.0f} Hz", loc="left")


STUDY = Study(
    name="fig7",
    title="Fig. 7: velocity of B in time and its spectrum",
    question="How does point B vibrate at 1, 2 and 5 mm/s, in time and in frequency, with the published scheme's "
    "numerical damping?",
    paper="Sections 2 and 3.5.3, Figs. 2, 3 and 7: intermittent vibration at 1 and 2 mm/s, periodic at 5 mm/s; a "
    "dominant frequency of 2700 Hz with harmonics at 5400 and 8100 Hz, others at 2080 and 6500 Hz. "
    "Section 3.5.4.2: sticking phases half as long at 2 mm/s as at 1 mm/s.",
    axes={"V": Axis(np.array(paper.SPEEDS), "m s-1", "velocity of P2's clamp")},
    settings=transients.run_settings(2.5, transients.PUBLISHED)
    | {"sample_rate": Setting(25e3, "Hz", "sampling rate of the recorded series")}
    | rig_settings(),
    function=histories,
    variables=VARIABLES,
    constants=transients.constants("theta", "mu", "F", "sample_rate"),
    coords=transients.series_coords,
    check=transients.check,
    derive=with_glued_modes,
    options={"batch_multiple": BATCH_MULTIPLE},
    draw=draw,
    findings=findings,
    record=recording.on_own_times,
)
