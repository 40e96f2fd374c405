"""The numbers of a user's structure by name, and the structure with other numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fivcore import Structure, checks, motion_cutoff
from studies.declaring.parameters import RIG, Parameter
from sweeps import InputError


def parameters(structure: Structure) -> dict[str, Parameter]:
    """The numbers of a structure by their names."""
    found = {
        "d1": replace(RIG["d1"], default=structure.d1, common=False),
        "d2": replace(RIG["d2"], default=structure.d2, common=False),
        "damping_ratio": Parameter(0.0, "1", "damping ratio of every mode with the contact open"),
        "mass_scale": Parameter(1.0, "1", "factor of the mass matrix"),
        "stiffness_scale": Parameter(1.0, "1", "factor of the stiffness matrix"),
    }
    each = zip(structure.frequency.tolist(), structure.damping.tolist(), strict=False)
    for k, (hertz, damping) in enumerate(each, 1):
        if hertz:
            ratio = damping / (4.0 * np.pi * hertz)
            found[f"frequency_{k}"] = Parameter(hertz, "Hz", f"frequency of mode {k}, contact open")
            found[f"damping_ratio_{k}"] = Parameter(ratio, "1", f"damping ratio of mode {k}, contact open")
        found[f"damping_{k}"] = Parameter(damping, "s-1", f"damping of mode {k}, contact open")
    return found


def varied(structure: Structure, numbers: Mapping[str, float]) -> Structure:
    """The structure with other numbers, named as in `parameters`.

    Scales and frequencies do not change the damping ratios, d1 and d2.
    """
    own, m = structure, len(structure.frequency)
    for name, value in numbers.items():
        least = 1e-12 if name.startswith("frequency") or name.endswith("scale") else 0.0
        checks.between(name, value, least, 10.0 if "ratio" in name else 1e12, parameters(own)[name].units)
    mass, stiffness = (numbers.get(f"{name}_scale", 1.0) for name in ("mass", "stiffness"))
    squares = own.stiffness * (stiffness / mass)
    for k in range(m):
        if (name := f"frequency_{k + 1}") in numbers:
            squares[k] = (2.0 * np.pi * numbers[name]) ** 2
    root, moved = np.sqrt(mass), ("normal", "tangential", "load", "output", "struck")
    rows = {name: row / root for name in moved if (row := getattr(own, name)) is not None}
    with np.errstate(invalid="ignore", divide="ignore"):
        damping = own.damping * np.where(own.stiffness > 0.0, np.sqrt(squares / own.stiffness), 1.0)
    if own.rayleigh is not None:
        d1, d2 = numbers.get("d1", own.d1), numbers.get("d2", own.d2)
        damping, own = (d1 + d2 * squares) * (np.arange(len(squares)) < m), replace(own, rayleigh=(d1, d2))
    elif numbers.keys() & {"d1", "d2"}:
        raise InputError("d1, d2: the structure is damped by mode; take damping_ratio, or leave d1 and d2 out")
    if any(name.startswith("damping_") for name in numbers):
        own, ratio = replace(own, rayleigh=None), numbers.get("damping_ratio", np.nan)
        for k, omega in enumerate(np.sqrt(squares[:m]).tolist(), 1):
            given = numbers.get(f"damping_{k}", 2.0 * numbers.get(f"damping_ratio_{k}", ratio) * omega)
            damping[k - 1] = damping[k - 1] if np.isnan(given) else given
    rows |= {"stiffness": squares, "damping": damping, "inertia": own.inertia * root}
    order = np.append(np.argsort(squares[:m], kind="stable"), np.arange(m, len(squares)))
    rows = {name: row[..., order] for name, row in rows.items()}
    own = replace(own, **rows, wider=own.wider and varied(own.wider, numbers))
    return replace(own, cutoff=own.cutoff and motion_cutoff(own.motion))
