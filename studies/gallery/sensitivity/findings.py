"""Sensitivities in words: the numbers that matter, those that do not, and what the derivatives obey."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fivcore.rig import BEAM_NUMBERS
from studies.gallery.sensitivity.study import PARAMETERS, SAME, STEP
from studies.motion.regimes import failures
from studies.study import constants
from studies.tables import Part, Table, number

MATTER = 3
# A number whose elasticities are all smaller moves no onset's friction by more than 0.1 % when it changes by 1 %.
SLIGHT = 0.1
# Exponents of each number in the units of mass, length and time; the last, where both beams and the head become
# wider and heavier together.
EXPONENTS = {
    **dict.fromkeys(("length", "thickness", "contact_position"), (0, 1, 0, 0)),
    "width": (0, 1, 0, 1),
    "young_modulus": (1, -1, -2, 0),
    "density": (1, -3, 0, 0),
    "head_mass": (1, 0, 0, 1),
    "d1": (0, 0, -1, 0),
    "d2": (0, 0, 1, 0),
    "theta": (0, 0, 0, 0),
}
RESULTS = {"elasticity_mu": (0, 0, 0, 0), "elasticity_frequency": (0, 0, -1, 0)}


def findings(dataset: xr.Dataset) -> list[Part]:
    """Numbers that matter at one inclination, the same over all, and how far the derivatives hold."""
    fixed, theta, at = constants(dataset), dataset["theta"].values, reference(dataset)
    has_onset, angle = dataset["elasticity_mu"].notnull(), float(at["theta"])
    pairs = at["pair"].values[has_onset.sel(theta=angle).any("parameter")]
    lines: list[Part] = [
        f"Flutter onsets of three pairs, theta from {theta.min():g} to {theta.max():g} degrees ({len(theta)}), "
        f"modes below {fixed['fmax'] / 1e3:g} kHz, mu up to {fixed['mu_max']:g}.",
        "",
    ]
    if not len(pairs):
        return [*lines, f"No onset has derivatives at theta = {angle:g} degrees.", *failures(dataset, ("theta",))]
    at = at.sel(pair=pairs)
    least, most = (getattr(abs(at["elasticity_mu"]), end)("pair").values for end in ("min", "max"))
    names = [named(p) for p in at["parameter"].values]
    slight = [name for name, size in zip(names, most, strict=True) if size < SLIGHT]
    matter = [f"{name} ({low:.3g} to {high:.3g})" for name, low, high in zip(names, least, most, strict=True)]
    lines += [
        f"At theta = {angle:g} degrees, in % for 1 %: mu by derivative, mu solved again, frequency by derivative.",
        _table(at),
        "",
        f"The numbers that matter most, with the sizes of their elasticities of mu: {', '.join(matter[:MATTER])}.",
        *(sentence for pair in pairs for sentence in _pair(at.sel(pair=pair))),
        *([f"Hardly matter (elasticities of mu below {SLIGHT:g}): {', '.join(slight)}."] if slight else []),
        *_linear(at),
        "",
        *(sentence for pair in pairs for sentence in _over_theta(dataset.sel(pair=pair), angle)),
    ]
    if has_onset.all("parameter").any() and set(PARAMETERS) <= set(dataset["parameter"].values.tolist()):
        lines.append(
            "Units of mass, length and time, and wider beams under a heavier head, each demand a sum of "
            f"elasticities; the largest residual is {residual(dataset):.0e} of the terms."
        )
    return [*lines, *failures(dataset, ("theta",))]


def reference(dataset: xr.Dataset) -> xr.Dataset:
    """The inclination nearest to where pairs are numbered; parameters by their largest elasticity of mu."""
    at = dataset.sel(theta=constants(dataset)["pairs_theta"], method="nearest").load()
    return at.isel(parameter=ranks(at["elasticity_mu"]))


def named(parameter: Any) -> str:
    """A number of the rig as a reader calls it."""
    beam, _, name = str(parameter).partition("_")
    return (
        f"{BEAM_NUMBERS[name][1]} of {beam.upper()}" if name in BEAM_NUMBERS else str(parameter).replace("_", " ")
    )


def ranks(elasticity: xr.DataArray) -> NDArray[np.intp]:
    """Places of the parameters, that with the largest elasticity of any pair first."""
    largest = abs(elasticity).max([dim for dim in elasticity.dims if dim != "parameter"])
    return np.argsort(-largest.fillna(0.0).values, kind="stable")


def excess_elasticity(dataset: xr.Dataset) -> xr.DataArray:
    """Elasticity of what an onset's friction has above tan(theta), by all numbers but theta."""
    others = dataset.sel(parameter=dataset["parameter"] != "theta")
    tangent = np.tan(np.radians(dataset["theta"]))
    return others["elasticity_mu"] * others["onset_mu"] / (others["onset_mu"] - tangent)


