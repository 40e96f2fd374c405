"""Where a method's contact force stops being unique (Painleve's paradox), and the error that says so.

Each method divides by something of its own when it slips, so the condition belongs to the method:

- "paper": W_NN +- mu W_NT r / (1 + r), W the gaps that unit forces close within a step, r = dt / tau;
- "exact" with an element: C_TT -+ mu C_TN (K where it has no damping), which decide between stick and slip at any
  instant;
- "fast" with an element: the same for the element that its kicks need (`fivcore.kicks`), and what its implicit
  step divides by (`fivcore.contact_law.slip_divisors`);
- without an element: W_NN +- mu W_NT of the kept modes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import brentq

from fivcore import checks, published
from fivcore.contact_law import slip_divisors
from fivcore.errors import not_unique
from fivcore.kernel import Array
from fivcore.reduced import TERMINATIONS, ReducedModel, full_model, reduced_model
from fivcore.rig import Rig
from fivcore.switches import METHODS, switches

LARGEST = 1e6


def critical_mu(
    rig: Rig,
    theta: Any,
    method: str = "fast",
    *,
    cutoff: float | None = None,
    termination: str = "absorbing",
    step: float | None = None,
    relaxation_time: float | None = None,
    cross_terms: bool = True,
    beta2: float | None = None,
) -> float:
    """Find the coefficient of friction from which on a method's contact force is not unique.

    Parameters
    ----------
    rig : Rig
    theta : float
        Degrees; its sign does not matter, for both directions of slip are looked at.
    method, cutoff, termination, step, relaxation_time, cross_terms, beta2
        As in `fivcore.simulate`.

    Returns
    -------
    float
        Infinite where normal and tangential direction do not couple at the contact.

    Raises
    ------
    ValueError
        Naming the argument, its value and what is allowed.
    """
    checks.instance("rig", rig, Rig)
    theta = checks.theta_degrees(theta)
    checks.choice("method", method, METHODS)
    checks.choice("termination", termination, TERMINATIONS)
    step = None if step is None else checks.between("step", step, 1e-12, 1.0, "s")
    asked = switches(method, termination, relaxation_time, cross_terms, beta2)
    if method == "paper":
        dt = published.STEP if step is None else step
        W = published.contact_closing(full_model(rig, theta), dt, asked.get("beta2", published.BETA2))
        r = dt / published.TAU
        return _ratio(W[0] * (1.0 + r) / r, W[1])
    cutoff = None if cutoff is None else checks.between("cutoff", cutoff, 1.0, 1e12, "Hz")
    model = reduced_model(rig, theta, cutoff, termination, **asked)
    return critical_mu_of(model, None if method == "exact" else model.default_step if step is None else step)


def critical_mu_of(model: ReducedModel, step: float | None) -> float:
    """The same for a reduced model and a step of `fast`; without a step, of the law itself."""
    if not model.K.any():
        return _ratio(model.W[0, 0], model.W[0, 1])
    _, K, C, M = model.kicks(step or 0.0)
    law = _ratio(K[1, 1], K[0, 1])
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
        _, K, C, M = model.kicks(step or 0.0)
        divisors: Array = slip_divisors(K, C, M, mu, step or 0.0)
    else:
        divisors = np.array([model.W[0, 0] + s * mu * model.W[0, 1] for s in (1.0, -1.0)])
    if divisors.min() <= 0.0:
        raise not_unique(mu, critical_mu_of(model, step))


def _ratio(direct: float, cross: float) -> float:
    return float(abs(direct / cross)) if cross else float("inf")
