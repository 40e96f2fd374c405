"""The contact forces of a group of lanes, by the numbers of `fivcore.contact.law.regime_maps`."""

from __future__ import annotations

from typing import Any

from fivcore.jit import inlined
from fivcore.transient import lane_rows as rows
from fivcore.transient.lanes import each, fma, load, magnitude, select
from fivcore.transient.statistics import SEPARATION, STICK


@inlined
def either(given: int, where: Any, a: int, b: int) -> Any:
    """Row a of `given` where it is true, elsewhere row b."""
    return select(where, load(given, a), load(given, b))


@inlined
def sticking(given: int, of: int, stuck: Any, apart: Any, k: int) -> Any:
    """The k-th number of the law for what sticks, by what it did before."""
    return select(
        stuck, load(given, of + rows.STICKING + k), either(given, apart, of + rows.LANDED + k, of + rows.ENTRY + k)
    )


@inlined
def find_contact(
    given: int, of: int, was: Any, uN: Any, uT: Any, anchor: Any, p: Any, gT: Any, vN: Any, vT: Any
) -> Any:
    """Which lanes stick, which slip, N, T, the element's new state and its u_T before.

    From penetration, g_T and their rates; where neither is true the surfaces are apart. `of` is the group's first
    row in `given`.
    """
    mu = load(given, of + rows.MU)
    stuck, apart = was == each(STICK), was == each(SEPARATION)
    left = fma(load(given, of + rows.APART + 1), uT, load(given, of + rows.APART) * uN)
    # Without an element the gap of a lasting contact is rounding: only its force can end it.
    opens = (p <= left) & (apart | (load(given, of + rows.RIGID) == each(0.0)))
    u = select(stuck, anchor - gT, uT)
    N = fma(sticking(given, of, stuck, apart, 1), u, sticking(given, of, stuck, apart, 0) * p)
    N = fma(sticking(given, of, stuck, apart, 2), vN, N)
    N = fma(sticking(given, of, stuck, apart, 3), vT, N)
    T = fma(sticking(given, of, stuck, apart, 5), u, sticking(given, of, stuck, apart, 4) * p)
    T = fma(sticking(given, of, stuck, apart, 6), vN, T)
    T = fma(sticking(given, of, stuck, apart, 7), vT, T)
    sticks = (each(0.0) < N) & (magnitude(T) <= mu * N) & ~opens
    # Between the middle of the step, where stick holds u_T, and its start, where slip begins.
    slid = fma(load(given, of + rows.M_NT), N, fma(load(given, of + rows.M_TT), T, vT))
    shift = either(given, apart, of + rows.LANDED_LAG, of + rows.LAG) * slid
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
