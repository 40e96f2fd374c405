"""Fingerprint of the code behind functions: one digest for each module of the project that they reach.

It sees, in the modules of the functions, given or carried along, the top-level statements that they reach by name,
and those that act on import: bare calls, entries and attributes set, definitions with decorators or bases of the
project, `import package.module`. A package's `__init__` counts likewise. Any other module of the project of which
these take a name, within functions too, counts as a whole; it is followed on from that name. By value, with the
code of their classes, count closures, defaults of nested functions, arguments of partials, compilers' options and
called instances; and numbers, arrays and texts without a slash that a function's names, or these names in a module
that it names, stand for, unless the function binds them.

It does not see formatting, comments, docstrings, annotations outside classes, imports for type checkers, what a
script does when it is started, the order of statements where none acts; libraries, whose versions `provenance`
compares; what is found by a computed name; what a module sets in another, if it is only imported as
`from package import module` and never named; what an assigned call changes elsewhere.

No module is imported for it and nothing found in a file is executed.
"""

from __future__ import annotations
import __future__

import ast
import builtins
import dataclasses
import dis
import importlib.util
import os
import sys
import sysconfig
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from enum import Enum
from functools import cache, cached_property, partial
from hashlib import blake2b
from importlib.machinery import PathFinder
from importlib.metadata import packages_distributions
from pathlib import Path
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

ENGINE = __name__.partition(".")[0]
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
IMPORTS = (ast.Import, ast.ImportFrom)
# Fields of a syntax tree that change nothing: whether a name is read or written shows in its place.
UNTOLD = ("ctx", "kind", "returns", "type_comment", "type_params")
# Instructions by which a module's names are bound.
BINDS = ("STORE_NAME", "STORE_GLOBAL", "DELETE_NAME")
# Attributes of a class that hold no code of it.
ASIDE = ("__module__", "__doc__", "__annotations__", "__firstlineno__", "__static_attributes__")
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
    homes = [_home(function) for function in functions]
    # An instance of a library's class does not make the library the project's.
    written = [
        home for home, f in zip(homes, functions, strict=True) if isinstance(_innermost(f), (FunctionType, type))
    ]
    reach = _Reach({home.partition(".")[0] for home in written})
    notes = [(home, reach.text(function)) for home, function in zip(homes, functions, strict=True)]
    texts = reach.texts()
    for home, note in notes + sorted(reach.notes):
        texts.setdefault(home, []).append(note)
    return {name: _digest("\0".join(texts[name]).encode()) for name in sorted(texts)}


def differing(stored: Mapping[str, str], present: Mapping[str, str]) -> list[str]:
    """Names of the modules whose code differs, or which only one side reaches; sorted."""
    return sorted(name for name in {*stored, *present} if stored.get(name) != present.get(name))


def _dump(node: Any, in_class: bool = False) -> str:
    """Syntax as text without what decides nothing, the same in every version of Python that knows it."""
    if isinstance(node, list):
        return f"[{','.join([_dump(each, in_class) for each in node if not _is_idle(each, in_class)])}]"
    if not isinstance(node, ast.AST):
        return repr(node)
    if isinstance(node, ast.AnnAssign) and not in_class:  # a dataclass lives on annotations; nothing else does
        node = ast.Assign([node.target], node.value or ast.Constant(None))
    fields = ["arg"] if isinstance(node, ast.arg) else [name for name in node._fields if name not in UNTOLD]
    inside = isinstance(node, ast.ClassDef) or (in_class and not isinstance(node, FUNCTIONS))
    # What a later version adds is empty where an earlier one could be.
    told = [(name, value) for name in fields if (value := getattr(node, name, None)) is not None and value != []]
    return f"{type(node).__name__}({','.join([f'{name}={_dump(value, inside)}' for name, value in told])})"


def _is_idle(node: Any, in_class: bool = False) -> bool:
    declares = isinstance(node, ast.AnnAssign) and node.value is None and not in_class
    document = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return declares or document or isinstance(node, ast.Pass)


def _sets(node: ast.AST) -> bool:
    """Whether an entry or attribute is set or deleted here."""
    return isinstance(node, (ast.Attribute, ast.Subscript)) and not isinstance(node.ctx, ast.Load)


def _dotted(node: ast.AST) -> Iterator[str]:
    """The names in a tree, each with the attributes taken from it."""
    attributes = ""
    while isinstance(node, ast.Attribute):
        attributes, node = f".{node.attr}{attributes}", node.value
    if isinstance(node, ast.Name):
        yield node.id + attributes
    else:
        for child in ast.iter_child_nodes(node):
            yield from _dotted(child)


