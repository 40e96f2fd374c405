"""Own structures: from matrices and modes, their statics, and what is refused."""

import numpy as np
import pytest
from scipy import sparse

from fivcore import InputError, Rig, Scene, Structure, flutter_onsets, simulate
from tests.helpers.plate import plate
from tests.helpers.structures import beams

RIG, THETA = Rig(), 5.0
OSCILLATOR = {"frequency": [0.0, 1.0], "normal": [1.0, 0.0], "tangential": [0.0, 1.0], "load": [-1.0, 0.0]}


@pytest.mark.parametrize("given", [{}, {"fmax": 94e3}, {"fmax": 94e3, "convert": sparse.csc_array}])
def test_matrices_give_the_beams(given, monkeypatch):
    """Dense, with the static compliance of the modes above `fmax`, and by shift and invert."""
    if "convert" in given:
        for module in ("structure", "finite_elements"):
            monkeypatch.setattr(f"fivcore.{module}.DENSE", 10)
    found, rig = beams(**given), Structure.of(RIG, THETA)
    assert found.preload == pytest.approx(1.0, abs=1e-8)
    frequency = np.sort(rig.frequency)[: min(len(found.frequency), 150)]
    assert found.frequency[0] == 0.0
    assert found.frequency[: len(frequency)] == pytest.approx(frequency, rel=1e-8)
    assert found.static == (2 if given else 0)
    for mine, theirs in zip(found.receptances([0.1, 1e3]), rig.receptances([0.1, 1e3]), strict=True):
        assert mine == pytest.approx(theirs, rel=1e-5 if given else 1e-6, abs=1e-12)


def test_a_structure_moves_like_the_rig_it_is():
    one = simulate(Scene(0.02, THETA, 0.2, 9.0), 0.02, cutoff=94e3, record=True)
    for structure in (Structure.of(RIG, THETA), beams(), beams(fmax=10e3), beams(fmax=94e3)):
        other = simulate(Scene(0.02, 0.0, 0.2, 9.0, structure), 0.02, cutoff=94e3, record=True)
        early = one.time < 0.0075
        assert other.velocity_B[early] == pytest.approx(one.velocity_B[early], abs=1e-6 * np.ptp(one.velocity_B))
        assert other.summary["first_slip_time"] == pytest.approx(one.summary["first_slip_time"], abs=4e-6)


@pytest.mark.parametrize("method", ["fast", "exact", "paper"])
def test_the_preload_is_that_of_statics(method):
    """A support of 100 Hz bears most of the load: at rest N is 3 % of it, and stays so in stick."""
    rig = Structure.of(RIG, THETA)
    content = rig.to_dict() | {"stiffness": [p or (2.0 * np.pi * 100.0) ** 2 for p in rig.stiffness]}
    held = Structure.from_dict(content)
    flexible = held.normal / held.stiffness
    assert held.preload == pytest.approx(-(flexible @ held.load) / (flexible @ held.normal))
    assert 0.02 < held.preload < 0.04
    given = {} if method == "paper" else {"cutoff": 94e3}
    run = simulate(Scene(1e-6, 0.0, 0.5, 9.0, held), 2e-3, method, **given, record=True, ramp=1e-3)
    assert run.normal_force == pytest.approx(9.0 * held.preload, rel=1e-4)
    assert np.all(run.state == 1)


def test_time_has_no_unit():
    """The same structure a million times slower: the same run, with times so much longer."""
    modes = {"normal": [1.0, 0.5, 0.4], "tangential": [0.0, 1.0, -0.8], "load": [-1.0, 0.0, 0.0]}
    quick = Structure.from_modes([0.0, 900.0, 1400.0], **modes, damping_ratio=0.002)
    slow = Structure.from_modes([0.0, 9e-4, 1.4e-3], **modes, damping_ratio=0.002)
    one = simulate(Scene(2e-3, 0.0, 0.3, 10.0, quick), 0.4, ramp=1e-3)
    other = simulate(Scene(2e3, 0.0, 0.3, 10.0, slow), 0.4e6, ramp=1e3)
    for name, unit in (("first_slip_time", 1e6), ("dominant_frequency", 1e-6), ("stick_fraction", 1.0)):
        assert other.summary[name] == pytest.approx(unit * one.summary[name], rel=0.02, abs=0.02, nan_ok=True), (
            name
        )


