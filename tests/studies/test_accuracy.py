"""Run time against error: the baselines are what they say, errors are errors, and scatter is scatter."""

import re
import subprocess
import sys
import threading
import time
from contextlib import nullcontext
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.interpolate import CubicSpline

from fivcore import Beam, DivergenceError, Rig, Scene, Transient, flutter_onsets, simulate, sliding_modes
from fivcore.contact.reduced import TERMINATIONS, default_cutoff, full_model, reduced_model
from studies import tables
from studies.accuracy import errors, figure, findings, runs, solve_ivp, study
from studies.accuracy import settings as choices
from studies.accuracy.pseudo_modes import with_pseudo_modes
from studies.accuracy.settings import (
    CONVERGED,
    DEFAULT,
    EVENTS,
    EXACT,
    FAST,
    METHODS,
    MODEL,
    OPTIONS,
    OWN,
    PAPER,
    PUBLISHED,
    SCENES,
)
from studies.accuracy.study import STUDY
from studies.motion import ensembles
from studies.plotting import figures
from tests.helpers.reduced_sliding import onset_of

RAMP = 1e-3
# A mesh on which the published scheme is quick, and a speed at which the surfaces slip and part within 10 ms.
COARSE = Rig(Beam(0.05, 0.010, 0.0015, 185e9, 7900.0, 8), Beam(0.15, 0.015, 0.0030, 185e9, 7900.0, 20))
QUICK = Scene(0.05, 5.0, 0.2, 9.0, COARSE)
SMALL = {
    "duration": 0.25,
    "members": 3,
    "members_expensive": 1,
    "p1_elements": 8,
    "p2_elements": 20,
    "scene": "5 mm/s",
}
PAIRS = [(method, name) for name, option in OPTIONS.items() for method in option.methods]
POINTS = [(method, name, scene) for method, name in PAIRS for scene in OPTIONS[name].scenes(method)]


# The baseline that is made with SciPy.


def slip_error(run, reference):
    """Largest error of the velocity of B over its largest value, from the start to half-way through slip.

    That is half-way between the reference's first slip and first separation: what grows until the surfaces part
    oscillates at up to 100 kHz, and a small error of its phase or of its rate is soon as large as the motion.
    """
    slip, parting = (reference.summary[f"first_{event}_time"] for event in ("slip", "separation"))
    ends = (0.5 * (slip + parting), run.summary["first_separation_time"], run.time[-1], reference.time[-1])
    times = run.time[run.time < np.nanmin(ends)]
    expected = CubicSpline(reference.time, reference.velocity_B)(times)
    return float(np.abs(run.velocity_B[: len(times)] - expected).max() / np.abs(expected).max())


@pytest.mark.slow
def test_solve_ivp_comes_to_the_exact_motion_as_its_tolerance_falls():
    scene = Scene(0.1, 12.0, 0.35, 9.0, COARSE)
    end = 0.5 * RAMP + ensembles.loading_time(scene) + 2e-3
    common = {"cutoff": 75e3, "ramp": RAMP}
    exact = simulate(scene, end, "exact", record=True, sample_rate=1e6, **common)
    parting = exact.summary["first_separation_time"]
    assert parting < end
    model, wrong = reduced_model(COARSE, scene.theta, 75e3), []
    for tolerance in (1e-4, 1e-6, 1e-8):
        found = solve_ivp.run(scene, model, end, RAMP, tolerance, exact.time)
        wrong.append(slip_error(found, exact))
    assert wrong[2] < 1e-4
    assert wrong[0] > 10.0 * wrong[1] > 100.0 * wrong[2]
    assert found.summary["first_separation_time"] == pytest.approx(parting, rel=1e-6)


def test_where_events_do_not_end_solve_ivp_fails_and_says_where(monkeypatch):
    monkeypatch.setattr(solve_ivp, "MOST_EVENTS", 2)
    monkeypatch.setattr(solve_ivp, "NO_TIME", 1e-3)
    with pytest.raises(DivergenceError, match=r"solve_ivp cannot go on at 0\.0\d+ s: A term") as caught:
        solve_ivp.run(QUICK, reduced_model(COARSE, 5.0), 0.02, RAMP, 1e-4, np.arange(0.0, 0.02, 1e-5))
    assert caught.value.scene is QUICK


