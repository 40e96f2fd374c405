"""Scenes side by side: the same bits in any company; skips over long sticks that leave what steps would have."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fivcore import ContactError, DivergenceError, Rig, Scene, critical_mu, simulate, simulate_many
from fivcore.contact.reduced import reduced_model
from fivcore.errors import SceneError
from fivcore.transient.driver import AT_ONCE
from fivcore.transient.fast import FastRun
from fivcore.transient.fast_kernel import FEW
from fivcore.transient.fast_scene import LANES
from fivcore.transient.fast_solver import frozen_solver
from fivcore.transient.normalised import Normalised
from fivcore.transient.stick_skip import skip_tables
from tests.helpers.runs import SERIES, assert_same_run, assert_same_summary

PAPERS = Scene(5e-3, 5.0, 0.2, 9.0)
COMPANY = [
    PAPERS,
    Scene(1e-3, 5.0, 0.2, 9.0),
    Scene(2e-2, 12.0, 0.35, 9.0),
    Scene(5e-3, -5.0, 0.2, 9.0),
    Scene(5e-3, 0.0, 0.3, 2.0),
    Scene(5e-3, 5.0, 0.2, 9.0, Rig(contact_position=0.065)),
]


@pytest.mark.parametrize("count", [1, 2, FEW, LANES, LANES + 1, AT_ONCE, AT_ONCE + 1, AT_ONCE + 5])
def test_a_scene_has_the_same_bits_in_any_company(count):
    alone = simulate(PAPERS, 0.06, record=True, sample_rate=50e3)
    beside = [COMPANY[(k + count) % len(COMPANY)] for k in range(count - 1)]
    place = count // 2
    many = [*beside[:place], PAPERS, *beside[place:]]
    ramps = [1e-3 if k == place else 1e-3 * (1.0 + 0.1 * k) for k in range(count)]
    assert_same_run(alone, simulate_many(many, 0.06, ramp=ramps, record=True, sample_rate=50e3)[place])


@pytest.mark.parametrize("method", ["fast", "exact", "paper"])
def test_every_scene_of_a_batch_is_the_scene_alone(method):
    scenes = COMPANY if method == "fast" else COMPANY[:3:2]
    durations = [0.05 + 0.01 * k if method == "fast" else 2e-3 for k in range(len(scenes))]
    for run, scene, duration in zip(simulate_many(scenes, durations, method), scenes, durations, strict=True):
        assert_same_run(run, simulate(scene, duration, method))


def test_the_order_of_a_batch_does_not_matter():
    """More scenes than are under way at once; those that wait come in whatever place becomes free."""
    many = [COMPANY[k % len(COMPANY)] for k in range(AT_ONCE + 8)]
    durations = [0.02 + 0.002 * (k % 9) for k in range(len(many))]
    order = np.random.default_rng(0).permutation(len(many))
    straight = simulate_many(many, durations)
    mixed = simulate_many([many[k] for k in order], [durations[k] for k in order])
    for k, run in zip(order, mixed, strict=True):
        assert_same_run(run, straight[k])


PAINLEVE = Scene(5e-3, 5.0, 1.01 * critical_mu(Rig(), 5.0, termination="none"), 9.0)


@pytest.mark.parametrize(
    ("method", "failing", "duration", "given", "error"),
    [
        ("fast", PAINLEVE, 0.02, {"termination": "none"}, ContactError),
        ("exact", Scene(5e-3, 5.0, 0.2, 9.0, Rig(head_mass=1e7)), 1e-3, {}, DivergenceError),
        ("fast", Scene(0.1, 5.0, 6.26, 9.0), 0.04, {"contact_motion": 1}, ContactError),
    ],
)
def test_a_scene_that_fails_leaves_the_others_alone(method, failing, duration, given, error):
    """Before its first step or on its way."""
    runs = simulate_many([PAPERS, failing, COMPANY[2]], duration, method, **given)
    assert isinstance(runs[1], error)
    assert runs[1].scene == failing
    assert f"V = {failing.V:g} m/s" in str(runs[1])
    assert_same_run(runs[0], simulate(PAPERS, duration, method, **given))
    assert_same_run(runs[2], simulate(COMPANY[2], duration, method, **given))


def test_a_scene_that_blows_up_leaves_the_others_alone(monkeypatch):
    calm = FastRun.calm

    def blown_up(run, floor):
        return calm(run, floor) and not (run.scene == Normalised.of(COMPANY[2]) and run.time > 0.03)

    alone = [simulate(scene, 0.06) for scene in (PAPERS, COMPANY[1])]
    monkeypatch.setattr(FastRun, "calm", blown_up)
    runs = simulate_many([PAPERS, COMPANY[2], COMPANY[1]], 0.06)
    assert isinstance(runs[1], DivergenceError)
    assert runs[1].scene == COMPANY[2]
    assert_same_run(runs[0], alone[0])
    assert_same_run(runs[2], alone[1])


def test_what_is_recorded_of_one_is_recorded_of_all():
    """Only durations, ramps, settling times and states are lists of each scene's own."""
    two, names, times = [PAPERS, COMPANY[1]], ["velocity_B", "state"], [0.0, 0.011, 0.0123, 0.05]
    for run, scene in zip(simulate_many(two, 0.05, record=names), two, strict=True):
        assert len(run.velocity_B) == len(run.state) == len(run.time) == 5000
        assert not len(run.normal_force)
        assert_same_run(run, simulate(scene, 0.05, record=names))
    for run, scene in zip(simulate_many(two, 0.05, record=True, sample_times=times), two, strict=True):
        assert run.time.tolist() == times
        assert_same_run(run, simulate(scene, 0.05, record=True, sample_times=times))
    # As long as the scenes are many, too.
    for run in simulate_many(two, 0.05, record=names, sample_times=times[:2]):
        assert run.time.tolist() == times[:2]


