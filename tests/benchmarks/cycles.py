"""What limit cycles of the paper's rig cost."""

from __future__ import annotations

from fivcore import Friction, Rig, Scene, follow_cycle, limit_cycle, simulate
from tests.benchmarks.stability import median
from tests.benchmarks.tables import Column, Table


def rig() -> Table:
    """Cycles from a neighbour, the end of a run and an irregular run, with falling friction; a branch."""
    scene = Scene(2e-3, 5.0, 0.12, 9.0, Rig(d2=1e-6))
    state = simulate(scene, 0.6).final_state
    found = limit_cycle(scene, state)
    irregular = Scene(6e-3, 5.0, 0.2, 9.0, Rig(d2=1.5e-7))
    falling = Scene(2e-3, 5.0, 0.115, 9.0, Rig(d2=1e-6), Friction(0.95, 0.05))
    end = simulate(falling, 0.6).final_state
    rows = [
        ["a cycle from a neighbour", median(lambda: limit_cycle(scene, found), 20)],
        ["a cycle from the end of a run", median(lambda: limit_cycle(scene, state), 5)],
        ["a cycle from an irregular run", median(lambda: limit_cycle(irregular), 3)],
        ["a cycle with falling friction", median(lambda: limit_cycle(falling, end), 3)],
        ["a hundred points over mu", median(lambda: follow_cycle(found, "mu", 2.0, most=100), 1)],
    ]
    return Table([Column("limit cycles"), Column("time", "s")], rows)


TABLES = {"rig": rig}