# Stand-ins for the dropped modes.


@pytest.mark.parametrize("termination", TERMINATIONS)
def test_the_element_keeps_the_onset_that_dropping_modes_moves(termination):
    onset = flutter_onsets(Rig(), 5.0).mu[0]
    models = [reduced_model(Rig(), 5.0, cutoff, termination) for cutoff in (25e3, 50e3, 100e3)]
    wrong = [abs(onset_of(model, onset) / onset - 1.0) for model in models]
    assert wrong[0] > wrong[1] > wrong[2]
    order = np.log2(wrong[1] / wrong[2])
    if termination == "none":
        assert 0.6 < order < 1.4
    else:
        assert order > 2.0
        assert wrong[1] < 2e-4


def test_errors_of_meshes_fall_with_the_fourth_order():
    rig, at = Rig(), []
    for factor in (0.5, 2.0, 4.0):
        beams = [replace(beam, elements=round(factor * beam.elements)) for beam in (rig.p1, rig.p2)]
        at.append(flutter_onsets(replace(rig, p1=beams[0], p2=beams[1]), 5.0).mu[0])
    wrong = np.abs(np.array(at[:2]) / at[2] - 1.0)
    assert np.log(wrong[0] / wrong[1]) / np.log(4.0) == pytest.approx(4.0, abs=0.5)


def mobility(model, omega):
    """Of the surfaces, (frequencies, 2, 2): velocities for unit forces, modes and element in series."""
    s = 1j * omega[:, None]
    modal = s / (model.stiffness + s * model.damping + s**2)
    element = s[..., None] * np.linalg.inv(model.K + s[..., None] * model.C)
    return np.einsum("in,wn,jn->wij", model.shapes, modal, model.shapes) + element


@pytest.mark.parametrize("damping", [None, 0.02])
@pytest.mark.parametrize("name", ["2 mm/s", "rig 0", "rig 1", "rig 4"])
def test_pseudo_modes_are_passive_and_keep_the_contacts_flexibility(name, damping):
    scene = choices.scene_of(name, Rig())
    own, full = reduced_model(scene.rig, scene.theta), full_model(scene.rig, scene.theta)
    model = with_pseudo_modes(own, full, damping)
    assert len(own.stiffness) < len(model.stiffness) <= len(own.stiffness) + 4
    assert np.all(np.linalg.eigvalsh(model.K) > 0.0)
    omega = 2.0 * np.pi * np.geomspace(1.0, 1e7, 4001)
    real = mobility(model, omega).real
    scale = np.abs(real).max(axis=(1, 2))
    assert np.all(np.linalg.eigvalsh(real)[:, 0] >= -1e-12 * scale)
    # A flaw would show: an active pseudo-mode makes the real part indefinite.
    active = replace(
        model, damping=model.damping * np.where(np.arange(len(model.damping)) < len(own.damping), 1, -1)
    )
    assert np.linalg.eigvalsh(mobility(active, omega).real).min() < -1e-6 * scale.max()
    added = model.shapes[:, len(own.stiffness) :]
    static = (added / model.stiffness[len(own.stiffness) :]) @ added.T + np.linalg.inv(model.K)
    np.testing.assert_allclose(static, np.linalg.inv(own.K), rtol=1e-9)
    # Their inverse mass is that of the modes that they stand for, along each band's axes.
    limit = (2.0 * np.pi * 300e3) ** 2
    dropped = full.shapes[:, (full.stiffness > own.stiffness.max()) & (full.stiffness <= limit)]
    assert np.trace(added @ added.T) == pytest.approx(np.trace(dropped @ dropped.T), rel=1e-9)


# Settings.


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_vibrates_and_the_paper_can_take_its_step(name):
    scene = choices.scene_of(name, Rig())
    assert sliding_modes(scene.rig, scene.theta, scene.mu).growth_rate.max() > 0.0
    assert (name in OWN) == (scene.rig == Rig())
    simulate(scene, 1e-6, "paper")


@pytest.mark.parametrize(("method", "name", "scene"), [point for point in POINTS if point[2] in choices.CHECKED])
def test_every_setting_is_one_that_its_method_takes(method, name, scene):
    if method != EVENTS:
        own = choices.scene_of(scene, Rig())
        simulate(own, 1e-5, method, ramp=RAMP, **choices.arguments(method, OPTIONS[name], own))


