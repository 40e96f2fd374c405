"""Planes of regimes: what ensembles agree on, how that compares with linear stability, and how it is shown."""

import re

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import beta

from fivcore import Rig, Scene, flutter_onsets
from studies import registry
from studies.gallery.regimes import compare_linear
from studies.gallery.regimes import study as regimes
from studies.gallery.regimes.compare_linear import VERDICTS
from studies.motion import ensembles, transients
from studies.motion import regimes as motion_regimes
from studies.motion.jobs import run_all
from studies.motion.regimes import KINDS
from studies.motion.transients import REGIMES
from studies.plotting import figures

# Long enough for what decays slowest, at d1 / 2 = 25 1/s, to be gone; short enough for a test.
SHORT = {"least": 0.6, "most": 0.85, "members": 2.0}
FIXED = {"method": "fast", "ramp": 1e-3, "cutoff": 0.0, "numerical_damping": "published"}
FIXED |= {"standard_error": 0.01, "least": 1.0, "most": 8.0}
STUDY = registry.load("regimes")
QUIET, INTERMITTENT, PERIODIC, IRREGULAR = (
    REGIMES.index(name) for name in ("steady sliding", "intermittent", "periodic", "irregular")
)


@pytest.fixture(scope="module")
def computed(computed):
    return lambda **given: computed("regimes", **SHORT | given)


@pytest.mark.parametrize(
    ("V", "mu", "regime"),
    [
        (1e-3, 0.2, "intermittent"),
        (2e-3, 0.2, "irregular"),
        (5e-3, 0.2, "irregular"),
        (5e-4, 0.3, "intermittent"),
        (5e-3, 0.05, "steady sliding"),
    ],
)
def test_all_members_of_a_scene_far_from_a_border_are_in_its_regime(V, mu, regime):
    """At mu = 0.2 sustained intermittence ends between 1.3 and 1.6 mm/s."""
    scene = Scene(V, 5.0, mu, 9.0)
    found = regimes.ensemble_figures(run_all(ensembles.ensemble(scene, 3, FIXED)))
    assert REGIMES[found["regime"]] == regime
    np.testing.assert_array_equal(found["member_regime"], found["regime"])
    np.testing.assert_allclose(found["mean_normal_force"], 9.0, rtol=0.02)
    if regime == "irregular":
        assert found["stick_fraction_std"] < 0.05
        assert 2.5e3 < found["dominant_frequency"] < 2.7e3


@pytest.mark.parametrize("theta", [2.0, 5.0, 10.0])
def test_the_motion_is_what_stability_of_all_simulated_modes_says(theta):
    """Vibration sets in where the first simulated mode grows, which may be one above 10 kHz."""
    onset = flutter_onsets(Rig(), theta, 10e3).mu[0]
    for mu in onset * np.array([0.9, 0.95, 1.05, 1.2]):
        scene = Scene(5e-3, theta, float(mu), 9.0)
        found = regimes.stability(scene, 0.0, "published")
        assert (found["growth_rate"] > 0.0) == (mu > onset)
        assert (found["unstable_modes"] > 0) == (mu > onset)
        (run,) = run_all(ensembles.ensemble(scene, 1, FIXED | {"least": 2.0}))
        quiet = run.summary["regime"] == "steady sliding"
        assert quiet == (found["model_growth_rate"] < 0.0)


def test_next_to_the_onset_motion_and_stability_agree(computed):
    """The first mode grows from mu = 0.1112 on, below 10 kHz; in the model that is run, too."""
    data = computed(V=[2e-3, 5e-3], mu=[0.1, 0.11, 0.113, 0.15], theta=[-5.0, 5.0], least=2.0, members=1.0)
    np.testing.assert_array_equal(data["regime"].sel(theta=-5.0), QUIET)
    grows = data["model_growth_rate"].sel(theta=5.0).squeeze("F").isel(V=0)
    np.testing.assert_array_equal(grows > 0.0, [False, False, True, True])
    np.testing.assert_allclose(data["model_growth_frequency"].sel(mu=0.113, theta=5.0), 2802.0, rtol=0.001)
    assert np.all(data["verdict"] == VERDICTS.index("agree"))


def test_what_only_modes_above_the_band_explain_is_named_so(computed):
    """With modes up to 375 kHz, undamped by the published scheme, one at 95.6 kHz grows first."""
    given = {"cutoff": 375e3, "members": 1.0, "numerical_damping": "none"}
    data = computed(V=[5e-3], mu=[0.11], theta=[5.0], **given)
    assert VERDICTS[int(data["verdict"].squeeze())] == "unstable above the band"
    np.testing.assert_allclose(data["model_growth_frequency"], 95.6e3, rtol=0.01)
    assert re.search(
        r"\n *vibrating, stable below 10 kHz, unstable above in the model that is run +1", STUDY.report(data)
    )


