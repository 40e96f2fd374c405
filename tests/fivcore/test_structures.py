"""Own structures: from matrices and modes, their statics, and what is refused."""

import pickle
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg, sparse

from fivcore import (
    DampingWarning,
    Friction,
    InputError,
    Rig,
    Scene,
    Structure,
    flutter_onsets,
    node_positions,
    simulate,
    sliding_modes,
)
from tests.helpers.plate import plate
from tests.helpers.structures import beams

RIG, THETA = Rig(), 5.0
OSCILLATOR = {"frequency": [0.0, 1.0], "normal": [1.0, 0.0], "tangential": [0.0, 1.0], "load": [-1.0, 0.0]}


@pytest.mark.parametrize("given", [{}, {"fmax": 94e3}, {"fmax": 94e3, "convert": sparse.csc_array}])
def test_matrices_give_the_beams(given, monkeypatch):
    """Dense, with the static compliance of the modes above `fmax`, and by shift and invert."""
    if "convert" in given:
        for module in ("structure", "finite_elements"):
            monkeypatch.setattr(f"fivcore.{module}.DENSE_SIZE", 10)
    found, rig = beams(**given), Structure.of(RIG, THETA)
    assert found.preload == pytest.approx(1.0, abs=1e-8)
    frequency = np.sort(rig.frequency)[: min(len(found.frequency), 150)]
    assert found.frequency[0] == 0.0
    assert found.frequency[: len(frequency)] == pytest.approx(frequency, rel=1e-8)
    assert found.static == (2 if given else 0)
    for mine, theirs in zip(found.receptances([0.1, 1e3]), rig.receptances([0.1, 1e3]), strict=True):
        assert mine == pytest.approx(theirs, rel=1e-5 if given else 1e-6, abs=1e-12)


def beam_rows():
    """Rows of the nodes in `SlidingModes.shape`'s order, of `tests.helpers.reference.assemble`: P1 from A to C."""
    n1, n2 = RIG.p1.elements, RIG.p2.elements
    upper = np.arange(3 * n1).reshape(n1, 3)[:, :2]
    lower = 3 * n1 + 1 + np.arange(3 * n2).reshape(n2, 3)[:, :2]
    return np.concatenate([[[-1, 3 * n1]], upper[::-1], [[-1, -1]], lower])


@pytest.mark.parametrize("given", [{}, {"convert": sparse.csc_array}])
def test_sliding_modes_are_brought_back_to_nodes(given):
    """Those of the beams by matrices, some with held rows, are the beams' own; positions change nothing else."""
    rig, plain = sliding_modes(RIG, THETA, [0.1, 0.3], 9e3), beams(**given)
    own = beams(**given, node_positions=node_positions(RIG, THETA), node_rows=beam_rows())
    assert (own, own.digest, own.to_dict()) == (plain, plain.digest, plain.to_dict())
    moved = own.displacement(sliding_modes(own, 0.0, [0.1, 0.3], 9e3).shape)
    flat = moved.reshape(*moved.shape[:2], -1)
    largest = np.take_along_axis(flat, np.abs(flat).argmax(axis=-1)[..., None], axis=-1)
    moved = moved / largest[..., None]
    assert moved[..., :2] == pytest.approx(rig.shape[..., :2], abs=2e-5)
    assert not moved[..., 2].any()
    ends = np.array([*range(30), *range(32, 121)])  # the stiffness has no row of the clamped node
    assert own.edges.tolist() == np.stack([ends, ends + 1], axis=1).tolist()
    with pytest.raises(InputError, match="it keeps no eigenvectors; give node_positions"):
        plain.displacement(1.0)


def test_shapes_of_modes_are_kept_in_the_order_of_modes():
    shapes = np.random.default_rng(3).normal(size=(5, 3, 2))
    swapped = {name: row[::-1] for name, row in OSCILLATOR.items()}
    given = {"node_positions": np.eye(5)[:, :2], "node_numbers": [7, 3, 9, 1, 4]}
    one = Structure.from_modes(**OSCILLATOR, **given, node_shapes=shapes)
    other = Structure.from_modes(**swapped, **given, node_shapes=shapes[..., ::-1])
    assert one.displacement([1.0, 2.0]) == pytest.approx(shapes @ [1.0, 2.0])
    assert np.array_equal(one.shapes, other.shapes)
    assert other.numbers.tolist() == [7, 3, 9, 1, 4]


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


PIN = Structure.from_modes([500, 800, 1700], [0.4, 0.1, 0.4], [-0.9, -0.7, -0.4], load=[-0.4, -0.1, 0.0])


