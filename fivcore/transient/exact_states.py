"""States of the exact motion at given times."""

from __future__ import annotations

import numpy as np

from fivcore.jit import Array
from fivcore.transient.drive import Canonical, State
from fivcore.transient.exact import DWELL, ExactRun
from fivcore.transient.statistics import STICK, Tally


def states_at(
    scene: Canonical,
    times: Array,
    *,
    ramp: float,
    cutoff: float | None = None,
    termination: str = "absorbing",
    initial: State | None = None,
) -> Array:
    """Exact motion of the kept modes at given times.

    Parameters
    ----------
    scene : Canonical
    times : ndarray, (m,)
        Ascending, s.
    ramp, cutoff, termination, initial
        As in `ExactRun`.

    Returns
    -------
    ndarray, (m, 2n)
        Modal displacements as deviations from `ReducedModel.rest`, then modal velocities, those of P2 relative to
        its clamp; canonical (F = 1).
    """
    run = ExactRun(
        scene, ramp=ramp, cutoff=cutoff, termination=termination, step=None, initial=initial,
        tally=Tally().start(STICK, None, 0.1, None), sample_rate=None,
    )  # fmt: skip
    run.tally.moments[:] = np.nan
    run.start(float(times[-1]) + DWELL)
    states = [run.state_at(float(t))[:-2] for t in times]
    return np.stack(states)
