"""Compiled steps of `method="fast"` for several contacts: impulses of all contacts between exact free moves.

The step is that of `fast.kernel` in vector form, with the 2 c forces f = (N, T) and a status for each contact.
With the flexibility S, the mean rates M of the gaps during an impulse for unit forces, the penetration p and rates
v before it, and Q = S + a M, the contact law is

    normal   (Q f)_N - (p - a v_N) >= 0, complementary to N >= 0                     a = tau
    stick    (Q f)_T = u_T - a v_T, u_T from the anchor where it stuck before        a by the status before
    slip     T = s m N while s ((Q f)_T - (u_T - a v_T)) <= 0, s the sign of T

Newton's method on the statuses (Alart and Curnier, Comput. Methods Appl. Mech. Eng. 92, 1991, 353-375) solves it:
the statuses select the equations, and their factors are kept until a status changes. With friction the method may
cycle; then a few sweeps of projected Gauss-Seidel over the contacts provide other statuses. All pivots are
positive if the forces are unique.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fivcore.friction import slip_speed
from fivcore.jit import Array, called, inlined, kernel, reordered
from fivcore.transient.statistics import SEPARATION, SLIP, STICK, clear, count_step, enter, first_counted

# Statuses: those of a record, and one more for slip with T < 0.
DOWN = 3
# Largest number of Newton steps and of Gauss-Seidel sweeps; change relative to the largest force at which sweeps
# end, and above which a step counts as unsolved.
NEWTON, SWEEPS, SETTLED, UNSOLVED = 5, 100, 1e-12, 1e-7
# Newton's method is tried this often, from the second time on after a few sweeps that provide new statuses.
ATTEMPTS, FEW = 12, 3
# Smallest pivot; penetration of a contact that stays open.
LEAST_PIVOT, NEVER = 1e-14, -1e300
# Columns of the counters of a contact.
STICK_TIME, SLIP_TIME, OPEN_TIME, SUM_N, MAX_N, SWITCHES, MAX_SLIP = range(7)
COUNTERS = 7


class Law(NamedTuple):
    """Constants of a step; arrays (2c, ...) have the rows of all normal directions first."""

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
    """State that a step updates."""

    q: Array
    v: Array
    # u, forces and the rates after the last impulse (2c,); anchors and last slip rates, (c,).
    u: Array
    force: Array
    after: Array
    anchor: Array
    slip: Array
    # Status and that before, (c,); counters (c, COUNTERS).
    status: Any
    was: Any
    counters: Array
    # Q for the present statuses, and the factors of the selected equations, (2c, 2c).
    matrix: Array
    factors: Array
    # Work arrays: (2c,) each in rows, and (m,).
    work: Array
    places: Any
    push: Array


@reordered
def product(matrix: Any, i: int, x: Any) -> float:
    """Row i of matrix times x."""
    total = 0.0
    for j in range(len(x)):
        total += matrix[i, j] * x[j]
    return total


@inlined
def multiply(matrix: Any, x: Any, y: Any) -> None:
    """Set y to matrix x."""
    for i in range(len(y)):
        y[i] = product(matrix, i, x)


@inlined
def after(i: int, count: int) -> Any:
    """Range from i + 1 to count, unsigned so that no index is tested for counting from the end."""
    return range(np.uint64(i + 1), np.uint64(count))


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
    """Compute the modal impulse `push` of the contact impulses; open contacts have none and are skipped."""
    c = gaps.shape[0] // 2
    push[:] = 0.0
    for i in range(c):
        if impulse[i] != 0.0 or impulse[c + i] != 0.0:
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
def factor(matrix: Any, kinetic: Any, status: Any, factors: Any, mine: Any, slides: Any, share: Any) -> int:
    """Factorise the equations that the statuses select; return their number, or -1 if a pivot is not positive.

    Unknowns are N of closed contacts (with T = m N in slip) and T of sticking ones: columns `mine`, and for slip
    also columns `slides` times m. There is no pivoting; the inverse pivots are on the diagonal.
    """
    c, count = len(status), 0
    for i in range(c):
        if status[i] != SEPARATION:
            mine[count], slides[count], share[count] = i, c + i, 0.0
            if status[i] != STICK:
                share[count] = kinetic[i] if status[i] == SLIP else -kinetic[i]
            count += 1
    for i in range(c):
        if status[i] == STICK:
            mine[count], slides[count], share[count] = c + i, c + i, 0.0
            count += 1
    for i in range(count):
        for j in range(count):
            factors[i, j] = matrix[mine[i], mine[j]] + share[j] * matrix[mine[i], slides[j]]
    for k in range(count):
        if not factors[k, k] > LEAST_PIVOT:
            return -1
        inverse = 1.0 / factors[k, k]
        factors[k, k] = inverse
        for i in after(k, count):
            part = factors[i, k] * inverse
            factors[i, k] = part
            for j in after(k, count):
                factors[i, j] -= part * factors[k, j]
    return count


@reordered
def solve(count: int, factors: Any, mine: Any, slides: Any, share: Any, b: Any, x: Any, f: Any) -> None:
    """Solve for the forces with the factors."""
    for i in range(count):
        total = b[mine[i]]
        for j in range(i):
            total -= factors[i, j] * x[j]
        x[i] = total
    for i in range(count - 1, -1, -1):
        total = x[i]
        for j in after(i, count):
            total -= factors[i, j] * x[j]
        x[i] = total * factors[i, i]
    f[:] = 0.0
    for i in range(count):
        f[slides[i]] = share[i] * x[i]
        f[mine[i]] = x[i]


@called
def gauss_seidel(law: Any, motion: Any, b: Any, sweeps: int) -> float:
    """Gauss-Seidel from the present forces; return the last change relative to the largest force."""
    A, f, was, status, slip, mu, kinetic = (
        motion.matrix, motion.force, motion.was, motion.status, motion.slip, law.mu, law.kinetic
    )  # fmt: skip
    c, change, per = len(mu), np.inf, law.unit / law.late
    for _ in range(sweeps):
        change, size = 0.0, 0.0
        for i in range(c):
            t = c + i
            nn, nt, tn, tt = A[i, i], A[i, t], A[t, i], A[t, t]
            rest_N = b[i] - product(A, i, f) + nn * f[i] + nt * f[t]
            rest_T = b[t] - product(A, t, f) + tn * f[i] + tt * f[t]
            determinant = nn * tt - nt * tn
            N, T = (tt * rest_N - nt * rest_T) / determinant, (nn * rest_T - tn * rest_N) / determinant
            now = STICK
            sticks = N > 0.0 and abs(T) <= (mu[i] if was[i] == STICK else kinetic[i]) * N
            way, ratio = 1.0 if T > 0.0 else -1.0, 1.0
            if law.falls and not (sticks and was[i] == STICK):
                # The slip rate is (A f - b)_T / late in units of the matrix; if stick and slip are both possible,
                # slip continues.
                # Rigid contact sticks by another rate than that at which it slips.
                own = -motion.work[1][t] / law.unit - b[t] if law.rigid else 0.0
                ahead, mobility = per * way * (rest_T + own - tn * rest_N / nn), per * (tt - tn * nt / nn)
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


@inlined
def newton(
    factors: Any, matrix: Any, b: Any, mu: Any, kinetic: Any, was: Any, status: Any, f: Any, x: Any, mine: Any,
    slides: Any, share: Any, count: int, counts: Any,
) -> int:  # fmt: skip
    """Newton's method on the statuses; return the number of equations, or -1 if the statuses do not settle."""
    c = len(mu)
    for _ in range(NEWTON):
        counts[0] += 1
        if count < 0:
            count = factor(matrix, kinetic, status, factors, mine, slides, share)
            counts[1], counts[2] = counts[1] + 1, counts[2] + (count < 0)
        solve(count, factors, mine, slides, share, b, x, f)
        stale = False
        for i in range(c):
            now, t = status[i], c + i
            new = now
            if now == SEPARATION:
                if b[i] > product(matrix, i, f):
                    new = STICK
            elif not f[i] > 0.0:
                new = SEPARATION
            elif now == STICK:
                m = mu[i] if was[i] == STICK else kinetic[i]
                if abs(f[t]) > m * f[i]:
                    new = SLIP if f[t] > 0.0 else DOWN
            elif (b[t] < product(matrix, t, f)) == (now == SLIP):
                new = STICK
            if new != now:
                stale, status[i] = True, new
        if not stale:
            return count
        count = -1
    return count


