"""Sticks in numbers: their laws beside the paper's, and their counts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import xarray as xr

from studies import paper
from studies.claims import Claim, beside
from studies.gallery.stick_time.fit import SLOW
from studies.motion import transients
from studies.motion.ensembles import ramp_of
from studies.study import constants
from studies.tables import Column, Part, Table, number
from sweeps import FAILED


def reference(dataset: xr.Dataset) -> xr.Dataset:
    """The part at the paper's friction and load, or the nearest there is."""
    return dataset.sel(mu=paper.MU, F=paper.LOAD, method="nearest")


CLAIMS = (
    Claim("exponent", {"law": "start_up"}, -1.0, "3.5.4.2"),
    Claim("start_up_ratio", {}, paper.STICK_RATIO, "3.5.4.2"),
)


def findings(dataset: xr.Dataset) -> list[Part]:
    """Sticks at each speed, the laws' exponents, the collapse over mu and F, and the paper's statements."""
    at, fixed = reference(dataset), constants(dataset)
    early = _first_stick(at)
    failed = int((dataset["status"] == FAILED).sum())
    return [
        f"Long sticks, theta = {fixed['theta']:g} degrees, mu = {float(at['mu']):g}, F = {float(at['F']):g} N, "
        f"{dataset.sizes['member']} repeat runs a speed, {transients.damping(fixed)}; 95 % intervals over them.",
        f"Start-up: begun within {transients.SETTLING:g} s of the first slip; sustained: later.",
        "",
        Table.of(at, "V", SPEEDS),
        "",
        _laws(at),
        f"Intermittence ends at {number(at['intermittence_end'], '.2f', 1e3)} mm/s: above, sustained sticks fill "
        "less than a tenth of the time.",
        "First stick, from the start of the drive: mu F / (k_t V) + ramp / 2 within "
        f"{number(early[0], '.3f', 100.0)} % at the slowest speed, {number(early.max(), '.2f', 100.0)} % at any.",
        *beside(dataset, CLAIMS),
        "",
        *_collapse(dataset),
        *([f"{failed} points failed and count for nothing."] if failed else []),
    ]


def _interval(at: xr.Dataset, name: str, form: str, factor: float = 1.0) -> str:
    """A value with its interval; a dash where there is none."""
    value, low, high = (number(at[f"{name}{end}"], form, factor) for end in ("", "_low", "_high"))
    return value if value == "-" else f"{value} ({low} to {high})"


def _product(kind: str) -> Callable[[xr.Dataset], str]:
    """T V of one kind of stick, um, with its interval."""
    return lambda row: _interval(row.sel(kind=kind), "mean_stick_time", ".1f", 1e6 * float(row["V"]))


SPEEDS: dict[str, Column] = {
    "V mm/s": ("V", "g", 1e3),
    "start-up": (lambda row: row["start_up_count"].sum(), ".0f"),
    "T V um, start-up": _product("start_up"),
    "sustained": (lambda row: row["sustained_count"].sum(), ".0f"),
    "T V um, sustained": _product("sustained"),
    "local exponent": (lambda row: row["local_exponent"].sel(kind="sustained"), ".2f"),
    "% of the time": ("sustained_share", ".1f", 100.0),
}


def _laws(at: xr.Dataset) -> Table:
    """The exponents of T ~ V^n."""
    end = float(at["intermittence_end"])
    speeds = " to ".join(f"{1e3 * V:g}" for V in sorted(paper.STICK_RATIO_SPEEDS))
    over = {
        "start_up": f"start-up, {speeds} mm/s",
        "sustained_slow": f"sustained, up to {number(end, '.2f', 1e3 * SLOW)} mm/s",
        "sustained": "sustained, up to the end of intermittence",
    }
    rows = [[text, _interval(at.sel(law=law), "exponent", ".3f")] for law, text in over.items()]
    return Table(["law T ~ V^n", "n"], rows, words=1)


def _first_stick(at: xr.Dataset) -> xr.DataArray:
    """By which share at most the first slip's time departs from the static law at each speed."""
    late = at["first_slip_time"] - 0.5 * ramp_of(at["member"], constants(at)["ramp"]) - at["loading_time"]
    share: xr.DataArray = abs(late / at["loading_time"]).max("member")
    return share


def _collapse(dataset: xr.Dataset) -> list[Part]:
    """Sticks at the paper's slowest speed for every mu and F, and what is left of them over mu F."""
    V = float(dataset["V"].sel(V=min(paper.SPEEDS), method="nearest"))
    slowest = float(dataset["V"].min())
    scenes = dataset.drop_dims("member").stack(scene=("mu", "F"), create_index=False)

    def mean(speed: float, kind: str) -> Callable[[xr.Dataset], Any]:
        return lambda row: row["mean_stick_time"].sel(V=speed, kind=kind)

    def per_grip(value: Callable[[xr.Dataset], Any]) -> Callable[[xr.Dataset], Any]:
        return lambda row: value(row) / (row["mu"] * row["F"]).where(row["mu"] > 0.0)

    columns: dict[str, Column] = {
        "mu": ("mu", "g"),
        "F N": ("F", "g"),
        "start-up ms": (mean(V, "start_up"), ".1f", 1e3),
        "sustained ms": (mean(V, "sustained"), ".1f", 1e3),
        "T V / (mu F) um/N": (per_grip(mean(slowest, "sustained")), ".1f", 1e6 * slowest),
        "ends at mm/s": ("intermittence_end", ".2f", 1e3),
        "at V / (mu F) mm/s/N": (per_grip(lambda row: row["intermittence_end"]), ".2f", 1e3),
    }
    return [
        f"Stick times at {1e3 * V:g} mm/s, T V / (mu F) of sustained sticks at {1e3 * slowest:g} mm/s:",
        Table.of(scenes, "scene", columns),
        "The paper: less friction or less load shortens the sticks. Loads collapse on V / F: they are copies of",
        "one motion. Friction does more than scale: the last columns differ from mu to mu.",
    ]
