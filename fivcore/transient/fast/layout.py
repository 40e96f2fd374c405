"""Data of a scene in `method="fast"`: a record of numbers, and blocks of modes."""

from __future__ import annotations

import numpy as np

from fivcore.transient.statistics import FIELDS

# Rows of a block of modes: flow over a step (q' = A q + B v, v' = C q + D v), gap shapes, displacement and
# velocity, shape at B, damping.
BLOCK = 48
(A, B, C, D, NORMAL, TANGENTIAL, Q, V, OUTPUT, DAMPING) = range(10)
BLOCK_ROWS = 10
BLOCK_SIZE = BLOCK * BLOCK_ROWS
# A step that does not come.
NEVER = 1 << 60
# Samples of stick before a skip is tried, and intervals between samples that one covers at most. A skip ends at
# multiples of the latter, so that what is asked for beside a run's motion cannot change the motion.
MIN_SAMPLES, MAX_SKIP = 48, 1024
# Rows of a record that are handed over at once, about.
MOST_ROWS = 10_000

_ARRAYS = {
    # N and T of stick from (p, u_T, v_N, v_T), and how long before the middle of a step slip begins, s; after
    # separation, stick and slip (`fivcore.contact.law.DiscreteContact.stick`).
    "stick_law": (3, 9),
    # `fivcore.contact.law.SlipMap`.
    "slip": (10,),
    # What a force adds to the mean rates of the gaps; spring; dashpot, with C_TT in slip last: NN, NT, TT.
    "M": (3,),
    "K": (3,),
    "C": (4,),
    # Gaps and their rates a step after unit impulses: NN, NT, TT.
    "after_q": (3,),
    "after_v": (3,),
    # Velocity of B for half an impulse; power that the modes lose with the rates of half an impulse: NN, NT, TT.
    "output": (2,),
    "damped_by": (3,),
}
_NUMBERS = [
    # Coefficient of friction: static; in slip, where it is constant, and at which slip ends.
    "mu kinetic",
    # Step, drive of the clamp; |T| / N above which a segment ends where a sample is taken; the last slip rate.
    "step speed ramp acceleration threshold slip_rate",
    # For a rigid contact: rates of the gaps after the last impulse, and at it penetration, N, T and, in stick,
    # what was left of mu N - |T|; whether the contact was closed at the last two, 1 or 0; NaN: unknown.
    RIGID := "after_N after_T last_p last_N last_T last_left lasting",
    # Gaps and their rates by the modes before the impulse; penetration and g_T at rest, the latter with inertia of
    # the base; u; g_T + u_T when stick began.
    "g_N g_T v_N v_T p_rest T_rest u_N u_T anchor",
]
_COUNTS = [
    # Contact state, present step, end of the segment; the next sample, row of the record, sample of the
    # dissipation and try of a skip; the step from which statistics count.
    "contact now last next_sample next_row next_energy next_skip settle sample_every row_every energy_every",
    # Whether the contact is rigid, the first separation ends the segment, the segment has ended early.
    "rigid until_open stopped",
    # Places for modes and their blocks; of the first block those that may move both gaps, and those after them
    # that move the normal gap alone; whether there are tables of the skip; how many samples and rows there are.
    "modes blocks both others may_skip samples rows",
]
SCENE = np.dtype([
    *((name, "f8", shape) for name, shape in _ARRAYS.items()),
    *((name, "f8") for name in " ".join(_NUMBERS).split()),
    *FIELDS,
    *((name, "i8") for name in " ".join(_COUNTS).split()),
])  # fmt: skip
# Of a deviation: gaps and rates without the last impulse, and that impulse; u and the anchor as above.
_DEVIATION = "g_N g_T v_N v_T impulse_N impulse_T u_N u_T anchor"
TANGENT = np.dtype([(name, "f8") for name in _DEVIATION.split()])
