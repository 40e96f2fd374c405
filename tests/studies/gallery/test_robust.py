"""The study of scattered rigs: probability, draws, indices, and what is told of them."""

from __future__ import annotations

import numpy as np
import pytest

import studies.query.accessor  # noqa: F401 - registers `.fiv`
from fivcore import flutter_onsets
from studies.gallery.robust.study import STUDY
from studies.rig import rig_of, rig_settings
from studies.scatter import instability
from sweeps import InputError, StoreError

GIVEN = {"theta": [0.0, 5.0, 8.0], "mu": np.linspace(0.0, 0.3, 61), "samples": 64, "sobol_samples": 16, "seed": 2}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return STUDY.sweep(GIVEN).plan(tmp_path_factory.mktemp("robust") / "robust.nc").run(scheduler="sync")


def test_onsets_are_those_of_each_rig(result):
    for k in (0, 31, 63):
        drawn = result.isel(sample=k)
        settings = {name: each.value for name, each in rig_settings().items()}
        settings |= {name: float(drawn[name]) for name in instability.USUAL}
        rig, _ = rig_of(settings)
        for theta in (5.0, 8.0):
            onsets = flutter_onsets(rig, theta)
            at = drawn.sel(theta=theta)
            assert float(at["onset_mu"]) == pytest.approx(onsets.mu[0], rel=2e-6)
            assert float(at["onset_frequency"]) == pytest.approx(onsets.frequency[0], rel=2e-6)


def test_the_probability_counts_rigs_beyond_their_onset_and_lies_in_its_interval(result):
    share = result["probability_unstable"].sel(theta=5.0)
    below = result["onset_mu"].sel(theta=5.0).values[:, None] <= result["mu"].values
    np.testing.assert_allclose(share, below.mean(axis=0), atol=1e-12)
    assert np.all(result["probability_low"] <= result["probability_unstable"])
    assert np.all(result["probability_high"] >= result["probability_unstable"])
    nominal = result["nominal_unstable"].sel(theta=5.0).values
    onset = float(result["nominal_onset_mu"].sel(theta=5.0))
    np.testing.assert_array_equal(nominal == 1, result["mu"].values >= onset)
    assert onset == pytest.approx(
        flutter_onsets(rig_of({n: s.value for n, s in rig_settings().items()})[0], 5.0).mu[0]
    )


def test_an_upright_rig_is_stable_and_its_indices_are_zero_not_unknown(result):
    at = result.sel(theta=0.0)
    assert not at["probability_unstable"].any()
    assert np.isnan(at["onset_mu"]).all()
    for name in ("sobol_first", "sobol_total", "sobol_first_se", "sobol_total_se"):
        assert np.isfinite(result[name]).all()
        assert not at[name].any()


def test_total_indices_name_the_numbers_with_the_largest_share_of_the_variance(result):
    """In the linear range each share is the squared correlation of the draws with the onset."""
    at = result.sel(theta=5.0)
    onset = at["onset_mu"].values
    squares = np.array([np.corrcoef(at[str(name)].values, onset)[0, 1] ** 2 for name in at["parameter"].values])
    found, expected = (set(np.argsort(-each)[:4]) for each in (at["sobol_total"].values, squares))
    assert len(found & expected) >= 3


def test_draws_are_coordinates_with_units_distribution_and_what_was_cut_away(result):
    draw = result["p1_thickness"]
    assert draw.dims == ("sample",)
    assert draw.attrs["units"] == "m"
    assert draw.attrs["distribution"] == "normal:0.0015:1.05e-05"
    assert 0.0 <= draw.attrs["share_cut_away"] < 1e-9
    assert float(draw.std()) == pytest.approx(1.05e-5, rel=0.1)


def test_a_query_finds_which_rigs_squeal(result):
    early = result.fiv.query(
        where="theta == 5 and onset_mu < 0.105", show="onset_mu, p1_thickness, p2_young_modulus"
    )
    every = result.fiv.query(where="theta == 5", show="p2_young_modulus, onset_mu")
    assert 0 < len(early) < len(every) == 64
    assert early["p2_young_modulus"].mean() > every["p2_young_modulus"].mean()


def test_more_samples_are_another_result_and_a_seed_too(tmp_path, result):
    small = {**GIVEN, "theta": [5.0], "samples": 8, "sobol_samples": 2}
    file = tmp_path / "robust.nc"
    first = STUDY.sweep(small).plan(file).run(scheduler="sync")
    again = STUDY.sweep(small).plan().run(scheduler="threads")
    np.testing.assert_array_equal(first["onset_mu"], again["onset_mu"])
    np.testing.assert_array_equal(first["onset_mu"][0], result["onset_mu"].sel(theta=5.0)[:8])
    with pytest.raises(StoreError, match="seed = 2 there, 3 here"):
        STUDY.sweep(small | {"seed": 3}).plan(file)


def test_findings_tell_risk_what_decides_and_how_numbers_scatter(result):
    text = STUDY.report(result)
    for part in ("the nominal rig flutters from mu = 0.1112", "What decides the lowest onset", "Wilson 95 %",
                 "No scattered rig is unstable at theta = 0 degrees.", "normal:0.0015:1.05e-05"):  # fmt: skip
        assert part in text
    STUDY.draw(result)
    STUDY.draw(result.isel(theta=[1]))


def test_what_cannot_be_is_refused():
    with pytest.raises(InputError, match="sobol_samples = 12: it must be a power of 2, like 16"):
        STUDY.sweep({"sobol_samples": 12})
    with pytest.raises(ValueError, match=r"samples = 0\.0: it must be"):
        STUDY.sweep({"samples": 0})
    with pytest.raises(ValueError, match="theta"):
        STUDY.sweep({"theta": [95.0]})
