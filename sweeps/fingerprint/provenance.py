"""The provenance of a result: the version of this project, and the environment that decides its values' last bits.

Another environment does not make results stale, but chaotic motion makes much of a last bit: where the points of a
file have several, that is told, and each point is marked by its own.
"""

from __future__ import annotations

import json
import platform
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_info

from sweeps.errors import InputError
from sweeps.fingerprint.code import differing

# What an environment is: by the versions of these, of Python and of BLAS with its core type, and by the processor.
LIBRARIES = ("numpy", "scipy", "numba", "llvmlite")
# What Linux says of a processor's kind, of x86 and of ARM.
PROCESSOR = ("vendor_id", "cpu family", "model", "CPU implementer", "CPU part")

Environment = Mapping[str, str]


def environment() -> dict[str, str]:
    """What decides the last bits here, by name."""
    found = {"python": platform.python_version()} | {name: _version(name) for name in LIBRARIES}
    return {name: each for name, each in (found | {"blas": _blas(), "processor": _processor()}).items() if each}


def environments_of(attributes: Mapping[str, Any]) -> list[dict[str, str]]:
    """The environments that the attributes of a file name; one of which nothing is known where there is none.

    Older files have the versions of all libraries that their code imports.
    """
    if "environments" in attributes:
        return [read_environment(each) for each in json.loads(attributes["environments"])]
    known = json.loads(attributes.get("libraries", "{}"))
    return [read_environment({name: each for name, each in known.items() if name in ("python", *LIBRARIES)})]


def read_environment(found: Any) -> dict[str, str]:
    """An environment as a file has it, or an `InputError` if it is none."""
    if not (isinstance(found, dict) and all(isinstance(text, str) for text in found.values())):
        raise InputError(f"{json.dumps(found)[:80]} is no environment")
    return found


def mixed(environments: Sequence[Environment]) -> str:
    """One line that says in what other environments differ from the first; "" if none does."""
    return "; ".join(filter(None, dict.fromkeys(_changes(environments[0], each) for each in environments[1:])))


def _changes(before: Environment, now: Environment) -> str:
    names = differing(before, now)
    return ", ".join(f"{name} {before.get(name, 'unknown')} -> {now.get(name, 'unknown')}" for name in names)


def listed(environments: Sequence[Environment]) -> str:
    """Environments for a file's history; nothing of those of which nothing is known."""
    return "; ".join(", ".join(" ".join(each) for each in one.items()) for one in environments if one)


@cache
def _version(name: str) -> str:
    with suppress(PackageNotFoundError):
        return version(name)
    return ""


@cache
def _blas() -> str:
    """The BLAS of NumPy and of SciPy, with the core types whose code they have chosen for this processor."""
    import scipy.linalg  # noqa: F401 - what is not loaded is not seen

    found = [each for each in threadpool_info() if each["user_api"] == "blas"]
    names = ("internal_api", "version", "architecture")
    return " and ".join(sorted({" ".join(str(each[n]) for n in names if each.get(n)) for each in found}))


@cache
def _processor() -> str:
    """Kind of the processor, and the widest instructions of it that NumPy knows: a virtual one may lack some."""
    lines = list[str]()
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().partition("\n\n")[0].splitlines()
    about = {name.strip(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    kind = " ".join(about[name] for name in PROCESSOR if name in about) or platform.processor()
    configuration: Any = np.show_config(mode="dicts")
    found = configuration.get("SIMD Extensions", {}).get("found", [])
    return " ".join(filter(None, [platform.machine(), kind, *found[-1:]]))


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
