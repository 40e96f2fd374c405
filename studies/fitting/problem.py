"""The problem of a fit as its file states it: unknowns with their priors, and targets with what predicts them."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fivcore import Structure, checks
from studies import request, spec, uncertainty
from studies.fitting.structures import parameters, varied
from studies.gallery import maps
from studies.parameters import suggest, unusual, warn_unusual
from studies.results import expanded
from sweeps import Axis, InputError

if TYPE_CHECKING:
    from studies.study import Study
    from sweeps import Sweep

KEYS = ("name", "rig", "set", "unknown", "target", "samples", "rounds", "seed")
TARGET_KEYS = ("name", "study", "at", "output", "value", "within", "is")
DEFAULTS = {"name": "fit", "set": {}, "unknown": {}, "target": [], "samples": 256, "rounds": 4, "seed": 0}
MOST_ROUNDS = 100
# Draws by which a study checks priors before a run.
CHECKED = 16


@dataclass(frozen=True, eq=False)
class Group:
    """A study's sweep at fixed parameters; `unknowns` are names of unknowns by the parameters that have them."""

    study: Study
    sweep: Sweep
    unknowns: Mapping[str, str]
    points: Mapping[str, Any]
    count: int

    def outputs(self, draw: Mapping[str, float], structure: Structure | None) -> dict[str, Any]:
        """Each output at the points, (points, entries), where the unknowns have the values of a draw."""
        drawn = {name: np.full(self.count, draw[unknown]) for name, unknown in self.unknowns.items()}
        points, changed = {**self.points, **drawn}, {} if structure is None else {"structure": structure}
        found = dict(self.sweep.function(points, **{**self.sweep.constants, **changed}))
        for problem in found.pop("error", ()):
            if problem is not None:
                raise problem
        factors = {"": np.ones(self.count), **(self.sweep.scale(points) if self.sweep.scale else {})}
        rows = {name: np.asarray(found[name]).reshape(self.count, -1) for name in self.sweep.variables}
        return {name: factors[self.sweep.variables[name].scale][:, None] * row for name, row in rows.items()}


@dataclass(frozen=True)
class Target:
    """One number that was measured, or one statement, which counts with the share of its entries in `codes`.

    `group`, `output`, `point` and `entries` say where its prediction is.
    """

    name: str
    text: str
    units: str
    value: float
    within: float
    codes: tuple[int, ...]
    group: int
    output: str
    point: int
    entries: tuple[int, ...]
    has_error: bool


@dataclass(frozen=True, eq=False)
class Problem:
    """Priors by the names of the unknowns, targets, and what predicts these."""

    name: str
    priors: Mapping[str, uncertainty.Distribution]
    axes: Mapping[str, tuple[str, str]]  # units and long name of each unknown
    targets: Sequence[Target]
    groups: Sequence[Group]
    structure: Structure | None
    samples: int
    rounds: int
    seed: int

    def predictions(self, draw: Mapping[str, float]) -> dict[str, float]:
        """The prediction of each target, and its standard error where the study computes one."""
        of_beams = {name for group in self.groups for name in group.unknowns.values()}
        own = {name: value for name, value in draw.items() if name not in of_beams}
        structure = varied(self.structure, own) if self.structure is not None and own else None
        outputs, found = [group.outputs(draw, structure) for group in self.groups], dict[str, float]()
        for each in self.targets:
            values = outputs[each.group][each.output][each.point, list(each.entries)]
            found[each.name] = float(np.isin(values, each.codes).mean() if each.codes else values[0])
            if each.has_error:
                error = outputs[each.group][f"{each.output}_se"][each.point, each.entries[0]]
                found[f"{each.name}_se"] = float(error)
        return found