def test_a_mass_on_a_belt_with_one_mode():
    """m = k = 1 and a rigid contact: stick to the static deflection, then steady sliding."""
    structure = Structure.from_modes(**OSCILLATOR | {"frequency": [0.0, 0.5 / np.pi]})
    run = simulate(Scene(0.01, 0.0, 0.5, 1.0, structure), 80.0, ramp=10.0, record=True)
    # The belt has moved V (t - 5 s) when the spring takes up mu N.
    assert run.summary["first_slip_time"] == pytest.approx(55.0, abs=0.5)
    assert run.tangential_force[-1] == pytest.approx(0.5, abs=1e-9)
    assert run.normal_force == pytest.approx(1.0, abs=1e-9)


def test_energy_balances_where_a_rigid_contact_lands_in_stick():
    """The landing takes the tangential motion too: not as friction a second time."""
    shapes = {"normal": [0.7, -1.0, -0.1, -0.4], "tangential": [0.0, 3.3, 0.2, -0.4]}
    structure = Structure.from_modes(
        [0.0, 500.0, 650.0, 1700.0], **shapes, load=[-0.7, 0.0, 0.0, 0.0], damping_ratio=0.003
    )
    onset = flutter_onsets(structure, 0.0).mu[0]
    run = simulate(Scene(2e-3, 0.0, 1.5 * onset, 10.0, structure), 1.0).summary
    assert min(run["stick_fraction"], run["separation_fraction"]) > 0.05
    assert run["energy_residual"] < 1e-3


def test_v_below_zero_is_the_mirror_image():
    structure = beams(fmax=94e3)
    one = simulate(Scene(0.02, 0.0, 0.2, 9.0, structure), 0.01, record=True)
    other = simulate(Scene(-0.02, 0.0, 0.2, 9.0, structure.mirrored()), 0.01, record=True)
    assert np.array_equal(one.normal_force, other.normal_force)
    assert np.array_equal(one.velocity_B, -other.velocity_B)
    assert np.array_equal(one.slip_velocity, -other.slip_velocity)


def test_damping_by_mode_by_ratio_and_by_matrix():
    structure = Structure.from_modes(**OSCILLATOR, damping_ratio=[0.0, 0.03], d1=0.2)
    assert structure.damping == pytest.approx([0.2, 0.2 + 2.0 * 0.03 * 2.0 * np.pi])
    M, K = np.eye(3), np.diag([0.0, 4.0, 9.0])
    rows = {"normal": [1.0, 0.5, 0.2], "tangential": [0.0, 1.0, 1.0], "load": [-1.0, 0.0, 0.0]}
    C = np.array([[0.0, 0.0, 0.0], [0.0, 0.3, 0.1], [0.0, 0.1, 0.5]])
    found = Structure.from_matrices(M, K, **rows, damping=C)
    assert found.damping == pytest.approx([0.0, 0.3, 0.5])
    assert "0.2 of the largest" in found.remarks[0]
    assert Structure.from_dict(found.to_dict()) == found
    # Equal ratios of the tied modes: their matrix is that of the free ones where there is nothing to tie.
    tied = Structure.from_modes(**OSCILLATOR).damped(0.01)
    assert tied.damping == pytest.approx([0.0, 0.0])


@pytest.mark.slow
def test_a_plate_of_a_hundred_thousand_degrees_of_freedom():
    M, K = plate(500, 100, 0.2, 0.04)
    tip = K.shape[0] - 2 * 101
    structure = Structure.from_matrices(
        M, K, normal={tip + 1: 1.0}, tangential={tip: 1.0}, load={tip + 201: -1.0}, d2=1e-8, fmax=50e3
    )
    assert len(structure.frequency) > 10
    assert 0.9 < structure.preload < 1.1
    assert np.isfinite(simulate(Scene(1e-3, 0.0, 0.2, 10.0, structure), 0.01).summary["energy_residual"])


