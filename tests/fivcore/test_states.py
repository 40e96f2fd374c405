"""States: runs that go on from the end of another, and starts in slip, in stick and in separation."""

import gc
import itertools
import pickle
import weakref
from dataclasses import replace

import numpy as np
import pytest

from fivcore import Friction, InputError, Rig, Scene, State, Structure, Until, simulate
from fivcore.contact.reduced import full_model
from fivcore.transient.fast.run import FastRun
from fivcore.transient.normalised import Normalised
from fivcore.transient.options import RunOptions
from fivcore.transient.statistics import first_counted
from fivcore.transient.stepped import duplicate

SCENE = Scene(2e-3, 5.0, 0.2, 9.0)
SLIDING = replace(SCENE, mu=0.05)
SERIES = ("velocity_B", "normal_force", "tangential_force", "slip_velocity", "state")


def parts(scene, times, duration, method="fast", **options):
    """A run in one piece, and the same in pieces that end at these times."""
    options = {"record": True, "sample_rate": None} | options
    whole, state, pieces = simulate(scene, duration, method, **options), None, []
    for begin, end in zip([0.0, *times], [*times, duration], strict=True):
        pieces.append(simulate(scene, end - begin, method, initial=state, **options))
        state = pieces[-1].final_state
    return whole, pieces


@pytest.mark.parametrize(("scene", "options"), [
    # In the ramp, before the first slip, in the onset, in the burst; from rest without a ramp.
    (SCENE, {"skip_sticks": False}),
    (replace(SCENE, V=-5e-3), {"skip_sticks": False}),
    (replace(SCENE, friction=Friction(0.6, 0.01)), {"skip_sticks": False}),
    (SCENE, {"skip_sticks": False, "ramp": 0.0, "cutoff": 60e3}),
    (SLIDING, {"skip_sticks": False, "end_early": False, "numerical_damping": "published"}),
])  # fmt: skip
def test_a_run_in_pieces_has_the_bits_of_one(scene, options):
    first = simulate(scene, 0.2, **options).summary["first_slip_time"]
    # Whole numbers of steps.
    times = [2e-5 * round(t / 2e-5) for t in (4e-4, 0.3 * first, first - 2e-4, first + 3e-4, first + 0.03)]
    whole, pieces = parts(scene, times, times[-1] + 0.02, **options)
    for name in ("time", *SERIES):
        joined = np.concatenate([getattr(piece, name) for piece in pieces])
        assert np.array_equal(joined, getattr(whole, name)), name
    a, b = pieces[-1].final_state, whole.final_state
    assert np.array_equal(a.displacement, b.displacement)
    assert np.array_equal(a.velocity, b.velocity)
    assert (a.contact, a.time, a.running) == (b.contact, b.time, True)
    assert not pieces[0].final_state.running or options.get("ramp") == 0.0


@pytest.mark.parametrize(("scene", "options", "phases"), [
    # Through the ramp, the onset and bursts, with skips; sliding that is proved to last.
    (replace(SCENE, V=5e-3), {"record": ("velocity_B",), "sample_rate": None}, 5),
    (replace(SLIDING, V=0.05), {"settle": 0.0}, 3),
])  # fmt: skip
def test_a_run_is_its_state_and_a_copy_goes_on_alike(scene, options, phases):
    run, seen, copies = FastRun(Normalised.of(scene), RunOptions(duration=0.16, **options)), set(), []
    while not run.done:
        copies.append(duplicate(run))
        seen.add(run.phase)
        for each in (run, copies[-1]):
            each.advance()
            each.written = [(part.t, part.samples, part.sticks, part.rows) for part in each.segments]
        for one, other in zip(run.written, copies[-1].written, strict=True):
            assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
    for early in copies[:3]:
        while not early.done:
            early.advance()
            assert len(list(early.segments))
    assert len(seen) == phases
    for each in (*copies[:3], copies[-1]):
        assert each.record.tobytes() == run.record.tobytes()
        assert each.blocks.tobytes() == run.blocks.tobytes()
        assert (each.now, each.may_settle, each.models) == (run.now, run.may_settle, run.models)


def test_skips_and_the_published_scheme_go_on_with_their_bits():
    # A skip crosses neither these times nor the start of the statistics.
    grid = 1024 * 20e-6
    whole, pieces = parts(replace(SCENE, V=1e-3), [3 * grid, 11 * grid], 16 * grid, settle=0.0)
    assert np.array_equal(np.concatenate([p.velocity_B for p in pieces]), whole.velocity_B)
    whole, pieces = parts(SCENE, [5e-4, 1.7e-3], 3e-3, "paper", ramp=1e-3)
    assert np.array_equal(np.concatenate([p.normal_force for p in pieces]), whole.normal_force)
    whole, pieces = parts(SCENE, [5e-4, 1.7e-3], 3e-3, "exact", ramp=1e-3)
    np.testing.assert_allclose(np.concatenate([p.normal_force for p in pieces]), whole.normal_force, rtol=1e-10)


