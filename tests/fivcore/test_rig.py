"""Beams, rigs and scenes: values, and what is said of values that cannot be."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from fivcore import (
    Rig,
    Scene,
    sliding_modes,
)


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
