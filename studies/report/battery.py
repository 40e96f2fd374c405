"""The line of the page that says what the project's long tests tried last."""

from __future__ import annotations

import json
from pathlib import Path

from studies import results

FILE = "battery.json"


def battery(out: str | Path | None = None) -> str:
    """One line on the outcome of the long tests; "" where their file is not, or is another.

    It stands beside the reference results, in a checkout.
    """
    file = results.reference_folder(out).parent / FILE
    try:
        known = json.loads(file.read_text(encoding="utf-8"))
        cases, kinds = sum(known["tried"].values()), len(known["tried"])
        failed = int(known["failed"])
        total = int(known["passed"]) + failed
        outcome = f"{failed} of {total} tests failed" if failed else f"all {total} tests passed"
        made = f"{known['date']:.10}, commit {known['commit']:.20}, seed {known['seed']:d}"
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return ""
    return f"Random input and faults: {outcome}, with {cases:,} cases of {kinds} kinds ({made})."
