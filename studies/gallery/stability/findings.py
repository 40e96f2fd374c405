"""What the plane of inclination and friction says, in numbers beside the paper's."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies import paper
from studies.motion import transients
from studies.study import constants
from studies.tables import Part, Table

# An onset of the paper is a branch's if their frequencies differ by less than this (logarithm of their ratio).
NEAR = 0.1
# What the table of windows tells of a peak, with so many decimals.
PEAK = {"growth_rate": 0, "theta": 2, "frequency": 0}


def findings(dataset: xr.Dataset) -> list[Part]:
    """Branches of onsets, windows, the unstable share of the plane, and what the paper's text says."""
    theta, mu = dataset["theta"].values, dataset["mu"].values
    return [
        f"Steady sliding, theta from {theta.min():g} to {theta.max():g} degrees ({len(theta)}), mu from "
        f"{mu.min():g} to {mu.max():g} ({len(mu)}), modes below {constants(dataset)['fmax'] / 1e3:g} kHz.",
        "",
        *_branches(dataset),
        "",
        *_windows(dataset),
        "",
        *_plane(dataset),
        *_beside_the_text(dataset),
    ]


def growing(dataset: xr.Dataset) -> NDArray[np.bool_]:
    """Points at which a mode grows, (theta, mu)."""
    return np.asarray(dataset["growth_rate"].transpose("theta", "mu").values > 0.0)


def expected(dataset: xr.Dataset) -> NDArray[np.intp]:
    """How many pairs are unstable by the branches alone, (theta, mu): onsets below less recoveries below."""
    mu = dataset["mu"].values[:, None]
    below = [
        np.count_nonzero(dataset[name].values[:, None, :] < mu, axis=-1)
        for name in ("pair_onset_mu", "pair_recovery_mu")
    ]
    return np.asarray(below[0] - below[1])


def _branches(dataset: xr.Dataset) -> list[Part]:
    """Where each branch lies and is lowest, with the paper's onsets."""
    comment = dataset["pair_onset_mu"].attrs.get("comment", "")
    if comment:
        return [f"The onsets could not be followed over theta: {comment}."]
    beside = _paper_onsets(dataset)
    rows = []
    for kind, dim in {"onset": "pair", "recovery": "recovery"}.items():
        for k in range(dataset.sizes[dim]):
            at = dataset.isel({dim: k})
            number = k + (dataset.sizes["pair"] if dim == "recovery" else 0)
            over = dataset["trace_theta"].values[dataset["trace_branch"].values == number]
            low = [float(at[f"{dim}_lowest_{name}"]) for name in ("frequency", "mu", "theta")]
            cells = [
                kind,
                f"{low[0]:.0f}",
                f"{low[1]:.4f}",
                f"{low[2]:.2f}",
                f"{over.min():.2f}",
                f"{over.max():.2f}",
            ]
            rows.append([*cells, *beside.get((kind, k), ["", ""])] if beside else cells)
    if not rows:
        return ["No flutter onset in this range."]
    heads = ["branch", "Hz", "lowest mu", "at deg", "from deg", "to deg"]
    if beside:
        heads += [f"mu at {paper.THETA:g} deg", "paper: first unstable"]
    lines: list[Part] = [Table(heads, rows)]
    if dataset.sizes["pair"]:
        first = dataset.isel(pair=int(np.argmin(dataset["pair_lowest_mu"].values)))
        mu, theta, frequency = (float(first[f"pair_lowest_{name}"]) for name in ("mu", "theta", "frequency"))
        lines += ["", f"Lowest onset: mu = {mu:.4f} at theta = {theta:.3f} degrees, {frequency:.0f} Hz."]
    return lines


def _paper_onsets(dataset: xr.Dataset) -> dict[tuple[str, int], list[str]]:
    """The onset at the paper's inclination, and the paper's, by branch."""
    if not paper.is_rig(dataset) or paper.THETA not in dataset["theta"].values:
        return {}
    at = dataset.sel(theta=paper.THETA)
    beside = {}
    for k in range(dataset.sizes["pair"]):
        mu, frequency = float(at["pair_onset_mu"][k]), float(at["pair_onset_frequency"][k])
        said = [f"{m:.2f}, near {f:.0f} Hz" for m, f in paper.ONSETS if abs(np.log(frequency / f)) < NEAR]
        beside["onset", k] = [transients.text(mu, 4), *(said or [""])]
    return beside


def _windows(dataset: xr.Dataset) -> list[Part]:
    """Intervals of theta in which a pair is unstable at one friction."""
    at, comment = float(dataset["window_mu"]), dataset["window_from"].attrs.get("comment", "")
    if dataset.sizes["theta"] == 1:
        return ["A single inclination has no window of instability; give a range of theta."]
    if comment:
        return [f"Windows of instability at mu = {at:g} could not be found: {comment}."]
    if not dataset.sizes["window"]:
        return [f"At mu = {at:g} no pair is unstable at any of these inclinations."]
    rows = []
    for k in range(dataset.sizes["window"]):
        window = dataset.isel(window=k)
        bounds = [
            f"{mark if int(window[f'window_open_{end}']) else ''} {float(window[f'window_{end}']):.3f}".strip()
            for end, mark in (("from", "<"), ("to", ">"))
        ]
        peak = [f"{float(window[f'window_peak_{name}']):.{n}f}" for name, n in PEAK.items()]
        rows.append([*bounds, f"{float(window['window_frequency_from']):.0f}", *peak])
    heads = ["from deg", "to deg", "Hz", "largest growth 1/s", "at deg", "at Hz"]
    return [
        f"Windows of instability at mu = {at:g}, as roots and not on the grid:",
        Table(heads, rows),
    ]


