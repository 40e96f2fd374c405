"""Compiled steps of `method="fast"` for several contacts: impulses of all between exact moves of the modes.

The step is that of `fast.kernel`, with vectors. Forces f = (N, T), 2 c of them, and a status of each contact. With
S the flexibility and M the mean rates of the gaps over an impulse, p the penetration before it, v the rates there
and Q = S + a M, the law of a contact is

    normal   (Q f)_N - (p - a v_N) >= 0, complementary to N >= 0                     a = tau
    stick    (Q f)_T = u_T - a v_T, u_T from the anchor where it stuck before        a by the status before
    slip     T = s m N while s ((Q f)_T - (u_T - a v_T)) <= 0, s the sign of T

Newton's method on the statuses (Alart and Curnier, Comput. Methods Appl. Mech. Eng. 92, 1991, 353-375) solves it:
the inverse of the matrix whose rows a status selects is kept, and a status that changes replaces a row of it
(Sherman and Morrison). Friction makes it cycle at times: then projected Gauss-Seidel, contact by contact, finds
the status. All pivots are positive where the forces are unique.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fivcore.friction import slip_speed
from fivcore.jit import Array, called, inlined, kernel, reordered
from fivcore.transient.statistics import SEPARATION, SLIP, STICK, clear, enter

# Statuses: those of a record, and slip with T < 0.
DOWN = 3
# Most steps of Newton's method; most sweeps of Gauss-Seidel, the change in units of the largest force at which
# they end, and that above which a step counts as unsolved.
NEWTON, SWEEPS, SETTLED, UNSOLVED = 12, 100, 1e-12, 1e-7
# Newton's method, and so often less one Gauss-Seidel and again Newton's from the statuses that it found.
ATTEMPTS = 6
# Least pivot, and rows that are replaced before the inverse is made anew.
LEAST_PIVOT, REPLACED = 1e-14, 4000
# Most refinements of a solution, and the share of the largest force that is rounding.
REFINED, ROUNDING = 4, 1e-13
# Columns of the counters of a contact.
STICK_TIME, SLIP_TIME, OPEN_TIME, SUM_N, MAX_N, SWITCHES, MAX_SLIP = range(7)
COUNTERS = 7


class Law(NamedTuple):
    """What does not change: (2c, ...) arrays have first all normal rows."""

    # Gap shapes, (2c, m); flow over a step, (4, m); B and damping, (m,).
    gaps: Array
    flow: Array
    output: Array
    damping: Array
    # Flexibility and mean rates, (2c, 2c); Q by the status before, (3, 2c, 2c), in units of `unit`; its a, (3,).
    flexibility: Array
    delassus: Array
    matrix: Array
    unit: float
    times: Array
    # At rest: forces, penetration and tangential gap, (2c,); which contacts the load closes, (c,).
    rest: Array
    at_rest: Array
    closed: Any
    # Friction of each contact, static and in slip, (c,), and `Friction.law` where it depends on the speed.
    mu: Array
    kinetic: Array
    falls: bool
    law: tuple[float, float, float]
    # s; exp(-step / tau); step / (1 - keep), s.
    step: float
    keep: float
    late: float
    rigid: bool


class Motion(NamedTuple):
    """What a step changes."""

    q: Array
    v: Array
    # u, forces and the rates after the last impulse (2c,); anchors and last slip rates, (c,).
    u: Array
    force: Array
    after: Array
    anchor: Array
    slip: Array
    # Status, that before, that of which `inverse` is, (c,); counters (c, COUNTERS).
    status: Any
    was: Any
    held: Any
    counters: Array
    # Q by the present statuses, (2c, 2c), and the inverse.
    matrix: Array
    inverse: Array
    # Work arrays: (2c,) each in rows, and (m,).
    work: Array
    push: Array


@reordered
def multiply(matrix: Any, x: Any, y: Any) -> None:
    """Set y to matrix x."""
    for i in range(matrix.shape[0]):
        total = 0.0
        for j in range(matrix.shape[1]):
            total += matrix[i, j] * x[j]
        y[i] = total


@reordered
def see(gaps: Any, q: Any, v: Any, g: Any, r: Any) -> None:
    """Gaps and their rates, contact by contact."""
    c = gaps.shape[0] // 2
    for i in range(c):
        a, b, x, y = 0.0, 0.0, 0.0, 0.0
        for j in range(gaps.shape[1]):
            a += gaps[i, j] * q[j]
            b += gaps[c + i, j] * q[j]
            x += gaps[i, j] * v[j]
            y += gaps[c + i, j] * v[j]
        g[i], g[c + i], r[i], r[c + i] = a, b, x, y


@reordered
def kick(gaps: Any, impulse: Any, push: Any) -> None:
    """What impulses give the modes."""
    c = gaps.shape[0] // 2
    push[:] = 0.0
    for i in range(c):
        for j in range(gaps.shape[1]):
            push[j] += gaps[i, j] * impulse[i] + gaps[c + i, j] * impulse[c + i]


@reordered
def move(flow: Any, push: Any, q: Any, v: Any) -> None:
    """Add the impulse and move freely over a step."""
    for j in range(len(q)):
        x, y = q[j], v[j] + push[j]
        q[j] = flow[0, j] * x + flow[1, j] * y
        v[j] = flow[2, j] * x + flow[3, j] * y


@reordered
def observe(output: Any, damping: Any, v: Any, push: Any) -> Any:
    """Velocity of B, and power lost, in the middle of an impulse."""
    speed, power = 0.0, 0.0
    for j in range(len(v)):
        middle = v[j] + 0.5 * push[j]
        speed += output[j] * middle
        power += damping[j] * middle * middle
    return speed, power


@reordered
def replace_row(inverse: Any, k: int, row: Any, work: Any) -> bool:
    """Make `inverse` that of the matrix with `row` in place of row k; False if its pivot is not positive."""
    n = len(row)
    work[:] = 0.0
    for i in range(n):
        if row[i] != 0.0:
            for j in range(n):
                work[j] += row[i] * inverse[i, j]
    pivot = work[k]
    if not pivot > LEAST_PIVOT:
        return False
    work[k] -= 1.0
    for i in range(n):
        share = inverse[i, k] / pivot
        if share != 0.0:
            for j in range(n):
                inverse[i, j] -= share * work[j]
    return True


@called
def follow(inverse: Any, matrix: Any, held: Any, kinetic: Any, i: int, new: int, work: Any) -> int:
    """Make the inverse that of contact i's new status; rows replaced, or -1 where a pivot is not positive."""
    c, old, row, other = len(held), held[i], work[5], work[6]
    done, fine = 1, True
    if new != SEPARATION and old == SEPARATION:
        row[:] = matrix[i]
        fine, done = replace_row(inverse, i, row, other), 2
    row[:] = 0.0
    row[c + i] = 1.0
    if new == STICK:
        row[:] = matrix[c + i]
    elif new != SEPARATION:
        row[i] = -kinetic[i] if new == SLIP else kinetic[i]
    fine = replace_row(inverse, c + i, row, other) and fine
    if new == SEPARATION and old != SEPARATION:
        row[:] = 0.0
        row[i] = 1.0
        fine, done = replace_row(inverse, i, row, other) and fine, 2
    held[i] = new
    return done if fine else -1


