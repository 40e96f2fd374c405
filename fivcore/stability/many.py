"""Flutter onsets of many rigs that differ in every number but their elements: a fraction of a millisecond each.

Modes come from `fivcore.beams.similar`, brackets from the search of `fivcore.stability.onsets`. The search takes a
time that goes with the number of poles, and most lie far beyond the band. Those are replaced by NODES poles, the
same for all rigs of one damping: with s = 1 / p, 1 / (p - lambda) = s / (1 - lambda s), and the second factor is
interpolated at the Chebyshev nodes of 0 < s < 1 / FAR, lambda in units of the band's. Its pole lies 49 half-widths
from the middle of this interval in the band, and at lambda = -MOST_REPORTED, where the interpolation is worst, 13.5:
an error of some 27^-NODES, less than rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize.elementwise import find_root

from fivcore import checks
from fivcore.beams.similar import lower_modes, unit_cantilever, upper_modes
from fivcore.errors import InputError, UnsolvedError
from fivcore.jit import Array, ReadOnlyArrays, kernel
from fivcore.rig import BEAM_LIMITS, RIG_LIMITS, Rig
from fivcore.stability.onsets import MOST_INTERVALS, axis_point, isolate, onset_friction, onset_function
from fivcore.stability.secular import MOST_REPORTED

FAR, NODES = 25.0, 12
# Rigs searched together, on which no result depends.
CHUNK = 256
# Numbers of a rig, columns of a table of rigs.
NUMBERS = ("theta", "contact_position", *RIG_LIMITS, *(f"{p}_{name}" for p in ("p1", "p2") for name in BEAM_LIMITS))


@dataclass(frozen=True, eq=False)
class ManyFlutterOnsets(ReadOnlyArrays):
    """Flutter onsets of n rigs, each rig's ascending in mu and followed by NaN; arrays are read-only.

    Attributes
    ----------
    mu, frequency, recovery_mu, recovery_frequency : ndarray, (n, onsets) or (n, recoveries)
        As for `FlutterOnsets`.
    divergence_mu : ndarray, (n,)
        Friction from which on a motion within the band grows without oscillation; NaN if there is none up to
        mu_max. It comes from beyond the band, as no eigenvalue passes zero: there P1's rigid mode has a pole that
        friction does not change.
    mu_max : float
    """

    mu: Array
    frequency: Array
    recovery_mu: Array
    recovery_frequency: Array
    divergence_mu: Array
    mu_max: float

    def unstable(self, mu: Any) -> NDArray[np.bool_]:
        """(n, m): whether a motion grows at friction mu, (m,), at most mu_max; a `ValueError` beyond.

        A pair of modes counts from its onset to its recovery in the band, even if it leaves the band between them;
        one that enters the band while it grows does not count.
        """
        friction = checks.array("mu", mu, lambda each: checks.between("mu", each, 0.0, self.mu_max, "up to mu_max"))
        friction = friction.reshape(-1)
        pairs = np.zeros((len(self.mu), len(friction)), dtype=np.int16)
        for onset in self.mu.T:
            pairs += onset[:, None] < friction
        for recovery in self.recovery_mu.T:
            pairs -= recovery[:, None] < friction
        return (pairs > 0) | (self.divergence_mu[:, None] < friction)


def flutter_onsets_many(
    numbers: Mapping[str, Any], fmax: float = 10e3, mu_max: float = 1.0, rig: Rig = Rig(), threads: int = 1
) -> ManyFlutterOnsets:
    """All flutter onsets and recoveries of many rigs, those of `flutter_onsets` but for rounding.

    Parameters
    ----------
    numbers : mapping of str to float or array_like, (n,)
        theta in degrees, and what differs from `rig`: contact_position, head_mass, d1, d2, and the numbers of a
        beam after "p1_" or "p2_", such as p1_length.
    fmax, mu_max : float
        Band, Hz; largest friction of interest.
    rig : Rig
        All numbers that are not named, and the beams' elements.
    threads : int
        On which no result depends.

    Returns
    -------
    ManyFlutterOnsets

    Raises
    ------
    ValueError, ArithmeticError
        For a number out of range, with its row; if the onsets of a rig cannot be isolated.
    """
    checks.instance("rig", rig, Rig)
    band, most = checks.band(fmax), checks.between("mu_max", mu_max, 1e-12, 1e6, "a coefficient of friction")
    workers, rows = checks.count("threads", threads, 1024), rig_table(numbers, rig)
    upper, lower = (unit_cantilever(beam.elements) for beam in (rig.p1, rig.p2))

    def search(start: int) -> tuple[Array, Array]:
        crossings, divergence, failed = _crossings(rows[start : start + CHUNK], 2.0 * np.pi * band, most, upper, lower)
        if failed >= 0:
            raise UnsolvedError(
                f"flutter_onsets_many: no friction up to mu_max = {most:g} can be told apart in row {start + failed} "
                f"below fmax = {band:g} Hz; choose a smaller band"
            )
        return crossings + [[start], [0.0], [0.0], [0.0]], divergence

    with ThreadPoolExecutor(workers) as pool:
        parts = list(pool.map(search, range(0, len(rows), CHUNK)))
    row, mu, frequency, rises = np.concatenate([np.empty((4, 0)), *(part for part, _ in parts)], axis=1)
    tables = []
    for kind in (rises > 0.0, rises <= 0.0):
        order = np.lexsort((mu[kind], row[kind]))
        places, count = row[kind][order].astype(int), np.bincount(row[kind].astype(int), minlength=len(rows))
        columns = np.arange(len(order)) - np.repeat(np.cumsum(count) - count, count)
        for values in (mu, band * frequency):
            tables.append(np.full((len(rows), count.max(initial=0)), np.nan))
            tables[-1][places, columns] = values[kind][order]
    divergence = np.concatenate([np.empty(0), *(part for _, part in parts)])
    return ManyFlutterOnsets(*tables, divergence, most)


def rig_table(numbers: Mapping[str, Any], rig: Rig) -> Array:
    """Checked table of rigs, (n, NUMBERS): what `numbers` names, and for the rest the numbers of `rig`."""
    checks.instance("numbers", numbers, Mapping)
    for name in numbers:
        checks.choice("numbers: a name", name, NUMBERS)
    if "theta" not in numbers:
        raise InputError("numbers: theta is missing")
    own = {"p1": rig.p1, "p2": rig.p2}
    given = []
    for name in NUMBERS:
        beam, _, field = name.partition("_")
        value = numbers[name] if name in numbers else getattr(own[beam], field) if beam in own else getattr(rig, name)
        column = checks.array(name, value, lambda each: each)
        if column.dtype.kind not in "iuf" or column.ndim > 1:
            raise InputError(f"{name} = {checks.short(value)}: it must be a number or a row of numbers")
        given.append(column.reshape(-1).astype(float))
    lengths = {len(column) for column in given} - {1}
    if len(lengths) > 1:
        raise InputError(f"numbers: arrays of {' and '.join(map(str, sorted(lengths)))} numbers: one length is needed")
    table = np.stack(np.broadcast_arrays(*given), axis=1)
    for name, column in zip(NUMBERS, table.T, strict=True):
        if name == "theta":
            good, allowed = np.abs(column) < 90.0, "between -90 and 90 degrees, both excluded"
        elif name == "contact_position":
            length = table[:, NUMBERS.index("p2_length")]
            good, allowed = (column > 0.0) & (column <= length), "above 0 and at most p2_length"
        else:
            low, high, unit = (RIG_LIMITS | BEAM_LIMITS)[name.removeprefix("p1_").removeprefix("p2_")]
            good, allowed = (column >= low) & (column <= high), f"a number from {low:g} to {high:g} ({unit})"
        if not np.all(good):
            row = int(np.argmin(good))
            raise InputError(f"{name} = {column[row]} in row {row}: it must be {allowed}")
    return table


def _crossings(rows: Array, unit: float, mu_max: float, upper: Any, lower: Any) -> tuple[Array, Array, int]:
    """Row, mu, frequency over the band's and W beyond, (4, k), of each crossing; divergences; an unsolved row or -1."""
    systems, sizes, brackets, divergence, failed = _isolate_rows(rows, unit, mu_max, upper, lower)
    row, low, high, _ = brackets.T
    index, damping = np.arange(len(brackets)), rows[:, 3:5] * [1.0 / unit, unit]

    def evaluated(omega: Array, k: Array) -> Array:
        return _evaluate(omega, k.astype(np.int64), brackets, systems, sizes, damping)

    found = find_root(lambda *at: evaluated(*at)[0], (low, high), args=(index,), tolerances={"xrtol": 1e-14})
    if failed < 0 and not np.all(found.success):
        failed = int(row[np.argmin(found.success)])
    mu = evaluated(found.x, index)[1]
    wanted = (mu > 0.0) & (mu <= mu_max)
    return np.stack([row, mu, found.x, evaluated(high, index)[0]])[:, wanted], divergence, failed


