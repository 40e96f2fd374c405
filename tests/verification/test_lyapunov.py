"""Largest Lyapunov exponents: two neighbours, eigenvalues of sliding, a limit cycle, a map with a known one."""

from copy import copy
from dataclasses import asdict

import numpy as np
import pytest

from fivcore import Friction, Options, Rig, Scene, State, Structure, lyapunov_exponent, simulate
from fivcore.contact.reduced import reduced_model
from fivcore.contact.step_map import eigenvectors, step_map
from fivcore.transient import lyapunov
from fivcore.transient.fast import layout
from fivcore.transient.fast.run import FastRun, aligned
from fivcore.transient.fast.solver import put, take
from fivcore.transient.fast.steady import eigenvalues
from fivcore.transient.simulate import request
from tests.helpers.sliding import sliding_state

SKEW = 0.3
STATE = ("g_N", "g_T", "v_N", "v_T", "u_N", "u_T", "anchor")
IMPULSES = {"g_N": ("after_q", 0, 1), "g_T": ("after_q", 1, 2), "v_N": ("after_v", 0, 1), "v_T": ("after_v", 1, 2)}


def begun(scene, duration, **options):
    return FastRun(*request(scene, duration, Options(skip_sticks=False, end_early=False, **options))[1:])


def taken(run, steps):
    run.pause = run.now + steps
    while run.now < run.pause:
        run.advance()


def finished(run):
    """Give the run's deviation its last impulse, as the run itself has it at a pause; return its modes."""
    record, modes = run.tangent
    blocks, impulse = modes.reshape(run.blocks.shape), (record["impulse_N"][0], record["impulse_T"][0])
    push = blocks[:, layout.NORMAL] * impulse[0] + blocks[:, layout.TANGENTIAL] * impulse[1]
    blocks[:, layout.Q] += blocks[:, layout.B] * push
    blocks[:, layout.V] += blocks[:, layout.D] * push
    for name, (row, i, j) in IMPULSES.items():
        record[name] += run.record[row][0, [i, j]] @ impulse
    record["impulse_N"] = record["impulse_T"] = 0.0
    return blocks


def partings(run, spans, steps, distance):
    """How far a deviation is from what parts the run and a neighbour, after each of some spans; and statuses."""
    run.tangent, errors, contacts, largest = lyapunov._deviation(run), [], set(), 0.0
    for _ in range(spans):
        lyapunov._scaled_back(run)
        other, (record, modes) = copy(run), run.tangent
        other.tangent, other.record, other.blocks = (), run.record.copy(), aligned(run.blocks)
        # A share of the largest velocity, not of the present one: in a long stick that decays, and differences of
        # so small a share of it are lost in the rounding of the deflections under load.
        largest = max(largest, np.linalg.norm(run.blocks[:, layout.V]))
        size = distance * largest
        moving = slice(layout.Q, layout.V + 1)
        other.blocks[:, moving] += size * modes.reshape(run.blocks.shape)[:, moving]
        for name in STATE:
            other.record[name] += size * record[name]
        for each in (run, other):
            taken(each, steps)
        mine, theirs = finished(run)[:, layout.V], (other.blocks - run.blocks)[:, layout.V] / size
        errors.append(np.linalg.norm(mine - theirs) / np.linalg.norm(mine))
        contacts.add(int(run.record["contact"][0]))
    return np.array(errors), contacts


# Scene, time until then, and the distance of the neighbour: small enough for a law that curves, as of falling
# friction, and large enough for the rounding of the deflections, beside which little is left in long sticks.
NEIGHBOURS = {
    "irregular": (5.0, 5e-3, Friction(), 0.1, 1e-6),
    "with long sticks": (5.0, 1e-3, Friction(), 0.2, 1e-5),
    "falling": (5.0, 2e-3, Friction(0.6, 0.01), 0.15, 1e-6),
    "a jump": (5.0, 2e-3, Friction(0.6, 0.0), 0.15, 1e-6),
}


@pytest.mark.parametrize("case", NEIGHBOURS)
def test_the_deviation_is_what_parts_two_neighbours(case):
    """Component by component, over spans of a millisecond; in a few a neighbour takes a branch a step later."""
    theta, V, friction, settle, distance = NEIGHBOURS[case]
    run = begun(Scene(V, theta, 0.2, 9.0, friction=friction), 1.0)
    taken(run, round(settle / run.step))
    errors, contacts = partings(run, 100, round(1e-3 / run.step), distance)
    assert np.median(errors) < 1e-4
    assert np.mean(errors > 1e-3) < 0.1
    assert len(contacts) > 1


