"""Which code computes: a digest for every module that a function reaches, of what it reaches there.

Stored results are taken up again only where these digests are equal. What a function's name leads to is read
from the source; what it carries along besides, in a closure or as a partial's arguments, enters by its value. So
do the numbers and arrays that names of modules stand for, where the text does not say them. Texts do not, unless
the source has another: they may name a place on this machine. Nor do containers, which functions fill.
"""

from __future__ import annotations

import dataclasses
import enum
import os
import sys
from collections.abc import Callable, Mapping
from functools import partial
from hashlib import blake2b
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from sweeps.fingerprint.definitions import Reach, installed

# What a name of a module may stand for to be compared: scalars, and arrays of NumPy's numbers and times.
SCALARS = (type(None), bool, int, float, complex, str, bytes)
NUMBERS = "biufcmM"
PLAIN = (type(None), type(...), bool, int, float, complex, str, bytes, range)
# Attributes of a class that hold no code of it.
ASIDE = ("__module__", "__doc__", "__annotations__", "__firstlineno__", "__static_attributes__")


def sources(*functions: Callable[..., Any]) -> dict[str, str]:
    """The identity of the code that the functions run, and of the values that they carry along.

    Comments, docstrings, formatting and the annotations of functions do not count, nor does what is not reached.

    Parameters
    ----------
    *functions : callable
        Plain, partial, wrapped or compiled ones, methods, lambdas, instances that can be called.

    Returns
    -------
    dict of str to str
        A digest for each module that is not a library's, sorted by name.

    Raises
    ------
    ValueError
        For a function that carries along what cannot be compared with a stored value.
    """
    homes = [_home(function) for function in functions]
    carried = _Carried(Reach(frozenset(home.partition(".")[0] for home in homes)))
    notes: dict[str, list[str]] = {}
    for home, function in zip(homes, functions, strict=True):
        notes.setdefault(home, []).append(carried.function(function))
    texts = carried.reach.texts()
    for home, name, value, said in carried.reach.values():
        notes.setdefault(home, []).extend(carried.present(name, value, said))
    return {
        name: _digest("\0".join(texts.get(name, []) + notes.get(name, [])).encode())
        for name in sorted({*texts, *notes})
    }


def differing(stored: Mapping[str, str], present: Mapping[str, str]) -> list[str]:
    """Names of the modules whose code differs, or which only one side reaches; sorted."""
    return sorted(name for name in {*stored, *present} if stored.get(name) != present.get(name))


class _IncomparableError(Exception):
    """A value has no text that would be the same in another process."""