def test_a_stable_scene_loses_its_slowest_mode_at_half_of_d1():
    """Damping on the mass alone leaves the lowest modes -d1 / 2."""
    found = regimes.stability(Scene(5e-3, 5.0, 0.05, 9.0), 0.0, "published")
    np.testing.assert_allclose([found["growth_rate"], found["model_growth_rate"]], -0.5 * Rig().d1, rtol=1e-3)


def test_copies_have_the_bits_of_one_scene_and_its_size(tmp_path):
    ratio = 10.0 ** (1.0 / 3.0)
    given = {"V": 4e-3 * ratio ** np.arange(2), "mu": [0.05, 0.2], "F": 3.7 * ratio ** np.arange(2)}
    sweep = STUDY.sweep(SHORT | given)
    plan = sweep.plan(tmp_path / "regimes.nc")
    assert (plan.points, plan.distinct) == (8, 6)
    data = plan.run("sync").squeeze("theta")
    left, right = data.isel(V=0, F=0), data.isel(V=1, F=1)
    factor = right["F"].values / left["F"].values
    for name, variable in regimes.VARIABLES.items():
        if variable.scale:
            np.testing.assert_allclose(right[name], left[name] * factor, rtol=1e-4)
        else:
            np.testing.assert_array_equal(right[name], left[name])
    assert data["duration"].dtype == np.float32
    # Alone, or in another batch, a point has the same bits.
    for k, F in enumerate(given["F"]):
        one = SHORT | {"V": given["V"][k], "mu": 0.2, "F": F}
        alone = STUDY.sweep(one).plan().run("sync")
        for name in regimes.VARIABLES:
            at = data[name].sel(mu=0.2).isel(V=k, F=k)
            np.testing.assert_array_equal(alone[name].squeeze(("V", "mu", "theta", "F")), at, err_msg=name)


def test_the_figures_of_an_ensemble_are_those_of_its_runs():
    scene, duration = Scene(5e-3, 5.0, 0.2, 9.0), 0.4
    found = regimes.ensemble_figures(run_all(ensembles.ensemble(scene, 3, FIXED | {"most": duration})))
    alone = [run_all([ensembles.member(scene, k, FIXED, duration)]) for k in (1, 2, 3)]
    runs = [transients.figures_of(run) for (run,) in alone]
    assert set(found) >= {"regime", "regime_certainty", *transients.SUMMARY}
    for name in regimes.FIGURES:
        values = np.array([run[name] for run in runs], dtype=float)
        values = values[np.isfinite(values)]
        how = {**dict.fromkeys(regimes.LARGEST, np.max), **dict.fromkeys(regimes.MIDDLE, np.median)}
        expected = how.get(name, np.mean)(values) if len(values) else np.nan
        if name in regimes.MIDDLE and len(values) == 2:
            expected = values.min()
        np.testing.assert_allclose(found[name], expected, rtol=1e-14, err_msg=name)
    spread = np.std([run["velocity_rms"] for run in runs], ddof=1)
    np.testing.assert_allclose(found["velocity_rms_std"], spread, rtol=1e-12)
    assert spread > 0.0
    single = regimes.ensemble_figures(alone[0])
    assert all(np.isnan(single[f"{name}_std"]) for name in regimes.SPREAD)
    assert single["regime_share"].max() == 1.0


@pytest.mark.parametrize(
    ("members", "regime"),
    [
        ([INTERMITTENT] * 4, INTERMITTENT),
        ([INTERMITTENT, IRREGULAR, INTERMITTENT], INTERMITTENT),
        ([INTERMITTENT, IRREGULAR], IRREGULAR),
        ([IRREGULAR, QUIET, QUIET, IRREGULAR], IRREGULAR),
        ([0, 0, QUIET, QUIET], QUIET),
        ([0, 0, QUIET], 0),
        ([INTERMITTENT, PERIODIC, IRREGULAR], IRREGULAR),
    ],
)
def test_most_runs_decide_and_the_later_regime_where_as_many(members, regime):
    for order in (members, members[::-1]):
        assert regimes.majority(np.array(order))["regime"] == regime


