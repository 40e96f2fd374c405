"""Scripts: a module that Python started, or the same file loaded without starting it, under one name."""

from __future__ import annotations

import importlib.util
import os
import re
import sys
from pathlib import Path
from types import ModuleType

import cloudpickle  # type: ignore[import-untyped]

from sweeps.errors import InputError

# Names of the modules that `load_script` made.
_loaded: set[str] = set()


def load_script(file: str | Path) -> ModuleType:
    """The module of a script's file, not started as a script.

    It is named as its file, and imports what lies beside it, as a script does. A sweep of its functions continues
    what the script has computed, and the other way round. Other processes get its functions by value.

    Raises
    ------
    InputError
        If there is no such file, its name is another module's, or it raises.
    """
    path = Path(file).expanduser()
    name = module_name(path)
    if not path.is_file():
        raise InputError(f"{file}: there is no such file")
    present = sys.modules.get(name)
    if present is not None:
        if _is_of(present, path):
            return present
        raise InputError(f"{file}: Python has a module called {name} already; rename the file")
    spec = importlib.util.spec_from_file_location(name, path.resolve())
    if spec is None or spec.loader is None:
        raise InputError(f"{file}: it is no Python file")
    module, folder = importlib.util.module_from_spec(spec), str(path.resolve().parent)
    sys.modules[name] = module
    sys.path.insert(0, folder)
    _loaded.add(name)
    try:
        spec.loader.exec_module(module)
    except Exception as problem:
        del sys.modules[name]
        sys.path.remove(folder)
        _loaded.remove(name)
        raise InputError(f"{file}: it cannot be loaded: {type(problem).__name__}: {problem}") from problem
    cloudpickle.register_pickle_by_value(module)
    return module


def module_name(file: str | Path) -> str:
    """The name of the module that a script's file is."""
    return re.sub(r"\W", "_", Path(file).stem)


def own_name(name: str) -> str:
    """The name of a module, whether or not Python started it: "__main__" only where it has no file."""
    return script_name() if name == "__main__" else name


def is_script(name: str) -> bool:
    """Whether what a module does besides its definitions is a script's."""
    return name in _loaded or name == script_name()


def script_name() -> str:
    """The name under which the file that Python started would be imported."""
    main = sys.modules["__main__"]
    if main.__spec__ is not None:  # python -m
        return main.__spec__.name
    file = getattr(main, "__file__", None)
    name = module_name(file) if file else "__main__"
    present = sys.modules.get(name)
    return name if file and (present is None or _is_of(present, file)) else "__main__"


def _is_of(module: ModuleType, file: str | Path) -> bool:
    own = getattr(module, "__file__", None)
    return own is not None and os.path.realpath(own) == os.path.realpath(file)
