"""One parameter followed up and down: known ends of hysteresis, states from scene to scene, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from fivcore import Friction, Scene, sliding_onsets
from studies import registry
from studies.answering import summary
from studies.asking.sweep import sweep_of
from studies.declaring.parameters import RUN
from studies.motion import following, regimes
from studies.physics.classical import block_of
from sweeps import InputError

OPTIONS = {name: parameter.default for name, parameter in RUN.items()}


def test_both_ends_of_the_hysteresis_of_a_belt_are_found_to_a_step():
    # Sliding is stable from the onset on, the cycle ends in the study `classics`.
    step, end = 0.02, 1.83660097
    speeds = np.arange(1.1, 1.9, step)
    chain = tuple(Scene(V, 0.0, 1.0, 1.0, block_of(1.0, 0.05), Friction(0.5, 0.5)) for V in speeds.tolist())
    (onset,) = sliding_onsets(chain[0], "V", 0.5, 2.0, 1.0).value
    found = following.follow([chain], 1.0, 500.0, **OPTIONS)
    up, down = regimes.is_of(found["regime"][0], *regimes.VIBRATING).T
    assert found["error"] == [None]
    assert speeds[up].max() + 0.5 * step == pytest.approx(end, abs=step)
    assert speeds[down].max() + 0.5 * step == pytest.approx(onset, abs=step)
    assert np.all(np.diff(up.astype(int)) <= 0)
    assert np.all(np.diff(down.astype(int)) <= 0)
    # A cycle has few extrema, and they are the same in all its periods.
    cycle = found["extremum"][0, len(speeds) // 2, 0]
    assert np.ptp(cycle[cycle > 0.5]) < 1e-2


def test_the_papers_rig_goes_on_vibrating_where_sliding_is_stable(computed):
    data = computed("hysteresis", mu=[0.088, 0.1, 0.112], member=[1, 2], hold=0.2)
    assert data["regime"].dims == ("member", "mu", "direction")
    vibrates = regimes.is_of(data["regime"].values, *regimes.VIBRATING)
    assert vibrates.tolist() == 2 * [[[False, False], [False, True], [True, True]]]
    np.testing.assert_allclose(data["bistable_low"], 0.094)
    np.testing.assert_allclose(data["bistable_high"], 0.106)
    assert data["growth_rate"].isel(member=0).values[1] < 0.0 < data["growth_rate"].isel(member=0).values[2]
    assert np.all(data["mapping_error"] == 0.0)
    study = registry.load("hysteresis")
    text = " ".join(summary.text(summary.parts(study, data)).split())
    assert "Sliding and vibration are both stable at μ from 0.094 ± 0.006 to 0.106 ± 0.006, in every loop." in text


def test_a_state_in_another_scene_keeps_its_deviation_from_rest():
    scene = Scene(2e-3, 5.0, 0.05, 9.0)
    state = following.run_one(following.runs.job(scene, 0.5, OPTIONS)).final_state
    same, jump = following.mapped(state, scene, scene)
    np.testing.assert_allclose(same.displacement, state.displacement, rtol=1e-12, atol=1e-20)
    assert jump == 0.0
    assert same.running
    assert same.origin is None
    # Steady sliding stays it at another speed, and nearly at another load.
    for other in (replace(scene, V=3e-3), replace(scene, F=10.0), replace(scene, theta=5.1)):
        mapped, jump = following.mapped(state, scene, other)
        run = following.run_one(following.runs.job(other, 0.3, OPTIONS, initial=mapped))
        assert run.summary["regime"] == "steady sliding"
        assert jump < 1e-6
        assert run.summary["mean_normal_force"] == pytest.approx(other.F, rel=1e-3)
    jerked = replace(state, velocity=np.ones(len(state.velocity)))
    assert following.mapped(jerked, scene, replace(scene, theta=6.0))[1] > 1.0


def test_a_rig_is_followed_too(computed):
    data = computed("hysteresis", follow="theta", theta=[4.9, 5.0, 5.1], mu=0.12, member=1, hold=0.1)
    assert data["regime"].dims == ("member", "theta", "direction")
    assert float(data["mu"]) == 0.12
    assert float(data["mapping_error"].max()) > 0.0


@pytest.mark.parametrize(("values", "message"), [
    ({"follow": "V"}, "V: it is followed; give several values of it, as V=START:STOP:COUNT"),
    ({"follow": ["V", "mu"]}, "follow = V, mu: give one; run the study once for each"),
    ({"follow": "V", "V": [1e-3, 2e-3], "mu": [0.1, 0.2]}, "mu: V is followed; give one value of mu, or"),
    ({"follow": "V", "V": [-1e-3, 2e-3], "mu": 0.1}, "V: it changes its sign; follow speeds of one sign"),
    ({"hold": 0.0}, "hold = 0"),
    ({"follow": "theta", "theta": [5.0, 95.0]}, "theta = 95"),
])  # fmt: skip
def test_what_cannot_be_followed_is_refused(values, message):
    with pytest.raises(InputError) as problem:
        sweep_of(registry.load("hysteresis"), values)
    assert message in str(problem.value)