@kernel
def _evaluate(omega: Array, index: Any, brackets: Array, systems: Array, sizes: Any, damping: Array) -> Array:
    """W and the friction, (2, k), at omega in the brackets of the given indices."""
    result = np.empty((2, len(omega)))
    for j in range(len(omega)):
        k, n = int(brackets[index[j], 0]), int(brackets[index[j], 3])
        p, a, b = systems[k, 0, : sizes[k]], systems[k, 1, : sizes[k]], systems[k, 2, : sizes[k]]
        result[0, j] = onset_function(omega[j], n, p, a, b, damping[k, 0], damping[k, 1])
        result[1, j] = onset_friction(omega[j], n, p, a, b, damping[k, 0], damping[k, 1])
    return result


@kernel
def _isolate_rows(
    rows: Array, unit: float, mu_max: float, upper: Any, lower: Any
) -> tuple[Array, Any, Array, Array, int]:
    """Systems (rows, 3, poles), their sizes, brackets (row, low, high, pole), divergences, an unsolved row or -1."""
    systems = np.empty((len(rows), 3, upper[0].shape[1] + 1 + lower[1].shape[1] + NODES))
    sizes, divergence, failed = np.zeros(len(rows), dtype=np.int64), np.full(len(rows), np.nan), -1
    found, total, brackets = np.empty((len(rows), 4)), 0, np.empty((MOST_INTERVALS, 3))
    for k in range(len(rows)):
        d1, d2 = rows[k, 3] / unit, rows[k, 4] * unit
        x, y = axis_point(1.0, d1, d2)
        # The band's largest lambda, more than 1 with heavy damping.
        limit = max(1.0, np.hypot(x, y))
        p, a, b = contact_poles(rows[k], unit, limit, upper, lower)
        sizes[k] = len(p)
        systems[k, 0, : len(p)], systems[k, 1, : len(p)], systems[k, 2, : len(p)] = p, a, b
        if not np.any(b):
            continue
        # An odd number of real eigenvalues lies between -edge and zero where this changes its sign.
        edge = MOST_REPORTED * limit
        friction = -np.sum(a / (p + edge)) / np.sum(b / (p + edge))
        if 0.0 < friction <= mu_max:
            divergence[k] = friction
        count, judged = isolate(p, a, b, d1, d2, mu_max, brackets)
        if judged == MOST_INTERVALS:
            return systems, sizes, found[:0], divergence, k
        if total + count > len(found):
            found = np.concatenate((found, np.empty((len(found) + count, 4))))
        found[total : total + count, 0], found[total : total + count, 1:] = k, brackets[:count]
        total += count
    return systems, sizes, found[:total], divergence, failed


