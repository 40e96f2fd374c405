"""What lanes leave behind, each in memory of its own, within `fivcore.transient.fast_kernel`.

`which` are the lanes that have something to note, bit by bit; `at` is the first row of their group in `places`,
which tells where it goes.
"""

from __future__ import annotations

from typing import Any

from fivcore.jit import inlined
from fivcore.transient import lane_rows as rows
from fivcore.transient.lanes import WIDTH, add_number, number_at, put_number, put_whole, whole_at
from fivcore.transient.statistics import BINS, bin_of


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
