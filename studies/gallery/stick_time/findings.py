"""What is said of the sticks: their laws beside the paper's, and how many there were."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from studies import paper
from studies.gallery.stick_time.fit import KINDS
from studies.motion import transients
from studies.study import constants
from studies.tables import Part, Table


def reference(dataset: xr.Dataset) -> xr.Dataset:
    """The part at the paper's friction and load, or the nearest there is."""
    return dataset.sel(mu=paper.MU, F=paper.LOAD, method="nearest")


def findings(dataset: xr.Dataset) -> list[Part]:
    """Sticks at each speed, the laws' exponents, the collapse over mu and F, and what the paper says."""
    at, given = reference(dataset), constants(dataset)
    lines: list[Part] = [
        f"Long sticks, theta = {given['theta']:g} degrees, mu = {float(at['mu']):g}, F = {float(at['F']):g} N, "
        f"{dataset.sizes['member']} members a speed; 95 % intervals over members.",
        f"Start-up: begun within {transients.SETTLING:g} s of the first slip; sustained: later.",
        "",
        _speeds(at),
        "",
        *_laws(at),
        "",
        *_collapse(dataset),
    ]
    failed = int((dataset["status"] == 2).sum())
    return lines + ([f"{failed} points failed and count for nothing."] if failed else [])


def _speeds(at: xr.Dataset) -> Table:
    """A line for each speed."""
    text, rows = transients.text, []
    for V in at["V"].values:
        here = at.sel(V=V)
        cells = [f"{1e3 * V:g}"]
        for kind in at["kind"].values:
            mean, low, high = (
                1e6 * V * float(here[f"mean_stick_time{end}"].sel(kind=kind)) for end in ("", "_low", "_high")
            )
            cells.append(str(int(here[f"{kind}_count"].sum())))
            cells.append("-" if np.isnan(mean) else f"{mean:.1f} ({low:.1f} to {high:.1f})")
        cells.append(text(here["local_exponent"].sel(kind="sustained"), 2))
        cells.append(text(100.0 * float(here["sustained_share"]), 1))
        rows.append(cells)
    heads = ["V mm/s", "start-up", "T V um", "sustained", "T V um", "local exponent", "% of the time"]
    return Table(heads, rows)


def _laws(at: xr.Dataset) -> list[str]:
    """Exponents, the ratio, the end of intermittence, and the first stick."""

    def with_interval(name: str, digits: int, **where: Any) -> str:
        value, low, high = (float(at[f"{name}{end}"].sel(**where)) for end in ("", "_low", "_high"))
        return "-" if np.isnan(value) else f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"

    text = transients.text
    end, early = float(at["intermittence_end"]), np.abs(_first_stick(at) / at["load_up_time"].values)
    slow = f"up to {1e3 * end / 3.0:.2f} mm/s" if np.isfinite(end) else "at the slowest speeds"
    speeds = " to ".join(f"{1e3 * V:g}" for V in sorted(paper.STICK_RATIO_SPEEDS))
    over = " / ".join(f"(T at {1e3 * V:g} mm/s)" for V in paper.STICK_RATIO_SPEEDS)
    slowest, largest = (
        float(np.nanmax(part)) if np.isfinite(part).any() else np.nan for part in (early[0], early)
    )
    return [
        f"Exponent, start-up, {speeds} mm/s: {with_interval('exponent', 3, law='start_up')}; paper -1.",
        f"{over}, start-up: {with_interval('start_up_ratio', 3)}; paper {paper.STICK_RATIO:g}.",
        f"Exponent, sustained, {slow}: {with_interval('exponent', 3, law='sustained_slow')}.",
        f"Exponent, sustained, up to the end of intermittence: {with_interval('exponent', 3, law='sustained')}.",
        f"Intermittence ends at {text(end, 2, 1e3)} mm/s: above, sustained sticks fill less than a "
        "tenth of the time.",
        "First stick, from the start of the drive: mu F / (k_t V) + ramp / 2 within "
        f"{text(slowest, 3, 100.0)} % at the slowest speed, {text(largest, 2, 100.0)} % at any.",
    ]


def _first_stick(at: xr.Dataset) -> Any:
    """Time of the first slip less that by which the static law gives it, s."""
    from studies.motion.ensembles import ramp_of

    ramp = constants(at)["ramp"]
    half = 0.5 * np.array([ramp_of(number, ramp) for number in at["member"].values])
    return (at["first_slip_time"] - at["load_up_time"]).transpose("V", "member").values - half


def _collapse(dataset: xr.Dataset) -> list[Part]:
    """Sticks at the paper's slowest speed for every mu and F, and what is left of them over mu F."""
    V = float(dataset["V"].sel(V=min(paper.SPEEDS), method="nearest"))
    slowest = float(dataset["V"].min())
    heads = [
        "mu",
        "F N",
        "start-up ms",
        "sustained ms",
        "T V / (mu F) um/N",
        "ends at mm/s",
        "at V / (mu F) mm/s/N",
    ]
    rows, text = [], transients.text
    for mu in dataset["mu"].values:
        for F in dataset["F"].values:
            at, grip = dataset.sel(mu=mu, F=F), mu * F or np.nan
            early, late = (at["mean_stick_time"].sel(V=V, kind=kind) for kind in KINDS)
            slow = at["mean_stick_time"].sel(V=slowest, kind="sustained")
            end = at["intermittence_end"]
            rows.append(
                [
                    f"{mu:g}",
                    f"{F:g}",
                    text(early, 1, 1e3),
                    text(late, 1, 1e3),
                    text(slow, 1, 1e6 * slowest / grip),
                    text(end, 2, 1e3),
                    text(end, 2, 1e3 / grip),
                ]
            )
    return [
        f"Stick times at {1e3 * V:g} mm/s, T V / (mu F) of sustained sticks at {1e3 * slowest:g} mm/s:",
        Table(heads, rows),
        "The paper: less friction or less load shortens the sticks. Loads collapse on V / F: they are copies of",
        "one motion. Friction does more than scale: the last columns differ from mu to mu.",
    ]
