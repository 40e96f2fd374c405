"""Fingerprint of the code behind functions: one digest for each module of the project that they reach.

It sees the top-level statements that functions reach by name in their own modules, and those that act on import:
calls, entries and attributes set, definitions with decorators or bases. Another module of the project counts as a
whole, a package's `__init__` as an own one; it is followed on from the names taken of it. By value, with the code
of their classes, count closures, defaults of nested functions, arguments of partials, compilers' options, called
instances; and numbers, arrays and texts that a function's names stand for, in its module and in those it names.

It does not see formatting, comments, docstrings, annotations outside classes; what a script does when it is
started, except to the objects of names that are reached; libraries, whose versions `provenance` compares; this
engine, unless its functions are given; what is found by a computed name; what a module sets in another, if it is
only imported as `from package import module` and never named; what an assigned call changes elsewhere. Nothing is
imported for it, and nothing in a file is executed.
"""

from __future__ import annotations

import builtins
import dataclasses
import inspect
import os
import sys
from collections import defaultdict
from collections.abc import Callable, Mapping
from enum import Enum
from functools import cache, partial
from hashlib import blake2b
from importlib.metadata import packages_distributions
from types import CellType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from sweeps.errors import InputError
from sweeps.fingerprint.scripts import is_script, own_name
from sweeps.fingerprint.source import Module, Statement, bound, imported, is_library, names, read, root

ENGINE = root(__name__)
# Attributes of a class that hold no code of it.
ASIDE = {"__module__", "__doc__", "__annotations__", "__firstlineno__", "__static_attributes__"}
ASIDE |= {"__annotate__", "__annotate_func__", "__annotations_cache__"}  # what annotations are since Python 3.14
REFUSED = "cannot be compared with a stored one"
PLAIN = (type(None), type(...), bool, int, float, complex, str, bytes, range)


def digests(*functions: Callable[..., Any]) -> dict[str, str]:
    """Digests of the code that functions run, with the values that they carry along.

    Parameters
    ----------
    *functions : callable
        Plain, partial, wrapped or compiled ones, methods, lambdas, classes, instances that can be called.

    Returns
    -------
    dict of str to str
        A digest for each module that is not a library's, sorted by name.

    Raises
    ------
    ValueError
        For a function that carries along what cannot be compared with a stored value.
    """
    innermost = [_innermost(function) for function in functions]
    # A library's class, or an instance of it, does not make the library the project's.
    reach = _Reach({_home(each) for each in innermost if isinstance(each, FunctionType)})
    for function, inner in zip(functions, innermost, strict=True):
        reach.notes.add((_home(inner), reach.text(function)))
    return reach.digests()


def differing(stored: Mapping[str, str], present: Mapping[str, str]) -> list[str]:
    """Names of the modules whose code differs, or which only one side reaches; sorted."""
    return sorted(name for name in {*stored, *present} if stored.get(name) != present.get(name))


def digest(content: bytes) -> str:
    """Short digest of bytes."""
    return blake2b(content, digest_size=8).hexdigest()