def _plane(dataset: xr.Dataset) -> list[str]:
    """The unstable part of the plane, the bound, and whether grid and branches agree."""
    grows = growing(dataset)
    known = int(np.isfinite(dataset["growth_rate"]).sum())
    if not known:
        return ["No point has been computed yet."]
    if grows.any():
        at = dataset.isel(_fastest(dataset))
        most = int(np.nanmax(dataset["unstable_modes"]))
        lines = [
            f"Unstable at {grows.sum()} of {known} points ({100.0 * grows.sum() / known:.1f} %), up to {most} "
            f"{'pair' if most == 1 else 'pairs'} at once.",
            f"Fastest at theta = {float(at['theta']):g} degrees, mu = {float(at['mu']):g}: "
            f"{float(at['growth_rate']):.0f} 1/s, {float(at['frequency']):.0f} Hz.",
        ]
    else:
        lines = [f"Stable at all of {known} points."]
    theta, mu = np.meshgrid(dataset["theta"].values, dataset["mu"].values, indexing="ij")
    tangent = np.tan(np.radians(theta))
    outside = grows & ~((tangent > 0.0) & (tangent < mu))
    lines.append(f"Unstable outside 0 < tan(theta) < mu: {outside.sum() or 'none'}.")
    traced = dataset["trace_theta"].values, dataset["trace_mu"].values
    if len(traced[0]):
        nearest = np.max(np.tan(np.radians(traced[0])) / traced[1])
        lines.append(f"Where an onset or recovery comes nearest to this bound, tan(theta) is {nearest:.4f} mu.")
    return lines + _agreement(dataset, grows)


def _fastest(dataset: xr.Dataset) -> dict[str, int]:
    """Where the largest growth rate stands."""
    growth = dataset["growth_rate"].transpose("theta", "mu").values
    place = np.unravel_index(np.nanargmax(growth), growth.shape)
    return {name: int(k) for name, k in zip(("theta", "mu"), place, strict=True)}


def _agreement(dataset: xr.Dataset, grows: NDArray[np.bool_]) -> list[str]:
    """Where the grid is not as the branches say: a mode may begin to grow without an onset in the band."""
    if "comment" in dataset["pair_onset_mu"].attrs:
        return []
    at = dataset.transpose("theta", "mu", ...)
    pairs, modes, frequency = expected(dataset), at["unstable_modes"].values, at["frequency"].values
    known = np.isfinite(modes)
    signs, counts = known & (grows != (pairs > 0)), known & (modes != pairs)
    lines = [f"Points where the sign of the growth is not what the branches say: {signs.sum() or 'none'}."]
    if counts.any():
        lines += [
            f"Points where more or fewer modes grow than pairs by the branches: {counts.sum()}, and at "
            f"{(counts & (frequency == 0.0)).sum()} of them the fastest does not oscillate.",
            "There a pair has become two modes that diverge, or grows across the end of the band.",
        ]
    return lines


def _beside_the_text(dataset: xr.Dataset) -> list[Part]:
    """What the paper's text says of inclinations at its friction, beside the windows."""
    theta = dataset["theta"].values
    if not paper.is_rig(dataset) or float(dataset["window_mu"]) != paper.MU or len(theta) == 1:
        return []
    ends = dataset["window_from"].values, dataset["window_to"].values
    rows = []
    for angle in sorted({*paper.ANGLES_MEASURED, *paper.ANGLES}):
        if not theta.min() <= angle <= theta.max():
            continue
        said = paper.ANGLES_MEASURED.get(angle, paper.ANGLES.get(angle, np.nan))
        inside = (ends[0] < angle) & (angle < ends[1])
        pairs = ", ".join(f"{f:.0f}" for f in dataset["window_frequency_from"].values[inside])
        rows.append(
            [
                f"{angle:g}",
                f"unstable at {pairs} Hz" if inside.any() else "stable",
                "slides steadily" if np.isnan(said) else f"vibrates at {said:.0f} Hz",
            ]
        )
    below, above = paper.STEADY_ANGLES
    steady = [
        f"theta < {below:g}" if theta.min() < below else "",
        f"theta > {above:g}" if theta.max() > above else "",
    ]
    for name, outside in zip(steady, (ends[0] < below, ends[1] > above), strict=True):
        if name:
            rows.append([name, "unstable in part" if outside.any() else "stable", "slides steadily"])
    if not rows:
        return []
    return ["", Table(["theta deg", f"steady sliding at mu = {paper.MU:g}", "measured (paper)"], rows)]
