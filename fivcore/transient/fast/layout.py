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
# A step number that is never reached.
NEVER = 1 << 60
# Samples of stick before a skip is attempted, and largest number of sampling intervals in a skip. Skips end at
# multiples of the latter, so that recording and other observation cannot change the motion.
MIN_SAMPLES, MAX_SKIP = 48, 1024
# Approximate number of rows of a record that are handed over at once.
MOST_ROWS = 10_000

_ARRAYS = {
    # For the previous status separation, stick and slip: matrix from (p, u_T, v_N, v_T) to N and T of stick, and
    # time between the start of slip and the middle of the step, s (`fivcore.contact.law.DiscreteContact.stick`).
    "stick_law": (3, 9),
    # `fivcore.contact.law.SlipMap`.
    "slip": (10,),
    # NN, NT and TT of the mean gap rates for unit forces, the spring, and the dashpot; C_TT in slip comes last.
    "M": (3,),
    "K": (3,),
    "C": (4,),
    # Gaps and their rates a step after unit impulses: NN, NT, TT.
    "after_q": (3,),
    "after_v": (3,),
    # Velocity of B for half an impulse; power dissipated by the modal rates of half an impulse: NN, NT, TT.
    "output": (2,),
    "damped_by": (3,),
}
_NUMBERS = [
    # Coefficients of friction: static; kinetic, if constant in slip, which also ends slip.
    "mu kinetic",
    # Step and drive of the clamp; |T| / N above which a segment ends at a sample; the last slip rate.
    "step speed ramp acceleration threshold slip_rate",
    # Rigid contact: gap rates after the last impulse; penetration, N, T and, in stick, mu N - |T| at that impulse;
    # 1 if the contact was closed at the last two impulses, otherwise 0; NaN: unknown.
    RIGID := "after_N after_T last_p last_N last_T last_left lasting",
    # Modal gaps and gap rates before the impulse; penetration and g_T at rest, the latter including the inertia of
    # the base; u; g_T + u_T at the start of stick.
    "g_N g_T v_N v_T p_rest T_rest u_N u_T anchor",
]
_COUNTS = [
    # Contact state, present step, end of the segment; steps of the next sample, row, dissipation sample and skip
    # attempt; first step of the statistics.
    "contact now last next_sample next_row next_energy next_skip settle sample_every row_every energy_every",
    # Flags: rigid contact; the first separation ends the segment; the segment ended early.
    "rigid until_open stopped",
    # Numbers of places for modes and of blocks; in the first block, of places that move both gaps and of those
    # after them that move only the normal gap; flag for skip tables; numbers of samples and rows written.
    "modes blocks both others may_skip samples rows",
]
SCENE = np.dtype([
    *((name, "f8", shape) for name, shape in _ARRAYS.items()),
    *((name, "f8") for name in " ".join(_NUMBERS).split()),
    *FIELDS,
    *((name, "i8") for name in " ".join(_COUNTS).split()),
])  # fmt: skip
# Fields of a deviation: gaps and rates without the last impulse, that impulse, and u and the anchor as above.
_DEVIATION = "g_N g_T v_N v_T impulse_N impulse_T u_N u_T anchor"
TANGENT = np.dtype([(name, "f8") for name in _DEVIATION.split()])
