"""Beams, rigs and scenes: values, and what is said of values that cannot be."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from fivcore import (
    Beam,
    Rig,
    Scene,
    flutter_onsets,
    glued_frequencies,
    node_positions,
    sliding_modes,
    tune_head_mass,
)

STEEL = {"length": 0.15, "width": 0.015, "thickness": 0.003, "young_modulus": 185e9, "density": 7900.0}
USUAL = {Beam: STEEL | {"elements": 90}, Rig: {}, Scene: {"V": 1e-3, "theta": 5.0, "mu": 0.2, "F": 9.0}}


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


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        (Beam, {"length": -0.05}, r"Beam: length = -0.05: it must be a number from 1e-09 to 1e\+06 \(m\)"),
        (Beam, {"width": float("nan")}, "Beam: width = nan"),
        (Beam, {"thickness": 0.0}, "Beam: thickness = 0.0"),
        (Beam, {"young_modulus": float("inf")}, "Beam: young_modulus = inf"),
        (Beam, {"density": "steel"}, "Beam: density = 'steel'"),
        (Beam, {"elements": 0}, "Beam: elements = 0: it must be a whole number from 1 to 1000"),
        (Beam, {"elements": 2.5}, "Beam: elements = 2.5"),
        (Beam, {"elements": True}, "Beam: elements = True"),
        (
            Rig,
            {"contact_position": 0.2},
            "contact_position = 0.2: it must be above 0 and at most P2's length, ",
        ),
        (Rig, {"contact_position": 0.0}, "Rig: contact_position = 0.0"),
        (Rig, {"head_mass": -1.0}, r"Rig: head_mass = -1.0: it must be a number from 0 to 1e\+15 \(kg\)"),
        (Rig, {"d1": float("nan")}, "Rig: d1 = nan"),
        (Rig, {"d2": -1e-8}, "Rig: d2 = -1e-08"),
        (Rig, {"point_b": 1.5}, "Rig: point_b = 1.5: it must be a fraction"),
        (Rig, {"p1": 3}, "Rig: p1 = 3: it must be a Beam"),
        (Scene, {"V": 0.0}, r"V = 0.0: it must be a speed of 1e-100 to 1e\+100 m/s, of either sign"),
        (Scene, {"theta": 90.0}, "theta = 90.0: it must be a single angle between -90 and 90 degrees"),
        (Scene, {"theta": -120.0}, "theta = -120.0"),
        (Scene, {"mu": -0.1}, r"mu = -0.1: it must be a number from 0 to 1e\+06 \(a coefficient of friction\)"),
        (Scene, {"F": 0.0}, "F = 0.0: it must be a number from 1e-100"),
        (Scene, {"V": float("nan")}, "V = nan"),
        (Scene, {"V": None}, "V = None"),
        (Scene, {"rig": "rig"}, "Scene: rig = 'rig': it must be a Rig"),
    ],
)
def test_an_impossible_beam_rig_or_scene_is_refused(kind, change, message):
    with pytest.raises(ValueError, match=message):
        kind(**(USUAL[kind] | change))


@pytest.mark.parametrize(
    ("theta", "mu", "message"),
    [
        ([5.0, 95.0], 0.2, "theta = 95.0"),
        (5.0, [0.1, -0.2], "mu = -0.2"),
        (5.0, [0.1, float("nan")], "mu = nan"),
        ("five", 0.2, "theta = 'five': it must be a single angle"),
        (5.0, ["0.2"], r"mu = \['0.2'\]: it must be a number or an array of numbers"),
        (5.0, [True], r"mu = \[True\]"),
        (5.0, np.array([0.2 + 1j]), "mu = array"),
        (5.0, np.ma.masked_array([0.1, 0.2], [False, True]), "mu = masked_array"),
        (5.0, [0.1, [0.2]], r"mu = \[0.1, \[0.2\]\]"),
        (5.0, 10**400, "mu = 1000"),
        (5.0, None, "mu = None"),
    ],
)
def test_bad_values_in_arrays_are_named(theta, mu, message):
    with pytest.raises(ValueError, match=message):
        sliding_modes(Rig(), theta, mu)


@pytest.mark.parametrize(
    "function", [sliding_modes, flutter_onsets, glued_frequencies, tune_head_mass, node_positions]
)
def test_something_that_is_no_rig_is_named(function):
    for wrong in (3, None, [], "rig"):
        with pytest.raises(ValueError, match=r"rig = .*: it must be a Rig"):
            function(wrong, *([5.0, 0.2][: 2 if function is sliding_modes else 1]))


def test_results_neither_share_nor_give_away_their_arrays():
    mu = np.array([0.1, 0.2])
    modes = sliding_modes(Rig(), 5.0, mu)
    mu[:] = 0.5
    np.testing.assert_array_equal(modes.mu, [0.1, 0.2])
    for part in (modes.frequency, modes.growth_rate, modes.eigenvalue, modes.theta, modes.mu):
        with pytest.raises(ValueError, match="read-only"):
            part[...] = 0.0