class _Carried:
    """Texts that tell one value from another; the code that values lead to is asked for at `reach`."""

    def __init__(self, reach: Reach) -> None:
        self.reach = reach
        self._seen: dict[int, Any] = {}  # keeps them alive: nothing else may take their id

    def text(self, value: Any) -> str:
        """A value in full, if it is plain or code."""
        kind = type(value)
        if isinstance(value, enum.Enum):
            return f"{self._class(kind)}.{value.name}"
        if kind in PLAIN:
            return f"{kind.__name__} {value!r}"
        if isinstance(value, np.dtype):
            return repr(value)
        if kind is np.ndarray and value.dtype.hasobject:
            return f"{value.dtype}{value.shape} {self.text(value.tolist())}"
        if kind is np.ndarray or isinstance(value, np.generic):
            return f"{value.dtype.str}{value.shape} {_digest(value.tobytes())}"
        if isinstance(value, (list, tuple)):
            return f"{self._class(kind)}({', '.join(map(self.text, value))})"
        if isinstance(value, (set, frozenset)):
            return f"{self._class(kind)}({', '.join(sorted(map(self.text, value)))})"
        if isinstance(value, dict):
            pairs = (f"{self.text(key)}: {self.text(item)}" for key, item in value.items())
            return f"{self._class(kind)}({', '.join(pairs)})"
        if isinstance(value, ModuleType):
            self.reach.follow(value.__name__)
            return value.__name__
        if isinstance(value, type):
            return self._class(value)
        if dataclasses.is_dataclass(value):
            pairs = (f"{f.name}: {self.text(getattr(value, f.name, None))}" for f in dataclasses.fields(value))
            return f"{self._class(kind)}({', '.join(pairs)})"
        if callable(value):
            return self.function(value)
        raise _IncomparableError

    def present(self, name: str, value: Any, said: list[Any]) -> list[str]:
        """What a name of a module stands for, if that is plain and not what the text says."""
        scalar = type(value) in SCALARS and (said or not isinstance(value, str))
        array = isinstance(value, np.generic) or type(value) in (np.ndarray, np.memmap)
        if not scalar and not (array and value.dtype.kind in NUMBERS):
            return []
        text = self.text(np.asarray(value) if isinstance(value, np.memmap) else value)
        return [] if [text] == [self.text(each) for each in said] else [f"{name} is {text}"]

    def function(self, function: Any) -> str:
        """What a function carries along, and its name; its code is asked for."""
        name = getattr(function, "__qualname__", type(function).__qualname__)
        if _of_library(function):
            return f"{function.__module__}.{name}"
        if isinstance(function, partial):
            inner = getattr(function.func, "__qualname__", type(function.func).__qualname__)
            given = [(f"argument {place}", value) for place, value in enumerate(function.args, 1)]
            given += sorted(function.keywords.items())
            bound = [self._held(f"function {inner} is given", key, value) for key, value in given]
            return f"partial {self.function(function.func)} {', '.join(bound)}"
        if isinstance(function, MethodType):
            owner = function.__self__
            return f"{self._owner(owner)} {self.function(function.__func__)}"
        if hasattr(function, "py_func"):
            # A compiler's options decide the last digits.
            options = self._if_told(getattr(function, "targetoptions", None))
            return f"{' '.join(options)} {self.function(function.py_func)}"
        if hasattr(function, "__wrapped__"):
            module = self.reach.module(_module_of(function)) if isinstance(function, FunctionType) else None
            wrapper = self.reach.statement(module, function.__code__) if module is not None else []
            return " ".join([*wrapper, self.function(function.__wrapped__)])
        if isinstance(function, FunctionType):
            return self._function(function)
        return self._owner(function)

    def _function(self, function: FunctionType) -> str:
        code, home, name = function.__code__, _module_of(function), function.__qualname__
        if id(function) in self._seen or self.reach.library(home):
            return f"{home}.{name}"
        self._seen[id(function)] = function
        module, top = self.reach.module(home), name.partition(".")[0]
        if module is None or os.path.realpath(code.co_filename) != os.path.realpath(module.file):
            own = [self._code(code, function)]
        elif "<" not in name and top in module.binders:
            self.reach.follow(home, (top,))
            return f"{home}.{name}"
        else:
            own = self.reach.statement(module, code)
        for variable, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
            try:
                value = cell.cell_contents
            except ValueError:  # not filled yet
                continue
            own.append(self._held(f"function {name} closes over", variable, value))
        defaults = function.__defaults__ or ()
        given = dict(zip(code.co_varnames[code.co_argcount - len(defaults) :], defaults, strict=False))
        for argument, value in (given | (function.__kwdefaults__ or {})).items():
            own.append(self._held(f"function {name} has the default", argument, value))
        return f"{home}.{name} {' '.join(own)}"

    def _code(self, code: CodeType, function: FunctionType) -> str:
        """Code without a source, and what the names in it mean now, as far as that can be told."""
        own = [code.co_code.hex(), code.co_exceptiontable.hex()]
        for constant in code.co_consts:
            if isinstance(constant, CodeType):
                own.append(self._code(constant, function))
            elif constant is None or constant != function.__doc__:
                own.append(self.text(constant))
        for name in code.co_names:
            own.append(name)
            if name in function.__globals__:
                own += self._if_told(function.__globals__[name])
        return " ".join(own)

    def _class(self, kind: type) -> str:
        home, name = str(kind.__module__), kind.__qualname__
        if id(kind) in self._seen or self.reach.library(home):
            return f"{home}.{name}"
        self._seen[id(kind)] = kind
        module, top = self.reach.module(home), name.partition(".")[0]
        if module is not None and top in module.binders:
            self.reach.follow(home, (top,))
            return f"{home}.{name}"
        own = [self._class(base) for base in kind.__bases__]
        members = {
            key: member for key, member in vars(kind).items() if key not in ASIDE and not _generated(member)
        }
        if dataclasses.is_dataclass(kind):
            members |= {f"{f.name} from": f.default_factory for f in dataclasses.fields(kind)}
        for key, member in sorted(members.items()):
            own.append(key)
            for part in (member, *(getattr(member, of, None) for of in ("fget", "fset", "__func__"))):
                own += self._if_told(part)
        return f"{home}.{name} {' '.join(own)}"

    def _owner(self, owner: Any) -> str:
        """The class or instance whose method is called."""
        if isinstance(owner, type):
            return self._class(owner)
        kind = type(owner)
        if not hasattr(owner, "__dict__") and not any("__slots__" in vars(base) for base in kind.__mro__):
            raise ValueError(
                f"a {kind.__qualname__} cannot be compared with a stored one, so its methods cannot either; "
                "call it in a function"
            )
        state = object.__getstate__(owner)
        parts = state if isinstance(state, tuple) else (state,)
        every = sorted((key, value) for part in parts for key, value in (part or {}).items())
        held = [self._held(f"the {kind.__qualname__} that is called holds", key, value) for key, value in every]
        return f"{self._class(kind)} {', '.join(held)}"

    def _held(self, how: str, name: str, value: Any) -> str:
        try:
            return f"{name}={self.text(value)}"
        except _IncomparableError:
            raise ValueError(
                f"{how} {name} = {value!r}, which cannot be compared with a stored one; pass it as a constant"
            ) from None

    def _if_told(self, value: Any) -> list[str]:
        """The text of a value if it has one; but instances do not count, though they may be called."""
        code = isinstance(value, (FunctionType, MethodType, partial, type)) or hasattr(value, "py_func")
        if callable(value) and not code and not _of_library(value):
            return []
        try:
            return [self.text(value)]
        except _IncomparableError:
            return []


