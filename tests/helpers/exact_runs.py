"""Complete runs of method "exact", and their counters."""

import numpy as np

from fivcore.transient.statistics import ENERGIES


def run_for(run):
    """Simulate a run to its end."""
    while not run.done:
        run.advance()
        assert run.flush(1e-150)
    return run


def counted(run, *names):
    """Counters of a run."""
    return np.array([float(run.record[name][0]) for name in names])


def energy_residual(run):
    work, *lost = counted(run, *ENERGIES)
    parts = np.array([work, run.released_energy(), *(-part for part in lost)])
    return float(abs(parts.sum()) / np.abs(parts).sum())