def read(content: str | Path | Mapping[str, Any], resolve: Callable[[str], Study], **options: Any) -> Problem:
    """The problem of a TOML file, or of a mapping like its content.

    `resolve` finds a study by its name; options are `samples`, `rounds` and `seed`, None where the file decides. An
    `InputError` names the file, the unknown or the target, and what is wrong with it.
    """
    if isinstance(content, Mapping):
        where, folder, found = "", Path(), dict(content)
    else:
        where, file = f"{content}: ", expanded(content)
        try:
            folder, found = file.parent, {"name": file.stem, **tomllib.loads(file.read_text("utf-8"))}
        except OSError as problem:
            raise InputError(f"{where}it cannot be read: {problem.strerror}") from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as problem:
            raise InputError(f"{where}it is not TOML: {problem}") from None
    try:
        _check_keys("", found, KEYS)
        found = {**DEFAULTS, **found, **{name: value for name, value in options.items() if value is not None}}
        return _problem(found, folder, resolve)
    except InputError as problem:
        raise InputError(f"{where}{problem}") from None


def _check_keys(what: str, table: Mapping[str, Any], known: Sequence[str]) -> None:
    for key in table:
        if key not in known:
            raise InputError(f"{what}{key}: no such key; {suggest(key, known)}the keys are {', '.join(known)}")


def _problem(found: Mapping[str, Any], folder: Path, resolve: Callable[[str], Study]) -> Problem:
    for key, kind in (("set", dict), ("unknown", dict), ("target", list)):
        if not isinstance(found[key], kind) or not (found[key] or key == "set"):
            example = {"unknown": "a table with NAME = a distribution", "target": "tables [[target]]"}
            raise InputError(f"{key} = {found[key]!r}: it must be {example.get(key, 'a table of values')}")
    if not re.fullmatch(r"\w[\w-]*", str(found["name"])):
        raise InputError(f"name = {found['name']!r}: it must be of letters, digits, _ and -")
    samples = checks.count("samples", found["samples"], uncertainty.MOST_SAMPLES)
    rounds = checks.count("rounds", found["rounds"], MOST_ROUNDS)
    uncertainty.check(samples, found["seed"])
    rig = request.read(folder / str(found["rig"]), "rig") if "rig" in found else request.Request()
    reader = _Reader({**rig.values, **found["set"]}, found["unknown"], rig.structure, resolve)
    for number, table in enumerate(found["target"], 1):
        who = f"target {table.get('name') or table.get('output') or number}: " if isinstance(table, dict) else ""
        try:
            if not who:
                raise InputError(f"target = {table!r}: it must be a table")
            _check_keys("", table, TARGET_KEYS)
            reader.add(table)
        except InputError as problem:
            raise InputError(f"{who}{problem}") from None
    for name in [*found["unknown"], *found["set"]]:
        if name not in reader.taken and name not in reader.priors:
            raise InputError(f"{name}: no target depends on it; {suggest(name, reader.taken)}".rstrip("; "))
    priors = {name: reader.priors[name] for name in found["unknown"]}
    known = reader.targets, reader.groups, reader.structure, samples, rounds, int(found["seed"])
    return Problem(str(found["name"]), priors, reader.axes, *known)


