"""Expressions over columns: a subset of Python's, parsed by `ast` and evaluated node by node.

Nodes outside of the allow-list are refused, and nothing is executed (`DataFrame.query` would). Comparisons with a
missing value are false, also !=; ``x == nan`` selects missing values, ``x != nan`` all others. Words may have
spaces or underscores. == of an axis and a number selects the nearest value of the axis (`studies.declaring.spec`).
"""

import ast
import math
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from operator import eq, ge, gt, le, lt, ne
from typing import Any

import numpy as np
import pandas as pd

from studies.declaring.parameters import suggest
from studies.declaring.spec import nearest
from studies.declaring.units import convert
from sweeps import InputError

BRIEF = 60
NUMBER, TEXT, TRUTH = "a number", "a text", "true or false"
GRAMMAR = "it may have names, SI numbers, 'texts', nan, == != < <= > >= in, and, or, not, + - * / // % ** and ()"
_OPERATORS: dict[type, Callable[..., Any]] = {
    **{ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide, ast.Pow: np.power},
    **{ast.FloorDiv: np.floor_divide, ast.Mod: np.mod, ast.USub: np.negative, ast.UAdd: np.positive},
    **{ast.Eq: eq, ast.NotEq: ne, ast.Lt: lt, ast.LtE: le, ast.Gt: gt, ast.GtE: ge},
    **{ast.And: np.logical_and, ast.Or: np.logical_or, ast.Not: np.logical_not},
}
_ALLOWED = (ast.Compare, ast.BoolOp, ast.UnaryOp, ast.BinOp, ast.Name, ast.Constant, ast.Load, *_OPERATORS)
_ALLOWED += (ast.Tuple, ast.List, ast.In, ast.NotIn)
_HINTS = {ast.BitAnd: "write and", ast.BitOr: "write or", ast.Call: "nothing can be called"}
# Signs of other languages, and what stands for them.
_FOREIGN = (
    *(("&&", r"&&", "and"), ("||", r"\|\|", "or"), ("!", r"!(?!=)", "not")),
    *(("=>", r"=>", ">="), ("=<", r"=<", "<="), ("<>", r"<>", "!=")),
)
_QUANTITY = re.compile(
    r"\b(\w+)\s*([=!<>]=|[<>])\s*(-?\d+\.?\d*(?:[eE]-?\d+)?)\s*(?!(?:and|or|in|not)\b)([A-Za-zµμ°%][\w/*^-]*)"
)


def parse(text: str, argument: str, units: Mapping[Any, str]) -> ast.expr:
    """Parse an expression; an error names the `argument` and, by the `units` of columns, a number with a unit."""
    start = f"{argument} = {str(text)[:BRIEF]!r}"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python's own, for example of '\d'
            tree = ast.parse(f"(\n{text}\n)", mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as problem:
        for name, sign, number, unit in _QUANTITY.findall(text):
            if name in units:
                value = f"{convert(float(number), unit, units[name], name):g}"
                advice = f"{name} is in {units[name].replace(' s-1', '/s')}: write {name} {sign} {value}"
                raise InputError(f"{start}: units cannot stand in a condition; {advice}") from None
        for sign, pattern, word in _FOREIGN:
            if re.search(pattern, text):
                raise InputError(f"{start}: write {word} in place of {sign}") from None
        alone = re.search(r"[^=!<>]=(?!=)", text)
        why = "to compare is ==" if alone else getattr(problem, "msg", "it cannot be read")
        why = "units cannot stand in a condition" if _QUANTITY.search(text) else why
        if re.search(r"\s(asc|desc)\w*$", text, re.IGNORECASE):
            why = "a minus before the name sorts descending"
        raise InputError(f"{start}: {why}; {GRAMMAR}") from None
    for node in ast.walk(tree):
        if not isinstance(node, _ALLOWED) or not isinstance(getattr(node, "value", 0), (int, float, str)):
            raise InputError(f"{start}: {_HINTS.get(type(node), f'no {type(node).__name__}')}; {GRAMMAR}")
    return tree


def names_in(*trees: ast.expr) -> list[str]:
    """Names of the columns in expressions."""
    names = [node.id for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Name)]
    return [name for name in dict.fromkeys(names) if name != "nan"]


def kind(value: Any) -> str:
    """The kind of a column or a value: NUMBER, TEXT or TRUTH."""
    dtype = value.dtype if isinstance(value, pd.Series) else np.asarray(value).dtype
    return {"b": TRUTH, "O": TEXT, "U": TEXT}.get(dtype.kind, NUMBER)


