"""Flutter onsets of many rigs that differ in every number but their elements: a fraction of a millisecond each.

Modes come from `fivcore.beams.similar`, brackets from the search of `fivcore.stability.onsets`. Its time goes with
the number of poles, and most of them lie far beyond the band. NODES poles replace those: with s = 1 / p, each term
1 / (p - lambda) = s / (1 - lambda s), and 1 / (1 - lambda s) is interpolated at the Chebyshev nodes of
0 < s < 1 / FAR, in units of the band's lambda. The pole of this function lies 49 half-widths of the interval from
its middle where |lambda| = 1, and 13.5 at lambda = -MOST_REPORTED: the error is some 98^-NODES or 27^-NODES of a
term, less than rounding (Trefethen, Approximation Theory and Approximation Practice, 2013, theorem 8.2).
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize.elementwise import find_root

from fivcore import checks
from fivcore.beams.similar import lower_deflections, unit_cantilever, upper_modes
from fivcore.errors import InputError, UnsolvedError
from fivcore.jit import Array, ReadOnlyArrays, kernel
from fivcore.rig import BEAM_NUMBERS, RIG_NUMBERS, Rig
from fivcore.stability.onsets import MOST_INTERVALS, axis_point, entries, isolate, onset_friction, onset_function
from fivcore.stability.secular import MOST_REPORTED

FAR, NODES = 25.0, 12
# Chebyshev nodes of (-1, 1), and their barycentric weights.
ANGLES = (np.arange(NODES) + 0.5) * np.pi / NODES
POINTS, WEIGHTS = np.cos(ANGLES), np.sin(ANGLES) * (-1.0) ** np.arange(NODES)
# Rigs searched together, on which no result depends.
BATCH = 256
# Numbers of a beam, and those of a rig and theta: the columns of `rig_table`.
BEAM, OWN = tuple(BEAM_NUMBERS)[:5], tuple(RIG_NUMBERS)[:4]
NUMBERS = ("theta", *OWN, *(f"{p}_{name}" for p in ("p1", "p2") for name in BEAM))
_PAPERS = Rig()


@dataclass(frozen=True, eq=False)
class ManyFlutterOnsets(ReadOnlyArrays):
    """Flutter onsets of n rigs, each rig's ascending in mu and followed by NaN; arrays are read-only.

    Attributes
    ----------
    mu, frequency, recovery_mu, recovery_frequency, entry_mu : ndarray, (n, any)
        As for `FlutterOnsets`.
    divergence_mu : ndarray, (n,)
        Friction above which a motion grows without oscillation, at no more than twice the band's angular frequency
        unless damping is heavy; NaN if that is above mu_max. It enters from beyond the band: no eigenvalue passes
        zero, where P1's rigid mode has a pole that friction does not change.
    mu_max : float
    """

    mu: Array
    frequency: Array
    recovery_mu: Array
    recovery_frequency: Array
    entry_mu: Array
    divergence_mu: Array
    mu_max: float

    def unstable(self, mu: Any) -> NDArray[np.bool_]:
        """(n, m): whether a motion grows at friction mu, (m,) for all rigs or each rig's own, (n, m).

        A mu that is not from 0 to mu_max is a `ValueError`.
        A pair of modes counts from its onset or entry to its recovery in the band, even where it grows beyond it.
        """
        limits = 0.0, self.mu_max, "a coefficient of friction up to mu_max"
        friction = checks.array("mu", mu, lambda each: checks.between("mu", each, *limits))
        friction = np.atleast_2d(friction)
        pairs = np.zeros(np.broadcast_shapes((len(self.mu), 1), friction.shape), dtype=np.int16)
        for sign, table in ((1, self.mu), (1, self.entry_mu), (-1, self.recovery_mu)):
            for each in table.T:
                pairs += sign * (each[:, None] < friction)
        return (pairs > 0) | (self.divergence_mu[:, None] < friction)


def flutter_onsets_many(
    numbers: Mapping[str, Any], fmax: float = 10e3, mu_max: float = 1.0, rig: Rig = _PAPERS, threads: int = 1
) -> ManyFlutterOnsets:
    """All flutter onsets and recoveries of many rigs: those of `flutter_onsets` but for rounding.

    Parameters
    ----------
    numbers : mapping of str to float or array_like, (n,)
        theta in degrees, and what differs from `rig`: contact_position, head_mass, d1, d2, and the numbers of a
        beam after p1_ or p2_, such as p1_length.
    fmax, mu_max : float
        Band, Hz; largest friction of interest.
    rig : Rig
        Whose elements and numbers all rigs have, but for the numbers that are named.
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
    workers, table = checks.count("threads", threads, 1024), rig_table(numbers, rig)
    beams = [unit_cantilever(beam.elements) for beam in (rig.p1, rig.p2)]

    def search(start: int) -> tuple[Array, Array]:
        crossings, divergence, failed = _crossings(table[start : start + BATCH], 2.0 * np.pi * band, most, *beams)
        if failed >= 0:
            raise UnsolvedError(
                f"flutter_onsets_many: no friction up to mu_max = {most:g} can be told apart in row "
                f"{start + failed} below fmax = {band:g} Hz; choose a smaller band"
            )
        crossings[0] += start
        return crossings, divergence

    with ThreadPoolExecutor(workers) as pool:
        solutions = list(pool.map(search, range(0, len(table), BATCH)))
    crossings = np.concatenate([np.empty((4, 0)), *(part for part, _ in solutions)], axis=1)
    crossings = crossings[:, np.lexsort(crossings[1::-1])] * [[1.0], [1.0], [band], [1.0]]
    on_axis, rises = crossings[2] <= band, crossings[3] > 0.0
    chosen = on_axis & rises, on_axis & ~rises, entries(crossings[0], ~on_axis, rises)
    tables = [part for each in chosen for part in _padded(crossings[:3, each], len(table))]
    divergence = np.concatenate([np.empty(0), *(part for _, part in solutions)])
    return ManyFlutterOnsets(tables[0], tables[1], tables[2], tables[3], tables[4], divergence, most)


