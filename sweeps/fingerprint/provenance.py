"""Which version of the code made a file."""

from __future__ import annotations

import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


@cache
def source() -> str:
    """Distribution, version and commit; the commit is "unknown" where neither git nor the version tells."""
    try:
        number, _, local = version("fiv").partition("+")
    except PackageNotFoundError:
        number, local = "(not installed)", ""
    return f"fiv {number} (commit {_checkout() or _built_from(local) or 'unknown'})"


def _checkout() -> str:
    """The commit of the checkout that this code runs from, if it runs from one."""
    home = Path(__file__).resolve().parents[2]
    # Only a checkout of this project counts, not a repository that happens to hold its installation.
    if not (home / ".git").exists():
        return ""
    try:
        commit = _git(home, "rev-parse", "--short=12", "HEAD")
        # Results are kept in the checkout too; only changed code makes a difference.
        return commit + ("-dirty" if _git(home, "status", "--porcelain", "--", "*.py") else "")
    except (OSError, subprocess.SubprocessError):
        return ""


def _git(home: Path, *arguments: str) -> str:
    command = ["git", "-C", str(home), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()


def _built_from(local: str) -> str:
    """The commit in a version's local part, as setuptools-scm writes it: g1a2b3c4 or g1a2b3c4.d20261120."""
    commit, _, date = local.partition(".")
    if not commit.startswith("g"):
        return ""
    return commit[1:] + ("-dirty" if date else "")
