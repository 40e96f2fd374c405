"""A study: a question, the axes it varies, the function that answers, and how the answer is shown."""

from __future__ import annotations

import difflib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from studies import spec, tables
from sweeps import Axis, Grid, InputError, Sweep, Variable, check_size

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Setting:
    """A number, or one of some `words`, that a study holds fixed unless it is set."""

    value: Any
    units: str
    long_name: str
    words: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Study:
    """A study: `fiv run` computes it, stores it, draws it and prints its findings.

    Attributes
    ----------
    name, title : str
    question : str
        What the study asks, in a sentence.
    paper : str
        What the paper says, in the project's own words, with the place.
    axes : mapping of str to Axis
        What is varied, with its default values.
    settings : mapping of str to Setting
        What is fixed.
    draw : callable
        `draw(dataset)` returns the figure, from what the file holds and nothing else (`deferred` imports it late).
    findings : callable
        `findings(dataset)` returns the findings as lines and tables.
    function : callable, optional
        `function(points, **constants)` computes a batch: `points` holds an array for each axis, one entry a point;
        it returns an array for each variable, the batch first.
    variables : mapping of str to Variable
        What the function returns.
    constants : callable, optional
        `constants(settings)` returns what the function gets besides its points; by default the settings.
    coords : mapping of str to Axis, or callable
        Axes of the variables' own dimensions; a callable gets the constants: `coords(**constants)`.
    check : callable, optional
        `check(axes, constants)` raises ValueError for what cannot be computed, before anything is planned.
    skip : callable, optional
        `skip(points)` says which points of the product are none (`sweeps.Grid`).
    derive : callable, optional
        `derive(dataset, **constants)` returns the dataset with what follows from the whole of it.
    options : mapping
        Further arguments of `sweeps.Sweep`: key, scale, order_by, batch_multiple.
    build : callable, optional
        `build(axes, settings)` returns the sweep where it is not one function; then the seven above are not used.
    record : callable, optional
        `record(study, given, names, sample_rate)` returns the sweep that keeps the series called `names` too
        (`motion.recording`); without it the study has no motion in time.
    scatters : bool
        Whether it scatters numbers by itself: `build` then finds distributions under `scatter` among its settings
        where some are asked for.
    request : mapping
        What else than axes and settings its file is to say that it was asked for (`studies.scatter`).
    """

    name: str
    title: str
    question: str
    paper: str
    axes: Mapping[str, Axis]
    settings: Mapping[str, Setting]
    draw: Callable[[xr.Dataset], Figure]
    findings: Callable[[xr.Dataset], Sequence[tables.Part]]
    function: Callable[..., Mapping[str, Any]] | None = None
    variables: Mapping[str, Variable] = field(default_factory=dict)
    constants: Callable[[Mapping[str, float]], Mapping[str, Any]] = dict
    coords: Mapping[str, Axis] | Callable[..., Mapping[str, Axis]] = field(default_factory=dict)
    check: Callable[[Mapping[str, Axis], Mapping[str, Any]], None] | None = None
    skip: Callable[[Mapping[str, Any]], Any] | None = None
    derive: Callable[..., xr.Dataset] | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    build: Callable[[Mapping[str, Axis], Mapping[str, float]], Sweep] | None = None
    record: Callable[[Study, Mapping[str, Any], Sequence[str], float | None], Sweep] | None = None
    scatters: bool = False
    request: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if (self.function is None) == (self.build is None):
            raise InputError(f"study {self.name}: it must have one of function and build")

    def report(self, dataset: xr.Dataset) -> str:
        """The findings as text for a terminal."""
        return tables.text(self.findings(dataset))

    def statement(self) -> str:
        """The paper's statement, the axes and the settings, as lines."""
        lines = [f"Paper: {self.paper}"]
        for name, axis in self.axes.items():
            if name in self.texts:
                ends = ", ".join(self.texts[name])
                ends = ends if len(ends) <= 22 else f"{len(axis)} texts"
            else:
                ends = f"{axis.values[0]:g} to {axis.values[-1]:g} ({len(axis)})"
            units = "" if axis.units == "1" else f", {axis.units}"
            lines.append(f"axis     {name:<17} {ends:<22} {axis.long_name}{units}")
        for name, setting in self.settings.items():
            units = "" if setting.units == "1" else f" {setting.units}"
            value = setting.value if setting.words else f"{setting.value:g}{units}"
            lines.append(f"setting  {name:<17} {value:<22} {setting.long_name}")
        return "\n".join(lines)

    def units(self, name: str) -> str:
        """Units of an axis or a setting; "" for a name that there is not."""
        declared = self.axes.get(name) or self.settings.get(name)
        return "" if declared is None else declared.units

    @property
    def texts(self) -> dict[str, list[str]]:
        """The values of axes of texts, and the words of settings; a run may ask for these and no others."""
        axes = {name: axis.values.tolist() for name, axis in self.axes.items() if axis.values.dtype.kind == "U"}
        return axes | {name: list(each.words) for name, each in self.settings.items() if each.words}

    def sweep(
        self, values: Mapping[str, Any], *, record: Sequence[str] = (), sample_rate: float | None = None
    ) -> Sweep:
        """The study's sweep with these values in place of its own.

        Parameters
        ----------
        values : mapping
            Values of axes and settings.
        record : sequence of str
            Series of the motion to keep besides, of `studies.motion.recording.SERIES`; by default none.
        sample_rate : float, optional
            Sampling rate of recorded series, Hz.

        Raises
        ------
        ValueError
            For a name that is neither an axis nor a setting, or a value out of range; for a series that there is
            not, or that this study cannot record.
        """
        if len(record) or sample_rate is not None:
            if self.record is None:
                raise InputError(f"study {self.name} has no motion in time to record")
            return self.record(self, values, record, sample_rate)
        axes, settings = dict(self.axes), {name: s.value for name, s in self.settings.items()}
        for name, value in values.items():
            if name in axes:
                axes[name] = _axis(name, value, axes[name])
            elif name in settings:
                words = self.settings[name].words
                settings[name] = one_word(name, value, words) if words else _one_number(self.name, name, value)
            else:
                names = [*axes, *settings]
                raise InputError(
                    f"{name}: study {self.name} has no such axis; {suggest(name, names)}"
                    f"its axes are {', '.join(axes)}; its settings are {', '.join(settings) or 'none'}"
                )
        return self.build(axes, settings) if self.build else self._one_function(axes, settings)

    def _one_function(self, axes: Mapping[str, Axis], settings: Mapping[str, float]) -> Sweep:
        """The sweep of `function` over the axes."""
        assert self.function is not None
        grid = Grid(axes, skip=self.skip)
        check_size(grid)
        try:
            fixed = dict(self.constants(settings))
            if self.check is not None:
                self.check(axes, fixed)
        except ValueError as problem:
            raise InputError(str(problem)) from problem
        return Sweep(
            self.name,
            self.function,
            grid,
            self.variables,
            fixed,
            coords=self.coords(**fixed) if callable(self.coords) else self.coords,
            code=("fivcore",),
            title=self.title,
            derive=None if self.derive is None else partial(self.derive, **fixed),
            **self.options,
        )


