"""States of steady sliding, and of its modes."""

import numpy as np

from fivcore import State, sliding_modes
from fivcore.contact.reduced import full_model
from fivcore.transient.statistics import SLIP


def sliding_state(rig, theta, mu, V, F, pair=0, size=0.0):
    """State of steady sliding plus a multiple of an unstable mode, and that mode's exponent; ramp = 0."""
    model, modes = full_model(rig, theta), sliding_modes(rig, theta, mu)
    elastic = model.stiffness > 0.0
    force = model.normal + mu * model.tangential
    # Friction bends it from where it is at rest under the unit load.
    q = np.zeros(len(force))
    q[elastic] = (force - model.normal)[elastic] / model.stiffness[elastic] + model.static_equilibrium[elastic]
    q[~elastic] = -(model.normal @ q) / model.normal[~elastic]
    # Relative to a clamp that starts with a jerk, P2 must move for it to be at V at once.
    v = -model.inertia * V / F
    if not size:
        return State(F * q, F * v, SLIP), None
    i = np.flatnonzero(modes.unstable)[pair]
    phi = complex(modes.growth_rate[i], 2.0 * np.pi * modes.frequency[i])
    shape = size * force / (model.stiffness + model.damping * phi + phi**2)
    return State(F * (q + shape.real), F * (v + (phi * shape).real), SLIP), phi
