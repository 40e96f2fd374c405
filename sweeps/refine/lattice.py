"""Which points of a dyadic lattice are computed, and how the others are predicted.

A lattice has (m - 1) 2^levels + 1 points along each axis. The coarse lattice, every 2^levels-th point, is computed
throughout. Then the spacing is halved, level by level. A new point is predicted from its neighbours on the lattice
before: values by linear interpolation, classes by agreement. A class is a whole number, an interval between
thresholds, or having no finite value. Each level computes, until results request no more, the points

- whose neighbours do not agree on their class, or whose predicted value is not of the class agreed on;
- that have a neighbour on the lattice of the level in another class;
- where second differences on the level before predict an error of linear interpolation above the tolerance;
- near a mispredicted point of this level: its class, or its value by more than the tolerance, is not as predicted;
- of a fixed sparse pattern, the control points.

Guarantee. In the end two neighbours of the finest lattice that are shown in different classes are both computed.
So every change of class that is shown is true, and each that is met is followed to its ends. What can be
missed are islands: points connected along the lattice, none of them computed, within what is shown as one class.

Estimate. The other rules choose points where errors are likely. Control points that they do not choose are a
sample of the interpolated points: the share of it that is mispredicted estimates how many of those are wrong. One
that is connected to another by mispredicted points does not count, for each would have led to the other; one that
is alone does (Good, Biometrika 40, 1953, 237-264: what a sample lacks is about as frequent as what it met once).
"""

from collections.abc import Iterator, Sequence
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sweeps.grid import Refinement

Values = NDArray[np.float64]
Codes = NDArray[np.int64]
Flags = NDArray[np.bool_]

# Classes of what has no finite value: not agreed on, no value, infinite.
UNSURE = int(np.iinfo(np.int64).min)
NOTHING, BELOW, ABOVE = UNSURE + 1, UNSURE + 2, UNSURE + 3
# Largest share and number of control points on a level: if none of so many is mispredicted, at most 1 % are wrong.
CONTROL_SHARE, CONTROL_POINTS = 1.0 / 12.0, 350


class Choice(NamedTuple):
    """The points to be computed, as far as the results so far decide, computed or not.

    Each finished level has its number (`level`) and `spacing` in units of the finest; the numbers of points
    `computed`, of `mispredicted` ones among them, of `control` points in the sample and of `missed` ones among
    these; how many points each of these `represents`; and the `largest` error of a prediction, 0 for classes.
    `exhausted` are the mispredicted points of the finest level, once that is finished.
    """

    points: Flags
    levels: list[dict[str, Any]]
    exhausted: Flags


@np.errstate(invalid="ignore")  # the difference of infinite values is NaN
def choose(
    values: Values, computed: Flags, levels: int, rule: Refinement, copies: Codes | None = None, start: Any = False
) -> Choice:
    """Choose the points to be computed, level by level, each time from the results of all chosen before.

    So the choice does not depend on the order in which results come, nor on where a run was interrupted. Arguments
    are as for `predict`, but nothing need be computed. `copies` are equal for points that are one computation:
    with one of them all are computed. Points of `start` are chosen in any case.
    """
    from scipy.ndimage import label, maximum_filter  # here, because it takes long and few commands refine

    dims, finished = computed.ndim, list[dict[str, Any]]()
    chosen, wrong = np.zeros_like(computed) | start, np.zeros_like(computed)
    chosen[coarse(levels, dims)] = True
    one = np.arange(computed.size).reshape(computed.shape) if copies is None else copies
    # An island of a class can lie hidden two steps away; errors of values lead from each point to the next.
    tolerance = None if rule.whole else rule.tolerance
    reach = 2 if tolerance is None else 1

    def complete() -> bool:
        if copies is not None:
            chosen[...] = np.isin(copies, copies[chosen])
        return bool(computed[chosen].all())

    for level in range(1, levels + 1) if complete() else ():
        part = coarse(levels - level, dims)
        here, own, same = chosen[part], values[part], one[part]  # views
        control, sample, earlier = control_points(here.shape), np.zeros_like(here), np.zeros_like(here)
        # Of each computation one point only.
        control &= np.isin(np.arange(same.size), np.unique(same, return_index=True)[1]).reshape(same.shape)
        earlier[coarse(1, dims)] = here[coarse(1, dims)]
        expected, expected_codes = predict(own, earlier, level, rule)
        while complete():
            shown, codes = predict(own, here, level, rule)
            finite, most = values[chosen & np.isfinite(values)], np.inf
            if tolerance is not None and finite.size:
                most = max(tolerance * float(np.ptp(finite)), rule.resolution * float(np.abs(finite).max()))
            errors = np.nan_to_num(np.abs(shown - expected), posinf=0.0)
            other = (codes != expected_codes) & (expected_codes != UNSURE)
            wrong = here & ~earlier & ((errors > most) | other)
            requested = _doubtful(shown, codes, most) | maximum_filter(wrong, 2 * reach + 1)
            more = requested & ~here
            if not more.any():  # and only then: the sample is of points that no result requests
                more = control & ~here
                sample |= more
            if not more.any():
                break
            here |= more
        else:
            here |= control
            break
        # Cubes of `reach` points touch where mispredicted points are within reach of each other.
        connected, count = label(maximum_filter(wrong, reach), np.ones((3,) * dims))
        missed = sample & wrong
        missed &= np.bincount(connected[missed], minlength=count + 1)[connected] == 1
        new, sample = here & ~earlier, sample & (missed | ~requested)
        sets = {"computed": new, "mispredicted": wrong, "control": sample, "missed": missed}
        record: dict[str, Any] = {"level": level, "spacing": 2 ** (levels - level)}
        record |= {name: len(np.unique(same[each])) for name, each in sets.items()}
        record |= {"represents": max(1.0 / CONTROL_SHARE, here.size / CONTROL_POINTS)}
        finished.append(record | {"largest": 0.0 if rule.whole else float(np.max(errors[new], initial=0.0))})
    if len(finished) == levels and np.any(computed & ~chosen):
        # Points that other runs have left in the file must not contradict their neighbours either.
        chosen = choose(values, computed, levels, rule, copies, computed).points
    return Choice(chosen, finished, wrong & (len(finished) == levels))


