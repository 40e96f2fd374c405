"""Cut-offs of motion: how many modes of a structure take part in impacts."""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.beams.modes import residual_flexibility

# Number of gap-moving modes below the default cut-off of motion (the paper's rig: up to 115 kHz). A mode moves a
# gap if its part of the gap's inverse mass exceeds PART times the mean up to it (`python -m tests.benchmarks
# constants`).
MOTION_MODES, PART = 39, 1e-3
# Smallest contact frequency, relative to the highest kept one, for which MOTION_MODES are enough. It is the root
# of 3 for bending beams and 1 for rods. Rigs of beams have at least 1.48; solids have 0.5 to 1.2 and keep twice as
# many.
SLENDER = 2.0**0.5
# Number of modes if sliding grows above GROWTH_REACH of the cut-off, where the contact dashpot would affect the
# growth.
FURTHER_MODES, GROWTH_REACH = 50, 0.7
# Most modes in motion, whether they move the gaps or not.
MOST_MODES = 400


def motion_cutoff(own: Any, most: int = MOST_MODES, number: int | None = None) -> float | None:
    """Cut-off above `number` modes that move the gaps, and at most `most` in all, Hz, rounded to three digits.

    The default number is `MOTION_MODES`, or twice as many if the contact is not `SLENDER`. Returns None if there
    are fewer modes. The result does not depend on the modes above the cut-off.
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
    """The usual cut-off of motion, and the higher one for growth near the usual one, Hz."""
    usual = motion_cutoff(own, most, MOTION_MODES)
    if usual is None or _slender(own, usual):
        return usual, motion_cutoff(own, most, FURTHER_MODES)
    return motion_cutoff(own, most, 2 * MOTION_MODES), motion_cutoff(own, most, 2 * FURTHER_MODES)


def _slender(own: Any, cutoff: float) -> bool:
    """Whether the modal mass on the residual compliance oscillates `SLENDER` times as fast as the kept modes."""
    kept, shapes = own.stiffness < (2.0 * np.pi * cutoff) ** 2, np.vstack([own.normal, own.tangential])
    flexibility = residual_flexibility(own.stiffness[~kept], shapes[:, ~kept])
    least = SLENDER**2 * own.stiffness[kept].max(initial=0.0) * flexibility - shapes[:, kept] @ shapes[:, kept].T
    return bool(np.linalg.eigvalsh(least)[0] <= 0.0)
