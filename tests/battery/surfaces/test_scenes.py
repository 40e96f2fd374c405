"""Scenes and rigs: what is taken, what is refused, and the symmetries that stability and motion must have."""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fivcore import Beam, InputError, Rig, Scene, flutter_onsets, simulate, sliding_modes
from tests.battery.surfaces.examples import surface
from tests.helpers.rigs import workshop_rig

examples = surface("scenes and rigs", times=70)
pytestmark = pytest.mark.battery

# Of every number the range that is documented.
BEAM = {
    "length": (1e-9, 1e6),
    "width": (1e-9, 1e6),
    "thickness": (1e-9, 1e6),
    "young_modulus": (1e-3, 1e25),
    "density": (1e-6, 1e9),
}
RIG = {"head_mass": (0.0, 1e15), "d1": (0.0, 1e12), "d2": (0.0, 1e6), "point_b": (0.0, 1.0)}
SCENE = {"mu": (0.0, 1e6), "F": (1e-100, 1e100)}


def within(low, high):
    """Numbers of a range as callers have them: floats, whole numbers, NumPy's."""
    whole = st.integers(math.ceil(max(low, -(2**53))), math.floor(min(high, 2**53)))
    return st.one_of(
        st.floats(low, high),
        whole,
        st.floats(low, high).map(np.float64),
        st.sampled_from([low, high]),
    )


BEAMS = st.builds(Beam, elements=st.integers(1, 1000), **{name: within(*limits) for name, limits in BEAM.items()})


@st.composite
def any_rigs(draw):
    p1, p2 = draw(BEAMS), draw(BEAMS)
    share = draw(st.floats(1e-3, 1.0))
    return Rig(p1, p2, share * p2.length, **{name: draw(within(*limits)) for name, limits in RIG.items()})


SPEEDS = within(1e-100, 1e100).flatmap(lambda speed: st.sampled_from([speed, -speed]))
ANGLES = st.floats(-90.0, 90.0, exclude_min=True, exclude_max=True)
SCENES = st.builds(Scene, SPEEDS, ANGLES, within(*SCENE["mu"]), within(*SCENE["F"]), any_rigs())


@examples(60)
@given(SCENES)
def test_a_scene_of_any_numbers_in_range_is_a_value(scene):
    """It is equal to its copies, has their hash, and a different number makes a different scene."""
    assert all(type(value) is float for value in (scene.V, scene.theta, scene.mu, scene.F))
    again = Scene(scene.V, scene.theta, scene.mu, scene.F, replace(scene.rig, p1=replace(scene.rig.p1)))
    for other in (again, copy.deepcopy(scene), eval(repr(scene), {**globals(), "inf": math.inf})):  # noqa: S307
        assert other == scene
        assert hash(other) == hash(scene)
    assert scene.mirrored().mirrored() == scene
    assert scene.mirrored().drive_theta == scene.drive_theta
    # Not the number again, where half of it is.
    other = replace(scene, F=2.0 * scene.F if scene.F < 1.0 else 0.5 * scene.F)
    assert other != scene
    assert scene not in {other}
    assert f"{scene.V:g}" in scene._repr_html_()


NO_NUMBERS = [math.nan, math.inf, -math.inf, "1", b"1", True, np.True_, None, 10**400, 1j, [1.0, 2.0], {}, Rig]
# Every argument with numbers that are none of its own, besides those.
WRONG = {
    **{("beam", name): [0.0, -1.0, low * 0.99, high * 1.01] for name, (low, high) in BEAM.items()},
    ("beam", "elements"): [0, -3, 1001, 2.5],
    ("rig", "contact_position"): [0.0, -1e-3, 0.151],
    ("rig", "point_b"): [-1e-9, 1.0 + 1e-9],
    **{("rig", name): [-1e-300, RIG[name][1] * 1.01] for name in ("head_mass", "d1", "d2")},
    ("scene", "V"): [0.0, 1e-101, -1e101],
    ("scene", "theta"): [90.0, -90.0, 1e300],
    ("scene", "mu"): [-1e-300, 1e6 * 1.01],
    ("scene", "F"): [0.0, -9.0, 1e101],
}
MADE = {
    "beam": lambda **given: replace(Rig().p1, **given),
    "rig": Rig,
    "scene": lambda **given: Scene(**{"V": 1e-3, "theta": 5.0, "mu": 0.2, "F": 9.0, **given}),
}
HEAD = {"beam": "Beam: ", "rig": "Rig: ", "scene": ""}


