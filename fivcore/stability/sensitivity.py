"""How flutter onsets and eigenvalues of steady sliding follow the numbers of the rig: derivatives in closed form.

With D = K - lambda M of the separate beams, rows r_N, r_T that read the gap and r_c = r_N + mu r_T, steady sliding
is D x = N r_c, r_N^T x = 0, and has the left vector D y = -R r_N, r_c^T y = 0. Hence G_lambda dlambda + G_mu dmu +
G_p dp = 0 with G_p dp = y^T dD x - N y^T dr_c + R dr_N^T x (Rogers, AIAA J. 8, 1970, 943-944). Degrees of freedom
are the absolute displacements along and across a beam, and rotations times an element's length h: E I / h^3,
E A / h and rho A h then scale constant matrices, and y^T dD x is a sum of mixed energies. theta turns the rows at
P1's tip and its support, which adds the reaction there along x, known from the momentum, times the displacement.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fivcore import checks
from fivcore.beams.modes import contact_modes, rig_bases
from fivcore.jit import Array, Complex
from fivcore.rig import Beam, Rig
from fivcore.stability.onsets import flutter_onsets
from fivcore.stability.secular import EPS
from fivcore.stability.sliding import sliding_modes

# Derivatives grow as 1 / x and their rounding errors as EPS / x^2 where two solutions are about x apart.
DOUBLE = 1e-7
# Imaginary parts of lambda, as shares of it: one of which onsets, even in it, feel nothing, and one that is given
# to them in its place.
UNFELT, INFINITESIMAL = 1e-8, 1e-30


@dataclass(frozen=True, eq=False)
class OnsetSensitivity:
    """Flutter onsets, ascending in mu, and their first derivatives.

    Names are theta, contact_position, head_mass, d1, d2, and of each beam p1_length, p1_width, p1_thickness,
    p1_young_modulus, p1_density, p2_length, ... Each derivative keeps all the others, and the meshes' elements.

    Attributes
    ----------
    mu, frequency : ndarray, (n,)
        1; Hz; as in `FlutterOnsets`.
    mu_gradient, frequency_gradient : dict of str to ndarray, (n,)
        Derivatives in SI units, by theta for each degree.
    mu_elasticity, frequency_elasticity : dict of str to ndarray, (n,)
        Relative change for a relative change of each number p, (p / mu) d mu / d p; of theta in degrees.
    fold : ndarray of bool, (n,)
        Whether the onset meets a recovery, where derivatives do not exist and are NaN.
    """

    mu: Array
    frequency: Array
    mu_gradient: dict[str, Array]
    frequency_gradient: dict[str, Array]
    mu_elasticity: dict[str, Array]
    frequency_elasticity: dict[str, Array]
    fold: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class SlidingSensitivity:
    """Eigenvalues of steady sliding, in the order of `sliding_modes`, and their first derivatives.

    Attributes
    ----------
    eigenvalue : ndarray of complex, (n,)
        phi, growth rate + 2 pi i frequency, 1/s.
    gradient, elasticity : dict of str to ndarray of complex, (n,)
        d phi / d p in SI units, by theta for each degree, and (p / phi) d phi / d p; names as in
        `OnsetSensitivity`, and mu. NaN for a double eigenvalue, which has no derivatives.
    """

    eigenvalue: Complex
    gradient: dict[str, Complex]
    elasticity: dict[str, Complex]


def onset_sensitivity(rig: Rig, theta: float, fmax: float = 10e3, mu_max: float = 1.0) -> OnsetSensitivity:
    """First derivatives of all flutter onsets in a band.

    Parameters
    ----------
    rig : Rig
    theta, fmax, mu_max : float
        Degrees; band, Hz; largest friction of interest.

    Returns
    -------
    OnsetSensitivity
        Without damping, which moves an onset only by its square, derivatives by d1 and d2 are zero.

    Raises
    ------
    ValueError, ArithmeticError
        As `flutter_onsets`.
    """
    onsets = flutter_onsets(rig, theta, fmax, mu_max)
    angle, mu, omega = float(theta), onsets.mu, 2.0 * np.pi * onsets.frequency
    phi, divisor = 1j * omega, 1.0 + 1j * rig.d2 * omega
    value = -phi * (phi + rig.d1) / divisor
    light = -value.imag < UNFELT * omega**2
    # Without damping Im F = 0 becomes F_lambda = 0 in the limit, and what is imaginary a derivative by lambda: a
    # complex step, exact to rounding (Squire and Trapp, SIAM Review 40, 1998, 110-112).
    value = value.real - 1j * np.maximum(-value.imag, INFINITESIMAL * omega**2)
    pair = _vectors(rig, angle, mu, value, np.zeros(len(mu), dtype=bool))
    partial: dict[str, Complex] = _partial(rig, angle, mu, value, pair)
    turn = (2.0 * omega - 1j * (rig.d1 + rig.d2 * value)) / divisor
    damping = np.where(light, 0.0, -pair.slope * phi / divisor)
    partial |= {"d1": damping, "d2": damping * value}
    # Real d omega and d mu from along d omega + G_mu dmu = -G_p.
    along, across = pair.slope * turn, (turn.conj() * pair.friction)[:, None]
    determinant = (along.conj() * pair.friction).imag
    terms = pair.left * pair.right
    parts = np.abs(terms.real * across.imag) + np.abs(terms.imag * across.real)
    fold = np.abs(determinant) <= DOUBLE * parts.sum(axis=1)
    determinant[fold] = np.nan
    by_mu = {p: -(along.conj() * each).imag / determinant for p, each in partial.items()}
    by_omega = {p: (pair.friction.conj() * each).imag / determinant for p, each in partial.items()}
    by_frequency = {p: each / (2.0 * np.pi) for p, each in by_omega.items()}
    at = _numbers(rig, angle)
    of_mu, of_frequency = (
        {p: at[p] * each / value for p, each in gradient.items()}
        for gradient, value in ((by_mu, mu), (by_omega, omega))
    )
    return OnsetSensitivity(mu, onsets.frequency, by_mu, by_frequency, of_mu, of_frequency, fold)


def sliding_sensitivity(rig: Rig, theta: float, mu: float, fmax: float = 10e3) -> SlidingSensitivity:
    """First derivatives of all eigenvalues of steady sliding in a band.

    Parameters
    ----------
    rig : Rig
    theta, mu, fmax : float
        Degrees; coefficient of friction; band, Hz.

    Returns
    -------
    SlidingSensitivity

    Raises
    ------
    ValueError, ArithmeticError
        As `sliding_modes`.
    """
    checks.instance("rig", rig, Rig)
    angle, friction = checks.theta_degrees(theta), checks.friction(mu)
    modes = sliding_modes(rig, angle, friction, fmax)
    value, phi = modes.eigenvalue, modes.growth_rate + 2j * np.pi * modes.frequency
    frictions = np.full(len(value), friction)
    pair = _vectors(rig, angle, frictions, value, modes.uncoupled)
    double = np.abs(pair.slope) <= DOUBLE * np.abs(pair.left * pair.right).sum(axis=1)
    # phi^2 + (d1 + d2 lambda) phi + lambda = 0
    width = rig.d1 + rig.d2 * value
    divisor = 2.0 * phi + width
    double |= np.abs(divisor) <= DOUBLE * (2.0 * np.abs(phi) + np.abs(width))
    defined = np.where(double, np.nan, 1.0)
    pair.slope[double] = divisor[double] = 1.0
    through, damping = defined * (1.0 + rig.d2 * phi) / (pair.slope * divisor), -defined * phi / divisor
    partial = _partial(rig, angle, frictions, value, pair) | {"mu": pair.friction}
    gradient = {p: each * through for p, each in partial.items()} | {"d1": damping, "d2": damping * value}
    at = _numbers(rig, angle) | {"mu": friction}
    return SlidingSensitivity(phi, gradient, {p: at[p] * each / phi for p, each in gradient.items()})


class _Pair(NamedTuple):
    """Left and right vectors y and x in modal coordinates, (k, modes); R, N, G_lambda and G_mu, (k,)."""

    left: Complex
    right: Complex
    reaction: Array
    force: Array
    slope: Complex
    friction: Complex


def _numbers(rig: Rig, theta: float) -> dict[str, float]:
    """The numbers by which derivatives are taken, but mu."""
    names = "length", "width", "thickness", "young_modulus", "density"
    beams = {f"{p}_{name}": getattr(beam, name) for p, beam in (("p1", rig.p1), ("p2", rig.p2)) for name in names}
    own = {name: getattr(rig, name) for name in ("contact_position", "head_mass", "d1", "d2")}
    return {"theta": theta, **own, **beams}


def _vectors(rig: Rig, theta: float, mu: Array, value: Complex, uncoupled: NDArray[np.bool_]) -> _Pair:
    """Left and right vectors at each lambda, (k,), of any scale.

    x_i = N (n_i + mu t_i) / (p_i - lambda) cancels in a mode k whose pole is near. Its part follows from the
    closed gap instead, as does y_k, and with N = n_k, R = -(n_k + mu t_k) it may be a mode without contact.
    """
    stiffness, normal, tangential = contact_modes(rig, theta)
    push = normal + mu[:, None] * tangential
    distance = stiffness - value[:, None]
    distance[distance == 0.0] = 1e-3 * EPS * np.abs(value).max(initial=0.0)
    size = np.abs(distance)
    # The mode of which rounding of lambda changes the gap most, or the one that has this lambda without contact.
    weight = np.abs(normal) * (np.abs(normal) + mu[:, None] * np.abs(tangential)) / size**2
    k = np.where(uncoupled, size.argmin(axis=1), weight.argmax(axis=1))
    rows = np.arange(len(k))
    distance[rows, k] = np.inf
    shares = normal / distance
    rest = (shares * push).sum(axis=1)
    left, right = push[rows, k, None] * shares, normal[k, None] * (push / distance)
    left[rows, k] = right[rows, k] = -rest
    slope, friction = -(left * right).sum(axis=1), -normal[k] * (left * tangential).sum(axis=1)
    return _Pair(left, right, -push[rows, k], normal[k], slope, friction)


def _partial(rig: Rig, theta: float, mu: Array, value: Complex, pair: _Pair) -> dict[str, Complex]:
    """G_p at constant lambda, (k,), by name."""
    (upper, lower), p1, p2 = rig_bases(rig, theta), rig.p1, rig.p2
    split, sine, cosine = len(upper.stiffness), np.sin(np.radians(theta)), np.cos(np.radians(theta))
    y, x = pair.left, pair.right
    # Of each of P1's modes: support, momentum along x of the cubic elements, elongation of each element.
    across, up, turn = upper.shapes.transpose(1, 0, 2)
    ends = 0.5 * (across[0] + across[-1]) + p1.length / p1.elements / 12.0 * cosine * turn[-1]
    momentum = p1.mass / p1.elements * (across.sum(axis=0) - ends)
    elongation = np.diff(sine * across + cosine * up, axis=0)
    rows = np.vstack([up[0], momentum, upper.normal, upper.tangential, elongation])
    # Not matrix products: BLAS would round differently with the number of its threads.
    (y_support, y_momentum, y_up, y_across, *y_long), (x_support, x_momentum, _, x_across, *x_long) = (
        np.einsum("rm,km->rk", rows, each[:, :split]) for each in (y, x)
    )
    head = -value * y_support * x_support
    product = y[:, :split] * x[:, :split]
    axial = p1.axial_stiffness * p1.elements / p1.length * (np.array(y_long) * np.array(x_long)).sum(axis=0)
    bending = (product * upper.stiffness).sum(axis=1) - axial
    inertia = -value * product.sum(axis=1) - rig.head_mass * head
    # The support's reaction along x is -lambda times the momentum, less the force at the contact.
    support = value * (y_momentum * x_support + y_support * x_momentum) + mu * pair.force * y_support
    angle = support + pair.force * (y_across - mu * y_up) - pair.reaction * x_across
    derivatives = {"theta": np.pi / 180.0 * angle, "head_mass": head, **_beam("p1", p1, bending, axial, inertia)}
    # P2's slope at the contact, from the element that holds it.
    h, count = p2.length / p2.elements, 2 * p2.elements
    e = min(int(np.searchsorted(lower.nodes[:, 0], 0.0, "right")) - 1, p2.elements - 1)
    a = -lower.nodes[e, 0] / h
    b = 1.0 - a
    row = np.array([[-6.0 * a * b / h, b * (b - 2.0 * a)], [6.0 * a * b / h, a * (a - 2.0 * b)]])
    slope = (row[:, :, None] * lower.shapes[e : e + 2, 1:]).sum(axis=(0, 1))
    position = ((pair.force[:, None] * y[:, split:] - pair.reaction[:, None] * x[:, split:]) * slope).sum(axis=1)
    product = y[:, split:] * x[:, split:]
    strain = product * lower.stiffness
    bending, axial = strain[:, :count].sum(axis=1), strain[:, count:].sum(axis=1)
    derivatives |= {"contact_position": position, **_beam("p2", p2, bending, axial, -value * product.sum(axis=1))}
    # In a longer P2 the contact lies nearer to the clamp, as a share of the length.
    derivatives["p2_length"] -= rig.contact_position / p2.length * position
    return derivatives


def _beam(name: str, beam: Beam, bending: Complex, axial: Complex, inertia: Complex) -> dict[str, Complex]:
    """Derivatives of a beam's energy y^T D x, (k,), from its strain energies and -lambda times the kinetic one."""
    return {
        f"{name}_length": (inertia - 3.0 * bending - axial) / beam.length,
        f"{name}_width": (bending + axial + inertia) / beam.width,
        f"{name}_thickness": (3.0 * bending + axial + inertia) / beam.thickness,
        f"{name}_young_modulus": (bending + axial) / beam.young_modulus,
        f"{name}_density": inertia / beam.density,
    }
