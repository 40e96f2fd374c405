"""One line of Python that computes one point again, and so raises again what it raised."""

from __future__ import annotations

import builtins
import dataclasses
import enum
import math
import sys
from collections.abc import Callable, Mapping
from functools import partial
from keyword import iskeyword
from typing import Any

import numpy as np

# Longest text of a value that cannot be written and is only described.
DESCRIBED = 80


def one_liner(function: Callable[..., Any], point: Mapping[str, Any], constants: Mapping[str, Any]) -> str:
    """The call of a function with one point, after the imports that it needs.

    Parameters
    ----------
    function : callable
        As a sweep calls it. One that cannot be imported stands there as `function`, and a remark says which it is.
    point : mapping of str to scalar
        The point's value on each axis.
    constants : mapping
        Numbers, texts, arrays, dataclasses, containers of them. Anything else stands there by its name, with a
        remark.
    """
    places: list[Any] = []
    while isinstance(function, partial):
        places = [*function.args, *places]
        constants = {**function.keywords, **constants}
        function = function.func
    line = _Line()
    called = line.reference(function)
    if called is None:
        name = getattr(function, "__qualname__", type(function).__qualname__)
        called = line.remark("function", f"{name} of {getattr(function, '__module__', None)}")
    arguments = [line.value(value, f"argument_{k}") for k, value in enumerate(places, 1)]
    arguments.append(repr({name: _Text(line.array(np.asarray([value]), name)) for name, value in point.items()}))
    odd = {name: value for name, value in constants.items() if not name.isidentifier() or iskeyword(name)}
    arguments += [f"{name}={line.value(value, name)}" for name, value in constants.items() if name not in odd]
    if odd:
        arguments.append(f"**{line.value(odd, 'constants')}")
    return line.finished(f"{called}({', '.join(arguments)})")


class _Text(str):
    """An expression: containers of them have the representation that is wanted."""

    __repr__ = str.__str__


class _Line:
    """A line in the making: expressions for values, the imports that these need, and remarks."""

    def __init__(self) -> None:
        self._imported: dict[str, str] = {}  # what a name stands for here
        self._remarks: dict[str, str] = {}

    def finished(self, call: str) -> str:
        """Imports, call and remarks."""
        imports = []
        for name, full in self._imported.items():
            module, _, original = full.rpartition(".")
            imports.append(f"from {module} import {original}{'' if original == name else f' as {name}'}")
        remarks = "; ".join(f"{name}: {text}" for name, text in self._remarks.items())
        return "; ".join([*sorted(imports), call]) + (f"  # {remarks}" if remarks else "")

    def remark(self, name: str, text: str) -> str:
        """Say at the line's end what a name stands for that is not defined in it."""
        self._remarks[name] = " ".join(text.split())
        return name

    def reference(self, target: Any) -> str | None:
        """A function or class by a name that is imported; None if there is no such name."""
        target = _unwrapped(target)
        module = getattr(target, "__module__", None)
        path = getattr(target, "__qualname__", None) or getattr(target, "__name__", None)
        found: Any = sys.modules.get(str(module))
        if not isinstance(path, str) or found is None or module == "__main__":
            return None
        for part in path.split("."):
            found = getattr(found, part, None)
        # Equality, for the method of a class is made anew each time.
        if found is None or _unwrapped(found) != target:
            return None
        first, dot, rest = path.partition(".")
        return f"{first if module == 'builtins' else self._import(f'{module}.{first}')}{dot}{rest}"

    def value(self, value: Any, name: str) -> str:
        """An expression for a value; `name` is what it is called if there is none."""
        kind = type(value)
        if value is None or value is ... or kind in (bool, int, str, bytes, range):
            return repr(value)
        if kind is float:
            return repr(value) if math.isfinite(value) else f"float('{value}')"
        if kind is complex:
            return f"complex({self.value(value.real, name)}, {self.value(value.imag, name)})"
        if kind is np.ndarray:
            return self.array(value, name)
        if isinstance(value, np.generic) and _plain(value.dtype):
            # `numpy.bool` would hide Python's own.
            called = "bool_" if value.dtype.kind == "b" else kind.__name__
            return f"{self._import(f'numpy.{called}')}({self.value(value.item(), name)})"
        if isinstance(value, enum.Enum):
            owner = self.reference(kind)
            return self.remark(name, repr(value)) if owner is None else f"{owner}[{value.name!r}]"
        if kind is dict:
            return repr({_Text(self.value(k, name)): _Text(self.value(v, name)) for k, v in value.items()})
        if kind in (list, tuple, set, frozenset):
            return repr(kind(_Text(self.value(item, name)) for item in value))
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return self._dataclass(value, name)
        known = self.reference(value) if callable(value) else None
        return self.remark(name, _described(value)) if known is None else known

    def array(self, value: np.ndarray, name: str) -> str:
        """An array, with its type and shape where its entries do not tell them."""
        if not _plain(value.dtype):
            return self.remark(name, _described(value))
        entries = value.tolist()
        plain = np.array(entries)
        dtype = "" if plain.dtype == value.dtype else f", dtype={value.dtype.str!r}"
        text = f"{self._import('numpy.array')}({self.value(entries, name)}{dtype})"
        return text if plain.shape == value.shape else f"{text}.reshape({value.shape!r})"

    def _dataclass(self, value: Any, name: str) -> str:
        """A dataclass by those of its fields that differ from their defaults."""
        called = self.reference(type(value))
        if called is None:
            called = self.remark(type(value).__name__, f"of {type(value).__module__}")
        given = []
        for field in dataclasses.fields(value):
            held, default = getattr(value, field.name), field.default
            if field.default_factory is not dataclasses.MISSING:
                default = field.default_factory()
            # Texts are compared, for arrays have no one answer and NaN does not equal itself.
            same = default is not dataclasses.MISSING and _Line().value(held, "") == _Line().value(default, "")
            if field.init and not same:
                given.append(f"{field.name}={self.value(held, field.name)}")
        return f"{called}({', '.join(given)})"

    def _import(self, full: str) -> str:
        """The name under which something is imported: its own, unless that is taken."""
        own = name = full.rpartition(".")[2]
        count = 1
        while hasattr(builtins, name) or name == "function" or self._imported.get(name, full) != full:
            count += 1
            name = f"{own}_{count}"
        self._imported[name] = full
        return name


def _plain(dtype: np.dtype[Any]) -> bool:
    """Whether Python's own numbers and texts hold every value of a type."""
    return dtype.kind in "biuSU" or (dtype.kind in "fc" and dtype.itemsize <= (8 if dtype.kind == "f" else 16))


def _described(value: Any) -> str:
    try:
        text = repr(value)
    except Exception:  # noqa: BLE001 - a repr that fails must not hide the error that is being told
        text = f"a {type(value).__qualname__}"
    return text if len(text) <= DESCRIBED else f"{text[: DESCRIBED - 3]}..."


def _unwrapped(function: Any) -> Any:
    """The function within a compiled or decorated one."""
    while not isinstance(function, type):
        inner = getattr(function, "py_func", None) or getattr(function, "__wrapped__", None)
        if inner is None:
            break
        function = inner
    return function
