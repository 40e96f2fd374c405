"""Every performance table of the READMEs: `python -m tests.benchmarks [--figure FILE] > tables.md`.

Two cores that do nothing else are needed. Each part is a program of its own, `python -m tests.benchmarks.PART`,
and says what it measures.
"""

from __future__ import annotations

import subprocess
import sys

from tests.benchmarks.stability import machine

PARTS = ("stability", "many", "transient", "kernel", "scaling", "sweeps", "query", "studies", "maps")


def main() -> None:
    """Run the parts one after another, and name the machine once."""
    print(machine(), flush=True)
    for part in PARTS:
        given = sys.argv[1:] if part == "scaling" else []
        found = subprocess.run(
            [sys.executable, "-m", f"tests.benchmarks.{part}", *given],
            check=True,
            stdout=subprocess.PIPE,
            text=True,
        )
        told = found.stdout.replace(machine(), "").replace(machine().removesuffix(", one core used"), "")
        print(told.rstrip(), flush=True)


if __name__ == "__main__":
    main()
