"""Modules as their files say them: found without an import, cut into statements, without what decides nothing."""

from __future__ import annotations
import __future__

import ast
import dis
import importlib.util
import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

from sweeps.fingerprint.scripts import script_name

FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
DEFINITIONS = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
IMPORTS = (ast.Import, ast.ImportFrom)
# Fields of a syntax tree that change nothing: whether a name is read or written shows in its place.
IGNORED = ("ctx", "kind", "returns", "type_comment", "type_params", "is_lazy")
SCRIPT = "__name__ == '__main__'"
STANDARD_LIBRARY = Path(os.__file__).parent


class Statement:
    """A top-level statement of a module; of an import, one name."""

    def __init__(self, node: Any, package: str) -> None:
        self.is_import = isinstance(node, IMPORTS)
        self.text = _dump(node)
        # The compiler knows which names are a function's own; annotations stay texts.
        flags = __future__.annotations.compiler_flag
        code = compile(ast.Module([node], []), "", "exec", flags, dont_inherit=True, optimize=0)
        used = names(code)
        self.uses = {each for each in _dotted(node) if root(each) in used}
        # Decorators and base classes may note what they are given.
        run = [*_run(node)]
        made = [part for part in run if isinstance(part, DEFINITIONS)]
        self.is_made = any(
            getattr(part, each, ()) for part in made for each in ("decorator_list", "bases", "keywords")
        )
        self.is_definition = isinstance(node, DEFINITIONS)
        # What a module does only as a script is to use its functions.
        is_script = isinstance(node, ast.If) and ast.unparse(node.test) == SCRIPT and not node.orelse
        self.effects = set() if is_script else {*_effects(node)}
        # Modules imported by it or within, each with the name taken from it: "" takes all, "*" any.
        self.imports = [each for part in ast.walk(node) for each in _imports(part, package)]
        if isinstance(node, ast.Import) and not node.names[0].asname:
            self.imports = [(root(node.names[0].name), "")]
        self.loads = {alias.name for part in run if isinstance(part, ast.Import) for alias in part.names}
        self.binds = bound(code) | {inner for _, inner in self.imports if inner == "*"}


class Module:
    """What a file says; a package without a file has no statements."""

    def __init__(self, name: str, package: str, file: str, content: bytes) -> None:
        self.name, self.file, self.is_package = name, file, name == package
        self.statements: list[Statement] = []
        for node in ast.parse(content, file).body:
            aliases = node.names if isinstance(node, IMPORTS) else ()
            parts = [type(node)(**{**vars(node), "names": [alias]}) for alias in aliases] or [node]
            self.statements += [Statement(part, package) for part in parts if not _is_idle(part)]
        bound_here = {each for statement in self.statements for each in statement.binds}
        self.binders = {name: [each for each in self.statements if name in each.binds] for name in bound_here}

    def binding(self, name: str) -> list[Statement]:
        """The statements that bind a name, and the stars that may do so after the first of them."""
        own = self.binders.get(name, [])
        after = self.statements.index(own[0]) if own else -1
        return own + [each for each in self.binders.get("*", []) if self.statements.index(each) > after]

    def binds_alone(self, statement: Statement) -> bool:
        """Whether no other statement may bind a name that this one binds."""
        return all(name != "*" and len(self.binding(name)) == 1 for name in statement.binds)


def read(name: str) -> Module | None:
    """The module of that name; None where there is no source."""
    spec = find(name)
    file = (spec and spec.has_location and spec.origin) or ""
    if spec is not None and (file.endswith(".py") or (spec.submodule_search_locations and not file)):
        with suppress(OSError, SyntaxError):
            return _parsed(name, spec.parent or "", file, Path(file).read_bytes() if file else b"")
    return None


# By content: the clock of files is coarse.
_parsed = cache(Module)


def find(name: str) -> ModuleSpec | None:
    """Where a module lies; no package above it is imported for that."""
    loaded = sys.modules.get("__main__" if name == script_name() else name)
    above = name.rpartition(".")[0]
    if isinstance(loaded, ModuleType):
        file = vars(loaded).get("__file__")  # a script has no more than that
        return loaded.__spec__ or (importlib.util.spec_from_file_location(name, file) if file else None)
    with suppress(ImportError, ValueError, KeyError):  # KeyError: of a folder in a package that is not imported
        if not above:
            return importlib.util.find_spec(name)
        parent = find(above)
        return PathFinder.find_spec(name, list(parent.submodule_search_locations or ()) if parent else [])
    return None