def _names(code: CodeType) -> set[str]:
    """Names of the module that compiled code uses, its functions included; and those of attributes."""
    return {*code.co_names}.union(*(_names(part) for part in code.co_consts if isinstance(part, CodeType)))


class _Statement:
    """A top-level statement of a module; of an import, one name."""

    def __init__(self, node: Any, package: str) -> None:
        self.node, self.package, self.is_import = node, package, isinstance(node, IMPORTS)

    @cached_property
    def text(self) -> str:
        return _dump(self.node)

    @cached_property
    def code(self) -> CodeType:
        # The compiler knows which names are a function's own; annotations stay texts.
        flags = __future__.annotations.compiler_flag
        tree = ast.Module([self.node], [])
        code: CodeType = compile(tree, "", "exec", flags, dont_inherit=True, optimize=0)
        return code

    @cached_property
    def binds(self) -> set[str]:
        return {each.argval for each in dis.get_instructions(self.code) if each.opname in BINDS}

    @cached_property
    def uses(self) -> set[str]:
        """Names of the module that it refers to, with the attributes taken: "module.function"."""
        names = _names(self.code)
        return {each for each in _dotted(self.node) if each.partition(".")[0] in names}

    @cached_property
    def acts(self) -> bool:
        """Whether it calls something for its effect, or sets an entry or attribute, when it runs."""
        outer = [self.node] if not isinstance(self.node, ast.ClassDef) else self.node.body
        parts = [part for each in outer if not isinstance(each, FUNCTIONS) for part in ast.walk(each)]
        return any(_sets(part) or (isinstance(part, ast.Expr) and not _is_idle(part)) for part in parts)

    @cached_property
    def imports(self) -> list[tuple[str, str]]:
        """Modules imported at the top or within, each with the name taken from it; "" takes all."""
        found = []
        for node in (each for each in ast.walk(self.node) if isinstance(each, IMPORTS)):
            for alias in node.names:
                if isinstance(node, ast.Import):
                    found += [(alias.name, "")] + [(alias.name.partition(".")[0], "")] * (alias.asname is None)
                    continue
                source = importlib.util.resolve_name("." * node.level + (node.module or ""), self.package)
                found.append((source, alias.name.strip("*")))
                if source == self.package:  # a submodule may be meant
                    found.append((f"{source}.{alias.name}", ""))
        return found


class _Module:
    """What a file says, cut into statements; a package without a file has none."""

    def __init__(self, name: str, package: str, file: str, content: bytes) -> None:
        self.name, self.file, self.is_package = name, file, name == package
        self.statements: list[_Statement] = []
        todo: list[Any] = ast.parse(content, file).body[::-1]
        while todo:
            node = todo.pop()
            test = getattr(node, "test", None)
            if isinstance(node, ast.If) and "TYPE_CHECKING" in (
                getattr(test, "id", ""),
                getattr(test, "attr", ""),
            ):
                todo += node.orelse[::-1]
            elif isinstance(node, IMPORTS) and len(node.names) > 1:
                fields = {name: getattr(node, name) for name in node._fields}
                names = sorted(node.names, key=lambda each: each.asname or each.name)
                parts = [type(node)(**fields | {"names": [each]}) for each in names]
                todo += [ast.copy_location(part, node) for part in parts[::-1]]
            elif not _is_idle(node):
                self.statements.append(_Statement(node, package))

    @cached_property
    def binders(self) -> dict[str, list[_Statement]]:
        """The statements that bind each name; those for "*" may bind any."""
        found: dict[str, list[_Statement]] = {}
        for each in self.statements:
            is_star = each.is_import and each.node.names[0].name == "*"
            for name in {"*"} if is_star else each.binds:
                found.setdefault(name, []).append(each)
        return found

    def binding(self, name: str) -> list[_Statement]:
        """The statements that bind a name or may do so."""
        return self.binders.get(name) or self.binders.get("*", [])

    def texts(self, taken: set[_Statement] | None = None) -> list[str]:
        """The statements taken, in no order where none acts or binds a name again; or else all."""
        if taken is None:
            return [each.text for each in self.statements]
        chosen = [each for each in self.statements if each in taken]
        fixed = any(each.acts or any(len(self.binders[name]) > 1 for name in each.binds) for each in chosen)
        # Tools sort imports anew.
        free = {each: each.is_import or not fixed for each in chosen}
        return sorted(each.text for each in chosen if free[each]) + [
            each.text for each in chosen if not free[each]
        ]


