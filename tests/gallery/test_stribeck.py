"""Falling friction in studies: shares of a growth rate, equivalent points, and the same law by every way."""

import numpy as np
import pytest

from fivcore import Friction, Rig, Scene, Structure, flutter_onsets, simulate, sliding_modes
from fivcore.friction import DECAYS
from studies import registry
from studies.answering import summary
from studies.asking.sweep import sweep_of
from studies.gallery import maps
from studies.gallery.stribeck import shares
from studies.motion.scenes import normalised

LAW = Friction(0.7, 0.02)


def swept(study, **values):
    return sweep_of(study, values).plan().run("sync")


@pytest.mark.parametrize("V", [0.2, 1.0, 3.0])
@pytest.mark.parametrize("decay", ["exponential", "rational"])
def test_shares_of_an_oscillator_are_minus_xi_and_half_the_fall(V, decay):
    xi, law = 0.05, Friction(0.5, 0.5, decay)
    block = Structure.from_modes(
        [0.0, 0.5 / np.pi], [1.0, 0.0], [0.0, 1.0], load=[-1.0, 0.0], damping_ratio=[0.0, xi]
    )
    found = shares(Scene(V, 0.0, 0.9, 2.0, block, law))
    fall = -0.9 * 2.0 * law.slope(V)
    assert found["growth_coupled"] == pytest.approx(-xi, abs=1e-12)
    assert found["growth_falling"] == pytest.approx(0.5 * fall, abs=1e-12)
    assert found["growth_rate"] == pytest.approx(0.5 * fall - xi, abs=1e-12)


def test_without_a_fall_all_growth_is_of_coupled_modes(computed):
    data = computed("stribeck", V=[1e-3, 0.05], kinetic_ratio=[0.6, 1.0], max_duration=0.3)
    assert np.all(data["growth_falling"].sel(kinetic_ratio=1.0) == 0.0)
    np.testing.assert_allclose(data["growth_coupled"] + data["growth_falling"], data["growth_rate"])
    modes = sliding_modes(Rig(), 5.0, 0.2)
    assert float(data["growth_rate"].sel(V=1e-3, kinetic_ratio=1.0)) == pytest.approx(modes.growth_rate.max())
    slow, fast = data["growth_falling"].sel(kinetic_ratio=0.6)
    assert slow > 100.0 * fast > 0.0
    text = summary.text(summary.parts(registry.load("stribeck"), data))
    assert "Steady sliding is unstable at every point" in text


@pytest.mark.parametrize(("group", "values", "distinct"), [
    ("growth", {"V": [1e-3, 2e-3], "F": [9.0, 18.0], "decay_speed": [0.01, 0.02]}, 1),
    ("growth", {"V": [1e-3, 2e-3], "F": [9.0, 18.0], "kinetic_ratio": 0.7, "decay_speed": [0.01, 0.02]}, 7),
    ("growth", {"V": [1e-3, 2e-3], "kinetic_ratio": 0.7, "decay_speed": 0.0, "decay": [*DECAYS]}, 1),
    ("growth", {"V": [-1e-3, 1e-3], "theta": [-5.0, 5.0], "kinetic_ratio": [0.7, 1.0]}, 4),
    ("onset", {"V": [1e-3, 2e-3], "decay_speed": [0.01, 0.02]}, 1),
    ("motion", {"V": [1e-3, 2e-3], "F": [9.0, 18.0], "kinetic_ratio": [0.7, 1], "decay_speed": [0.01, 0.02]}, 10),
])  # fmt: skip
def test_equivalent_points_are_computed_once(group, values, distinct):
    plan = sweep_of(maps.STUDIES[group], values).plan()
    assert plan.todo == distinct
    assert plan.points == np.prod([np.size(each) for each in values.values()])


def test_copies_have_the_bits_of_one_motion(computed):
    given = {"theta": 5.0, "mu": 0.2, "duration": 0.2, "kinetic_ratio": 0.7}
    data = computed("scenes", V=[0.01, 0.04], F=[3.0, 12.0], decay_speed=[0.01, 0.04], **given)
    one, four = (data.sel(V=a * 0.01, F=a * 3.0, decay_speed=a * 0.01) for a in (1.0, 4.0))
    assert four["velocity_rms"].item() == 4.0 * one["velocity_rms"].item() > 0.0
    scene = Scene(0.04, 5.0, 0.2, 3.0, friction=Friction(0.7, 0.04))
    alone = simulate(scene, 0.2).summary
    assert data["velocity_rms"].sel(V=0.04, F=3.0, decay_speed=0.04).item() == alone["velocity_rms"]


