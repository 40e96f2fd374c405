"""Skipping the quiet part of a stick, whose motion is known in closed form.

While the contact sticks and the clamp moves at constant speed, a step of `transient.fast_kernel` is an affine map
of x = (q, v), the same whatever mu, V and F: x' = M x + b + c k in the k-th step, for the clamp loads the contact
evenly. So x is a line in k plus a sum of the eigenvectors of M, each of which turns and shrinks by its eigenvalue
z in a step. Everything that the step decides by is then known at any later step: N, T, and the gap that the
element leaves open.

A skip looks at these readings where samples are due. Between two samples, m steps apart, no reading can be off the
straight line between them by more than the sum over all eigenvectors of |amplitude| min(2, |m log z|^2 / 8). Where
N, mu N - T, mu N + T and the closing of the gap stay above that bound, no step in between can end stick. A skip
leaves behind what its steps would have left, but for rounding.

Damping and the dashpot lose a quadratic form of the amplitudes in each step. Summed over the steps of a skip it is
the difference of another quadratic form between its two ends, from geometric series in the products of two
eigenvalues. The energy balance does not enter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from fivcore.beams.modes import one_blas_thread
from fivcore.contact.step_map import stick_map
from fivcore.jit import Array, kernel, reordered_call
from fivcore.transient import fast_scene as at
from fivcore.transient.fast_solver import Solver
from fivcore.transient.statistics import STICK

# Eigenvectors are used where M X - X diag(z) is smaller, in units in which the energy is a sum of squares.
ACCURATE = 1e-10
# What must be left of every eigenvector after a step: a reading is also told one step earlier.
LEAST = 1e-3
# Samples that are looked at together.
LOOKS = 64
# Rows over the eigenvalues, real and imaginary part each: log z, 1 / (1 - z), the readings N, T, velocity of B and
# the closing of the gap beyond what would open it, and one step earlier penetration and u_T. Then by how much a
# reading can be off a straight line between two samples.
(LOG, SUM, ON_N, ON_T, ON_B, ON_C, WAS_P, WAS_U) = range(0, 16, 2)
BEND, OVER_VALUES = 16, 17
# What depends on where a skip begins is linear in a = (penetration at rest, u_T with the modes at rest, 1, speed).
# Rows over x = (q, v): the line's start for each part of a, its slope for a unit of speed, the gap shapes; for
# each eigenvalue the real and imaginary parts of the way into its coordinate and back.
LINE, SLOPE, SHAPES, INTO = 0, 4, 5, 6
# Rows of 5: start of the lines of the readings N, T, velocity of B and closing, of penetration and u_T for each
# part of a, and their slope for a unit of speed; then the quadratic form of what the line loses in a step.
AFFINE_ROWS, LOST_BY_LINE = 10, 6
# Rows of the workspace.
(X, RE, IM, START_RE, START_IM, TURN_RE, TURN_IM, STARTS, SLOPES) = range(9)
AMPLITUDES, READINGS, WORKSPACE_ROWS = 9, 13, 17


@dataclass(frozen=True, eq=False)
class SkipTables:
    """What a skip needs of a solver, for one interval between samples.

    Attributes
    ----------
    count : int
        Eigenvalues, one of each conjugate pair.
    size : int
        Modes, with the empty places of the last block.
    packed : ndarray, (rows, any)
        Rows below each other: `count`, `size`; z to the powers of the next LOOKS samples, real parts over all
        eigenvalues, then negative imaginary parts, 2 count; rows over the eigenvalues, OVER_VALUES; rows over x,
        INTO + 4 count; the quadratic form of what the eigenvectors lose, 2 count; what they lose together with
        each part of the line, 4; the lines, AFFINE_ROWS.
    """

    count: int
    size: int
    packed: Array


@lru_cache(maxsize=64)
@one_blas_thread()
def skip_tables(solver: Solver, sample_every: int) -> SkipTables | None:
    """Tables of a skip; None where the map of stick has no decaying eigenvectors.

    Parameters
    ----------
    solver : Solver
        With an element: without one stick and its end are not told apart by forces alone.
    sample_every : int
        Steps between two samples.
    """
    model, step = solver.model, solver.step
    if not model.K.any():
        return None
    stick = stick_map(model, solver.impulse, step)
    n, t, size = model.normal, model.tangential, len(model.normal)
    # In these units the energy is the sum of squares: eigenvectors are then as well conditioned as they can be.
    units = stick.units
    scaled = units[:, None] * stick.matrix / units
    try:
        z, vectors = np.linalg.eig(scaled)
        into = np.linalg.inv(vectors)
        still = np.linalg.inv(np.eye(2 * size) - stick.matrix)
    except np.linalg.LinAlgError:
        return None
    wrong = np.abs(into @ (scaled @ vectors - vectors * z)).sum(axis=1).max()
    if not wrong < ACCURATE or not np.abs(z).max() < 1.0 or not np.abs(z).min() > LEAST:
        return None
    # One of each conjugate pair, counted twice.
    kept = np.flatnonzero(z.imag >= 0.0)
    twice = np.where(z.imag[kept] > 0.0, 2.0, 1.0)
    z, vectors, into = z[kept], (vectors / units[:, None])[:, kept] * twice, (into * units)[kept]
    # What a steady force makes of x, and one that grows by as much in each step.
    steady = still @ stick.impulse
    growing = still @ steady
    law, mobility = solver.maps.stick, solver.impulse.mobility
    # Penetration, u_T and the rates before the impulse with the modes at rest; the growth of u_T in a step.
    at_rest = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, -mobility[0, 0], 0], [0, 0, -mobility[1, 0], -1]])
    growth = np.array([0.0, step, 0.0, 0.0])
    force, more = law @ at_rest, law @ growth
    force[0, 2] -= 1.0
    line, slope = steady @ force, steady @ more
    line[:, 3] -= growing @ more
    seen, rise = at_rest + stick.seen @ line, growth + stick.seen @ slope
    on_b = 0.5 * step * np.array([model.point_b @ n, model.point_b @ t])
    relax = solver.maps.separation[0]
    lines = np.column_stack([seen, rise])
    held = law @ lines
    of_b = np.append(model.point_b @ line[size:], model.point_b @ slope[size:]) + on_b @ held
    of_b[2] -= on_b[0]
    before = lines[:2].copy()
    before[:, 3] -= rise[:2]
    affine = np.vstack([held, of_b, lines[0] - relax @ before, lines[:2]])
    N, T = stick.force @ vectors
    P, U = stick.seen[:2] @ vectors
    B = model.point_b @ vectors[size:] + on_b[0] * N + on_b[1] * T
    log = np.log(z)
    readings = (log, 1.0 / (1.0 - z), N, T, B, P - (relax @ np.stack([P, U])) / z, P / z, U / z)
    bend = np.minimum(2.0, 0.125 * np.abs(sample_every * log) ** 2)
    over = np.stack([*(part for reading in readings for part in (reading.real, reading.imag)), bend])
    # Rates in the middle of the impulse, weighted so that the sum of their squares is what a step loses.
    dashpot = np.linalg.cholesky(solver.dissipation).T if solver.dissipation.any() else np.zeros((2, 2))
    weights = np.sqrt(step) * np.sqrt(model.damping)[:, None]
    unit_load = np.array([[0, 0, 1.0, 0], [0, 0, 0, 0]])

    def losing(v: Any, forces: Any, rates: Any, load: Any) -> Any:
        middle = v + 0.5 * step * (np.outer(n, forces[0] - load[0]) + np.outer(t, forces[1]))
        return np.vstack([weights * middle, np.sqrt(step) * dashpot @ (rates + mobility @ forces)])

    by_vectors = losing(vectors[size:], np.stack([N, T]), stick.seen[2:] @ vectors, np.zeros((2, len(z))))
    by_line = losing(line[size:], held[:, :4], lines[2:, :4], unit_load)
    plain = (by_vectors.T @ by_vectors) / (1.0 - np.outer(z, z))
    mixed = (by_vectors.conj().T @ by_vectors) / (1.0 - np.outer(z.conj(), z))
    form = 0.5 * np.block([
        [plain.real + mixed.real, -plain.imag - mixed.imag],
        [-plain.imag + mixed.imag, mixed.real - plain.real],
    ])  # fmt: skip
    both = 2.0 * (by_line.T @ by_vectors) / (1.0 - z)
    affine = np.vstack([affine, np.column_stack([by_line.T @ by_line, np.zeros(4)])])
    # Modes as the blocks have them, with the places that stay empty.
    room = solver.size
    columns = np.r_[: len(n), room : room + len(n)]
    rows = np.stack([
        *line.T, slope, np.r_[n, t], *into.real, *into.imag, *vectors.T.real, *vectors.T.imag
    ])  # fmt: skip
    table = np.zeros((len(rows), 2 * room))
    table[:, columns] = rows
    turns = np.cumprod(np.tile(z**sample_every, (LOOKS, 1)), axis=0).T
    crossed = np.column_stack([both.real, -both.imag])
    head = np.array([[float(len(z)), float(room)]])
    parts = (head, turns.real, -turns.imag, over, table, form, crossed, affine)
    return SkipTables(len(z), room, joined(parts))


def joined(parts: Sequence[Array]) -> Array:
    """Put the rows of several matrices below each other, those of the widest being filled."""
    whole = np.zeros((sum(len(part) for part in parts), max(part.shape[1] for part in parts)))
    row = 0
    for part in parts:
        whole[row : row + len(part), : part.shape[1]] = part
        row += len(part)
    return whole


def workspace_for(tables: list[SkipTables]) -> Array:
    """Space for any of these: amplitudes have two numbers for each eigenvalue, x two for each mode."""
    widest = max([LOOKS, *(max(2 * part.size, 2 * part.count) for part in tables)])
    return np.zeros((WORKSPACE_ROWS, widest))


@reordered_call
def dot(a: Any, b: Any, count: int) -> float:
    """Sum of products."""
    total = 0.0
    for j in range(count):
        total += a[j] * b[j]
    return total


@reordered_call
def add_line(table: Any, p: float, u: float, speed: float, steps: float, sign: float, x: Any, count: int) -> None:
    """Add the line after some steps to x, or take it off."""
    for j in range(count):
        start = table[LINE, j] * p + table[LINE + 1, j] * u + table[LINE + 2, j] + table[LINE + 3, j] * speed
        x[j] += sign * (start + table[SLOPE, j] * speed * steps)


@reordered_call
def readings_of(over: Any, re: Any, im: Any, count: int) -> Any:
    """N, T, velocity of B and closing of the gap by the eigenvectors."""
    N, T, B, C = 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        x, y = re[k], im[k]
        N += over[ON_N, k] * x - over[ON_N + 1, k] * y
        T += over[ON_T, k] * x - over[ON_T + 1, k] * y
        B += over[ON_B, k] * x - over[ON_B + 1, k] * y
        C += over[ON_C, k] * x - over[ON_C + 1, k] * y
    return N, T, B, C


@reordered_call
def look_ahead(turns: Any, over: Any, re: Any, im: Any, count: int, amplitudes: Any, readings: Any) -> None:
    """Fill in the four readings by the eigenvectors at the next LOOKS samples, (4, LOOKS)."""
    for r in range(4):
        row = ON_N + 2 * r
        for k in range(count):
            amplitudes[r, k] = over[row, k] * re[k] - over[row + 1, k] * im[k]
            amplitudes[r, count + k] = over[row, k] * im[k] + over[row + 1, k] * re[k]
        for m in range(LOOKS):
            readings[r, m] = 0.0
        for j in range(2 * count):
            weight = amplitudes[r, j]
            for m in range(LOOKS):
                readings[r, m] += weight * turns[j, m]


@reordered_call
def bounds(over: Any, re: Any, im: Any, count: int, mu: float) -> Any:
    """By how much N, mu N - T, mu N + T and the closing can be off straight lines between two samples."""
    N, ahead, back, C = 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        size = over[BEND, k] * np.sqrt(re[k] * re[k] + im[k] * im[k])
        a, b, c, d = over[ON_N, k], over[ON_N + 1, k], over[ON_T, k], over[ON_T + 1, k]
        N += size * np.sqrt(a * a + b * b)
        ahead += size * np.sqrt((mu * a - c) ** 2 + (mu * b - d) ** 2)
        back += size * np.sqrt((mu * a + c) ** 2 + (mu * b + d) ** 2)
        C += size * np.sqrt(over[ON_C, k] ** 2 + over[ON_C + 1, k] ** 2)
    return N, ahead, back, C


@reordered_call
def turn(over: Any, count: int, steps: float, re: Any, im: Any, into_re: Any, into_im: Any) -> None:
    """Amplitudes some steps later."""
    for k in range(count):
        size, angle = np.exp(over[LOG, k] * steps), over[LOG + 1, k] * steps
        c, s = size * np.cos(angle), size * np.sin(angle)
        x, y = re[k], im[k]
        into_re[k], into_im[k] = x * c - y * s, x * s + y * c


@reordered_call
def quadratic(form: Any, re: Any, im: Any, count: int) -> float:
    """Value of the quadratic form of the losses."""
    total = 0.0
    for j in range(2 * count):
        row, weight = 0.0, re[j] if j < count else im[j - count]
        for k in range(count):
            row += form[j, k] * re[k] + form[j, count + k] * im[k]
        total += weight * row
    return total


@kernel
def skip(scene: Any, modes: Any, samples: Any, rows: Any, tables: Any, workspace: Any) -> bool:
    """Take a scene to the last sample before which stick cannot have ended; whether that is any farther.

    Parameters are those of `transient.fast_kernel.advance`.
    """
    every, now, sample = scene.sample_every, scene.now, scene.next_sample
    # No skip crosses a multiple of this, where segments begin and end: what a scene does is independent of them.
    reach = at.MAX_SKIP * every
    last = min((now // reach + 1) * reach, scene.last)
    if scene.settle > now:
        last = min(last, scene.settle)
    t = (now + 0.5) * scene.step
    if t < scene.ramp or sample + every > last:
        return False
    row = scene.skip_at
    count, size = int(tables[row, 0]), int(tables[row, 1])
    turns = tables[row + 1 : row + 1 + 2 * count]
    row += 1 + 2 * count
    over = tables[row : row + OVER_VALUES]
    row += OVER_VALUES
    table = tables[row : row + INTO + 4 * count]
    row += INTO + 4 * count
    form = tables[row : row + 2 * count]
    row += 2 * count
    both = tables[row : row + 4]
    affine = tables[row + 4 : row + 4 + AFFINE_ROWS]
    step, speed = scene.step, scene.speed
    # A first slip that is waited for comes with a share of mu N.
    mu = min(scene.threshold, scene.mu)
    x, re, im = workspace[X], workspace[RE], workspace[IM]
    start_re, start_im = workspace[START_RE], workspace[START_IM]
    # Penetration and u_T with the modes at rest.
    p, u = scene.p_rest, scene.anchor - scene.T_rest + speed * (t - 0.5 * scene.ramp)
    for j in range(size):
        k = scene.modes_at + j // at.BLOCK * at.BLOCK_SIZE + j % at.BLOCK
        x[j], x[size + j] = modes[k + at.Q * at.BLOCK], modes[k + at.V * at.BLOCK]
    add_line(table, p, u, speed, 0.0, -1.0, x, 2 * size)
    for k in range(count):
        re[k] = dot(table[INTO + k], x, 2 * size)
        im[k] = dot(table[INTO + count + k], x, 2 * size)
    starts, slopes = workspace[STARTS], workspace[SLOPES]
    for k in range(6):
        starts[k] = affine[k, 0] * p + affine[k, 1] * u + affine[k, 2] + affine[k, 3] * speed
        slopes[k] = affine[k, 4] * speed
    N0, T0, B0, C0 = starts[0], starts[1], starts[2], starts[3]
    N1, T1, B1, C1 = slopes[0], slopes[1], slopes[2], slopes[3]
    N, T, B, C = readings_of(over, re, im, count)
    if not _safe(bounds(over, re, im, count, mu), mu, N + N0, T + T0, C + C0):
        return False
    for k in range(count):
        start_re[k], start_im[k] = re[k], im[k]
    largest, past = N + N0, float(sample - now)
    if past > 0.0:
        turn(over, count, past, start_re, start_im, re, im)
        N, T, B, C = readings_of(over, re, im, count)
        if not _safe(
            bounds(over, re, im, count, mu), mu, N + N0 + N1 * past, T + T0 + T1 * past, C + C0 + C1 * past
        ):
            return False
    goal, written = sample, scene.samples_at + scene.samples
    readings = workspace[READINGS : READINGS + 4]
    was_N, was_B = N + N0 + N1 * past, B + B0 + B1 * past
    quiet = True
    while quiet and goal + every <= last:
        # Amplitudes only shrink: what bounds them here does so at all samples to come.
        off = bounds(over, re, im, count, mu)
        look_ahead(turns, over, re, im, count, workspace[AMPLITUDES : AMPLITUDES + 4], readings)
        far = 0
        for m in range(LOOKS):
            past += every
            now_N, now_T = readings[0, m] + N0 + N1 * past, readings[1, m] + T0 + T1 * past
            quiet = goal + every <= last and _safe(off, mu, now_N, now_T, readings[3, m] + C0 + C1 * past)
            if not quiet:
                break
            samples[written, 0], samples[written, 1], samples[written, 2] = was_B, 0.0, was_N
            largest = max(largest, was_N)
            was_N, was_B = now_N, readings[2, m] + B0 + B1 * past
            written += 1
            goal += every
            far += 1
        if far > 0:
            for k in range(count):
                a, b, c, s = re[k], im[k], turns[k, far - 1], -turns[count + k, far - 1]
                re[k], im[k] = a * c - b * s, a * s + b * c
    steps = float(goal - now)
    if steps == 0.0:
        return False
    scene.samples = written - scene.samples_at
    scene.damped += quadratic(form, start_re, start_im, count) - quadratic(form, re, im, count)
    a, b = (p, u, 1.0, speed), (p, u, 1.0, speed)
    for i in range(4):
        for k in range(count):
            lost = both[i, k] * (start_re[k] - re[k]) + both[i, count + k] * (start_im[k] - im[k])
            scene.damped += a[i] * lost
        for j in range(4):
            scene.damped += steps * a[i] * b[j] * affine[LOST_BY_LINE + i, j]
    for j in range(2 * size):
        x[j] = 0.0
    add_line(table, p, u, speed, steps, 1.0, x, 2 * size)
    for k in range(count):
        into, back = table[INTO + 2 * count + k], table[INTO + 3 * count + k]
        for j in range(2 * size):
            x[j] += re[k] * into[j] - im[k] * back[j]
    scene.u_N, scene.u_T = starts[4] + slopes[4] * (steps - 1.0), starts[5] + slopes[5] * (steps - 1.0)
    sum_N, sum_T = 0.0, 0.0
    for k in range(count):
        scene.u_N += over[WAS_P, k] * re[k] - over[WAS_P + 1, k] * im[k]
        scene.u_T += over[WAS_U, k] * re[k] - over[WAS_U + 1, k] * im[k]
        # The sum of z^i amplitude over the steps.
        c, d = start_re[k] - re[k], start_im[k] - im[k]
        e, f = c * over[SUM, k] - d * over[SUM + 1, k], c * over[SUM + 1, k] + d * over[SUM, k]
        sum_N += over[ON_N, k] * e - over[ON_N + 1, k] * f
        sum_T += over[ON_T, k] * e - over[ON_T + 1, k] * f
    pairs = 0.5 * steps * (steps - 1.0)
    sum_N += N0 * steps + N1 * pairs
    sum_T += T0 * steps + T1 * pairs
    for j in range(size):
        k = scene.modes_at + j // at.BLOCK * at.BLOCK_SIZE + j % at.BLOCK
        modes[k + at.Q * at.BLOCK], modes[k + at.V * at.BLOCK] = x[j], x[size + j]
    scene.work += speed * step * sum_T
    scene.sum_N += step * sum_N
    scene.stick_time += step * steps
    scene.max_N = max(scene.max_N, largest)
    normal, tangential = table[SHAPES, :size], table[SHAPES, size:]
    scene.g_N, scene.g_T = dot(normal, x, size), dot(tangential, x, size)
    scene.v_N, scene.v_T = dot(normal, x[size:], size), dot(tangential, x[size:], size)
    if scene.next_row < goal:
        _record(scene, over, count, start_re, start_im, re, im, workspace, rows, goal)
    scene.now = scene.next_sample = goal
    return True


@kernel
def _safe(off: Any, mu: float, N: float, T: float, C: float) -> bool:
    """Whether nothing can end stick between here and a sample that is as good."""
    return off[0] < N and mu * N - T > off[1] and mu * N + T > off[2] and off[3] < C


@kernel
def _record(
    scene: Any, over: Any, count: int, start_re: Any, start_im: Any, re: Any, im: Any, workspace: Any, rows: Any,
    goal: int,
) -> None:  # fmt: skip
    """Rows of the record between now and step `goal`; `re` and `im` are overwritten."""
    starts, slopes = workspace[STARTS], workspace[SLOPES]
    by_re, by_im = workspace[TURN_RE], workspace[TURN_IM]
    for k in range(count):
        by_re[k], by_im[k] = 1.0, 0.0
    turn(over, count, float(scene.row_every), by_re, by_im, by_re, by_im)
    turn(over, count, float(scene.next_row - scene.now), start_re, start_im, re, im)
    while scene.next_row < goal:
        N, T, B, _ = readings_of(over, re, im, count)
        past = float(scene.next_row - scene.now)
        place = scene.rows_at + scene.rows
        rows[place, 0] = (scene.next_row + 0.5) * scene.step
        rows[place, 1] = B + starts[2] + slopes[2] * past
        rows[place, 2] = N + starts[0] + slopes[0] * past
        rows[place, 3] = T + starts[1] + slopes[1] * past
        rows[place, 4], rows[place, 5] = 0.0, STICK
        scene.rows += 1
        scene.next_row += scene.row_every
        for k in range(count):
            x, y = re[k], im[k]
            re[k], im[k] = x * by_re[k] - y * by_im[k], x * by_im[k] + y * by_re[k]