def tied_exponents(own):
    """Complex eigenvalues with the contact tied, static modes as springs; without `fivcore.damping`."""
    m, gaps = len(own.frequency), np.stack([own.normal, own.tangential])
    K, held = np.diag(own.stiffness[:m]), np.eye(m)
    if own.static:
        compliance = (gaps[:, m:] / own.stiffness[m:]) @ gaps[:, m:].T
        K += gaps[:, :m].T @ np.linalg.solve(compliance, gaps[:, :m])
    else:
        held = linalg.null_space(gaps)
    K, D = held.T @ K @ held, held.T @ (own.damping[:m, None] * held)
    unit = np.sqrt(np.abs(K).max())
    values = unit * np.linalg.eigvals(np.block([[0.0 * K, np.eye(len(K))], [-K / unit**2, -D / unit]]))
    values = values[values.imag > 0.0]
    return values[np.argsort(np.abs(values))]


@pytest.mark.parametrize("ratio", [0.01, 0.001, "falling"])
@pytest.mark.parametrize("fmax", [None, 10e3, 20e3, 50e3, 94e3])
def test_ratios_of_the_tied_structure_are_those_asked_for(fmax, ratio):
    """The pin of studies/README.md, and the paper's rig by its matrices, as far as 0.8 of the band."""
    own = PIN if fmax is None else beams(fmax=fmax)
    top, count = own.frequency[-1], len(own.tied_damping[0])
    asked = np.geomspace(0.02, 0.005, count) if ratio == "falling" else np.full(count, ratio)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        damped = own.damped(ratio if ratio != "falling" else asked)
    exponents = tied_exponents(damped)
    frequency, found = np.abs(exponents) / (2.0 * np.pi), -exponents.real / np.abs(exponents)
    low = frequency < 0.8 * top
    assert low.sum() == {None: 1, 10e3: 7, 20e3: 10, 50e3: 19, 94e3: 29}[fmax]
    np.testing.assert_allclose(found[low], asked[low], rtol=0.02)
    # What came of it is said, and no free mode is damped against all reason.
    np.testing.assert_allclose(damped.tied_damping[0], frequency, rtol=1e-4)
    np.testing.assert_allclose(damped.tied_damping[1], found, rtol=0.01)
    missed = np.abs(found / asked - 1.0) > 0.1
    for hertz in frequency[missed]:
        assert f" {hertz:.6g}"[:4] in damped.remarks[-1]
    assert missed.any() == any("tied" in remark for remark in damped.remarks)
    free = damped.damping[: len(own.frequency)] / (2.0 * np.sqrt(own.stiffness[: len(own.frequency)]) + 1e-300)
    assert np.all(free[own.frequency > 0.0] < 2.0 * asked.max())
    assert np.all(damped.damping >= 0.0)


def test_ratios_that_no_damping_gives_are_said():
    """Of two tied modes one cannot be undamped with all others damped."""
    own = beams(fmax=20e3)
    asked = np.full(len(own.tied_damping[0]), 1e-4)
    asked[3] = 0.2
    with pytest.warns(DampingWarning, match=r"^damping: .* missed at .* Hz: 0\.\d+ for 0\.2"):
        damped = own.damped(asked)
    assert damped.remarks[-1].startswith("damping: ratios of tied modes are missed at ")
    assert np.all(damped.damping >= 0.0)
    assert np.all(own.damped(0.0).damping == 0.0)


def test_tied_modes_below_a_fine_mesh():
    """The suspension of a pin whose highest mode has 600 MHz, 3e7 times as much."""
    M, K = pin(80)
    own = Structure.from_matrices(M, K, normal={80: 1.0}, tangential={162: 1.0, 40: 1e-3}, load={80: -1.0})
    frequency, _ = own.damped(0.01).tied_damping
    M, K = pin(20)
    other = Structure.from_matrices(M, K, normal={20: 1.0}, tangential={42: 1.0, 10: 1e-3}, load={20: -1.0})
    np.testing.assert_allclose(frequency[:2], other.damped(0.01).tied_damping[0][:2], rtol=1e-4)


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


