"""Every figure with a unit is F times its canonical value, to the last bit: copies of a scene can be scaled."""

import numpy as np
import pytest

from fivcore import Rig, Scene, simulate
from fivcore.transient.normalised import Normalised
from tests.helpers.runs import SERIES

SCALED = {
    "velocity_rms",
    "mean_normal_force",
    "max_normal_force",
    "normal_force_999",
    "max_slip_speed",
    "slip_speed_999",
}
CASES = [
    (Scene(5e-3, 5.0, 0.2, 9.0), 0.25, {}),
    (Scene(-3.7e-3, 5.0, 0.2, 7.3), 0.25, {"settle": 0.0}),
    (Scene(-3.7e-3, 5.0, 0.2, 7.3), 0.25, {"numerical_damping": "published"}),
    (Scene(0.013, -5.0, 0.2, 0.037), 0.25, {"settle": 0.0}),
    (Scene(-2.1e-2, -5.0, 0.2, 113.0), 0.25, {}),
    # Ended early, and by the other methods.
    (Scene(-2e-2, 5.0, 0.2, 3.3, Rig(d1=200.0)), 0.3, {}),
    (Scene(-0.03, -5.0, 0.2, 7.3), 0.01, {"method": "paper", "settle": 0.0}),
    (Scene(-0.03, -5.0, 0.2, 7.3), 0.01, {"method": "paper", "numerical_damping": "none", "settle": 0.0}),
    (Scene(-0.03, -5.0, 0.2, 7.3), 0.012, {"method": "exact", "settle": 0.0}),
]


@pytest.mark.parametrize(("scene", "duration", "given"), CASES)
def test_a_summary_is_the_canonical_one_times_the_load(scene, duration, given):
    sense, F = np.sign(scene.V), scene.F
    canonical = Scene(Normalised.of(scene).speed_per_load, scene.drive_theta, scene.mu, 1.0, scene.rig)
    own, unit = (simulate(each, duration, record=True, **given) for each in (scene, canonical))
    for key, value in unit.summary.items():
        expected = F * value if key in SCALED else value
        assert np.array_equal(own.summary[key], expected, equal_nan=not isinstance(value, str)), key
    for name, factor in zip(SERIES, (1.0, F * sense, F, F * sense, F * sense, 1), strict=True):
        assert np.array_equal(getattr(own, name), factor * getattr(unit, name)), name
    assert own.summary["settled_early"] == bool(scene.rig.d1 == 200.0)
