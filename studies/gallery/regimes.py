"""The regime of the vibration at each speed and friction, by an ensemble, beside linear stability."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import Scene, Transient, loading_time
from studies import paper
from studies.answering.results import rig_of, with_variables
from studies.declaring import labels
from studies.declaring.spec import evenly, logarithmically
from studies.motion import ensemble, regimes
from studies.motion.jobs import Job, outcomes
from studies.motion.stability import LINEAR, first_onsets, linear_stability
from studies.physics.verdicts import BELOW, VERDICTS, uncertain, with_verdicts
from studies.plotting.regimes import draw
from studies.study import Claim, Parameter, Study
from sweeps import DONE, Variable

CLAIMS = tuple(Claim("regime", {"V": V}, kind, "2, 3.5.3", cells=True) for V, kind in paper.VIBRATION.items())


OUTPUTS = (
    ensemble.outputs()
    | LINEAR
    | {
        "duration": Variable("s", "simulated time, mean over realisations", (), "float32", 6),
        "loading_time": Variable(
            "s", "static stick time: the drive loads a stuck contact until it slips", (), "float32", 6
        ),
    }
)


def motions(scenes: Sequence[Scene], members: int, **options: Any) -> dict[str, Any]:
    """Regime, statistics and linear stability of each scene."""

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        scene = jobs[0].scene
        duration = np.mean([motion.summary["simulated_time"] for motion in runs])
        stability = linear_stability(scene, options["cutoff"], options["numerical_damping"])
        times = {"duration": duration, "loading_time": loading_time(scene)}
        return ensemble.statistics(runs) | stability | times

    return outcomes([ensemble.ensemble(scene, members, options) for scene in scenes], values)


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Add the onset of instability of steady sliding, and the comparison of the motion of each point with it."""
    dims, mu, frequency = first_onsets(dataset, rig_of(dataset))
    text = f"lowest mu at which steady sliding flutters (modes {BELOW}), up to the largest mu of the grid"
    onsets = {
        "onset_mu": (dims, mu, "1", text),
        "onset_frequency": (dims, frequency, "Hz", f"frequency at the {text}"),
    }
    return with_verdicts(with_variables(dataset, onsets))


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Regimes, their agreement with linear stability, and the range of each regime."""
    kinds, codes = (
        dataset["regime"].copy(data=each) for each in (regimes.kinds(dataset), dataset["verdict"].values)
    )
    compared, vary = codes.isin([0, 1, 2, 3]), [str(dim) for dim in kinds.dims if dataset.sizes[dim] > 1]

    def where(chosen: xr.DataArray) -> str:
        spans = [f"{labels.title(name)} {regimes.span(dataset, chosen, name)}" for name in vary if chosen.any()]
        return ", ".join(spans)

    told = f"No scene can be compared with linear stability {BELOW}"
    if compared.any():
        count, right = int(compared.sum()), int(((codes == 0) & compared).sum())
        scenes = f"all {count} scenes" if right == count else labels.counted(right, count, "scene")
        told = f"Linear stability {BELOW} predicts whether the rig vibrates in {scenes}"
    yield f"{told}, {regimes.damping_text(dataset)}."
    table = dataset.assign(dominant_frequency=regimes.dominant_frequency(dataset))
    names = ["stick_fraction", "velocity_rms", "dominant_frequency", "normal_force_999"]
    rows: list[Any] = []
    for code in np.unique(kinds):
        inside = kinds == code
        medians = [float(labels.readable(table[name]).where(inside).median()) for name in names]
        rows.append(
            (regimes.KINDS[code], int(inside.sum()), 100.0 * float(inside.mean()), *medians, where(inside))
        )
    heads = [f"{name} {labels.unit_of(table[name])[0]}".strip() for name in names]
    yield "Scenes by regime, with medians", pd.DataFrame(rows, columns=["regime", "scenes", "%", *heads, "where"])
    cases = {text: codes == k for k, text in enumerate(VERDICTS.values())}
    if int(dataset["members"]) > 1:
        cases["uncertain: realisations differ"] = kinds.copy(data=uncertain(dataset))
    rows = [(text, int(chosen.sum()), where(chosen)) for text, chosen in cases.items() if chosen.any()]
    caption = f"Motion against linear stability, {int((dataset['status'] == DONE).sum())} scenes"
    yield caption, pd.DataFrame(rows, columns=["verdict", "scenes", "where"])
    if np.isfinite(dataset["onset_mu"]).any():
        onsets = labels.frame(dataset, [*map(str, dataset["onset_mu"].dims), "onset_mu", "onset_frequency"])
        yield f"Lowest mu at which steady sliding flutters (modes {BELOW})", onsets


STUDY = Study(
    name="regimes",
    title="Regimes: kind of vibration over V and mu",
    question="Where does the rig slide steadily, vibrate, or stick and burst, with the published scheme's "
    "numerical damping, and does linear stability predict it?",
    paper="Sections 2 and 3.5.3, at mu = 0.2: intermittent vibration at 1 and 2 mm/s, periodic at 5 mm/s; by "
    "Section 3.4.2 steady sliding is unstable from mu = 0.12 on. A plane of regimes is not in it.",
    parameters={
        "V": Parameter(logarithmically(2e-4, 1e-2, 40), "m s-1", "speed of the drive"),
        "mu": Parameter(evenly(0.01, 0.4, 40), "1", "coefficient of friction"),
        "theta": Parameter(np.array([paper.THETA]), "degree", "inclination of P1"),
        "F": Parameter(np.array([paper.LOAD]), "N", "load on A"),
    }
    | ensemble.members(1)
    # Beside the paper's regimes, and stability below 10 kHz: without that damping modes above it grow first.
    | ensemble.until(0.3, 16.0, "published"),
    outputs=OUTPUTS, function=motions, coords=ensemble.coords, check=ensemble.check, derive=derive,
    summary=summarise, figure=draw, claims=CLAIMS, normalised=True, chaotic=True, roles=("motions", "states"),
)  # fmt: skip