@dataclass(frozen=True)
class Evaluator:
    """Values of expressions over `columns`; equality finds the nearest value of `axes`, or calls `note`."""

    columns: Any
    axes: Mapping[str, Any]
    argument: str
    note: Callable[[str], None] = lambda text: None

    def __call__(self, node: ast.expr, expected: str | None = None) -> Any:
        """Evaluate to a series or one value, of the expected kind."""
        try:
            with np.errstate(all="ignore"):
                value = self._value(node)
        except (RecursionError, OverflowError):
            raise InputError(f"{self.argument}: too many levels, or too large a number; {GRAMMAR}") from None
        if expected and kind(value) != expected:
            advice = "; compare it with a value, the whole in quotes: 'mu > 0.2'" * (expected == TRUTH)
            raise self._wrong(node, f"it is {kind(value)}, and must be {expected}{advice}")
        # Whole numbers would overflow.
        return value.astype(float) if expected == NUMBER and isinstance(value, pd.Series) else value

    def _value(self, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=constant):
                return constant if isinstance(constant, (bool, str)) else float(constant)  # type: ignore[arg-type]
            case ast.Name(id=name):
                return math.nan if name == "nan" else self.columns[name]
            case ast.UnaryOp(op=sign):
                return _OPERATORS[type(sign)](self(node.operand, TRUTH if isinstance(sign, ast.Not) else NUMBER))
            case ast.BinOp(op=sign):
                return _OPERATORS[type(sign)](self(node.left, NUMBER), self(node.right, NUMBER))
            case ast.BoolOp(op=sign):
                return reduce(_OPERATORS[type(sign)], [self(part, TRUTH) for part in node.values])
            case ast.Compare():
                pairs = zip([node.left, *node.comparators], node.ops, node.comparators, strict=False)
                return reduce(np.logical_and, [self._compare(*pair) for pair in pairs])
        raise self._wrong(node, "a list can only stand after in, like mu in (0.1, 0.2)")

    def _compare(self, left: ast.expr, sign: ast.cmpop, right: ast.expr) -> Any:
        if isinstance(sign, (ast.In, ast.NotIn)):
            if not isinstance(right, (ast.Tuple, ast.List)) or not right.elts:
                raise self._wrong(right, "in needs a list, like (0.1, 0.2), or (0.1,) for one value")
            equal, join = (ast.Eq(), np.logical_or) if isinstance(sign, ast.In) else (ast.NotEq(), np.logical_and)
            return reduce(join, [self._compare(left, equal, part) for part in right.elts])
        # Beside a Python float, single precision is compared in single precision.
        a, b = (float(value) if isinstance(value, float) else value for value in (self(left), self(right)))
        equality = isinstance(sign, (ast.Eq, ast.NotEq))
        absent = [isinstance(value, float) and math.isnan(value) for value in (a, b)]
        if equality and any(absent):
            missing = pd.isna(b if absent[0] else a)
            return missing if isinstance(sign, ast.Eq) else np.logical_not(missing)
        if kind(a) != kind(b) or (not equality and kind(a) != NUMBER):
            raise self._wrong(left, f"it is {kind(a)}, and cannot be compared so with {kind(b)}")
        if equality:
            a, b = self._meant(a, right, b), self._meant(b, left, a)
        if kind(a) == TEXT and isinstance(a, pd.Series) and isinstance(b, pd.Series):
            a, b = a.astype(object), b.astype(object)  # categories of two columns differ
        return _OPERATORS[type(sign)](a, b) & pd.notna(a) & pd.notna(b)

    def _meant(self, value: Any, node: ast.expr, column: Any) -> Any:
        """Replace a value by the word of a column, or by the nearest value of an axis."""
        if isinstance(value, str) and hasattr(column, "cat"):
            words, spaced = [*column.cat.categories], value.replace("_", " ")
            if same := [word for word in words if word.replace("_", " ") == spaced]:
                return same[0]
            hint = f"{suggest(spaced, words)}its words are {', '.join(words[:20])}"
            raise self._wrong(node, f"it is never {value!r}; {hint}")
        if isinstance(value, float) and isinstance(node, ast.Name) and np.size(self.axes.get(node.id, ())):
            found, is_near = nearest(self.axes[node.id], value)
            if is_near:
                return found
            self.note(f"{node.id} has no value {value:.15g}; the nearest is {found:.15g}")
        return value

    def _wrong(self, node: ast.expr, why: str) -> InputError:
        return InputError(f"{self.argument} = {ast.unparse(node)[:BRIEF]!r}: {why}")
