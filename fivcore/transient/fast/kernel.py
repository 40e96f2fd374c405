"""Compiled steps of `method="fast"`: impulses of the contact between exact moves of the kept modes.

One step is a Strang splitting of second order. In the middle of the step the gap is evaluated, the contact law
(`fivcore.contact.law`) gives the normal force N and the tangential force T, and the modal velocities change by the
step times the force. Then every mode moves freely and exactly over one step. Coordinates are deviations from the
static equilibrium under the unit load, so the impulse carries N - 1.

The free move of a step does not wait for the contact law of that step: modes are stored without the last impulse,
whose effect on the gaps follows from three numbers. Modes that move only the normal gap are advanced before the
contact law and the others after it, so the processor has independent work while it solves the contact.

In rigid contact with few modes, steps are long compared with the time between events. When a contact status ends,
the time between the last impulse and this one is divided by linear interpolation (`locate`), so that event times
are of second order; the impulse also corrects the friction that acted for too long or too short a time.

Rows of a block of modes have a constant stride, so the compiler knows that they do not overlap. Sums over modes
may be reordered (`fivcore.jit.reordered`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.friction import friction_ratio, slip_speed
from fivcore.jit import called, contracted, inlined, kernel, reordered
from fivcore.transient.fast import layout
from fivcore.transient.fast.skip import skip
from fivcore.transient.statistics import SEPARATION, SLIP, STICK, clear, enter, first_counted

# Unsigned indices are not tested for counting from the end.
_A, _B, _C, _D, _NORMAL, _TANGENTIAL, _Q, _V, _OUTPUT, _DAMPING = (
    np.uint64(row * layout.BLOCK) for row in range(layout.BLOCK_ROWS)
)
_BLOCK_SIZE = np.uint64(layout.BLOCK_SIZE)


@reordered
def move(x: Any, first: Any, count: Any, impulse_N: float, impulse_T: float) -> Any:
    """Add the effect of the last impulse to some modes, and move them freely; return their gaps and rates."""
    gN, gT, vN, vT = 0.0, 0.0, 0.0, 0.0
    for j in range(first, first + count):
        normal, tangential = x[j + _NORMAL], x[j + _TANGENTIAL]
        push = normal * impulse_N + tangential * impulse_T
        q, v = x[j + _Q] + x[j + _B] * push, x[j + _V] + x[j + _D] * push
        y = x[j + _A] * q + x[j + _B] * v
        w = x[j + _C] * q + x[j + _D] * v
        x[j + _Q] = y
        x[j + _V] = w
        gN += normal * y
        gT += tangential * y
        vN += normal * w
        vT += tangential * w
    return gN, gT, vN, vT


@reordered
def move_normal(x: Any, first: Any, count: Any, impulse_N: float) -> Any:
    """Do the same with modes that move only the normal gap; return this gap and its rate."""
    gN, vN = 0.0, 0.0
    for j in range(first, first + count):
        normal = x[j + _NORMAL]
        push = normal * impulse_N
        q, v = x[j + _Q] + x[j + _B] * push, x[j + _V] + x[j + _D] * push
        y = x[j + _A] * q + x[j + _B] * v
        w = x[j + _C] * q + x[j + _D] * v
        x[j + _Q] = y
        x[j + _V] = w
        gN += normal * y
        vN += normal * w
    return gN, vN


@inlined
def block(k: int, size: int) -> Any:
    """Start of block k, and how many of the `size` places it holds."""
    return np.uint64(k) * _BLOCK_SIZE, np.uint64(min(size - k * layout.BLOCK, layout.BLOCK))


@inlined
def move_both(modes: Any, both: int, size: int, blocks: int, impulse_N: float, impulse_T: float) -> Any:
    """Move the first `both` places of the first block, and all other blocks."""
    gN, gT, vN, vT = move(modes, np.uint64(0), np.uint64(both), impulse_N, impulse_T)
    for k in range(1, blocks):
        first, count = block(k, size)
        more = move(modes, first, count, impulse_N, impulse_T)
        gN, gT, vN, vT = gN + more[0], gT + more[1], vN + more[2], vT + more[3]
    return gN, gT, vN, vT


@reordered
def finish(x: Any, first: Any, count: Any, impulse_N: float, impulse_T: float) -> None:
    """Add the effect of the last impulse to a block of modes."""
    for j in range(first, first + count):
        push = x[j + _NORMAL] * impulse_N + x[j + _TANGENTIAL] * impulse_T
        x[j + _Q] += x[j + _B] * push
        x[j + _V] += x[j + _D] * push


@reordered
def observe(x: Any, first: Any, count: Any, last_N: float, last_T: float) -> Any:
    """Velocity of B and dissipated power of a block of modes, both before the impulse.

    The last two numbers are the change of the power, to first order, for unit impulses in N and T.
    """
    speed, power, by_N, by_T = 0.0, 0.0, 0.0, 0.0
    for j in range(first, first + count):
        normal, tangential = x[j + _NORMAL], x[j + _TANGENTIAL]
        v = x[j + _V] + x[j + _D] * (normal * last_N + tangential * last_T)
        lost = x[j + _DAMPING] * v
        speed += x[j + _OUTPUT] * v
        power += lost * v
        by_N += lost * normal
        by_T += lost * tangential
    return speed, power, by_N, by_T


@kernel
def advance(
    scenes: Any, modes: Any, samples: Any, rows: Any, sticks: Any, tables: Any, work: Any, law: Any,
    tangent: Any,
) -> None:  # fmt: skip
    """Take a scene to the end of its segment.

    `scenes` (1,) is its record of `layout.SCENE` and `modes` its blocks in a row. `samples` (any, SAMPLE),
    `rows` (any, 6) and `sticks` (any, 2), start and end, are written as in `statistics.Segment`; `tables` and
    `work` are those of `skip.skip`. `law` is `Friction.law` if friction depends on the slip rate, otherwise ();
    each is compiled separately. `tangent` is () or a small deviation that follows a motion without skips and
    without rigid contact: its record (1,) of `layout.TANGENT` and its modes, as in `modes`.
    """
    scene = scenes[0]
    while scene.stopped == 0 and scene.now < scene.last:
        if scene.settle == scene.now:
            clear(scene)
        if scene.now >= scene.next_skip:
            skip(scene, modes, samples, rows, tables, work)
        else:
            take_steps(scene, modes, samples, rows, sticks, law, tangent)


@inlined
def pause(scene: Any, now: int) -> int:
    """Return the step before which the run must pause."""
    if scene.stopped != 0:
        return now
    until = min(scene.last, scene.next_skip)
    return min(until, scene.settle) if scene.settle > now else until


@contracted
def added(free: float, by_N: float, impulse_N: float, by_T: float, impulse_T: float) -> float:
    """Gap or rate with the effect of the last impulse, added in the same order as at a pause: no bit changes."""
    return free + (by_N * impulse_N + by_T * impulse_T)


@called
def falling(scene: Any, law: Any, p: float, u: float, vN: float, vT: float, way: float, last: float) -> Any:
    """Slip speed (negative without slip), N, T and the new u_T where friction depends on the slip speed.

    `u` is u_T at the start, `way` the sign of T, and `last` the slip rate in the step before.
    """
    s, mu = scene.slip, scene.mu
    alpha, beta, gamma = s[0] * p + s[1] * vN, s[2], s[3]
    free, mobility = vT - s[4] * u + s[5] / beta * alpha, s[6] + s[5] / beta * gamma
    v, ratio = slip_speed(-way * last, -way * free, mobility, alpha, beta, way * gamma, mu, law)
    m = way * mu * ratio
    N = alpha / (beta - gamma * m)
    T = m * N
    return v, N, T, s[7] * u + s[8] * N + s[9] * T


@called
def holding(scene: Any, vN: float, vT: float) -> Any:
    """N and T that hold a rigid contact: they cancel the change of the gap rates over the last free move."""
    law, less_N, less_T = scene.stick_law[np.uint64(STICK)], 0.5 * (vN - scene.after_N), 0.5 * (vT - scene.after_T)
    return law[2] * less_N + law[3] * less_T, law[6] * less_N + law[7] * less_T


@called
def going_on(scene: Any, law: Any, vN: float, vT: float, slip_rate: float) -> Any:
    """Slip speed and N of a rigid contact that continues to slip; a negative speed has passed zero."""
    way = np.sign(scene.last_T)
    if len(law) > 0:
        speed, N, _, _ = falling(scene, law, 0.0, 0.0, vN, vT, way, slip_rate)
        if speed >= 0.0:
            return speed, N
    m = way * scene.kinetic
    N = -vN / (scene.M[0] + m * scene.M[1])
    return -way * (vT + (scene.M[1] + m * scene.M[2]) * N), N


@called
def crossing(before: float, after: float) -> float:
    """Share of a step after which a linear function changes its sign; 1 if it does not."""
    return before / (before - after) if before * after < 0.0 else 1.0


@called
def locate(scene: Any, law: Any, was: int, p: float, N: float, vN: float, vT: float, slip_rate: float) -> float:
    """Fraction of the time from the last impulse to this one after which a rigid contact left the status `was`.

    The quantity whose zero ends the status is interpolated linearly: the penetration in separation; in stick N, or
    mu N - |T| of the holding forces, which are known midway between impulses; in slip N or the slip speed, which
    starts at `slip_rate`.
    """
    if was == SEPARATION:
        return crossing(scene.last_p, p)
    if was == STICK and N < 0.0:
        return crossing(scene.last_N, N)
    if was == STICK:
        hold_N, hold_T = holding(scene, vN, vT)
        left, before = scene.mu * hold_N - abs(hold_T), scene.last_left
        # T may be wrong by half its change per step, so that stick ends one step too early or too late.
        return min(max(before / (before - left) - 0.5, -0.5), 1.5) if before > left else 1.0
    speed, N = going_on(scene, law, vN, vT, slip_rate)
    return min(crossing(scene.last_N, N), crossing(-np.sign(scene.last_T) * slip_rate, speed))


@contracted
def respond(
    scene: Any, d: Any, law: Any, was: int, contact: int, met: bool, slip_rate: float, N: float, T: float
) -> None:  # fmt: skip
    """Linearised contact law of a step for a deviation `d`, on the branch that the motion takes.

    `was` and `contact` are the contact statuses before and after, `met` is true at a touchdown; slip rate, N and T
    are those of the motion.
    """
    maps, s, M = scene.stick_law[np.uint64(was)], scene.slip, scene.M
    by_q, by_v = scene.after_q, scene.after_v
    p = -added(d.g_N, by_q[0], d.impulse_N, by_q[1], d.impulse_T)
    gT = added(d.g_T, by_q[1], d.impulse_N, by_q[2], d.impulse_T)
    vN = added(d.v_N, by_v[0], d.impulse_N, by_v[1], d.impulse_T)
    vT = added(d.v_T, by_v[1], d.impulse_N, by_v[2], d.impulse_T)
    dN, dT, u, before, first = 0.0, 0.0, d.u_T, d.u_T, d.u_N
    if met:
        first, u = p, d.anchor - gT if was == STICK else u
        dN = maps[0] * p + maps[1] * u + maps[2] * vN + maps[3] * vT
        dT = maps[4] * p + maps[5] * u + maps[6] * vN + maps[7] * vT
        shift = maps[8] * (vT + M[1] * dN + M[2] * dT)
        before = u + shift if was == STICK else u
    if contact == STICK:
        d.u_N, d.u_T = p, u if was == STICK else u - shift
        d.anchor = gT + d.u_T
    elif contact == SLIP:
        # T = m N; if m depends on the slip speed, with the derivative of the equation for the speed (`falling`).
        m, dm = T / N, 0.0
        inverse, alpha = 1.0 / (s[2] - s[3] * m), s[0] * p + s[1] * vN
        if len(law) > 0:
            free, mobility = vT - s[4] * before + s[5] / s[2] * alpha, s[6] + s[5] / s[2] * s[3]
            slope = scene.mu * friction_ratio(abs(slip_rate), law[0], law[1], law[2])[1]
            dm = -slope * (free + mobility * m * inverse * alpha) / (1.0 + mobility * slope * N * s[2] * inverse)
        dN = inverse * (alpha + s[3] * N * dm)
        dT = m * dN + N * dm
        d.u_N, d.u_T = p, s[7] * before + s[8] * dN + s[9] * dT
    else:
        dN, dT = 0.0, 0.0
        d.u_N, d.u_T = s[7] * first, s[7] * before
    d.impulse_N, d.impulse_T = scene.step * dN, scene.step * dT


@contracted
def take_steps(scene: Any, modes: Any, samples: Any, rows: Any, sticks: Any, law: Any, tangent: Any) -> None:
    """Take a scene to its next pause."""
    mu, kinetic, step, rigid, ramp = scene.mu, scene.kinetic, scene.step, scene.rigid != 0, scene.ramp
    per_step, kept = 1.0 / step, scene.kinetic == mu and len(law) == 0
    stick_law, slip, decay = scene.stick_law, scene.slip, scene.slip[7]
    # Slip with T = mu N and with T = -mu N: N over alpha, and what N adds to u_T.
    forward_N, backward_N = 1.0 / (slip[2] - kinetic * slip[3]), 1.0 / (slip[2] + kinetic * slip[3])
    forward_u, backward_u = slip[8] + kinetic * slip[9], slip[8] - kinetic * slip[9]
    M_NN, M_NT, M_TT = scene.M[0], scene.M[1], scene.M[2]
    K_NN, K_NT, K_TT = scene.K[0], scene.K[1], scene.K[2]
    C_NN, C_NT, C_TT, C_slip = scene.C[0], scene.C[1], scene.C[2], scene.C[3]
    q_NN, q_NT, q_TT = scene.after_q[0], scene.after_q[1], scene.after_q[2]
    v_NN, v_NT, v_TT = scene.after_v[0], scene.after_v[1], scene.after_v[2]
    contact, u_N, u_T, anchor, slip_rate = scene.contact, scene.u_N, scene.u_T, scene.anchor, scene.slip_rate
    free_gN, free_gT, free_vN, free_vT = scene.g_N, scene.g_T, scene.v_N, scene.v_T
    impulse_N, impulse_T = 0.0, 0.0
    both, others, size, blocks = scene.both, scene.others, scene.modes, scene.blocks
    speed, power, power_N, power_T = 0.0, 0.0, 0.0, 0.0
    now = scene.now
    until, due = pause(scene, now), min(scene.next_sample, scene.next_row, scene.next_energy)
    while now < until:
        if now == due:
            speed, power, power_N, power_T = 0.0, 0.0, 0.0, 0.0
            for k in range(blocks):
                first, count = block(k, size)
                more = observe(modes, first, count, impulse_N, impulse_T)
                speed, power = speed + more[0], power + more[1]
                power_N, power_T = power_N + more[2], power_T + more[3]
        others_gN, others_vN = move_normal(modes, np.uint64(both), np.uint64(others), impulse_N)
        t = (now + 0.5) * step
        if t < ramp:
            drive = scene.acceleration * t
            X = 0.5 * drive * t
        else:
            drive = scene.speed
            X = drive * (t - 0.5 * ramp)
        # Gaps and their rates before the impulse. The unit load's share of it comes first.
        p = scene.p_rest - added(free_gN, q_NN, impulse_N, q_NT, impulse_T)
        gT = added(free_gT, q_NT, impulse_N, q_TT, impulse_T) + (scene.T_rest - X)
        vN = added(free_vN, v_NN, impulse_N, v_NT, impulse_T) - M_NN
        vT = added(free_vT, v_NT, impulse_N, v_TT, impulse_T) - (M_NT + drive)
        # The contact law.
        was = contact
        status = np.uint64(was)
        relaxed = decay * u_N
        closed, N, T = p > relaxed, 0.0, 0.0
        # In rigid contact the gap of a lasting contact is rounding: only its force can end it.
        closed = closed or (rigid and was != SEPARATION)
        before, end_N, end_T, met = u_T, relaxed, decay * u_T, closed
        stick_N, less_N, less_T, last_rate = 0.0, 0.0, 0.0, slip_rate
        if closed:
            u = anchor - gT if was == STICK else u_T
            N = (stick_law[status, 0] * p + stick_law[status, 2] * vN) + (
                stick_law[status, 3] * vT + stick_law[status, 1] * u
            )
            T = (stick_law[status, 4] * p + stick_law[status, 6] * vN) + (
                stick_law[status, 7] * vT + stick_law[status, 5] * u
            )
            closing, halts_N, halts_T = vN, 0.0, 0.0
            stick_N = N
            if rigid and was != STICK and not np.isnan(scene.after_T):
                # Where contact or stick begins, the gaps should not change over the free move that follows. The
                # rate after the impulse is therefore minus half the change over the last free move.
                rest_T = -0.25 * (vT + scene.after_T)
                if was == SEPARATION:
                    closing = 0.75 * vN - 0.25 * scene.after_N
                halts_N = stick_law[status, 2] * (closing - vN) + stick_law[status, 3] * rest_T
                halts_T = stick_law[status, 6] * (closing - vN) + stick_law[status, 7] * rest_T
                if was == SEPARATION:
                    N, T, halts_N, halts_T = N + halts_N, T + halts_T, 0.0, 0.0
            holds = N > 0.0 and abs(T) <= (mu if was == STICK else kinetic) * N
            if len(law) > 0 and holds and was != STICK:
                # If stick and slip are both possible, slip continues.
                holds = falling(scene, law, p, u, closing, vT, np.sign(T), slip_rate)[0] < 0.0
            forward = T > 0.0
            if rigid and was == SLIP and not np.isnan(scene.after_T):
                # Where slip passes zero the contact sticks if it can be held: the impulse also takes back what the
                # friction of the last step has done after that moment.
                hold_N, hold_T = holding(scene, vN, vT)
                passed = going_on(scene, law, vN, vT, slip_rate)[0] < 0.0
                holds = passed and N > 0.0 and abs(hold_T) <= mu * hold_N
                forward = (scene.last_T > 0.0) != passed
            if holds:
                contact, before, end_N, end_T = STICK, u, p, u
                within = was == SLIP or abs(T + halts_T) <= mu * (N + halts_N)
                if rigid and N + halts_N > 0.0 and within:
                    N, T = N + halts_N, T + halts_T
                    if was == SLIP:
                        less_N, less_T = N - hold_N, T - hold_T
            else:
                contact = SLIP
            if was != STICK or contact != STICK:
                # Between the middle of the step, where stick holds u_T, and its start, where slip begins.
                shift = stick_law[status, 8] * (vT + M_NT * N + M_TT * T)
                if contact == STICK:
                    end_T = u - shift
                    anchor = gT + end_T
                else:
                    before = u + shift if was == STICK else u
                    m, per_alpha = (kinetic, forward_N) if forward else (-kinetic, backward_N)
                    N = (slip[0] * p + slip[1] * closing) * per_alpha
                    if N > 0.0:
                        T, end_N = m * N, p
                        end_T = decay * before + (forward_u if forward else backward_u) * N
                        if len(law) > 0:
                            _, N, T, end_T = falling(scene, law, p, before, closing, vT, np.sign(m), slip_rate)
                        old_T = scene.last_T
                        if scene.lasting > 0.0 and (was == STICK or T * old_T < 0.0):
                            # Friction before the change, but no impact, for that part of the step or back from
                            # the last one.
                            share = locate(scene, law, was, p, stick_N, vN, vT, last_rate)
                            less_T = (share - 0.5) * (old_T - T)
                            # Where friction is constant no further than to where slip would turn and be driven.
                            rate, mobility = vT + M_NT * N + M_TT * T, M_TT - M_NT * M_NT / M_NN
                            if kept and m * (rate + mobility * less_T) > 0.0:
                                less_T = -rate / mobility
                            less_N = -M_NT / M_NN * less_T
                            if not N + less_N > 0.0:
                                less_N, less_T = 0.0, 0.0
                            N, T = N + less_N, T + less_T
                    else:
                        closed, N, T = False, 0.0, 0.0
                        end_N, end_T = decay * p, decay * before
        last_N, last_T = impulse_N, impulse_T
        impulse_N, impulse_T = step * (N - 1.0), step * T
        free_gN, free_gT, free_vN, free_vT = move_both(modes, both, size, blocks, last_N, last_T)
        free_gN, free_vN = free_gN + others_gN, free_vN + others_vN
        mean_N, mean_T = vN + M_NN * N + M_NT * T, vT + M_NT * N + M_TT * T
        slip_rate = mean_T
        if not closed:
            contact = SEPARATION
            # The spring releases its energy. What it has taken over all steps of a contact is half its
            # stiffness times the last penetration times the one after it; nothing, where that is negative.
            held = u_N if was == SEPARATION else max(p, 0.0)
            released = K_NN * (u_N * held - end_N * end_N) + K_TT * (before * before - end_T * end_T)
            scene.termination += 0.5 * released + K_NT * (u_N * before - end_N * end_T)
            scene.separation_time += step
        else:
            if contact == STICK:
                rate_T, dashpot = -mean_T, C_TT
                scene.stick_time += step
            else:
                rate_T, dashpot = (end_T - before) * per_step, C_slip
                scene.slip_time += step
            if rigid:
                # Nothing moves in a rigid contact: what work it takes is the loss of an impact.
                scene.impact -= step * (N * mean_N + (T * mean_T if contact == STICK else 0.0))
            else:
                slip_rate = mean_T + rate_T
            lost = C_NN * mean_N * mean_N - 2.0 * C_NT * mean_N * rate_T + dashpot * rate_T * rate_T
            scene.termination += step * lost
            scene.work += step * (T * drive)
            if contact == SLIP:
                scene.friction -= step * (T * slip_rate)
            scene.sum_N += step * N
            scene.max_N = max(scene.max_N, N)
        scene.max_slip = max(scene.max_slip, abs(slip_rate))
        u_N, u_T = end_N, end_T
        if contact != was:
            if rigid:
                # Between the last impulse and this one, whose time counts half for either status so far.
                share = locate(scene, law, was, p, stick_N, vN, vT, last_rate)
                t += (share - 1.0) * step
                longer = (share - 0.5) * step if scene.settle != now else 0.0
                scene.stick_time += longer * (int(was == STICK) - int(contact == STICK))
                scene.slip_time += longer * (int(was == SLIP) - int(contact == SLIP))
                scene.separation_time += longer * (int(was == SEPARATION) - int(contact == SEPARATION))
            if enter(scene, was, contact, t):
                place = scene.sticks - 1
                sticks[place, 0], sticks[place, 1] = scene.last_stick, t
            if contact == SEPARATION and scene.until_open != 0:
                scene.stopped = 1
            scene.settle = first_counted(scene.settled_from, step, 0.5)
            scene.next_skip = layout.NEVER
            if contact == STICK and scene.may_skip != 0:
                scene.next_skip = scene.next_sample + layout.MIN_SAMPLES * scene.sample_every
            until = pause(scene, now)
        if rigid:
            scene.lasting = 1.0 if closed and was != SEPARATION and not np.isnan(scene.last_p) else 0.0
            hold_N, hold_T = holding(scene, vN, vT)
            scene.last_left = mu * hold_N - abs(hold_T) if was == STICK else np.nan
            scene.last_T = T - less_T
            scene.after_N, scene.after_T = 2.0 * mean_N - vN, 2.0 * mean_T - vT
            scene.last_p, scene.last_N = p, N
        if now == due:
            speed += scene.output[0] * impulse_N + scene.output[1] * impulse_T
            power += (power_N + scene.damped_by[0] * impulse_N) * impulse_N
            power += (power_T + scene.damped_by[1] * impulse_N + scene.damped_by[2] * impulse_T) * impulse_T
            if scene.next_sample == now:
                place = scene.samples
                samples[place, 0], samples[place, 1], samples[place, 2] = speed, slip_rate, N
                samples[place, 3], samples[place, 4] = scene.stick_time, scene.separation_time
                samples[place, 5], samples[place, 6] = scene.sum_N, scene.switches
                scene.samples += 1
                scene.next_sample += scene.sample_every
                if scene.threshold < np.inf and (contact != STICK or abs(T) > scene.threshold * N):
                    scene.stopped = 1
                    until = now
            if scene.next_energy == now:
                scene.damped += scene.energy_every * step * power
                scene.next_energy += scene.energy_every
            if scene.next_row == now:
                place = scene.rows
                rows[place, 0], rows[place, 1], rows[place, 2] = (now + 0.5) * step, speed, N - less_N
                rows[place, 3], rows[place, 4], rows[place, 5] = T - less_T, slip_rate, contact
                scene.rows += 1
                scene.next_row += scene.row_every
            due = min(scene.next_sample, scene.next_row, scene.next_energy)
        if len(tangent) > 0:
            d = tangent[0][0]
            last_N, last_T = d.impulse_N, d.impulse_T
            respond(scene, d, law, was, contact, met, slip_rate, N, T)
            others_gN, others_vN = move_normal(tangent[1], np.uint64(both), np.uint64(others), last_N)
            gN, d.g_T, vN, d.v_T = move_both(tangent[1], both, size, blocks, last_N, last_T)
            d.g_N, d.v_N = gN + others_gN, vN + others_vN
        now += 1
    for k in range(blocks):
        first, count = block(k, size)
        finish(modes, first, count, impulse_N, impulse_T)
    scene.now, scene.contact, scene.u_N, scene.u_T, scene.anchor = now, contact, u_N, u_T, anchor
    scene.slip_rate = slip_rate
    scene.g_N = added(free_gN, q_NN, impulse_N, q_NT, impulse_T)
    scene.g_T = added(free_gT, q_NT, impulse_N, q_TT, impulse_T)
    scene.v_N = added(free_vN, v_NN, impulse_N, v_NT, impulse_T)
    scene.v_T = added(free_vT, v_NT, impulse_N, v_TT, impulse_T)