@called
def gauss_seidel(law: Any, motion: Any, b: Any) -> float:
    """Solve a step contact by contact from the present forces; the last change in units of the largest force."""
    A, f, was, status, slip, mu, kinetic = (
        motion.matrix, motion.force, motion.was, motion.status, motion.slip, law.mu, law.kinetic
    )  # fmt: skip
    c, change, per = len(mu), np.inf, law.unit / law.late
    for _ in range(SWEEPS):
        change, size = 0.0, 0.0
        for i in range(c):
            t = c + i
            nn, nt, tn, tt = A[i, i], A[i, t], A[t, i], A[t, t]
            rest_N, rest_T = others(A, f, b, i, t)
            rest_N, rest_T = rest_N + nn * f[i] + nt * f[t], rest_T + tn * f[i] + tt * f[t]
            determinant = nn * tt - nt * tn
            N, T = (tt * rest_N - nt * rest_T) / determinant, (nn * rest_T - tn * rest_N) / determinant
            now = STICK
            sticks = N > 0.0 and abs(T) <= (mu[i] if was[i] == STICK else kinetic[i]) * N
            way, ratio = 1.0 if T > 0.0 else -1.0, 1.0
            if law.falls and not (sticks and was[i] == STICK):
                # The slip rate is (A f - b)_T / late in units of the matrix; if stick and slip are both possible,
                # slip continues.
                ahead, mobility = per * way * (rest_T - tn * rest_N / nn), per * (tt - tn * nt / nn)
                speed, ratio = slip_speed(-way * slip[i], ahead, mobility, rest_N, nn, -way * nt, mu[i], law.law)
                sticks = sticks and speed < 0.0
            if not sticks:
                m = way * ratio * kinetic[i]
                N, now = rest_N / (nn + m * nt), SLIP if T > 0.0 else DOWN
                T = m * N
                if not N > 0.0:
                    N, T, now = 0.0, 0.0, SEPARATION
            change, size = max(change, abs(N - f[i]), abs(T - f[t])), max(size, N)
            f[i], f[t], status[i] = N, T, now
        change /= max(size, 1e-3)
        if change <= SETTLED:
            break
    return change


