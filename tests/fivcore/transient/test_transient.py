"""Transient motion: what the paper's rig does, and what every run must do whatever its scene."""

import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from fivcore import (
    ContactError,
    DivergenceError,
    Rig,
    Scene,
    critical_mu,
    glued_frequencies,
    simulate,
    simulate_many,
)
from fivcore.contact import step_map as step_limit
from fivcore.contact.reduced import DAMPING, default_cutoff, full_model, reduced_model
from fivcore.rig import P1, P2
from fivcore.transient import fast, moving_contact
from fivcore.transient.moving_contact import ContactMotion, moved_model
from fivcore.transient.normalised import Normalised
from fivcore.transient.published import STEP, TAU
from studies.accuracy.rigs import drawn_scene
from tests.benchmarks.ensembles import FRACTIONS, compare, members
from tests.helpers.runs import SERIES, assert_same_run, assert_same_summary


def paper_scene(V, F=9.0):
    return Scene(V, 5.0, 0.2, F)


@pytest.fixture(scope="module")
def vibrating():
    """One second at 2 mm/s, recorded at the rate of the samples of which statistics are made."""
    return simulate(paper_scene(2e-3), 1.0, record=True, sample_rate=50e3)


# What the paper's rig does.


@pytest.mark.parametrize("V", [pytest.param(2e-3, marks=pytest.mark.slow), 5e-3])
def test_fast_slips_and_separates_first_when_the_published_scheme_does(V):
    """First slip comes when the clamp has moved by 0.1435 mm, the first separation 3.6 to 3.95 ms later."""
    delays = {}
    for method in ("fast", "paper"):
        until = 0.5e-3 + 0.1435e-3 / V + 5e-3
        summary = simulate(paper_scene(V), until, method, numerical_damping="published").summary
        slip = summary["first_slip_time"]
        assert slip == pytest.approx(0.5e-3 + 0.1435e-3 / V, rel=0.01)
        delays[method] = summary["first_separation_time"] - slip
    assert delays["fast"] == pytest.approx(delays["paper"], abs=0.2e-3)
    if V == 2e-3:
        assert 3.6e-3 <= delays["paper"] <= 3.95e-3


# At the paper's speeds: shares of time, RMS of the velocity of B, 99.9 % quantiles of force and slip speed.
FIGURES = {
    1e-3: ((0.925, 0.045, 0.030), 5.1e-3, 28, None),
    2e-3: ((0.743, 0.073, 0.184), 5.1e-3, 28, 37e-3),
    5e-3: ((0.596, 0.083, 0.321), 10.1e-3, 36, 65e-3),
}


@pytest.mark.parametrize("V", FIGURES)
def test_time_fractions_lines_and_forces_at_the_papers_speeds(V):
    """Three runs: shares of time within 0.02, the RMS of the velocity of B within 10 %."""
    fractions, rms, force, slip = FIGURES[V]
    given = {"numerical_damping": "published", "settle": 0.3}
    runs = [simulate(paper_scene(V), 2.8, ramp=1e-3 * (1 + 0.013 * k), **given).summary for k in range(3)]
    for key, expected in zip(FRACTIONS, fractions, strict=True):
        assert np.mean([run[key] for run in runs]) == pytest.approx(expected, abs=0.02)
    assert np.mean([run["velocity_rms"] for run in runs]) == pytest.approx(rms, rel=0.1)
    if V == 2e-3:
        assert 3.6e-3 <= runs[0]["first_separation_time"] - runs[0]["first_slip_time"] <= 3.95e-3
    # Where bursts are rare, one run in ten has its strongest peak at a rival peak.
    assert 2.54e3 < np.median([run["dominant_frequency"] for run in runs]) < 2.69e3
    assert np.mean([run["normal_force_999"] for run in runs]) == pytest.approx(force, abs=3.0)
    if slip is not None:
        assert np.mean([run["slip_speed_999"] for run in runs]) == pytest.approx(slip, rel=0.12)
    for run in runs:
        assert run["mean_normal_force"] == pytest.approx(9.0, rel=5e-3)
        assert run["energy_residual"] < 0.01


