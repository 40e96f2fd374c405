"""Compiled steps of `method="fast"`: impulses of the contact between exact moves of the kept modes.

One step is a Strang splitting of second order. In the middle of the step the gap is evaluated, the contact law
(`fivcore.contact.law`) gives the normal force N and the tangential force T, and the modal velocities change by the
step times the force. Then every mode moves freely and exactly over one step. Coordinates are deviations from the
static equilibrium under the unit load, so the impulse carries N - 1.

`advance` takes many scenes, each with numbers of its own: a record (`transient.fast_scene`) and blocks of modes.
It works on GROUP of them in turns, one step each: while the processor waits for the contact law of one scene it
moves the modes of the others. No number of a scene depends on another scene.

The modes of a scene lie in blocks of BLOCK modes. Rows of a block have a fixed distance, so the compiler knows
that they do not overlap and uses vector registers. Sums over modes may be reordered (`fivcore.jit.reordered`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.jit import contracted, inlined, kernel, reordered
from fivcore.transient import fast_scene as at
from fivcore.transient.statistics import SEPARATION, SLIP, STICK, clear, count_step, enter

# Scenes that are worked on in turns.
GROUP = 2
# Unsigned numbers are no candidates for an index from the end.
_A, _B, _C, _D = (np.uint64(row * at.BLOCK) for row in (at.A, at.B, at.C, at.D))
_NORMAL, _TANGENTIAL = (np.uint64(row * at.BLOCK) for row in (at.NORMAL, at.TANGENTIAL))
_Q, _V, _POINT_B, _DAMPING = (np.uint64(row * at.BLOCK) for row in (at.Q, at.V, at.POINT_B, at.DAMPING))
_SLIDE_N, _SLIDE_T = (np.uint64(row * at.BLOCK) for row in (at.SLIDE_N, at.SLIDE_T))
_BLOCK, _BLOCK_SIZE = np.uint64(at.BLOCK), np.uint64(at.BLOCK_SIZE)


@reordered
def apply_impulse(x: Any, first: Any, count: Any, impulse_N: float, impulse_T: float) -> Any:
    """Give a block of modes an impulse, move it freely over a step; what it adds to g_N, g_T and their rates."""
    gN, gT, vN, vT = 0.0, 0.0, 0.0, 0.0
    for j in range(first, first + count):
        normal, tangential, q = x[j + _NORMAL], x[j + _TANGENTIAL], x[j + _Q]
        rate = x[j + _V] + normal * impulse_N + tangential * impulse_T
        y = x[j + _A] * q + x[j + _B] * rate
        w = x[j + _C] * q + x[j + _D] * rate
        x[j + _Q] = y
        x[j + _V] = w
        gN += normal * y
        gT += tangential * y
        vN += normal * w
        vT += tangential * w
    return gN, gT, vN, vT


@reordered
def observe(x: Any, first: Any, count: Any, half_N: float, half_T: float) -> Any:
    """Velocity of B before the impulse, and the power that a block of modes loses in the middle of it."""
    speed, power = 0.0, 0.0
    for j in range(first, first + count):
        speed += x[j + _POINT_B] * x[j + _V]
        rate = x[j + _V] + x[j + _NORMAL] * half_N + x[j + _TANGENTIAL] * half_T
        power += x[j + _DAMPING] * rate * rate
    return speed, power


@reordered
def follow_shapes(x: Any, first: Any, count: Any) -> Any:
    """Gap shapes of the next step, and by how much the gaps and their rates change with them alone."""
    gN, gT, vN, vT = 0.0, 0.0, 0.0, 0.0
    for j in range(first, first + count):
        normal, tangential, q, v = x[j + _SLIDE_N], x[j + _SLIDE_T], x[j + _Q], x[j + _V]
        x[j + _NORMAL] += normal
        x[j + _TANGENTIAL] += tangential
        gN += normal * q
        gT += tangential * q
        vN += normal * v
        vT += tangential * v
    return gN, gT, vN, vT


@contracted
def solve_contact(scene: Any, p: float, gT: float, vN: float, vT: float) -> Any:
    """Contact state, N, T, the element's state after the step, and u_T at the start of the regime of the step.

    p, gT, vN, vT are penetration, g_T and the rates of the gaps before the impulse.
    """
    was, uN, u = scene.contact, scene.u_N, scene.u_T
    left = scene.relax_NN * uN + scene.relax_NT * u
    # Without an element the gap of a lasting contact is rounding: only its force can end it.
    if p <= left and (was == SEPARATION or scene.rigid == 0):
        return SEPARATION, 0.0, 0.0, left, scene.relax_TN * uN + scene.relax_TT * u, u
    share, offset = 1.0, scene.enter_offset
    if was == STICK:
        u = scene.anchor - gT
        N = scene.stick_Np * p + scene.stick_Nu * u + scene.stick_Nn * vN + scene.stick_Nt * vT
        T = scene.stick_Tp * p + scene.stick_Tu * u + scene.stick_Tn * vN + scene.stick_Tt * vT
    elif was == SLIP:
        N = scene.enter_Np * p + scene.enter_Nu * u + scene.enter_Nn * vN + scene.enter_Nt * vT
        T = scene.enter_Tp * p + scene.enter_Tu * u + scene.enter_Tn * vN + scene.enter_Tt * vT
    else:
        N = scene.land_Np * p + scene.land_Nu * u + scene.land_Nn * vN + scene.land_Nt * vT
        T = scene.land_Tp * p + scene.land_Tu * u + scene.land_Tn * vN + scene.land_Tt * vT
        # A landing on a rigid contact takes part of the force of a lasting one.
        share, offset = scene.landing_share, scene.land_offset
    mu = scene.mu
    # Between the middle of the step, where stick holds u_T, and its start, where slip begins.
    shift = offset * (vT + scene.M_NT * N + scene.M_TT * T)
    if N > 0.0 and abs(T) <= mu * N:
        return STICK, share * N, share * T, p, u if was == STICK else u - shift, u
    start = u + shift if was == STICK else u
    if T > 0.0:
        N = scene.ahead_Np * p + scene.ahead_Nu * start + scene.ahead_Nn * vN
        end = scene.ahead_up * p + scene.ahead_uu * start + scene.ahead_un * vN
    else:
        N = scene.back_Np * p + scene.back_Nu * start + scene.back_Nn * vN
        end = scene.back_up * p + scene.back_uu * start + scene.back_un * vN
        mu = -mu
    if N > 0.0:
        N *= share
        return SLIP, N, mu * N, p, end, start
    endN, endT = scene.relax_NN * p + scene.relax_NT * start, scene.relax_TN * p + scene.relax_TT * start
    return SEPARATION, 0.0, 0.0, endN, endT, start


@contracted
def apply_contact(scene: Any) -> Any:
    """N, T and slip rate in a scene's present step, with all that is counted in every step."""
    step, was = scene.step, scene.contact
    t = (scene.now + 0.5) * step
    if t < scene.ramp:
        drive = scene.acceleration * t
        X = 0.5 * drive * t
    else:
        drive, X = scene.speed, scene.speed * (t - 0.5 * scene.ramp)
    # The unit load's share of the impulse comes first.
    vN = scene.v_N - (scene.M_NN - scene.moving_rate)
    vT = scene.v_T - (scene.M_NT + drive)
    gT = scene.g_T + (scene.T_rest - X)
    p = scene.p_rest - scene.g_N
    wasN = scene.u_N
    contact, N, T, newN, newT, before = solve_contact(scene, p, gT, vN, vT)
    scene.u_N, scene.u_T = newN, newT
    meanN = vN + scene.M_NN * N + scene.M_NT * T
    meanT = vT + scene.M_NT * N + scene.M_TT * T
    slip_rate = meanT
    if contact == SEPARATION:
        # The spring gives up what it holds. What it has taken over all steps of a contact is half its stiffness
        # times the last penetration times the one after it; nothing, where that is negative.
        held = wasN if was == SEPARATION else max(p, 0.0)
        released = scene.K_NN * (wasN * held - newN * newN) + scene.K_TT * (before * before - newT * newT)
        released += 2.0 * scene.K_NT * (wasN * before - newN * newT)
        scene.termination += 0.5 * released
    else:
        dashpot, rateT = scene.C_TT, -meanT
        if contact == SLIP:
            dashpot, rateT = scene.C_slip, (newT - before) * scene.per_step
        power = scene.C_NN * meanN * meanN - 2.0 * scene.C_NT * meanN * rateT + dashpot * rateT * rateT
        scene.termination += step * power
        if scene.rigid != 0:
            # Nothing moves in the element, so what work the contact takes is the landing's loss.
            scene.impact -= step * (N * meanN + (T * meanT if contact == STICK else 0.0))
        else:
            slip_rate += rateT
    scene.work += step * (T * drive - N * scene.moving_rate)
    scene.friction -= step * (T * slip_rate)
    count_step(scene, contact, N, abs(slip_rate), step)
    scene.contact = contact
    if contact == STICK and was != STICK:
        scene.anchor = gT + newT
    return N, T, slip_rate


