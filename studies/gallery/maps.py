"""Maps of a quantity over one or two parameters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from studies.answering.refinement import report
from studies.answering.results import MAPS, configuration
from studies.declaring import labels
from studies.declaring.parameters import RUN, SLIDING, Parameter
from studies.motion import ensemble, knock, run, uncertainty
from studies.physics import quantities
from studies.plotting import general
from studies.study import Study


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
            found += f", above {limit:g} at {100.0 * float((values > limit).mean()):.3g} % of the points"
        yield f"{labels.title(name, dataset[name])}: {found}."
        if name == "onset_frequency" and (entries := int((dataset[name] == run.BAND).sum())):
            where = labels.counted(entries, values.size)
            yield f"At {where} that is where a growing mode comes below {run.BAND:g} Hz; its onset is above."
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
        "Does steady sliding flutter, and how?", SLIDING, quantities.GROWTH, quantities.growth,
        **STEADY, like="stability", thresholds={"growth_rate": 0.0},
    ),
    "onset": Study(
        "map_onset", "Lowest μ at which steady sliding flutters (modes below 10 kHz)",
        "From which friction on does steady sliding flutter?", SLIDING, quantities.ONSET, quantities.onset,
        **STEADY,
    ),
    "contact_limit": Study(
        "map_contact_limit", "Uniqueness of the contact force", "Where is the contact force unique?",
        MODEL, quantities.LIMIT, quantities.contact_limit, summary=summarise,
    ),
    "glued": Study(
        "map_glued", "Natural frequencies of the beams glued at the contact",
        "At which frequencies do the glued beams vibrate?", {}, quantities.GLUED, quantities.glued,
        summary=summarise, beams=True,
    ),
    "motion": Study(
        "map_motion", "Motion", "How does the rig move?", RUNS, quantities.MOTION, quantities.motion,
        **MOVING, check=ensemble.check, coords=ensemble.APART, like="regimes",
    ),
    "chaos": Study(
        "map_chaos", "Chaos: how fast neighbouring motions part", "Is the motion chaotic?",
        TIME, quantities.CHAOS, quantities.chaos,
        **MOVING, thresholds={"lyapunov_exponent": 0.0},
    ),
    "cycles": Study(
        "map_cycles", "Limit cycle near the motion", "Which limit cycle is near the motion?",
        SEARCHED, quantities.CYCLE, quantities.cycles, **MOVING,
    ),
    "knock": Study(
        "map_knock", "Smallest knock that starts vibration where steady sliding is stable",
        "Which knock starts vibration?", knock.PARAMETERS, knock.OUTPUTS, knock.knocks,
        **MOVING, check=knock.check,
    ),
    "probability": Study(
        "map_probability", "Stability of uncertain rigs", "How likely is steady sliding to flutter?",
        DRAWS, quantities.PROBABILITY, quantities.probability, summary=summarise, check=uncertainty.check,
        beams=True, thresholds={"probability_unstable": 0.5},
        scatter=lambda numbers: uncertainty.distributions(uncertainty.usual(numbers)),
    ),
}  # fmt: skip
