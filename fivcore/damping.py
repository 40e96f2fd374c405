"""Modes of a structure with its contact tied in both directions, and modal damping that fits their ratios."""

from __future__ import annotations

import numpy as np
from scipy import linalg, optimize

from fivcore.finite_elements import refined
from fivcore.jit import Array

# Fraction of the band in which tied modes can attain given ratios; above it they involve modes that are not
# computed.
BAND_SHARE = 0.8
# Weight of the tied modes above that fraction, and of the ratios of the free modes. With it the tied ratios below
# are within 0.8 % on the paper's rig with 11 to 361 modes, and no free mode has more than 1.6 times the ratio. A
# tenth of it gives 0.5 % but free modes without damping; a weight of 0 gives up to 18 times the ratio.
WEIGHT = 1e-2


def tied_modes(stiffness: Array, gaps: Array, static: int) -> tuple[Array, Array]:
    """Squared angular frequencies, rad2/s2, (k,), ascending, and shapes in the computed modes, (m, k).

    `stiffness`, (n,), and `gaps`, (2, n), kg^-1/2, include all modes; the last `static` ones act as springs.
    """
    m = len(stiffness) - static
    springs = gaps[:, m:] / np.sqrt(stiffness[m:])
    # Gaps without spring compliance, and spring extensions that close the others.
    rigid = linalg.null_space(springs.T).T @ gaps[:, :m] if static else gaps
    stretch = np.linalg.pinv(springs) @ gaps[:, :m]
    held = linalg.null_space(rigid / np.abs(rigid).max(axis=1, keepdims=True)) if len(rigid) else np.eye(m)
    matrix = held.T @ (np.diag(stiffness[:m]) + stretch.T @ stretch) @ held
    values, turn = refined(matrix, *np.linalg.eigh(matrix))
    return values, held @ turn


def tied_ratios(damping: Array, values: Array, shapes: Array) -> Array:
    """Damping ratios of the tied modes, (k,), to first order, for damping of the computed modes, 1/s, (m,)."""
    return np.asarray((shapes**2 / (2.0 * np.sqrt(values))).T @ damping)


def fitted(ratios: Array, stiffness: Array, values: Array, shapes: Array) -> Array:
    """Damping of the computed modes, 1/s, (m,), that gives the tied ones these ratios, (k,).

    Nonnegative least squares of the relative errors of first-order ratios. Among all damping that fits, the result
    is closest to the same ratios in the free modes.
    """
    if not ratios.any():
        return np.zeros(len(stiffness))
    tied, free = np.sqrt(values), np.sqrt(stiffness)
    unit = 2.0 * np.maximum(free, tied[0])
    weight = np.where(tied < BAND_SHARE * free[-1], 1.0, WEIGHT) / np.where(ratios > 0.0, ratios, ratios.mean())
    rows = weight[:, None] * tied_ratios(np.diag(unit), values, shapes)
    nearest = WEIGHT / ratios.mean()
    rows = np.vstack([rows, nearest * np.eye(len(free))])
    wanted = np.append(weight * ratios, nearest * np.interp(free, tied, ratios))
    return np.asarray(unit * optimize.nnls(rows, wanted)[0])
