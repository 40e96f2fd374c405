"""The problem of a step with several contacts, and the friction at which its forces are no longer unique.

Each contact is open, sticks, or slips forwards or backwards, and each set of statuses selects rows of one matrix.
The forces are unique if the determinants of all these selections are positive (coherent orientation; Scholtes,
Introduction to Piecewise Differentiable Equations, 2012, section 2.3). As mu grows, one of them is first zero.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from fivcore.beams.modes import one_blas_thread
from fivcore.contact.law import DiscreteContact
from fivcore.jit import Array

# Local compliance, or inverse mass, of each of several contacts, in units of the mean.
LOCAL = 1e-10
# Largest number of contacts for which all sets of statuses are examined; starts of the search beyond it.
ALL, STARTS = 4, 4


def with_local(matrix: Array) -> Array:
    """Add a small local term of each contact to a symmetric matrix, so that coincident contacts share a force."""
    return np.asarray(matrix + LOCAL * np.trace(matrix) / len(matrix) * np.eye(len(matrix)))


def step_matrices(contact: DiscreteContact) -> tuple[Array, Array]:
    """Q = S + a M for each previous status, (3, 2c, 2c), and a, (3,), s; M and 1 in rigid contact."""
    S, M = contact.flexibility, contact.delassus
    if not S.any():
        return np.tile(with_local(M), (3, 1, 1)), np.ones(3)
    times = contact.tau + np.array([0.5 * contact.step, 0.0, contact.mean_time])
    matrix = S + times[:, None, None] * M
    # Normal rows are those of stick for every previous status.
    matrix[:, : len(M) // 2] = matrix[1, : len(M) // 2]
    return matrix, times


@lru_cache(maxsize=64)
def unique_up_to(model: Any, step: float) -> float:
    """Smallest coefficient of friction at which the forces of a step, s, of a `ReducedModel` are not unique.

    Up to ALL contacts all sets of statuses are examined; with more, the result is the smallest that a search
    finds.
    """
    matrices = step_matrices(model.discrete(step))[0][[1, 2]]
    return min(_least_friction(matrix / np.trace(matrix), np.asarray(model.friction)) for matrix in matrices)


@one_blas_thread()
def _least_friction(matrix: Array, factors: Array) -> float:
    c, known = len(factors), dict[tuple[int, ...], float]()

    def at(statuses: Sequence[int]) -> float:
        """Critical friction of one set of statuses: 0 open, 1 stick, 2 and 3 slip."""
        key = tuple(statuses)
        if key not in known:
            known[key] = _critical(matrix, factors, np.array(key))
        return known[key]

    if c <= ALL:
        return min(at(each) for each in itertools.product(range(4), repeat=c))
    rng, best = np.random.default_rng(0), np.inf
    for start in range(STARTS):
        now = [2 + start] * c if start < 2 else rng.integers(2, 4, c).tolist()
        here = at(now)
        while (step := min((at(each), each) for each in _neighbours(now)))[0] < here:
            here, now = step
        best = min(best, here)
    return best


def _neighbours(now: list[int]) -> Iterator[list[int]]:
    """Sets of statuses that differ in one contact."""
    for i, status in itertools.product(range(len(now)), range(4)):
        if status != now[i]:
            yield [*now[:i], status, *now[i + 1 :]]


def _critical(matrix: Array, factors: Array, status: Array) -> float:
    """Smallest friction at which the determinant of a set of statuses vanishes."""
    c, way = len(factors), np.select([status == 2, status == 3], [1.0, -1.0])
    if not way.any():
        return float("inf")
    rows = np.flatnonzero(np.append(status > 0, status == 1))
    # Columns of N include T = mu * way * factor * N.
    change = np.zeros((2 * c, 2 * c))
    change[:, :c] = matrix[:, c:] * (way * factors)
    values = np.linalg.eigvals(-np.linalg.solve(matrix[np.ix_(rows, rows)], change[np.ix_(rows, rows)]))
    real = values.real[np.abs(values.imag) <= 1e-9 * np.abs(values)]
    return float(1.0 / real.max()) if real.size and real.max() > 1e-9 else float("inf")
