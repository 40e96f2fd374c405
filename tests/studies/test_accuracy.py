"""Run time against error: the baselines are what they say, errors are errors, and scatter is scatter."""

import dataclasses
import json
import re
import subprocess
import sys
import threading
import time

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from fivcore import Beam, Rig, Scene, Transient, flutter_onsets, simulate, sliding_modes
from fivcore.contact.reduced import TERMINATIONS, default_cutoff, full_model, reduced_model
from studies import tables
from studies.accuracy import elements, errors, figure, findings, linear, rows, runs, solve_ivp
from studies.accuracy import settings as choices
from studies.accuracy.settings import DEFAULT, FAST, LINEAR, METHODS, OPTIONS, PAPER, SCENES
from studies.accuracy.study import STUDY, VARIABLES, check, coords, key
from studies.motion import ensembles, transients
from studies.plotting import figures
from sweeps import Axis
from tests.helpers.rigs import workshop_rig

RAMP = 1e-3
# A mesh on which the published scheme is quick, and a speed at which the surfaces slip and part within 10 ms.
COARSE = Rig(Beam(0.05, 0.010, 0.0015, 185e9, 7900.0, 8), Beam(0.15, 0.015, 0.0030, 185e9, 7900.0, 20))
QUICK = Scene(0.05, 5.0, 0.2, 9.0, COARSE)
SMALL = {
    "duration": 0.25,
    "members": 3,
    "recorded": 2,
    "reference_members": 2,
    "variant_duration": 0.25,
    "variant_members": 1,
    "p1_elements": 8,
    "p2_elements": 20,
    "scene": "5 mm/s",
}
FIXED = {name: setting.value for name, setting in STUDY.settings.items()} | {"rig": Rig()}
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
    assert runs.errors(run, known)["burst_velocity_error"] < 1e-6


def test_assembled_beams_have_the_modes_of_the_bases():
    parts = elements.assemble(COARSE, 20.0)
    K, M = (np.zeros((len(parts.normal),) * 2) for _ in range(2))
    for whole, band in ((K, parts.K), (M, parts.M)):
        for d, row in enumerate(band):
            whole += np.diag(row[: len(row) - d], -d) + (np.diag(row[: len(row) - d], d) if d else 0.0)
    model = full_model(COARSE, 20.0)
    G = np.stack([parts.normal, parts.tangential])
    shapes = np.stack([model.normal, model.tangential])
    np.testing.assert_allclose(G @ np.linalg.solve(M, G.T), shapes @ shapes.T, rtol=1e-9)
    # The rigid mode is without stiffness, so flexibility is compared with a load on the stiffness.
    flexibility = (shapes / (model.stiffness + 1e3)) @ shapes.T
    np.testing.assert_allclose(G @ np.linalg.solve(K + 1e3 * M, G.T), flexibility, rtol=1e-7)


@pytest.mark.parametrize("kind", KINDS)
def test_every_setting_of_fast_has_a_reference_for_the_first_burst(kind):
    option = OPTIONS[KINDS[kind]]
    scene = choices.meshed(QUICK, option)
    found = runs.burst(FAST, option, scene, choices.arguments(FAST, option, scene), RAMP, 4)
    names = {name for name in VARIABLES if re.match("slip_.*error|burst_", name)}
    assert set(found) == (set() if kind == "contact" else names)
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
        found, reached = solve_ivp.run(scene, model, end, RAMP, tolerance, exact.time)
        assert reached == end
        wrong.append(runs.errors(found, exact)["slip_velocity_error"])
    assert wrong[2] < 1e-4
    assert wrong[0] > 10.0 * wrong[1] > 100.0 * wrong[2]
    assert found.summary["first_separation_time"] == pytest.approx(parting, rel=1e-6)


