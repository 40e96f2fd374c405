"""The plane of inclination and friction: where steady sliding is unstable, how fast, and at which frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fivcore import OnsetCurve, OnsetCurves, Rig, checks, flutter_onsets, onset_curves, sliding_modes
from studies import paper
from studies.gallery.table6.windows import with_windows
from studies.motion import transients
from studies.rig import rig_of, rig_settings
from studies.spec import evenly
from studies.study import Study, deferred
from sweeps import Axis, Variable

Array = NDArray[Any]

VARIABLES = {
    "growth_rate": Variable("s-1", "largest growth rate of steady sliding below 10 kHz", (), "float32", digits=4),
    "frequency": Variable("Hz", "frequency of the mode with the largest growth rate", (), "float32", digits=5),
    "unstable_modes": Variable("1", "number of growing mode pairs below 10 kHz", (), "int8"),
}
# How a branch ends, as its flags name it.
ENDS = ("range", "mu_max", "fmax", "fold")
# Curves of onsets are followed within the band.
LEFT_OUT = "; pairs that enter the band already growing are not counted"
# Of each point of a branch, with units.
TRACED = {"theta": "degree", "mu": "1", "frequency": "Hz"}


def largest_growth(rig: Rig, theta: Any, mu: Any, fmax: float) -> tuple[Array, Array, Array]:
    """Growth rate and frequency of the mode that grows fastest in steady sliding with V > 0, and how many grow.

    theta and mu broadcast; NaN where the band holds no mode. A pair of which one grows and one decays counts once.
    """
    modes = sliding_modes(rig, theta, mu, fmax)
    growth = np.where(np.isnan(modes.growth_rate), -np.inf, modes.growth_rate)
    if not growth.shape[-1]:
        nothing = np.full(growth.shape[:-1], np.nan)
        return nothing, nothing.copy(), np.zeros(growth.shape[:-1], dtype=int)
    top = growth.argmax(axis=-1)[..., None]
    fastest = [np.take_along_axis(each, top, -1)[..., 0] for each in (modes.growth_rate, modes.frequency)]
    return fastest[0], fastest[1], np.count_nonzero(modes.unstable, axis=-1)


def first_growth(rig: Rig, theta: float, fmax: float, largest: float) -> tuple[float, float]:
    """Lowest friction up to the largest from which a pair grows in the band, and its frequency there, Hz; or NaN.

    That is at a flutter onset, or at the top of the band, which a pair enters already growing.
    """
    found = flutter_onsets(rig, theta, fmax, largest)
    onsets = zip(found.mu.tolist(), found.frequency.tolist(), strict=True)
    return min((*onsets, *((mu, fmax) for mu in found.entry_mu.tolist())), default=(np.nan, np.nan))


def fastest(points: Mapping[str, Any], *, rig: Rig, fmax: float) -> dict[str, Any]:
    """The variables of the plane at each point."""
    return dict(zip(VARIABLES, largest_growth(rig, points["theta"], points["mu"], fmax), strict=True))


def with_curves(dataset: xr.Dataset, *, rig: Rig, fmax: float) -> xr.Dataset:
    """Add the branches of onsets and recoveries over theta, the windows at the paper's friction, and the bound.

    Where branches or windows cannot be told apart there are none, and a `comment` gives the reason.
    """
    theta, mu = dataset["theta"].values, dataset["mu"].values
    curves, comment = OnsetCurves((), (), theta, *np.empty((4, len(theta), 0))), ""
    if mu.max() > 0.0:
        try:
            curves = onset_curves(rig, theta, fmax, float(mu.max()))
        except ArithmeticError as problem:
            comment = str(problem)
    friction = float(np.clip(paper.MU, mu.min(), mu.max()))
    tangent = np.tan(np.radians(theta))
    dataset = with_windows(dataset, rig, friction, 1.0).assign(
        at_angles("pair", "onset", curves.onsets, curves.mu, curves.frequency)
        | at_angles("recovery", "recovery", curves.recoveries, curves.recovery_mu, curves.recovery_frequency)
        | lowest(curves)
        | whole((*curves.onsets, *curves.recoveries))
        | {
            "bound_mu": variable("theta", np.where(tangent > 0.0, tangent, np.nan), "1", "tan(theta), if above 0"),
            "window_mu": variable((), friction, "1", "coefficient of friction of the windows"),
        }
    )
    if comment:
        dataset["pair_onset_mu"].attrs["comment"] = comment
    return transients.with_flags(
        dataset, **{f"{dim}_{end}": ENDS for dim in ("pair", "recovery") for end in ("begins", "ends")}
    )


def variable(dims: Any, values: Any, units: str, long_name: str) -> tuple[Any, Any, dict[str, str]]:
    """A derived variable, as `xarray.Dataset.assign` takes it."""
    return dims, values, {"units": units, "long_name": long_name}


def at_angles(dim: str, kind: str, curves: Sequence[OnsetCurve], mu: Array, frequency: Array) -> dict[str, Any]:
    """Branches at the grid's angles, where each is lowest, and how it begins and ends."""
    what = "the pair's flutter onset" if kind == "onset" else "a pair's recovery"
    variables = {
        f"pair_{kind}_mu": variable(("theta", dim), mu, "1", f"coefficient of friction at {what}"),
        f"pair_{kind}_frequency": variable(("theta", dim), frequency, "Hz", f"frequency at {what}"),
    }
    places = np.array([curve.lowest for curve in curves]).reshape(-1, 3).T
    for (name, units), values in zip(TRACED.items(), places, strict=True):
        variables[f"{dim}_lowest_{name}"] = variable(dim, values, units, f"{name} where {what} is lowest in mu")
    for k, name in enumerate(("begins", "ends")):
        codes = np.array([ENDS.index(curve.ends[k]) for curve in curves], dtype=np.int8)
        variables[f"{dim}_{name}"] = variable(dim, codes, "1", f"where {what} {name} as theta rises")
    return variables


