"""Where the contact force of a reduced model stops being unique (Painleve's paradox), and the error that says so.

- "exact" with an element: C_TT -+ mu C_TN (K where it has no damping), which decide between stick and slip at any
  instant;
- "fast" with an element: the same for the element that its kicks need (`fivcore.contact.impulse`), and what its
  implicit step divides by (`fivcore.contact.law.slip_divisors`);
- without an element: W_NN +- mu W_NT of the kept modes.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from fivcore.contact.law import slip_divisors
from fivcore.contact.reduced import ReducedModel
from fivcore.errors import not_unique
from fivcore.jit import Array

LARGEST = 1e6


def critical_mu_of(model: ReducedModel, step: float | None) -> float:
    """The same for a reduced model and a step of `fast`; without a step, of the law itself."""
    if not model.K.any():
        return ratio(model.W[0, 0], model.W[0, 1])
    _, K, C, M = model.impulse(step or 0.0)
    law = ratio(K[1, 1], K[0, 1])
    if step is None or not C.any():
        return law

    def least(mu: float) -> float:
        return float(slip_divisors(K, C, M, mu, step)[2:].min())

    # The step's own divisors are positive at mu = 0 and smooth up to the law's limit.
    trial = np.linspace(0.0, min(law, LARGEST) * (1.0 - 1e-9), 400)[1:]
    below = np.array([least(mu) <= 0.0 for mu in trial])
    if not below.any():
        return law
    first = int(np.argmax(below))
    return float(brentq(least, trial[first - 1] if first else 0.0, trial[first]))


def check_unique(model: ReducedModel, mu: float, step: float | None) -> None:
    """Raise where the contact force of a reduced model is not unique."""
    if model.K.any():
        _, K, C, M = model.impulse(step or 0.0)
        divisors: Array = slip_divisors(K, C, M, mu, step or 0.0)
    else:
        divisors = np.array([model.W[0, 0] + s * mu * model.W[0, 1] for s in (1.0, -1.0)])
    if divisors.min() <= 0.0:
        raise not_unique(mu, critical_mu_of(model, step))


def ratio(direct: float, cross: float) -> float:
    """The friction at which the cross term equals the direct one."""
    return float(abs(direct / cross)) if cross else float("inf")