@pytest.mark.parametrize("scene", [paper_scene(2e-3), Scene(-5e-3, 5.0, 0.2, 9.0)])
def test_the_motion_does_not_depend_on_the_stretches_it_is_taken_in(scene, monkeypatch):
    """Bit for bit, long after the first burst; the sums of the figures are added stretch by stretch."""
    runs = []
    for short, long in ((0.04, 0.2), (0.0137, 0.0091), (0.5, 0.5)):
        monkeypatch.setattr(fast, "SHORT_SEGMENT", short)
        monkeypatch.setattr(fast, "LONG_SEGMENT", long)
        runs.append(simulate(scene, 0.4, record=True, sample_rate=1e6, end_early=False))
    for run in runs[1:]:
        for name in SERIES:
            assert np.array_equal(getattr(run, name), getattr(runs[0], name))
        assert run.summary.pop("regime") == runs[0].summary["regime"]
        for name, value in run.summary.items():
            assert value == pytest.approx(runs[0].summary[name], rel=1e-9, nan_ok=True)


def test_while_stuck_a_glued_mode_rings():
    summary = simulate(paper_scene(1e-3), 2.0).summary
    assert summary["first_slip_time"] == pytest.approx(0.5e-3 + 0.1435, rel=0.01)
    glued = glued_frequencies(Rig(), 5.0)
    assert np.min(np.abs(glued / summary["stuck_frequency"] - 1.0)) < 5e-3
    assert summary["regime"] == "intermittent"
    assert all(0.025 < t < 0.09 for t in summary["stick_times"])


@pytest.mark.slow
@pytest.mark.parametrize("V", FIGURES)
def test_the_published_scheme_at_the_papers_speeds(V):
    expected, rms, force, _ = FIGURES[V]
    summary = simulate(paper_scene(V), 2.8, "paper", settle=0.3).summary
    assert summary["first_slip_time"] == pytest.approx(0.5e-3 + 0.1435e-3 / V, rel=0.01)
    if V < 5e-3:
        assert 3.6e-3 <= summary["first_separation_time"] - summary["first_slip_time"] <= 3.95e-3
    for key, fraction in zip(FRACTIONS, expected, strict=True):
        assert summary[key] == pytest.approx(fraction, abs=0.01)
    assert summary["mean_normal_force"] == pytest.approx(9.0, rel=5e-3)
    assert summary["velocity_rms"] == pytest.approx(rms, rel=0.05)
    assert 2.54e3 < summary["dominant_frequency"] < 2.69e3
    assert summary["normal_force_999"] == pytest.approx(force, abs=3.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["2 mm/s", "theta 10"])
def test_fast_agrees_with_the_published_scheme_in_its_statistics(name):
    """Two scenes of the table that `python -m tests.benchmarks.ensembles` makes."""
    for key, difference, allowed in compare(members(name, "paper", 2), members(name, "fast", 6)):
        assert abs(difference) <= allowed, key


# What every run must do.


def test_a_record_obeys_the_contact_law(vibrating):
    state, N, T = vibrating.state, vibrating.normal_force, vibrating.tangential_force
    assert {0, 1, 2} == set(np.unique(state))
    assert np.all(N >= 0.0)
    assert np.all(N[state == 0] == 0.0)
    assert np.all(T[state == 0] == 0.0)
    assert np.all(np.abs(T) <= 0.2 * N * (1.0 + 1e-12))
    sliding = state == 2
    assert np.abs(T[sliding]) == pytest.approx(0.2 * N[sliding], rel=1e-12)
    assert np.all(T[sliding] * vibrating.slip_velocity[sliding] <= 0.0)
    assert np.max(np.abs(vibrating.slip_velocity[state == 1])) < 1e-9


def differences(run):
    """Shares of time and mean normal force of a record less those of its summary."""
    summary, settled = run.summary, run.time > run.summary["first_slip_time"] + 0.1
    shares = [np.mean(run.state[settled] == k) - summary[key] for key, k in zip(FRACTIONS, (1, 2, 0), strict=True)]
    return [*shares, run.normal_force[settled].mean() / summary["mean_normal_force"] - 1.0]


