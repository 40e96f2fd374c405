"""Limit cycles: closed forms, an oscillator's branch, the paper's rig, growth in runs, random structures."""

from dataclasses import replace
from itertools import islice, pairwise

import numpy as np
import pytest

from fivcore import (
    Friction,
    Rig,
    Scene,
    State,
    Structure,
    UnsolvedError,
    flutter_onsets,
    follow_cycle,
    limit_cycle,
    lyapunov_exponent,
    painleve_mu,
    simulate,
)
from fivcore.cycles import branch, shooting
from studies.physics.classical import belted, cycle

# bSTAB's oscillator (Stender, Hoffmann, Nonlinear Dynamics 107, 2022): sticking ends and the cycles fold at END,
# and from the unstable one, born at ONSET, on sliding is stable.
XI, FALL, ONSET, END = 0.05, Friction(0.5, 0.5), 1.1512925465, 1.83660097
DAMPED = Rig(d2=1e-6)


def of_belt(V, law, xi=0.0):
    """The cycle of a block on a belt, which carries it along at first."""
    scene, start = belted(V, law, xi)
    return limit_cycle(scene, State(start.displacement, start.velocity, start.contact, True))


def of_run(scene, duration):
    return limit_cycle(scene, simulate(scene, duration * scene.rig.time_scale).final_state)


@pytest.mark.parametrize("V", [0.2, 0.05, 0.1, 0.4, 0.8])
def test_a_falling_friction_has_the_periods_of_leine(V):
    law = Friction(0.0, 1.0 / 3.0, "rational")
    slip, stick, _ = cycle(V, law)
    found = of_belt(V, law)
    assert found.period == pytest.approx(slip + stick, abs=1e-9)
    assert dict(found.states)["stick"] == pytest.approx(stick, abs=1e-9)
    # Stick wipes out every deviation.
    assert np.all(np.abs(found.multipliers) < 1e-9)
    assert found.residual < 1e-10


def test_a_jump_has_its_closed_form():
    V, kappa = 0.2, 0.5
    found = of_belt(V, Friction(kappa, 0.0))
    stick, slip = 2.0 * (1.0 - kappa) / V, 2.0 * (np.pi - np.arctan((1.0 - kappa) / V))
    assert dict(found.states) == pytest.approx({"stick": stick, "slip": slip}, abs=1e-11)
    # v = -(1 - kappa) sin t + V cos t after the first slip.
    fastest = V + np.hypot(1.0 - kappa, V)
    assert found.summary["max_slip_speed"] == pytest.approx(fastest, rel=2e-3)
    assert found.summary["mean_normal_force"] == pytest.approx(1.0, abs=1e-12)
    assert found.stable


def test_runs_by_fast_end_on_a_cycle_as_steps_get_shorter():
    """Of a block on a belt, whose events `fast` locates: second order over four steps."""
    found = of_belt(0.2, Friction(0.5, 0.0))
    scene, start = found.scene, found.final_state
    errors = []
    for count in (100, 200, 400, 800):
        run = simulate(scene, 3.0 * found.period, initial=start, step=found.period / count, settle=0.0)
        (stick,) = run.summary["stick_times"][-1:]
        errors.append(abs(stick - dict(found.states)["stick"]))
    assert errors[-1] < 1e-4
    assert np.log2(errors[0] / errors[-1]) / 3.0 > 1.5


def test_stable_and_unstable_cycle_meet_at_the_fold():
    branch = follow_cycle(of_belt(1.834, FALL, XI), "V", 2.4, most=4)
    assert [place.text for place in branch.places] == ["stick vanishes", "fold"]
    assert branch.places[1].value == pytest.approx(END, abs=2e-7)
    first, last = branch.cycles[0], branch.cycles[-1]
    assert [name for name, _ in first.states] == ["slip", "stick"]
    assert (first.stable, last.stable, last.states[0][0]) == (True, False, "slip")


@pytest.mark.slow
def test_the_unstable_cycle_is_born_where_sliding_changes_its_stability():
    branch = follow_cycle(of_belt(1.82, FALL, XI), "V", 2.7, most=60)
    assert branch.places[-1].text == "birth from steady sliding"
    assert branch.places[-1].value == pytest.approx(ONSET, abs=1e-6)
    crests = [np.ptp(each.velocity_B) for each in branch.cycles]
    assert crests[-1] < 0.1 * max(crests)