def _padded(values: Array, rows: int) -> Array:
    """Values (1 + k, n) whose first says the row, ascending, as k tables with NaN behind each row's values."""
    row = values[0].astype(int)
    count = np.bincount(row, minlength=rows)
    tables = np.full((len(values) - 1, rows, count.max(initial=0)), np.nan)
    tables[:, row, np.arange(len(row)) - (np.cumsum(count) - count)[row]] = values[1:]
    return tables


def rig_table(numbers: Mapping[str, Any], rig: Rig) -> Array:
    """Checked numbers of rigs, (n, NUMBERS), those that are not named from `rig`."""
    checks.instance("numbers", numbers, Mapping)
    for name in numbers:
        checks.choice("a name in numbers", name, NUMBERS)
    if "theta" not in numbers:
        raise InputError("numbers: theta is missing")
    given = {}
    for name in NUMBERS:
        beam, _, field = name.partition("_")
        own = getattr(getattr(rig, beam), field) if field in BEAM else getattr(rig, name, None)
        value = numbers.get(name, own)
        column = checks.array(name, value, lambda each: each)
        if column.dtype.kind not in "iuf" or column.ndim > 1:
            raise InputError(f"{name} = {checks.short(value)}: it must be a number or a row of numbers")
        given[name] = column.reshape(-1).astype(float)
    if len(lengths := {len(column) for column in given.values()} - {1}) > 1:
        raise InputError(f"numbers: rows of {sorted(lengths)} numbers: they must have one length")
    table = np.stack(np.broadcast_arrays(*given.values()), axis=1)
    if len(table):
        # If a number is bad, then one that is not finite, the least or the largest of its kind, or this one.
        beyond = np.argmax(given["contact_position"] > given["p2_length"])
        for row in sorted({*np.argmin(table, axis=0), *np.argmax(table, axis=0), beyond}):
            _check(row, table[row].tolist(), rig)
    return table


def _check(row: int, values: list[Any], rig: Rig) -> None:
    """Raise what `Beam`, `Rig` and `flutter_onsets` would raise for the numbers of a row."""
    part = "p1"
    try:
        upper, part = replace(rig.p1, **dict(zip(BEAM, values[5:10], strict=True))), "p2"
        lower, part = replace(rig.p2, **dict(zip(BEAM, values[10:], strict=True))), "rig"
        Rig(upper, lower, *values[1:5])
        checks.theta_degrees(values[0])
    except InputError as error:
        raise InputError(f"{part} of row {row}: {error}") from None


def _crossings(table: Array, unit: float, mu_max: float, upper: Any, lower: Any) -> tuple[Array, Array, int]:
    """Crossings (4, k): row, mu, frequency over the band's, rise; divergences; a row that failed, or -1."""
    systems, sizes, brackets, divergence, failed = _isolate_rows(table, unit, mu_max, upper, lower)
    row, low, high, _ = np.ascontiguousarray(brackets.T)
    index, damping = np.arange(len(brackets)), table[:, 3:5] * [1.0 / unit, unit]

    def evaluated(omega: Array, k: Any) -> Array:
        return _evaluate(omega, brackets[k.astype(int)], systems, sizes, damping)

    solution = find_root(lambda *at: evaluated(*at)[0], (low, high), args=(index,), tolerances={"xrtol": 1e-14})
    if failed < 0 and not np.all(solution.success):
        failed = int(row[np.argmin(solution.success)])
    mu, rise = evaluated(solution.x, index)[1], evaluated(high, index)[0]
    return np.stack([row, mu, solution.x, rise])[:, (mu > 0.0) & (mu <= mu_max)], divergence, failed


@kernel
def _evaluate(omega: Array, brackets: Array, systems: Array, sizes: Any, damping: Array) -> Array:
    """W and the friction, (2, k), at omega in as many brackets."""
    result = np.empty((2, len(omega)))
    for j in range(len(omega)):
        k, n = int(brackets[j, 0]), int(brackets[j, 3])
        p, a, b = systems[k, 0, : sizes[k]], systems[k, 1, : sizes[k]], systems[k, 2, : sizes[k]]
        result[0, j] = onset_function(omega[j], n, p, a, b, damping[k, 0], damping[k, 1])
        result[1, j] = onset_friction(omega[j], n, p, a, b, damping[k, 0], damping[k, 1])
    return result


