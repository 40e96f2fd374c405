"""Compute the repository's own outcomes: `python -m tests.make_reference [--adopt N] [STUDY ...]`.

All studies if none is named, from nothing and with their defaults (two hours of one core), those of the paper's
motion with the identified damping too; it updates what `fiv list` prints of each. With --adopt, after a change
of code that changes no result, N points of each are computed again on a processor of the same kind; the
reference is kept if all their bits agree.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from studies import paper, registry, runner
from studies.accuracy.study import COSTS
from studies.answering import claims
from studies.answering.results import REFERENCE
from studies.asking.sweep import sweep_of
from studies.cli.options import CATALOGUE
from studies.study import Study
from sweeps import Adopt, open_results

# Studies that are computed with the identified damping as well, into a folder of that name; what else is set then.
IDENTIFIED = "identified"
TWICE: dict[str, dict[str, Any]] = {
    **{name: {} for name in ("fig5", "fig7", "table6", "regimes")},
    "contact": {"window_start": 0.13},  # within a burst at 2 mm/s
    "stick_time": {"mu": paper.MU, "F": paper.LOAD},
}


def entry(study: Study, folder: Path) -> dict[str, Any]:
    """Compute the entry of a study in `fiv list`; the time is that of the reference on one core."""
    plan = sweep_of(study).plan()
    index = plan.manifest.representative
    with open_results(folder / study.name / f"{study.name}.nc") as dataset:
        times = dataset["wall_time"].values.ravel()
    seconds = float(np.nansum(times if index is None else times[np.unique(index[index >= 0])]))
    found = {"title": study.title, "question": study.question, "points": plan.points, "seconds": round(seconds, 3)}
    found |= {"structure": study.takes_structure}
    return found | {"roles": list(study.roles)} if study.roles else found


def main() -> None:
    """Compute the reference, or adopt it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("studies", metavar="STUDY", nargs="*", choices=[[], *registry.NAMES], help="default: all")
    parser.add_argument("--adopt", metavar="N", type=int, help="keep the reference if N points have the same bits")
    arguments = parser.parse_args()
    folder, catalogue = Path("results") / REFERENCE, json.loads(CATALOGUE.read_text(encoding="utf-8"))
    for name in arguments.studies or registry.NAMES:
        study, requests = registry.load(name), {folder: dict[str, Any]()}
        if name in TWICE:
            requests[folder / IDENTIFIED] = claims.IDENTIFIED | TWICE[name]
        for place, values in requests.items():
            store = place / name / f"{name}.nc"
            if arguments.adopt is None:
                runner.execute(study, sweep_of(study, values).plan(store, fresh=True))
                print(store)
            else:
                adopt = Adopt(arguments.adopt, exact=True, measured=COSTS)
                plan = sweep_of(study, values).plan(store, adopt=adopt)
                plan.run()
                print(f"{store}: {plan.adopted or 'its code has not changed'}")
        if arguments.adopt is None:
            catalogue[name] = entry(study, folder)
    ordered = {name: catalogue[name] for name in registry.NAMES if name in catalogue}
    CATALOGUE.write_text(json.dumps(ordered, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