def test_in_slip_it_follows_a_growing_eigenvector():
    """2794 Hz, with 1764 1/s, over a millisecond."""
    start, _ = sliding_state(Rig(), 5.0, 0.2, 1.0, 8.0)
    run = begun(Scene(1.0, 5.0, 0.2, 8.0), 1.0, initial=start, ramp=0.0)
    model, count, size = run.model, 500, len(run.model.normal)
    z, vectors, _, _ = eigenvectors(step_map(model, run.step, 0.2))
    top = np.argmin(np.abs(np.log(z) / run.step - (1764.0 + 2794.0j * 2.0 * np.pi)))
    assert np.log(np.abs(z[top])) / run.step == pytest.approx(1764.0, rel=5e-3)
    x, expected = vectors[:, top].real, (vectors[:, top] * z[top] ** count).real
    run.tangent = record, modes = lyapunov._deviation(run)
    blocks = modes.reshape(run.blocks.shape)
    for row, values in ((layout.Q, x[:size]), (layout.V, x[size:-1])):
        put(blocks, run.places, row, values)
    record["g_N"], record["g_T"] = model.shapes @ x[:size]
    record["v_N"], record["v_T"] = model.shapes @ x[size:-1]
    record["u_T"] = x[-1]
    taken(run, count)
    assert run.record["switches"] == 0.0
    found = take(finished(run), run.places, layout.V)
    np.testing.assert_allclose(found, expected[size:-1], rtol=0.0, atol=1e-8 * np.abs(expected[size:-1]).max())


def test_a_state_may_be_given_in_any_way():
    """As the end of a run it would go on with that run's step, four times as long."""
    scene, given = Scene(2e-3, 5.0, 0.2, 9.0), {"settle": 0.02}
    end = simulate(scene, 0.15).final_state
    step = 0.25 * reduced_model(Rig(), 5.0, None).default_step
    ways = [
        lyapunov_exponent(scene, 0.05, initial=end, **given),
        lyapunov_exponent(scene, 0.05, initial=end, step=step, **given),
        lyapunov_exponent(scene, 0.05, initial=State(end.displacement, end.velocity, end.contact, True), **given),
    ]
    assert len({(each.value, each.start, each.time) for each in ways}) == 1


def test_steady_sliding_has_minus_the_least_damping():
    scene = Scene(2e-2, 8.0, 0.1, 9.0)
    model = reduced_model(Rig(), 8.0, None)
    least = eigenvalues(model, 0.1, model.default_step).real.max()
    found = lyapunov_exponent(scene, 6.0)
    assert least < 0.0
    assert found.value == pytest.approx(least, rel=5e-3)
    assert abs(found.value - least) < 3.0 * found.standard_error


def test_a_limit_cycle_has_none():
    """Stick and slip at some 50 Hz, by friction that falls with speed; chaos on the same rig has hundreds."""
    found = lyapunov_exponent(Scene(0.1, -5.0, 0.2, 9.0, friction=Friction(0.9, 0.2)), 8.0)
    assert abs(found.value) < 3.0 * found.standard_error < 6.0
    chaos = lyapunov_exponent(Scene(5e-3, 5.0, 0.2, 9.0), 2.0)
    assert chaos.value > 700.0 > 10.0 * chaos.standard_error
    assert chaos.start > 0.1
    assert chaos.start + chaos.time == pytest.approx(2.0)


def test_the_mean_of_a_skew_tent_map():
    """ln 2 with slopes of 2; else -a ln a - (1 - a) ln(1 - a), within the error in 95 % of all runs."""
    held, exact = 0, -SKEW * np.log(SKEW) - (1.0 - SKEW) * np.log(1.0 - SKEW)
    x, growths = np.random.default_rng(0).random(200), []
    for _ in range(4000):
        growths.append(np.log(np.where(x < SKEW, 1.0 / SKEW, 1.0 / (1.0 - SKEW))))
        x = np.where(x < SKEW, x / SKEW, (1.0 - x) / (1.0 - SKEW))
    for each in np.transpose(growths):
        value, error = lyapunov.mean_growth(each.reshape(-1, 20).sum(axis=1), np.full(200, 20.0), 12)
        held += abs(value - exact) < 2.0 * error
    assert 0.9 < held / 200 < 0.99
    value, error = lyapunov.mean_growth(np.full(50, 3.0 * np.log(2.0)), np.full(50, 3.0), 6)
    assert (value, error) == pytest.approx((np.log(2.0), 0.0))


def test_refusals():
    own = Structure.from_modes([0.0, 0.2], [1.0, 0.0], [0.0, 1.0], load=[-1.0, 0.0])
    with pytest.raises(ValueError, match="its contact is rigid"):
        lyapunov_exponent(Scene(0.1, 0.0, 0.2, 1.0, own), 1.0)
    assert np.isnan(list(asdict(lyapunov_exponent(Scene(1e-3, 5.0, 0.2, 9.0), 0.1)).values())[1])


def test_the_deviation_of_a_few_modes_is_what_parts_two_neighbours():
    """Three move and three are compliance; they stick and slip."""
    normal, tangential = [0.5, 1.0, 0.4, 0.8, 0.3, 0.6], [1.0, 0.4, 0.7, -0.5, 0.9, 0.2]
    frequency, load = [20.0, 55.0, 140.0, 900.0, 1500.0, 2300.0], [-each for each in normal]
    own = Structure.from_modes(frequency, normal, tangential, load=load, damping_ratio=0.01)
    run = begun(Scene(2e-3, 0.0, 0.6, 10.0, own, Friction(0.5, 0.01)), 1.0, cutoff=400.0, ramp=0.0)
    taken(run, 300)
    errors, contacts = partings(run, 15, 80, 1e-6)
    assert np.median(errors) < 1e-6
    assert np.mean(errors > 1e-3) < 0.1
    assert len(contacts) > 1