def test_where_events_do_not_end_solve_ivp_gives_up_and_says_where(monkeypatch):
    monkeypatch.setattr(solve_ivp, "MOST_EVENTS", 2)
    monkeypatch.setattr(solve_ivp, "NO_TIME", 1e-3)
    times = np.arange(0.0, 0.02, 1e-5)
    found, reached = solve_ivp.run(QUICK, reduced_model(COARSE, 5.0), 0.02, RAMP, 1e-4, times)
    assert found.summary["first_slip_time"] < reached < 0.02
    assert found.time[-1] < reached


# Sliding stability of reduced models.


@settings(deadline=None, max_examples=6)
@given(st.integers(0, 10_000), st.floats(1.0, 40.0), st.floats(0.05, 0.6))
def test_with_all_modes_the_plain_matrix_has_the_sliding_modes(seed, theta, mu):
    rig = workshop_rig(seed)
    known = sliding_modes(rig, theta, mu)
    found = linear.sliding_eigenvalues(full_model(rig, theta), mu)
    values = known.growth_rate + 2j * np.pi * known.frequency
    assert np.abs(found[:, None] - values).min(axis=0).max() < 2e-6 * np.pi * known.frequency.max()


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
    at = [linear.stability(choices.meshed(scene, option), option) for option in options]
    for name in ("onset_mu", "growth_rate"):
        wrong = [abs(each[name][0] / at[2][name][0] - 1.0) for each in at[:2]]
        assert np.log(wrong[0] / wrong[1]) / np.log(4.0) == pytest.approx(4.0, abs=0.5)


# Settings.


@pytest.mark.parametrize(("method", "name"), [pair for pair in PAIRS if pair[0] in choices.SIMULATED])
def test_every_setting_is_one_that_its_method_takes(method, name):
    for scene in [*SCENES][-2:]:  # the paper's three speeds are one rig with one limit
        own = choices.meshed(choices.scene_of(scene, Rig()), OPTIONS[name])
        simulate(own, 1e-5, method, ramp=RAMP, **choices.arguments(method, OPTIONS[name], own))


@pytest.mark.parametrize("method", [FAST, PAPER])
def test_steps_are_shares_of_the_largest(method):
    scene = choices.scene_of("5 mm/s", Rig())
    limit = choices.step_limit(method, scene, {})
    simulate(scene, 1e-5, method, step=0.9999 * limit)
    with pytest.raises(ValueError, match="at most"):
        simulate(scene, 1e-5, method, step=1.0001 * limit)


def test_settings_have_names_of_their_own_and_cut_offs_are_told_in_kilohertz():
    assert len(OPTIONS) == 38
    assert {DEFAULT, choices.UNDAMPED, "cut-off 3.02 step 0.9", "mesh 0.333", "leaps off"} < set(OPTIONS)
    assert not any("," in name for axis in STUDY.axes.values() for name in axis.values)
    cutoff = choices.cutoff_of(OPTIONS["cut-off 3.02 step 0.9"], Rig())
    assert rows.label("cut-off 3.02 step 0.9", cutoff) == "cut-off 73.1 kHz step 0.9"
    assert rows.label("mesh 2", cutoff) == "mesh 2"


def test_what_does_not_go_together_is_skipped_and_stability_is_computed_once():
    points = STUDY.sweep({}).grid.points()
    kept = ~choices.skip(points)
    assert kept.sum() == len(PAIRS) * len(SCENES)
    table = key({name: values[kept] for name, values in points.items()})
    stable = points["method"][kept] == LINEAR
    # The paper's three speeds are one question.
    assert len(np.unique(table[stable], axis=0)) == stable.sum() // 2
    assert len(np.unique(table[~stable], axis=0)) == (~stable).sum()


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"method": "quick"}, "method = 'quick': there is no such method"),
        ({"setting": [DEFAULT, "step 0.31"]}, "setting = 'step 0.31': there is no such setting"),
        ({"scene": 2}, "scene = 2: there is no such scene"),
        ({"members": 0}, "members = 0.0: it must be a whole number from 1 to 100"),
        ({"recorded": 2.5}, "recorded = 2.5: it must be a whole number"),
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


