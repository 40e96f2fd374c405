"""Rigs at the edges of sense for `studies.stress.cases`: beams, meshes, heads, contact points and damping."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from fivcore import Rig

# What a beam is multiplied by to be very stiff or soft, long or short, thick or thin.
STIFFER, LONGER, THICKER = 100.0, 10.0, 10.0
# What "exact" says where one mode of a regime is slower than the others by ten orders of magnitude.
TOO_SLOW = {"exact": "DivergenceError"}
# What it says of a mesh so coarse that the reduced model keeps every mode and needs no element.
NO_ELEMENT = {"exact": "ValueError"}


@dataclass(frozen=True)
class Made:
    """A rig and how it is asked about, as in `studies.stress.cases.Case`."""

    name: str
    asks: str
    rig: Rig
    group: str = "rig"
    duration: float = 12e-3
    start: str = ""
    expected: Mapping[str, str] = field(default_factory=dict)
    names: str = ""
    apart: Mapping[str, str] = field(default_factory=dict)


def _with(factor: float, name: str, *beams: str) -> Rig:
    """The paper's rig, a number of some beams multiplied; the contact stays at the same share of P2's length."""
    rig = Rig()
    changed: dict[str, Any] = {}
    for beam in beams:
        own = getattr(rig, beam)
        changed[beam] = replace(own, **{name: factor * getattr(own, name)})
    longer = changed.get("p2", rig.p2).length / rig.p2.length
    return replace(rig, contact_position=longer * rig.contact_position, **changed)


def _meshed(p1: int, p2: int) -> Rig:
    rig = Rig()
    return replace(rig, p1=replace(rig.p1, elements=p1), p2=replace(rig.p2, elements=p2))


def _beams() -> tuple[Made, ...]:
    """Each beam, and both, stiffer and softer; each longer, shorter, thicker and thinner."""
    made = []
    for word, factor in (("stiff", STIFFER), ("soft", 1.0 / STIFFER)):
        for beams in (("p1",), ("p2",), ("p1", "p2")):
            who = " and ".join(beam.upper() for beam in beams)
            asks = f"Young's modulus of {who} times {factor:g}"
            made.append(Made(f"{word} {who}", asks, _with(factor, "young_modulus", *beams)))
    shapes = (
        ("long", "length", LONGER),
        ("short", "length", 1.0 / LONGER),
        ("thick", "thickness", THICKER),
        ("thin", "thickness", 1.0 / THICKER),
    )
    for word, name, factor in shapes:
        for beam in ("p1", "p2"):
            asks = f"{name} of {beam.upper()} times {factor:g}"
            made.append(Made(f"{word} {beam.upper()}", asks, _with(factor, name, beam)))
    return tuple(made)


def _meshes() -> tuple[Made, ...]:
    """From one element a beam to four hundred; the finest are thrown together, for they cannot run for long."""
    coarse = [
        Made(f"{n} and {n} elements", f"beams of {n} elements", _meshed(n, n), expected=NO_ELEMENT, names="cutoff")
        for n in (1, 3)
    ]
    mixed = [
        Made("3 and 90 elements", "P1 of 3 elements, P2 of 90", _meshed(3, 90)),
        Made("30 and 3 elements", "P1 of 30 elements, P2 of 3", _meshed(30, 3)),
    ]
    fine = Made(
        "400 and 400 elements",
        "beams of 400 elements, P1 thrown onto P2 at 1 m/s",
        _meshed(400, 400),
        duration=0.2e-3,
        start="thrown at 1 m/s",
    )
    return (*coarse, *mixed, fine)


RIGS: tuple[Made, ...] = (
    *_beams(),
    *_meshes(),
    Made("no head", "no mass at A", Rig(head_mass=0.0)),
    Made("head of 1 mg", "a head of 1 mg", Rig(head_mass=1e-6)),
    Made("head of 1 t", "a head of 1000 kg", Rig(head_mass=1e3)),
    Made("head of 1e9 kg", "a head of 1e9 kg", Rig(head_mass=1e9), expected=TOO_SLOW),
    Made("contact 1 um from the clamp", "the contact 1 um from P2's clamp", Rig(contact_position=1e-6)),
    Made("contact 1 mm from the clamp", "the contact 1 mm from P2's clamp", Rig(contact_position=1e-3)),
    Made("contact at the free end", "the contact at P2's free end", Rig(contact_position=0.15)),
    Made("no damping", "d1 = d2 = 0", Rig(d1=0.0, d2=0.0), "damping"),
    Made("d2 = 0", "no damping on the stiffness", Rig(d2=0.0), "damping"),
    # At 1e5 1/s 8 of 80 nearby scenes are lost in rounding by `exact`, at 7e4 1/s none.
    Made("d1 = 5e4 1/s", "a damping on the mass of 5e4 1/s", Rig(d1=5e4), "damping"),
    Made("d1 = 1e7 1/s", "a damping on the mass of 1e7 1/s", Rig(d1=1e7), "damping", expected=TOO_SLOW),
    Made("d2 = 1 us", "a damping on the stiffness of 1 us", Rig(d2=1e-6), "damping"),
    Made("d2 = 100 us", "a damping on the stiffness of 100 us", Rig(d2=1e-4), "damping"),
)
