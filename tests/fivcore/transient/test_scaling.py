"""Every figure with a unit is F times its canonical value, to the last bit: copies of a scene can be scaled."""

import numpy as np
import pytest

from fivcore import Rig, Scene, simulate
from fivcore.transient.normalised import Normalised

SCALED = (
    "velocity_rms",
    "mean_normal_force",
    "max_normal_force",
    "normal_force_999",
    "max_slip_speed",
    "slip_speed_999",
)
QUICKLY_SETTLED = Rig(d1=200.0)


def canonical_copy(scene):
    """The scene for V > 0 and F = 1 that this one is a copy of."""
    canonical = Normalised.of(scene)
    return Scene(canonical.speed_per_load, scene.drive_theta, scene.mu, 1.0, scene.rig)


def same(one, other):
    """Bit for bit, NaN like NaN."""
    if isinstance(one, (bool, str, int)):
        return type(one) is type(other) and one == other
    return np.array_equal(one, other, equal_nan=True)


@pytest.mark.parametrize("theta", [5.0, -5.0])
@pytest.mark.parametrize(("V", "F"), [(5e-3, 9.0), (-3.7e-3, 7.3), (0.013, 0.037), (-2.1e-2, 113.0)])
@pytest.mark.parametrize("settle", [None, 0.0])
def test_a_summary_is_the_canonical_one_times_the_load(V, theta, F, settle):
    check(Scene(V, theta, 0.2, F), 0.25, settle=settle)


@pytest.mark.parametrize("V", [2e-2, -2e-2])
def test_so_it_is_where_a_run_is_ended_early(V):
    assert check(Scene(V, -5.0 if V > 0 else 5.0, 0.2, 3.3, QUICKLY_SETTLED), 0.3)["settled_early"]


@pytest.mark.parametrize(("method", "duration"), [("paper", 0.015), ("exact", 0.02)])
@pytest.mark.parametrize("V", [0.03, -0.03])
def test_so_it_is_with_the_other_methods(method, duration, V):
    check(Scene(V, 5.0 if V > 0 else -5.0, 0.2, 7.3), duration, method=method, settle=0.0)


def check(scene, duration, **given):
    """Compare a scene with its canonical copy; its summary."""
    sense, F = np.sign(scene.V), scene.F
    own, unit = (simulate(s, duration, record=True, **given) for s in (scene, canonical_copy(scene)))
    for key, value in unit.summary.items():
        expected = F * value if key in SCALED else value
        assert same(own.summary[key], expected), key
    assert np.array_equal(own.velocity_B, F * sense * unit.velocity_B)
    assert np.array_equal(own.slip_velocity, F * sense * unit.slip_velocity)
    assert np.array_equal(own.tangential_force, F * sense * unit.tangential_force)
    assert np.array_equal(own.normal_force, F * unit.normal_force)
    assert np.array_equal(own.time, unit.time)
    assert np.array_equal(own.state, unit.state)
    return own.summary
