"""Table 6 as tables: stability and motion by inclination, windows of instability, and the paper's text beside."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from studies import paper
from studies.claims import Claim, beside
from studies.gallery import fig11
from studies.gallery.table6 import windows
from studies.motion import regimes, transients
from studies.study import constants
from studies.tables import Column, Part, Table, listed

# Rows of the table of all inclinations.
MOST_ROWS = 31
# Runs whose dominant frequencies lie further apart than this share have two rival peaks, not one that scatters.
RIVAL = 0.05
AT: dict[str, Any] = {"theta": paper.THETA, "V": paper.ANGLES_SPEED}
CLAIMS = (
    Claim("dominant_frequency", AT, paper.ANGLES_MEASURED[paper.THETA], "2, measured"),
    Claim("dominant_frequency", AT, paper.ANGLES_SIMULATED[paper.THETA], "3.5.3, simulated"),
    *(
        Claim("frequency", AT | {"pair": pair}, frequency, "3.4.2")
        for pair, frequency in enumerate(paper.ANGLES_UNSTABLE[paper.THETA], 1)
    ),
    *fig11.CLAIMS,
    *(Claim("regime", AT | {"theta": angles}, regimes.STEADY, "3.6, measured") for angles in paper.STEADY_ANGLES),
)


def findings(dataset: xr.Dataset) -> list[Part]:
    """Stability and motion at each inclination, windows of instability, and the paper's text beside them."""
    fixed, theta = constants(dataset), dataset["theta"].values
    unstable, pairs = dataset["unstable_modes"].values, dataset.sizes["pair"]
    inside = (dataset["window_from"] <= dataset["theta"]) & (dataset["theta"] <= dataset["window_to"])
    regime, line = dataset["member_regime"], dataset["member_dominant_frequency"]
    rival = line.max("member") > (1.0 + RIVAL) * line.min("member")
    cases = {
        "A mode is unstable that does not begin to grow by flutter within the band": unstable
        > inside.sum("window").values,
        f"More than {pairs} modes are unstable, and the {pairs} fastest are kept": unstable > pairs,
        "The runs differ in regime, or their dominant frequencies lie far apart": (
            (regime.max("member") > regime.min("member")) | rival
        ).values,
        f"The runs were cut short at most = {fixed['most']:g} s": dataset["duration"].values >= fixed["most"],
    }
    of_paper = paper.is_point(dataset, mu=paper.MU, F=paper.LOAD, V=paper.ANGLES_SPEED)
    return [
        f"Steady sliding and motion by inclination ({len(theta)}), V = {1e3 * fixed['V']:g} mm/s, "
        f"mu = {fixed['mu']:g}, F = {fixed['F']:g} N; modes below {transients.BAND / 1e3:g} kHz; "
        f"{fixed['members']} runs at each, {transients.damping(fixed)}, "
        f"their figures from {transients.SETTLING:g} s after first slip on.",
        "",
        *_by_inclination(dataset),
        "",
        *windows.report(dataset, fixed["mu"]),
        "",
        *_by_motion(dataset),
        *(f"{case}: theta = {listed(theta[where])} degrees." for case, where in cases.items() if where.any()),
        *regimes.failures(dataset),
        *beside(dataset, CLAIMS),
        *(["The body of the paper's Table 6 is not at hand: this is all that its text says."] if of_paper else []),
    ]


def _by_inclination(dataset: xr.Dataset) -> list[Part]:
    """A row for each inclination; of many, evenly chosen ones and those of which the paper gives a number."""
    theta = dataset["theta"].values
    named = np.flatnonzero(np.isin(theta, [*paper.ANGLES_MEASURED, *paper.ANGLES]))
    rows = sorted({*transients.some(len(theta), MOST_ROWS), *named.tolist()})
    columns: dict[str, Column] = {
        "theta deg": ("theta", "g"),
        "unstable Hz (1/s)": _pairs,
        "fastest 1/s": ("mode_growth_rate", ".0f"),
        "run s": ("duration", ".2g"),
        "vibration": regimes.kind,
        "runs": (lambda at: at["regime_share"] * at.sizes["member"], ".0f"),
        "dominant Hz": ("dominant_frequency", ".0f"),
        "of all": _lines,
        "RMS mm/s": ("velocity_rms", ".2f", 1e3),
        "stick": ("stick_fraction", ".3f"),
        "separation": ("separation_fraction", ".3f"),
    }
    return [
        Table.of(dataset.isel(theta=rows), "theta", columns),
        *([f"and {len(theta) - len(rows)} more in the file."] if len(rows) < len(theta) else []),
        "",
        "Unstable: frequencies with their growth rates; fastest: growth rate of the least stable mode.",
        "Vibration: of most runs, and of how many; dominant Hz: median of the runs that vibrate; range of all.",
    ]


def _pairs(at: xr.Dataset) -> str:
    pairs = zip(at["frequency"].values, at["growth_rate"].values, strict=True)
    return ", ".join(f"{f:.0f} ({g:.0f})" for f, g in pairs if np.isfinite(f)) or "-"


def _lines(at: xr.Dataset) -> str:
    """Lowest and highest dominant frequency of the runs that vibrate."""
    lines = at["member_dominant_frequency"]
    return "-" if lines.isnull().all() else f"{float(lines.min()):.0f}-{float(lines.max()):.0f}"


def _by_motion(dataset: xr.Dataset) -> list[Part]:
    """How many runs move in which way, by the number of unstable modes."""
    regime = dataset["member_regime"].values
    unstable = np.broadcast_to(dataset["unstable_modes"].values[:, None], regime.shape)
    counts = np.unique(unstable[np.isfinite(regime)])
    rows = [
        [transients.REGIMES[int(code)], *(f"{np.sum((regime == code) & (unstable == count))}" for count in counts)]
        for code in np.unique(regime[np.isfinite(regime)])
    ]
    heads = ["runs by unstable modes", *(f"{count:.0f}" for count in counts)]
    return [Table(heads, rows, words=1)] if rows else []
