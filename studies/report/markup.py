"""HTML made of elements: whatever is not an element already is escaped, so no text can become markup."""

from __future__ import annotations

import json
from collections.abc import Iterable
from html import escape
from typing import Any


class Markup(str):
    """Text that is HTML already; only this module makes it of text."""

    __slots__ = ()


Content = str | Iterable["Content"]
# Elements that hold nothing and have no end.
VOID = ("meta", "link", "img", "br")


def tag(name: str, /, *content: Content, **attributes: str | bool | None) -> Markup:
    """An element.

    Parameters
    ----------
    name : str
    *content : str, Markup, or iterables of them
        Text is escaped.
    **attributes
        `class_` is class and `aria_label` aria-label; True is an attribute without a value; None and False are
        left out.
    """
    told = "".join(
        f" {key.rstrip('_').replace('_', '-')}" + ("" if value is True else f'="{escape(str(value))}"')
        for key, value in attributes.items()
        if value is not None and value is not False
    )
    if name in VOID:
        return Markup(f"<{name}{told}>")
    return Markup(f"<{name}{told}>{joined(content)}</{name}>")


def joined(content: Content) -> Markup:
    """Elements and escaped text, one after the other."""
    if isinstance(content, str):
        return content if isinstance(content, Markup) else Markup(escape(content))
    return Markup("".join(joined(each) for each in content))


def data(name: str, value: Any) -> Markup:
    """A block of JSON for the page's script; nothing in it can end the block.

    Raises
    ------
    ValueError
        For a NaN, which JSON does not have.
    """
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for sign in "&<>":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(f'<script type="application/json" id="{escape(name)}">{text}</script>')


def code(name: str, text: str) -> Markup:
    """A `script` or `style` of the project's own files.

    Raises
    ------
    ValueError
        If it would end itself.
    """
    if f"</{name}" in text.lower():
        raise ValueError(f"a {name} must not hold its own end")
    return Markup(f"<{name}>{text}</{name}>")