@examples(120)
@given(st.data(), st.sampled_from(sorted(WRONG)))
def test_a_number_that_cannot_be_is_refused_by_name(data, which):
    kind, name = which
    value = data.draw(st.sampled_from([*WRONG[which], *NO_NUMBERS]))
    with pytest.raises(ValueError, match=r"it must be ") as caught:
        MADE[kind](**{name: value})
    assert isinstance(caught.value, InputError)
    message = str(caught.value)
    assert message.startswith(f"{HEAD[kind]}{name} = ")
    assert message.isprintable()
    assert len(message) < 250


# Stability.

WORKSHOP = st.builds(workshop_rig, st.integers(0, 10_000))
SLOPES, FRICTIONS = st.floats(-60.0, 60.0), st.floats(0.0, 1.5)
# Powers of two change no rounding.
FACTORS = st.integers(-4, 4).map(lambda power: 2.0**power)


def in_units(rig: Rig, length: float, mass: float, time: float) -> Rig:
    """The same rig, its numbers in other units of length, mass and time."""

    def beam(own: Beam) -> Beam:
        stiffness = mass / (length * time**2)
        sides = {name: getattr(own, name) * length for name in ("length", "width", "thickness")}
        return replace(
            own, **sides, young_modulus=own.young_modulus * stiffness, density=own.density * mass / length**3
        )

    return Rig(
        beam(rig.p1),
        beam(rig.p2),
        rig.contact_position * length,
        rig.head_mass * mass,
        rig.d1 / time,
        rig.d2 * time,
    )


@examples(15)
@given(WORKSHOP, SLOPES, FRICTIONS, FACTORS, FACTORS, FACTORS)
def test_stability_is_the_same_in_any_units(rig, theta, mu, length, mass, time):
    one = sliding_modes(rig, theta, mu, 8e3)
    other = sliding_modes(in_units(rig, length, mass, time), theta, mu, 8e3 / time)
    assert one.frequency.shape == other.frequency.shape
    scale = 2.0 * np.pi * np.abs(one.frequency) + np.abs(one.growth_rate)
    np.testing.assert_allclose(other.frequency * time, one.frequency, rtol=1e-8, atol=1e-8)
    assert np.all(np.abs(other.growth_rate * time - one.growth_rate) <= 1e-7 * scale)


@examples(15)
@given(WORKSHOP, SLOPES, FACTORS, FACTORS, FACTORS)
def test_onsets_are_the_same_in_any_units(rig, theta, length, mass, time):
    one = flutter_onsets(rig, theta, 8e3)
    other = flutter_onsets(in_units(rig, length, mass, time), theta, 8e3 / time)
    np.testing.assert_allclose(other.mu, one.mu, rtol=1e-8)
    np.testing.assert_allclose(other.frequency * time, one.frequency, rtol=1e-8)
    np.testing.assert_allclose(other.recovery_mu, one.recovery_mu, rtol=1e-8)


@examples(15)
@given(WORKSHOP, SLOPES, FRICTIONS, st.floats(1e-4, 1.0), st.floats(0.1, 100.0))
@example(Rig(), 5.0, 0.2, 2e-3, 9.0)
def test_stability_is_that_of_the_scene_in_the_mirror(rig, theta, mu, speed, load):
    """Modes of (theta, V) and (-theta, -V), each through its own scene."""
    scene = Scene(speed, theta, mu, load, rig)
    other = Scene(-speed, -theta, mu, load, rig)
    assert other == scene.mirrored()
    one, mirrored = (sliding_modes(each.rig, each.drive_theta, each.mu, 8e3) for each in (scene, other))
    np.testing.assert_array_equal(one.growth_rate, mirrored.growth_rate)
    np.testing.assert_array_equal(one.frequency, mirrored.frequency)


