"""Run time against error: the baselines are what they say, errors are errors, and scatter is scatter."""

import re
import subprocess
import sys
import threading
import time
from contextlib import nullcontext
from functools import partial

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from fivcore import Beam, DivergenceError, Rig, Scene, Transient, flutter_onsets, simulate
from fivcore.contact.reduced import TERMINATIONS, default_cutoff, reduced_model
from studies import tables
from studies.accuracy import elements, errors, figure, findings, linear, runs, solve_ivp, study
from studies.accuracy import settings as choices
from studies.accuracy.settings import DEFAULT, FAST, LINEAR, METHODS, OPTIONS, PAPER, SCENES
from studies.accuracy.study import STUDY, VARIABLES, coords
from studies.motion import ensembles
from studies.plotting import figures

RAMP = 1e-3
# A mesh on which the published scheme is quick, and a speed at which the surfaces slip and part within 10 ms.
COARSE = Rig(Beam(0.05, 0.010, 0.0015, 185e9, 7900.0, 8), Beam(0.15, 0.015, 0.0030, 185e9, 7900.0, 20))
QUICK = Scene(0.05, 5.0, 0.2, 9.0, COARSE)
SMALL = {
    "duration": 0.25,
    "members": 3,
    "reference_members": 2,
    "variant_duration": 0.25,
    "variant_members": 1,
    "p1_elements": 8,
    "p2_elements": 20,
    "scene": "5 mm/s",
}
PAIRS = [(method, name) for name, option in OPTIONS.items() for method in option.methods]
# Of `fast`, one of each kind.
KINDS = {OPTIONS[name].kind: name for method, name in PAIRS if method == FAST}


# The baselines.


def test_in_finite_elements_the_published_scheme_moves_as_in_modes():
    end = 0.5 * RAMP + ensembles.load_up(QUICK) + 6e-3
    run = elements.run(QUICK, end, RAMP, 1e6)
    known = simulate(QUICK, end, "paper", ramp=RAMP, record=True, sample_rate=1e6)
    for name in ("first_slip_time", "first_separation_time"):
        assert run.summary[name] == known.summary[name] < end
    times = run.time[run.time < run.summary["first_separation_time"]]
    np.testing.assert_array_equal(times, known.time[: len(times)])
    wrong = np.abs(run.velocity_B - known.velocity_B)[: len(times)]
    assert wrong.max() < 1e-6 * np.abs(known.velocity_B[: len(times)]).max()


@pytest.mark.parametrize("kind", KINDS)
def test_every_setting_of_fast_has_a_reference_for_the_first_burst(kind):
    option = OPTIONS[KINDS[kind]]
    scene = choices.meshed(QUICK, option)
    found = runs.burst(FAST, option, scene, choices.arguments(FAST, option, scene), {"ramp": RAMP})
    assert set(found) == (set() if kind == "termination" else {"slip_velocity_error"})
    assert all(0.0 < error < 5.0 for error in found.values())


def test_solve_ivp_comes_to_the_exact_motion_as_its_tolerance_falls():
    scene = Scene(0.1, 12.0, 0.35, 9.0, COARSE)
    end = 0.5 * RAMP + ensembles.load_up(scene) + 2e-3
    common = {"cutoff": default_cutoff(COARSE), "ramp": RAMP}
    exact = simulate(scene, end, "exact", record=True, sample_rate=1e6, **common)
    parting = exact.summary["first_separation_time"]
    assert parting < end
    model, wrong = reduced_model(COARSE, scene.theta), []
    for tolerance in (1e-4, 1e-6, 1e-8):
        found = solve_ivp.run(scene, model, end, RAMP, tolerance, exact.time)
        wrong.append(runs.slip_error(found, exact)["slip_velocity_error"])
    assert wrong[2] < 1e-4
    assert wrong[0] > 10.0 * wrong[1] > 100.0 * wrong[2]
    assert found.summary["first_separation_time"] == pytest.approx(parting, rel=1e-6)


