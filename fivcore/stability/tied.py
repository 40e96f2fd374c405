"""Natural frequencies with both beams tied at the contact point (section 3.3 and Table 4 of the paper)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fivcore import checks
from fivcore.beams.modes import contact_modes, rig_bases
from fivcore.damping import tied_modes
from fivcore.errors import InputError
from fivcore.jit import Array, kernel
from fivcore.rig import ContactModel, Rig, checked_theta
from fivcore.structure import modal_structure

HEAVIEST = 1e9  # kg, the largest concentrated mass that tuning gives


def glued_frequencies(rig: ContactModel, theta: float, count: int = 8) -> Array:
    """Natural frequencies of the undamped rig with both translations of C tied to P2, rotations free.

    They are those of the finite-element model with all its modes, to rounding. Each is bisected by counting the
    eigenvalues below a frequency, so that none is missed (Wittrick and Williams, Q. J. Mech. Appl. Math. 24, 1971,
    263-284).

    Parameters
    ----------
    rig : Rig or Structure
    theta, count : float, int
        Degrees, 0 with a structure; number of frequencies, at most that of modes minus two.

    Returns
    -------
    ndarray, (count,)
        Hz, ascending.

    Raises
    ------
    ValueError
        For an argument out of range.
    """
    own = modal_structure(rig, checked_theta("rig", rig, theta))
    if own.several:
        found = tied_modes(own.stiffness, np.vstack([own.normal, own.tangential]), own.static)[0]
        return np.asarray(np.sqrt(found[: checks.count("count", count, len(found))]) / (2.0 * np.pi))
    stiffness, normal, tangential = own.stiffness, own.normal, own.tangential
    modes = len(own.frequency) - 2
    if modes < 1:
        raise InputError(f"rig = {checks.short(rig)}: with its contact tied it has no mode")
    number = checks.count("count", count, modes)
    # Two constraints raise the k-th eigenvalue, at most to the free one two places above. Each mode has a bracket
    # of its own, so that its bits do not depend on the count.
    free = np.sort(stiffness)
    low, high = np.maximum(free * (1.0 - 1e-9), free[free > 0.0][0] * 1e-24), free[2:] * (1.0 + 1e-9)
    squares = [_eigenvalue(k, low[k], high[k], stiffness, normal, tangential) for k in range(number)]
    return np.asarray(np.sqrt(squares) / (2.0 * np.pi))


def tune_head_mass(rig: Rig, theta: float, frequency: float = 16.0) -> float:
    """Head mass that makes `frequency` the first natural frequency of the tied rig, kg.

    The head mass of `rig` is ignored. With a mass M at A, omega^2 M h = 1 holds at resonance; h is the tied
    receptance at A.

    Parameters
    ----------
    rig : Rig
    theta, frequency : float
        Degrees; Hz, below the first tied frequency without a concentrated mass, above that with HEAVIEST.

    Raises
    ------
    ValueError
        If no head mass gives this frequency; the message names the range.
    """
    checks.instance("rig", rig, Rig)
    angle, bare = checks.theta_degrees(theta), replace(rig, head_mass=0.0)
    highest, lowest = (glued_frequencies(each, angle, 1)[0] for each in (bare, replace(rig, head_mass=HEAVIEST)))
    allowed = f"above {lowest:.6g} Hz, with a head mass of {HEAVIEST:g} kg, and below {highest:.6g} Hz,"
    target = checks.number("frequency", frequency, f"{allowed} without one", lambda x: lowest < x < highest)
    square, mass = (2.0 * np.pi * target) ** 2, 0.0
    # If the head mass is many times the mass of the beam, the receptance suffers from cancellation; a second
    # step from the first answer then gives full accuracy.
    for _ in range(2):
        loaded = replace(bare, head_mass=mass)
        stiffness, *contact = contact_modes(loaded, angle)
        head = rig_bases(loaded, angle)[0].shapes[0, 1]
        rows = np.stack([np.pad(head, (0, len(stiffness) - len(head))), *contact])
        h = (rows / (stiffness - square)) @ rows.T
        mass += float(np.linalg.det(h[1:, 1:]) / (square * np.linalg.det(h)))
    return mass


@kernel
def _eigenvalue(k: int, low: float, high: float, stiffness: Array, normal: Array, tangential: Array) -> float:
    """The smallest square with more than k tied eigenvalues below it, bisected to rounding."""
    middle = 0.5 * (low + high)
    while low < middle < high:
        # Those of the separate beams less those that the contact raises.
        below, nn, nt, tt = 0, 0.0, 0.0, 0.0
        for i in range(len(stiffness)):
            soft = 1.0 / (stiffness[i] - middle)
            below += soft < 0.0
            nn += normal[i] * normal[i] * soft
            nt += normal[i] * tangential[i] * soft
            tt += tangential[i] * tangential[i] * soft
        if nn * tt - nt * nt < 0.0:
            below -= 1
        elif nn + tt < 0.0:
            below -= 2
        if below > k:
            high = middle
        else:
            low = middle
        middle = 0.5 * (low + high)
    return middle
