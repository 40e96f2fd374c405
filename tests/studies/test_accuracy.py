"""Run time against error: the baselines are what they say, errors are errors, and scatter is scatter."""

import dataclasses
import json
import re

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from fivcore import Beam, Rig, Scene, Transient, flutter_onsets, simulate, sliding_modes
from fivcore.contact.reduced import TERMINATIONS, default_cutoff, full_model, reduced_model
from studies import tables
from studies.accuracy import burst as accuracy_burst
from studies.accuracy import elements as accuracy_elements
from studies.accuracy import errors as accuracy_errors
from studies.accuracy import figure as accuracy_figure
from studies.accuracy import findings as accuracy_report
from studies.accuracy import linear as accuracy_linear
from studies.accuracy import odes as accuracy_odes
from studies.accuracy import rows as accuracy_rows
from studies.accuracy import runs as accuracy_runs
from studies.accuracy import settings as asked
from studies.accuracy import solve_ivp as accuracy_events
from studies.accuracy import trajectory as accuracy_track
from studies.accuracy.study import STUDY, VARIABLES, check, key
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
    "scene": [2],
}
EVERY = [(method, option) for option in asked.OPTIONS for method in option.methods]


def recorded(method, end, rate=1e6, **given):
    return accuracy_track.track_of(simulate(QUICK, end, method, ramp=RAMP, record=True, sample_rate=rate, **given))


# The baselines.


def test_in_finite_elements_the_published_scheme_moves_as_in_modes():
    end = 0.5 * RAMP + ensembles.load_up(QUICK) + 6e-3
    found, known = accuracy_elements.run(QUICK, end, RAMP, 1e6), recorded("paper", end)
    assert found.first_slip_time == known.first_slip_time
    assert found.first_separation_time == known.first_separation_time < end
    assert accuracy_track.errors(found, known)["burst_velocity_error"] < 1e-6


# One of each kind.
OF_FAST = {option.kind: option for method, option in EVERY if method == asked.FAST}


@pytest.mark.parametrize("kind", OF_FAST)
def test_every_setting_of_fast_has_a_reference_for_the_first_burst(kind):
    option = OF_FAST[kind]
    scene = asked.meshed(QUICK, option)
    found = accuracy_burst.burst(asked.FAST, option, scene, asked.arguments(asked.FAST, option, scene), RAMP, 4)
    moves = kind == "contact"
    assert set(found) == (
        set() if moves else {name for name in VARIABLES if re.match("slip_.*error|burst_", name)}
    )
    assert all(0.0 < error < 5.0 for error in found.values())


def test_assembled_beams_have_the_modes_of_the_bases():
    parts = accuracy_elements.assemble(COARSE, 20.0)
    K, M = (np.zeros((len(parts.normal),) * 2) for _ in range(2))
    for whole, band in ((K, parts.K), (M, parts.M)):
        for d, row in enumerate(band):
            whole += np.diag(row[: len(row) - d], -d) + (np.diag(row[: len(row) - d], d) if d else 0.0)
    model = full_model(COARSE, 20.0)
    G = np.stack([parts.normal, parts.tangential])
    shapes = np.stack([model.normal, model.tangential])
    np.testing.assert_allclose(G @ np.linalg.solve(M, G.T), shapes @ shapes.T, rtol=1e-9)
    # The rigid mode is without stiffness, so flexibility is compared with a load on the stiffness.
    held = K + 1e3 * M
    np.testing.assert_allclose(
        G @ np.linalg.solve(held, G.T), (shapes / (model.stiffness + 1e3)) @ shapes.T, rtol=1e-7
    )


