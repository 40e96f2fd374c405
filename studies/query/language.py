"""Expressions that choose rows: a grammar so small that nothing in one can call, import or look inside.

    any         all { "or" all }
    all         not { "and" not }
    not         "not" not | comparison
    comparison  sum { ("==" | "!=" | "<" | "<=" | ">" | ">=") sum }
    sum         product { ("+" | "-") product }
    product     sign { ("*" | "/") sign }
    sign        ("-" | "+") sign | power
    power       atom [ "**" sign ]
    atom        NUMBER | TEXT | NAME | "nan" | "(" any ")"

As in Python, `a < b < c` is `a < b and b < c`, and `-a ** 2` is `-(a ** 2)`. A TEXT is in single or double quotes
and holds no quote of its kind; nothing in it is escaped. What an expression means is in `query.conditions`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NoReturn

from studies.query.tree import Arithmetic, Comparison, Logic, Minus, Missing, Name, Node, Not, Number, Text

# In letters; and in brackets, signs, powers and nots within each other.
LONGEST, DEEPEST = 4000, 40
# Of an expression so much is shown about what is wrong with it.
SHOWN = 60

GRAMMAR = (
    "an expression is of names, numbers, 'texts', nan, comparisons (== != < <= > >=), and, or, not, + - * / ** "
    "and brackets"
)
COMPARISONS = ("==", "!=", "<=", ">=", "<", ">")
# What people write who know other languages.
HINTS = {
    "=": "to compare is ==",
    "in": "write mu == 0.1 or mu == 0.2",
    "&": "write and",
    "|": "write or",
    "!": "write not, or != to compare",
    "^": "a power is **",
    "~": "write not",
    "(": "nothing can be called",
    "[": "nothing can be indexed",
    ".": "there are no attributes",
    "'": "a text ends with the quote that it began with",
    '"': "a text ends with the quote that it began with",
}

_TOKENS = re.compile(
    r"(?P<space>[ \t\r\n]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?(?![\w.]))"
    r"|(?P<text>'[^'\r\n]*'|\"[^\"\r\n]*\")"
    r"|(?P<name>[^\W\d]\w*)"
    r"|(?P<symbol>\*\*|==|!=|<=|>=|[-+*/()<>])"
)
_STRANGE = re.compile(r"[\w.]+|.", re.DOTALL)


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    start: int
    end: int


def parse(text: str) -> Node:
    """Read an expression.

    Raises
    ------
    ValueError
        If it is none; the message shows the place.
    """
    if not isinstance(text, str):
        raise ValueError(f"where = {text!r}: it must be a text; {GRAMMAR}")
    if len(text) > LONGEST:
        raise ValueError(f"where = {text[:SHOWN]!r}...: it has {len(text)} letters; it may have {LONGEST}")
    return _Parser(text).whole()


class _Parser:
    """Reads one expression, token by token."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.depth = 0
        self.tokens = list(self._cut())
        self.place = 0

    def whole(self) -> Node:
        found = self._any()
        if self._now.kind != "end":
            self._refuse(self._now)
        return found

    def _cut(self) -> Iterator[_Token]:
        at = 0
        while at < len(self.text):
            match = _TOKENS.match(self.text, at)
            kind = "strange" if match is None else str(match.lastgroup)
            # A number that runs into letters is shown as a whole.
            found = match or _STRANGE.match(self.text, at)
            assert found is not None
            if kind != "space":
                yield _Token(kind, found[0], at, found.end())
            at = found.end()
        yield _Token("end", "", at, at)

    @property
    def _now(self) -> _Token:
        return self.tokens[self.place]

    def _is(self, *texts: str) -> bool:
        return self._now.kind in ("symbol", "name") and self._now.text in texts

    def _take(self) -> _Token:
        token = self._now
        self.place += 1
        return token

    def _said(self, begin: int) -> str:
        """What was written from the token `begin` to the one before this."""
        return self.text[self.tokens[begin].start : self.tokens[self.place - 1].end]

    def _any(self) -> Node:
        return self._logic("or", self._all)

    def _all(self) -> Node:
        return self._logic("and", self._not)

    def _logic(self, word: str, part: Callable[[], Node]) -> Node:
        begin, found = self.place, [part()]
        while self._is(word):
            self._take()
            found.append(part())
        return found[0] if len(found) == 1 else Logic(self._said(begin), word, tuple(found))

    def _not(self) -> Node:
        begin = self.place
        if not self._is("not"):
            return self._chain(Comparison, COMPARISONS, self._sum)
        self._take()
        of = self._deeper(self._not)
        return Not(self._said(begin), of)

    def _sum(self) -> Node:
        return self._chain(Arithmetic, ("+", "-"), self._product)

    def _product(self) -> Node:
        return self._chain(Arithmetic, ("*", "/"), self._sign)

    def _chain(
        self, kind: type[Arithmetic] | type[Comparison], signs: tuple[str, ...], part: Callable[[], Node]
    ) -> Node:
        begin, first, rest = self.place, part(), list[tuple[str, Node]]()
        while self._is(*signs):
            sign = self._take().text
            rest.append((sign, part()))
        return kind(self._said(begin), first, tuple(rest)) if rest else first

    def _sign(self) -> Node:
        begin = self.place
        if not self._is("-", "+"):
            return self._power()
        sign = self._take().text
        of = self._deeper(self._sign)
        return Minus(self._said(begin), of) if sign == "-" else Arithmetic(self._said(begin), of, ())

    def _power(self) -> Node:
        begin, base = self.place, self._atom()
        if not self._is("**"):
            return base
        self._take()
        exponent = self._deeper(self._sign)
        return Arithmetic(self._said(begin), base, (("**", exponent),))

    def _atom(self) -> Node:
        token = self._now
        if self._is("("):
            self._take()
            inner = self._deeper(self._any)
            if not self._is(")"):
                self._refuse(self._now)
            self._take()
            return inner
        if token.kind not in ("number", "text", "name") or token.text in ("and", "or", "not"):
            self._refuse(token)
        self._take()
        if token.kind == "number":
            return Number(token.text, float(token.text))
        if token.kind == "text":
            return Text(token.text, token.text[1:-1])
        return Missing(token.text) if token.text == "nan" else Name(token.text, token.text)

    def _deeper(self, part: Callable[[], Node]) -> Node:
        self.depth += 1
        if self.depth > DEEPEST:
            raise ValueError(f"where = {self._about(self._now)}: more than {DEEPEST} levels are within each other")
        found = part()
        self.depth -= 1
        return found

    def _refuse(self, token: _Token) -> NoReturn:
        """Raise, with the place."""
        if token.kind == "end":
            what = "something is missing at its end" if self.text.strip() else "it is empty"
        else:
            shown = token.text if len(token.text) <= SHOWN else f"{token.text[:SHOWN]}..."
            odd = "" if shown.isascii() else f" ({', '.join(f'U+{ord(c):04X}' for c in shown if not c.isascii())})"
            what = f"{shown!r}{odd} at letter {token.start + 1} cannot stand there"
        hint = HINTS.get(token.text, HINTS["."] if token.text.startswith(".") else "")
        raise ValueError(f"where = {self._about(token)}: {what}; {hint}{'; ' if hint else ''}{GRAMMAR}")

    def _about(self, token: _Token) -> str:
        """The expression, or of a long one what is about a token."""
        begin = max(min(token.start - SHOWN // 2, len(self.text) - SHOWN), 0)
        part = self.text[begin : begin + SHOWN]
        return f"{'...' if begin else ''}{part!r}{'...' if begin + SHOWN < len(self.text) else ''}"
