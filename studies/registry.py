"""The studies: predefined, installed (entry points `fiv.studies`), or a file of one's own.

A study's module is imported when it is asked for. What a result says of its study is a name and nothing more:
only who types the path of a file has it loaded.
"""

from __future__ import annotations

import json
import os
import re
from contextlib import suppress
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from studies.study import Study

# The predefined studies in their order, with their modules; then those that are not listed, by the name of the
# sweep: a map is made by a command of its own.
MODULES = {
    "table4": "gallery.table4",
    "fig5": "gallery.fig5",
    "fig6": "gallery.fig6",
    "fig7": "gallery.fig7",
    "contact": "gallery.contact",
    "fig11": "gallery.fig11",
    "table6": "gallery.table6.study",
    "stick_time": "gallery.stick_time.study",
    "stability": "gallery.stability.study",
    "sensitivity": "gallery.sensitivity.study",
    "robust": "gallery.robust.study",
    "regimes": "gallery.regimes.study",
    "scenes": "gallery.scenes.study",
    "accuracy": "accuracy.study",
    "stress": "stress.study",
    "map": "maps.maps",
}
UNLISTED = ("map",)
NAMES = tuple(name for name in MODULES if name not in UNLISTED)
GROUP = "fiv.studies"
# What a study at points that are no grid is called besides (`studies.scatter`), and what makes it.
SUFFIXES = {"-scatter": "--scatter NAME=DISTRIBUTION", "-points": "--points FILE.csv"}
# Of a text that is read as a whole.
MOST_LETTERS = 100_000_000
CATALOGUE = Path(__file__).with_name("catalogue.json")
# Studies of one's own that this process was given, by name.
_registered: dict[str, Study] = {}


@cache
def installed() -> dict[str, EntryPoint]:
    """Studies that installed packages bring along, by name; none of them is imported."""
    return {each.name: each for each in entry_points(group=GROUP) if each.name not in MODULES}


def catalogue() -> dict[str, dict[str, Any]]:
    """Title, question, points and usual time of each predefined study, read without its import."""
    catalogue: dict[str, dict[str, Any]] = json.loads(CATALOGUE.read_text(encoding="utf-8"))
    return catalogue


def names() -> list[str]:
    """Every study that a name stands for: the predefined ones, then the installed ones."""
    return [*NAMES, *sorted(installed())]


def resolve(text: str | Study) -> Study:
    """The study of the argument STUDY: a name, or the path of a Python file that defines STUDY and is run."""
    from studies.study import Study
    from sweeps import InputError, load_script

    if isinstance(text, Study):
        return register(text)
    if not (isinstance(text, str) and is_file(text)):
        return load(text)
    study = getattr(load_script(expanded(text)), "STUDY", None)
    if not isinstance(study, Study):
        raise InputError(f"{text}: it defines no study; it must have one called STUDY (studies.study.Study)")
    return register(study, text)


def expanded(path: str | Path) -> Path:
    """A path with the home folder in place of `~`, or an `InputError` where there is none.

    Raises
    ------
    OSError
        If nobody can tell whether there is a file; from Python 3.14 on `exists` would say that there is none.
    """
    from sweeps import InputError

    try:
        found = Path(path).expanduser()
    except RuntimeError:
        raise InputError(f"{path}: {Path(path).parts[0]} has no home folder; write the whole path") from None
    with suppress(FileNotFoundError, NotADirectoryError, ValueError):
        os.lstat(found)
    return found


def read_text(file: Path, encoding: str) -> str:
    """A text that a user has written, as it stands there; an `InputError` if it is longer than anybody writes."""
    from sweeps import InputError

    with file.open(encoding=encoding, newline="") as opened:
        text = opened.read(MOST_LETTERS + 1)
    if len(text) > MOST_LETTERS:
        raise InputError(f"it has more than {MOST_LETTERS} letters")
    return text


def is_file(text: str) -> bool:
    """Whether STUDY is the path of a Python file."""
    return text.endswith(".py")


def register(study: Study, where: str = "name") -> Study:
    """Register a study of a user, which this process then finds by its name.

    An `InputError` refuses the name of another, and one that no folder can have.
    """
    from sweeps import InputError

    if study.name in MODULES:
        if study is load(study.name):
            return study
        raise InputError(f"{where}: a predefined study is called {study.name!r}; choose another name")
    if not re.fullmatch(r"\w[\w-]*", study.name) or study.name == "reference":
        raise InputError(f"{where}: a study cannot be called {study.name!r}; use letters, digits, _ and -")
    _registered[study.name] = study
    return study


def parted(name: str) -> tuple[str, str]:
    """A study's name and which of `SUFFIXES` is behind it, or ""."""
    suffix = next((each for each in SUFFIXES if name.endswith(each)), "")
    return name.removesuffix(suffix), suffix


def load(name: str) -> Study:
    """The study called `name`: predefined, installed, or given to this process before; no file is run.

    With one of `SUFFIXES` it is the study that shows such a result.
    Where there is none, an `InputError` suggests the nearest.
    """
    from studies.study import Study, suggest
    from sweeps import InputError

    if name in MODULES:
        study: Study = import_module(f"studies.{MODULES[name]}").STUDY
        return study
    if name in _registered:
        return _registered[name]
    if name in installed():
        loaded = installed()[name].load()
        if not isinstance(loaded, Study) or loaded.name != name:
            raise InputError(f"STUDY = {name!r}: the entry point {installed()[name].value} is no study called so")
        return register(loaded)
    base, suffix = parted(str(name))
    if suffix:
        at_points: Study = import_module("studies.scatter.study").derived(load(base), suffix)
        return at_points
    raise InputError(
        f"STUDY = {name!r}: there is no such study; {suggest(str(name), names())}"
        f"the studies are {', '.join(names())}; one's own is named by its file, FILE.py"
    )
