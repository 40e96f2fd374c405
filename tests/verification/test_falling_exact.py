"""'exact' with friction that falls with the sliding speed: an oscillator on a belt, and the paper's rig.

The oscillator's cycles are compared with a closed form and with an integration of its own equation by SciPy.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fivcore import ContactError, Friction, Scene, Structure, simulate
from fivcore.transient.exact import ExactRun, states_at
from fivcore.transient.normalised import Normalised, State
from fivcore.transient.options import RunOptions
from fivcore.transient.statistics import SLIP, STICK
from tests.helpers.exact_runs import energy_residual, run_for

# Leine et al., Nonlinear Dynamics 16 (1998): mu = 1 / (1 + 3 |v|). Periods: `expected_slip`.
RATIONAL, EXPONENTIAL, JUMP = Friction(0.0, 1.0 / 3.0, "rational"), Friction(0.5, 0.5), Friction(0.5, 0.0)
PERIODS = {0.05: 28.933508, 0.1: 17.865990, 0.2: 12.001031, 0.4: 8.910589, 0.8: 7.353907}


def block(xi=0.0):
    """1 kg on a spring of 1 N/m, pressed against the belt."""
    return Structure.from_modes(
        [0.0, 0.5 / np.pi], [1.0, 0.0], [0.0, 1.0], load=[-1.0, 0.0], damping_ratio=[0.0, xi]
    )


def on_belt(V, friction, xi=0.0, F=1.0):
    """Normalised scene, and the block carried along by the belt with its spring at rest."""
    scene = Scene(V, 0.0, 1.0, F, block(xi), friction=friction)
    return Normalised.of(scene), {"ramp": 0.0, "initial": State(np.zeros(2), np.array([0.0, V / F]), STICK)}


def sticks_of(V, friction, duration, xi=0.0):
    """Begin and end of each stick that ends, but the first."""
    scene, given = on_belt(V, friction, xi)
    options = RunOptions(duration=duration, method="exact", step=0.05, min_stick=1e-3, settle=0.0, **given)
    run = ExactRun(scene, options)
    sticks = []
    while not run.done:
        run.advance()
        sticks += [segment.sticks for segment in run.segments]
    assert energy_residual(run) < 1e-10
    return np.concatenate(sticks), run


def expected_slip(V, friction, xi=0.0):
    """Time that the oscillator slips (infinite: it sticks no more), that it sticks, and its displacements then.

    Where the spring is too tight to stick as it has come up with the belt, it overtakes the belt.
    """
    t, x, v, sense, seen = 0.0, 1.0 - 2.0 * xi * V, V, 1.0, []
    while True:

        def rates(_, y, sense=sense):
            return [y[1], sense * friction.ratio(V - y[1]) - 2.0 * xi * y[1] - y[0]]

        def even(_, y):
            return y[1] - V

        even.terminal, even.direction = True, sense
        found = solve_ivp(
            rates, (t, t + 100.0), [x, v], "DOP853", events=even, rtol=3e-14, atol=1e-15, dense_output=True
        )
        if not len(found.t_events[0]):
            return np.inf, 0.0, np.zeros(2)
        begin, t, (x, v) = t, found.t_events[0][0], found.y_events[0][0]
        seen.append(found.sol(np.linspace(begin, t, 4001))[0])
        if abs(x + 2.0 * xi * V) < 1.0:
            return (
                t,
                (1.0 - 2.0 * xi * V - x) / V,
                np.array([np.min(np.concatenate(seen)), np.max(np.concatenate(seen))]),
            )
        sense = -sense


def test_a_jump_to_kinetic_friction_gives_the_cycle_in_closed_form():
    """It sticks from x = 2 kappa - 1 up to 1 and swings about kappa meanwhile."""
    V, kappa = 0.2, 0.5
    sticks, _ = sticks_of(V, JUMP, 30.0)
    slip = 2.0 * np.pi - 2.0 * np.arctan((1.0 - kappa) / V)
    assert slip == pytest.approx(3.9026054078, abs=1e-10)
    assert sticks[:, 1] - sticks[:, 0] == pytest.approx(2.0 * (1.0 - kappa) / V, abs=1e-8)
    assert sticks[1:, 0] - sticks[:-1, 1] == pytest.approx(slip, abs=1e-8)
    scene, given = on_belt(V, JUMP)
    # From x = 1 on, its highest place is reached when tan t = V / (1 - kappa).
    top = 5.0 + np.arctan(V / (1.0 - kappa))
    (x,) = states_at(scene, np.array([top]), **given)[:, 1]
    assert x - kappa == pytest.approx(0.5385164807, abs=1e-9)


@pytest.mark.parametrize("V", PERIODS)
def test_cycles_of_leines_oscillator(V):
    """At V = 0.8 the block overtakes the belt before it sticks."""
    slip, stick, _ = expected_slip(V, RATIONAL)
    assert slip + stick == pytest.approx(PERIODS[V], abs=6e-7)
    sticks, _ = sticks_of(V, RATIONAL, 1.0 / V + 2.0 * (slip + stick) + 0.5)
    # The spring of rigid contact gives way by 1e-9 m.
    error = max(1e-8, 1e-9 / V)
    assert np.diff(sticks[:, 0]) == pytest.approx(slip + stick, abs=error)
    assert sticks[:, 1] - sticks[:, 0] == pytest.approx(stick, abs=2.0 * error)


def test_displacements_of_leines_oscillator():
    slip, stick, ends = expected_slip(0.2, RATIONAL)
    assert (slip, stick) == (pytest.approx(4.2959995, abs=1e-7), pytest.approx(7.7050318, abs=1e-7))
    assert ends == pytest.approx([-0.5554326, 1.1339447], abs=1e-7)
    scene, given = on_belt(0.2, RATIONAL)
    x = states_at(scene, 5.0 + np.linspace(0.0, slip, 4001)[1:-1], **given)[:, 1]
    assert [x.min(), x.max()] == pytest.approx(ends, abs=1e-8)


def test_stick_and_slip_end_where_the_belt_is_too_fast():
    """Published: at V = 1.83657789."""
    slip, stick, _ = expected_slip(1.5, EXPONENTIAL, 0.05)
    sticks, _ = sticks_of(1.5, EXPONENTIAL, 15.0, 0.05)
    assert np.diff(sticks[:, 0]) == pytest.approx(slip + stick, abs=1e-8)
    for V, lasts in ((1.8, True), (1.84, False)):
        assert np.isfinite(expected_slip(V, EXPONENTIAL, 0.05)[0]) == lasts
        sticks, run = sticks_of(V, EXPONENTIAL, 20.0, 0.05)
        assert (len(sticks) > 0) == lasts
        assert run.record["contact"][0] == SLIP or lasts


def test_copies_in_other_units_have_the_same_bits():
    """V, F and the decay speed times 4."""
    found = [
        simulate(Scene(a * 0.2, 0.0, 1.0, a, block(), friction=Friction(0.2, a * 0.3)), 12.0, "exact", record=True)
        for a in (1.0, 4.0)
    ]
    for name, a in (("velocity_B", 4.0), ("tangential_force", 4.0), ("state", 1)):
        assert np.array_equal(a * getattr(found[0], name), getattr(found[1], name))


RIG = Scene(0.02, 5.0, 0.2, 9.0, friction=Friction(0.5, 0.2))


@pytest.mark.parametrize("friction", [RIG.friction, JUMP, Friction(0.3, 1.0, "rational")])
def test_the_energy_balance_of_the_papers_rig(friction):
    """Slip begins after 8 ms."""
    scene = Normalised.of(replace(RIG, friction=friction))
    run = run_for(ExactRun(scene, RunOptions(duration=0.0105, method="exact", settle=0.0)))
    assert run.record["first_slip"] < 0.008
    assert run.record["slip_time"] > 1e-3
    assert energy_residual(run) < 1e-10


def test_series_of_slip_obey_the_law():
    found = simulate(RIG, 0.0085, "exact", record=True, sample_rate=None)
    slips, N = found.state == SLIP, found.normal_force
    mu = [RIG.mu * RIG.friction.ratio(speed) for speed in found.slip_velocity[slips]]
    ratio = -np.sign(found.slip_velocity[slips]) * found.tangential_force[slips] / N[slips]
    assert slips.sum() > 100
    assert ratio == pytest.approx(mu, rel=1e-12)


def test_without_a_fall_every_bit_is_that_of_coulombs_law():
    found = [
        simulate(replace(RIG, friction=friction), 0.01, "exact", record=True)
        for friction in (Friction(), Friction(1.0, 0.0), Friction(1.0, 3.0, "rational"))
    ]
    for other in found[1:]:
        assert repr(other.summary) == repr(found[0].summary)
        assert np.array_equal(other.tangential_force, found[0].tangential_force)


def test_a_slip_rate_that_is_not_unique_is_an_error():
    """(1 - kappa) mu N / v_d reaches C_TT - mu |C_NT| of the contact's dashpot."""
    with pytest.raises(ContactError, match=r"decay_speed = 0\.02 m/s.* N = 9 N; it must be above 0\.0465 m/s"):
        simulate(replace(RIG, friction=Friction(0.5, 0.02)), 0.01, "exact")
    # By an impact the force rises within a step so far that there is no slip rate at all.
    with pytest.raises(ContactError, match=r"not unique where N = [\d.]+ N; it must be above [\d.]+ m/s"):
        simulate(replace(RIG, V=0.05, friction=Friction(0.5, 0.1)), 0.01, "exact")
    assert simulate(replace(RIG, friction=Friction(0.5, 0.047)), 1e-3, "exact").summary["slip_fraction"] == 0.0
