"""Adaptive importance sampling of a posterior whose prior is a standard normal distribution.

Population Monte Carlo (Cappé et al., J. Comput. Graph. Stat. 13, 2004, 907-929): each round draws from a mixture
of normal kernels about the weighted draws of all rounds before. Weights have the mixture of all rounds' proposals
as denominator (Cornuet et al., Scand. J. Stat. 39, 2012, 798-812), so that no round is lost, and a share of each
proposal is the prior (Hesterberg, Technometrics 37, 1995, 185-194), so that they are bounded.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.distance import cdist
from scipy.special import logsumexp, ndtri, softmax

from sweeps import unit_draws

Array = NDArray[Any]

PRIOR_SHARE = 0.1
# About a least-squares solution: shares of normal distributions with its covariance, and with so many times that.
AROUND_BEST = {1.0: 0.6, 9.0: 0.3}
# While fewer draws count than this share of a round, their likelihoods are flattened for the next proposal.
LEAST_COUNTING = 0.1
# Step of difference quotients, in standard deviations of the prior.
STEP = 1e-3
# Relative change of the sum of squares at which a solution is close enough to draw about it.
CLOSE = 1e-4
# Misfit of a draw without a value, in standard deviations.
NO_VALUE = 1e4
# Entries of a table of distances.
MOST_ENTRIES = 4_000_000


@dataclass(frozen=True, eq=False)
class Part:
    """Normal distributions with a common covariance, as a part of a proposal.

    `share` is their weight in the proposal, `centres` (k, d) have `weights` (k,), whose sum is 1, and `factor` (d,
    d) is the lower Cholesky factor of the covariance.
    """

    share: float
    centres: Array
    weights: Array
    factor: Array

    def log_density(self, z: Array) -> Array:
        """Logarithm of the density at points (n, d), multiplied by the share."""
        white = [each @ np.linalg.inv(self.factor).T for each in (z, self.centres)]
        blocks = np.array_split(white[0], len(z) * len(self.centres) // MOST_ENTRIES + 1)
        distances = (cdist(block, white[1], "sqeuclidean") for block in blocks)
        sums = [logsumexp(np.log(self.weights) - 0.5 * each, axis=1) for each in distances]
        scale = np.log(np.diag(self.factor)).sum() + 0.5 * z.shape[1] * np.log(2.0 * np.pi)
        return np.asarray(np.concatenate(sums) - scale + np.log(self.share))


Proposal = Sequence[Part]


def prior(dimensions: int, share: float = 1.0) -> Part:
    """The standard normal distribution as part of a proposal."""
    return Part(share, np.zeros((1, dimensions)), np.ones(1), np.eye(dimensions))


def around(best: Array, covariance: Array) -> Proposal:
    """The proposal around a least-squares solution.

    It is rounded to digits that all processors share, so that the same fit continues on another one.
    """
    factor = np.linalg.cholesky(covariance)
    size = 10.0 ** np.floor(np.log10(np.linalg.norm(factor, axis=1)) - 3.0)
    factor = np.rint(factor / size[:, None]) * size[:, None]
    factor[np.diag_indices_from(factor)] = np.maximum(np.diag(factor), size)
    centre = (np.rint(best / size) * size)[None]
    shares = AROUND_BEST.items()
    return prior(len(best), PRIOR_SHARE), *(Part(s, centre, np.ones(1), np.sqrt(k) * factor) for k, s in shares)


def draws(proposal: Proposal, count: int, seed: int) -> Array:
    """Draws (count, d) by scrambled Sobol points, whose first dimension chooses the normal distribution."""
    d = proposal[0].centres.shape[1]
    chance, *unit = unit_draws(d + 1, count, "sobol", seed).T
    levels = np.cumsum(np.concatenate([part.share * part.weights for part in proposal]))
    chosen = np.minimum(np.searchsorted(levels, chance * levels[-1]), len(levels) - 1)
    centres = np.concatenate([part.centres for part in proposal])[chosen]
    factors = np.repeat(np.stack([part.factor for part in proposal]), [len(p.weights) for p in proposal], axis=0)
    return np.asarray(centres + np.einsum("nij,nj->ni", factors[chosen], ndtri(np.stack(unit, axis=1))))


def log_weights(z: Array, log_likelihood: Array, proposals: Sequence[Proposal]) -> Array:
    """Logarithms of prior x likelihood / mixture of the rounds' proposals, at points (n, d)."""
    parts = [part.log_density(z) for proposal in proposals for part in proposal]
    mixture = np.logaddexp.reduce(parts, axis=0) - np.log(len(proposals))
    return np.asarray(prior(z.shape[1]).log_density(z) + log_likelihood - mixture)