@given(st.lists(st.integers(0, len(REGIMES) - 1), min_size=1, max_size=30))
def test_certainty_is_the_posterior_that_more_than_half_are_in_the_regime(members):
    found = regimes.majority(np.array(members))
    inside = members.count(found["regime"])
    assert inside == max(members.count(k) for k in set(members))
    posterior = beta(inside + 0.5, len(members) - inside + 0.5)
    np.testing.assert_allclose(found["regime_certainty"], posterior.sf(0.5), rtol=1e-9)
    np.testing.assert_allclose(found["regime_share"].sum(), 1.0)
    # One more run in the regime makes it surer.
    assert regimes.majority(np.array([*members, found["regime"]]))["regime_certainty"] > found["regime_certainty"]


def row(**columns):
    """A dataset of one row of points."""
    count = max(map(np.size, columns.values()))
    return xr.Dataset({name: ("V", np.broadcast_to(values, count)) for name, values in columns.items()})


# Of a mode 2.5 s pass between the first slip and the last quarter of the run: it tells from 4 1/s on.
@pytest.mark.parametrize(
    ("regime", "growth", "model", "other", "verdict"),
    [
        (QUIET, -25.0, -25.0, {}, "agree"),
        (QUIET, 0.0, 0.0, {}, "agree"),
        (INTERMITTENT, 300.0, 300.0, {}, "agree"),
        (PERIODIC, 0.5, 300.0, {}, "agree"),
        (IRREGULAR, -25.0, -25.0, {}, "subcritical"),
        (IRREGULAR, -25.0, np.nan, {}, "subcritical"),
        (IRREGULAR, -25.0, -4.0, {}, "subcritical"),
        (IRREGULAR, -25.0, -3.99, {}, "no verdict"),
        (IRREGULAR, -25.0, -25.0, {"duration": 0.8}, "no verdict"),
        (IRREGULAR, -25.0, 0.0, {}, "no verdict"),
        (IRREGULAR, -25.0, 0.5, {}, "unstable above the band"),
        (QUIET, 300.0, 300.0, {}, "quiet though unstable"),
        (QUIET, 4.0, 300.0, {}, "quiet though unstable"),
        (QUIET, 3.99, 300.0, {}, "no verdict"),
        (REGIMES.index("undecided"), 300.0, 300.0, {}, "no verdict"),
        (REGIMES.index("stuck"), 300.0, 300.0, {}, "no verdict"),
        (np.nan, np.nan, np.nan, {"status": 2}, "failed"),
        (np.nan, np.nan, np.nan, {"status": 0}, None),
    ],
)
def test_verdicts(regime, growth, model, other, verdict):
    point = {"status": 1, "duration": 4.0, "first_slip_time": 0.5} | other
    (code,) = compare_linear.verdicts(row(regime=[regime], growth_rate=growth, model_growth_rate=model, **point))
    assert (np.isnan(code) and verdict is None) or VERDICTS[int(code)] == verdict


def test_verdicts_and_the_lowest_onset_at_each_inclination_are_added():
    quiet = {"regime": [QUIET, QUIET], "growth_rate": -25.0, "model_growth_rate": -25.0, "first_slip_time": 0.5}
    data = row(status=1, duration=4.0, **quiet).rename(V="theta")
    data = data.assign_coords(theta=[-5.0, 5.0]).expand_dims(mu=[0.0, 0.3])
    added = compare_linear.with_verdicts(data, rig=Rig())
    onsets = flutter_onsets(Rig(), 5.0, 10e3, 0.3)
    np.testing.assert_array_equal(added["onset_mu"], [np.nan, onsets.mu.min()])
    np.testing.assert_array_equal(added["onset_frequency"], [np.nan, onsets.frequency[onsets.mu.argmin()]])
    np.testing.assert_array_equal(added["verdict"], np.full((2, 2), VERDICTS.index("agree")))
    assert (added["verdict"].encoding["dtype"], added["verdict"].encoding["_FillValue"]) == ("int8", -128)


def test_a_regime_is_uncertain_if_members_differ_and_too_few_are_in_it():
    largest, certainty = zip((1.0, 0.9), (0.75, 0.84), (0.9, 0.95), (0.9, 0.96), (0.5, 0.94), strict=True)
    data = row(regime_certainty=certainty).assign(
        regime_share=(("V", "kind"), np.stack([largest, np.zeros(5)], 1))
    )
    assert compare_linear.uncertain(data).tolist() == [False, True, False, False, True]