def test_where_events_do_not_end_solve_ivp_fails_and_says_where(monkeypatch):
    monkeypatch.setattr(solve_ivp, "MOST_EVENTS", 2)
    monkeypatch.setattr(solve_ivp, "NO_TIME", 1e-3)
    with pytest.raises(DivergenceError, match=r"solve_ivp cannot go on at 0\.0\d+ s: A term") as caught:
        solve_ivp.run(QUICK, reduced_model(COARSE, 5.0), 0.02, RAMP, 1e-4, np.arange(0.0, 0.02, 1e-5))
    assert caught.value.scene is QUICK


# Sliding stability of reduced models.


@pytest.mark.parametrize("termination", TERMINATIONS)
def test_the_element_keeps_the_onset_that_dropping_modes_moves(termination):
    onset = flutter_onsets(Rig(), 5.0).mu[0]
    models = [reduced_model(Rig(), 5.0, cutoff, termination) for cutoff in (25e3, 50e3, 100e3)]
    wrong = [abs(linear.onset_of(model, onset) / onset - 1.0) for model in models]
    assert wrong[0] > wrong[1] > wrong[2]
    order = np.log2(wrong[1] / wrong[2])
    if termination == "none":
        assert 0.6 < order < 1.4
    else:
        assert order > 2.0
        assert wrong[1] < 2e-4


def test_errors_of_meshes_fall_with_the_fourth_order():
    scene, options = Scene(5e-3, 5.0, 0.2, 9.0), [OPTIONS[f"mesh {size}"] for size in ("0.5", "2", "4")]
    at = [linear.stability(choices.meshed(scene, option), option)["onset_mu"][0] for option in options]
    wrong = np.abs(np.array(at[:2]) / at[2] - 1.0)
    assert np.log(wrong[0] / wrong[1]) / np.log(4.0) == pytest.approx(4.0, abs=0.5)


# Settings.


@pytest.mark.parametrize(("method", "name"), [pair for pair in PAIRS if pair[0] in choices.SIMULATED])
def test_every_setting_is_one_that_its_method_takes(method, name):
    for scene in [*SCENES][-2:]:  # the paper's three speeds are one rig with one limit
        own = choices.meshed(Scene(*choices.SCENES[scene], Rig()), OPTIONS[name])
        simulate(own, 1e-5, method, ramp=RAMP, **choices.arguments(method, OPTIONS[name], own))


@pytest.mark.parametrize("method", [FAST, PAPER])
def test_steps_are_shares_of_the_largest(method):
    scene = Scene(*choices.SCENES["5 mm/s"], Rig())
    limit = choices.step_limit(method, scene)
    simulate(scene, 1e-5, method, step=0.9999 * limit)
    with pytest.raises(ValueError, match="at most"):
        simulate(scene, 1e-5, method, step=1.0001 * limit)


def test_settings_have_names_of_their_own_and_cut_offs_are_told_in_kilohertz():
    assert {DEFAULT, choices.UNDAMPED, "cut-off 3.02", "mesh 0.333", "leaps off"} < set(OPTIONS)
    assert not any("," in name for axis in STUDY.axes.values() for name in axis.values)
    cutoff = choices.cutoff_of(OPTIONS["cut-off 3.02"], Rig())
    assert findings.label("cut-off 3.02", cutoff) == "cut-off 73.1 kHz"
    assert findings.label("mesh 2", cutoff) == "mesh 2"


def test_what_does_not_go_together_is_skipped():
    kept = ~choices.skip(STUDY.sweep({}).grid.points())
    assert kept.sum() == len(PAIRS) * len(SCENES)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"members": 0}, "members = 0.0: it must be a whole number from 1 to 100"),
        ({"variant_members": 2.5}, "variant_members = 2.5: it must be a whole number"),
        ({"ramp": 0.0}, "ramp = 0.0: it must be a number from 1e-06 to 1 (s, for members differ by it)"),
        ({"duration": 0.3}, "duration = 0.3: it must be a number from 0.34"),
        ({"variant_duration": 0.1}, "variant_duration = 0.1: it must be a number from 0.34"),
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
    names = [DEFAULT, "cut-off 1.6", "tau 2"]
    STUDY.sweep(SMALL | {"method": FAST, "setting": names}).plan().run("threads", workers=2)
    assert len(work["timed"]) == len(names) * (1 + runs.TIMED)
    for begin, end, thread in work["timed"]:
        assert not [each for each in work["all"] if each[2] != thread and each[0] < end and begin < each[1]]