def test_solve_ivp_comes_to_the_exact_motion_as_its_tolerance_falls():
    scene = Scene(0.1, 12.0, 0.35, 9.0, COARSE)
    end = 0.5 * RAMP + ensembles.load_up(scene) + 2e-3
    common = {"cutoff": default_cutoff(COARSE), "ramp": RAMP}
    exact = accuracy_track.track_of(simulate(scene, end, "exact", record=True, sample_rate=1e6, **common))
    assert exact.first_separation_time < end
    model, wrong = reduced_model(COARSE, scene.theta), []
    for tolerance in (1e-4, 1e-6, 1e-8):
        found, reached = accuracy_events.run(scene, model, end, RAMP, tolerance, exact.time)
        assert reached == end
        wrong.append(accuracy_track.errors(found, exact)["slip_velocity_error"])
    assert wrong[2] < 1e-4
    assert wrong[0] > 10.0 * wrong[1] > 100.0 * wrong[2]
    assert found.first_separation_time == pytest.approx(exact.first_separation_time, rel=1e-6)


def test_where_events_do_not_end_solve_ivp_gives_up_and_says_where(monkeypatch):
    monkeypatch.setattr(accuracy_events, "MOST_EVENTS", 2)
    monkeypatch.setattr(accuracy_events, "NO_TIME", 1e-3)
    times = np.arange(0.0, 0.02, 1e-5)
    found, reached = accuracy_events.run(QUICK, reduced_model(COARSE, 5.0), 0.02, RAMP, 1e-4, times)
    assert found.first_slip_time < reached < 0.02
    assert found.time[-1] < reached


# Sliding stability of reduced models.


@settings(deadline=None, max_examples=6)
@given(st.integers(0, 10_000), st.floats(1.0, 40.0), st.floats(0.05, 0.6))
def test_with_all_modes_the_plain_matrix_has_the_sliding_modes(seed, theta, mu):
    rig = workshop_rig(seed)
    known = sliding_modes(rig, theta, mu)
    found = accuracy_odes.sliding_eigenvalues(full_model(rig, theta), mu)
    scale = 2.0 * np.pi * known.frequency.max()
    for rate, frequency in zip(known.growth_rate, known.frequency, strict=True):
        value = rate + 2j * np.pi * frequency
        assert np.abs(found - value).min() < 1e-6 * scale


@pytest.mark.parametrize("termination", TERMINATIONS)
def test_the_element_keeps_the_onset_that_dropping_modes_moves(termination):
    onset = flutter_onsets(Rig(), 5.0).mu[0]
    wrong = [
        abs(accuracy_linear.onset_of(reduced_model(Rig(), 5.0, cutoff, termination), onset) / onset - 1.0)
        for cutoff in (25e3, 50e3, 100e3)
    ]
    assert wrong[0] > wrong[1] > wrong[2]
    order = np.log2(wrong[1] / wrong[2])
    if termination == "none":
        assert 0.6 < order < 1.4
    else:
        assert order > 2.0
        assert wrong[1] < 2e-4


def test_errors_of_meshes_fall_with_the_fourth_order():
    at = {
        option.value: accuracy_linear.stability(Scene(5e-3, 5.0, 0.2, 9.0), option)
        for option in asked.OPTIONS
        if option.kind == "mesh"
    }
    for name in ("onset_mu", "growth_rate"):
        wrong = [abs(at[factor][name][0] / at[4.0][name][0] - 1.0) for factor in (0.5, 2.0)]
        assert np.log(wrong[0] / wrong[1]) / np.log(4.0) == pytest.approx(4.0, abs=0.5)


# Settings.


@pytest.mark.parametrize(
    ("method", "option"),
    [pair for pair in EVERY if pair[0] in asked.SIMULATED],
    ids=lambda each: each.label(Rig()) if isinstance(each, asked.Option) else asked.METHODS[each],
)
def test_every_setting_is_one_that_its_method_takes(method, option):
    for number in (2, 3):  # the paper's three speeds are one rig with one limit
        scene = asked.meshed(asked.scene_of(number, Rig()), option)
        arguments = asked.arguments(method, option, scene)
        simulate(scene, 1e-5, asked.SIMULATED[method], ramp=RAMP, **arguments)