class _Reach:
    """Goes from functions to all that they reach; the packages of their homes are followed wherever they lie."""

    def __init__(self, homes: set[str]) -> None:
        self.homes = homes  # modules of the functions, where only what is reached counts
        self.own = {root(name) for name in homes} | _siblings()
        self.notes: set[tuple[str, str]] = set()  # values that count, by module
        self._modules: dict[str, Module | None] = {}
        self._taken: dict[Module, set[Statement]] = {}
        self._asked: set[tuple[str, str]] = set()
        self._todo: list[tuple[str, str]] = []
        self._open: list[int] = []
        self._seen: dict[int, Any] = {}  # keeps them alive: nothing else may take their id

    def digests(self) -> dict[str, str]:
        """A digest of what is reached in each module."""
        while self._todo:
            self._visit(*self._todo.pop())
        texts: dict[str, list[str]] = defaultdict(list)
        for module in [each for each in self._taken if self._taken[each]]:
            counted = self._taken[module] if module.is_package or module.name in self.homes else module.statements
            chosen = [each for each in module.statements if each in counted]
            # Of imports the order makes no difference, unless something else may bind their names.
            free = [each for each in chosen if each.is_import and module.binds_alone(each)]
            texts[module.name] = sorted(each.text for each in free)
            texts[module.name] += [each.text for each in chosen if each not in free]
        for name, note in sorted(self.notes):
            texts[name].append(note)
        return {name: digest("\0".join(texts[name]).encode()) for name in sorted(texts)}

    def _ask(self, module: str, path: str) -> None:
        """Follow a name of a module, with attributes; all names for "", what acts on import for any."""
        if (module, path) not in self._asked:
            self._asked.add((module, path))
            self._todo.append((module, path))

    def _library(self, name: str) -> bool:
        """Whether a module is another's, or the engine's."""
        name = own_name(name)
        return name not in self.homes if root(name) == ENGINE else root(name) not in self.own and is_library(name)

    def _module(self, name: str) -> Module | None:
        """The module of that name, unless it is a library's or has no source."""
        if name not in self._modules:
            self._modules[name] = None if self._library(name) else read(name)
        return self._modules[name]

    def _visit(self, source: str, path: str) -> None:
        module, (head, _, rest) = self._module(source), path.partition(".")
        if module is None:
            return
        chosen = list(module.binding(head) if head else module.statements)
        if head and module.is_package and self._module(f"{source}.{head}") is not None:
            self._ask(f"{source}.{head}", rest)
        elif not chosen and not hasattr(builtins, head):  # for the module's `__getattr__`
            chosen += module.statements
        if head and is_script(source):  # of what a script does counts what changes the name's object
            chosen += [each for each in module.statements if head in each.effects]
        if module not in self._taken:
            self._taken[module] = set()
            for loaded in {source.rpartition(".")[0]}.union(*(each.loads for each in module.statements)):
                self._ask(loaded, "__name__")
            acts = not is_script(source)
            chosen += [each for each in module.statements if each.is_made or (acts and each.effects)]
        for statement in chosen:
            self._taken[module].add(statement)
            for target, inner in statement.imports:
                if inner == "*" and (starred := self._module(target)) and "__all__" in starred.binders:
                    self._ask(target, "__all__")
                parts = (inner.replace("*", head), rest if statement.is_import else "")
                self._ask(target, ".".join(filter(None, parts)))
            for use in statement.uses:
                if module.binding(root(use)):
                    self._ask(source, use)

    def text(self, value: Any) -> str:
        """A value in full, if it is plain or code, whose source is asked for."""
        if id(value) in self._open:  # it holds itself
            return f"again {len(self._open) - self._open.index(id(value))}"
        self._open.append(id(value))
        try:
            return self._text(value)
        finally:
            self._open.pop()

    def _text(self, value: Any) -> str:
        kind = type(value)
        if kind in PLAIN or isinstance(value, np.dtype):
            return f"{kind.__name__} {value!r}"
        if isinstance(value, (np.ndarray, np.generic)):
            content = self.text(value.tolist()) if value.dtype.hasobject else digest(value.tobytes())
            return f"{value.dtype.str}{value.shape} {content}"
        if isinstance(value, slice):  # a constant of code since Python 3.14
            return f"slice {self.text((value.start, value.stop, value.step))}"
        if isinstance(value, (list, tuple, dict, set, frozenset)):
            parts = [self.text(each) for each in (value.items() if isinstance(value, dict) else value)]
            return f"{self._class(kind)} {sorted(parts) if isinstance(value, (set, frozenset)) else parts}"
        if isinstance(value, ModuleType):
            name = own_name(value.__name__)
            self._ask(name, "")
            return name
        if isinstance(value, type):
            return self._class(value)
        if isinstance(value, FunctionType):
            return self._function(value)
        if isinstance(value, CodeType):
            return self._compiled(value)
        if name := self._name_in_library(value):
            return name
        if isinstance(value, MethodType):
            return f"{self.text(value.__self__)} {self.text(value.__func__)}"
        if isinstance(value, partial):
            name = getattr(value.func, "__qualname__", type(value.func).__qualname__)
            given = {f"argument {place}": each for place, each in enumerate(value.args, 1)} | value.keywords
            return f"partial {self.text(value.func)} {self._held(f'function {name} is given', given)}"
        if _inner(value) is not None and self._library(kind.__module__):
            # A compiler's options decide the last digits.
            options = vars(value).get("targetoptions")
            types = "" if getattr(value, "_can_compile", True) else f"{value.signatures} "
            return (f"{self._if_told(options)} " if options else "") + types + self.text(_inner(value))
        if isinstance(value, Enum):
            return f"{self._class(kind)} {value.name}"
        if dataclasses.is_dataclass(value):
            fields = [(field.name, getattr(value, field.name, None)) for field in dataclasses.fields(value)]
            return f"{self._class(kind)} {self.text(fields)}"
        if not self._library(kind.__module__) or (callable(value) and hasattr(value, "__dict__")):
            state: Any = object.__getstate__(value)
            attributes, slots = state if isinstance(state, tuple) else (state, None)
            held = {key: each for key, each in ((attributes or {}) | (slots or {})).items() if key not in ASIDE}
            return f"{self._class(kind)} {self._held(f'the {kind.__qualname__} that is called holds', held)}"
        raise _IncomparableError(f"a {kind.__qualname__} {REFUSED}; call it in a function")

    def _held(self, how: str, values: Mapping[str, Any]) -> str:
        found = []
        for name, value in sorted(values.items()):
            try:
                found.append(f"{name}={self.text(value)}")
            except _IncomparableError:
                raise InputError(f"{how} {name} = {value!r}, which {REFUSED}; pass it as a constant") from None
        return ", ".join(found)

    def _if_told(self, value: Any) -> str:
        """The text of a value if it has one."""
        seen = dict(self._seen)
        try:
            return self.text(value)
        except ValueError:
            # What was seen on the way is in no text yet.
            self._seen = seen
            return ""

    def _name_in_library(self, value: Any) -> str:
        """The name under which a library holds a value; "" if none does."""
        module = str(getattr(value, "__module__", None))
        name = str(getattr(value, "__qualname__", getattr(value, "__name__", None)))
        is_there = getattr(sys.modules.get(module), name, None) is value
        return f"{module}.{name}" if is_there and self._library(module) else ""

    def _function(self, function: FunctionType) -> str:
        code, home, name = function.__code__, _home(function), function.__qualname__
        if id(function) in self._seen or self._library(home):
            return f"{home}.{name} {self.text(_inner(function))}"
        self._seen[id(function)] = function
        self.homes.add(home)
        module = self._module(home)
        has_source = module is not None and os.path.realpath(code.co_filename) == os.path.realpath(module.file)
        self._note(function, has_source)
        self._ask(home, "__name__")
        for each in () if has_source else imported(code):
            self._ask(each, "")
        if module is not None and has_source:
            if self._defined(home, code.co_qualname):
                return f"{home}.{name}"
            for each in filter(module.binding, names(code)):
                self._ask(home, each)
        cells = zip(code.co_freevars, function.__closure__ or (), strict=True)
        # An empty cell, of a name that is not bound yet, equals another.
        closed = {variable: cell.cell_contents for variable, cell in cells if cell != CellType()}
        parameters = inspect.signature(function, follow_wrapped=False).parameters.values()
        given = {each.name: each.default for each in parameters if each.default is not each.empty}
        held = self._held(f"function {name} closes over", closed)
        held += self._held(f"function {name} has the default", given)
        return f"{home}.{name} {self._compiled(code, function.__doc__)} {held}"

    def _defined(self, home: str, qualname: str) -> bool:
        """Ask for the top-level statement that defines something; whether its text says all of it."""
        module = self._module(home)
        if module is None or not module.binding(root(qualname)):
            return False
        self._ask(home, root(qualname))
        found = module.binding(root(qualname))
        return "<" not in qualname and len(found) == 1 and found[0].is_definition

    def _note(self, function: FunctionType, has_source: bool) -> None:
        """Note the numbers, arrays and texts that a function's names stand for; without a source all told."""
        present, used = function.__globals__, names(function.__code__) - bound(function.__code__)
        named = [present[name] for name in used & set(present) if isinstance(present[name], ModuleType)]
        spaces = {each.__name__: vars(each) for each in named if not self._library(each.__name__)}
        for home, space in [(_home(function), present), *spaces.items()]:
            for name in sorted(used & set(space)):
                if _is_number(space[name]) or (space is present and not has_source):
                    self.notes.add((home, f"{name} is {self._if_told(space[name])}"))

    def _compiled(self, code: CodeType, document: str | None = None) -> str:
        constants = [self.text(each) for each in code.co_consts if each is None or each != document]
        taken = f"{inspect.getargs(code)} {code.co_posonlyargcount} {code.co_kwonlyargcount}"
        return " ".join([taken, code.co_code.hex(), code.co_exceptiontable.hex(), *code.co_names, *constants])

    def _class(self, kind: type) -> str:
        home = own_name(kind.__module__)
        name = f"{home}.{kind.__qualname__}"
        if id(kind) in self._seen or self._library(home):
            return name
        self._seen[id(kind)] = kind
        if self._defined(home, kind.__qualname__):
            return name
        fields = getattr(kind, "__dataclass_fields__", {})
        members = {**vars(kind), **{f"{key} from": field.default_factory for key, field in fields.items()}}
        for key in sorted(members.keys() - ASIDE):
            parts = (members[key], *(getattr(members[key], part, None) for part in ("fget", "fset", "__func__")))
            name += " ".join([key, *map(self._if_told, parts)])
        return name + " ".join(map(self._class, kind.__bases__))


