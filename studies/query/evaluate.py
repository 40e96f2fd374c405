"""How two parts of an expression are compared: numbers, words that codes stand for, texts, and what is missing.

A comparison with a value that is missing is false, with != too; `x == nan` is true where x is missing, and
`x != nan` where it is not. Words may be written with spaces or with underscores. Equality between an axis and a
number asks for the axis's nearest value (`studies.query.nearest`).
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.query.columns import NUMBER, TEXT, WORDS, Column, spaced
from studies.query.language import SHOWN
from studies.query.nearest import nearest
from studies.query.tree import Node

TRUTH, MISSING = "truth", "missing"

Values = Mapping[str, NDArray[Any]]
Evaluate = Callable[[Values], Any]
_COMPARISONS: dict[str, Callable[[Any, Any], Any]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


@dataclass(frozen=True, eq=False)
class Term:
    """A part of an expression that is understood.

    Attributes
    ----------
    kind : str
        NUMBER, TEXT, WORDS, TRUTH or MISSING.
    said : str
        As it was written.
    evaluate : callable
        From the values of columns, arrays that broadcast, to an array or a scalar.
    column : Column, optional
        Where it is one and nothing else.
    constant : float or str, optional
        Where it is one.
    """

    kind: str
    said: str
    evaluate: Evaluate
    column: Column | None = None
    constant: float | str | None = None


def compared(node: Node, left: Term, sign: str, right: Term, note: Callable[[str], None]) -> Evaluate:
    """What compares two neighbours in a comparison.

    Parameters
    ----------
    node : Node
        All of the comparison, to be shown in messages.
    left, right : Term
    sign : str
    note : callable
        Told, in a sentence, of a value that no axis has.

    Raises
    ------
    ValueError
        If they cannot be compared.
    """
    kinds = {left.kind, right.kind}
    equality = sign in ("==", "!=")
    one, other = (right, left) if left.column is None else (left, right)
    if TRUTH in kinds:
        truth = left if left.kind == TRUTH else right
        raise _wrong(node, f"{shortened(truth.said)} is true or false already; join it by and, or")
    if not equality and kinds != {NUMBER}:
        raise _wrong(node, "only numbers are above or below each other; other values are compared by == and !=")
    if MISSING in kinds:
        return _missing(node, left if right.kind == MISSING else right, sign)
    if kinds == {NUMBER}:
        if equality and one.column is not None and one.column.axis and isinstance(other.constant, float):
            return _at(one.column, sign, other.constant, f"{left.said} {sign} {right.said}", note)
        return _numbers(left, sign, right)
    if NUMBER in kinds:
        raise _unlike(node, left, right)
    if WORDS in kinds and isinstance(other.constant, str):
        return _word(node, one, sign, other.constant)
    if one.column is not None and one.column.axis and isinstance(other.constant, str):
        _known(one.column, sign, other.constant, note)
    return _texts(left, sign, right)


def _at(column: Column, sign: str, asked: float, said: str, note: Callable[[str], None]) -> Evaluate:
    """Where an axis has the value nearest to a number, if that is near enough."""
    name = column.name
    assert column.values is not None
    value, found = nearest(column.values, asked) if column.values.size else (np.nan, False)
    if not found and sign == "==":
        note(f"{said}: {name} has no such value; the nearest is {value:.15g}")
    compare = _COMPARISONS[sign]
    return lambda values: compare(values[name], value if found else np.nan)


def _known(column: Column, sign: str, asked: str, note: Callable[[str], None]) -> None:
    """Tell of a text that an axis does not have."""
    assert column.values is not None
    known = [str(value) for value in column.values.ravel()]
    if sign == "==" and asked not in known:
        note(f"{column.name} == {asked!r}: {column.name} has no such value; {_near(asked, known)}")


def _numbers(left: Term, sign: str, right: Term) -> Evaluate:
    compare = _COMPARISONS[sign]

    def compared(values: Values) -> Any:
        a, b = left.evaluate(values), right.evaluate(values)
        found = compare(a, b)
        # NaN is unequal to everything, but nothing is known of what is missing.
        return found & (a == a) & (b == b) if sign == "!=" else found

    return compared


def _missing(node: Node, one: Term, sign: str) -> Evaluate:
    """Where a column or a number has no value, or has one."""
    if one.kind in (TEXT, MISSING):
        raise _wrong(node, "nan is a missing number or word; of texts the empty one is ''")
    column = one.column or Column(one.said, NUMBER)

    def compared(values: Values) -> Any:
        absent = column.missing(np.asarray(one.evaluate(values)))
        return absent if sign == "==" else ~absent

    return compared


def _word(node: Node, one: Term, sign: str, asked: str) -> Evaluate:
    """Where codes stand for a word, or for another."""
    assert one.column is not None
    assert one.column.words is not None
    column, words = one.column, one.column.words
    codes = [code for code, word in words.items() if spaced(word) == spaced(asked)]
    if not codes:
        raise _wrong(node, f"{column.name} is never {asked!r}; {_near(asked, list(words.values()))}")

    def compared(values: Values) -> Any:
        found = np.isin(one.evaluate(values), codes)
        return found if sign == "==" else ~(found | column.missing(one.evaluate(values)))

    return compared


def _texts(left: Term, sign: str, right: Term) -> Evaluate:
    """Texts, or the words that codes stand for."""

    def plain(term: Term, values: Values) -> Any:
        found = term.evaluate(values)
        return term.column.shown(found) if term.kind == WORDS and term.column is not None else found

    def compared(values: Values) -> Any:
        a, b = plain(left, values), plain(right, values)
        same = np.asarray(a == b, dtype=bool)
        known = np.ones((), dtype=bool)
        for term, found in ((left, a), (right, b)):
            if term.kind == WORDS:
                known = known & np.asarray(found != "", dtype=bool)
        return (same if sign == "==" else ~same) & known

    return compared


def _wrong(node: Node, why: str) -> ValueError:
    return ValueError(f"where = {shortened(node.said)!r}: {why}")


def _unlike(node: Node, left: Term, right: Term) -> ValueError:
    """Why a number and something else cannot be compared."""
    for one, other in ((left, right), (right, left)):
        if one.kind == WORDS and one.column is not None and one.column.words is not None:
            words = ", ".join(map(repr, one.column.words.values()))
            return _wrong(
                node, f"{one.said} is a word and {shortened(other.said)} a number; its words are {words}"
            )
    text, number = (left, right) if left.kind == TEXT else (right, left)
    hint = f"; without quotes {text.constant} is a number" if _is_number(text.constant) else ""
    return _wrong(node, f"{shortened(text.said)} is a text and {shortened(number.said)} a number{hint}")


def _is_number(text: Any) -> bool:
    try:
        return bool(np.isfinite(float(str(text))))
    except ValueError:
        return False


def _near(asked: str, known: list[str]) -> str:
    from studies.study import suggest

    listed = ", ".join(known[:20]) + (", ..." if len(known) > 20 else "")
    return f"{suggest(spaced(asked), known)}its values are {listed}"


def shortened(text: str) -> str:
    """What is shown of a part of an expression."""
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
