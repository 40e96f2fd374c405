"""The two beams alone: Euler-Bernoulli's frequencies, and the modes as an exact change of coordinates."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from fivcore import Beam, Rig, sliding_modes
from fivcore.beams.elements import axial, bending, hermite
from fivcore.beams.modes import lower_basis, natural_modes, residual_flexibility, rig_bases, upper_basis
from fivcore.rig import P2
from tests.helpers import reference
from tests.helpers.rigs import workshop_rig


def bar(elements: int) -> Beam:
    return replace(P2, elements=elements)


def bending_frequencies(equation, first: int) -> np.ndarray:
    """Hz, from four roots beta L of an equation, one in each (k pi, (k + 1) pi) from k = `first` on."""
    roots = [
        brentq(equation, k * np.pi + 1e-9, (k + 1) * np.pi - 1e-9, xtol=1e-14) for k in range(first, first + 4)
    ]
    wave, line = np.array(roots) / P2.length, P2.mass / P2.length
    return wave**2 * np.sqrt(P2.bending_stiffness / line) / (2.0 * np.pi)


CANTILEVER = bending_frequencies(lambda x: np.cos(x) + 1.0 / np.cosh(x), 0)
PINNED = bending_frequencies(lambda x: np.cos(x) * np.tanh(x) - np.sin(x), 1)
AXIAL = (2 * np.arange(3) + 1) * np.sqrt(P2.young_modulus / P2.density) / (4.0 * P2.length)


def free(n: int) -> np.ndarray:
    """Of a free tip."""
    return np.sqrt(lower_basis(bar(n), 0.1).stiffness)[:4] / (2.0 * np.pi)


def pinned(n: int) -> np.ndarray:
    """An upright P1 that neither moves nor gives pins the end of P2; its own bending does not touch y."""
    stiff = Beam(0.05, 0.01, 0.0015, 185e17, 7900.0, 1)
    rig = Rig(stiff, bar(n), contact_position=0.15, head_mass=1e12, d1=0.0, d2=0.0)
    found = sliding_modes(rig, 0.0, 0.0, 1.2 * PINNED[-1]).frequency
    return found[found > 50.0][:4]


def axially(n: int) -> np.ndarray:
    basis = lower_basis(bar(n), 0.1)
    return np.sqrt(basis.stiffness)[basis.tangential != 0.0][:3] / (2.0 * np.pi)


@pytest.mark.parametrize(
    ("frequencies", "exact", "coarsest", "order", "apart"),
    [
        (free, CANTILEVER, 8, 4.0, 0.15),
        (pinned, PINNED, 8, 4.0, 0.15),
        (axially, AXIAL, 32, 2.0, 0.05),
    ],
)
def test_frequencies_converge_to_the_analytic_ones(frequencies, exact, coarsest, order, apart):
    errors = np.array([np.abs(frequencies(factor * coarsest) / exact - 1.0) for factor in (1, 2, 4)])
    assert np.all(errors[-1] < 1e-4 * (4.0 if order == 2.0 else 1.0))
    np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), order, atol=apart)


@pytest.mark.parametrize("family", [axial, bending])
def test_flexibility_root_is_the_inverse_of_the_stiffness(family):
    part = family(bar(7))
    identity = part.stiffness @ part.flexibility_root @ part.flexibility_root.T
    np.testing.assert_allclose(identity, np.eye(len(identity)), atol=1e-10)


@pytest.mark.parametrize("theta", [-30.0, 80.0])
def test_all_modes_together_are_the_finite_element_model(theta):
    """Mass and static flexibility seen from the contact are the same, modal or assembled."""
    rig = workshop_rig(3)
    upper, lower = rig_bases(rig, theta)
    k, m, normal, tangential = reference.assemble(rig, theta)
    rows = np.stack([normal, tangential])
    modal = np.stack(
        [np.concatenate([upper.normal, lower.normal]), np.concatenate([upper.tangential, lower.tangential])]
    )
    mobility = rows @ np.linalg.solve(m, rows.T)
    np.testing.assert_allclose(modal @ modal.T, mobility, rtol=1e-9, atol=1e-12 * np.abs(mobility).max())
    # The receptance at a frequency between the modes, where the rigid mode does no harm.
    square = (2.0 * np.pi * 123.4) ** 2
    stiffness = np.concatenate([upper.stiffness, lower.stiffness])
    receptance = rows @ np.linalg.solve(k - square * m, rows.T)
    np.testing.assert_allclose(
        (modal / (stiffness - square)) @ modal.T, receptance, rtol=1e-8, atol=1e-10 * np.abs(receptance).max()
    )


@pytest.mark.parametrize("elements", [1, 2, 90, 400])
def test_modes_are_orthonormal_and_ascending_on_any_mesh(elements):
    part = bending(bar(elements))
    values, vectors = natural_modes(part.stiffness, part.mass, part.flexibility_root)
    assert np.all(np.diff(values) > 0.0)
    np.testing.assert_allclose(vectors.T @ part.mass @ vectors, np.eye(len(values)), atol=1e-9)
    scale = np.sqrt(np.outer(values, values))
    np.testing.assert_allclose(vectors.T @ part.stiffness @ vectors / scale, np.eye(len(values)), atol=1e-6)


def test_static_tip_deflection_is_the_cantilevers():
    beam = bar(9)
    basis = lower_basis(beam, beam.length)
    flexibility = residual_flexibility(basis.stiffness, basis.normal, basis.tangential)
    expected = np.diag([beam.length**3 / (3.0 * beam.bending_stiffness), beam.length / beam.axial_stiffness])
    np.testing.assert_allclose(flexibility, expected, rtol=1e-12, atol=1e-12 * expected[1, 1])
    upper, _ = rig_bases(Rig(), 5.0)
    with pytest.raises(ValueError, match="rigid mode"):
        residual_flexibility(upper.stiffness, upper.normal, upper.tangential)


def test_upper_beam_translates_freely_along_y():
    basis = upper_basis(Rig().p1, 2.9434, 25.0)
    total = Rig().p1.mass + 2.9434
    assert basis.stiffness[0] == 0.0
    np.testing.assert_allclose(basis.shapes[:, 1, 0], total**-0.5, rtol=1e-15)
    np.testing.assert_array_equal(basis.shapes[:, [0, 2], 0], 0.0)
    # At A x and rotation are blocked in every mode.
    np.testing.assert_array_equal(basis.shapes[0, [0, 2]], 0.0)


@given(st.floats(0.001, 0.15))
@settings(max_examples=50, deadline=None)
def test_interpolation_reproduces_a_cubic(position):
    beam = bar(11)
    x = np.linspace(0.0, beam.length, 12)[1:] / beam.length
    axial_row, bending_row = hermite(beam, position)
    state = np.empty(22)
    state[0::2], state[1::2] = 3.0 * x**2 - x**3, (6.0 * x - 3.0 * x**2) / beam.length
    s = position / beam.length
    assert bending_row @ state == pytest.approx(3.0 * s**2 - s**3, rel=1e-9, abs=1e-14)
    assert axial_row @ x == pytest.approx(s, rel=1e-12)


def test_bases_are_shared_and_cannot_be_changed():
    first, second = rig_bases(Rig(), 5.0), rig_bases(Rig(), 5.0)
    assert first[0] is second[0]
    assert first[1] is second[1]
    with pytest.raises(ValueError, match="read-only"):
        first[0].normal[0] = 1.0
    # P2 does not know theta, mu or the head mass.
    assert rig_bases(Rig(head_mass=1.0), 7.0)[1] is first[1]
