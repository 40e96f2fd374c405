"""Which versions made a result: of this project, and of the libraries that its code imports.

Other versions of libraries do not make results stale: figures agree but for rounding. They are worth a warning.
"""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Iterable, Mapping
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from sweeps.fingerprint.code import differing
from sweeps.fingerprint.source import read, root

# Compared whichever modules import them: they decide the last digits.
ALWAYS = {"numpy", "scipy", "numba"}


def versions(modules: Iterable[str]) -> dict[str, str]:
    """Versions of Python, NumPy, SciPy, Numba and of the packages that the `modules` of a fingerprint import."""
    statements = [each for module in map(read, modules) if module is not None for each in module.statements]
    tops = {root(source) for statement in statements for source, _ in statement.imports}
    found = {name: _version(name) for name in sorted(ALWAYS | tops)}
    return {"python": platform.python_version()} | {name: each for name, each in found.items() if each}


def versions_differing(stored: Mapping[str, str], present: Mapping[str, str]) -> str:
    """One line that says which versions differ, or which only one side has; "" if none does."""
    return "; ".join(
        f"{name} {stored.get(name, 'none')} there, {present.get(name, 'none')} here"
        for name in differing(stored, present)
    )


@cache
def _version(name: str) -> str:
    try:
        return version(name)
    except (PackageNotFoundError, ValueError):  # ValueError: of the empty name, `from . import`
        return ""


@cache
def source() -> str:
    """Distribution, version and commit; the commit is "unknown" where neither git nor the version tells."""
    number, _, local = _version("fiv").partition("+")
    return f"fiv {number or '(not installed)'} (commit {_checkout() or _built_from(local) or 'unknown'})"


def _checkout() -> str:
    """The commit of the checkout that this code runs from, if it runs from one."""
    home = Path(__file__).resolve().parents[2]
    # Only a checkout of this project counts, not a repository that happens to hold its installation.
    if not (home / ".git").exists():
        return ""
    git = partial(subprocess.check_output, cwd=home, text=True, timeout=10, stderr=subprocess.DEVNULL)
    try:
        commit = git(["git", "rev-parse", "--short=12", "HEAD"]).strip()
        # Results are kept in the checkout too; only changed code makes a difference.
        return commit + ("-dirty" if git(["git", "status", "--porcelain", "--", "*.py"]) else "")
    except (OSError, subprocess.SubprocessError):
        return ""


def _built_from(local: str) -> str:
    """The commit in a version's local part, as setuptools-scm writes it: g1a2b3c4 or g1a2b3c4.d20261120."""
    commit, _, date = local.partition(".")
    return commit[1:] + ("-dirty" if date else "") if commit.startswith("g") else ""
