"""Grids of scenes: copies have the bits of their own simulation, and what is recorded is what happens."""

import json

import numpy as np
import pytest

from fivcore import Rig, Scene, critical_mu, simulate, simulate_many
from fivcore.contact import reduced
from studies import registry
from studies.gallery.scenes import study as scenes
from studies.motion import jobs as runs
from studies.motion import recording, transients
from studies.plotting import figures

# One geometric ratio for V and F, no power of two, and with it the same V / F again and again.
RATIO = 10.0 ** (1.0 / 3.0)
SHORT = {"duration": 0.15, "settle": 0.02}


def direct(V, theta, mu, F, rig=None, **given):
    """One scene as anyone would simulate it."""
    return simulate(Scene(V, theta, mu, F, rig or Rig()), SHORT["duration"], settle=SHORT["settle"], **given)


def test_every_point_has_the_bits_of_its_own_simulation(computed):
    axes = {
        "V": np.concatenate([[-7e-3], 4e-3 * RATIO ** np.arange(3)]),
        "theta": [-5.0, 0.0, 5.0],
        "mu": [0.2, 0.3],
        "F": 3.7 * RATIO ** np.arange(3),
    }
    data = computed("scenes", **SHORT, **axes, head_mass=2.0)
    assert data["velocity_rms"].dims == ("V", "theta", "mu", "F")
    for place in list(np.ndindex(*data["velocity_rms"].shape))[::5]:
        at = data.isel(dict(zip(data["velocity_rms"].dims, place, strict=True)))
        run = direct(*(float(at[name]) for name in transients.SCENE), rig=Rig(head_mass=2.0))
        for name, value in transients.figures_of(run).items():
            np.testing.assert_array_equal(at[name].values, value, err_msg=f"{name} at {place}")


def test_a_grid_is_planned_as_its_distinct_scenes():
    axes = {"V": 1e-3 * RATIO ** np.arange(10), "F": 0.9 * RATIO ** np.arange(10)}
    axes |= {"theta": np.linspace(-15.0, 15.0, 13), "mu": np.linspace(0.05, 0.55, 11)}
    plan = scenes.STUDY.sweep(axes | {"duration": 1e-3}).plan()
    assert (plan.points, plan.distinct) == (14_300, 19 * 13 * 11)


def test_a_basis_is_built_once_for_each_inclination(computed):
    for cached in (reduced.full_model, reduced.reduced_model):
        cached.cache_clear()
    computed("scenes", **SHORT, V=[4e-3, 6e-3, 8e-3], theta=[2.0, 4.0, 6.0], mu=[0.2, 0.3], F=9.0)
    # One for the run and one for its onset.
    assert reduced.reduced_model.cache_info().misses == 2 * 3
    assert reduced.full_model.cache_info().misses == 3


def test_a_mirror_image_is_a_copy_and_another_theta_is_not(tmp_path):
    given = SHORT | {"V": [-6e-3, 6e-3], "theta": [-5.0, 0.0, 5.0], "mu": 0.2, "F": 9.0}
    sweep = scenes.STUDY.sweep(given)
    plan = sweep.plan(tmp_path / "scenes.nc")
    assert (plan.points, plan.distinct) == (6, 3)
    data = plan.run("sync")
    for name in transients.SUMMARY:
        left, right = data[name].sel(V=-6e-3), data[name].sel(V=6e-3)
        np.testing.assert_array_equal(left.values[::-1], right.values)
    # Digging in, it vibrates; trailing, it slides.
    assert float(data["velocity_rms"].sel(V=-6e-3, theta=-5.0).squeeze()) > 1e-3
    assert float(data["velocity_rms"].sel(V=-6e-3, theta=5.0).squeeze()) < 1e-3


def test_a_scene_without_an_answer_fails_alone(computed):
    given = SHORT | {"theta": 40.0, "mu": [0.1, 0.2, 0.3, 5.0, 6.0], "V": [5e-3, 1e-2], "F": [4.5, 9.0]}
    data = computed("scenes", **given)
    np.testing.assert_array_equal(data["status"].sel(theta=40.0)[:, :3], 1)
    np.testing.assert_array_equal(data["status"].sel(theta=40.0)[:, 3:], 2)
    texts = data["error"].sel(mu=5.0).values.ravel()
    limit = f"ContactError: mu = 5: from {critical_mu(Rig(), 40.0):.6g} on"
    assert all(text.startswith(limit) and "is a copy of" in text for text in texts)
    assert np.all(np.isnan(data["velocity_rms"].sel(mu=5.0)))
    report = scenes.STUDY.report(data)
    assert "20 scenes of 0.15 s on the paper's rig, without numerical damping, 15 computed" in report
    assert report.count("failed: V") == 5
    assert "and 3 more failed." in report