def test_a_record_is_what_the_summary_speaks_of(vibrating):
    # Samples of one chaotic run are off by up to .001 (standard deviation of 12 runs).
    others = [simulate(paper_scene(V), 1.0, record=True, sample_rate=50e3) for V in (1.999e-3, 2.001e-3)]
    assert np.abs(np.mean([differences(run) for run in (vibrating, *others)], axis=0)).max() < 2e-3
    summary, t = vibrating.summary, vibrating.time
    settled = t > summary["first_slip_time"] + 0.1
    # Sampled twice as often it would differ by up to half a percent.
    assert vibrating.velocity_B[settled].std() == pytest.approx(summary["velocity_rms"], rel=1e-9)
    assert t[1] - t[0] == pytest.approx(2e-5, rel=0.1)
    assert t[-1] == pytest.approx(1.0, abs=2e-5)


def test_the_same_scene_has_the_same_bits_on_threads():
    scenes = [Scene(V, theta, 0.2, 9.0) for V in (5e-3, 8e-3) for theta in (3.0, 5.0, 8.0)]
    alone = [simulate(scene, 0.1, record=True) for scene in scenes]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda scene: simulate(scene, 0.1, record=True), scenes))
    for one, other in zip(alone, together, strict=True):
        assert_same_run(one, other)


def test_memory_does_not_grow_with_duration_unless_recorded():
    simulate(paper_scene(5e-3), 0.3)
    peaks = []
    # Four seconds hold stretches of full length.
    for duration in (4.0, 16.0):
        tracemalloc.start()
        run = simulate(paper_scene(5e-3), duration)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert all(len(getattr(run, name)) == 0 for name in SERIES)
    assert peaks[1] < 1.1 * peaks[0]


@pytest.mark.parametrize("given", [{}, {"step": 2.5e-6, "cutoff": 75e3}, {"step": 0.5e-6, "cutoff": 75e3}])
def test_without_a_drive_worth_the_name_the_rig_stays_at_rest(given):
    result = simulate(Scene(1e-9, 5.0, 0.2, 9.0), 5e-3, record=True, **given)
    assert result.normal_force == pytest.approx(9.0, rel=1e-8 if given else 1e-6)
    assert result.summary["regime"] == "undecided"


HARD = [("fast", 0.05, seed) for seed in range(24)]
# Beyond the critical friction.
REFUSED = {1, 8, 14}
HARD += [("exact", 0.005, seed) for seed in range(40, 48)] + [("paper", 0.002, seed) for seed in range(52, 60)]


@pytest.mark.parametrize(("method", "duration", "seed"), HARD)
def test_hard_scenes_end_with_an_answer_or_an_error_that_names_them(method, duration, seed):
    rng = np.random.default_rng(seed)
    scene = Scene(
        float(10 ** rng.uniform(-6, 0)) * rng.choice([-1.0, 1.0]),
        float(rng.uniform(-60.0, 60.0)),
        float(rng.uniform(0.0, 3.0 if method == "fast" else 2.0)),
        float(10 ** rng.uniform(-2, 4)),
    )
    ramp = float(rng.choice([0.0, 1e-3]))
    assert (scene.mu >= critical_mu(Rig(), scene.theta, method)) == (seed in REFUSED)
    if seed in REFUSED:
        with pytest.raises(ContactError, match=f"mu = {scene.mu:g}, ") as caught:
            simulate(scene, duration, method, ramp=ramp)
        assert caught.value.scene == scene
        return
    result = simulate(scene, duration, method, record=True, ramp=ramp, settle=0.0)
    for name in SERIES:
        assert np.isfinite(getattr(result, name)).all()
    assert np.all(result.normal_force >= 0.0)
    if method != "paper":
        cone = scene.mu * result.normal_force * (1 + 1e-9)
        assert np.all(np.abs(result.tangential_force) <= cone)
    assert sum(result.summary[key] for key in FRACTIONS) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("method", "termination"),
    [("fast", "absorbing"), ("fast", "elastic"), ("fast", "none"), ("paper", "absorbing")],
)
def test_beyond_the_critical_friction_a_method_refuses(method, termination):
    critical = critical_mu(Rig(), 30.0, method, termination=termination)
    below, above = (Scene(0.1, 30.0, critical * factor, 9.0) for factor in (1 - 1e-6, 1 + 1e-6))
    cutoff = None if method == "paper" else default_cutoff(Rig())
    simulate(below, 1e-4, method, termination=termination, cutoff=cutoff)
    with pytest.raises(ContactError, match="Painleve") as caught:
        simulate(above, 1e-4, method, termination=termination)
    assert caught.value.scene == above
    assert f"from {critical:.6g} on" in str(caught.value)