@pytest.fixture(scope="module")
def sticking():
    """A stable cycle of the paper's rig with more damping."""
    return of_run(Scene(2e-3, 5.0, 0.12, 9.0, DAMPED), 0.6)


def test_a_run_of_the_rig_stays_on_its_cycle(sticking):
    assert sticking.stable
    assert [name for name, _ in sticking.states] == ["stick", "slip"]
    start, errors = sticking.final_state, []
    size = np.linalg.norm(start.velocity)
    for count in (209, 418, 836, 1672):
        run = simulate(sticking.scene, 11.0 * sticking.period, initial=start, step=sticking.period / count,
                       skip_sticks=False, end_early=False)  # fmt: skip
        errors.append(np.linalg.norm(run.final_state.velocity - start.velocity) / size)
    assert errors[0] < 2e-3
    assert all(b < 0.6 * a for a, b in pairwise(errors))
    # The deviation along the motion neither grows nor decays; all others do the latter.
    found = lyapunov_exponent(
        sticking.scene, 0.3, initial=State(start.displacement, start.velocity, start.contact, True)
    )
    assert abs(found.value) < 40.0


def test_the_branch_of_the_rig_folds(sticking):
    branch = follow_cycle(sticking, "mu", 0.05, most=18)
    (fold,) = branch.places
    assert (fold.text, fold.value) == ("fold", pytest.approx(0.10356, abs=2e-5))
    # On either side one cycle is stable and one is not.
    assert branch.cycles[0].stable
    assert not branch.cycles[-1].stable
    assert all(each.residual < 1e-10 for each in branch.cycles)


def test_a_branch_has_the_same_bits_whatever_the_cycle_was_used_for(sticking):
    first, again = (follow_cycle(sticking, "mu", 0.05, most=4) for _ in range(2))
    assert again.values.tolist() == first.values.tolist()
    assert [each.summary for each in again.cycles] == [each.summary for each in first.cycles]


@pytest.mark.slow
def test_the_unstable_branch_of_the_rig_ends_at_the_onset_of_flutter(sticking):
    """Between vibration and sliding; at the onset it slips all the time."""
    branch, onsets = follow_cycle(sticking, "mu", 0.05, most=60), flutter_onsets(DAMPED, 5.0)
    last = branch.places[-1]
    assert (last.text, last.value) == ("stick vanishes", pytest.approx(onsets.mu[0], rel=1e-5))
    assert branch.cycles[-1].frequency == pytest.approx(onsets.frequency[0], rel=1e-4)


@pytest.mark.slow
def test_a_hundred_points_of_the_rig(sticking):
    """Through places where statuses begin and vanish; `python -m tests.benchmarks` has the time."""
    branch = follow_cycle(sticking, "mu", 0.6, most=100)
    texts = [place.text for place in branch.places]
    assert texts[:2] == ["stick begins within slip", "slip vanishes"]
    assert len(branch.cycles) > 30


def test_a_perturbation_grows_in_a_run_as_the_multiplier_says():
    scene = Scene(2e-3, 5.0, 0.112, 9.0, DAMPED)
    found = limit_cycle(scene, 1.4e-3)
    assert not found.stable
    values, vectors = np.linalg.eig(found.monodromy)
    top = int(np.argmax(np.abs(values)))
    assert values[top].imag == 0.0
    flow, first, periods = found.flow, found.segments[0], 4
    size = 1e-5 * np.linalg.norm(first.start)
    deviation = np.append(vectors[:, top].real, 0.0) * size

    def after(z):
        start, step = flow.state(first.status, z), found.period / 1672
        end = simulate(
            scene, periods * found.period, initial=start, step=step, skip_sticks=False, end_early=False
        ).final_state
        return flow.of_state(end)[1]

    grown = after(first.start + deviation) - after(first.start)
    # The run ends at a time, not at the event: along the motion there is a shift.
    parts = np.column_stack([deviation, flow.field(first.status, first.start) @ first.start])
    growth = np.linalg.lstsq(parts / np.linalg.norm(parts, axis=0), grown, rcond=None)[0][0] / np.linalg.norm(
        deviation
    )
    assert growth == pytest.approx(values[top].real ** periods, rel=0.01)


def four_states():
    """Stick, slip, separation, slip of the rig, stable, beside irregular motion: not each run passes near it."""
    scene = Scene(8e-3, 5.0, 0.2, 9.0, Rig(d2=3e-7))
    return next(found for end in np.arange(1.5, 6.0, 0.5) if (found := limit_cycle(scene, duration=end)).stable)


