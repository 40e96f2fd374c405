"""What can be named of a result: axes, variables, what their codes mean, and the settings it was made with."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import xarray as xr

NUMBER, TEXT, WORDS = "number", "text", "words"
# What a file says of the making of each point.
MAKING = ("status", "error", "wall_time")


@dataclass(frozen=True, eq=False)
class Column:
    """One thing that has a name in a result.

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
    """

    name: str
    kind: str
    dims: tuple[str, ...] = ()
    units: str = ""
    words: Mapping[int, str] | None = None
    whole: bool = False
    axis: bool = False
    values: NDArray[Any] | None = None

    def shown(self, values: NDArray[Any]) -> NDArray[Any]:
        """Words in place of codes; "" where there is none."""
        if self.words is None:
            return values
        found = np.full(values.shape, "", dtype=object)
        for code, word in self.words.items():
            found[values == code] = word
        return found

    def missing(self, values: NDArray[Any]) -> NDArray[np.bool_]:
        """Where there is no value: NaN, or a text without letters."""
        if self.kind == TEXT:
            return np.asarray(values == "", dtype=bool)
        return np.isnan(values) if values.dtype.kind == "f" else np.zeros(values.shape, dtype=bool)


def spaced(word: str) -> str:
    """A word as it is shown: the meanings of flags have underscores where words have spaces."""
    return word.replace("_", " ")


class Columns:
    """Everything that can be named of a result, found by name.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of a sweep, as `studies.open`, `sweeps.open_results` or plain xarray give it, or a part of one.

    Raises
    ------
    ValueError
        If it is not of a sweep.
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self.dataset = dataset
        self.configuration = configuration(dataset)
        self.axes = tuple(str(name) for name in self.configuration["axes"] if name in dataset.variables)
        along = {dim for name in self.axes for dim in dataset[name].dims}
        # In the order that the grid has.
        self.point_dims = tuple(str(dim) for dim in dataset.dims if dim in along)
        self.settings = settings(self.configuration["constants"])

    @property
    def names(self) -> list[str]:
        """All names: axes first, settings last."""
        rest = [str(name) for name in self.dataset.variables if name not in self.axes]
        return list(dict.fromkeys([*self.axes, *rest, *map(str, self.dataset.dims), *self.settings]))

    def find(self, name: str, where: str) -> Column:
        """What is called so; `where` says in a message where it was asked for.

        Raises
        ------
        ValueError
            If there is nothing of the name; the message has the nearest that there is.
        """
        if name in self.dataset.variables:
            return self._of_variable(name, where)
        if name in self.dataset.sizes:
            # Its entries have no names: they are counted as `isel` counts them.
            return Column(
                name, NUMBER, (name,), "", None, True, True, np.arange(self.dataset.sizes[name], dtype=np.int64)
            )
        if name in self.settings:
            value = self.settings[name]
            text = isinstance(value, str)
            held = np.asarray(np.nan if value is None else value, dtype=object if text else None)
            whole = isinstance(value, int)
            return Column(
                name, TEXT if text else NUMBER, (), self._unit_of_setting(name), None, whole, False, held
            )
        from studies.study import suggest

        if self._is_word(name):
            near = f"to compare with the word, write '{name}' in quotes"
        elif name == "time" and "elapsed" in self.names:
            near = "did you mean elapsed?"
        else:
            near = suggest(name, self.names).strip() or f"there are {', '.join(self.names)}"
        raise ValueError(f"{where} = {name!r}: nothing is called so; {near}")

    def _is_word(self, name: str) -> bool:
        """Whether it is what a code stands for."""
        told = (str(each.attrs.get("flag_meanings", "")) for each in self.dataset.variables.values())
        return any(name in meanings.split() for meanings in told)

    def _of_variable(self, name: str, where: str) -> Column:
        variable = self.dataset.variables[name]
        dims = tuple(map(str, variable.dims))
        attributes = variable.attrs
        kept = np.dtype(variable.encoding.get("dtype", variable.dtype))
        axis = name in self.axes or (dims == (name,) and name in self.dataset.dims)
        values = np.asarray(variable.values) if axis else None
        if "flag_meanings" in attributes and "flag_values" in attributes:
            codes = np.atleast_1d(attributes["flag_values"]).tolist()
            meanings = map(spaced, str(attributes["flag_meanings"]).split())
            return Column(name, WORDS, dims, "", dict(zip(codes, meanings, strict=True)), True, False, values)
        if variable.dtype.kind in "OU":
            return Column(name, TEXT, dims, "", None, False, axis, values)
        if variable.dtype.kind not in "iufb":
            raise ValueError(f"{where} = {name!r}: it is of type {variable.dtype}, which has no place in a table")
        units = str(attributes.get("units", ""))
        whole = variable.dtype.kind in "iu" or kept.kind in "iu"
        return Column(name, NUMBER, dims, "" if units == "1" else units, None, whole, axis, values)

    def _unit_of_setting(self, name: str) -> str:
        """As the study declares it."""
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
    """What a result was made with: name, axes, constants.

    Raises
    ------
    ValueError
        If it does not say.
    """
    try:
        found: dict[str, Any] = json.loads(dataset.attrs["configuration"])
        if isinstance(found["axes"], dict) and isinstance(found["constants"], dict):
            return found
    except (KeyError, TypeError, ValueError):
        pass
    raise ValueError(
        "dataset: it is not the result of a sweep, or what it says of itself (attrs) was lost; open its file again"
    )


def settings(constants: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """The numbers and texts among constants, by the names of settings: of a rig d1, p1_length and so on."""
    found: dict[str, Any] = {}
    for name, value in constants.items():
        if isinstance(value, Mapping):
            found |= settings(value, prefix if name == "rig" else f"{prefix}{name}_")
        elif value is None or isinstance(value, (bool, int, float, str)):
            found[f"{prefix}{name}"] = value
    return found