def deferred(place: str) -> Callable[[xr.Dataset], Any]:
    """The function at `module:name`, imported when called: drawing is slow to import, and workers never draw."""

    def call(dataset: xr.Dataset) -> Any:
        module, _, name = place.partition(":")
        return getattr(import_module(module), name)(dataset)

    return call


def constants(dataset: xr.Dataset) -> dict[str, Any]:
    """Constants of a result's function, from the file's configuration."""
    values: dict[str, Any] = json.loads(dataset.attrs["configuration"])["constants"]
    return values


def suggest(name: str, names: list[str]) -> str:
    """'did you mean ...? ' for a near miss, else nothing."""
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f"did you mean {near[0]}? " if near else ""


def _axis(name: str, value: Any, own: Axis) -> Axis:
    """The axis with other values, sorted, each once; of one of texts some of its own, in its own order."""
    if own.values.dtype.kind == "U":
        texts = np.atleast_1d(np.asarray(value, dtype=object))
        for text in texts.ravel().tolist():
            if text not in own.values.tolist():
                every = own.values.tolist()
                near = suggest(str(text), every) or f"it must be one of {', '.join(every[:8])}"
                raise InputError(f"{name} = {text!r}: there is no such {name}; {near.rstrip()}")
        return replace(own, values=own.values[np.isin(own.values, texts.astype(str))])
    values = _numbers(name, value, "a number or a list of numbers")
    if own.values.dtype.kind == "i":
        whole = (values == np.rint(values)) & (np.abs(values) < 2**53)
        if not np.all(whole):
            raise InputError(f"{name} = {values[~whole][0]:g}: it must be a whole number")
    return Axis(np.unique(values).astype(own.values.dtype), own.units, own.long_name)


def _numbers(name: str, value: Any, allowed: str) -> np.ndarray:
    """One or more finite numbers as an array of one dimension."""
    try:
        values = np.atleast_1d(np.asarray(value))
    except ValueError:
        values = np.empty((0, 0))
    if values.dtype.kind not in "iuf" or values.ndim != 1 or not len(values):
        raise InputError(f"{name} = {value!r}: it must be {allowed}")
    if not np.all(np.isfinite(values)):
        raise InputError(f"{name} = {values[~np.isfinite(values)][0]}: it must be finite")
    return values.astype(float)


def one_word(name: str, value: Any, words: Sequence[str]) -> str:
    """The one of the words that is asked for, alone or as a list of one."""
    entries = np.atleast_1d(np.asarray(value, dtype=object)).ravel().tolist()
    if len(entries) != 1 or entries[0] not in words:
        raise InputError(f"{name} = {', '.join(map(repr, entries))}: it must be one of {', '.join(words)}")
    return str(entries[0])


def _one_number(study: str, name: str, value: Any) -> float:
    values = _numbers(name, value, "one number")
    if len(values) != 1:
        listed = ", ".join(f"{v:g}" for v in values[:5])
        hint = (
            f"; to vary it: fiv map --x {name}={spec.written(values)} --quantity NAME, or fiv run {study} --points"
        )
        raise InputError(f"{name} = {listed}: study {study} holds it fixed, so it must be one number{hint}")
    return float(values[0])
