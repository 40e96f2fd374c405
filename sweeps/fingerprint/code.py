"""Fingerprint of code: what results depend on, as far as it is code.

Covered are the packages, modules and files that a sweep declares; of the functions' own packages the top-level
definitions and assignments that they reach by name, with the statements that change these objects; other local
packages that this code imports, whole; and values that functions carry along: closures, defaults of nested
functions, arguments of partials, attributes of called instances.

Not covered are files that a module reads, unless they are declared; names that are found by computation; and the
code of installed packages: of those that are declared, or define a function, the version counts, that of others is
part of the environment (`sweeps.fingerprint.provenance`). Formatting, comments and docstrings change nothing.
Nothing in a file is executed.
"""

from __future__ import annotations

import ast
import dataclasses
import importlib.util
import inspect
import json
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from enum import Enum
from functools import cache, cached_property, partial
from hashlib import blake2b
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.metadata import packages_distributions, version
from pathlib import Path
from types import CellType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import cloudpickle  # type: ignore[import-untyped]
import numpy as np
import pandas as pd
import psutil  # type: ignore[import-untyped]

from sweeps.errors import InputError

DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
IMPORTS = (ast.Import, ast.ImportFrom)
ENGINE = __name__.partition(".")[0]
# Where installed packages lie.
INSTALLED = {"site-packages", "dist-packages"}
# Accuracy of the time at which a process started, s.
MARGIN = 2.0

Functions = Iterable[Callable[..., Any]]


def digests(functions: Functions, code: Sequence[str | Path] = ()) -> dict[str, str]:
    """Digests by which the code of two runs is compared.

    Parameters
    ----------
    functions : iterable of callable
        Plain, partial, wrapped or compiled functions, methods, lambdas, classes, instances that can be called.
    code : sequence of (str or Path)
        Packages and modules by name, and files or folders, on which results depend besides.

    Returns
    -------
    dict of str to str
        By the name of each module, package and file; of an installed package its version.

    Raises
    ------
    InputError
        If there is no such code, or a function carries along a value that cannot be compared.
    """
    reach = _Reach(functions, code)
    texts = {
        name: [each.text for each in reach.parsed(name).statements if each in taken]
        for name, taken in reach.taken.items()
    }
    texts |= {name: [reach.parsed(each).text for each in sorted(_modules(name))] for name in reach.packages}
    for name, values in reach.values.items():
        texts[name] = texts.get(name, []) + sorted(values)
    found = {name: _digest("\0".join(lines).encode()) for name, lines in texts.items() if lines}
    for path in reach.files:
        files = [path] if path.is_file() else sorted(each for each in path.rglob("*") if each.is_file())
        found[path.name] = _digest(
            b"\0".join(f"{each.relative_to(path)}".encode() + each.read_bytes() for each in files)
        )
    return dict(sorted((found | {name: f"version {_version(name)}" for name in reach.versions}).items()))


def libraries(functions: Functions, code: Sequence[str | Path] = ()) -> list[str]:
    """Names of the installed packages that the covered code imports."""
    return sorted(_Reach(functions, code).libraries)


def check_loaded(functions: Functions, code: Sequence[str | Path] = ()) -> None:
    """Refuse code that Python has loaded and that is not what its file says now.

    Results of the loaded code would get the fingerprint of the file. Functions, methods and literals are compared.

    Raises
    ------
    InputError
        Naming the module.
    """
    reach = _Reach(functions, code)
    reached: dict[str, set[str] | None] = {n: None for package in reach.packages for n in _modules(package)}
    reached |= {home: set() for home, _ in reach.functions}
    reached |= {name: set().union(*(each.binds for each in taken)) for name, taken in reach.taken.items()}
    started = psutil.Process().create_time() - MARGIN
    for name, names in reached.items():
        loaded, file = sys.modules.get(_loaded_name(name)), _file(name)
        # Other loaders, like that of pytest, may change the code. A file older than this process cannot differ.
        if loaded is None or file is None or type(getattr(loaded, "__loader__", None)) is not SourceFileLoader:
            continue
        if file.stat().st_ctime < started:
            continue
        codes, literals = _compiled(file.read_bytes(), str(loaded.__file__))
        wrong = [each.co_qualname for home, each in reach.functions if home == name and each not in codes]
        for key in vars(loaded).keys() if names is None else names & vars(loaded).keys():
            value = vars(loaded)[key]
            differs = key in literals and (type(value), value) != (type(literals[key]), literals[key])
            if differs or not codes.issuperset(_codes(value, loaded)):
                wrong.append(key)
        if wrong:
            raise InputError(
                f"{file.name} has changed since Python loaded it ({', '.join(sorted({*wrong}))}); restart Python, "
                "or reload the module, and plan again"
            )


