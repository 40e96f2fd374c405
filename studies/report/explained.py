"""Texts that explain the page: symbols with the paper's values, regimes and words."""

from __future__ import annotations

from typing import Any

from fivcore import Rig
from fivcore.rig import BEAM_NUMBERS, RIG_NUMBERS
from fivcore.transient import summary
from studies import paper
from studies.motion import transients
from studies.plotting import planes

SYMBOLS = {
    "P1, P2": "upper beam, inclined; lower beam, horizontal and driven",
    "A": "support of P1: it moves along y only, without rotation; it bears the head mass and the load",
    "B": "where the velocity of P1 along x is read, {b} of the length from C to A",
    "C, D": "tip of P1; point of P2 below it, where they touch",
    "x, y": "along P2 from its clamp; upwards",
    "N, T": "normal force, never below 0; friction force",
    "V": "velocity of P2's clamp along x",
    "θ (theta)": "inclination of P1 from y; above 0 it leans the way P2 moves",
    "μ (mu)": "coefficient of friction",
    "F": "load on A, downwards",
}
OWN = {
    "V": f"{', '.join(f'{1e3 * speed:g}' for speed in paper.SPEEDS)} mm/s",
    "θ (theta)": f"{paper.THETA:g}°",
    "μ (mu)": f"{paper.MU:g}",
    "F": f"{paper.LOAD:g} N",
}
REGIMES = {
    "undecided": "The run ends before the drive can make the contact slip, or before the motion settles.",
    "stuck": f"The contact never slips, although the clamp has moved {summary.SLIP_DRIVE:g} times as far as "
    "statics needs for that.",
    "steady sliding": f"The contact slips for more than {100.0 * summary.STEADY_SHARE:g} % of the time, at a rate "
    f"that stays within {100.0 * summary.STEADY_SPREAD:g} % of V in the end.",
    "intermittent": "Bursts of vibration and long sticks take turns: long sticks fill more than "
    f"{100.0 * summary.LONG_SHARE:g} % of the time, and one begins in the last third of the run.",
    "periodic": "The vibration repeats: the velocity of B correlates with itself after 20 periods by more than "
    f"{summary.COHERENT:g}.",
    "irregular": "Any other vibration.",
}
STATES = {
    "stick": "C and D do not move against each other; |T| ≤ μN.",
    "slip": "C slides along P2; |T| = μN, against the sliding.",
    "separation": "C is off P2; N = T = 0.",
}
WORDS = {
    "mode": "A shape in which the beams vibrate together, with a frequency and a growth rate.",
    "growth rate": "Rate at which a mode's amplitude grows (above 0: unstable) or decays (below 0), in 1/s.",
    "onset": "Coefficient of friction from which on a mode grows: there two modes coalesce (flutter).",
    "dominant frequency": "Frequency of the largest peak in the spectrum of the velocity of B, outside long "
    "sticks.",
    "loading time to slip": "Time in which the drive loads a stuck contact from rest until it slips.",
    "repeat runs": "Runs of one scene that differ only by how fast the drive starts; their spread is that of "
    "chance.",
    "numerical damping": "What the paper's time integration adds to the stiffness damping; each study says "
    "whether it has it.",
    "settled": f"From {transients.SETTLING:g} s after the first slip on, where statistics begin.",
}


def explained() -> dict[str, Any]:
    """Symbols, rows of name, meaning and the paper's value; regimes and states with their colours; words."""
    rig = Rig()
    symbols = [
        [name, meaning.format(b=f"{rig.point_b:g}"), OWN.get(name, "")] for name, meaning in SYMBOLS.items()
    ]
    symbols += [_number(name, meaning, getattr(rig, name)) for name, (_, meaning) in RIG_NUMBERS.items()]
    for name, (_, meaning) in BEAM_NUMBERS.items():
        own = [_number(f"{beam}_{name}", "", getattr(getattr(rig, beam), name))[2] for beam in ("p1", "p2")]
        symbols.append([f"p1_{name}, p2_{name}", f"{meaning} of P1 and P2", ", ".join(dict.fromkeys(own))])
    colours = dict(zip(transients.REGIMES, planes.COLOURS, strict=False)) | planes.STATE_COLOURS
    return {
        "symbols": symbols,
        "regimes": [(name, colours[name], text) for name, text in REGIMES.items()],
        "states": [(name, colours[name], text) for name, text in STATES.items()],
        "words": WORDS,
    }


def _number(name: str, meaning: str, value: float) -> list[str]:
    _, unit, factor = planes.SYMBOLS[name]
    return [name, meaning, f"{factor * value:.5g} {unit}".strip()]
