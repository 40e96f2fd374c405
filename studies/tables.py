"""Tables of a report as data: a terminal shows them as aligned lines, a page as tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

# Of a column: the name of a variable or axis, or a function of the row; how the number is written; what it is
# multiplied by. A function alone returns the text.
Column = Callable[["xr.Dataset"], str] | tuple[str | Callable[["xr.Dataset"], Any], str] | tuple[Any, str, float]


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
    """

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int = 0

    @classmethod
    def of(cls, dataset: xr.Dataset, along: str, columns: Mapping[str, Column], words: int = 0) -> Table:
        """A row for each entry of a dimension.

        Parameters
        ----------
        dataset : xarray.Dataset
        along : str
            The dimension.
        columns : mapping of str to Column
            By their heads, for example ``{"V mm/s": ("V", ".4g", 1e3), "regime": regimes.kind}``. A NaN is shown
            as a dash, a whole number with flags as its word.
        words : int
            As of the table.
        """
        rows = [dataset.isel({along: k}) for k in range(dataset.sizes[along])]
        return cls([*columns], [[_cell(row, column) for column in columns.values()] for row in rows], words)

    def __str__(self) -> str:
        every = [self.heads, *self.rows]
        widths = [max(map(len, column)) for column in zip(*every, strict=True)]
        sides = "<" * self.words + ">" * (len(widths) - self.words)
        form = "  ".join(f"{{:{side}{width}}}" for side, width in zip(sides, widths, strict=True))
        return "\n".join(form.format(*row).rstrip() for row in every)


def number(value: Any, form: str, factor: float = 1.0) -> str:
    """A number for a reader, like ``format``; a dash for NaN, and no sign before a zero."""
    value = factor * float(value)
    return "-" if np.isnan(value) else format(float(value), f"z{form}")


def word(point: xr.DataArray) -> str:
    """The meaning of one whole number with flags; a dash for NaN."""
    if np.isnan(float(point)):
        return "-"
    place: int = np.asarray(point.attrs["flag_values"]).tolist().index(int(point))
    return str(point.attrs["flag_meanings"]).split()[place].replace("_", " ")


def _cell(row: xr.Dataset, column: Column) -> str:
    if callable(column):
        words: str = column(row)
        return words
    value: Any = row[column[0]] if isinstance(column[0], str) else column[0](row)
    if "flag_meanings" in getattr(value, "attrs", {}):
        return word(value)
    return number(value, *column[1:])


# A line of text, or a table.
Part = str | Table


def text(parts: Iterable[Part]) -> str:
    """A report as text for a terminal."""
    return "\n".join(map(str, parts))


def listed(values: Sequence[float], most: int = 8) -> str:
    """The first numbers of a list, and how many more there are."""
    rest = f" and {len(values) - most} more" if len(values) > most else ""
    return ", ".join(f"{value:g}" for value in values[:most]) + rest


def apart(groups: Iterable[Sequence[Part]]) -> list[Part]:
    """The parts of all groups that have any, with an empty line between two groups."""
    parts: list[Part] = []
    for group in filter(None, groups):
        parts += ["", *group] if parts else group
    return parts