def test_steps_are_shares_of_the_largest():
    scene = choices.scene_of("5 mm/s", Rig())
    limit = choices.step_limit(scene)
    simulate(scene, 1e-5, step=0.9999 * limit)
    with pytest.raises(ValueError, match="at most"):
        simulate(scene, 1e-5, step=1.0001 * limit)
    assert choices.arguments(FAST, OPTIONS["step 0.5"], scene) == {"step": 0.5 * limit}


def test_both_dampings_are_asked_for_by_name():
    scene = choices.scene_of("5 mm/s", Rig())
    published, model = (
        choices.arguments(*pair, scene) for pair in ((FAST, OPTIONS[PUBLISHED]), (PAPER, OPTIONS[MODEL]))
    )
    assert published == {"numerical_damping": "published"}
    assert model == {"numerical_damping": "none", "step": 1e-8}
    assert choices.arguments(PAPER, OPTIONS[DEFAULT], scene) == {}


def test_settings_have_names_of_their_own():
    assert {DEFAULT, CONVERGED, PUBLISHED, MODEL, "cut-off 0.64", "damping 0.333", "cross terms off"} < set(
        OPTIONS
    )
    assert not any("," in name for axis in STUDY.axes.values() for name in axis.values)


def test_what_does_not_go_together_is_skipped():
    sweep = STUDY.sweep({})
    every = sweep.grid.points()
    kept = ~choices.skip(every)
    assert {
        tuple(str(every[axis][k]) for axis in ("method", "setting", "scene")) for k in np.flatnonzero(kept)
    } == set(POINTS)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"members": 0}, "members = 0.0: it must be a whole number from 1 to 100"),
        ({"members_expensive": 2.5}, "members_expensive = 2.5: it must be a whole number"),
        ({"members": 2, "members_expensive": 3}, "members_expensive = 3.0: it must be a whole number from 1 to 2"),
        ({"ramp": 0.0}, "ramp = 0.0: it must be a number from 1e-06 to 1 (s, for repeat runs differ by it)"),
        ({"duration": 0.3}, "duration = 0.3: it must be a number from 0.34"),
        ({"contact_position": 1.0}, "contact_position = 1"),
    ],
)
def test_bad_input_is_named_before_anything_is_planned(values, text):
    with pytest.raises(ValueError, match=re.escape(text)) as caught:
        STUDY.sweep(values)
    assert "\n" not in str(caught.value)


# Costs.


@pytest.fixture
def work(monkeypatch):
    """Begin and end of every computation, and of every one that is timed, each with its thread."""
    every = {"all": [], "timed": []}

    def watched(own, kind, *arguments, **options):
        begin = time.perf_counter()
        found = own(*arguments, **options)
        every[kind].append((begin, time.perf_counter(), threading.get_ident()))
        return found

    for name, kind in (("simulate_many", "all"), ("simulate", "all"), ("timed", "timed")):
        monkeypatch.setattr(runs, name, partial(watched, getattr(runs, name), kind))
    return every


def test_nothing_of_the_run_is_computed_beside_what_is_timed(work):
    names = [DEFAULT, "cut-off 0.4", "damping 3"]
    STUDY.sweep(SMALL | {"method": FAST, "setting": names}).plan().run("threads", workers=2)
    assert len(work["timed"]) == len(names)
    for begin, end, thread in work["timed"]:
        assert not [each for each in work["all"] if each[2] != thread and each[0] < end and begin < each[1]]


def test_a_point_waits_for_that_of_another_process():
    code = "import sys, filelock; filelock.FileLock(sys.argv[1]).acquire(timeout=0)"
    with runs.TURN:
        other = subprocess.run([sys.executable, "-c", code, runs.TURN.lock_file], capture_output=True, text=True)
    assert other.returncode != 0
    assert "Timeout" in other.stderr


