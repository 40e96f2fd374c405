"""Named rigs: numbers or a structure, kept as `rig.toml` in the folder in which their results lie."""

from __future__ import annotations

import json
import os
import re
import shlex
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from fivcore import Rig, Structure
from studies.answering import results
from studies.asking.request import Request, is_distribution, read, rows
from studies.declaring import spec
from studies.declaring.parameters import RIG, SCENE, rig_numbers, suggest, unusual, warn_unusual
from studies.motion.scenes import scene_of
from studies.study import Study
from sweeps import InputError, MissingFileError, StoreError

# The rig of the paper, which has a name without a file.
PAPER = "paper"
# Folders that the results have besides.
TAKEN = (results.REFERENCE, results.MAPS, results.FITS, "rig", "structure", "compare")
# Where a rig usually runs; a structure has no other numbers. Falling friction is of a run: many studies ignore it.
OPERATION = ("V", "mu", "F")
NUMBERS = SCENE | RIG
HEAD = {
    "set": "Numbers of this rig; the others are the paper's.",
    "structure": "A structure as it was read: modes, contact, damping. No other file is needed.",
}
LONGEST = 60
# What is taken for a rig: one by its name or itself, one of beams, a structure, a file of either, a result of one.
AnyRig: TypeAlias = "NamedRig | Rig | Structure | str | Path"


@dataclass(frozen=True)
class NamedRig:
    """A rig with a name, or "" without one, and the `folder` of its results.

    `values` are as they were typed; beside a `structure`, a `Structure.to_dict`, those of `OPERATION` only.
    """

    name: str
    folder: Path
    values: Mapping[str, Any] = field(default_factory=dict)
    structure: Mapping[str, Any] | None = None

    @property
    def numbers(self) -> dict[str, Any]:
        """The numbers that it has itself, in SI and degrees."""
        return {name: _number(name, value) for name, value in self.values.items()}

    @property
    def results(self) -> list[str]:
        """Names of the results that it has."""
        return [file.stem for file in results.stored(self.folder)]

    @property
    def title(self) -> str:
        """Its numbers, or its structure, in a line."""
        texts = [f"{name} = {value}" for name, value in self.values.items()]
        if self.structure is not None:
            texts.insert(0, repr(Structure.from_dict(self.structure)))
        return ", ".join(texts) or "the paper's numbers"

    def same(self, other: NamedRig) -> bool:
        """Whether another has the same numbers."""
        one, two = (Structure.from_dict(each.structure) if each.structure else None for each in (self, other))
        return one == two and self.numbers == other.numbers


def is_name(rig: Any) -> bool:
    """Whether a rig is named; a path has a suffix or a slash."""
    return isinstance(rig, str) and not {".", "/", os.sep} & {*rig}


def names(out: str | Path | None = None) -> list[str]:
    """The rigs of a results folder."""
    folder = results.results_folder(out)
    found = {file.parent.name for file in folder.glob(f"*/{results.RIG_FILE}")}
    return sorted(found | {PAPER} if results.stored(folder / PAPER) else found)


def named(name: str, out: str | Path | None = None) -> NamedRig:
    """The rig of this name in a results folder; an `InputError` suggests the nearest, or says how to make it."""
    folder = results.results_folder(out) / name
    if name == PAPER:
        return NamedRig(PAPER, folder)
    _check_name(name)
    if not (folder / results.RIG_FILE).is_file():
        near = f"did you mean {name}.toml? " if Path(f"{name}.toml").is_file() else ""
        near = near or suggest(name, [*names(out), PAPER])
        make = shlex.join(["fiv", "rig", name, "--set", "p1_length=60mm", *_out(out)])
        raise MissingFileError(f"rig {name!r}: there is none in {folder.parent}; {near}make it with: {make}")
    return replace(unnamed(folder / results.RIG_FILE), name=name, folder=folder)


