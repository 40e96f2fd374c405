"""Columns of a result by name: axes, variables, meanings of their codes, and settings."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sweeps import InputError

if TYPE_CHECKING:
    import xarray as xr

NUMBER, TEXT, WORDS = "number", "text", "words"
# What a file says of how each point was computed.
MAKING = ("status", "error", "wall_time")


@dataclass(frozen=True, eq=False)
class Column:
    """One thing that has a name in a result, or is calculated from such.

    Attributes
    ----------
    name : str
    kind : str
        NUMBER, TEXT, or WORDS where codes stand for words.
    dims : tuple of str
        What it runs along.
    units : str
        "" for none.
    words : mapping of int to str
        Word of each code, as it is shown: with spaces where the file has underscores.
    whole : bool
        Whether its numbers are whole, although a missing one is NaN.
    axis : bool
        Whether it says where one is along a dimension; equality with a number then finds the nearest value.
    values : ndarray, optional
        Of an axis and of a setting; of anything else they are read where they are needed.
    inputs : tuple of Column
        What it is calculated from.
    calculate : callable, optional
        From the values of its inputs, by name, to its own.
    """

    name: str
    kind: str
    dims: tuple[str, ...] = ()
    units: str = ""
    words: Mapping[int, str] | None = None
    whole: bool = False
    axis: bool = False
    values: NDArray[Any] | None = None
    inputs: tuple[Column, ...] = ()
    calculate: Callable[[Mapping[str, NDArray[Any]]], Any] | None = None

    def shown(self, values: NDArray[Any]) -> NDArray[Any]:
        """Words in place of codes; NaN where there is none."""
        if self.words is None:
            return values
        words = np.full(values.shape, np.nan, dtype=object)
        for code, word in self.words.items():
            words[values == code] = word
        return words

    def missing(self, values: NDArray[Any]) -> NDArray[np.bool_]:
        """Where there is no value: NaN, or a text without letters."""
        if self.kind == TEXT:
            return np.asarray(values == "", dtype=bool)
        return np.isnan(values) if values.dtype.kind == "f" else np.zeros(values.shape, dtype=bool)


def spaced(word: str) -> str:
    """A word as it is shown: the meanings of flags have underscores where words have spaces."""
    return word.replace("_", " ")


def column_of(
    name: str, variable: xr.Variable | xr.DataArray, axis: bool = False, argument: str = "show"
) -> Column:
    """The column that a variable is; `argument` says in a message whose value names it.

    Raises
    ------
    ValueError
        If it has no place in a table.
    """
    dims, attributes, kind = tuple(map(str, variable.dims)), variable.attrs, variable.dtype.kind
    axis = axis and len(dims) < 2
    values = np.asarray(variable.values) if axis else None
    if "flag_values" in attributes:
        codes = np.atleast_1d(attributes["flag_values"]).tolist()
        meanings = map(spaced, str(attributes["flag_meanings"]).split())
        return Column(name, WORDS, dims, "", dict(zip(codes, meanings, strict=True)), True, False, values)
    if kind in "OU":
        return Column(name, TEXT, dims, "", None, False, axis, values)
    if kind not in "iufb":
        raise InputError(f"{argument} = {name!r}: it is of type {variable.dtype}, which has no place in a table")
    units = str(attributes.get("units", ""))
    whole = kind in "iu" or np.dtype(variable.encoding.get("dtype", variable.dtype)).kind in "iu"
    return Column(name, NUMBER, dims, "" if units == "1" else units, None, whole, axis, values)


def hint(name: str, names: Sequence[str]) -> str:
    """A hint for a message on an unknown name: the nearest known one, else all."""
    from studies.study import suggest

    return suggest(name, list(names)).strip() or f"there are {', '.join(names)}"


class Columns:
    """Everything that can be named of a result.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of a sweep, as `studies.open`, `sweeps.open_results` or plain xarray give it, or a part of one.
    note : callable
        Called with a sentence on a requested value that no axis has.

    Raises
    ------
    ValueError
        If it is not of a sweep.
    """

    def __init__(self, dataset: xr.Dataset, note: Callable[[str], None] = lambda text: None) -> None:
        self.dataset, self.note = dataset, note
        self.configuration = configuration(dataset)
        self.axes = tuple(str(name) for name in self.configuration["axes"] if name in dataset.variables)
        along = {dim for name in self.axes for dim in dataset[name].dims}
        # In the order that the grid has.
        self.point_dims = tuple(str(dim) for dim in dataset.dims if dim in along)
        self.settings = settings(self.configuration["constants"])

    def beside(self, column: Column) -> bool:
        """Whether it has many values at each point, along a further dimension."""
        return not set(column.dims) <= set(self.point_dims)

    @property
    def names(self) -> list[str]:
        """All names: axes first, settings last."""
        rest = [str(name) for name in self.dataset.variables if name not in self.axes]
        return list(dict.fromkeys([*self.axes, *rest, *map(str, self.dataset.dims), *self.settings]))

    def find(self, name: str, argument: str) -> Column:
        """Find the column of this name; `argument` is the option that messages name.

        Raises
        ------
        ValueError
            If there is no such column; the message has the nearest name.
        """
        if name in self.dataset.variables:
            return column_of(
                name, self.dataset.variables[name], name in (*self.axes, *self.dataset.dims), argument
            )
        if name in self.dataset.sizes:
            # Its entries have no names: they are counted as `isel` counts them.
            numbers = np.arange(self.dataset.sizes[name], dtype=np.int64)
            return Column(name, NUMBER, (name,), "", None, True, True, numbers)
        if name in self.settings:
            value = self.settings[name]
            kind = TEXT if isinstance(value, str) else NUMBER
            values = np.asarray(np.nan if value is None else value, dtype=object if kind == TEXT else None)
            units = self._unit_of_setting(name)
            return Column(name, kind, (), units, None, isinstance(value, int), False, values)
        if self._is_word(name):
            near = f"to compare with the word, write '{name}' in quotes"
        elif name == "time" and "elapsed" in self.names:
            near = "did you mean elapsed?"
        else:
            near = hint(name, self.names)
        raise InputError(f"{argument} = {name!r}: no such column; {near}")

    def _is_word(self, name: str) -> bool:
        """Whether it is what a code stands for."""
        meanings = (str(each.attrs.get("flag_meanings", "")) for each in self.dataset.variables.values())
        return any(name in words.split() for words in meanings)

    def _unit_of_setting(self, name: str) -> str:
        """The setting as its study declares it."""
        from studies import registry

        with suppress(ValueError):
            declared = registry.load(self.dataset.attrs.get("sweep", "")).settings
            if not declared:
                # A map's are those of what it shows.
                from studies.maps.quantities import AXES, RUN

                declared = AXES | RUN
            if name in declared:
                units = declared[name].units
                return "" if units == "1" else units
        return ""


def configuration(dataset: xr.Dataset) -> dict[str, Any]:
    """Read the configuration of a result: name, axes, constants.

    Raises
    ------
    ValueError
        If it does not say.
    """
    try:
        content: dict[str, Any] = json.loads(dataset.attrs["configuration"])
        if isinstance(content["axes"], dict) and isinstance(content["constants"], dict):
            return content
    except (KeyError, TypeError, ValueError):
        pass
    raise InputError(
        "dataset: it is not the result of a sweep, or what it says of itself (attrs) was lost; open its file again"
    )


def settings(constants: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """The numbers and texts among constants, by the names of settings: of a rig d1, p1_length and so on."""
    flat: dict[str, Any] = {}
    for name, value in constants.items():
        if isinstance(value, Mapping):
            flat |= settings(value, prefix if name == "rig" else f"{prefix}{name}_")
        elif value is None or isinstance(value, (bool, int, float, str)):
            # A column of whole numbers has 64 bits.
            long = isinstance(value, int) and not -(1 << 63) <= value < 1 << 63
            flat[f"{prefix}{name}"] = float(str(value)) if long else value
    return flat
