"""The rig as settings: its numbers by name, with units and the paper's values."""

from __future__ import annotations

from collections.abc import Mapping

from fivcore import Rig
from fivcore.rig import BEAM_NUMBERS, RIG_NUMBERS
from studies import paper
from studies.study import Setting
from sweeps import InputError


def rig_settings() -> dict[str, Setting]:
    """Settings for theta and every number of the rig, with the paper's values (`fivcore.Rig`'s defaults)."""
    rig = Rig()
    settings = {"theta": Setting(paper.THETA, "degree", "inclination of P1")}
    for name, (units, long_name) in RIG_NUMBERS.items():
        settings[name] = Setting(getattr(rig, name), units, long_name)
    for beam in ("p1", "p2"):
        for name, (units, long_name) in BEAM_NUMBERS.items():
            value = float(getattr(getattr(rig, beam), name))
            settings[f"{beam}_{name}"] = Setting(value, units, f"{long_name} of {beam.upper()}")
    return settings


def rig_of(settings: Mapping[str, float]) -> tuple[Rig, float]:
    """The rig and theta that settings made by `rig_settings` describe; an error names the setting."""
    names = [*RIG_NUMBERS, *(f"{beam}_{name}" for beam in ("p1", "p2") for name in BEAM_NUMBERS)]
    try:
        return Rig.of(**{name: settings[name] for name in names}), settings["theta"]
    except ValueError as problem:
        raise InputError(str(problem)) from None