def test_without_an_element_24_modes_lose_their_contact_force_at_1_92():
    assert critical_mu(Rig(), 5.0, cutoff=50e3, termination="none") == pytest.approx(1.92, abs=0.005)
    model = full_model(Rig(), 5.0)
    inverse = 1.0 / (1.0 + 0.8 * STEP * model.damping)
    r = STEP / TAU
    normal, cross = np.sum(model.normal**2 * inverse), np.sum(model.normal * model.tangential * inverse)
    assert critical_mu(Rig(), 5.0, "paper") == pytest.approx(normal * (1 + r) / (r * abs(cross)))


@pytest.mark.parametrize(
    ("method", "scene", "duration"),
    [
        # Through the onset; a drive that starts to slide steadily for good; the published scheme; event to event.
        ("fast", paper_scene(5e-3), 0.07),
        ("fast", Scene(-5e-3, 5.0, 0.05, 9.0), 2.0),
        ("paper", paper_scene(5e-3), 0.001),
        ("exact", paper_scene(5e-3), 0.03),
    ],
)
def test_series_at_given_times_are_those_of_every_step(method, scene, duration):
    every = simulate(scene, duration, method, record=True, sample_rate=1e9 if duration < 0.01 else 1e6)
    times = np.sort(np.concatenate([[0.0, duration], np.random.default_rng(2).uniform(0.0, duration, 3000)]))
    kept = simulate(scene, duration, method, record=True, sample_times=times)
    assert_same_summary(kept, every)
    np.testing.assert_array_equal(kept.time, times)
    for name in ("velocity_B", "normal_force", "tangential_force", "slip_velocity"):
        np.testing.assert_array_equal(getattr(kept, name), np.interp(times, every.time, getattr(every, name)))
    before = np.maximum(np.searchsorted(every.time, times, side="right") - 1, 0)
    np.testing.assert_array_equal(kept.state, every.state[before])
    assert kept.state.dtype == np.int8
    assert every.summary["settled_early"] == (duration == 2.0)


def test_switches_and_energy_converge_as_the_step_goes_to_zero():
    """Changes of contact state per second: first order, a tenth too few at 1 us; the energy residual, second.

    Means over eight runs of 1.2 s.
    """
    ramps, found = [1e-3 * (1 + 0.013 * k) for k in range(8)], []
    for step in (1e-6, 0.5e-6, 0.25e-6):
        runs = simulate_many([paper_scene(5e-3)] * 8, 1.2, step=step, cutoff=75e3, ramp=ramps)
        found.append([[run.summary[name] for run in runs] for name in ("switches_per_second", "energy_residual")])
    rates, residuals = np.mean(found, axis=2).T
    limit = 2.0 * rates[2] - rates[1]
    # `exact`: 55.4 thousand.
    assert limit == pytest.approx(55.4e3, rel=0.03)
    missed = 1.0 - rates / limit
    assert 0.0 < missed[0] < 0.16
    assert np.all(missed[1:] < 0.67 * missed[:-1])
    assert max(residuals) < 0.005
    assert residuals[2] < 0.5 * max(residuals)


