"""What an expression means for the columns of a result: the kind of each part, and what it is for a row."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from studies.query import tree
from studies.query.columns import NUMBER, TEXT, WORDS, Column
from studies.query.evaluate import MISSING, TRUTH, Evaluate, Term, Values, compared, shortened

# The largest power, of either sign.
MOST_POWER = 100.0

_ARITHMETIC: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": np.divide,
    "**": np.power,
}
_KINDS = {
    NUMBER: "a number",
    TEXT: "a text",
    WORDS: "a word",
    TRUTH: "true or false",
    MISSING: "the missing value",
}


def condition(node: tree.Node, columns: Mapping[str, Column], note: Callable[[str], None]) -> Evaluate:
    """What decides which rows an expression chooses.

    Parameters
    ----------
    node : Node
        Of `studies.query.language.parse`.
    columns : mapping of str to Column
        Every name that stands in it.
    note : callable
        Told, in a sentence, of a number that no axis has.

    Returns
    -------
    callable
        From the columns' values by name, arrays that broadcast, to booleans.

    Raises
    ------
    ValueError
        If its parts do not go together; the message shows which.
    """
    term = _Meaning(columns, note).of(node)
    if term.kind != TRUTH:
        example = f"{term.said} == {_example(term)}"
        raise ValueError(
            f"where = {shortened(node.said)!r}: it is {_KINDS[term.kind]}; compare it, like {example}"
        )

    def decide(values: Values) -> Any:
        with np.errstate(all="ignore"):
            return term.evaluate(values)

    return decide


class _Meaning:
    """Gives each part of an expression its kind and what evaluates it."""

    def __init__(self, columns: Mapping[str, Column], note: Callable[[str], None]) -> None:
        self.columns, self.note = columns, note

    def of(self, node: tree.Node) -> Term:
        """The meaning of one part."""
        if isinstance(node, tree.Number):
            return _constant(node.value, node.said)
        if isinstance(node, tree.Text):
            return Term(TEXT, node.said, lambda values: node.value, None, node.value)
        if isinstance(node, tree.Missing):
            return Term(MISSING, node.said, lambda values: np.nan)
        if isinstance(node, tree.Name):
            return Term(
                self.columns[node.name].kind,
                node.said,
                lambda values: values[node.name],
                self.columns[node.name],
            )
        if isinstance(node, tree.Minus):
            part = self._number(node.of, node)
            return _numeric(node, lambda values: -_wide(part.evaluate(values)), part)
        if isinstance(node, tree.Arithmetic):
            return self._arithmetic(node)
        if isinstance(node, tree.Comparison):
            return self._chain(node)
        if isinstance(node, tree.Not):
            inner = self._truth(node.of, node, "not")
            return Term(TRUTH, node.said, lambda values: np.logical_not(inner.evaluate(values)))
        assert isinstance(node, tree.Logic)
        terms = [self._truth(part, node, node.word) for part in node.parts]
        join = np.logical_and if node.word == "and" else np.logical_or

        def joined(values: Values) -> Any:
            found = terms[0].evaluate(values)
            for term in terms[1:]:
                found = join(found, term.evaluate(values))
            return found

        return Term(TRUTH, node.said, joined)

    def _truth(self, node: tree.Node, whole: tree.Node, word: str) -> Term:
        term = self.of(node)
        if term.kind != TRUTH:
            raise ValueError(
                f"where = {shortened(whole.said)!r}: {shortened(term.said)} is {_KINDS[term.kind]}; {word} is for "
                f"what is true or false, like {shortened(term.said)} == {_example(term)}"
            )
        return term

    def _number(self, node: tree.Node, whole: tree.Node) -> Term:
        term = self.of(node)
        if term.kind != NUMBER:
            raise ValueError(
                f"where = {shortened(whole.said)!r}: {shortened(term.said)} is {_KINDS[term.kind]}; "
                "only numbers can be calculated with"
            )
        return term

    def _arithmetic(self, node: tree.Arithmetic) -> Term:
        first = self._number(node.first, node)
        rest = [(sign, self._number(each, node)) for sign, each in node.rest]
        for sign, term in rest:
            if sign == "**" and not (isinstance(term.constant, float) and abs(term.constant) <= MOST_POWER):
                raise ValueError(
                    f"where = {shortened(node.said)!r}: the power {shortened(term.said)} must be a number from "
                    f"-{MOST_POWER:g} to {MOST_POWER:g}"
                )

        def calculated(values: Values) -> Any:
            found = _wide(first.evaluate(values))
            for sign, term in rest:
                found = _ARITHMETIC[sign](found, _wide(term.evaluate(values)))
            return found

        return _numeric(node, calculated, first, *(term for _, term in rest))

    def _chain(self, node: tree.Comparison) -> Term:
        terms = [self.of(each) for each in tree.parts(node)]
        signs = [sign for sign, _ in node.rest]
        pairs = [
            compared(node, left, sign, right, self.note)
            for left, sign, right in zip(terms, signs, terms[1:], strict=False)
        ]

        def every(values: Values) -> Any:
            found = pairs[0](values)
            for pair in pairs[1:]:
                found = np.logical_and(found, pair(values))
            return found

        return Term(TRUTH, node.said, every)


def _constant(value: float, said: str) -> Term:
    return Term(NUMBER, said, lambda values: value, None, value)


def _numeric(node: tree.Node, evaluate: Evaluate, *terms: Term) -> Term:
    """A number; where all it is made of is constant it is one too."""
    if all(isinstance(term.constant, float) for term in terms):
        with np.errstate(all="ignore"):
            return _constant(float(evaluate({})), node.said)
    return Term(NUMBER, node.said, evaluate)


def _wide(values: Any) -> Any:
    """Numbers to calculate with: whole ones would overflow, and divide by zero with an error."""
    return np.asarray(values, dtype=float)


def _example(term: Term) -> str:
    """Something to compare with."""
    if term.kind == WORDS and term.column is not None and term.column.words:
        return repr(next(iter(term.column.words.values())))
    return {TEXT: "'text'", MISSING: "0"}.get(term.kind, "0")
