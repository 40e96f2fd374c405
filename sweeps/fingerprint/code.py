"""Fingerprint of code: what results depend on, as far as it is code.

Covered are the packages, modules and files that a sweep declares; of the functions' own packages the top-level
definitions and assignments that they reach by name, with the statements that change these objects; other local
packages that this code imports, whole; and values that functions carry along: closures, defaults of nested
functions, arguments of partials, attributes of called instances.

Not covered are files that a module reads, unless they are declared; names that are found by computation; and the
code of installed packages: of those that are declared, or define a function, the version counts, that of others is
part of the environment. Formatting, comments and docstrings change nothing. Nothing in a file is executed.
"""

import ast
import dataclasses
import importlib.util
import inspect
import json
import os
import re
import sys
from collections import Counter
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
    """Digests of code by the name of each module, package and file; of an installed package its version.

    `functions` are callables of any kind, `code` the packages and modules, by name, and the files and folders on
    which results depend besides. An `InputError` if there is no such code, or a function carries along a value
    that cannot be compared.
    """
    reach, texts = _Reach(functions, code), dict[str, list[str]]()
    for module, taken in sorted(reach.taken.items()):
        lines = [each.text for each in reach.statements(module) if each in taken]
        texts.setdefault(reach.whole.get(module, module), []).extend(lines)
    for name, values in reach.values.items():
        texts.setdefault(name, []).extend(sorted(values))
    found = {name: digest("\0".join(lines).encode()) for name, lines in texts.items() if lines}
    for path in reach.files:
        files = [path] if path.is_file() else sorted(each for each in path.rglob("*") if each.is_file())
        contents = (str(each.relative_to(path)).encode() + each.read_bytes() for each in files)
        found[path.name] = digest(b"\0".join(contents))
    for name in reach.versions:
        distributions = packages_distributions().get(_root(name))
        found[name] = f"version {version(distributions[0]) if distributions else 'unknown'}"
    return dict(sorted(found.items()))


def libraries(functions: Functions, code: Sequence[str | Path] = ()) -> list[str]:
    """Names of the installed packages that the covered code imports."""
    return sorted(_Reach(functions, code).libraries)


def check_loaded(functions: Functions, code: Sequence[str | Path] = ()) -> None:
    """Refuse code that Python has loaded and that is not what its file says now.

    Results of the loaded code would get the fingerprint of the file. Functions, methods and literals are compared.
    """
    reach = _Reach(functions, code)
    started = psutil.Process().create_time() - MARGIN
    for name in reach.taken.keys() | {home for home, _ in reach.functions}:
        loaded, file = _loaded(name), _file(name)
        # Other loaders, like that of pytest, may change the code. A file older than this process cannot differ.
        if loaded is None or file is None or type(getattr(loaded, "__loader__", None)) is not SourceFileLoader:
            continue
        if file.stat().st_ctime < started:
            continue
        codes, literals = _compiled(file.read_bytes(), str(loaded.__file__))
        wrong = {each.co_qualname for home, each in reach.functions if home == name and each not in codes}
        names = set[str]().union(*(each.names for each in reach.taken.get(name, ())))
        for key, value in vars(loaded).items():
            if name not in reach.whole and key not in names:
                continue
            differs = key in literals and (type(value), value) != (type(literals[key]), literals[key])
            if differs or not codes.issuperset(_codes(value, loaded)):
                wrong.add(key)
        if wrong:
            what = f"{file.name} has changed since Python loaded it ({', '.join(sorted(wrong))})"
            raise InputError(f"{what}; restart Python, or reload the module, and plan again")