@pytest.mark.parametrize("method", ["fast", "exact", "paper"])
def test_a_ramp_shorter_than_a_step_is_a_jerk(method):
    """What matters is the speed that P2 is given at once, not in how many steps."""
    jerk, *others = (
        simulate(paper_scene(1e-3), 1e-3, method, ramp=ramp, settle=0.0, record=True)
        for ramp in (0.0, 1e-9, 1e-7, 1.3e-6)
    )
    for short in others:
        assert short.summary["stick_fraction"] == pytest.approx(jerk.summary["stick_fraction"], abs=0.02)
        assert short.normal_force[-1] == pytest.approx(jerk.normal_force[-1], rel=0.02)
        assert short.tangential_force[-1] == pytest.approx(jerk.tangential_force[-1], abs=0.05)


def test_within_the_ramp_energy_balances_and_heavy_damping_does_not_make_the_contact_slip_early():
    assert simulate(paper_scene(5e-3), 0.02, ramp=0.1).summary["energy_residual"] < 0.02
    for d2 in (3e-6, 1e-4):
        scene = Scene(5e-3, 5.0, 0.2, 9.0, Rig(d2=d2))
        default, plain = (simulate(scene, 0.035, cutoff=cutoff, settle=0.0).summary for cutoff in (None, 75e3))
        assert default["first_slip_time"] == pytest.approx(plain["first_slip_time"], rel=1e-3)


def test_a_step_at_which_slip_alternates_is_refused():
    rig, mu, cutoff = Rig(replace(P1, elements=10), replace(P2, elements=30)), 2.0, 300e3
    model = reduced_model(rig, 60.0, cutoff)
    assert step_limit.stable(model, mu, model.default_step)
    with pytest.raises(ValueError, match=r"at most .* s; beyond, slip with mu = 2 is unstable") as caught:
        simulate(Scene(-0.05, -60.0, mu, 9.0, rig), 1e-3, step=0.99 * model.largest_step, cutoff=cutoff)
    limit = float(str(caught.value).split("at most ")[1].split(" s")[0])
    assert step_limit.stable(model, mu, 0.99 * limit)
    assert not step_limit.stable(model, mu, 1.01 * limit)


@pytest.mark.parametrize("method", ["fast", "exact", "paper"])
def test_a_run_that_blows_up_says_so(method, monkeypatch):
    """Steps known to be unstable are refused beforehand; here a run is told that its energy has exploded."""
    kind = {"fast": "fast.FastRun", "exact": "exact.ExactRun", "paper": "published.PaperRun"}[method]
    energies = iter([1.0])
    monkeypatch.setattr(f"fivcore.transient.{kind}.stored_energy", lambda run: next(energies, 1e9))
    scene = paper_scene(5e-3)
    with pytest.raises(DivergenceError, match=r"blown up at t = .*; scene V = 0\.005 m/s") as caught:
        simulate(scene, 1e-3, method)
    assert caught.value.scene == scene


@pytest.mark.parametrize(("n1", "n2"), [(1, 1), (2, 2), (1, 40), (30, 1)])
@pytest.mark.parametrize("method", ["fast", "exact"])
def test_coarse_meshes_run_whatever_is_left_above_the_cut_off(method, n1, n2):
    rig = Rig(replace(P1, elements=n1), replace(P2, elements=n2))
    scene = Scene(0.02, 5.0, 0.2, 9.0, rig)
    assert reduced_model(rig, 5.0).K.any() == (n1 != n2)
    if method == "exact" and n1 == n2:
        with pytest.raises(ValueError, match=r"cutoff = 117350: it keeps every mode .* or method 'fast'"):
            simulate(scene, 0.02, method)
        return
    summary = simulate(scene, 0.02, method, settle=0.0).summary
    # Over a third of a period of the head on its beam.
    assert summary["mean_normal_force"] == pytest.approx(9.0, rel=0.05)


# The reduced model.


def test_the_element_keeps_the_static_flexibility():
    full, *reduced = full_model(Rig(), 20.0), reduced_model(Rig(), 20.0, 75e3), reduced_model(Rig(), 20.0, 200e3)

    def flexibility(model):
        elastic = model.stiffness > 0.0
        return (model.shapes[:, elastic] / model.stiffness[elastic]) @ model.shapes[:, elastic].T

    for model in reduced:
        assert flexibility(model) + np.linalg.inv(model.K) == pytest.approx(flexibility(full))


