"""Complex eigenvalues of steady sliding: frequencies, growth rates and shapes (section 3.4 of the paper).

V > 0 is assumed: the sign of V matters only in combination with that of theta (`Scene.drive_theta`), and its
magnitude and the load F only if friction falls with the speed (`fivcore.stability.falling`). With proportional
damping each undamped eigenvalue lambda (`fivcore.stability.exponents`) gives a pair phi with phi^2 + (d1 + d2
lambda) phi + lambda = 0. Static modes are damped in the same way, so their compliance is divided by 1 + d2 phi;
with modal damping they are undamped.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import checks
from fivcore.beams.modes import rig_bases
from fivcore.errors import InputError
from fivcore.friction import COULOMB, Friction
from fivcore.jit import Array, Complex, ReadOnlyArrays
from fivcore.rig import ContactModel, Rig, checked_theta
from fivcore.stability.exponents import band_modes, exponents, pair, sliding_shape
from fivcore.stability.falling import checked_sliding, sliding_point
from fivcore.stability.several import exponents_at, shape_of_several
from fivcore.structure import Structure, modal_structure


@dataclass(frozen=True, eq=False)
class SlidingModes(ReadOnlyArrays):
    """Modes of steady sliding within a band, ascending in frequency; missing ones are NaN.

    Attributes
    ----------
    frequency, growth_rate : ndarray, (..., modes)
        Im(phi) / 2 pi, Hz, zero for a mode that does not oscillate; Re(phi), 1/s, above zero for a mode that grows
        (the paper's eta with its sign turned). The leading dimensions are those of theta and mu broadcast.
    eigenvalue : ndarray, (..., modes)
        The undamped eigenvalue lambda, rad2/s2; where there is none, with modal damping or friction that falls
        with the speed, -phi^2.
    uncoupled : ndarray of bool, (..., modes)
        Whether the mode has a node at the contact, so that friction does not change it.
    theta, mu : ndarray, (...)
        Degrees and 1; mu is the static coefficient.
    fmax : float
        The band, Hz: modes above it are not listed, nor those with |phi| above twice its angular frequency. Above
        20 kHz the undamped beams have growing pairs that depend on mesh and basis.
    rig : Rig or Structure
    friction : Friction
    V, F : ndarray, (...), or None
        Speed, m/s, and load, N, as they were given.
    """

    frequency: Array
    growth_rate: Array
    eigenvalue: Complex
    uncoupled: NDArray[np.bool_]
    theta: Array
    mu: Array
    fmax: float
    rig: ContactModel
    friction: Friction = COULOMB
    V: Array | None = None
    F: Array | None = None

    @property
    def unstable(self) -> NDArray[np.bool_]:
        """(..., modes): whether the mode grows."""
        return np.asarray(self.growth_rate > 0.0)

    @property
    def shape(self) -> Complex:
        """(..., modes, nodes, 3): displacement along x, along y, and rotation; the largest translation is 1.

        P1's nodes from A to C come first, then P2's from the clamp to the free end (`node_positions`). For a
        structure: modal coordinates, (..., modes, n), scaled so that the largest is 1.
        """
        rig, modes = self.rig, len(modal_structure(self.rig, 0.0).frequency)
        size = (rig.p1.elements + rig.p2.elements + 2, 3) if isinstance(rig, Rig) else (modes,)
        shapes = np.full((*self.frequency.shape, *size), complex(np.nan, np.nan))
        for index in zip(*np.nonzero(np.isfinite(self.frequency)), strict=True):
            theta = float(self.theta[index[:-1]])
            phi = complex(self.growth_rate[index], 2.0 * np.pi * self.frequency[index])
            falling, alone = not self.friction.constant, bool(self.uncoupled[index])
            if rig.several:
                V, F = (None if each is None else float(each[index[:-1]]) for each in (self.V, self.F))
                q = shape_of_several(rig, self.fmax, phi, self.friction, float(self.mu[index[:-1]]), V, F)
            else:
                q = sliding_shape(modal_structure(rig, theta), phi, alone, falling)
            shape = parts = q[:modes]
            if isinstance(rig, Rig):
                upper, lower = rig_bases(rig, theta)
                split = len(upper.stiffness)
                shape = np.concatenate([upper.shapes @ q[:split], lower.shapes @ q[split:]])
                parts = shape[:, :2].ravel()
            shapes[index] = shape / parts[np.argmax(np.abs(parts))]
        return shapes


def sliding_modes(
    rig: ContactModel,
    theta: Any,
    mu: Any,
    fmax: float = 10e3,
    *,
    friction: Friction = COULOMB,
    V: Any = None,
    F: Any = None,
) -> SlidingModes:
    """Complex modes of the steady sliding state for V > 0 (equations (10) to (12) of the paper).

    Eigenvalues are those of the finite-element model with all its modes, without truncation. Of the two real
    eigenvalues that belong to one undamped eigenvalue only the larger is listed; with modal damping or friction
    that falls with the speed all real eigenvalues are listed.

    Parameters
    ----------
    rig : Rig or Structure
        With a structure theta is 0.
    theta, mu : float or array_like
        Degrees; coefficient of friction, the static one, broadcast against each other.
    fmax : float
        Band, Hz.
    friction : Friction
        How friction depends on the speed; with a jump at rest, decay_speed = 0, the kinetic coefficient acts.
    V, F : float or array_like, optional
        Speed above 0, m/s, and load, N, broadcast likewise; needed where friction falls with the speed.

    Returns
    -------
    SlidingModes

    Raises
    ------
    ValueError
        For an argument out of range.
    """
    checked_theta("rig", rig, 0.0)
    band = checks.band(fmax)
    angles = checks.array("theta", theta, lambda each: checked_theta("rig", rig, each))
    frictions = checks.array("mu", mu, checks.friction)
    V, F = checked_sliding(friction, V, F)
    names, shape = "theta", angles.shape
    for name, each in (("mu", frictions), ("V", V), ("F", F)):
        try:
            shape = np.broadcast_shapes(shape, () if each is None else each.shape)
        except ValueError:
            raise InputError(
                f"{name} of shape {np.shape(each)}: it must broadcast with {names}, {shape}"
            ) from None
        names += f", {name}"
    angles, frictions = (np.broadcast_to(each, shape).copy() for each in (angles, frictions))
    V, F = (None if each is None else np.broadcast_to(each, shape).copy() for each in (V, F))
    if rig.several:
        return _of_several(modal_structure(rig, 0.0), band, angles, frictions, friction, V, F)
    m, k = frictions.ravel() * friction.kinetic_ratio, np.zeros(frictions.size)
    groups = {angle: np.flatnonzero(angles.ravel() == angle) for angle in np.unique(angles).tolist()}
    solved = []
    for angle, points in groups.items():
        own = modal_structure(rig, angle)
        if not friction.constant:
            given = [each.ravel()[points].tolist() for each in (frictions, V, F)]
            m[points], k[points] = np.transpose(
                [sliding_point(own, friction, *each) for each in zip(*given, strict=True)]
            )
        modes = band_modes(own, band, not friction.constant)
        solved.append((points, modes, exponents(modes, m[points], k[points])))
    values = np.full((frictions.size, max((roots.shape[1] for *_, roots in solved), default=0)), np.nan * 1j)
    uncoupled, omega = np.zeros(values.shape, dtype=bool), 2.0 * np.pi * band
    for points, modes, roots in solved:
        values[points, : roots.shape[1]] = roots
        uncoupled[points, roots.shape[1] - len(modes.uncoupled) : roots.shape[1]] = True
    phi, values = omega * values, omega**2 * values
    if any(modes.rayleigh for _, modes, _ in solved):
        listed = ~np.isnan(values)
        phi[listed] = pair(values[listed], rig.d1 + rig.d2 * values[listed])[0]
    else:
        values = -(phi**2)
    phi[(phi.imag > omega) | (np.abs(phi) > 2.0 * omega)] = complex(np.nan, np.nan)
    missing = np.isnan(phi)
    values[missing], uncoupled[missing] = complex(np.nan, np.nan), False
    order = np.lexsort((phi.real, phi.imag), axis=-1)[:, : np.count_nonzero(~missing, axis=1).max(initial=0)]
    phi, values, uncoupled = (
        np.take_along_axis(each, order, axis=1).reshape(*angles.shape, order.shape[1])
        for each in (phi, values, uncoupled)
    )
    return SlidingModes(
        phi.imag / (2.0 * np.pi), phi.real.copy(), values, uncoupled, angles, frictions, band, rig, friction, V, F
    )


def _of_several(
    own: Structure, band: float, theta: Array, mu: Array, friction: Friction, V: Array | None, F: Array | None
) -> SlidingModes:
    """`sliding_modes` of a structure with several contacts."""
    at = exponents_at(own, band, friction)
    each = [[None] * mu.size if values is None else values.ravel().tolist() for values in (V, F)]
    found = [at(*point) for point in zip(mu.ravel().tolist(), *each, strict=True)]
    phi = np.full((mu.size, max(map(len, found), default=0)), complex(np.nan, np.nan))
    for row, values in zip(phi, found, strict=True):
        row[: len(values)] = 2.0 * np.pi * band * values
    phi = phi.reshape(*mu.shape, phi.shape[1])
    rates = phi.imag / (2.0 * np.pi), phi.real.copy()
    return SlidingModes(
        *rates, -(phi**2), np.zeros(phi.shape, dtype=bool), theta, mu, band, own, friction, V, F
    )  # fmt: skip


def node_positions(rig: Rig, theta: float) -> Array:
    """Undeformed x, y from the contact point, (nodes, 2), m, as `SlidingModes.shape`; `ValueError` as there."""
    checks.instance("rig", rig, Rig)
    upper, lower = rig_bases(rig, checks.theta_degrees(theta))
    return np.concatenate([upper.nodes, lower.nodes])


def node_shapes(rig: Rig, theta: float) -> Array:
    """Displacement along x and y of the nodes in each mode of `Structure.of`, (nodes, 2, n), kg^-1/2."""
    checks.instance("rig", rig, Rig)
    upper, lower = rig_bases(rig, checks.theta_degrees(theta))
    n1, n2 = len(upper.stiffness), len(lower.stiffness)
    shapes = [np.pad(upper.shapes[:, :2], ((0, 0), (0, 0), (0, n2)))]
    return np.concatenate([*shapes, np.pad(lower.shapes[:, :2], ((0, 0), (0, 0), (n1, 0)))])