@kernel
def _isolate_rows(
    table: Array, unit: float, mu_max: float, upper: Any, lower: Any
) -> tuple[Array, Any, Array, Array, int]:
    """Systems (n, 3, poles), sizes, brackets (row, low, high, pole), divergences; a row that failed, or -1."""
    rows = len(table)
    systems = np.empty((rows, 3, upper[0].shape[1] + lower[0].shape[1] + 1 + NODES))
    sizes, divergence = np.zeros(rows, dtype=np.int64), np.full(rows, np.nan)
    roots, brackets = np.empty((0, 4)), np.empty((MOST_INTERVALS, 3))
    for k in range(rows):
        d1, d2 = table[k, 3] / unit, table[k, 4] * unit
        x, y = axis_point(1.0, d1, d2)
        # The band's largest lambda, more than 1 with heavy damping.
        limit = max(1.0, np.hypot(x, y))
        sizes[k] = contact_poles(table[k], unit, limit, upper, lower, systems[k])
        p, a, b = systems[k, 0, : sizes[k]], systems[k, 1, : sizes[k]], systems[k, 2, : sizes[k]]
        if not np.any(b):
            continue
        # Above this friction f < 0 at -edge, and f is +infinity at -0: a real eigenvalue lies between them.
        edge, h_nn, h_nt = MOST_REPORTED * limit, 0.0, 0.0
        for i in range(len(p)):
            h_nn += a[i] / (p[i] + edge)
            h_nt += b[i] / (p[i] + edge)
        if 0.0 < -h_nn / h_nt <= mu_max:
            divergence[k] = -h_nn / h_nt
        count, judged = isolate(p, a, b, d1, d2, mu_max, brackets)
        if judged == MOST_INTERVALS:
            return systems, sizes, roots, divergence, k
        new = np.full((count, 4), float(k))
        new[:, 1:] = brackets[:count]
        roots = np.concatenate((roots, new))
    return systems, sizes, roots, divergence, -1


@kernel
def contact_poles(row: Array, unit: float, limit: float, upper: Any, lower: Any, system: Array) -> int:
    """Fill `system` with poles p and residues a, b of `isolate`, those beyond FAR `limit` replaced; their number.

    `row` is one of `rig_table`, `upper` and `lower` are the beams' `unit_cantilever`; `limit` times unit^2 is the
    largest lambda in the band, rad2/s2.
    """
    (mass1, along, across), (mass2, _, bending) = _scales(row[5:10]), _scales(row[10:15])
    modes = upper_modes(row[0], row[2] / mass1, along, across, upper[0], upper[2])
    deflections, n = lower_deflections(row[1] / row[10], lower[1]), modes.shape[1]
    # What is rounding beside the largest entry is no coupling, as in `beams.modes`.
    least1, least2 = 1e-15 * np.abs(modes[1]).max(), 1e-15 * np.abs(deflections).max()
    size, far, share, new_a, new_b = 0, False, np.empty(NODES), np.zeros(NODES), np.zeros(NODES)
    for i in range(n + len(deflections)):
        if i < n:
            p, normal, tangential, mass, least = modes[0, i], modes[1, i], modes[2, i], mass1, least1
        else:
            p, normal, tangential = bending * lower[0][0, len(deflections) // 2 + i - n], -deflections[i - n], 0.0
            mass, least = mass2, least2
        p, a, b = p / unit**2, normal * normal / (mass * unit**2), normal * tangential / (mass * unit**2)
        if abs(normal) <= least:
            continue
        if p <= FAR * limit:
            system[0, size], system[1, size], system[2, size] = p, a, b
            size += 1
            continue
        # Lagrange polynomials at s = 1 / p by the barycentric formula.
        far, total = True, 0.0
        for k in range(NODES):
            away = 2.0 * FAR * limit / p - 1.0 - POINTS[k]
            share[k] = WEIGHTS[k] / (away if away != 0.0 else 1e-300)
            total += share[k]
        for k in range(NODES):
            new_a[k] += a / p * (share[k] / total)
            new_b[k] += b / p * (share[k] / total)
    for k in range(NODES if far else 0):
        p = 2.0 * FAR * limit / (1.0 + POINTS[k])
        system[0, size], system[1, size], system[2, size] = p, p * new_a[k], p * new_b[k]
        size += 1
    return size


@kernel
def _scales(beam: Array) -> tuple[float, float, float]:
    """Mass of a beam, and squared frequencies of axial and of bending modes over those of the unit beam."""
    length, width, thickness, young_modulus, density = beam[0], beam[1], beam[2], beam[3], beam[4]
    scale = young_modulus / (density * length * length)
    return density * length * width * thickness, scale, scale * (thickness / length) ** 2
