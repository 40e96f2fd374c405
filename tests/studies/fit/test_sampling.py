"""Importance sampling in rounds, against posteriors in closed form."""

import numpy as np
import pytest
from scipy import stats

from studies.fitting import sampling

SAMPLES, ROUNDS = 256, 4
# Two measurements of three unknowns, whose prior is a standard normal distribution: one direction stays unknown.
A = np.array([[3.0, 1.0, 0.0], [20.0, -5.0, 0.0]])
MEASURED = np.array([4.0, 15.0])
EXACT_COVARIANCE = np.linalg.inv(A.T @ A + np.eye(3))
EXACT_MEAN = EXACT_COVARIANCE @ A.T @ MEASURED


def linear(z):
    return z @ A.T - MEASURED


def rounds(start, log_likelihood, count=ROUNDS, seed=0):
    """Weights and draws after so many rounds."""
    known = np.zeros(0)
    for _ in range(count):
        known = log_likelihood(sampling.replay(start, known, SAMPLES, seed)[1])
    weights, z = sampling.replay(start, known, SAMPLES, seed)
    return weights, z[: len(weights)], known


def normal_errors(z):
    return -0.5 * (linear(z) ** 2).sum(axis=1)


@pytest.mark.parametrize("by_squares", [True, False])
def test_a_linear_model_has_its_normal_posterior(by_squares):
    """Five standard errors; the prior alone is 20 times as wide as the posterior, and finds it all the same."""
    best = sampling.best(linear, 3)
    np.testing.assert_allclose(best[0], EXACT_MEAN, atol=1e-6)
    np.testing.assert_allclose(best[1], EXACT_COVARIANCE, atol=1e-6)
    start = sampling.around(*best) if by_squares else (sampling.prior(3),)
    weights, z, _ = rounds(start, normal_errors)
    count = sampling.effective_size(weights)
    assert count > (0.5 if by_squares else 0.2) * len(z)
    spread = np.sqrt(np.diag(EXACT_COVARIANCE))
    assert np.all(np.abs(weights @ z - EXACT_MEAN) < 5.0 * spread / np.sqrt(count))
    found = np.cov(z, rowvar=False, aweights=weights)
    assert np.abs(found - EXACT_COVARIANCE).max() < 5.0 * np.sqrt(2.0 / count) * EXACT_COVARIANCE.max()


def test_least_squares_at_the_edge_of_what_can_be_has_its_slope_from_within():
    """Beyond z = 0 there is no value, the best one is there, and its slope is 2."""
    best, covariance = sampling.best(lambda z: np.where(z <= 0.0, 2.0 * z - 0.001, np.nan), 1)
    assert best == pytest.approx([0.0], abs=0.01)
    assert covariance == pytest.approx(np.array([[0.2]]), rel=1e-6)


def test_weights_have_the_evidence_as_their_mean():
    start = sampling.around(*sampling.best(linear, 3))
    _, z, known = rounds(start, normal_errors, 1)
    ratios = np.exp(sampling.log_weights(z, known, [start]))
    scale = 2.0 * np.pi  # of a density of two measurements
    exact = scale * stats.multivariate_normal(np.zeros(2), A @ A.T + np.eye(2)).pdf(MEASURED)
    assert ratios.mean() == pytest.approx(exact, rel=0.15)


def test_both_of_two_separate_solutions_are_kept():
    weights, z, _ = rounds((sampling.prior(1),), lambda z: -0.5 * ((z[:, 0] ** 2 - 1.0) / 0.1) ** 2)
    error = 0.5 / np.sqrt(sampling.effective_size(weights))
    assert error < 0.05
    assert abs(weights[z[:, 0] > 0.0].sum() - 0.5) < 4.0 * error


def test_a_longer_fit_begins_with_the_draws_of_a_shorter_one():
    start = (sampling.prior(3),)
    short, long = (rounds(start, normal_errors, count)[1] for count in (2, 3))
    np.testing.assert_array_equal(long[: len(short)], short)
    assert not np.array_equal(rounds(start, normal_errors, 1, seed=1)[1], short[:SAMPLES])


def test_without_any_value_the_prior_is_drawn_again():
    weights, z, _ = rounds((sampling.prior(2),), lambda z: np.full(len(z), -np.inf), 2)
    assert not weights.any()
    assert np.abs(z.mean(axis=0)).max() < 0.1
    assert sampling.best(lambda z: np.full((len(z), 1), np.nan), 2) is None