def test_a_point_is_in_a_regime_failed_or_pending():
    codes = [*range(6), 4, np.nan, np.nan, np.nan]
    data = row(status=[1] * 6 + [2, 2, 0, 1], regime=codes, dominant_frequency=1e3)
    names = [*REGIMES, "failed", "failed", "pending", "pending"]
    assert [motion_regimes.kind(data.isel(V=k)) for k in range(10)] == names
    codes = motion_regimes.kinds(data)
    assert [KINDS[code] for code in codes] == names
    assert motion_regimes.is_of(codes, "stuck", "failed").tolist() == [
        name in ("stuck", "failed") for name in names
    ]
    # Only what vibrates has a dominant frequency.
    line = motion_regimes.dominant_frequency(data.isel(V=slice(6)))
    np.testing.assert_array_equal(line, [np.nan] * 3 + [1e3] * 3)


@pytest.mark.parametrize("count", [0, 1, 5, 6, 8])
def test_the_first_failures_are_told_and_how_many_more_there_are(count):
    data = row(status=[1] + [2] * count, error=[""] + [f"no {k}" for k in range(count)])
    data = data.assign_coords(V=0.5 * np.arange(count + 1)).expand_dims(mu=[0.2])
    lines = motion_regimes.failures(data, ["V"])
    assert lines[:5] == [f"failed: V = {0.5 * (k + 1):g}: no {k}" for k in range(min(count, 5))]
    assert lines[5:] == ([f"and {count - 5} more failed."] if count > 5 else [])
    assert motion_regimes.failures(data)[:1] == ["failed: mu = 0.2, V = 0.5: no 0"][:count]


def test_a_plane_half_done_is_shown_as_far_as_it_goes(computed):
    data = computed(V=[2e-3, 5e-3], mu=[0.05, 0.11, 0.2], most=0.2)
    data["status"][0] = 0
    for name in regimes.VARIABLES:
        data[name] = data[name].astype(float)
        data[name][0] = np.nan
    data = compare_linear.with_verdicts(data, rig=Rig())
    assert np.isnan(data["verdict"][0]).all()
    assert np.isfinite(data["verdict"][1]).all()
    with figures.style():
        figure = STUDY.draw(data)
    legends = filter(None, (axes.get_legend() for axes in figure.axes))
    assert "pending" in {text.get_text() for legend in legends for text in legend.get_texts()}
    (table,) = (part for part in STUDY.findings(data) if getattr(part, "heads", [""])[0] == "regime")
    counts = {name: int(count) for name, count, *_ in table.rows}
    assert (counts["pending"], sum(counts.values())) == (3, 6)


def test_the_paper_stands_beside_its_own_rig_only(computed):
    with_paper = {"V": [1e-3, 2e-3, 5e-3], "mu": [0.19, 0.22], "most": 0.2}
    report = STUDY.report(computed(**with_paper))
    rows = re.findall(r"V = (\d) mm/s, mu = 0.19 +(intermittent|periodic) .* 2, 3.5.3", report)
    assert rows == [("1", "intermittent"), ("2", "intermittent"), ("5", "periodic")]
    assert "paper  " not in STUDY.report(computed(**with_paper, theta=6.0))


def test_a_file_explains_itself_and_grows(tmp_path):
    for mu in ([0.1, 0.2], [0.1, 0.2, 0.3]):
        given = SHORT | {"V": [2e-3, 5e-3], "mu": mu, "most": 0.3}
        data = STUDY.sweep(given).plan(tmp_path / "regimes.nc").run("sync")
    assert int((data["status"] == 1).sum()) == 6
    with xr.open_dataset(tmp_path / "regimes.nc") as plain:
        assert plain["regime"].dims == ("V", "mu", "theta", "F")
        assert plain["regime_share"].dims == ("V", "mu", "theta", "F", "kind")
        assert plain["member_regime"].dims == ("V", "mu", "theta", "F", "member")
        assert list(plain["kind"].values.astype(str)) == list(REGIMES)
        np.testing.assert_array_equal(plain["regime_share"].sum("kind"), 1.0)
        assert plain["onset_mu"].dims == ("theta",)
        for name, words in (("regime", REGIMES), ("member_regime", REGIMES), ("verdict", VERDICTS)):
            assert plain[name].attrs["flag_meanings"].split() == [word.replace(" ", "_") for word in words]
            assert plain[name].encoding["dtype"] == np.int8
        for name, variable in transients.SUMMARY.items():
            if name != "regime":
                assert plain[name].attrs["units"] == variable.units
                assert plain[name].dtype == np.float32


def test_the_standard_error_of_a_mean_over_repeat_runs():
    assert regimes.of_mean(np.array([3.0, 4.0])) == pytest.approx(2.5)
    assert regimes.VARIABLES["velocity_rms_se"].scale == regimes.VARIABLES["velocity_rms"].scale == "load"
