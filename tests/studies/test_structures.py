"""Studies of structures of one's own: default ranges, and what a failed point says."""

import numpy as np
import pytest

from fivcore import DampingWarning, Rig, Structure, flutter_onsets, painleve_mu
from studies import registry
from studies.answering import summary
from studies.asking.sweep import sweep_of


def drawn(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 7))
    load = -rng.uniform(0.2, 1.0, n)
    frequency = np.sort(rng.uniform(100.0, 5000.0, n))
    return Structure.from_modes(
        frequency, -load, rng.normal(size=n), load=load, damping_ratio=rng.uniform(1e-3, 0.02, n)
    )


@pytest.mark.parametrize("name", ["fig5", "hysteresis", "regimes"])
def test_a_default_range_of_friction_lies_around_the_first_onset(name):
    study, met = registry.load(name), 0
    for seed in range(8):
        own = drawn(seed)
        found = flutter_onsets(own, 0.0, mu_max=10.0)
        first = min([*found.mu, *found.entry_mu, np.nan_to_num(found.divergence_mu, nan=np.inf)])
        sweep = sweep_of(study, {}, structure=own.to_dict())
        mu = (sweep.grid.axes.get("mu") or sweep.coords["mu"]).values
        usual = study.parameters["mu"].default
        limit = 0.9 * painleve_mu(own, 0.0)
        if np.isfinite(first) and first / 0.11123 * usual.max() < limit:
            met += 1
            np.testing.assert_allclose(mu / first, usual / 0.11123, rtol=6e-3)
            assert mu.min() < first < mu.max()
        elif np.isfinite(limit):
            assert mu.max() <= 1.005 * limit
        else:
            np.testing.assert_array_equal(mu, usual)
    assert met >= 1


def test_a_range_that_is_given_stays():
    sweep = sweep_of(registry.load("regimes"), {"mu": [0.1, 0.2]}, structure=drawn(0).to_dict())
    np.testing.assert_array_equal(sweep.grid.axes["mu"].values, [0.1, 0.2])


def test_a_failed_point_names_no_scaled_scene():
    study = registry.load("scenes")
    # Beyond the friction at which the contact force is not unique.
    data = sweep_of(study, {"V": [0.2], "theta": [60.0], "mu": [0.1, 9.0], "F": [500.0], "duration": 0.01})
    with pytest.warns(UserWarning, match="1 of 2 points failed"):
        data = data.plan().run("sync")
    error = str(data["error"].sel(mu=9.0).item())
    assert "not unique" in error
    assert "scene V" not in error


def test_what_is_remarked_of_a_structure_is_in_the_file_and_in_every_answer():
    own = Structure.of(Rig(), 5.0)
    asked = np.full(len(own.tied_damping[0]), 1e-4)
    asked[3] = 0.2
    with pytest.warns(DampingWarning, match="^damping: ratios of tied modes are missed"):
        own = own.damped(asked)
    study = registry.load("fig5")
    data = sweep_of(study, {"mu": [0.1, 0.2]}, structure=own.to_dict()).plan().run("sync")
    assert f"Of the structure: {own.remarks[-1]}." in [*summary.parts(study, data)]