def test_the_shortest_run_is_that_of_the_slowest_scene_asked_for():
    check({"scene": Axis(["5 mm/s"])}, FIXED | {"variant_duration": 0.3})
    with pytest.raises(ValueError, match="variant_duration"):
        check({"scene": Axis(["1 mm/s"])}, FIXED | {"variant_duration": 0.3})


# Costs.


@pytest.fixture
def work(monkeypatch):
    """Begin and end of every computation, and of every one that is timed, each with its thread."""
    every = {"all": [], "timed": []}

    def watch(name, kind):
        own = getattr(runs, name)

        def watched(*arguments, **options):
            begin = time.perf_counter()
            try:
                return own(*arguments, **options)
            finally:
                every[kind].append((begin, time.perf_counter(), threading.get_ident()))

        monkeypatch.setattr(runs, name, watched)

    for name in ("simulate_many", "simulate", "band_powers"):
        watch(name, "all")
    watch("timed", "timed")
    return every


def test_nothing_of_the_run_is_computed_beside_what_is_timed(work):
    names = [DEFAULT, "cut-off 1.6", "leaps off", "tau 2"]
    STUDY.sweep(SMALL | {"method": FAST, "setting": names}).plan().run("threads", workers=2)
    assert len(work["timed"]) == len(names) * (1 + runs.TIMED)
    for begin, end, thread in work["timed"]:
        assert not [each for each in work["all"] if each[2] != thread and each[0] < end and begin < each[1]]


def test_a_point_waits_for_that_of_another_process():
    lock = runs.turn()
    code = "import sys, filelock; filelock.FileLock(sys.argv[1]).acquire(timeout=0)"
    with lock:
        other = subprocess.run([sys.executable, "-c", code, lock.lock_file], capture_output=True, text=True)
    assert other.returncode != 0
    assert "Timeout" in other.stderr


def test_the_published_scheme_is_timed_over_short_runs_and_its_figures_are_of_whole_ones(monkeypatch):
    lengths = []

    def simulated(scenes, duration, **options):
        lengths.append(duration)
        return [Transient(QUICK, {"stick_times": np.zeros(0)} | dict.fromkeys(runs.FIGURES, 0.0)) for _ in scenes]

    monkeypatch.setattr(runs, "simulate_many", simulated)
    monkeypatch.setattr(runs, "band_powers", lambda run: np.zeros(len(runs.BANDS)))
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


@pytest.mark.parametrize(("n", "neighbours"), [(25, 1), (33, 0), (38, 0)])
def test_a_sine_is_in_its_band_with_half_its_square(n, neighbours):
    t = np.arange(0.0, 1.0, 1.0 / (transients.OVERSAMPLING * runs.SAMPLE_RATE))
    v = 0.3 * np.sin(2.0 * np.pi * 10.0 ** (n / 10.0) * t)
    power = runs.band_powers(Transient(QUICK, {"first_slip_time": 0.05}, time=t, velocity_B=v))
    # A window of 25 ms spreads a line over 80 Hz, more than the lowest bands are wide.
    inside = np.abs(runs.BANDS - n) <= neighbours
    assert power[inside].sum() == pytest.approx(0.5 * 0.3**2, rel=0.02)
    assert power[~inside].sum() < 0.02 * power[inside].sum()


