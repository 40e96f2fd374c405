"""Beams, rigs and scenes: values, and what is said of values that cannot be."""

import re
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from fivcore import Beam, Rig, Scene, simulate, sliding_modes
from fivcore.rig import html_table


def test_defaults_are_table_3():
    rig = Rig()
    assert (rig.p1.length, rig.p1.width, rig.p1.thickness, rig.p1.elements) == (0.05, 0.01, 0.0015, 30)
    assert (rig.p2.length, rig.p2.width, rig.p2.thickness, rig.p2.elements) == (0.15, 0.015, 0.003, 90)
    assert (rig.p1.young_modulus, rig.p1.density) == (185e9, 7900.0) == (rig.p2.young_modulus, rig.p2.density)
    assert (rig.contact_position, rig.head_mass, rig.d1, rig.d2, rig.point_b) == (0.08, 2.9434, 50.0, 1e-8, 0.5)


def test_scenes_are_frozen_and_hashable_and_plain_floats():
    scene = Scene(np.float32(0.5), 5, np.float64(0.25), 9)
    assert {scene: 1}[Scene(0.5, 5.0, 0.25, 9.0)] == 1
    assert all(type(value) is float for value in (scene.V, scene.theta, scene.mu, scene.F))
    with pytest.raises(FrozenInstanceError):
        scene.V = 1.0


def test_results_neither_share_nor_give_away_their_arrays():
    mu = np.array([0.1, 0.2])
    modes = sliding_modes(Rig(), 5.0, mu)
    mu[:] = 0.5
    np.testing.assert_array_equal(modes.mu, [0.1, 0.2])
    for part in (modes.frequency, modes.growth_rate, modes.eigenvalue, modes.theta, modes.mu):
        with pytest.raises(ValueError, match="read-only"):
            part[...] = 0.0


def test_a_rig_of_some_numbers_has_the_papers_for_the_rest():
    rig = Rig.of(p1_length=0.06, head_mass=2.0, p2={"thickness": 0.004})
    assert rig == Rig(replace(Rig().p1, length=0.06), replace(Rig().p2, thickness=0.004), head_mass=2.0)
    steel = Beam(0.04, 0.01, 0.002, 210e9, 7850.0, 10)
    assert Rig.of(p1_width=0.02, p1=steel).p1 == replace(steel, width=0.02)
    assert Rig.of() == Rig()


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        (
            {"p1_lenght": 1.0},
            "p1_lenght: a rig has no such number; did you mean p1_length? it has contact_position",
        ),
        ({"p3_length": 1.0}, "p3_length: a rig has no such number"),
        ({"p1_length": -1.0}, "p1_length = -1.0: it must be a number from 1e-09 to 1e+06 (m)"),
        ({"contact_position": 9.0}, "contact_position = 9.0: it must be above 0 and at most P2's length, 0.15 m"),
        ({"p1": 3}, "p1 = 3: it must be a Beam, or some of length, width"),
        ({"p2": {"size": 1.0}}, "p2 = {'size': 1.0}: it must be a Beam, or some of length, width"),
    ],
)
def test_a_number_that_there_is_not_or_that_cannot_be_is_named(numbers, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        Rig.of(**numbers)


def test_notebooks_show_tables_with_units_and_nothing_is_markup():
    scene = Scene(2e-3, 5.0, 0.2, 10.0)
    run = simulate(scene, 1e-3)
    for shown in (scene, scene.rig, run):
        text = shown._repr_html_()
        assert text.count("<table>") == text.count("</table>") >= 1
        assert "<td>p1_" not in text
        assert "kg m-3" in text
    assert "<td>energy_residual</td>" in run._repr_html_()
    assert "&lt;b&gt;" in html_table("<b>", ("",), ())