@pytest.mark.parametrize("rig", [Rig(), replace(Rig(), contact_position=0.12), drawn_scene(2010, 0).rig])
def test_the_elements_damping_is_a_share_of_the_critical_one(rig):
    model = reduced_model(rig, 5.0)
    mass = np.linalg.inv(model.W)
    squares, shapes = eigh(model.K, mass)
    assert np.sqrt(squares[-1]) == pytest.approx(model.contact_frequency)
    damping = shapes[:, -1] @ model.C @ shapes[:, -1]
    assert damping == pytest.approx(2.0 * DAMPING * model.contact_frequency)


# A contact point that moves.


@pytest.mark.parametrize("method", ["fast", "paper"])
def test_moving_the_contact_point_hardly_matters_at_first(method):
    """By first slip D has moved by 0.1435 mm: first slip comes when it does with a frozen contact."""
    scene, given = Scene(20e-3, 5.0, 0.2, 9.0), {"cutoff": 75e3} if method == "fast" else {}
    frozen, *moving = (
        simulate(scene, 0.012, method, contact_motion=motion, settle=0.0, **given).summary for motion in (0, -1, 1)
    )
    for name in ("first_slip_time", "mean_normal_force"):
        assert [summary[name] for summary in moving] == pytest.approx([frozen[name]] * 2, rel=0.02)


def test_the_line_wanders_with_the_contact_point_and_the_mean_force_does_not():
    """P2's stiffness at D, and with it the unstable pair, depends on where D is."""
    scene = paper_scene(5e-3)
    towards, away = (simulate(scene, 0.4, contact_motion=motion).summary for motion in (-1, 1))
    assert towards["dominant_frequency"] < 0.97 * away["dominant_frequency"]
    for summary in (towards, away):
        assert summary["mean_normal_force"] == pytest.approx(9.0, rel=5e-3)


def test_the_mirrored_scene_moves_the_contact_the_same_way():
    one, other = (
        simulate(scene, 0.05, contact_motion=-1, record=True)
        for scene in (paper_scene(5e-3), paper_scene(5e-3).mirrored())
    )
    assert one.summary["first_separation_time"] < 0.05
    assert np.array_equal(one.normal_force, other.normal_force)
    assert np.array_equal(one.velocity_B, -other.velocity_B)


@pytest.mark.parametrize(
    ("theta", "place", "direction", "duration", "bound"),
    [
        (5.0, 0.14, 1, 0.0025, 0.01),
        (-5.0, 0.14, 1, 0.002, 1e-4),
        (5.0, 0.012, -1, 0.0025, 1e-3),
    ],
)
def test_energy_is_kept_while_the_contact_point_moves(theta, place, direction, duration, bound):
    """Over an element of P2 and more, through vibration and through steady sliding."""
    scene = Scene(1.0, theta, 0.2, 9.0, Rig(contact_position=place))
    assert simulate(scene, duration, contact_motion=direction).summary["energy_residual"] < bound


def test_the_cost_of_a_fast_contact_point_is_that_of_its_path(monkeypatch):
    """At 0.02 m/s a segment is 5 um long; a hundred times as fast it is ten times as long, and moves B as well."""
    slow, quick = (ContactMotion(Normalised.of(paper_scene(V)), 0.0, 1) for V in (0.02, 2.0))
    assert [each.segment_steps(1e-6) for each in (slow, quick)] == [250, 25]
    scene, made = Scene(2.0, -5.0, 0.2, 9.0), []
    monkeypatch.setattr(fast, "moved_model", lambda *given: made.append(given) or moved_model(*given))
    run = simulate(scene, 4e-3, contact_motion=1, record=True)
    # Two models a segment.
    path = 2.0 * (4e-3 - 0.5e-3)
    assert len(made) <= 2.0 * (path / 45e-6 + 20)
    monkeypatch.setattr(moving_contact, "MOST", 5e-6)
    fine = simulate(scene, 4e-3, contact_motion=1, record=True)
    assert len(made) > 1000
    assert np.abs(run.velocity_B - fine.velocity_B).max() < 0.02 * np.abs(fine.velocity_B).max()
