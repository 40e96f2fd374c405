"""Fingerprint of code: of loaded functions, and of all definitions that they name.

A function counts by its compiled code, its defaults, its closure, its attributes, and the globals that it names;
functions and classes among these are followed, also through imports within functions. Values count by their
content. So the fingerprint describes the code that computed the numbers, whatever its files contain later.
Formatting, comments and docstrings change nothing.

Installed packages also count by the hashes of their files in RECORD. Libraries do not, since their versions are
part of the environment; of this engine only the given functions count. Names found at run time and files read by
code are not covered unless they are declared. Compiled code differs between versions of Python; there a digest of
the sources replaces it.
"""

import importlib.util
import pkgutil
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import CellType, FunctionType, ModuleType
from typing import Any, NamedTuple

from sweeps.errors import InputError
from sweeps.fingerprint import modules
from sweeps.fingerprint.bytecode import bytecode, digest, members_of, parts_of

LONG = 1000  # characters of a text; longer ones count by their digest
# Names that every module has.
OWN = {*vars(ModuleType("")), "__builtins__", "__cached__", "__file__", "__path__"}

# Digests after a run, as text, and those before: what code changes while it runs, like a cache, counts as it was.
_settled: dict[str, dict[str, str]] = {}


class Covered(NamedTuple):
    """Digests by module, package and file, and of values; one of all sources; installed packages in use."""

    code: dict[str, str]
    values: dict[str, str]
    sources: str
    libraries: tuple[str, ...]


def covered(functions: Iterable[Any], code: Sequence[str | Path] = (), values: Mapping[str, Any] = {}) -> Covered:
    """Return the code and values on which `functions`, callables of any kind, depend.

    `code` are further packages and modules, by name, and files and folders on which results depend; the code of
    `values` counts, too. An `InputError` if there is no such code, or if a value cannot be compared.
    """
    reach = _Reach()
    contents = {name: digest(reach.text(each, name).encode()) for name, each in values.items()}
    for name in code:
        reach.declare(name)
    for each in functions:
        reach.give(each)
    reach.follow()
    texts = {home: "\n".join(sorted(lines)) for home, lines in sorted(reach.lines.items()) if lines}
    found = {home: digest(text.encode()) for home, text in texts.items()}
    sources = [f"{home} {digest(modules.source_of(home))}" for home in texts if reach.kind(home) == "local"]
    libraries, found = tuple(sorted(reach.libraries)), _settled.get(str(found), found)
    return Covered(found, contents, digest("\n".join(sources).encode()), libraries)


def digests(functions: Iterable[Any], code: Sequence[str | Path] = ()) -> dict[str, str]:
    """Return the digests of code alone; see `covered`."""
    return covered(functions, code).code


def settle(before: dict[str, str], after: dict[str, str]) -> None:
    """Let code with digests `after` count as `before`, since only running it has changed it."""
    if after != before:
        _settled[str(after)] = before


