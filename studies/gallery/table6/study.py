"""Table 6: linear stability of steady sliding, and the motion in time, over the inclination."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from fivcore import Rig, Scene, Transient, checks, sliding_modes
from studies import paper
from studies.gallery import fig11
from studies.gallery.table6.windows import with_windows
from studies.motion import ensembles, regimes, transients
from studies.motion.jobs import BATCH_MULTIPLE, Job, check_jobs, outcomes
from studies.rig import rig_of, rig_settings
from studies.spec import evenly
from studies.study import Setting, Study, deferred
from sweeps import Axis, Variable

MOST_MEMBERS = 1000
# Places for unstable pairs; fixed, so that a file can be completed whatever its angles. The paper's rig fills two
# at mu = 0.2 and at most four up to mu = 2.
PAIRS = 8
AVERAGED = ("velocity_rms", "stick_fraction", "slip_fraction", "separation_fraction")
KEPT = ("regime", "dominant_frequency", *AVERAGED)


def _of(name: str, whose: str, dims: tuple[str, ...]) -> Variable:
    summary = transients.SUMMARY[name]
    return replace(summary, long_name=f"{summary.long_name}, {whose}", dims=dims)


VARIABLES = (
    {
        "unstable_modes": Variable("1", "number of unstable modes of steady sliding below 10 kHz", (), "int16"),
        "frequency": Variable("Hz", "frequency of the unstable pair of steady sliding", ("pair",)),
        "growth_rate": Variable("s-1", "growth rate of the unstable pair of steady sliding", ("pair",)),
    }
    | fig11.STABILITY
    | {
        "duration": Variable("s", "simulated time, mean over repeat runs"),
        "regime": replace(transients.SUMMARY["regime"], long_name="regime of most repeat runs"),
        "regime_share": Variable("1", "share of the repeat runs in the regime of most"),
        "dominant_frequency": _of("dominant_frequency", "lower median of the vibrating repeat runs", ()),
    }
    | {name: _of(name, "mean of the repeat runs", ()) for name in AVERAGED}
    | {f"member_{name}": _of(name, "of one repeat run", ("member",)) for name in KEPT}
)


def inclinations(points: Mapping[str, Any], *, members: int, **fixed: Any) -> dict[str, Any]:
    """Unstable pairs of steady sliding, and the motion of an ensemble, at each inclination."""

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        scene = jobs[0].scene
        fastest = dict(zip(fig11.STABILITY, fig11.fastest(scene), strict=True))
        return (
            unstable_pairs(scene)
            | fastest
            | ensemble(runs)
            | {"duration": np.mean([run.summary["simulated_time"] for run in runs])}
        )

    every = transients.scenes(points, fixed)
    return outcomes([ensembles.ensemble(scene, members, fixed) for scene in every], values)


def unstable_pairs(scene: Scene) -> dict[str, Any]:
    """Frequency and growth rate of the unstable pairs, ascending in frequency, and how many there are.

    Of more than PAIRS those that grow fastest; NaN where there are fewer.
    """
    modes = sliding_modes(scene.rig, scene.drive_theta, scene.mu, transients.BAND)
    unstable = np.flatnonzero(modes.unstable)
    fastest = np.argsort(-modes.growth_rate[unstable], kind="stable")[:PAIRS]
    chosen = np.sort(unstable[fastest])  # modes ascend in frequency
    frequency, growth = np.full((2, PAIRS), np.nan)
    frequency[: len(chosen)], growth[: len(chosen)] = modes.frequency[chosen], modes.growth_rate[chosen]
    return {"unstable_modes": len(unstable), "frequency": frequency, "growth_rate": growth}


def ensemble(runs: Sequence[Transient]) -> dict[str, Any]:
    """The motion of a scene's repeat runs: of each, and of all together."""
    figures = ensembles.figures_of(runs)
    each = {name: figures[name] for name in KEPT}
    vibrates = regimes.is_of(each["regime"], *regimes.VIBRATING)
    each["dominant_frequency"] = np.where(vibrates, each["dominant_frequency"], np.nan)
    most, counts = ensembles.majority(each["regime"])
    together = {name: each[name].mean() for name in AVERAGED} | {
        "regime": most,
        "regime_share": counts[most] / len(runs),
        "dominant_frequency": ensembles.middle(each["dominant_frequency"]),
    }
    return together | {f"member_{name}": values for name, values in each.items()}


def constants(settings: Mapping[str, float]) -> dict[str, Any]:
    """The rig, the operating point, the ensemble and how long it runs."""
    rig, _ = rig_of({**settings, "theta": paper.THETA})
    members = checks.count("members", settings["members"], MOST_MEMBERS)
    point = {name: settings[name] for name in ("V", "mu", "F")}
    return point | ensembles.shared(settings) | {"rig": rig, "members": members}


def check(axes: Mapping[str, Axis], fixed: Mapping[str, Any]) -> None:
    """Refuse what cannot be run; a scene whose contact has no unique solution fails as a point."""
    ensembles.check(fixed)
    checks.between("cutoff", fixed["cutoff"], 0.0, 1e12, "Hz")
    first, *_ = transients.scenes({"theta": axes["theta"].values}, fixed)
    check_jobs([ensembles.member(first, 1, fixed, 1e-6)])


def coords(*, members: int, **_: Any) -> dict[str, Axis]:
    """The pairs and the repeat runs, counted from 1."""
    return {
        "pair": Axis(np.arange(1, PAIRS + 1), "1", "unstable pair, ascending in frequency"),
        "member": Axis(np.arange(1, members + 1), "1", "repeat run, by the ramp of the drive"),
    }


def derive(dataset: xr.Dataset, *, rig: Rig, mu: float, V: float, **_: Any) -> xr.Dataset:
    """Add the windows of instability."""
    return with_windows(dataset, rig, mu, V)


STUDY = Study(
    name="table6",
    title="Table 6: stability and motion over the inclination",
    question="At which inclinations is steady sliding unstable, and how does the rig then move, with the "
    "published scheme's numerical damping?",
    paper="Section 3.6, on Table 6, at 2 mm/s: vibration at 2700 Hz at 10 degrees, steady sliding at 15, above 12 "
    "and at negative angles; Sections 2, 3.4.2 and 3.5.3, at 5 degrees: 2700 Hz measured and simulated, unstable "
    "pairs at 400 and 2800 Hz. The body of the table is not at hand.",
    axes={"theta": Axis(evenly(-10.0, 20.0, 61), "degree", "inclination of P1")},
    settings={
        "V": Setting(paper.ANGLES_SPEED, "m s-1", "velocity of P2's clamp"),
        "mu": Setting(paper.MU, "1", "coefficient of friction"),
        "F": Setting(paper.LOAD, "N", "load on A"),
        "members": Setting(6.0, "1", "number of repeat runs at each inclination"),
    }
    | ensembles.settings(0.3, 8.0, transients.PUBLISHED, standard_error=ensembles.KNOWN)
    | {name: setting for name, setting in rig_settings().items() if name != "theta"},
    function=inclinations,
    variables=VARIABLES,
    constants=constants,
    coords=coords,
    check=check,
    derive=derive,
    options={"batch_multiple": BATCH_MULTIPLE},
    draw=deferred("studies.gallery.table6.figure:draw"),
    findings=deferred("studies.gallery.table6.findings:findings"),
)