def pin(elements, length=0.05, diameter=0.02, springs=(20.0, 20.0)):
    """M and K of a steel pin in bending on two springs, Hz with half its mass, and of another mass at 20 Hz."""
    each, area, inertia = length / elements, np.pi * diameter**2 / 4.0, np.pi * diameter**4 / 64.0
    a, b, c, d = 6.0 * each, 4.0 * each**2, 22.0 * each, 13.0 * each
    k = np.array([[12.0, a, -12.0, a], [a, b, -a, b / 2.0], [-12.0, -a, 12.0, -a], [a, b / 2.0, -a, b]])
    m = np.array([[156.0, c, 54.0, -d], [c, b, d, -0.75 * b], [54.0, d, 156.0, -c], [-d, -0.75 * b, -c, b]])
    M, K = np.zeros((2, 2 * elements + 3, 2 * elements + 3))
    for e in range(elements):
        part = slice(2 * e, 2 * e + 4)
        K[part, part] += 2.1e11 * inertia / each**3 * k
        M[part, part] += 7800.0 * area * each / 420.0 * m
    M[-1, -1] = mass = 7800.0 * area * length
    for dof, hertz in zip((0, -3), springs, strict=True):
        K[dof, dof] += 0.5 * mass * (2.0 * np.pi * hertz) ** 2
    K[-1, -1] = mass * (2.0 * np.pi * 20.0) ** 2
    return M, K


@pytest.mark.parametrize("convert", [np.asarray, sparse.csc_array])
@pytest.mark.parametrize("elements", [4, 10, 20, 40, 80])
def test_a_soft_support_is_not_a_rigid_motion(elements, convert, monkeypatch):
    """However fine the mesh, whose highest mode has 2 to 600 MHz: a rigid bar has 20 and 34.64 Hz."""
    if convert is sparse.csc_array:
        for module in ("structure", "finite_elements"):
            monkeypatch.setattr(f"fivcore.{module}.DENSE_SIZE", 5)
    M, K = pin(elements)
    rows = {"normal": {len(M) - 3: 1.0}, "tangential": {len(M) - 1: 1.0}, "load": {len(M) - 3: -1.0}}
    found = Structure.from_matrices(convert(M), convert(K), **rows, fmax=None if elements < 5 else 10e3)
    assert found.frequency[:3] == pytest.approx([20.0, 20.0, 20.0 * np.sqrt(3.0)], abs=2e-3)
    assert not found.remarks
    # Without one spring the pin turns about the other; that is rigid, and held by the contact.
    M, K = pin(elements, springs=(20.0, 0.0))
    found = Structure.from_matrices(convert(M), convert(K), **rows, fmax=10e3)
    assert found.frequency[:2] == pytest.approx([0.0, 20.0], abs=1e-3)
    assert np.count_nonzero(found.stiffness == 0.0) == 1
    assert "count as rigid" in found.remarks[0]


@pytest.mark.parametrize("weight", [1e13, 1e20, 1e25, 1e36])
def test_held_degrees_of_freedom(weight):
    """A stiffness far above all others, as by a penalty or as 1e36 from Abaqus, is a support."""
    K = chain(12)
    rows = {"normal": {11: 1.0}, "tangential": {5: 1.0}, "load": {11: -1.0}}
    free = Structure.from_matrices(
        np.eye(11), K[1:, 1:], **{name: {dof - 1: w for dof, w in row.items()} for name, row in rows.items()}
    )
    K[0, 0] += weight
    for sparsely in (False, True):
        found = Structure.from_matrices(np.eye(12), sparse.csc_array(K) if sparsely else K, **rows)
        np.testing.assert_allclose(found.frequency[:11], free.frequency, rtol=1e-7)
        assert any("1 degrees of freedom are held" in each for each in found.remarks) == (weight > 1e22)
    # A spring between two degrees of freedom leaves nothing of the others.
    K[:2, :2] += 1e36 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    with pytest.raises(InputError, match=r"^stiffness: .* off the diagonal"):
        Structure.from_matrices(np.eye(12), K, **rows)


def chain(n, end=1.0):
    """Stiffness of springs of 1e6 N/m in a row; its last node is free."""
    return 1e6 * (np.diag([*[2.0] * (n - 1), end]) - np.eye(n, k=1) - np.eye(n, k=-1))