def test_a_point_waits_for_that_of_another_process():
    code = "import sys, filelock; filelock.FileLock(sys.argv[1]).acquire(timeout=0)"
    with runs.TURN:
        other = subprocess.run([sys.executable, "-c", code, runs.TURN.lock_file], capture_output=True, text=True)
    assert other.returncode != 0
    assert "Timeout" in other.stderr


def test_the_published_scheme_is_timed_over_short_runs_and_its_figures_are_of_whole_ones(monkeypatch):
    lengths = []

    def simulated(scene, duration, method, **options):
        lengths.append(duration)
        return Transient(scene, {"stick_times": np.zeros(0)} | dict.fromkeys(runs.FIGURES, 0.0))

    monkeypatch.setattr(runs, "simulate", simulated)
    fixed = {"ramp": RAMP, "duration": 2.0, "reference_members": 4, "members": 1, "variant_members": 1}
    found = runs.ensemble(PAPER, OPTIONS[DEFAULT], QUICK, {}, fixed)
    assert lengths == [runs.WARMING, *[runs.SHORT] * runs.TIMED, *[2.0] * 4]
    assert found["batch_cpu_per_second"] == found["cpu_per_second"]


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

    def made(values, options=(DEFAULT,), methods=(FAST, PAPER)):
        def point(method, setting, scene, fixed):
            sizes = {dim: len(axis) for dim, axis in coords(**fixed).items()}
            found = {name: np.full([sizes[dim] for dim in each.dims], np.nan) for name, each in VARIABLES.items()}
            for name, value in values(method, setting).items():
                found[name][...] = value
            return found

        monkeypatch.setattr(study, "point", point)
        monkeypatch.setattr(runs, "TURN", nullcontext())
        given = SMALL | {"members": 4, "method": list(methods), "setting": list(options)}
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
def test_a_setting_is_right_within_tolerance_and_scatter_and_slips_when_it_should(file, off, late, right):
    shift = {FAST: (off, 0.1 * (1.0 + late)), PAPER: (0.0, 0.1)}
    data = file(lambda method, _: figures_of(0.6 + shift[method][0]) | {"first_slip_time": shift[method][1]})
    at = data.isel(method=0, setting=0, scene=0)
    share = at.sel(figure="stick_fraction")
    assert float(share["figure_error"]) == pytest.approx(off)
    assert float(share["figure_standard_error"]) == pytest.approx(np.std(WOBBLE, ddof=1) * np.sqrt(0.5), rel=1e-6)
    # Of the figures that there are: three shares, of which two are off, the line and the RMS.
    assert float(at["mismatch"]) == pytest.approx(np.sqrt(2.0 * (off / 0.02) ** 2 / 5.0))
    assert float(at["first_slip_error"]) == pytest.approx(late)
    assert errors.WITHIN[int(at["within"])] == right


def test_the_reference_has_no_errors_and_what_is_missing_none_either(file):
    data = file(lambda method, _: figures_of(0.6) if method == PAPER else {}, (DEFAULT, "step 0.45"))
    within = xr.apply_ufunc(np.array(errors.WITHIN).__getitem__, data["within"])
    assert data["mismatch"].sel({"method": PAPER, "setting": DEFAULT}).isnull().all()
    # Another setting of the reference's method is compared.
    assert within.squeeze().values.tolist() == [["unknown"] * 2, ["unknown", "yes"]]
    data = file(lambda *_: figures_of(0.6), (DEFAULT, "cut-off 2.1"), (FAST,))
    assert data["mismatch"].isnull().all()
    assert data["cutoff"].values.tolist() == [default_cutoff(Rig()), pytest.approx(50.8e3, rel=1e-3)]