@np.errstate(invalid="ignore")  # the difference of infinite values is NaN
def predict(values: Values, computed: Flags, levels: int, rule: Refinement) -> tuple[Values, Codes]:
    """Predict the values and classes of the points that are not computed, level by level.

    Classes are those of the neighbours that have one, where these agree. Values are interpolated along each axis
    on which a point is odd and summed, less what then counts twice (Boolean sum). With only the corners of a cell
    computed this is multilinear interpolation; with points on its edges or faces it passes through them (Gordon,
    SIAM J. Numer. Anal. 8, 1971, 158-177). `values`, of any number of dimensions, are read where `computed`; the
    coarse lattice, `levels` halvings from this one, must be.
    """
    values, dims = np.where(computed, values, np.nan), computed.ndim
    codes = np.where(computed, classes(values, rule), UNSURE)
    # On each level the edges of cells before their faces and insides.
    for level, count in product(reversed(range(levels)), range(1, dims + 1)):
        own, own_codes, due = (each[coarse(level, dims)] for each in (values, codes, ~computed))  # views
        for odd in combinations(range(dims), count):
            (here,), beside = _near(dims, odd, 0), list(_near(dims, odd, 1))
            near = np.stack([own_codes[place] for place in beside])
            least = np.where(near == UNSURE, np.iinfo(np.int64).max, near).min(axis=0)
            agreed = np.where(least == near.max(axis=0), least, UNSURE)
            if rule.whole:
                predicted = np.where((agreed == UNSURE) | (agreed == NOTHING), np.nan, agreed)
            else:
                total: Any = 0.0
                for steps in range(1, count + 1):
                    # As many means as there are choices of axes, each of 2^steps points.
                    points = [own[place] for place in _near(dims, odd, steps)]
                    total = total - (-0.5) ** steps * sum(points[1:], points[0])
                predicted = np.where(np.isfinite(total), total, own[beside[0]])
                agreed = np.where(classes(predicted, rule) == agreed, agreed, UNSURE)
            np.copyto(own[here], predicted, where=due[here])
            np.copyto(own_codes[here], agreed, where=due[here])
    return values, codes


def coarse(levels: int, dims: int) -> tuple[slice, ...]:
    """The points of the lattice that lie 2^levels apart."""
    return (slice(None, None, 2**levels),) * dims


def control_points(shape: Sequence[int]) -> Flags:
    """New points of a level in a fixed pattern that is even and its own mirror image.

    A linear function of their indices, modulo 1, is small. Its factors are powers of the root of x^(d + 1) = x + 1
    in d dimensions, which spread points evenly; halved, they do so among the points of each parity.
    """
    root, phases = 1.0, np.zeros(shape)
    for _ in range(50):
        root = (1.0 + root) ** (1.0 / (len(shape) + 1.0))
    for axis, index in enumerate(np.indices(shape, sparse=True)):
        phases += 0.5 * root ** -(axis + 1.0) * np.minimum(index, shape[axis] - 1 - index)
    control = np.asarray(phases % 1.0 < min(CONTROL_SHARE, CONTROL_POINTS / phases.size))
    control[coarse(1, len(shape))] = False
    return control


def classes(values: Values, rule: Refinement) -> Codes:
    """The class of each value."""
    finite = np.nan_to_num(values, posinf=0.0, neginf=0.0)
    codes = finite.astype(np.int64) if rule.whole else np.digitize(finite, rule.thresholds, right=True)
    return np.select([np.isfinite(values), values == np.inf, values == -np.inf], [codes, ABOVE, BELOW], NOTHING)


def _near(dims: int, odd: Sequence[int], count: int) -> Iterator[tuple[slice, ...]]:
    """Neighbours, by a step along each of `count` axes, of points that are odd along just the axes `odd`."""
    moved = {-1: slice(0, -1, 2), 0: slice(1, None, 2), 1: slice(2, None, 2)}
    for axes, signs in product(combinations(odd, count), product((-1, 1), repeat=count)):
        steps = dict.fromkeys(odd, 0) | dict(zip(axes, signs, strict=True))
        yield tuple(moved[steps[axis]] if axis in steps else slice(0, None, 2) for axis in range(dims))


def _doubtful(values: Values, codes: Codes, most: float) -> Flags:
    """Points without a class, at a change of class, or where linear interpolation is likely to be off by `most`.

    Its error is h^2 f'' / 8, summed over the axes, by the larger second difference of the two even neighbours.
    """
    doubtful, errors = codes == UNSURE, np.zeros(values.shape)
    for axis in range(values.ndim):
        lines, marks = np.moveaxis(codes, axis, 0), np.moveaxis(doubtful, axis, 0)
        change = (lines[1:] != lines[:-1]) & (lines[1:] != UNSURE) & (lines[:-1] != UNSURE)
        marks[1:] |= change
        marks[:-1] |= change
        even, sums = np.moveaxis(values, axis, 0)[::2], np.moveaxis(errors, axis, 0)
        bends = np.full(even.shape, np.nan)
        bends[1:-1] = np.abs(even[2:] - 2.0 * even[1:-1] + even[:-2])
        sums[1::2] += np.nan_to_num(np.fmax(bends[1:], bends[:-1]), nan=0.0, posinf=0.0) / 8.0
    return np.asarray(doubtful | (errors > most))
