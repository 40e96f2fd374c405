"""Data of scenes in `method="fast"`: a record of numbers and blocks of modes for each, lanes for a group."""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.jit import Array
from fivcore.transient.statistics import COUNTED, FIELDS, SEPARATION, SLIP, STICK

# Rows of a block of modes: flow over a step (q' = A q + B v, v' = C q + D v), gap shapes, displacement and
# velocity, shape at B, damping.
BLOCK = 48
(A, B, C, D, NORMAL, TANGENTIAL, Q, V, POINT_B, DAMPING) = range(10)
BLOCK_ROWS = 10
BLOCK_SIZE = BLOCK * BLOCK_ROWS
# A step that does not come.
NEVER = 1 << 60
# Samples of stick before a skip is tried, and intervals between samples that one covers at most. A skip ends at
# multiples of the latter, so that what is asked for beside a run's motion cannot change the motion.
MIN_SAMPLES, MAX_SKIP = 48, 1024
# Scenes that a kernel takes through a step together, each in its lane.
LANES = 8

# N and T that stick needs from (p, u_T, v_N, v_T); how long before the middle of a step slip begins; the share of
# a lasting force that acts (`fivcore.contact.law.StatusMaps`). Each of them after separation, stick and slip.
STICK_LAW = [*(f"{force}{of}" for force in "NT" for of in "punt"), "offset", "share"]
_IN_STEP = [
    *(f"{name}_{state}" for state in (SEPARATION, STICK, SLIP) for name in STICK_LAW),
    # N and u_T of slip with T = mu N and T = -mu N from (p, u_T, v_N).
    *(f"{way}_{what}{of}" for way in ("ahead", "back") for what in "Nu" for of in "pun"),
    # u after a step of separation from u before it.
    "relax_NN relax_NT relax_TN relax_TT",
    # What a force adds to the mean rates of the gaps; the element's stiffness and what it loses, in slip too.
    "mu M_NN M_NT M_TT K_NN K_NT K_TT C_NN C_NT C_TT C_slip",
    # Drive of the clamp; 1 where there is no element.
    "step per_step speed ramp acceleration rigid",
    # Gaps and their rates by the modes before the impulse; penetration and g_T at rest, the latter with inertia of
    # the base; the element's state; g_T + u_T when stick began.
    "g_N g_T v_N v_T p_rest T_rest u_N u_T anchor",
    # Changes of the contact state; when the present stick began; the step of the last change that has not been
    # looked at yet, -1 for none.
    "switches stick_start changed_in",
]
# What every step of a scene reads or writes.
IN_STEP = [*" ".join(_IN_STEP).split(), *COUNTED]
# What a lane has besides: the present step, the next to be observed and the one before which the scene leaves; 1
# where it has slipped, and where its next separation matters; its shortest long stick; of a step the contact state
# after it, its forces and its slip rate, 1 where more than a count follows from a change of the state, the state
# before it and when a stick that it ended began.
_IN_LANE = "now next until slipped awaits_open least_stick contact N T slip_rate notable was begun"
_NUMBERS = [
    # Velocity of B for half an impulse; |T| / N above which a segment ends where a sample is taken.
    "B_N B_T threshold",
]
_COUNTS = [
    # Contact state, present step, end of the segment; the next sample, row of the record and try of a skip; the
    # step from which statistics count.
    "contact now last next_sample next_row next_skip settle sample_every row_every",
    # Whether the first separation ends the segment, and whether the segment has ended before its last step.
    "until_open stopped",
    # Modes and their blocks, and where they begin; where the tables of the skip begin (-1: none), and samples and
    # rows; how many there are of these.
    "modes blocks modes_at skip_at samples_at rows_at samples rows",
]
# The kernel finds what a lane takes over at the start of a record.
SCENE = np.dtype([
    *((name, "f8") for name in [*IN_STEP, *" ".join(_NUMBERS).split()]),
    *(field for field in FIELDS if field[0] not in IN_STEP),
    *((name, "i8") for name in " ".join(_COUNTS).split()),
])  # fmt: skip
GROUP = np.dtype([(name, "f8", (LANES,)) for name in [*IN_STEP, *_IN_LANE.split()]])


def lanes_for(scenes: Any) -> tuple[Array, Any, Array]:
    """View of the numbers of records (n,), a group (1,) and a view of its lanes, as the kernel needs them."""
    group = np.zeros(1, GROUP)
    return scenes.view(np.float64).reshape(len(scenes), -1), group, group.view(np.float64).reshape(-1, LANES)
