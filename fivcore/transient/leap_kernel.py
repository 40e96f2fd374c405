"""Leaping over the quiet part of a stick, compiled: see `transient.leaps` for what is done and why it may be."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray  # type: ignore[attr-defined]

from fivcore.jit import inlined, kernel
from fivcore.transient import lane_rows as rows
from fivcore.transient.lanes import WIDTH, add_number, number_at, numbers, put_number, wholes
from fivcore.transient.leap_sums import (
    GROWING,
    HEAD,
    INTO,
    LOOKS,
    ON_N,
    ON_T,
    OTHERS,
    OVER_VALUES,
    SHAPES,
    STEADY,
    SUM,
    WAS_P,
    WAS_U,
    add,
    bends,
    dot,
    energy,
    forward,
    four,
    look_ahead,
    powers,
    safe,
    turn,
    weigh,
)
from fivcore.transient.statistics import STICK, bin_of

# Rows of the workspace; four for the amplitudes of the readings, and as many for the readings at the next looks.
X, RE, IM, LINE, SLOPE, START_RE, START_IM, BY, WORD, AMPLITUDES, READINGS = (*range(10), 13)
WORKSPACE = 17


def room_width(modes: int) -> int:
    """Columns of the workspace."""
    return max(2 * modes, LOOKS)


@inlined
def bin_of_number(room: Any, number: float) -> int:
    """Bin of the histograms."""
    room[WORD, 0] = number
    return bin_of(room[WORD].view(np.int64)[0])


@kernel
def leap(
    number: int,
    sizes: Any,
    all_given: int,
    all_state: int,
    all_places: int,
    all_q: int,
    all_v: int,
    workspace: int,
) -> None:
    """Take a lane's scene to the last look before which stick cannot have ended, and say when to try again.

    Parameters are those of `fivcore.transient.fast_kernel.work`.
    """
    group, lane = number // WIDTH, number % WIDTH
    modes = sizes[0] + sizes[1] + sizes[2]
    given = carray(numbers(all_given + 8 * group * rows.GIVEN * WIDTH), (rows.GIVEN, WIDTH))
    state = carray(numbers(all_state + 8 * group * rows.STATE * WIDTH), (rows.STATE, WIDTH))
    places = carray(wholes(all_places + 8 * group * rows.PLACES * WIDTH), (rows.PLACES, WIDTH))
    q = carray(numbers(all_q + 8 * group * modes * WIDTH), (modes, WIDTH))
    v = carray(numbers(all_v + 8 * group * modes * WIDTH), (modes, WIDTH))
    width = max(2 * modes, LOOKS)
    room = carray(numbers(workspace), (WORKSPACE, width))
    hearing, now = int(given[rows.HEARING, lane]), int(state[rows.NOW, lane])
    # No leap crosses a multiple of this, where stretches begin and end: what a scene does is independent of them.
    end = (now // (rows.REACH * hearing) + 1) * rows.REACH * hearing
    far = _leap(lane, given, state, places, q, v, room, workspace, min(end, int(state[rows.LAST, lane])))
    now = int(state[rows.NOW, lane])
    if now < end:
        state[rows.NEXT_LEAP, lane] = now + (1.0 if far else 2.0) * given[rows.PATIENCE, lane]
    else:
        state[rows.NEXT_LEAP, lane] = now


@kernel
def _leap(
    lane: int, given: Any, state: Any, places: Any, q: Any, v: Any, room: Any, workspace: int, last: int
) -> bool:
    """Leap no farther than `last`; whether it got anywhere. The arrays are those of the lane's group."""
    address = places[rows.LEAP, lane]
    count, size = int(number_at(address, 0)), int(number_at(address, 1))
    turns = carray(numbers(address + 8 * HEAD), (2 * count, LOOKS))
    turns_at = address + 8 * HEAD
    address = turns_at + 16 * count * LOOKS
    over = carray(numbers(address), (OVER_VALUES, count))
    table = carray(numbers(address + 8 * OVER_VALUES * count), (INTO + 4 * count, 2 * size))
    step, pace, mu = given[rows.STEP, lane], given[rows.PACE, lane], given[rows.MU, lane]
    # A first slip that is waited for comes with a share of mu N.
    bound = min(given[rows.SHARE, lane], 1.0) * mu
    hearing, now = int(given[rows.HEARING, lane]), int(state[rows.NOW, lane])
    settled_from = state[rows.SETTLED_FROM, lane]
    settled = (now + 0.5) * step >= settled_from
    look = int(state[rows.NEXT_HEARD, lane])
    t = (now + 0.5) * step
    if t < given[rows.RAMP, lane] or look + hearing > last:
        return False
    x, line, slope = room[X, : 2 * size], room[LINE, : 2 * size], room[SLOPE, : 2 * size]
    re, im = room[RE, :count], room[IM, :count]
    for j in range(size):
        x[j], x[size + j] = q[j, lane], v[j, lane]
    # Force and its growth per step with the modes at rest.
    clamp = pace * (t - 0.5 * given[rows.RAMP, lane])
    p, u = state[rows.P_REST, lane], state[rows.ANCHOR, lane] - state[rows.T_REST, lane] + clamp
    rN, rT = -given[rows.M_NN, lane], -given[rows.M_NT, lane] - pace
    laws = given[:8, lane]
    dN, dT = laws[1] * pace * step, laws[5] * pace * step
    fN = laws[0] * p + laws[1] * u + laws[2] * rN + laws[3] * rT - 1.0
    fT = laws[4] * p + laws[5] * u + laws[6] * rN + laws[7] * rT
    for j in range(2 * size):
        slope[j] = table[STEADY, j] * dN + table[STEADY + 1, j] * dT
        line[j] = table[STEADY, j] * fN + table[STEADY + 1, j] * fT
        line[j] -= table[GROWING, j] * dN + table[GROWING + 1, j] * dT
        x[j] -= line[j]
    for k in range(count):
        re[k] = dot(table[INTO + k], x)
        im[k] = dot(table[INTO + count + k], x)
    normal, tangential = table[SHAPES, :size], table[SHAPES, size:]
    point_b = table[OTHERS, :size]
    # The lines of penetration, u_T and their rates, hence of what is looked at.
    p, u = p - dot(normal, line[:size]), u - dot(tangential, line[:size])
    rN, rT = rN + dot(normal, line[size:]), rT + dot(tangential, line[size:])
    dp, du = -dot(normal, slope[:size]), pace * step - dot(tangential, slope[:size])
    dN, dT = dot(normal, slope[size:]), dot(tangential, slope[size:])
    N0 = laws[0] * p + laws[1] * u + laws[2] * rN + laws[3] * rT
    T0 = laws[4] * p + laws[5] * u + laws[6] * rN + laws[7] * rT
    N1 = laws[0] * dp + laws[1] * du + laws[2] * dN + laws[3] * dT
    T1 = laws[4] * dp + laws[5] * du + laws[6] * dN + laws[7] * dT
    on_N, on_T = step * given[rows.B_N, lane], step * given[rows.B_T, lane]
    B0 = dot(point_b, line[size:]) + on_N * (N0 - 1.0) + on_T * T0
    B1 = dot(point_b, slope[size:]) + on_N * N1 + on_T * T1
    left_N, left_T = given[rows.APART, lane], given[rows.APART + 1, lane]
    C0 = p - left_N * (p - dp) - left_T * (u - du)
    C1 = dp - left_N * dp - left_T * du
    N, T, B, C = four(over, re, im)
    if not safe(over, re, im, bound, N + N0, T + T0, C + C0):
        return False
    start_re, start_im = room[START_RE, :count], room[START_IM, :count]
    start_re[:], start_im[:] = re, im
    most = N + N0
    past = float(look - now)
    if past > 0.0:
        powers(over, past, start_re, start_im, re, im)
        N, T, B, C = four(over, re, im)
    if past > 0.0 and not safe(over, re, im, bound, N + N0 + N1 * past, T + T0 + T1 * past, C + C0 + C1 * past):
        return False
    if settled and look > now:
        add_number(places[rows.FORCES, lane], bin_of_number(room, most), (look - now) * step)
    at, heard, width = look, places[rows.HEARD_COUNT, lane], room.shape[1]
    readings = room[READINGS : READINGS + 4]
    was_N, was_B = N + N0 + N1 * past, B + B0 + B1 * past
    quiet = True
    while quiet and at + hearing <= last:
        # Amplitudes only shrink: what bounds them here does so at all looks to come.
        off = bends(over, re, im, bound)
        weigh(over, re, im, room[AMPLITUDES : AMPLITUDES + 4])
        look_ahead(turns_at, workspace + 8 * AMPLITUDES * width, workspace + 8 * READINGS * width, count, width)
        far = 0
        for m in range(LOOKS):
            past += hearing
            now_N, now_T = readings[0, m] + N0 + N1 * past, readings[1, m] + T0 + T1 * past
            quiet = (
                at + hearing <= last
                and (settled or (at + hearing - 0.5) * step < settled_from)
                and now_N > off[0]
                and bound * now_N - now_T > off[1]
                and bound * now_N + now_T > off[2]
                and readings[3, m] + C0 + C1 * past > off[3]
            )
            if not quiet:
                break
            put_number(places[rows.HEARD, lane], 2 * heard, was_B)
            put_number(places[rows.HEARD, lane], 2 * heard + 1, 0.0)
            heard += 1
            if settled:
                add_number(places[rows.FORCES, lane], bin_of_number(room, was_N), hearing * step)
                most = max(most, was_N)
            was_N, was_B = now_N, readings[2, m] + B0 + B1 * past
            at += hearing
            far += 1
        if far > 0:
            forward(turns, far, re, im)
    steps = float(at - now)
    if steps == 0.0:
        return False
    places[rows.HEARD_COUNT, lane] = heard
    for j in range(size):
        x[j], x[size + j] = q[j, lane], v[j, lane]
    K_NN, K_NT, K_TT = given[rows.K_NN, lane], given[rows.K_NT, lane], given[rows.K_TT, lane]
    others, shapes = table[OTHERS], table[SHAPES]
    before = energy(x, shapes, others, K_NN, K_NT, K_TT, state[rows.U_N, lane], state[rows.U_T, lane])
    for j in range(2 * size):
        x[j] = line[j] + slope[j] * steps
    for k in range(count):
        add(x, re[k], table[INTO + 2 * count + k], im[k], table[INTO + 3 * count + k])
    p, u = p + dp * (steps - 1.0), u + du * (steps - 1.0)
    sum_N, sum_T = 0.0, 0.0
    for k in range(count):
        p += over[WAS_P, k] * re[k] - over[WAS_P + 1, k] * im[k]
        u += over[WAS_U, k] * re[k] - over[WAS_U + 1, k] * im[k]
        # The sum of z^i amplitude over the steps.
        a, b = start_re[k] - re[k], start_im[k] - im[k]
        c, d = a * over[SUM, k] - b * over[SUM + 1, k], a * over[SUM + 1, k] + b * over[SUM, k]
        sum_N += over[ON_N, k] * c - over[ON_N + 1, k] * d
        sum_T += over[ON_T, k] * c - over[ON_T + 1, k] * d
    pairs = 0.5 * steps * (steps - 1.0)
    sum_N += N0 * steps + N1 * pairs
    sum_T += T0 * steps + T1 * pairs
    for j in range(size):
        q[j, lane], v[j, lane] = x[j], x[size + j]
    work = pace * step * sum_T
    after = energy(x, shapes, others, K_NN, K_NT, K_TT, p, u)
    state[rows.WORK, lane] += work
    # What modes and element lose here is what is missing.
    state[rows.DAMPED, lane] += work + before - after
    if settled:
        state[rows.SUM_N, lane] += step * sum_N
        state[rows.STICK_TIME, lane] += step * steps
        state[rows.MAX_N, lane] = max(state[rows.MAX_N, lane], most)
        add_number(places[rows.SPEEDS, lane], bin_of_number(room, 0.0), step * steps)
    state[rows.U_N, lane], state[rows.U_T, lane] = p, u
    state[rows.G_N, lane], state[rows.G_T, lane] = dot(normal, x[:size]), dot(tangential, x[:size])
    state[rows.V_N, lane], state[rows.V_T, lane] = dot(normal, x[size:]), dot(tangential, x[size:])
    if state[rows.NEXT_ROW, lane] < at:
        _record(lane, given, state, places, over, start_re, start_im, re, im, room, at, N0, N1, T0, T1, B0, B1)
    state[rows.NOW, lane] = state[rows.NEXT_SAMPLE, lane] = state[rows.NEXT_HEARD, lane] = state[
        rows.NEXT, lane
    ] = at
    return True