def found(rig: AnyRig | None, out: str | Path | None) -> tuple[NamedRig | None, str | Path | None]:
    """The rig that `rig` stands for, or None, and its results folder; a rig without a name uses `out`."""
    if rig is None:
        return None, out
    own = named(rig, out) if isinstance(rig, str) and is_name(rig) else unnamed(rig)
    return own, own.folder if own.name else out


def unnamed(rig: AnyRig) -> NamedRig:
    """A rig as it is, of beams or of a structure, or from a file with numbers or a structure."""
    if isinstance(rig, NamedRig):
        return rig
    if isinstance(rig, Structure):
        return NamedRig("", Path(), structure=rig.to_dict())
    if isinstance(rig, Rig):
        numbers, papers = rig_numbers(rig), rig_numbers(Rig())
        return NamedRig("", Path(), {name: value for name, value in numbers.items() if value != papers[name]})
    request = read(rig, "rig")
    if wrong := _of_runs(request):
        raise InputError(f"rig {rig}: {wrong[0]} is of a run (--config); a rig has [set] or a structure")
    own = NamedRig("", Path(rig).parent, request.values, request.structure)
    with _of(rig):
        _check(own, ())
    return own


def title(name: str, out: str | Path | None = None) -> str:
    """A one-line description of a rig, or the error if its file is damaged."""
    try:
        return named(name, out).title
    except ValueError as problem:
        return str(problem)


def kept(rig: str | NamedRig, out: str | Path | None = None) -> NamedRig:
    """A rig with a name, by it or itself; an `InputError` says how to give one to a file."""
    if isinstance(rig, NamedRig):
        return rig
    if not is_name(rig):
        name = re.sub(r"[^\w-]", "_", Path(rig).stem) or "mine"
        keep = shlex.join(["fiv", "rig", name, rig, *_out(out)])
        raise InputError(f"rig {rig!r}: results are kept by the name of a rig; give it one with: {keep}")
    return named(rig, out)


def place(rig: str | NamedRig | None, out: str | Path | None = None) -> str | Path | None:
    """The folder in which the results of a named rig lie; without one the results folder as it is given."""
    return out if rig is None else kept(rig, out).folder


def define(
    name: str,
    source: AnyRig | None = None,
    values: Mapping[str, Any] | None = None,
    out: str | Path | None = None,
    *,
    taken: Collection[str] = (),
) -> tuple[NamedRig, bool]:
    """A rig by this name, and whether its file was written.

    Parameters
    ----------
    source : str, path, NamedRig, fivcore.Rig or Structure, optional
        Where its numbers or its structure come from: another rig or its name, a TOML file with a table [set], the
        file of a structure, or a result of one; by default the rig that has the name already.
    values : mapping, optional
        Further numbers, as text or in SI.
    taken : collection of str
        Names that a rig cannot have: those of studies.

    Raises
    ------
    InputError
        For a wrong name or number, and where a rig that has results would change. Nothing is written then.
    """
    if name == PAPER:
        raise InputError(f"rig {PAPER!r}: it is the paper's rig; choose another name")
    _check_name(name)
    if name in taken or name in TAKEN:
        what = "a study" if name in taken else "a folder of the results"
        raise InputError(f"rig {name!r}: {what} has this name; choose another, such as my_{name}")
    if re.fullmatch("(?i)con|prn|aux|nul|(com|lpt)[0-9]", name):
        raise InputError(f"rig {name!r}: Windows has no folder of this name; choose another, such as my_{name}")
    if other := [each for each in names(out) if each != name and each.casefold() == name.casefold()]:
        raise InputError(f"rig {name!r}: it differs from {other[0]!r} in capitals only; choose another name")
    root = results.results_folder(out)
    folder = root / name
    if results.is_own(root) or results.is_own(root.parent):
        raise InputError(f"{root}: runs only read the reference; choose another folder (out=...)")
    if inside := results.rig_in(root):
        raise InputError(f"{root}: it is the folder of the rig {inside!r}; choose another folder (out=...)")
    before = named(name, out) if (folder / results.RIG_FILE).is_file() else None
    if before is None and results.stored(folder.parent) and any(folder.glob("*.nc*")):
        raise InputError(f"rig {name!r}: {folder} has the results of a study; choose another name")
    given = found(source, out)[0] or before or NamedRig(name, folder)
    plain = {key: each.item() if isinstance(each, np.generic) else each for key, each in (values or {}).items()}
    rig = NamedRig(name, folder, {**given.values, **plain}, given.structure)
    _check(rig, {*(values or {})} if source is None else {*rig.values})
    if before is not None:
        if rig.same(before):
            return before, False
        if before.results:
            start = str(source) if isinstance(source, (str, Path)) else name
            again = ["fiv", "rig", free(f"{name}-2", out), start]
            again += [word for key, value in (values or {}).items() for word in ("--set", f"{key}={value}")]
            kept = ", ".join(before.results)
            raise InputError(
                f"rig {name!r}: it has results ({kept}), so it stays as it is; another rig: "
                f"{shlex.join([*again, *_out(out)])}"
            )
    _write(rig)
    return rig, True


