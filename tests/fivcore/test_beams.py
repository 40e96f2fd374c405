"""Bases of the two beams alone: an exact change of coordinates of the finite elements."""

import numpy as np
import pytest

from fivcore import Rig
from fivcore.beams.elements import bending
from fivcore.beams.modes import lower_basis, natural_modes, residual_flexibility, rig_bases, upper_basis
from tests.helpers import reference
from tests.helpers.rigs import workshop_rig
from tests.known import bar


@pytest.mark.parametrize("theta", [-30.0, 80.0])
def test_all_modes_together_are_the_finite_element_model(theta):
    """Mass and static flexibility seen from the contact are the same, modal or assembled."""
    rig = workshop_rig(3)
    upper, lower = rig_bases(rig, theta)
    k, m, *rows = reference.assemble(rig, theta)
    rows = np.stack(rows)
    modal = np.stack([np.append(upper.normal, lower.normal), np.append(upper.tangential, lower.tangential)])
    stiffness = np.append(upper.stiffness, lower.stiffness)
    mobility = rows @ np.linalg.solve(m, rows.T)
    np.testing.assert_allclose(modal @ modal.T, mobility, rtol=1e-9, atol=1e-12 * np.abs(mobility).max())
    # The receptance at a frequency between the modes, where the rigid mode does no harm.
    square = (2.0 * np.pi * 123.4) ** 2
    expected = rows @ np.linalg.solve(k - square * m, rows.T)
    found = (modal / (stiffness - square)) @ modal.T
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("elements", [1, 2, 90, 400])
def test_modes_are_orthonormal_and_ascending_on_any_mesh(elements):
    part = bending(bar(elements))
    values, vectors = natural_modes(part.stiffness, part.mass, part.flexibility_root)
    assert np.all(np.diff(values) > 0.0)
    np.testing.assert_allclose(vectors.T @ part.mass @ vectors, np.eye(len(values)), atol=1e-9)
    scale = np.sqrt(np.outer(values, values))
    np.testing.assert_allclose(vectors.T @ part.stiffness @ vectors / scale, np.eye(len(values)), atol=1e-6)


def test_the_static_tip_deflection_is_the_cantilevers():
    beam = bar(9)
    basis = lower_basis(beam, beam.length)
    flexibility = residual_flexibility(basis.stiffness, np.stack([basis.normal, basis.tangential]))
    expected = np.diag([beam.length**3 / (3.0 * beam.bending_stiffness), beam.length / beam.axial_stiffness])
    np.testing.assert_allclose(flexibility, expected, rtol=1e-12, atol=1e-12 * expected[1, 1])
    upper, _ = rig_bases(Rig(), 5.0)
    with pytest.raises(ValueError, match="rigid mode"):
        residual_flexibility(upper.stiffness, np.stack([upper.normal, upper.tangential]))


def test_the_upper_beam_translates_freely_along_y_and_is_held_in_x_and_rotation_at_A():
    basis = upper_basis(Rig().p1, 2.9434, 25.0)
    assert basis.stiffness[0] == 0.0
    np.testing.assert_allclose(basis.shapes[:, 1, 0], (Rig().p1.mass + 2.9434) ** -0.5, rtol=1e-15)
    np.testing.assert_array_equal(basis.shapes[:, [0, 2], 0], 0.0)
    np.testing.assert_array_equal(basis.shapes[0, [0, 2]], 0.0)


def test_bases_are_shared_and_cannot_be_changed():
    first, second = rig_bases(Rig(), 5.0), rig_bases(Rig(), 5.0)
    assert (first[0] is second[0], first[1] is second[1]) == (True, True)
    with pytest.raises(ValueError, match="read-only"):
        first[0].normal[0] = 1.0
    # P2 does not know theta, mu or the head mass.
    assert rig_bases(Rig(head_mass=1.0), 7.0)[1] is first[1]
