"""No mode is missed: equal parts, rings, membranes and nearly equal modes of finite elements; by closed forms."""

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import splu

from fivcore import Structure

RANDOM = 200


def chain(n, ends=2.0):
    """Springs in a row, fixed at both ends or, with `ends` of 1, free."""
    return sparse.diags_array(
        [-np.ones(n - 1), [ends, *2.0 * np.ones(n - 2), ends], -np.ones(n - 1)], offsets=(-1, 0, 1)
    )


def ring(n):
    return chain(n) - sparse.coo_array(([1.0, 1.0], ([0, n - 1], [n - 1, 0])), shape=(n, n))


def ring_squares(n):
    return 4.0 * np.sin(np.pi * np.arange(n) / n) ** 2


def chain_squares(n):
    return 4.0 * np.sin(0.5 * np.pi * np.arange(1, n + 1) / (n + 1)) ** 2


def parts(rng):
    """2 to 700 chains that are equal, or that differ by a relative 1e-12 to 1e-6; some are weakly coupled."""
    count = int(2.0 * 350.0 ** rng.random())
    each = max(2, int(rng.uniform(601, 1800) / count))
    factors = np.ones(count) + rng.choice([0.0, 1e-12, 1e-9, 1e-6]) * rng.random(count)
    if rng.random() < 0.5:
        return sparse.kron(sparse.diags_array(factors), chain(each)), np.outer(
            factors, chain_squares(each)
        ).ravel()
    # The same parts, each held to the next by springs between all their nodes.
    spring = rng.choice([1e-12, 1e-9, 1e-6])
    held = sparse.kron(spring * chain(count, 1.0), sparse.eye_array(each))
    link = spring * 4.0 * np.sin(0.5 * np.pi * np.arange(count) / count) ** 2
    squares = np.add.outer(link, chain_squares(each)).ravel()
    return sparse.kron(sparse.eye_array(count), chain(each)) + held, squares


def rings(rng):
    count, each = int(rng.integers(1, 40)), int(rng.integers(40, 100))
    each = max(each, 620 // count)
    soil = 10.0 ** rng.uniform(-6.0, -2.0)
    one = ring(each) + soil * sparse.eye_array(each)
    return sparse.kron(sparse.eye_array(count), one), np.tile(ring_squares(each) + soil, count)


def membrane(rng):
    """Square, so that modes come in pairs; fixed at its edges, or closed to a torus on a soft ground."""
    n = int(rng.integers(25, 45))
    if rng.random() < 0.5:
        one, squares = chain(n), chain_squares(n)
    else:
        one, squares = ring(n) + 1e-5 * sparse.eye_array(n), ring_squares(n) + 1e-5
    eye = sparse.eye_array(n)
    return sparse.kron(one, eye) + sparse.kron(eye, one), np.add.outer(squares, squares).ravel()


def springs(rng):
    """Masses on springs of their own: few stiffnesses, or all different."""
    n = int(rng.integers(601, 1500))
    squares = rng.choice([1.0, 1.0 + 1e-12, 2.0, 3.0], n) if rng.random() < 0.5 else rng.uniform(1.0, 4.0, n)
    return sparse.diags_array(squares), squares


def model(seed):
    """A stiffness, the squares of its modes, and a band with a share of them, or all."""
    rng = np.random.default_rng(seed)
    K, squares = (parts, parts, rings, membrane, springs)[seed % 5](rng)
    # The matrix itself must not tell which nodes are equal; a gap in the squares is where the band ends.
    turn = rng.permutation(K.shape[0])
    squares = np.sort(squares)
    gaps = np.append(np.flatnonzero(np.diff(squares) > 1e-4 * squares[1:]), len(squares) - 1)
    wanted = len(squares) * rng.choice([0.01, 0.1, 0.5, 1.0], p=[0.4, 0.4, 0.1, 0.1])
    count = 1 + int(gaps[np.abs(gaps + 1 - wanted).argmin()])
    above = squares[count] if count < len(squares) else 2.0 * squares[-1]
    limit = np.sqrt(squares[count - 1] * above)
    return sparse.csc_array(K.tocsr()[turn][:, turn]), squares[:count], limit, rng


def check(seed):
    K, squares, limit, rng = model(seed)
    n, mass, unit = K.shape[0], 10.0 ** rng.uniform(-3.0, 3.0), 10.0 ** rng.uniform(0.0, 6.0)
    normal, tangential = rng.normal(size=(2, n))
    hertz = np.sqrt(unit) / (2.0 * np.pi)
    M = sparse.eye_array(n, format="csc") * mass
    own = Structure.from_matrices(
        M, K * (mass * unit), normal=normal, tangential=tangential, load=-normal, fmax=hertz * np.sqrt(limit)
    )
    assert len(own.frequency) == len(squares), seed
    np.testing.assert_allclose(own.frequency, hertz * np.sqrt(squares), rtol=1e-9, err_msg=str(seed))
    # The compliance of all modes below the band is that of the model only if their shapes are right, too.
    flexible = normal @ splu(K).solve(np.stack([normal, tangential], axis=1)) / (mass * unit)
    np.testing.assert_allclose(
        [each.real for each in own.receptances(0.0)], flexible, rtol=1e-6, err_msg=str(seed)
    )
    assert own.preload == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(0, RANDOM, 15))
def test_all_modes_below_the_band(seed):
    check(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [seed for seed in range(RANDOM) if seed % 15])
def test_all_modes_below_the_band_of_many_models(seed):
    check(seed)
