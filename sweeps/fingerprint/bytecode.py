"""Digests of compiled code, without docstrings and positions, and the parts of values, from their pickles."""

import dis
import random
import sys
from collections.abc import Iterable, Iterator
from copyreg import dispatch_table
from functools import cache, cached_property
from hashlib import blake2b
from types import CodeType, FunctionType, MappingProxyType
from typing import Any, NamedTuple

import numpy as np

# The compiler and its optimisation: code that another one has compiled cannot be compared.
COMPILER = f"{sys.implementation.cache_tag} -O{sys.flags.optimize}"
# Members of classes that count even if they are named like those of Python.
MEMBERS = (FunctionType, property, staticmethod, classmethod, int, float)
# Random generators of whole modules, seeded anew by each process; SciPy's distributions have one of them. These
# count by their type.
GENERATORS: tuple[Any, ...] = (random.random.__self__, np.random.random.__self__)  # type: ignore[attr-defined]
LOADS = {"LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS", "STORE_GLOBAL"}


class Bytecode(NamedTuple):
    """Digest of code, the globals that it loads, all names in it, and its imports: module, level and names."""

    text: str
    loads: frozenset[str]
    names: frozenset[str]
    imports: tuple[tuple[str, int, tuple[str, ...]], ...]


def digest(content: bytes) -> str:
    """Return a short hash."""
    return blake2b(content, digest_size=8).hexdigest()


@cache
def bytecode(code: CodeType) -> Bytecode:
    """Read compiled code, with the functions within it."""
    counts = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags & 0x2C
    parts, constants, inner = [f"{counts} {code.co_varnames} {code.co_exceptiontable.hex()}"], [], list[Bytecode]()
    loads, imports = set[str](), list[Any]()
    for each in dis.get_instructions(code):
        text, is_constant = each.argrepr, each.opcode in dis.hasconst or each.opname == "LOAD_SMALL_INT"
        if is_constant:  # by value: one without a use, like the docstring, is in no instruction
            constants.append(each.argval)
            text = _constant(each.argval)
            inner += [bytecode(each.argval)] if isinstance(each.argval, CodeType) else []
        elif each.opname in LOADS:
            loads.add(each.argval)
        elif each.opname == "IMPORT_NAME":
            imports.append((each.argval, constants[-2], constants[-1] or ()))
        parts.append(f"{each.opcode} {text}")
    names = frozenset(code.co_names).union(*(each.names for each in inner))
    every = (*imports, *(one for each in inner for one in each.imports))
    return Bytecode(
        digest("\n".join(parts).encode()), frozenset(loads).union(*(e.loads for e in inner)), names, every
    )


def _constant(value: Any) -> str:
    if isinstance(value, CodeType):
        return bytecode(value).text
    if isinstance(value, frozenset):
        return f"set {sorted(map(_constant, value))}"
    return f"tuple {[*map(_constant, value)]}" if isinstance(value, tuple) else repr(value)


def parts_of(value: Any) -> Iterable[Any]:
    """The parts of a value; without a better way those of its pickle, which may raise."""
    kind = type(value)
    if kind.__module__ == "threadpoolctl":
        raise TypeError("its state is that of this process: addresses and paths of libraries")
    inner = getattr(value, "py_func", None) or getattr(value, "__wrapped__", None)
    if isinstance(inner, FunctionType) and kind.__module__.partition(".")[0] in ("numba", "functools", "builtins"):
        return inner, str(sorted(getattr(value, "targetoptions", {}).items(), key=str))
    if kind in (list, tuple, set, frozenset):
        return tuple(value)
    if kind in (dict, MappingProxyType):
        return [each for item in value.items() for each in item]
    if any(value is each for each in GENERATORS):
        return (kind,)
    if hasattr(value, "acquire") and hasattr(value, "release"):
        raise TypeError("a lock has no content")
    if kind is property:
        return value.fget, value.fset, value.fdel
    if hasattr(value, "gen") and hasattr(value, "func"):  # a context manager that decorates
        return value.func, value.args, value.kwds
    reduce: Any = dispatch_table.get(kind, lambda each: each.__reduce_ex__(4))
    if isinstance(reduced := reduce(value), str):
        return kind, reduced
    make, arguments, state, *items = (*reduced, None)[:5]
    if isinstance(state, dict):
        state = {k: v for k, v in state.items() if not isinstance(getattr(kind, k, None), cached_property)}
    return make, arguments, state, *(each and list(each) for each in items)


def members_of(value: type) -> Iterator[tuple[str, Any]]:
    """Yield the members of a class and its annotations; of a class compiled by Numba its methods and types."""
    compiled: Any = getattr(value, "class_type", None)
    if hasattr(compiled, "jit_methods"):
        yield "methods", dict(compiled.jit_methods)
        yield "types", str(compiled.struct)
        return
    yield "annotations", str(vars(value).get("__annotations__"))
    for key, each in vars(value).items():
        if not key[:2] == key[-2:] == "__" or (isinstance(each, MEMBERS) and key != "__firstlineno__"):
            yield key, each
