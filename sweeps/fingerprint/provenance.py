"""The origin of a result: version of the code, and the environment that decides the last bits of its values.

Results of another environment are not stale, but chaotic motion amplifies a last bit. A file therefore lists the
environments of its runs, and a run that adds another one warns.
"""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_info

# Libraries that every environment names, if they are installed: they compute, or compile what computes.
LIBRARIES = ("numpy", "scipy", "numba", "llvmlite")
# Names in Linux's description of a processor, x86 and ARM.
PROCESSOR = ("vendor_id", "cpu family", "model", "CPU implementer", "CPU part")

Environment = Mapping[str, str]


def environment(libraries: Iterable[str] = ()) -> dict[str, str]:
    """Versions of Python, LIBRARIES, further `libraries` (import names) and BLAS, and the kind of processor."""
    versions = {"python": platform.python_version()}
    versions |= {name: _version(name) for name in (*LIBRARIES, *libraries)}
    return {k: v for k, v in (versions | {"blas": _blas(), "processor": _processor()}).items() if v}


def mixed(environments: Sequence[Environment]) -> str:
    """Describe how other environments differ from the first, in one line; "" if none does."""
    first, *others = environments or [{}]
    lines = []
    for other in others:
        # A library that only one of them names is no difference: the code may have begun to import it.
        names = sorted(name for name in {*first} & {*other} if first[name] != other[name])
        lines.append(", ".join(f"{name} {first[name]} -> {other[name]}" for name in names))
    return "; ".join(filter(None, dict.fromkeys(lines)))


def listed(environments: Sequence[Environment]) -> str:
    """Environments as text for a file's history."""
    return "; ".join(", ".join(" ".join(each) for each in one.items()) for one in environments if one)


@cache
def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # the distribution may have another name
        found = packages_distributions().get(name)
        return version(found[0]) if found else ""


@cache
def _blas() -> str:
    """The BLAS of NumPy and of SciPy, with the core types whose code they have chosen for this processor."""
    import scipy.linalg  # noqa: F401 - threadpoolctl sees only loaded libraries

    blas = [each for each in threadpool_info() if each["user_api"] == "blas"]
    names = ("internal_api", "version", "architecture")
    return " and ".join(sorted({" ".join(str(each[n]) for n in names if each.get(n)) for each in blas}))


@cache
def _processor() -> str:
    """Kind of the processor, and the widest instructions that NumPy uses: a virtual processor may lack some."""
    lines = list[str]()
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().partition("\n\n")[0].splitlines()
    properties = {name.strip(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    kind = " ".join(properties[name] for name in PROCESSOR if name in properties) or platform.processor()
    configuration: Any = np.show_config(mode="dicts")
    simd = configuration.get("SIMD Extensions", {}).get("found", [])
    return " ".join(filter(None, [platform.machine(), kind, *simd[-1:]]))


@cache
def source(package: str) -> str:
    """Distribution, version and commit of a package; of a module without a distribution its name."""
    names = packages_distributions().get(package)
    if not names:
        return package
    number, _, local = _version(names[0]).partition("+")
    # As setuptools-scm writes it: g1a2b3c4 or g1a2b3c4.d20261120.
    commit, _, date = local.partition(".")
    built_from = commit[1:] + ("-dirty" if date else "") if commit.startswith("g") else ""
    return f"{names[0]} {number} (commit {_checkout(package) or built_from or 'unknown'})"


def _checkout(package: str) -> str:
    """The commit of the git checkout in whose top folder the package lies; "" if it lies in none."""
    spec = find_spec(package)
    home = Path(spec.origin).resolve().parents[1] if spec is not None and spec.origin else Path()
    # An installation inside somebody's repository is not a checkout of the package.
    if not (home / ".git").exists():
        return ""
    git = partial(subprocess.check_output, cwd=home, text=True, timeout=10, stderr=subprocess.DEVNULL)
    try:
        commit = git(["git", "rev-parse", "--short=12", "HEAD"]).strip()
        # Results may lie in the checkout too; only changed code counts.
        return commit + ("-dirty" if git(["git", "status", "--porcelain", "--", "*.py"]) else "")
    except (OSError, subprocess.SubprocessError):
        return ""