class _Reader:
    """Collects what the tables of targets say."""

    def __init__(self, fixed: Any, unknown: Any, structure: Any, resolve: Callable[[str], Study]) -> None:
        self.fixed, self.unknown, self.resolve = fixed, unknown, resolve
        self.structure = Structure.from_dict(structure) if structure else None
        self.own = parameters(self.structure) if self.structure else {}
        self.taken, self.targets, self.groups = set(self.own), list[Target](), list[Group]()
        self.priors, self.axes = dict[str, uncertainty.Distribution](), dict[str, tuple[str, str]]()
        self._known = dict[str, int]()

    def add(self, table: Mapping[str, Any]) -> None:
        """A target for each value, or for each point of a statement."""
        states, outputs = "is" in table, table.get("output", "regime")
        outputs = outputs if isinstance(outputs, list) else [outputs]
        if states == ("value" in table) or states == ("within" in table) or not (states or "output" in table):
            raise InputError("it must have output, value and within, or is")
        if states and "study" not in table:
            # A map's motion, of which every realisation counts.
            table = {**table, "study": "regimes", "at": {"numerical_damping": "none", **table.get("at", {})}}
        study = self.resolve(table["study"]) if "study" in table else maps.STUDIES[maps.quantity_group(outputs[0])]
        group, at = self._group(study, table.get("at", {})), table.get("at", {})
        places = [(name, *place) for name in outputs for place in self._places(group, name, at, states)]
        variable = group.sweep.variables[outputs[0]]
        if states != bool(variable.flags):
            kind = "words; write is = ..." if variable.flags else "numbers; write value and within"
            raise InputError(f"{outputs[0]} has {kind}")
        codes, values, widths = (), [1.0] * len(places), [0.0] * len(places)
        if states:
            codes = _codes(table["is"], variable.flags or {})
        else:
            values, widths = _numbers(table["value"], table["within"], variable.units)
        if len(values) != len(places) or len(widths) != len(places):
            raise InputError(
                f"{', '.join(outputs)} has {len(places)} entries, value {len(values)}, within {len(widths)}: "
                "choose one entry in at, or give as many values"
            )
        names = [table.get("name", output) for output, *_ in places]
        for k, (output, point, entries) in enumerate(places):
            name = f"{names[k]}_{k + 1}" if names.count(names[k]) > 1 else names[k]
            if name in {*self.unknown, *(each.name for each in self.targets)}:
                raise InputError(f"there are two of the name {name}; give one another name")
            about = group.sweep.variables[output]
            text = f"share of members: {table['is']}" if states else about.long_name
            units, error = "1" if states else about.units, not states and f"{output}_se" in group.sweep.variables
            output = _of_members(group, output, states)
            place = self.groups.index(group), output, point, entries, error
            self.targets.append(Target(name, text, units, values[k], widths[k], codes, *place))

    def _group(self, study: Study, at: Mapping[str, Any]) -> Group:
        """The group of a study at these parameters, made when it is first needed."""
        takes = set(study.known(self.structure))
        dims = {dim for variable in study.outputs.values() for dim in variable.dims} - study.parameters.keys()
        values = {n: v for n, v in self.fixed.items() if n in takes} | {n: v for n, v in at.items() if n not in dims}
        unknowns = {p: n for n in self.unknown for p in (n, f"p1_{n}", f"p2_{n}") if p in takes}
        self.taken |= takes
        if (key := f"{study.name} {values}") in self._known:
            return self.groups[self._known[key]]
        if not unknowns and not self.own.keys() & self.unknown:
            raise InputError(f"study {study.name} depends on no unknown: {', '.join(self.unknown)}")
        for name in self.unknown.keys() & {*unknowns.values(), *self.own}:
            if name in values:
                raise InputError(f"{name}: it is unknown and has a value; leave one out")
            of_study = next((p for p, n in unknowns.items() if n == name), "")
            parameter = study.parameters[of_study] if of_study else self.own[name]
            text = uncertainty.text_of(self.unknown[name], name)
            self.priors[name] = uncertainty.parse(text, of_study or re.sub(r"_\d+$", "", name), parameter.units)
            self.axes[name] = parameter.units, re.sub(" of P1$", "", parameter.text)
        drawn = {parameter: self.priors[name].text for parameter, name in unknowns.items()}
        asked = request.Request(study.name, {**values, **drawn})
        numbers = asked.values_of(study)
        structure = self.structure and self.structure.to_dict()
        sweep = study.sweep(numbers, structure=structure, samples=CHECKED)
        for name in drawn.keys() - sweep.grid.axes.keys():
            raise InputError(f"{name}: study {study.name} draws it itself; take another study")
        lines = unusual({name: v for name, v in numbers.items() if name in values and v is not None}, values)
        warn_unusual([line for line in lines if not asked.bears_unit(line.partition(" ")[0])], strict=False)
        # The points of the sweep at one draw.
        grid = sweep.grid
        one = grid.points(np.arange(grid.size // CHECKED) if drawn else None)
        points = {name: values for name, values in one.items() if name not in drawn and name != "sample"}
        self._known[key] = len(self.groups)
        self.groups.append(Group(study, sweep, unknowns, points, len(next(iter(one.values())))))
        return self.groups[-1]

    def _places(self, group: Group, output: str, at: Mapping[str, Any], states: bool) -> list[tuple[int, Any]]:
        """The point and the entries of each target of an output: one entry, or of a statement all of a point."""
        variables, grid = group.sweep.variables, group.sweep.grid
        if output not in variables:
            near = suggest(output, variables)
            raise InputError(f"study {group.study.name} computes no {output}; {near}it has {', '.join(variables)}")
        for name in group.points if states else ():
            if len(grid.axes[name]) > 1 and name not in {**at, **self.fixed}:
                raise InputError(f"{name}: study {group.study.name} has a range of it; give its value in at")
        dims = variables[_of_members(group, output, states)].dims
        axes = {dim: group.sweep.coords.get(dim, grid.axes.get(dim)) for dim in dims}
        index = np.arange(int(np.prod([len(axis) for axis in axes.values()]))).reshape([len(a) for a in axes.values()])
        chosen = index[np.ix_(*(_entries(dim, axis, at.get(dim)) for dim, axis in axes.items()))].ravel().tolist()
        points = range(group.count)
        return [(k, tuple(chosen)) for k in points] if states else [(k, (e,)) for k in points for e in chosen]


def _of_members(group: Group, output: str, states: bool) -> str:
    """The output that has the words of a statement, of every realisation where there are several."""
    return f"member_{output}" if states and f"member_{output}" in group.sweep.variables else output


def _entries(dim: str, axis: Axis, value: Any) -> Any:
    """Places along a dimension of an output: all, or that of a value."""
    if value is None:
        return np.arange(len(axis))
    found = np.flatnonzero(axis.values == (value if axis.values.dtype.kind == "U" else spec.one(str(value), dim)))
    if not len(found):
        raise InputError(f"{dim} = {value}: it must be one of {', '.join(map(str, axis.values[:12].tolist()))}")
    return found


def _codes(given: Any, flags: Mapping[int, str]) -> tuple[int, ...]:
    """The flags that a statement allows: those of a word, of a list of words, or all but those after "not "."""
    negative = isinstance(given, str) and given.startswith("not ")
    words = [given.removeprefix("not ")] if isinstance(given, str) else list(given)
    for word in words:
        if word not in flags.values():
            near = suggest(str(word), flags.values())
            raise InputError(f"is = {word!r}: {near}it must be one of {', '.join(flags.values())}")
    return tuple(code for code, word in flags.items() if (word in words) != negative)


def _numbers(value: Any, within: Any, units: str) -> tuple[list[float], list[float]]:
    """Measured values and their standard deviations; an `InputError` for one without the unit that it needs."""
    found = list[Any]()
    for name, given in (("value", value), ("within", within)):
        text = ", ".join(map(str, given)) if isinstance(given, list) else str(given)
        relative = name == "within" and text.rstrip().endswith("%")
        if not relative and units != "1" and not re.search(r"[A-Zabcdf-zµ°]", text):
            raise InputError(f"{name} = {text}: it needs its unit, for example {text.split(',')[-1].strip()} {units}")
        found.append(spec.parse(text, name, "1" if relative else units) * (np.abs(found[0]) if relative else 1.0))
    values, widths = found[0], found[1] if len(found[1]) > 1 else np.repeat(found[1], len(found[0]))
    if not np.all(widths > 0.0):
        raise InputError(f"within = {widths.min():g}: it must be above 0, one standard deviation")
    return values.tolist(), widths.tolist()
