"""Maps: what is computed over one or two parameters that a request chooses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

import fivcore
from fivcore import Friction, Rig, Scene, UnsolvedError, flutter_onsets, limit_cycle, painleve_mu
from studies.answering.refinement import report
from studies.answering.results import MAPS, configuration
from studies.declaring import labels
from studies.declaring.parameters import RUN, SLIDING, Parameter
from studies.motion import ensemble, knock, run, uncertainty
from studies.motion.jobs import each_scene, outcomes
from studies.motion.stability import first_of, growths
from studies.plotting import general
from studies.study import Study
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
CYCLE = {
    "limit_cycle_frequency": ("Hz", "frequency of the limit cycle near the motion"),
    "limit_cycle_rms": Variable("m s-1", "RMS of the velocity of B on the limit cycle", (), scale="load"),
    "limit_cycle_stable": ("1", "1 where the limit cycle is stable, 0 where it is not"),
}
PROBABILITY = {"probability_unstable": ("1", "probability of instability")}
PROBABILITY |= {f"{name}_se": ("1", f"standard error of the {text}") for name, (_, text) in PROBABILITY.items()}


def growth(rig: Rig, theta: Any, mu: Any, **sliding: Any) -> dict[str, Any]:
    """The least stable mode of steady sliding, and the number of unstable ones."""
    return dict(zip(GROWTH, map(np.atleast_1d, growths(rig, theta, mu, **sliding)), strict=True))


def onset(rig: Rig, theta: Any, **sliding: Any) -> dict[str, Any]:
    """The lowest onset of flutter, the lowest recovery, and divergence; NaN without one."""
    columns, found = np.broadcast_arrays(np.atleast_1d(theta), *(sliding[name] for name in SLIDING)), []
    for angle, V, F, *law in zip(*(column.tolist() for column in columns), strict=True):
        crossings = flutter_onsets(rig, angle, run.BAND, MU_MAX, friction=Friction(*law), V=V, F=F)
        recovery = min(crossings.recovery_mu.tolist(), default=np.nan)
        found.append((*first_of(crossings, run.BAND), recovery, crossings.divergence_mu))
    return dict(zip(ONSET, np.transpose(found), strict=True))


def contact_limit(rig: Rig, theta: Any, **options: Any) -> dict[str, Any]:
    """The friction from which on the contact force is not unique; NaN where it always is."""
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
    """The limit cycle near which the motion of each scene is, NaN where none is found."""

    def values(scene: Scene) -> dict[str, Any]:
        try:
            cycle = limit_cycle(scene, duration=duration or SEARCH * scene.rig.time_scale, **how)
        except UnsolvedError:
            return dict.fromkeys(CYCLE, np.nan)
        found = cycle.frequency, cycle.summary["velocity_rms"], float(cycle.stable)
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


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """The range of each quantity, how it was computed, and the values along one parameter."""
    names, x, y = general.arranged(dataset)
    thresholds = STUDIES[str(dataset.attrs["sweep"]).removeprefix(f"{MAPS}_")].thresholds
    for name in names:
        values, (unit, _) = labels.readable(dataset[name]), labels.unit_of(dataset[name])
        found = " to ".join(dict.fromkeys(labels.number(float(end)) for end in (values.min(), values.max())))
        missing = int(values.isnull().sum())
        found = f"{found} {unit}".rstrip() + f", no value at {missing} of {values.size} points" * bool(missing)
        if "flag_values" in values.attrs:
            words, counts = np.unique(labels.words(values), return_counts=True)
            shares = zip(words, 100.0 * counts / values.size, strict=True)
            found = ", ".join(f"{word} {share:.3g} %" for word, share in shares)
        elif (limit := thresholds.get(name)) is not None:
            found += f", above {limit:g} at {100.0 * float((values > limit).mean()):.3g} %"
        yield f"{labels.title(name, dataset[name])}: {found}."
    yield " ".join([f"{dataset['status'].size} points.", *report(dataset)])
    if y is None:
        yield "Values", labels.frame(dataset, [x, *names, *(f"{n}_se" for n in names if f"{n}_se" in dataset)])
    if texts := configuration(dataset)["constants"].get("distributions"):
        yield "Uncertain parameters", uncertainty.table(texts)


RUNS = ensemble.members(1) | ensemble.until(0.3, 16.0)
TIME = {"duration": Parameter(4.0, "s", "simulated time", common=True)}
TIME |= {name: RUN[name] for name in ("ramp", "cutoff", "numerical_damping")}
MODEL = {name: RUN[name] for name in ("cutoff", "numerical_damping")}
SEARCHED = TIME | {"duration": Parameter(None, "s", "time of the run that is searched; auto: 0.5 s", common=True)}
DRAWS = {
    "samples": Parameter(1024, "1", "number of uncertain rigs", common=True),
    "seed": Parameter(0, "1", "seed of the random numbers", common=True),
}
STEADY: dict[str, Any] = {"summary": summarise, "normalised": True}
MOVING: dict[str, Any] = STEADY | {"chaotic": True}
# By what they compute; their outputs with one number a point are the quantities of maps.
STUDIES = {
    "growth": Study(
        "map_growth", "Least stable mode of steady sliding (modes below 10 kHz)",
        "Does steady sliding flutter, and how?", SLIDING, GROWTH, growth,
        **STEADY, like="stability", thresholds={"growth_rate": 0.0},
    ),
    "onset": Study(
        "map_onset", "Lowest μ at which steady sliding flutters (modes below 10 kHz)",
        "From which friction on does steady sliding flutter?", SLIDING, ONSET, onset, **STEADY,
    ),
    "contact_limit": Study(
        "map_contact_limit", "Uniqueness of the contact force", "Where is the contact force unique?",
        MODEL, LIMIT, contact_limit, summary=summarise,
    ),
    "glued": Study(
        "map_glued", "Natural frequencies of the beams glued at the contact",
        "At which frequencies do the glued beams vibrate?", {}, GLUED, glued, summary=summarise, beams=True,
    ),
    "motion": Study(
        "map_motion", "Motion", "How does the rig move?", RUNS, MOTION, motion,
        **MOVING, check=ensemble.check, coords=ensemble.APART, like="regimes",
    ),
    "chaos": Study(
        "map_chaos", "Chaos: how fast neighbouring motions part", "Is the motion chaotic?", TIME, CHAOS, chaos,
        **MOVING, thresholds={"lyapunov_exponent": 0.0},
    ),
    "cycles": Study(
        "map_cycles", "Limit cycle near the motion", "Which limit cycle is near the motion?",
        SEARCHED, CYCLE, cycles, **MOVING,
    ),
    "knock": Study(
        "map_knock", "Smallest knock that starts vibration where steady sliding is stable",
        "Which knock starts vibration?", knock.PARAMETERS, knock.OUTPUTS, knock.knocks,
        **MOVING, check=knock.check,
    ),
    "probability": Study(
        "map_probability", "Stability of uncertain rigs", "How likely is steady sliding to flutter?",
        DRAWS, PROBABILITY, probability, summary=summarise, check=uncertainty.check, beams=True,
        thresholds={"probability_unstable": 0.5},
        scatter=lambda numbers: uncertainty.distributions(uncertainty.usual(numbers)),
    ),
}  # fmt: skip
