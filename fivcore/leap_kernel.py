"""Leaping over the quiet part of a stick, compiled: see `fivcore.leaps` for what is done and why it may be."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray  # type: ignore[attr-defined]

from fivcore import lane_rows as rows
from fivcore.kernel import inlined, kernel, reordered
from fivcore.lanes import WIDTH, add_number, number_at, numbers, put_number, wholes
from fivcore.tally import STICK, bin_of

# What `fivcore.leaps` packs: how many eigenvalues and modes; then rows over the eigenvalues z (real and
# imaginary parts: z to the power of the steps between two looks, log z, 1 / (1 - z), and the readings N, T,
# velocity of B, how much the gap is closed beyond what would open it, and one step earlier penetration and u_T;
# then how far a reading can be off a straight line between two looks) ...
HEAD = 2
(TURN, LOG, SUM, ON_N, ON_T, ON_B, ON_C, WAS_P, WAS_U) = range(0, 18, 2)
BEND = 18
OVER_VALUES = 19
# ... then rows over x = (q, v): what a steady force and a growing one make of it (normal, tangential each), the
# gap shapes, shape at B and stiffness, and for each eigenvalue the real and imaginary parts of the way into its
# coordinate and back.
(STEADY, GROWING, SHAPES, OTHERS, INTO) = (0, 2, 4, 5, 6)
# Rows of the workspace.
X, RE, IM, LINE, SLOPE, START_RE, START_IM, BY, WORD = range(9)
WORKSPACE = 9
# Looks after which it is found out anew how far readings can be off.
AGAIN = 64


@reordered
def _dot(a: Any, b: Any) -> float:
    total = 0.0
    for j in range(a.shape[0]):
        total += a[j] * b[j]
    return total


@reordered
def _turn(re: Any, im: Any, by_re: Any, by_im: Any) -> None:
    """Turn and shrink all amplitudes."""
    for k in range(re.shape[0]):
        x, y = re[k], im[k]
        re[k] = x * by_re[k] - y * by_im[k]
        im[k] = x * by_im[k] + y * by_re[k]


@reordered
def _four(over: Any, re: Any, im: Any) -> Any:
    """N, T, velocity of B and closing of the gap, apart from the line."""
    N, T, B, C = 0.0, 0.0, 0.0, 0.0
    for k in range(re.shape[0]):
        x, y = re[k], im[k]
        N += over[ON_N, k] * x - over[ON_N + 1, k] * y
        T += over[ON_T, k] * x - over[ON_T + 1, k] * y
        B += over[ON_B, k] * x - over[ON_B + 1, k] * y
        C += over[ON_C, k] * x - over[ON_C + 1, k] * y
    return N, T, B, C


@reordered
def _bends(over: Any, re: Any, im: Any, mu: float) -> Any:
    """How far N, mu N - T, mu N + T and the closing can be off straight lines between two looks."""
    N, ahead, back, C = 0.0, 0.0, 0.0, 0.0
    for k in range(re.shape[0]):
        size = over[BEND, k] * np.sqrt(re[k] * re[k] + im[k] * im[k])
        a, b, c, d = over[ON_N, k], over[ON_N + 1, k], over[ON_T, k], over[ON_T + 1, k]
        N += size * np.sqrt(a * a + b * b)
        ahead += size * np.sqrt((mu * a - c) ** 2 + (mu * b - d) ** 2)
        back += size * np.sqrt((mu * a + c) ** 2 + (mu * b + d) ** 2)
        C += size * np.sqrt(over[ON_C, k] ** 2 + over[ON_C + 1, k] ** 2)
    return N, ahead, back, C


@reordered
def _powers(over: Any, steps: float, re: Any, im: Any, into_re: Any, into_im: Any) -> None:
    """Amplitudes some steps later."""
    for k in range(re.shape[0]):
        size, angle = np.exp(over[LOG, k] * steps), over[LOG + 1, k] * steps
        c, s = size * np.cos(angle), size * np.sin(angle)
        into_re[k], into_im[k] = re[k] * c - im[k] * s, re[k] * s + im[k] * c


@reordered
def _energy(
    x: Any, shapes: Any, others: Any, K_NN: float, K_NT: float, K_TT: float, uN: float, uT: float
) -> float:
    """Of the modes about the equilibrium, the element and the load."""
    n = x.shape[0] // 2
    total = 0.5 * (K_NN * uN * uN + 2.0 * K_NT * uN * uT + K_TT * uT * uT)
    for j in range(n):
        total += 0.5 * (x[n + j] * x[n + j] + others[n + j] * x[j] * x[j]) + shapes[j] * x[j]
    return total


@reordered
def _add(x: Any, a: float, one: Any, b: float, other: Any) -> None:
    for j in range(x.shape[0]):
        x[j] += a * one[j] - b * other[j]


@inlined
def _safe(over: Any, re: Any, im: Any, mu: float, N: float, T: float, C: float) -> bool:
    """Whether nothing can end stick between here and a look that is as good."""
    bends = _bends(over, re, im, mu)
    return bends[0] < N and mu * N - T > bends[1] and mu * N + T > bends[2] and bends[3] < C


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

    Parameters are those of `fivcore.fast_kernel.work`.
    """
    group, lane = number // WIDTH, number % WIDTH
    modes = sizes[0] + sizes[1] + sizes[2]
    given = carray(numbers(all_given + 8 * group * rows.GIVEN * WIDTH), (rows.GIVEN, WIDTH))
    state = carray(numbers(all_state + 8 * group * rows.STATE * WIDTH), (rows.STATE, WIDTH))
    places = carray(wholes(all_places + 8 * group * rows.PLACES * WIDTH), (rows.PLACES, WIDTH))
    q = carray(numbers(all_q + 8 * group * modes * WIDTH), (modes, WIDTH))
    v = carray(numbers(all_v + 8 * group * modes * WIDTH), (modes, WIDTH))
    room = carray(numbers(workspace), (WORKSPACE, 2 * modes))
    hearing, now = int(given[rows.HEARING, lane]), int(state[rows.NOW, lane])
    # No leap crosses a multiple of this, where stretches begin and end: what a scene does is independent of them.
    end = (now // (rows.REACH * hearing) + 1) * rows.REACH * hearing
    far = _leap(lane, given, state, places, q, v, room, min(end, int(state[rows.LAST, lane])))
    now = int(state[rows.NOW, lane])
    if now < end:
        state[rows.NEXT_LEAP, lane] = now + (1.0 if far else 2.0) * given[rows.PATIENCE, lane]
    else:
        state[rows.NEXT_LEAP, lane] = now


@kernel
def _leap(lane: int, given: Any, state: Any, places: Any, q: Any, v: Any, room: Any, last: int) -> bool:
    """Leap no farther than `last`; whether it got anywhere. The arrays are those of the lane's group."""
    address = places[rows.LEAP, lane]
    count, size = int(number_at(address, 0)), int(number_at(address, 1))
    over = carray(numbers(address + 8 * HEAD), (OVER_VALUES, count))
    table = carray(numbers(address + 8 * (HEAD + OVER_VALUES * count)), (INTO + 4 * count, 2 * size))
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
    x, re, im, line, slope = room[X], room[RE, :count], room[IM, :count], room[LINE], room[SLOPE]
    for j in range(size):
        x[j], x[size + j] = q[j, lane], v[j, lane]
    # Force and its growth per step with the modes at rest.
    clamp = pace * (t - 0.5 * given[rows.RAMP, lane])
    p, u = state[rows.P_REST, lane], state[rows.ANCHOR, lane] - state[rows.T_REST, lane] + clamp
    half = 0.5 * step
    rN, rT = -half * given[rows.W_NN, lane], -half * given[rows.W_NT, lane] - pace
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
        re[k] = _dot(table[INTO + k], x)
        im[k] = _dot(table[INTO + count + k], x)
    normal, tangential = table[SHAPES, :size], table[SHAPES, size:]
    point_b = table[OTHERS, :size]
    # The lines of penetration, u_T and their rates, hence of what is looked at.
    p, u = p - _dot(normal, line[:size]), u - _dot(tangential, line[:size])
    rN, rT = rN + _dot(normal, line[size:]), rT + _dot(tangential, line[size:])
    dp, du = -_dot(normal, slope[:size]), pace * step - _dot(tangential, slope[:size])
    dN, dT = _dot(normal, slope[size:]), _dot(tangential, slope[size:])
    N0 = laws[0] * p + laws[1] * u + laws[2] * rN + laws[3] * rT
    T0 = laws[4] * p + laws[5] * u + laws[6] * rN + laws[7] * rT
    N1 = laws[0] * dp + laws[1] * du + laws[2] * dN + laws[3] * dT
    T1 = laws[4] * dp + laws[5] * du + laws[6] * dN + laws[7] * dT
    on_N, on_T = step * given[rows.B_N, lane], step * given[rows.B_T, lane]
    B0 = _dot(point_b, line[size:]) + on_N * (N0 - 1.0) + on_T * T0
    B1 = _dot(point_b, slope[size:]) + on_N * N1 + on_T * T1
    left_N, left_T = given[rows.APART, lane], given[rows.APART + 1, lane]
    C0 = p - left_N * (p - dp) - left_T * (u - du)
    C1 = dp - left_N * dp - left_T * du
    N, T, B, C = _four(over, re, im)
    if not _safe(over, re, im, bound, N + N0, T + T0, C + C0):
        return False
    start_re, start_im = room[START_RE, :count], room[START_IM, :count]
    start_re[:], start_im[:] = re, im
    most = N + N0
    _powers(over, float(look - now), start_re, start_im, re, im)
    N, T, B, C = _four(over, re, im)
    past = float(look - now)
    if not _safe(over, re, im, bound, N + N0 + N1 * past, T + T0 + T1 * past, C + C0 + C1 * past):
        return False
    if settled and look > now:
        add_number(places[rows.FORCES, lane], bin_of_number(room, most), (look - now) * step)
    at, looks, heard = look, 0, places[rows.HEARD_COUNT, lane]
    bends = _bends(over, re, im, bound)
    while at + hearing <= last and (settled or (at + hearing - 0.5) * step < settled_from):
        was_N, was_B = N + N0 + N1 * past, B + B0 + B1 * past
        _turn(re, im, over[TURN], over[TURN + 1])
        looks += 1
        # Amplitudes only shrink: what bounded them once bounds them for good, but less closely.
        if looks % AGAIN == 0:
            bends = _bends(over, re, im, bound)
        past += hearing
        N, T, B, C = _four(over, re, im)
        now_N, now_T = N + N0 + N1 * past, T + T0 + T1 * past
        if not (
            now_N > bends[0]
            and bound * now_N - now_T > bends[1]
            and bound * now_N + now_T > bends[2]
            and C + C0 + C1 * past > bends[3]
        ):
            break
        put_number(places[rows.HEARD, lane], 2 * heard, was_B)
        put_number(places[rows.HEARD, lane], 2 * heard + 1, 0.0)
        heard += 1
        if settled:
            add_number(places[rows.FORCES, lane], bin_of_number(room, was_N), hearing * step)
            most = max(most, was_N)
        at += hearing
    steps = float(at - now)
    if steps == 0.0:
        return False
    places[rows.HEARD_COUNT, lane] = heard
    if state[rows.NEXT_ROW, lane] < at:
        _record(lane, given, state, places, over, start_re, start_im, re, im, room, at, N0, N1, T0, T1, B0, B1)
    for j in range(size):
        x[j], x[size + j] = q[j, lane], v[j, lane]
    K_NN, K_NT, K_TT = given[rows.K_NN, lane], given[rows.K_NT, lane], given[rows.K_TT, lane]
    others, shapes = table[OTHERS], table[SHAPES]
    before = _energy(x, shapes, others, K_NN, K_NT, K_TT, state[rows.U_N, lane], state[rows.U_T, lane])
    _powers(over, steps, start_re, start_im, re, im)
    for j in range(2 * size):
        x[j] = line[j] + slope[j] * steps
    for k in range(count):
        _add(x, re[k], table[INTO + 2 * count + k], im[k], table[INTO + 3 * count + k])
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
    after = _energy(x, shapes, others, K_NN, K_NT, K_TT, p, u)
    state[rows.WORK, lane] += work
    # What modes and element lose here is what is missing.
    state[rows.DAMPED, lane] += work + before - after
    if settled:
        state[rows.SUM_N, lane] += step * sum_N
        state[rows.STICK_TIME, lane] += step * steps
        state[rows.MAX_N, lane] = max(state[rows.MAX_N, lane], most)
        add_number(places[rows.SPEEDS, lane], bin_of_number(room, 0.0), step * steps)
    state[rows.U_N, lane], state[rows.U_T, lane] = p, u
    state[rows.G_N, lane], state[rows.G_T, lane] = _dot(normal, x[:size]), _dot(tangential, x[:size])
    state[rows.V_N, lane], state[rows.V_T, lane] = _dot(normal, x[size:]), _dot(tangential, x[size:])
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
    _powers(over, float(apart), by_re, by_im, by_re, by_im)
    _powers(over, float(row - now), start_re, start_im, re, im)
    while row < at:
        N, T, B, _ = _four(over, re, im)
        k = float(row - now)
        put_number(places[rows.ROWS, lane], rows.COLUMNS * written, (row + 0.5) * given[rows.STEP, lane])
        put_number(places[rows.ROWS, lane], rows.COLUMNS * written + 1, B + B0 + B1 * k)
        put_number(places[rows.ROWS, lane], rows.COLUMNS * written + 2, N + N0 + N1 * k)
        put_number(places[rows.ROWS, lane], rows.COLUMNS * written + 3, T + T0 + T1 * k)
        put_number(places[rows.ROWS, lane], rows.COLUMNS * written + 4, 0.0)
        put_number(places[rows.ROWS, lane], rows.COLUMNS * written + 5, STICK)
        written, row = written + 1, row + apart
        _turn(re, im, by_re, by_im)
    places[rows.ROW_COUNT, lane] = written
    state[rows.NEXT_ROW, lane] = row
