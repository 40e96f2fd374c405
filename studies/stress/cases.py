"""What each method is asked under stress: the cases as data, one row each.

A case is the operating point with something driven to an edge. Where the edge is the method's own (its largest
step, its critical friction) the row says how far from it to go; `studies.stress.limits` finds the number. How runs
are judged is said in `studies.stress.checks`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from fivcore import Rig
from studies.stress.case import CONTACT, METHODS, PASSES, POINT, VALUE, Case
from studies.stress.rigs import RIGS

# When the contact of other rigs slips, s, for what is stuck tells little.
RIG_SLIPS = 1.5e-3
NO_STEP = {"exact": "it has no step to be stable: its grid is only where statistics are read"}
OWN_MODES = {"paper": "it keeps all modes: it has no cut-off and no termination"}
ABSORBING = {"exact": "it needs the absorbing element and refuses another termination"}


def _refused(name: str, group: str, asks: str, names: str, **more: Any) -> Case:
    """A case with an argument that no method may take."""
    return Case(name, group, asks, names=names, **{"expected": VALUE} | more)


def _steps() -> tuple[Case, ...]:
    """Approaching and past the limit of stability."""
    base = Case("", "step", "", edge="step", names="step", apart=NO_STEP)
    return tuple(
        replace(
            base,
            name=f"step {share:g} of the largest",
            asks=f"a step of {share:g} times the largest stable one",
            share=share,
            expected=PASSES if share < 1.0 else VALUE,
        )
        for share in (0.5, 0.9, 0.999, 1.001, 1.5)
    )


def _frictions() -> tuple[Case, ...]:
    """From none to beyond the method's own critical friction, at a speed at which much friction slips too."""
    hard = {"V": 1.0, "theta": 20.0}
    given = [
        Case(f"mu = {mu:g}", "friction", f"a coefficient of friction of {mu:g}", {"mu": mu})
        for mu in (0.0, 1e-12, 1.0, 2.0)
    ]
    given[2:] = [replace(case, scene={**case.scene, "V": 1.0}, run={"duration": 10e-3}) for case in given[2:]]
    near = [
        Case(
            f"{share:.7g} of critical mu, {angle:g}°",
            "friction",
            f"{share:.7g} times the coefficient of friction at which the contact force stops being unique, at "
            f"{angle:g} degrees and {hard['V']:g} m/s",
            {**hard, "theta": angle},
            run={"duration": 10e-3},
            edge="mu",
            share=share,
            # "exact" says so where slip would grow faster than events may follow each other.
            expected=CONTACT if share > 1.0 else {"exact": CONTACT} if 1.0 - share < 1e-6 else PASSES,
            names="mu",
        )
        for angle in (5.0, 20.0, -20.0)
        for share in (0.5, 0.999, 0.9999999, 1.001)
    ]
    upright = Case(
        "mu = 1e6, upright",
        "friction",
        "the largest coefficient of friction that a scene takes, where nothing couples the directions",
        {"mu": 1e6, "theta": 0.0, "V": 1.0},
        run={"duration": 10e-3},
    )
    refused = [
        _refused(f"mu = {mu:g}", "friction", f"a coefficient of friction of {mu:g}", "mu", scene={"mu": mu})
        for mu in (-0.1, float("nan"))
    ]
    return (*given, *near, upright, *refused)


def _angles() -> tuple[Case, ...]:
    """Upright, steep, flat, and past what a scene takes."""
    taken = [
        Case(f"theta = {theta:g}°", "angle", f"P1 at {theta:g} degrees", {"theta": theta})
        for theta in (0.0, 5.0, -5.0, 60.0, -60.0, 89.0, 89.9999, -89.9999)
    ]
    past = [
        _refused(f"theta = {theta:g}°", "angle", f"P1 at {theta:g} degrees", "theta", scene={"theta": theta})
        for theta in (90.0, -91.0, float("nan"))
    ]
    return (*taken, *past)


