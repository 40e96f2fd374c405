"""The rows of the arrays in which lanes keep their scenes (`fivcore.transient.fast_kernel`): columns are lanes."""

# Rows of `given`, which a stretch does not change. The numbers of `fivcore.contact.law.regime_maps`: stick (N
# and T on p, u_T, v_N, v_T), slip for T = mu N and T = -mu N (N and u_T on p, u_T, v_N), what is left of u in
# separation, entry (as stick), lag, unevenness, landing (as stick), its lag.
STICKING, FORWARDS, BACKWARDS, APART, ENTRY, LAG, UNEVENNESS, LANDED, LANDED_LAG = 0, 8, 14, 20, 24, 32, 33, 34, 42
# Coefficient of friction, step and its inverse; what a force adds to the mean rates of the gaps, stiffness and
# damping of the element; what half a kick makes of the velocity of B.
(MU, STEP, PER_STEP, M_NN, M_NT, M_TT, K_NN, K_NT, K_TT, C_NN, C_NT, C_TT, B_N, B_T) = range(43, 57)
# What share of the laws' force acts at touch-down, and whether the contact is rigid.
(LANDING, RIGID) = range(57, 59)
# V, ramp, V over ramp; by how much the gaps at rest change in a step.
(PACE, RAMP, PULL, REST_N, REST_T) = range(59, 64)
# |T| above this share of mu N, or the end of stick, ends the stretch when samples are taken (never: infinity).
# Whether the first separation ends it. Steps between what is heard, and what is recorded; steps of stick before
# a leap is tried (never: infinity).
(SHARE, UNTIL_OPEN, HEARING, RECORDING, PATIENCE) = range(64, 69)
GIVEN = 69

# Rows of `state`: the step and the last one; gaps and rates by the modes; penetration and g_T at rest, the latter
# with the inertia of the base; rate of g_N by the motion of the contact point.
(NOW, LAST, G_N, G_T, V_N, V_T, P_REST, T_REST, CREEP) = range(9)
# The element's state, g_T + u_T at the last moment of sliding, contact state.
(U_N, U_T, ANCHOR, CONTACT) = range(9, 13)
# The next steps at which samples are taken, something is heard, something recorded, a leap tried; the first of
# these but for the last.
(NEXT_SAMPLE, NEXT_HEARD, NEXT_ROW, NEXT_LEAP, NEXT) = range(13, 18)
# The kick of the present step.
(KICK_N, KICK_T) = range(18, 20)
# The moments and sums of `fivcore.transient.statistics`, in its order.
FIRST_SLIP, FIRST_SEPARATION, STICK_START, SETTLED_FROM, SETTLING, LEAST_STICK = range(20, 26)
SUM_N, MAX_N, MAX_SLIP, SWITCHES, APART_TIME, STICK_TIME, SLIP_TIME = range(26, 33)
WORK, DAMPED, FRICTION, TERMINATION, IMPACT = range(33, 38)
STATE = 38

# Rows of `places`, whole numbers: addresses of the histograms, of what is heard, of the record, of the long
# sticks and of what a leap needs; how much there is of what is heard, of the record and of the sticks, and room
# for these.
(FORCES, SPEEDS, HEARD, ROWS, STICKS, LEAP, HEARD_COUNT, ROW_COUNT, STICK_COUNT, STICK_ROOM) = range(10)
PLACES = 10
# Rows of `scratch`: the columns of a record, and the size of the slip rate.
(S_TIME, S_B, S_N, S_T, S_SPEED, S_CONTACT, S_SIZE) = range(7)
SCRATCH, COLUMNS = 7, 6

# Every how many steps the histograms are filled; whatever is heard is heard at multiples of it.
SAMPLED = 10
# Intervals of hearing that a leap covers at most.
REACH = 1024
# Rows of the coefficients of a mode that is felt in both directions, and in one: its gap shapes, then a, b, c, d
# of the flow over a step.
BOTH, ONE = 6, 5