def is_library(name: str) -> bool:
    """Whether a module belongs to Python or was installed."""
    spec = find(name)
    place = Path((spec and (spec.origin or next(iter(spec.submodule_search_locations or ()), ""))) or "")
    among = {"site-packages", "dist-packages"} & {*place.parts}
    return bool(among) or place.name in ("built-in", "frozen") or STANDARD_LIBRARY in place.parents


def root(dotted: str) -> str:
    """The name before the first dot."""
    return dotted.partition(".")[0]


def bound(code: CodeType, at_top: int = 4) -> set[str]:
    """Names of the module that compiled code binds, its functions not included."""
    binds = ("STORE_GLOBAL", "DELETE_GLOBAL", "STORE_NAME", "DELETE_NAME")
    here = {each.argval for each in dis.get_instructions(code) if each.opname in binds[:at_top]}
    return here.union(*(bound(part, 2) for part in code.co_consts if isinstance(part, CodeType)))


def names(code: CodeType) -> set[str]:
    """Names of the module that compiled code uses, its functions included; and those of attributes."""
    return {*code.co_names}.union(*(names(part) for part in code.co_consts if isinstance(part, CodeType)))


def imported(code: CodeType) -> set[str]:
    """Modules that compiled code imports, its functions included."""
    here = {each.argval for each in dis.get_instructions(code) if each.opname == "IMPORT_NAME"}
    return here.union(*(imported(part) for part in code.co_consts if isinstance(part, CodeType)))


def _dump(node: Any, in_class: bool = False) -> str:
    """Syntax as text without what decides nothing, the same in every version of Python that knows it."""
    if isinstance(node, list):
        return f"[{','.join([_dump(each, in_class) for each in node if not _is_idle(each, in_class)])}]"
    if not isinstance(node, ast.AST):
        return repr(node)
    if isinstance(node, ast.AnnAssign) and not in_class:  # a dataclass lives on annotations; nothing else does
        node = ast.Assign([node.target], node.value or ast.Constant(None))
    fields = ["arg"] if isinstance(node, ast.arg) else [name for name in node._fields if name not in IGNORED]
    inside = isinstance(node, ast.ClassDef) or (in_class and not isinstance(node, FUNCTIONS))
    # What a later version adds is empty where an earlier one could be.
    told = [(name, value) for name in fields if (value := getattr(node, name, None)) is not None and value != []]
    return f"{type(node).__name__}({','.join([f'{name}={_dump(value, inside)}' for name, value in told])})"


def _is_idle(node: Any, in_class: bool = False) -> bool:
    declares = isinstance(node, ast.AnnAssign) and node.value is None and not in_class
    document = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return declares or document or isinstance(node, ast.Pass)


def _effects(node: ast.AST) -> Iterator[str]:
    """Names whose objects a statement changes in place when it runs; "" for what else it calls for its effect."""
    if isinstance(node, FUNCTIONS) or _is_idle(node):
        return
    if isinstance(node, (ast.Attribute, ast.Subscript)) and not isinstance(node.ctx, ast.Load):
        yield from map(root, _dotted(node.value))
    elif isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name):
        yield node.target.id
    elif isinstance(node, ast.Call):
        yield from map(root, _dotted(node.func)) if isinstance(node.func, ast.Attribute) else ("",)
    elif isinstance(node, ast.Expr) and not isinstance(node.value, ast.Call):
        yield ""
    for child in ast.iter_child_nodes(node):
        if not (isinstance(node, (ast.Assign, ast.AnnAssign)) and child is node.value):
            yield from _effects(child)


def _run(node: ast.AST) -> Iterator[ast.AST]:
    """The parts of a statement that run when its module is imported, what is within functions not included."""
    yield node
    for child in () if isinstance(node, FUNCTIONS) else ast.iter_child_nodes(node):
        yield from _run(child)


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


def _imports(node: ast.AST, package: str) -> Iterator[tuple[str, str]]:
    if isinstance(node, ast.Import):
        for alias in node.names:
            yield from ((name, "") for name in {alias.name, alias.name if alias.asname else root(alias.name)})
    elif isinstance(node, ast.ImportFrom):
        with suppress(ImportError):  # of a script, which may try both
            source = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
            yield from ((source, alias.name) for alias in node.names)
