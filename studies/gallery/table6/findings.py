"""What is said of the inclinations: a table, the windows, and where paper and model part."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies import paper
from studies.gallery.table6.windows import NOT_STATED, SLIDES, STATED, STEADY, VIBRATES, VIBRATING
from studies.motion import regimes, transients
from studies.motion.regimes import KINDS
from studies.study import constants
from studies.tables import Part, Table
from sweeps import DONE, FAILED

# Rows of the table, angles named in a sentence, and failures told.
MOST_ROWS, MOST_NAMED, MOST_FAILURES = 31, 8, 5
# Members whose main lines lie further apart than this share hear two rival lines, not one that scatters.
RIVAL = 0.05


def findings(dataset: xr.Dataset) -> list[Part]:
    """Stability and motion at each inclination, windows of instability, and the paper's text beside them."""
    given = constants(dataset)
    papers = paper.is_point(dataset, mu=paper.MU, F=paper.LOAD, V=paper.ANGLES_SPEED)
    lines: list[Part] = [
        f"Steady sliding and motion at {_count(dataset.sizes['theta'])}, V = {1e3 * given['V']:g} mm/s, "
        f"mu = {given['mu']:g}, F = {given['F']:g} N; modes below {transients.BAND / 1e3:g} kHz, "
        f"{given['members']} runs{_length(dataset)} at each; figures from {transients.SETTLING:g} s after first"
        " slip on.",
        "",
        *_table(dataset, papers),
        "",
        *_windows(dataset),
        "",
        *_stability_beside_motion(dataset),
        *_cut_short(dataset),
        *_members(dataset),
    ]
    if papers:
        lines += ["", *_beside_paper(dataset)]
    return [*lines, *_overflow(dataset), *_failures(dataset)]


def _table(dataset: xr.Dataset, papers: bool) -> list[Part]:
    """A line for each inclination; of many, evenly chosen ones and those of which the paper gives a number."""
    theta, text, kinds = dataset["theta"].values, transients.text, regimes.kinds(dataset)
    named = np.flatnonzero(np.isin(theta, [*paper.ANGLES_MEASURED, *paper.ANGLES]))
    rows = sorted({*transients.some(len(theta), MOST_ROWS), *(int(k) for k in named)})
    heads = ["theta deg", "unstable Hz (1/s)", "fastest 1/s", "vibration", "runs", "main line Hz", "of all"]
    heads += ["RMS mm/s", "stick", "apart"]
    lines = []
    for k in rows:
        at = dataset.isel(theta=k)
        low, high = _range(at)
        pairs = zip(at["frequency"].values, at["growth_rate"].values, strict=True)
        cells = [
            f"{theta[k]:g}",
            ", ".join(f"{f:.0f} ({g:.0f})" for f, g in pairs if np.isfinite(f)) or "-",
            text(at["mode_growth_rate"], 0),
            KINDS[kinds[k]],
            text(at["regime_share"], 0, dataset.sizes["member"]),
            text(at["dominant_frequency"], 0),
            "-" if np.isnan(low) else f"{low:.0f}-{high:.0f}",
            text(at["velocity_rms"], 2, 1e3),
            *(text(at[f"{state}_fraction"], 3) for state in ("stick", "separation")),
        ]
        lines.append([*cells, _said(at)] if papers else cells)
    found: list[Part] = [Table([*heads, "paper's text"] if papers else heads, lines)]
    left = len(theta) - len(rows)
    found += [f"and {left} more in the file."] if left else []
    return [
        *found,
        "",
        "Unstable: frequencies with their growth rates; fastest: growth rate of the least stable mode.",
        "Vibration: of most runs, and of how many; main line: median of the runs that vibrate, and range of all.",
    ]


def _said(at: xr.Dataset) -> str:
    """What the paper's text says of an inclination; nothing where it says nothing."""
    code, measured = int(at["stated_paper"]), float(at["measured_frequency_paper"])
    if code == NOT_STATED:
        return ""
    return STATED[code] + ("" if np.isnan(measured) else f" at {measured:.0f} Hz")


def _range(at: xr.Dataset) -> tuple[float, float]:
    """Lowest and highest main line of the runs that vibrate, Hz; NaN where none does."""
    known = at["member_dominant_frequency"].values
    known = known[np.isfinite(known)]
    return (float(known.min()), float(known.max())) if len(known) else (np.nan, np.nan)


