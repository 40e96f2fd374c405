"""Compiled steps of `method="fast"`: impulses of the contact between exact moves of the kept modes.

One step is a Strang splitting of second order. In the middle of the step the gap is evaluated, the contact law
(`fivcore.contact.law`) gives the normal force N and the tangential force T, and the modal velocities change by the
step times the force. Then every mode moves freely and exactly over one step. Coordinates are deviations from the
static equilibrium under the unit load, so the impulse carries N - 1.

`advance` takes many scenes, each with numbers of its own: a record (`transient.fast_scene`) and blocks of modes.
Up to LANES of them go through a step together. First the contact law of all is solved at once: it has no branches,
so the compiler takes as many scenes as fit into a vector register; of a few scenes it takes one by one. Then each
scene moves its modes, several to a register. No number of a scene depends on another scene. A change of the
contact state comes at no regular time, and a branch that is not foreseen costs as much as a step: what
follows from every change is chosen and counted without one.

Rows of a block of modes have a fixed distance, so the compiler knows that they do not overlap. Sums over modes may
be reordered (`fivcore.jit.reordered`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.jit import contracted, inlined, kernel, reordered
from fivcore.transient import fast_scene as at
from fivcore.transient.statistics import SEPARATION, SLIP, STICK, clear, enter
from fivcore.transient.stick_skip import skip

_IN_STEP = len(at.IN_STEP)
# Fewer scenes than this are not worth a vector.
FEW = 4
_STICK, _SLIP, _SEPARATION = float(STICK), float(SLIP), float(SEPARATION)
# Unsigned numbers are no candidates for an index from the end.
_A, _B, _C, _D = (np.uint64(row * at.BLOCK) for row in (at.A, at.B, at.C, at.D))
_NORMAL, _TANGENTIAL = (np.uint64(row * at.BLOCK) for row in (at.NORMAL, at.TANGENTIAL))
_Q, _V, _POINT_B, _DAMPING = (np.uint64(row * at.BLOCK) for row in (at.Q, at.V, at.POINT_B, at.DAMPING))
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
        was, u_N, u_T, ramp = x.contact[g], x.u_N[g], x.u_T[g], x.ramp[g]
        stuck, apart = was == _STICK, was == _SEPARATION
        # The law of stick after this state.
        Np_0, Nu_0, Nn_0, Nt_0 = x.Np_0[g], x.Nu_0[g], x.Nn_0[g], x.Nt_0[g]
        Np_1, Nu_1, Nn_1, Nt_1 = x.Np_1[g], x.Nu_1[g], x.Nn_1[g], x.Nt_1[g]
        Np_2, Nu_2, Nn_2, Nt_2 = x.Np_2[g], x.Nu_2[g], x.Nn_2[g], x.Nt_2[g]
        Tp_0, Tu_0, Tn_0, Tt_0 = x.Tp_0[g], x.Tu_0[g], x.Tn_0[g], x.Tt_0[g]
        Tp_1, Tu_1, Tn_1, Tt_1 = x.Tp_1[g], x.Tu_1[g], x.Tn_1[g], x.Tt_1[g]
        Tp_2, Tu_2, Tn_2, Tt_2 = x.Tp_2[g], x.Tu_2[g], x.Tn_2[g], x.Tt_2[g]
        offset_0, offset_1, offset_2 = x.offset_0[g], x.offset_1[g], x.offset_2[g]
        share_0, share_1, share_2 = x.share_0[g], x.share_1[g], x.share_2[g]
        Np = Np_1 if stuck else Np_0 if apart else Np_2
        Nu = Nu_1 if stuck else Nu_0 if apart else Nu_2
        Nn = Nn_1 if stuck else Nn_0 if apart else Nn_2
        Nt = Nt_1 if stuck else Nt_0 if apart else Nt_2
        Tp = Tp_1 if stuck else Tp_0 if apart else Tp_2
        Tu = Tu_1 if stuck else Tu_0 if apart else Tu_2
        Tn = Tn_1 if stuck else Tn_0 if apart else Tn_2
        Tt = Tt_1 if stuck else Tt_0 if apart else Tt_2
        offset = offset_1 if stuck else offset_0 if apart else offset_2
        share = share_1 if stuck else share_0 if apart else share_2
        # The clamp.
        t = (x.now[g] + 0.5) * step
        started = x.acceleration[g] * t
        in_ramp = t < ramp
        speed = x.speed[g]
        drive = started if in_ramp else speed
        X = 0.5 * started * t if in_ramp else speed * (t - 0.5 * ramp)
        # Gaps before the impulse. The unit load's share of it comes first.
        p, gT = x.p_rest[g] - x.g_N[g], x.g_T[g] + (x.T_rest[g] - X)
        vN, vT = x.v_N[g] - M_NN, x.v_T[g] - (M_NT + drive)
        # Without an element the gap of a lasting contact is rounding: only its force can end it.
        open_already = (p <= relax_NN * u_N + relax_NT * u_T) & (apart | (not rigid))
        # Stick.
        anchor = x.anchor[g]
        u = anchor - gT if stuck else u_T
        N = (Np * p + Nn * vN) + (Nt * vT + Nu * u)
        T = (Tp * p + Tn * vN) + (Tt * vT + Tu * u)
        # Between the middle of the step, where stick holds u_T, and its start, where slip begins.
        shift = offset * (vT + M_NT * N + M_TT * T)
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
        contact = (_STICK if sticks else _SLIP) if closed else _SEPARATION
        now, begun, changed_in, least_stick = x.now[g], x.stick_start[g], x.changed_in[g], x.least_stick[g]
        changed, slipped, awaits_open = contact != was, x.slipped[g] != 0.0, x.awaits_open[g] != 0.0
        ends = stuck & (t - begun >= least_stick)
        first = (closed & (not sticks) & (not slipped)) | ((not closed) & awaits_open)
        x.notable[g] = 1.0 if changed & (ends | first) else 0.0
        x.was[g], x.begun[g], x.contact[g] = was, begun, contact
        x.changed_in[g] = now if changed else changed_in
        x.switches[g] += 1.0 if changed else 0.0
        x.stick_start[g] = (t if sticks & slipped else np.nan) if changed else begun
        x.N[g], x.T[g], x.slip_rate[g] = N, T, slip_rate
        x.u_N[g], x.u_T[g] = end_N, end_T
        x.anchor[g] = gT + end_T if sticks & (not stuck) else anchor
        x.termination[g] += step * power if closed else 0.5 * released
        x.impact[g] -= landing
        x.work[g] += step * (T * drive)
        x.friction[g] -= step * (T * slip_rate)
        x.sum_N[g] += step * N
        x.max_N[g], x.max_slip[g] = max(x.max_N[g], N), max(x.max_slip[g], abs(slip_rate))
        x.stick_time[g] += step if sticks else 0.0
        x.slip_time[g] += step if closed & (not sticks) else 0.0
        x.separation_time[g] += 0.0 if closed else step


@inlined
def note(x: Any, g: int, scene: Any) -> bool:
    """Note what follows from the change of state in lane g; return whether it has ended a long stick to list."""
    was, contact = int(x.was[g]), int(x.contact[g])
    scene.stick_start = x.begun[g]
    listed = enter(scene, was, contact, (scene.now + 0.5) * scene.step)
    if contact == SEPARATION and scene.until_open != 0:
        scene.stopped = 1
    if scene.settled_from < np.inf:
        scene.settle = int(np.ceil(scene.settled_from * scene.per_step - 0.5))
    return listed


@inlined
def await_skip(scene: Any) -> None:
    """Find out when a skip is to be tried, where the contact state has changed."""
    if scene.changed_in >= 0.0:
        begun, every = int(scene.changed_in), scene.sample_every
        waits = scene.contact == STICK and scene.skip_at >= 0
        scene.next_skip = ((begun + every - 1) // every + at.MIN_SAMPLES) * every if waits else at.NEVER
        scene.changed_in = -1.0


@inlined
def plan(x: Any, g: int, scene: Any) -> None:
    """Find in which step lane g is observed next, before which its scene leaves it, and what is notable in it."""
    x.slipped[g] = 1.0 if scene.first_slip < np.inf else 0.0
    x.awaits_open[g] = 0.0 if scene.first_separation < np.inf and scene.until_open == 0 else 1.0
    x.least_stick[g] = scene.least_stick
    x.next[g] = min(scene.next_sample, scene.next_row)
    until = min(scene.last, scene.next_skip)
    if scene.settle > scene.now:
        until = min(until, scene.settle)
    x.until[g] = scene.now if scene.stopped != 0 else until


@kernel
def take_steps(turn: Any, scenes: Any, group: Any, modes: Any, samples: Any, rows: Any, sticks: Any) -> None:
    """Take the scenes whose numbers are in `turn` (n,), each in its lane, to where the first is to leave it."""
    x, count = group[0], len(turn)
    # Where the modes of a lane begin, and how many its first block has.
    firsts, sizes = np.empty(at.LANES, dtype=np.uint64), np.empty(at.LANES, dtype=np.uint64)
    # Whether a lane has further blocks.
    further = False
    for g in range(count):
        scene = scenes[turn[g]]
        firsts[g], sizes[g] = np.uint64(scene.modes_at), min(np.uint64(scene.modes), _BLOCK)
        further = further or scene.blocks > 1
    # Steps before a lane is observed or left.
    quiet = 0.0
    while True:
        solve_contacts(x, np.uint64(count if count < FEW else at.LANES))
        for g in range(count):
            if x.notable[g] != 0.0:
                scene = scenes[turn[g]]
                scene.now = int(x.now[g])
                if note(x, g, scene):
                    place = scene.sticks_at + scene.sticks - 1
                    sticks[place, 0], sticks[place, 1] = scene.last_stick, (scene.now + 0.5) * scene.step
                plan(x, g, scene)
                quiet = min(quiet, x.until[g] - x.now[g])
        if quiet <= 0.0:
            quiet = np.inf
            for g in range(count):
                if x.next[g] <= x.now[g]:
                    scene = scenes[turn[g]]
                    scene.now, scene.contact, scene.changed_in = int(x.now[g]), int(x.contact[g]), x.changed_in[g]
                    await_skip(scene)
                    x.changed_in[g] = -1.0
                    N, T, slip_rate = x.N[g], x.T[g], x.slip_rate[g]
                    impulse_N, impulse_T = x.step[g] * (N - 1.0), x.step[g] * T
                    speed, power = scene.B_N * impulse_N + scene.B_T * impulse_T, 0.0
                    first, left = firsts[g], np.uint64(scene.modes)
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
                        samples[place, 5], samples[place, 6] = x.sum_N[g], x.switches[g]
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
                quiet = min(quiet, min(x.next[g], x.until[g]) - x.now[g])
        for g in range(count):
            impulse_N, impulse_T = x.step[g] * (x.N[g] - 1.0), x.step[g] * x.T[g]
            gN, gT, vN, vT = apply_impulse(modes, firsts[g], sizes[g], impulse_N, impulse_T)
            x.g_N[g], x.g_T[g], x.v_N[g], x.v_T[g] = gN, gT, vN, vT
        if further:
            for g in range(count):
                scene = scenes[turn[g]]
                impulse_N, impulse_T = x.step[g] * (x.N[g] - 1.0), x.step[g] * x.T[g]
                first, left = firsts[g], np.uint64(scene.modes)
                for k in range(1, scene.blocks):
                    size = min(left - np.uint64(k) * _BLOCK, _BLOCK)
                    a, b, c, d = apply_impulse(
                        modes, first + np.uint64(k) * _BLOCK_SIZE, size, impulse_N, impulse_T
                    )
                    x.g_N[g], x.g_T[g], x.v_N[g], x.v_T[g] = x.g_N[g] + a, x.g_T[g] + b, x.v_N[g] + c, x.v_T[g] + d
        for g in range(at.LANES):
            x.now[g] += 1.0
        quiet -= 1.0
        if quiet <= 0.0:
            for g in range(count):
                if x.now[g] >= x.until[g]:
                    return


@kernel
def advance(
    scenes: Any, numbers: Any, group: Any, lanes: Any, modes: Any, samples: Any, rows: Any, sticks: Any,
    tables: Any, work: Any,
) -> None:  # fmt: skip
    """Take every scene to the end of its segment.

    `scenes` (m,) are records of `fast_scene.SCENE`, `numbers` (m, any) is a view of them, `group` (1,) a workspace
    of `fast_scene.GROUP` and `lanes` (any, LANES) a view of that. A scene says where its own part begins of
    `modes`, blocks in a row; of `samples` and `rows`, as in `statistics.Segment`; of `sticks` (any, 2), begin and
    end; and of the `tables` of `stick_skip.skip`, whose workspace is `work`.
    """
    x, turn = group[0], np.empty(at.LANES, dtype=np.int64)
    count, waiting = 0, 0
    while True:
        # Scenes leave their lanes, and others enter.
        for g in range(count):
            k = turn[g]
            for i in range(_IN_STEP):
                numbers[k, i] = lanes[i, g]
            scenes[k].now, scenes[k].contact = int(x.now[g]), int(x.contact[g])
            await_skip(scenes[k])
        staying, seen = 0, 0
        while staying < at.LANES and (seen < count or waiting < len(scenes)):
            if seen < count:
                k = turn[seen]
                seen += 1
            else:
                k = waiting
                waiting += 1
            scene = scenes[k]
            while scene.stopped == 0:
                if scene.settle == scene.now:
                    clear(scene)
                if scene.now < scene.last and scene.now >= scene.next_skip:
                    skip(scene, modes, samples, rows, tables, work)
                    continue
                if scene.now < scene.last:
                    turn[staying] = k
                    staying += 1
                break
        count = staying
        if count == 0:
            return
        lanes[:] = 0.0
        for g in range(count):
            k = turn[g]
            for i in range(_IN_STEP):
                lanes[i, g] = numbers[k, i]
            scene = scenes[k]
            x.now[g], x.contact[g] = scene.now, scene.contact
            plan(x, g, scene)
        take_steps(turn[:count], scenes, group, modes, samples, rows, sticks)