class _Reach:
    """Follows names from functions through the modules of their packages."""

    def __init__(self, functions: Functions, code: Sequence[str | Path]) -> None:
        self.statements = cache(_statements_of)  # each file is read once
        # Packages that are covered as declared, or that have no code of their own.
        self._known = {_root(name) for name in code if isinstance(name, str)} | sys.stdlib_module_names
        homes = {_root(home_of(getattr(function, "func", function))) for function in functions} - self._known
        self._own, before = {home for home in homes if not _is_installed(home)}, None
        while before != self._own:  # a package that is found late counts from the beginning
            before = set(self._own)
            self._follow_all(functions, code)

    def _follow_all(self, functions: Functions, code: Sequence[str | Path]) -> None:
        self.taken, self.values = dict[str, set[_Statement]](), dict[str, list[str]]()
        # The package of each module that is covered as a whole.
        self.whole = dict[str, str]()
        self.versions, self.libraries = set[str](), set[str]()
        self.files = [each for each in code if isinstance(each, Path)]
        self.functions, self._seen = list[tuple[str, CodeType]](), set[Any]()
        for name in code:
            if not (name.exists() if isinstance(name, Path) else _spec(name)):
                raise InputError(f"code = {str(name)!r}: there is no such package, module or file")
            if isinstance(name, str) and _is_installed(name):
                self.versions.add(name)
            elif isinstance(name, str):
                self._cover(name)
        for function in functions:
            self._function(function)

    def _cover(self, package: str) -> None:
        modules = _modules(package)
        self.whole |= dict.fromkeys(modules, package)
        for module in modules:
            self.taken[module] = {*self.statements(module)}
            for root in {_root(target) for each in self.taken[module] for _, target, _ in each.imports}:
                self._count(root)

    def _count(self, root: str) -> None:
        """Count a package that covered code imports."""
        if root in self._own | {ENGINE} or root in sys.stdlib_module_names or _spec(root) is None:
            return
        if _is_installed(root):
            self.libraries.add(root)
        elif root not in map(_root, self.whole.values()):
            self._cover(root)

    def _take(self, module: str, name: str, attribute: str = "") -> None:
        """Take the statements of a module that bind a name or change its object; "*" takes all."""
        if (module, name, attribute) in self._seen or _file(module) is None:
            return
        self._seen.add((module, name, attribute))
        for each in self.statements(module):
            if name == "*" or not each.names.isdisjoint((name, "*")):
                self._follow(module, each, name, attribute)

    def _follow(self, module: str, statement: "_Statement", name: str = "", attribute: str = "") -> None:
        """Take a statement, with all that it uses; of an import what `name` imports, with its attribute."""
        for bound, target, inner in statement.imports:
            # What the engine computes is given by its own functions.
            if (bound in (name, "") or "*" in (bound, name)) and not (_root(target) == ENGINE != _root(module)):
                self._import(target, name if inner == "*" else inner, attribute)
        taken = self.taken.setdefault(module, set())
        if statement not in taken:
            taken.add(statement)
            for use in statement.uses:
                self._take(module, *use)

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

    def _function(self, function: Any) -> None:
        """Follow a callable of any kind, with the values that it carries along."""
        inner = getattr(function, "py_func", None) or getattr(function, "__wrapped__", None)
        kind, home = type(function), home_of(inner or function)
        name, carried = getattr(function, "__qualname__", kind.__qualname__), dict[Any, Any]()
        if isinstance(function, partial):
            inner, carried = function.func, {**dict(enumerate(function.args)), **function.keywords}
        elif isinstance(function, MethodType):
            inner, carried = function.__func__, {"self": function.__self__}
        elif inner is not None:
            carried = {"options": str(sorted(getattr(function, "targetoptions", {}).items(), key=str))}
        elif isinstance(function, (FunctionType, type)):
            carried = self._definition(function, home, name)
        elif not (_root(home_of(kind)) in sys.stdlib_module_names or _is_installed(_root(home_of(kind)))):
            inner, carried = kind, getattr(function, "__dict__", {})
        for key, value in carried.items():
            followed = set[Any]()
            try:
                text = json.dumps(plain(value, followed))
            except InputError:
                what = f"{name} has {key} = {value!r}, which cannot be compared with a stored value"
                raise InputError(f"{what}; pass it as a constant") from None
            self.values.setdefault(home, []).append(f"{name} has {key} = {text}")
            for each in followed:
                self._function(each)
        if inner is not None:
            self._function(inner)

    def _definition(self, function: FunctionType | type, home: str, name: str) -> dict[Any, Any]:
        """Take the definition of a function or class; return what it carries along."""
        root, file, nested = _root(home), _file(home), "<" in name
        if id(function) in self._seen or root in self._known:
            return {}
        self._seen.add(id(function))
        if _is_installed(root):
            self.versions |= {root} if isinstance(function, FunctionType) else set()
            return {}
        self._own.add(root)
        carried = dict[Any, Any]()
        if isinstance(function, type):
            nested = False
            if file is None:
                kinds = (FunctionType, bool, int, float, str)
                carried = {key: value for key, value in vars(function).items() if isinstance(value, kinds)}
                carried = {key: value for key, value in carried.items() if key not in ("__module__", "__doc__")}
        else:
            code = function.__code__
            self.functions.append((home, code))
            cells = zip(code.co_freevars, function.__closure__ or (), strict=True)
            carried = {key: cell.cell_contents for key, cell in cells if cell != CellType()}  # one may be unbound
            if nested:
                parameters = inspect.signature(function).parameters.values()
                carried |= {each.name: each.default for each in parameters if each.default is not each.empty}
            if nested or file is None:  # a statement may have several; a notebook's function has no file
                self.values.setdefault(home, []).append(_bytecode(code))
            for key in sorted(_names(code) & function.__globals__.keys()) if file is None else ():
                if isinstance(value := function.__globals__[key], ModuleType):
                    self._count(_root(value.__name__))
                else:
                    carried[key] = value
            for each in self.statements(home) if nested else ():
                if each.first <= code.co_firstlineno <= each.last:
                    self._follow(home, each)
        if not nested:
            self._take(home, _root(name))
        return carried


