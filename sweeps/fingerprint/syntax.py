"""What of a statement's syntax counts when code is compared, and what does not."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from typing import Any

# The names of an expression such as module.name.attribute.
Chain = tuple[str, ...]

DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
# Fields of a tree that change nothing: whether a name is read or written shows in its place.
UNTOLD = ("ctx", "kind", "type_comment", "type_params")


def dumped(node: Any) -> str:
    """A syntax tree as text, the same in every version of Python that knows its statements."""
    if isinstance(node, ast.AST):
        # What a later version adds is empty where an earlier one could be.
        told = ((name, getattr(node, name, None)) for name in node._fields if name not in UNTOLD)
        inside = ",".join(f"{name}={dumped(value)}" for name, value in told if value is not None and value != [])
        return f"{type(node).__name__}({inside})"
    if isinstance(node, list):
        return f"[{','.join(map(dumped, node))}]"
    return repr(node)


def first_line(node: ast.AST) -> int:
    """Of a definition, decorators included."""
    parts = [node, *getattr(node, "decorator_list", ())]
    return min(getattr(part, "lineno", 0) for part in parts)


def blocks(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """Where a statement holds others: in which node, in which field of it."""
    for field in ("body", "orelse", "finalbody"):
        if getattr(node, field, None):
            yield node, field
    for part in (*getattr(node, "handlers", ()), *getattr(node, "cases", ())):
        yield part, "body"


def bare(body: list[ast.stmt], in_class: bool = False) -> list[ast.stmt]:
    """The statements that do something: no docstrings, no annotations of functions, nothing for type checkers."""
    kept: list[ast.stmt] = []
    for node in body:
        if isinstance(node, ast.Pass) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            continue
        if isinstance(node, ast.If):
            test, negated = node.test, isinstance(node.test, ast.UnaryOp) and isinstance(node.test.op, ast.Not)
            test = test.operand if isinstance(test, ast.UnaryOp) and negated else test
            if "TYPE_CHECKING" in (getattr(test, "id", ""), getattr(test, "attr", "")):
                kept += bare(node.body if negated else node.orelse, in_class)
                continue
        if isinstance(node, ast.AnnAssign) and not in_class:
            # A dataclass lives on its annotations; elsewhere nothing does.
            if node.value is not None:
                kept.append(ast.copy_location(ast.Assign([node.target], node.value), node))
            continue
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            node.returns = None
            every = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
            for argument in (*every, node.args.vararg, node.args.kwarg):
                if argument is not None:
                    argument.annotation = None
        inside = isinstance(node, ast.ClassDef) or (in_class and not isinstance(node, DEFINITIONS))
        for owner, field in blocks(node):
            setattr(owner, field, bare(getattr(owner, field), inside))
        kept.append(node)
    return kept


def bound(node: ast.AST) -> Iterator[str]:
    """Names that a top-level statement binds, or whose entries or attributes it sets."""
    if isinstance(node, DEFINITIONS):
        yield node.name
    elif isinstance(node, (ast.Import, ast.ImportFrom)):
        for alias in node.names:
            yield alias.asname or (alias.name.partition(".")[0] if isinstance(node, ast.Import) else alias.name)
    elif isinstance(node, ast.Name):
        if not isinstance(node.ctx, ast.Load):
            yield node.id
    elif isinstance(node, (ast.Attribute, ast.Subscript)) and not isinstance(node.ctx, ast.Load):
        base: ast.AST = node
        while isinstance(base, (ast.Attribute, ast.Subscript)):
            base = base.value
        if isinstance(base, ast.Name):
            yield base.id
    elif not isinstance(node, ast.Lambda):
        for name in (getattr(node, "name", None), getattr(node, "rest", None)):  # of a pattern or a handler
            if isinstance(name, str):
                yield name
        for child in ast.iter_child_nodes(node):
            # The variable of a comprehension is its own.
            if not (isinstance(node, ast.comprehension) and child is node.target):
                yield from bound(child)


def references(node: ast.AST) -> tuple[list[Chain], list[ast.Import | ast.ImportFrom], set[str]]:
    """What a top-level statement refers to in its module, its imports, and what it changes there when it runs.

    Changed are the names that its functions declare as global, or whose entries or attributes they set.
    """
    uses: dict[Chain, None] = {}
    imports: list[ast.Import | ast.ImportFrom] = []
    changes: set[str] = set()
    # With the names that the functions around keep to themselves; at the top there are no functions.
    todo: list[tuple[ast.AST, frozenset[str] | None]] = [(node, None)]
    while todo:
        node, hidden = todo.pop()
        if hidden is not None:
            changes |= _changed(node) - hidden
        chain: Chain = ()
        while isinstance(node, ast.Attribute):
            chain, node = (node.attr, *chain), node.value
        if isinstance(node, ast.Name):
            if (chain or isinstance(node.ctx, ast.Load)) and node.id not in (hidden or ()):
                uses[(node.id, *chain)] = None
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            imports.append(node)
        elif isinstance(node, ast.Global):
            uses |= {(name,): None for name in node.names}
        elif isinstance(node, (*FUNCTIONS, *COMPREHENSIONS)):
            around, within, own = _scope(node)
            todo += [(part, hidden) for part in around]
            shared = {name for part in ast.walk(node) if isinstance(part, ast.Global) for name in part.names}
            todo += [(part, ((hidden or frozenset()) | own) - shared) for part in within]
        else:
            todo += [(part, hidden) for part in ast.iter_child_nodes(node)]
    return list(uses), imports, changes


def _changed(node: ast.AST) -> set[str]:
    if isinstance(node, ast.Global):
        return {*node.names}
    if isinstance(node, ast.keyword) and node.arg == "out":
        return {part.id for part in ast.walk(node.value) if isinstance(part, ast.Name)}
    part_of = isinstance(node, (ast.Attribute, ast.Subscript)) and not isinstance(node.ctx, ast.Load)
    return {*bound(node)} if part_of else set()


def _scope(node: Any) -> tuple[list[ast.AST], list[ast.AST], set[str]]:
    """Of a function or comprehension: what is evaluated around it, what within, and names that are its own.

    A name that is imported is followed from there, so it is none of these.
    """
    own: set[str] = set()
    around: list[ast.AST]
    within: list[ast.AST]
    if isinstance(node, COMPREHENSIONS):
        first = node.generators[0]
        parts = [part for part in ast.iter_child_nodes(node) if part is not first]
        todo: list[ast.AST] = [each.target for each in node.generators]
        around, within = [first.iter], [*parts, *first.ifs, first.target]
    else:
        todo = [*node.body] if isinstance(node.body, list) else [node.body]
        defaults = [each for each in (*node.args.defaults, *node.args.kw_defaults) if each is not None]
        around, within = [*getattr(node, "decorator_list", ()), *defaults], [*todo]
        own = {part.arg for part in ast.walk(node.args) if isinstance(part, ast.arg)}
        # An argument of a lambda among the defaults is not one of the function's.
        own -= {part.arg for each in defaults for part in ast.walk(each) if isinstance(part, ast.arg)}
    while todo:
        part = todo.pop()
        if isinstance(part, ast.Name) and not isinstance(part.ctx, ast.Load):
            own.add(part.id)
        elif isinstance(part, DEFINITIONS):
            own.add(part.name)
        elif not isinstance(part, (ast.Lambda, *COMPREHENSIONS, ast.alias)):
            # Of a pattern or a handler.
            own |= {name for field in ("name", "rest") if isinstance(name := getattr(part, field, None), str)}
            todo += ast.iter_child_nodes(part)
    return around, within, own


def acts(node: ast.AST) -> bool:
    """Whether a statement does something besides binding names."""
    if isinstance(node, DEFINITIONS) or (isinstance(node, ast.If) and "__name__" in ast.dump(node.test)):
        return False
    inner = (child for owner, field in blocks(node) for child in getattr(owner, field))
    return isinstance(node, ast.Expr) or any(map(acts, inner))