def _windows(dataset: xr.Dataset) -> list[Part]:
    """A line for each window of instability, and unstable modes that are in none."""
    theta, comment = dataset["theta"].values, dataset["window_from"].attrs.get("comment", "")
    where = f"from {theta.min():g} to {theta.max():g} degrees"
    if len(theta) == 1:
        return ["A single inclination has no window of instability; give a range of theta."]
    if comment:
        return [f"Windows of instability {where} could not be found: {comment}."]
    if not dataset.sizes["window"]:
        return [f"No pair has a window of instability {where}.", *_outside(dataset)]
    rows = []
    for k in range(dataset.sizes["window"]):
        at = dataset.isel(window=k)
        # A window that the range cuts off goes on beyond it.
        marks = {end: sign if int(at[f"window_open_{end}"]) else "" for end, sign in (("from", "<"), ("to", ">"))}
        bounds = [f"{mark} {float(at[f'window_{end}']):.3f}".strip() for end, mark in marks.items()]
        figures = ("frequency_from", "frequency_to", "peak_growth_rate")
        cells = [f"{float(at[f'window_{name}']):.0f}" for name in figures]
        rows.append([*bounds, *cells, f"{float(at['window_peak_theta']):.2f}"])
    heads = ["unstable from deg", "to deg", "from Hz", "to Hz", "largest growth 1/s", "at deg"]
    return [
        f"Windows of instability {where}, as roots and not on the grid:",
        Table(heads, rows),
        *_outside(dataset),
    ]


def _outside(dataset: xr.Dataset) -> list[str]:
    """Inclinations at which more modes are unstable than there are windows about them."""
    theta = dataset["theta"].values
    ends = dataset["window_from"].values, dataset["window_to"].values
    around = ((ends[0] <= theta[:, None]) & (theta[:, None] <= ends[1])).sum(axis=1)
    more = theta[dataset["unstable_modes"].values > around]
    if not len(more):
        return []
    return [f"A mode that does not begin to grow by flutter within the band is unstable at {_angles(more)}."]


def _stability_beside_motion(dataset: xr.Dataset) -> list[str]:
    """Whether the rig vibrates where a mode grows, and there alone."""
    theta, kinds = dataset["theta"].values, regimes.kinds(dataset)
    done = dataset["status"].values == DONE
    unstable = dataset["unstable_modes"].values > 0
    moves, rests = np.isin(kinds, VIBRATING), kinds == STEADY
    if np.any(done) and np.all((unstable & moves) | (~unstable & rests) | ~done):
        return ["The rig vibrates wherever a mode is unstable, and slides steadily wherever none is."]
    cases = (
        (done & moves & ~unstable, "The rig vibrates though no mode below 10 kHz is unstable"),
        (done & rests & unstable, "The rig slides steadily though a mode below 10 kHz is unstable"),
        (done & ~moves & ~rests, "The contact is stuck, or the runs are too short to tell,"),
    )
    return [f"{words} at {_angles(theta[chosen])}." for chosen, words in cases if np.any(chosen)]


def _length(dataset: xr.Dataset) -> str:
    """How long the runs are, in words; it changes a little with the stiffness, and so with the inclination."""
    known = dataset["duration"].values
    ends = [f"{end(known[np.isfinite(known)]):.2g}" for end in (np.min, np.max) if np.any(np.isfinite(known))]
    return f" of {' to '.join(dict.fromkeys(ends))} s" if ends else ""


def _cut_short(dataset: xr.Dataset) -> list[str]:
    """Inclinations at which the runs ended before they had the length that their own time scale asks."""
    most = constants(dataset)["most"]
    short = dataset["theta"].values[dataset["duration"].values >= most]
    return [f"At {_angles(short)} the runs were cut short at most = {most:g} s."] if len(short) else []


def _members(dataset: xr.Dataset) -> list[str]:
    """Inclinations at which the runs do not agree in kind, or have main lines far apart."""
    lines = []
    for k, theta in enumerate(dataset["theta"].values):
        at = dataset.isel(theta=k)
        codes = at["member_regime"].values
        found, counts = np.unique(codes[np.isfinite(codes)].astype(int), return_counts=True)
        low, high = _range(at)
        if len(found) > 1 or high > (1.0 + RIVAL) * low:
            kinds = ", ".join(f"{n} {transients.REGIMES[code]}" for code, n in zip(found, counts, strict=True))
            lined = "" if np.isnan(low) else f"; main lines from {low:.0f} to {high:.0f} Hz"
            lines.append(f"Runs differ at {theta:g} degrees: {kinds}{lined}.")
    more = len(lines) - MOST_NAMED
    return lines[:MOST_NAMED] + ([f"and at {more} more inclinations."] if more > 0 else [])