class _Statement:
    """A top-level statement of a file, without docstrings; of an import one name."""

    def __init__(self, node: ast.stmt, package: str) -> None:
        self._node, self._package = node, package
        self.first = min([node.lineno, *(each.lineno for each in getattr(node, "decorator_list", []))])
        self.last = node.end_lineno or 0
        # The parts that run with the module: all but the bodies of functions and classes.
        self._top: list[ast.AST] = [node]
        for each in self._top:
            if not isinstance(each, (*DEFINITIONS, ast.Lambda)):
                self._top += ast.iter_child_nodes(each)

    @cached_property
    def text(self) -> str:
        return ast.unparse(self._node)

    @cached_property
    def names(self) -> set[str]:
        """Names that it binds, or whose objects it changes: by an attribute, an entry, or an unused result."""
        stored = [n for n in self._top if hasattr(n, "ctx") and not isinstance(n.ctx, ast.Load)]
        calls = [n.value for n in self._top if isinstance(n, ast.Expr) and isinstance(n.value, ast.Call)]
        changed = [*stored, *(each.func for each in calls if isinstance(each.func, ast.Attribute))]
        names = {n.id for place in changed for n in ast.walk(place) if isinstance(n, ast.Name)}
        names |= {n.name for n in self._top if isinstance(n, DEFINITIONS)}
        return names | {bound for bound, *_ in self.imports if bound}

    @cached_property
    def uses(self) -> set[tuple[str, str]]:
        """Names that it does not define itself, each with the attribute that is taken of it."""
        module = ast.fix_missing_locations(ast.Module([self._node], []))
        used = _names(compile(module, "", "exec", dont_inherit=True))
        found, nodes = set[tuple[str, str]](), list[ast.AST]([self._node])
        for node in nodes:
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                found.add((node.value.id, node.attr))
            elif isinstance(node, ast.Name):
                found.add((node.id, ""))
            else:
                nodes += ast.iter_child_nodes(node)
        return {each for each in found if each[0] in used}

    @cached_property
    def imports(self) -> list[tuple[str, str, str]]:
        """The name that is bound, "" within a function; the module; the name in it, "" for the module itself."""
        found = list[tuple[str, str, str]]()
        for node in (each for each in ast.walk(self._node) if isinstance(each, IMPORTS)):
            here = node in self._top
            for each in node.names:
                root = _root(each.name)
                if isinstance(node, ast.ImportFrom):
                    with suppress(ImportError):
                        relative = "." * node.level + (node.module or "")
                        module = importlib.util.resolve_name(relative, self._package)
                        found.append(((each.asname or each.name) * here, module, each.name))
                elif each.asname or root == each.name:
                    found.append(((each.asname or root) * here, each.name, ""))
                else:
                    found += [(root * here, root, ""), ("", each.name, ".")]
        return found


def _statements_of(name: str) -> list[_Statement]:
    """The top-level statements of a module, imports first."""
    file, spec = _file(name), _spec(name)
    try:
        return _statements(file.read_bytes() if file else b"", (spec.parent if spec else "") or "")
    except SyntaxError as problem:
        raise InputError(f"{file}: it is no Python code: {problem}") from None


@cache  # by content, since modification times are too coarse
def _statements(content: bytes, package: str) -> list[_Statement]:
    nodes, tree = list[ast.stmt](), ast.parse(content)
    for node in ast.walk(tree):
        if isinstance(body := getattr(node, "body", None), list):
            # Docstrings, and other strings that are no values.
            kept = [s for s in body if not (isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant))]
            node.body = kept or [ast.Pass(lineno=0)]  # type: ignore[attr-defined]
    for each in tree.body:
        if not (isinstance(each, ast.If) and ast.unparse(each.test) == "__name__ == '__main__'"):
            names = each.names if isinstance(each, IMPORTS) else []
            nodes += [type(each)(**{**vars(each), "names": [name]}) for name in names] or [each]
    # The order of imports changes nothing.
    nodes.sort(key=lambda node: ast.unparse(node) if isinstance(node, IMPORTS) else "~")
    return [_Statement(node, package) for node in nodes]


