"""How often modes are linked wrongly, by what compares them: behind `fivcore.stability.following`.

Random structures along friction, and along the frequency of an open mode at one friction: modes veer, cross and
lock in. The reference follows exponents in `DENSE` steps, each nearest to where its last two point. Over longer
steps modes are linked by four criteria; a link is wrong if the reference has another. Modes that come near to an
exceptional point within the step, where what each is called is a convention, do not count.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from fivcore import FollowedModes, SlidingModes, Structure, followed_modes, modes_along
from fivcore.jit import Array
from fivcore.stability import following

# Steps of the reference; longer ones; |S_aa| / |2 phi| of vectors of length 1 below which a point is exceptional.
DENSE, STEPS, RIGID = 10_000, (10, 40, 200), 0.1
VARIANTS = ((5e-3, 1.2, 10), (1e-3, 1.05, 10), (1e-2, 1.5, 8), (5e-3, 1.2, 4))
# With it MACXP has no mode without damping.
LEAST_DAMPING = 1e-3


def structure(seed: int) -> Structure:
    """A random structure; each third is damped by mode, by Rayleigh's law, or not at all."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 12))
    damping: Any = ({"damping_ratio": rng.uniform(1e-3, 0.03, n)}, {"d1": 20.0, "d2": 1e-7}, {})[seed % 3]
    load, t = -rng.uniform(0.2, 1.0, n), rng.normal(size=n)
    # Every other one has a mode with a node at the contact, nearly or wholly, which others cross.
    load[0] *= (1.0, 0.02)[seed % 2]
    t[0] *= (1.0, 0.02)[seed % 2]
    return Structure.from_modes(np.sort(rng.uniform(100.0, 12e3, n)), -load, t, load=load, **damping)


def along_friction(seed: int) -> Callable[[float], tuple[Any, ...]]:
    """Friction from 0 to 1."""
    own = structure(seed)
    return lambda s: (own, 0.0, s)


def along_frequency(seed: int) -> Callable[[float], tuple[Any, ...]]:
    """The frequency of an open mode from 1 to 9 kHz, friction of 0.2."""
    own = structure(seed)

    def at(s: float) -> tuple[Any, ...]:
        squares = own.stiffness.copy()
        squares[1] = (2e3 * np.pi * (1.0 + 8.0 * s)) ** 2
        damping = own.d1 + own.d2 * squares if own.rayleigh else own.damping
        return replace(own, stiffness=squares, damping=damping), 0.0, 0.2

    return at


def reference(points: list[Any]) -> tuple[list[Array], list[Array]]:
    """Numbers of the modes at each point, and those near an exceptional point."""
    numbers, near, last = list[Any]([np.arange(len(points[0].phi))]), list[Any](), dict[Any, Any]()
    count = len(points[0].phi)
    for k, point in enumerate(points):
        size = np.linalg.norm(point.left, axis=1) * np.linalg.norm(point.right, axis=1)
        rigid = np.abs(point.own) / np.maximum(2.0 * np.abs(point.phi) * size, 1e-300)
        if k:
            before, own = points[k - 1], numbers[-1]
            ahead = np.array([2.0 * z - last.get(number, z) for z, number in zip(before.phi, own, strict=True)])
            cost = np.minimum(np.abs(ahead[:, None] - point.phi), 0.05)
            rows, columns = linear_sum_assignment(cost)
            new = np.full(len(point.phi), -1)
            new[columns] = np.where(cost[rows, columns] < 0.05, own[rows], -1)
            fresh = new < 0
            new[fresh] = count + np.arange(fresh.sum())
            count += int(fresh.sum())
            last = dict(zip(own.tolist(), before.phi.tolist(), strict=True))
            numbers.append(new)
        near.append(numbers[-1][rigid < RIGID])
    return numbers, near


def macxp(one: Any, other: Any) -> Array:
    """The pole-weighted criterion of P. Vacher, B. Jacquier and A. Bucharles, ISMA 2010."""
    a, b = (
        each.phi.imag * 1j
        + np.where(
            np.abs(each.phi.real) < LEAST_DAMPING * np.abs(each.phi),
            -LEAST_DAMPING * np.abs(each.phi),
            each.phi.real,
        )
        for each in (one, other)
    )
    x, z = one.right, other.right
    both = np.abs(x.conj() @ z.T) / np.abs(a.conj()[:, None] + b) + np.abs(x @ z.T) / np.abs(a[:, None] + b)
    own = [
        np.sum(np.abs(v) ** 2, axis=1) / (2.0 * np.abs(p.real)) + np.abs(np.sum(v * v, axis=1)) / (2.0 * np.abs(p))
        for v, p in ((x, a), (z, b))
    ]
    return np.asarray(both**2 / (own[0][:, None] * own[1]))


