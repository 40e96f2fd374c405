"""What an expression is made of, once it is read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Node:
    """A part of an expression.

    Attributes
    ----------
    said : str
        As it was written.
    """

    said: str


@dataclass(frozen=True)
class Number(Node):
    """A number."""

    value: float


@dataclass(frozen=True)
class Text(Node):
    """A text, without its quotes."""

    value: str


@dataclass(frozen=True)
class Name(Node):
    """What an axis, a variable or a setting is called."""

    name: str


@dataclass(frozen=True)
class Missing(Node):
    """`nan`: that there is no value."""


@dataclass(frozen=True)
class Minus(Node):
    """A change of sign."""

    of: Node


@dataclass(frozen=True)
class Arithmetic(Node):
    """Sums and differences, or products and quotients, or one power, from left to right."""

    first: Node
    rest: tuple[tuple[str, Node], ...]


@dataclass(frozen=True)
class Comparison(Node):
    """Comparisons of each part with the next."""

    first: Node
    rest: tuple[tuple[str, Node], ...]


@dataclass(frozen=True)
class Not(Node):
    """What is true where its part is not."""

    of: Node


@dataclass(frozen=True)
class Logic(Node):
    """All of its parts ("and"), or any of them ("or")."""

    word: str
    parts: tuple[Node, ...]


def names(node: Node) -> Iterator[str]:
    """Every name in an expression, as often as it stands there."""
    if isinstance(node, Name):
        yield node.name
    for part in parts(node):
        yield from names(part)


def speaks_of_missing(node: Node) -> bool:
    """Whether `nan` stands anywhere in an expression."""
    return isinstance(node, Missing) or any(map(speaks_of_missing, parts(node)))


def parts(node: Node) -> tuple[Node, ...]:
    """What a part of an expression is made of."""
    if isinstance(node, (Arithmetic, Comparison)):
        return (node.first, *(each for _, each in node.rest))
    if isinstance(node, (Minus, Not)):
        return (node.of,)
    return node.parts if isinstance(node, Logic) else ()