def _names(code: CodeType) -> set[str]:
    """Names that compiled code does not define itself, and those of attributes."""
    return {*code.co_names}.union(*(_names(each) for each in code.co_consts if isinstance(each, CodeType)))


def _bytecode(code: CodeType) -> str:
    parts = [_bytecode(each) if isinstance(each, CodeType) else repr(each) for each in code.co_consts]
    return f"{code.co_code.hex()} {code.co_names} {code.co_varnames} {parts}"


@cache
def _compiled(content: bytes, file: str) -> tuple[set[CodeType], dict[str, Any]]:
    """All code objects of a file, and the values of names that it sets once, to a literal."""
    codes, tree = [compile(content, file, "exec", dont_inherit=True)], ast.parse(content)
    for code in codes:
        codes += [each for each in code.co_consts if isinstance(each, CodeType)]
    every, literals = list(ast.walk(tree)), dict[str, Any]()
    stored = Counter(n.id for n in every if isinstance(n, ast.Name) and not isinstance(n.ctx, ast.Load))
    star = any(isinstance(n, ast.alias) and n.name == "*" for n in every)
    for node in () if star else tree.body:
        if isinstance(node, ast.Assign) and isinstance(name := node.targets[0], ast.Name) and stored[name.id] == 1:
            with suppress(ValueError):
                literals[name.id] = ast.literal_eval(node.value)
    # A dict, list or set may be filled later, by the module itself or as a cache.
    return {*codes}, {n: value for n, value in literals.items() if not isinstance(value, (dict, list, set))}


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


def home_of(function: Any) -> str:
    """The module where a function's globals are; `__module__` may be copied or set."""
    while isinstance(function, partial):
        function = function.func
    named = function.__globals__.get("__name__") if isinstance(function, FunctionType) else None
    return _own_name(str(named or getattr(function, "__module__", None) or type(function).__module__))


def _own_name(name: str) -> str:
    """The name of a module, whether or not Python started it as a script."""
    main: Any = sys.modules["__main__"]
    if name == "__main__" and main.__spec__ is not None:  # python -m
        return str(main.__spec__.name)
    return _stem(main.__file__) if name == "__main__" and getattr(main, "__file__", None) else name


def _loaded(name: str) -> ModuleType | None:
    return sys.modules.get("__main__" if name not in sys.modules and name == _own_name("__main__") else name)


def _stem(file: Any) -> str:
    return re.sub(r"\W", "_", Path(file).stem)


def _spec(name: str) -> ModuleSpec | None:
    if isinstance(loaded := _loaded(name), ModuleType):
        file = getattr(loaded, "__file__", None)  # a script has no spec
        return loaded.__spec__ or (importlib.util.spec_from_file_location(name, file) if file else None)
    with suppress(ImportError, ValueError):
        return importlib.util.find_spec(name)
    return None


def _file(name: str) -> Path | None:
    spec = _spec(name)
    return Path(spec.origin) if spec and spec.origin and spec.origin.endswith(".py") else None


def _modules(package: str) -> list[str]:
    """The modules of a package, or the module of that name."""
    spec, found = _spec(package), list[str]()
    for place in map(Path, (spec.submodule_search_locations or ()) if spec else ()):
        parts = [file.relative_to(place).with_suffix("").parts for file in place.rglob("*.py")]
        found += [".".join([package, *(part for part in each if part != "__init__")]) for each in parts]
    return sorted(found) or [package] * (_file(package) is not None)


def _is_installed(name: str) -> bool:
    spec = _spec(name)
    places = [spec.origin or "", *(spec.submodule_search_locations or ())] if spec else []
    return bool(INSTALLED & {part for place in places for part in Path(place).parts})


def _root(dotted: str) -> str:
    return dotted.partition(".")[0]


def digest(content: bytes) -> str:
    """A short hash."""
    return blake2b(content, digest_size=8).hexdigest()


def plain(value: Any, classes: set[Any] | None = None) -> Any:
    """A constant as JSON represents it; its functions, and the classes of its parts, are added to `classes`.

    An `InputError` if it is not of numbers, strings, arrays, DataFrames, dataclasses and containers of these.
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
    the results of the script, and the other way round. Other processes get its functions by value. An InputError
    if there is no such file, its name is another module's, or it raises.
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
