"""Planes of regimes: realisations that agree, their statistics, and the comparison with linear stability."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import beta

from fivcore import Rig, Scene, flutter_onsets
from fivcore.transient.summary import regime_of
from studies.gallery import regimes
from studies.motion import ensemble, run
from studies.motion import regimes as motion
from studies.motion.jobs import run_all
from studies.motion.run import REGIMES
from studies.physics import verdicts
from tests import HOME

# Long enough for what decays slowest, at d1 / 2 = 25 1/s, to be gone; short enough for a test.
SHORT = {"min_duration": 0.6, "max_duration": 0.85, "members": 2}
OPTIONS = {"ramp": 1e-3, "cutoff": None, "skip_long_sticks": 1, "numerical_damping": "published"}
OPTIONS |= {"standard_error": 0.01, "min_duration": 1.0, "max_duration": 8.0}
VERDICTS = list(verdicts.VERDICTS)
STEADY, INTERMITTENT, PERIODIC, IRREGULAR = map(
    REGIMES.index, ("steady sliding", "intermittent", "periodic", "irregular")
)


@pytest.mark.parametrize(("V", "mu"), [(1e-3, 0.2), (2e-3, 0.2), (5e-3, 0.2), (5e-4, 0.3), (5e-3, 0.05)])
def test_all_realisations_of_a_scene_far_from_an_onset_move_alike(V, mu):
    """Sliding for good below the lowest onset, 0.1112; above it a vibration with the reference's share of stick.

    Shares agree within four standard errors; those of realisations scatter as the standard errors say.
    """
    with xr.open_dataset(HOME / "results" / "reference" / "regimes" / "regimes.nc") as data:
        kept = data.squeeze().sel(V=V, mu=mu, method="nearest").load()
    found = ensemble.statistics(run_all(ensemble.ensemble(Scene(float(kept["V"]), 5.0, mu, 9.0), 3, OPTIONS)))
    vibrates = motion.is_of(found["member_regime"], *motion.VIBRATING)
    np.testing.assert_array_equal(vibrates, mu > 0.1112)
    np.testing.assert_allclose(found["mean_normal_force"], 9.0, rtol=0.02)
    error = found["stick_fraction_se"]
    assert abs(found["stick_fraction"] - kept["stick_fraction"]) <= 4.0 * np.hypot(
        error, kept["stick_fraction_se"]
    )
    assert found["stick_fraction_std"] <= 4.0 * np.sqrt(3.0) * error
    if V >= 2e-3 and mu == 0.2:
        assert 2.5e3 < found["dominant_frequency"] < 2.7e3


@pytest.mark.parametrize("theta", [2.0, 5.0, 10.0])
def test_the_motion_is_what_stability_of_all_simulated_modes_predicts(theta):
    """Vibration sets in where the first simulated mode grows, which may be one above 10 kHz."""
    onset = flutter_onsets(Rig(), theta, 10e3).mu[0]
    for mu in onset * np.array([0.9, 0.95, 1.05, 1.2]):
        scene = Scene(5e-3, theta, float(mu), 9.0)
        found = regimes.linear_stability(scene, None, "published")
        assert (found["growth_rate"] > 0.0) == (mu > onset)
        assert (found["unstable_modes"] > 0) == (mu > onset)
        (result,) = run_all(ensemble.ensemble(scene, 1, OPTIONS | {"min_duration": 2.0}))
        assert (result.summary["regime"] == "steady sliding") == (found["model_growth_rate"] < 0.0)


def test_next_to_the_onset_motion_and_stability_agree(computed):
    """The first mode grows from mu = 0.1112 on, below 10 kHz; in the model that is simulated, too."""
    values = {"V": [2e-3, 5e-3], "mu": [0.1, 0.11, 0.113, 0.15], "theta": [-5.0, 5.0]}
    data = computed("regimes", **values, **SHORT | {"min_duration": 2.0, "members": 1})
    np.testing.assert_array_equal(data["regime"].sel(theta=-5.0), STEADY)
    grows = data["model_growth_rate"].sel(theta=5.0).squeeze("F").isel(V=0)
    np.testing.assert_array_equal(grows > 0.0, [False, False, True, True])
    np.testing.assert_allclose(data["model_growth_frequency"].sel(mu=0.113, theta=5.0), 2802.0, rtol=0.001)
    assert np.all(data["verdict"] == VERDICTS.index("agree"))
    onsets = flutter_onsets(Rig(), 5.0, 10e3, 0.15)
    np.testing.assert_array_equal(data["onset_mu"], [np.nan, onsets.mu.min()])


def test_vibration_by_modes_above_the_band_has_its_verdict(computed):
    """With modes up to 375 kHz, undamped by the published scheme, one at 95.6 kHz grows first."""
    values = {"V": 5e-3, "mu": 0.11, "cutoff": 375e3, "members": 1, "numerical_damping": "none"}
    data = computed("regimes", **SHORT | values)
    assert VERDICTS[int(data["verdict"].squeeze())] == "unstable above the band"
    np.testing.assert_allclose(data["model_growth_frequency"], 95.6e3, rtol=0.01)


def test_equivalent_points_have_the_bits_of_one_scene_and_its_size(computed):
    ratio = 10.0 ** (1.0 / 3.0)
    values = {"V": 4e-3 * ratio ** np.arange(2), "mu": [0.05, 0.2], "F": 3.7 * ratio ** np.arange(2)}
    data = computed("regimes", **SHORT | values).squeeze("theta")
    left, right = data.isel(V=0, F=0), data.isel(V=1, F=1)
    factor = right["F"].values / left["F"].values
    for name, variable in regimes.OUTPUTS.items():
        if variable.scale:
            np.testing.assert_allclose(right[name], left[name] * factor, rtol=1e-4)
        else:
            np.testing.assert_array_equal(right[name], left[name])


def test_statistics_of_an_ensemble_are_those_of_its_realisations():
    scene = Scene(5e-3, 5.0, 0.2, 9.0)
    runs = run_all(ensemble.ensemble(scene, 3, OPTIONS | {"min_duration": 0.1, "max_duration": 0.4}))
    found, summaries = ensemble.statistics(runs), [run.summary_of(result) for result in runs]
    how = dict.fromkeys(ensemble.LARGEST, np.max) | dict.fromkeys(ensemble.MIDDLE, np.median)
    how |= {f"{name}_se": lambda errors: np.sqrt(np.sum(errors**2)) / len(errors) for name in run.ESTIMATED}
    for name in ensemble.QUANTITIES:
        values = np.array([each[name] for each in summaries], dtype=float)
        values = values[np.isfinite(values)]
        expected = how.get(name, np.mean)(values) if len(values) else np.nan
        if name in ensemble.MIDDLE and len(values) == 2:
            expected = values.min()
        np.testing.assert_allclose(found[name], expected, rtol=1e-14, err_msg=name)
    spread = np.std([each["velocity_rms"] for each in summaries], ddof=1)
    np.testing.assert_allclose(found["velocity_rms_std"], spread, rtol=1e-12)
    single = ensemble.statistics(runs[:1])
    assert all(np.isnan(single[f"{name}_std"]) for name in ensemble.SPREAD)


@pytest.mark.parametrize(
    ("members", "regime"),
    [
        ([INTERMITTENT] * 4, INTERMITTENT),
        ([INTERMITTENT, IRREGULAR, INTERMITTENT], INTERMITTENT),
        ([INTERMITTENT, IRREGULAR], IRREGULAR),
        ([IRREGULAR, STEADY, STEADY, IRREGULAR], IRREGULAR),
        ([0, 0, STEADY, STEADY], STEADY),
        ([0, 0, STEADY], 0),
        ([INTERMITTENT, PERIODIC, IRREGULAR], IRREGULAR),
    ],
)
def test_most_realisations_decide_and_of_equally_many_the_later_regime(members, regime):
    for order in (members, members[::-1]):
        assert ensemble.majority(np.array(order))[0] == regime


@given(st.lists(st.integers(0, len(REGIMES) - 1), min_size=1, max_size=30))
def test_certainty_is_the_posterior_that_more_than_half_are_in_the_regime(members):
    regime, certainty = ensemble.vote(np.array(members))
    inside = members.count(regime)
    assert inside == max(members.count(k) for k in set(members))
    np.testing.assert_allclose(certainty, beta(inside + 0.5, len(members) - inside + 0.5).sf(0.5), rtol=1e-9)
    assert ensemble.vote(np.array([*members, regime]))[1] > certainty


def row(**columns):
    """A dataset of one row of points."""
    count = max(map(np.size, columns.values()))
    return xr.Dataset({name: ("V", np.broadcast_to(values, count)) for name, values in columns.items()})


# Of a mode 2.5 s pass between the first slip and the last quarter of the run: it decides from 4 1/s on.
@pytest.mark.parametrize(
    ("regime", "growth", "model", "other", "verdict"),
    [
        (STEADY, -25.0, -25.0, {}, "agree"),
        (STEADY, 0.0, 0.0, {}, "agree"),
        (INTERMITTENT, 300.0, 300.0, {}, "agree"),
        (PERIODIC, 0.5, 300.0, {}, "agree"),
        (IRREGULAR, -25.0, -25.0, {}, "subcritical"),
        (IRREGULAR, -25.0, np.nan, {}, "subcritical"),
        (IRREGULAR, -25.0, -4.0, {}, "subcritical"),
        (IRREGULAR, -25.0, -3.99, {}, "no verdict"),
        (IRREGULAR, -25.0, -25.0, {"duration": 0.8}, "no verdict"),
        (IRREGULAR, -25.0, 0.0, {}, "no verdict"),
        (IRREGULAR, -25.0, 0.5, {}, "unstable above the band"),
        (STEADY, 300.0, 300.0, {}, "quiet though unstable"),
        (STEADY, 4.0, 300.0, {}, "quiet though unstable"),
        (STEADY, 3.99, 300.0, {}, "no verdict"),
        (REGIMES.index("undecided"), 300.0, 300.0, {}, "no verdict"),
        (REGIMES.index("stuck"), 300.0, 300.0, {}, "no verdict"),
        (np.nan, np.nan, np.nan, {"status": 2}, "failed"),
        (np.nan, np.nan, np.nan, {"status": 0}, None),
    ],
)
def test_verdicts(regime, growth, model, other, verdict):
    point = {"status": 1, "duration": 4.0, "first_slip_time": 0.5} | other
    (code,) = verdicts.compare_linear(row(regime=[regime], growth_rate=growth, model_growth_rate=model, **point))
    assert (np.isnan(code) and verdict is None) or VERDICTS[int(code)] == verdict


def test_a_regime_is_uncertain_if_realisations_differ_and_too_few_are_in_it():
    largest, certainty = zip((1.0, 0.9), (0.75, 0.84), (0.9, 0.95), (0.9, 0.96), (0.5, 0.94), strict=True)
    shares = np.stack([largest, np.zeros(5)], 1)
    data = row(regime_certainty=certainty).assign(regime_share=(("V", "kind"), shares))
    assert verdicts.uncertain(data).tolist() == [False, True, False, False, True]


def test_a_point_is_in_a_regime_failed_or_pending():
    data = row(
        status=[1] * 6 + [2, 2, 0, 1], regime=[*range(6), 4, np.nan, np.nan, np.nan], dominant_frequency=1e3
    )
    names = [*REGIMES, "failed", "failed", "pending", "pending"]
    assert [motion.kind(data.isel(V=k)) for k in range(10)] == names
    assert motion.is_of(motion.kinds(data), "stuck", "failed").tolist() == [
        n in ("stuck", "failed") for n in names
    ]
    frequency = motion.dominant_frequency(data.isel(V=slice(6)))
    np.testing.assert_array_equal(frequency, [np.nan] * 3 + [1e3] * 3)


@pytest.mark.parametrize(
    ("name", "limit", "others", "words"),
    [
        ("drive", 1.3, {"slipped": False}, ("undecided", "stuck", "stuck")),
        ("slip_share", 0.999, {"steadiness": 0.0}, ("irregular", "irregular", "steady sliding")),
        ("steadiness", 0.01, {"slip_share": 1.0}, ("steady sliding", "irregular", "irregular")),
        ("stick_share", 0.1, {"last_stick": 0.7}, ("irregular", "irregular", "intermittent")),
        ("last_stick", 2.0 / 3.0, {"stick_share": 0.2}, ("irregular", "irregular", "intermittent")),
        ("periodicity", 0.9, {}, ("irregular", "irregular", "periodic")),
    ],
)
def test_below_at_and_above_each_limit_a_point_of_a_result_is_in_its_regime(name, limit, others, words):
    usual = {"slipped": True, "drive": 50.0, "slip_share": 0.5, "steadiness": 1.0}
    usual |= {"stick_share": 0.0, "last_stick": 0.0, "periodicity": 0.3} | others
    found = [regime_of(**usual | {name: value}) for value in (0.999 * limit, limit, 1.001 * limit)]
    data = row(status=1, regime=[REGIMES.index(word) for word in found])
    assert tuple(motion.kind(data.isel(V=k)) for k in range(3)) == words
    expected = [word in ("intermittent", "periodic", "irregular") for word in words]
    assert motion.is_of(motion.kinds(data), *motion.VIBRATING).tolist() == expected
    assert motion.is_of(motion.kinds(data), motion.STEADY).tolist() == [w == "steady sliding" for w in words]


@pytest.mark.parametrize(("coords", "word"), [
    ({"numerical_damping": "published"}, "with"), ({"numerical_damping": "none"}, "without"), ({}, "without"),
])  # fmt: skip
def test_a_result_is_with_the_published_damping_only_if_it_says_so(coords, word):
    assert motion.damping_text(xr.Dataset(coords=coords)).startswith(f"{word} the published")
