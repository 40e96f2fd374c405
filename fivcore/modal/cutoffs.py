"""Cut-offs of motion: how many modes of a structure take part in impacts."""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.beams.modes import residual_flexibility

# Modes that move the gaps below the default cut-off of motion (the paper's rig: 115 kHz); a mode does if its share
# of a gap's inverse mass is above PART of the mean up to it (`python -m tests.benchmarks constants`).
MOTION_MODES, PART = 39, 1e-3
# Least frequency of the contact, in units of that of the highest kept mode, with which these are enough: it is
# root 3 of bending beams, 1 of rods; rigs of beams have 1.48 or more, solids 0.5 to 1.2 and twice as many modes.
SLENDER = 2.0**0.5
# As many as that where sliding grows above this share of the cut-off, where the contact's dashpot decides on it.
FURTHER_MODES, GROWTH_REACH = 50, 0.7
# Most modes in motion, whether they move the gaps or not.
MOST_MODES = 400


def motion_cutoff(own: Any, most: int = MOST_MODES, number: int | None = None) -> float | None:
    """Frequency above `number` modes that move the gaps, and at most `most` in all, Hz, to three digits.

    By default `MOTION_MODES`, twice as many where the contact is not `SLENDER`. None: there are fewer. The same
    whatever modes follow.
    """
    if number is None:
        return motion_cutoffs(own, most)[0]
    m = len(own.frequency)
    gaps = np.vstack([own.normal[..., :m], own.tangential[..., :m]]) ** 2
    mean = np.cumsum(gaps, axis=1) / np.arange(1, m + 1)
    moving = np.flatnonzero(np.any((gaps > PART * mean) & (gaps > 0.0), axis=0))
    last = min([most - 1, *moving[number - 1 : number].tolist()])
    return float(f"{own.frequency[last : last + 2].mean():.3g}") if m > last + 1 else None


def motion_cutoffs(own: Any, most: int) -> tuple[float | None, float | None]:
    """The usual cut-off of motion, and that where it grows near it, Hz."""
    usual = motion_cutoff(own, most, MOTION_MODES)
    if usual is None or _slender(own, usual):
        return usual, motion_cutoff(own, most, FURTHER_MODES)
    return motion_cutoff(own, most, 2 * MOTION_MODES), motion_cutoff(own, most, 2 * FURTHER_MODES)


def _slender(own: Any, cutoff: float) -> bool:
    """Whether the kept modes' mass on the others' compliance oscillates `SLENDER` times as fast as they do."""
    kept, shapes = own.stiffness < (2.0 * np.pi * cutoff) ** 2, np.vstack([own.normal, own.tangential])
    flexibility = residual_flexibility(own.stiffness[~kept], shapes[:, ~kept])
    least = SLENDER**2 * own.stiffness[kept].max(initial=0.0) * flexibility - shapes[:, kept] @ shapes[:, kept].T
    return bool(np.linalg.eigvalsh(least)[0] <= 0.0)