def growth_near(rig, theta, mu, frequency, step):
    """Growth rates of the mode whose eigenvalue is nearest to i omega, a relative step below, at and above mu."""
    modes = sliding_modes(rig, theta, mu * np.array([1.0 - step, 1.0, 1.0 + step]), 12e3)
    away = np.abs(modes.growth_rate + 2j * np.pi * (modes.frequency - frequency))
    return modes.growth_rate[np.arange(3), np.nanargmin(away, axis=1)]


@examples(15)
@given(WORKSHOP, st.floats(1.0, 40.0))
@example(Rig(), 5.0)
@example(workshop_rig(1652), 21.0)
def test_a_growth_rate_passes_through_zero_at_an_onset(rig, theta):
    found = flutter_onsets(rig, theta, 6e3)
    for mu, frequency, sign in (
        (found.mu, found.frequency, 1.0),
        (found.recovery_mu, found.recovery_frequency, -1.0),
    ):
        assert np.all(np.diff(mu) > 0.0)
        assert np.all((mu > 0.0) & (mu <= 1.0))
        for m, f in zip(mu, frequency, strict=True):
            before, at, after = growth_near(rig, theta, m, f, 1e-6)
            if not sign * before < 0.0 < sign * after:
                # Near a place where eigenvalues are equal these move as a square root.
                before, at, after = growth_near(rig, theta, m, f, 1e-8)
            assert abs(at) < 1e-6 * 2.0 * np.pi * f
            assert sign * before < 0.0 < sign * after


# Motion.


@st.composite
def scenes(draw):
    """A scene of the paper's rig but for some numbers."""
    rig = Rig.of(
        p1_length=draw(st.sampled_from([0.05, 0.06])),
        head_mass=draw(st.sampled_from([1.0, 2.9434])),
        d1=draw(st.sampled_from([0.0, 50.0])),
    )
    sense = draw(st.sampled_from([1.0, -1.0]))
    speed, theta = 10 ** draw(st.floats(-4.0, -0.5)), draw(st.floats(-15.0, 15.0))
    return Scene(sense * speed, theta, draw(st.floats(0.0, 0.5)), 10 ** draw(st.floats(-1.0, 2.0)), rig)


@examples(15)
@given(scenes())
def test_a_short_motion_obeys_the_law_of_the_contact(scene):
    motion = simulate(scene, 0.01, record=True, settle=0.0)
    shares = [motion.summary[f"{state}_fraction"] for state in ("stick", "slip", "separation")]
    assert sum(shares) == pytest.approx(1.0, abs=1e-12)
    assert all(0.0 <= share <= 1.0 for share in shares)
    force, friction = motion.normal_force, motion.tangential_force
    assert np.all(force >= 0.0)
    assert np.all(np.abs(friction) <= scene.mu * force * (1.0 + 1e-9) + 1e-12 * scene.F)
    # 0 separation, 1 stick, 2 slip.
    apart, slips = motion.state == 0, motion.state == 2
    assert np.all(force[apart] == 0.0)
    np.testing.assert_allclose(np.abs(friction[slips]), scene.mu * force[slips], rtol=1e-9, atol=1e-12 * scene.F)


@examples(15)
@given(scenes(), st.floats(1e-3, 1e3))
def test_a_motion_is_homogeneous_in_speed_and_load_and_the_same_in_the_mirror(scene, factor):
    one = simulate(scene, 0.01, record=True, settle=0.0)
    larger = simulate(replace(scene, V=factor * scene.V, F=factor * scene.F), 0.01, record=True, settle=0.0)
    mirrored = simulate(scene.mirrored(), 0.01, record=True, settle=0.0)
    for name, sense in (("velocity_B", -1.0), ("normal_force", 1.0), ("slip_velocity", -1.0)):
        own = getattr(one, name)
        # What is below has lost digits.
        np.testing.assert_allclose(getattr(larger, name), factor * own, rtol=1e-12, atol=np.finfo(float).tiny)
        np.testing.assert_array_equal(getattr(mirrored, name), sense * own)
    np.testing.assert_array_equal(larger.state, one.state)
    np.testing.assert_array_equal(mirrored.state, one.state)