class _Reach:
    """Goes from functions to all that they reach; packages in `own` are followed wherever they lie."""

    def __init__(self, own: set[str]) -> None:
        self.own = own | _siblings()
        self.notes: set[tuple[str, str]] = set()  # what names stand for, by module
        self._homes: set[str] = set()  # modules of the functions, where only what is reached counts
        self._modules: dict[str, _Module | None] = {}
        self._taken: dict[str, set[_Statement]] = {}
        self._asked: set[tuple[str, str]] = set()
        self._todo: list[tuple[str, str]] = []
        self._seen: dict[int, Any] = {}  # keeps them alive: nothing else may take their id

    def texts(self) -> dict[str, list[str]]:
        """What is reached, by module."""
        while self._todo:
            self._go(*self._todo.pop())
        found = {}
        for name, module in self._modules.items():
            if module is not None and self._taken.get(name):
                is_part = module.is_package or name in self._homes
                found[name] = module.texts(self._taken[name] if is_part else None)
        return found

    def _ask(self, module: str, name: str = "") -> None:
        if (module, name) not in self._asked:
            self._asked.add((module, name))
            self._todo.append((module, name))

    def library(self, name: str) -> bool:
        """Whether a module is another's."""
        if name.partition(".")[0] in self.own:
            return False
        file, folders = _find(name)
        return name in sys.builtin_module_names or _installed((file, *folders)[0])

    def _module(self, name: str) -> _Module | None:
        """The module of that name, unless it is a library's or has no source."""
        if name not in self._modules:
            file, folders = _find(name)
            is_source = file.endswith(".py") or bool(folders and not file)
            self._modules[name] = (
                _read(name, file, bool(folders)) if is_source and not self.library(name) else None
            )
        return self._modules[name]

    def _go(self, source: str, name: str) -> None:
        """Take what is asked of a module: a name and on, all of it for "", only what acts for "."."""
        module, (head, _, rest) = self._module(source), name.partition(".")
        if module is None:
            return
        if source not in self._taken:
            self._taken[source] = set()
            self._ask(source.rpartition(".")[0], ".")
            acting = [each for each in module.statements if self._acts(module, each)]
            self._take(module, acting, with_imports=True)
        chosen = module.binding(head) if head else module.statements if not name else []
        submodule, further = f"{source}.{head}", rest if head in module.binders else name  # by a star
        if head and not chosen and self._module(submodule) is not None:
            self._ask(submodule, rest)
        elif head and not chosen and not hasattr(builtins, head):  # for the module's `__getattr__`
            chosen, further = module.statements, ""
        for target, inner in (each for statement in chosen if statement.is_import for each in statement.imports):
            self._ask(target, ".".join(filter(None, (inner, further))))
        self._take(module, chosen)

    def _take(self, module: _Module, chosen: list[_Statement], with_imports: bool = False) -> None:
        for statement in set(chosen) - self._taken[module.name]:
            self._taken[module.name].add(statement)
            for target, inner in statement.imports if with_imports or not statement.is_import else ():
                self._ask(target, inner)
            for use in () if statement.is_import else statement.uses:
                if module.binding(use.partition(".")[0]):
                    self._ask(module.name, use)

    def _acts(self, module: _Module, statement: _Statement) -> bool:
        """Whether a statement may change more than the names that it binds."""
        node = statement.node
        if statement.is_import:
            return isinstance(node, ast.Import) and not (node.names[0].asname or self.library(node.names[0].name))
        heads = [*getattr(node, "decorator_list", ()), *getattr(node, "bases", ()), *getattr(node, "keywords", ())]
        for each in (
            each for head in heads for name in _dotted(head) for each in module.binding(name.partition(".")[0])
        ):
            if not each.is_import or not self.library(each.imports[0][0]):
                return True
        # What a script does of itself is to use its functions.
        is_script = module.name == "__main__" or "__name__" in statement.uses
        return statement.acts and not is_script

    def text(self, value: Any) -> str:
        """A value in full, if it is plain or code, whose source is asked for."""
        kind = type(value)
        if kind in PLAIN:
            return f"{kind.__name__} {value!r}"
        if isinstance(value, np.dtype):
            return repr(value)
        if isinstance(value, (np.ndarray, np.generic)):
            content = self.text(value.tolist()) if value.dtype.hasobject else _digest(value.tobytes())
            return f"{value.dtype.str}{value.shape} {content}"
        if isinstance(value, (set, frozenset)):
            value = sorted(map(self.text, value))
        if isinstance(value, (list, tuple)):
            return f"{self._class(kind)}({', '.join(map(self.text, value))})"
        if isinstance(value, ModuleType):
            self._ask(value.__name__, "")
            return value.__name__
        if isinstance(value, type):
            return self._class(value)
        if isinstance(value, FunctionType):
            return self._function(value)
        if _of_library(value):
            return f"{value.__module__}.{getattr(value, '__qualname__', value.__name__)}"
        if isinstance(value, MethodType):
            return f"{self.text(value.__self__)} {self.text(value.__func__)}"
        if isinstance(value, dict):
            value = [(key, value[key]) for key in value]
            return f"{self._class(kind)} {self.text(value)}"
        name, how, held = "", "", dict[str, Any]()
        if isinstance(value, Enum):
            held = {"name": value.name}
        elif dataclasses.is_dataclass(value):
            held = {field.name: getattr(value, field.name, None) for field in dataclasses.fields(value)}
        elif isinstance(value, partial):
            how = f"function {getattr(value.func, '__qualname__', type(value.func).__qualname__)} is given"
            held = {f"argument {place}": each for place, each in enumerate(value.args, 1)} | value.keywords
            name = self.text(value.func)
        elif _inner(value) is not None:
            # A compiler's options decide the last digits.
            options = vars(value).get("targetoptions")
            return f"{self._if_told(options)} {self.text(_inner(value))}" if options else self.text(_inner(value))
        elif not self.library(kind.__module__) or (callable(value) and hasattr(value, "__dict__")):
            how = f"the {kind.__qualname__} that is called holds"
            state: Any = object.__getstate__(value)
            for part in state if isinstance(state, tuple) else [state]:
                held |= part or {}
        else:
            raise _IncomparableError(
                f"a {kind.__qualname__} cannot be compared with a stored one; call it in a function"
            )
        return f"{self._class(kind)} {name} {self._held(how, held)}"

    def _held(self, how: str, values: Mapping[str, Any]) -> str:
        found = []
        for name, value in sorted(values.items()):
            try:
                found.append(f"{name}={self.text(value)}")
            except _IncomparableError:
                if not how:
                    raise
                raise ValueError(
                    f"{how} {name} = {value!r}, which cannot be compared with a stored one; pass it as a constant"
                ) from None
        return ", ".join(found)

    def _if_told(self, value: Any) -> str:
        """The text of a value if it has one; but instances do not count, though they may be called."""
        code = isinstance(value, (FunctionType, type)) or _inner(value) is not None
        with suppress(ValueError):
            return self.text(value) if code or not callable(value) or _of_library(value) else ""
        return ""

    def _function(self, function: FunctionType) -> str:
        code, name = function.__code__, function.__qualname__
        home = str(function.__globals__.get("__name__") or "__main__")
        if id(function) in self._seen or self.library(home):
            return f"{home}.{name} {self.text(_inner(function))}"
        self._seen[id(function)] = function
        self._homes.add(home)
        module, top = self._module(home), code.co_qualname.partition(".")[0]
        has_source = module is not None and os.path.realpath(code.co_filename) == os.path.realpath(module.file)
        self._note(home, function.__globals__, code)
        if module is not None and has_source:
            for each in {top} if top in module.binders else _names(code) & set(module.binders):
                self._ask(home, each)
            if "<" not in code.co_qualname:
                return f"{home}.{name}"
        closed = {}
        for variable, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
            with suppress(ValueError):  # not filled yet
                closed[variable] = cell.cell_contents
        values = function.__defaults__ or ()
        given = dict(zip(code.co_varnames[code.co_argcount - len(values) :], values, strict=False))
        known = {} if has_source else function.__globals__
        own = [self._compiled(code, function.__doc__, known), self._held(f"function {name} closes over", closed)]
        own.append(self._held(f"function {name} has the default", given | (function.__kwdefaults__ or {})))
        return f"{home}.{name} {' '.join(own)}"

    def _note(self, home: str, present: Mapping[str, Any], code: CodeType, *inside: str) -> None:
        """Note the numbers, arrays and texts that the names in `code` stand for, in its module and those named."""
        bound = {each.argval for each in dis.get_instructions(code) if each.opname in BINDS}
        for name in _names(code) & set(present) - bound:
            value, kind = present[name], type(present[name])
            is_array = isinstance(value, (np.ndarray, np.generic)) and not value.dtype.hasobject
            # Other texts may name a place on this machine.
            if is_array or (kind in PLAIN and not (kind is str and {*value} & {"/", os.sep})):
                self.notes.add((home, f"{name} is {self.text(value)}"))
            elif kind is ModuleType and not inside and not self.library(value.__name__):
                self._note(value.__name__, vars(value), code, name)

    def _compiled(self, code: CodeType, document: str | None, known: Mapping[str, Any]) -> str:
        """Compiled code; what the names in it mean, where they are known and it can be told."""
        own = [code.co_code.hex(), code.co_exceptiontable.hex()]
        for constant in code.co_consts:
            if isinstance(constant, CodeType):
                own.append(self._compiled(constant, document, known))
            elif constant is None or constant != document:
                own.append(self.text(constant))
        return " ".join(own + [f"{name}={self._if_told(known.get(name))}" for name in code.co_names])

    def _class(self, kind: type) -> str:
        name, home, top = (
            f"{kind.__module__}.{kind.__qualname__}",
            kind.__module__,
            kind.__qualname__.partition(".")[0],
        )
        if id(kind) in self._seen or self.library(home):
            return name
        self._seen[id(kind)] = kind
        module = self._module(home)
        if module is not None and top in module.binders:
            self._ask(home, top)
            if "<" not in kind.__qualname__:
                return name
        members = {key: member for key, member in vars(kind).items() if key not in ASIDE}
        if dataclasses.is_dataclass(kind):
            members |= {f"{field.name} from": field.default_factory for field in dataclasses.fields(kind)}
        for key, member in sorted(members.items()):
            parts = (member, *(getattr(member, part, None) for part in ("fget", "fset", "__func__")))
            name += " ".join([key, *map(self._if_told, parts)])
        return name + " ".join(map(self._class, kind.__bases__))


