"""A run of `fiv` in processes of its own, watched from outside: its memory, and how far it is."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from sweeps.storage.store import Store, read_state
from tests import HOME

PAGE, TICK = os.sysconf("SC_PAGE_SIZE"), 1.0 / os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Look:
    """What a run had at one moment: seconds since it began, points, and memory and time of its processes."""

    at: float
    done: int
    todo: int
    # Resident bytes of each process and seconds that it had of a processor, by its number.
    memory: dict[int, int]
    processor: dict[int, float]


def family(process: int) -> list[int]:
    """A process and all that it has started, as far as they are there."""
    members = [process]
    for member in members:
        with suppress(OSError):
            for task in os.listdir(f"/proc/{member}/task"):
                text = Path(f"/proc/{member}/task/{task}/children").read_text()
                members += [int(child) for child in text.split() if int(child) not in members]
    return members


def resident(process: int) -> int:
    """Bytes that a process has in memory; 0 where it has gone."""
    with suppress(OSError):
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * PAGE
    return 0


def processor(process: int) -> float:
    """Seconds of a processor that a process has had; 0 where it has gone."""
    with suppress(OSError):
        # Behind the name, which may have blanks and brackets.
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) * TICK
    return 0.0


def watch(store: Store, *arguments: str, every: float = 0.5) -> tuple[list[Look], str]:
    """Run `fiv` with these arguments to its end; looks at it while it computed, and what it printed."""
    path = os.pathsep.join([str(HOME), os.environ.get("PYTHONPATH", "")])
    looks, log = [], store.file.parent.parent / "printed.txt"
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("w") as printed:
        process = subprocess.Popen(
            [sys.executable, "-m", "studies", *arguments],
            cwd=HOME,
            env=os.environ | {"PYTHONPATH": path},
            stdout=printed,
            stderr=subprocess.STDOUT,
        )
        begun = time.monotonic()
        while process.poll() is None:
            state = read_state(store.progress)
            if 0 < state.get("done", 0) < state["todo"]:
                members = family(process.pid)
                memory = {member: resident(member) for member in members}
                work = {member: processor(member) for member in members}
                looks.append(Look(time.monotonic() - begun, state["done"], state["todo"], memory, work))
            time.sleep(every)
    assert not process.returncode, log.read_text()
    return looks, log.read_text()
