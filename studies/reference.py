"""The repository's own outcomes, in `results/reference`.

`python -m studies.reference [STUDY ...]` makes them, all if none is named, from nothing and with the studies' own
values (two hours of one core), and notes what `fiv list` says of each. Runs only read them.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from studies import registry, results, runner
from studies.cli.output import show
from sweeps import duration, open_results


def entry(name: str, folder: Path) -> dict[str, Any]:
    """A study's entry; the time is that of the reference's computations, on one core."""
    study = registry.load(name)
    plan = study.sweep({}).plan()
    own = plan.manifest.representative
    with open_results(folder / name / f"{name}.nc") as dataset:
        times = dataset["wall_time"].values.ravel()
    seconds = float(np.nansum(times if own is None else times[np.unique(own[own >= 0])]))
    return {"title": study.title, "question": study.question, "points": plan.points, "time": duration(seconds)}


def main(names: list[str]) -> None:
    """Make the reference."""
    folder = Path("results") / results.FOLDER
    catalogue = registry.catalogue()
    for name in names or registry.NAMES:
        plan = runner.plan(registry.load(name), {}, folder, fresh=True, reference=True)
        show(str(runner.execute(plan).file))
        catalogue[name] = entry(name, folder)
    ordered = {name: catalogue[name] for name in registry.NAMES if name in catalogue}
    text = json.dumps(ordered, indent=1, ensure_ascii=False)
    registry.CATALOGUE.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