def free(name: str, out: str | Path | None = None) -> str:
    """A name like this one that no folder of the results has."""
    plain = re.sub(r"[^\w-]", "_", name)[:LONGEST].lstrip("-") or "mine"
    stem, _, number = plain.rpartition("-")
    stem, count = (stem, int(number)) if stem and re.fullmatch(r"\d", number) else (plain, 1)
    every = [plain, *(f"{stem}-{k}" for k in range(count + 1, 1000))]
    return next(each for each in every if not (results.results_folder(out) / each).exists())


def applied(rig: NamedRig, request: Request, study: Study) -> Request:
    """The request of a study with a named rig: its numbers, or its structure.

    A parameter over which the study has a range keeps it, and theta, V, mu, F and the law of friction may be
    requested otherwise. Another number of the beams of a named rig is an `InputError`: it would be another rig.
    """
    if request.structure is not None:
        raise InputError(f"rig {rig.name!r}: the request has a structure already; leave one out")
    base = rig.numbers if rig.name else None
    request = replace(request, rig=rig.name, base=base, structure=rig.structure)
    if rig.structure is None and not RIG.keys() & study.parameters.keys():
        whose = f"rig {rig.name!r}" if rig.name else "rig"
        raise InputError(f"{whose}: study {study.name} does not depend on the rig; leave it out")
    for name, value in request.values.items() if rig.name else ():
        if name in RIG and name in study.parameters and _is_single(value):
            own, other = rig.values.get(name, RIG[name].default), _number(name, value)
            if other != _number(name, own):
                more = [] if rig.name == PAPER else [rig.name]
                called = free("-".join([*more, name, str(value)]))
                make = shlex.join(["fiv", "rig", called, *more, "--set", f"{name}={value}"])
                raise InputError(
                    f"{name} = {value}: the rig {rig.name!r} has {own}; make another, and use it as --rig "
                    f"{called}: {make}"
                )
    given = {*request.values, *request.sides, *(rows(study, request.points) if request.points is not None else ())}
    added = {
        name: value
        for name, value in rig.values.items()
        if name in study.parameters
        and name not in given
        and (request.sides or not (study.parameters[name].is_axis or study.parameters[name].inner))
    }
    return replace(request, values={**added, **request.values})


def requested(
    rig: AnyRig | None, request: Request, study: Study, out: str | Path | None
) -> tuple[Request, str | Path | None]:
    """The request of a study with a rig, and the folder of its results."""
    own, place = found(rig, out)
    return request if own is None else applied(own, request, study), place


def _of_runs(request: Request) -> list[str]:
    """Names of the settings of a request other than values and a structure."""
    known = ("values", "structure")
    return [key for key, value in vars(request).items() if key not in known and value not in ("", (), None, 0)]


