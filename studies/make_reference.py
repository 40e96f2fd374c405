"""Compute the repository's own outcomes: `python -m studies.make_reference [STUDY ...]`.

All studies if none is named, from nothing and with their defaults (two hours of one core); it updates what `fiv
list` prints of each.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from studies import registry, runner
from studies.results import REFERENCE
from studies.study import Study
from sweeps import open_results


def entry(study: Study, folder: Path) -> dict[str, Any]:
    """Compute the entry of a study in `fiv list`; the time is that of the reference on one core."""
    plan = study.sweep({}).plan()
    index = plan.manifest.representative
    with open_results(folder / study.name / f"{study.name}.nc") as dataset:
        times = dataset["wall_time"].values.ravel()
    seconds = float(np.nansum(times if index is None else times[np.unique(index[index >= 0])]))
    return {"title": study.title, "question": study.question, "points": plan.points, "seconds": round(seconds, 3)}


def main(names: list[str]) -> None:
    """Compute the reference."""
    folder = Path("results") / REFERENCE
    catalogue = registry.catalogue()
    for name in names or registry.NAMES:
        study = registry.load(name)
        store = folder / name / f"{name}.nc"
        runner.execute(study, study.sweep({}).plan(store, fresh=True))
        catalogue[name] = entry(study, folder)
        print(store)
    ordered = {name: catalogue[name] for name in registry.NAMES if name in catalogue}
    registry.CATALOGUE.write_text(json.dumps(ordered, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