@kernel
def contact_poles(row: Array, unit: float, limit: float, upper: Any, lower: Any) -> tuple[Array, Array, Array]:
    """Squared frequencies p and residues a, b of `isolate`, those beyond FAR `limit` replaced; a row of `rig_table`.

    `upper` and `lower` are the beams' `unit_cantilever`, and `limit` is in units of unit^2.
    """
    mass, along, across = _scales(row[5:10])
    p, normal, tangential = upper_modes(row[0], row[2] / mass, along, across, upper[0], upper[2])
    mass2, along, across = _scales(row[10:15])
    p2, normal2 = lower_modes(row[1] / row[10], across, lower[0], lower[1])
    p = np.append(p, p2) / unit**2
    a = np.append(normal * normal / mass, normal2 * normal2 / mass2) / unit**2
    b = np.append(normal * tangential / mass, np.zeros(len(p2))) / unit**2
    far = p > FAR * limit
    near = ~far & (a != 0.0)
    if not np.any(far):
        return p[near], a[near], b[near]
    # Sums of residue times s times a Chebyshev polynomial, and from them the residues at the nodes.
    moments, share = np.zeros((2, NODES)), np.empty((3, NODES))
    for i in np.flatnonzero(far):
        s = 1.0 / p[i]
        z = 2.0 * FAR * limit * s - 1.0
        before, now = z, 1.0
        for j in range(NODES):
            moments[0, j] += a[i] * s * now
            moments[1, j] += b[i] * s * now
            before, now = now, (2.0 * z * now - before if j else z)
    for k in range(NODES):
        angle = (k + 0.5) * np.pi / NODES
        weights = np.cos(angle * np.arange(NODES)) * np.where(np.arange(NODES) == 0, 1.0, 2.0) / NODES
        share[0, k] = 2.0 * FAR * limit / (1.0 + np.cos(angle))
        share[1, k] = share[0, k] * np.sum(weights * moments[0])
        share[2, k] = share[0, k] * np.sum(weights * moments[1])
    return np.append(p[near], share[0]), np.append(a[near], share[1]), np.append(b[near], share[2])


@kernel
def _scales(beam: Array) -> tuple[float, float, float]:
    """Mass of a beam, and squared frequencies of axial and of bending modes over those of the unit beam."""
    length, width, thickness, young_modulus, density = beam[0], beam[1], beam[2], beam[3], beam[4]
    along = young_modulus / (density * length * length)
    return density * length * width * thickness, along, along * (thickness / length) ** 2