def test_a_cost_is_that_of_whole_runs_after_one_that_compiles(monkeypatch):
    ran = []

    def simulated(scenes, duration, method, **options):
        ran.append((len(scenes), duration))
        summary = {"stick_times": np.zeros(0), "regime": "stuck"} | dict.fromkeys(runs.KEPT, 0.0)
        return [Transient(scene, summary) for scene in scenes]

    monkeypatch.setattr(runs, "simulate_many", simulated)
    monkeypatch.setattr(runs, "simulate", lambda scene, *rest, **options: simulated([scene], *rest))
    monkeypatch.setattr(runs, "timed", lambda compute: (compute(), 3.0))
    fixed = {"ramp": RAMP, "duration": 2.0, "members": 3, "members_expensive": 1}
    costs = [runs.measured(method, OPTIONS[DEFAULT], QUICK, fixed)["cpu_per_second"] for method in (FAST, PAPER)]
    assert ran == [(1, 2.0), (3, 2.0), (1, runs.WARMING), (1, 2.0)]
    assert costs == [0.5, 1.5]


# Errors and scatter.


def of(values, time=1.0):
    return errors.Ensembles.of(xr.DataArray(values, dims=("setting", "member")), time)


@settings(deadline=None)
@given(st.integers(2, 9), st.integers(2, 9), st.integers(0, 10_000))
def test_over_equal_times_a_deviation_is_students_t(n, m, seed):
    rng = np.random.default_rng(seed)
    one, other = rng.normal(1.0, 0.3, (1, n)), rng.normal(1.1, 0.3, (1, m))
    padded = np.pad(one, ((0, 0), (0, 3)), constant_values=np.nan)
    error, standard = of(padded, 2.0).minus(of(other, 2.0))
    known = stats.ttest_ind(one[0], other[0], equal_var=True)
    assert float((error / standard)[0]) == pytest.approx(known.statistic, rel=1e-9)


def test_a_run_twice_as_long_scatters_half_as_much():
    """Of long and of short runs of one process, the deviations of the mean are normal, whatever is pooled."""
    rng = np.random.default_rng(3)
    short, long = rng.normal(0.0, 1.0, (4000, 3)), rng.normal(0.0, np.sqrt(0.25), (4000, 12))
    error, standard = of(short, 1.0).minus(of(long, 4.0))
    # Of 13 degrees of freedom.
    assert np.std((error / standard).values) == pytest.approx(np.sqrt(13.0 / 11.0), rel=0.03)


@pytest.fixture
def file(monkeypatch):
    """The study's file at one scene, with `values(method, setting)` in place of what is computed."""

    def made(values, options=(DEFAULT, CONVERGED), methods=(FAST, PAPER), scenes=("5 mm/s",)):
        def point(method, setting, scene, fixed):
            found = study.blank(fixed)
            for name, value in values(method, setting).items():
                found[name][...] = value
            return found

        monkeypatch.setattr(study, "point", point)
        monkeypatch.setattr(runs, "TURN", nullcontext())
        given = {"members": 4, "method": list(methods), "setting": list(options), "scene": list(scenes)}
        return STUDY.sweep(given).plan().run("sync")

    return made


WOBBLE = 1e-3 * np.array([-1.0, 1.0, -2.0, 2.0])


def figures_of(stick, cost=1.0):
    return {
        "stick_fraction": stick + WOBBLE,
        "slip_fraction": 0.1 + WOBBLE,
        "separation_fraction": 0.9 - stick - WOBBLE,
        "dominant_frequency": 2600.0 * (1.0 + WOBBLE),
        "velocity_rms": 0.01 * (1.0 + WOBBLE),
        "observed_time": 1.0,
        "cpu_per_second": cost,
    }


@pytest.mark.parametrize(
    ("off", "late", "right"),
    [(0.01, 0.0, "yes"), (0.019, 0.0, "yes"), (0.03, 0.0, "no"), (-0.03, 0.0, "no"), (0.01, 0.02, "no")],
)
@pytest.mark.parametrize(
    ("own", "reference"), [((FAST, DEFAULT), (FAST, CONVERGED)), ((FAST, PUBLISHED), (PAPER, DEFAULT))]
)
def test_a_setting_is_right_within_tolerance_and_scatter_and_slips_when_it_should(
    file, own, reference, off, late, right
):
    """By the reference of its own damping; whatever has the other is far off."""
    at = {own: (off, 0.1 * (1.0 + late)), reference: (0.0, 0.1)}

    def values(*pair):
        shift, slip = at.get(pair, (0.25, 1.0))
        return figures_of(0.6 + shift) | {"first_slip_time": slip}

    data = file(values, (DEFAULT, CONVERGED, PUBLISHED)).sel({"method": own[0], "setting": own[1]}).isel(scene=0)
    share = data.sel(figure="stick_fraction")
    assert float(share["figure_error"]) == pytest.approx(off)
    assert float(share["figure_standard_error"]) == pytest.approx(np.std(WOBBLE, ddof=1) * np.sqrt(0.5), rel=1e-6)
    # Of the figures that there are: three shares, of which two are off, the frequency and the RMS.
    assert float(data["mismatch"]) == pytest.approx(np.sqrt(2.0 * (off / 0.02) ** 2 / 5.0), abs=1e-12)
    assert float(data["first_slip_error"]) == pytest.approx(late)
    assert errors.WITHIN[int(data["within"])] == right