@pytest.mark.parametrize("n", [6, 700])
@pytest.mark.parametrize("sparsely", [False, True])
def test_messages_name_degrees_of_freedom(n, sparsely, monkeypatch):
    """A mass without some motion, though no row is zero; a part that nothing holds; a negative spring."""
    convert = sparse.csc_array if sparsely else np.asarray
    names = [f"node {1 + dof // 2}, {'xy'[dof % 2]}" for dof in range(n)]
    rows = {"normal": {n - 1: 1.0}, "tangential": {1: 1.0}, "load": {n - 1: -1.0}}
    pair, loose, weak, negative = np.eye(n), chain(n), chain(n), chain(n)
    pair[2:4, 2:4] = 1.0
    loose[2] = loose[:, 2] = 0.0
    negative[3, 3] = -1e7
    weak -= (np.linalg.eigvalsh(weak)[0] + 50.0) * np.eye(n)
    for M, K, text in (
        (pair, chain(n), "mass: .* a motion, largest at node 2, [xy], has none"),
        (np.eye(n), loose, "stiffness: 1 rigid .* one moves node 2, x most"),
        (np.eye(n), negative, "stiffness: indefinite: a motion, largest at node 2, y, has -1"),
        (np.eye(n), weak, "stiffness: indefinite: a motion, largest at node .*, [xy], has -50 1/s2"),
    ):
        with pytest.raises(InputError, match=text) as caught:
            Structure.from_matrices(convert(M), convert(K), **rows, fmax=300.0, names=names)
        assert "\n" not in str(caught.value)
    if n > 600:
        monkeypatch.setattr("fivcore.finite_elements.MEMORY", 1e-3)
        for fmax, text in (
            (0.01, "fmax = 0.01: no mode is below it; the lowest has 0.356888 Hz"),
            (1e4, "700 modes below it need 0 GB"),
        ):
            with pytest.raises(InputError, match=text):
                Structure.from_matrices(np.eye(n), chain(n), **rows, fmax=fmax)
    with pytest.raises(InputError, match="names: there are 2; it must be"):
        Structure.from_matrices(np.eye(n), chain(n), **rows, names=["a", "b"])


def test_the_digest_has_the_law_of_damping():
    """Stability with falling friction computes otherwise with it, and keeps its results by the digest."""
    own = beams(fmax=20e3)
    by_mode = replace(own, rayleigh=None)
    assert own != by_mode
    assert own == replace(own, rayleigh=(RIG.d1, RIG.d2)) == Structure.from_dict(own.to_dict())
    assert by_mode == Structure.from_dict(by_mode.to_dict())


def test_a_structure_holds_modes_and_no_matrices():
    """What is pickled, told to other processes and digested is some numbers for each mode."""
    M, K = (each.tocsc() for each in plate(40, 20, 0.2, 0.04))
    rows = {"normal": {1601: 1.0}, "tangential": {1600: 1.0}, "load": {1601: -1.0}}
    own = Structure.from_matrices(M, K, **rows, fmax=20e3)
    own.tied_damping, own.damped(0.01), own.preload, own.time_scale, own.digest
    modes = len(own.stiffness) + len(own.motion.stiffness)
    assert len(pickle.dumps(own)) < 3_000 + 8 * 10 * modes
    assert len(pickle.dumps(own)) < 0.05 * len(pickle.dumps(K))