@kernel
def _record(
    lane: int, given: Any, state: Any, places: Any, over: Any, start_re: Any, start_im: Any, re: Any, im: Any,
    room: Any, at: int, N0: float, N1: float, T0: float, T1: float, B0: float, B1: float,
) -> None:  # fmt: skip
    """Rows of the record between now and `at`."""
    now, row, apart = int(state[rows.NOW, lane]), int(state[rows.NEXT_ROW, lane]), int(given[rows.RECORDING, lane])
    count, written = re.shape[0], places[rows.ROW_COUNT, lane]
    by_re, by_im = room[X, :count], room[BY, :count]
    by_re[:], by_im[:] = 1.0, 0.0
    powers(over, float(apart), by_re, by_im, by_re, by_im)
    powers(over, float(row - now), start_re, start_im, re, im)
    while row < at:
        N, T, B, _ = four(over, re, im)
        k = float(row - now)
        put_number(places[rows.ROWS, lane], rows.COLUMNS * written, (row + 0.5) * given[rows.STEP, lane])
        put_number(places[rows.ROWS, lane], rows.COLUMNS * written + 1, B + B0 + B1 * k)
        put_number(places[rows.ROWS, lane], rows.COLUMNS * written + 2, N + N0 + N1 * k)
        put_number(places[rows.ROWS, lane], rows.COLUMNS * written + 3, T + T0 + T1 * k)
        put_number(places[rows.ROWS, lane], rows.COLUMNS * written + 4, 0.0)
        put_number(places[rows.ROWS, lane], rows.COLUMNS * written + 5, STICK)
        written, row = written + 1, row + apart
        turn(re, im, by_re, by_im)
    places[rows.ROW_COUNT, lane] = written
    state[rows.NEXT_ROW, lane] = row
