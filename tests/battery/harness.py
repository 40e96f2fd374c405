"""The battery's own part of pytest: a seed for all that is random, and counts of what was tried.

`python -m pytest` tries a few cases of each surface, always the same. `python -m pytest -m battery` tries
thousands of them, and what takes minutes, by a seed: half an hour on two cores. `--hypothesis-seed=N` gives the
seed, without which a new one is drawn; `--counts=results/battery.json` keeps what it prints.
"""

from __future__ import annotations

import json
import os
import secrets
import time
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from sweeps.fingerprint.provenance import environment
from tests.benchmarks import tables

# What was tried in this process, by what it is.
TRIED: Counter[str] = Counter()
began = time.monotonic()


def pytest_addoption(parser: pytest.Parser) -> None:
    """The file for the counts."""
    parser.addoption("--counts", metavar="FILE", type=Path, help="JSON file for the counts of a long run")


def at_length(config: pytest.Config) -> bool:
    """Whether this is the long run."""
    return config.option.markexpr.startswith("battery")


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Give all processes of a long run one seed, before Hypothesis reads it."""
    if at_length(config):
        if config.option.hypothesis_seed is None:
            config.option.hypothesis_seed = str(secrets.randbelow(10**6))
        # xdist would begin with the files of many tests; the storms are one.
        config.option.loadscopereorder = False
        # Test files are imported later.
        from tests.battery.surfaces import examples

        examples.at_length = True


def seed(config: pytest.Config) -> int:
    """The seed of this run: 0 of a short one."""
    return int(config.option.hypothesis_seed or 0)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Any:
    """A test's report has what it tried, from whatever process."""
    before = TRIED.copy()
    try:
        return (yield)
    finally:
        item.user_properties.append(("tried", dict(TRIED - before)))


def counted(reports: list[Any]) -> dict[str, int]:
    """What was tried in all tests."""
    total: Counter[str] = Counter()
    for report in reports:
        total.update(dict(report.user_properties).get("tried", {}))
    return dict(sorted(total.items()))


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Print seed and counts of a long run."""
    if not at_length(config):
        return
    stats = {key: terminalreporter.stats.get(key, []) for key in ("passed", "failed", "error", "skipped")}
    tried = counted([*stats["passed"], *stats["failed"]])
    terminalreporter.section(f"battery, seed {seed(config)}")
    for what, count in tried.items():
        terminalreporter.line(f"{count:>9,} {what}".replace(",", " "))
    if file := config.option.counts:
        keep(
            file,
            {
                "date": f"{datetime.now(UTC):%Y-%m-%d}",
                "commit": tables.git("describe", "--always", "--dirty", "--exclude=*", "--abbrev=7"),
                "seed": seed(config),
                "minutes": round((time.monotonic() - began) / 60.0, 1),
                "machine": tables.machine(),
                "environment": environment(),
                "passed": len(stats["passed"]),
                "failed": len(stats["failed"]) + len(stats["error"]),
                "skipped": len(stats["skipped"]),
                "tried": tried,
            },
        )


def keep(file: Path, outcome: dict[str, Any]) -> None:
    """Write the file, which is whole at any time."""
    temporary = file.with_name(f".{file.name}.{os.getpid()}.tmp")
    temporary.write_text(json.dumps(outcome, indent=1) + "\n", encoding="utf-8")
    os.replace(temporary, file)
