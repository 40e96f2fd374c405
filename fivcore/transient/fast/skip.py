"""Skip the quiet part of a stick phase, whose motion is known in closed form.

While the contact sticks and the clamp moves at constant speed, a step of `transient.fast.kernel` is an affine map
of x = (q, v), x' = M x + b + c k in step k, and M is independent of mu, V and F. The solution x is linear in k
plus a sum of eigenvectors of M, each multiplied by its eigenvalue z per step. The outputs N, velocity of B, T and
closing of the gap at any later step follow directly.

A skip evaluates the outputs at the sampling times. Between two samples, m steps apart, an output deviates from
linear interpolation by at most the sum over all eigenvectors of |amplitude| min(2, |m log z|^2 / 8). If N, mu N -
|T| and the closing exceed that bound, no step in between can end stick.

The energy dissipated by damping and dashpot in a step is a quadratic form of the amplitudes. Its sum over a skip
is a geometric series in products of two eigenvalues, so the energy balance remains independent of the skip.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fivcore.beams.modes import one_blas_thread
from fivcore.contact.reduced import ReducedModel
from fivcore.contact.step_map import eigenvectors, step_map
from fivcore.jit import Array, called, reordered_call
from fivcore.transient.fast import layout
from fivcore.transient.fast.onset import BEFORE_SLIP, MOTION
from fivcore.transient.fast.solver import places_of
from fivcore.transient.statistics import STICK

# Largest error of the eigenvectors; smallest |z|, which divides outputs of the previous step.
ACCURATE, LEAST_EIGENVALUE = 1e-10, 1e-3
# Eigenvalues and modes are padded to a multiple of this, which fills vector registers; padding has zero amplitude.
EIGHT = 8
# Samples that are evaluated together.
ROUND = 64
# The outputs N, velocity of B, T and closing.
OUTPUTS = 4


class SkipTables(NamedTuple):
    """Matrices of a skip for one model, step and sampling interval, and work vectors.

    There are c eigenvalues, one of each conjugate pair, and m places for modes, both padded. Of c complex numbers
    the real parts are stored first, then the imaginary parts, which are negated in factors of amplitudes.
    """

    # For each eigenvalue: outputs (4, 2 c); penetration and u_T one step earlier (2, 2 c); sums of N and T over
    # all later steps and the loss by products with each of (p, u, 1, V), (6, 2 c); log z, (2 c,).
    outputs: Array
    earlier: Array
    sums: Array
    logarithm: Array
    # Bounds of N, T and the closing, (6, c): deviation from interpolation between samples; deviation at any time.
    moduli: Array
    # Powers of z at ROUND samples, (ROUND, 2 c).
    powers: Array
    # Loss over all later steps as a quadratic form of the amplitudes, (2 c, 2 c).
    form: Array
    # The rest of the motion is linear in (p, u, 1, V), where p and u are penetration and u_T with the modes at
    # rest. Columns: initial value of the linear part for each of the four, and its slope for unit V. Rows: the
    # outputs, penetration and u_T, (6, 5); and the loss per step as a quadratic form of the four, (4, 5).
    affine: Array
    losses: Array
    # Amplitudes of the eigenvectors in x, (2 c, 2 m), and the x of amplitudes, (2 m, 2 c).
    into: Array
    back: Array
    # The linear part of x, (2 m, 5), and the gaps of x with their rates, (4, 2 m).
    drift: Array
    shapes: Array
    # Index of each mode's displacement in the flat array of all blocks, (n,).
    numbers: NDArray[np.int64]


# Tables of a run without skips.
_EMPTY: dict[str, Any] = {name: np.zeros((0, 0)) for name in SkipTables._fields}
NO_TABLES = SkipTables(**_EMPTY | {"logarithm": np.zeros(0), "numbers": np.zeros(0, dtype=np.int64)})


@lru_cache(maxsize=64)
@one_blas_thread()
def skip_tables(model: ReducedModel, step: float, sample_every: int) -> SkipTables:
    """Tables of a skip, `sample_every` steps between samples; NO_TABLES where stick has no decaying eigenvectors.

    They are independent of mu, V and F. There are none for rigid contact, where the end of stick does not follow
    from the forces alone.
    """
    if not model.K.any():
        return NO_TABLES
    contact, gaps, size = model.discrete(step), model.shapes, len(model.normal)
    stick, dissipation, mobility = step_map(model, step), model.dissipation(contact), contact.delassus
    try:
        z, vectors, into, error = eigenvectors(stick)
        # Response of x to a constant force, and its lag under a force that grows linearly.
        still = np.eye(2 * size) - stick.matrix
        steady = np.linalg.solve(still, stick.impulse)
        behind = np.linalg.solve(still, steady)
        dashpot = np.linalg.cholesky(dissipation).T if dissipation.any() else np.zeros((2, 2))
    except np.linalg.LinAlgError:
        return NO_TABLES
    if not error < ACCURATE or not np.abs(z).max() < 1.0 or not np.abs(z).min() > LEAST_EIGENVALUE:
        return NO_TABLES
    # One of each conjugate pair, counted twice; padding has no amplitude.
    kept = np.flatnonzero(z.imag >= 0.0)
    empty = ((0, -len(kept) % EIGHT), (0, 0))
    into = np.pad(into[kept], empty)
    vectors = np.pad((vectors * np.where(z.imag > 0.0, 2.0, 1.0))[:, kept], empty[::-1])
    z = np.append(z[kept], np.full(empty[0][1], 0.5))
    count = len(z)
    # Inputs of the contact law with the modes at rest for (p, u, 1, V), and what a unit of V adds in a step.
    inputs = np.zeros((4, 5))
    inputs[0, 0] = inputs[1, 1] = 1.0
    inputs[2:, 2], inputs[3, 3], inputs[1, 4] = -mobility[:, 0], -1.0, step
    force = stick.law @ inputs
    force[0, 2] -= 1.0
    line = steady @ force
    line[:, 3] -= behind @ force[:, 4]
    # Columns from here on: eigenvectors, (p, u, 1, V), growth.
    x = np.hstack([vectors, line])
    seen = stick.seen @ x
    seen[:, count:] += inputs
    earlier = np.hstack([seen[:2, :count] / z, seen[:2, count:]])
    earlier[:, -2] -= seen[:2, -1]
    N, T = force = stick.law @ seen
    net = force.copy()
    net[0, count + 2] -= 1.0
    B = model.output @ (x[size:] + 0.5 * step * gaps.T @ net)
    outputs = np.stack([N, B, T, seen[0] - contact.slip.decay * earlier[0]])
    # Rates in the middle of the impulse, weighted so that their sum of squares is the loss of a step.
    rates = np.sqrt(step) * np.vstack([
        np.sqrt(model.damping)[:, None] * (x[size:] + 0.5 * step * gaps.T @ net),
        dashpot @ (seen[2:] + mobility @ force),
    ])  # fmt: skip
    by_vectors, by_line = rates[:, :count], rates[:, count:-1].real
    both = 2.0 * (by_line.T @ by_vectors) / (1.0 - z)
    lost = np.pad(by_line.T @ by_line, ((0, 0), (0, 1)))
    affine = np.vstack([outputs[:, count:], seen[:2, count:]]).real
    outputs = outputs[:, :count]
    sums = force[:, :count] / (1.0 - z)

    def rows_of(values: Any) -> Array:
        return np.hstack([values.real, -values.imag])

    def over_modes(rows: Any) -> Array:
        wide = np.zeros((len(rows), 2, -(-size // EIGHT) * EIGHT))
        wide[:, :, :size] = rows.reshape(len(rows), 2, size)
        return wide.reshape(len(rows), -1)

    plain = by_vectors.T @ by_vectors / (1.0 - np.outer(z, z))
    mixed = by_vectors.conj().T @ by_vectors / (1.0 - np.outer(z.conj(), z))
    form = 0.5 * np.block([
        [plain.real + mixed.real, -plain.imag - mixed.imag],
        [-plain.imag + mixed.imag, mixed.real - plain.real],
    ])  # fmt: skip
    bend = np.minimum(2.0, 0.125 * np.abs(sample_every * np.log(z)) ** 2)
    moduli = np.abs(outputs[[0, 2, 3]])
    powers = np.tile(z**sample_every, (ROUND, 1))
    powers[0] = 1.0
    # Conjugate: amplitudes are real and imaginary parts, what they are multiplied with has the latter negative.
    way_in, way_back = rows_of(into.conj().T).T, rows_of(vectors).T
    block, place = np.divmod(places_of(model)[0], layout.BLOCK)
    tables = SkipTables(
        outputs=rows_of(outputs),
        earlier=rows_of(earlier[:, :count]),
        sums=rows_of(np.vstack([sums, both])),
        logarithm=np.append(np.log(z).real, -np.log(z).imag),
        moduli=np.vstack([bend * moduli, moduli]),
        powers=rows_of(np.cumprod(powers, axis=0)),
        form=form,
        affine=affine,
        losses=lost,
        into=over_modes(way_in),
        back=over_modes(way_back).T,
        drift=over_modes(line.T).T,
        shapes=over_modes(np.kron(np.eye(2), gaps)),
        numbers=layout.Q * layout.BLOCK + block * layout.BLOCK_SIZE + place,
    )
    whole: Any = (np.ascontiguousarray(table) for table in tables)
    return SkipTables(*whole)


def prepare(run: Any) -> SkipTables:
    """Allow skips in the next segment if the run uses its own model and the drive is at constant speed."""
    record, tables = run.record, NO_TABLES
    moves = run.phase in (BEFORE_SLIP, MOTION) and run.now * run.step >= run.ramp
    if moves and run.options.skip_sticks:
        tables = skip_tables(run.solver.model, run.solver.step, int(record["sample_every"][0]))
    record["may_skip"] = tables is not NO_TABLES
    if tables is NO_TABLES:
        record["next_skip"] = layout.NEVER
    elif record["contact"] == STICK:
        # At the next sample at the earliest.
        due = int(record["next_skip"][0])
        record["next_skip"] = max(due if due < layout.NEVER else 0, int(record["next_sample"][0]))
    return tables


def workspace_for(tables: SkipTables) -> tuple[Array, ...]:
    """Vectors for a skip with these tables."""
    count, size = len(tables.logarithm), len(tables.drift)
    return (*map(np.zeros, (size, count, count, count, count, count + 6, 5, 6, 6)), np.zeros((OUTPUTS, ROUND)))


@reordered_call
def multiply(matrix: Any, vector: Any, out: Any, more: float = 0.0) -> None:
    """Write the product of a matrix and a vector, plus `more` times the old content of `out`."""
    for i in range(len(matrix)):
        total = more * out[i] if more != 0.0 else 0.0
        for j in range(matrix.shape[1]):
            total += matrix[i, j] * vector[j]
        out[i] = total


@reordered_call
def rotate(factors: Any, vector: Any, out: Any) -> None:
    """Write the product of complex amplitudes and factors; imaginary parts of factors are stored negative."""
    count = len(vector) // 2
    for k in range(count):
        a, b = factors[k], -factors[count + k]
        re, im = vector[k], vector[count + k]
        out[k], out[count + k] = a * re - b * im, a * im + b * re


@called
def skip(scene: Any, modes: Any, samples: Any, rows: Any, tables: Any, work: Any) -> None:
    """Advance a scene to the last sample before which stick cannot have ended, if there is one.

    The scene is a record of `layout.SCENE`; `modes`, `samples` and `rows` are those of
    `transient.fast.kernel.advance`, `tables` are `SkipTables`, and `work` is a workspace of `workspace_for`.
    """
    every, now = scene.sample_every, scene.now
    # No skip crosses a multiple of this, where segments begin and end, so the motion is independent of segments.
    most = layout.MAX_SKIP * every
    last = min((now // most + 1) * most, scene.last)
    if scene.settle > now:
        last = min(last, scene.settle)
    scene.next_skip = now + 2 * layout.MIN_SAMPLES * every
    if now + every > last:
        return
    outputs, moduli, powers, affine = tables.outputs, tables.moduli, tables.powers, tables.affine
    x, y, initial, other, sums, result, weights, starts, slopes, sampled = work
    twice, half = len(y), len(x) // 2
    step, speed = scene.step, scene.speed
    # The wait for the first slip ends at a share of mu N.
    mu = min(scene.threshold, scene.mu)
    weights[:] = 0.0
    weights[4] = speed
    multiply(affine, weights, slopes)
    weights[0], weights[2], weights[3], weights[4] = scene.p_rest, 1.0, speed, 0.0
    weights[1] = scene.anchor - scene.T_rest + speed * ((now + 0.5) * step - 0.5 * scene.ramp)
    multiply(affine, weights, starts)
    # x without its linear part, and the amplitudes of its eigenvectors.
    multiply(tables.drift, weights, x)
    for j in range(len(tables.numbers)):
        k = tables.numbers[j]
        x[j] = modes[k] - x[j]
        x[half + j] = modes[k + (layout.V - layout.Q) * layout.BLOCK] - x[half + j]
    multiply(tables.into, x, initial)
    rotate(powers[0], initial, y)
    goal, far, largest, total = now, ROUND - 1, 0.0, 0.0
    while far == ROUND - 1:
        # Amplitudes only decay, so a bound at this sample holds at all later ones.
        for k in range(twice // 2):
            other[k] = np.sqrt(y[k] ** 2 + y[twice // 2 + k] ** 2)
        multiply(moduli, other, result)
        off_N, off_F, off_C = result[0], mu * result[0] + result[1], result[2]
        all_N, all_F, all_C = result[3], mu * result[3] + result[4], result[5]
        # If the linear parts stay away from the limits by more than all amplitudes, T and closing are not needed.
        certain = True
        for past in (goal - now, goal - now + (ROUND - 1) * every):
            N, T, C = starts[0] + slopes[0] * past, starts[2] + slopes[2] * past, starts[3] + slopes[3] * past
            certain = certain and all_N < N and all_F < mu * N - abs(T) and all_C < C
        for r in range(2 if certain else 4):
            for m in range(ROUND):
                sampled[r, m] = starts[r] + slopes[r] * (goal - now + m * every)
            rotate(outputs[r], y, other)
            multiply(powers, other, sampled[r], 1.0)
        far = -1
        for m in range(min(ROUND, (last - goal) // every + 1)):
            N, T, C = sampled[0, m], sampled[2, m], sampled[3, m]
            if not certain and not (off_N < N and off_F < mu * N - abs(T) and off_C < C):
                break
            far += 1
        if far <= 0:
            break
        for m in range(far):
            N, place = sampled[0, m], scene.samples + m
            samples[place, 0], samples[place, 1], samples[place, 2] = sampled[1, m], 0.0, N
            # The integral of N up to here by the rectangle rule; at the end of the skip it is exact.
            taken = step * ((goal - now) + m * every + 1)
            samples[place, 3], samples[place, 4] = scene.stick_time + taken, scene.separation_time
            samples[place, 5], samples[place, 6] = scene.sum_N + step * total, scene.switches
            total += every * N
            largest = max(largest, N)
        scene.samples += far
        goal += far * every
        rotate(powers[far], y, y)
    if goal == now:
        return
    steps = float(goal - now)
    # Integrals of N and T over the steps of the skip, and what damping and dashpot lose.
    for j in range(twice):
        sums[j] = initial[j] + y[j]
        other[j] = initial[j] - y[j]
    multiply(tables.form, other, result)
    lost = 0.0
    for j in range(twice):
        lost += result[j] * sums[j]
    multiply(tables.losses, weights, result)
    multiply(tables.sums, other, sums)
    for i in range(4):
        lost += weights[i] * (sums[2 + i] + steps * result[i])
    pairs = 0.5 * steps * (steps - 1.0)
    scene.damped += lost
    scene.sum_N += step * (sums[0] + starts[0] * steps + slopes[0] * pairs)
    scene.work += speed * step * (sums[1] + starts[2] * steps + slopes[2] * pairs)
    scene.stick_time += step * steps
    scene.max_N = max(scene.max_N, largest)
    # State after the last step.
    multiply(tables.earlier, y, result)
    scene.u_N = result[0] + starts[4] + slopes[4] * (steps - 1.0)
    scene.u_T = result[1] + starts[5] + slopes[5] * (steps - 1.0)
    weights[4] = speed * steps
    multiply(tables.drift, weights, x)
    multiply(tables.back, y, x, 1.0)
    for j in range(len(tables.numbers)):
        k = tables.numbers[j]
        modes[k], modes[k + (layout.V - layout.Q) * layout.BLOCK] = x[j], x[half + j]
    multiply(tables.shapes, x, result)
    scene.g_N, scene.g_T, scene.v_N, scene.v_T = result[0], result[1], result[2], result[3]
    # Rows of the record.
    while scene.next_row < goal:
        past = float(scene.next_row - now)
        for k in range(twice // 2):
            angle = tables.logarithm[twice // 2 + k] * past
            factor = np.exp(tables.logarithm[k] * past)
            other[k], other[twice // 2 + k] = factor * np.cos(angle), factor * np.sin(angle)
        rotate(other, initial, y)
        multiply(outputs, y, result)
        for r in range(OUTPUTS):
            result[r] += starts[r] + slopes[r] * past
        place = scene.rows
        rows[place, 0], rows[place, 1] = (scene.next_row + 0.5) * step, result[1]
        rows[place, 2], rows[place, 3] = result[0], result[2]
        rows[place, 4], rows[place, 5] = 0.0, STICK
        scene.rows += 1
        scene.next_row += scene.row_every
    scene.now = scene.next_sample = scene.next_energy = scene.next_skip = goal
    # Continue at once where a segment may end, so that the motion does not depend on whether it ends.
    if goal % most != 0:
        scene.next_skip += layout.MIN_SAMPLES * every
