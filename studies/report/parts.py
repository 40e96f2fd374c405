"""Pieces of the report page that occur in many places: a command, a table, what a study tells."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

from studies.report.markup import Content, Markup, tag
from studies.tables import Part, Table

# A cell with more letters is broken into lines.
LONG = 40


def command(text: str) -> Markup:
    """A line to be typed, with a button that copies it; it is broken before an option, if at all."""
    first, *options = text.split(" --")
    line = tag("code", first, [(" ", tag("span", f"--{option}")) for option in options])
    return tag(
        "div", tag("pre", line), tag("button", "Copy", type="button", class_="copy", hidden=True), class_="command"
    )


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], caption: str) -> Markup:
    """A table that scrolls by itself where it is too wide; its caption is for those who cannot see it.

    Numbers stand flush right, words flush left.
    """
    words = [k == 0 or not all(_is_number(row[k]) for row in rows) for k in range(len(heads))]
    top = [tag("th", head, scope="col", class_=_look(head, word)) for head, word in zip(heads, words, strict=True)]
    lines = [
        tag(
            "tr",
            tag("th", row[0], scope="row", class_="text"),
            [tag("td", cell, class_=_look(cell, word)) for cell, word in zip(row[1:], words[1:], strict=True)],
        )
        for row in rows
    ]
    whole = tag(
        "table", tag("caption", caption, class_="hidden"), tag("thead", tag("tr", top)), tag("tbody", lines)
    )
    return tag("div", whole, class_="scroll", tabindex="0", role="region", aria_label=caption)


def _look(cell: str, word: bool) -> str | None:
    looks = ["text"] if word else []
    looks += ["long"] if len(cell) > LONG else []
    return " ".join(looks) or None


def _is_number(cell: str) -> bool:
    """Whether a cell says how much, or nothing."""
    return cell in ("", "-") or cell.lstrip("<>+- ")[:1].isdigit()


def told(parts: Iterable[Part], title: str) -> list[Markup]:
    """A study's report: paragraphs and tables."""
    shown: list[Markup] = []
    block: list[str] = []
    for part in [*parts, ""]:
        if isinstance(part, str) and part:
            block.append(part)
            continue
        if block:
            shown.append(tag("p", _flowing(block)))
            block = []
        if isinstance(part, Table):
            shown.append(table(part.heads, part.rows, f"{title}: by {part.heads[0] or part.heads[1]}"))
    return shown


def _flowing(lines: Sequence[str]) -> list[Content]:
    """Lines of a terminal: a sentence goes on, and what follows an end or is set in begins anew."""
    shown: list[Content] = [lines[0].strip()]
    for before, line in pairwise(lines):
        anew = before.rstrip()[-1:] in ".:" or line.startswith(" ") or before.startswith(" ")
        shown += [tag("br") if anew else " ", line.strip()]
    return shown