def _beside_paper(dataset: xr.Dataset) -> list[str]:
    """Where the paper's text and the model part, and what the text leaves open."""
    theta, kinds = dataset["theta"].values, regimes.kinds(dataset)
    said = dataset["stated_paper"].values
    silent = theta[said == NOT_STATED]
    lines = []
    if len(silent):
        lines.append(
            f"The body of the paper's Table 6 is not at hand: beside the model stands what the text says. Of "
            f"{_angles(silent)} it says nothing, and these cells stay empty."
        )
    spoken = (said != NOT_STATED) & (dataset["status"].values == DONE)
    expected = np.where(said == VIBRATES, np.isin(kinds, VIBRATING), kinds == STEADY)
    for code, words in ((VIBRATES, "vibrates"), (SLIDES, "slides steadily")):
        apart = np.flatnonzero(spoken & ~expected & (said == code))
        lines += [f"{theta[k]:g} degrees: to the paper the rig {words}; here: {KINDS[kinds[k]]}." for k in apart]
    if np.any(spoken) and np.all(expected[spoken]):
        lines.append(f"Wherever the text speaks ({_count(spoken.sum())}), the rig moves as it says.")
    return lines + _bounds(dataset) + _lines(dataset)


def _bounds(dataset: xr.Dataset) -> list[str]:
    """The ends of instability between what the paper's text calls steady and what it calls vibrating."""
    if not dataset.sizes["window"]:
        return []
    begin, end = int(np.argmin(dataset["window_from"].values)), int(np.argmax(dataset["window_to"].values))
    vibrating = list(paper.ANGLES_MEASURED)
    lines = []
    for which, place, left in (
        ("from", begin, (paper.STEADY_ANGLES[0], min(vibrating))),
        ("to", end, (max(vibrating), paper.STEADY_ANGLES[1])),
    ):
        if int(dataset[f"window_open_{which}"][place]):
            continue
        bound = float(dataset[f"window_{which}"][place])
        within = "" if left[0] <= bound <= left[1] else ", not between"
        lines.append(
            f"The text leaves a bound of instability between {left[0]:g} and {left[1]:g} degrees; here it is at "
            f"{bound:.2f}{within}."
        )
    return lines


def _lines(dataset: xr.Dataset) -> list[str]:
    """Main lines and unstable pairs beside the frequencies that the paper's text gives."""
    lines = []
    for theta in dataset["theta"].values:
        at = dataset.sel(theta=theta)
        main = float(at["dominant_frequency"])
        compared = [
            f"{100.0 * (main / float(at[f'{how}_frequency_paper']) - 1.0):+.1f} % from the {how} "
            f"{float(at[f'{how}_frequency_paper']):.0f} Hz"
            for how in ("measured", "simulated")
            if np.isfinite(main) and np.isfinite(at[f"{how}_frequency_paper"])
        ]
        if compared:
            lines.append(f"{theta:g} degrees: main line {main:.0f} Hz, {' and '.join(compared)} of the paper.")
        said, found = at["unstable_frequency_paper"].values, at["frequency"].values
        said, found = said[np.isfinite(said)], found[np.isfinite(found)]
        if len(said):
            lines.append(
                f"{theta:g} degrees: unstable pairs at {_hertz(found)} Hz; by the paper at {_hertz(said)} Hz."
            )
    return lines


def _hertz(values: NDArray[Any]) -> str:
    return _and([f"{value:.0f}" for value in values]) or "no"


def _angles(values: Sequence[float] | NDArray[Any]) -> str:
    """Inclinations in words: each of a few, else their number and range."""
    if len(values) > MOST_NAMED:
        return f"{len(values)} inclinations from {min(values):g} to {max(values):g} degrees"
    return f"{_and([f'{value:g}' for value in values])} degrees"


def _and(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else list(words))


def _count(number: int) -> str:
    return f"{number} inclination{'' if number == 1 else 's'}"


def _overflow(dataset: xr.Dataset) -> list[str]:
    """Inclinations at which not all unstable pairs have a place."""
    places = dataset.sizes["pair"]
    over = dataset["theta"].values[dataset["unstable_modes"].values > places]
    if not len(over):
        return []
    return [f"At {_angles(over)} more than {places} modes are unstable; the {places} that grow fastest are kept."]


def _failures(dataset: xr.Dataset) -> list[str]:
    failed = np.flatnonzero(dataset["status"].values == FAILED)
    theta, errors = dataset["theta"].values, dataset["error"].values
    lines = [f"failed: theta = {theta[k]:g}: {errors[k]}" for k in failed[:MOST_FAILURES]]
    more = len(failed) - MOST_FAILURES
    return lines + ([f"and {more} more failed."] if more > 0 else [])
