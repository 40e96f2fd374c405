"""Table 4: the beams glued at the contact."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

from fivcore import Rig, glued_frequencies, tune_head_mass
from studies import paper
from tests.helpers import reference
from tests.helpers.rigs import angles, rigs, workshop_rig

AT_85 = Rig(contact_position=0.085)


def test_table_4_is_found_again_at_85_mm():
    rig = replace(AT_85, head_mass=tune_head_mass(AT_85, 5.0, 16.0))
    assert rig.head_mass == pytest.approx(Rig().head_mass, abs=1e-4)
    np.testing.assert_allclose(glued_frequencies(rig, 5.0), paper.GLUED_NUMERICAL, rtol=0.0025)


def test_table_4_is_not_found_at_80_mm():
    rig = replace(Rig(), head_mass=tune_head_mass(Rig(), 5.0, 16.0))
    error = np.abs(glued_frequencies(rig, 5.0) / paper.GLUED_NUMERICAL - 1.0)
    assert error.max() > 0.1
    assert glued_frequencies(Rig(), 5.0)[0] == pytest.approx(17.5, abs=0.05)


def test_a_ninth_mode_below_10_khz_is_not_in_the_paper():
    assert glued_frequencies(AT_85, 5.0, 9)[8] == pytest.approx(8237.0, abs=1.0)


@pytest.mark.parametrize("seed", range(6))
def test_frequencies_are_those_of_a_dense_solve(seed):
    rig, theta = (AT_85, 5.0) if seed == 0 else (workshop_rig(seed), 7.0 * seed - 40.0)
    dense = np.sqrt(reference.glued_eigenvalues(rig, theta)[:12]) / (2.0 * np.pi)
    np.testing.assert_allclose(glued_frequencies(rig, theta, 12), dense, rtol=1e-10)


def test_every_mode_can_be_asked_for_and_none_beyond():
    """With the same bits whatever the count."""
    everything = glued_frequencies(Rig(), 5.0, 359)
    assert np.all(np.diff(everything) >= 0.0)
    for count in (1, 6, 17):
        np.testing.assert_array_equal(glued_frequencies(Rig(), 5.0, count), everything[:count])
    with pytest.raises(ValueError, match="count = 360: it must be a whole number from 1 to 359"):
        glued_frequencies(Rig(), 5.0, 360)


@given(rigs, angles)
@settings(max_examples=20, deadline=None)
def test_tuning_makes_the_frequency_the_first_and_the_mirror_image_has_the_same(rig, theta):
    np.testing.assert_allclose(glued_frequencies(rig, theta), glued_frequencies(rig, -theta), rtol=1e-10)
    largest = glued_frequencies(replace(rig, head_mass=0.0), theta, 1)[0]
    for share in (0.02, 0.5, 0.99):
        mass = tune_head_mass(rig, theta, share * largest)
        assert mass > 0.0
        first = glued_frequencies(replace(rig, head_mass=mass), theta, 1)[0]
        assert first == pytest.approx(share * largest, rel=1e-9)


@pytest.mark.parametrize("frequency", [9000.0, 1e-6, 0.0, float("nan")])
def test_tuning_names_the_possible_frequencies(frequency):
    said = rf"frequency = {frequency}: it must be above 0\.000962\d* Hz, .*, and below 101\.\d+ Hz"
    with pytest.raises(ValueError, match=said):
        tune_head_mass(Rig(), 5.0, frequency)


@pytest.mark.parametrize("frequency", [1e-3, 100.0])
def test_tuning_is_exact_at_the_ends_of_its_range(frequency):
    rig = replace(Rig(), head_mass=tune_head_mass(Rig(), 5.0, frequency))
    assert glued_frequencies(rig, 5.0, 1)[0] == pytest.approx(frequency, rel=1e-9)
