"""Cases of the battery as data, one row each, by groups.

A case is the operating point with something driven to an edge. Where the edge is the method's own (its largest
step, its critical friction), the row says which share of it; `studies.stress.ask` computes the limit. A run must
pass every check of `studies.stress.checks`; what a method cannot do it must refuse, naming the argument.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

from fivcore import Rig
from studies import paper
from studies.stress.starts import NO_STATES, STARTS

METHODS = ("fast", "exact", "paper")
PASSES, VALUE, CONTACT, DIVERGENCE = EXPECTED = ("passes", "ValueError", "ContactError", "DivergenceError")
NAN, INFINITE = float("nan"), float("inf")
PAPERS = Rig()
# Ten times the paper's middle speed: first slip after 8 ms, the first burst 3 ms later, bursts from then on.
POINT = {"V": 20e-3, "theta": paper.THETA, "mu": paper.MU, "F": paper.LOAD}
DURATION = 30e-3


@dataclass(frozen=True)
class Case:
    """One task for every method."""

    name: str
    asks: str  # for a reader
    scene: Mapping[str, float] = field(default_factory=dict)  # what differs from POINT
    run: Mapping[str, Any] = field(default_factory=dict)  # further arguments of `simulate`, `duration` among them
    rig: Rig = PAPERS
    edge: str = ""  # one of `studies.stress.ask.LIMITS`, of which `share` is asked
    share: float = 1.0
    slips_at: float = 0.0  # s: V is such that by then the drive has moved what a contact at rest yields
    start: str = ""  # one of STARTS; "": rest under the load
    expected: str | Mapping[str, str] = PASSES  # one of EXPECTED, for all methods or by method (others: PASSES)
    names: str = ""  # the argument that a refusal must name
    not_asked: Mapping[str, str] = field(default_factory=dict)  # methods, and why
    copy: bool = False  # whether the motion is that of POINT in another size or in a mirror
    group: str = ""

    def expectation(self, method: str) -> str:
        """The expected outcome with a method."""
        return self.expected if isinstance(self.expected, str) else self.expected.get(method, PASSES)


def _numbers(number: str, name: str, asks: str, *values: float, **more: Any) -> Any:
    """A case for each value of a number of the scene, which stands in its name and in what it asks."""
    also = more.pop("also", {})
    return [Case(name.format(v), asks.format(v), also | {number: v}, names=number, **more) for v in values]


def _rig(name: str, asks: str, rig: Rig, duration: float = 12e-3, **more: Any) -> Case:
    """A rig at a speed at which it slips soon; stiff or fine beams need shorter steps of the published scheme."""
    soon: dict[str, Any] = {"edge": "fitting step", "share": 0.9, "slips_at": 1.5e-3}
    return Case(name, asks, run={"duration": duration}, rig=rig, **soon, **more)


def _beams(word: str, number: str, factor: float, *beams: str) -> Case:
    """A number of some beams multiplied; the contact stays at the same share of P2's length."""
    scaled = {beam: getattr(PAPERS, beam) for beam in beams}
    scaled = {beam: replace(own, **{number: factor * getattr(own, number)}) for beam, own in scaled.items()}
    position = scaled.get("p2", PAPERS.p2).length / PAPERS.p2.length * PAPERS.contact_position
    who, called = " and ".join(map(str.upper, beams)), {"young_modulus": "Young's modulus"}.get(number, number)
    rig = replace(PAPERS, contact_position=position, **scaled)
    return _rig(f"{word} {who}", f"{called} of {who} times {factor:g}", rig)


def _mesh(asks: str, p1: int, p2: int, **more: Any) -> Case:
    rig = replace(PAPERS, p1=replace(PAPERS.p1, elements=p1), p2=replace(PAPERS.p2, elements=p2))
    return _rig(f"{p1} and {p2} elements", asks, rig, **more)


# Methods that a case is not asked of, and why.
NO_STEP = {"exact": "it has no step to be stable: its grid is only where statistics are read"}
OWN_MODES = {"paper": "it keeps all modes: it has no cut-off and no termination"}
ABSORBING = {"exact": "it needs the absorbing element and refuses another termination"}
ENDS_EARLY = dict.fromkeys(("exact", "paper"), "only 'fast' ends a run early")
# Cases that would take these methods longer than some 10 s of a core.
TOO_EXPENSIVE = {
    "long P2": ("exact",),
    "absorbing, cut-off 1000 kHz": ("exact",),
    "1 s, vibrating": ("paper",),
} | dict.fromkeys(("100 s, vibrating", "100 s, sliding", "100 s, stuck"), ("exact", "paper"))
# What "exact" says where one mode of a regime is slower than the others by ten orders of magnitude; and of a mesh
# so coarse that the reduced model keeps every mode and needs no element.
TOO_SLOW: dict[str, Any] = {"expected": {"exact": DIVERGENCE}}
NO_ELEMENT: dict[str, Any] = {"expected": {"exact": VALUE}, "names": "cutoff"}
BRIEF = {"duration": 10e-3}
MU = ("mu", "mu = {:g}", "a coefficient of friction of {:g}")
THETA = ("theta", "theta = {:g}°", "P1 at {:g} degrees")
DRIVE, LOAD = "a drive of {:g} m/s", "a load of {:g} N"