class _Reach:
    """Follows names from functions; `lines` describe the reached definitions, by module, package and file."""

    def __init__(self) -> None:
        self.lines: dict[str, list[str]] = {}
        self.libraries: set[str] = set()
        # Objects that have a text, or are about to get it, by identity; definitions to be followed.
        self._texts: dict[int, tuple[Any, str]] = {}
        self._waiting: list[tuple[str, Any, str]] = []
        self._open: set[tuple[str, str]] = set()  # attributes of modules that are being followed

    def kind(self, home: str) -> str:
        """The kind of a module (`modules.kind_of`); an installed package on the way is recorded."""
        root = home.partition(".")[0]
        if root == modules.ENGINE:
            return "library"
        if (kind := modules.kind_of(home)) != "local" and modules.is_installed(root):
            self.libraries.add(root)
        if kind == "installed":
            self.lines.setdefault(root, [modules.record(root)])
        elif kind == "local" and (extension := modules.extension_of(home)):
            self.lines.setdefault(home, [extension])
        return kind

    def give(self, function: Any) -> None:
        """Add a function, also one of the engine; its bound values count, and the function within it."""
        inner = function
        while isinstance(inner, partial) or hasattr(inner, "function"):
            parts = (*inner.args, inner.func) if isinstance(inner, partial) else (inner.function,)
            inner = next(each for each in parts if callable(each) or hasattr(each, "function"))
        name = getattr(function, "__qualname__", type(function).__qualname__)
        plain = isinstance(function, FunctionType)
        text = self._definition(function, name) if plain else self.text(function, name)
        if plain and modules.home_of(function).startswith(f"{modules.ENGINE}."):
            text += bytecode(function.__code__).text
        self.lines.setdefault(modules.home_of(inner), []).append(text)

    def declare(self, name: str | Path) -> None:
        """Add a file or folder by its bytes, a package or module with all its definitions."""
        if isinstance(name, Path) and name.exists():
            self.lines.setdefault(name.name, []).append(modules.contents_of(name))
            return
        if isinstance(name, Path) or (module := modules.loaded(name)) is None:
            raise InputError(f"code = {str(name)!r}: there is no such package, module or file")
        inner = pkgutil.walk_packages(getattr(module, "__path__", ()), f"{name}.", onerror=lambda _: None)
        for each in [name, *(each.name for each in inner if not each.name.endswith("__main__"))]:
            if self.kind(each) == "local":
                items = vars(modules.loaded(each) or object).items()
                self.lines.setdefault(each, []).extend(f"{k} = {self.text(v)}" for k, v in items if k not in OWN)

    def follow(self) -> None:
        """Add the definitions named so far, and those that they name."""
        while self._waiting:
            self._define(*self._waiting.pop())

    def text(self, value: Any, holder: str = "") -> str:
        """Return a text that is equal for equal values; definitions of local code are added to `lines`.

        What cannot be compared counts by its type, or is an `InputError` if a `holder` carries it along.
        """
        if value is None or value is ... or type(value) in (bool, int, float, complex):
            return repr(value)
        if isinstance(value, (str, bytes)):
            return repr(value) if len(value) < LONG else digest(repr(value).encode())
        if isinstance(value, (FunctionType, type)):
            return self._definition(value)
        if isinstance(value, ModuleType) or callable(value):
            self.kind(value.__name__ if isinstance(value, ModuleType) else modules.home_of(value))
        if isinstance(value, ModuleType):
            return f"module {value.__name__}"
        if id(value) not in self._texts:
            self._texts[id(value)] = value, "itself"
            try:
                inner = parts_of(value)
            except Exception:  # noqa: BLE001 - any object may refuse in its own way
                if holder:
                    what = f"it carries {value!r}, which cannot be compared with a stored value"
                    raise InputError(f"{holder}: {what}; pass it as a constant") from None
                inner = (type(value),)
            texts = [self.text(each, holder) for each in inner]
            texts = sorted(texts) if isinstance(value, (set, frozenset)) else texts
            self._texts[id(value)] = value, f"{type(value).__qualname__} {digest(str(texts).encode())}"
        return self._texts[id(value)][1]

    def _definition(self, value: Any, holder: str = "") -> str:
        """The name of a function or class, which is followed if it is local."""
        if id(value) not in self._texts:
            home = modules.home_of(value)
            name, kind = f"{home}.{value.__qualname__}", self.kind(home)
            self._texts[id(value)] = value, name
            if kind == "installed":  # an upgrade may have changed RECORD, and not what is loaded
                members = [value, *vars(value).values()] if isinstance(value, type) else [value]
                codes = [bytecode(each.__code__).text for each in members if isinstance(each, FunctionType)]
                self.lines[home.partition(".")[0]].append(f"{name} {codes}")
            elif kind == "local" and "<" in name:  # others may have this name
                self._texts[id(value)] = value, f"{name} {digest(self._define(name, value, holder).encode())}"
            elif kind == "local":
                self._waiting.append((name, value, holder))
        return self._texts[id(value)][1]

    def _define(self, name: str, value: Any, holder: str) -> str:
        parts = self._class(value) if isinstance(value, type) else self._function(value, holder)
        line = f"{name} {list(parts)}"
        self.lines.setdefault(modules.home_of(value), []).append(line)
        return line

    def _class(self, value: type) -> Iterator[str]:
        yield str(
            [self.text(each) for each in (*value.__bases__, type(value), getattr(value, "__members__", None))]
        )
        for key, each in members_of(value):
            yield f"{key}: {self.text(each)}"

    def _function(self, value: FunctionType, holder: str) -> Iterator[str]:
        code, known = bytecode(value.__code__), value.__globals__
        yield code.text
        carried = {"defaults": value.__defaults__, **(value.__kwdefaults__ or {}), **vars(value)}
        cells = zip(value.__code__.co_freevars, value.__closure__ or (), strict=True)
        carried |= {key: cell.cell_contents for key, cell in cells if cell != CellType()}  # one may be unbound
        for key, each in carried.items():
            yield from self._named(key, each, code.names, holder)
        for key in sorted((code.loads & known.keys()) - OWN):
            yield from self._named(key, known[key], code.names)
        package = known.get("__package__") or str(known.get("__name__")).rpartition(".")[0]
        for target, level, names in code.imports:
            with suppress(ImportError, ValueError):
                target = importlib.util.resolve_name("." * level + target, package)
            if self.kind(target) == "local":
                # Of `import a.b` both are used, of `from a import b` one, which may be a module itself.
                for each in (target, *([f"{target}.{n}" for n in names] or [target.partition(".")[0]])):
                    if (module := modules.loaded(each)) is not None:
                        yield from self._named(each, module, {*names} | code.names)

    def _named(self, key: str, value: Any, names: Set[str], holder: str = "") -> Iterator[str]:
        """Describe the value of a name; of a module, the values of its attributes in `names`."""
        if isinstance(value, ModuleType) and self.kind(value.__name__) != "library":
            for each in sorted(names & vars(value).keys()):
                if (place := (value.__name__, each)) not in self._open:
                    self._open.add(place)
                    yield from self._named(f"{key}.{each}", vars(value)[each], names)
                    self._open.remove(place)
        yield f"{key} = {self.text(value, holder)}"
