"""The problem of a fit as its file states it: unknowns with their priors, and targets with their predictions."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fivcore import Structure, checks
from studies.asking import request
from studies.asking.rigs import NamedRig, is_name
from studies.asking.sweep import sweep_of
from studies.declaring import spec
from studies.declaring.own import parameters, varied
from studies.declaring.parameters import Parameter, check_keys, suggest, unusual, warn_unusual
from studies.motion import uncertainty
from studies.registry import names_for, of_quantities
from studies.study import Study
from sweeps import InputError, Sweep

DEFAULTS = {"name": "fit", "set": {}, "unknown": {}, "target": [], "samples": 128, "rounds": 4, "seed": 0}
TABLES = {"set": "a table of values", "unknown": "a table of distributions", "target": "tables [[target]]"}
TARGET_KEYS = ("name", "study", "at", "output", "value", "within", "is")
MOST_ROUNDS = 100
# What a result has besides unknowns and targets.
TAKEN = ("draw", "round", "weight")
# Draws by which a study checks priors.
CHECKED = 16


@dataclass(frozen=True, eq=False)
class Source:
    """A study at fixed parameters that predicts targets; `unknowns` by the parameters that they set."""

    study: Study
    values: Mapping[str, Any]
    unknowns: Mapping[str, str]


@dataclass(frozen=True)
class Target:
    """A measured number, or a statement, whose value is the fraction of members in `codes`.

    The prediction is entry `entry` of an output of a source, where dimensions of its own are as in `chosen`.
    """

    name: str
    text: str
    units: str
    value: float
    within: float
    codes: tuple[int, ...]
    source: int
    output: str
    chosen: Mapping[str, Any]
    entry: int
    has_error: bool


@dataclass(frozen=True, eq=False)
class Model:
    """Targets, the studies that predict them, and the structure, if any."""

    targets: Sequence[Target]
    sources: Sequence[Source]
    structure: Structure | None


@dataclass(frozen=True, eq=False)
class Problem:
    """Priors by the names of the unknowns, with units and long names, and the model; draws of a round, rounds."""

    name: str
    priors: Mapping[str, uncertainty.Distribution]
    axes: Mapping[str, tuple[str, str]]
    model: Model
    samples: int
    rounds: int
    seed: int


def read(
    content: str | Path | Mapping[str, Any],
    resolve: Callable[[str], Study],
    rig: NamedRig | None = None,
    **options: Any,
) -> Problem:
    """The problem of a TOML file, or of a mapping like its content, which may name no `rig` where one is given.

    `resolve` finds a study by its name; options are `samples`, `rounds` and `seed`, None where the file decides.
    An `InputError` names the file, the unknown or the target, and what is wrong with it.
    """
    given = {name: value for name, value in options.items() if value is not None}
    if isinstance(content, Mapping):
        return _problem({**DEFAULTS, **content, **given}, Path(), resolve, rig)
    with request.toml(content, str(content)) as table:
        own = {**DEFAULTS, "name": Path(content).stem, **table, **given}
        return _problem(own, Path(content).parent, resolve, rig)


def _problem(
    found: Mapping[str, Any], folder: Path, resolve: Callable[[str], Study], named: NamedRig | None
) -> Problem:
    check_keys(found, (*DEFAULTS, "rig"))
    for key, what in TABLES.items():
        if type(found[key]) is not type(DEFAULTS[key]) or not (found[key] or key == "set"):
            raise InputError(f"{key} = {found[key]!r}: it must be {what}")
    if not re.fullmatch(r"\w[\w-]*", str(found["name"])):
        raise InputError(f"name = {found['name']!r}: it must be of letters, digits, _ and -")
    rounds = checks.count("rounds", found["rounds"], MOST_ROUNDS)
    uncertainty.check(found["samples"], found["seed"])
    if named is not None and "rig" in found:
        raise InputError(f"rig = {found['rig']!r}: there is another rig already; leave one out")
    if is_name(found.get("rig")):
        text = "in a file it is a path; leave it out, and give the name as rig=..."
        raise InputError(f"rig = {found['rig']!r}: {text}")
    rig = request.read(folder / str(found["rig"]), "rig") if "rig" in found else named or request.Request()
    unknown = {p for name in found["unknown"] for p in (name, f"p1_{name}", f"p2_{name}")}
    fixed = {name: value for name, value in rig.values.items() if named is None or name not in unknown}
    reader = _Reader({**fixed, **found["set"]}, found["unknown"], rig.structure, resolve)
    for number, table in enumerate(found["target"], 1):
        who = f"target {number}"
        try:
            checks.instance("target", table, dict)
            who = f"target {table.get('name') or ', '.join(_listed(table.get('output', []))) or number}"
            check_keys(table, TARGET_KEYS)
            reader.add(table)
        except ValueError as problem:
            raise InputError(f"{who}: {problem}") from None
    for name in [*found["unknown"], *found["set"]]:
        if name not in reader.taken and name not in reader.priors:
            raise InputError(f"{name}: no target depends on it; {suggest(name, reader.taken)}".rstrip("; "))
    priors = {name: reader.priors[name] for name in found["unknown"]}
    if reader.structure:
        varied(reader.structure, {n: float(priors[n].ppf(0.5)) for n in priors.keys() & reader.own.keys()})
    model = Model(reader.targets, reader.sources, reader.structure)
    numbers = int(found["samples"]), rounds, int(found["seed"])
    return Problem(str(found["name"]), priors, reader.axes, model, *numbers)


class _Reader:
    """Collects targets and sources from the tables of a file."""

    def __init__(self, fixed: Any, unknown: Any, structure: Any, resolve: Callable[[str], Study]) -> None:
        self.fixed, self.unknown, self.resolve = fixed, unknown, resolve
        self.structure = Structure.from_dict(structure) if structure else None
        self.own = parameters(self.structure) if self.structure else {}
        self.taken, self.targets, self.sources = set(self.own), list[Target](), list[Source]()
        self.priors, self.axes = dict[str, uncertainty.Distribution](), dict[str, tuple[str, str]]()
        self._sweeps = dict[str, tuple[int, Sweep]]()

    def add(self, table: Mapping[str, Any]) -> None:
        """A target for each value, or for each point of a statement."""
        checks.instance("at", at := table.get("at", {}), dict)
        states = "is" in table
        outputs = _listed(table.get("output", ["regime"] * states))
        if states in ("value" in table, "within" in table) or not outputs:
            raise InputError("it must have output, value and within, or is")
        if "study" in table:
            study = self.resolve(table["study"])
        elif states:
            # A map's motion, of which every realisation counts.
            study, at = self.resolve(names_for("states")[0]), {"numerical_damping": "none", **at}
        else:
            study = of_quantities(outputs[:1])
        dims = {dim for variable in study.outputs.values() for dim in variable.dims} - study.parameters.keys()
        chosen = {name: value for name, value in at.items() if name in dims}
        source, sweep = self._source(study, {name: value for name, value in at.items() if name not in dims})
        entries = [(name, k) for name in outputs for k in range(_entries(study, sweep, name, chosen, states))]
        given, variables = {"sample", *at, *self.fixed, *self.sources[source].unknowns}, sweep.variables
        for name in sweep.grid.axes.keys() - given if states else ():
            if len(sweep.grid.axes[name]) > 1:
                raise InputError(f"{name}: study {study.name} has a range of it; give its value in at")
        if len({variables[name].units for name in outputs}) > 1:
            raise InputError("its outputs have different units; give each a table of its own")
        flags, units = variables[outputs[0]].flags, variables[outputs[0]].units
        if states != bool(flags):
            raise InputError(f"{outputs[0]} has {'words; write is' if flags else 'numbers; write value'} = ...")
        codes, values, widths = tuple[int, ...](), [1.0] * len(entries), [0.0] * len(entries)
        if flags:
            codes, units = _codes(table["is"], flags), "1"
        else:
            values, widths = _numbers(table["value"], table["within"], units)
        if len(values) != len(entries) or len(widths) != len(entries):
            raise InputError(
                f"{', '.join(outputs)} has {len(entries)} values, value {len(values)}, within {len(widths)}: "
                "select one in at, or give as many"
            )
        names = [table.get("name", output) for output, _ in entries]
        for k, (output, entry) in enumerate(entries):
            name = f"{names[k]}_{k + 1}" if names.count(names[k]) > 1 else names[k]
            if name in {*TAKEN, *self.unknown, *(each.name for each in self.targets)}:
                raise InputError(f"there are two of the name {name}; give one another name")
            text, member = variables[output].long_name, f"member_{output}"
            if states:
                text, output = f"share of members: {table['is']}", member if member in variables else output
            place = source, output, chosen, entry, not states and f"{output}_se" in variables
            self.targets.append(Target(name, text, units, values[k], widths[k], codes, *place))

    def _source(self, study: Study, at: Mapping[str, Any]) -> tuple[int, Sweep]:
        """The index of the source of a study at these parameters, created on first use, and a sweep of it."""
        takes = set(study.known(self.structure))
        values = {name: value for name, value in self.fixed.items() if name in takes} | dict(at)
        unknowns = {p: n for n in self.unknown for p in (n, f"p1_{n}", f"p2_{n}") if p in takes}
        self.taken |= takes
        if (key := f"{study.name} {sorted(values.items())}") in self._sweeps:
            return self._sweeps[key]
        if not unknowns and not self.own.keys() & self.unknown:
            raise InputError(f"study {study.name} depends on no unknown: {', '.join(self.unknown)}")
        for name in self.unknown.keys() & {*unknowns.values(), *self.own}:
            if name in values:
                raise InputError(f"{name}: it is unknown and has a value; leave one out")
            of_study = [study.parameters[p] for p, n in unknowns.items() if n == name]
            parameter = of_study[0] if of_study else self.own[name]
            text = uncertainty.text_of(self.unknown[name], name)
            self.priors[name] = uncertainty.parse(text, name, parameter.units)
            self.axes[name] = parameter.units, re.sub(" of P1$", "", parameter.text)
        asked = request.Request(study.name, values)
        numbers = asked.values_of(study)
        # The presentation of a study changes nothing.
        bare = replace(study, paper="", derive=None, summary=None, figure=None, claims=())
        drawn = {parameter: self.priors[name] for parameter, name in unknowns.items()}
        structure = None if self.structure is None else self.structure.to_dict()
        sweep = sweep_of(bare, {**numbers, **drawn}, structure=structure, samples=CHECKED)
        for name in drawn.keys() - sweep.grid.axes.keys():
            raise InputError(f"{name}: study {study.name} draws it itself; take another study")
        lines = unusual({name: value for name, value in numbers.items() if value is not None}, values)
        warn_unusual([line for line in lines if not asked.has_unit(line.partition(" ")[0])], strict=False)
        self._sweeps[key] = len(self.sources), sweep
        self.sources.append(Source(bare, numbers, unknowns))
        return self._sweeps[key]


def _listed(names: Any) -> list[str]:
    return [str(name) for name in names] if isinstance(names, list) else [str(names)]


def _entries(study: Study, sweep: Sweep, output: str, chosen: Mapping[str, Any], states: bool) -> int:
    """Number of values of an output at one draw; the members of a statement count as one."""
    if output not in sweep.variables:
        near = suggest(output, sweep.variables)
        raise InputError(f"study {study.name} computes no {output}; {near}it has {', '.join(sweep.variables)}")
    sizes = [len(axis) for name, axis in sweep.coords.items() if name in sweep.variables[output].dims]
    for name, value in chosen.items():
        if value not in (known := sweep.coords[name].values.tolist() if name in sweep.coords else []):
            raise InputError(f"{name} = {value}: it must be one of {', '.join(map(str, known[:12]))}")
        sizes.remove(len(known))
    points = [size for dim, size in zip(sweep.grid.dims, sweep.grid.shape, strict=True) if dim != "sample"]
    return math.prod([*points, *([] if states else sizes)])


def _codes(given: Any, flags: Mapping[int, str]) -> tuple[int, ...]:
    """The flags that a statement allows: that of its word, or all others after "not "."""
    word = str(given).removeprefix("not ")
    Parameter("", choices=tuple(flags.values())).read("is", word)
    return tuple(code for code, each in flags.items() if (each == word) == (word == given))


def _numbers(value: Any, within: Any, units: str) -> tuple[list[float], list[float]]:
    """Measured values and their standard deviations; an `InputError` for one that lacks a required unit."""
    found = list[Any]()
    for name, given in (("value", value), ("within", within)):
        text = ", ".join(map(str, given)) if isinstance(given, list) else str(given)
        relative = name == "within" and text.rstrip().endswith("%")
        if units != "1" and not spec.has_unit(text):
            example = f"{text.split(',')[-1].strip()} {units}"
            raise InputError(f"{name} = {text}: it needs its unit, for example {example}")
        found.append(spec.parse(text, name, "1" if relative else units) * (np.abs(found[0]) if relative else 1.0))
    values, widths = found[0], found[1] if len(found[1]) > 1 else np.repeat(found[1], len(found[0]))
    if not np.all(widths > 0.0):
        raise InputError(f"within = {widths.min():g}: it must be above 0, one standard deviation")
    return values.tolist(), widths.tolist()