def test_the_published_scheme_is_compared_with_the_model():
    assert choices.REFERENCES == {(FAST, PUBLISHED): (PAPER, DEFAULT)}
    assert choices.GIVEN == (FAST, CONVERGED)
    scene = choices.scene_of("rig 0", Rig())
    given = choices.arguments(FAST, OPTIONS[CONVERGED], scene)
    assert given["cutoff"] == 3.0 * default_cutoff(scene.rig)
    assert given["step"] == 0.5 * reduced_model(scene.rig, scene.theta, given["cutoff"]).default_step


def test_a_reference_has_no_errors_and_what_is_missing_none_either(file):
    data = file(
        lambda method, setting: figures_of(0.6) if setting != "step 0.5" else {}, (DEFAULT, CONVERGED, "step 0.5")
    )
    within = xr.apply_ufunc(np.array(errors.WITHIN).__getitem__, data["within"])
    assert data["mismatch"].sel({"method": FAST, "setting": CONVERGED}).isnull().all()
    # In the order of the axis; the published scheme itself is compared with the model.
    assert data["setting"].values.tolist() == [DEFAULT, CONVERGED, "step 0.5"]
    assert within.squeeze().values.tolist() == [["yes", "unknown", "unknown"], ["yes", "unknown", "unknown"]]
    data = file(lambda *_: figures_of(0.6), (DEFAULT, "cut-off 0.64"), (FAST,))
    assert data["mismatch"].isnull().all()


def test_a_dominant_frequency_is_right_if_it_is_that_of_a_run_of_the_reference_or_a_rival_peak(file):
    lines = {CONVERGED: [2600.0, 2600.0, 2600.0, 5000.0], DEFAULT: 5050.0, "step 0.5": 5250.0, "damping 3": 3030.0}

    def values(_, setting):
        rivals = {"rival_lines": [3000.0, np.nan, np.nan]} if setting == CONVERGED else {}
        return figures_of(0.6) | {"dominant_frequency": lines[setting]} | rivals

    data = file(values, tuple(lines), (FAST,)).isel(method=0, scene=0).sel(figure="dominant_frequency")
    found = [float(data["figure_error"].sel(setting=name)) for name in lines]
    np.testing.assert_allclose(found, [np.nan, 0.01, 0.05, 0.01])
    # A rival peak is none of a reference that is not there.
    lines[PUBLISHED] = 3000.0
    assert file(values, (CONVERGED, PUBLISHED), (FAST,))["figure_error"].isnull().all()


def test_rival_peaks_are_those_at_least_half_as_strong(monkeypatch):
    times = np.arange(40000) / runs.RATE

    def velocity(*_):
        return sum(a * np.sin(2.0 * np.pi * f * times) for a, f in ((1.0, 3e3), (0.8, 5e3), (0.6, 7e3)))

    monkeypatch.setattr(runs.transients, "velocity", velocity)
    found = runs.rival_lines(QUICK, times[-1] + 1.0 / runs.RATE, {"ramp": RAMP})
    np.testing.assert_allclose(found, [3e3, 5e3, np.nan], rtol=1e-2)


def test_means_of_sticks_are_compared_where_there_is_more_than_a_handful(file):
    sticks = {DEFAULT: (1.6, 30.0), CONVERGED: (1.0, 30.0), "step 0.5": (1.6, 4.0)}

    def values(_, setting):
        mean, count = sticks[setting]
        return {"mean_stick_time": 0.05 * mean, "long_sticks": count, "observed_time": 1.0}

    data = file(values, tuple(sticks), (FAST,)).isel(method=0, scene=0).sel(figure="mean_stick_time")
    found = [float(data["figure_error"].sel(setting=name)) for name in sticks]
    np.testing.assert_allclose(found, [0.6, np.nan, np.nan], atol=1e-9)