class _IncomparableError(ValueError):
    """A value has no text that would be the same in another process."""


def _inner(function: Any) -> Any:
    """What a wrapper of whatever kind calls, or None."""
    if isinstance(function, (partial, MethodType)):
        return function.func if isinstance(function, partial) else function.__func__
    held = {} if isinstance(function, type) else getattr(function, "__dict__", {})
    return held.get("py_func", held.get("__wrapped__"))


def _innermost(function: Any) -> Any:
    return function if _inner(function) is None else _innermost(_inner(function))


def _home(function: Any) -> str:
    """The module to whose digest a given function's values belong."""
    function = _innermost(function)
    # Where its globals are; `__module__` may be another's, copied or set.
    named = function.__globals__.get("__name__") if isinstance(function, FunctionType) else None
    return str(named or getattr(function, "__module__", None) or "__main__")


def _of_library(function: Any) -> bool:
    """Whether it is not written in Python and found by its name in a library."""
    module = sys.modules.get(str(getattr(function, "__module__", None)))
    name = str(getattr(function, "__qualname__", getattr(function, "__name__", None)))
    file = getattr(module, "__file__", None) or ""
    known = module is not None and (_installed(file) or module.__name__ in sys.builtin_module_names)
    return known and getattr(module, name, None) is function


def _digest(content: bytes) -> str:
    return blake2b(content, digest_size=8).hexdigest()


