"""Modes of assembled models: a disc brake of 4669 degrees of freedom, closed forms, and random sparse systems."""

import time

import numpy as np
import pytest
from scipy import io, linalg, sparse
from scipy.sparse.linalg import eigs

from fivcore.errors import InputError
from fivcore.stability import assembled
from fivcore.stability.assembled import assembled_modes, assembled_onsets
from studies.plotting.modes import modes_figure
from tests import HOME

# The disc brake and its two unstable modes: shared/data/README.md.
FOLDER = HOME.parent / "shared" / "data" / "brake_m0"
BAND, W = 20e3 / (2.0 * np.pi), 4.0 * np.pi
# Sinou and Jezequel, Eur. J. Mech. A 26 (2007) 106-122, after Hulten: 100 and 75 Hz.
W1, W2 = 200.0 * np.pi, 150.0 * np.pi
HULTEN = np.diag([W1**2, W2**2]), [[0.0, -(W2**2)], [W1**2, 0.0]]
# Hoffmann, Fischer, Allgaier, Gaul, Mech. Res. Comm. 29 (2002) 197-205.
HOFFMANN = [[2.0, 1.0], [1.0, 2.0]], [[0.0, -4.0 / 3.0], [0.0, 0.0]]


@pytest.fixture(scope="module")
def brake():
    """M and KR, and C and K without KR as functions of the speed."""
    if not FOLDER.is_dir():
        pytest.skip(f"no {FOLDER}")

    def read(name):
        file = io.loadmat(FOLDER / f"B{name}LL00.mat")
        return sparse.csr_array(file[next(key for key in file if not key.startswith("__"))])

    m, d1, dg, dr, d4, k1, kr, kgeo = map(read, ("M", "D", "Y", "DIW", "H", "K", "KQ", "W"))
    constant = d1 - dr + d4 / (3200.0 * np.pi)
    return m, kr, lambda w: constant + w * dg + dr / w, lambda w: k1 + (w**2 - 1.0) * kgeo


def nearest(mass, damping, stiffness, shift, count):
    """Eigenvalues by SciPy alone, which factorises the whole linearisation."""
    one, unit = sparse.eye_array(mass.shape[0]), abs(shift)
    a = sparse.block_array([[None, unit * one], [-stiffness / unit, -damping]], format="csc", dtype=complex)
    b = sparse.block_diag([one, mass], format="csc", dtype=complex)
    return eigs(a, count, b, shift, return_eigenvectors=False, tol=1e-12)


def assert_within(known, modes, row, error, whole=False):
    """Each of the known eigenvalues in the region is among the modes, and if they are all, no other."""
    top, lam = 2.0 * np.pi * BAND, modes.growth_rate[row] + 2j * np.pi * modes.frequency[row]
    known = known[(known.imag >= 0.0) & (known.imag <= top) & (np.abs(known.real) <= 0.5 * top)]
    lam = lam[np.isfinite(lam)]
    assert np.abs(np.subtract.outer(known, lam)).min(axis=1).max() < error
    assert len(known) == len(lam) or not whole


def test_disc_brake(brake):
    mass, friction, damping, stiffness = brake
    modes = assembled_modes(mass, damping(W), stiffness(W), friction_stiffness=friction, fmax=BAND)
    growing, neutral = modes.growth_rate > 0.0, modes.growth_rate == 0.0
    np.testing.assert_allclose(modes.growth_rate[growing], [5.4742, 74.8306], atol=1e-3)
    np.testing.assert_allclose(modes.frequency[growing], [784.9902, 2769.2304], atol=1e-3)
    np.testing.assert_allclose(modes.frequency[neutral], [816.561], atol=1e-3)
    assert modes.residual.max() < 1e-8
    assert modes.growth_error.max() < 1e-3


