"""The request of a run: values of parameters from the command line, a TOML file, a table, or a result."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import sweeps
from fivcore import Structure
from studies.answering.results import configuration, expanded, open_dataset, settings, structure_in
from studies.asking.own import of_structure
from studies.declaring import spec
from studies.declaring.parameters import KNOWN, USUAL_RANGES, check_keys
from studies.declaring.units import convert
from sweeps import InputError

if TYPE_CHECKING:
    import xarray as xr

    from studies.study import Study

# Keys of a file with the types of their values; "set" and "scatter" are tables of parameters.
KEYS: dict[str, tuple[tuple[type, ...], str]] = {
    "set": ((dict,), "a table"),
    "scatter": ((dict,), "a table of strings like 'normal:0.2:0.02'"),
    "points": ((str, dict), "a file or a table"),
    "record": ((list,), "a list of strings"),
    "sample_rate": ((int, float, str), "a number or a text like '20kHz'"),
    **dict.fromkeys(("study", "scheduler"), ((str,), "a string")),
    **dict.fromkeys(("samples", "seed", "workers"), ((int,), "a whole number")),
}
DRAWS = ("samples", "seed")
# A file with one of these is of a structure (`fivcore.Structure.read`).
STRUCTURE = ("mass", "stiffness", "modes", "mode")
# What a named rig holds of one: `Structure.to_dict`.
KEPT = "structure"
MOST_ROWS = 1_000_000


@dataclass(frozen=True)
class Request:
    """The request of a run: the study, and the options of the command line.

    `values` maps a parameter to a SPEC, a distribution (`normal:0.2:0.02`, or one of SciPy's), a word, a number,
    or a list of these; `points` is a CSV file, a DataFrame, or columns by name, with one point in each row;
    `structure` is `Structure.to_dict` of one in place of the rig; `command` is the command line.

    The `sides` of a map are the parameters across and upwards. Their intervals are halved `refine` times where the
    first of its `quantities` changes, or where interpolation is off by more than `tolerance` of its range.

    `rig` is the name of the rig in whose folder the results lie, and `base` are the numbers of that rig.
    """

    study: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)
    points: Any = None
    record: tuple[str, ...] = ()
    sample_rate: float | str | None = None
    samples: int | None = None
    seed: int | None = None
    scheduler: str | None = None
    workers: int | None = None
    structure: Mapping[str, Any] | None = None
    command: str = ""
    sides: tuple[str, ...] = ()
    quantities: tuple[str, ...] = ()
    refine: int = 0
    tolerance: float | None = None
    rig: str = ""
    base: Mapping[str, Any] | None = None

    def over(self, other: Request) -> Request:
        """The values of this request, and values of another request for parameters that this one lacks."""
        ours = {name: value for name, value in vars(self).items() if value not in ("", (), None)}
        if self.scheduler or self.workers:
            ours |= {"scheduler": self.scheduler, "workers": self.workers}
        return replace(other, **ours | {"values": {**other.values, **self.values}})

    def values_of(self, study: Study) -> dict[str, Any]:
        """The values of the study's parameters: numbers, arrays, words or distributions."""
        study = of_structure(study, self.structure)
        how = {name: getattr(self, name) for name in DRAWS if name in study.parameters}
        values = {**self.values, **{name: value for name, value in how.items() if value is not None}}
        counts = {name: len(p.default) for name, p in study.parameters.items() if p.is_axis}
        # More points than a plan can hold are refused before their values are made.
        for name, value in values.items():
            if isinstance(value, str) and not study.parameter(name, self.structure).choices:
                count = 1 if is_distribution(value) else spec.count(value)
                counts[name] = (count - 1) * 2**self.refine + 1 if name in self.sides else count
            elif np.ndim(value):
                counts[name] = np.size(value)
        sweeps.check_counts(counts or {"points": 1})
        read = {name: _read(study, name, value) for name, value in values.items()}
        halved = self.sides if self.refine else ()
        units = {name: study.parameters[name].units for name in halved}
        return read | {name: spec.refined(values[name], name, self.refine, units[name]) for name in halved}

    def points_of(self, study: Study) -> dict[str, Any]:
        """Arguments of `asking.sweep.sweep_of` besides the values."""
        table = None if self.points is None else rows(of_structure(study, self.structure), self.points)
        rate = self.sample_rate
        rate = spec.one(rate, "sample_rate", "Hz") if isinstance(rate, str) else rate
        how: dict[str, Any] = {"record": self.record, "sample_rate": rate, "rows": table}
        how["structure"] = self.structure
        drawn = any(is_distribution(value) for value in self.values.values())
        for name in DRAWS:
            if (value := getattr(self, name)) is not None and name not in study.parameters:
                if not drawn:
                    raise InputError(f"{name} = {value}: it is for draws; give a distribution, mu=normal:0.2:0.02")
                how[name] = value
        return how

    def stored(self) -> dict[str, Any]:
        """The parts of the request that a result's file stores besides its parameters."""
        from studies.motion.uncertainty import text_of

        drawn = {name: text_of(v, name) for name, v in self.values.items() if is_distribution(v)}
        rest = {"record": list(self.record), "scatter": drawn, "seed": self.seed, "command": self.command}
        if self.sides:
            rest |= {"x": self.sides[0], "quantities": list(self.quantities)}
        return {name: value for name, value in rest.items() if value}

    def has_unit(self, name: str) -> bool:
        """Whether a value was typed with a unit."""
        value = self.values.get(name)
        return isinstance(value, str) and spec.has_unit(value)


def is_distribution(value: Any) -> bool:
    """Whether a value is a distribution, or the text of one."""
    from studies.motion.uncertainty import is_kind

    return hasattr(value, "ppf") or (isinstance(value, str) and is_kind(value.partition(":")[0].strip()))


def _read(study: Study, name: str, value: Any) -> Any:
    """A value of a parameter; a string is a word, a SPEC or a distribution."""
    parameter = study.parameter(name)
    if hasattr(value, "ppf") and not hasattr(value, "text"):
        from studies.motion.uncertainty import text_of

        value = text_of(value, name)
    if not isinstance(value, str):
        return value
    if parameter.choices:
        return spec.listed(value, parameter.choices)
    if value.strip() == "auto":
        return None if parameter.default is None else "auto"
    if is_distribution(value) or re.match(r"\s*(?!log:)[a-z]\w*:", value):
        from studies.motion.uncertainty import parse

        if re.search(r"\d,\d", value):
            raise InputError(f"{name} = {value!r}: a point is the decimal sign; write {value.replace(',', '.')}")
        return parse(value, name, parameter.units)
    if not parameter.is_whole:
        kind = name.removeprefix("p1_").removeprefix("p2_")
        largest = USUAL_RANGES[kind][1] if kind in USUAL_RANGES and name in KNOWN else np.inf
        known = KNOWN.get(name, parameter).default
        usual = 0.0 if known is None else float(np.max(np.abs(known)))
        spec.check_commas(value, name, parameter.units, usual, largest)
    values = spec.parse(value, name, parameter.units)
    if name == "V" and study.moves and not np.all(values):
        raise InputError("V = 0: the drive must move; usual are {:g} to {:g} m/s".format(*USUAL_RANGES["V"]))
    return values


def assignment(text: str, option: str = "--set") -> tuple[str, str]:
    """The two sides of NAME=SPEC."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip():
        raise InputError(f"{option} {text!r}: it must be NAME=VALUE, for example mu=0:0.5:101")
    if several := re.split(r",\s*(?=[A-Za-z_]\w*\s*=)", text)[1:]:
        raise InputError(f"{option} {text!r}: give each parameter its own option: {option} {several[0]}")
    return name.strip(), value.strip()


def structure_of(rig: Structure | str | Path) -> dict[str, Any]:
    """`to_dict` of a structure: of an object, of a TOML file, or of a result's file."""
    if not isinstance(rig, Structure) and Path(rig).suffix == ".nc":
        if not (found := structure_in(open_dataset(os.fspath(rig)))):
            raise InputError(
                f"{rig}: it is a result of the paper's beams; give one of a structure, or a FILE.toml"
            )
        return found
    return own_structure(rig).to_dict()


def own_structure(rig: Structure | str | Path) -> Structure:
    """The structure of `structure_of`, with the eigenvectors that its TOML file requests."""
    if isinstance(rig, Structure):
        return rig
    if Path(rig).suffix == ".nc":
        return Structure.from_dict(structure_of(rig))
    with toml(rig, str(rig)) as content:
        if isinstance(kept := content.get(KEPT), dict):
            return Structure.from_dict(_kept(kept))
    try:
        return Structure.read(path := expanded(rig))
    except ValueError as problem:
        raise InputError(f"{rig}: {str(problem).removeprefix(f'{path}: ')}") from None


def _kept(content: Mapping[str, Any]) -> dict[str, Any]:
    """`to_dict` of the structure in the file of a named rig, in which None is left out."""

    def whole(given: Mapping[str, Any]) -> dict[str, Any]:
        wider = whole(given["wider"]) if "wider" in given else None
        return {"rayleigh": None, "cutoff": None, **given, "wider": wider}

    try:
        return Structure.from_dict(whole(content)).to_dict()
    except (KeyError, TypeError) as problem:
        raise InputError(f"{KEPT}: it is damaged: {problem}") from None


def read(file: str | Path, option: str = "--config") -> Request:
    """The request in a TOML file, or for the structure in it; an `InputError` says what is wrong with the file."""
    if Path(file).suffix == ".nc":
        return Request(structure=structure_of(file))
    with toml(file, f"{option} {file}") as content:
        if not content.keys().isdisjoint((*STRUCTURE, KEPT)):
            values = content.get("set", {}) if KEPT in content else {}
            return Request(values=values, structure=structure_of(file))
        check_keys(content, KEYS, f"; of a structure {' or '.join(STRUCTURE)}")
        for key, value in content.items():
            kinds, allowed = KEYS[key]
            if not isinstance(value, kinds) or isinstance(value, bool):
                raise InputError(f"{key} = {value!r}: it must be {allowed}")
        values, scatter = content.pop("set", {}), content.pop("scatter", {})
        if not all(isinstance(word, str) for word in (*scatter.values(), *content.get("record", ()))):
            raise InputError("scatter and record: their values must be strings")
        for name in values.keys() & scatter.keys():
            raise InputError(f"{name}: it is in set and in scatter; give one of the two")
        return Request(**{**content, "values": values | scatter, "record": tuple(content.get("record", ()))})


@contextmanager
def toml(file: str | Path, where: str) -> Iterator[dict[str, Any]]:
    """The content of a TOML file; an `InputError`, also one raised while it is used, begins with `where`."""
    try:
        yield tomllib.loads(expanded(file).read_text("utf-8"))
    except OSError as problem:
        raise InputError(f"{where}: it cannot be read: {problem.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as problem:
        raise InputError(f"{where}: it is not TOML: {problem}") from None
    except ValueError as problem:
        raise InputError(f"{where}: {str(problem).removeprefix(f'{file}: ')}") from None


def of_result(dataset: xr.Dataset, whose: str = "dataset") -> Request:
    """The request that computes a result again."""
    configured = configuration(dataset)
    if "name" not in configured:
        raise InputError(f"{whose}: it does not say what it was computed from; give the file of a result")
    if (dataset["status"] == sweeps.INTERPOLATED).any():
        raise InputError(f"{whose}: it is a refined map; compute it again with fiv map")
    request, constants = configured.get("request", {}), configured["constants"]
    scatter, record = request.get("scatter", {}), tuple(request.get("record", ()))
    axes = {name: dataset[name].values for name in configured["axes"] if name not in (*scatter, "sample", "row")}
    points = {name: value for name, value in axes.items() if dataset[name].dims == ("row",)} or None
    values = {name: "auto" if value is None else value for name, value in settings(dataset).items()}
    values |= {name: value for name, value in constants.items() if isinstance(value, list) and name != "record"}
    values |= {name: value for name, value in axes.items() if name not in (points or ())} | scatter
    how = {"seed": request["seed"]} if "seed" in request else {}
    if "sample" in dataset.dims:
        how["samples"] = dataset.sizes["sample"]
    rate = constants.get("sample_rate") if record and "sample_rate" not in values else None
    structure = structure_in(dataset) or None
    if "quantities" in request:
        dims = sorted(map(str, dataset["status"].dims), key=lambda dim: dim != request["x"])
        how |= {"sides": tuple(dims), "quantities": tuple(request["quantities"])}
    return Request(configured["name"], values, points, record, rate, structure=structure, **how)


def rows(study: Study, points: Any) -> dict[str, Any]:
    """The columns of a CSV file or DataFrame, or by name, in the study's units; heads are NAME or NAME [UNIT]."""
    import pandas as pd

    columnar = isinstance(points, (Mapping, pd.DataFrame))
    where = "points" if columnar else f"points = {points}"
    try:
        if columnar:
            table = points
            if isinstance(points, Mapping):
                table = pd.DataFrame({name: np.atleast_1d(np.asarray(column)) for name, column in points.items()})
            heads = [str(head) for head in table]
        else:
            # Without a header pandas renames no head and takes no column as an index.
            text: dict[str, Any] = {"dtype": str, "keep_default_na": False, "encoding": "utf-8-sig"}
            table = pd.read_csv(expanded(points), header=None, nrows=MOST_ROWS + 2, **text).fillna("")
            heads, table = table.iloc[0].tolist(), table.iloc[1:]
    except OSError as problem:
        raise InputError(f"{where}: it cannot be read: {problem.strerror}") from None
    except ValueError as problem:
        raise InputError(
            f"{where}: it is no table with commas and a head for each column: {str(problem).strip()}"
        ) from None
    if not 0 < len(table) <= MOST_ROWS:
        raise InputError(f"{where}: it has {len(table)} rows; it must have from 1 to {MOST_ROWS}")
    columns: dict[str, Any] = {}
    for head, cells in zip(heads, table.to_numpy().T, strict=True):
        name, _, unit = (part.strip() for part in head.rstrip("] \t").partition("["))
        row, values = 0, []
        try:
            if len(heads) == 1 and (marks := [mark for mark in ";\t" if mark in head.strip()]):
                raise InputError(f"its columns are separated by {marks[0]!r}; separate them by commas")
            if name in columns:
                raise InputError(f"column {name} occurs twice; leave one out")
            own, words = study.parameter(name).units, study.parameters[name].choices
            for cell in map(str, cells):
                row += 1
                number = 0.0 if words else convert(spec.finite(cell), unit or own, own, name)
                values.append(cell.strip() if words else number)
        except InputError as problem:
            raise InputError(f"{where}: {f'row {row}, column {name}: ' if row else ''}{problem}") from None
        columns[name] = values
    return columns
