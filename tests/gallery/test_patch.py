"""Study `patch`: the foot against the point, and the contacts that are closed as it slides."""

import pytest

from fivcore import Rig, Scene, flutter_onsets, simulate
from fivcore.stability.several import steady_forces
from studies import registry
from studies.asking.sweep import sweep_of
from studies.physics.foot import closed, foot, growth, onset
from sweeps import InputError


def test_a_point_has_the_onset_of_the_rig_and_a_short_foot_too():
    known = flutter_onsets(Rig(), 5.0)
    for nodes, length in ((1, 15e-3), (2, 1e-6), (3, 1e-6)):
        own = foot(Rig(), 5.0, nodes, length)
        mu, hertz = onset(own)
        assert mu == pytest.approx(known.mu[0], abs=1e-4)
        assert hertz == pytest.approx(known.frequency[0], rel=1e-3)
        assert closed(own, mu) == 1
        assert growth(own, 0.9 * mu) < 0.0 < growth(own, 1.1 * mu)


@pytest.mark.parametrize("mu", [0.0, 0.1, 0.3])
def test_contacts_that_are_closed_as_it_slides_bear_what_a_run_says(mu):
    own, F = foot(Rig(), 5.0, 3, 15e-3), 9.0
    forces = steady_forces(own, mu, F)
    assert forces.sum() == pytest.approx(F, rel=1e-6)
    assert closed(own, mu) == (1 if mu == 0.3 else 2)
    found = simulate(Scene(2e-3, 0.0, mu, F, own), 1.5, settle=1.0).summary["contact_mean_normal_force"]
    # The head swings at 17 Hz for a second.
    assert found == pytest.approx(forces, abs=0.02 * F)


def test_a_foot_that_leaves_the_beam_is_refused():
    for values, message in (
        ({"foot_length": 0.2}, "foot_length = 0.2: it must be above 0 and below 0.14 m"),
        ({"nodes": 0}, "nodes = 0"),
        ({"finer": 0.5}, "finer = 0.5"),
        ({"V": -1e-3}, "V = -0.001"),
    ):
        with pytest.raises(InputError, match=message):
            sweep_of(registry.load("patch"), values)
