"""Probabilities and Sobol indices against closed forms, and against rigs solved one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import brentq

from fivcore import Rig, flutter_onsets, sliding_modes
from studies.maps import maps
from studies.rig import rig_of, rig_settings
from studies.scatter import instability
from studies.scatter.distributions import parse
from sweeps import InputError, Sample

SETTINGS = {name: each.value for name, each in rig_settings().items()}
THETA = 5.0


def onset(modulus: float) -> float:
    """Friction at the lowest onset of the paper's rig but for P2's modulus."""
    return float(flutter_onsets(replace(Rig(), p2=replace(Rig().p2, young_modulus=modulus)), THETA).mu[0])


@pytest.mark.parametrize("text", ["normal:185e9:4e9", "uniform:18e10:2e11", "triangular:18e10:182e9:2e11"])
def test_with_one_scattered_number_the_probability_is_its_distribution_at_the_onset(text):
    """The lowest onset falls with the modulus; Sobol points of one number are within 1 / n of its distribution."""
    count, mu = 512, np.array([0.1, 0.105, 0.11, 0.115, 0.12])
    draws = instability.sample({"p2_young_modulus": text}, count, 3)
    share = instability.unstable_share(Rig(), draws | {"theta": THETA}, mu)
    scatter = parse(text, "p2_young_modulus")
    ends = [onset(150e9), onset(230e9)]
    assert ends[0] > mu[-1] > mu[0] > ends[1]
    limit = [brentq(lambda modulus, level=level: onset(modulus) - level, 150e9, 230e9, rtol=1e-10) for level in mu]
    assert 0.05 < share[2] < 0.95
    np.testing.assert_allclose(share, 1.0 - scatter.cdf(limit), atol=1.5 / count)


def test_with_scattered_friction_alone_it_is_what_lies_above_the_onset():
    plane = maps.plane_of("theta=3:9:3", "p1_thickness=1.45e-3:1.55e-3:2")
    text, count = "normal:0.12:0.02", 1024
    sweep = maps.sweep_of(plane, "probability_unstable", {"samples": count}, scatter={"mu": text})
    found = sweep.plan().run(scheduler="sync")["probability_unstable"]
    for point in found.stack(point=found.dims).T:
        rig, _ = rig_of(SETTINGS | {"p1_thickness": float(point["p1_thickness"])})
        onsets = flutter_onsets(rig, float(point["theta"]), mu_max=0.3)
        assert not len(onsets.recovery_mu)
        assert float(point) == pytest.approx(1.0 - float(parse(text, "mu").cdf(onsets.mu[0])), abs=1.5 / count)


def test_it_is_the_share_of_rigs_of_which_a_mode_grows():
    """Steady sliding solved rig by rig."""
    texts = instability.usual(SETTINGS) | {"theta": "uniform:1:9"}
    draws, mu = instability.sample(texts, 32, 1), np.linspace(0.02, 0.4, 20)
    grows = []
    for k in range(32):
        values = SETTINGS | {name: float(each[k]) for name, each in draws.items()}
        rig, theta = rig_of(values)
        grows.append([sliding_modes(rig, theta, level).unstable.any() for level in mu])
    np.testing.assert_array_equal(instability.unstable_share(Rig(), draws, mu), np.mean(grows, axis=0))


def test_one_sample_of_rigs_serves_all_points_of_a_map():
    """Along friction the probability never falls where no rig recovers, and a point alone is as in the map."""
    plane = maps.plane_of("theta=4:6:2", "mu=0.08:0.16:9")
    fixed = {"samples": 64, "seed": 5}
    whole = maps.sweep_of(plane, "probability_unstable", fixed).plan().run(scheduler="sync")
    share = whole["probability_unstable"].transpose("theta", "mu").values
    assert np.all(np.diff(share, axis=1) >= 0.0)
    assert share.min() < 0.1
    assert share.max() > 0.9
    alone = maps.sweep_of(maps.plane_of("theta=6", "mu=0.12"), "probability_unstable", fixed)
    value = alone.plan().run(scheduler="sync")["probability_unstable"]
    assert value.item() == share[1, 4]
    text = maps.STUDY.report(whole)
    assert "Each point is a share of 64 rigs, seed 5: one half means 0.381 to 0.619" in text
    assert "thickness of P1" in text


def test_linear_functions_have_the_sobol_indices_of_their_variances():
    scatter = {name: parse(f"normal:{k}:{k}", "V") for k, name in enumerate("abc", 1)}
    found = instability.sobol_indices(lambda x: 2.0 * x["a"] + x["b"] - x["c"], scatter, 1024, 0)
    expected = np.array([4.0, 4.0, 9.0]) / 17.0
    np.testing.assert_allclose(found[0], expected, atol=0.02)
    np.testing.assert_allclose(found[1], expected, atol=0.02)


def test_the_ishigami_function_has_its_known_indices():
    """Ishigami and Homma, 1990, with a = 7 and b = 0.1: variances by its closed form."""
    a, b = 7.0, 0.1
    scatter = {name: parse(f"uniform:{-np.pi!r}:{np.pi!r}", "V") for name in "xyz"}

    def ishigami(at):
        return np.sin(at["x"]) + a * np.sin(at["y"]) ** 2 + b * at["z"] ** 4 * np.sin(at["x"])

    mixed, own = 8.0 * b**2 * np.pi**8 / 225.0, [0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2, a**2 / 8.0, 0.0]
    variance = sum(own) + mixed
    first, total, first_se, total_se = instability.sobol_indices(ishigami, scatter, 2048, 0)
    expected = np.array(own) / variance
    np.testing.assert_array_less(np.abs(first - expected), 2.0 * first_se)
    expected += np.array([mixed, 0.0, mixed]) / variance
    np.testing.assert_array_less(np.abs(total - expected), 2.0 * total_se)
    assert first_se.max() < 0.03


def test_where_nothing_varies_the_indices_are_zero():
    found = instability.sobol_indices(lambda x: np.ones_like(x["a"]), {"a": parse("uniform:1:2", "V")}, 64, 0)
    assert not found.any()


def test_wilsons_interval_is_that_of_scipy():
    for count in (1, 10, 1024):
        for yes in {0, 1, count // 3, count}:
            ends = stats.binomtest(yes, count).proportion_ci(0.95, "wilson")
            np.testing.assert_allclose(instability.wilson(yes / count, count), [ends.low, ends.high], atol=1e-14)


@pytest.mark.parametrize(("method", "most"), [("random", 0.98), ("sobol", 1.0)])
@pytest.mark.parametrize("probability", [0.03, 0.3, 0.5])
def test_wilsons_interval_covers_over_seeds(probability, method, most):
    """Draws of friction beside an onset at its quantile; Sobol points scatter less than independent ones."""
    scatter, count, seeds = parse("normal:0.2:0.05", "mu"), 256, 400
    level = float(scatter.ppf(1.0 - probability))
    shares = [
        np.mean(Sample({"mu": scatter}, count, method, seed).axes["mu"].values > level) for seed in range(seeds)
    ]
    low, high = instability.wilson(np.array(shares), count)
    assert 0.92 <= np.mean((low <= probability) & (probability <= high)) <= most


def test_usual_scatter_is_about_the_numbers_given_and_leaves_out_what_is_zero():
    texts = instability.usual(SETTINGS | {"d1": 0.0, "p1_length": 0.06})
    assert "d1" not in texts
    assert texts["p1_length"] == "normal:0.06:0.00012"
    assert all(each.cut < 1e-6 for each in instability.scatters(texts).values())


def test_what_cannot_scatter_is_refused():
    with pytest.raises(InputError, match=r"--scatter p1_lenght: it cannot scatter here; did you mean p1_length\?"):
        instability.scatters({"p1_lenght": "normal:0.05:0.001"})
    plane = maps.plane_of("theta=4:6:2", "mu=0.1")
    with pytest.raises(InputError, match="--scatter theta: it is an axis of this map"):
        maps.sweep_of(plane, "probability_unstable", {}, scatter={"theta": "normal:5:1"})
    with pytest.raises(InputError, match="--scatter: growth_rate is of one rig"):
        maps.sweep_of(plane, "growth_rate", {}, scatter={"d1": "normal:50:10"})
    with pytest.raises(ValueError, match=r"samples = 0\.5: it must be a whole number"):
        maps.sweep_of(plane, "probability_unstable", {"samples": 0.5})


def test_a_pair_that_enters_the_band_already_growing_counts():
    """In a map of onsets, among scattered rigs and in the probability, with the band's top as its frequency."""
    numbers = {"contact_position": 0.068125, "p1_length": 0.045625}
    rig, theta = rig_of(SETTINGS | numbers | {"theta": 8.0})
    [entry] = flutter_onsets(rig, theta).entry_mu
    plane = maps.plane_of("theta=8:9:2", "contact_position=0.068125:0.07:2")
    for quantity, value in (("onset_mu", entry), ("onset_frequency", 10e3)):
        whole = maps.sweep_of(plane, quantity, {"p1_length": numbers["p1_length"]}).plan().run(scheduler="sync")
        at = whole[quantity].sel(theta=8.0, contact_position=numbers["contact_position"])
        assert float(at) == pytest.approx(value, rel=1e-9)
    found = instability.lowest(instability.onsets(Rig(), numbers | {"theta": [8.0, 0.0]}), np.nan)
    np.testing.assert_allclose(found, [[entry, np.nan], [10e3, np.nan]], rtol=1e-9)
    mu = entry * np.array([1.0 - 1e-6, 1.0 + 1e-6])
    np.testing.assert_array_equal(instability.unstable_share(Rig(), numbers | {"theta": 8.0}, mu), [0.0, 1.0])
