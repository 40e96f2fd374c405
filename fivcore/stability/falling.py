"""Steady sliding where friction falls with the speed, and its onsets along mu, V or F.

With m = mu(V) and k = -N0 mu'(V), N0 the normal force of steady sliding, T' = m N' + k d(g_T')/dt: a drop of
friction with speed acts as a negative damper. Exponents are those of `exponents`, onsets those of `sampled`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import checks
from fivcore.errors import InputError
from fivcore.friction import Friction
from fivcore.jit import Array, ReadOnlyArrays
from fivcore.rig import Rig, Scene
from fivcore.stability.exponents import band_modes
from fivcore.stability.sampled import FrictionPath, coulomb_crossings, sampled_crossings
from fivcore.stability.several import onsets_along
from fivcore.structure import Structure, modal_structure

# Of speed, m/s, and load, N.
LIMITS = 1e-100, 1e100


def wedging(own: Structure) -> float:
    """h_NT / h_NN at rest: in steady sliding with friction m, N0 = F preload / (1 + wedging m)."""
    rigid = own.stiffness == 0.0
    weight = own.normal * rigid if rigid.any() else own.normal / own.stiffness
    return float((weight @ own.tangential) / (weight @ own.normal))


def sliding_point(own: Structure, friction: Friction, mu: float, V: float, F: float) -> tuple[float, float]:
    """Friction m = mu(V) and its negative slope k, N s/m; an `InputError` if the contact jams."""
    m, held = mu * friction.ratio(V), 1.0 + wedging(own) * mu * friction.ratio(V)
    if not held > 0.0 and not friction.constant:
        raise InputError(
            f"mu = {mu:g}: at V = {V:g} m/s it must be below {mu / (1.0 - held):.6g}, where the contact jams"
            " and steady sliding ceases to exist"
        )
    return m, 0.0 if friction.constant else -F * own.preload / held * mu * friction.slope(V)


def falling_crossings(
    own: Structure, fmax: float, friction: Friction, values: dict[str, float], name: str, low: float, high: float
) -> Array:
    """`sampled_crossings` along one of mu, V and F, the others from `values`, between `low` and `high`."""
    modes, f, (kappa, v_d, rational) = band_modes(own, fmax, True), wedging(own), friction.law
    mu, V, F = (values[each] for each in ("mu", "V", "F"))
    if name == "mu":
        # Without damping, rounding lets every motion grow at any mu above 0.
        r, s, low = friction.ratio(V), -friction.slope(V), max(low, 1e-11 * high)
        high = min(high, (1.0 - 1e-6) / (-f * r)) if f * r < 0.0 else high
        m0, m1, fall, power = 0.0, r, F * s, 1.0
    elif name == "V":
        # In terms of g, the share of mu (1 - kappa) that is left.
        m0, m1, fall, power = mu * kappa, mu * (1.0 - kappa), F * mu * (1.0 - kappa) / v_d, 1.0 + rational
    else:
        m0, m1, fall, power = mu * friction.ratio(V), 0.0, -mu * friction.slope(V), 1.0

    def at(value: float) -> tuple[float, float]:
        one = values | {name: value}
        return sliding_point(own, friction, one["mu"], one["V"], one["F"])

    def value_of(x: float) -> float:
        if name != "V":
            return x
        x = np.sqrt(x) if squared and x > 0.0 else x
        return np.nan if not 0.0 < x < 1.0 else v_d * (1.0 / x - 1.0 if rational else -np.log(x))

    at(low)
    if fall == 0.0 and m1 == 0.0:
        return np.empty((0, 3))
    squared = power == 2.0 and not modes.residues[1].any()
    if squared:
        m1, power = 0.0, 1.0
    path = FrictionPath(m0, m1, f, fall * own.preload * modes.omega, power)
    return sampled_crossings(modes, path, low, high, name, value_of, at)


@dataclass(frozen=True, eq=False)
class SlidingOnsets(ReadOnlyArrays):
    """Where growth rates pass through zero along one parameter of a scene; arrays are read-only.

    Attributes
    ----------
    parameter : {"mu", "V", "F"}
    value, frequency : ndarray, (n,)
        Values of the parameter, ascending, and frequency, Hz.
    change : ndarray of int, (n,)
        1 where a growth rate rises through zero as the parameter rises (onset), -1 where it falls (recovery).
    """

    parameter: str
    value: Array
    frequency: Array
    change: NDArray[np.int_]


def sliding_onsets(scene: Scene, parameter: str, low: float, high: float, fmax: float = 10e3) -> SlidingOnsets:
    """Onsets and recoveries of steady sliding along the static friction, the speed or the load.

    Onsets are those within the band, as for `flutter_onsets`: motions that grow without oscillation, or that enter
    the band while growing, have none. If friction falls with the speed, the search along mu ends at the friction
    at which the contact of a structure jams, if that is below `high`.

    Parameters
    ----------
    scene : Scene
        The scene; its own value of the parameter is ignored, except for the sign of V.
    parameter : {"mu", "V", "F"}
    low, high : float
        Limits of the parameter, 0 <= low < high; speed and load are above 0.
    fmax : float
        Band, Hz.

    Returns
    -------
    SlidingOnsets

    Raises
    ------
    ValueError, ArithmeticError
        For an argument out of range; if the onsets cannot be isolated.
    """
    checks.instance("scene", scene, Scene)
    checks.choice("parameter", parameter, ("mu", "V", "F"))
    limits = {"mu": (0.0, 1e6, "1"), "V": (*LIMITS, "m/s"), "F": (*LIMITS, "N")}[parameter]
    start, most, band = checks.between("low", low, *limits), limits[1], checks.band(fmax)
    end = checks.number("high", high, f"above low = {start:g}, up to {most:g}", lambda x: start < x <= most)
    own = modal_structure(scene.rig, scene.drive_theta)
    if scene.V < 0.0 and not isinstance(scene.rig, Rig):
        own = own.mirrored()
    values = {"mu": scene.mu, "V": abs(scene.V), "F": scene.F}
    if own.several:
        found = onsets_along(own, band, scene.friction, values, parameter, start, end)
    elif not scene.friction.constant:
        found = falling_crossings(own, band, scene.friction, values, parameter, start, end)
    else:
        ratio = scene.friction.kinetic_ratio if parameter == "mu" else 0.0
        found = coulomb_crossings(own, band, ratio, end)
        found = found[found[:, 0] > start]
    value, where, change = found.T
    axis = where <= 1.0
    return SlidingOnsets(parameter, value[axis], band * where[axis], np.sign(change[axis]).astype(int))


def checked_sliding(friction: Friction, V: Any, F: Any) -> tuple[Array | None, Array | None]:
    """Check speed and load, which are required if friction falls with the speed."""
    checks.instance("friction", friction, Friction)
    if not friction.constant and (V is None or F is None):
        missing = "V" if V is None else "F"
        raise InputError(f"{missing} is missing: where friction falls with the speed give V (m/s) and F (N)")
    speed = None if V is None else checks.array("V", V, lambda x: checks.between("V", x, *LIMITS, "m/s"))
    load = None if F is None else checks.array("F", F, lambda x: checks.between("F", x, *LIMITS, "N"))
    return speed, load
