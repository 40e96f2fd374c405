"""Run time against error: settings are what they say, errors are errors, and costs are of the runs alone."""

import re
import time
from contextlib import nullcontext
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy import stats

from fivcore import Rig, Scene, simulate, sliding_modes
from fivcore.contact.reduced import default_cutoff, reduced_model
from studies.accuracy import errors, presentation, study
from studies.accuracy.settings import CONVERGED, DEFAULT, FAST, PAPER, PUBLISHED, SETTINGS, TWO, scene_of
from studies.accuracy.study import STUDY
from studies.answering import summary
from studies.asking.sweep import sweep_of
from studies.plotting import figures

# A scene; deviations of four runs from their mean.
QUICK, WOBBLE = Scene(0.05, 5.0, 0.2, 9.0), 1e-3 * np.array([-1.0, 1.0, -2.0, 2.0])
POINTS = [(method, name, at) for name, of in SETTINGS.items() for method, ats in of.scenes.items() for at in ats]
ONCE = {point[:2]: point for point in reversed(POINTS) if point[2] in TWO}.values()


@pytest.mark.parametrize(
    ("method", "name", "at"),
    # Of each setting one quick scene; those of the reference are computed.
    [pytest.param(*point, marks=[pytest.mark.slow] * (point not in ONCE)) for point in POINTS if point[2] in TWO],
)
def test_every_setting_is_one_that_its_method_takes(method, name, at):
    scene = scene_of(at, Rig())
    simulate(scene, 1e-5, method, ramp=1e-3, **SETTINGS[name].options(scene))


def test_scenes_vibrate_steps_are_shares_of_the_largest_and_dampings_have_names():
    for scene in (scene_of(name, Rig()) for name in study.SCENES):
        assert sliding_modes(scene.rig, scene.theta, scene.mu).growth_rate.max() > 0.0
    options = {name: setting.options(scene) for name, setting in SETTINGS.items()}
    simulate(scene, 1e-5, step=0.9999 * options["step 0.5"]["step"] / 0.5)
    with pytest.raises(ValueError, match="at most"):
        simulate(scene, 1e-5, step=1.0001 * options["step 0.5"]["step"] / 0.5)
    assert options[PUBLISHED] == {"numerical_damping": "published"}
    assert options["numerical damping none"] == {"numerical_damping": "none", "step": 1e-8}
    model = reduced_model(scene.rig, scene.theta, cutoff := 3.0 * default_cutoff(scene.rig))
    assert options[CONVERGED] == {"cutoff": cutoff, "step": 0.5 * model.default_step}


def test_bad_input_is_named_before_anything_is_planned():
    for values, text in (
        ({"members": 0}, "members = 0: it must be a whole number from 1 to 100"),
        ({"members": 2, "members_expensive": 3}, "members_expensive = 3: it must be a whole number from 1 to 2"),
        ({"ramp": 0.0}, "ramp = 0.0: it must be a number from 1e-06 to 1 (s, for the runs of a scene differ"),
        ({"duration": 0.3}, "duration = 0.3: it must be a number from 0.34"),
    ):
        with pytest.raises(ValueError, match=re.escape(text)):
            sweep_of(STUDY, values)


def test_while_a_point_is_timed_no_other_is_computed(monkeypatch):
    spans = []

    def measured(*_, **__):
        spans.append([time.perf_counter(), time.sleep(0.05), time.perf_counter()])
        return {}

    monkeypatch.setattr(study, "measure", measured)
    sweep_of(STUDY, {"method": FAST, "setting": [DEFAULT, "step 0.5"], "scene": "5 mm/s"}).plan().run(
        "threads", workers=2
    )
    assert all(one[2] <= other[0] for one, other in pairwise(sorted(spans)))


def test_deviations_are_students_t_and_a_run_four_times_as_long_has_half_the_standard_error():
    def deviations(*ensembles, times):
        arrays = [xr.DataArray(values, dims=("setting", "member")) for values in ensembles]
        error, standard, _ = errors.difference(*arrays, *times)
        return (error / standard).values

    rng = np.random.default_rng(3)
    for n, m in ((2, 9), (5, 3), (7, 2)):
        one, other = rng.normal(1.0, 0.3, (1, n)), rng.normal(1.1, 0.3, (1, m))
        padded = np.pad(one, ((0, 0), (0, 3)), constant_values=np.nan)
        known = stats.ttest_ind(one[0], other[0], equal_var=True).statistic
        assert deviations(padded, other, times=(2.0, 2.0))[0] == pytest.approx(known, rel=1e-9)
    short, long = rng.normal(0.0, 1.0, (4000, 3)), rng.normal(0.0, np.sqrt(0.25), (4000, 12))
    assert np.std(deviations(short, long, times=(1.0, 4.0))) == pytest.approx(np.sqrt(13.0 / 11.0), rel=0.03)


