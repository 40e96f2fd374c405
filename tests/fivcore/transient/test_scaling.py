"""Every figure with a unit is F times its canonical value, to the last bit: copies of a scene can be scaled."""

import numpy as np
import pytest

from fivcore import Rig, Scene, simulate
from fivcore.transient.normalised import Normalised
from tests.helpers.runs import SERIES

SCALED = (
    "velocity_rms",
    "mean_normal_force",
    "max_normal_force",
    "normal_force_999",
    "max_slip_speed",
    "slip_speed_999",
)


def canonical_copy(scene):
    """The scene for V > 0 and F = 1 that this one is a copy of."""
    canonical = Normalised.of(scene)
    return Scene(canonical.speed_per_load, scene.drive_theta, scene.mu, 1.0, scene.rig)


def same(one, other):
    """Bit for bit, NaN like NaN."""
    if isinstance(one, (bool, str, int)):
        return type(one) is type(other) and one == other
    return np.array_equal(one, other, equal_nan=True)


CASES = [
    (Scene(V, theta, 0.2, F), 0.25, {"settle": settle})
    for V, F in ((5e-3, 9.0), (-3.7e-3, 7.3), (0.013, 0.037), (-2.1e-2, 113.0))
    for theta in (5.0, -5.0)
    for settle in (None, 0.0)
]
# Ended early, and with the other methods; each in either sense.
for sense in (1.0, -1.0):
    CASES.append((Scene(sense * 2e-2, sense * -5.0, 0.2, 3.3, Rig(d1=200.0)), 0.3, {}))
    for method, duration in (("paper", 0.01), ("exact", 0.012)):
        given = {"method": method, "settle": 0.0}
        CASES.append((Scene(sense * 0.03, sense * 5.0, 0.2, 7.3), duration, given))


@pytest.mark.parametrize(("scene", "duration", "given"), CASES)
def test_a_summary_is_the_canonical_one_times_the_load(scene, duration, given):
    sense, F = np.sign(scene.V), scene.F
    own, unit = (simulate(s, duration, record=True, **given) for s in (scene, canonical_copy(scene)))
    for key, value in unit.summary.items():
        expected = F * value if key in SCALED else value
        assert same(own.summary[key], expected), key
    factors = (1.0, F * sense, F, F * sense, F * sense, 1)
    for name, factor in zip(SERIES, factors, strict=True):
        assert np.array_equal(getattr(own, name), factor * getattr(unit, name)), name
    assert own.summary["settled_early"] == bool(scene.rig.d1 == 200.0)