@pytest.mark.parametrize("V", [6e-3, -6e-3])
def test_what_is_recorded_is_the_motion(V):
    theta = 5.0 if V > 0 else -5.0
    rate, given = 40e3, SHORT | {"V": [V, 3.1 * V], "theta": [theta, -theta], "mu": 0.2, "F": [3.0, 9.0]}
    data = scenes.STUDY.sweep(given, record=tuple(recording.SERIES), sample_rate=rate).plan().run("sync")
    times = data["elapsed"].values
    np.testing.assert_array_equal(times, np.arange(6000) / rate)
    assert data["elapsed"].attrs["units"] == "s"
    for F in (3.0, 9.0):
        at = data.sel(V=V, theta=theta, mu=0.2, F=F)
        run = direct(V, theta, 0.2, F, record=True, sample_rate=1e6)
        for name in ("velocity_B", "normal_force", "tangential_force", "slip_velocity"):
            assert data[name].dims == ("V", "theta", "mu", "F", "elapsed")
            assert data[name].dtype == np.float32
            assert data[name].attrs["units"] == recording.SERIES[name].units
            # Rounded to four digits once before it is multiplied and once after.
            expected = np.interp(times, run.time, getattr(run, name))
            np.testing.assert_allclose(at[name], expected, rtol=1.1e-4, atol=1e-30)
        earlier = np.maximum(np.searchsorted(run.time, times, side="right") - 1, 0)
        np.testing.assert_array_equal(at["state"], run.state[earlier])
    assert data["state"].attrs["flag_meanings"] == "separation stick slip"
    assert "flag_values" in data["regime"].attrs
    assert "6000 samples at 40000 Hz" in scenes.STUDY.report(data)
    plain = scenes.STUDY.sweep(given).plan().run("sync")
    for name in transients.SUMMARY:
        np.testing.assert_array_equal(data[name], plain[name])


def test_nothing_is_recorded_that_was_not_asked_for(monkeypatch):
    told = []
    monkeypatch.setattr(runs, "simulate_many", lambda *a, **k: told.append(k) or simulate_many(*a, **k))
    for record in ((), ("state",)):
        sweep = scenes.STUDY.sweep(SHORT | {"V": 5e-3, "theta": 5.0, "mu": 0.2, "F": 9.0}, record=record)
        assert set(sweep.variables) == {*transients.SUMMARY, "simulated_time", *record}
        assert {"record", "sample_rate"} & {*sweep.constants} == ({"record", "sample_rate"} if record else set())
        found = sweep.function(sweep.grid.points(), **sweep.constants)
        assert set(found) == {*transients.SUMMARY, "simulated_time", *record, "error", "wall_time"}
        assert (told[-1]["record"] or ()) == record
    assert found["state"].shape == (1, round(SHORT["duration"] * recording.SAMPLE_RATE))


@pytest.mark.parametrize(("name", "axis"), [("fig7", "V"), ("fig11", "theta")])
def test_a_study_with_times_of_its_own_records_there(name, axis):
    study, value = registry.load(name), {"V": 5e-3, "theta": 10.0}[axis]
    given = {"duration": 0.12, axis: value}
    sweep = study.sweep(given, record=("normal_force", "velocity_B", "state"), sample_rate=20e3)
    data = sweep.plan().run("sync")
    assert data.sizes["elapsed"] == 2400
    plain = study.sweep(given | {"sample_rate": 20e3}).plan().run("sync")
    for variable in plain.data_vars:
        if variable != "wall_time":
            np.testing.assert_array_equal(data[variable], plain[variable])
    held = json.loads(data.attrs["configuration"])["constants"]
    assert held["record"] == ["normal_force", "state"]
    scene = Scene(value if axis == "V" else held["V"], value if axis == "theta" else held["theta"], 0.2, 9.0)
    run = simulate(scene, 0.12, numerical_damping="published", record=True, sample_rate=1e6)
    expected = np.interp(data["elapsed"], run.time, run.normal_force)
    np.testing.assert_allclose(data["normal_force"].squeeze(), expected, rtol=1e-4)
    assert data["state"].attrs["flag_meanings"] == "separation stick slip"
    if name == "fig7":
        assert data["long_stick"].attrs["flag_meanings"] == "no yes"
    # What it keeps anyway adds nothing.
    alone = study.sweep(given, record="velocity_B")
    assert set(alone.variables) == set(plain.data_vars) - {"status", "error", "wall_time", "glued_frequency"}
    assert "record" not in alone.constants
    with figures.style():
        study.draw(data)


def test_scenes_run_until_their_shares_are_known(computed):
    """Each as long as it needs, unless all have one duration or their series are recorded."""
    given = {"V": [5e-3, 2e-2], "theta": 5.0, "mu": 0.2, "F": 9.0, "standard_error": 0.02, "least": 0.1}
    data = computed("scenes", **given)
    times = data["simulated_time"].values.ravel()
    assert times[0] != times[1]
    assert (times > 0.2).all()
    assert (data["stick_fraction_se"] <= 0.02).all()
    assert "Each runs until the shares of time are known to 0.02" in scenes.STUDY.report(data)
    recorded = scenes.STUDY.sweep(given, record=["velocity_B"])
    assert recorded.constants["duration"] == recording.DURATION
