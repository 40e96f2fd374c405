"""Beams, rigs and scenes are values."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from fivcore import Beam, Rig, Scene


def test_defaults_are_table_3():
    assert Rig().p1 == Beam(0.05, 0.01, 0.0015, 185e9, 7900.0, 30)
    assert Rig().p2 == Beam(0.15, 0.015, 0.003, 185e9, 7900.0, 90)
    rig = Rig()
    assert (rig.contact_position, rig.head_mass, rig.d1, rig.d2, rig.point_b) == (0.08, 2.9434, 50.0, 1e-8, 0.5)


def test_scenes_are_frozen_and_hashable_and_plain_floats():
    scene = Scene(np.float32(0.5), 5, np.float64(0.25), 9)
    assert {scene: 1}[Scene(0.5, 5.0, 0.25, 9.0)] == 1
    assert all(type(value) is float for value in (scene.V, scene.theta, scene.mu, scene.F))
    with pytest.raises(FrozenInstanceError):
        scene.V = 1.0


def test_a_rig_of_some_numbers_has_the_papers_for_the_rest():
    rig = Rig.of(p1_length=0.06, head_mass=2.0, p2={"thickness": 0.004})
    assert rig == Rig(replace(Rig().p1, length=0.06), replace(Rig().p2, thickness=0.004), head_mass=2.0)
    steel = Beam(0.04, 0.01, 0.002, 210e9, 7850.0, 10)
    assert Rig.of(p1_width=0.02, p1=steel).p1 == replace(steel, width=0.02)
    assert Rig.of() == Rig()
    assert "<td>7900</td>" in rig._repr_html_()
