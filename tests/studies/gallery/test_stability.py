"""The plane of inclination and friction: its numbers, what follows from it, what it says and draws."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fivcore import Rig, flutter_onsets, onset_curves, sliding_modes
from studies import paper, runner
from studies.gallery.stability import findings as stability_report
from studies.gallery.stability.study import STUDY, largest_growth
from studies.plotting import figures
from studies.spec import evenly
from tests.helpers.rigs import frictions, workshop_rig

SMALL = {"theta": evenly(-4.0, 16.0, 21), "mu": evenly(0.0, 0.5, 26)}


def computed(**given_values):
    """The study's dataset in memory."""
    return STUDY.sweep(given_values).plan().run("sync")


@pytest.fixture(scope="module")
def plane():
    return computed(**SMALL)


# The helper.


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 300), st.floats(-40.0, 40.0), frictions)
def test_the_largest_growth_is_that_of_the_fastest_mode(seed, theta, mu):
    rig = workshop_rig(seed)
    modes = sliding_modes(rig, theta, mu, 8e3)
    growth, frequency, count = largest_growth(rig, theta, mu, 8e3)
    if not np.any(np.isfinite(modes.growth_rate)):
        assert np.isnan(growth)
        assert np.isnan(frequency)
    else:
        assert growth == np.nanmax(modes.growth_rate)
        assert frequency in modes.frequency[modes.growth_rate == growth]
    assert count == np.count_nonzero(modes.growth_rate > 0.0)


def test_the_helper_broadcasts():
    theta, mu = np.array([0.0, 5.0, 10.0])[:, None], np.array([0.1, 0.2])
    every = largest_growth(Rig(), theta, mu, 10e3)
    assert all(each.shape == (3, 2) for each in every)
    for k in range(3):
        for j in range(2):
            one = largest_growth(Rig(), theta[k, 0], mu[j], 10e3)
            assert [each[k, j] for each in every] == [float(each) for each in one]


def test_a_band_without_modes_has_no_growth():
    growth, frequency, count = largest_growth(Rig(), [5.0, 6.0], 0.2, 1.0)
    assert np.all(np.isnan(growth) & np.isnan(frequency))
    np.testing.assert_array_equal(count, 0)


# The plane.


def test_the_papers_onsets_are_where_growth_begins(plane):
    at = plane.sel(theta=paper.THETA)
    np.testing.assert_allclose(np.sort(at["pair_onset_mu"]), [0.11123, 0.15298, 0.22365], atol=1e-5)
    assert float(at["onset_mu"]) == flutter_onsets(Rig(), paper.THETA, 10e3, 0.5).mu[0]
    assert float(at["onset_frequency"]) == pytest.approx(2802.0, abs=0.5)
    grows = at["growth_rate"] > 0.0
    np.testing.assert_array_equal(grows, at["mu"] > at["onset_mu"])


def test_growth_and_branches_agree_at_every_point(plane):
    np.testing.assert_array_equal(plane["unstable_modes"], stability_report.expected(plane))
    np.testing.assert_array_equal(plane["growth_rate"] > 0.0, plane["unstable_modes"] > 0)


def test_the_plane_holds_what_the_solver_says(plane):
    theta, mu = np.meshgrid(plane["theta"], plane["mu"], indexing="ij")
    growth, frequency, count = largest_growth(Rig(), theta, mu, 10e3)
    np.testing.assert_allclose(plane["growth_rate"], growth, rtol=1e-3)
    np.testing.assert_allclose(plane["frequency"], frequency, rtol=1e-4)
    np.testing.assert_array_equal(plane["unstable_modes"], count)


def test_nothing_grows_outside_the_bound(plane):
    grows = (plane["growth_rate"] > 0.0).transpose("theta", "mu").values
    bound = plane["bound_mu"].values
    assert np.all(np.isnan(bound) == (plane["theta"].values <= 0.0))
    allowed = plane["mu"].values > np.where(np.isnan(bound), np.inf, bound)[:, None]
    assert not np.any(grows & ~allowed)


def test_branches_are_kept_to_their_ends(plane):
    curves = onset_curves(Rig(), SMALL["theta"], 10e3, 0.5)
    number = plane["trace_branch"].values
    for k, curve in enumerate(curves.onsets):
        np.testing.assert_allclose(plane["trace_theta"].values[number == k], curve.theta, rtol=1e-6)
        np.testing.assert_allclose(plane["trace_mu"].values[number == k], curve.mu, rtol=1e-6)
        assert plane["trace_mu"].values[number == k][0] == pytest.approx(0.5)
    assert plane["pair_begins"].attrs["flag_meanings"].split()[int(plane["pair_begins"][0])] == "mu_max"
    lowest = plane.isel(pair=int(np.argmin(plane["pair_lowest_mu"].values)))
    assert float(lowest["pair_lowest_mu"]) == pytest.approx(0.09083, abs=1e-5)
    assert float(lowest["pair_lowest_theta"]) == pytest.approx(2.5935, abs=1e-3)


def test_the_windows_at_the_papers_friction(plane):
    assert float(plane["window_mu"]) == paper.MU
    np.testing.assert_allclose(plane["window_from"], [1.97, 0.62], atol=0.01)
    np.testing.assert_allclose(plane["window_to"], [9.35, 10.68], atol=0.01)


@pytest.mark.parametrize(("mu", "taken"), [([0.0, 0.1], 0.1), ([0.3, 0.4], 0.3)])
def test_the_windows_are_at_the_nearest_friction_there_is(mu, taken):
    assert float(computed(theta=[0.0, 10.0], mu=mu)["window_mu"]) == taken


