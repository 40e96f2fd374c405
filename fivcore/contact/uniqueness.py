"""Where the contact force of a reduced model stops being unique (Painleve's paradox): a divisor of slip is zero.

With an element the divisors are those of `fivcore.contact.law.slip_divisors`: for "exact" C_TT -+ mu C_TN alone (K
without damping), for "fast" those of the corrected element (`fivcore.contact.impulse`) and of its implicit step.
Without an element they are W_NN +- mu W_NT of the kept modes.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from fivcore.contact.law import slip_divisors
from fivcore.contact.reduced import ReducedModel
from fivcore.errors import not_unique
from fivcore.jit import Array

# No coefficient of friction is larger (`fivcore.checks.friction`).
LARGEST = 1e6


def critical_mu_of(model: ReducedModel, step: float | None) -> float:
    """Smallest friction without a unique contact force, in steps of `fast`; without a step, by the law itself."""
    if not model.K.any():
        return ratio(model.W[0, 0], model.W[0, 1])
    _, K, C, M = model.impulse(step or 0.0)
    law = ratio(K[1, 1], K[0, 1])
    if step is None or not C.any():
        return law

    def least(mu: float) -> float:
        return float(slip_divisors(K, C, M, mu, step)[2:].min())

    # The step's own divisors are positive at mu = 0 and smooth up to the law's limit.
    trial = np.linspace(0.0, min(law, LARGEST) * (1.0 - 1e-9), 400)
    first = next((k for k in range(1, 400) if least(trial[k]) <= 0.0), None)
    return law if first is None else float(brentq(least, trial[first - 1], trial[first]))


def check_unique(model: ReducedModel, mu: float, step: float | None) -> None:
    """Raise `ContactError` where the contact force of a reduced model is not unique; `step` as above."""
    if model.K.any():
        _, K, C, M = model.impulse(step or 0.0)
        divisors: Array = slip_divisors(K, C, M, mu, step or 0.0)
    else:
        divisors = np.array([model.W[0, 0] + s * mu * model.W[0, 1] for s in (1.0, -1.0)])
    if divisors.min() <= 0.0:
        raise not_unique(mu, critical_mu_of(model, step))


def ratio(direct: float, cross: float) -> float:
    """Friction at which the cross term equals the direct one."""
    return float(abs(direct / cross)) if cross else float("inf")