@cache
def _installed(path: str) -> bool:
    """Whether a path lies among the libraries or in Python itself."""
    parts, place = Path(path).parts, Path(path)
    return bool({"site-packages", "dist-packages"} & {*parts}) or any(
        place.is_relative_to(sysconfig.get_path(kind)) for kind in ("stdlib", "platstdlib")
    )


@cache
def _siblings() -> frozenset[str]:
    """The packages installed together with this one, if it is installed at all."""
    owners = packages_distributions() if _installed(__file__) else {}
    return frozenset({ENGINE} | {top for top in owners if {*owners[top]} & {*owners.get(ENGINE, ())}})


def _find(name: str) -> tuple[str, list[str]]:
    """File of a module, or "", and the folders of its submodules; no package above it is imported for that."""
    loaded, above = sys.modules.get(name), name.rpartition(".")[0]
    if loaded is not None:
        # Not as attributes, which a module's `__getattr__` may make up.
        return vars(loaded).get("__file__") or "", list(vars(loaded).get("__path__") or ())
    try:
        spec = PathFinder.find_spec(name, _find(above)[1]) if above else importlib.util.find_spec(name)
    except (ImportError, ValueError, KeyError):  # KeyError: of a folder in a package that is not imported
        spec = None
    if spec is None:
        return "", []
    return (spec.origin or "" if spec.has_location else ""), list(spec.submodule_search_locations or ())


def _read(name: str, file: str, is_package: bool) -> _Module | None:
    package = name if is_package else name.rpartition(".")[0]
    if name == "__main__":
        package = getattr(sys.modules[name], "__package__", None) or ""
    try:
        return _parse(name, package, file, Path(file).read_bytes() if file else b"")
    except OSError:
        return None


# By content: the clock of files is coarse.
_parse = cache(_Module)