@inlined
def switch(scene: Any, was: int) -> bool:
    """Count a change of the contact state, and what follows from it for the steps to come; see `enter`."""
    contact = scene.contact
    listed = enter(scene, was, contact, (scene.now + 0.5) * scene.step)
    scene.next_skip = at.NEVER
    if contact == STICK and scene.skip_at >= 0:
        scene.next_skip = scene.next_sample + at.MIN_SAMPLES * scene.sample_every
    elif contact == SEPARATION and scene.until_open != 0:
        scene.stopped = 1
    if scene.settled_from < np.inf:
        scene.settle = int(np.ceil(scene.settled_from * scene.per_step - 0.5))
    plan(scene)
    return listed


@inlined
def plan(scene: Any) -> None:
    """Find the next step at which anything but a plain step happens."""
    following = min(scene.next_sample, scene.next_row, scene.next_skip, scene.last)
    if scene.settle > scene.now:
        following = min(following, scene.settle)
    scene.next = scene.now + 1 if scene.stopped != 0 else following


@kernel
def advance(order: Any, scenes: Any, modes: Any, samples: Any, rows: Any, sticks: Any) -> int:
    """Take every scene to the end of its segment or to where a skip is to be tried; return how many are to skip.

    `order` (m,) are the numbers of the scenes, records of `fast_scene.SCENE`; those to skip come first in it
    afterwards. A scene says where its own part
    begins of `modes`, blocks in a row; of `samples` (any, 3), velocity of B, slip rate and N; of `rows` (any, 6),
    time, velocity of B, N, T, slip rate and contact state; and of `sticks` (any, 2), begin and end.
    """
    turn = np.empty(GROUP, dtype=np.int64)
    count, waiting, skips = 0, 0, 0
    while count < GROUP and waiting < len(order):
        turn[count] = order[waiting]
        count, waiting = count + 1, waiting + 1
    while count > 0:
        g = 0
        while g < count:
            scene = scenes[turn[g]]
            due = scene.next <= scene.now
            if due:
                if scene.settle == scene.now:
                    clear(scene)
                if scene.stopped != 0 or scene.now >= min(scene.last, scene.next_skip):
                    if scene.stopped == 0 and scene.now < scene.last:
                        order[skips] = turn[g]
                        skips += 1
                    if waiting < len(order):
                        turn[g] = order[waiting]
                        waiting += 1
                    else:
                        count -= 1
                        turn[g] = turn[count]
                    continue
            was = scene.contact
            N, T, slip_rate = apply_contact(scene)
            if scene.contact != was and switch(scene, was):
                place = scene.sticks_at + scene.sticks - 1
                sticks[place, 0], sticks[place, 1] = scene.last_stick, (scene.now + 0.5) * scene.step
            impulse_N, impulse_T = scene.step * (N - 1.0), scene.step * T
            first, left = np.uint64(scene.modes_at), np.uint64(scene.modes)
            if due:
                speed, power = scene.B_N * impulse_N + scene.B_T * impulse_T, 0.0
                for k in range(scene.blocks):
                    size = min(left - np.uint64(k) * _BLOCK, _BLOCK)
                    more, lost = observe(
                        modes, first + np.uint64(k) * _BLOCK_SIZE, size, 0.5 * impulse_N, 0.5 * impulse_T
                    )
                    speed, power = speed + more, power + lost
                # Written here and not by a function: arrays that a function with branches takes are counted each
                # time.
                if scene.next_sample == scene.now:
                    place = scene.samples_at + scene.samples
                    samples[place, 0], samples[place, 1], samples[place, 2] = speed, slip_rate, N
                    scene.samples += 1
                    scene.next_sample += scene.sample_every
                    scene.damped += scene.sample_every * scene.step * power
                    if scene.threshold < np.inf and (scene.contact != STICK or abs(T) > scene.threshold * N):
                        scene.stopped = 1
                if scene.next_row == scene.now:
                    place = scene.rows_at + scene.rows
                    rows[place, 0], rows[place, 1], rows[place, 2] = (scene.now + 0.5) * scene.step, speed, N
                    rows[place, 3], rows[place, 4], rows[place, 5] = T, slip_rate, scene.contact
                    scene.rows += 1
                    scene.next_row += scene.row_every
                plan(scene)
            gN, gT, vN, vT = apply_impulse(modes, first, min(left, _BLOCK), impulse_N, impulse_T)
            for k in range(1, scene.blocks):
                size = min(left - np.uint64(k) * _BLOCK, _BLOCK)
                a, b, c, d = apply_impulse(modes, first + np.uint64(k) * _BLOCK_SIZE, size, impulse_N, impulse_T)
                gN, gT, vN, vT = gN + a, gT + b, vN + c, vT + d
            if scene.moving != 0:
                byN, byT = 0.0, 0.0
                for k in range(scene.blocks):
                    size = min(left - np.uint64(k) * _BLOCK, _BLOCK)
                    a, b, c, d = follow_shapes(modes, first + np.uint64(k) * _BLOCK_SIZE, size)
                    byN, byT, vN, vT = byN + a, byT + b, vN + c, vT + d
                gN, gT = gN + byN, gT + byT
                # What sticks does not slide over P2.
                scene.anchor += byT + scene.rest_slide_T
                scene.p_rest -= scene.rest_slide_N
                scene.T_rest += scene.rest_slide_T
                scene.moving_rate = (byN + scene.rest_slide_N) * scene.per_step
            scene.g_N, scene.g_T, scene.v_N, scene.v_T = gN, gT, vN, vT
            scene.now += 1
            g += 1
    return skips