class _Reach:
    """Follows names from functions through the modules of their packages."""

    def __init__(self, functions: Functions, code: Sequence[str | Path]) -> None:
        self.parsed = cache(_parsed)  # each file is read once
        self.taken: dict[str, set[_Statement]] = {}
        self.values: dict[str, list[str]] = {}
        self.packages, self.versions, self.libraries = set[str](), set[str](), set[str]()
        self.files = [each for each in code if isinstance(each, Path)]
        self.functions = list[tuple[str, CodeType]]()
        self._own, self._seen = set[str](), set[Any]()
        for name in code:
            if not (name.exists() if isinstance(name, Path) else _spec(name)):
                raise InputError(f"code = {str(name)!r}: there is no such package, module or file")
            if isinstance(name, str) and _is_installed(name):
                self.versions.add(name)
            elif isinstance(name, str):
                self._add(name)
        for function in functions:
            self._function(function)

    def _add(self, package: str) -> None:
        """Cover a whole package, and what it imports."""
        self.packages.add(package)
        for root in set().union(*(self.parsed(module).imports for module in _modules(package))):
            self._count(root)

    def _count(self, root: str) -> None:
        """Count a package that covered code imports."""
        if root in self._own | {ENGINE} or root in sys.stdlib_module_names or _spec(root) is None:
            return
        if _is_installed(root):
            self.libraries.add(root)
        elif root not in {_root(each) for each in self.packages}:
            self._add(root)

    def _take(self, module: str, name: str, attribute: str = "") -> None:
        """Take the statements of a module that bind a name or change its object; "*" takes all."""
        if (module, name, attribute) in self._seen or _file(module) is None:
            return
        self._seen.add((module, name, attribute))
        for each in self.parsed(module).statements:
            if name == "*" or {name, "*"} & (each.binds | each.effects):
                self._follow(module, each, name, attribute)

    def _follow(self, module: str, statement: _Statement, name: str = "", attribute: str = "") -> None:
        """Take a statement, with all that it uses; of an import what `name` imports, with its attribute."""
        for bound, target, inner in statement.imports:
            if bound in (name, "") or "*" in (bound, name):
                self._import(target, name if inner == "*" else inner, attribute)
        taken = self.taken.setdefault(module, set())
        if statement not in taken:
            taken.add(statement)
            for use, its_attribute in statement.uses:
                self._take(module, use, its_attribute)

    def _import(self, module: str, name: str, attribute: str) -> None:
        """Follow an imported name, or the attribute that is used of an imported module."""
        if name == ".":
            self._take(module, "*")
        elif _root(module) not in self._own:
            self._count(_root(module))
        elif name and _file(f"{module}.{name}") is not None:
            self._take(f"{module}.{name}", attribute or "*")
        else:
            self._take(module, name or attribute or "*", attribute if name else "")

    def _value(self, home: str, how: str, value: Any) -> None:
        """Count a value that a function carries along."""
        followed = set[Any]()
        try:
            text = json.dumps(plain(value, followed))
        except InputError:
            raise InputError(
                f"{how} = {value!r}, which cannot be compared with a stored value; pass it as a constant"
            ) from None
        self.values.setdefault(home, []).append(f"{how} = {text}")
        for each in followed:
            self._function(each)

    def _function(self, function: Any) -> None:
        """Follow a callable of any kind."""
        inner = getattr(function, "py_func", None) or getattr(function, "__wrapped__", None)
        kind = type(function)
        name, home = getattr(function, "__qualname__", kind.__qualname__), _home(inner or function)
        if isinstance(function, partial):
            for key, value in [*enumerate(function.args), *function.keywords.items()]:
                self._value(home, f"a partial has the argument {key}", value)
            self._function(function.func)
        elif isinstance(function, MethodType):
            self._value(home, f"method {name} is of", function.__self__)
            self._function(function.__func__)
        elif inner is not None:
            options = getattr(function, "targetoptions", {})
            self.values.setdefault(home, []).append(f"{name} is compiled with {sorted(options.items(), key=str)}")
            self._function(inner)
        elif isinstance(function, (FunctionType, type)):
            self._definition(function, home, name)
        elif not (_root(_home(kind)) in sys.stdlib_module_names or _is_installed(_root(_home(kind)))):
            self._function(kind)
            for key, value in sorted(getattr(function, "__dict__", {}).items()):
                self._value(home, f"the {name} that is called has {key}", value)

    def _definition(self, function: FunctionType | type, home: str, name: str) -> None:
        root = _root(home)
        if id(function) in self._seen or root in sys.stdlib_module_names:
            return
        self._seen.add(id(function))
        if root in {_root(each) for each in self.packages}:
            return
        if _is_installed(root):
            self.versions |= {root} if isinstance(function, FunctionType) else set()
            return
        self._own.add(root)
        nested = "<" in name
        if isinstance(function, FunctionType):
            code = function.__code__
            for key, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
                if cell != CellType():  # a name that is not bound yet
                    self._value(home, f"function {name} closes over {key}", cell.cell_contents)
            for key, value in inspect.signature(function).parameters.items() if nested else ():
                if value.default is not value.empty:
                    self._value(home, f"function {name} has the default {key}", value.default)
            if _file(home) is None:
                # A notebook's: its bytecode, and the globals that it uses.
                used = _names(code) & function.__globals__.keys()
                self.values.setdefault(home, []).append(_bytecode(code))
                for key in sorted(used):
                    value = function.__globals__[key]
                    if isinstance(value, ModuleType):
                        self._count(_root(value.__name__))
                    else:
                        self._value(home, f"function {name} uses {key}", value)
            self.functions.append((home, code))
            if nested:  # a statement may have several
                self.values.setdefault(home, []).append(_bytecode(code))
        elif _file(home) is None:
            for key, value in vars(function).items():
                if isinstance(value, (FunctionType, bool, int, float, str)) and key not in (
                    "__module__",
                    "__doc__",
                ):
                    self._value(home, f"class {name} has {key}", value)
        if not (nested and isinstance(function, FunctionType)):
            self._take(home, _root(name))
        elif _file(home) is not None:
            for each in self.parsed(home).statements:
                if each.first <= function.__code__.co_firstlineno <= each.last:
                    self._follow(home, each)


