"""Flutter onsets: the friction at which steady sliding loses its stability, by roots instead of scanning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from fivcore import checks
from fivcore.beams.modes import contact_modes
from fivcore.jit import Array
from fivcore.rig import Rig
from fivcore.stability import onset_kernels


@dataclass(frozen=True, eq=False)
class FlutterOnsets:
    """Where growth rates pass through zero as mu rises, ascending in mu.

    What grows without ever crossing the imaginary axis within the band is not listed: a divergence that comes
    in from beyond it, or a mode that enters the band while growing. No onset is therefore no proof of
    stability; `sliding_modes` at the mu in question is.

    Attributes
    ----------
    mu, frequency : ndarray, (n,)
        Friction and frequency (Hz) at which a growth rate rises through zero.
    recovery_mu, recovery_frequency : ndarray, (m,)
        Where one falls back through zero.
    rig, theta, fmax, mu_max
        What was asked: the answer holds for this band and this damping.
    """

    mu: Array
    frequency: Array
    recovery_mu: Array
    recovery_frequency: Array
    rig: Rig
    theta: float
    fmax: float
    mu_max: float


def flutter_onsets(rig: Rig, theta: float, fmax: float = 10e3, mu_max: float = 1.0) -> FlutterOnsets:
    """All flutter onsets and recoveries of steady sliding (V > 0) in a band.

    On the imaginary axis mu is an explicit function of the frequency; an onset is where it is real. All
    such frequencies are first isolated, by a search that cannot pass over a pair of them
    (`fivcore.stability.onset_kernels`), then refined to rounding.

    Parameters
    ----------
    rig : Rig
    theta : float
        Degrees.
    fmax : float
        Band, Hz.
    mu_max : float
        Largest friction of interest.

    Returns
    -------
    FlutterOnsets

    Raises
    ------
    ValueError
        For an argument out of range.
    ArithmeticError
        If the onsets cannot be isolated.

    Notes
    -----
    Without damping an onset is where two real eigenvalues meet, and a recovery where a pair parts again.
    Two onsets less than 1e-13 of the band apart cancel and are not reported.
    """
    checks.instance("rig", rig, Rig)
    angle = checks.theta_degrees(theta)
    band = checks.band(fmax)
    most = checks.between("mu_max", mu_max, 1e-12, 1e6, "a coefficient of friction")

    crossings = onset_crossings(rig, angle, band, most)
    up = np.array([each[:2] for each in crossings if each[2]]).reshape(-1, 2)
    down = np.array([each[:2] for each in crossings if not each[2]]).reshape(-1, 2)
    return FlutterOnsets(up[:, 0], up[:, 1], down[:, 0], down[:, 1], rig, angle, band, most)


def onset_crossings(rig: Rig, theta: float, fmax: float, mu_max: float) -> list[tuple[float, float, bool]]:
    """Friction, frequency (Hz) and whether it is an onset, not a recovery, ascending in friction."""
    stiffness, normal, tangential = contact_modes(rig, theta)
    unit = 2.0 * np.pi * fmax
    seen = normal != 0.0
    p, a = stiffness[seen] / unit**2, normal[seen] ** 2 / unit**2
    b = normal[seen] * tangential[seen] / unit**2
    d1, d2 = rig.d1 / unit, rig.d2 * unit
    if not np.any(b):
        return []
    brackets = np.empty((64, 3))
    count, judged = onset_kernels.isolate(p, a, b, d1, d2, mu_max, brackets)
    if count > len(brackets):
        brackets = np.empty((count, 3))
        count, judged = onset_kernels.isolate(p, a, b, d1, d2, mu_max, brackets)
    if judged == onset_kernels.MOST_INTERVALS:
        raise ArithmeticError(
            f"flutter_onsets: no friction up to mu_max = {mu_max:g} can be told apart at theta = {theta:g} "
            f"below fmax = {fmax:g} Hz; choose a smaller band"
        )
    crossings = []
    for low, high, pole in brackets[:count]:
        system = (int(pole), p, a, b, d1, d2)
        omega = brentq(onset_kernels.onset_function, low, high, args=system, xtol=1e-300, rtol=1e-14)
        mu = onset_kernels.onset_friction(omega, *system)
        if 0.0 < mu <= mu_max:
            # d Re(phi) / d mu has the sign of d Im(mu) / d omega, and Im(mu) that of W.
            crossings.append((mu, omega * fmax, onset_kernels.onset_function(high, *system) > 0.0))
    return sorted(crossings)
