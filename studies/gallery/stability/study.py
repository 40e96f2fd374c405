"""The plane of inclination and friction: where steady sliding is unstable, how fast, and at which frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fivcore import OnsetCurve, OnsetCurves, Rig, checks, onset_curves, sliding_modes
from studies import paper
from studies.gallery.table6.windows import ENDS as WINDOW_ENDS
from studies.gallery.table6.windows import WINDOWS, windows
from studies.motion import transients
from studies.rig import rig_of, rig_settings
from studies.spec import evenly
from studies.study import Study, deferred
from sweeps import Axis, Grid, Sweep, Variable

Array = NDArray[Any]

VARIABLES = {
    "growth_rate": Variable("s-1", "largest growth rate of steady sliding below 10 kHz", (), "float32", digits=4),
    "frequency": Variable("Hz", "frequency of the mode with the largest growth rate", (), "float32", digits=5),
    "unstable_modes": Variable("1", "number of growing mode pairs below 10 kHz", (), "int8"),
}
# How an end of a branch is told in a file.
ENDS = ("range", "mu_max", "fmax", "fold")


def largest_growth(rig: Rig, theta: Any, mu: Any, fmax: float) -> tuple[Array, Array, Array]:
    """What grows fastest in steady sliding with V > 0.

    Parameters
    ----------
    rig : Rig
    theta, mu : float or array_like
        Degrees and 1; broadcast.
    fmax : float
        Band, Hz.

    Returns
    -------
    growth_rate, frequency : ndarray
        Of the mode with the largest growth rate in the band, 1/s and Hz; NaN where the band holds none.
    unstable_modes : ndarray of int
        How many grow; a pair of which one grows and one decays counts once.
    """
    modes = sliding_modes(rig, theta, mu, fmax)
    growth = np.where(np.isnan(modes.growth_rate), -np.inf, modes.growth_rate)
    if not growth.shape[-1]:
        nothing = np.full(growth.shape[:-1], np.nan)
        return nothing, nothing.copy(), np.zeros(growth.shape[:-1], dtype=int)
    top = growth.argmax(axis=-1)[..., None]
    fastest = [np.take_along_axis(each, top, -1)[..., 0] for each in (modes.growth_rate, modes.frequency)]
    return fastest[0], fastest[1], np.count_nonzero(modes.unstable, axis=-1)


def fastest(points: Mapping[str, Any], *, rig: Rig, fmax: float) -> dict[str, Any]:
    """The variables of the plane at each point."""
    return dict(zip(VARIABLES, largest_growth(rig, points["theta"], points["mu"], fmax), strict=True))


def with_curves(dataset: xr.Dataset, *, rig: Rig, fmax: float) -> xr.Dataset:
    """Add the branches of onsets and recoveries over theta, the windows at the paper's friction, and the bound.

    Where branches or windows cannot be told apart, all else is kept and a `comment` tells the reason.
    """
    theta, mu = dataset["theta"].values, dataset["mu"].values
    curves, lost = followed(rig, theta, fmax, float(mu.max()))
    friction = float(np.clip(paper.MU, mu.min(), mu.max()))
    open_windows, not_found = windows(rig, friction, 1.0, float(theta.min()), float(theta.max()))
    tangent = np.tan(np.radians(theta))
    dataset = dataset.assign(
        at_angles("pair", "onset", curves.onsets, curves.mu, curves.frequency)
        | at_angles("recovery", "recovery", curves.recoveries, curves.recovery_mu, curves.recovery_frequency)
        | lowest(curves)
        | whole((*curves.onsets, *curves.recoveries))
        | {
            "bound_mu": variable("theta", np.where(tangent > 0.0, tangent, np.nan), "1", "tan(theta), if above 0"),
            "window_mu": variable((), friction, "1", "coefficient of friction of the windows"),
        }
        | {
            f"window_{name}": variable("window", open_windows[name], units, long_name)
            for name, (_, units, long_name) in WINDOWS.items()
        }
    )
    for name, comment in {"pair_onset_mu": lost, "window_from": not_found}.items():
        if comment:
            dataset[name].attrs["comment"] = comment
    return transients.with_flags(
        dataset,
        window_open_from=WINDOW_ENDS,
        window_open_to=WINDOW_ENDS,
        **{f"{kind}_{end}": ENDS for kind in ("pair", "recovery") for end in ("begins", "ends")},
    )


def followed(rig: Rig, theta: Array, fmax: float, mu_max: float) -> tuple[OnsetCurves, str]:
    """All branches; and why there are none though there might be, else ""."""
    comment = ""
    if mu_max > 0.0:
        try:
            return onset_curves(rig, theta, fmax, mu_max), ""
        except ArithmeticError as problem:
            comment = str(problem)
    return OnsetCurves((), (), theta, *np.empty((4, len(theta), 0))), comment


def variable(dims: Any, values: Any, units: str, long_name: str) -> tuple[Any, Any, dict[str, str]]:
    """What a dataset is given."""
    return dims, values, {"units": units, "long_name": long_name}


def at_angles(dim: str, kind: str, curves: Sequence[OnsetCurve], mu: Array, frequency: Array) -> dict[str, Any]:
    """Branches at the grid's angles, where each is lowest, and how it begins and ends."""
    what = "the pair's flutter onset" if kind == "onset" else "a pair's recovery"
    found = {
        f"pair_{kind}_mu": variable(("theta", dim), mu, "1", f"coefficient of friction at {what}"),
        f"pair_{kind}_frequency": variable(("theta", dim), frequency, "Hz", f"frequency at {what}"),
    }
    places = np.array([curve.lowest for curve in curves]).reshape(-1, 3).T
    for name, units, values in zip(("theta", "mu", "frequency"), ("degree", "1", "Hz"), places, strict=True):
        found[f"{dim}_lowest_{name}"] = variable(dim, values, units, f"{name} where {what} is lowest in mu")
    for k, name in enumerate(("begins", "ends")):
        codes = np.array([ENDS.index(curve.ends[k]) for curve in curves], dtype=np.int8)
        found[f"{dim}_{name}"] = variable(dim, codes, "1", f"where {what} {name} as theta rises")
    return found


