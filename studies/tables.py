"""Tables of a report as data: a terminal shows them as aligned lines, a page as tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Heads and rows of text; `str` gives its lines.

    Attributes
    ----------
    heads : sequence of str
    rows : sequence of sequence of str
        Each as long as `heads`.
    words : int
        How many of the first columns are words, flush left; numbers are flush right.
    form : str
        How `str.format` writes a line where columns are not to be as wide as what they hold.
    """

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int = 0
    form: str = ""

    def __str__(self) -> str:
        every = [self.heads, *self.rows]
        widths = [max(map(len, column)) for column in zip(*every, strict=True)]
        sides = "<" * self.words + ">" * (len(widths) - self.words)
        form = self.form or "  ".join(f"{{:{side}{width}}}" for side, width in zip(sides, widths, strict=True))
        return "\n".join(form.format(*row).rstrip() for row in every)


# A line of text, or a table.
Part = str | Table


def text(parts: Iterable[Part]) -> str:
    """What a terminal shows of a report."""
    return "\n".join(map(str, parts))


def apart(groups: Iterable[Sequence[Part]]) -> list[Part]:
    """The parts of all groups that have any, with an empty line between two groups."""
    parts: list[Part] = []
    for group in filter(None, groups):
        parts += ["", *group] if parts else group
    return parts