M3, K3 = np.eye(3), np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
ROWS = {"normal": {0: 1.0}, "tangential": {1: 1.0}, "load": {0: -1.0}}
SWAPPED = np.array([[2.0, -1.0, 0.0], [0.0, 2.0, -1.0], [0.0, 0.0, 1.0]])
OUT_OF_RANGE = sparse.csr_array(K3)
OUT_OF_RANGE.indices[1] = 10**6
WRONG_MATRICES = [
    ({"mass": np.eye(2)}, "stiffness of shape (3, 3)"),
    ({"node_positions": np.zeros(3)}, "node_positions of shape (3,): it must be (k, 3) or (k, 2)"),
    ({"node_positions": np.zeros((2, 3))}, "2 nodes do not share 3 degrees of freedom; give node_rows"),
    ({"node_positions": [[np.nan, 0.0]]}, "node_positions = nan: it must be a finite number"),
    (
        {"node_positions": np.zeros((1, 3)), "node_rows": [[0, 3, 1]]},
        "node_rows = 0 to 3: each must be from -1 to 2",
    ),
    ({"node_positions": np.zeros((1, 3)), "node_rows": [[0.5, 3, 1]]}, "node_rows of shape (1, 3)"),
    ({"node_positions": np.zeros((3, 3)), "node_numbers": [1, 1, 2]}, "3 whole numbers that differ"),
    ({"mass": np.ones((2, 3))}, "mass of shape (2, 3), float64: it must be a real matrix of shape (n, n)"),
    ({"mass": np.ones(3)}, "mass of shape (3,)"),
    ({"mass": "wood"}, "mass of shape (), <U4: it must be a real matrix"),
    ({"mass": np.diag([1.0, np.nan, 1.0])}, "mass has an entry nan: all must be finite"),
    ({"mass": np.diag([1.0, 0.0, 1.0])}, "mass: it must be positive definite"),
    ({"mass": -np.eye(3)}, "mass: it must be positive definite"),
    ({"stiffness": K3 + np.diag([0.5, 0.0], 1)}, "stiffness: not symmetric"),
    ({"stiffness": SWAPPED}, "only one triangle is there"),
    ({"stiffness": sparse.csr_array(SWAPPED)}, "only one triangle is there"),
    ({"stiffness": OUT_OF_RANGE}, "must be a matrix of numbers (axis 1 index 1000000 exceeds matrix dimension 3)"),
    ({"stiffness": -K3}, "stiffness: indefinite"),
    ({"stiffness": np.full((3, 3), np.inf)}, "stiffness has an entry"),
    ({"stiffness": np.eye(4)}, "stiffness of shape (4, 4), float64: it must be a real matrix of shape (3, 3)"),
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
    ({name: [1.0] for name in OSCILLATOR} | {"frequency": [0.0]}, "the only mode is rigid"),
    ({"load": [-1e99, 0.0]}, "the normal force at rest is 1e+99 for a unit load; it must be from 1e-12 to 1e12"),
    ({"normal": [1e99, 0.0]}, "the normal force at rest is 1e-99 for a unit load; it must be"),
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


@pytest.mark.parametrize("elements", [4, 10, 20, 40])
def test_a_load_that_does_not_press_the_contact(elements):
    """Of a bar on two springs, loaded over the other one: modes and stability are right, motion is refused."""
    M, K = pin(elements)
    rows = {"normal": {len(M) - 3: 1.0}, "tangential": {len(M) - 1: 1.0}, "load": {0: -1.0}}
    own = Structure.from_matrices(M, K, **rows)
    assert own.frequency[:2] == pytest.approx([20.0, 20.0], abs=1e-3)
    assert any(remark.startswith("load: it does not press") for remark in own.remarks)
    # The closed contact holds one end of the bar, which has a third of its mass about it, on half of the springs.
    assert sliding_modes(own, 0.0, 0.3, 100.0).frequency == pytest.approx([20.0, 20.0 * np.sqrt(1.5)], abs=1e-2)
    assert "preload" in own._repr_html_()
    with pytest.raises(
        InputError, match=r"^load: it does not press the contact at rest, .*; change where it acts$"
    ):
        simulate(Scene(1e-3, 0.0, 0.3, 9.0, own), 0.01)


ONE = Structure.from_modes([100.0], [1.0], [0.5], load=[-1.0])
TWO = Structure.from_modes([0.0, 100.0], [1.0, 0.3], [0.2, 1.0], load=[-1.0, 0.0])
PARALLEL = Structure.from_modes([100.0, 300.0, 700.0], [1.0, 0.5, 0.3], [2.0, 1.0, 0.6], load=[-1.0, -0.2, 0.0])


@pytest.mark.parametrize("method", ["fast", "exact"])
@pytest.mark.parametrize("friction", [Friction(), Friction(0.5, 0.02)])
@pytest.mark.parametrize("structure", [ONE, PARALLEL])
def test_a_contact_that_cannot_slip_is_refused(structure, friction, method):
    for cutoff in (None, 1e5):
        with pytest.raises(InputError, match=r"^normal, tangential: they are parallel") as caught:
            simulate(Scene(1e-3, 0.0, 0.3, 9.0, structure, friction), 0.01, method, cutoff=cutoff)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("method", ["fast", "exact"])
def test_cut_offs_of_two_modes(method):
    """Above both the structure is complete; below one it is not enough."""
    scene = Scene(1e-3, 0.0, 0.3, 9.0, TWO)
    whole, cut = (simulate(scene, 0.01, method, cutoff=cutoff, record=True) for cutoff in (None, 1e5))
    assert np.array_equal(whole.tangential_force, cut.tangential_force)
    with pytest.raises(InputError, match=r"^cutoff = 50: it must be above 100 Hz, so that two modes are kept"):
        simulate(scene, 0.01, method, cutoff=50.0)


def test_theta_belongs_to_the_modes():
    with pytest.raises(
        ValueError, match="theta = 5: the modes of a Structure have its inclination already; give 0"
    ):
        Scene(1e-3, 5.0, 0.2, 9.0, Structure.from_modes(**OSCILLATOR))
    with pytest.raises(ValueError, match="it must be a Rig or a Structure"):
        Scene(1e-3, 5.0, 0.2, 9.0, "rig")
