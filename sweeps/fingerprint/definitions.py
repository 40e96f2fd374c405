"""What the definitions of a program reach, read from its source: from a name to its statements, and on from these.

Nothing is imported for it and nothing is run. What no name leads to is not seen: a module imported for its
effects alone, `globals()`, attributes that another module sets.

What names stand for at present is told of modules that are certain to be imported where the function is: by its
own module and on from there, in statements at the top. So it does not matter whether another was imported yet.
"""

from __future__ import annotations

import ast
import importlib.metadata
import importlib.util
import sys
import sysconfig
from collections.abc import Iterator
from contextlib import suppress
from functools import cache, cached_property
from importlib.machinery import PathFinder
from pathlib import Path
from types import CodeType
from typing import Any

from sweeps.fingerprint.syntax import DEFINITIONS, Chain, acts, bare, bound, dumped, first_line, references


class Piece:
    """A top-level statement of a module; of an import, one name."""

    def __init__(self, node: ast.stmt, module: str, package: str) -> None:
        self.node, self.module, self.package = node, module, package
        self.names = frozenset(bound(node))

    @cached_property
    def text(self) -> str:
        """The statement without its formatting."""
        return dumped(self.node)

    @property
    def uses(self) -> list[Chain]:
        """What the statement refers to."""
        return self._references[0]

    @cached_property
    def targets(self) -> dict[str, list[tuple[str, Chain]]]:
        """For each name imported here, at the top or within: the module, and what is taken from it."""
        found: dict[str, list[tuple[str, Chain]]] = {}
        for name, target in (each for node in self._references[1] for each in self._imports(node)):
            found.setdefault(name, []).append(target)
        return found

    @property
    def changes(self) -> set[str]:
        """Names of the module that functions here bind, or what they stand for changes, when they run."""
        return self._references[2]

    @cached_property
    def literals(self) -> dict[str, Any]:
        """What the names stand for of which the text says it."""
        found: dict[str, Any] = {}
        if isinstance(self.node, ast.Assign):
            with suppress(ValueError, TypeError):
                value = ast.literal_eval(self.node.value)
                for target in self.node.targets:
                    several = isinstance(target, (ast.Tuple, ast.List)) and isinstance(value, (tuple, list))
                    pairs = zip(getattr(target, "elts", ()), value, strict=False) if several else [(target, value)]
                    found |= {each.id: part for each, part in pairs if isinstance(each, ast.Name)}
        return found

    @cached_property
    def _references(self) -> tuple[list[Chain], list[ast.Import | ast.ImportFrom], set[str]]:
        return references(self.node)

    def _imports(self, node: ast.Import | ast.ImportFrom) -> Iterator[tuple[str, tuple[str, Chain]]]:
        """Each name that an import binds, and what it then stands for."""
        for alias in node.names:
            if isinstance(node, ast.Import):
                top = alias.name.partition(".")[0]
                yield (alias.asname, (alias.name, ())) if alias.asname else (top, (top, ()))
                continue
            parents = self.package.split(".")
            parents = parents[: len(parents) - node.level + 1] if node.level else []
            source = ".".join([*parents, *([node.module] if node.module else [])])
            yield alias.asname or alias.name, (source, () if alias.name == "*" else (alias.name,))
            if source == self.module:  # a package's own file, where a submodule may be meant
                yield alias.asname or alias.name, (f"{source}.{alias.name}", ())

    def within(self, code: CodeType) -> list[str]:
        """The definitions in this statement of which `code` may be the compiled form."""
        found: list[ast.AST] = []
        for node in ast.walk(self.node):
            if isinstance(node, (*DEFINITIONS, ast.Lambda)):
                name = node.name if isinstance(node, DEFINITIONS) else "<lambda>"
                if name == code.co_name and first_line(node) == code.co_firstlineno:
                    found.append(node)
        # Of several lambdas in one line the columns of their bodies tell.
        spots, bodies = set(code.co_positions()), [(n, n.body) for n in found if isinstance(n, ast.Lambda)]
        exact = [n for n, b in bodies if (b.lineno, b.end_lineno, b.col_offset, b.end_col_offset) in spots]
        return [dumped(node) for node in exact or found]