def test_no_scenes_are_no_runs_and_an_option_that_is_none_is_named():
    assert simulate_many([], 0.01) == []
    with pytest.raises(TypeError, match=r"'ramps'"):
        simulate_many([PAPERS], 0.01, ramps=1e-3)


# What is recorded changes nothing.


def slips_in(step_asked, **given):
    """A scene that first slips in a step, counted in the steps of `given`."""
    low, high = 5e-3, 20e-3
    for _ in range(60):
        scene = Scene(0.5 * (low + high), 5.0, 0.2, 9.0)
        found = round(simulate(scene, 0.04, **given).summary["first_slip_time"] / given["step"] - 0.5)
        if found == step_asked:
            return scene
        low, high = (scene.V, high) if found > step_asked else (low, scene.V)
    raise AssertionError(f"no scene slips first in step {step_asked}")


@pytest.mark.parametrize("offset", [-1, 0, 1])
def test_a_first_slip_at_the_end_of_a_segment_of_the_record(offset):
    # Where it starts gently, the contact does not jump over a step.
    given = {"cutoff": 75e3, "step": 2e-6, "ramp": 1e-2}
    segment = 10 * 1024
    scene = slips_in(segment + offset, **given)
    plain = simulate(scene, 0.15, **given)
    whole = simulate(scene, 0.15, record=True, sample_rate=5e5, **given)
    assert np.array_equal(np.flatnonzero(whole.state != 1)[:1], [segment + offset])
    assert_same_summary(plain, whole)


@pytest.mark.parametrize("given", [{"contact_motion": 1}, {"cutoff": 75e3}, {}])
@pytest.mark.parametrize("theta", [5.0, -5.0])
def test_a_record_changes_no_bit_of_a_moving_contact_or_of_steady_sliding(theta, given):
    """At 5 degrees it vibrates; at -5, so well damped, it slides steadily before the end."""
    scene = Scene(5e-3, theta, 0.2, 9.0, Rig(d1=200.0))
    duration = 0.06 if given.get("contact_motion") else 0.5
    plain = simulate(scene, duration, **given)
    assert plain.summary["settled_early"] == (theta < 0.0 and "contact_motion" not in given)
    assert_same_summary(plain, simulate(scene, duration, record=["state"], sample_rate=5e5, **given))


@pytest.mark.parametrize("rate", [1e3, 1e7])
def test_recorded_or_not_the_bits_are_the_same(rate):
    """Through the onset, sticks, slip and separation, and steps of which each is recorded."""
    for plain, run in zip(
        simulate_many(COMPANY, 0.15), simulate_many(COMPANY, 0.15, record=["state"], sample_rate=rate), strict=True
    ):
        assert_same_summary(plain, run)


