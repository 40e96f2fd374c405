"""Quantities of a map, each with the function that computes it for many points.

A function gets points on any two axes, and whatever else makes a scene as constants. Points that differ only in
what a quantity does not depend on are computed once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import Rig, Scene, Transient, critical_mu, glued_frequencies
from studies import paper
from studies.gallery.regimes import study as regimes
from studies.gallery.stability import study as stability
from studies.motion import ensembles, normalised, transients
from studies.motion.jobs import Job, outcomes
from studies.rig import rig_of, rig_settings
from studies.scatter import instability
from studies.study import Setting
from sweeps import Variable

Points = Mapping[str, Any]

# What can be an axis, with the value it has where it is none.
AXES: dict[str, Setting] = {
    "V": Setting(paper.SPEEDS[1], "m s-1", "velocity of P2's clamp"),
    **{name: each for name, each in rig_settings().items() if name == "theta"},
    **{name: each for name, each in transients.run_settings(1.0).items() if name in transients.SCENE},
    **{name: each for name, each in rig_settings().items() if name != "theta"},
}
RIG = tuple(name for name in AXES if name not in transients.SCENE)
# As `studies.gallery.stability.study.largest_growth` gives them.
GROWTH = ("growth_rate", "frequency", "unstable_modes")
# Stands for a value that is the same at all points, where only its being the same matters.
SAME = {"V": 1.0, "theta": 1.0, "mu": 0.0, "F": 1.0}


@dataclass(frozen=True)
class Quantity:
    """One number a point.

    Attributes
    ----------
    variable : Variable
    function, key : callable
        Of a sweep.
    matter : tuple of str
        What of a scene, besides its rig, the quantity depends on; of V only the sign if theta stands without V.
    thresholds : tuple of float
        Values at which it passes from one class to another.
    settings : mapping of str to Setting
        What else can be set.
    """

    variable: Variable
    function: Callable[..., dict[str, Any]]
    key: Callable[[Points], NDArray[Any]]
    matter: tuple[str, ...]
    thresholds: tuple[float, ...] = ()
    settings: Mapping[str, Setting] = field(default_factory=dict)

    @property
    def is_whole(self) -> bool:
        """Whether it is a class or a count."""
        return np.dtype(self.variable.dtype).kind == "i"


def growth(points: Points, *, quantity: str, **fixed: Any) -> dict[str, Any]:
    """Growth rate or frequency of the fastest-growing mode of steady sliding, or the number of growing modes."""
    every = _complete(points, fixed)
    theta, mu, rigs = _drive_theta(every), every["mu"], _rig_of_each(every)
    values = np.empty(len(mu))
    for rig in dict.fromkeys(rigs):
        rows = [k for k, each in enumerate(rigs) if each == rig]
        grown = stability.largest_growth(rig, theta[rows], mu[rows], transients.BAND)
        values[rows] = dict(zip(GROWTH, grown, strict=True))[quantity]
    return {quantity: values}


def onset(points: Points, *, quantity: str, **fixed: Any) -> dict[str, Any]:
    """Lowest friction up to 1 from which a pair grows in the band, or its frequency; NaN where there is none."""

    def lowest(rig: Rig, theta: float) -> float:
        return stability.first_growth(rig, theta, transients.BAND, 1.0)[quantity == "onset_frequency"]

    return {quantity: _each(lowest, points, fixed)}


def glued(points: Points, *, quantity: str, **fixed: Any) -> dict[str, Any]:
    """A natural frequency of the beams glued at the contact."""
    number = int(quantity.rpartition("_")[2])
    return {quantity: _each(lambda rig, theta: float(glued_frequencies(rig, theta, number)[-1]), points, fixed)}


def probability(
    points: Points, *, quantity: str, scatter: Mapping[str, str], samples: int, seed: int, **fixed: Any
) -> dict[str, Any]:
    """Share of scattered rigs whose steady sliding is unstable; one sample of rigs serves all points.

    Points that differ in mu alone share one search for onsets.
    """
    every = _complete(points, fixed)
    theta, turned, rigs = _drive_theta(every), np.sign(every["V"]), _rig_of_each(every)
    draws, shares = instability.sample(scatter, samples, seed), np.empty(len(theta))
    own = draws.pop("mu", None)
    places: dict[Any, list[int]] = {}
    for k, place in enumerate(zip(rigs, theta.tolist(), turned.tolist(), strict=True)):
        places.setdefault(place, []).append(k)
    for (rig, angle, sense), rows in places.items():
        numbers = draws | {"theta": sense * draws["theta"] if "theta" in draws else angle}
        friction = every["mu"][rows] if own is None else own[:, None]
        shares[rows] = instability.unstable_share(rig, numbers, friction)
    return {quantity: shares}


def contact_limit(
    points: Points, *, quantity: str, cutoff: float, numerical_damping: str, **fixed: Any
) -> dict[str, Any]:
    """Friction from which on the contact force is not unique; NaN where it always is."""

    def limit(rig: Rig, theta: float) -> float:
        mu = critical_mu(rig, theta, transients.METHOD, numerical_damping=numerical_damping, cutoff=cutoff or None)
        return mu if np.isfinite(mu) else np.nan

    return {quantity: _each(limit, points, fixed)}


def motion(points: Points, *, quantity: str, members: int, **fixed: Any) -> dict[str, Any]:
    """Figures of the repeat runs of each point's normalised scene; in units of F where F is an axis."""
    every = _complete(points, fixed)
    normal = zip(*normalised.coordinates(every), _rig_of_each(every), strict=True)
    scenes = [Scene(float(V), float(theta), float(mu), 1.0, rig) for V, theta, mu, rig in normal]

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        return {quantity: regimes.ensemble_figures(runs)[quantity]}

    jobs = [ensembles.ensemble(scene, members, fixed) for scene in scenes]
    columns = outcomes(jobs, values, copies=True)
    if quantity in normalised.SCALED and "F" not in points:
        columns[quantity] = columns[quantity] * fixed["F"]
    return columns


