"""Quantities of maps, sorted by the arguments from which they are computed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import fivcore
from fivcore import Friction, NoVibrationError, Rig, Scene, UnsolvedError, flutter_onsets, limit_cycle, painleve_mu
from studies.declaring.parameters import SLIDING
from studies.motion import ensemble, run, uncertainty
from studies.motion.jobs import each_scene, outcomes
from studies.motion.stability import first_of, growths
from sweeps import Variable

MU_MAX = 1.0
# Length of a run that is searched for a limit cycle, s; of a structure in units of its time.
SEARCH = 0.5
GROWTH = {
    "growth_rate": Variable("s-1", "growth rate of the least stable mode", (), "float32", digits=4),
    "frequency": Variable("Hz", "frequency of the least stable mode", (), "float32", digits=5),
    "unstable_modes": Variable("1", "number of unstable modes", (), "int8"),
}
ONSET = {"onset_mu": ("1", "lowest onset mu"), "onset_frequency": ("Hz", "frequency at the lowest onset")}
ONSET |= {
    "recovery_mu": ("1", "lowest mu at which a pair recovers"),
    "divergence_mu": ("1", "mu from which the contact jams"),
}
LIMIT = {"painleve_mu": ("1", "mu from which on the contact force is not unique")}
GLUED = {f"glued_frequency_{k}": ("Hz", f"natural frequency {k}, glued") for k in range(1, 9)}
# A standard error says what it is of; what a member or a regime has is left out.
MOTION = {
    n: v if n.endswith("_se") else replace(v, long_name=v.long_name.split(",")[0])
    for n, v in ensemble.outputs().items()
    if v.dims in ((), ("motion",))
}
CHAOS = {"lyapunov_exponent": ("s-1", "largest Lyapunov exponent of the motion")}
CHAOS |= {f"{name}_se": ("s-1", f"standard error of the {text}") for name, (_, text) in CHAOS.items()}
# "no vibration": the motion is stuck or slides steadily; "not found": it vibrates, or is undecided.
SEARCHED = ("found", "no vibration", "not found")
CYCLE = {
    "limit_cycle_frequency": ("Hz", "frequency of the limit cycle near the motion"),
    "limit_cycle_rms": Variable("m s-1", "RMS of the velocity of B on the limit cycle", (), scale="load"),
    "limit_cycle_stable": ("1", "1 where the limit cycle is stable, 0 where it is not"),
    "limit_cycle_search": Variable(
        "1", "outcome of the search near the motion", (), "int8", flags=dict(enumerate(SEARCHED))
    ),
}
PROBABILITY = {"probability_unstable": ("1", "probability of instability")}
PROBABILITY |= {f"{name}_se": ("1", f"standard error of the {text}") for name, (_, text) in PROBABILITY.items()}


def growth(rig: Rig, theta: Any, mu: Any, **sliding: Any) -> dict[str, Any]:
    """Growth rate and frequency of the least stable mode of steady sliding, and the number of unstable modes."""
    return dict(zip(GROWTH, map(np.atleast_1d, growths(rig, theta, mu, **sliding)), strict=True))


def onset(rig: Rig, theta: Any, **sliding: Any) -> dict[str, Any]:
    """The lowest onset of flutter, the lowest recovery, and divergence; NaN if there is none."""
    columns, found = np.broadcast_arrays(np.atleast_1d(theta), *(sliding[name] for name in SLIDING)), []
    for angle, V, F, *law in zip(*(column.tolist() for column in columns), strict=True):
        crossings = flutter_onsets(rig, angle, run.BAND, MU_MAX, friction=Friction(*law), V=V, F=F)
        recovery = min(crossings.recovery_mu.tolist(), default=np.nan)
        found.append((*first_of(crossings, run.BAND), recovery, crossings.divergence_mu))
    return dict(zip(ONSET, np.transpose(found), strict=True))


def contact_limit(rig: Rig, theta: Any, **options: Any) -> dict[str, Any]:
    """The friction above which the contact force is not unique; NaN if it always is."""
    found = [painleve_mu(rig, angle, run.METHOD, **options) for angle in np.ravel(theta).tolist()]
    return {"painleve_mu": np.where(np.isfinite(found), found, np.nan)}


def glued(rig: Rig, theta: Any) -> dict[str, Any]:
    """Natural frequencies of the beams glued at the contact."""
    found = [fivcore.glued_frequencies(rig, angle, len(GLUED)) for angle in np.ravel(theta).tolist()]
    return dict(zip(GLUED, np.transpose(found), strict=True))


def motion(scenes: Sequence[Scene], members: int, **options: Any) -> dict[str, Any]:
    """Statistics of the realisations of each scene."""
    jobs = [ensemble.ensemble(scene, members, options) for scene in scenes]
    return outcomes(jobs, lambda _, runs: {k: v for k, v in ensemble.statistics(runs).items() if k in MOTION})


def chaos(scenes: Sequence[Scene], duration: float, **how: Any) -> dict[str, Any]:
    """The largest Lyapunov exponent of the motion of each scene."""

    def values(scene: Scene) -> dict[str, Any]:
        exponent = fivcore.lyapunov_exponent(scene, duration, **how)
        return dict(zip(CHAOS, (exponent.value, exponent.standard_error), strict=True))

    return each_scene(scenes, values)


def cycles(scenes: Sequence[Scene], duration: float | None, **how: Any) -> dict[str, Any]:
    """The limit cycle near the motion of each scene; NaN if none is found."""

    def values(scene: Scene) -> dict[str, Any]:
        try:
            cycle = limit_cycle(scene, duration=duration or SEARCH * scene.rig.time_scale, **how)
        except UnsolvedError as error:
            outcome = "no vibration" if isinstance(error, NoVibrationError) else "not found"
            return dict.fromkeys(CYCLE, np.nan) | {"limit_cycle_search": SEARCHED.index(outcome)}
        found = cycle.frequency, cycle.summary["velocity_rms"], float(cycle.stable), SEARCHED.index("found")
        return dict(zip(CYCLE, found, strict=True))

    return each_scene(scenes, values)


def probability(rig: Rig, theta: Any, mu: Any, samples: int, seed: int, distributions: Any) -> dict[str, Any]:
    """The fraction of uncertain rigs that are unstable; one sample of rigs serves all points."""
    theta, mu = np.broadcast_arrays(np.atleast_1d(theta), np.atleast_1d(mu))
    draws = uncertainty.draws(distributions, samples, seed)
    drawn_mu, share = draws.pop("mu", None), np.empty(len(theta))
    for angle in np.unique(theta):
        rows = theta == angle
        friction = mu[rows] if drawn_mu is None else drawn_mu[:, None]
        share[rows] = uncertainty.unstable_share(rig, {"theta": angle} | draws, friction)
    return dict(zip(PROBABILITY, (share, np.sqrt(share * (1.0 - share) / samples)), strict=True))