@reordered
def others(A: Any, f: Any, b: Any, i: int, t: int) -> Any:
    """Two rows of b - A f."""
    x, y = b[i], b[t]
    for j in range(len(f)):
        x -= A[i, j] * f[j]
        y -= A[t, j] * f[j]
    return x, y


@inlined
def newton(
    inverse: Any, matrix: Any, b: Any, eligible: Any, mu: Any, kinetic: Any, was: Any, status: Any, held: Any,
    f: Any, right: Any, y: Any, more: Any, work: Any, counts: Any,
) -> bool:  # fmt: skip
    """Solve a step by its statuses; False if they do not settle."""
    c = len(mu)
    for _ in range(NEWTON):
        counts[0] += 1
        for i in range(c):
            right[i] = b[i] if status[i] != SEPARATION else 0.0
            right[c + i] = b[c + i] if status[i] == STICK else 0.0
        multiply(inverse, right, f)
        multiply(matrix, f, y)
        for _ in range(REFINED):
            # Replaced rows leave rounding in the inverse, much of it where contacts hardly differ.
            worst, size = 0.0, 0.0
            for i in range(c):
                t, m = c + i, kinetic[i] if status[i] == SLIP else -kinetic[i]
                right[i] = b[i] - y[i] if status[i] != SEPARATION else -f[i]
                right[t] = b[t] - y[t] if status[i] == STICK else -f[t]
                right[t] += m * f[i] if status[i] >= SLIP else 0.0
                worst, size = max(worst, abs(right[i]), abs(right[t])), max(size, abs(f[i]))
            if worst <= ROUNDING * size:
                break
            multiply(inverse, right, more)
            for k in range(2 * c):
                f[k] += more[k]
            multiply(matrix, f, y)
        moved = False
        for i in range(c):
            now, t = status[i], c + i
            new = now
            if now == SEPARATION:
                if eligible[i] != 0.0 and b[i] > y[i]:
                    new = STICK
            elif not f[i] > 0.0:
                new = SEPARATION
            elif now == STICK:
                m = mu[i] if was[i] == STICK else kinetic[i]
                if abs(f[t]) > m * f[i]:
                    new = SLIP if f[t] > 0.0 else DOWN
            elif (b[t] < y[t]) == (now == SLIP):
                new = STICK
            if new != now:
                moved, status[i] = True, new
        if not moved:
            return True
        for i in range(c):
            if status[i] != held[i]:
                done = follow(inverse, matrix, held, kinetic, i, status[i], work)
                counts[1] += max(done, 0)
                if done < 0:
                    return False
    return False


@called
def renew(law: Any, motion: Any, counts: Any) -> None:
    """Make the inverse anew for the present statuses and matrix."""
    motion.inverse[:] = 0.0
    for i in range(len(motion.inverse)):
        motion.inverse[i, i] = 1.0
    motion.held[:] = SEPARATION
    counts[1], counts[2] = 0, counts[2] + (not update(law, motion))


