"""Structures from tables of modes: static modes, damping, preload, and additional modes for motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.csgraph import connected_components

from fivcore import checks
from fivcore.errors import InputError
from fivcore.finite_elements import static_modes
from fivcore.jit import Array
from fivcore.modal.cutoffs import FURTHER_MODES, MOST_MODES, MOTION_MODES, motion_cutoffs
from fivcore.modal.rows import ratios_of

NO_PRELOAD = "it does not press the contact at rest, so that there is no motion with friction"


def structure_of(
    make: Callable[..., Any],
    table: Array,
    own: Mapping[str, Any],
    rayleigh: tuple[Any, Any],
    ratio: Any,
    compliance: Any = None,
    vectors: Any = None,
    names: Any = None,
) -> Any:
    """Check a table of modes and return the structure that `make` builds from it.

    The rows of `table` are stiffness, normal, tangential, load, inertia and output; with c contacts normal and
    tangential have c rows each, and `own` holds their gap and friction. `compliance`, (2c + 1, 2c + 1), is that of
    the modes that are not computed; error messages use `vectors` and the `names` of the degrees of freedom.
    """
    m, order, c = table.shape[1], np.argsort(table[0], kind="stable"), len(table) // 2 - 2
    d1, d2 = checks.between("d1", rayleigh[0], 0.0, 1e12, "1/s"), checks.between("d2", rayleigh[1], 0.0, 1e12, "s")
    if m == 1 and table[0, 0] == 0.0:
        raise InputError(
            "frequency: the only mode is rigid, so that nothing vibrates; give more, or a higher fmax"
        )
    for name, rows in zip(("normal", "tangential", "load"), np.split(table[1:-2], (c, 2 * c)), strict=True):
        if not rows.any():
            raise InputError(f"{name}: it must not be zero for every mode")
    table = table[:, order]
    if compliance is not None:
        springs = np.vstack(static_modes(compliance, float(table[0].max())))
        table = np.hstack([table, np.pad(springs, ((0, 2), (0, 0)))])
    stiffness, load, inertia, output = (row.copy() for row in table[[0, -3, -2, -1]])
    normal, tangential = (rows.copy() if own else rows[0].copy() for rows in np.split(table[1:-3], 2))
    damping = np.where(np.arange(len(stiffness)) < m, d1 + d2 * stiffness, 0.0)
    if ratio is not None:
        damping[:m] += 2.0 * ratios_of(ratio, m) * np.sqrt(stiffness[:m])
    check_held(stiffness, normal, None if vectors is None else vectors[:, order], names)
    law, each = None if ratio is not None else (d1, d2), (normal, tangential, inertia, output, load)
    structure = make(stiffness, damping, *each, normal, law, len(stiffness) - m, **own)
    pressing, rounding = structure._normal_force
    if abs(pressing) <= rounding:
        return replace(structure, remarks=(f"load: {NO_PRELOAD}",))
    if not pressing > 0.0:
        raise InputError(
            f"load: with it the contact opens (normal force {pressing:.3g} for a unit load);"
            " change the sign of load or normal"
        )
    if not 1e-12 <= pressing <= 1e12:
        text = f"{pressing:.3g} for a unit load; it must be from 1e-12 to 1e12"
        raise InputError(f"load: with it and normal the normal force at rest is {text}")
    return structure


def with_matrix(found: Any, by_modes: Array) -> Any:
    """Add the diagonal of a damping matrix in modal coordinates."""
    diagonal = np.diag(by_modes)
    if diagonal.min() < -1e-9 * np.abs(by_modes).max():
        raise InputError(f"damping: it gives a mode {diagonal.min():g} 1/s; it must not be negative")
    coupling = float(np.abs(by_modes - np.diag(diagonal)).max() / max(diagonal.max(), 1e-300))
    text = f"damping: coupling of modes is left out, at most {coupling:.3g} of the largest term"
    added = np.pad(np.maximum(diagonal, 0.0), (0, found.static))
    return replace(found, damping=found.damping + added, rayleigh=None, remarks=(*found.remarks, text))


def for_motion(own: Any, band: float | None, n: int, up_to: Callable[[float], Any]) -> Any:
    """Set the cut-off of motion, and compute the modes below it that `own`, which ends at `band`, lacks.

    The upper third of the `n` modes of a mesh is not used, because it is inaccurate; small models keep all modes.
    """
    if band is None and n <= MOTION_MODES:
        return own
    found, top, most = own, band or 0.0, min(max(2 * n // 3, 2), MOST_MODES)
    factor, before = 2.0, 0
    while (cutoffs := motion_cutoffs(found, most))[1] is None and found.static:
        m = len(found.frequency)
        if before:
            # The number of modes grows as the square root of frequency for beams, as frequency or its square for
            # plates.
            power = np.clip(np.log(m / before) / np.log(factor), 0.4, 3.0)
            factor = float(np.clip((1.1 * FURTHER_MODES / m) ** (1.0 / power), 1.25, 8.0))
        top, before = top * factor, m
        found = up_to(top)
    usual, further = cutoffs
    if usual is None or found is own:
        return replace(own, cutoff=usual)
    return replace(own, cutoff=usual, wider=up_to(further or usual))


def check_held(stiffness: Array, normal: Array, vectors: Array | None, names: Any) -> None:
    """Raise unless the closed contacts prevent every rigid motion."""
    rigid = np.flatnonzero(stiffness == 0.0)
    if not len(rigid):
        return
    # The combinations of rigid motions that leave the gap closed.
    free = linalg.null_space(np.atleast_2d(normal)[:, rigid] / max(np.abs(normal).max(), 1e-300))
    if free.shape[1]:
        text = f"{free.shape[1]} rigid motion(s) that the closed contact does not hold"
        if vectors is not None:
            moved = np.abs(vectors[:, rigid] @ free[:, 0])
            text += f"; one moves {names[moved.argmax()]} most"
        raise InputError(f"stiffness: {text}: support the structure")


def of_loaded_bodies(M: Any, K: Any, normal: Array, load: Array) -> Array:
    """The normal gap row, (n,), restricted to the bodies that the load acts on."""
    label = connected_components(sum(sparse.csr_array(matrix != 0.0) for matrix in (M, K)), directed=False)[1]
    return np.where(np.isin(label, label[load != 0.0]), normal, 0.0)
