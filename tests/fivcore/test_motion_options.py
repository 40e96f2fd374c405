"""`Options` in place of keywords; options that once were not obeyed: rates, ramps beside a drive that runs."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from fivcore import InputError, Options, Scene, State, Structure, lyapunov_exponent, simulate, simulate_many
from sweeps import Axis, Grid, Sweep, Variable, pointwise
from tests.helpers.runs import assert_same_run
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


# Options.
VIBRATING = Scene(5e-3, 5.0, 0.2, 9.0)
GIVEN = [
    {},
    {"record": True, "sample_rate": 33e3, "ramp": 2e-3, "numerical_damping": "published"},
    {"record": ["velocity_B", "state"], "sample_times": np.linspace(0.0, 0.04, 9), "skip_sticks": False},
    {"method": "exact", "cutoff": 20e3, "settle": 0.01, "record": "state", "step": 2e-6},
    {"initial": (np.zeros(361), np.zeros(361), 1), "cutoff": 50e3, "min_stick": 1e-3, "end_early": False},
]


@pytest.mark.parametrize("given", GIVEN)
def test_options_are_the_keywords(given):
    options = Options(**given)
    runs = [simulate(VIBRATING, 0.04, **given), simulate(VIBRATING, 0.04, options=options)]
    runs += simulate_many([VIBRATING], [0.04], options=options)
    runs += [simulate(VIBRATING, 0.04, options=replace(options))]
    for run in runs[1:]:
        assert_same_run(run, runs[0])


def test_lyapunov_exponent_and_sweeps_take_options():
    options = Options(cutoff=40e3, settle=0.01, record=True)
    found = lyapunov_exponent(VIBRATING, 0.03, options=options)
    expected = lyapunov_exponent(VIBRATING, 0.03, cutoff=40e3, settle=0.01)
    assert (found.value, found.start, found.time) == (expected.value, expected.start, expected.time)
    with pytest.raises(InputError, match=r"^method = 'paper': a Lyapunov exponent is that of a motion by 'fast'$"):
        lyapunov_exponent(VIBRATING, 0.03, options=Options(method="paper"))
    grid, variables = Grid({"V": Axis([2e-3, 5e-3], "m s-1")}), {"velocity_rms": Variable("m s-1")}
    swept = Sweep("with_options", pointwise(rms_of), grid, variables, constants={"options": options})
    expected = [simulate(Scene(V, 5.0, 0.2, 9.0), 0.03, cutoff=40e3, settle=0.01).summary for V in (2e-3, 5e-3)]
    values = swept.plan().run(scheduler="sync")["velocity_rms"].values
    assert values.tolist() == [each["velocity_rms"] for each in expected]


def rms_of(V, options):
    return {"velocity_rms": simulate(Scene(V, 5.0, 0.2, 9.0), 0.03, options=options).summary["velocity_rms"]}


def test_options_are_frozen_and_compare_by_value():
    one, other = (Options(cutoff=50_000, record=["state"], sample_times=np.array([0.0, 1.0])) for _ in range(2))
    assert one == other == replace(one) != replace(one, cutoff=60e3)
    assert len({one, other}) == 1
    with pytest.raises(FrozenInstanceError):
        one.cutoff = 1e3


def test_wrong_options_are_named_where_they_are_made():
    with pytest.raises(InputError, match=r"^cutoff = -1.0: it must be a number from 1 to 1e\+12 \(Hz\)$"):
        Options(cutoff=-1.0)
    with pytest.raises(
        InputError, match=r"^initial: it must be modal displacements, modal velocities and a contact"
    ):
        Options(initial=3)
    with pytest.raises(InputError, match=r"^sample_rate = 'usual': it must be a number"):
        Options(sample_rate="usual")
    with pytest.raises(TypeError, match=r"'cut_off'"):
        Options(cut_off=50e3)
    with pytest.raises(InputError, match=r"^options = \{'cutoff': 50000.0\}: it must be an Options$"):
        simulate(VIBRATING, 0.01, options={"cutoff": 50e3})


@pytest.mark.parametrize(("name", "value"), [("cutoff", 50e3), ("method", "exact"), ("settle", [0.1])])
def test_keywords_beside_options_are_refused(name, value):
    """A method that stands before them, and a list for many scenes, too."""
    with pytest.raises(InputError, match=rf"^{name} = .*beside options: .*replace\(options, {name}=\.\.\.\)$"):
        simulate_many([VIBRATING], 0.01, options=Options(), **{name: value})