@pytest.mark.slow
def test_the_cycle_of_figures_8_and_9_has_four_states():
    found = four_states()
    scene = found.scene
    names = [name for name, _ in found.states]
    assert sorted(names) == ["separation", "slip", "slip", "stick"]
    end, count = (
        0.1 + 250.0 * found.period,
        ("stick_fraction", "slip_fraction", "separation_fraction", "velocity_rms"),
    )
    run = simulate(scene, end, initial=found.final_state, settle=0.1, step=4e-7, skip_sticks=False).summary
    assert [run[name] for name in count] == pytest.approx([found.summary[name] for name in count], abs=1e-3)
    assert run["max_normal_force"] == pytest.approx(found.summary["max_normal_force"], rel=5e-3)
    assert found.summary["mean_normal_force"] == pytest.approx(scene.F, rel=5e-4)


@pytest.mark.slow
def test_it_loses_its_stability_with_half_the_damping():
    """Half of it is what gives the paper's motion; on the way slips of a microsecond begin and vanish."""
    branch = follow_cycle(four_states(), "d2", 1.5e-7)
    last = branch.cycles[-1]
    assert branch.values[-1] < 1.5e-7
    assert not last.stable
    assert {name for name, _ in last.states} == {"stick", "slip", "separation"}
    assert last.residual < 1e-10


def drawn(seed):
    """Structures with 2 to 6 modes beyond their first onset of flutter."""
    while True:
        rng, seed = np.random.default_rng(seed), seed + 1
        n = int(rng.integers(2, 7))
        load, frequency = -rng.uniform(0.2, 1.0, n), np.sort(rng.uniform(200.0, 4000.0, n))
        ratio, row = rng.choice([0.003, 0.01, 0.03]), -rng.uniform(0.2, 1.5, n)
        own = Structure.from_modes(frequency, -load, row, load=load, damping_ratio=ratio)
        V, share, kappa = (
            10.0 ** rng.uniform(-2.5, -0.5),
            rng.uniform(1.1, 1.6),
            float(rng.choice([1.0, 0.8, 0.6])),
        )
        found = flutter_onsets(own, 0.0)
        if len(found.mu) and share * found.mu[0] < 0.9 * painleve_mu(own, 0.0):
            yield Scene(V, 0.0, share * found.mu[0], 50.0, own, Friction(kappa, 0.0))


def periodic(seed):
    """Scenes of these whose runs are periodic, with the run."""
    for scene in drawn(seed):
        run = simulate(scene, 2.0 * scene.rig.time_scale)
        if run.summary["regime"] == "periodic" and run.summary["periodicity"] > 0.999:
            yield scene, run


FALLING = Friction(0.95, 0.05)


@pytest.mark.parametrize(
    "found",
    [
        pytest.param(lambda: of_run(Scene(2e-3, 5.0, 0.12, 9.0, DAMPED), 0.6), id="rig"),
        pytest.param(lambda: of_run(Scene(2e-3, 5.0, 0.115, 9.0, DAMPED, FALLING), 0.6), id="rig, falling"),
        pytest.param(
            lambda: of_run(Scene(2e-3, 5.0, 0.115, 9.0, DAMPED, Friction(0.95, 0.0)), 0.6), id="rig, jump"
        ),
        pytest.param(lambda: of_belt(0.2, Friction(0.0, 1.0 / 3.0, "rational")), id="belt, falling"),
        pytest.param(lambda: of_belt(0.2, Friction(0.5, 0.0)), id="belt, jump"),
    ],
)
def test_a_segment_has_the_derivative_of_its_motion(found):
    cycle = found()
    flow, random = cycle.flow, np.random.default_rng(5)
    for each in cycle.segments:
        _, tangent = flow.over(each.status, each.start, each.time)
        # Deviations in which the surfaces touch.
        change = flow.entry(each.status, each.status, each.start)[:-1, :-1] @ random.normal(size=len(tangent) - 1)
        change = np.append(1e-8 * flow.size(each.start) * change / np.linalg.norm(change), 0.0)
        ends = [flow.over(each.status, each.start + way * change, each.time, tangent=False)[0] for way in (1, -1)]
        slope = 0.5 * (ends[0] - ends[1])
        assert np.linalg.norm(tangent @ change - slope) <= 1e-4 * np.linalg.norm(slope)
        values = [flow.field(each.status, z) @ z for z in (each.start + change, each.start - change)]
        slope = 0.5 * (values[0] - values[1])
        field = flow.field(each.status, each.start) @ change
        assert np.linalg.norm(field - slope) <= 1e-4 * np.linalg.norm(slope)


