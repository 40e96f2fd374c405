"""The rig as settings: its numbers by name, with units and the paper's values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fivcore import Beam, Rig
from studies import paper
from studies.study import Setting
from sweeps import InputError

# Units and meaning of the numbers that make a rig, by their names in `fivcore`.
RIG_NUMBERS = {
    "contact_position": ("m", "distance of the contact from P2's clamp"),
    "head_mass": ("kg", "mass at A"),
    "d1": ("s-1", "Rayleigh damping on the mass"),
    "d2": ("s", "Rayleigh damping on the stiffness"),
    "point_b": ("1", "where the velocity of P1 is read, as a share of its length from C"),
}
BEAM_NUMBERS = {
    "length": ("m", "length"),
    "width": ("m", "width"),
    "thickness": ("m", "thickness"),
    "young_modulus": ("Pa", "Young's modulus"),
    "density": ("kg m-3", "density"),
    "elements": ("1", "number of elements"),
}


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
    fields: dict[str, Any] = {name: settings[name] for name in RIG_NUMBERS}
    try:
        for beam in ("p1", "p2"):
            numbers: dict[str, Any] = {name: settings[f"{beam}_{name}"] for name in BEAM_NUMBERS}
            fields[beam] = Beam(**numbers)
        return Rig(**fields), settings["theta"]
    except ValueError as problem:
        raise InputError(str(problem).replace("Beam: ", f"{beam}_", 1).replace("Rig: ", "", 1)) from None
