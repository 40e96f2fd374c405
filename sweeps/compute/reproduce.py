"""One line of Python that computes one point again, and so raises again what it raised."""

from __future__ import annotations

import builtins
import dataclasses
import inspect
import math
import pkgutil
import reprlib
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

# Describes, in so many letters, a value that cannot be written, even one whose own description raises.
DESCRIBED = reprlib.Repr()
DESCRIBED.maxother = 80
# Types of arrays (one letter each, as NumPy has them) whose entries Python's own numbers and texts hold.
WRITABLE = f"?{np.typecodes['AllInteger']}efdU"


def one_liner(function: Callable[..., Any], point: Mapping[str, Any], constants: Mapping[str, Any]) -> str:
    """The call of a function with one point, after the imports that it needs.

    Parameters
    ----------
    function : callable
        As a sweep calls it. One that cannot be imported stands there as `function`, and a remark says which it is.
    point : mapping of str to scalar
        The point's value on each axis.
    constants : mapping
        Numbers, texts, arrays, dataclasses, lists, tuples and dicts of them. Anything else stands there by its
        name, with a remark.
    """
    places: list[Any] = []
    while isinstance(function, partial):
        places = [*function.args, *places]
        constants = {**function.keywords, **constants}
        function = function.func
    line = _Line()
    name = getattr(function, "__qualname__", type(function).__qualname__)
    called = line.reference(function) or line.remark("function", f"{name} of {function.__module__}")
    arguments = [line.value(value, f"argument_{k}") for k, value in enumerate(places, 1)]
    arguments.append(line.value({name: np.asarray([value]) for name, value in point.items()}, "points"))
    arguments += [f"{name}={line.value(value, name)}" for name, value in constants.items()]
    return line.finished(f"{called}({', '.join(arguments)})")


def importable(target: Any) -> Any:
    """Import a function or class by its own name; that may give another one, or None."""
    module, name = getattr(target, "__module__", None), getattr(target, "__qualname__", None)
    try:
        return None if module == "__main__" else pkgutil.resolve_name(f"{module}:{name}")
    except (ImportError, AttributeError, ValueError):
        return None


class _Text(str):
    """An expression: containers of them have the representation that is wanted."""

    __repr__ = str.__str__


class _Line:
    """A line in the making: expressions for values, the imports that these need, and remarks."""

    def __init__(self) -> None:
        self._imported: dict[str, tuple[str, str]] = {}  # module and name of what a name stands for here
        self._remarks: dict[str, str] = {}

    def finished(self, call: str) -> str:
        """Imports, call and remarks."""
        imports = [
            f"from {module} import {own}{'' if own == name else f' as {name}'}"
            for name, (module, own) in self._imported.items()
        ]
        remarks = "; ".join(f"{name}: {text}" for name, text in self._remarks.items())
        return "; ".join([*sorted(imports), call]) + (f"  # {remarks}" if remarks else "")

    def remark(self, name: str, text: str) -> str:
        """Say at the line's end what a name stands for that is not defined in it."""
        self._remarks[name] = " ".join(text.split())
        return name

    def reference(self, target: Any) -> str | None:
        """A function or class by a name that is imported; None if there is no such name."""
        # Equality, for the method of a class is made anew each time.
        if not callable(target) or inspect.unwrap(importable(target)) != inspect.unwrap(target):
            return None
        first, dot, rest = target.__qualname__.partition(".")
        return f"{self._import(target.__module__, first)}{dot}{rest}"

    def value(self, value: Any, name: str) -> str:
        """An expression for a value; `name` is what it is called if there is none."""
        kind = type(value)
        if kind is float and not math.isfinite(value):
            return f"float('{value}')"
        if value is None or kind in (bool, int, float, str):
            return repr(value)
        if isinstance(value, (np.ndarray, np.generic)) and value.dtype.char in WRITABLE:
            return self._array(value, name)
        if kind is dict:
            return repr({_Text(self.value(k, name)): _Text(self.value(v, name)) for k, v in value.items()})
        if kind in (list, tuple):
            return repr(kind(_Text(self.value(item, name)) for item in value))
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return self._dataclass(value, name)
        return self.reference(value) or self.remark(name, DESCRIBED.repr(value))

    def _array(self, value: np.ndarray | np.generic, name: str) -> str:
        """An array or a scalar, with its type and shape where its entries do not tell them."""
        entries = value.tolist()
        plain = np.array(entries)
        dtype = "" if plain.dtype == value.dtype else f", dtype={value.dtype.str!r}"
        text = f"{self._import('numpy', 'array')}({self.value(entries, name)}{dtype})"
        if isinstance(value, np.generic):
            return f"{text}[()]"
        return text if plain.shape == value.shape else f"{text}.reshape({value.shape!r})"

    def _dataclass(self, value: Any, name: str) -> str:
        """A dataclass by those of its fields that differ from their defaults."""
        kind, given = type(value), []
        for field in dataclasses.fields(value):
            held = getattr(value, field.name)
            default = field.default_factory() if callable(field.default_factory) else field.default
            # Texts are compared, for arrays have no one answer and NaN does not equal itself.
            if field.init and _Line().value(held, "held") != _Line().value(default, "default"):
                given.append(f"{field.name}={self.value(held, field.name)}")
        called = self.reference(kind) or self.remark(kind.__name__, f"of {kind.__module__}")
        return f"{called}({', '.join(given)})"

    def _import(self, module: str, own: str) -> str:
        """The name under which something is imported: its own, unless that is taken."""
        name = own
        taken = {*vars(builtins), "function"}
        while name in taken or self._imported.setdefault(name, (module, own)) != (module, own):
            name += "_"
        return name