class _IncomparableError(ValueError):
    """A value has no text that would be the same in another process."""


def _is_number(value: Any) -> bool:
    """Whether a value is a number, an array or a text; texts with a slash may name a place on this machine."""
    if isinstance(value, (np.ndarray, np.generic)):
        return not value.dtype.hasobject
    return type(value) in PLAIN and not (isinstance(value, str) and {*value} & {"/", os.sep})


def _inner(function: Any) -> Any:
    """The function that a wrapper of whatever kind calls, or None."""
    if isinstance(function, (partial, MethodType)):
        return function.func if isinstance(function, partial) else function.__func__
    held = {} if isinstance(function, type) else getattr(function, "__dict__", {})
    return held.get("py_func", held.get("__wrapped__"))


def _innermost(function: Any) -> Any:
    return function if _inner(function) is None else _innermost(_inner(function))


def _home(function: Any) -> str:
    """The module where a function's globals are; `__module__` may be another's, copied or set."""
    named = function.__globals__.get("__name__") if isinstance(function, FunctionType) else None
    return own_name(str(named or getattr(function, "__module__", None) or "__main__"))


@cache
def _siblings() -> frozenset[str]:
    """The packages installed together with this one, if it is installed at all."""
    owners = packages_distributions() if is_library(ENGINE) else {}
    return frozenset(top for top in owners if {*owners[top]} & {*owners.get(ENGINE, ())})
