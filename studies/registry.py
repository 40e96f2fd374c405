"""The studies: predefined, installed (entry points `fiv.studies`), or a user's file.

A study's module is imported on request. A result stores only the name of its study: a file of Python runs only if
the user types its path.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING

from studies.answering.results import MAPS, REFERENCE, expanded, is_script
from sweeps import InputError, load_script

if TYPE_CHECKING:
    from studies.study import Study

# The predefined studies in their order.
NAMES = (
    "table4", "fig5", "fig6", "fig7", "contact", "fig11", "table6", "stick_time", "stability", "sensitivity",
    "robust", "regimes", "damping", "stribeck", "hysteresis", "cycles", "basins", "scenes", "accuracy", "stress",
    "classics", "patch",
)  # fmt: skip
# Where a predefined study is not in the gallery.
ELSEWHERE = {"accuracy": "studies.accuracy.study", "stress": "studies.stress.study"}
GROUP = "fiv.studies"
# What `fiv list` tells of the predefined studies, and their roles (`tests.make_reference`).
CATALOGUE = Path(__file__).with_name("catalogue.json")
# Studies of users in this process, and the files which were typed for them, by name.
_registered: dict[str, Study] = {}
_files: dict[str, str] = {}


@cache
def installed() -> dict[str, EntryPoint]:
    """Studies of installed packages by name; none of them is imported."""
    return {point.name: point for point in entry_points(group=GROUP) if point.name not in NAMES}


def names() -> list[str]:
    """Names of all studies: the predefined ones, then the installed ones."""
    return [*NAMES, *sorted(installed())]


def names_for(role: str) -> list[str]:
    """The predefined studies with a role (`Study.roles`), in their order; none of them is imported."""
    catalogue = json.loads(CATALOGUE.read_text(encoding="utf-8"))
    return [name for name in NAMES if role in catalogue.get(name, {}).get("roles", ())]


def resolve(text: str | Study) -> Study:
    """The study of the argument STUDY: a name, or the path of a Python file that defines STUDY, which is run."""
    from studies.study import Study

    if isinstance(text, Study):
        return register(text)
    if not (isinstance(text, str) and is_script(text)):
        return load(text)
    study = getattr(load_script(expanded(text)), "STUDY", None)
    if not isinstance(study, Study):
        raise InputError(f"{text}: it defines no study; it must have one called STUDY (studies.study.Study)")
    return register(study, text)


def register(study: Study, where: str = "name") -> Study:
    """Register a user's study, which this process then finds by its name.

    Raises
    ------
    InputError
        If a predefined study has the name, or a folder cannot have it.
    """
    if study.name in NAMES:
        if study is load(study.name):
            return study
        raise InputError(f"{where}: a predefined study is called {study.name!r}; choose another name")
    if not re.fullmatch(r"\w[\w-]*", study.name) or study.name in (REFERENCE, MAPS):
        raise InputError(f"{where}: a study cannot be called {study.name!r}; use letters, digits, _ and -")
    _registered[study.name] = study
    _files.update({study.name: where} if is_script(where) else {})
    return study


def argument_of(name: str) -> str | None:
    """The argument of `fiv run` for a study: its name, or the file of a user's study; else None."""
    return name if name in names() else _files.get(name)


def load(name: str) -> Study:
    """The study called `name`: predefined, installed or registered; no file is run.

    Raises
    ------
    InputError
        If no study has the name; the message suggests the nearest.
    """
    from studies.declaring.parameters import suggest
    from studies.study import Study

    if name in NAMES:
        study: Study = import_module(ELSEWHERE.get(name, f"studies.gallery.{name}")).STUDY
        return study
    if name in _registered:
        return _registered[name]
    if name in installed():
        loaded = installed()[name].load()
        if not isinstance(loaded, Study) or loaded.name != name:
            raise InputError(
                f"STUDY = {name!r}: the entry point {installed()[name].value} is no study of that name"
            )
        return register(loaded)
    if str(name).startswith(f"{MAPS}_") and name.removeprefix(f"{MAPS}_") in (studies := maps()):
        return studies[name.removeprefix(f"{MAPS}_")]
    near = f"did you mean {name}.py? " if Path(f"{name}.py").is_file() else suggest(str(name), names())
    raise InputError(
        f"STUDY = {name!r}: no study has this name; {near}give the file of your own, FILE.py, or one of "
        f"{', '.join(names())}"
    )


def maps() -> dict[str, Study]:
    """The studies of `fiv map` by their quantities."""
    from studies.gallery.maps import STUDIES

    return STUDIES


def of_quantities(names: Sequence[str]) -> Study:
    """The study of a map of these quantities; an `InputError` suggests the nearest name."""
    from studies.declaring.parameters import suggest

    known = {name: what for what, study in maps().items() for name, v in study.outputs.items() if not v.dims}
    for name in names:
        if name not in known:
            main = ", ".join(each for each in known if not each.endswith(("_se", "_std")))
            raise InputError(f"quantity {name}: no such quantity; {suggest(name, known)}choose from {main}")
    chosen = {known[name]: name for name in reversed(names)}
    if len(chosen) > 1:
        what = " and ".join(reversed(chosen.values()))
        raise InputError(f"quantity {','.join(names)}: {what} need different computations; draw a map of each")
    return maps()[known[names[0]]]