@dataclasses.dataclass(eq=False)
class _Statement:
    """A top-level statement of a file: its lines, what it binds, uses (with attributes), changes and imports."""

    node: ast.stmt
    first: int
    last: int
    binds: set[str]
    uses: set[tuple[str, str]]
    effects: set[str]
    # The name that is bound, "" within a function; the module; the name in it, "" for the module itself.
    imports: list[tuple[str, str, str]]

    @cached_property
    def text(self) -> str:
        """Its source, formatted."""
        return ast.unparse(self.node)


class _Parsed:
    """A file without docstrings: its text, the packages that it imports, and its statements."""

    def __init__(self, content: bytes, package: str) -> None:
        self._package, tree = package, ast.parse(content)
        every = list(ast.walk(tree))
        for node in every:
            _strip(node)
        aliases = [each for node in every if isinstance(node, IMPORTS) for each in _aliases(node, package)]
        self.imports = {_root(module) for _, module, _ in aliases}
        self._nodes = list[ast.stmt]()
        for each in tree.body:
            if not (isinstance(each, ast.If) and ast.unparse(each.test) == "__name__ == '__main__'"):
                names = each.names if isinstance(each, IMPORTS) else []
                self._nodes += [type(each)(**{**vars(each), "names": [name]}) for name in names] or [each]
        # The order of imports changes nothing.
        self._nodes.sort(key=lambda node: ast.unparse(node) if isinstance(node, IMPORTS) else "~")

    @cached_property
    def text(self) -> str:
        """All statements."""
        return "\0".join(map(ast.unparse, self._nodes))

    @cached_property
    def statements(self) -> list[_Statement]:
        """The top-level statements, an import for each name."""
        return [_statement(node, self._package) for node in self._nodes]


def _strip(node: ast.AST) -> None:
    """Remove docstrings, and other strings that are no values."""
    body = getattr(node, "body", None)
    if isinstance(body, list):
        kept = [s for s in body if not (isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant))]
        node.body = kept or [ast.Pass()]  # type: ignore[attr-defined]


