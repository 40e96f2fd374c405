"""Sensitivity of the flutter onsets: real changes, and pairs over theta."""

from functools import partial

import numpy as np
import pytest

from fivcore import Rig, flutter_onsets, onset_curves
from studies import paper
from studies.declaring.parameters import rig_numbers
from studies.gallery.sensitivity import STUDY
from studies.physics.onsets import VARIED

ANGLES = [-5.0, 0.5, 3.0, 5.0, 8.0]


@pytest.fixture(scope="module")
def computed(computed):
    return partial(computed, "sensitivity")


@pytest.fixture(scope="module")
def whole(computed):
    return computed(theta=ANGLES)


@pytest.mark.parametrize("parameter", VARIED)
def test_derivatives_and_changes_are_those_of_changed_rigs(whole, parameter):
    def onsets(factor):
        numbers = rig_numbers(Rig()) | {"theta": 8.0}
        numbers[parameter] *= factor
        theta = numbers.pop("theta")
        return flutter_onsets(Rig.of(**numbers), theta)

    step, at = 1e-5, whole.sel(theta=8.0, parameter=parameter)
    start, low, high, one = map(onsets, (1.0, 1.0 - step, 1.0 + step, 1.01))
    for name in ("mu", "frequency"):
        first, less, more, new = (getattr(found, name)[:3] for found in (start, low, high, one))
        np.testing.assert_array_equal(at[f"onset_{name}"], first)
        slope = (more - less) / (2.0 * step * first)
        np.testing.assert_allclose(at[f"elasticity_{name}"], slope, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(at[f"change_{name}"] / first, new / first - 1.0, rtol=1e-7, atol=1e-9)


def test_pairs_are_branches_of_onsets_numbered_where_requested(whole, computed):
    curves, at = onset_curves(Rig(), ANGLES), ANGLES.index(paper.THETA)
    branches = [int(np.flatnonzero(curves.mu[at] == mu)[0]) for mu in np.sort(curves.mu[at])[:3]]
    for name in ("mu", "frequency"):
        found = whole[f"onset_{name}"].transpose("parameter", "theta", "pair").values
        np.testing.assert_array_equal(found, np.broadcast_to(getattr(curves, name)[:, branches], found.shape))
    np.testing.assert_allclose(whole["onset_frequency"].max(["theta", "parameter"]), [2802, 398, 7705], atol=0.5)
    known = np.isfinite(whole["elasticity_mu"].values).all(axis=1)
    np.testing.assert_array_equal(known.sum(axis=1), [0, 2, 3, 3, 3])
    assert computed(theta=[5.0], parameter=["theta"], pairs_theta=15.0, mu_max=0.2)["onset_mu"].isnull().all()


def test_the_summary_names_the_parameters_that_matter(whole):
    [sentence, *tables] = STUDY.summary(whole)
    assert "length of P2 (8.57 to 41.6 %), length of P1 (" in sentence
    assert sentence.endswith("less than 0.1 % with head mass, d1, d2.")
    assert [caption.split(",")[0] for caption, _ in tables] == ["2802 Hz", "398 Hz", "7705 Hz"]
