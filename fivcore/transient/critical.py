"""Where a method's contact force stops being unique (Painleve's paradox), by the divisors of its slip.

For "paper" see `fivcore.transient.published.critical_friction`, for "exact" and "fast" `fivcore.contact.law`.
"""

from __future__ import annotations

from typing import Any

from fivcore import checks
from fivcore.contact.ablation import Modify, modified
from fivcore.contact.reduced import full_model, reduced_model
from fivcore.rig import Rig
from fivcore.transient import published
from fivcore.transient.options import law_options


def critical_mu(
    rig: Rig,
    theta: Any,
    method: str = "fast",
    *,
    numerical_damping: str | None = None,
    cutoff: float | None = None,
    termination: str = "absorbing",
    step: float | None = None,
    modify: Modify | None = None,
    beta2: float | None = None,
) -> float:
    """Find the coefficient of friction from which on a method's contact force is not unique.

    Parameters
    ----------
    rig : Rig
    theta : float
        Degrees; its sign does not matter, for both directions of slip are looked at.
    method, numerical_damping, cutoff, termination, step, modify, beta2
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
    law = law_options(method, termination, modify, numerical_damping, beta2)
    rig, beta2 = published.with_numerical_damping(rig, method, law["numerical_damping"]), law["beta2"]
    step = None if step is None else checks.between("step", step, 1e-12, 1.0, "s")
    if method == "paper":
        return published.critical_friction(
            full_model(rig, theta), step or published.STEP, beta2 or published.BETA2
        )
    cutoff = None if cutoff is None else checks.between("cutoff", cutoff, 1.0, 1e12, "Hz")
    model = modified(reduced_model(rig, theta, cutoff, termination), modify)
    return model.critical_mu(None if method == "exact" else step or model.default_step)
