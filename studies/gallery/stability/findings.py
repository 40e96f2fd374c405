"""The plane of inclination and friction as tables: branches, windows, what is unstable, and the paper's text."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies import paper
from studies.claims import Claim, beside
from studies.gallery.table6 import windows
from studies.motion import regimes
from studies.study import constants
from studies.tables import Part, Table

# An onset of the paper is a branch's if their frequencies differ by less than this (logarithm of their ratio).
NEAR = 0.1
AT_MU: dict[str, Any] = {"mu": paper.MU}
CLAIMS = (
    Claim("unstable_modes", AT_MU | {"theta": paper.THETA}, len(paper.ANGLES_UNSTABLE[paper.THETA]), "3.4.2"),
    *(
        Claim("unstable_modes", AT_MU | {"theta": theta}, 0.0, "3.6, measured: slides steadily")
        for theta in (*(theta for theta, line in paper.ANGLES.items() if np.isnan(line)), *paper.STEADY_ANGLES)
    ),
)


def findings(dataset: xr.Dataset) -> list[Part]:
    """Branches of onsets, windows, the unstable share of the plane, and the paper's statements."""
    theta, mu = dataset["theta"].values, dataset["mu"].values
    return [
        f"Steady sliding, theta from {theta.min():g} to {theta.max():g} degrees ({len(theta)}), mu from "
        f"{mu.min():g} to {mu.max():g} ({len(mu)}), modes below {constants(dataset)['fmax'] / 1e3:g} kHz.",
        "",
        *_branches(dataset),
        "",
        *windows.report(dataset, float(dataset["window_mu"])),
        "",
        *_plane(dataset),
        *regimes.failures(dataset),
        *beside(dataset, (*_onset_claims(dataset), *CLAIMS)),
    ]


def expected(dataset: xr.Dataset) -> NDArray[np.intp]:
    """How many pairs are unstable by the branches alone, (theta, mu): onsets below less recoveries below."""
    mu = dataset["mu"].values[:, None]
    below = [
        np.count_nonzero(dataset[name].values[:, None, :] < mu, axis=-1)
        for name in ("pair_onset_mu", "pair_recovery_mu")
    ]
    return np.asarray(below[0] - below[1])


def _branches(dataset: xr.Dataset) -> list[Part]:
    """Where each branch is lowest, and from where to where it reaches."""
    comment = dataset["pair_onset_mu"].attrs.get("comment", "")
    if comment:
        return [f"The onsets could not be followed over theta: {comment}."]
    rows = []
    for kind, dim in {"onset": "pair", "recovery": "recovery"}.items():
        lowest = (dataset[f"{dim}_lowest_{name}"].values for name in ("frequency", "mu", "theta"))
        rows += [[kind, f"{f:.0f}", f"{mu:.4f}", f"{theta:.3f}"] for f, mu, theta in zip(*lowest, strict=True)]
    if not rows:
        return ["No flutter onset in this range."]
    over = dataset["trace_theta"].groupby(dataset["trace_branch"])
    ends = zip(over.min().values, over.max().values, strict=True)
    rows = [[*row, f"{low:.2f}", f"{high:.2f}"] for row, (low, high) in zip(rows, ends, strict=True)]
    return [Table(["branch", "Hz", "lowest mu", "at deg", "from deg", "to deg"], rows, words=1)]


def _plane(dataset: xr.Dataset) -> list[Part]:
    """The unstable part of the plane, the bound tan(theta) = mu, and whether grid and branches agree."""
    at = dataset.transpose("theta", "mu", ...)
    growth, modes, frequency = (at[name].values for name in ("growth_rate", "unstable_modes", "frequency"))
    finite, grows, tangent = np.isfinite(growth), growth > 0.0, np.tan(np.radians(at["theta"].values))[:, None]
    if not finite.any():
        return ["No point has been computed yet."]
    count, inside = finite.sum(), (tangent > 0.0) & (tangent < at["mu"].values)
    rows = {
        "points with a growing mode": f"{grows.sum()} of {count} ({100.0 * grows.sum() / count:.1f} %)",
        "most growing modes at a point": f"{np.nanmax(modes):.0f}",
        "points whose fastest growing mode does not oscillate": f"{(grows & (frequency == 0.0)).sum()}",
        "growing outside 0 < tan(theta) < mu": f"{(grows & ~inside).sum()}",
    }
    if grows.any():
        top = at.isel(at["growth_rate"].argmax(["theta", "mu"]))
        rate, hertz, theta, mu = (float(top[name]) for name in ("growth_rate", "frequency", "theta", "mu"))
        rows["largest growth rate"] = f"{rate:.0f} 1/s, {hertz:.0f} Hz at theta = {theta:g} degrees, mu = {mu:g}"
    if dataset.sizes["trace"]:
        ratio = np.tan(np.radians(dataset["trace_theta"].values)) / dataset["trace_mu"].values
        rows["largest tan(theta) / mu of an onset or recovery"] = f"{ratio.max():.4f}"
    if "comment" not in dataset["pair_onset_mu"].attrs:
        # A mode may grow without an onset: where a pair has become two that diverge, or at the band's end.
        pairs = expected(dataset)
        rows["growing, but not by the branches, or the reverse"] = f"{(finite & (grows != (pairs > 0))).sum()}"
        rows["more or fewer growing modes than by the branches"] = f"{(finite & (modes != pairs)).sum()}"
    return [Table(["over the plane", "value"], [*rows.items()], words=2)]


def _onset_claims(dataset: xr.Dataset) -> list[Claim]:
    """The paper's onsets, each beside the branch with its frequency."""
    if paper.THETA not in dataset["theta"].values:
        return []
    frequency = dataset["pair_onset_frequency"].sel(theta=paper.THETA).values
    return [
        Claim(f"pair_onset_{name}", {"theta": paper.THETA, "pair": int(pair)}, value, "3.4.2, first unstable")
        for onset in paper.ONSETS
        for pair in np.flatnonzero(np.abs(np.log(frequency / onset[1])) < NEAR)
        for name, value in zip(("mu", "frequency"), onset, strict=True)
    ]
