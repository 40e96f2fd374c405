"""The studies by name; a study's module is imported when it is asked for."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from studies.study import Study

NAMES = (
    "table4",
    "fig5",
    "fig6",
    "fig7",
    "contact",
    "fig11",
    "table6",
    "stick_time",
    "stability",
    "regimes",
    "scenes",
    "accuracy",
    "stress",
)


# Studies that are not listed, by the name of the sweep: a map is made by a command of its own.
UNLISTED = ("map",)
# Studies whose module is not that of their name in the gallery.
ELSEWHERE = {"map": "maps.maps", "accuracy": "accuracy.study", "stress": "stress.study"} | {
    name: f"gallery.{name}.study" for name in ("table6", "stick_time", "stability", "regimes", "scenes")
}


def load(name: str) -> Study:
    """The study called `name`.

    Raises
    ------
    ValueError
        If there is none; the message suggests the nearest.
    """
    if not isinstance(name, str) or name not in (*NAMES, *UNLISTED):
        from studies.study import suggest

        raise ValueError(
            f"STUDY = {name!r}: there is no such study; {suggest(str(name), list(NAMES))}"
            f"the studies are {', '.join(NAMES)}"
        )
    study: Study = import_module("studies." + ELSEWHERE.get(name, f"gallery.{name}")).STUDY
    return study
