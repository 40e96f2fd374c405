"""Uncertain rigs: onsets of single rigs, probabilities that count them, dominant parameters, what is refused."""

import numpy as np
import pytest

from fivcore import Rig, flutter_onsets
from studies import runner
from studies.answering import summary
from studies.asking.sweep import sweep_of
from studies.gallery.robust import STUDY
from studies.motion.uncertainty import USUAL, parse

GIVEN = {"theta": [0.0, 5.0, 8.0], "mu": np.linspace(0.0, 0.3, 61), "samples": 64, "sobol_samples": 16, "seed": 2}
SMALL = GIVEN | {"theta": [5.0], "samples": 8, "sobol_samples": 2}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return sweep_of(STUDY, GIVEN).plan(tmp_path_factory.mktemp("robust") / "robust.nc").run(scheduler="sync")


def test_onsets_are_those_of_each_rig_and_draws_are_coordinates(result):
    for k in (0, 63):
        at = result.isel(sample=k).sel(theta=8.0)
        onsets = flutter_onsets(Rig.of(**{name: float(at[name]) for name in USUAL}), 8.0)
        assert float(at["onset_mu"]) == pytest.approx(onsets.mu[0], rel=2e-6)
        assert float(at["onset_frequency"]) == pytest.approx(onsets.frequency[0], rel=2e-6)
    assert result["p1_thickness"].attrs["distribution"] == "normal:0.0015:1.05e-05"


def test_the_probability_counts_rigs_beyond_their_onset_and_lies_in_its_interval(result):
    at, mu = result.sel(theta=5.0), result["mu"].values
    below = at["onset_mu"].values[:, None] <= mu
    np.testing.assert_allclose(at["probability_unstable"], below.mean(axis=0), atol=1e-12)
    assert np.all(result["probability_low"] <= result["probability_high"])
    nominal = flutter_onsets(Rig(), 5.0).mu[0]
    assert float(at["nominal_onset_mu"]) == pytest.approx(nominal)
    np.testing.assert_array_equal(at["nominal_unstable"] == 1, mu >= nominal)


def test_indices_are_zero_for_an_upright_rig_and_for_certain_parameters(result):
    upright = result.sel(theta=0.0)
    assert not upright["probability_unstable"].any()
    assert np.isnan(upright["onset_mu"]).all()
    one = sweep_of(STUDY, SMALL | {"d1": parse("normal:50:10", "d1")}).plan().run("sync")
    for name in ("sobol_first", "sobol_total", "sobol_first_se", "sobol_total_se"):
        assert np.isfinite(result[name]).all()
        assert not upright[name].any()
        np.testing.assert_array_equal(one[name][0], (one["parameter"] == "d1") & (not name.endswith("se")))


def test_total_indices_name_the_parameters_with_most_of_the_variance(result):
    """In the linear range each share is the squared correlation of the draws with the onset."""
    at = result.sel(theta=5.0)
    squares = [np.corrcoef(at[name], at["onset_mu"])[0, 1] ** 2 for name in at["parameter"].values]
    found, expected = (set(np.argsort(values)[-4:]) for values in (at["sobol_total"].values, squares))
    assert len(found & expected) >= 3
    sentence = next(STUDY.summary(result))
    assert "from mu = 0.1112 on, at 2802 Hz" in sentence
    assert "Young's modulus of P2" in sentence
    assert all(axes.get_legend() is None for axes in runner.draw(STUDY, result)[""].axes)  # none lies on data


def test_another_nominal_rig_has_a_summary():
    data = sweep_of(STUDY, SMALL | {"p1_length": 0.06}).plan().run("sync")
    assert data["p1_length"].dims == ("sample",)
    assert "P1 length = 60 mm" in summary.text(summary.parts(STUDY, data), 100)
    assert "P1 length = 60 mm" in runner.draw(STUDY, data)[""]._suptitle.get_text()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"sobol_samples": 12}, "sobol_samples = 12: it must be a power of 2"),
        ({"samples": 0}, "samples = 0.*: it must be"),
        ({"theta": parse("normal:5:1", "theta")}, "theta: it is an axis of study robust, without"),
        ({"point_b": parse("normal:0.5:0.1", "point_b")}, "point_b: stability does not depend on it"),
    ],
)
def test_what_cannot_be_is_refused(values, message):
    with pytest.raises(ValueError, match=message):
        sweep_of(STUDY, values)


def test_the_nominal_rig_is_in_the_middle_of_the_requested_distributions():
    drawn = {"p1_length": parse("normal:60:0.1mm", "p1_length", "m"), "d1": parse("lognormal:40:0.2", "d1", "s-1")}
    constants = sweep_of(STUDY, GIVEN | drawn).constants
    assert (constants["p1_length"], constants["d1"], constants["p2_length"]) == (0.06, 40.0, 0.15)
