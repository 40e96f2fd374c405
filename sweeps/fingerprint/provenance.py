"""The origin of a result: version of the code, and the environment, which decides the last bits of values.

Results of another environment are valid, but chaotic motion amplifies a last bit. A file therefore lists the
environments of its runs, and a run that adds another one warns.
"""

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
    # A library that only one of them names is no difference: the code may have begun to import it.
    changed = [sorted(name for name in {*first} & {*each} if first[name] != each[name]) for each in others]
    pairs = zip(changed, others, strict=True)
    lines = [", ".join(f"{name} {first[name]} -> {each[name]}" for name in names) for names, each in pairs]
    return "; ".join(filter(None, dict.fromkeys(lines)))


@cache
def distributions() -> Mapping[str, list[str]]:
    """The distributions of each top-level name; finding them takes half a second."""
    return packages_distributions()


@cache
def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # the distribution may have another name
        found = distributions().get(name)
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
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").partition("\n\n")[0].splitlines()
    properties = {name.strip(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    kind = " ".join(properties[name] for name in PROCESSOR if name in properties) or platform.processor()
    configuration: Any = np.show_config(mode="dicts")
    simd = configuration.get("SIMD Extensions", {}).get("found", [])
    return " ".join(filter(None, [platform.machine(), kind, *simd[-1:]]))


@cache
def source(package: str) -> str:
    """Distribution, version and commit of a package; the name of a module without a distribution."""
    if not (names := distributions().get(package)):
        return package
    number, _, local = _version(names[0]).partition("+")
    # As setuptools-scm writes it: g1a2b3c4 or g1a2b3c4.d20261120.
    built_from, _, date = local.partition(".")
    commit = built_from[1:] + "-dirty" * bool(date) if built_from.startswith("g") else "unknown"
    spec = find_spec(package)
    home = Path(spec.origin).resolve().parents[1] if spec is not None and spec.origin else Path()
    # An installation inside somebody's repository is not a checkout of the package.
    if (home / ".git").exists():
        git = partial(subprocess.check_output, cwd=home, text=True, timeout=10, stderr=subprocess.DEVNULL)
        with suppress(OSError, subprocess.SubprocessError):
            # Results may lie in the checkout too; only changed code counts.
            dirty = "-dirty" * bool(git(["git", "status", "--porcelain", "--", "*.py"]))
            commit = git(["git", "rev-parse", "--short=12", "HEAD"]).strip() + dirty
    return f"{names[0]} {number} (commit {commit})"