@pytest.mark.parametrize("method", ["fast", "exact", "paper"])
def test_resampled_series_are_linear_across_a_stop(method):
    """The stop is in a burst, and a sample in the half step after it."""
    scene, rate = replace(SCENE, V=2e-2), 77e3
    steps = {"fast": None, "exact": 2e-6, "paper": None}[method]
    stop = 850 / rate
    whole, pieces = parts(scene, [stop], stop + 2e-4, method, sample_rate=rate, step=steps, skip_sticks=True)
    join = len(pieces[0].time)
    joined = np.concatenate([piece.normal_force for piece in pieces])
    at = np.searchsorted(pieces[1].time, pieces[0].final_state.time)
    # The last sample before the stop lies beyond the last step of its run.
    others = np.arange(len(joined)) != join - 1
    assert pieces[1].time[at] - pieces[0].final_state.time < 1.0 / rate
    np.testing.assert_allclose(joined[others], whole.normal_force[others], rtol=1e-9, atol=1e-9)


def test_a_chain_of_runs_does_not_keep_them():
    state, first = None, None
    for _ in range(30):
        motion = simulate(SCENE, 1e-3, initial=state)
        state = motion.final_state
        first = first or weakref.ref(state.origin[1])
    gc.collect()
    assert first() is None
    assert len(pickle.dumps(motion)) < 2e6


def test_a_changed_function_changes_the_model():
    factor = {"K": 1.0}

    def softer(model):
        return replace(model, K=factor["K"] * model.K, C=factor["K"] * model.C)

    def share(of_K):
        factor["K"] = of_K
        return simulate(SCENE, 0.1, settle=0.03, modify=softer).summary["stick_fraction"]

    found = [share(each) for each in (1.0, 0.5, 1.0)]
    assert found[0] == found[2] != found[1]


@pytest.mark.parametrize(("method", "time"), [("fast", 5e-4), ("fast", 0.02), ("exact", 2e-3)])
def test_modifications_that_make_equal_models_go_on_and_others_do_not(method, time):
    """Neither another function that does the same nor the same function that does something else misleads."""
    factor = {"K": 1.0}

    def softer(model):
        return replace(model, K=factor["K"] * model.K, C=factor["K"] * model.C)

    end = simulate(SCENE, time, method, modify=softer).final_state
    for modify, goes_on in ((softer, True), (lambda model: softer(model), True), (None, True), (list, False)):
        if modify is list:
            factor["K"] = 0.5
            modify = softer
        run = simulate(SCENE, 1e-4, method, initial=end, modify=modify, record=True, sample_rate=None)
        assert (run.time[0] >= time * (1.0 - 1e-9)) == goes_on


def test_statistics_of_a_piece_are_its_own():
    one = simulate(SCENE, 1.0)
    two = simulate(SCENE, 1.0, initial=one.final_state)
    again = simulate(SCENE, 1.0, initial=one.final_state)
    for name in ("stick_fraction", "velocity_rms"):
        assert two.summary[name] == pytest.approx(one.summary[name], rel=0.1)
        assert two.summary[name] == again.summary[name]
    assert two.summary["simulated_time"] == pytest.approx(1.0)
    assert two.summary["energy_residual"] < 5e-3
    assert 1.0 <= two.summary["first_slip_time"] < 1.1
    assert simulate(SCENE, Until(0.05, 0.3, 4.0), initial=one.final_state).summary["simulated_time"] < 4.0


def with_modes_alone(scene, end, method="fast"):
    """What a run of 0.1 ms from a state misses without the run that the state comes from; and both contacts."""
    same, modes = (
        simulate(scene, 1e-4, method, initial=start, record=True, sample_rate=None)
        for start in (end, replace(end))
    )
    sizes = {"normal_force": 9.0, "velocity_B": max(np.abs(same.velocity_B).max(), 1e-3)}
    errors = [np.abs(getattr(same, name) - getattr(modes, name)).max() / size for name, size in sizes.items()]
    return errors, (same.state[0], modes.state[0])


@pytest.mark.parametrize(("method", "scene", "time", "error"), [
    ("fast", SCENE, 0.031, 3e-4), ("fast", SCENE, 0.1003, 3e-4),
    ("fast", SLIDING, 0.3, 3e-4), ("exact", SCENE, 0.01, 1e-9), ("paper", SCENE, 0.0101, 3e-3),
])  # fmt: skip
def test_modes_alone_go_on_with_the_motion(method, scene, time, error):
    # Without its run a state is what all methods share; order 2 in the step of "fast" remains.
    end = simulate(scene, time, method).final_state
    errors, contacts = with_modes_alone(scene, end, method)
    assert contacts == (end.contact, end.contact)
    assert max(errors) < error