class Module:
    """What a file says, cut into pieces; a package without a file has none."""

    def __init__(self, name: str, package: str, file: str, content: bytes) -> None:
        self.name, self.file = name, file
        self.pieces: list[Piece] = []
        for node in bare(ast.parse(content, file).body):
            nodes: list[ast.stmt] = [node]
            if isinstance(node, ast.Import):
                nodes = [ast.copy_location(ast.Import([alias]), node) for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                one = ((ast.ImportFrom(node.module, [alias], node.level)) for alias in node.names)
                nodes = [ast.copy_location(part, node) for part in one]
            self.pieces += [Piece(part, name, package) for part in nodes]
        self.binders: dict[str, list[Piece]] = {}
        for piece in self.pieces:
            for own in piece.names:
                self.binders.setdefault(own, []).append(piece)
        # What a script does of itself is to use its functions.
        self.effects = [] if self.name == "__main__" else [piece for piece in self.pieces if acts(piece.node)]

    def offers(self, name: str) -> bool:
        """Whether an import with a star would ask for the name here."""
        listing = self.binders.get("__all__", [])
        if not listing:
            return not name.startswith("_")
        listed = listing[0].literals.get("__all__") if len(listing) == 1 else None
        return listed is None or name in listed

    def texts(self, taken: set[Piece]) -> list[str]:
        """The pieces taken, in their order; but imports, which tools like to sort anew, by their text."""
        loose, fixed = list[str](), list[str]()
        for piece in self.pieces:
            if piece in taken:
                free = isinstance(piece.node, (ast.Import, ast.ImportFrom)) and not any(
                    len(self.binders[name]) > 1 for name in piece.names
                )
                (loose if free else fixed).append(piece.text)
        return sorted(loose) + fixed


class Reach:
    """Goes from what is asked for to all that it reaches; packages in `own` are followed wherever they lie."""

    def __init__(self, own: frozenset[str]) -> None:
        self.own = own | _siblings()
        self._modules: dict[str, Module | None] = {}
        self._entered: set[str] = set()
        self._taken: dict[str, set[Piece]] = {}
        self._asked: dict[tuple[str, Chain], None] = {}
        self._given: set[str] = set()
        self._todo: list[tuple[str, Chain]] = []

    def follow(self, module: str, chain: Chain = ()) -> None:
        """Ask for `module.name` and on; without a name, for all of the module; it is imported."""
        self._given.add(module)
        self._ask(module, chain)

    def _ask(self, module: str, chain: Chain) -> None:
        if (module, chain) not in self._asked:
            self._asked[module, chain] = None
            self._todo.append((module, chain))

    def texts(self) -> dict[str, list[str]]:
        """What is reached, by module."""
        while self._todo:
            name, chain = self._todo.pop()
            module = self.module(name)
            if module is not None:
                self._enter(module)
                self._go(module, chain)
        modules = ((name, self.module(name), taken) for name, taken in self._taken.items())
        return {name: module.texts(taken) for name, module, taken in modules if module is not None}

    def values(self) -> Iterator[tuple[str, str, Any, list[Any]]]:
        """What is reached and no function reached assigns to: module, name, value; and the value the text says."""
        asked = {(name, chain[:1]) for name, chain in self._asked}
        for name in sorted(self._imported() & set(self._taken) & set(sys.modules)):
            module, taken, present = self.module(name), self._taken[name], vars(sys.modules[name])
            if module is None:
                continue
            changes = {own for piece in taken for own in piece.changes}
            imports = (ast.Import, ast.ImportFrom)
            every = {own for piece in taken if not isinstance(piece.node, imports) for own in piece.names}
            for own in sorted((every & set(present)) - changes):
                if (name, (own,)) in asked or (name, ()) in asked:
                    once = len(module.binders[own]) == 1
                    said = [piece.literals[own] for piece in module.binders[own] if own in piece.literals]
                    yield name, own, present[own], said if once else []

    def statement(self, module: Module, code: CodeType) -> list[str]:
        """Ask for the statement that holds the nested function of this code; the function itself."""
        self._given.add(module.name)
        self._enter(module)
        for piece in module.pieces:
            if first_line(piece.node) <= code.co_firstlineno <= (piece.node.end_lineno or 0):
                own = piece.within(code)
                if own:
                    self._take(module, piece)
                    return own
        self.follow(module.name)
        return []

    def module(self, name: str) -> Module | None:
        """The module of that name, unless it is a library's or has no source."""
        if name not in self._modules:
            file, folders = _find(name)
            readable = (file.endswith(".py") or (folders and not file)) and not self.library(name)
            self._modules[name] = _read(name, file, bool(folders)) if readable else None
        return self._modules[name]

    def library(self, name: str) -> bool:
        """Whether a module is another's."""
        if name.partition(".")[0] in self.own:
            return False
        file, folders = _find(name)
        return name in sys.builtin_module_names or installed((file, *folders)[0])

    def _imported(self) -> set[str]:
        """The modules reached that are imported for certain, and libraries."""
        found: set[str] = set()
        todo = [*self._given]
        while todo:
            name = todo.pop()
            if name in found:
                continue
            found.add(name)
            todo.append(name.rpartition(".")[0])
            module = self.module(name) if name in self._entered else None
            for piece in module.pieces if module is not None else ():
                if isinstance(piece.node, ast.Import):
                    todo += [alias.name for alias in piece.node.names]
                elif isinstance(piece.node, ast.ImportFrom):
                    for source, inner in (target for targets in piece.targets.values() for target in targets):
                        todo.append(source)
                        giver = self.module(source) if inner else None
                        if giver is not None and inner[0] not in giver.binders:
                            todo.append(f"{source}.{inner[0]}")
        return found

    def _stars(self, module: Module, name: str, passed: tuple[str, ...] = ()) -> list[str]:
        """The modules imported with a star that have the name."""
        passed, found = (*passed, module.name), []
        for source, _ in (target for piece in module.binders.get("*", ()) for target in piece.targets["*"]):
            giver = self.module(source) if source not in passed else None
            if giver is not None and giver.offers(name):
                has = name in giver.binders or self.module(f"{source}.{name}") is not None
                found += [source] if has or self._stars(giver, name, passed) else []
        return found

    def _go(self, module: Module, chain: Chain) -> None:
        stars = self._stars(module, chain[0]) if chain else []
        for source in stars:
            self._ask(source, chain)
        if chain and chain[0] in module.binders:
            for piece in module.binders[chain[0]]:
                self._take(module, piece, *chain)
        elif chain and self.module(f"{module.name}.{chain[0]}") is not None:
            self._ask(f"{module.name}.{chain[0]}", chain[1:])
        elif not stars:
            for piece in module.pieces:
                for name in sorted(piece.names) or [""]:
                    self._take(module, piece, name)

    def _enter(self, module: Module) -> None:
        """Take what a module and the packages above it do of themselves when they are imported."""
        if module.name not in self._entered:
            self._entered.add(module.name)
            above = self.module(module.name.rpartition(".")[0])
            if above is not None:
                self._enter(above)
            # What comes with a star is asked for by name.
            for piece in (*module.effects, *module.binders.get("*", ())):
                self._take(module, piece)

    def _take(self, module: Module, piece: Piece, name: str = "", *chain: str) -> None:
        """Take a piece and all it refers to; `name` was asked for, and of what that is, `chain`."""
        for target, inner in piece.targets.get(name, ()):
            self._ask(target, (*inner, *chain))
        taken = self._taken.setdefault(module.name, set())
        if piece in taken:
            return
        taken.add(piece)
        for use in piece.uses:
            for target, inner in piece.targets.get(use[0], ()):
                self._ask(target, (*inner, *use[1:]))
            if use[0] in module.binders or self._stars(module, use[0]):
                self._ask(module.name, use)


@cache
def installed(path: str) -> bool:
    """Whether a path lies among the libraries or in Python itself."""
    place = Path(path)
    if {"site-packages", "dist-packages"} & set(place.parts):
        return True
    return any(place.is_relative_to(sysconfig.get_path(kind)) for kind in ("stdlib", "platstdlib"))


@cache
def _siblings() -> frozenset[str]:
    """The packages installed together with this one, if it is installed at all."""
    own = __name__.partition(".")[0]
    if installed(__file__):
        for distribution in importlib.metadata.distributions():
            tops = (distribution.read_text("top_level.txt") or "").split()
            tops = tops or [file.parts[0] for file in distribution.files or () if file.suffix == ".py"]
            if own in tops:
                return frozenset(tops)
    return frozenset({own})


def _find(name: str) -> tuple[str, list[str]]:
    """File of a module, or "", and the folders of its submodules; no package above it is imported for that."""
    loaded, above = sys.modules.get(name), name.rpartition(".")[0]
    if loaded is not None:
        return getattr(loaded, "__file__", None) or "", list(getattr(loaded, "__path__", ()))
    try:
        spec = PathFinder.find_spec(name, _find(above)[1]) if above else importlib.util.find_spec(name)
    except (ImportError, ValueError, KeyError):  # KeyError: of a folder in a package that is not imported
        spec = None
    if spec is None:
        return "", []
    return (spec.origin or "" if spec.has_location else ""), list(spec.submodule_search_locations or ())


def _read(name: str, file: str, is_package: bool) -> Module | None:
    package = name if is_package else name.rpartition(".")[0]
    if name == "__main__":
        package = getattr(sys.modules[name], "__package__", None) or ""
    try:
        return _parse(name, package, file, Path(file).read_bytes() if file else b"")
    except OSError:
        return None


# By content: the clock of files is coarse.
_parse = cache(Module)
