"""Skip the quiet part of a stick, whose motion is known in closed form.

While the contact sticks and the clamp moves at constant speed, a step of `transient.fast_kernel` is an affine map
of x = (q, v), the same whatever mu, V and F: x' = M x + b + c k in the k-th step, because the clamp loads the
contact evenly. So x is a line in k plus a sum of the eigenvectors of M, each multiplied by its eigenvalue z in a
step. The outputs N, velocity of B, T and closing of the gap follow at any later step.

A skip evaluates the outputs where samples are due. Between two samples, m steps apart, no output is off the
straight line between them by more than the sum over all eigenvectors of |amplitude| min(2, |m log z|^2 / 8). Where
N, mu N - |T| and the closing stay above that bound, no step in between can end stick.

Damping and the dashpot lose a quadratic form of the amplitudes in each step. Geometric series in the products of
two eigenvalues sum it over a skip, so the energy balance does not enter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from fivcore.beams.modes import one_blas_thread
from fivcore.contact.law import status_maps
from fivcore.contact.reduced import ReducedModel
from fivcore.contact.step_map import eigenvectors, step_map
from fivcore.jit import Array, kernel, reordered_call
from fivcore.transient import fast_scene as at
from fivcore.transient.statistics import STICK

# Largest error of the eigenvectors, and smallest |z|, by which outputs of the step before are divided.
ACCURATE, LEAST = 1e-10, 1e-3
# Eigenvalues come in so many; empty places have zero amplitude.
EIGHT = 8


def _sizes(*numbers: int) -> Any:
    """Sizes of matrices: as plain numbers they would each make another version of a compiled function."""
    return tuple(np.int64(number) for number in numbers)


# Samples that are evaluated together.
(ROUND,) = _sizes(64)
# The outputs N, velocity of B, T and closing. Bounds of N, T and the closing: off a straight line between two
# samples, and off the line at any time.
OUTPUTS, MODULI, ONE = _sizes(4, 6, 1)
# Rows over the eigenvalues: the outputs; penetration and u_T one step earlier; what N and T sum up to over all
# steps to come and the loss together with each of (p, u, 1, V); log z.
EARLIER, SUMS, LOGARITHM, VALUE_ROWS = _sizes(4, 6, 12, 13)
# Beside the eigenvectors all is linear in (p, u, 1, V), where p and u are penetration and u_T with the modes at
# rest. Columns: the line's start for each of the four, its slope for a unit of V. Rows: the outputs, penetration
# and u_T; and the loss in a step as a quadratic form of the four.
COLUMNS, AFFINE, LOSSES = _sizes(5, 6, 4)
# Vectors of the workspace; behind them are the outputs at ROUND samples.
X, Y, INITIAL, OTHER, WEIGHTS, STARTS, SLOPES, RESULT, VECTORS = range(9)


@dataclass(frozen=True, eq=False)
class SkipTables:
    """Tables of a skip for one model, step and interval between samples."""

    # Number c of eigenvalues, one of each conjugate pair, and m of places for modes; both with empty places.
    count: int
    size: int
    # c and 2 m, then the matrices of `skip_tables`, row by row.
    packed: Array


@lru_cache(maxsize=64)
@one_blas_thread()
def skip_tables(model: ReducedModel, step: float, sample_every: int) -> SkipTables | None:
    """Tables of a skip, samples being `sample_every` steps apart; None where stick has no decaying eigenvectors.

    They are the same whatever mu, V and F. In rigid contact there are none: forces alone do not tell stick and
    its end apart.
    """
    if not model.K.any():
        return None
    impulse = model.impulse(step)
    stick, gaps, size = step_map(model, impulse, step), model.shapes, len(model.rest)
    dissipation = model.dissipation(impulse)
    separation = status_maps(impulse.stiffness, impulse.damping, impulse.delassus, 0.0, step).separation
    try:
        z, vectors, into, error = eigenvectors(stick)
        still = np.linalg.inv(np.eye(2 * size) - stick.matrix)
        dashpot = np.linalg.cholesky(dissipation).T if dissipation.any() else np.zeros((2, 2))
    except np.linalg.LinAlgError:
        return None
    if not error < ACCURATE or not np.abs(z).max() < 1.0 or not np.abs(z).min() > LEAST:
        return None
    # One of each conjugate pair, counted twice.
    kept = z.imag >= 0.0
    z, vectors, into = z[kept], vectors[:, kept] * np.where(z.imag[kept] > 0.0, 2.0, 1.0), into[kept]
    count, mobility = len(z), impulse.delassus
    # Inputs of the contact law with the modes at rest for (p, u, 1, V), and what a unit of V adds in a step.
    inputs = np.zeros((4, COLUMNS))
    inputs[0, 0] = inputs[1, 1] = 1.0
    inputs[2:, 2], inputs[3, 3], inputs[1, 4] = -mobility[:, 0], -1.0, step
    force = stick.law @ inputs
    force[0, 2] -= 1.0
    # What a steady force makes of x, and what one that grows by as much in each step leaves behind.
    steady = still @ stick.impulse
    line = steady @ force
    line[:, 3] -= still @ line[:, 4]
    # Columns from here on: eigenvectors, (p, u, 1, V), growth.
    x = np.hstack([vectors, line])
    seen = stick.seen @ x
    seen[:, count:] += inputs
    earlier = np.hstack([seen[:2, :count] / z, seen[:2, count:]])
    earlier[:, -2] -= seen[:2, -1]
    N, T = force = stick.law @ seen
    net = force.copy()
    net[0, count + 2] -= 1.0
    B = model.point_b @ (x[size:] + 0.5 * step * gaps.T @ net)
    outputs = np.stack([N, B, T, seen[0] - separation[0] @ earlier])
    # Rates in the middle of the impulse, weighted so that the sum of their squares is what a step loses.
    rates = np.sqrt(step) * np.vstack([
        np.sqrt(model.damping)[:, None] * (x[size:] + 0.5 * step * gaps.T @ net),
        dashpot @ (seen[2:] + mobility @ force),
    ])  # fmt: skip
    by_vectors, by_line = rates[:, :count], rates[:, count:-1].real
    both = 2.0 * (by_line.T @ by_vectors) / (1.0 - z)
    lost = np.pad(by_line.T @ by_line, ((0, 0), (0, 1)))
    affine = np.vstack([outputs[:, count:], seen[:2, count:], lost]).real
    outputs = outputs[:, :count]
    sums = force[:, :count] / (1.0 - z)
    # Empty places among the eigenvalues, and among the modes as the blocks have them.
    empty, places = -count % EIGHT, -(-size // EIGHT) * EIGHT

    def rows_of(values: Any) -> Array:
        wide = np.pad(values, ((0, 0), (0, empty)))
        return np.hstack([wide.real, -wide.imag])

    def over_modes(rows: Any) -> Array:
        wide = np.zeros((len(rows), 2, places))
        wide[:, :, :size] = rows.reshape(len(rows), 2, size)
        return wide.reshape(len(rows), -1)

    plain, mixed = (
        np.pad(left @ by_vectors / (1.0 - np.outer(powers, z)), (0, empty))
        for left, powers in ((by_vectors.T, z), (by_vectors.conj().T, z.conj()))
    )
    form = 0.5 * np.block([
        [plain.real + mixed.real, -plain.imag - mixed.imag],
        [-plain.imag + mixed.imag, mixed.real - plain.real],
    ])  # fmt: skip
    bend = np.minimum(2.0, 0.125 * np.abs(sample_every * np.log(z)) ** 2)
    moduli = np.abs(outputs[[0, 2, 3]])
    moduli = np.pad(np.vstack([bend * moduli, moduli]), ((0, 0), (0, empty)))
    values = rows_of(np.vstack([outputs, earlier[:, :count], sums, both, np.log(z)]))
    powers = np.cumprod(np.vstack([np.ones_like(z), *[z**sample_every] * (ROUND - 1)]), axis=0)
    # Conjugate: amplitudes are real and imaginary parts, what they are multiplied with has the latter negative.
    way_in, way_back = rows_of(into.conj().T).T, rows_of(vectors).T
    matrices = (
        values,  # (VALUE_ROWS, 2 c)
        moduli,  # (MODULI, c)
        rows_of(powers).T,  # (2 c, ROUND)
        form,  # (2 c, 2 c)
        affine,  # (AFFINE + LOSSES, COLUMNS)
        over_modes(way_in),  # (2 c, 2 m)
        over_modes(way_back),  # (2 c, 2 m)
        over_modes(line.T).T,  # (2 m, COLUMNS)
        over_modes(np.kron(np.eye(2), gaps)),  # (OUTPUTS, 2 m)
    )
    parts = [np.array([count + empty, 2.0 * places]), *(each.ravel() for each in matrices)]
    return SkipTables(count + empty, places, np.concatenate(parts))


def workspace_for(tables: list[SkipTables]) -> Array:
    """Space for any of these."""
    widest = max([int(ROUND), *(2 * max(part.count, part.size) for part in tables)])
    return np.zeros(VECTORS * widest + OUTPUTS * ROUND)


@reordered_call
def multiply(tables: Any, first: Any, rows: Any, width: Any, work: Any, vector: Any, out: Any) -> None:
    """Write the product of a matrix and a vector of the workspace to the workspace."""
    # Unsigned numbers are no candidates for an index from the end.
    for i in range(rows):
        total, row, column = 0.0, np.uint64(first + i * width), np.uint64(vector)
        for j in range(np.uint64(width)):
            total += tables[row + j] * work[column + j]
        work[out + i] = total


@reordered_call
def combine(tables: Any, first: Any, rows: Any, width: Any, work: Any, weights: Any, out: Any) -> None:
    """Add the weighted sum of the rows of a matrix, a multiple of four, to a vector of the workspace."""
    target = np.uint64(out)
    for i in range(0, rows, 4):
        a, b, c, d = work[weights + i], work[weights + i + 1], work[weights + i + 2], work[weights + i + 3]
        row = first + i * width
        one, two, three, four = (
            np.uint64(row),
            np.uint64(row + width),
            np.uint64(row + 2 * width),
            np.uint64(row + 3 * width),
        )
        for j in range(np.uint64(width)):
            more = a * tables[one + j] + b * tables[two + j] + c * tables[three + j] + d * tables[four + j]
            work[target + j] += more


@reordered_call
def rotate(factors: Any, first: Any, stride: Any, work: Any, vector: Any, out: Any, count: Any) -> None:
    """Write the product of complex amplitudes and factors; imaginary parts of factors are stored negative."""
    for k in range(count):
        a, b = factors[first + k * stride], -factors[first + (count + k) * stride]
        re, im = work[vector + k], work[vector + count + k]
        work[out + k], work[out + count + k] = a * re - b * im, a * im + b * re


@kernel
def skip(scene: Any, modes: Any, samples: Any, rows: Any, tables: Any, work: Any) -> None:
    """Take a scene from a sample to the last one before which stick cannot have ended, if that is farther.

    The scene is a record of `fast_scene.SCENE`; `modes`, `samples` and `rows` are those of
    `transient.fast_kernel.advance`, `tables` those of all scenes in a row, of which a scene says where its own
    begin, and `work` is a workspace of `workspace_for`.
    """
    every, now = scene.sample_every, scene.now
    # No skip crosses a multiple of this, where segments begin and end: the motion is independent of them.
    most = at.MAX_SKIP * every
    last = min((now // most + 1) * most, scene.last)
    if scene.settle > now:
        last = min(last, scene.settle)
    scene.next_skip = now + 2 * at.MIN_SAMPLES * every
    if now + every > last:
        return
    # Where the matrices begin, and the vectors of the workspace.
    values = scene.skip_at + 2
    count, size = int(tables[values - 2]), int(tables[values - 1])
    twice, half = 2 * count, size // 2
    moduli = values + VALUE_ROWS * twice
    powers = moduli + MODULI * count
    form = powers + ROUND * twice
    affine = form + twice * twice
    into = affine + (AFFINE + LOSSES) * COLUMNS
    back = into + twice * size
    drift = back + twice * size
    shapes = drift + COLUMNS * size
    wide = (len(work) - OUTPUTS * ROUND) // VECTORS
    x, y, initial, other, weights = X * wide, Y * wide, INITIAL * wide, OTHER * wide, WEIGHTS * wide
    starts, slopes, result, sampled = STARTS * wide, SLOPES * wide, RESULT * wide, VECTORS * wide
    step, speed = scene.step, scene.speed
    # A first slip that is waited for comes with a share of mu N.
    mu = min(scene.threshold, scene.mu)
    for i in range(COLUMNS):
        work[weights + i] = 0.0
    work[weights + 4] = speed
    multiply(tables, affine, AFFINE, COLUMNS, work, weights, slopes)
    work[weights], work[weights + 2], work[weights + 3], work[weights + 4] = scene.p_rest, 1.0, speed, 0.0
    work[weights + 1] = scene.anchor - scene.T_rest + speed * ((now + 0.5) * step - 0.5 * scene.ramp)
    multiply(tables, affine, AFFINE, COLUMNS, work, weights, starts)
    # x less its line, and the amplitudes of the eigenvectors in it.
    multiply(tables, drift, size, COLUMNS, work, weights, x)
    for j in range(half):
        k = scene.modes_at + j // at.BLOCK * at.BLOCK_SIZE + j % at.BLOCK
        work[x + j] = modes[k + at.Q * at.BLOCK] - work[x + j]
        work[x + half + j] = modes[k + at.V * at.BLOCK] - work[x + half + j]
    multiply(tables, into, twice, size, work, x, initial)
    rotate(tables, powers, ROUND, work, initial, y, count)
    goal, far, largest, total = now, ROUND - 1, 0.0, 0.0
    while far == ROUND - 1:
        # Amplitudes only shrink: what bounds them here does so at all samples to come.
        for k in range(count):
            work[other + k] = np.sqrt(work[y + k] ** 2 + work[y + count + k] ** 2)
        multiply(tables, moduli, MODULI, count, work, other, result)
        off_N, off_F, off_C = work[result], mu * work[result] + work[result + 1], work[result + 2]
        all_N, all_F, all_C = work[result + 3], mu * work[result + 3] + work[result + 4], work[result + 5]
        # Where the lines stay away from the limits by more than all amplitudes, T and closing are not needed.
        certain = True
        for past in (goal - now, goal - now + (ROUND - 1) * every):
            N, T = work[starts] + work[slopes] * past, work[starts + 2] + work[slopes + 2] * past
            C = work[starts + 3] + work[slopes + 3] * past
            certain = certain and all_N < N and all_F < mu * N - abs(T) and all_C < C
        for r in range(2 if certain else 4):
            row = sampled + r * ROUND
            for m in range(ROUND):
                work[row + m] = work[starts + r] + work[slopes + r] * (goal - now + m * every)
            rotate(tables, values + r * twice, ONE, work, y, other, count)
            combine(tables, powers, twice, ROUND, work, other, row)
        far = -1
        for m in range(sampled, sampled + min(ROUND, (last - goal) // every + 1)):
            N, T, C = work[m], work[m + 2 * ROUND], work[m + 3 * ROUND]
            if not certain and not (off_N < N and off_F < mu * N - abs(T) and off_C < C):
                break
            far += 1
        if far <= 0:
            break
        for m in range(far):
            N, place = work[sampled + m], scene.samples_at + scene.samples + m
            samples[place, 0], samples[place, 1], samples[place, 2] = work[sampled + ROUND + m], 0.0, N
            # The integral of N up to here by the rectangle rule; at the end of the skip it is exact.
            taken = step * ((goal - now) + m * every + 1)
            samples[place, 3], samples[place, 4] = scene.stick_time + taken, scene.separation_time
            samples[place, 5], samples[place, 6] = scene.sum_N + step * total, scene.switches
            total += every * N
            largest = max(largest, N)
        scene.samples += far
        goal += far * every
        rotate(tables, powers + far, ROUND, work, y, y, count)
    if goal == now:
        return
    steps = float(goal - now)
    # Integrals of N and T over the steps of the skip, and what damping and dashpot lose.
    for j in range(twice):
        work[x + j] = work[initial + j] + work[y + j]
        work[other + j] = work[initial + j] - work[y + j]
    multiply(tables, form, twice, twice, work, other, result)
    multiply(work, result, ONE, twice, work, x, sampled)
    lost = work[sampled]
    multiply(tables, affine + AFFINE * COLUMNS, LOSSES, COLUMNS, work, weights, result)
    multiply(tables, values + SUMS * twice, LOGARITHM - SUMS, twice, work, other, x)
    for i in range(LOSSES):
        lost += work[weights + i] * (work[x + 2 + i] + steps * work[result + i])
    pairs = 0.5 * steps * (steps - 1.0)
    scene.damped += lost
    scene.sum_N += step * (work[x] + work[starts] * steps + work[slopes] * pairs)
    scene.work += speed * step * (work[x + 1] + work[starts + 2] * steps + work[slopes + 2] * pairs)
    scene.stick_time += step * steps
    scene.max_N = max(scene.max_N, largest)
    # State after the last step.
    multiply(tables, values + EARLIER * twice, SUMS - EARLIER, twice, work, y, result)
    scene.u_N = work[result] + work[starts + 4] + work[slopes + 4] * (steps - 1.0)
    scene.u_T = work[result + 1] + work[starts + 5] + work[slopes + 5] * (steps - 1.0)
    work[weights + 4] = speed * steps
    multiply(tables, drift, size, COLUMNS, work, weights, x)
    combine(tables, back, twice, size, work, y, x)
    for j in range(half):
        k = scene.modes_at + j // at.BLOCK * at.BLOCK_SIZE + j % at.BLOCK
        modes[k + at.Q * at.BLOCK], modes[k + at.V * at.BLOCK] = work[x + j], work[x + half + j]
    multiply(tables, shapes, OUTPUTS, size, work, x, result)
    scene.g_N, scene.g_T = work[result], work[result + 1]
    scene.v_N, scene.v_T = work[result + 2], work[result + 3]
    # Rows of the record.
    log = values + LOGARITHM * twice
    while scene.next_row < goal:
        past = float(scene.next_row - now)
        for k in range(count):
            factor, angle = np.exp(tables[log + k] * past), tables[log + count + k] * past
            work[other + k], work[other + count + k] = factor * np.cos(angle), factor * np.sin(angle)
        rotate(work, other, ONE, work, initial, y, count)
        multiply(tables, values, OUTPUTS, twice, work, y, result)
        for r in range(OUTPUTS):
            work[result + r] += work[starts + r] + work[slopes + r] * past
        place = scene.rows_at + scene.rows
        rows[place, 0], rows[place, 1] = (scene.next_row + 0.5) * step, work[result + 1]
        rows[place, 2], rows[place, 3] = work[result], work[result + 2]
        rows[place, 4], rows[place, 5] = 0.0, STICK
        scene.rows += 1
        scene.next_row += scene.row_every
    scene.now = scene.next_sample = scene.next_skip = goal
    # Go on at once where a segment may end, so that it changes nothing whether it does.
    if goal % most != 0:
        scene.next_skip += at.MIN_SAMPLES * every
