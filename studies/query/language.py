"""Expressions over the columns of a result: a small part of Python's, read by Python's own parser.

There are comparisons (also ``0.1 < mu < 0.2`` and ``mu in (0.1, 0.2)``), ``and``, ``or``, ``not``, + - * / **,
brackets, numbers, texts, ``nan`` and names. `ast` parses an expression, every other type of node is refused, and
`studies.query.evaluate` walks what is left over NumPy arrays: nothing is compiled or run. `DataFrame.query`,
numexpr and SQL engines are not used, because what they read may execute code or open files.

A text is in single or double quotes, holds no quote of its kind, and knows no escapes. The page's filter
(`studies/report/filter.js`) speaks the same language; `tests/studies/query/expressions.json` holds both to it.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate

from sweeps import InputError

# The most letters; the most brackets, and the most signs, powers and nots, within each other; the letters of an
# expression that a message shows.
LONGEST, DEEPEST, SHOWN = 4000, 40, 60

GRAMMAR = (
    "an expression is of names, numbers, 'texts', nan, comparisons (== != < <= > >= in), and, or, not, + - * / ** "
    "and brackets"
)
# What people write who know other languages.
HINTS = {
    "=": "to compare is ==",
    "&": "write and",
    "|": "write or",
    "!": "write not, or != to compare",
    "^": "a power is **",
    "~": "write not",
    "[": 'nothing can be indexed; a list is in round brackets, like regime in ("stuck", "periodic")',
    "'": "a text ends with the quote that it began with",
    '"': "a text ends with the quote that it began with",
    ast.Call: "nothing can be called",
    ast.Attribute: "there are no attributes",
    ast.FloorDiv: "there is no //",
    ast.Is: "to compare is ==",
    ast.IsNot: "to compare is !=",
}

_PARTS = (
    ast.expr,
    *(ast.And, ast.Or, ast.Not, ast.USub, ast.UAdd, ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow),
    *(ast.Eq, ast.NotEq, ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.In, ast.NotIn, ast.Load),
)
_NUMBER = r"(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_TEXT = re.compile(r"'[^'\r\n]*'|\"[^\"\r\n]*\"")
# Of what is no text: a number of another form, a sign that stands for nothing, or = and ! alone.
_STRANGE = re.compile(
    rf"(?<![\w.])(?=\.?[0-9])(?!{_NUMBER}(?![\w.]))[\w.]+"
    r"|[^\w \t\r\n.,+\-*/()<>=!]"
    r"|(?<![=!<>])=(?!=)|!(?!=)"
)


@dataclass(frozen=True, eq=False)
class Expression:
    """An expression that was parsed.

    Attributes
    ----------
    text : str
        As it was written, without space at its ends.
    argument : str
        Whose value it is, for messages.
    tree : ast.expr
        Of the types of node that the language has.
    """

    text: str
    argument: str
    tree: ast.expr
    _bytes: bytes

    def span(self, node: ast.expr) -> tuple[int, int]:
        """Where a node begins and ends, without the brackets around it, in letters; `ast` counts bytes."""
        start, end = (len(self._bytes[:offset].decode()) for offset in (node.col_offset, node.end_col_offset))
        return start, end

    def part(self, node: ast.expr) -> str:
        """The text of a node."""
        return self.text[slice(*self.span(node))]

    def wrong(self, node: ast.expr, why: str) -> InputError:
        """An error of what a node means."""
        return InputError(f"{self.argument} = {shortened(self.part(node))!r}: {why}")

    def names(self, node: ast.expr | None = None) -> list[str]:
        """Every name in it, or in a part of it, once."""
        names = (each.id for each in ast.walk(node or self.tree) if isinstance(each, ast.Name))
        return [name for name in dict.fromkeys(names) if name != "nan"]

    def speaks_of_missing(self) -> bool:
        """Whether `nan` stands anywhere in it."""
        return any(isinstance(each, ast.Name) and each.id == "nan" for each in ast.walk(self.tree))


def parse(text: str, argument: str = "where") -> Expression:
    """Read an expression.

    Parameters
    ----------
    text : str
    argument : str
        Whose value it is, for messages.

    Raises
    ------
    ValueError
        If it is none; the message shows the place.
    """
    if not isinstance(text, str):
        raise InputError(f"{argument} = {text!r}: it must be a text; {GRAMMAR}")
    if len(text) > LONGEST:
        raise InputError(f"{argument} = {text[:SHOWN]!r}...: it has {len(text)} letters; it may have {LONGEST}")
    text = text.strip(" \t\r\n")
    bare = _without_texts(text)
    if strange := _STRANGE.search(bare):
        raise _misplaced(text, argument, *strange.span(), HINTS.get(strange[0], ""))
    depths = _depths(bare)
    if max(depths, default=0) > DEEPEST:
        raise _too_deep(text, argument)
    # On one line, and with texts that hold nothing which means something to Python.
    plain = _TEXT.sub(lambda match: match[0][0] + "_" * (len(match[0]) - 2) + match[0][0], text)
    plain = re.sub(r"[\t\r\n]", " ", plain)
    try:
        tree = ast.parse(plain, mode="eval").body
    except SyntaxError as problem:
        start, end = (problem.offset or len(text) + 1) - 1, (problem.end_offset or 0) - 1
        # Of a bracket that does not end Python shows the beginning.
        unclosed = text[start : start + 1] == "(" and depths[-1] > 0
        raise _misplaced(text, argument, len(text) if unclosed else start, end) from None
    except (RecursionError, MemoryError):
        raise _too_deep(text, argument) from None
    expression = Expression(text, argument, tree, plain.encode())
    for node, depth in _walk(tree):
        if kind := _refused(node, expression.part(node)):
            raise _misplaced(text, argument, *_spot(expression, node), HINTS.get(kind, ""))
        if depth > DEEPEST:
            raise _too_deep(text, argument)
    return expression


def is_number(text: str) -> bool:
    """Whether it is one that an expression may have, without a sign."""
    return re.fullmatch(_NUMBER, text) is not None


def shortened(text: str) -> str:
    """Shorten a part of an expression for a message."""
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."


def split(text: str) -> list[str]:
    """The entries of a list: at commas outside of brackets and texts."""
    bare = _without_texts(text)
    cuts = [k for k, depth in enumerate(_depths(bare)) if bare[k] == "," and depth == 0]
    return [text[a:b].strip() for a, b in zip([0, *(cut + 1 for cut in cuts)], [*cuts, None], strict=True)]


def _without_texts(text: str) -> str:
    """The same letters at the same places, and blanks where texts are."""
    return _TEXT.sub(lambda match: " " * len(match[0]), text)


def _depths(text: str) -> list[int]:
    """How many brackets are open after each letter."""
    return list(accumulate((letter == "(") - (letter == ")") for letter in text))


def _walk(tree: ast.expr) -> Iterator[tuple[ast.expr, int]]:
    """Every node, from the whole to its parts, and how many signs, powers and nots it is within."""
    stack = [(tree, 0)]
    while stack:
        node, depth = stack.pop()
        yield node, depth
        power = node.right if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow) else None
        inside = isinstance(node, ast.UnaryOp)
        parts = (child for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr))
        stack.extend((part, depth + (inside or part is power)) for part in parts)


def _refused(node: ast.expr, part: str) -> type[ast.AST] | None:
    """The type of what the language does not have, if a node is that or has such an operator."""
    if isinstance(node, ast.Constant):
        good = bool(_TEXT.fullmatch(part)) or is_number(part)
    elif isinstance(node, ast.Name):
        # Python takes letters of other widths for those that they look like.
        good = node.id == part
    else:
        good = isinstance(node, (ast.BoolOp, ast.UnaryOp, ast.BinOp, ast.Compare, ast.Tuple))
    if not good:
        return type(node)
    return next((type(each) for each in ast.iter_child_nodes(node) if not isinstance(each, _PARTS)), None)


def _spot(expression: Expression, node: ast.expr) -> tuple[int, int]:
    """Where what is wrong with a node stands: behind its first part, if it begins with one."""
    start, end = expression.span(node)
    # From Python 3.12 on an f-string has parts of their own places.
    inside = [] if isinstance(node, ast.JoinedStr) else ast.iter_child_nodes(node)
    parts = [expression.span(part) for part in inside if isinstance(part, ast.expr)]
    behind = min(parts)[1] if parts else end
    behind += len(expression.text[behind:]) - len(expression.text[behind:].lstrip(" )"))
    return (behind, end) if behind < end else (start, end)


def _misplaced(text: str, argument: str, start: int, end: int, hint: str = "") -> InputError:
    """An error of what stands from one letter to another."""
    part = text[start : max(end, start + 1)]
    if part:
        odd = ", ".join(f"U+{ord(letter):04X}" for letter in shortened(part) if not letter.isascii())
        what = f"unexpected {shortened(part)!r}{f' ({odd})' if odd else ''} at column {start + 1}"
    else:
        what = "something is missing at its end" if text else "it is empty"
    begin = max(min(start - SHOWN // 2, len(text) - SHOWN), 0)
    shown = f"{'...' if begin else ''}{text[begin : begin + SHOWN]!r}{'...' if begin + SHOWN < len(text) else ''}"
    return InputError(f"{argument} = {shown}: {what}; {hint}{'; ' if hint else ''}{GRAMMAR}")


def _too_deep(text: str, argument: str) -> InputError:
    return InputError(f"{argument} = {shortened(text)!r}: more than {DEEPEST} levels are within each other")