@pytest.mark.slow
def test_the_figure_of_the_disc_brake_names_what_grows(brake):
    mass, friction, damping, stiffness = brake
    matrices = mass, damping(W), stiffness(W)
    modes = assembled_modes(*matrices, friction_stiffness=friction, mu=[0.0, 0.5, 1.0], fmax=BAND)
    assert [text.get_text() for text in modes_figure(modes).axes[1].texts] == ["2769 Hz", "785 Hz"]


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.3, 1.4])
def test_disc_brake_at_other_speeds(brake, scale):
    mass, friction, damping, stiffness = brake
    speeds = [1.0, np.pi, 30.0, 100.0]
    modes = assembled_modes(mass, damping, lambda w: stiffness(w) + scale * friction, mu=speeds, fmax=BAND)
    for row, w in enumerate(speeds):
        for shift in (100.0 + 3e3j, 100.0 + 17e3j):
            known = nearest(mass, damping(w), stiffness(w) + scale * friction, shift, 8)
            assert_within(known, modes, row, 1e-3)


@pytest.mark.slow
def test_onsets_of_the_disc_brake(brake):
    mass, friction, damping, stiffness = brake
    onsets = assembled_onsets(mass, damping(W), stiffness(W), friction, BAND)
    for mu, frequency in zip(*onsets, strict=True):
        at, rates = 2j * np.pi * frequency, []
        for factor in (0.999, 1.0, 1.001):
            known = nearest(mass, damping(W), stiffness(W) + factor * mu * friction, at + 1.0, 4)
            rates.append(known[np.argmin(np.abs(known - at))].real)
        assert rates[0] < 0.0 < rates[2]
        assert abs(rates[1]) < 1e-4 * rates[2]
    scales = np.linspace(0.0, 1.0, 200)
    start = time.process_time()
    modes = assembled_modes(mass, damping(W), stiffness(W), friction_stiffness=friction, mu=scales, fmax=BAND)
    assert time.process_time() - start < 60.0
    assert np.nanmax(modes.residual) < 1e-8
    np.testing.assert_array_equal((modes.growth_rate > 0.0).sum(axis=1), np.searchsorted(onsets[0], scales))


def test_flutter_of_two_degrees_of_freedom():
    onsets = assembled_onsets(np.eye(2), None, *HOFFMANN)
    np.testing.assert_allclose(onsets, [[0.75], [np.sqrt(0.5) / np.pi]], atol=1e-9)
    modes = assembled_modes(np.eye(2), None, HOFFMANN[0], friction_stiffness=HOFFMANN[1], mu=[[0.7, 1.0]])
    np.testing.assert_allclose(modes.growth_rate, [[[0.0, 0.0], [-0.2020717688, 0.2020717688]]], atol=1e-9)
    same = assembled_modes(np.eye(2), None, lambda mu: np.add(HOFFMANN[0], np.multiply(mu, HOFFMANN[1])))
    np.testing.assert_array_equal(same.growth_rate, modes.growth_rate[0, 1])


@pytest.mark.parametrize(
    ("damping", "onset"),
    [
        ((0.0, 0.0), 7.0 / 24.0),
        ((0.02, 0.02), 0.2893671255),
        ((0.02, 0.06), 0.2717900338),
        ((0.06, 0.02), 0.2355513626),
        ((0.02, 0.002), 0.1487132720),
    ],
)
def test_damping_moves_the_onset(damping, onset):
    mu, frequency = assembled_onsets(np.eye(2), np.diag(damping) * [W1, W2], *HULTEN)
    np.testing.assert_allclose(mu, [onset], atol=1e-9)
    assert any(damping) or abs(frequency[0] - 88.388348) < 1e-6


def test_divergence_is_an_onset_at_zero_frequency():
    np.testing.assert_allclose(assembled_onsets([[1.0]], [[0.1]], [[0.4]], [[-1.0]]), [[0.4], [0.0]], atol=1e-9)