def lowest(curves: OnsetCurves) -> dict[str, Any]:
    """The lowest onset at each angle, NaN where there is none."""
    rows = [
        min(((m, f) for m, f in zip(*row, strict=True) if np.isfinite(m)), default=(np.nan, np.nan))
        for row in zip(curves.mu, curves.frequency, strict=True)
    ]
    mu, frequency = np.array(rows).T
    return {
        "onset_mu": variable("theta", mu, "1", f"coefficient of friction at the lowest flutter onset{LEFT_OUT}"),
        "onset_frequency": variable("theta", frequency, "Hz", f"frequency at the lowest flutter onset{LEFT_OUT}"),
    }


def whole(curves: Sequence[OnsetCurve]) -> dict[str, Any]:
    """The branches as they were followed, to their ends, one after the other: onsets first, then recoveries."""
    number = np.repeat(np.arange(len(curves), dtype=np.int16), [len(curve.theta) for curve in curves])
    variables = {"trace_branch": variable("trace", number, "1", "number of the branch, from 0; onsets first")}
    for name, units in TRACED.items():
        values = np.concatenate([np.empty(0), *(getattr(curve, name) for curve in curves)])
        variables[f"trace_{name}"] = variable("trace", np.float32(values), units, f"{name} along the branches")
    return variables


def constants(settings: Mapping[str, float]) -> dict[str, Any]:
    """The rig and the band."""
    rig, _ = rig_of({**settings, "theta": paper.THETA})
    return {"rig": rig, "fmax": transients.BAND}


def check(axes: Mapping[str, Axis], fixed: Mapping[str, Any]) -> None:
    """Refuse an inclination or friction out of range; a point whose modes cannot be found fails by itself."""
    for theta in axes["theta"].values[[0, -1]]:
        checks.theta_degrees(theta)
        for mu in axes["mu"].values[[0, -1]]:
            with suppress(ArithmeticError):
                largest_growth(fixed["rig"], theta, mu, fixed["fmax"])


STUDY = Study(
    name="stability",
    title="Stability of steady sliding over inclination and friction",
    question="At which inclinations and frictions is steady sliding unstable, how fast does vibration grow, and "
    "at which frequency?",
    paper="Section 3.4.2: at 5 degrees pairs of modes are first unstable at mu = 0.12 (2800 Hz), 0.16 (400 Hz) "
    "and 0.23 (7700 Hz). Section 3.6: at mu = 0.2 the rig vibrates at 10 degrees and slides steadily at 15, as "
    "above 12 degrees and at negative angles. It has no map over both.",
    axes={
        "theta": Axis(evenly(-10.0, 20.0, 241), "degree", "inclination of P1"),
        "mu": Axis(evenly(0.0, 0.5, 201), "1", "coefficient of friction"),
    },
    settings={name: each for name, each in rig_settings().items() if name != "theta"},
    function=fastest,
    variables=VARIABLES,
    constants=constants,
    check=check,
    derive=with_curves,
    options={"order_by": ("theta",)},
    draw=deferred("studies.gallery.stability.figure:draw"),
    findings=deferred("studies.gallery.stability.findings:findings"),
)
