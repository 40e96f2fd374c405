"""Data of a scene in `method="fast"`: a record of numbers, and the rows of its blocks of modes."""

from __future__ import annotations

import numpy as np

from fivcore.transient.statistics import FIELDS

# Rows of a block of modes: flow over a step (q' = A q + B v, v' = C q + D v), gap shapes, displacement and
# velocity, shape at B, damping, change of the gap shapes in a step.
BLOCK = 64
(A, B, C, D, NORMAL, TANGENTIAL, Q, V, POINT_B, DAMPING, SLIDE_N, SLIDE_T) = range(12)
BLOCK_ROWS = 12
BLOCK_SIZE = BLOCK * BLOCK_ROWS
# A step that does not come.
NEVER = 1 << 60
# Samples of stick before a skip is tried, and intervals between samples that one covers at most. A skip ends at
# multiples of the latter, so that what is asked for beside a run's motion cannot change the motion.
MIN_SAMPLES, MAX_SKIP = 48, 1024

# Contact law (`fivcore.contact.law.RegimeMaps`): N and T that stick needs from (p, u_T, v_N, v_T), in a step after
# stick, slip and separation; N and u_T of slip with T = mu N and T = -mu N from (p, u_T, v_N).
_LAW = [f"{regime}_{force}{of}" for regime in ("stick", "enter", "land") for force in "NT" for of in "punt"]
_LAW += [f"{way}_{what}{of}" for way in ("ahead", "back") for what in "Nu" for of in "pun"]
_NUMBERS = [
    # u after a step of separation from u before it; how long before the middle of a step slip begins, and contact
    # after separation; the share of a lasting force that a landing takes.
    "relax_NN relax_NT relax_TN relax_TT enter_offset land_offset landing_share",
    # What a force adds to the mean rates of the gaps; the element's stiffness and what it loses, in slip too.
    "mu M_NN M_NT M_TT K_NN K_NT K_TT C_NN C_NT C_TT C_slip",
    # Velocity of B for half an impulse; drive of the clamp; changes of the gaps at rest in a step of a contact
    # point that moves; |T| / N above which a segment ends where a sample is taken.
    "B_N B_T step per_step speed ramp acceleration rest_slide_N rest_slide_T threshold",
    # Gaps and their rates by the modes before the impulse; penetration and g_T at rest, the latter with inertia of
    # the base; rate of g_N by the motion of the contact point; the element's state; g_T + u_T when stick began.
    "g_N g_T v_N v_T p_rest T_rest moving_rate u_N u_T anchor",
]
_COUNTS = [
    # Contact state, present step, end of the segment, next step at which anything but a plain step happens: a
    # sample, a row of the record, the try of a skip, the step from which statistics count.
    "contact now last next next_sample next_row next_skip settle sample_every row_every",
    # Whether there is no element, the first separation ends the segment, the contact point moves, and whether the
    # segment has ended before its last step.
    "rigid until_open moving stopped",
    # Modes and their blocks, and where they begin; where the tables of the skip begin (-1: none), and samples and
    # rows; how many there are of these.
    "modes blocks modes_at skip_at samples_at rows_at samples rows",
]
SCENE = np.dtype([
    *FIELDS,
    *((name, "f8") for name in [*_LAW, *" ".join(_NUMBERS).split()]),
    *((name, "i8") for name in " ".join(_COUNTS).split()),
])  # fmt: skip