def chain(size, masses):
    """M, C, K and Kf of a chain with random couplings, damping, gyroscopic and circulatory parts."""
    random, scatter, ones = np.random.default_rng(1), {"density": 4.0 / size, "format": "csr"}, np.ones(size)
    a, b, g, f = (sparse.random_array((size, size), rng=random, **scatter) for _ in range(4))
    springs = sparse.diags_array([2.0 * ones, -ones[1:], -ones[1:]], offsets=[0, 1, -1])
    stiffness = 2e8 * (springs + 0.05 * (b @ b.T))
    damping = 1e-7 * stiffness + 0.5 * (a @ a.T) + 30.0 * (g - g.T)
    return sparse.diags_array(masses * random.uniform(0.05, 0.15, size)), damping, stiffness, 3e6 * (f - f.T)


@pytest.mark.parametrize(("copies", "massless"), [(1, False), (2, False), (1, True)])
def test_all_modes_of_a_random_system(copies, massless, monkeypatch):
    monkeypatch.setattr(assembled, "UNPROJECTED", 50)
    matrices = chain(200 // copies, np.arange(200 // copies) % 7 > 0 if massless else 1.0)
    mass, damping, stiffness, friction = (sparse.block_diag([each] * copies) for each in matrices)
    one, unit = np.eye(200), 2.0 * np.pi * BAND
    modes = assembled_modes(
        mass, damping, stiffness, friction_stiffness=friction, mu=[0.6, 0.6004, 0.6007, 0.601], fmax=BAND
    )
    # The full problem is solved at the other three.
    whole = (stiffness + 0.6004 * friction).toarray()
    a = np.block([[0.0 * one, unit * one], [-whole / unit, -damping.toarray()]])
    known = linalg.eigvals(a, linalg.block_diag(one, mass.toarray()))
    assert_within(known, modes, 1, 1e-8 * unit, whole=True)


PARTS = [(2, 40, 0.6, 0.0), (20, 12, 0.6, 0.0), (20, 12, 0.6, 1e-12), (40, 6, 0.8, 0.0), (40, 6, 0.8, 1e-7)]
PARTS += [(60, 5, 0.6, 1e-9), (100, 4, 1.0, 0.0), (40, 6, 3.0, 0.0), (150, 1, 2.0, 0.0)]


@pytest.mark.parametrize(("copies", "each", "band", "apart"), PARTS)
def test_all_modes_of_equal_and_nearly_equal_parts(copies, each, band, apart, monkeypatch):
    """In any order of rows; some bands have a few modes of each part, some have all."""
    monkeypatch.setattr(assembled, "UNPROJECTED", 50)
    rng = np.random.default_rng(0)
    skew, turn = rng.normal(size=(2, each, each))
    K = 2.0 * np.eye(each) - np.eye(each, k=1) - np.eye(each, k=-1) + 0.02 * np.diag(rng.random(each))
    C, Kf = 1e-3 * K + 1e-3 * (turn - turn.T), 0.05 * (skew - skew.T)
    M, order = np.diag(1.0 + 0.3 * rng.random(each)), rng.permutation(copies * each)
    factors = sparse.diags_array(1.0 + apart * rng.random(copies))
    whole = [sparse.kron(factors if part is K else np.eye(copies), part).tocsr() for part in (M, C, K, Kf)]
    whole = [matrix[order][:, order] for matrix in whole]
    modes = assembled_modes(*whole[:3], friction_stiffness=whole[3], mu=[0.6, 0.601], fmax=band / (2.0 * np.pi))
    for row, mu in enumerate(modes.mu):
        lower = -np.linalg.solve(M, np.hstack([K + mu * Kf, C]))
        known = linalg.eigvals(np.vstack([np.eye(each, 2 * each, each), lower]))
        known = known[(known.imag >= 0.0) & (known.imag <= band) & (np.abs(known.real) <= 0.5 * band)]
        found = modes.growth_rate[row] + 2j * np.pi * modes.frequency[row]
        found = found[np.isfinite(found)]
        assert len(found) == copies * len(known) > 0
        nearest = np.abs(np.subtract.outer(known, found)).argmin(axis=0)
        assert np.all(np.bincount(nearest) == copies)
        assert np.abs(found - known[nearest]).max() < 1e-6 * band


def test_where_most_modes_are_in_the_region_they_are_found_densely():
    """The sleepers of NLEVP (Betcke et al., ACM Trans. Math. Software 39, 2013): circulant, so in closed form."""
    n, top = 230, np.pi
    A = np.roll(np.eye(n), 1, axis=0) + np.roll(np.eye(n), -1, axis=0) - 2.0 * np.eye(n)
    modes = assembled_modes(np.eye(n), np.eye(n) + A @ A, np.eye(n) + A + A @ A, fmax=0.5)
    a = 2.0 * np.cos(2.0 * np.pi * np.arange(n) / n) - 2.0
    known = np.concatenate([np.roots([1.0, 1.0 + each**2, 1.0 + each + each**2]) for each in a])
    known = known[(known.imag >= 0.0) & (np.abs(known.real) <= 0.5 * top)]
    found = modes.growth_rate + 2j * np.pi * modes.frequency
    assert len(found) == len(known)
    assert np.abs(np.subtract.outer(known, found)).min(axis=1).max() < 1e-7


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"mass": np.ones((2, 3))}, "mass of shape (2, 3), float64: it must be a real matrix of shape (n, n)"),
        ({"mass": [[1.0, 0.5], [0.0, 1.0]]}, "mass differs from its transpose by 0.5: it must be symmetric"),
        ({"damping": sparse.eye_array(3)}, "damping of shape (3, 3), float64: it must be a real matrix of"),
        ({"stiffness": [[np.nan, 0.0], [0.0, 1.0]]}, "stiffness has an entry nan: all must be finite"),
        ({"stiffness": 1j * np.eye(2)}, "stiffness of shape (2, 2), complex128"),
        ({"friction_stiffness": lambda mu: [[mu]]}, "friction_stiffness of shape (1, 1)"),
        ({"mass": np.diag([1.0, 0.0]), "stiffness": np.diag([1.0, 0.0])}, "every degree of freedom needs mass"),
        ({"fmax": 0.0}, "fmax = 0.0: it must be a number from"),
        ({"mu": [0.1, np.inf]}, "mu = inf: it must be a finite number"),
    ],
)
def test_wrong_input_is_named(wrong, message):
    with pytest.raises(InputError) as caught:
        assembled_modes(**{"mass": np.eye(2), "damping": None, "stiffness": np.eye(2)} | wrong)
    assert message in str(caught.value)


@pytest.mark.parametrize("rate", [1.5e-5, 1e-3])
def test_a_mode_that_grows_already_when_it_enters_the_band_is_no_onset(rate):
    """Damping below zero, and a stiffness that friction reduces."""
    top = 2.0 * np.pi
    onsets = assembled_onsets([[1.0]], [[-2.0 * rate * top]], [[1.2 * top**2]], [[-0.4 * top**2]], fmax=1.0)
    assert np.shape(onsets) == (2, 0)


def test_an_arnoldi_method_may_restart_many_times():
    """Modes of a chain next to each other, in closed form, of which a few restarts find none."""
    size, shift = 300, 1j
    one, K = (
        sparse.eye_array(size, format="csr"),
        sparse.diags_array([2.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(size, size)),
    )
    known = 2j * np.sin(0.5 * np.pi * np.arange(1, size + 1) / (size + 1))
    found = assembled._eigenvalues_near(one, 0.0 * one, K.tocsr(), shift, 0.05, 30)[0]
    known = known[np.abs(known - shift) < 0.05]
    np.testing.assert_allclose(np.sort(found.imag), known.imag, rtol=1e-9)