GROUPED: dict[str, list[Case]] = {
    "step": [
        Case(f"step {share:g} of the largest", f"a step of {share:g} times the largest stable one", edge="step",
             share=share, expected=VALUE if share > 1.0 else PASSES, names="step", not_asked=NO_STEP)
        for share in (0.5, 0.9, 0.999, 1.001, 1.5)
    ],
    "friction": [
        *_numbers(*MU, 0.0, 1e-12),
        *_numbers(*MU, 1.0, 2.0, also={"V": 1.0}, run=BRIEF),
        *(Case(f"{share:.7g} of critical mu, {theta:g}°",
               f"{share:.7g} times the coefficient of friction at which the contact force stops being unique, "
               f"at {theta:g} degrees and 1 m/s",
               # "exact" says so where slip would grow faster than events may follow each other.
               {"V": 1.0, "theta": theta}, BRIEF, edge="mu", share=share, names="mu",
               expected=CONTACT if share > 1.0 else {"exact": CONTACT} if 1.0 - share < 1e-6 else PASSES)
          for theta, share in product((5.0, 20.0, -20.0), (0.5, 0.999, 0.9999999, 1.001))),
        Case("mu = 1e6, upright",
             "the largest coefficient of friction that a scene takes, where nothing couples the directions",
             {"mu": 1e6, "theta": 0.0, "V": 1.0}, BRIEF),
        *_numbers(*MU, -0.1, NAN, expected=VALUE),
    ],
    "angle": [
        *_numbers(*THETA, 0.0, 5.0, -5.0, 60.0, -60.0, 89.0, 89.9999, -89.9999),
        *_numbers(*THETA, 90.0, -91.0, NAN, expected=VALUE),
    ],
    "speed": [
        *_numbers("V", "V = {:g} m/s", DRIVE, 1e-9, 1e-3, 1.0, -POINT["V"]),
        Case("in the mirror", "V and theta of the other sign: the same motion",
             {"V": -POINT["V"], "theta": -POINT["theta"]}, copy=True),
        *_numbers("V", "V = {:g}", DRIVE, 0.0, INFINITE, NAN, expected=VALUE),
    ],
    "load": [
        *(Case(f"F = {F:g} N, same V/F",
               f"a load of {F:g} N at the operating point's V / F: the same motion in another size",
               {"F": F, "V": POINT["V"] * F / POINT["F"]}, copy=True)
          for F in (1e-3, 1.0, 1e6)),
        *_numbers("F", "F = {:g} N", LOAD, 1e-3, 1e6),
        *_numbers("F", "F = {:g}", LOAD, 0.0, -9.0, NAN, expected=VALUE),
        *(Case(f"{share:g} of the {edge} V/F", f"{share:g} times the {edge} V / F that is resolved",
               edge=f"{edge} V/F", share=share, expected=expected, names="V / F")
          for edge, share, expected in (("least", 1.001, PASSES), ("least", 0.999, VALUE),
                                        ("largest", 0.999, PASSES), ("largest", 1.001, VALUE))),
    ],
    **{
        group: [
            Case(name, start.asks, run={} if name in NO_STATES else {"duration": 20e-3}, start=name,
                 expected=VALUE if name in NO_STATES else PASSES, names="initial")
            for name, start in STARTS.items() if start.group == group
        ]
        for group in ("grazing", "release", "catch", "first state")
    },
    "rig": [
        *(_beams(word, "young_modulus", factor, *beams)
          for word, factor in (("stiff", 100.0), ("soft", 0.01)) for beams in (("p1",), ("p2",), ("p1", "p2"))),
        *(_beams(word, "length", factor, beam) for word, factor in (("long", 10.0), ("short", 0.1))
          for beam in ("p1", "p2")),
        *(_beams(word, "thickness", factor, beam) for word, factor in (("thick", 10.0), ("thin", 0.1))
          for beam in ("p1", "p2")),
        _mesh("beams of 1 elements", 1, 1, **NO_ELEMENT),
        _mesh("beams of 3 elements", 3, 3, **NO_ELEMENT),
        _mesh("P1 of 3 elements, P2 of 90", 3, 90),
        _mesh("P1 of 30 elements, P2 of 3", 30, 3),
        # Thrown together, for it cannot run for long.
        _mesh("beams of 400 elements, P1 thrown onto P2 at 1 m/s", 400, 400,
              duration=0.2e-3, start="thrown at 1 m/s"),
        _rig("no head", "no mass at A", Rig(head_mass=0.0)),
        _rig("head of 1 mg", "a head of 1 mg", Rig(head_mass=1e-6)),
        _rig("head of 1 t", "a head of 1000 kg", Rig(head_mass=1e3)),
        _rig("head of 1e9 kg", "a head of 1e9 kg", Rig(head_mass=1e9), **TOO_SLOW),
        _rig("contact 1 um from the clamp", "the contact 1 um from P2's clamp", Rig(contact_position=1e-6)),
        _rig("contact 1 mm from the clamp", "the contact 1 mm from P2's clamp", Rig(contact_position=1e-3)),
        _rig("contact at the free end", "the contact at P2's free end", Rig(contact_position=0.15)),
    ],
    "damping": [
        _rig("no damping", "d1 = d2 = 0", Rig(d1=0.0, d2=0.0)),
        _rig("d2 = 0", "no damping on the stiffness", Rig(d2=0.0)),
        # At 1e5 1/s 8 of 80 nearby scenes are lost in rounding by `exact`, at 7e4 1/s none.
        _rig("d1 = 5e4 1/s", "a damping on the mass of 5e4 1/s", Rig(d1=5e4)),
        _rig("d1 = 1e7 1/s", "a damping on the mass of 1e7 1/s", Rig(d1=1e7), **TOO_SLOW),
        _rig("d2 = 1 us", "a damping on the stiffness of 1 us", Rig(d2=1e-6)),
        _rig("d2 = 100 us", "a damping on the stiffness of 100 us", Rig(d2=1e-4)),
    ],
    "drive": [
        *(Case(f"ramp {ramp:g} s", f"a ramp of {ramp:g} s", run={"ramp": ramp, "duration": 20e-3})
          for ramp in (0.0, 1e-9, 1e-6, 10.0, 1e3)),
        *(Case(f"ramp {ramp:g}", f"a ramp of {ramp:g} s", run={"ramp": ramp}, expected=VALUE, names="ramp")
          for ramp in (-1e-3, 1e-12)),
    ],
    "long": [
        Case("100 s, vibrating", "100 s at 5 mm/s", {"V": 5e-3}, {"duration": 100.0}),
        Case("1 s, vibrating", "1 s at 5 mm/s", {"V": 5e-3}, {"duration": 1.0}),
        Case("100 s, sliding", "100 s of steady sliding", {"theta": -5.0}, {"duration": 100.0}),
        Case("10 s, every step", "10 s of sliding in which all vibration dies, every step taken",
             {"theta": -5.0}, {"duration": 10.0, "end_early": False}, not_asked=ENDS_EARLY),
        Case("100 s, stuck", "100 s at a drive that never slips", {"V": 1e-9}, {"duration": 100.0}),
    ],
    "moving contact": [
        Case(f"to {end}, {share:g} of the way",
             f"a contact point moving {share:g} times as long as it takes to reach {end} from nearby, at 1 m/s",
             {"V": 1.0}, {"contact_motion": motion}, Rig(contact_position=position), "reach", share,
             expected=dict.fromkeys(METHODS if share > 1.0 else ("exact",), VALUE),
             names="duration" if share > 1.0 else "contact_motion")
        for motion, end, position in ((-1, "P2's clamp", 0.012), (1, "P2's free end", 0.14))
        for share in (0.999, 1.001)
    ],
    "termination": [
        *(Case(f"termination {kind}", f"the termination {kind!r}", run={"termination": kind},
               expected={"exact": VALUE}, names="termination", not_asked=OWN_MODES)
          for kind in ("elastic", "none")),
        *(Case(f"{share:g} of the least cut-off, {kind}",
               f"{share:g} times the least cut-off, termination {kind!r}",
               run={"termination": kind}, edge="cutoff", share=share,
               expected={"paper": VALUE} if share > 1.0 else VALUE, names="cutoff", not_asked=reason)
          for kind, reason in (("absorbing", {}), ("none", ABSORBING)) for share in (0.999, 1.001, 30.0)),
        *(Case(f"{kind}, cut-off {cutoff / 1e3:g} kHz",
               f"a cut-off that leaves out the fastest modes alone, termination {kind!r}",
               run={"termination": kind, "cutoff": cutoff, "duration": duration}, not_asked=OWN_MODES | reason)
          for kind, cutoff, duration, reason in (("absorbing", 3e5, 20e-3, {}), ("elastic", 3e5, 20e-3, ABSORBING),
                                                 ("absorbing", 1e6, 12e-3, {}))),
        Case("every mode, no element",
             "a cut-off above all modes: the finite elements themselves, touching rigidly",
             {"V": 1.0}, {"cutoff": 1e9, "duration": 4e-3},
             expected={"exact": VALUE}, names="cutoff", not_asked=OWN_MODES),
    ],
    "record": [
        Case("too many samples", "a record of more samples than may be", run={"record": True, "duration": 10.0},
             edge="samples", share=1.001, expected=VALUE, names="sample_rate"),
    ],
}  # fmt: skip

CASES = {case.name: replace(case, group=group) for group, cases in GROUPED.items() for case in cases}
