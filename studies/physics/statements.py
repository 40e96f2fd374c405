"""The paper's statements on motion as rules, the scenes that they concern, and their truth for a rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from fivcore import Rig, Scene, Transient, flutter_onsets
from studies import paper
from studies.declaring.parameters import RIG, SCENE
from studies.motion import ensemble, regimes, run
from studies.motion.jobs import Job, outcomes
from sweeps import DONE, Variable

Motions = Mapping[str, Mapping[str, Any]]
Rule = Callable[[Motions], Any]
# Each scene by what differs from the paper's reference case, 2 mm/s. The paper says "lower" of friction and load,
# "greater than 12 degrees" and "negative angles".
STEADY = {"15 degrees": 15.0, "12.5 degrees": 12.5, "-5 degrees": -5.0}
SCENES: dict[str, dict[str, float]] = {
    **{f"{1e3 * V:g} mm/s": {"V": V} for V in paper.SPEEDS},
    "less friction": {"mu": 0.75 * paper.MU},
    "less load": {"F": 0.5 * paper.LOAD},
    **{name: {"theta": theta} for name, theta in {"10 degrees": 10.0, **STEADY}.items()},
}
PEAKS = ("normal_force", "slip_speed")
# How near a frequency and a ratio of sticks must be to the paper's, relatively.
NEAR_LINE, NEAR_RATIO = 0.05, 0.25
# Onsets are those of the paper's range of mu.
MU_MAX = 0.5


def _is(scene: str, *kinds: str) -> Rule:
    return lambda of: regimes.is_of(of[scene]["regime"], *kinds)


def _near(scene: str, other: str, name: str, value: float, within: float) -> Rule:
    """A quantity of a scene, or its ratio to that of another scene, lies within a relative distance of a value."""

    def rule(of: Motions) -> Any:
        found = of[scene][name] / (of[other][name] if other else 1.0)
        sticks = not other or _is(scene, "intermittent")(of) & _is(other, "intermittent")(of)
        return sticks & (np.abs(found - value) <= within * value)

    return rule


def _reaches(scene: str, name: str, value: float) -> Rule:
    """A run reaches a value, but exceeds it for less than a thousandth of the time."""
    return lambda of: (of[scene][f"{name}_999"] <= value) & (value <= of[scene][f"max_{name}"])


def _shorter(scene: str) -> Rule:
    """A scene vibrates without long sticks, or with shorter ones than at 2 mm/s."""

    def rule(of: Motions) -> Any:
        shorter = of[scene]["mean_stick_time"] < of["2 mm/s"]["mean_stick_time"]
        without = _is(scene, *regimes.WITHOUT_STICKS)(of)
        return _is("2 mm/s", "intermittent")(of) & (without | (_is(scene, "intermittent")(of) & shorter))

    return rule


# Section and rule of each statement; the rule says of each realisation whether the statement holds.
STATEMENTS: dict[str, tuple[str, Rule]] = {
    "intermittent at 1 mm/s": ("2, 3.5.3", _is("1 mm/s", "intermittent")),
    "intermittent at 2 mm/s": ("2, 3.5.3", _is("2 mm/s", "intermittent")),
    "no long sticks at 5 mm/s": ("2, 3.5.4.2", _is("5 mm/s", *regimes.WITHOUT_STICKS)),
    # Half the load moves as twice the speed.
    "intermittent at 4 mm/s": ("3.5.4.2", _is("less load", "intermittent")),
    "less friction, shorter sticks": ("3.5.4.2", _shorter("less friction")),
    "less load, shorter sticks": ("3.5.4.2", _shorter("less load")),
    "sticks at 2 mm/s half of 1 mm/s": (
        "3.5.4.2", _near("2 mm/s", "1 mm/s", "mean_stick_time", paper.STICK_RATIO, NEAR_RATIO),
    ),
    "no long sticks at 10 degrees": ("3.6", _is("10 degrees", *regimes.WITHOUT_STICKS)),
    **{f"steady at {name}": ("3.6", _is(name, regimes.STEADY)) for name in STEADY},
    **{
        f"{paper.SIMULATED_LINE:g} Hz at {scene}": (
            section, _near(scene, "", "dominant_frequency", paper.SIMULATED_LINE, NEAR_LINE),
        )
        for scene, section in {**dict.fromkeys([*SCENES][:3], "3.5.3"), "10 degrees": "3.6"}.items()
    },
    **{
        text: (section, _reaches(scene, name, value))
        for scene, section, (force, speed) in (
            ("2 mm/s", "3.5.4.2", paper.CONTACT_PEAKS[2e-3]), ("5 mm/s", "3.5.4.1", paper.CONTACT_PEAKS[5e-3]),
        )
        for text, name, value in (
            (f"{force:g} N at {scene}", PEAKS[0], force),
            (f"slip {1e3 * speed:g} mm/s at {scene}", PEAKS[1], speed),
        )
    },
}  # fmt: skip
QUANTITIES = ("stick_fraction", "mean_stick_time", "dominant_frequency", "periodicity", "normal_force_999",
              "max_normal_force", "slip_speed_999", "max_slip_speed")  # fmt: skip
OUTPUTS = {
    "truth": Variable("1", "share of the realisations in which a statement holds", ("statement",), "float32", 6),
    "held": Variable("1", "statements that hold in more than half of the realisations", (), "int16"),
    "regime": replace(run.SUMMARY["regime"], long_name="regime of most realisations", dims=("scene",)),
    **{
        name: replace(run.SUMMARY[name], long_name=f"{run.SUMMARY[name].long_name}, middle of the realisations",
                      dims=("scene",), dtype="float32", digits=4)
        for name in QUANTITIES
    },
    "onset_mu": Variable("1", "onset mu of flutter", ("onset",), digits=8),
    "onset_frequency": Variable("Hz", "frequency at the onset of flutter", ("onset",), digits=8),
}  # fmt: skip


def statements(rig: Rig, duration: float, members: int, **options: Any) -> dict[str, Any]:
    """Truth of each statement for a rig, statistics of its scenes, and its onsets."""
    ramps = [options["ramp"] * (1.0 + ensemble.STRETCH * k) for k in range(members)]
    point = {name: parameter.default for name, parameter in SCENE.items()}
    jobs = [
        run.job(Scene(**point | scene, rig=rig), duration, options | {"ramp": ramp})
        for scene in SCENES.values()
        for ramp in ramps
    ]

    def values(_: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        own = [ensemble.summaries(runs[k * members : (k + 1) * members]) for k in range(len(SCENES))]
        motions = dict(zip(SCENES, own, strict=True))
        truth = np.array([np.mean(holds(motions)) for _, holds in STATEMENTS.values()])
        onsets = flutter_onsets(rig, paper.THETA, run.BAND, MU_MAX)
        return {
            "truth": truth,
            "held": np.count_nonzero(truth > 0.5),
            "regime": [ensemble.majority(each["regime"])[0] for each in own],
            **{name: [ensemble.middle(each[name]) for each in own] for name in QUANTITIES},
            "onset_mu": onsets.mu[: len(paper.ONSETS)],
            "onset_frequency": onsets.frequency[: len(paper.ONSETS)],
        }

    return outcomes([jobs], values)


def most(dataset: xr.Dataset) -> xr.DataArray:
    """Mark the points at which the largest number of statements holds."""
    held: xr.DataArray = dataset["held"].where(dataset["status"] == DONE)
    return held == held.max()


def holding(dataset: xr.Dataset) -> xr.DataArray:
    """Fraction of the points at which each statement holds."""
    share: xr.DataArray = (dataset["truth"] > 0.5).where(dataset["status"] == DONE).mean(["d1", "d2"])
    return share


def identified(dataset: xr.Dataset) -> dict[str, float]:
    """The identified damping: the printed d1, and the d2 at which most statements hold for it.

    Of several such d2 it is the one at which the statements hold in most realisations; then the smallest.
    """
    column = dataset.sel(d1=RIG["d1"].default, method="nearest").transpose("d2", ...)
    held = column["held"] + column["truth"].sum("statement") / (1.0 + column.sizes["statement"])
    place = np.argmax(held.where(column["status"] == DONE).fillna(-1.0).values)
    return {"d1": float(column["d1"]), "d2": float(column["d2"][place])}
