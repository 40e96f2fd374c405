"""The way of who sees the project for the first time: `python -m tests.docs.first_time [FOLDER]`.

In an empty folder, with no environment and nothing computed but what a clone brings along, it runs the README's
lines "In ten minutes" as they stand there, shows each, and says how long all took.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
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


def walk(folder: Path) -> Path:
    """Run the lines in one shell, which shows each and stops at the first that fails; returns the clone."""
    script = ["bash", "-euxo", "pipefail", "-c", "\n".join(lines())]
    subprocess.run(script, cwd=folder, env=environment(), check=True)
    return folder / "fiv"


def main() -> None:
    """Walk, and tell how long it took."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(sys.argv[1] if len(sys.argv) > 1 else temporary)
        folder.mkdir(parents=True, exist_ok=True)
        begin = time.perf_counter()
        walk(folder)
        print(f"{time.perf_counter() - begin:.1f} s in all")


if __name__ == "__main__":
    main()
