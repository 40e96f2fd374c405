"""Derivatives of the flutter onsets by the parameters of the rig: central differences of fourth order.

The changed rigs are rows of one call of `flutter_onsets_many`. RELATIVE_STEP balances truncation against rounding:
on five rigs, including the paper's, normalised sensitivities agree with closed-form derivatives to a relative
5e-8; small ones to 5e-10 of the largest sensitivity of the same onset. With a node of a coarse P2 at the contact
the error is some 1e-6, since there the second derivative of the interpolated deflection jumps.

Of a structure the derivatives are in closed form, by the implicit function theorem: at an onset
h_NN + mu h_NT = 0 at phi = i omega, two real equations for mu and omega.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.jit import Array, ReadOnlyArrays
from fivcore.rig import ContactModel, Rig
from fivcore.stability.exponents import FAINT
from fivcore.stability.many import PARAMETERS, FlutterOnsets, flutter_onsets, flutter_onsets_many, rig_table
from fivcore.stability.several import sides
from fivcore.structure import Structure, modal_structure

# Relative step; smallest parameter value to which it applies, as a fraction of the value that affects the rig.
RELATIVE_STEP, LEAST_SIZE = 2e-5, 1e-3
# Places and weights of central differences, and of those to one side, of fourth and of second order.
CENTRAL = np.array([[-2.0, -1.0, 1.0, 2.0], [1 / 12, -2 / 3, 2 / 3, -1 / 12], [0.0, -0.5, 0.5, 0.0]])
ONE_SIDED = np.array([[1.0, 2.0, 3.0, 4.0], [4.0, -3.0, 4.0 / 3.0, -0.25], [2.0, -0.5, 0.0, 0.0]])
# Largest relative change of an onset frequency between rows; largest relative difference between the derivatives
# of both orders; rounding of the onset. Beyond these values the onset is too close to a fold for a derivative.
SAME, BENT, ROUNDING = 1e-2, 1e-2, 1e-12
# Damping in closed form where there is none, in units of the angular frequency of the band; its error is squared.
TINY = 1e-7


@dataclass(frozen=True, eq=False)
class OnsetSensitivity(ReadOnlyArrays):
    """Flutter onsets, ascending in mu, and their first derivatives.

    Names are theta, contact_position, head_mass, d1, d2, and of each beam p1_length, p1_width, p1_thickness,
    p1_young_modulus, p1_density, p2_length, ... Each derivative keeps all the others, and the meshes' elements.
    For a structure they are frequency_1, ... (Hz) and damping_1, ... (1/s; only with damping) of its modes, and
    direction, the angle, rad, by which the contact directions rotate: n to n cos - t sin, t to n sin + t cos.

    Attributes
    ----------
    mu, frequency : ndarray, (n,)
        1; Hz; as in `FlutterOnsets`.
    mu_gradient, frequency_gradient : dict of str to ndarray, (n,)
        Derivatives in SI units, by theta for each degree.
    mu_normalised, frequency_normalised : dict of str to ndarray, (n,)
        Normalised sensitivities: relative change for a relative change of each parameter p, (p / mu) d mu / d p;
        of theta in degrees; of a direction, for each radian.
    fold : ndarray of bool, (n,)
        Whether the onset is near a fold, where it meets a recovery and its derivatives are infinite, or where the
        set of closed contacts changes. Derivatives by parameters that reach the fold within some RELATIVE_STEP
        are NaN.
    """

    mu: Array
    frequency: Array
    mu_gradient: dict[str, Array]
    frequency_gradient: dict[str, Array]
    mu_normalised: dict[str, Array]
    frequency_normalised: dict[str, Array]
    fold: NDArray[np.bool_]


def onset_sensitivity(
    rig: ContactModel, theta: float, fmax: float = 10e3, mu_max: float = 1.0
) -> OnsetSensitivity:
    """First derivatives of all flutter onsets in a band.

    Parameters
    ----------
    rig : Rig or Structure
    theta, fmax, mu_max : float
        Degrees, 0 with a structure; band, Hz; largest friction of interest.

    Returns
    -------
    OnsetSensitivity

    Raises
    ------
    ValueError, ArithmeticError
        As `flutter_onsets`.
    """
    onsets = flutter_onsets(rig, theta, fmax, mu_max)
    if not isinstance(rig, Rig):
        return _of_structure(modal_structure(rig, theta), onsets, 2.0 * np.pi * fmax)
    values, omega = rig_table({"theta": theta}, rig)[0], 2.0 * np.pi * fmax
    least = np.zeros(len(PARAMETERS))
    least[[PARAMETERS.index(name) for name in ("head_mass", "d1", "d2")]] = rig.p1.mass, omega, 1.0 / omega
    # mu and theta have singular points where P1 is upright and where it lies.
    sizes = np.append(min(abs(theta), 90.0 - abs(theta)), np.abs(values[1:]))
    steps = RELATIVE_STEP * np.maximum(sizes, LEAST_SIZE * least)
    # Row 0 is the rig itself; the others change one parameter each, within its range.
    rows = np.tile(values, (1 + 4 * len(PARAMETERS), 1))
    stencils = np.array([_stencil(*each, rig) for each in zip(PARAMETERS, values, steps, strict=True)])
    for k, ((places, *_), step) in enumerate(zip(stencils, steps, strict=True)):
        rows[1 + 4 * k : 5 + 4 * k, k] += step * places
    # A little more than the limits, so that no onset is beyond them in a changed rig.
    wider = min(1.01 * fmax, 1e9), min(1.01 * mu_max, 1e6)
    changed = flutter_onsets_many(dict(zip(PARAMETERS, rows.T, strict=True)), *wider, rig)
    index = _matched(onsets.frequency, changed.frequency)
    none, gradients = np.any(index[1:].reshape(len(PARAMETERS), 4, -1) < 0, axis=1), []
    for table in (changed.mu, changed.frequency):
        found = np.take_along_axis(np.pad(table, ((0, 0), (0, 1)), constant_values=np.nan), index, axis=1)
        moved = (found[1:] - found[0]).reshape(len(PARAMETERS), 4, -1)
        slopes, coarse = np.einsum("poi,pin->opn", stencils[:, 1:], moved)
        none |= ~(np.abs(coarse - slopes) <= BENT * np.abs(slopes) + ROUNDING * found[0])
        gradients.append(slopes / steps[:, None])
    return _listed(onsets, PARAMETERS, values, gradients, none)


def _listed(
    onsets: FlutterOnsets, names: Sequence[str], values: Array, gradients: Sequence[Array], none: NDArray[np.bool_]
) -> OnsetSensitivity:
    """Derivatives of mu and frequency by name, each (parameters, n); `none` masks missing ones."""
    roots, tables = (onsets.mu, onsets.frequency), [np.where(none, np.nan, each) for each in gradients]
    tables += [values[:, None] * each / root for each, root in zip(tables, roots, strict=True)]
    by_mu, by_frequency, of_mu, of_frequency = (dict(zip(names, each, strict=True)) for each in tables)
    return OnsetSensitivity(*roots, by_mu, by_frequency, of_mu, of_frequency, np.asarray(none.any(axis=0)))


def _of_structure(own: Structure, onsets: FlutterOnsets, band: float) -> OnsetSensitivity:
    """`onset_sensitivity` of a structure, with 2 pi fmax."""
    m, p = len(own.frequency), own.stiffness
    # Static modes have the damping of Rayleigh's law, as in `exponents`.
    damping = np.append(own.damping[:m], own.d2 * p[m:])
    damped = damping.max() > FAINT * band
    damping = damping if damped else np.where(np.arange(len(p)) < m, TINY * band, 0.0)
    kinds = ("frequency", "damping") if damped else ("frequency",)
    names = [*(f"{kind}_{k}" for kind in kinds for k in range(1, m + 1)), "direction"]
    values = np.concatenate([own.frequency, own.damping[:m] if damped else [], [1.0]])

    def slopes(omega: float, mu: float) -> tuple[complex, complex, NDArray[np.complex128]]:
        """Derivatives of h_NN + mu h_NT by omega, by mu and by the parameters."""
        phi = 1j * omega
        soft = 1.0 / (p + phi * (damping + phi))
        gap, push, turned_gap, turned_push, by_friction = sides(own, soft, mu)
        terms = -push * gap * soft**2
        turned = np.sum((turned_gap * push + gap * turned_push) * soft)
        by_stiffness, by_damping = 8.0 * np.pi**2 * own.frequency * terms[:m], (phi * terms)[: m if damped else 0]
        by_each = np.concatenate([by_stiffness, by_damping, [turned]])
        return 1j * np.sum(terms * (damping + 2.0 * phi)), np.sum(gap * by_friction * soft), by_each

    by_mu, by_frequency = np.empty((2, len(names), len(onsets.mu)))
    none = np.zeros(by_mu.shape, dtype=bool)
    for k, (mu, frequency) in enumerate(zip(onsets.mu.tolist(), onsets.frequency.tolist(), strict=True)):
        omega = 2.0 * np.pi * frequency
        by_omega, by_friction, by_each = slopes(omega, mu)
        flatness = _determinant(by_omega, by_friction)
        by_mu[:, k] = -_determinant(by_omega, by_each) / flatness
        by_frequency[:, k] = -_determinant(by_each, by_friction) / flatness / (2.0 * np.pi)
        # Change, over two steps of a parameter, of this determinant, which is zero at a fold.
        ahead = slopes(omega * (1.0 + RELATIVE_STEP), mu)
        change = (_determinant(*ahead[:2]) / flatness - 1.0) / (RELATIVE_STEP * frequency)
        none[:, k] = ~(np.abs(2.0 * RELATIVE_STEP * values * by_frequency[:, k] * change) <= BENT)
    return _listed(onsets, names, values, (by_mu, by_frequency), none)


def _determinant(one: Any, other: Any) -> Any:
    """Determinant of two complex numbers as columns."""
    return (np.conj(one) * other).imag


def _stencil(name: str, value: float, step: float, rig: Rig) -> Array:
    """Places and weights, (2, 4), of a difference formula that stays in the range of a parameter."""
    low = rig.contact_position if name == "p2_length" else -np.inf if name == "theta" else 0.0
    high = rig.p2.length if name == "contact_position" else np.inf
    if value - 2.0 * step <= low:
        return ONE_SIDED
    return -ONE_SIDED if value + 2.0 * step >= high else CENTRAL


def _matched(frequency: Array, rows: Array) -> NDArray[np.int64]:
    """Place of each onset, (n,), in each row, (k, m), or -1: mutually nearest in frequency and within SAME."""
    away = np.abs(rows[:, None, :] / frequency[:, None] - 1.0)
    away[np.isnan(away)] = np.inf
    limits = away.min(axis=1, keepdims=True, initial=SAME), away.min(axis=2, keepdims=True, initial=SAME)
    same = (away == limits[0]) & (away == limits[1])
    return np.where(same.any(axis=2), same.argmax(axis=2) if rows.shape[1] else 0, -1)