@called
def update(law: Any, motion: Any) -> bool:
    """Let the inverse be that of the present statuses; False if a pivot is not positive."""
    fine, inverse, matrix, held = True, motion.inverse, motion.matrix, motion.held
    for i in range(len(held)):
        if motion.status[i] != held[i]:
            fine = follow(inverse, matrix, held, law.kinetic, i, motion.status[i], motion.work) > 0 and fine
    return fine


@called
def relax(law: Any, motion: Any, b: Any, eligible: Any, before: Any, counts: Any) -> float:
    """Solve a step by Gauss-Seidel, from forces that become those found; the last change of them."""
    motion.force[:] = before
    for i in range(len(law.mu)):
        if eligible[i] == 0.0:
            b[i] = -1e300
    change = gauss_seidel(law, motion, b)
    before[:] = motion.force
    if not law.falls:
        renew(law, motion, counts)
    return change


@kernel
def take_steps(scenes: Any, law: Law, motion: Motion, counts: Any, samples: Any, rows: Any, sticks: Any) -> None:
    """Take a scene to its next pause, as `fast.kernel.advance` does.

    `counts` are Newton steps, rows replaced, pivots lost, steps by Gauss-Seidel, and unsolved ones.
    """
    # Fields of tuples are read once: each reading counts references.
    (
        gaps, flow, output, damping, flexibility, delassus, by_status, unit, times,
        rest, at_rest, closed, mu, kinetic, falls, _, h, keep, _, rigid,
    ) = law  # fmt: skip
    q, v, u, f, after, anchor, slip, status, was, held, counters, matrix, inverse, work, push = motion
    g, r, b, mean, right, y, last, more = work[0], work[1], work[2], work[3], work[4], work[7], work[8], work[13]
    share, impulse, base, eligible = work[9], work[10], work[11], work[12]
    scene, c, gone = scenes[0], len(mu), 1.0 - keep
    # The load's share of the rates.
    multiply(delassus, rest, share)
    for now in range(scene.now, scene.last):
        if scene.settle == now:
            clear(scene)
            counters[:] = 0.0
            scene.any_open, scene.all_stick = 0.0, 0.0
        t = (now + 0.5) * h
        drive = scene.acceleration * t if t < scene.ramp else scene.speed
        X = 0.5 * drive * t if t < scene.ramp else drive * (t - 0.5 * scene.ramp)
        see(gaps, q, v, g, r)
        for i in range(c):
            k = c + i
            old = min(status[i], SLIP)
            if old != was[i]:
                matrix[k] = by_status[old, k]
                was[i] = old
                if status[i] == STICK and not falls:
                    follow(inverse, matrix, held, kinetic, i, STICK, work)
            g[i], g[k] = at_rest[i] - g[i], g[k] + at_rest[k] - X
            r[i], r[k] = r[i] - share[i], r[k] - share[k] - drive
            eligible[i] = 1.0 if old != SEPARATION or g[i] > keep * u[i] else 0.0
            if rigid:
                # Where a contact or its stick begins, gaps do not change over the next move (`fast.kernel`).
                b[i] = -(r[i] if old != SEPARATION else 0.75 * r[i] - 0.25 * after[i])
                b[k] = -(r[k] if old == STICK else 0.75 * r[k] - 0.25 * after[k])
                eligible[i] = 1.0 if old != SEPARATION or g[i] > 0.0 else 0.0
            else:
                b[i] = g[i] - times[STICK] * r[i]
                b[k] = (anchor[i] - g[k] if old == STICK else u[k]) - times[old] * r[k]
            b[i], b[k] = b[i] / unit, b[k] / unit
        if counts[1] > REPLACED:
            renew(law, motion, counts)
        for k in range(2 * c):
            last[k] = f[k]
        for attempt in range(ATTEMPTS):
            if falls or attempt > 0:
                change = relax(law, motion, b, eligible, last, counts)
                counts[3] += attempt < 2
                if falls or change <= SETTLED or attempt == ATTEMPTS - 1:
                    counts[4] += change > UNSOLVED
                    break
            if newton(
                inverse, matrix, b, eligible, mu, kinetic, was, status, held, f, right, y, more, work, counts
            ):
                break
        multiply(delassus, f, mean)
        multiply(flexibility, f, base)
        taken, slips, opens, touching, sum_N, sum_T, fastest = 0.0, 0, 0, 0, 0.0, 0.0, 0.0
        for i in range(c):
            k, now_is, old = c + i, min(status[i], SLIP), was[i]
            mean[i], mean[k] = mean[i] + r[i], mean[k] + r[k]
            before = 0.0 if rigid else anchor[i] - g[k] if old == STICK else u[k]
            slip_rate = mean[k]
            if now_is == STICK:
                end = before - (times[old] - times[STICK]) * mean[k]
                anchor[i] = g[k] + end
                slip_rate = 0.0
            else:
                before += (times[SLIP] - times[STICK]) * mean[k] if old == STICK else 0.0
                end = keep * before + gone * base[k]
                slip_rate += (end - before) / h
            u[k] = end
            if now_is == SEPARATION:
                first = g[i] if old != SEPARATION and g[i] > keep * u[i] else u[i]
                u[i] = keep * first + gone * base[i] if not rigid else 0.0
            else:
                u[i] = g[i] if not rigid else 0.0
                taken -= f[i] * mean[i] + f[k] * (mean[k] - slip_rate)
                scene.friction -= h * f[k] * slip_rate
                scene.work += h * f[k] * drive
            slip[i] = slip_rate
            if abs(slip_rate) > abs(fastest):
                fastest = slip_rate
            sum_N, sum_T = sum_N + f[i], sum_T + f[k]
            opens += closed[i] and now_is == SEPARATION
            slips += now_is == SLIP
            touching += now_is != SEPARATION
            table = counters[i]
            table[OPEN_TIME if now_is == SEPARATION else STICK_TIME if now_is == STICK else SLIP_TIME] += h
            table[SUM_N] += h * f[i]
            table[MAX_N], table[MAX_SLIP] = max(table[MAX_N], f[i]), max(table[MAX_SLIP], abs(slip_rate))
            table[SWITCHES] += now_is != old
            impulse[i], impulse[k] = h * (f[i] - rest[i]), h * (f[k] - rest[k])
            after[i], after[k] = 2.0 * mean[i] - r[i], 2.0 * mean[k] - r[k]
        # What the springs store is in it.
        scene.termination += h * taken
        contact = SEPARATION if touching == 0 else SLIP if slips > 0 else STICK
        scene.any_open += h * (opens > 0)
        scene.all_stick += h * (opens + slips == 0)
        scene.sum_N += h * sum_N
        scene.max_N, scene.max_slip = max(scene.max_N, sum_N), max(scene.max_slip, abs(fastest))
        if contact == STICK:
            scene.stick_time += h
        elif contact == SLIP:
            scene.slip_time += h
        else:
            scene.separation_time += h
        if contact != scene.contact:
            if enter(scene, scene.contact, contact, t):
                place = scene.sticks - 1
                sticks[place, 0], sticks[place, 1] = scene.last_stick, t
            scene.contact = contact
            if scene.settled_from < np.inf:
                scene.settle = int(np.ceil(scene.settled_from / h - 0.5 - 1e-6))
        kick(gaps, impulse, push)
        if now % scene.look_every == 0:
            speed, power = observe(output, damping, v, push)
            if now % scene.energy_every == 0:
                scene.damped += scene.energy_every * h * power
            if now % scene.sample_every == 0:
                place = scene.samples
                samples[place, 0], samples[place, 1], samples[place, 2] = speed, fastest, sum_N
                samples[place, 3], samples[place, 4] = scene.stick_time, scene.separation_time
                samples[place, 5], samples[place, 6] = scene.sum_N, scene.switches
                scene.samples += 1
            if scene.row_every > 0 and now % scene.row_every == 0:
                row = rows[scene.rows]
                row[0], row[1], row[2], row[3], row[4], row[5] = t, speed, sum_N, sum_T, fastest, contact
                for i in range(c):
                    row[6 + i], row[6 + c + i], row[6 + 2 * c + i] = f[i], f[c + i], slip[i]
                    row[6 + 3 * c + i] = min(status[i], SLIP)
                scene.rows += 1
        move(flow, push, q, v)
    scene.now = scene.last


@kernel
def start(law: Law, motion: Motion, counts: Any) -> None:
    """Make the inverse of a motion at its start."""
    renew(law, motion, counts)