def lowest(curves: OnsetCurves) -> dict[str, Any]:
    """The lowest onset at each angle, NaN where there is none."""
    rows = [
        min(((m, f) for m, f in zip(*row, strict=True) if np.isfinite(m)), default=(np.nan, np.nan))
        for row in zip(curves.mu, curves.frequency, strict=True)
    ]
    mu, frequency = np.array(rows).T
    return {
        "onset_mu": variable("theta", mu, "1", "coefficient of friction at the lowest flutter onset"),
        "onset_frequency": variable("theta", frequency, "Hz", "frequency at the lowest flutter onset"),
    }


def whole(curves: Sequence[OnsetCurve]) -> dict[str, Any]:
    """The branches as they were followed, to their ends, one after the other: onsets first, then recoveries."""
    number = np.repeat(np.arange(len(curves), dtype=np.int16), [len(curve.theta) for curve in curves])
    found = {"trace_branch": variable("trace", number, "1", "number of the branch, from 0; onsets first")}
    for name, units in {"theta": "degree", "mu": "1", "frequency": "Hz"}.items():
        values = np.concatenate([np.empty(0), *(getattr(curve, name) for curve in curves)])
        found[f"trace_{name}"] = variable("trace", values.astype(np.float32), units, f"{name} along the branches")
    return found


def build(axes: Mapping[str, Axis], settings: Mapping[str, float]) -> Sweep:
    """The sweep over theta and mu; what cannot be computed is found out here, before anything is planned."""
    rig, _ = rig_of({**settings, "theta": paper.THETA})
    fixed: dict[str, Any] = {"rig": rig, "fmax": transients.BAND}
    for theta in (axes["theta"].values.min(), axes["theta"].values.max()):
        checks.theta_degrees(theta)
        for mu in (axes["mu"].values.min(), axes["mu"].values.max()):
            with suppress(ArithmeticError):
                largest_growth(rig, theta, mu, transients.BAND)
    return Sweep(
        "stability",
        fastest,
        Grid({name: axes[name] for name in ("theta", "mu")}),
        VARIABLES,
        fixed,
        title="Stability of steady sliding over inclination and friction",
        derive=partial(with_curves, **fixed),
        order_by=("theta",),
    )


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
    build=build,
    draw=deferred("studies.gallery.stability.figure:draw"),
    findings=deferred("studies.gallery.stability.findings:findings"),
)
