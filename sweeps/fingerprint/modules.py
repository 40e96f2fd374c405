"""Modules: their names, their places, and the module of a script's file."""

import importlib
import importlib.util
import inspect
import os
import sys
from contextlib import suppress
from functools import cache, partial
from importlib.metadata import distribution
from pathlib import Path
from types import ModuleType
from typing import Any

import cloudpickle  # type: ignore[import-untyped]

from sweeps.errors import InputError
from sweeps.fingerprint.bytecode import digest
from sweeps.fingerprint.provenance import distributions

ENGINE = __name__.partition(".")[0]
# Where installed packages lie; those that do not count, since their versions are part of the environment.
INSTALLED = {"site-packages", "dist-packages"}
LIBRARIES = {"numpy", "scipy", "numba", "llvmlite", "pandas", "xarray", "netCDF4", "dask", "distributed"}
LIBRARIES |= {"cloudpickle", "threadpoolctl", "filelock", "cryptography", "click", "rich", "jinja2", "markupsafe"}
LIBRARIES |= {"matplotlib", "itables", "PIL", "pint", "pyuff", "mpmath"}


def home_of(function: Any) -> str:
    """The name of the module in which a callable of any kind is defined."""
    while isinstance(function, partial):
        function = function.func
    named = getattr(function, "__module__", None) or getattr(function, "__globals__", {}).get("__name__")
    return own_name(named if isinstance(named, str) else type(function).__module__)


def own_name(name: str) -> str:
    """The name of a module, also if Python started it as a script."""
    main: Any = sys.modules["__main__"]
    if name == "__main__" and main.__spec__ is not None:  # python -m
        return str(main.__spec__.name)
    return stem(main.__file__) if name == "__main__" and getattr(main, "__file__", None) else name


def stem(file: Any) -> str:
    """The name of the module of a script."""
    return "".join(c if c.isalnum() else "_" for c in Path(file).stem)


def by_value() -> set[str]:
    """Names of the modules whose functions are sent to other processes with their code."""
    return {"__main__", own_name("__main__"), *cloudpickle.list_registry_pickle_by_value()}


def loaded(name: str) -> ModuleType | None:
    """A module, imported if necessary; None if that fails."""
    if name not in sys.modules and name == own_name("__main__"):
        return sys.modules["__main__"]
    with suppress(Exception, SystemExit):
        return importlib.import_module(name)
    return None


def source_of(name: str) -> bytes:
    """Return the source of a module."""
    with suppress(OSError, TypeError):  # that of a notebook is not kept
        return Path(inspect.getsourcefile(loaded(name)) or "").read_bytes()  # type: ignore[arg-type]
    return b""


def contents_of(path: Path) -> str:
    """Return the names and digests of a file, or of all files in a folder."""
    files = [path] if path.is_file() else sorted(each for each in path.rglob("*") if each.is_file())
    return "\n".join(f"{each.relative_to(path).as_posix()} {digest(each.read_bytes())}" for each in files)


@cache
def is_installed(root: str) -> bool:
    """Whether a package lies where packages are installed."""
    with suppress(ImportError, ValueError):
        spec = getattr(sys.modules.get(root), "__spec__", None) or importlib.util.find_spec(root)
        places = [spec.origin or "", *(spec.submodule_search_locations or ())] if spec else []
        return any(INSTALLED & {*Path(place).parts} for place in places)
    return False


@cache
def kind_of(home: str) -> str:
    """The kind of a module: "library", "installed" or "local", as all modules of this distribution are."""
    root = home.partition(".")[0]
    if root in sys.stdlib_module_names and not is_shadowed(root):
        return "library"
    if home.startswith("namedtuple_") and home not in sys.modules:  # generated
        return "library"
    if root.startswith("_cython_"):  # of the types of compiled functions, whatever extension was loaded first
        return "library"
    if not is_installed(root) or {*distributions().get(root, ())} & {*distributions().get(ENGINE, ())}:
        return "local"
    return "library" if root in LIBRARIES else "installed"


def is_shadowed(root: str) -> bool:
    """Whether a module with the name of one of Python's own is another module."""
    file = getattr(sys.modules.get(root), "__file__", None)
    return file is not None and not Path(file).is_relative_to(Path(os.__file__).parent) and root != "__main__"


@cache
def extension_of(home: str) -> str:
    """Digest of the file of a compiled extension module; "" of any other module."""
    file = getattr(sys.modules.get(home), "__file__", None) or ""
    return f"extension {digest(Path(file).read_bytes())}" if file.endswith((".so", ".pyd")) else ""


@cache  # as first seen: an upgrade does not change what is loaded
def record(root: str) -> str:
    """Digest of the hashes of an installed package's files; without a RECORD, of the files."""
    files = [each for name in distributions().get(root, ()) for each in distribution(name).files or ()]
    lines = [f"{each} {each.hash.value}" for each in files if each.hash and each.suffix in (".py", ".so", ".pyd")]
    if not lines and (spec := importlib.util.find_spec(root)):
        places = [p for folder in spec.submodule_search_locations or () for p in Path(folder).rglob("*.py")]
        lines = [f"{path.name} {digest(path.read_bytes())}" for path in places or [Path(spec.origin or "")]]
    return "RECORD " + digest("\n".join(sorted(lines)).encode())


def load_script(file: str | Path) -> ModuleType:
    """The module of a script's file, which is not started as a script.

    It has the name of its file and imports modules beside it, like a script. A sweep of its functions continues
    the results of the script, and vice versa. Other processes receive its functions by value. An InputError if
    there is no such file, if another module has its name, or if it raises.
    """
    path = Path(file).expanduser()
    name, folder = stem(path), str(path.resolve().parent)
    if not path.is_file():
        raise InputError(f"{file}: there is no such file")
    present = sys.modules.get(name)
    if present is not None:
        if os.path.realpath(str(getattr(present, "__file__", None))) == os.path.realpath(path):
            return present
        raise InputError(f"{file}: Python has a module called {name} already; rename the file")
    spec = importlib.util.spec_from_file_location(name, path.resolve())
    if spec is None or spec.loader is None:
        raise InputError(f"{file}: it is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    sys.path.insert(0, folder)
    try:
        spec.loader.exec_module(module)
    except Exception as problem:
        del sys.modules[name]
        sys.path.remove(folder)
        raise InputError(f"{file}: it cannot be loaded: {type(problem).__name__}: {problem}") from problem
    cloudpickle.register_pickle_by_value(module)
    return module
