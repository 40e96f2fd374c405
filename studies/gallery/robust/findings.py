"""The probability of instability as text: what is safe, what decides, and how the numbers were drawn."""

from __future__ import annotations

import numpy as np
import xarray as xr

from studies import paper
from studies.gallery.robust.figure import MOST, order
from studies.motion import regimes, transients
from studies.plotting import planes
from studies.scatter import instability
from studies.study import constants
from studies.tables import Part, Table

# Probabilities for which the friction is listed.
RISKS = (0.01, 0.05, 0.5, 0.95, 0.99)
# From this total index on a number matters.
MATTERS = 0.05


def findings(dataset: xr.Dataset) -> list[Part]:
    """Frictions by risk at the angle next to the paper's and where all is safe; indices; distributions."""
    at = dataset.sel(theta=paper.THETA, method="nearest")
    theta, mu = dataset["theta"].values, dataset["mu"].values
    fixed, count = constants(dataset), dataset.sizes["sample"]
    lines: list[Part] = [
        f"{count} rigs, theta from {theta.min():g} to {theta.max():g} degrees ({len(theta)}), mu from "
        f"{mu.min():g} to {mu.max():g} ({len(mu)}), modes below {transients.BAND / 1e3:g} kHz; seed "
        f"{fixed['seed']}.",
        "",
        *_by_risk(at),
        "",
        *_deciding(at, fixed["sobol_samples"]),
        "",
        *_extremes(dataset),
        *regimes.failures(dataset),
        "",
        instability.table(fixed["scatter"]),
    ]
    return lines


def _by_risk(at: xr.Dataset) -> list[Part]:
    """At one angle the lowest friction at which each share of rigs is unstable, beside the nominal onset."""
    mu, share = at["mu"].values, at["probability_unstable"].values
    nominal, theta = float(at["nominal_onset_mu"]), float(at["theta"])
    if np.isnan(share).any():
        return [f"theta = {theta:g} degrees has not been computed."]
    lines: list[Part] = []
    if np.isnan(nominal):
        lines.append(f"At theta = {theta:g} degrees the nominal rig has no flutter onset.")
    else:
        there = float(np.interp(nominal, mu, share))
        onset = at["onset_mu"].values
        lines.append(
            f"At theta = {theta:g} degrees the nominal rig flutters from mu = {nominal:.4f} on, "
            f"{float(at['nominal_onset_frequency']):.0f} Hz; {100.0 * there:.0f} % of the scattered rigs are "
            f"unstable there, and {100.0 * np.mean(np.isnan(onset)):.2g} % have no onset."
        )
    rows = []
    for risk in RISKS:
        reached = share >= risk
        if not reached.any():
            continue
        k = int(reached.argmax())
        interval = f"{float(at['probability_low'][k]):.3f} to {float(at['probability_high'][k]):.3f}"
        rows.append([f"{100.0 * risk:g} %", f"{mu[k]:g}", f"{share[k]:.3f}", interval])
    return (
        [*lines, Table(["unstable rigs", "from mu", "probability there", "Wilson 95 %"], rows)] if rows else lines
    )


def _deciding(at: xr.Dataset, base: int) -> list[Part]:
    """The numbers with the largest total indices, and what the others come to."""
    places = order(at)
    first, total, error = (at[f"sobol_{name}"].values for name in ("first", "total", "total_se"))
    if not total.any():
        return [f"At theta = {float(at['theta']):g} degrees no scattered rig has an onset: nothing decides."]
    matter = [planes.name(str(at["parameter"].values[k])) for k in places if total[k] >= MATTERS]
    rows = [
        [planes.name(str(at["parameter"].values[k])), f"{first[k]:.3f}", f"{total[k]:.3f}", f"{error[k]:.3f}"]
        for k in places[:MOST]
    ]
    return [
        f"What decides the lowest onset at theta = {float(at['theta']):g} degrees: {', '.join(matter)}. (Where a "
        f"rig has none, mu = {instability.MU_MAX:g} stands in.) The "
        f"others have total indices below {MATTERS:g} (base of {base} points).",
        Table(["number", "first index", "total index", "+-"], rows, words=1),
    ]


def _extremes(dataset: xr.Dataset) -> list[Part]:
    """Over all angles: where the scatter makes most of the difference."""
    share, nominal = (dataset[name].values for name in ("probability_unstable", "nominal_unstable"))
    finite = np.isfinite(share)
    if not finite.any():
        return []
    stable, unstable = finite & (nominal == 0), finite & (nominal == 1)
    parts = []
    for chosen, word, of in ((stable, "stable", share), (unstable, "unstable", 1.0 - share)):
        if chosen.any():
            wrong = 100.0 * float(of[chosen].mean())
            parts.append(f"where the nominal rig is {word}, {wrong:.2g} % of the scattered ones are not")
    safe = dataset["mu"].values[None, :] * np.where(share == 0.0, 1.0, np.nan)
    clean = [float(theta) for theta, row in zip(dataset["theta"].values, share, strict=True) if not row.any()]
    lines: list[Part] = [f"Over the plane, {'; '.join(parts)}."]
    if clean:
        lines.append(
            f"No scattered rig is unstable at theta = {', '.join(f'{each:g}' for each in clean)} degrees."
        )
    elif np.isfinite(safe).any():
        lines.append("At every angle some scattered rig is unstable at some friction.")
    return lines