def _statement(node: ast.stmt, package: str) -> _Statement:
    code = compile(ast.fix_missing_locations(ast.Module([node], [])), "", "exec", dont_inherit=True)
    used, top = _names(code), list(_top(node))
    binds = {n.id for n in top if isinstance(n, ast.Name) and not isinstance(n.ctx, ast.Load)}
    binds |= {n.name for n in top if isinstance(n, DEFINITIONS)}
    imports = [("", *each[1:]) for n in ast.walk(node) if isinstance(n, IMPORTS) for each in _aliases(n, package)]
    imports = [each for n in top if isinstance(n, IMPORTS) for each in _aliases(n, package)] or imports
    binds |= {bound for bound, *_ in imports if bound}
    uses = {(name, attribute) for name, attribute in _dotted(node) if name in used}
    first = min([node.lineno, *(each.lineno for each in getattr(node, "decorator_list", []))])
    return _Statement(node, first, node.end_lineno or 0, binds, uses, _effects(node), imports)


def _top(node: ast.AST) -> Iterator[ast.AST]:
    """The parts of a statement that run with its module: all but the bodies of functions and classes."""
    yield node
    for child in () if isinstance(node, (*DEFINITIONS, ast.Lambda)) else ast.iter_child_nodes(node):
        yield from _top(child)


def _dotted(node: ast.AST) -> Iterator[tuple[str, str]]:
    """Names, each with the attribute that is taken of it."""
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        yield node.value.id, node.attr
    elif isinstance(node, ast.Name):
        yield node.id, ""
    else:
        for child in ast.iter_child_nodes(node):
            yield from _dotted(child)


def _effects(node: ast.AST) -> set[str]:
    """Names whose objects a statement changes: by an attribute, an entry, or a method whose result is unused."""
    places: list[ast.AST] = [
        n for n in _top(node) if isinstance(n, (ast.Attribute, ast.Subscript)) and not isinstance(n.ctx, ast.Load)
    ]
    places += [n.value.func for n in _top(node) if isinstance(n, ast.Expr) and isinstance(n.value, ast.Call)]
    names = set()
    for place in places:
        while isinstance(place, (ast.Attribute, ast.Subscript)):
            place = place.value
            names |= {place.id} if isinstance(place, ast.Name) else set()
    return names


def _aliases(node: Any, package: str) -> Iterator[tuple[str, str, str]]:
    for each in node.names:
        if isinstance(node, ast.Import):
            root = _root(each.name)
            yield each.asname or root, each.name if each.asname else root, ""
            if root != each.name and not each.asname:
                yield "", each.name, "."
        else:
            with suppress(ImportError):
                module = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
                yield each.asname or each.name, module, each.name


def _names(code: CodeType) -> set[str]:
    """Names that compiled code does not define itself, and those of attributes."""
    return {*code.co_names}.union(*(_names(each) for each in code.co_consts if isinstance(each, CodeType)))


def _bytecode(code: CodeType) -> str:
    parts = [_bytecode(each) if isinstance(each, CodeType) else repr(each) for each in code.co_consts]
    return f"{code.co_code.hex()} {code.co_names} {code.co_varnames} {parts}"


@cache
def _compiled(content: bytes, file: str) -> tuple[set[CodeType], dict[str, Any]]:
    """All code objects of a file, and the values of names that it sets once, to a literal."""
    codes, tree = {compile(content, file, "exec", dont_inherit=True)}, ast.parse(content)
    waiting = list(codes)
    while waiting:
        waiting = [each for code in waiting for each in code.co_consts if isinstance(each, CodeType)]
        codes |= {*waiting}
    names = [n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and not isinstance(n.ctx, ast.Load)]
    literals, stars = dict[str, Any](), [n for n in ast.walk(tree) if isinstance(n, ast.alias) and n.name == "*"]
    for node in () if stars else tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            with suppress(ValueError):
                literals[node.targets[0].id] = ast.literal_eval(node.value)
    # A dict, list or set may be filled later, by the module itself or as a cache.
    fixed = {name: value for name, value in literals.items() if not isinstance(value, (dict, list, set))}
    return codes, {name: value for name, value in fixed.items() if names.count(name) == 1}


def _codes(value: Any, module: ModuleType) -> Iterator[CodeType]:
    """The code of a loaded function, or of a class's methods, that the module defines."""
    if isinstance(value, type) and value.__module__ == module.__name__:
        for each in [each for each in vars(value).values() if not isinstance(each, type)]:
            yield from _codes(getattr(each, "fget", None) or getattr(each, "__func__", each), module)
    inner = getattr(value, "py_func", None) or value
    inner = inspect.unwrap(inner) if callable(inner) else inner
    # Functions that `exec` makes, like those of dataclasses, are in no file.
    if isinstance(inner, FunctionType) and inner.__code__.co_filename == module.__file__:
        yield inner.__code__