def _check_name(name: str) -> None:
    if not is_name(name) or not re.fullmatch(r"\w[\w-]*", name):
        raise InputError(f"rig {name!r}: a name has letters, digits, _ and -, and no suffix or slash")


@contextmanager
def _of(file: Any) -> Iterator[None]:
    """Begin the line of what is wrong with the file of a rig with its name."""
    try:
        yield
    except InputError as problem:
        raise InputError(f"rig {file}: {problem}") from None


def _out(out: str | Path | None) -> list[str]:
    return ["--out", os.fspath(out)] if out else []


def _is_single(value: Any) -> bool:
    if isinstance(value, str):
        return not is_distribution(value) and ":" not in value and spec.count(value) == 1
    return not hasattr(value, "ppf") and np.size(value) == 1


def _number(name: str, value: Any) -> Any:
    """One number of a rig; an `InputError` names it and says what would do."""
    parameter = NUMBERS[name]
    if isinstance(value, str):
        if is_distribution(value) or ":" in value:
            raise InputError(f"{name} = {value}: a rig has one value; ranges and distributions are of a run")
        if "," in value:
            point = value.replace(",", ".")
            raise InputError(f"{name} = {value}: a rig has one value, with a decimal point: {name}={point}")
        value = spec.one(value, name, parameter.units)
    if isinstance(value, bool) or not np.isscalar(value):
        raise InputError(f"{name} = {value}: it must be one number, or a text like '60mm'")
    return parameter.read(name, value)


def _check(rig: NamedRig, new: Collection[str]) -> None:
    """Check the numbers of a rig, and warn of unusual ones among those that are `new`."""
    for name, value in rig.values.items():
        if name not in NUMBERS:
            near = suggest(name, NUMBERS) or "what else a study takes is of a run (--set); "
            raise InputError(f"{name}: a rig has no such number; {near}it has {', '.join(NUMBERS)}")
        if rig.structure is not None and name not in OPERATION:
            raise InputError(f"{name} = {value}: a structure has no such number; leave it out, or change its file")
    whole = {name: parameter.default for name, parameter in NUMBERS.items()} | rig.numbers
    own = {} if rig.structure is None else {"theta": 0.0, "structure": rig.structure}
    try:
        scene_of(whole | own)
    except InputError:
        raise
    except ValueError as problem:
        raise InputError(str(problem)) from None
    bears = Request(values=rig.values).has_unit
    lines = [line.partition("; ")[0] if bears(line.partition(" ")[0]) else line for line in unusual(whole, new)]
    warn_unusual(lines, strict=False)


def _write(rig: NamedRig) -> None:
    """Write the file of a rig; a `StoreError` if that is impossible."""
    tables = {"set": rig.values} if rig.values or rig.structure is None else {}
    tables |= {} if rig.structure is None else {"structure": rig.structure}
    text = "\n".join(f"# {HEAD[kind]}\n{_table(kind, content)}" for kind, content in tables.items())
    file = rig.folder / results.RIG_FILE
    temporary = file.with_name(f".{results.RIG_FILE}.{os.getpid()}.tmp")
    try:
        rig.folder.mkdir(parents=True, exist_ok=True)
        temporary.write_text(text, "utf-8")
        os.replace(temporary, file)
    except OSError as problem:
        raise StoreError(f"{file} could not be written: {problem.strerror}") from None


def _table(name: str, content: Mapping[str, Any]) -> str:
    """A table of TOML, with the tables in it, without what is None. Strings and lists are those of JSON."""
    plain = {key: value for key, value in content.items() if value is not None and not isinstance(value, Mapping)}
    lines = [f"[{name}]", *(f"{key} = {_toml(value)}" for key, value in plain.items())]
    inner = [_table(f"{name}.{key}", value) for key, value in content.items() if isinstance(value, Mapping)]
    return "\n".join([*lines, "", *inner])


def _toml(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False).replace("NaN", "nan").replace("Infinity", "inf")
