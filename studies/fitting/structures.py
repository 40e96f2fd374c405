"""Parameters of a structure that a fit varies: damping, scales of its matrices, frequencies of its modes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fivcore import Structure
from fivcore.structure import motion_cutoff
from studies.parameters import RIG, Parameter
from sweeps import InputError

FREQUENCY = re.compile(r"frequency_([1-9]\d*)")


def parameters(structure: Structure) -> dict[str, Parameter]:
    """The numbers of a structure by their names."""
    frequencies = enumerate(structure.frequency.tolist(), 1)
    return {
        "d1": RIG["d1"],
        "d2": RIG["d2"],
        "damping_ratio": Parameter(0.0, "1", "damping ratio of every mode with the contact open"),
        "mass_scale": Parameter(1.0, "1", "factor of the mass matrix"),
        "stiffness_scale": Parameter(1.0, "1", "factor of the stiffness matrix"),
    } | {f"frequency_{k}": Parameter(f, "Hz", f"frequency of mode {k}, contact open") for k, f in frequencies if f}


def varied(structure: Structure, numbers: Mapping[str, float]) -> Structure:
    """The structure with other numbers: `parameters` has their names.

    Scales of mass and stiffness leave the damping ratios, d1 and d2 as they are.
    """
    own, m = structure, len(structure.frequency)
    mass, stiffness = (numbers.get(f"{name}_scale", 1.0) for name in ("mass", "stiffness"))
    squares = own.stiffness * (stiffness / mass)
    for name, value in numbers.items():
        if found := FREQUENCY.fullmatch(name):
            squares[int(found[1]) - 1] = (2.0 * np.pi * value) ** 2
    root = np.sqrt(mass)
    rows = {name: getattr(own, name) / root for name in ("normal", "tangential", "load", "output")}
    with np.errstate(invalid="ignore", divide="ignore"):
        damping = own.damping * np.where(own.stiffness > 0.0, np.sqrt(squares / own.stiffness), 1.0)
    if own.rayleigh is not None:
        d1, d2 = numbers.get("d1", own.d1), numbers.get("d2", own.d2)
        damping, own = (d1 + d2 * squares) * (np.arange(len(squares)) < m), replace(own, rayleigh=(d1, d2))
    elif numbers.keys() & {"d1", "d2"}:
        raise InputError("d1, d2: the structure is damped by mode; take damping_ratio, or leave d1 and d2 out")
    rows |= {"stiffness": squares, "damping": damping, "inertia": own.inertia * root}
    order = np.append(np.argsort(squares[:m], kind="stable"), np.arange(m, len(squares)))
    rows = {name: row[order] for name, row in rows.items()}
    own = replace(own, **rows, wider=own.wider and varied(own.wider, numbers))
    own = replace(own, cutoff=own.cutoff and motion_cutoff(own.motion))
    return own.damped(numbers["damping_ratio"], "free") if "damping_ratio" in numbers else own