M3, K3 = np.eye(3), np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
ROWS = {"normal": {0: 1.0}, "tangential": {1: 1.0}, "load": {0: -1.0}}
SWAPPED = np.array([[2.0, -1.0, 0.0], [0.0, 2.0, -1.0], [0.0, 0.0, 1.0]])
OUT_OF_RANGE = sparse.csr_array(K3)
OUT_OF_RANGE.indices[1] = 10**6
WRONG_MATRICES = [
    ({"mass": np.eye(2)}, "stiffness of shape (3, 3)"),
    ({"mass": np.ones((2, 3))}, "mass of shape (2, 3): it must be a square matrix"),
    ({"mass": np.ones(3)}, "mass of shape (3,)"),
    ({"mass": "wood"}, "mass = 'wood': it must be a matrix"),
    ({"mass": np.diag([1.0, np.nan, 1.0])}, "mass: it has entries that are not finite"),
    ({"mass": np.diag([1.0, 0.0, 1.0])}, "mass: it must be positive definite"),
    ({"mass": -np.eye(3)}, "mass: it must be positive definite"),
    ({"stiffness": K3 + np.diag([0.5, 0.0], 1)}, "stiffness: not symmetric"),
    ({"stiffness": SWAPPED}, "only one triangle is there"),
    ({"stiffness": sparse.csr_array(SWAPPED)}, "only one triangle is there"),
    ({"stiffness": OUT_OF_RANGE}, "must be a matrix of numbers (axis 1 index 1000000 exceeds matrix dimension 3)"),
    ({"stiffness": -K3}, "stiffness: indefinite"),
    ({"stiffness": K3 * np.inf}, "stiffness: it has entries that are not finite"),
    ({"stiffness": np.eye(4)}, "stiffness of shape (4, 4): it must be of shape (3, 3)"),
    ({"damping": np.eye(2)}, "damping of shape (2, 2)"),
    ({"damping": -np.eye(3)}, "it must not be negative"),
    ({"damping": SWAPPED}, "damping: not symmetric"),
    ({"normal": {0: 0.0}}, "normal: it must not be zero"),
    ({"normal": [0.0, 0.0, 0.0]}, "normal: it must not be zero"),
    ({"normal": [1.0, 0.0]}, "normal of shape (2,): it must be a row of 3 finite numbers"),
    ({"normal": {3: 1.0}}, "normal: degree of freedom 3: it must be from 0 to 2"),
    ({"normal": {-1: 1.0}}, "normal: degree of freedom -1"),
    ({"normal": {"tip": 1.0}}, "normal: degree of freedom 'tip'"),
    ({"normal": {0: "a"}}, "normal: weight of 0 = 'a'"),
    ({"normal": {0: np.inf}}, "normal: weight of 0 = inf"),
    ({"tangential": np.full(3, np.nan)}, "tangential of shape (3,)"),
    ({"tangential": {1: 0.0}}, "tangential: it must not be zero"),
    ({"tangential": "x"}, "tangential = 'x'"),
    ({"load": {0: 1.0}}, "load: with it the contact opens"),
    ({"load": np.zeros(3)}, "load: it must not be zero"),
    ({"output": [1.0]}, "output of shape (1,)"),
    ({"drive": [[1.0]]}, "drive of shape (1, 1)"),
    ({"d1": -1.0}, "d1 = -1.0: it must be a number from 0"),
    ({"d2": "much"}, "d2 = 'much'"),
    ({"damping_ratio": -0.1}, "damping_ratio = -0.1"),
    ({"damping_ratio": [0.1, 0.1]}, "damping_ratio of shape (2,): it must be one number or 3"),
    ({"fmax": 0.0}, "fmax = 0.0"),
    ({"fmax": 1e-3}, "fmax = 0.001: no mode is below it"),
    # Free in all directions: three rigid motions, of which the contact holds one.
    ({"stiffness": np.zeros((3, 3))}, "2 rigid motion(s) that the closed contact does not hold"),
    ({"stiffness": np.diag([1.0, 0.0, 1.0])}, "one moves degree of freedom 1 most"),
]
WRONG_MODES = [
    ({"frequency": [0.0, -1.0]}, "frequency = -1: it must be 0 or above"),
    ({"frequency": []}, "frequency of shape (0,)"),
    ({"normal": [1.0]}, "normal of shape (1,): it must be a row of 2 finite numbers"),
    ({"frequency": [0.0, 0.0]}, "1 rigid motion(s) that the closed contact does not hold"),
]


@pytest.mark.parametrize(("given", "message"), WRONG_MATRICES)
def test_wrong_matrices_are_refused_in_one_line(given, message):
    arguments = {"mass": M3, "stiffness": K3, **ROWS, **given}
    with pytest.raises(InputError) as caught:
        Structure.from_matrices(**arguments)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("given", "message"), WRONG_MODES)
def test_wrong_modes_are_refused_in_one_line(given, message):
    with pytest.raises(InputError) as caught:
        Structure.from_modes(**OSCILLATOR | given)
    assert message in str(caught.value)


def test_theta_belongs_to_the_modes():
    with pytest.raises(
        ValueError, match="theta = 5: the modes of a Structure have its inclination already; give 0"
    ):
        Scene(1e-3, 5.0, 0.2, 9.0, Structure.from_modes(**OSCILLATOR))
    with pytest.raises(ValueError, match="it must be a Rig or a Structure"):
        Scene(1e-3, 5.0, 0.2, 9.0, "rig")