def same_drive(points: Points) -> NDArray[Any]:
    """Equal rows where the rig and its inclination as seen from the drive are the same."""
    return _columns(points, _drive_theta(_complete(points, SAME)))


def same_sliding(points: Points) -> NDArray[Any]:
    """Equal rows where the friction is the same as well."""
    every = _complete(points, SAME)
    return _columns(points, _drive_theta(every), every["mu"])


def same_motion(points: Points) -> NDArray[Any]:
    """Equal rows for copies of one scene of one rig."""
    return _columns(points, *normalised.coordinates(_complete(points, SAME)))


def load(points: Points) -> dict[str, NDArray[Any]]:
    """The factors by which the summary of a normalised scene is multiplied."""
    return {"load": np.asarray(points["F"], dtype=float)}


def _complete(points: Points, fixed: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Every number that makes a scene and is given, one entry a point."""
    count = len(next(iter(points.values())))
    same = {name: np.full(count, float(fixed[name])) for name in AXES if name in fixed and name not in points}
    return same | {name: np.asarray(values, dtype=float) for name, values in points.items()}


def _drive_theta(every: Points) -> NDArray[Any]:
    """`fivcore.Scene.drive_theta` of each point."""
    return np.asarray(np.where(every["V"] > 0.0, every["theta"], -every["theta"]) + 0.0)


def _rig_of_each(every: Points) -> list[Rig]:
    rows = list(zip(*(every[name].tolist() for name in RIG), strict=True))
    made = {row: rig_of(dict(zip(RIG, row, strict=True)) | {"theta": 0.0})[0] for row in set(rows)}
    return [made[row] for row in rows]


def _each(find: Callable[[Rig, float], float], points: Points, fixed: Mapping[str, Any]) -> NDArray[Any]:
    """Evaluate `find(rig, theta)` at each point."""
    every = _complete(points, fixed)
    return np.array(
        [find(rig, theta) for rig, theta in zip(_rig_of_each(every), _drive_theta(every).tolist(), strict=True)]
    )


def _columns(points: Points, *columns: NDArray[Any]) -> NDArray[Any]:
    """Rows of a key, with the numbers of the rig that vary."""
    return np.stack([*columns, *(np.asarray(points[name], dtype=float) for name in RIG if name in points)], axis=1)


ONSETS = {
    "onset_mu": Variable("1", "lowest friction up to 1 from which a pair grows below 10 kHz"),
    "onset_frequency": Variable("Hz", "frequency of the pair that grows from the lowest friction on, or 10 kHz"),
}
GLUED = {
    f"glued_frequency_{k}": Variable("Hz", f"natural frequency {k} of the beams glued at the contact")
    for k in range(1, 9)
}
MOTION = {name: regimes.VARIABLES[name] for name in ("regime", "regime_certainty", *regimes.FIGURES)}
RUN = {name: each for name, each in regimes.STUDY.settings.items() if name not in AXES}
# A map is of any rig.
RUN["numerical_damping"] = transients.run_settings(1.0)["numerical_damping"]

# Of scattered rigs; their scatter is given by a table of its own.
SCATTER = {
    "samples": Setting(1024.0, "1", "number of scattered rigs"),
    "seed": Setting(0.0, "1", "of the random numbers"),
}

QUANTITIES: dict[str, Quantity] = (
    {name: Quantity(stability.VARIABLES[name], growth, same_sliding, ("theta", "mu")) for name in GROWTH}
    | {name: Quantity(variable, onset, same_drive, ("theta",)) for name, variable in ONSETS.items()}
    | {
        "critical_mu": Quantity(
            Variable("1", "friction from which on the contact force is not unique"),
            contact_limit,
            same_drive,
            ("theta",),
            settings={name: RUN[name] for name in ("cutoff", "numerical_damping")},
        )
    }
    | {name: Quantity(variable, glued, same_drive, ("theta",)) for name, variable in GLUED.items()}
    | {name: Quantity(each, motion, same_motion, transients.SCENE, settings=RUN) for name, each in MOTION.items()}
)
QUANTITIES["growth_rate"] = replace(QUANTITIES["growth_rate"], thresholds=(0.0,))
QUANTITIES["probability_unstable"] = Quantity(
    Variable("1", "share of scattered rigs whose steady sliding is unstable"),
    probability,
    same_sliding,
    ("theta", "mu"),
    thresholds=(0.5,),
    settings=SCATTER,
)
# Found over all mu: with mu as an axis there is nothing to show.
OVER_MU = (*ONSETS, "critical_mu")
