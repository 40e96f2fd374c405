"""The rig with several contacts: P1's tip on a rigid foot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fivcore import checks
from fivcore.beams.elements import hermite
from fivcore.beams.modes import rig_bases
from fivcore.contact.reduced import default_cutoff
from fivcore.rig import Rig
from fivcore.structure import Structure


def on_foot(rig: Rig, theta: float, nodes: int, length: float) -> Structure:
    """The rig with P1's tip on a rigid foot without mass, as a structure.

    Parameters
    ----------
    rig : Rig
    theta : float
        Inclination of P1, degrees.
    nodes : int
        Number of contacts, evenly over the foot; with 1 it is the rig itself.
    length : float
        Length of the foot along x, about the tip, m.
    """
    own, (upper, lower) = replace(Structure.of(rig, theta), cutoff=default_cutoff(rig)), rig_bases(rig, theta)
    nodes = checks.count("nodes", nodes, 1000)
    if nodes == 1:
        return own
    # Deflection and rotation of P2's nodes in turn, as `hermite` takes them.
    bent, rows = lower.shapes[1:, 1:].reshape(2 * rig.p2.elements, -1), []
    for arm in np.linspace(-0.5, 0.5, nodes) * length:
        along, across = hermite(rig.p2, rig.contact_position + arm)
        lifted = upper.shapes[-1, 1] + arm * upper.shapes[-1, 2]
        moved = np.append(upper.shapes[-1, 0], -along @ lower.shapes[1:, 0])
        rows.append((np.append(lifted, -across @ bent), moved))
    normal, tangential = map(np.stack, zip(*rows, strict=True))
    return replace(own, normal=normal, tangential=tangential, gap=np.zeros(nodes), friction=np.ones(nodes))