def normalised(logarithms: Array) -> Array:
    """Weights with the sum 1; zeros if none is positive."""
    return np.asarray(softmax(logarithms) if np.isfinite(logarithms.max()) else np.zeros(len(logarithms)))


def effective_size(weights: Array) -> float:
    """Kish's effective number of draws."""
    return float(weights.sum() ** 2 / max((weights**2).sum(), 1e-300))


def next_proposal(z: Array, log_likelihood: Array, proposals: Sequence[Proposal], samples: int) -> Proposal:
    """The prior, and normal kernels around the weighted draws with Silverman's bandwidth."""
    n, d = z.shape
    base, least = log_weights(z, np.zeros(n), proposals), max(LEAST_COUNTING * samples, 2.0 * d)
    possible = np.isfinite(log_likelihood)
    if not possible.any():
        return (prior(d),)

    def flattened(power: float) -> Array:
        return normalised(np.where(possible, base + power * np.where(possible, log_likelihood, 0.0), -np.inf))

    low, high = 0.0, 1.0
    if effective_size(weights := flattened(1.0)) < least:
        for _ in range(40):
            power = 0.5 * (low + high)
            low, high = (power, high) if effective_size(flattened(power)) >= least else (low, power)
        weights = flattened(low)
    count = effective_size(weights)
    width = (4.0 / ((d + 2.0) * count)) ** (1.0 / (d + 4.0))
    spread = np.cov(z, rowvar=False, aweights=weights).reshape(d, d) if count > d + 1.0 else np.eye(d)
    kept = weights > 0.0
    factor = width * np.linalg.cholesky(spread + 1e-12 * np.eye(d))
    return prior(d, PRIOR_SHARE), Part(1.0 - PRIOR_SHARE, z[kept], weights[kept], factor)


def replay(start: Proposal, log_likelihood: Array, samples: int, seed: int) -> tuple[Array, Array]:
    """Weights (n,) of the draws of the first rounds, and all draws (n + samples, d) up to the next round's.

    `start` is the first round's proposal; `log_likelihood` (n,) has `samples` draws of each round, -inf where
    there is no value. Each round has a seed of its own.
    """
    proposals, z, rounds = [start], draws(start, samples, seed), len(log_likelihood) // samples
    for k in range(1, rounds + 1):
        proposals.append(next_proposal(z, log_likelihood[: k * samples], proposals, samples))
        z = np.concatenate([z, draws(proposals[-1], samples, seed + k)])
    known = z[: rounds * samples]
    return normalised(log_weights(known, log_likelihood, proposals[:-1])) if rounds else np.zeros(0), z


def best(misfits: Callable[[Array], Array], dimensions: int) -> tuple[Array, Array] | None:
    """Least squares from the prior's median, the prior among the residuals; the solution and its covariance.

    `misfits(z)` returns, for points (n, d), residuals in standard deviations, (n, m). None if the median has no
    value.
    """
    steps = STEP * np.concatenate([np.zeros((1, dimensions)), np.eye(dimensions), -np.eye(dimensions)])

    def residuals(z: Array) -> Array:
        found = misfits(z[None])[0]
        return np.concatenate([np.where(np.isfinite(found), found, NO_VALUE), z])

    def slopes(z: Array) -> Array:
        # From one side where the other has no value, as beyond the end of a beam.
        at, *moved = misfits(z + steps)
        sides = np.split((np.stack(moved) - at) / STEP * np.repeat([[1.0], [-1.0]], dimensions, axis=0), 2)
        known = np.isfinite(sides).astype(float)
        mean = np.nan_to_num(sides).sum(axis=0) / np.maximum(known.sum(axis=0), 1.0)
        return np.concatenate([mean.T, np.eye(dimensions)])

    if not np.all(np.isfinite(misfits(np.zeros((1, dimensions))))):
        return None
    found = least_squares(residuals, np.zeros(dimensions), slopes, x_scale=1.0, ftol=CLOSE)
    return found.x, np.linalg.inv(found.jac.T @ found.jac)
