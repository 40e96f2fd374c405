"""Ends of stick, slip and separation lie within a step: rigid contact of few modes, by closed forms."""

import numpy as np
import pytest

from fivcore import Friction, Scene, State, Structure, simulate
from fivcore.friction import COULOMB
from fivcore.transient.statistics import SLIP
from studies.physics.classical import belted, block_of, cycle

RATIONAL, JUMP = Friction(0.0, 1.0 / 3.0, "rational"), Friction(0.5, 0.0)


def closed_form(V, law):
    """Slip and stick of the cycle of x'' + x = r, |r| <= mu(V - x')."""
    if law is RATIONAL:
        return cycle(V, law)[:2]
    return 2.0 * (np.pi - np.arctan(0.5 / V)), 1.0 / V


@pytest.mark.parametrize(
    ("law", "V"), [*((RATIONAL, V) for V in (0.05, 0.1, 0.2, 0.4, 0.8)), (JUMP, 0.2), (JUMP, 0.25)]
)
def test_periods_and_sticks_of_a_block_on_a_belt(law, V):
    """By default within 1e-3; at V = 0.8 it overtakes the belt before it sticks."""
    slip, stick = closed_form(V, law)
    scene, start = belted(V, law)
    settle = 1.0 / V + slip
    run = simulate(
        scene, settle + 12.0 * (slip + stick), ramp=0.0, settle=settle, min_stick=0.5, initial=start
    ).summary
    assert run["first_slip_time"] == pytest.approx(1.0 / V, rel=1e-3)
    assert np.diff(run["stick_starts"]) == pytest.approx(slip + stick, rel=1e-3)
    assert run["stick_times"] == pytest.approx(stick, rel=1e-3)
    assert run["stick_fraction"] == pytest.approx(stick / (slip + stick), abs=1e-3)
    assert run["stick_fraction"] + run["slip_fraction"] == pytest.approx(1.0, abs=1e-9)
    assert run["energy_residual"] < 1e-3


@pytest.mark.parametrize("law", [RATIONAL, JUMP])
def test_the_error_of_event_times_is_of_second_order(law):
    """Of the law that is continuous and of the one that jumps; twenty times the default step is within 1 %."""
    slip, stick = closed_form(0.2, law)
    scene, start = belted(0.2, law)
    how = {"ramp": 0.0, "settle": 0.0, "min_stick": 0.5, "initial": start}
    errors = []
    for step in (0.08, 0.02, 0.005):
        starts = [
            simulate(scene, 5.0 + 8.0 * (slip + stick), step=step * factor, **how).summary["stick_starts"]
            for factor in (1.0, 0.97, 0.94, 0.91)
        ]
        errors.append(max(abs(np.diff(each) / (slip + stick) - 1.0).max() for each in starts))
    assert errors[0] < 1e-2
    assert errors[2] < errors[0] / 20.0


def test_friction_keeps_its_cone_in_every_row():
    for law, V in ((RATIONAL, 0.8), (JUMP, 0.2), (COULOMB, 0.3)):
        scene, start = belted(V, law)
        run = simulate(scene, 40.0, ramp=0.0, initial=start, record=True, sample_rate=None)
        assert np.all(np.abs(run.tangential_force) <= run.normal_force * (1.0 + 1e-9))


@pytest.mark.parametrize(
    ("hertz", "duration"),
    [(1e-4, 5.0), (1e-4, 50.0), (1e-5, 500.0), (1e-6, 1e4), (1e-7, 1e5), (1e-2, 5.0), (1e-1, 5.0)],
)
def test_a_block_that_the_belt_takes_along(hertz, duration):
    """1 kg on a belt of 10 m/s under mu g = 2.94 m/s2: however soft its spring, no step is too long for that."""
    scene = Scene(10.0, 0.0, 0.3, 9.8, block_of(2.0 * np.pi * hertz))
    run = simulate(scene, duration, ramp=0.0, settle=0.0)
    assert run.summary["simulated_time"] == pytest.approx(duration, rel=1e-2)
    # x = a (1 - cos wt) / w^2, a = 2.94: v = V at sin wt = V w / a, if friction is stronger than the spring then.
    ratio, omega = 10.0 * 2.0 * np.pi * hertz / 2.94, 2.0 * np.pi * hertz
    if ratio < 0.5:
        stuck = run.summary["stick_fraction"] * run.summary["simulated_time"]
        assert run.summary["simulated_time"] - stuck == pytest.approx(np.arcsin(ratio) / omega, rel=5e-3)
    else:
        assert run.summary["stick_fraction"] < 0.5


@pytest.mark.parametrize("steps", [1.0, 3.0, 10.0])
def test_a_jump_apart_and_a_landing(steps):
    """A unit mass thrown up falls back after 2 v / g, whatever the step."""
    body = Structure.from_modes([0.0, 0.2], [1.0, 0.0], [0.0, 1.0], load=[-1.0, 0.0])
    scene, start = Scene(1e-6, 0.0, 0.1, 1.0, body), State([0.0, 0.0], [0.5, 0.0], 0)
    run = simulate(scene, 4.0, ramp=0.0, settle=0.0, initial=start, step=0.007 * steps).summary
    assert run["separation_fraction"] * run["simulated_time"] == pytest.approx(1.0, rel=5e-3 * steps)


def test_slip_from_the_start_ends_in_stick():
    """Of a state that slips: the time until v = V, by constant friction."""
    scene = Scene(1.0, 0.0, 0.5, 1.0, block_of(1e-3))
    start = State(np.zeros(2), np.array([0.0, 0.0]), SLIP, True)
    run = simulate(scene, 10.0, settle=0.0, initial=start).summary
    assert run["slip_fraction"] * 10.0 == pytest.approx(2.0, rel=5e-3)