# Skips.


@given(st.floats(3e-4, 3e-3), st.floats(1.0, 12.0), st.floats(0.05, 0.5))
@settings(max_examples=12, deadline=None)
def test_a_skip_ends_before_stick_does(V, theta, mu):
    """First slip, which a skip that went too far would delay, at the same step; and the motion up to there."""
    scene = Scene(V, theta, mu, 9.0)
    duration = min(1.2 * 0.1435e-3 * mu / 0.2 / V, 0.25)
    every, skipped = (
        simulate(scene, duration, leap=leap, record=True, sample_rate=20e3, cutoff=75e3) for leap in (False, True)
    )
    assert every.summary["first_slip_time"] == pytest.approx(
        skipped.summary["first_slip_time"], abs=1e-9, nan_ok=True
    )
    slip = every.summary["first_slip_time"]
    stuck = every.time < (slip if slip > 0.0 else np.inf)
    for name, unit in (("velocity_B", V), ("normal_force", 9.0), ("tangential_force", 9.0)):
        apart = np.abs(getattr(every, name) - getattr(skipped, name))[stuck]
        assert apart.max() < 1e-7 * unit, name
    assert np.array_equal(every.state[stuck], skipped.state[stuck])


def test_what_a_skip_counts_is_what_steps_count():
    """A stick that lasts the whole run: means, spectra and energies."""
    scene = Scene(2e-4, 5.0, 0.2, 9.0)
    every, skipped = (simulate(scene, 0.3, leap=leap, settle=0.05).summary for leap in (False, True))
    assert skipped["regime"] == every["regime"]
    for name in ("stick_fraction", "mean_normal_force", "velocity_rms", "stuck_frequency"):
        assert skipped[name] == pytest.approx(every[name], rel=1e-6, nan_ok=True), name
    for name in ("normal_force_999", "max_normal_force"):
        assert skipped[name] == pytest.approx(every[name], rel=1e-3), name
    assert skipped["max_slip_speed"] == every["max_slip_speed"] == 0.0
    assert max(skipped["energy_residual"], every["energy_residual"]) < 1e-2


def test_a_skip_is_recorded_like_steps():
    """At any rate, and with the same bits of everything else as without a record."""
    scene = Scene(1e-3, 5.0, 0.2, 9.0)
    plain = simulate(scene, 0.3)
    every = simulate(scene, 0.14, record=True, sample_rate=1e6, leap=False)
    for rate in (1e6, 33e3):
        skipped = simulate(scene, 0.3, record=True, sample_rate=rate)
        assert_same_summary(plain, skipped)
        held = skipped.time[skipped.time < 0.13]
        assert np.allclose(np.diff(held), held[1] - held[0], rtol=1e-9)
        assert np.interp(held, every.time, every.velocity_B) == pytest.approx(
            skipped.velocity_B[: len(held)], abs=1e-9
        )


def test_where_a_mode_is_gone_within_a_step_there_are_no_skips():
    scene = Scene(0.2, 5.0, 0.2, 9.0, Rig(d2=1e-4))
    every, skipped = (
        simulate(scene, 5e-3, leap=leap, record=True, sample_rate=1e7, settle=0.0, cutoff=75e3, step=9.2e-8)
        for leap in (False, True)
    )
    for name in SERIES:
        assert np.all(np.isfinite(getattr(skipped, name)))
    assert np.array_equal(every.velocity_B, skipped.velocity_B)


def test_without_eigenvectors_that_decay_there_are_no_skips():
    rig = Rig(d1=0.0, d2=0.0)
    model = reduced_model(rig, 5.0)
    assert skip_tables(frozen_solver(model, 0.2, model.default_step), 16).count > 0
    rigid = reduced_model(Rig(), 5.0, 75e3, "none")
    assert skip_tables(frozen_solver(rigid, 0.2, rigid.default_step), 16) is None
    every, skipped = (simulate(Scene(2e-3, 5.0, 0.2, 9.0, rig), 0.09, leap=leap).summary for leap in (False, True))
    assert skipped["first_slip_time"] == pytest.approx(every["first_slip_time"], abs=2e-6)


