"""Refined maps of what is known everywhere, and how far boundaries of two maps lie apart."""

import numpy as np
from scipy.ndimage import distance_transform_cdt

from sweeps.refine import lattice


def refine(sweep, store, *backend, **options):
    """The refined sweep, planned and run."""
    return sweep.plan(store, **options).run(*backend)


def explored(truth, levels, rule, copies=None):
    """The refined map of a full one, which of its points were computed, and in how many passes.

    As by a refined sweep, but without files.
    """
    truth = np.asarray(truth, dtype=float)
    known = np.zeros(truth.shape, dtype=bool)
    passes = 0
    while True:
        chosen = lattice.closure(truth, known, levels, rule, copies)
        if known[chosen].all():
            return lattice.survey(truth, known, levels, rule).values, known, passes
        known |= chosen
        passes += 1


def edges(classes):
    """Where neighbours differ: on a grid twice as fine, half-way between them."""
    found = np.zeros([2 * n - 1 for n in classes.shape], dtype=bool)
    found[1::2, ::2] = classes[1:] != classes[:-1]
    found[::2, 1::2] = classes[:, 1:] != classes[:, :-1]
    return found


def distances(one, other):
    """From every boundary edge of one map to the nearest of the other, in cells, the larger along both axes."""
    there = edges(np.asarray(other))
    if not there.any():
        return np.full(np.count_nonzero(edges(np.asarray(one))), np.inf)
    return distance_transform_cdt(~there, metric="chessboard")[edges(np.asarray(one))] / 2.0