def test_growth_and_onsets_of_maps_are_those_of_the_law():
    given = {"V": 4e-3, "F": 3.0, "kinetic_ratio": [LAW.kinetic_ratio, 1.0], "decay_speed": LAW.decay_speed}
    growth, onset = (swept(maps.STUDIES[group], **given) for group in ("growth", "onset"))
    for law in (LAW, Friction()):
        how = {"friction": law, "V": 4e-3, "F": 3.0}
        modes, at = sliding_modes(Rig(), 5.0, 0.2, **how), {"kinetic_ratio": law.kinetic_ratio}
        assert float(growth["growth_rate"].sel(at)) == pytest.approx(np.nanmax(modes.growth_rate), rel=1e-3)
        found = flutter_onsets(Rig(), 5.0, **how)
        lowest = min(*found.mu, *found.entry_mu)
        assert float(onset["onset_mu"].sel(at)) == pytest.approx(lowest, rel=1e-9)


def test_a_jump_is_the_kinetic_coefficient_in_steady_sliding():
    data = swept(maps.STUDIES["growth"], mu=[0.16, 0.2], kinetic_ratio=[0.8, 1.0], decay_speed=0.0)
    kinetic, constant = (
        data["growth_rate"].sel(mu=0.2, kinetic_ratio=0.8),
        data["growth_rate"].sel(mu=0.16, kinetic_ratio=1.0),
    )
    assert float(kinetic) == float(constant)


def test_what_a_constant_friction_does_not_depend_on_has_one_value():
    points = {"V": [2e-3, -2e-3], "kinetic_ratio": [1.0, 0.5], "decay_speed": [7.0, 0.01], "decay": "rational"}
    motion, steady = (normalised(points, 2, steady=each) for each in (False, True))
    assert motion["decay_speed"].tolist() == steady["decay_speed"].tolist() == [0.01, pytest.approx(0.01 / 9.0)]
    assert motion["decay"].tolist() == ["exponential", "rational"]
    assert steady["V"][0] == 1.0
    assert motion["theta"].tolist() == steady["theta"].tolist() == [5.0, -5.0]


def test_laws_of_friction_are_drawn_and_derived_values_know_them(computed):
    from studies.motion.uncertainty import parse

    values = {
        "kinetic_ratio": parse("uniform:0.6:1.2", "kinetic_ratio"),
        "V": 2e-3,
        "theta": 5.0,
        "mu": 0.2,
        "F": 9.0,
    }
    drawn = sweep_of(registry.load("scenes"), values | {"duration": 0.02}, samples=8).plan().run("sync")
    assert np.all(drawn["status"] == 1)
    assert drawn["kinetic_ratio"].max() <= 1.0
    law = {"kinetic_ratio": 0.7, "max_duration": 0.3, "min_duration": 0.2}
    data = computed("regimes", V=[1e-3, 0.02], mu=[0.1, 0.2], **law)
    assert data["onset_mu"].dims == ("theta", "V", "F")
    expected = flutter_onsets(Rig(), 5.0, mu_max=0.2, friction=Friction(0.7), V=0.02, F=9.0)
    assert float(data["onset_mu"].sel(V=0.02).squeeze()) == min(*expected.mu, *expected.entry_mu)
    # The model that is simulated has fewer modes, and a step.
    at = data.sel(V=1e-3, mu=0.2).squeeze()
    assert float(at["model_growth_rate"]) == pytest.approx(float(at["growth_rate"]), rel=0.1)
    plane = computed("stability", theta=[4.0, 5.0], mu=[0.1, 0.2], kinetic_ratio=0.7)
    assert plane.sizes["pair"] == 0
    assert "friction depends on the speed" in plane["pair_onset_mu"].attrs["comment"]
    assert np.all(plane["onset_mu"] < 0.01)


@pytest.mark.parametrize("study", ["stability", "scenes", "stribeck"])
@pytest.mark.parametrize(("values", "message"), [
    ({"kinetic_ratio": 1.5}, "kinetic_ratio = 1.5: it must be a number from 0 to 1"),
    ({"decay_speed": -1.0}, "decay_speed = -1.0: it must be 0 or a speed from"),
    ({"decay": "linear"}, "decay = 'linear': it must be one of exponential, rational"),
    ({"V": 0.0}, "V = 0.0: it must be a speed of"),
])  # fmt: skip
def test_wrong_laws_are_refused_in_a_line(study, values, message):
    with pytest.raises(ValueError, match=message) as problem:
        sweep_of(registry.load(study), values)
    assert "\n" not in str(problem.value)
