"""The studies of motion in time: the physics of what they find, what they store, draw and refuse."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from fivcore import Rig, glued_frequencies
from studies import paper, registry, runner
from studies.gallery import contact
from studies.motion import regimes, transients
from studies.study import constants


@pytest.fixture(scope="module")
def histories(computed):
    return computed("fig7", duration=1.5)


@pytest.fixture(scope="module")
def contacts(computed):
    return computed("contact", duration=0.8)


@pytest.fixture(scope="module")
def angles(computed):
    return computed("fig11", duration=0.8)


@pytest.fixture
def dataset(name, histories, contacts, angles):
    return {"fig7": histories, "contact": contacts, "fig11": angles}[name]


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("fig7", ["2700", "5400", "8100", "2080", "6500", "intermittent", "periodic"]),
        ("contact", ["25", "30", "50", "120"]),
        ("fig11", ["2700", "steady sliding"]),
    ],
)
def test_a_report_has_the_papers_numbers_for_the_papers_rig_alone(name, numbers, dataset, computed):
    report = registry.load(name).report
    for number in ("paper", *numbers):
        assert re.search(rf"\b{number}\b", report(dataset))
    assert "paper" not in report(computed(name, duration=0.2, head_mass=1.0))


def test_the_first_slip_comes_when_the_clamp_has_moved_far_enough(histories):
    expected = 0.5 * constants(histories)["ramp"] + 0.1435e-3 / histories["V"]
    np.testing.assert_allclose(histories["first_slip_time"], expected, rtol=0.01)
    assert np.all(histories["first_separation_time"] > histories["first_slip_time"])


def test_the_rig_sings_at_the_papers_frequency_and_rings_glued_while_stuck(histories):
    at = histories.sel(V=5e-3)
    assert 0.985 * 2580.0 < float(at["dominant_frequency"]) < 1.015 * 2650.0
    frequency = histories["frequency"].values
    line = transients.line_near(frequency, at["spectrum"].values, float(at["dominant_frequency"]))
    assert line == pytest.approx(float(at["dominant_frequency"]), rel=0.01)
    glued = glued_frequencies(Rig(), 5.0, 8)
    np.testing.assert_allclose(histories["glued_frequency"], glued)
    stuck = histories["spectrum_stuck"].sel(V=1e-3).values
    for said, mode in zip(paper.OTHER_LINES, glued[[3, 6]], strict=True):
        assert transients.line_near(frequency, stuck, said) == pytest.approx(mode, abs=3.0)


def test_long_sticks_are_marked_where_they_are_counted(histories):
    """At 1 mm/s the vibration is intermittent; at 2 and 5 mm/s a long stick at most follows the first burst."""
    assert regimes.kind(histories.sel(V=1e-3)) == "intermittent"
    marked = histories["long_stick"].sum("elapsed") / constants(histories)["sample_rate"]
    together = (histories["long_sticks"] * histories["mean_stick_time"]).fillna(0.0)
    for speed in paper.SPEEDS[1:]:
        assert histories["long_sticks"].sel(V=speed) <= 2
        assert float(marked.sel(V=speed)) == pytest.approx(float(together.sel(V=speed)), abs=1e-4)
    assert float(marked.sel(V=1e-3)) >= float(together.sel(V=1e-3)) - 1e-3
    # A stick right after the first burst still rings with it: at 1 mm/s there are others.
    at = histories.sel(V=1e-3)
    quiet, loud = (at["velocity_B"].where(at["long_stick"] == stuck).std("elapsed") for stuck in (1, 0))
    assert quiet < 0.2 * loud


def test_shares_of_time_make_one_and_the_spectrum_holds_the_energy(histories):
    shares = sum(histories[f"{name}_fraction"] for name in transients.STATES)
    np.testing.assert_allclose(shares, 1.0, atol=1e-9)
    # What lies between the band and half the sample rate is some tenth of the energy.
    power = histories["spectrum"].sum("frequency") * float(histories["frequency"][1])
    np.testing.assert_array_less(power, 1.05 * histories["velocity_rms"] ** 2)
    np.testing.assert_array_less(0.7 * histories["velocity_rms"] ** 2, power)


def test_the_contact_keeps_its_law(contacts):
    N, ratio, slip, state = (
        contacts[name].values for name in ("normal_force", "apparent_friction", "slip_velocity", "state")
    )
    separation, stick, sliding = (state == code for code in range(3))
    assert separation.any(axis=1).all()
    assert sliding.any(axis=1).all()
    assert np.all(N >= 0.0)
    assert np.all(N[separation] == 0.0)
    assert np.all(ratio[separation] == 0.0)
    assert np.all(np.abs(ratio) <= paper.MU * (1.0 + 1e-6))
    np.testing.assert_allclose(np.abs(ratio[sliding]), paper.MU, rtol=1e-6)
    assert np.all(np.abs(slip[stick]) < 1e-9)
    assert np.all(slip[sliding] * ratio[sliding] <= 0.0)
    np.testing.assert_allclose(contacts["mean_normal_force"], paper.LOAD, rtol=5e-3)


def test_slip_adds_up_to_what_the_clamp_moves(computed):
    data = computed("contact", window=0.1, window_start=0.3, sample_rate=200e3, duration=0.45)
    moved = data["slip_displacement"]
    # P2 moves on by 0.2 and 0.5 mm; P1 springs to and fro by 3 and 7 micrometres RMS, 26 at most in 3 s.
    np.testing.assert_allclose(-moved.isel(elapsed=-1), 0.1 * data["V"], atol=40e-6)
    steps = np.diff(moved, axis=1)
    between = 0.5 * (data["slip_velocity"].values[:, 1:] + data["slip_velocity"].values[:, :-1]) / 200e3
    assert np.mean(np.abs(steps - between)) < 0.25 * np.mean(np.abs(steps))


def test_the_overview_holds_the_start(contacts):
    for k in range(contacts.sizes["V"]):
        at = contacts.isel(V=k)
        soon = (at["interval"] > at["first_slip_time"]) & (at["interval"] < at["first_slip_time"] + 0.1)
        assert float(at["largest_slip_speed"][soon].max()) == pytest.approx(float(at["start_up_slip_speed"]))
        before = at["interval"] < at["first_slip_time"] - 1e-3
        assert float(at["largest_slip_speed"][before].max()) < 1e-9
    assert np.all((contacts["start_up_slip_speed"] > 0.08) & (contacts["start_up_slip_speed"] < 0.2))


def test_ten_degrees_vibrate_and_fifteen_slide_steadily(angles):
    assert regimes.kind(angles.sel(theta=15.0)) == "steady sliding"
    assert regimes.kind(angles.sel(theta=10.0)) in ("periodic", "irregular")
    late = angles["velocity_B"].sel(elapsed=slice(0.6, None))
    assert np.ptp(late.sel(theta=15.0).values) < 1e-6
    assert np.ptp(late.sel(theta=10.0).values) > 1e-3
    growth = angles["mode_growth_rate"]
    assert float(growth.sel(theta=10.0)) > 500.0
    assert float(growth.sel(theta=15.0)) == pytest.approx(-0.5 * Rig().d1, rel=1e-3)
    measured = paper.ANGLES[10.0]
    assert float(angles["dominant_frequency"].sel(theta=10.0)) == pytest.approx(measured, rel=0.05)


def test_the_mirror_image_moves_the_other_way(computed):
    right, left = (computed("fig7", V=sign * 5e-3, theta=sign * 5.0, duration=0.2) for sign in (1.0, -1.0))
    np.testing.assert_array_equal(left["velocity_B"], -right["velocity_B"])
    np.testing.assert_array_equal(left["long_stick"], right["long_stick"])


@pytest.mark.parametrize(
    ("name", "given", "status"),
    [
        ("fig11", {"theta": [5.0, 40.0], "mu": 4.0}, [1, 2]),
        ("fig7", {"theta": 40.0, "mu": 5.0}, [2, 2, 2]),
        ("contact", {"theta": 40.0, "mu": 5.0}, [2, 2]),
    ],
)
def test_a_point_without_a_solution_keeps_its_error_and_is_reported_and_drawn(name, given, status, tmp_path):
    finished = runner.run(name, given | {"duration": 0.1}, tmp_path)
    np.testing.assert_array_equal(finished.dataset["status"], status)
    assert finished.dataset["error"].values[-1].startswith(f"ContactError: mu = {given['mu']:g}")
    assert finished.study.report(finished.dataset).count("failed") == finished.failed == status.count(2)
    assert finished.figure.is_file()


def test_a_spectrum_measures_power_and_a_line_its_frequency():
    rate, times = 40e3, np.arange(40_000) / 40e3
    frequency = transients.frequencies(rate).values
    everything = np.ones(len(times), dtype=bool)
    power = transients.spectrum(1.5 + 0.3 * np.sin(2.0 * np.pi * 2613.0 * times), everything, rate)
    assert power.sum() * frequency[1] == pytest.approx(0.5 * 0.3**2, rel=1e-3)
    assert transients.line_near(frequency, power, 2700.0) == pytest.approx(2613.0, abs=1.0)
    noise = transients.spectrum(np.random.default_rng(0).normal(size=len(times)), everything, rate)
    assert noise.mean() == pytest.approx(2.0 / rate, rel=0.05)
    assert np.isnan(transients.line_near(frequency, power, np.nan))
    # A stretch shorter than a window counts with what it has, one far shorter not at all.
    tone = np.sin(2.0 * np.pi * 2000.0 * times)
    burst = (times % 0.1 >= 0.01) & (times % 0.1 < 0.02)
    assert transients.spectrum(tone, burst, rate).sum() * frequency[1] == pytest.approx(0.5, rel=0.02)
    assert np.all(np.isnan(transients.spectrum(tone, times < 1e-3, rate)))


def test_what_rings_above_the_band_is_not_folded_into_it():
    rate = 40e3
    times = transients.even_times(0.5, rate).values
    fine = np.arange(0.0, 0.5, 2.4e-6)
    tones = np.sin(2.0 * np.pi * 5e3 * fine) + np.sin(2.0 * np.pi * 37e3 * fine)
    kept = transients.velocity(SimpleNamespace(time=fine, velocity_B=tones), times, rate)
    inside = slice(100, -100)
    np.testing.assert_allclose(kept[inside], np.sin(2.0 * np.pi * 5e3 * times)[inside], atol=0.01)


def test_the_main_phases_are_found_in_their_order():
    stick, slip, apart = contact.STICK, contact.SLIP, contact.SEPARATION
    state = np.repeat([stick, slip, stick, slip, apart, slip, apart, slip, stick], [9, 3, 5, 2, 1, 2, 8, 4, 2])
    assert contact.main_phases(state) == {1: (0, 9), 2: (9, 12), 3: (22, 30), 4: (30, 34)}
    assert contact.main_phases(np.full(5, stick)) == {1: (0, 5)}
