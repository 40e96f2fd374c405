"""Where runs of `method="fast"` are computed side by side: benches of lanes, and who sits in them when.

A run is a generator. Where it needs steps to be taken it yields a `Stretch` and goes on when that has been filled
in. `side_by_side` puts the stretches of many runs into the lanes of benches, one bench for each set of numbers of
modes, and always works on the one with the most to do. What a lane computes does not depend on the others
(`fivcore.transient.lanes`), so neither does any run on what runs beside it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast

import numpy as np

from fivcore.jit import Array
from fivcore.transient import lane_rows as rows
from fivcore.transient.fast_kernel import work
from fivcore.transient.fast_solver import Solver
from fivcore.transient.lanes import WIDTH, aligned
from fivcore.transient.leap_kernel import WORKSPACE, room_width
from fivcore.transient.statistics import STATE, Tally

# Lanes of a bench. While one group waits for its contact forces the other moves its modes.
GROUPS = 2
LANES = GROUPS * WIDTH
# Runs under way at once: more than one bench takes, for while some are in their onset others are not.
AT_ONCE = 2 * LANES
# How long a stick lasts, in intervals of hearing, before a leap is tried; and then from one leap to the next.
PATIENCE = 48
Result = TypeVar("Result")
Kind = tuple[int, int, int, bool]
NO_END = 1 << 60


@dataclass(eq=False)
class Stretch:
    """Steps that a run wants to be taken.

    Attributes
    ----------
    solver : Solver
    q, v : ndarray, (n,)
        Before the kick in the middle of step `first`; changed in place, as `contact` and `tally` are.
    contact : ndarray, (3,)
        The element's state u_N and u_T, and g_T + u_T at the last moment of sliding.
    ahead : ndarray, (7,)
        g_N, g_T and their rates by the modes, penetration and g_T at rest, rate of g_N by the motion of the
        contact point, before the kick; NaN in the first four: not known.
    tally : Tally
    first, last : int
        In steps of the solver.
    pace, ramp : float
    hearing, recording : int
        Every how many steps something is heard, and recorded (0: never).
    share : float
        |T| above this share of mu N, or the end of stick, ends the stretch; infinite: it does not.
    until_open : bool
        Whether the first separation ends it.
    slides : tuple of ndarray
        By how much the gap shapes, normal and tangential, change in a step; empty where the contact point stays.
    slides_at_rest : tuple of float
        By how much that changes the gaps at rest.
    leads_to : tuple, optional
        Kind of the bench that the run is on the way to.
    leaps : ndarray, optional
        What `fivcore.transient.leaps.leaps` has packed: leap where the contact sticks.
    leap_at : float
        The step at which a leap is tried next, where the contact sticks.
    heard, rows, sticks : ndarray
        What came of it.
    """

    solver: Solver
    q: Array
    v: Array
    contact: Array
    ahead: Array
    tally: Tally
    first: int
    last: int
    pace: float
    ramp: float
    hearing: int
    recording: int
    share: float = np.inf
    until_open: bool = False
    slides: tuple[Array, ...] = ()
    slides_at_rest: tuple[float, float] = (0.0, 0.0)
    leads_to: Kind | None = None
    leaps: Array | None = None
    leap_at: float = np.inf
    heard: Array = field(default_factory=lambda: np.empty((0, 2)))
    rows: Array = field(default_factory=lambda: np.empty((0, rows.COLUMNS)))
    sticks: Array = field(default_factory=lambda: np.empty((0, 2)))

    @property
    def kind(self) -> Kind:
        """What lanes of one bench have in common."""
        return kind_of(self.solver, bool(self.slides))

    def begins(self) -> float:
        """When, s."""
        return self.first * self.solver.step


# A run in progress: it yields what is to be filled in, and returns its result.
Running = Generator[Stretch, None, Result]


def kind_of(solver: Solver, moving: bool = False) -> Kind:
    """What lanes of one bench have in common: the numbers of modes, and whether contact points move."""
    both, normal, tangential = solver.sizes
    return both, normal, tangential, moving


class Bench:
    """Lanes for scenes with equal numbers of modes."""

    def __init__(self, kind: Kind) -> None:
        *sizes, moving = self.kind = kind
        self.sizes = tuple(sizes)
        both, normal, tangential = self.sizes
        size = both + normal + tangential
        self._modes = in_groups(rows.BOTH * both + rows.ONE * (normal + tangential))
        self._damping, self._point_b, self._q, self._v = (in_groups(size) for _ in range(4))
        self._slides = in_groups(size if moving else 0)
        self._given, self._state = in_groups(rows.GIVEN), in_groups(rows.STATE)
        self._places = np.zeros((GROUPS, rows.PLACES, WIDTH), dtype=np.int64)
        self._scratch = aligned(rows.SCRATCH)
        self._room = np.zeros((WORKSPACE, room_width(size)))
        parts = (self._given, self._state, self._places, self._q, self._v, self._scratch, self._room)
        slides = self._slides.ctypes.data if moving else 0
        self._addresses = tuple(part.ctypes.data for part in (self._modes, self._damping, self._point_b))
        self._addresses += (slides, *(part.ctypes.data for part in parts))
        self.queue: list[Stretch] = []
        # Steps taken, up to multiples of what lies between two looks.
        self._clock = 0
        self._inside: list[Stretch | None] = [None] * LANES
        self._solvers: list[Solver | None] = [None] * LANES
        for lane in range(LANES):
            self._vacate(lane)

    def _column(self, lane: int) -> tuple[int, slice, int]:
        """Where a lane is in arrays of groups, rows and lanes."""
        return lane // WIDTH, slice(None), lane % WIDTH

    def _vacate(self, lane: int) -> None:
        """What is in no use is at rest, apart for ever, counts nothing and never ends."""
        column = self._column(lane)
        for part in (self._given, self._state, self._places, self._q, self._v):
            part[column] = 0
        given, state = self._given[column], self._state[column]
        given[rows.SHARE] = np.inf
        state[rows.LAST] = np.inf
        state[rows.NEXT_SAMPLE : rows.NEXT + 1] = np.inf
        state[rows.FIRST_SLIP : rows.LEAST_STICK + 1] = np.nan
        self._inside[lane] = None

    @property
    def stretches(self) -> list[Stretch]:
        """Those in lanes and those that wait for one."""
        return [stretch for stretch in self._inside if stretch is not None] + self.queue

    def _board(self, stretch: Stretch) -> None:
        """Take a stretch into a free lane, one that knows its solver if there is one."""
        free = [lane for lane in range(LANES) if self._inside[lane] is None]
        lane = next((lane for lane in free if self._solvers[lane] is stretch.solver), free[0])
        solver, tally, column = stretch.solver, stretch.tally, self._column(lane)
        given, state, places = self._given[column], self._state[column], self._places[column]
        q, v = self._q[column], self._v[column]
        if self._solvers[lane] is not solver or stretch.slides:
            self._modes[column] = solver.coefficients
            self._damping[column][solver.place] = solver.model.damping
            self._point_b[column][solver.place] = solver.model.point_b
            self._solvers[lane] = solver
        if stretch.slides:
            self._slides[column] = solver.placed(*stretch.slides)
        q[solver.place], v[solver.place] = stretch.q, stretch.v
        given[: len(solver.given)] = solver.given
        given[rows.PACE], given[rows.RAMP] = stretch.pace, stretch.ramp
        given[rows.PULL] = stretch.pace / stretch.ramp if stretch.ramp else 0.0
        given[[rows.REST_N, rows.REST_T]] = stretch.slides_at_rest
        given[rows.SHARE], given[rows.UNTIL_OPEN] = stretch.share, stretch.until_open
        given[rows.HEARING], given[rows.RECORDING] = stretch.hearing, stretch.recording or np.inf
        given[rows.PATIENCE] = np.inf if stretch.leaps is None else PATIENCE * stretch.hearing
        first, last, hearing, recording = stretch.first, stretch.last, stretch.hearing, stretch.recording
        state[rows.NOW], state[rows.LAST] = first, last
        state[rows.G_N : rows.CREEP + 1] = stretch.ahead
        state[rows.U_N : rows.ANCHOR + 1] = stretch.contact
        state[rows.CONTACT] = tally.flags[STATE]
        state[rows.NEXT_SAMPLE] = -(-first // rows.SAMPLED) * rows.SAMPLED
        state[rows.NEXT_HEARD] = -(-first // hearing) * hearing
        state[rows.NEXT_ROW] = -(-first // recording) * recording if recording else np.inf
        state[rows.NEXT] = state[rows.NEXT_SAMPLE : rows.NEXT_ROW + 1].min()
        state[rows.NEXT_LEAP] = np.inf if stretch.leaps is None else stretch.leap_at
        state[rows.FIRST_SLIP : rows.LEAST_STICK + 1] = tally.moments
        state[rows.SUM_N :] = tally.sums
        step = solver.step
        stretch.heard = np.empty(((last - first) // hearing + 1, 2))
        stretch.rows = np.empty(((last - first) // recording + 1 if recording else 0, rows.COLUMNS))
        stretch.sticks = tally.room(first * step, last * step, step)
        parts = (tally.forces, tally.speeds, stretch.heard, stretch.rows, stretch.sticks)
        places[: len(parts)] = [part.ctypes.data for part in parts]
        places[rows.LEAP] = 0 if stretch.leaps is None else stretch.leaps.ctypes.data
        places[rows.HEARD_COUNT :] = 0
        places[rows.STICK_ROOM] = len(stretch.sticks)
        self._inside[lane] = stretch

    def work(self) -> list[Stretch]:
        """Take steps in as many lanes as there is work for until a stretch has ended; return those that have."""
        self.queue.sort(key=Stretch.begins)
        ended = 0
        while ended == 0:
            most = self._let_in()
            groups = 1 if not any(self._inside[WIDTH:]) else GROUPS
            ended, taken = work(groups, most, self.sizes, *self._addresses)
            self._clock += taken
        return [self._leave(lane) for lane in range(LANES) if ended >> lane & 1]

    def _let_in(self) -> int:
        """Take in who waits, as far as there is room; how many steps may be taken before the next one is.

        Lanes hear something at the same steps, or each would stop all others for it: who begins elsewhere between
        two such steps waits for the others to get there.
        """
        if not any(self._inside):
            self._clock = self.queue[0].first
        soonest = NO_END
        for stretch in self.queue[: self._inside.count(None)]:
            wait = (stretch.first - self._clock) % stretch.hearing
            if wait == 0:
                self.queue.remove(stretch)
                self._board(stretch)
            else:
                soonest = min(soonest, wait)
        return soonest

    def _leave(self, lane: int) -> Stretch:
        stretch, column = cast(Stretch, self._inside[lane]), self._column(lane)
        state, places, tally, place = (
            self._state[column],
            self._places[column],
            stretch.tally,
            stretch.solver.place,
        )
        stretch.q[:], stretch.v[:] = self._q[column][place], self._v[column][place]
        stretch.first, stretch.leap_at = int(state[rows.NOW]), float(state[rows.NEXT_LEAP])
        stretch.ahead[:] = state[rows.G_N : rows.CREEP + 1]
        stretch.contact[:] = state[rows.U_N : rows.ANCHOR + 1]
        tally.flags[STATE] = state[rows.CONTACT]
        tally.moments[:] = state[rows.FIRST_SLIP : rows.LEAST_STICK + 1]
        tally.sums[:] = state[rows.SUM_N :]
        stretch.heard = stretch.heard[: places[rows.HEARD_COUNT]]
        stretch.rows = stretch.rows[: places[rows.ROW_COUNT]]
        stretch.sticks = stretch.sticks[: places[rows.STICK_COUNT]]
        self._vacate(lane)
        return stretch


def in_groups(size: int) -> Array:
    """Zeros for so many rows of each group, (GROUPS, size, WIDTH)."""
    return aligned(GROUPS * size).reshape(GROUPS, size, WIDTH)


def fulfil(stretch: Stretch) -> None:
    """Take the steps of one stretch by itself."""
    bench = Bench(stretch.kind)
    bench.queue.append(stretch)
    bench.work()


def alone(run: Running[Result]) -> Result:
    """Let one run go through; it raises what the run raises."""
    (result,) = side_by_side([run])
    if isinstance(result, Exception):
        raise result
    return result


def most_urgent(benches: list[Bench]) -> Bench:
    """Of the benches that are full, or that nobody else is on the way to, the one whose runs are far behind.

    Runs that others leave behind would have nobody to share a bench with at the end.
    """
    in_use = [bench for bench in benches if bench.stretches]
    expected = {stretch.leads_to for bench in in_use for stretch in bench.stretches}
    ripe = [bench for bench in in_use if len(bench.stretches) >= LANES or bench.kind not in expected]
    if not ripe:
        return max(in_use, key=lambda bench: len(bench.stretches))
    return min(ripe, key=lambda bench: min(stretch.begins() for stretch in bench.stretches))


def side_by_side(runs: Sequence[Running[Result]]) -> list[Result | Exception]:
    """Let runs go through; what each returns, or what it raises."""
    results: list[Any] = [None] * len(runs)
    to_start = deque(range(len(runs)))
    benches: dict[Kind, Bench] = {}
    whose: dict[int, int] = {}

    def resume(k: int) -> None:
        try:
            stretch = next(runs[k])
        except StopIteration as stop:
            results[k] = stop.value
        except Exception as error:  # noqa: BLE001 - it is this run's answer, and nobody else's
            results[k] = error
        else:
            whose[id(stretch)] = k
            if stretch.kind not in benches:
                benches[stretch.kind] = Bench(stretch.kind)
            benches[stretch.kind].queue.append(stretch)

    while True:
        while to_start and len(whose) < AT_ONCE:
            resume(to_start.popleft())
        if not whose:
            return results
        bench = most_urgent(list(benches.values()))
        for stretch in bench.work():
            resume(whose.pop(id(stretch)))
