"""Friction that depends on the sliding speed.

mu(v) = mu (kappa + (1 - kappa) g(|v| / v_d)) with g = exp(-x) or 1 / (1 + x): from the static coefficient mu,
which bounds |T| / N in stick, down to kappa mu at high speed. kappa = 1 is Coulomb's law with one coefficient;
v_d = 0 is a jump from the static to the kinetic coefficient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from fivcore import checks
from fivcore.jit import called, inlined

DECAYS = ("exponential", "rational")
# Units and meaning of its numbers.
FRICTION_PARAMETERS = {
    "kinetic_ratio": ("1", "kinetic over static coefficient of friction"),
    "decay_speed": ("m s-1", "sliding speed over which friction falls"),
}


@dataclass(frozen=True)
class Friction:
    """How the coefficient of friction depends on the sliding speed; a bad value is a `ValueError`, naming it.

    Parameters
    ----------
    kinetic_ratio : float
        kappa, the kinetic over the static coefficient, from 0 to 1; with 1 friction does not depend on the speed.
    decay_speed : float
        v_d, m/s: the speed over which friction falls; 0: a jump from the static to the kinetic coefficient.
    decay : {"exponential", "rational"}
        g = exp(-|v| / v_d), the decay of Abaqus and, with DC = 1 / v_d and FACT = 1 / kappa, of Ansys; or
        g = 1 / (1 + |v| / v_d) (Leine et al., Nonlinear Dynamics 16, 1998, 41-54).
    """

    kinetic_ratio: float = 1.0
    decay_speed: float = 0.01
    decay: str = "exponential"

    def __post_init__(self) -> None:
        kappa = checks.between("Friction: kinetic_ratio", self.kinetic_ratio, 0.0, 1.0, "1")
        allowed, given = "0 or a speed from 1e-100 to 1e+100 m/s", self.decay_speed
        speed = checks.number("Friction: decay_speed", given, allowed, lambda x: x == 0.0 or 1e-100 <= x <= 1e100)
        checks.choice("Friction: decay", self.decay, DECAYS)
        object.__setattr__(self, "kinetic_ratio", kappa)
        object.__setattr__(self, "decay_speed", speed)

    @property
    def constant(self) -> bool:
        """Whether the coefficient of a contact that slips is the same at every speed."""
        return self.kinetic_ratio == 1.0 or self.decay_speed == 0.0

    @property
    def law(self) -> tuple[float, float, float]:
        """Arguments of `friction_ratio`: kappa, v_d, and 1 where the decay is rational."""
        return self.kinetic_ratio, self.decay_speed, float(self.decay == DECAYS[1])

    def ratio(self, speed: float) -> float:
        """mu(v) / mu of a contact that slips at a speed, m/s."""
        return float(friction_ratio(abs(speed), *self.law)[0])

    def slope(self, speed: float) -> float:
        """Derivative of `ratio`, s/m: zero or negative."""
        return float(friction_ratio(abs(speed), *self.law)[1])

    def normalised(self, load: float) -> Friction:
        """The law for speeds in units of a load, N; `COULOMB` if kinetic_ratio is 1."""
        if self.kinetic_ratio == 1.0:
            return COULOMB
        return replace(self, decay_speed=float(f"{self.decay_speed / load:.11e}"))


COULOMB = Friction()


@inlined
def friction_ratio(speed: float, kappa: float, decay_speed: float, rational: float) -> tuple[float, float]:
    """mu(v) / mu at a speed >= 0 of a contact that slips, and its derivative."""
    if decay_speed == 0.0 or kappa == 1.0:
        return kappa, 0.0
    falling = 1.0 - kappa
    if rational != 0.0:
        g = 1.0 / (1.0 + speed / decay_speed)
        return kappa + falling * g, -falling * g * g / decay_speed
    g = math.exp(-speed / decay_speed)
    return kappa + falling * g, -falling * g / decay_speed


@called
def slip_speed(
    guess: float, ahead: float, S: float, alpha: float, beta: float, gamma: float, mu: float, law: Any
) -> tuple[float, float]:
    """Slip speed v, the largest root of v = ahead - S y(v), and mu(v) / mu.

    y = mu(v) N is the force of friction and N = alpha / (beta - gamma mu(v)) the normal force; `ahead` is the
    speed without friction, and `law` is `Friction.law`. Newton's method starts from the guess; if that fails, it
    starts again from `ahead`: no root is larger, and as y is convex, every step approaches the largest root.
    Without a root v is negative and the ratio is 1.
    """
    v, again = max(guess, 0.0), False
    for _ in range(100):
        ratio, slope = friction_ratio(v, law[0], law[1], law[2])
        inverse = 1.0 / (beta - gamma * (mu * ratio))
        normal = alpha * inverse
        rise = 1.0 + S * (mu * slope) * (normal * (beta * inverse))
        step = (v - ahead + S * (mu * ratio) * normal) / rise
        if not rise > 0.0 or (v - step < 0.0 and not again):
            if again or ahead <= 0.0:
                return -1.0, 1.0
            v, again = ahead, True
            continue
        v -= step
        if v < 0.0:
            return -1.0, 1.0
        # The convergence is quadratic, and the tangent gives the ratio at the new v.
        if abs(step) <= 1e-8 * min(v + law[1], law[1]):
            return v, ratio - slope * step
    return v, friction_ratio(v, law[0], law[1], law[2])[0]