def residual(dataset: xr.Dataset) -> float:
    """Largest residual of the sums that units and widths demand of elasticities, as a share of their terms."""
    weights = np.array([EXPONENTS[p.removeprefix("p1_").removeprefix("p2_")] for p in PARAMETERS], dtype=float)
    residuals = []
    for name, expected in RESULTS.items():
        values = dataset[name].sel(parameter=list(PARAMETERS)).transpose(..., "parameter").values
        residuals.append(np.abs(values @ weights - expected) / (1.0 + np.abs(values) @ np.abs(weights)))
    return float(np.nanmax(residuals))


def _table(at: xr.Dataset) -> Table:
    heads, rows = ["number"], [[named(p)] for p in at["parameter"].values]
    for pair in at["pair"].values:
        one = at.sel(pair=pair)
        heads += [f"{float(one['onset_frequency'].max()):.0f} Hz: mu", "solved", "Hz"]
        again = 100.0 * one["change_mu"] / one["onset_mu"]
        for row, *values in zip(rows, one["elasticity_mu"], again, one["elasticity_frequency"], strict=True):
            row += [number(value, ".3f") for value in values]
    return Table(heads, rows, words=1)


def _pair(one: xr.Dataset) -> list[Part]:
    """The numbers that matter for one pair, and what 1 % more of each does."""
    mu, frequency = float(one["onset_mu"].max()), float(one["onset_frequency"].max())
    lines: list[Part] = [f"{frequency:.0f} Hz, onset at mu = {mu:.4f}; with 1 % more of"]
    for k in ranks(one["elasticity_mu"])[:MATTER]:
        say, more, faster = (float(one[name][k]) for name in ("elasticity_mu", "change_mu", "change_frequency"))
        effect = (
            f"mu {'rises' if more > 0.0 else 'falls'} to {mu + more:.4f} ({100.0 * more / mu:+.1f} %, by "
            f"derivative {say:+.1f} %), the frequency changes by {100.0 * faster / frequency:+.1f} % to "
            f"{frequency + faster:.0f} Hz"
        )
        if np.isnan(more):
            effect = f"no onset within {100.0 * SAME:g} % of the frequency that the derivative predicts"
        lines.append(f"  {named(one['parameter'].values[k])}: {effect}.")
    return lines


def _linear(at: xr.Dataset) -> list[Part]:
    """Change solved again over that by derivative, for the numbers that matter."""
    size = abs(at["elasticity_mu"])
    ratio = at["change_mu"] / (STEP * at["elasticity_mu"] * at["onset_mu"]).where(size >= SLIGHT)
    return [
        f"1 % of a number changes mu by {number(ratio.min(), '.2f')} to {number(ratio.max(), '.2f')} times what "
        f"its derivative says (elasticities of {SLIGHT:g} or more)."
    ]


def _over_theta(one: xr.Dataset, angle: float) -> list[Part]:
    """Where the inclination itself does not matter, and the strongest other number over all of them."""
    theta, others = one["theta"].values, excess_elasticity(one)
    name, lines = f"{float(one['onset_frequency'].max()):.0f} Hz", []
    if "theta" in one["parameter"].values:
        slope = one["elasticity_mu"].sel(parameter="theta").values
        turns = np.flatnonzero((slope[:-1] < 0.0) & (slope[1:] >= 0.0))
        lines = [
            f"{name}: over theta mu is least between {theta[k]:g} and {theta[k + 1]:g} degrees." for k in turns
        ]
    if others.sizes["parameter"] and len(theta) > 1:
        first = others.isel(parameter=ranks(others.sel(theta=angle))[0])
        raw = one["elasticity_mu"].sel(parameter=first["parameter"])
        of_mu, of_excess = (f"{float(e.min()):.3g} to {float(e.max()):.3g}" for e in (raw, first))
        by = named(first["parameter"].item())
        lines.append(f"{name}: by {by} the elasticity of mu is {of_mu}, that of mu - tan(theta) {of_excess}.")
    return [*lines]