def test_friction_that_falls_on_the_rig():
    found = of_run(Scene(2e-3, 5.0, 0.115, 9.0, DAMPED, FALLING), 0.6)
    assert [name for name, _ in found.states] == ["slip", "stick"]
    assert found.stable
    start = found.final_state
    run = simulate(found.scene, 10.0 * found.period, "exact", initial=start, settle=0.0, step=found.period / 1000)
    size = np.linalg.norm(start.velocity)
    assert np.linalg.norm(run.final_state.velocity - start.velocity) < 1e-6 * size
    branch = follow_cycle(found, "decay_speed", 0.02, most=4)
    assert len(branch.values) == 4
    assert all(each.residual < 1e-10 for each in branch.cycles)


def agrees(scene, run):
    """The cycle on which a run is: a run of "exact" stays on it, and the run has its RMS."""
    found = limit_cycle(scene, run.final_state)
    assert found.stable
    assert found.residual < 1e-10
    # The main frequency of a run is one of the cycle's harmonics.
    order = run.summary["dominant_frequency"] / found.frequency
    assert order == pytest.approx(round(order), abs=0.01)
    options = {"initial": found.final_state, "settle": 0.0, "step": found.period / 1000}
    early, late = (simulate(scene, n * found.period, "exact", **options).final_state for n in (0.5, 10.5))
    # An event right after another is not acted on by "exact".
    assert np.linalg.norm(late.velocity - early.velocity) < 1e-5 * np.linalg.norm(early.velocity)
    end = run.final_state
    for method in ("fast", "exact"):
        start = State(end.displacement, end.velocity, end.contact, True)
        late = simulate(scene, 60.0 * found.period, method, initial=start, settle=20.0 * found.period)
        assert late.summary["velocity_rms"] == pytest.approx(found.summary["velocity_rms"], rel=0.05)


@pytest.mark.parametrize("seed", [906, 1250, 2692, 3715])
def test_random_structures(seed):
    """Most have a jump of friction: an impact, or the end of slip, decides between its two cones."""
    scene = next(drawn(seed))
    agrees(scene, simulate(scene, 2.0 * scene.rig.time_scale))


@pytest.mark.slow
def test_fifty_random_structures():
    for scene, run in islice(periodic(0), 50):
        agrees(scene, run)


def test_of_a_mirrored_scene_it_is_the_mirrored_cycle(sticking):
    scene = sticking.scene
    mirrored = limit_cycle(scene.mirrored(), sticking)
    np.testing.assert_allclose(mirrored.velocity_B, -sticking.velocity_B, rtol=0.0, atol=1e-9)
    loaded = limit_cycle(replace(scene, V=2.0 * scene.V, F=2.0 * scene.F), sticking)
    assert loaded.frequency == pytest.approx(sticking.frequency, rel=1e-9)
    assert loaded.summary["velocity_rms"] == pytest.approx(2.0 * sticking.summary["velocity_rms"], rel=1e-9)


@pytest.mark.parametrize(
    ("scene", "options", "text"),
    [
        (Scene(2e-3, 5.0, 0.05, 9.0), {}, "after 0.5 s the motion is 'steady sliding'"),
        (Scene(2e-3, 5.0, 0.05, 9.0), {"method": "exact"}, "method = 'exact'"),
        (Scene(2e-3, 5.0, 0.05, 9.0), {"guess": "edge"}, "guess = 'edge': it must be a LimitCycle"),
    ],
)
def test_refusals(scene, options, text):
    with pytest.raises((ValueError, UnsolvedError), match=text):
        limit_cycle(scene, **options)


def test_parameters_that_there_are_not(sticking):
    with pytest.raises(ValueError, match="parameter = 'length': it must be one of V, theta, mu"):
        follow_cycle(sticking, "length", 1.0)


def test_equations_without_a_solution_end_a_search(sticking):
    lost = [each._replace(start=np.nan * each.start) for each in sticking.segments]
    assert shooting.solve(sticking.flow, lost, sticking.plane) is None
    way = branch._Follower("mu", 0.1)
    point = way.point(sticking, 0.12, branch.sense(sticking, 1.0))
    assert way.step(point, 1e-3) is not None
    assert way.step(point._replace(tangent=0.0 * point.tangent), 1e-3) is None
    with pytest.raises(UnsolvedError, match="more than one branch"):
        branch.bordered(point.linear, 0.0 * point.tangent, 1.0)
