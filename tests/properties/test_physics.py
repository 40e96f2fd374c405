"""What must hold of any scene: symmetries, scaling, and the law of the contact.

A few examples, always the same; FIV_EXAMPLES=100 tries a hundred times as many, drawn anew.
"""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import fivcore
from fivcore import (
    ContactError,
    Rig,
    Scene,
    flutter_onsets,
    glued_frequencies,
    painleve_mu,
    simulate,
    sliding_modes,
    tune_head_mass,
)
from tests.helpers.examples import examples
from tests.helpers.rigs import angles, frictions, rigs, workshop_rig

# Stability.

WORKSHOP, SLOPES = st.builds(workshop_rig, st.integers(0, 10_000)), st.floats(-60.0, 60.0)
# Powers of two change no rounding.
FACTORS = st.integers(-4, 4).map(lambda power: 2.0**power)


def in_units(rig, length, mass, time):
    """The same rig, its numbers in other units of length, mass and time."""

    def beam(own):
        sides = {name: getattr(own, name) * length for name in ("length", "width", "thickness")}
        young, density = own.young_modulus * mass / (length * time**2), own.density * mass / length**3
        return replace(own, **sides, young_modulus=young, density=density)

    beams, place, head = (beam(rig.p1), beam(rig.p2)), rig.contact_position * length, rig.head_mass * mass
    return Rig(*beams, place, head, rig.d1 / time, rig.d2 * time)


@given(WORKSHOP, SLOPES, frictions, FACTORS, FACTORS, FACTORS)
@examples(20)
def test_stability_is_the_same_in_any_units(rig, theta, mu, length, mass, time):
    other_rig, band = in_units(rig, length, mass, time), 8e3 / time
    one, other = sliding_modes(rig, theta, mu, 8e3), sliding_modes(other_rig, theta, mu, band)
    assert one.frequency.shape == other.frequency.shape
    scale = 2.0 * np.pi * np.abs(one.frequency) + np.abs(one.growth_rate)
    np.testing.assert_allclose(other.frequency * time, one.frequency, rtol=1e-8, atol=1e-8)
    assert np.all(np.abs(other.growth_rate * time - one.growth_rate) <= 1e-7 * scale)
    one, other = flutter_onsets(rig, theta, 8e3), flutter_onsets(other_rig, theta, band)
    np.testing.assert_allclose(other.mu, one.mu, rtol=1e-8)
    np.testing.assert_allclose(other.frequency * time, one.frequency, rtol=1e-8)
    np.testing.assert_allclose(other.recovery_mu, one.recovery_mu, rtol=1e-8)


@given(rigs, angles, frictions, st.floats(1e3, 20e3))
@examples(30)
def test_upright_or_without_friction_sliding_is_stable_and_flutter_needs_a_digging_contact(rig, theta, mu, fmax):
    assert not np.any(sliding_modes(rig, 0.0, mu, fmax).unstable)
    assert not np.any(sliding_modes(rig, theta, 0.0, fmax).unstable)
    assert len(flutter_onsets(rig, 0.0, fmax).mu) == 0


@given(rigs, angles)
@examples(15)
def test_a_tuned_head_mass_gives_the_frequency_and_the_mirror_image_the_same_modes(rig, theta):
    np.testing.assert_allclose(glued_frequencies(rig, theta), glued_frequencies(rig, -theta), rtol=1e-10)
    largest = glued_frequencies(replace(rig, head_mass=0.0), theta, 1)[0]
    for share in (0.02, 0.5, 0.99):
        mass = tune_head_mass(rig, theta, share * largest)
        assert mass > 0.0
        first = glued_frequencies(replace(rig, head_mass=mass), theta, 1)[0]
        assert first == pytest.approx(share * largest, rel=1e-9)


def growth_near(rig, theta, mu, frequency, step):
    """Growth rates of the mode whose eigenvalue is nearest to i omega, a relative step below, at and above mu."""
    modes = sliding_modes(rig, theta, mu * np.array([1.0 - step, 1.0, 1.0 + step]), 12e3)
    away = np.abs(modes.growth_rate + 2j * np.pi * (modes.frequency - frequency))
    return modes.growth_rate[np.arange(3), np.nanargmin(away, axis=1)]