def test_a_rig_whose_pairs_recover():
    data = computed(theta=evenly(0.0, 20.0, 11), mu=evenly(0.0, 0.6, 13), p1_length=0.08)
    assert data.sizes["recovery"] > 0
    known = np.isfinite(data["pair_recovery_mu"].values)
    assert known.any()
    assert np.all(data["pair_recovery_mu"].values[known] <= 0.6)
    text = STUDY.report(data)
    assert "recovery" in text
    assert "paper" not in text.lower()


# What it says.


def test_the_report_has_the_papers_numbers_beside_its_own(plane):
    text = STUDY.report(plane)
    assert "Lowest onset: mu = 0.0908 at theta = 2.593 degrees, 2802 Hz." in text
    for line in (
        "0.1112     0.12, near 2800 Hz",
        "0.1530      0.16, near 400 Hz",
        "0.2236     0.23, near 7700 Hz",
    ):
        assert line in text
    assert "Unstable outside 0 < tan(theta) < mu: none." in text
    assert "sign of the growth is not what the branches say: none" in text
    assert "vibrates at 2700 Hz" in text
    share = float((plane["growth_rate"] > 0.0).mean())
    assert f"({100.0 * share:.1f} %)" in text


def test_growth_without_an_onset_in_the_band_is_told():
    """At theta = 24 and mu = 0.8 a pair of the paper's rig diverges."""
    data = computed(theta=[20.0, 24.0, 28.0], mu=[0.7, 0.8, 0.9])
    assert np.any(data["frequency"] == 0.0)
    text = STUDY.report(data)
    differ = np.count_nonzero(data["unstable_modes"].values != stability_report.expected(data))
    assert f"grow than pairs by the branches: {differ}, and at" in text


EDGES = {
    "one inclination": ({"theta": [5.0], "mu": SMALL["mu"]}, "A single inclination has no window"),
    "one friction": ({"theta": SMALL["theta"], "mu": [0.2]}, "Windows of instability at mu = 0.2"),
    "one point": ({"theta": [5.0], "mu": [0.2]}, "Unstable at 1 of 1 points"),
    "one stable point": ({"theta": [15.0], "mu": [0.2]}, "Stable at all of 1 points"),
    "no friction": ({"theta": [0.0, 5.0], "mu": [0.0]}, "No flutter onset in this range"),
    "two by two, stable": ({"theta": [-5.0, -4.0], "mu": [0.1, 0.3]}, "No flutter onset in this range"),
    "another rig": ({"theta": [2.0, 8.0, 12.0], "mu": [0.1, 0.3, 0.5], "head_mass": 0.5}, "Lowest onset"),
    "steep": ({"theta": [-80.0, 80.0], "mu": [0.0, 1.0]}, "Stable at all of 4 points"),
}


@pytest.mark.parametrize("case", EDGES)
def test_other_grids_are_told_and_drawn(case, tmp_path):
    given_values, said = EDGES[case]
    data = computed(**given_values)
    assert said in STUDY.report(data)
    assert runner.plot(STUDY, data, tmp_path / "stability.nc").stat().st_size > 5000


def test_points_that_are_missing_stay_white(plane, tmp_path):
    some = plane.copy(deep=True)
    for name in ("growth_rate", "frequency", "unstable_modes"):
        some[name] = some[name].astype(float)
        some[name][:, 10:] = np.nan
    text = STUDY.report(some)
    assert "of 210 points" in text
    with figures.style():
        figure = STUDY.draw(some)
        panel = figure.axes[0]
        figure.canvas.draw()
    assert all(np.ma.getmaskarray(mesh.get_array()).reshape(26, 21)[10:].all() for mesh in panel.collections[:2])


def test_nothing_computed_yet_is_no_error(plane, tmp_path):
    none = plane.copy(deep=True)
    for name in ("growth_rate", "frequency", "unstable_modes"):
        none[name] = none[name].astype(float) * np.nan
    assert "No point has been computed yet." in STUDY.report(none)
    runner.plot(STUDY, none, tmp_path / "stability.nc")


def test_the_legend_names_every_branch(plane):
    with figures.style():
        figure = STUDY.draw(plane)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert [f"onset, {f:.0f} Hz" for f in plane["pair_lowest_frequency"].values] == labels[: plane.sizes["pair"]]
    assert "tan θ = μ" in labels
    assert "paper: vibrates (measured)" in labels


def test_the_default_file_is_small(tmp_path):
    sweep = STUDY.sweep({})
    assert sweep.grid.shape == (241, 201)
    assert list(sweep.grid.axes) == ["theta", "mu"]
    file = tmp_path / "stability.nc"
    STUDY.sweep({"theta": evenly(-10.0, 20.0, 61), "mu": evenly(0.0, 0.5, 51)}).plan(file).run("sync")
    assert file.stat().st_size < 150e3


def test_batches_do_not_matter():
    whole = computed(theta=[1.0, 5.0, 9.0], mu=[0.1, 0.2])
    for theta in (1.0, 5.0, 9.0):
        part = computed(theta=[theta], mu=[0.1, 0.2])
        for name in ("growth_rate", "frequency", "unstable_modes"):
            np.testing.assert_array_equal(part[name].values[0], whole[name].sel(theta=theta).values)


@pytest.mark.parametrize(
    ("given_values", "message"),
    [
        ({"theta": [0.0, 90.0]}, "theta = 90.0: it must be"),
        ({"mu": [-0.1, 0.2]}, r"mu = -0.1: it must be a number from 0"),
        ({"V": 1e-3}, "V: study stability has no such axis"),
        ({"p2_thickness": 0.0}, "p2_thickness = 0.0"),
    ],
)
def test_what_cannot_be_computed_is_refused_before_anything_is_planned(given_values, message):
    with pytest.raises(ValueError, match=message):
        STUDY.sweep(given_values)
