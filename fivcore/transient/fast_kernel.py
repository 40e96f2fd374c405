"""The compiled heart of `method="fast"`: kept modes move exactly, the contact acts in symmetric kicks.

One step from kick to kick, for kicks in the middle of the time steps: evaluate the gap, let
`fivcore.contact.law` find the force, change the velocities by step times force, move every mode freely over
one step (a Strang splitting, second order). Coordinates are deviations from the static equilibrium under the
unit load, so the load needs no force of its own: a kick carries N - 1.

Every lane holds a scene of its own, at a time of its own (`transient.lanes`). Scenes share only numbers of modes
of three kinds: those that the contact feels in both directions (P1's), along its normal only (P2's bending) and
along its tangent only (P2's axial motion).

All arrays are (rows, lanes). There are two groups of lanes, the rows of the second below those of the first: while
the processor waits for the contact forces of one group it moves the modes of the other.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.jit import inlined, kernel
from fivcore.transient import lane_rows as rows
from fivcore.transient.lane_contact import find_contact
from fivcore.transient.lane_modes import along, damped, follow_shapes, kick_and_move
from fivcore.transient.lane_notes import clear, enter_sticks, hear, record, spread
from fivcore.transient.lanes import (
    WIDTH,
    bits,
    each,
    fma,
    least,
    load,
    magnitude,
    number_at,
    select,
    store,
)
from fivcore.transient.leap_kernel import leap
from fivcore.transient.statistics import SEPARATION, SLIP, STICK


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
    step, pace = load(given, of + rows.STEP), load(given, of + rows.PACE)
    pull, ramp, mu = load(given, of + rows.PULL), load(given, of + rows.RAMP), load(given, of + rows.MU)
    M_NN, M_NT, M_TT = load(given, of + rows.M_NN), load(given, of + rows.M_NT), load(given, of + rows.M_TT)
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
    rateN = load(state, here + rows.V_N) - (M_NN - creep)
    rateT = load(state, here + rows.V_T) - (M_NT + drive)
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
    meanN = fma(M_NN, N, fma(M_NT, T, rateN))
    meanT = fma(M_NT, N, fma(M_TT, T, rateT))
    ratesT = select(sticks, -meanT, select(slips, (newT - before) * load(given, of + rows.PER_STEP), zero))
    ratesN = select(touch, -meanN, zero)
    speed = meanT + ratesT
    # Apart, the element gives up what it holds; in contact, its dashpot loses. What the spring has taken over all
    # kicks of a contact is half its stiffness times the last penetration times the one after it; nothing, where
    # that is negative.
    heldN = select(was == each(SEPARATION), wasN, select(p > zero, p, zero))
    released = fma(load(given, of + rows.K_NN), fma(wasN, heldN, -(newN * newN)), zero)
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
    # In some lane the state changes every few steps: no branch could be foretold, so there is none.
    switched, stuck = ~(contact == was), was == each(STICK)
    settled = t >= load(state, here + rows.SETTLED_FROM)
    started, first_slip = load(state, here + rows.STICK_START), load(state, here + rows.FIRST_SLIP)
    entered, left = sticks & ~stuck, stuck & ~sticks
    slipped = switched & slips & ~(first_slip <= t)
    opened = switched & ~(touch | (load(state, here + rows.FIRST_SEPARATION) <= t))
    long = left & (t - started >= load(state, here + rows.LEAST_STICK))
    ended = 0
    if bits(slipped | opened | long) != 0:
        ended = _mark(given, of, state, here, places, at, scratch, t, slipped, opened, long)
        settled, first_slip = t >= load(state, here + rows.SETTLED_FROM), load(state, here + rows.FIRST_SLIP)
    add_to(state, here + rows.SWITCHES, select(switched & settled, one, zero))
    # The stick that a run begins with is not counted.
    started = select(entered & (first_slip <= t), t, select(left, each(np.nan), started))
    store(state, here + rows.STICK_START, started)
    # A leap is tried at a look, where all lanes are together.
    look = load(state, here + rows.NEXT_HEARD) + load(given, of + rows.PATIENCE)
    leap_at = select(left, each(np.inf), select(entered, look, load(state, here + rows.NEXT_LEAP)))
    store(state, here + rows.NEXT_LEAP, leap_at)
    store(state, here + rows.ANCHOR, select(entered, slid + newT, anchor))
    store(state, here + rows.CONTACT, contact)
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
        watched = (load(state, here + rows.NEXT_HEARD) == now) & (share <= one)
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
    return ended | bits((load(state, here + rows.LAST) <= now) | (leap_at <= now))


@inlined
def _mark(
    given: int, of: int, state: int, here: int, places: int, at: int, scratch: int, t: Any, slipped: Any,
    opened: Any, long: Any,
) -> int:  # fmt: skip
    """What happens seldom: first slip, first separation, the end of a long stick.

    The first slip says which sticks are long, and starts the statistics anew.
    """
    zero = each(0.0)
    store(state, here + rows.FIRST_SLIP, select(slipped, t, load(state, here + rows.FIRST_SLIP)))
    least_stick, settling = load(state, here + rows.LEAST_STICK), load(state, here + rows.SETTLING)
    store(state, here + rows.LEAST_STICK, select(slipped & ~(least_stick >= zero), each(0.2) * t, least_stick))
    anew = slipped & (settling >= zero)
    store(state, here + rows.SETTLED_FROM, select(anew, t + settling, load(state, here + rows.SETTLED_FROM)))
    for row in range(here + rows.SUM_N, here + rows.SLIP_TIME + 1):
        store(state, row, select(anew, zero, load(state, row)))
    clear(places, at, bits(anew))
    store(state, here + rows.FIRST_SEPARATION, select(opened, t, load(state, here + rows.FIRST_SEPARATION)))
    store(scratch, rows.S_TIME, t)
    enter_sticks(state, here + rows.STICK_START, scratch, places, at, bits(long))
    return bits(opened & (load(given, of + rows.UNTIL_OPEN) > zero))


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
    most: int,
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
) -> Any:
    """Take steps and leaps in all lanes until a stretch has ended.

    Arrays are given by their addresses (`fivcore.transient.lanes`).

    Parameters
    ----------
    groups : int
        How many groups of lanes are in use.
    most : int
        How many steps are taken at most.
    sizes : tuple of 3 ints
        How many modes are felt in both directions, along the normal only, along the tangent only: even numbers.
        Modes come in this order.
    modes : ndarray, (groups (BOTH sizes[0] + ONE (sizes[1] + sizes[2])), WIDTH)
        Gap shapes and flow over a step.
    damping, point_b : ndarray, (groups n, WIDTH)
    slides : ndarray, (groups n, WIDTH)
        By how much the gap shapes change in a step; 0 for its address where all contact points stay.
    given, state, places : ndarray, (groups GIVEN, WIDTH), (groups STATE, WIDTH), (groups PLACES, WIDTH)
        Rows as in `fivcore.transient.lane_rows`.
    q, v : ndarray, (groups n, WIDTH)
        Before the kick in the middle of the step `state[NOW]`.
    scratch : ndarray, (SCRATCH, WIDTH)
    room : ndarray, (WORKSPACE, 2 n)
        Of `fivcore.transient.leap_kernel.leap`.

    Returns
    -------
    ended : int
        Bit by bit, the lanes whose stretch has ended.
    taken : int
        How many steps were taken.
    """
    taken = 0
    while True:
        ended = 0
        while ended == 0 and taken < most:
            taken += 1
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
        if ended != 0 or taken >= most:
            return ended, taken