@given(WORKSHOP, st.floats(1.0, 40.0))
@examples(20)
@example(Rig(), 5.0)
@example(workshop_rig(1652), 21.0)
def test_a_growth_rate_passes_through_zero_at_an_onset(rig, theta):
    found = flutter_onsets(rig, theta, 6e3)
    turns = (found.mu, found.frequency, 1.0), (found.recovery_mu, found.recovery_frequency, -1.0)
    for mu, frequency, sign in turns:
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
def scenes(draw, steepest=15.0, most=0.5):
    """A scene of the paper's rig but for some numbers."""
    numbers = {"p1_length": [0.05, 0.06], "head_mass": [1.0, 2.9434], "d1": [0.0, 50.0]}
    rig = Rig.of(**{name: draw(st.sampled_from(values)) for name, values in numbers.items()})
    V = draw(st.sampled_from([1.0, -1.0])) * 10 ** draw(st.floats(-4.0, -0.5))
    theta, mu = draw(st.floats(-steepest, steepest)), draw(st.floats(0.0, most))
    return Scene(V, theta, mu, 10 ** draw(st.floats(-1.0, 2.0)), rig)


@given(scenes(89.9, 1e3))
@examples(30)
def test_a_scene_is_a_value_and_the_mirror_image_of_its_mirror_image(scene):
    """Equal to its copies, with their hash, and a different number makes a different scene."""
    for other in (replace(scene), copy.deepcopy(scene), eval(repr(scene), vars(fivcore))):  # noqa: S307
        assert other == scene
        assert hash(other) == hash(scene)
    assert replace(scene, F=2.0 * scene.F) != scene
    assert scene.mirrored().mirrored() == scene
    assert scene.mirrored().drive_theta == scene.drive_theta
    assert replace(scene, V=math.copysign(7.0, scene.V)).drive_theta == scene.drive_theta


@pytest.mark.parametrize(
    ("method", "duration", "count"), [("fast", 0.02, 25), ("exact", 2e-3, 4), ("paper", 5e-4, 6)]
)
def test_a_motion_obeys_the_law_of_the_contact(method, duration, count):
    """Signorini's and Coulomb's at every step, or the scene is refused as beyond the critical friction."""

    @given(scenes(60.0, 3.0), st.sampled_from([0.0, 1e-4]))
    @examples(count)
    def holds(scene, ramp):
        given = {"ramp": ramp, "record": True, "sample_rate": None, "settle": 0.0}
        if scene.mu >= painleve_mu(scene.rig, scene.drive_theta, method):
            with pytest.raises(ContactError, match=f"mu = {scene.mu:g}, ") as caught:
                simulate(scene, duration, method, **given)
            assert caught.value.scene == scene
            return
        run = simulate(scene, duration, method, **given)
        N, T, slip, state = run.normal_force, run.tangential_force, run.slip_velocity, run.state
        rounding = 1e-9 * N + 1e-12 * scene.F
        assert all(np.isfinite(each).all() for each in (N, T, slip, run.velocity_B))
        assert sum(run.summary[f"{name}_fraction"] for name in ("stick", "slip", "separation")) == pytest.approx(
            1.0
        )
        assert np.all(N >= 0.0)
        assert np.all((N[state == 0] == 0.0) & (T[state == 0] == 0.0))
        if method != "paper":
            # The published scheme relaxes towards the cone.
            assert np.all(np.abs(T) <= scene.mu * N + rounding)
            slips = state == 2
            assert np.all(np.abs(np.abs(T) - scene.mu * N)[slips] <= rounding[slips])
            assert np.all((T * slip)[slips] <= 1e-12 * scene.F * np.abs(slip).max())
            assert np.abs(slip[state == 1]).max(initial=0.0) <= 1e-9 * abs(scene.V)

    holds()


@given(scenes(), st.floats(1e-3, 1e3), st.sampled_from(["fast", "fast", "fast", "exact"]))
@examples(15)
@example(Scene(0.1, 1.0, 0.5, 1.0, Rig.of(p1_length=0.06, head_mass=1.0, d1=0.0)), 3.0, "fast")
def test_a_motion_is_homogeneous_in_speed_and_load_and_the_same_in_the_mirror(scene, factor, method):
    # Of every step: between two of them series are interpolated, where a value near zero has lost digits.
    given = {"record": True, "sample_rate": None, "settle": 0.0}
    duration = 0.01 if method == "fast" else 2e-3
    larger = replace(scene, V=factor * scene.V, F=factor * scene.F)
    one, larger, mirrored = (
        simulate(each, duration, method, **given) for each in (scene, larger, scene.mirrored())
    )
    for name, sense in (("velocity_B", -1.0), ("normal_force", 1.0), ("slip_velocity", -1.0)):
        own = getattr(one, name)
        # What is below has lost digits.
        np.testing.assert_allclose(getattr(larger, name), factor * own, rtol=1e-12, atol=np.finfo(float).tiny)
        np.testing.assert_array_equal(getattr(mirrored, name), sense * own)
    np.testing.assert_array_equal(larger.state, one.state)
    np.testing.assert_array_equal(mirrored.state, one.state)
