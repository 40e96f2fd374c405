"""Compiled steps of `method="fast"`: impulses of the contact between exact moves of the kept modes.

One step is a Strang splitting of second order. In the middle of the step the gap is evaluated, the contact law
(`fivcore.contact.law`) gives the normal force N and the tangential force T, and the modal velocities change by the
step times the force. Then every mode moves freely and exactly over one step. Coordinates are deviations from the
static equilibrium under the unit load, so the impulse carries N - 1.

`advance` takes many scenes, each with numbers of its own: a record (`transient.fast_scene`) and blocks of modes.
Up to LANES of them go through a step together. First the contact law of all is solved at once: it has no branches,
so the compiler takes as many scenes as fit into a vector register; of a few scenes it takes one by one. Then each
scene moves its modes, several to a register. No number of a scene depends on another scene.

Rows of a block of modes have a fixed distance, so the compiler knows that they do not overlap. Sums over modes may
be reordered (`fivcore.jit.reordered`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.jit import contracted, inlined, kernel, reordered
from fivcore.transient import fast_scene as at
from fivcore.transient.statistics import SEPARATION, SLIP, STICK, clear, enter

_IN_STEP, _LAW = len(at.IN_STEP), len(at.STICK_LAW)
# Fewer scenes than this are not worth a vector.
FEW = 4
_STICK, _SLIP, _SEPARATION = float(STICK), float(SLIP), float(SEPARATION)
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
def solve_contacts(x: Any, lanes: Any) -> None:
    """Solve the contact in the present step of all scenes of a group, with all that is counted in every step.

    The compiler takes the lanes together because there are no branches: what a conditional expression chooses from
    has been read or computed before.
    """
    for g in range(lanes):
        mu, step, per_step, rigid = x.mu[g], x.step[g], x.per_step[g], x.rigid[g] != 0.0
        M_NN, M_NT, M_TT = x.M_NN[g], x.M_NT[g], x.M_TT[g]
        K_NN, K_NT, K_TT = x.K_NN[g], x.K_NT[g], x.K_TT[g]
        relax_NN, relax_NT, relax_TN, relax_TT = x.relax_NN[g], x.relax_NT[g], x.relax_TN[g], x.relax_TT[g]
        was, u_N, u_T, ramp, moving_rate = x.contact[g], x.u_N[g], x.u_T[g], x.ramp[g], x.moving_rate[g]
        stuck, apart = was == _STICK, was == _SEPARATION
        # The clamp.
        t = (x.now[g] + 0.5) * step
        started = x.acceleration[g] * t
        in_ramp = t < ramp
        speed = x.speed[g]
        drive = started if in_ramp else speed
        X = 0.5 * started * t if in_ramp else speed * (t - 0.5 * ramp)
        # Gaps before the impulse. The unit load's share of it comes first.
        p, gT = x.p_rest[g] - x.g_N[g], x.g_T[g] + (x.T_rest[g] - X)
        vN, vT = x.v_N[g] - (M_NN - moving_rate), x.v_T[g] - (M_NT + drive)
        # Without an element the gap of a lasting contact is rounding: only its force can end it.
        open_already = (p <= relax_NN * u_N + relax_NT * u_T) & (apart | (not rigid))
        # Stick.
        anchor = x.anchor[g]
        u = anchor - gT if stuck else u_T
        N = (x.Np[g] * p + x.Nn[g] * vN) + (x.Nt[g] * vT + x.Nu[g] * u)
        T = (x.Tp[g] * p + x.Tn[g] * vN) + (x.Tt[g] * vT + x.Tu[g] * u)
        # Between the middle of the step, where stick holds u_T, and its start, where slip begins.
        shift = x.offset[g] * (vT + M_NT * N + M_TT * T)
        sticks = (N > 0.0) & (abs(T) <= mu * N)
        # Slip.
        start = u + shift if stuck else u
        ahead = T > 0.0
        ahead_N = (x.ahead_Np[g] * p + x.ahead_Nn[g] * vN) + x.ahead_Nu[g] * start
        ahead_u = (x.ahead_up[g] * p + x.ahead_un[g] * vN) + x.ahead_uu[g] * start
        back_N = (x.back_Np[g] * p + x.back_Nn[g] * vN) + x.back_Nu[g] * start
        back_u = (x.back_up[g] * p + x.back_un[g] * vN) + x.back_uu[g] * start
        slip_N, slip_u = (ahead_N if ahead else back_N), (ahead_u if ahead else back_u)
        slip_T = mu * slip_N if ahead else -mu * slip_N
        closed = (sticks | (slip_N > 0.0)) & (not open_already)
        sticks = sticks & closed
        share = x.share[g]
        N = share * (N if sticks else slip_N) if closed else 0.0
        T = share * (T if sticks else slip_T) if closed else 0.0
        # The element after the step; in separation it relaxes.
        before = u_T if open_already else u if sticks else start
        before_N = u_N if open_already else p
        end_N = p if closed else relax_NN * before_N + relax_NT * before
        stuck_u = u if stuck else u - shift
        end_T = (stuck_u if sticks else slip_u) if closed else relax_TN * before_N + relax_TT * before
        mean_N, mean_T = vN + M_NN * N + M_NT * T, vT + M_NT * N + M_TT * T
        # The spring gives up what it holds. What it has taken over all steps of a contact is half its stiffness
        # times the last penetration times the one after it; nothing, where that is negative.
        held = u_N if apart else max(p, 0.0)
        released = K_NN * (u_N * held - end_N * end_N) + K_TT * (before * before - end_T * end_T)
        released += 2.0 * K_NT * (u_N * before - end_N * end_T)
        rate_T = -mean_T if sticks else (end_T - before) * per_step
        C_TT, C_slip = x.C_TT[g], x.C_slip[g]
        dashpot = C_TT if sticks else C_slip
        power = x.C_NN[g] * mean_N * mean_N - 2.0 * x.C_NT[g] * mean_N * rate_T + dashpot * rate_T * rate_T
        slip_rate = mean_T + rate_T if closed & (not rigid) else mean_T
        # Nothing moves in a rigid contact, so what work it takes is the landing's loss.
        landing = step * (N * mean_N + (T * mean_T if sticks else 0.0)) if closed & rigid else 0.0
        x.was[g], x.contact[g] = was, (_STICK if sticks else _SLIP) if closed else _SEPARATION
        x.N[g], x.T[g], x.slip_rate[g] = N, T, slip_rate
        x.u_N[g], x.u_T[g] = end_N, end_T
        x.anchor[g] = gT + end_T if sticks & (not stuck) else anchor
        x.termination[g] += step * power if closed else 0.5 * released
        x.impact[g] -= landing
        x.work[g] += step * (T * drive - N * moving_rate)
        x.friction[g] -= step * (T * slip_rate)
        x.sum_N[g] += step * N
        x.max_N[g], x.max_slip[g] = max(x.max_N[g], N), max(x.max_slip[g], abs(slip_rate))
        x.stick_time[g] += step if sticks else 0.0
        x.slip_time[g] += step if closed & (not sticks) else 0.0
        x.separation_time[g] += 0.0 if closed else step


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
    return listed


@inlined
def plan(x: Any, g: int, scene: Any) -> None:
    """Find the next step in which lane g is observed, and the one before which its scene leaves it."""
    x.next[g] = min(scene.next_sample, scene.next_row)
    until = min(scene.last, scene.next_skip)
    if scene.settle > scene.now:
        until = min(until, scene.settle)
    x.until[g] = scene.now if scene.stopped != 0 else until


@inlined
def choose_law(lanes: Any, g: int, numbers: Any, k: int, contact: int) -> None:
    """Put the law of stick after a contact state into lane g."""
    for i in range(_LAW):
        lanes[_IN_STEP + i, g] = numbers[k, _IN_STEP + _LAW * contact + i]


@kernel
def advance(
    order: Any, scenes: Any, numbers: Any, group: Any, lanes: Any, modes: Any, samples: Any, rows: Any, sticks: Any
) -> int:
    """Take every scene to the end of its segment or to where a skip is to be tried; return how many are to skip.

    `order` (m,) are the numbers of the scenes, records of `fast_scene.SCENE`; those to skip come first in it
    afterwards. `numbers` (any, any) is a view of the records, `group` (1,) a workspace of `fast_scene.GROUP` and
    `lanes` (any, LANES) a view of that. A scene says where its own part begins of `modes`, blocks in a row; of
    `samples` and `rows`, as in `record.Segment`; and of `sticks` (any, 2), begin and end.
    """
    x, turn = group[0], np.empty(at.LANES, dtype=np.int64)
    count, waiting, skips, leaving = 0, 0, 0, True
    while True:
        if leaving:
            # Scenes leave their lanes, and others enter.
            for g in range(count):
                k = turn[g]
                for i in range(_IN_STEP):
                    numbers[k, i] = lanes[i, g]
                scenes[k].now, scenes[k].contact = int(x.now[g]), int(x.contact[g])
            staying, seen = 0, 0
            while staying < at.LANES and (seen < count or waiting < len(order)):
                if seen < count:
                    k = turn[seen]
                    seen += 1
                else:
                    k = order[waiting]
                    waiting += 1
                scene = scenes[k]
                if scene.settle == scene.now:
                    clear(scene)
                if scene.stopped == 0 and scene.now < scene.last:
                    if scene.now < scene.next_skip:
                        turn[staying] = k
                        staying += 1
                    else:
                        order[skips] = k
                        skips += 1
            count = staying
            if count == 0:
                return skips
            lanes[:] = 0.0
            for g in range(count):
                k = turn[g]
                for i in range(_IN_STEP):
                    lanes[i, g] = numbers[k, i]
                scene = scenes[k]
                x.now[g], x.contact[g] = scene.now, scene.contact
                choose_law(lanes, g, numbers, k, scene.contact)
                plan(x, g, scene)
            leaving = False
        solve_contacts(x, np.uint64(count if count < FEW else at.LANES))
        for g in range(count):
            scene = scenes[turn[g]]
            N, T, slip_rate = x.N[g], x.T[g], x.slip_rate[g]
            impulse_N, impulse_T = x.step[g] * (N - 1.0), x.step[g] * T
            first, left = np.uint64(scene.modes_at), np.uint64(scene.modes)
            due, changed = x.next[g] <= x.now[g], x.contact[g] != x.was[g]
            if due or changed:
                scene.now, scene.contact = int(x.now[g]), int(x.contact[g])
                if changed:
                    if switch(scene, int(x.was[g])):
                        place = scene.sticks_at + scene.sticks - 1
                        sticks[place, 0], sticks[place, 1] = scene.last_stick, (scene.now + 0.5) * scene.step
                    choose_law(lanes, g, numbers, turn[g], scene.contact)
                if due:
                    speed, power = scene.B_N * impulse_N + scene.B_T * impulse_T, 0.0
                    for k in range(scene.blocks):
                        size = min(left - np.uint64(k) * _BLOCK, _BLOCK)
                        more, lost = observe(
                            modes, first + np.uint64(k) * _BLOCK_SIZE, size, 0.5 * impulse_N, 0.5 * impulse_T
                        )
                        speed, power = speed + more, power + lost
                    # Written here and not by a function: arrays that a function with branches takes are counted
                    # each time.
                    if scene.next_sample == scene.now:
                        place = scene.samples_at + scene.samples
                        samples[place, 0], samples[place, 1], samples[place, 2] = speed, slip_rate, N
                        samples[place, 3], samples[place, 4] = x.stick_time[g], x.separation_time[g]
                        samples[place, 5], samples[place, 6] = x.sum_N[g], scene.switches
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
                plan(x, g, scene)
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
                x.anchor[g] += byT + scene.rest_slide_T
                x.p_rest[g] -= scene.rest_slide_N
                x.T_rest[g] += scene.rest_slide_T
                x.moving_rate[g] = (byN + scene.rest_slide_N) * scene.per_step
            x.g_N[g], x.g_T[g], x.v_N[g], x.v_T[g] = gN, gT, vN, vT
            x.now[g] += 1.0
            leaving = leaving or x.now[g] >= x.until[g]
