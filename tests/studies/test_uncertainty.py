"""Distributions, probabilities and Sobol indices against closed forms, SciPy, and rigs solved one by one."""

import numpy as np
import pytest
from scipy import stats

from fivcore import Rig, flutter_onsets, sliding_modes
from studies.declaring.parameters import rig_numbers
from studies.motion import uncertainty
from studies.motion.uncertainty import parse
from sweeps import InputError

LEVELS = np.array([0.0, 0.001, 0.3, 0.5, 0.9, 0.999, 1.0])


@pytest.mark.parametrize(
    ("text", "name", "units", "whole", "low", "high"),
    [
        ("normal:50:0.1mm", "p1_length", "m", stats.norm(0.05, 1e-4), 0.0, np.inf),
        ("normal:0.05:0.05", "mu", "1", stats.norm(0.05, 0.05), 0.0, np.inf),
        ("lognormal:1:0.5", "point_b", "1", stats.lognorm(0.5), 0.0, 1.0),
        ("triangular:50:80:120deg", "theta", "degree", stats.triang(3.0 / 7.0, 50.0, 70.0), -90.0, 90.0),
        ("loguniform:10ns:1us", "d2", "s", stats.loguniform(1e-8, 1e-6), 0.0, np.inf),
        ("normal:0.5:1kHz", "frequency_12", "Hz", stats.norm(500.0, 1000.0), 0.0, np.inf),
        ("normal:0:1m", "length", "m", stats.norm(0.0, 1.0), 0.0, np.inf),
        ("uniform:-2mm/s:2mm/s", "V", "m s-1", stats.uniform(-2e-3, 4e-3), -np.inf, np.inf),
    ],
)
def test_a_distribution_is_truncated_to_what_its_parameter_can_be(text, name, units, whole, low, high):
    found = parse(text, name, units)
    below, left = whole.cdf(low), whole.cdf(high) - whole.cdf(low)
    np.testing.assert_allclose(found.ppf(LEVELS[1:-1]), whole.ppf(below + LEVELS[1:-1] * left), rtol=1e-9)
    assert np.all((found.ppf(LEVELS) >= low) & (found.ppf(LEVELS) <= high))
    assert found.cut == pytest.approx(1.0 - left, abs=1e-12)
    assert found.whole_std == pytest.approx(whole.std())
    # Its text defines it again, in the parameter's units.
    again = parse(found.text, name, units)
    assert again.described == found.described
    np.testing.assert_array_equal(again.ppf(LEVELS), found.ppf(LEVELS))


@pytest.mark.parametrize(
    ("frozen", "text"),
    [
        (stats.loguniform(1e-9, 1e-7), "loguniform:1e-09:1e-07"),
        (stats.loguniform(1.0, 10.0, scale=2.0), "loguniform:2:20"),
        (stats.loguniform(1.0, 10.0, loc=3.0), "reciprocal:1:10:3:1"),
    ],
)
def test_a_frozen_loguniform_is_the_same_distribution(frozen, text):
    assert uncertainty.text_of(frozen, "d2") == text
    np.testing.assert_allclose(parse(text, "V").ppf(LEVELS), frozen.ppf(LEVELS), rtol=1e-12)
    np.testing.assert_allclose(parse(text, "V").cdf(frozen.ppf(LEVELS)), LEVELS, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("gauss:1:1", "'gauss' is none of normal, uniform, lognormal, triangular"),
        ("normal:1", "normal takes 2 numbers, not 1"),
        ("uniform:-1e308:1e308", "HIGH - LOW at most 1.8e308"),
        ("uniform:,1:2", "separated by ':'"),
        ("triangular:1:5:2", "MODE must be from LOW = 1 to HIGH = 2, not 5"),
        ("loguniform:0:1", "LOW must be above 0, not 0"),
        ("lognormal:-1:1", "MEDIAN must be above 0, not -1"),
        ("normal:-9:1", "100 % of it is beyond what mu can be, 0 to inf"),
        ("normal:1mm:1mm", "mm is a length"),
    ],
)
def test_a_wrong_distribution_is_one_line_with_the_forms(text, problem):
    with pytest.raises(InputError) as caught:
        parse(text, "mu")
    message = str(caught.value)
    assert message.startswith(f"mu = {text!r}: ")
    assert problem in message
    assert message.endswith(f"{uncertainty.FORMS} | {uncertainty.SCIPYS}")
    assert "\n" not in message


def test_usual_distributions_are_about_the_numbers_of_the_rig_and_leave_out_zeros():
    texts = uncertainty.usual(rig_numbers(Rig()) | {"d1": 0.0, "p1_length": 0.06})
    assert "d1" not in texts
    assert texts["p1_length"] == "normal:0.06:0.00012"
    assert len(uncertainty.table(texts)) == len(texts) == len(uncertainty.USUAL) - 1
    with pytest.raises(InputError, match=r"^p1_lenght: .* did you mean p1_length\?"):
        uncertainty.distributions({"p1_lenght": "normal:0.05:0.001"})