def mac(one: Any, other: Any) -> Array:
    """The usual criterion, of right vectors."""
    x, z = (each.right / np.linalg.norm(each.right, axis=1, keepdims=True) for each in (one, other))
    return np.asarray(np.abs(x.conj() @ z.T) ** 2)


CRITERIA: dict[str, Callable[[Any, Any], Array]] = {
    "both sides": lambda one, other: 1.0 - following._costs(one, other),
    "MAC": mac,
    "MACXP": macxp,
    "exponents": lambda one, other: 1.0 - np.minimum(np.abs(one.phi[:, None] - other.phi), 1.0),
}


def compared(points: list[Any], numbers: list[Array], near: list[Array]) -> dict[tuple[str, int], Array]:
    """Links, wrong ones, those in no doubt (above NEAR), and wrong ones of them, by criterion and steps."""
    found = {(name, steps): np.zeros(4, int) for name in CRITERIA for steps in STEPS}
    for steps in STEPS:
        for i, j in pairwise(range(0, len(points), (len(points) - 1) // steps)):
            left_out = {int(each) for k in range(i, j + 1) for each in near[k]}
            here, there = numbers[i], numbers[j]
            for name, criterion in CRITERIA.items():
                values = np.nan_to_num(criterion(points[i], points[j]), nan=0.0)
                rows, columns = linear_sum_assignment(1.0 - np.clip(values, 0.0, 1.0))
                for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
                    if here[row] in there and not {int(here[row]), int(there[column])} & left_out:
                        wrong, sure = here[row] != there[column], values[row, column] > 1.0 - following.NEAR
                        found[name, steps] += np.array([1, wrong, sure, wrong and sure], int)
    return found


def problems(number: int, dense: int) -> Iterator[tuple[str, Any, list[Any], list[Array], list[Array]]]:
    """Paths, their dense points, and the reference."""
    for kind, path in (("friction", along_friction), ("frequency", along_frequency)):
        for seed in range(number):
            at = path(seed)
            points = following._AlongAny(at, 10e3, fixed=True).points(np.linspace(0.0, 1.0, dense + 1))
            yield kind, at, points, *reference(points)


def whole(at: Any, kind: str, points: list[Any], numbers: list[Array], near: list[Array]) -> Array:
    """Steps of a hundredth over which a number of `following` is another mode, and all that count."""
    values = np.linspace(0.0, 1.0, 101)
    modes: SlidingModes | FollowedModes = modes_along(at, values)
    if kind == "friction":
        modes = followed_modes(at(0.0)[0], 0.0, values)
    every, found = (len(points) - 1) // 100, np.zeros(2, int)
    rates = (modes.growth_rate / (2.0 * np.pi) + 1j * modes.frequency) / 1e4
    for k in range(100):
        i, j = k * every, (k + 1) * every
        left_out = {int(each) for m in range(i, j + 1) for each in near[m]}
        for column in rates[k : k + 2].T:
            if np.isfinite(column).all():
                a, b = (
                    int(numbers[m][np.abs(points[m].phi - z).argmin()])
                    for m, z in zip((i, j), column, strict=True)
                )
                if not {a, b} & left_out and a in numbers[j]:
                    found += [1, a != b]
    return found


def show(number: int, dense: int = DENSE) -> Iterator[str]:
    """Lines: shares of wrong links by criterion, and of the whole method."""
    total = dict[Any, Any]()
    for kind, at, *rest in problems(number, dense):
        for key, each in compared(*rest).items():
            total[kind, *key] = total.get((kind, *key), 0) + each
        for variant in VARIANTS:
            following.FIRST, following.GROWTH, following.HALVINGS = variant
            following._along_friction.cache_clear()
            name = f"{kind:10} FIRST {{:g}}, GROWTH {{:g}}, HALVINGS {{}}".format(*variant)
            total[name] = total.get(name, 0) + whole(at, kind, *rest)
        following.FIRST, following.GROWTH, following.HALVINGS = VARIANTS[0]
    for key, each in total.items():
        if not isinstance(key, str):
            links, wrong, sure, both = each.tolist()
            yield (
                f"  {key[0]:10}{key[2]:4d} steps, {key[1]:12}{wrong:6d} of {links} links wrong, "
                f"{both} of the {sure} in no doubt"
            )
        else:
            yield f"  {key}: {each[1]} of {each[0]} links of the whole method wrong"


if __name__ == "__main__":
    print("\n".join(show(6, 2000)))
