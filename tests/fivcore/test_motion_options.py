"""Options of a run that once were not obeyed: rates, ramps beside a drive that runs, scales of time."""

from dataclasses import replace

import numpy as np
import pytest

from fivcore import InputError, Scene, State, Structure, lyapunov_exponent, simulate
from tests.helpers.structures import beams

SLIDING = Scene(2e-3, 5.0, 0.05, 9.0)
SLOW = Structure.from_modes([50.0, 170.0], [1.0, 0.3], [0.2, 1.0], load=[-1.0, -0.3], damping_ratio=0.01)


@pytest.mark.parametrize("rate", [1e3, 50e3, 99e3, 100e3, 100001.0])
def test_an_explicit_rate_is_obeyed(rate):
    """The one that is the beams' default, too; by default a structure has 100 kHz in units of its time."""
    scene = Scene(2e-3, 0.0, 0.2, 9.0, SLOW)
    run = simulate(scene, 0.05, record=True, sample_rate=rate)
    assert np.diff(run.time) == pytest.approx(1.0 / rate, rel=1e-6)
    usual = simulate(scene, 0.05, record=True)
    assert np.diff(usual.time) == pytest.approx(1e-5 * run.summary["time_scale"], rel=0.05)


def test_the_default_rate_may_be_below_what_can_be_asked():
    slow = Structure.from_modes([0.0, 1e-6], [1.0, 0.0], [0.0, 1.0], load=[-1.0, 0.0])
    assert simulate(Scene(1.0, 0.0, 0.3, 1.0, slow), 100.0).summary["simulated_time"] == pytest.approx(100.0)


def test_the_scale_of_times_is_in_the_summary():
    scene = Scene(2e-3, 0.0, 0.2, 9.0, SLOW)
    assert simulate(scene, 0.01).summary["time_scale"] == pytest.approx(5e3 / 170.0)
    assert simulate(SLIDING, 0.001).summary["time_scale"] == 1.0
    high = Structure.from_modes([20e3, 30e3], [1.0, 0.3], [0.2, 1.0], load=[-1.0, -0.3])
    assert simulate(replace(scene, rig=high), 0.001).summary["time_scale"] == pytest.approx(0.25)


@pytest.mark.parametrize("method", ["fast", "exact", "paper"])
@pytest.mark.parametrize("structure", [False, True])
def test_a_drive_that_runs_is_not_forgotten(method, structure):
    """After a run that is shorter than the ramp, and after another one, as by a state that was given."""
    scene = Scene(2e-3, 0.0, 0.05, 9.0, beams(fmax=20e3)) if structure else SLIDING
    end = simulate(scene, 0.1).final_state
    for mu in (0.051, 0.052, 0.053):
        other = replace(scene, mu=mu)
        given = State(end.displacement, end.velocity, end.contact, True)
        one, two = (simulate(other, 2e-4, method, initial=state, record=True) for state in (end, given))
        end = one.final_state
        assert end.running
        np.testing.assert_array_equal(one.slip_velocity, two.slip_velocity)
    begun = simulate(scene, 2e-4).final_state
    assert not begun.running
    assert not simulate(replace(scene, mu=0.06), 2e-4, initial=begun).final_state.running


def test_a_ramp_beside_a_drive_that_has_started_is_refused():
    end = simulate(SLIDING, 0.01).final_state
    other = replace(SLIDING, mu=0.06)
    for scene in (SLIDING, other):
        with pytest.raises(InputError, match=r"^ramp = 0.002: the drive of the initial state has started already"):
            simulate(scene, 1e-3, initial=end, ramp=2e-3)
    simulate(SLIDING, 1e-3, initial=end, ramp=1e-3)
    simulate(other, 1e-3, initial=end, ramp=0.0)
    with pytest.raises(InputError, match=r"^ramp = 0.001: "):
        simulate(other, 1e-3, initial=end, ramp=1e-3)
    # A state at rest has its ramp.
    rest = State(end.displacement, end.velocity, 1)
    assert not simulate(other, 1e-4, initial=rest, ramp=2e-3).final_state.running
    assert lyapunov_exponent(Scene(2e-3, 5.0, 0.2, 9.0), 0.05, initial=end, settle=0.0).time > 0.0


def test_a_run_from_a_running_drive_counts_no_ramp():
    """What the clamp has moved decides between "undecided" and "stuck"."""
    scene = Scene(2e-3, 5.0, 0.5, 9.0)
    end = simulate(scene, 0.01).final_state
    # It slips statically after 0.18 s.
    run = simulate(replace(scene, mu=0.4999), 0.05, initial=end, ramp=0.0)
    assert run.summary["regime"] == "undecided"
    assert run.final_state.running
