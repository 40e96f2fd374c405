"""The way of who sees the project for the first time: `python -m tests.docs.first_time [FOLDER]`.

In an empty folder, with no environment and nothing computed but what a clone brings along, it runs the README's
lines "In ten minutes" as they stand there, and says what each took and what is there at the end.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

from tests import HOME

MARKER = "<!-- first time -->\n```sh\n"


def lines() -> list[str]:
    """The README's lines."""
    return (HOME / "README.md").read_text().partition(MARKER)[2].partition("\n```")[0].splitlines()


def environment() -> dict[str, str]:
    """That of this process, without what an environment of Python or the project's own settings would bring in."""
    inside = {"VIRTUAL_ENV", "PYTHONPATH", "PYTHONHOME", "FIV_RESULTS"}
    found = {name: value for name, value in os.environ.items() if name not in inside}
    own = str(Path(sys.executable).parent) if sys.prefix != sys.base_prefix else None
    found["PATH"] = os.pathsep.join(part for part in found["PATH"].split(os.pathsep) if part != own)
    return found | {"FIV": str(HOME)}


def walk(folder: Path) -> dict[str, float]:
    """Run every line in one shell, which stops at the first that fails; seconds that each took.

    Raises
    ------
    subprocess.CalledProcessError
        If a line fails.
    """
    timed = "\n".join(f"{line}\necho '@@' $(date +%s.%N) >> times" for line in ["cd .", *lines()])
    script = timed.replace(">> times", f">> '{folder}/times'")
    subprocess.run(["bash", "-euo", "pipefail", "-c", script], cwd=folder, env=environment(), check=True)
    at = [float(line.split()[1]) for line in (folder / "times").read_text().splitlines()]
    return dict(zip(lines(), (b - a for a, b in pairwise(at)), strict=True))


def main() -> None:
    """Walk, and tell."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(sys.argv[1] if len(sys.argv) > 1 else temporary)
        folder.mkdir(parents=True, exist_ok=True)
        begin = time.perf_counter()
        for line, seconds in walk(folder).items():
            print(f"{seconds:7.1f} s  {line}")
        print(f"{time.perf_counter() - begin:7.1f} s  in all")
        results = folder / "fiv" / "results"
        for name in ("stick_time/stick_time.nc", "map/growth_rate-theta-mu.nc", "report.html"):
            print(f"{(results / name).stat().st_size:9} bytes  results/{name}")


if __name__ == "__main__":
    main()
