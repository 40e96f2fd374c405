"""Measured tables: `python -m tests.benchmarks [PART | PART.TABLE ...]` measures them, all by default.

Each goes into results/benchmarks.json with machine, commit and date, as soon as it is there; the others stay.
`python -m tests.benchmarks --show [PART | PART.TABLE ...]` prints what that file holds; `--tables` writes the
tables of the READMEs. Two cores that do nothing else are needed; each table is measured in a process of its own.
`python -m tests.benchmarks constants [--full]` prints the constants that decide the motion, each with the
measurement behind it, in minutes; with `--full` in an hour or two.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from importlib import import_module

from threadpoolctl import threadpool_limits

from tests.benchmarks import tables

PARTS = (
    *("stability", "many", "transient", "kernel", "scaling", "sweeps"),
    *("query", "studies", "maps", "damping", "ensembles", "rivals", "cycles", "contacts", "constants"),
)


def chosen(asked: list[str]) -> list[str]:
    """The names PART.TABLE of what was asked for."""
    every = [f"{part}.{name}" for part in PARTS for name in import_module(f"tests.benchmarks.{part}").TABLES]
    unknown = [each for each in asked if each not in (*PARTS, *every)]
    if unknown:
        raise SystemExit(f"PART = {unknown[0]!r}: it must be one of {', '.join((*PARTS, *every))}")
    return [name for name in every if not asked or name in asked or name.partition(".")[0] in asked]


def measure(name: str) -> tables.Table:
    """Measure one table, in this process, on one core unless it says otherwise itself."""
    part, _, table = name.partition(".")
    with threadpool_limits(1):
        found: tables.Table = import_module(f"tests.benchmarks.{part}").TABLES[table]()
    return found


def main() -> None:
    """Measure, or write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--tables", action="store_true", help="write the READMEs' tables, measure nothing")
    parser.add_argument("--show", action="store_true", help="print measured tables, measure nothing")
    parser.add_argument("--print", action="store_true", help="print one table as JSON, keep nothing")
    parser.add_argument("--full", action="store_true", help="measure the constants on all rigs and structures")
    given = parser.parse_args()
    if given.names == ["constants"]:
        import_module("tests.benchmarks.constants").show(given.full)
    elif given.tables:
        tables.write()
    elif given.show:
        known = tables.load()
        for name in chosen(given.names):
            print(f"{name}\n{tables.markdown(name, known)}" if name in known else f"{name}\nnot measured yet\n")
    elif given.print:
        print(json.dumps(measure(given.names[0])._asdict()))
    else:
        for name in chosen(given.names):
            where, begin = tables.provenance(), time.perf_counter()
            command = [sys.executable, "-m", "tests.benchmarks", name, "--print"]
            done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
            tables.keep(name, where | json.loads(done.stdout.splitlines()[-1]))
            print(f"{name}: {time.perf_counter() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main()
