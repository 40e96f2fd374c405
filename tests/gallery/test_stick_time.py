"""Sticks against speed: the statistics by closed forms, the study by its physics."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from fivcore import Scene
from studies import paper, registry
from studies.asking.sweep import sweep_of
from studies.motion import ensemble
from studies.motion.stick_fit import bootstrap, crossing, exponent, interval, local_exponents, of_sticks, ratio
from tests import HOME

STUDY = registry.load("stick_time")
SPEEDS = np.array([0.25e-3, 0.5e-3, 1e-3, 2e-3])
ALL = np.ones(len(SPEEDS), dtype=bool)


@given(st.floats(-2.0, 0.5), st.floats(1e-6, 1.0))
def test_an_exact_law_has_its_exponent_and_no_interval(n, factor):
    total = np.repeat((factor * SPEEDS**n)[:, None], 8, axis=1)
    means = bootstrap(3.0 * total, np.full_like(total, 3.0))
    np.testing.assert_allclose(means[0], factor * SPEEDS**n, rtol=1e-12)
    np.testing.assert_allclose(exponent(SPEEDS, *means, ALL), n, atol=1e-10)
    np.testing.assert_allclose(local_exponents(SPEEDS, *means), n, atol=1e-10)
    np.testing.assert_allclose(ratio(SPEEDS, *means, (2e-3, 1e-3)), 2.0**n, rtol=1e-10)


def test_the_interval_of_an_exponent_covers_the_true_one_as_often_as_it_says():
    # Sticks of a run are alike: whole runs must be drawn.
    random, held = np.random.default_rng(3), 0
    for _ in range(60):
        count = random.integers(1, 6, size=(len(SPEEDS), 20)).astype(float)
        of_run = random.gamma(4.0, 0.25, size=count.shape) / SPEEDS[:, None]
        _, low, high = exponent(SPEEDS, *bootstrap(of_run * count, count), ALL)
        held += low <= -1.0 <= high
    # 95 % of 60 is 57; binomial standard error 1.7.
    assert held >= 50


def test_the_interval_of_a_mean_is_that_of_its_standard_error():
    total = np.random.default_rng(4).normal(1.0, 0.2, size=(1, 200))
    low, high = interval(bootstrap(total, np.ones_like(total))[1])[:, 0]
    assert high - low == pytest.approx(2.0 * 1.96 * total.std() / np.sqrt(200), rel=0.1)
    np.testing.assert_allclose(interval(np.linspace(0.0, 1.0, 2001)), [0.025, 0.975])


def test_speeds_without_sticks_have_no_mean_and_do_no_harm():
    total = np.array([[1.0, 1.0], [0.5, 0.5], [0.0, 0.0]])
    V, means = np.array([1.0, 2.0, 4.0]), bootstrap(total, (total > 0.0).astype(float))
    assert np.isnan(means[0][2])
    np.testing.assert_allclose(exponent(V, *means, ALL[:3]), -1.0)
    assert np.all(np.isnan(exponent(V, *means, np.array([True, False, True]))))
    assert np.all(np.isnan(local_exponents(V, *means)[:, 2]))
    assert np.all(np.isnan(ratio(V, *means, (4.0, 1.0))))
    assert np.all(np.isnan(ratio(V, *means, (3.0, 1.0))))


def test_a_mean_takes_more_than_a_run_or_two_of_many():
    total = np.ones((2, 8)) * (np.arange(8) < [[2], [3]])
    mean, samples = bootstrap(total, total)
    assert np.array_equal(np.isnan(mean), [True, False])
    assert np.all(np.isnan(samples[:, 0]))


def test_a_share_falls_below_a_level_for_good_where_it_does_so_last():
    shares = {(0.9, 0.5, 0.1, 0.0): 2.75, (0.9, 0.1, 0.5, 0.0): 3.6, (0.9, 0.8, 0.7, 0.6): np.nan}
    shares |= {(0.1, 0.1, 0.1, 0.0): np.nan, (0.9, np.nan, 0.1, 0.0): 2.75}
    for share, end in shares.items():
        np.testing.assert_allclose(crossing(np.arange(1.0, 5.0), np.array(share), 0.2), end)


def test_sticks_are_told_apart_by_whether_the_motion_had_settled():
    run = {"first_slip_time": 0.2, "simulated_time": 1.0, "stick_times": np.array([0.05, 0.06, 0.07])}
    found = of_sticks(Scene(1e-3, 5.0, 0.2, 9.0), run | {"stick_starts": np.array([0.21, 0.299, 0.3001])})
    assert (found["start_up_count"], found["sustained_count"]) == (2, 1)
    np.testing.assert_allclose([found[f"{kind}_total"] for kind in ("start_up", "sustained")], [0.11, 0.07])
    np.testing.assert_allclose(found["stick_time"][:4], [0.05, 0.06, 0.07, np.nan])


def test_sticks_shorten_as_the_speed_grows(computed):
    """As in the reference, within four standard errors of both, which are those of the intervals."""
    values = {"V": [1e-3, 2e-3], "member": np.arange(1, 6), "mu": 0.2, "F": 9.0}
    at = computed("stick_time", min_duration=0.5, **values).sel(F=9.0, mu=0.2)
    # The first slip comes when statics says.
    half = 0.5e-3 * (1.0 + ensemble.STRETCH * (at["member"] - 1.0))
    np.testing.assert_allclose(at["first_slip_time"] - half, at["loading_time"], rtol=3e-3)
    with xr.open_dataset(HOME / "results" / "reference" / "stick_time" / "stick_time.nc") as data:
        kept = data.sel(V=values["V"], mu=0.2, F=9.0).load()
    for name in ("mean_stick_time", "start_up_ratio"):
        (one, error), (other, its) = (
            (data[name], (data[f"{name}_high"] - data[f"{name}_low"]) / (2.0 * 1.96))
            for data in (each.sel(kind="start_up") for each in (at, kept))
        )
        assert np.all(np.abs(one - other) < 4.0 * np.hypot(error, its)), name


def test_half_the_speed_at_twice_the_load_is_equivalent(computed):
    values = {"V": [1e-3, 2e-3], "F": [9.0, 18.0], "mu": 0.2, "member": 1, "cutoff": 75e3}
    small = computed("stick_time", min_duration=0.1, **values)
    for name in STUDY.outputs:
        np.testing.assert_array_equal(small[name].sel(V=1e-3, F=9.0), small[name].sel(V=2e-3, F=18.0))
    plan = sweep_of(STUDY).plan()
    assert (plan.points, plan.distinct) == (2304, 1344)


@pytest.mark.slow
def test_the_two_laws_of_the_paper(computed):
    """The claims about sticks, by the study as it is; a few minutes."""
    at = computed("stick_time").sel(mu=paper.MU, F=paper.LOAD)
    assert at["exponent"].sel(law="start_up") == pytest.approx(-1.03, abs=0.1)
    assert at["start_up_ratio"] == pytest.approx(0.48, rel=0.1)
    product = 1e6 * (at["V"] * at["mean_stick_time"]).sel(kind="sustained")
    np.testing.assert_allclose(product.sel(V=[0.25e-3, 0.5e-3]), 70.0, rtol=0.05)
    assert product.sel(V=1.3e-3) == pytest.approx(57.0, rel=0.1)
    assert 1.3e-3 < at["intermittence_end"] < 1.6e-3
    assert at["exponent"].sel(law="sustained") == pytest.approx(-1.12, abs=0.06)