def test_steps_are_shares_of_the_largest():
    scene = asked.scene_of(2, Rig())
    for method in (asked.FAST, asked.PAPER):
        limit = asked.step_limit(method, scene, {})
        simulate(scene, 1e-5, asked.SIMULATED[method], step=0.9999 * limit)
        with pytest.raises(ValueError, match="at most"):
            simulate(scene, 1e-5, asked.SIMULATED[method], step=1.0001 * limit)


def test_labels_tell_all_settings_apart():
    assert len({option.label(Rig()) for option in asked.OPTIONS}) == len(asked.OPTIONS)
    assert asked.OPTIONS[asked.DEFAULT].kind == "default"


def test_what_does_not_go_together_is_skipped_and_stability_is_computed_once():
    points = {
        name: values.ravel()
        for name, values in zip(
            ("method", "setting", "scene"),
            np.meshgrid(*(np.arange(len(axis)) for axis in STUDY.axes.values()), indexing="ij"),
            strict=True,
        )
    }
    kept = ~asked.skip(points)
    assert kept.sum() == len(EVERY) * len(asked.SCENES)
    rows = key({name: values[kept] for name, values in points.items()})
    linear = points["method"][kept] == asked.LINEAR
    # The paper's three speeds are one question.
    assert len(np.unique(rows[linear], axis=0)) == linear.sum() // 2
    assert len(np.unique(rows[~linear], axis=0)) == (~linear).sum()


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"method": 6}, "method = 6: it must be a whole number from 0 to 5"),
        ({"setting": [0, 99]}, "setting = 99: it must be a whole number from 0 to "),
        ({"scene": -1}, "scene = -1: it must be a whole number from 0 to 3"),
        ({"members": 0}, "members = 0.0: it must be a whole number from 1 to 100"),
        ({"recorded": 2.5}, "recorded = 2.5: it must be a whole number"),
        ({"ramp": 0.0}, "ramp = 0.0: it must be a number from 1e-06 to 1 (s, for members differ by it)"),
        ({"duration": 0.3}, "duration = 0.3: it must be a number from 0.34"),
        ({"variant_duration": 0.1}, "variant_duration = 0.1: it must be a number from 0.34"),
        ({"contact_position": 1.0}, "contact_position = 1"),
    ],
)
def test_bad_input_is_named_before_anything_is_planned(given, text):
    with pytest.raises(ValueError, match=re.escape(text)) as caught:
        STUDY.sweep(given)
    assert "\n" not in str(caught.value)


def test_the_shortest_run_is_that_of_the_slowest_scene_asked_for():
    given = {name: setting.value for name, setting in STUDY.settings.items()} | {"rig": Rig()}
    quick = {"method": Axis([0]), "setting": Axis([0]), "scene": Axis([2])}
    check(quick, given | {"variant_duration": 0.3})
    with pytest.raises(ValueError, match="variant_duration"):
        check(quick | {"scene": Axis([0])}, given | {"variant_duration": 0.3})


# Errors and scatter.


@settings(deadline=None)
@given(st.integers(2, 9), st.integers(2, 9), st.integers(0, 10_000))
def test_over_equal_times_a_deviation_is_students_t(n, m, seed):
    rng = np.random.default_rng(seed)
    one, other = rng.normal(1.0, 0.3, n), rng.normal(1.1, 0.3, m)
    values = np.full((2, max(n, m)), np.nan)
    values[0, :n], values[1, :m] = one, other
    own = accuracy_errors.Ensembles.of(values[:1, None, None], 2.0)
    error, standard = own.beside(accuracy_errors.Ensembles.of(values[1:, None, None], 2.0))
    known = stats.ttest_ind(one, other, equal_var=True)
    np.testing.assert_allclose((error / standard).ravel(), known.statistic, rtol=1e-9)


def test_a_run_twice_as_long_scatters_half_as_much():
    """Of long and of short runs of one process, the deviations of the mean are normal, whatever is pooled."""
    rng = np.random.default_rng(3)
    short = rng.normal(0.0, 1.0, (4000, 3))
    long = rng.normal(0.0, np.sqrt(0.25), (4000, 12))
    of = accuracy_errors.Ensembles.of
    error, standard = of(short, 1.0).beside(of(long, 4.0))
    # Of 13 degrees of freedom.
    assert np.std(error / standard) == pytest.approx(np.sqrt(13.0 / 11.0), rel=0.03)


