"""The run of `method="exact"` that a scene needs, and its states at any times."""

from __future__ import annotations

import numpy as np

from fivcore.jit import Array
from fivcore.transient.exact import DWELL, ExactRun
from fivcore.transient.exact_falling import FallingRun
from fivcore.transient.normalised import Normalised, State
from fivcore.transient.options import RunOptions


def exact_run(scene: Normalised, options: RunOptions) -> ExactRun:
    """Make the run for the scene's law of friction."""
    return (ExactRun if scene.friction.constant else FallingRun)(scene, options)


def states_at(
    scene: Normalised, times: Array, *, ramp: float, cutoff: float | None = None, initial: State | None = None
) -> Array:
    """Exact motion at ascending `times` (m,), s; the others are options.

    Returns modal displacements, modal velocities, those of P2 relative to its clamp, and (u_N, u_T),
    (m, 2n + 2); displacements are deviations from those under the load alone; normalised (F = 1).
    """
    end = float(times[-1]) + DWELL
    run = exact_run(
        scene, RunOptions(duration=end, method="exact", ramp=ramp, cutoff=cutoff, initial=initial, step=end)
    )
    states = []
    for t in times:
        while run._stop <= t:
            run._next_status()
        states.append(run._state_at(float(t)))
    return np.stack(states)