def _speeds() -> tuple[Case, ...]:
    """Speeds and loads at the edges of sense, copies of the operating point, and V / F at its limits."""
    speeds = [
        Case(f"V = {V:g} m/s", "speed", f"a drive of {V:g} m/s", {"V": V}, copy=copy)
        for V, copy in ((1e-9, False), (1e-3, False), (1.0, False), (-POINT["V"], False))
    ]
    mirrored = {"V": -POINT["V"], "theta": -POINT["theta"]}
    mirror = Case("in the mirror", "speed", "V and theta of the other sign: the same motion", mirrored, copy=True)
    no_speed = [
        _refused(f"V = {V:g}", "speed", f"a drive of {V:g} m/s", "V", scene={"V": V})
        for V in (0.0, float("inf"), float("nan"))
    ]
    loads = [
        Case(
            f"F = {F:g} N, same V/F",
            "load",
            f"a load of {F:g} N at the operating point's V / F: the same motion in another size",
            {"F": F, "V": POINT["V"] * F / POINT["F"]},
            copy=True,
        )
        for F in (1e-3, 1.0, 1e6)
    ]
    alone = [Case(f"F = {F:g} N", "load", f"a load of {F:g} N", {"F": F}) for F in (1e-3, 1e6)]
    no_load = [
        _refused(f"F = {F:g}", "load", f"a load of {F:g} N", "F", scene={"F": F})
        for F in (0.0, -9.0, float("nan"))
    ]
    paces = [
        Case(
            f"{share:g} of the {edge} V/F",
            "load",
            f"{share:g} times the {edge} V / F that is resolved",
            edge=f"{edge} pace",
            share=share,
            expected=PASSES if inside else VALUE,
            names="V / F",
        )
        for edge, share, inside in (
            ("least", 1.001, True),
            ("least", 0.999, False),
            ("largest", 0.999, True),
            ("largest", 1.001, False),
        )
    ]
    return (*speeds, mirror, *no_speed, *loads, *alone, *no_load, *paces)


def _starts() -> tuple[Case, ...]:
    """Contacts that graze, are released, are caught, and begin in each state."""
    rows = (
        ("touching", "grazing", "P1 unloaded, just touching and at rest, when the load comes on"),
        ("vanishing impact", "grazing", "an impact at 1 nm/s from a gap of 1 pm"),
        ("tangent", "grazing", "a ringing tip whose path touches P2 without a closing speed"),
        ("tangent, missed", "grazing", "the same path a trillionth of its size higher"),
        ("tangent, met", "grazing", "the same path a trillionth of its size lower"),
        ("preload 100 F", "release", "rest under a hundred times the load, released"),
        ("preload 10000 F", "release", "rest under ten thousand times the load, released"),
        ("thrown at 1 m/s", "catch", "P1 thrown onto P2 at 1 m/s"),
        ("thrown at 100 m/s", "catch", "P1 thrown onto P2 at 100 m/s"),
        ("along at 10 m/s", "catch", "P1's tip moving along P2 at 10 m/s as contact is made"),
        ("along at 1 km/s", "catch", "P1's tip moving along P2 at 1 km/s as contact is made"),
        (
            "struck along",
            "catch",
            "all modes as after a blow of 4 us along P2 that leaves the contact slipping at 10 m/s",
        ),
        ("struck across", "catch", "all modes as after a blow of 4 us across P2 that opens the contact at 10 m/s"),
        ("rest, separation", "first state", "rest under the load, begun in separation"),
        ("rest, stick", "first state", "rest under the load, begun in stick"),
        ("rest, slip", "first state", "rest under the load, begun in slip"),
        ("open, stick", "first state", "a gap of 1 um, begun in stick"),
        ("open, slip", "first state", "a gap of 1 um, begun in slip"),
    )
    given = tuple(Case(name, group, asks, start=name, run={"duration": 20e-3}) for name, group, asks in rows)
    wrong = tuple(
        _refused(name, "first state", asks, "initial", start=name)
        for name, asks in (
            ("too few modes", "displacements of one mode less than the rig has"),
            ("not a number", "a modal velocity that is not a number"),
            ("no such state", "the contact state 3"),
        )
    )
    return given + wrong


def _rigs() -> tuple[Case, ...]:
    """Beams, meshes, heads, contact points and damping far from the paper's."""
    return tuple(
        Case(
            made.name,
            made.group,
            made.asks,
            rig=made.rig,
            run={"duration": made.duration},
            # Stiffer or finer beams need shorter steps of the published scheme: nine tenths of what is stable.
            edge="fitting step",
            share=0.9,
            slips_at=RIG_SLIPS,
            start=made.start,
            expected=made.expected or PASSES,
            names=made.names,
            apart=made.apart,
        )
        for made in RIGS
    )