@pytest.fixture
def file():
    """A file at one scene with `values(method, setting)`, variables by name, and nothing else."""

    def made(values, options=(DEFAULT,), methods=(FAST, PAPER)):
        fixed = {"members": 4, "reference_members": 2, "variant_members": 1}
        dims, extra = ("method", "setting", "scene"), {name: axis.values for name, axis in coords(fixed).items()}
        sizes = {"method": len(methods), "setting": len(options), "scene": 1} | {
            n: len(v) for n, v in extra.items()
        }
        data = xr.Dataset(
            {
                name: (of := (*dims, *each.dims), np.full([sizes[dim] for dim in of], np.nan))
                for name, each in VARIABLES.items()
            },
            {"method": list(methods), "setting": list(options), "scene": ["5 mm/s"], **extra},
        )
        for method in methods:
            for option in options:
                for name, value in values(method, option).items():
                    data[name].loc[{"method": method, "setting": option}] = value
        constants = {"reference_members": 2, "members": 3, "duration": 1.0, "rig": dataclasses.asdict(Rig())}
        data.attrs["configuration"] = json.dumps({"constants": constants})
        return errors.with_errors(data.assign(status=(dims, np.ones(data["step"].shape, np.int8))), rig=Rig())

    return made


WOBBLE = 1e-3 * np.array([-1.0, 1.0, -2.0, 2.0])


def figures_of(stick, rms=0.01, cost=1.0):
    return {
        "stick_fraction": stick + WOBBLE,
        "slip_fraction": 0.1 + WOBBLE,
        "separation_fraction": 0.9 - stick - WOBBLE,
        "dominant_frequency": 2600.0 * (1.0 + WOBBLE),
        "velocity_rms": rms * (1.0 + WOBBLE),
        "observed_time": 1.0,
        "cpu_per_second": cost,
    }


@pytest.mark.parametrize(("off", "right"), [(0.01, True), (0.019, True), (0.03, False), (-0.03, False)])
def test_a_setting_is_right_within_tolerance_and_scatter(file, off, right):
    data = file(lambda method, _: figures_of(0.6 + (off if method == FAST else 0.0)))
    at = data.isel(method=0, setting=0, scene=0)
    assert float(at["stick_fraction_error"]) == pytest.approx(off)
    deviation = off / (np.std(WOBBLE, ddof=1) * np.sqrt(0.5))
    assert float(at["stick_fraction_deviation"]) == pytest.approx(deviation, rel=1e-6)
    assert float(at["worst_mismatch"]) == pytest.approx(abs(off) / 0.02)
    # Of the figures that there are: three shares, of which two are off, the line and the RMS.
    assert float(at["mismatch"]) == pytest.approx(np.sqrt(2.0 * (off / 0.02) ** 2 / 5.0))
    assert int(at["within"]) == (errors.YES if right else errors.NO)


def test_a_late_first_slip_is_not_right(file):
    late = {FAST: 0.102, PAPER: 0.1}
    data = file(lambda method, _: figures_of(0.6) | {"first_slip_time": late[method]})
    at = data.isel(method=0, setting=0, scene=0)
    assert float(at["first_slip_error"]) == pytest.approx(0.02)
    assert int(at["within"]) == errors.NO


def test_the_reference_has_no_errors_and_what_is_missing_none_either(file):
    data = file(lambda method, _: figures_of(0.6) if method == PAPER else {}, (DEFAULT, "step 0.75"))
    reference = data.sel({"method": PAPER, "setting": DEFAULT})
    assert np.all(reference["within"] == errors.UNKNOWN)
    assert reference["mismatch"].isnull().all()
    assert np.all(data["within"].sel({"method": FAST}) == errors.UNKNOWN)
    # Another setting of the reference's method is compared.
    assert np.all(data["within"].sel({"method": PAPER, "setting": "step 0.75"}) == errors.YES)


def test_without_the_reference_there_are_cut_offs_and_no_errors(file):
    data = file(lambda *_: figures_of(0.6), (DEFAULT, "cut-off 2.1"), (FAST,))
    assert "mismatch" not in data
    assert data["cutoff"].values.tolist() == [default_cutoff(Rig()), pytest.approx(50.8e3, rel=1e-3)]