def test_modes_alone_go_on_with_a_vibration():
    """In the median of 15 starts in chaotic motion: how much one misses depends on how near an impact is."""
    state, found = simulate(SCENE, 0.21).final_state, []
    for _ in range(15):
        found.append(with_modes_alone(SCENE, state)[0])
        state = simulate(SCENE, 3.7e-3, initial=state).final_state
    assert np.all(np.median(found, axis=0) < 1e-2)


def test_steady_sliding_goes_on_at_another_speed_and_by_every_method():
    end = replace(simulate(SLIDING, 1.0).final_state)
    assert end.contact == 2
    assert State.of(SLIDING, end.displacement, end.velocity).contact == 2
    for method in ("fast", "exact", "paper"):
        run = simulate(replace(SLIDING, V=3e-3), 2e-3, method, initial=end, record=True)
        np.testing.assert_allclose(run.slip_velocity, -3e-3, rtol=1e-3)
        np.testing.assert_allclose(run.normal_force, 9.0, rtol=1e-3)
    run = simulate(SLIDING, 0.5, initial=end)
    assert run.summary["regime"] == "steady sliding"
    assert run.summary["first_slip_time"] == 0.0


def test_a_state_of_the_mirrored_scene_is_refused():
    """Its modes are those of the other inclination, or of the mirrored structure."""
    own = Structure.from_modes([300.0, 500.0], [0.4, 0.1], [-0.9, 0.7], load=[-0.4, -0.1], damping_ratio=0.01)
    for scene in (SCENE, Scene(2e-3, 0.0, 0.2, 9.0, own)):
        other = replace(scene, V=-scene.V)
        for one, two in ((scene, other), (other, scene)):
            with pytest.raises(InputError, match=r"initial: it is the end of a run with the other sign of V"):
                simulate(two, 1e-3, initial=simulate(one, 1e-3).final_state)
        end = simulate(scene.mirrored(), 1e-3).final_state
        for same in (scene, scene.mirrored()):
            assert simulate(same, 1e-3, initial=end).summary["simulated_time"] == pytest.approx(1e-3)


def test_the_contact_follows_from_gap_and_rate():
    rig, full = Rig(), full_model(Rig(), 5.0)
    q, still = 9.0 * full.static_equilibrium, np.zeros(len(full.normal))
    assert State.of(SCENE, q, still).contact == 2
    up = 1e-6 * full.normal / (full.normal @ full.normal)
    assert State.of(SCENE, q + up, still).contact == 0
    moving = SCENE.V * full.tangential / (full.tangential @ full.tangential)
    assert State.of(SCENE, q, moving).contact == 1
    run = simulate(SCENE, 1e-4, initial=State.of(SCENE, q + up, still), record=True, sample_rate=None)
    assert run.state[0] == 0
    assert run.summary["first_separation_time"] == 0.0
    with pytest.raises(InputError, match=r"modal velocities of shape \(3,\)"):
        simulate(Scene(2e-3, 5.0, 0.2, 9.0, rig), 1e-3, initial=State.of(SCENE, q, still[:3]))


def test_a_structure_keeps_what_its_modes_leave_out():
    n = 40
    K = 1e6 * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    own = Structure.from_matrices(0.1 * np.eye(n), K, normal={n - 1: 1.0}, tangential={n - 2: 1.0},
                                  load={n - 1: -1.0}, damping_ratio=0.01, fmax=300.0)  # fmt: skip
    scene = Scene(0.01, 0.0, 0.3, 10.0, own)
    whole, pieces = parts(scene, [0.1], 0.2, skip_sticks=False, step=2e-5)
    assert np.array_equal(np.concatenate([p.normal_force for p in pieces]), whole.normal_force)
    end = pieces[0].final_state
    assert len(end.displacement) > len(own.frequency)
    run = simulate(scene, 1e-3, initial=replace(end), record=True, sample_rate=None, step=2e-5)
    assert run.normal_force[0] == pytest.approx(pieces[1].normal_force[0], rel=2e-2)


def test_no_sample_of_the_statistics_is_older_than_their_counters():
    """Settling lasts a whole number of steps by default, 0.1 s, so that rounding decides ties."""
    rng = np.random.default_rng(0)
    for every, read_at in itertools.product((1, 7, 11), (0.5, 1.0)):
        step = 20e-6 / every
        t = (np.arange(30_000) * every + read_at) * step
        for slip in rng.integers(0, 20_000, 500) + read_at:
            settled_from = slip * step + 5000 * every * step
            assert first_counted(settled_from, step, read_at) <= np.searchsorted(t, settled_from) * every
            assert first_counted(settled_from, step, read_at) >= slip - read_at + 5000 * every