def test_a_sine_is_in_its_band_with_half_its_square():
    t = np.arange(0.0, 1.0, 1.0 / (transients.OVERSAMPLING * accuracy_runs.SAMPLE_RATE))
    for n, neighbours in ((25, 1), (33, 0), (38, 0)):
        v = 0.3 * np.sin(2.0 * np.pi * 10.0 ** (n / 10.0) * t)
        summary = {"first_slip_time": 0.05}
        power = accuracy_runs.band_powers(Transient(QUICK, summary, time=t, velocity_B=v))
        # A window of 25 ms spreads a line over 80 Hz, more than the lowest bands are wide.
        inside = np.abs(accuracy_runs.BANDS - n) <= neighbours
        assert power[inside].sum() == pytest.approx(0.5 * 0.3**2, rel=0.02)
        assert power[~inside].sum() < 0.02 * power[inside].sum()


def told(values, options=(0,), methods=(asked.FAST, asked.PAPER), members=4):
    """A file with the figures `values(method, setting)` at one scene, by name, and nothing else."""
    shapes = {"member": members, "stick": accuracy_runs.KEPT, "band": len(accuracy_runs.BANDS), "termination": 3}
    whole = {
        name: np.full((len(methods), len(options), 1, *(shapes[dim] for dim in each.dims)), np.nan)
        for name, each in VARIABLES.items()
    }
    for j, method in enumerate(methods):
        for k, option in enumerate(options):
            for name, value in values(method, option).items():
                whole[name][j, k, 0] = value
    dims = ("method", "setting", "scene")
    coords = {"method": list(methods), "setting": list(options), "scene": [2], "termination": list(TERMINATIONS)}
    data = xr.Dataset(
        {name: ((*dims, *VARIABLES[name].dims), part) for name, part in whole.items()}, coords=coords
    )
    return accuracy_errors.with_errors(data, rig=Rig())


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
def test_a_setting_is_right_within_tolerance_and_scatter(off, right):
    data = told(lambda method, _: figures_of(0.6 + (off if method == asked.FAST else 0.0)))
    at = data.isel(method=0, setting=0, scene=0)
    assert float(at["stick_fraction_error"]) == pytest.approx(off)
    assert float(at["stick_fraction_deviation"]) == pytest.approx(
        off / (np.std(WOBBLE, ddof=1) * np.sqrt(0.5)), rel=1e-6
    )
    assert float(at["worst_mismatch"]) == pytest.approx(abs(off) / 0.02)
    # Of the figures that there are: three shares, of which two are off, the line and the RMS.
    assert float(at["mismatch"]) == pytest.approx(np.sqrt(2.0 * (off / 0.02) ** 2 / 5.0))
    assert int(at["within"]) == (accuracy_errors.YES if right else accuracy_errors.NO)


def test_the_reference_has_no_errors_and_what_is_missing_none_either():
    data = told(lambda method, setting: figures_of(0.6) if method == asked.PAPER else {}, (0, 5))
    assert int(data["within"].sel({"method": asked.PAPER, "setting": 0})[0]) == accuracy_errors.UNKNOWN
    assert np.isnan(data["mismatch"].sel({"method": asked.PAPER, "setting": 0}).values).all()
    assert np.all(data["within"].sel({"method": asked.FAST}) == accuracy_errors.UNKNOWN)
    assert data["method_name"].values.tolist() == ["fast", "paper"]


def test_without_the_reference_names_are_all_there_is():
    data = told(lambda method, setting: figures_of(0.6), (0, 1), (asked.FAST,))
    assert "mismatch" not in data
    assert data["setting_name"].values.tolist() == ["default", asked.OPTIONS[1].label(Rig())]


