"""Which points of a dyadic lattice are worth computing, and what the others are likely to be.

A lattice has (m - 1) 2^levels + 1 points along each axis; every 2^levels-th is of the coarse lattice, which is
computed throughout. Then the spacing is halved, level by level. A new point is predicted from the points about
it that the level before had: of values by linear interpolation along the lattice, blended where it lies between
points along several axes; of classes by agreement. A point is asked for

- where those do not agree on its class, or its predicted value is not of the class they agree on;
- where a neighbour on the lattice of the level is of another class than is predicted for it;
- where a point up to two steps away turned out not to be of the class that was predicted: it has met something
  finer, or the result is rough there;
- where second differences of the level before let an error of linear interpolation above the tolerance be
  expected.

What becomes known may ask for more; when nothing is asked for any more, the next level begins. A class is a whole
number, the interval between thresholds in which a float lies, or having no finite value.

Guarantee. In the end two neighbours of the finest lattice that are shown in different classes are both computed.
So every change of class that is shown is there, exactly where it is shown, and one that is met is followed along
the finest lattice wherever it leads. What is missed are islands: points that hang together along the lattice, none
of them computed, within what is shown as one class. They hold no coarse point and lie between computed ones: a
patch smaller than a coarse cell, or a strip that passes between the coarse points without touching anything that
was followed. What is said of values is an estimate: a peak between computed points leaves no trace in second
differences.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, product, takewhile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]
Codes = NDArray[np.int64]
Flags = NDArray[np.bool_]

# Classes that are no class of a finite value: not agreed upon, no value, infinite.
UNSURE = int(np.iinfo(np.int64).min)
NOTHING, BELOW, ABOVE = UNSURE + 1, UNSURE + 2, UNSURE + 3
# So many steps about a surprise are looked at: the nearest island that its neighbours hide is two steps away.
ABOUT = 2


@dataclass(frozen=True)
class Refinement:
    """What decides where a sweep is computed.

    Parameters
    ----------
    variable : str
        The variable that is looked at: one number a point. Of a whole number every value is a class of its own.
    levels : int
        Halvings of the coarse lattice's spacing along every axis: each has (m - 1) 2^levels + 1 values.
    tolerance : float, optional
        Largest error expected of interpolation, in units of the range of the values found; None: any.
    thresholds : tuple of float
        Ascending; a value up to the first of them is of one class, one above it of another, and so on.
    resolution : float
        Errors below this share of the largest value are rounding; `refined` makes it at least that of the variable
        as it is kept.
    whole : bool
        Whether every value is a class, between which nothing is interpolated; `refined` sets it by the variable.
    """

    variable: str
    levels: int
    tolerance: float | None = None
    thresholds: tuple[float, ...] = ()
    resolution: float = 1e-9
    whole: bool = False


class Survey(NamedTuple):
    """Values of a lattice, predicted where they are not known; and the points that are to be computed next."""

    values: Values
    asked: Flags


def coarse(levels: int, dims: int) -> tuple[slice, ...]:
    """The points of the lattice that lie 2^levels apart."""
    return (slice(None, None, 2**levels),) * dims


def survey(values: Values, known: Flags, levels: int, rule: Refinement) -> Survey:
    """Predict what is not known, and say what is to be computed next.

    Parameters
    ----------
    values : ndarray
        Of any number of dimensions; looked at where `known`.
    known : ndarray of bool, same shape
    levels : int
        Halvings between the coarse lattice, which must be known, and this one; those of the rule do not count.
    rule : Refinement
    """
    # Imported here: it takes long, and few commands refine.
    from scipy.ndimage import maximum_filter

    found = np.where(known, values, np.nan)
    codes = np.where(known, classes(found, rule), UNSURE)
    asked = np.zeros(known.shape, dtype=bool)
    most = _largest_error(found[known], rule)
    for level in reversed(range(levels)):
        part = coarse(level, known.ndim)
        with np.errstate(invalid="ignore"):  # infinite values have differences that are none
            surprises = _predict(found[part], codes[part], known[part], rule)
        if not asked.any():
            about = maximum_filter(surprises, 2 * ABOUT + 1)
            wanted = (codes[part] == UNSURE) | _at_changes(codes[part]) | about | (_errors(found[part]) > most)
            asked[part] = wanted & ~known[part]
    return Survey(found, asked)


def closure(values: Values, known: Flags, levels: int, rule: Refinement, copies: Codes | None = None) -> Flags:
    """All points that are wanted, as far as what is known tells.

    The points are chosen level by level, each time from the results of all that were chosen before: so the choice
    does not depend on the order in which results come, nor on where a run was interrupted.

    Parameters
    ----------
    values, known, levels, rule
        As for `survey`; nothing need be known.
    copies : ndarray of int, optional
        Equal for points that are one computation: with one of them all are known.
    """
    chosen = np.zeros(known.shape, dtype=bool)
    chosen[coarse(levels, known.ndim)] = True
    while True:
        if copies is not None:
            chosen = np.isin(copies, copies[chosen])
        if not known[chosen].all():
            return chosen
        asked = survey(values, chosen, levels, rule).asked
        if not asked.any():
            break
        chosen |= asked
    # Of what other runs have left in the file, too, nothing may contradict the points about it.
    chosen |= known
    return chosen | survey(values, chosen, levels, rule).asked


def finest_known(known: Flags) -> int | None:
    """The number of halvings after which a lattice that is known throughout becomes this one; None if none is."""
    spans = np.array(known.shape) - 1
    levels = takewhile(lambda level: not np.any(spans % 2**level), range(max(known.shape).bit_length()))
    return next((level for level in levels if known[coarse(level, known.ndim)].all()), None)


def classes(values: Values, rule: Refinement) -> Codes:
    """The class of each value."""
    finite = np.nan_to_num(values, posinf=0.0, neginf=0.0)
    codes = finite.astype(np.int64) if rule.whole else np.digitize(finite, rule.thresholds, right=True)
    return np.select([np.isfinite(values), values == np.inf, values == -np.inf], [codes, ABOVE, BELOW], NOTHING)


def _predict(values: Values, codes: Codes, known: Flags, rule: Refinement) -> Flags:
    """Predict the points half-way between the even ones; which known points are not of the class predicted."""
    dims = values.ndim
    surprises = np.zeros(known.shape, dtype=bool)
    for count in range(1, dims + 1):
        for odd in combinations(range(dims), count):
            here = _shifted(dims, odd, {})
            agreed = _agreed([codes[near] for near in _about(dims, odd, 1)])
            surprises[here] = known[here] & (agreed != UNSURE) & (agreed != codes[here])
            if rule.whole:
                predicted = np.where((agreed == UNSURE) | (agreed == NOTHING), np.nan, agreed)
            else:
                predicted = _blended(values, odd)
                agreed = np.where(classes(predicted, rule) == agreed, agreed, UNSURE)
            np.copyto(values[here], predicted, where=~known[here])
            np.copyto(codes[here], agreed, where=~known[here])
    return surprises


def _blended(values: Values, odd: Sequence[int]) -> Values:
    """Linear interpolation along each odd axis, summed, less what then counts twice (Boolean sum).

    With all but the corners of a cell predicted this is multilinear interpolation; with points known on its edges
    or faces it passes through them (Gordon, SIAM J. Numer. Anal. 8, 1971, 158-177).
    """
    total: Any = 0.0
    for count in range(1, len(odd) + 1):
        near = [values[place] for place in _about(values.ndim, odd, count)]
        # As many means as there are choices of axes, each of 2^count points.
        total = total - (-0.5) ** count * sum(near[1:], near[0])
    nearest = values[next(_about(values.ndim, odd, 1))]
    return np.asarray(np.where(np.isfinite(total), total, nearest))


def _agreed(codes: Sequence[Codes]) -> Codes:
    """The class that all have who are sure; UNSURE if there is none."""
    near = np.stack(codes)
    least = np.where(near == UNSURE, np.iinfo(np.int64).max, near).min(axis=0)
    return np.where(least == near.max(axis=0), least, UNSURE)


def _at_changes(codes: Codes) -> Flags:
    """Points with a neighbour of another class, where both are sure."""
    found = np.zeros(codes.shape, dtype=bool)
    for axis in range(codes.ndim):
        lines, marks = np.moveaxis(codes, axis, 0), np.moveaxis(found, axis, 0)
        here, next_ = lines[:-1], lines[1:]
        change = (here != next_) & (here != UNSURE) & (next_ != UNSURE)
        marks[:-1] |= change
        marks[1:] |= change
    return found


def _errors(values: Values) -> Values:
    """Error of linear interpolation at the odd points, by the second differences of the even ones about them.

    Of h^2 f'' / 8 along each axis the larger from both sides, the sum over axes; 0 where nothing tells.
    """
    total = np.zeros(values.shape)
    for axis in range(values.ndim):
        even, sums = np.moveaxis(values, axis, 0)[::2], np.moveaxis(total, axis, 0)
        bends = np.full(even.shape, np.nan)
        with np.errstate(invalid="ignore"):
            bends[1:-1] = np.abs(even[2:] - 2.0 * even[1:-1] + even[:-2])
        sums[1::2] += np.nan_to_num(np.fmax(bends[1:], bends[:-1]), nan=0.0, posinf=0.0) / 8.0
    return total


def _largest_error(values: Values, rule: Refinement) -> float:
    """The error that may remain, in the unit of the values."""
    finite = values[np.isfinite(values)]
    if rule.whole or rule.tolerance is None or not len(finite):
        return np.inf
    return max(rule.tolerance * float(np.ptp(finite)), rule.resolution * float(np.abs(finite).max()))


def _about(dims: int, odd: Sequence[int], count: int) -> Iterator[tuple[slice, ...]]:
    """Of the points that are odd along some axes, the neighbours by a step along each of `count` of these."""
    for axes in combinations(odd, count):
        for steps in product((-1, 1), repeat=count):
            yield _shifted(dims, odd, dict(zip(axes, steps, strict=True)))


def _shifted(dims: int, odd: Sequence[int], steps: dict[int, int]) -> tuple[slice, ...]:
    """The points that are odd along some axes and even along the others, each a step further."""
    moved = {-1: slice(0, -1, 2), 0: slice(1, None, 2), 1: slice(2, None, 2)}
    return tuple(moved[steps.get(axis, 0)] if axis in odd else slice(0, None, 2) for axis in range(dims))
