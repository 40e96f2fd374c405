"""The compiled heart of `method="fast"`: kept modes move exactly, the contact acts in symmetric kicks.

One step from kick to kick, for kicks in the middle of the time steps: evaluate the gap, let
`fivcore.contact_law` find the force, change the velocities by step times force, move every mode freely over
one step (a Strang splitting, second order). Coordinates are deviations from the static equilibrium under the
unit load, so the load needs no force of its own: a kick carries N - 1.

Every lane holds a scene of its own, at a time of its own (`fivcore.lanes`). Scenes share only the numbers of modes
of three kinds: those that the contact feels in both directions (P1's), along its normal only (P2's bending) and
along its tangent only (P2's axial motion).

All arrays are (rows, lanes). There are two groups of lanes, the rows of the second below those of the first: while
the processor waits for the contact forces of one group it moves the modes of the other.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore import lane_rows as rows
from fivcore.kernel import inlined, kernel
from fivcore.lanes import (
    WIDTH,
    add_number,
    bits,
    each,
    fma,
    least,
    load,
    magnitude,
    number_at,
    put_number,
    put_whole,
    select,
    store,
    whole_at,
)
from fivcore.leap_kernel import leap
from fivcore.tally import BINS, SEPARATION, SLIP, STICK, bin_of

# The truths of a mask, all true.
EVERY = (1 << WIDTH) - 1


@inlined
def both_ways(
    modes: int, row: int, q: int, v: int, j: int, hN: Any, hT: Any, gN: Any, gT: Any, vN: Any, vT: Any
) -> Any:
    """Kick and move a mode; the gaps and their rates with what it adds to them."""
    normal, tangential, was = load(modes, row), load(modes, row + 1), load(q, j)
    rate = fma(tangential, hT, fma(normal, hN, load(v, j)))
    x = fma(load(modes, row + 2), was, load(modes, row + 3) * rate)
    y = fma(load(modes, row + 4), was, load(modes, row + 5) * rate)
    store(q, j, x)
    store(v, j, y)
    return fma(normal, x, gN), fma(tangential, x, gT), fma(normal, y, vN), fma(tangential, y, vT)


@inlined
def one_way(modes: int, row: int, q: int, v: int, j: int, h: Any, gap: Any, rate: Any) -> Any:
    """The same for a mode that the contact feels in one direction."""
    shape, was = load(modes, row), load(q, j)
    kicked = fma(shape, h, load(v, j))
    x = fma(load(modes, row + 1), was, load(modes, row + 2) * kicked)
    y = fma(load(modes, row + 3), was, load(modes, row + 4) * kicked)
    store(q, j, x)
    store(v, j, y)
    return fma(shape, x, gap), fma(shape, y, rate)


@inlined
def kick_and_move(sizes: Any, modes: int, row: int, q: int, v: int, first: int, hN: Any, hT: Any) -> Any:
    """Kick, move freely over one step, and return g_N, g_T and their rates there.

    Two sums of each kind: a sum waits for its last term, and the numbers of modes are even for this.
    """
    both, normal, tangential = sizes
    gN, gT, vN, vT = each(0.0), each(0.0), each(0.0), each(0.0)
    gN2, gT2, vN2, vT2 = gN, gT, vN, vT
    for j in range(first, first + both, 2):
        gN, gT, vN, vT = both_ways(modes, row, q, v, j, hN, hT, gN, gT, vN, vT)
        gN2, gT2, vN2, vT2 = both_ways(modes, row + rows.BOTH, q, v, j + 1, hN, hT, gN2, gT2, vN2, vT2)
        row += 2 * rows.BOTH
    first += both
    for j in range(first, first + normal, 2):
        gN, vN = one_way(modes, row, q, v, j, hN, gN, vN)
        gN2, vN2 = one_way(modes, row + rows.ONE, q, v, j + 1, hN, gN2, vN2)
        row += 2 * rows.ONE
    first += normal
    for j in range(first, first + tangential, 2):
        gT, vT = one_way(modes, row, q, v, j, hT, gT, vT)
        gT2, vT2 = one_way(modes, row + rows.ONE, q, v, j + 1, hT, gT2, vT2)
        row += 2 * rows.ONE
    return gN + gN2, gT + gT2, vN + vN2, vT + vT2


@inlined
def damped(sizes: Any, modes: int, row: int, damping: int, v: int, first: int, hN: Any, hT: Any) -> Any:
    """Power that the modes lose after a kick by hN and hT."""
    both, normal, tangential = sizes
    power, more = each(0.0), each(0.0)
    for j in range(first, first + both, 2):
        rate = fma(load(modes, row + 1), hT, fma(load(modes, row), hN, load(v, j)))
        power = fma(load(damping, j) * rate, rate, power)
        row += rows.BOTH
        rate = fma(load(modes, row + 1), hT, fma(load(modes, row), hN, load(v, j + 1)))
        more = fma(load(damping, j + 1) * rate, rate, more)
        row += rows.BOTH
    for kick, begin, end in ((hN, both, both + normal), (hT, both + normal, both + normal + tangential)):
        for j in range(first + begin, first + end, 2):
            rate = fma(load(modes, row), kick, load(v, j))
            power = fma(load(damping, j) * rate, rate, power)
            row += rows.ONE
            rate = fma(load(modes, row), kick, load(v, j + 1))
            more = fma(load(damping, j + 1) * rate, rate, more)
            row += rows.ONE
    return power + more


@inlined
def along(shape: int, v: int, first: int, end: int) -> Any:
    """Velocity of a point."""
    speed, more = each(0.0), each(0.0)
    for j in range(first, end, 2):
        speed = fma(load(shape, j), load(v, j), speed)
        more = fma(load(shape, j + 1), load(v, j + 1), more)
    return speed + more


@inlined
def follow_shapes(sizes: Any, modes: int, row: int, slides: int, q: int, v: int, first: int) -> Any:
    """Gap shapes of the next step, and by how much the gaps and their rates change with them alone."""
    both, normal, tangential = sizes
    gN, gT, vN, vT = each(0.0), each(0.0), each(0.0), each(0.0)
    # P1's shapes, the only ones that are felt both ways, stay.
    row, first = row + both * rows.BOTH, first + both
    for j in range(first, first + normal):
        slide = load(slides, j)
        store(modes, row, load(modes, row) + slide)
        gN, vN = fma(slide, load(q, j), gN), fma(slide, load(v, j), vN)
        row += rows.ONE
    first += normal
    for j in range(first, first + tangential):
        slide = load(slides, j)
        store(modes, row, load(modes, row) + slide)
        gT, vT = fma(slide, load(q, j), gT), fma(slide, load(v, j), vT)
        row += rows.ONE
    return gN, gT, vN, vT


@inlined
def either(given: int, where: Any, a: int, b: int) -> Any:
    """Row a of `given` where it is true, elsewhere row b."""
    return select(where, load(given, a), load(given, b))


@inlined
def find_contact(
    given: int, of: int, was: Any, uN: Any, uT: Any, anchor: Any, p: Any, gT: Any, vN: Any, vT: Any
) -> Any:
    """Which lanes stick, which slip, N, T, the element's new state and its u_T before.

    From penetration, g_T and their rates; where neither is true the surfaces are apart. `of` is the group's first
    row in `given`.
    """
    mu, half = load(given, of + rows.MU), load(given, of + rows.HALF)
    stuck, apart = was == each(STICK), was == each(SEPARATION)
    left = fma(load(given, of + rows.APART + 1), uT, load(given, of + rows.APART) * uN)
    # Without an element the gap of a lasting contact is rounding: only its force can end it.
    opens = (p <= left) & (apart | (load(given, of + rows.RIGID) == each(0.0)))
    u = select(stuck, anchor - gT, uT)
    law, other = of + rows.STICKING, of + rows.ENTRY
    N = fma(
        either(given, stuck, law + 2, other + 2),
        vN,
        fma(either(given, stuck, law + 1, other + 1), u, either(given, stuck, law, other) * p),
    )
    N = fma(either(given, stuck, law + 3, other + 3), vT, N)
    T = fma(
        either(given, stuck, law + 6, other + 6),
        vN,
        fma(either(given, stuck, law + 5, other + 5), u, either(given, stuck, law + 4, other + 4) * p),
    )
    T = fma(either(given, stuck, law + 7, other + 7), vT, T)
    sticks = (each(0.0) < N) & (magnitude(T) <= mu * N) & ~opens
    # Between the middle of the step, where stick holds u_T, and its start, where slip begins.
    shift = load(given, of + rows.LAG) * fma(
        half, fma(load(given, of + rows.W_NT), N, load(given, of + rows.W_TT) * T), vT
    )
    start, held = select(stuck, u + shift, u), select(stuck, u, u - shift)
    ahead = each(0.0) < T
    law, other = of + rows.FORWARDS, of + rows.BACKWARDS
    M = fma(either(given, ahead, law + 2, other + 2), vN, either(given, ahead, law, other) * p)
    M = fma(either(given, ahead, law + 1, other + 1), start, M)
    after = fma(either(given, ahead, law + 5, other + 5), vN, either(given, ahead, law + 3, other + 3) * p)
    after = fma(either(given, ahead, law + 4, other + 4), start, after)
    slips = (each(0.0) < M) & ~opens & ~sticks
    touch = sticks | slips
    # What is left of the element's state where contact has ended, at the start of the step or within it.
    endN, endT = select(opens, uN, p), select(opens, uT, start)
    leftN = fma(load(given, of + rows.APART + 1), endT, load(given, of + rows.APART) * endN)
    leftT = fma(load(given, of + rows.APART + 3), endT, load(given, of + rows.APART + 2) * endN)
    # A landing on a rigid contact takes part of the force of a lasting one.
    share = select(apart, load(given, of + rows.LANDING), each(1.0))
    N = share * select(sticks, N, select(slips, M, each(0.0)))
    T = select(sticks, share * T, select(ahead, mu, -mu) * N)
    before = select(opens, uT, select(sticks, u, start))
    newT = select(sticks, held, select(slips, after, leftT))
    return sticks, slips, N, T, select(touch, p, leftN), newT, before


@inlined
def clear(places: int, at: int, which: int) -> None:
    """Empty the histograms of some lanes."""
    for lane in range(WIDTH):
        if (which >> lane) & 1:
            for k in range(BINS):
                put_number(whole_at(places, (at + rows.FORCES) * WIDTH + lane), k, 0.0)
                put_number(whole_at(places, (at + rows.SPEEDS) * WIDTH + lane), k, 0.0)


@inlined
def enter_sticks(starts: Any, of: int, ends: Any, places: int, at: int, which: int) -> None:
    """Add the sticks that have ended in some lanes to their lists."""
    for lane in range(WIDTH):
        count = whole_at(places, (at + rows.STICK_COUNT) * WIDTH + lane)
        if (which >> lane) & 1 and count < whole_at(places, (at + rows.STICK_ROOM) * WIDTH + lane):
            put_number(
                whole_at(places, (at + rows.STICKS) * WIDTH + lane),
                2 * count,
                number_at(starts, of * WIDTH + lane),
            )
            put_number(
                whole_at(places, (at + rows.STICKS) * WIDTH + lane),
                2 * count + 1,
                number_at(ends, rows.S_TIME * WIDTH + lane),
            )
            put_whole(places, (at + rows.STICK_COUNT) * WIDTH + lane, count + 1)


@inlined
def spread(given: int, of: int, scratch: int, places: int, at: int, which: int) -> None:
    """Add a sample to the histograms of some lanes."""
    for lane in range(WIDTH):
        if (which >> lane) & 1:
            weight = rows.SAMPLED * number_at(given, (of + rows.STEP) * WIDTH + lane)
            forces = whole_at(places, (at + rows.FORCES) * WIDTH + lane)
            speeds = whole_at(places, (at + rows.SPEEDS) * WIDTH + lane)
            add_number(forces, bin_of(whole_at(scratch, rows.S_N * WIDTH + lane)), weight)
            add_number(speeds, bin_of(whole_at(scratch, rows.S_SIZE * WIDTH + lane)), weight)


@inlined
def hear(scratch: int, places: int, at: int, which: int) -> None:
    """Keep the velocity of B and the slip rate of some lanes."""
    for lane in range(WIDTH):
        if (which >> lane) & 1:
            count = whole_at(places, (at + rows.HEARD_COUNT) * WIDTH + lane)
            put_number(
                whole_at(places, (at + rows.HEARD) * WIDTH + lane),
                2 * count,
                number_at(scratch, rows.S_B * WIDTH + lane),
            )
            put_number(
                whole_at(places, (at + rows.HEARD) * WIDTH + lane),
                2 * count + 1,
                number_at(scratch, rows.S_SPEED * WIDTH + lane),
            )
            put_whole(places, (at + rows.HEARD_COUNT) * WIDTH + lane, count + 1)


@inlined
def record(scratch: int, places: int, at: int, which: int) -> None:
    """Add a row to the record of some lanes."""
    for lane in range(WIDTH):
        if (which >> lane) & 1:
            kept, count = (
                whole_at(places, (at + rows.ROWS) * WIDTH + lane),
                whole_at(places, (at + rows.ROW_COUNT) * WIDTH + lane),
            )
            for column in range(rows.COLUMNS):
                put_number(kept, rows.COLUMNS * count + column, number_at(scratch, column * WIDTH + lane))
            put_whole(places, (at + rows.ROW_COUNT) * WIDTH + lane, count + 1)


@inlined
def add_to(state: int, row: int, value: Any) -> None:
    """Add to a row."""
    store(state, row, load(state, row) + value)


@inlined
def meet(
    sizes: Any, group: int, modes: int, damping: int, point_b: int, given: int, state: int, places: int, v: int,
    scratch: int,
) -> Any:  # fmt: skip
    """Find the contact forces of a group of lanes and count what is to be counted.

    Leaves the kick in the rows KICK_N and KICK_T; returns, bit by bit, the lanes whose stretch ends here.
    """
    of, here, at = group * rows.GIVEN, group * rows.STATE, group * rows.PLACES
    zero, one = each(0.0), each(1.0)
    step, half, pace = load(given, of + rows.STEP), load(given, of + rows.HALF), load(given, of + rows.PACE)
    pull, ramp, mu = load(given, of + rows.PULL), load(given, of + rows.RAMP), load(given, of + rows.MU)
    W_NN, W_NT, W_TT = load(given, of + rows.W_NN), load(given, of + rows.W_NT), load(given, of + rows.W_TT)
    now, creep, was = (
        load(state, here + rows.NOW),
        load(state, here + rows.CREEP),
        load(state, here + rows.CONTACT),
    )
    t = (now + each(0.5)) * step
    ramped = t < ramp
    X = select(ramped, each(0.5) * (pull * (t * t)), pace * (t - each(0.5) * ramp))
    drive = select(ramped, pull * t, pace)
    # The unit load's share of the kick comes first.
    rateN = load(state, here + rows.V_N) - fma(half, W_NN, -creep)
    rateT = load(state, here + rows.V_T) - fma(half, W_NT, drive)
    slid = load(state, here + rows.G_T) + (load(state, here + rows.T_REST) - X)
    wasN, wasT = load(state, here + rows.U_N), load(state, here + rows.U_T)
    p = load(state, here + rows.P_REST) - load(state, here + rows.G_N)
    anchor = load(state, here + rows.ANCHOR)
    sticks, slips, N, T, newN, newT, before = find_contact(
        given, of, was, wasN, wasT, anchor, p, slid, rateN, rateT
    )
    store(state, here + rows.KICK_N, step * (N - one))
    store(state, here + rows.KICK_T, step * T)
    store(state, here + rows.U_N, newN)
    store(state, here + rows.U_T, newT)
    touch = sticks | slips
    meanN = fma(half, fma(W_NN, N, W_NT * T), rateN)
    meanT = fma(half, fma(W_NT, N, W_TT * T), rateT)
    ratesT = select(sticks, -meanT, select(slips, (newT - before) * load(given, of + rows.PER_STEP), zero))
    ratesN = select(touch, -meanN, zero)
    speed = meanT + ratesT
    # Apart, the element gives up what it holds; in contact, its dashpot loses.
    released = fma(load(given, of + rows.K_NN), fma(wasN, wasN, -(newN * newN)), zero)
    released = fma(load(given, of + rows.K_TT), fma(before, before, -(newT * newT)), released)
    released = fma(each(2.0) * load(given, of + rows.K_NT), fma(wasN, before, -(newN * newT)), released)
    dashpot = load(given, of + rows.C_TT) * select(slips, load(given, of + rows.UNEVENNESS), one)
    power = fma(load(given, of + rows.C_NN) * ratesN, ratesN, (dashpot * ratesT) * ratesT)
    power = fma(each(2.0) * load(given, of + rows.C_NT) * ratesN, ratesT, power)
    add_to(state, here + rows.TERMINATION, select(touch, step * power, each(0.5) * released))
    add_to(state, here + rows.WORK, step * fma(T, drive, -(N * creep)))
    add_to(state, here + rows.FRICTION, -(step * (T * speed)))
    rigid = load(given, of + rows.RIGID) > zero
    if bits(rigid) != 0:
        # Nothing moves in the element, so what work the contact takes is the landing's loss.
        taken = fma(N, meanN, select(sticks, T * meanT, zero))
        add_to(state, here + rows.IMPACT, select(rigid, -(step * taken), zero))
        speed = select(rigid, meanT, speed)
    size = magnitude(speed)
    contact = select(sticks, each(STICK), select(slips, each(SLIP), each(SEPARATION)))
    ended = 0
    if bits(contact == was) != EVERY:
        switched = ~(contact == was)
        first_slip, first_separation = (
            load(state, here + rows.FIRST_SLIP),
            load(state, here + rows.FIRST_SEPARATION),
        )
        slipped = switched & slips & ~(first_slip <= t)
        if bits(slipped) != 0:
            _slip_first(given, of, state, here, places, at, t, slipped)
            first_slip = load(state, here + rows.FIRST_SLIP)
        opened = switched & ~touch & ~(first_separation <= t)
        store(state, here + rows.FIRST_SEPARATION, select(opened, t, first_separation))
        ended = bits(opened & (load(given, of + rows.UNTIL_OPEN) > zero))
        counts = switched & (t >= load(state, here + rows.SETTLED_FROM))
        add_to(state, here + rows.SWITCHES, select(counts, one, zero))
        entered, left = switched & sticks, switched & (was == each(STICK))
        started = load(state, here + rows.STICK_START)
        long = bits(left & (t - started >= load(state, here + rows.LEAST_STICK)))
        if long != 0:
            store(scratch, rows.S_TIME, t)
            enter_sticks(state, here + rows.STICK_START, scratch, places, at, long)
        # The stick that a run begins with is not counted.
        started = select(entered & (first_slip <= t), t, select(left, each(np.nan), started))
        store(state, here + rows.STICK_START, started)
        leap_at = select(left, each(np.inf), load(state, here + rows.NEXT_LEAP))
        leap_at = select(entered, now + load(given, of + rows.PATIENCE), leap_at)
        store(state, here + rows.NEXT_LEAP, leap_at)
        store(state, here + rows.ANCHOR, select(entered, slid + newT, anchor))
        store(state, here + rows.CONTACT, contact)
    settled = t >= load(state, here + rows.SETTLED_FROM)
    weight = select(settled, step, zero)
    add_to(state, here + rows.STICK_TIME, select(sticks, weight, zero))
    add_to(state, here + rows.SLIP_TIME, select(slips, weight, zero))
    add_to(state, here + rows.APART_TIME, select(touch, zero, weight))
    store(state, here + rows.SUM_N, fma(weight, N, load(state, here + rows.SUM_N)))
    most, fastest = load(state, here + rows.MAX_N), load(state, here + rows.MAX_SLIP)
    store(state, here + rows.MAX_N, select(settled & (most < N), N, most))
    store(state, here + rows.MAX_SLIP, select(settled & (size > fastest), size, fastest))
    if bits(load(state, here + rows.NEXT) == now) != 0:
        share = load(given, of + rows.SHARE)
        watched = (load(state, here + rows.NEXT_SAMPLE) == now) & (share <= one)
        ended |= bits(watched & (~sticks | (magnitude(T) > share * (mu * N))))
        store(scratch, rows.S_TIME, t)
        store(scratch, rows.S_N, N)
        store(scratch, rows.S_T, T)
        store(scratch, rows.S_SPEED, speed)
        store(scratch, rows.S_CONTACT, contact)
        store(scratch, rows.S_SIZE, size)
        _look(sizes, group, modes, damping, point_b, given, state, places, v, scratch, settled)
    now = now + one
    store(state, here + rows.NOW, now)
    return ended | bits((load(state, here + rows.LAST) <= now) | (load(state, here + rows.NEXT_LEAP) <= now))


@inlined
def _slip_first(given: int, of: int, state: int, here: int, places: int, at: int, t: Any, slipped: Any) -> None:
    """The first slip says which sticks are long, and starts the statistics anew."""
    zero = each(0.0)
    store(state, here + rows.FIRST_SLIP, select(slipped, t, load(state, here + rows.FIRST_SLIP)))
    least_stick, settling = load(state, here + rows.LEAST_STICK), load(state, here + rows.SETTLING)
    store(state, here + rows.LEAST_STICK, select(slipped & ~(least_stick >= zero), each(0.2) * t, least_stick))
    anew = slipped & (settling >= zero)
    store(state, here + rows.SETTLED_FROM, select(anew, t + settling, load(state, here + rows.SETTLED_FROM)))
    for row in range(here + rows.SUM_N, here + rows.SLIP_TIME + 1):
        store(state, row, select(anew, zero, load(state, row)))
    clear(places, at, bits(anew))


@inlined
def _look(
    sizes: Any, group: int, modes: int, damping: int, point_b: int, given: int, state: int, places: int, v: int,
    scratch: int, settled: Any,
) -> None:  # fmt: skip
    """Take samples, listen and record where it is time to."""
    of, here, at = group * rows.GIVEN, group * rows.STATE, group * rows.PLACES
    both, normal, tangential = sizes
    first = group * (both + normal + tangential)
    first_row = group * (rows.BOTH * both + rows.ONE * (normal + tangential))
    now, hN, hT = load(state, here + rows.NOW), load(state, here + rows.KICK_N), load(state, here + rows.KICK_T)
    sampling, hearing = load(state, here + rows.NEXT_SAMPLE), load(state, here + rows.NEXT_HEARD)
    writing = load(state, here + rows.NEXT_ROW)
    sampled, heard, written = sampling == now, hearing == now, writing == now
    if bits(sampled) != 0:
        spread(given, of, scratch, places, at, bits(sampled & settled))
        sampling = select(sampled, now + each(rows.SAMPLED), sampling)
    if bits(heard | written) != 0:
        kick = fma(load(given, of + rows.B_N), hN, load(given, of + rows.B_T) * hT)
        store(scratch, rows.S_B, along(point_b, v, first, first + both + normal + tangential) + kick)
        power = damped(sizes, modes, first_row, damping, v, first, each(0.5) * hN, each(0.5) * hT)
        lost = load(given, of + rows.HEARING) * (load(given, of + rows.STEP) * power)
        add_to(state, here + rows.DAMPED, select(heard, lost, each(0.0)))
        hear(scratch, places, at, bits(heard))
        record(scratch, places, at, bits(written))
        hearing = select(heard, now + load(given, of + rows.HEARING), hearing)
        writing = select(written, now + load(given, of + rows.RECORDING), writing)
    store(state, here + rows.NEXT_SAMPLE, sampling)
    store(state, here + rows.NEXT_HEARD, hearing)
    store(state, here + rows.NEXT_ROW, writing)
    store(state, here + rows.NEXT, least(sampling, least(hearing, writing)))


@inlined
def move(sizes: Any, group: int, modes: int, slides: int, given: int, state: int, q: int, v: int) -> None:
    """Kick the modes of a group of lanes and move them over one step."""
    of, here = group * rows.GIVEN, group * rows.STATE
    both, normal, tangential = sizes
    first = group * (both + normal + tangential)
    row = group * (rows.BOTH * both + rows.ONE * (normal + tangential))
    hN, hT = load(state, here + rows.KICK_N), load(state, here + rows.KICK_T)
    gN, gT, vN, vT = kick_and_move(sizes, modes, row, q, v, first, hN, hT)
    if slides != 0:
        byN, byT, rateN, rateT = follow_shapes(sizes, modes, row, slides, q, v, first)
        gN, gT, vN, vT = gN + byN, gT + byT, vN + rateN, vT + rateT
        rest_N, rest_T = load(given, of + rows.REST_N), load(given, of + rows.REST_T)
        # What sticks does not slide over P2.
        add_to(state, here + rows.ANCHOR, byT + rest_T)
        add_to(state, here + rows.P_REST, -rest_N)
        add_to(state, here + rows.T_REST, rest_T)
        store(state, here + rows.CREEP, (byN + rest_N) * load(given, of + rows.PER_STEP))
    store(state, here + rows.G_N, gN)
    store(state, here + rows.G_T, gT)
    store(state, here + rows.V_N, vN)
    store(state, here + rows.V_T, vT)


@kernel
def work(
    groups: int,
    sizes: Any,
    modes: int,
    damping: int,
    point_b: int,
    slides: int,
    given: int,
    state: int,
    places: int,
    q: int,
    v: int,
    scratch: int,
    room: int,
) -> int:
    """Take steps and leaps in all lanes until a stretch has ended.

    Arrays are given by their addresses (`fivcore.lanes`).

    Parameters
    ----------
    groups : int
        How many groups of lanes are in use.
    sizes : tuple of 3 ints
        How many modes are felt in both directions, along the normal only, along the tangent only: even numbers.
        Modes come in this order.
    modes : ndarray, (groups (BOTH sizes[0] + ONE (sizes[1] + sizes[2])), WIDTH)
        Gap shapes and flow over a step.
    damping, point_b : ndarray, (groups n, WIDTH)
    slides : ndarray, (groups n, WIDTH)
        By how much the gap shapes change in a step; 0 for its address where all contact points stay.
    given, state, places : ndarray, (groups GIVEN, WIDTH), (groups STATE, WIDTH), (groups PLACES, WIDTH)
        Rows as in `fivcore.lane_rows`.
    q, v : ndarray, (groups n, WIDTH)
        Before the kick in the middle of the step `state[NOW]`.
    scratch : ndarray, (SCRATCH, WIDTH)
    room : ndarray, (WORKSPACE, 2 n)
        Of `fivcore.leap_kernel.leap`.

    Returns
    -------
    int
        Bit by bit, the lanes whose stretch has ended.
    """
    while True:
        ended = 0
        while ended == 0:
            for group in range(groups):
                ended |= meet(sizes, group, modes, damping, point_b, given, state, places, v, scratch) << (
                    group * WIDTH
                )
            for group in range(groups):
                move(sizes, group, modes, slides, given, state, q, v)
        for lane in range(groups * WIDTH):
            cell = lane // WIDTH * rows.STATE * WIDTH + lane % WIDTH
            now, last = number_at(state, cell + rows.NOW * WIDTH), number_at(state, cell + rows.LAST * WIDTH)
            if number_at(state, cell + rows.NEXT_LEAP * WIDTH) <= now < last:
                leap(lane, sizes, given, state, places, q, v, room)
                if number_at(state, cell + rows.NOW * WIDTH) < last:
                    ended &= ~(1 << lane)
        if ended != 0:
            return ended