def _module_of(function: FunctionType) -> str:
    """Where its globals are; `__module__` may be another's, copied or set."""
    return str(function.__globals__.get("__name__") or "__main__")


def _home(function: Any) -> str:
    """The module to whose digest a given function's values belong."""
    while not isinstance(function, type):
        if isinstance(function, partial):
            function = function.func
        elif isinstance(function, MethodType):
            function = function.__func__
        elif hasattr(function, "py_func"):
            function = function.py_func
        elif hasattr(function, "__wrapped__"):
            function = function.__wrapped__
        elif isinstance(function, FunctionType):
            return _module_of(function)
        else:
            return str(getattr(function, "__module__", None) or "builtins")
    return str(function.__module__)


def _generated(member: Any) -> bool:
    """Whether a method was made by `dataclass`: it says no more than the fields do."""
    return isinstance(member, FunctionType) and member.__code__.co_qualname.startswith("__create_fn__")


def _of_library(function: Any) -> bool:
    """Whether it is a library's, not written in Python, and found there by its name."""
    module = sys.modules.get(str(getattr(function, "__module__", None)))
    if module is None or isinstance(function, (FunctionType, type)):
        return False
    name = getattr(function, "__qualname__", getattr(function, "__name__", None))
    place = getattr(module, "__file__", None) or ""
    known = installed(place) or module.__name__ in sys.builtin_module_names
    return known and isinstance(name, str) and getattr(module, name, None) is function


def _digest(content: bytes) -> str:
    return blake2b(content, digest_size=8).hexdigest()