def test_sticks_of_one_distribution_are_near_and_of_another_far():
    rng = np.random.default_rng(1)

    def values(method, setting):
        scale = {asked.PAPER: 0.05, asked.FAST: 0.05 if setting == 0 else 0.08}[method]
        return {"stick_time": rng.gamma(9.0, scale / 9.0, (4, accuracy_runs.KEPT))}

    at = told(values, (0, 1)).isel(method=0, scene=0)
    assert float(at["stick_time_ks_probability"][0]) > 0.01
    assert float(at["stick_time_ks_probability"][1]) < 1e-6
    assert float(at["stick_time_wasserstein"][1]) == pytest.approx(0.6, abs=0.1)
    assert float(at["mean_stick_time_error"][1]) == pytest.approx(0.6, abs=0.15)
    assert abs(float(at["mean_stick_time_deviation"][0])) < 4.0


# What is chosen, and how it is shown.

points = st.lists(st.tuples(st.floats(0.01, 100.0), st.floats(0.01, 10.0), st.integers(0, 4)), max_size=12)


def row(cost, mismatch, right):
    return accuracy_rows.Row(0, 0, "step", "step", cost, np.nan, mismatch, 0.1, mismatch, np.nan, right, 4)


@given(points)
def test_the_front_is_what_nothing_beats(given):
    every = [row(*each) for each in given]
    front = accuracy_rows.front(every)
    for each in every:
        beaten = any(other.cost <= each.cost and other.mismatch <= each.mismatch for other in front)
        assert beaten
    for one in front:
        assert not any(other.cost < one.cost and other.mismatch < one.mismatch for other in every)
    best = accuracy_rows.cheapest_right(every)
    right = [each.cost for each in every if each.right == 4]
    assert (best is None) == (not right)
    assert best is None or best.cost == min(right)


@pytest.mark.parametrize(
    "values",
    [
        lambda method, setting: figures_of(0.6, cost=0.02),
        lambda method, setting: figures_of(0.6) if method == asked.PAPER else {},
        lambda method, setting: {},
    ],
)
def test_whatever_is_there_is_told_and_drawn(values):
    data = told(values, (0, 5, 8))
    told_of = {"reference_members": 2, "members": 3, "duration": 1.0, "rig": dataclasses.asdict(Rig())}
    data.attrs["configuration"] = json.dumps({"constants": told_of})
    data["status"] = (("method", "setting", "scene"), np.ones(data["step"].shape, dtype=np.int8))
    text = tables.text(accuracy_report.findings(data))
    assert "Reference: paper" in text
    with figures.style():
        accuracy_figure.draw(data).canvas.draw()


def test_a_small_study_from_end_to_end(tmp_path):
    """Two methods, the default and a coarse cut-off; the file completed later knows all errors."""
    first = STUDY.sweep(SMALL | {"method": [0], "setting": [0]}).plan(tmp_path / "accuracy.nc").run("sync")
    assert "mismatch" not in first
    whole = (
        STUDY.sweep(SMALL | {"method": [0, 1, 5], "setting": [0, 8]}).plan(tmp_path / "accuracy.nc").run("sync")
    )
    assert set(np.unique(whole["status"])) == {1, 3}
    at = whole.sel({"method": asked.FAST, "setting": 0}).isel(scene=0)
    reference = whole.sel({"method": asked.PAPER, "setting": 0}).isel(scene=0)
    assert 0.0 < float(at["batch_cpu_per_second"]) < 0.1 * float(reference["cpu_per_second"])
    expected = float(at["stick_fraction"].mean() - reference["stick_fraction"].mean())
    assert float(at["stick_fraction_error"]) == pytest.approx(expected, rel=1e-9)
    assert abs(float(at["stick_fraction_error"])) < 0.1
    assert float(at["spectrum_error"]) < 0.5
    assert float(at["first_slip_error"]) < 1e-3
    assert float(at["slip_velocity_error"]) < 0.5
    text = tables.text(accuracy_report.findings(whole))
    assert "fast by default" in text
    assert "Sliding stability" in text
    with figures.style():
        accuracy_figure.draw(whole).canvas.draw()