def test_the_ishigami_function_has_its_known_sobol_indices():
    """Ishigami and Homma, 1990, with a = 7 and b = 0.1: variances in closed form."""
    a, b = 7.0, 0.1
    uncertain = {name: parse(f"uniform:{-np.pi!r}:{np.pi!r}", "V", "m s-1") for name in "xyz"}

    def ishigami(at):
        return np.sin(at["x"]) + a * np.sin(at["y"]) ** 2 + b * at["z"] ** 4 * np.sin(at["x"])

    mixed, single = 8.0 * b**2 * np.pi**8 / 225.0, [0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2, a**2 / 8.0, 0.0]
    first, total, first_se, total_se = uncertainty.sobol_indices(ishigami, uncertain, 2048, 0)
    expected = np.array(single) / (sum(single) + mixed)
    np.testing.assert_array_less(np.abs(first - expected), 2.0 * first_se)
    expected += np.array([mixed, 0.0, mixed]) / (sum(single) + mixed)
    np.testing.assert_array_less(np.abs(total - expected), 2.0 * total_se)


def test_sobol_indices_of_one_parameter_and_of_a_constant():
    one = {"a": parse("normal:1:1", "V")}
    assert uncertainty.sobol_indices(lambda x: x["a"], one, 8, 0).ravel().tolist() == [1.0, 1.0, 0.0, 0.0]
    assert not uncertainty.sobol_indices(lambda x: np.ones_like(x["a"]), one, 8, 0).any()


def test_wilsons_interval_is_that_of_scipy():
    for count in (1, 10, 1024):
        for yes in {0, 1, count // 3, count}:
            ends = stats.binomtest(yes, count).proportion_ci(0.95, "wilson")
            np.testing.assert_allclose(uncertainty.wilson(yes / count, count), [ends.low, ends.high], atol=1e-14)


def test_the_share_counts_rigs_with_an_unstable_mode_solved_one_by_one():
    texts = uncertainty.usual(rig_numbers(Rig())) | {"theta": "uniform:1:9"}
    draws, mu = uncertainty.draws(texts, 24, 1), np.linspace(0.02, 0.4, 20)
    unstable = []
    for k in range(24):
        numbers = {name: float(values[k]) for name, values in draws.items()}
        theta = numbers.pop("theta")
        unstable.append(sliding_modes(Rig.of(**numbers), theta, mu).unstable.any(axis=-1))
    np.testing.assert_array_equal(uncertainty.unstable_share(Rig(), draws, mu), np.mean(unstable, axis=0))


def test_a_pair_that_enters_the_band_unstable_counts_with_the_bands_end_as_its_frequency():
    numbers = {"contact_position": 0.068125, "p1_length": 0.045625}
    [entry] = flutter_onsets(Rig.of(**numbers), 8.0).entry_mu
    found = uncertainty.lowest(uncertainty.onsets(Rig(), numbers | {"theta": [8.0, 0.0]}), np.nan)
    np.testing.assert_allclose(found, [[entry, np.nan], [10e3, np.nan]], rtol=1e-9)
    mu = entry * np.array([1.0 - 1e-6, 1.0 + 1e-6])
    np.testing.assert_array_equal(uncertainty.unstable_share(Rig(), numbers | {"theta": 8.0}, mu), [0.0, 1.0])


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (stats.norm(0.2, 0.02), "normal:0.2:0.02"),
        (stats.norm(loc=0.2, scale=0.02), "normal:0.2:0.02"),
        (stats.uniform(0.1, 0.2), "uniform:0.1:0.30000000000000004"),
        (stats.truncnorm(-2.0, 2.0, loc=0.2, scale=0.02), "truncnorm:-2:2:0.2:0.02"),
        (stats.lognorm(0.3, scale=0.2), "lognorm:0.3:0:0.2"),
        (stats.gamma(4, 0.0, 0.05), "gamma:4:0:0.05"),
    ],
)
def test_a_frozen_distribution_is_the_text_that_one_types(given, text):
    assert uncertainty.text_of(given, "mu") == text
    found = parse(text, "mu")
    np.testing.assert_allclose(found.ppf(LEVELS[1:-1]), given.ppf(LEVELS[1:-1]), rtol=1e-12)
    assert (found.text, uncertainty.text_of(found, "mu")) == (text, text)


@pytest.mark.parametrize(
    "given", [stats.poisson(3), stats.norm([1, 2], 1), stats.gaussian_kde([1.0, 2.0]), object()]
)
def test_what_is_no_frozen_distribution_is_refused(given):
    with pytest.raises(InputError, match=r"^mu = .*: it must be a frozen distribution of scipy.stats, norm"):
        uncertainty.text_of(given, "mu")


@pytest.mark.parametrize("text", ["truncnorm:1:0:0.2:0.02", "gamma:-1:0:1", "norm:0:0", "norm:1mm:1"])
def test_numbers_that_define_no_distribution_are_refused(text):
    with pytest.raises(InputError, match=f"^mu = '{text}': "):
        parse(text, "mu")
