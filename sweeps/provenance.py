"""Which version of the code made a file."""

from __future__ import annotations

import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


@cache
def source() -> str:
    """Distribution and version, and the commit where the code runs from a checkout of its own."""
    try:
        name = f"fiv {version('fiv')}"
    except PackageNotFoundError:
        name = "fiv (not installed)"
    home = Path(__file__).resolve().parents[1]
    # Only a checkout of this project counts, not a repository that happens to hold its installation.
    if not (home / ".git").exists():
        return name
    try:
        found = subprocess.run(
            ["git", "-C", str(home), "describe", "--always", "--dirty", "--abbrev=12"],
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return name
    return f"{name} (commit {found.stdout.strip()})"
