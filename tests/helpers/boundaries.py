"""Fields, refined maps of them, and the distances between the boundaries of two maps."""

import numpy as np
from scipy.ndimage import distance_transform_cdt, gaussian_filter

from sweeps import Refinement
from sweeps.refine import lattice

X, Y = np.meshgrid(np.linspace(-1.0, 1.0, 65), np.linspace(-1.0, 1.0, 65), indexing="ij")
SHAPES = {
    "circle": np.hypot(X - 0.1, Y + 0.05) < 0.6,
    "line": X + 0.3 * Y > 0.1,
    "along the lattice": X > 0.01,
    "wedge": np.abs(Y - 0.03) < 0.25 * (X + 0.4),
    "three classes": np.digitize(np.hypot(X, Y) + 0.2 * np.sin(5.0 * X), [0.4, 0.9]),
    "checkerboard of quarters": (X > 0.02) ^ (Y > 0.3),
    "thin but rooted": ((np.abs(Y) < 0.04) & (X < 0.7)) | (X < -0.5),
}

# Values, and the largest share of them that is computed for a tolerance of 2 %.
SMOOTH = {
    "peak": (np.exp(-8.0 * (X**2 + Y**2)), 0.15),
    "waves": (np.sin(3.0 * X) * np.cos(2.0 * Y), 0.2),
    "kink": (np.abs(X - 0.3 * Y + 0.1), 0.15),
    "root": (np.sqrt(np.maximum(X + 0.4 * Y, 0.0)), 0.2),
}


def bumps(random, count=20, width=0.05):
    places = random.uniform(-1.0, 1.0, (count, 2))
    return X + sum(0.3 * np.exp(-((X - x) ** 2 + (Y - y) ** 2) / (2.0 * width**2)) for x, y in places)


ROUGH = {
    "bumps": bumps,
    "narrow bumps": lambda random: bumps(random, 40, 0.03),
    "kinks": lambda random: sum(np.abs(a * X + b * Y - c) for a, b, c in random.uniform(-1.0, 1.0, (6, 3))),
    "smooth": lambda random: gaussian_filter(random.normal(size=X.shape), 8.0),
    "rough": lambda random: gaussian_filter(random.normal(size=X.shape), 4.0),
    "speckle": lambda random: X - Y + 0.04 * random.normal(size=X.shape),
}


def noise(seed, width, size=33, classes=3):
    """Classes of any roughness, from speckle to smooth."""
    random = np.random.default_rng(seed).normal(size=(size, size))
    smooth = gaussian_filter(random, width) if width else random
    return np.digitize(smooth, np.quantile(smooth, np.arange(1, classes) / classes)).astype(float)


def Rule(thresholds=(), tolerance=None, whole=False):
    """The rule of a lattice without a sweep."""
    return Refinement("", 0, tolerance, thresholds, whole=whole)


CLASSES = Rule(whole=True)


def refine(sweep, store, *backend, **options):
    """Plan and run the refined sweep."""
    return sweep.plan(store, **options).run(*backend)


def explored(truth, levels, rule, copies=None):
    """The refined map of a full one, its computed points, and the last choice of points.

    It is computed as by a refined sweep, but without files.
    """
    truth = np.asarray(truth, dtype=float)
    computed = np.zeros(truth.shape, dtype=bool)
    while True:
        choice = lattice.choose(truth, computed, levels, rule, copies)
        if computed[choice.points].all():
            return lattice.predict(truth, computed, levels, rule)[0], computed, choice
        computed |= choice.points


def edges(classes):
    """Places where neighbours differ: on a grid twice as fine, midway between them."""
    changes = np.zeros([2 * n - 1 for n in classes.shape], dtype=bool)
    changes[1::2, ::2] = classes[1:] != classes[:-1]
    changes[::2, 1::2] = classes[:, 1:] != classes[:, :-1]
    return changes


def distances(one, other):
    """Distances of one map's boundary edges to the other's nearest, in cells, the larger along both axes."""
    there = edges(np.asarray(other))
    if not there.any():
        return np.full(np.count_nonzero(edges(np.asarray(one))), np.inf)
    return distance_transform_cdt(~there, metric="chessboard")[edges(np.asarray(one))] / 2.0