@pytest.fixture
def file(monkeypatch):
    """The study's file with `values(method, setting)` in place of what is computed."""

    def made(values, options=(DEFAULT, CONVERGED), methods=(FAST, PAPER), scenes=("5 mm/s",)):
        monkeypatch.setattr(study, "measure", lambda *pair, **_: dict(values(*pair[:2])))
        monkeypatch.setattr(study, "TURN", nullcontext())
        axes = {"method": list(methods), "setting": list(options), "scene": list(scenes)}
        return sweep_of(STUDY, {"members": 4} | axes).plan().run("sync")

    return made


def statistics(stick, cost=1.0, time=1.0, **more):
    fractions = {"stick_fraction": stick, "slip_fraction": 0.1, "separation_fraction": 0.9 - stick}
    values = {name: value + WOBBLE for name, value in fractions.items()}
    values |= {"dominant_frequency": 2600.0 * (1.0 + WOBBLE), "velocity_rms": 0.01 * (1.0 + WOBBLE)}
    constant = {name: value + 0.0 * WOBBLE for name, value in {"observed_time": time, **more}.items()}
    return values | constant | {"cpu_per_second": cost}


@pytest.mark.parametrize(
    ("pair", "off", "late", "right"),
    [((FAST, PUBLISHED), 0.019, 0, 1), ((FAST, DEFAULT), -0.03, 0, 0), ((FAST, DEFAULT), 0.01, 0.02, 0)],
)
def test_a_setting_is_right_within_tolerance_and_slips_when_it_should(file, pair, off, late, right):
    """By the reference of its own damping; whatever has the other is far off."""
    reference = (PAPER, DEFAULT) if pair[1] == PUBLISHED else (FAST, CONVERGED)
    at = {pair: (off, 0.1 * (1.0 + late)), reference: (0.0, 0.1)}

    def values(*other):
        shift, slip = at.get(other, (0.25, 1.0))
        return statistics(0.6 + shift, first_slip_time=slip)

    data = file(values, (DEFAULT, CONVERGED, PUBLISHED)).sel({"method": pair[0], "setting": pair[1]}).isel(scene=0)
    stick, standard = data.sel(quantity="stick_fraction"), np.std(WOBBLE, ddof=1) * np.sqrt(0.5)
    assert float(stick["quantity_error"]) == pytest.approx(off)
    assert float(stick["quantity_standard_error"]) == pytest.approx(standard, rel=1e-6)
    # Of five finite errors, three fractions, the frequency and the RMS, two are off.
    assert float(data["mismatch"]) == pytest.approx(np.sqrt(2.0 * (off / 0.02) ** 2 / 5.0), abs=1e-12)
    assert float(data["first_slip_error"]) == pytest.approx(late)
    assert int(data["within"]) == right


def test_a_dominant_frequency_is_that_of_a_run_of_the_reference_or_a_rival_peak(file, monkeypatch):
    found = {CONVERGED: [2600.0, 2600.0, 2600.0, 5000.0], DEFAULT: 5050.0, "step 0.5": 5250.0, "damping 3": 3030.0}

    def values(_, setting):
        rivals = {"rival_peaks": [3000.0]} if setting == CONVERGED else {}
        return statistics(0.6, dominant_frequency=np.array(found[setting])) | rivals

    data = file(values, tuple(found), (FAST,)).isel(method=0, scene=0).sel(quantity="dominant_frequency")
    np.testing.assert_allclose(data["quantity_error"].sel(setting=list(found)), [np.nan, 0.01, 0.05, 0.01])
    times = np.arange(40000) / study.RATE
    waves = sum(a * np.sin(2.0 * np.pi * f * times) for a, f in ((1.0, 3e3), (0.8, 5e3), (0.6, 7e3)))
    monkeypatch.setattr(study.series, "velocity", lambda *_: waves)
    peaks = study.rival_peaks(QUICK, times[-1] + 1.0 / study.RATE, {"ramp": 1e-3})
    np.testing.assert_allclose(peaks, [3e3, 5e3], rtol=1e-2)


def test_the_cheapest_is_right_at_every_scene_and_a_result_without_values_has_a_summary_and_a_figure(file):
    for right, cheapest in (([4, 3, 4], [2.0]), ([3, 0, 1], [])):
        rows = pd.DataFrame({"cost": [3.0, 1.0, 2.0]})
        for group in presentation.GROUPS:
            rows[f"right {group}"], rows[f"compared {group}"] = right, 4
        assert presentation.cheapest_right(rows)["cost"].tolist() == cheapest
    for values in ({}, statistics(0.6)):
        data = file(lambda *_, values=values: values, scenes=("5 mm/s", "rig 3"))
        assert "percentage points" in summary.text(STUDY.summary(data))
        with figures.style():
            STUDY.figure(data).canvas.draw()