def _home(function: Any) -> str:
    """The module where a function's globals are; `__module__` may be copied or set."""
    while isinstance(function, partial):
        function = function.func
    named = function.__globals__.get("__name__") if isinstance(function, FunctionType) else None
    return _own_name(str(named or getattr(function, "__module__", None) or type(function).__module__))


def _own_name(name: str) -> str:
    """The name of a module, whether or not Python started it as a script."""
    main = sys.modules["__main__"]
    if name != "__main__":
        return name
    if main.__spec__ is not None:  # python -m
        return main.__spec__.name
    return _stem(main.__file__) if getattr(main, "__file__", None) else name


def _loaded_name(name: str) -> str:
    return "__main__" if name not in sys.modules and name == _own_name("__main__") else name


def _stem(file: Any) -> str:
    return re.sub(r"\W", "_", Path(file).stem)


def _spec(name: str) -> ModuleSpec | None:
    """Where a module lies."""
    loaded = sys.modules.get(_loaded_name(name))
    if isinstance(loaded, ModuleType):
        file = getattr(loaded, "__file__", None)  # a script has no spec
        return loaded.__spec__ or (importlib.util.spec_from_file_location(name, file) if file else None)
    with suppress(ImportError, ValueError):
        return importlib.util.find_spec(name)
    return None


def _file(name: str) -> Path | None:
    """The source of a module."""
    spec = _spec(name)
    return Path(spec.origin) if spec and spec.origin and spec.origin.endswith(".py") else None


def _modules(package: str) -> dict[str, Path]:
    """The modules of a package, or the module of that name, with their files."""
    spec, found = _spec(package), dict[str, Path]()
    for place in map(Path, (spec.submodule_search_locations or ()) if spec else ()):
        for file in place.rglob("*.py"):
            parts = file.relative_to(place).with_suffix("").parts
            found[".".join([package, *(part for part in parts if part != "__init__")])] = file
    own = _file(package)
    return found or ({package: own} if own else {})


def _is_installed(name: str) -> bool:
    spec = _spec(name)
    places = [spec.origin or "", *(spec.submodule_search_locations or ())] if spec else []
    return bool(INSTALLED & {part for place in places for part in Path(place).parts})


def _version(name: str) -> str:
    root = _root(name)
    names = packages_distributions().get(root)
    return version(names[0]) if names else "unknown"


def _parsed(name: str) -> _Parsed:
    file, spec = _file(name), _spec(name)
    try:
        return _parsed_content(file.read_bytes() if file else b"", (spec.parent if spec else "") or "")
    except SyntaxError as problem:
        raise InputError(f"{file}: it is no Python code: {problem}") from None


# By content, since modification times are too coarse.
_parsed_content = cache(_Parsed)


def _root(dotted: str) -> str:
    """The name before the first dot."""
    return dotted.partition(".")[0]


def _digest(content: bytes) -> str:
    return blake2b(content, digest_size=8).hexdigest()


def plain(value: Any, classes: set[Any] | None = None) -> Any:
    """A constant as JSON represents it; its functions, and the classes of its parts, are added to `classes`.

    Raises
    ------
    InputError
        If it is not made of numbers, strings, arrays, DataFrames, dataclasses and containers of these.
    """
    if classes is not None and callable(value):
        classes.add(value)
        # Libraries have functions of one name: numpy.sin, math.sin.
        home = f"{type(value).__module__}." if isinstance(value, np.ufunc) else ""
        return home + getattr(value, "__qualname__", getattr(value, "__name__", type(value).__qualname__))
    if classes is not None and _root(type(value).__module__) not in ("builtins", "numpy", "pandas"):
        classes.add(type(value))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, (pd.DataFrame, pd.Series)):
        value = value.to_dict("list") if isinstance(value, pd.DataFrame) else value.to_dict()
    if isinstance(value, Mapping):
        return {str(key): plain(each, classes) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each, classes) for each in value]
    if isinstance(value, (complex, np.complexfloating)):
        return [value.real, value.imag]
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist(), classes)
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise InputError(f"constants contain {value!r}, which cannot be written as JSON")


def load_script(file: str | Path) -> ModuleType:
    """The module of a script's file, not started as a script.

    It is named as its file, and imports modules beside it, as a script does. A sweep of its functions continues
    the results of the script, and the other way round. Other processes get its functions by value.

    Raises
    ------
    InputError
        If there is no such file, its name is another module's, or it raises.
    """
    path = Path(file).expanduser()
    name, folder = _stem(path), str(path.resolve().parent)
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