@kernel
def take_steps(scenes: Any, law: Law, motion: Motion, counts: Any, samples: Any, rows: Any, sticks: Any) -> None:
    """Take a scene to its next pause, as `fast.kernel.advance` does.

    `counts` are Newton steps, factorisations, pivots lost, steps by Gauss-Seidel, and unsolved ones.
    """
    # Fields of tuples are read once, because each access counts references.
    (
        gaps, flow, output, damping, flexibility, delassus, by_status, unit, times,
        rest, at_rest, closed, mu, kinetic, falls, _, h, keep, _, rigid,
    ) = law  # fmt: skip
    q, v, u, f, after, anchor, slip, status, was, counters, matrix, factors, work, places, push = motion
    g, r, b, mean, x, part = work[0], work[1], work[2], work[3], work[4], work[5]
    share, impulse, mine, slides = work[6], work[7], places[0], places[1]
    scene, c, gone, count, per_unit = scenes[0], len(mu), 1.0 - keep, -1, 1.0 / unit
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
                count = -1 if old == STICK else count
            g[i], g[k] = at_rest[i] - g[i], g[k] + at_rest[k] - X
            r[i], r[k] = r[i] - share[i], r[k] - share[k] - drive
            apart = old == SEPARATION and not g[i] > (0.0 if rigid else keep * u[i])
            if rigid:
                # Where a contact or its stick begins, gaps do not change over the next move (`fast.kernel`).
                b[i] = -(r[i] if old != SEPARATION else 0.75 * r[i] - 0.25 * after[i])
                b[k] = -(r[k] if old == STICK else 0.75 * r[k] - 0.25 * after[k])
            else:
                b[i] = g[i] - times[STICK] * r[i]
                b[k] = (anchor[i] - g[k] if old == STICK else u[k]) - times[old] * r[k]
            b[i], b[k] = NEVER if apart else b[i] * per_unit, b[k] * per_unit
        for attempt in range(ATTEMPTS):
            if falls or attempt > 0:
                whole = falls or attempt == ATTEMPTS - 1
                change = gauss_seidel(law, motion, b, SWEEPS if whole else FEW)
                counts[3] += attempt < 2
                if whole or change <= SETTLED:
                    counts[4] += change > UNSOLVED
                    break
            count = newton(factors, matrix, b, mu, kinetic, was, status, f, x, mine, slides, part, count, counts)
            if count >= 0:
                break
        multiply(delassus, f, mean)
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
                end = keep * before + gone * product(flexibility, k, f)
                slip_rate += (end - before) / h
            u[k] = end
            if now_is == SEPARATION:
                first = g[i] if old != SEPARATION and g[i] > keep * u[i] else u[i]
                u[i] = keep * first + gone * product(flexibility, i, f) if not rigid else 0.0
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
        count_step(scene, contact, sum_N, abs(fastest), h)
        if contact != scene.contact:
            if enter(scene, scene.contact, contact, t):
                place = scene.sticks - 1
                sticks[place, 0], sticks[place, 1] = scene.last_stick, t
            scene.contact = contact
            if scene.settled_from < np.inf:
                scene.settle = first_counted(scene.settled_from, h, 0.5)
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