def test_means_of_sticks_are_compared_where_there_is_more_than_a_handful(file):
    sticks = np.full((4, runs.KEPT), np.nan)
    sticks[:, :5] = np.random.default_rng(1).gamma(9.0, 0.05 / 9.0, (4, 5))
    shares = {FAST: (1.0, 1.6), PAPER: (1.0, np.nan)}

    def values(method, setting):
        own = sticks * shares[method][setting == "step 0.15"]
        return {"stick_time": own if setting != "step 0.3" else own[:, :1] + np.full(runs.KEPT, np.nan)}

    error = file(values, (DEFAULT, "step 0.15", "step 0.3"))["figure_error"].isel(method=0, scene=0)
    np.testing.assert_allclose(error.sel(figure="mean_stick_time"), [0.0, 0.6, np.nan], atol=1e-6)


def test_cut_offs_are_compared_with_all_modes_and_meshes_with_the_finest(file):
    onsets = {DEFAULT: 1.0, "cut-off 2.1": 1.1, "mesh 2": 1.25, "mesh 4": 2.0}
    data = file(lambda _, setting: {"onset_mu": onsets[setting]}, tuple(onsets), (LINEAR,))
    errors_found = data["onset_error"].isel(scene=0, termination=1).values
    np.testing.assert_allclose(errors_found, [0.5, 0.1, 0.375, np.nan])


# What is chosen, and how it is shown.


@pytest.mark.parametrize(
    ("costs", "right", "cheapest"),
    [([3.0, 1.0, 2.0], [4, 3, 4], [2.0]), ([1.0, 2.0], [3, 0], []), ([1.0], [4], [1.0])],
)
def test_the_cheapest_is_right_at_every_scene(costs, right, cheapest):
    every = pd.DataFrame({"cost": costs, "right_scenes": right, "known_scenes": 4})
    assert findings.cheapest_right(every)["cost"].tolist() == cheapest


@pytest.mark.parametrize(
    ("values", "compared"),
    [
        (lambda *_: figures_of(0.6, cost=0.02), True),
        (lambda method, _: figures_of(0.6) if method == PAPER else {}, True),
        (lambda *_: {}, False),
    ],
)
def test_whatever_is_there_is_told_and_drawn(file, values, compared):
    data = file(values, (DEFAULT, "step 0.75", "cut-off 1.05", "cut-off 2.5"), METHODS)
    text = tables.text(findings.findings(data))
    assert "Reference: paper" in text
    assert ("Without paper by default" in text) != compared
    with figures.style():
        figure.draw(data).canvas.draw()


def test_a_small_study_from_end_to_end(tmp_path):
    """Two methods, the default and a coarse cut-off; the file completed later knows all errors."""
    store, given = tmp_path / "accuracy.nc", SMALL | {"method": FAST, "setting": DEFAULT}
    assert STUDY.sweep(given).plan(store).run("sync")["mismatch"].isnull().all()
    given |= {"method": [FAST, PAPER, LINEAR], "setting": [DEFAULT, "cut-off 1.05"]}
    whole = STUDY.sweep(given).plan(store).run("sync")
    assert set(np.unique(whole["status"])) == {1, 3}
    assert whole["error"].dims == whole["status"].dims  # the messages of the engine's failed points
    at, reference = (whole.sel({"method": each, "setting": DEFAULT}).isel(scene=0) for each in (FAST, PAPER))
    assert 0.0 < float(at["batch_cpu_per_second"]) < 0.1 * float(reference["cpu_per_second"])
    expected = float(at["stick_fraction"].mean() - reference["stick_fraction"].mean())
    assert float(at["figure_error"].sel(figure="stick_fraction")) == pytest.approx(expected, rel=1e-9)
    assert abs(expected) < 0.1
    assert float(at["first_slip_error"]) < 1e-3
    assert float(at["slip_velocity_error"]) < 0.5
    lines = tables.text(findings.findings(whole)).splitlines()
    assert {line.split()[0] for line in lines if "cut-off 25.4 kHz" in line} == {"fast", "cut-off"}
