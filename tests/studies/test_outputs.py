"""An output that a study gets costs itself: what is stored stays, in all bits."""

from dataclasses import replace

import numpy as np
import pytest

from fivcore import followed_modes, simulate_many
from studies import registry
from studies.asking.sweep import sweep_of
from studies.motion.run import BAND


def added(name, **changes):
    """A predefined study that its user has extended."""
    study = registry.load(name)
    return replace(study, **{what: {**getattr(study, what), **more} for what, more in changes.items()})


def damping_ratio(rig, theta, mu):
    modes = followed_modes(rig, theta, mu, BAND)
    return {"damping_ratio": -modes.growth_rate / np.hypot(modes.growth_rate, 2.0 * np.pi * modes.frequency)}


def quantile(scenes, duration):
    runs = simulate_many(scenes, duration or 0.2, record=True)
    return {"force_90": [np.quantile(run.normal_force, 0.9) for run in runs]}


CASES = {
    "fig5": ({"damping_ratio": ("1", "damping ratio", "mode")}, damping_ratio, {"mu": [0.1, 0.2, 0.3]}),
    "scenes": (
        {"force_90": ("N", "normal force, 90 % quantile")},
        quantile,
        {"V": [1e-3, 2e-3], "mu": [0.2], "theta": [5.0], "F": [9.0, 18.0], "duration": 0.2},
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_an_output_costs_itself(name, tmp_path):
    outputs, function, request = CASES[name]
    file = tmp_path / f"{name}.nc"
    before = sweep_of(registry.load(name), request).plan(file).run()
    study = added(name, outputs=outputs, functions=dict.fromkeys(outputs, function))
    data = sweep_of(study, request).plan(file).run()
    for each in before.variables:
        np.testing.assert_array_equal(data[each], before[each])
        assert data[each].dims == before[each].dims
    (output,) = outputs
    assert data[output].notnull().any()
    assert data.attrs["history"].splitlines()[-1].endswith(f"; {output} added")
    # As if it had been there from the beginning.
    whole = sweep_of(study, request).plan().run()
    for each in set(whole.variables) - {"wall_time"}:
        np.testing.assert_array_equal(data[each], whole[each])


def test_the_damping_ratio_is_that_of_the_modes():
    outputs, function, request = CASES["fig5"]
    study = added("fig5", outputs=outputs, functions=dict.fromkeys(outputs, function))
    data = sweep_of(study, request).plan().run()
    size = np.hypot(data["growth_rate"], 2.0 * np.pi * data["frequency"])
    np.testing.assert_allclose(data["damping_ratio"], -data["growth_rate"] / size, rtol=1e-12)
