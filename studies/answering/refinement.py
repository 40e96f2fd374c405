"""Estimated errors of the interpolated points of a refined map, from its control points."""

import json
from collections.abc import Sequence
from math import isfinite, nan
from typing import Any

import xarray as xr

CONFIDENCE = 0.95  # with which the share of wrong points is below its bound


def report(dataset: xr.Dataset) -> list[str]:
    """Up to three sentences on the errors of the interpolated points of a refined sweep."""
    if "refinement" not in dataset.attrs:
        return []
    errors, lines = json.loads(dataset.attrs["refinement"]), []
    count, levels, tolerance = errors["interpolated"], errors["levels"], errors["tolerance"]
    estimate, upper = shares(levels)
    wrong = "in another class" if tolerance is None else f"off by more than {100.0 * tolerance:g} % of the range"
    if count and not isfinite(estimate):
        lines.append(f"{count} points are interpolated; how many of them are {wrong} is not known.")
    elif count:
        share, most, sure = map(_percent, (estimate, upper, CONFIDENCE))
        text = f"of which about {share} (at most {most}, with {sure} confidence) are {wrong}"
        lines.append(f"{count} points are interpolated, {text}; the others are computed.")
    if count := errors["exhausted"]:
        within = ", ".join(f"{dim} {low:.4g} to {high:.4g}" for dim, (low, high) in errors["within"].items())
        lines.append(f"The map is still too coarse at {count} points ({within}); one level more halves the steps.")
    return lines


def shares(levels: Sequence[dict[str, Any]]) -> tuple[float, float]:
    """Estimate and bound the fraction of wrong interpolated points; NaN without control points.

    Counts are weighted by the points that each control point represents, and the bound is that for a weighted sum
    of counts (Fay and Feuer, Statistics in Medicine 16, 1997, 791-801).
    """
    from scipy.special import gammaincinv  # here, because it takes long and few commands refine

    sampled = [each for each in levels if each["control"]]
    if not sampled:
        return nan, nan
    total = sum(each["control"] * each["represents"] for each in sampled)
    weights = [each["represents"] / total for each in sampled]
    estimate = sum(each["missed"] * weight for each, weight in zip(sampled, weights, strict=True))
    variance = sum(each["missed"] * weight**2 for each, weight in zip(sampled, weights, strict=True))
    mean, variance = estimate + max(weights), variance + max(weights) ** 2
    return estimate, min(1.0, float(gammaincinv(mean**2 / variance, CONFIDENCE)) * variance / mean)


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share >= 0.1 else f"{100.0 * share:.2g} %"