def test_time_to_a_standard_error_is_that_of_the_scatter_of_one_second(file):
    """Runs of two seconds with a standard deviation of s: one second has s * sqrt(2)."""
    data = file(lambda method, _: figures_of(0.6, {FAST: 0.02, PAPER: 20.0}[method]) | {"observed_time": 2.0})
    second = np.std(WOBBLE, ddof=1) * np.sqrt(2.0)
    assert float(data["one_second_error"][0]) == pytest.approx(second)
    known = data["time_to_standard_error"].sel(setting=DEFAULT).values.ravel()
    np.testing.assert_allclose(known, np.array([0.02, 20.0]) * (second / 0.005) ** 2)


# What is chosen, and how it is shown.


@pytest.mark.parametrize(
    ("costs", "right", "cheapest"),
    [([3.0, 1.0, 2.0], [4, 3, 4], [2.0]), ([1.0, 2.0], [3, 0], []), ([1.0], [4], [1.0])],
)
def test_the_cheapest_is_right_at_every_scene(costs, right, cheapest):
    every = pd.DataFrame({"cost": costs})
    for group in findings.GROUPS:
        every[f"right {group}"], every[f"compared {group}"] = right, 4
    assert findings.cheapest_right(every)["cost"].tolist() == cheapest
    # What was compared at fewer scenes is not.
    every["compared random rigs"] = [4] * (len(costs) - 1) + [5]
    assert findings.cheapest_right(every).empty


@pytest.mark.parametrize(
    ("values", "compared"),
    [
        (lambda *_: figures_of(0.6, cost=0.02), True),
        (lambda method, _: figures_of(0.6) if method == PAPER else {}, True),
        (lambda *_: {}, False),
    ],
)
def test_whatever_is_there_is_told_and_drawn(file, values, compared):
    names = (DEFAULT, CONVERGED, PUBLISHED, MODEL, "step 0.5", "cut-off 0.4", "truncation 2", "pseudo-modes 0.02")
    data = file(values, names, METHODS, ("5 mm/s", "rig 0", "rig 3"))
    text = tables.text(findings.findings(data))
    assert "Two references" in text
    assert ("Without paper, default, there is none" in text) != compared
    with figures.style():
        figure.draw(data).canvas.draw()


def test_a_small_study_from_end_to_end(tmp_path):
    """Default, reference and a coarse cut-off; the file completed later knows all errors."""
    store, given = tmp_path / "accuracy.nc", SMALL | {"method": FAST, "setting": DEFAULT}
    assert STUDY.sweep(given).plan(store).run("sync")["mismatch"].isnull().all()
    given |= {"method": [FAST, PAPER, EXACT], "setting": [DEFAULT, CONVERGED, PUBLISHED, "cut-off 0.4"]}
    whole = STUDY.sweep(given).plan(store).run("sync")
    assert set(np.unique(whole["status"])) == {1, 3}
    assert whole["error"].dims == whole["status"].dims  # the messages of the engine's failed points
    at = {
        pair: whole.sel(dict(zip(("method", "setting"), pair, strict=True))).isel(scene=0)
        for pair in ((FAST, DEFAULT), (FAST, CONVERGED), (FAST, PUBLISHED), (PAPER, DEFAULT), (EXACT, DEFAULT))
    }
    assert 0.0 < float(at[FAST, DEFAULT]["cpu_per_second"]) < 0.1 * float(at[PAPER, DEFAULT]["cpu_per_second"])
    for own, reference in (((FAST, DEFAULT), (FAST, CONVERGED)), ((FAST, PUBLISHED), (PAPER, DEFAULT))):
        expected = float(at[own]["stick_fraction"].mean() - at[reference]["stick_fraction"].mean())
        assert float(at[own]["figure_error"].sel(figure="stick_fraction")) == pytest.approx(expected, rel=1e-9)
        assert abs(expected) < 0.1
        assert abs(float(at[own]["first_slip_error"])) < 1e-3
    lines = tables.text(findings.findings(whole)).splitlines()
    assert {line.split()[0] for line in lines if "cut-off 0.4" in line} == {"fast"}