def test_a_skip_over_many_real_eigenvalues():
    """Overdamped modes have no conjugate: there are more eigenvalues to keep than modes.

    The slowest takes seconds to decay, so that rounding in its amplitude lasts: some 1e-8 of the velocity.
    """
    rig = Rig(d1=1e5)
    model = reduced_model(rig, 5.0)
    tables = skip_tables(frozen_solver(model, 0.2, model.default_step), 10)
    assert tables.count > tables.size
    every, skipped = (simulate(Scene(5e-4, 5.0, 0.2, 9.0, rig), 0.25, leap=leap).summary for leap in (False, True))
    assert skipped["velocity_rms"] == pytest.approx(every["velocity_rms"], rel=2e-7, abs=0.0)


# Every place of every array.

WATCHED = """
import json
from fivcore import Scene, simulate_many

slow, quick = Scene(1e-3, 5.0, 0.2, 9.0), Scene(0.02, 5.0, 0.2, 9.0)
given = {"record": True, "sample_rate": 20e3, "min_stick": 1e-5, "settle": 0.0}
runs = simulate_many([slow, quick, Scene(5e-3, 12.0, 0.3, 9.0)], [0.06, 0.0105, 0.0105], **given)
runs += simulate_many([slow, quick], 0.0105, cutoff=75e3, ramp=0.0, **given)
runs += simulate_many([quick, Scene(0.02, -5.0, 0.2, 9.0)], 0.0105, contact_motion=1, **given)
runs += simulate_many([Scene(5e-3, -5.0, 0.2, 9.0)], 1.0, **given)
runs += simulate_many([quick], 0.0105, "exact", **given)
runs += simulate_many([quick], 2e-3, "paper", **given)
runs += simulate_many([quick], 5e-4, "paper", contact_motion=1, **given)
told = [{name: getattr(value, "tolist", lambda: value)() for name, value in run.summary.items()} for run in runs]
for figures, run in zip(told, runs):
    figures["states"] = sorted(set(run.state.tolist()))
print(json.dumps(told))
"""


def watched(folder, **environment):
    """Summaries of a few short runs of a process of its own."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder)} | environment
    return json.loads(subprocess.check_output([sys.executable, "-c", WATCHED], text=True, env=environment))


@pytest.mark.slow
def test_compiled_now_or_before_the_bits_are_the_same(tmp_path):
    compiled, loaded = (json.dumps(watched(tmp_path)) for _ in range(2))
    assert loaded == compiled


@pytest.mark.slow
def test_no_kernel_leaves_its_arrays(tmp_path):
    """Ramp, onset, skip, slip, separation, record, moving contact, steady sliding: with every index checked."""
    usual, checked = watched(tmp_path / "usual"), watched(tmp_path / "checked", NUMBA_BOUNDSCHECK="1")
    assert {state for figures in usual for state in figures["states"]} == {0, 1, 2}
    assert len(usual) == len(checked)
    for one, other in zip(usual, checked, strict=True):
        assert set(one) == set(other)
        for name, value in one.items():
            if isinstance(value, (str, bool)):
                assert other[name] == value, name
            else:
                assert other[name] == pytest.approx(value, rel=1e-5, abs=1e-9, nan_ok=True), name


@pytest.mark.parametrize(("rig", "named"), [(Rig(d2=100.0), "d2 = 100:"), (Rig(d1=1e12), "d1 = 1e+12,")])
def test_damping_that_needs_too_many_steps_is_refused_and_leaves_the_others_alone(rig, named):
    scene = Scene(2e-3, 5.0, 0.2, 9.0)
    alone = simulate(scene, 2e-3)
    refused, other = simulate_many([replace(scene, rig=rig), scene], 2e-3)
    assert isinstance(refused, SceneError)
    assert named in str(refused)
    assert "must be at most 9.9e+10 1/s over this duration" in str(refused)
    assert refused.scene.rig == rig
    np.testing.assert_equal(other.summary | {"wall_time": 0.0}, alone.summary | {"wall_time": 0.0})
    with pytest.raises(ValueError, match=r"^step = 1e-12: it must be at least 2e-11 s over this duration"):
        simulate(scene, 2e-3, step=1e-12)
