"""Meaning of an expression for the columns of a result, and its value for every row.

A comparison with a value that is missing is false, with != too; `x == nan` is true where x is missing, and
`x != nan` where it is not. ``x in (a, b)`` means ``x == a or x == b``, ``x not in (a, b)`` ``x != a and x != b``.
Words may be written with spaces or with underscores. Equality between an axis and a number asks for the axis's
nearest value (`studies.query.nearest`).
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.query.columns import NUMBER, TEXT, WORDS, Column, Columns, spaced
from studies.query.language import Expression, is_number, parse, shortened
from studies.query.nearest import nearest

# The largest power, of either sign.
MOST_POWER = 100.0
TRUTH, MISSING = "truth", "missing"

Values = Mapping[str, NDArray[Any]]
Evaluate = Callable[[Values], Any]
Note = Callable[[str], None]

_ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: np.divide,
    ast.Pow: np.power,
}
_COMPARISONS: dict[type[ast.cmpop], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Eq: ("==", operator.eq),
    ast.NotEq: ("!=", operator.ne),
    ast.Lt: ("<", operator.lt),
    ast.LtE: ("<=", operator.le),
    ast.Gt: (">", operator.gt),
    ast.GtE: (">=", operator.ge),
}
_KINDS = {
    NUMBER: "a number",
    TEXT: "a text",
    WORDS: "a word",
    TRUTH: "true or false",
    MISSING: "the missing value",
}


@dataclass(frozen=True, eq=False)
class Term:
    """A part of an expression with its meaning.

    Attributes
    ----------
    kind : str
        NUMBER, TEXT, WORDS, TRUTH or MISSING.
    text : str
        As it was written.
    evaluate : callable
        From the values of columns, arrays that broadcast, to an array or a scalar.
    column : Column, optional
        Where it is one and nothing else.
    constant : float or str, optional
        Where it is one.
    """

    kind: str
    text: str
    evaluate: Evaluate
    column: Column | None = None
    constant: float | str | None = None

    def shown(self, values: Values) -> Any:
        """Its values; words in place of codes, and NaN where there is none."""
        own = self.evaluate(values)
        return own if self.column is None else self.column.shown(own)

    @property
    def brief(self) -> str:
        """Its text in one line, for a message."""
        return shortened("".join(letter if letter.isprintable() else " " for letter in self.text))

    @property
    def described(self) -> str:
        """Its text and kind, for a message."""
        return f"{self.brief} is {_KINDS[self.kind]}"

    @property
    def example(self) -> str:
        """A comparison with it, for a message."""
        words = self.column.words if self.column else None
        value = repr(next(iter(words.values()))) if words else {TEXT: "'text'"}.get(self.kind, "0")
        return f"{self.brief} == {value}"


def condition(expression: Expression, columns: Mapping[str, Column], note: Note, part: ast.expr) -> Evaluate:
    """Make a function that chooses rows from the values of columns by name, arrays that broadcast.

    `columns` has every name that stands in it; `note` is called with a sentence on a value that no axis has.

    Raises
    ------
    ValueError
        If it is not true or false, or its parts do not go together; the message shows which.
    """
    term = _Meaning(expression, columns, note).of(part)
    if term.kind != TRUTH:
        raise expression.wrong(part, f"it is {_KINDS[term.kind]}; compare it, like {term.example}")
    return _quietly(term.evaluate)


def column(every: Columns, text: str, argument: str) -> Column:
    """The column of a name, or one that an expression calculates: of numbers, or of what is true or false.

    `argument` says in a message whose value it is.

    Raises
    ------
    ValueError
        If it is neither.
    """
    if text in every.names or text.isidentifier():
        return every.find(text, argument)
    expression = parse(text, argument)
    inputs = {name: every.find(name, argument) for name in expression.names()}
    term = _Meaning(expression, inputs, every.note).of(expression.tree)
    if term.column is not None:
        return term.column
    if term.kind not in (NUMBER, TRUTH):
        raise expression.wrong(
            expression.tree, f"it is {_KINDS[term.kind]}; a column has a name, or is calculated"
        )
    dims = tuple(str(dim) for dim in every.dataset.sizes if any(dim in each.dims for each in inputs.values()))
    calculate = _quietly(term.evaluate)
    return Column(expression.text, term.kind, dims, inputs=tuple(inputs.values()), calculate=calculate)


def _quietly(evaluate: Evaluate) -> Evaluate:
    """The same without warnings of NumPy: what has no value becomes NaN."""

    def evaluated(values: Values) -> Any:
        with np.errstate(all="ignore"):
            return evaluate(values)

    return evaluated


class _Meaning:
    """Gives each node of an expression its kind and what evaluates it."""

    def __init__(self, expression: Expression, columns: Mapping[str, Column], note: Note) -> None:
        self.expression, self.columns, self.note = expression, columns, note

    def of(self, node: ast.expr) -> Term:
        """The meaning of one node."""
        text = self.expression.part(node)
        match node:
            case ast.Constant(value=str()):
                return Term(TEXT, text, lambda values: text[1:-1], None, text[1:-1])
            case ast.Constant():
                return _constant(float(text), text)
            case ast.Name(id="nan"):
                return Term(MISSING, text, lambda values: np.nan)
            case ast.Name(id=name):
                column = self.columns[name]
                return Term(column.kind, text, lambda values: values[name], column)
            case ast.UnaryOp(op=ast.Not()):
                inner = self._truth(node.operand, node, "not")
                return Term(TRUTH, text, lambda values: np.logical_not(inner.evaluate(values)))
            case ast.UnaryOp():
                number = self._number(node.operand, node)
                sign = -1.0 if isinstance(node.op, ast.USub) else 1.0
                return _numeric(text, lambda values: sign * _wide(number.evaluate(values)), [number])
            case ast.BinOp():
                return self._arithmetic(node)
            case ast.BoolOp():
                word, join = ("and", np.logical_and) if isinstance(node.op, ast.And) else ("or", np.logical_or)
                terms = [self._truth(each, node, word) for each in node.values]
                return Term(TRUTH, text, lambda values: reduce(join, (term.evaluate(values) for term in terms)))
            case ast.Compare():
                return self._chain(node)
        raise self.expression.wrong(node, "a list has its place after in, like mu in (0.1, 0.2)")

    def _truth(self, node: ast.expr, whole: ast.expr, word: str) -> Term:
        term = self.of(node)
        if term.kind != TRUTH:
            why = f"{term.described}; {word} is for what is true or false, like {term.example}"
            raise self.expression.wrong(whole, why)
        return term

    def _number(self, node: ast.expr, whole: ast.expr) -> Term:
        term = self.of(node)
        if term.kind != NUMBER:
            raise self.expression.wrong(whole, f"{term.described}; only numbers can be calculated with")
        return term

    def _arithmetic(self, node: ast.BinOp) -> Term:
        # A long sum leans to the left, node within node; it is read without recursion.
        steps: list[tuple[type[ast.operator], Term]] = []
        first: ast.expr = node
        while isinstance(first, ast.BinOp):
            right = self._number(first.right, first)
            if isinstance(first.op, ast.Pow) and not (
                isinstance(right.constant, float) and abs(right.constant) <= MOST_POWER
            ):
                limits = f"from -{MOST_POWER:g} to {MOST_POWER:g}"
                raise self.expression.wrong(first, f"the power {right.brief} must be a number {limits}")
            steps.append((type(first.op), right))
            first = first.left
        start = self._number(first, node)
        steps.reverse()

        def calculated(values: Values) -> Any:
            result = _wide(start.evaluate(values))
            for kind, term in steps:
                result = _ARITHMETIC[kind](result, _wide(term.evaluate(values)))
            return result

        return _numeric(self.expression.part(node), calculated, [start, *(term for _, term in steps)])

    def _chain(self, node: ast.Compare) -> Term:
        pairs = []
        left = self.of(node.left)
        for sign, comparator in zip(node.ops, node.comparators, strict=True):
            if isinstance(sign, (ast.In, ast.NotIn)):
                pairs.append(self._member(node, left, sign, comparator))
                if comparator is not node.comparators[-1]:
                    raise self.expression.wrong(node, "nothing is compared with a list; join comparisons by and")
                continue
            right = self.of(comparator)
            pairs.append(self._compared(node, left, type(sign), right))
            left = right
        text = self.expression.part(node)
        return Term(TRUTH, text, lambda values: reduce(np.logical_and, (pair(values) for pair in pairs)))

    def _member(self, node: ast.Compare, left: Term, sign: ast.In | ast.NotIn, members: ast.expr) -> Evaluate:
        """Whether a value is one of a list."""
        if not (isinstance(members, ast.Tuple) and members.elts):
            why = "like (0.1, 0.2); one of a single value has a comma too: (0.1,)"
            raise self.expression.wrong(node, f"after in comes a list in brackets, {why}")
        inside = isinstance(sign, ast.In)
        kind, join = (ast.Eq, np.logical_or) if inside else (ast.NotEq, np.logical_and)
        pairs = [self._compared(node, left, kind, self.of(each)) for each in members.elts]
        return lambda values: reduce(join, (pair(values) for pair in pairs))

    def _compared(self, node: ast.Compare, left: Term, kind: type[ast.cmpop], right: Term) -> Evaluate:
        """The function that compares two neighbours in a comparison."""
        kinds = {left.kind, right.kind}
        sign, compare = _COMPARISONS[kind]
        one, other = (right, left) if left.column is None else (left, right)
        wrong = self.expression.wrong
        if TRUTH in kinds:
            truth = left if left.kind == TRUTH else right
            raise wrong(node, f"{truth.brief} is true or false already; join it by and, or")
        if sign not in ("==", "!=") and kinds != {NUMBER}:
            why = "only numbers are above or below each other; other values are compared by == and !="
            raise wrong(node, why)
        if MISSING in kinds:
            present = left if right.kind == MISSING else right
            if present.kind in (TEXT, MISSING):
                raise wrong(node, "nan is a missing number or word; of texts the empty one is ''")
            return _missing(present, sign)
        axis = one.column if one.column is not None and one.column.axis else None
        if kinds == {NUMBER}:
            if axis is not None and sign in ("==", "!=") and isinstance(other.constant, float):
                return self._at(axis, sign, other.constant, f"{left.brief} {sign} {right.brief}")
        elif NUMBER in kinds:
            raise wrong(node, _unlike(left, right))
        elif one.column is not None and isinstance(other.constant, str):
            text, words = other.constant, one.column.words
            if words is not None:
                text = spaced(text)
                if text not in words.values():
                    near = _near(text, list(words.values()))
                    raise wrong(node, f"{one.column.name} is never {other.constant!r}; {near}")
            elif axis is not None and sign == "==":
                self._note_text(axis, text)
            left, right = one, Term(TEXT, other.text, lambda values: text)
        return _comparison(left, compare, right)

    def _note_text(self, axis: Column, text: str) -> None:
        texts = np.ravel(np.asarray(axis.values)).tolist()
        if text not in texts:
            self.note(f"{axis.name} == {text!r}: {axis.name} has no such value; {_near(text, texts)}")

    def _at(self, column: Column, sign: str, number: float, text: str) -> Evaluate:
        """Where an axis has the value nearest to a number, if that is near enough."""
        assert column.values is not None
        value, near = nearest(column.values, number) if column.values.size else (np.nan, False)
        if not near and sign == "==":
            self.note(f"{text}: {column.name} has no such value; the nearest is {value:.15g}")
        compare = operator.eq if sign == "==" else operator.ne
        return lambda values: compare(values[column.name], value if near else np.nan)


def _constant(value: float, text: str) -> Term:
    return Term(NUMBER, text, lambda values: value, None, value)


def _numeric(text: str, evaluate: Evaluate, terms: list[Term]) -> Term:
    """A number; a constant where all that it is made of is constant."""
    if all(isinstance(term.constant, float) for term in terms):
        with np.errstate(all="ignore"):
            return _constant(float(evaluate({})), text)
    return Term(NUMBER, text, evaluate)


def _wide(values: Any) -> Any:
    """Numbers to calculate with: whole ones would overflow, and divide by zero with an error."""
    return np.asarray(values, dtype=float)


def _comparison(left: Term, compare: Callable[[Any, Any], Any], right: Term) -> Evaluate:
    """Where two terms compare so: NaN is unequal to everything, but nothing is known of what is missing."""

    def compared(values: Values) -> Any:
        a, b = left.shown(values), right.shown(values)
        result = np.asarray(compare(a, b), dtype=bool)
        return result & (a == a) & (b == b) if compare is operator.ne else result

    return compared


def _missing(one: Term, sign: str) -> Evaluate:
    """Where a term has no value, or has one."""

    def compared(values: Values) -> Any:
        own = one.shown(values)
        return np.asarray(own != own if sign == "==" else own == own, dtype=bool)

    return compared


def _unlike(left: Term, right: Term) -> str:
    """Why a number and something else cannot be compared."""
    one, number = (right, left) if left.kind == NUMBER else (left, right)
    if one.column is not None and one.column.words is not None:
        words = ", ".join(map(repr, one.column.words.values()))
        return f"{one.brief} is a word and {number.brief} a number; its words are {words}"
    hint = f"; without quotes {one.constant} is a number" if is_number(str(one.constant)) else ""
    return f"{one.brief} is a text and {number.brief} a number{hint}"


def _near(text: str, values: list[str]) -> str:
    from studies.study import suggest

    listed = ", ".join(values[:20]) + (", ..." if len(values) > 20 else "")
    return f"{suggest(spaced(text), values)}its values are {listed}"