def _drives() -> tuple[Case, ...]:
    """Ramps, long runs and a moving contact point."""
    ramps = [
        Case(f"ramp {ramp:g} s", "drive", f"a ramp of {ramp:g} s", run={"ramp": ramp, "duration": 20e-3})
        for ramp in (0.0, 1e-9, 1e-6, 10.0, 1e3)
    ]
    wrong = [
        _refused(f"ramp {ramp:g}", "drive", f"a ramp of {ramp:g} s", "ramp", run={"ramp": ramp})
        for ramp in (-1e-3, 1e-12)
    ]
    long = [
        Case("100 s, vibrating", "long", "100 s at 5 mm/s", {"V": 5e-3}, run={"duration": 100.0}),
        Case("1 s, vibrating", "long", "1 s at 5 mm/s", {"V": 5e-3}, run={"duration": 1.0}),
        Case("100 s, sliding", "long", "100 s of steady sliding", {"theta": -5.0}, run={"duration": 100.0}),
        Case(
            "10 s, every step",
            "long",
            "10 s of sliding in which all vibration dies, every step taken",
            {"theta": -5.0},
            run={"duration": 10.0, "end_early": False},
            apart=dict.fromkeys(("exact", "paper"), "only 'fast' ends a run early"),
        ),
        Case("100 s, stuck", "long", "100 s at a drive that never slips", {"V": 1e-9}, run={"duration": 100.0}),
    ]
    moving = [
        Case(
            f"to {end}, {share:g} of the way",
            "moving contact",
            f"a contact point moving {share:g} times as long as it takes to reach {end} from nearby, at 1 m/s",
            {"V": 1.0},
            Rig(contact_position=start),
            {"contact_motion": motion},
            edge="reach",
            share=share,
            expected=dict.fromkeys(METHODS if share > 1.0 else ("exact",), VALUE),
            names="duration" if share > 1.0 else "contact_motion",
        )
        for motion, end, start in ((-1, "P2's clamp", 0.012), (1, "P2's free end", 0.14))
        for share in (0.999, 1.001)
    ]
    return (*ramps, *wrong, *long, *moving)


def _terminations() -> tuple[Case, ...]:
    """What stands for the modes above the cut-off, from hardly any kept to all; a record that is too long."""
    kinds = [
        Case(
            f"termination {kind}",
            "termination",
            f"the termination {kind!r}",
            run={"termination": kind},
            expected={"exact": VALUE},
            names="termination",
            apart=OWN_MODES,
        )
        for kind in ("elastic", "none")
    ]
    cutoffs = [
        Case(
            f"{share:g} of the least cut-off, {kind}",
            "termination",
            f"{share:g} times the least cut-off, termination {kind!r}",
            run={"termination": kind},
            edge="cutoff",
            share=share,
            expected={"paper": VALUE} if share > 1.0 else VALUE,
            names="cutoff",
            apart=ABSORBING if kind == "none" else {},
        )
        for kind in ("absorbing", "none")
        for share in (0.999, 1.001, 30.0)
    ]
    high = [
        Case(
            f"{kind}, cut-off {cutoff / 1e3:g} kHz",
            "termination",
            f"a cut-off that leaves out the fastest modes alone, termination {kind!r}",
            run={"termination": kind, "cutoff": cutoff, "duration": duration},
            apart=OWN_MODES if kind == "absorbing" else OWN_MODES | ABSORBING,
        )
        for kind, cutoff, duration in (
            ("absorbing", 3e5, 20e-3),
            ("elastic", 3e5, 20e-3),
            ("absorbing", 1e6, 12e-3),
        )
    ]
    every = Case(
        "every mode, no element",
        "termination",
        "a cut-off above all modes: the finite elements themselves, touching rigidly",
        {"V": 1.0},
        run={"cutoff": 1e9, "duration": 4e-3},
        expected={"exact": VALUE},
        names="cutoff",
        apart=OWN_MODES,
    )
    samples = [
        _refused(
            "too many samples",
            "record",
            "a record of more samples than may be",
            "sample_rate",
            run={"record": True, "duration": 10.0},
            edge="samples",
            share=1.001,
        )
    ]
    return (*kinds, *cutoffs, *high, every, *samples)


CASES: tuple[Case, ...] = (
    *_steps(),
    *_frictions(),
    *_angles(),
    *_speeds(),
    *_starts(),
    *_rigs(),
    *_drives(),
    *_terminations(),
)
GROUPS = tuple(dict.fromkeys(case.group for case in CASES))