def test_sticks_of_one_distribution_are_near_and_of_another_far(file):
    rng = np.random.default_rng(1)

    def values(method, setting):
        scale = 0.08 if (method, setting) == (FAST, "step 0.15") else 0.05
        return {"stick_time": rng.gamma(9.0, scale / 9.0, (4, runs.KEPT))}

    at = file(values, (DEFAULT, "step 0.15")).isel(method=0, scene=0)
    assert float(at["stick_time_ks_probability"][0]) > 0.01
    assert float(at["stick_time_ks_probability"][1]) < 1e-6
    assert float(at["stick_time_wasserstein"][1]) == pytest.approx(0.6, abs=0.1)
    assert float(at["mean_stick_time_error"][1]) == pytest.approx(0.6, abs=0.15)
    assert abs(float(at["mean_stick_time_deviation"][0])) < 4.0


def test_cut_offs_are_compared_with_all_modes_and_meshes_with_the_finest(file):
    onsets = {DEFAULT: 1.0, "cut-off 2.1": 1.1, "mesh 2": 1.25, "mesh 4": 2.0}
    data = file(lambda _, setting: {"onset_mu": onsets[setting]}, tuple(onsets), (LINEAR,))
    errors_found = data["onset_error"].isel(scene=0, termination=1).values
    np.testing.assert_allclose(errors_found, [0.5, 0.1, 0.375, np.nan])
    assert data["growth_error"].isnull().all()


# What is chosen, and how it is shown.


@given(st.lists(st.tuples(st.floats(0.01, 100.0), st.floats(0.01, 10.0), st.integers(0, 4)), max_size=12))
def test_the_front_is_what_nothing_beats(values):
    every = pd.DataFrame(values, columns=["cost", "mismatch", "right_scenes"], dtype=float).assign(known_scenes=4)
    front = rows.front(every)
    for each in every.itertuples():
        assert ((front["cost"] <= each.cost) & (front["mismatch"] <= each.mismatch)).any()
    for one in front.itertuples():
        assert not ((every["cost"] < one.cost) & (every["mismatch"] < one.mismatch)).any()
    right = every["cost"][every["right_scenes"] == 4]
    assert rows.cheapest_right(every)["cost"].tolist() == ([right.min()] if len(right) else [])


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
    data["gave_up_time"].loc[{"method": "SciPy solve_ivp", "setting": DEFAULT}] = 0.0123
    text = tables.text(findings.findings(data))
    assert "Reference: paper" in text
    assert "SciPy solve_ivp, default, 5 mm/s: gave up at 12.300 ms" in text
    assert ("Without paper by default" in text) != compared
    with figures.style():
        figure.draw(data).canvas.draw()


def test_a_small_study_from_end_to_end(tmp_path):
    """Two methods, the default and a coarse cut-off; the file completed later knows all errors."""
    store, given = tmp_path / "accuracy.nc", SMALL | {"method": FAST, "setting": DEFAULT}
    assert "mismatch" not in STUDY.sweep(given).plan(store).run("sync")
    given |= {"method": [FAST, PAPER, LINEAR], "setting": [DEFAULT, "cut-off 1.05"]}
    whole = STUDY.sweep(given).plan(store).run("sync")
    assert set(np.unique(whole["status"])) == {1, 3}
    at, reference = (whole.sel({"method": each, "setting": DEFAULT}).isel(scene=0) for each in (FAST, PAPER))
    assert 0.0 < float(at["batch_cpu_per_second"]) < 0.1 * float(reference["cpu_per_second"])
    expected = float(at["stick_fraction"].mean() - reference["stick_fraction"].mean())
    assert float(at["stick_fraction_error"]) == pytest.approx(expected, rel=1e-9)
    assert abs(float(at["stick_fraction_error"])) < 0.1
    assert float(at["spectrum_error"]) < 0.5
    assert float(at["first_slip_error"]) < 1e-3
    assert float(at["slip_velocity_error"]) < 0.5
    text = tables.text(findings.findings(whole))
    assert re.search(r"\nfast +cut-off 25.4 kHz .*/", text)
    assert re.search(r"\ncut-off 25.4 kHz +\d", text)
    with figures.style():
        figure.draw(whole).canvas.draw()
