"""Cases of the battery as data, in groups: an operating point with one argument at an extreme value."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from fivcore import SEPARATION as OPEN
from fivcore import SLIP, STICK, ReducedModel, Rig, Scene, default_cutoff, full_model, propagator
from studies import paper

# How far a tip rings whose path touches P2, m; half the duration of a blow, s.
RINGING, BLOW = 1e-6, 2e-6


def _equilibrium(scene: Scene, force: float, gap: float = 0.0) -> tuple[ReducedModel, int, Any]:
    """All modes, the index of the rigid one, and the equilibrium under load and contact force, at a gap."""
    full = full_model(scene.rig, scene.drive_theta)
    elastic = full.stiffness > 0.0
    rigid = int(np.flatnonzero(~elastic)[0])
    # Modal force of the unit load on A.
    load = np.where(elastic, full.stiffness * full.static_equilibrium - full.normal, -full.normal)
    q = np.zeros(len(full.stiffness))
    q[elastic] = (scene.F * load + force * full.normal)[elastic] / full.stiffness[elastic]
    q[rigid] = (gap - full.normal @ q) / full.normal[rigid]
    return full, rigid, q


def _at_rest(
    scene: Scene, _: Any, contact: int, force: float = 0.0, gap: float = 0.0, fall: float = 0.0, along: float = 0.0
) -> Any:
    """Equilibrium with a contact force, in units of the load; P1 falls, or its lowest mode along P2 moves."""
    full, rigid, q = _equilibrium(scene, force * scene.F, gap)
    v, mode = np.zeros_like(q), int(np.flatnonzero(full.tangential)[0])
    v[rigid] = -fall / full.normal[rigid]
    v[mode] = along / full.tangential[mode]
    return q, v, contact


def _struck(scene: Scene, _: Any, shape: str, n: int | None = None) -> Any:
    """Velocities after a blow on both surfaces that gives them a relative speed of 10 m/s, in all modes."""
    full, _, q = _equilibrium(scene, scene.F)
    direction = getattr(full, shape)
    # A Gauss pulse: one without duration would put most of its energy into the mesh's fastest modes.
    v = direction * np.exp(-0.5 * full.stiffness * BLOW**2)
    return q[:n], 10.0 / float(direction @ v) * v, SLIP


def _tangent(scene: Scene, kept: Any, above: float) -> Any:
    """A state in which P1 falls and rings so that its first smallest gap is `above` times the amplitude.

    Modes that are not kept are at rest.
    """
    full, rigid, q = _equilibrium(scene, 0.0)
    q = np.where(kept, q, 0.0)
    p1 = np.arange(len(q)) <= 3 * scene.rig.p1.elements
    # It rings in the mode below the usual cut-off that moves the tip most.
    low = full.stiffness < (2.0 * np.pi * default_cutoff(scene.rig)) ** 2
    mode = int(np.argmax(np.abs(full.normal) * (p1 & low & (full.stiffness > 0.0))))
    k, c = full.stiffness[[mode]], full.damping[[mode]]
    fall = scene.F * full.normal[rigid] ** 2

    def path(t: float) -> float:
        drag = full.damping[rigid] * t
        # To the fourth power of t, enough for a period of the ringing.
        fallen = 0.5 * fall * t * t * (1.0 - drag / 3.0 + drag * drag / 12.0)
        return float(RINGING * propagator(k, c, t)[0, 0] - fallen)

    period = 2.0 * np.pi / float(np.sqrt(k[0]))
    # The path is flat there: a time good to half of all digits is a place good to all.
    digits = {"xatol": 1e-9 * period}
    least = minimize_scalar(path, bounds=(0.25 * period, 0.75 * period), method="bounded", options=digits)
    q[mode] += RINGING / full.normal[mode]
    q[rigid] = 0.0
    q[rigid] = ((1.0 + above) * RINGING - float(least.fun) - full.normal @ q) / full.normal[rigid]
    return q, np.zeros_like(q), OPEN


METHODS = ("fast", "exact", "paper")
PASSES, VALUE, CONTACT, DIVERGENCE = EXPECTED = ("passes", "ValueError", "ContactError", "DivergenceError")
NAN, INFINITE, PAPERS = float("nan"), float("inf"), Rig()
# Ten times the paper's middle speed: first slip after 8 ms, the first burst 3 ms later, bursts from then on.
POINT, DURATION = {"V": 20e-3, "theta": paper.THETA, "mu": paper.MU, "F": paper.LOAD}, 30e-3


@dataclass(frozen=True)
class Case:
    """One task for every method."""

    name: str
    scene: Mapping[str, float] = field(default_factory=dict)  # what differs from POINT
    run: Mapping[str, Any] = field(default_factory=dict)  # further arguments of `simulate`, `duration` among them
    task: str = ""  # for a reader, where the name does not say it
    rig: Rig = PAPERS
    edge: str = ""  # one of `checks.LIMITS`, of which `share` is taken
    share: float = 1.0
    slips_at: float = 0.0  # s: V is such that by then the drive has moved what a contact at rest yields
    start: Callable[..., Any] | None = None  # `start(scene, kept)`: modal displacements, velocities, contact state
    expected: str | Mapping[str, str] = PASSES  # one of EXPECTED, for all methods or by method (others: PASSES)
    names: str = ""  # the argument that a refusal must name
    excluded: Mapping[str, str] = field(default_factory=dict)  # methods that it does not apply to, and why
    copy: bool = False  # whether the motion is that of POINT in another size or in a mirror
    group: str = ""

    def expectation(self, method: str) -> str:
        """The expected outcome with a method."""
        return self.expected if isinstance(self.expected, str) else self.expected.get(method, PASSES)


def _begun(name: str, task: str, build: Any = _at_rest, expected: str = PASSES, **values: Any) -> Case:
    """A case with an initial state; None is rest under the load."""
    run, start = {"duration": 20e-3}, partial(build, **values)
    return Case(name, run=run, task=task, start=start, expected=expected, names="initial")


def _numbers(number: str, name: str, *values: float, also: Any = None, **more: Any) -> list[Case]:
    """Cases with each value of a number of the scene, which is part of their names and tasks."""
    return [Case(name.format(x), {**(also or {}), number: x}, names=number, **more) for x in values]


def _rig(name: str, rig: Rig, duration: float = 12e-3, **more: Any) -> Case:
    """A rig at a speed at which it slips soon; stiff or fine beams need shorter steps of the published scheme."""
    soon: dict[str, Any] = {"edge": "fitting step", "share": 0.9, "slips_at": 1.5e-3}
    return Case(name, run={"duration": duration}, rig=rig, **soon, **more)


def _beams(word: str, number: str, factor: float, *beams: str) -> Case:
    """Multiply a number of some beams; the contact keeps its relative position on P2."""
    old = {beam: getattr(PAPERS, beam) for beam in beams}
    scaled = {beam: replace(part, **{number: factor * getattr(part, number)}) for beam, part in old.items()}
    position = scaled.get("p2", PAPERS.p2).length / PAPERS.p2.length * PAPERS.contact_position
    rig = replace(PAPERS, contact_position=position, **scaled)
    return _rig(f"{word} {' and '.join(map(str.upper, beams))}", rig, task=f"{number} times {factor:g}")


# A run that ends before its energy balance depends on last bits. Near Painleve's mu at 5 degrees the balance of
# the first impacts is off by 1.2 %, and after 10 ms by anything up to 7 %.
LANDING, BRIEF = {"duration": 5e-3}, {"duration": 10e-3}
# Methods that a case does not apply to, and why.
NO_STEP = {"exact": "it has no step to be stable: its grid is only where statistics are read"}
ALL_MODES = {"paper": "it keeps all modes: it has no cut-off"}
ENDS_EARLY = dict.fromkeys(("exact", "paper"), "only 'fast' ends a run early")
# Cases that would take these methods longer than some 10 s of a core.
TOO_EXPENSIVE: Any = dict.fromkeys(("100 s, vibrating", "100 s, sliding", "100 s, stuck"), ("exact", "paper"))
TOO_EXPENSIVE |= dict.fromkeys(("long P2", "cut-off 1000 kHz", "every mode"), ("exact",))
TOO_EXPENSIVE["1 s, vibrating"] = ("paper",)
AT_REST: Any = {"force": 1.0}
THROWN: Any = {"duration": 2e-4, "start": partial(_at_rest, contact=OPEN, gap=1e-6, fall=1.0)}
BLOWN, ALONG = "all modes as after a blow of 4 us", "P1's tip moving along P2 as contact is made"
T = "tangential"

GROUPED: dict[str, list[Case]] = {
    "step": [
        Case(f"step {x:g} of the largest", edge="step", share=x, names="step", excluded=NO_STEP,
             expected=VALUE if x > 1.0 else PASSES)
        for x in (0.5, 0.9, 0.999, 1.001, 1.5)],
    "friction": [
        *_numbers("mu", "mu = {:g}", 0.0, 1e-12),
        *_numbers("mu", "mu = {:g}", 1.0, 2.0, also={"V": 1.0}, run=BRIEF),
        *(Case(f"{share:.7g} of Painleve's mu, {theta:g}°", {"V": 1.0, "theta": theta},
               LANDING if theta == 5.0 else BRIEF, edge="mu", share=share, names="mu",
               # "exact" says so where slip would grow faster than events may follow each other.
               expected=CONTACT if share > 1.0 else {"exact": CONTACT} if 1.0 - share < 1e-6 else PASSES)
          for theta, share in product((5.0, 20.0, -20.0), (0.5, 0.999, 0.9999999, 1.001))),
        Case("mu = 1e6, upright", {"mu": 1e6, "theta": 0.0, "V": 1.0}, BRIEF,
             "the largest coefficient of friction that a scene takes, where nothing couples the directions"),
        *_numbers("mu", "mu = {:g}", -0.1, NAN, expected=VALUE)],
    "angle": [
        *_numbers("theta", "theta = {:g}°", 0.0, 5.0, -5.0, 60.0, -60.0, 89.0, 89.9999, -89.9999),
        *_numbers("theta", "theta = {:g}°", 90.0, -91.0, NAN, expected=VALUE)],
    "speed": [
        *_numbers("V", "V = {:g} m/s", 1e-9, 1e-3, 1.0, -POINT["V"]),
        Case("in the mirror", {"V": -POINT["V"], "theta": -POINT["theta"]}, task="the same motion", copy=True),
        *_numbers("V", "V = {:g}", 0.0, INFINITE, NAN, expected=VALUE)],
    "load": [
        *(Case(f"F = {F:g} N, same V/F", {"F": F, "V": POINT["V"] * F / POINT["F"]}, copy=True,
               task="the same motion in another size") for F in (1e-3, 1.0, 1e6)),
        *_numbers("F", "F = {:g} N", 1e-3, 1e6),
        *_numbers("F", "F = {:g}", 0.0, -9.0, NAN, expected=VALUE),
        *(Case(f"{x:g} of the {edge} V/F", edge=f"{edge} V/F", share=x, names="V / F",
               expected=PASSES if (x > 1.0) == (edge == "least") else VALUE)
          for edge, x in (("least", 1.001), ("least", 0.999), ("largest", 0.999), ("largest", 1.001)))],
    "grazing": [
        _begun("touching", "P1 unloaded, just touching and at rest, when the load comes on", contact=OPEN),
        _begun("vanishing impact", "an impact at 1 nm/s from a gap of 1 pm", contact=OPEN, gap=1e-12, fall=1e-9),
        _begun("tangent", "a ringing tip whose path touches P2 without a closing speed", _tangent, above=0.0),
        _begun("tangent, missed", "the same path a trillionth of its size higher", _tangent, above=1e-12),
        _begun("tangent, met", "the same path a trillionth of its size lower", _tangent, above=-1e-12)],
    "release": [
        _begun("preload 100 F", "rest under a hundred times the load, released", contact=STICK, force=1e2),
        _begun("preload 10000 F", "rest under ten thousand times the load, released", contact=STICK, force=1e4)],
    "catch": [
        _begun("thrown at 1 m/s", "P1 thrown onto P2 at 1 m/s", contact=OPEN, gap=1e-6, fall=1.0),
        _begun("thrown at 100 m/s", "P1 thrown onto P2 at 100 m/s", contact=OPEN, gap=1e-6, fall=100.0),
        *(_begun(f"along at {speed}", ALONG, contact=SLIP, along=along, **AT_REST)
          for speed, along in (("10 m/s", 10.0), ("1 km/s", 1e3))),
        _begun("struck along", f"{BLOWN} along P2 that leaves the contact slipping at 10 m/s", _struck, shape=T),
        _begun("struck across", f"{BLOWN} across P2 that opens the contact at 10 m/s", _struck, shape="normal")],
    "first state": [
        _begun("rest, separation", "rest under the load, begun in separation", contact=OPEN, **AT_REST),
        _begun("rest, stick", "rest under the load, begun in stick", contact=STICK, **AT_REST),
        _begun("rest, slip", "rest under the load, begun in slip", contact=SLIP, **AT_REST),
        _begun("open, stick", "a gap of 1 um, begun in stick", contact=STICK, gap=1e-6),
        _begun("open, slip", "a gap of 1 um, begun in slip", contact=SLIP, gap=1e-6),
        _begun("too few modes", "displacements of one mode less than the rig has", _struck, VALUE, shape=T, n=-1),
        _begun("not a number", "a modal velocity that is not a number", contact=STICK, fall=NAN, expected=VALUE),
        _begun("no such state", "the contact state 3", contact=3, expected=VALUE, **AT_REST)],
    "rig": [
        *(_beams(word, "young_modulus", factor, *beams)
          for word, factor in (("stiff", 100.0), ("soft", 0.01)) for beams in (("p1",), ("p2",), ("p1", "p2"))),
        *(_beams(word, number, factor, beam)
          for number, words in (("length", ("long", "short")), ("thickness", ("thick", "thin")))
          for word, factor in zip(words, (10.0, 0.1), strict=True) for beam in ("p1", "p2")),
        *(_rig(f"{p1} and {p2} elements", Rig.of(p1_elements=p1, p2_elements=p2))
          for p1, p2 in ((1, 1), (3, 3), (3, 90), (30, 3))),
        _rig("400 and 400 elements", Rig.of(p1_elements=400, p2_elements=400), **THROWN,
             task="P1 thrown onto P2 at 1 m/s, for it cannot run for long"),
        _rig("no head", Rig(head_mass=0.0)),
        *(_rig(f"head of {text}", Rig(head_mass=mass))
          for text, mass in (("1 mg", 1e-6), ("1 t", 1e3), ("1e9 kg", 1e9))),
        *(_rig(f"contact 1 {unit} from the clamp", Rig(contact_position=away))
          for unit, away in (("um", 1e-6), ("mm", 1e-3))),
        _rig("contact at the free end", Rig(contact_position=0.15))],
    "damping": [
        _rig("no damping", Rig(d1=0.0, d2=0.0)),
        _rig("d2 = 0", Rig(d2=0.0)),
        *(_rig(f"d1 = {text} 1/s", Rig(d1=float(text))) for text in ("5e4", "1e7")),
        *(_rig(f"d2 = {text} us", Rig(d2=d2)) for text, d2 in (("1", 1e-6), ("100", 1e-4)))],
    "drive": [
        *(Case(f"ramp {ramp:g} s", run={"ramp": ramp, "duration": 20e-3})
          for ramp in (0.0, 1e-9, 1e-6, 10.0, 1e3)),
        *(Case(f"ramp {ramp:g}", run={"ramp": ramp}, expected=VALUE, names="ramp") for ramp in (-1e-3, 1e-12))],
    "long": [
        *(Case(f"{s:g} s, vibrating", {"V": 5e-3}, {"duration": s}) for s in (100.0, 1.0)),
        Case("100 s, sliding", {"theta": -5.0}, {"duration": 100.0}),
        Case("10 s, every step", {"theta": -5.0}, {"duration": 10.0, "end_early": False}, excluded=ENDS_EARLY,
             task="sliding in which all vibration dies, every step taken"),
        Case("100 s, stuck", {"V": 1e-9}, {"duration": 100.0})],
    "cut-off": [
        *(Case(f"{x:g} of the least cut-off", edge="cutoff", share=x, names="cutoff",
               expected={"paper": VALUE} if x > 1.0 else VALUE) for x in (0.999, 1.001, 30.0)),
        *(Case(f"cut-off {cutoff / 1e3:g} kHz", run={"cutoff": cutoff, "duration": duration}, excluded=ALL_MODES)
          for cutoff, duration in ((3e5, 20e-3), (1e6, 12e-3))),
        Case("every mode", {"V": 1.0}, {"cutoff": 1e9, "duration": 4e-3}, excluded=ALL_MODES,
             task="a cut-off above all modes: the finite elements themselves, touching rigidly")],
    "record": [Case("too many samples", run={"record": True, "duration": 10.0}, edge="samples", share=1.001,
                    expected=VALUE, names="sample_rate")],
}  # fmt: skip

CASES = {case.name: replace(case, group=group) for group, cases in GROUPED.items() for case in cases}
