"""Flutter onsets of one rig, or of many with the same mesh, in less than a millisecond each.

The modes follow from `fivcore.beams.similar`, with modes far above the band compressed
(`fivcore.contact.compression`), and the roots from the search of `fivcore.stability.onsets`.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import checks
from fivcore.beams.similar import lower_deflections, unit_cantilever, upper_modes
from fivcore.contact.compression import BLOCKS, FAR, compressed
from fivcore.errors import InputError
from fivcore.friction import COULOMB, Friction
from fivcore.jit import Array, ReadOnlyArrays, kernel
from fivcore.rig import BEAM_PARAMETERS, RIG_PARAMETERS, ContactModel, Rig, checked_theta
from fivcore.stability import onsets
from fivcore.stability.exponents import band_modes
from fivcore.stability.falling import checked_sliding, falling_crossings
from fivcore.stability.onsets import MOST_INTERVALS, axis_point, divergence_onset, isolated_crossings
from fivcore.stability.sampled import coulomb_crossings
from fivcore.stability.several import onsets_of_several
from fivcore.structure import Structure, modal_structure

# Number of rigs searched together; no result depends on it.
RIGS_AT_ONCE = 256
# Parameters of a beam, and of a rig with theta: the columns of `rig_table`.
BEAM, OWN = tuple(BEAM_PARAMETERS)[:5], tuple(RIG_PARAMETERS)[:4]
PARAMETERS = ("theta", *OWN, *(f"{p}_{name}" for p in ("p1", "p2") for name in BEAM))
_PAPERS = Rig()


@dataclass(frozen=True, eq=False)
class FlutterOnsets(ReadOnlyArrays):
    """Where growth rates pass through zero as mu rises, ascending in mu; arrays are read-only.

    Attributes
    ----------
    mu, frequency, recovery_mu, recovery_frequency : ndarray, (n,) or (m,)
        Friction and frequency (Hz) at which a growth rate rises through zero (destabilisation), and at which it
        falls back (restabilisation).
    entry_mu : ndarray, (k,)
        Friction at which a pair enters the band through its top while it grows, at no more than 1.7 times the
        band's angular frequency.
    divergence_mu : float
        Least friction at which a motion grows without oscillation (divergence: the contact jams), at no more than
        twice the band's angular frequency; NaN if that is above mu_max. It is not computed, and NaN, if friction
        falls with the speed; `sliding_modes` then shows the growing modes.
    """

    mu: Array
    frequency: Array
    recovery_mu: Array
    recovery_frequency: Array
    entry_mu: Array
    divergence_mu: float


@dataclass(frozen=True, eq=False)
class ManyFlutterOnsets(FlutterOnsets):
    """Flutter onsets of n rigs, each rig's ascending in mu and followed by NaN; arrays are read-only.

    Attributes
    ----------
    mu, frequency, recovery_mu, recovery_frequency, entry_mu : ndarray, (n, any)
    divergence_mu : ndarray, (n,)
        As for `FlutterOnsets`. At divergence a flutter pair ceases to oscillate, or a real eigenvalue enters from
        beyond the band; no eigenvalue passes zero, where the rigid mode of P1 has a pole independent of friction.
    change_mu, change : ndarray, (n, any)
        Friction at which the number of growing eigenvalues in the band changes, and by how much: by 2 for a
        pair, by 1 for a real one.
    mu_max : float
    """

    divergence_mu: Array  # type: ignore[assignment]
    change_mu: Array
    change: Array
    mu_max: float

    def unstable(self, mu: Any) -> NDArray[np.bool_]:
        """(n, m): whether a motion grows in the band at friction mu, (m,) for all rigs or each rig's own, (n, m).

        This is the case if `sliding_modes` has an unstable mode. Raises `ValueError` for mu outside 0 to mu_max.
        """
        limits = 0.0, self.mu_max, "a coefficient of friction up to mu_max"
        friction = checks.array("mu", mu, lambda each: checks.between("mu", each, *limits))
        friction = np.atleast_2d(friction)
        growing = np.zeros(np.broadcast_shapes((len(self.mu), 1), friction.shape))
        for at, change in zip(self.change_mu.T, self.change.T, strict=True):
            growing += np.where(at[:, None] < friction, change[:, None], 0.0)
        return growing > 0.0


def flutter_onsets(
    rig: ContactModel,
    theta: float,
    fmax: float = 10e3,
    mu_max: float = 1.0,
    *,
    friction: Friction = COULOMB,
    V: float | None = None,
    F: float | None = None,
) -> FlutterOnsets:
    """All flutter onsets and recoveries of steady sliding (V > 0) in a band, refined to rounding.

    Two onsets closer than 1e-13 of the band are not reported. For onsets along V or F see `sliding_onsets`. If
    friction falls with the speed, the search ends at the friction at which the contact of a structure jams. With
    several contacts, those that are closed in steady sliding count; a change of their set at which modes begin to
    grow is an onset, and `divergence_mu` is the friction at which steady sliding ceases to be unique.

    Parameters
    ----------
    rig : Rig or Structure
    theta, fmax, mu_max : float
        Degrees, 0 with a structure; band, Hz; largest friction of interest.
    friction : Friction
        How friction depends on the speed; all mu are static coefficients.
    V, F : float, optional
        Speed, m/s, and load, N; needed where friction falls with the speed.

    Returns
    -------
    FlutterOnsets

    Raises
    ------
    ValueError, ArithmeticError
        For an argument out of range; if the onsets cannot be isolated.
    """
    angle = checked_theta("rig", rig, theta)
    speed, load = checked_sliding(friction, V, F)
    band, most = checks.band(fmax), checks.between("mu_max", mu_max, 1e-12, 1e6, "a coefficient of friction")
    if rig.several:
        several = onsets_of_several(modal_structure(rig, 0.0), band, most, friction, speed, load)
        return FlutterOnsets(*several)
    if isinstance(rig, Rig) and friction.kinetic_ratio == 1.0:
        found, divergence = crossings(rig_table({"theta": angle}, rig), band, most, rig)
    else:
        for name, value in (("V", speed), ("F", load)):
            if value is not None and value.ndim:
                raise InputError(f"{name} of shape {value.shape}: it must be one number")
        values = {"mu": 0.0, "V": float(speed or 0.0), "F": float(load or 0.0)}
        found, divergence = _of_structure(modal_structure(rig, angle), band, most, friction, values)
    whole = _listed(found, divergence, band, most)
    own: Any = {each.name: getattr(whole, each.name)[0].copy() for each in fields(FlutterOnsets)}
    return FlutterOnsets(**own | {"divergence_mu": float(own["divergence_mu"])})


def _of_structure(
    own: Structure, fmax: float, mu_max: float, friction: Friction, values: dict[str, float]
) -> tuple[Array, Array]:
    """`crossings` of a structure."""
    divergence, kappa = np.nan, friction.kinetic_ratio
    if friction.constant:
        found, modes = coulomb_crossings(own, fmax, kappa, mu_max), band_modes(own, fmax)
        a, b, _ = modes.residues
        divergence = divergence_onset(modes.p, modes.c, a, b, kappa * mu_max) / kappa
    else:
        found = falling_crossings(own, fmax, friction, values, "mu", 0.0, mu_max)
    return np.insert(found * [1.0, fmax, 1.0], 0, 0.0, axis=1).T, np.array([divergence])


def flutter_onsets_many(
    numbers: Mapping[str, Any], fmax: float = 10e3, mu_max: float = 1.0, rig: Rig = _PAPERS, threads: int = 1
) -> ManyFlutterOnsets:
    """All flutter onsets and recoveries of many rigs: those of `flutter_onsets`, bit for bit.

    Parameters
    ----------
    numbers : mapping of str to float or array_like, (n,)
        theta in degrees, and what differs from `rig`: contact_position, head_mass, d1, d2, and the parameters of a
        beam after p1_ or p2_, such as p1_length.
    fmax, mu_max : float
        Band, Hz; largest friction of interest.
    rig : Rig
        All rigs have its mesh, and its parameters where `numbers` names none.
    threads : int
        Number of threads; no result depends on it.

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
    table = rig_table(numbers, rig)
    return _listed(*crossings(table, band, most, rig, threads), band, most)


def _listed(found: Array, divergence: Array, fmax: float, mu_max: float) -> ManyFlutterOnsets:
    """Sort `crossings` into onsets, recoveries, entries into the band and changes, by row."""
    (place, change), rows = found[2:], len(divergence)
    on_axis, up = place <= fmax, change > 0.0
    entering = ~on_axis & (place <= onsets.PATH_TOP * fmax) & up
    parts = found[:3, on_axis & up], found[:3, on_axis & ~up], found[:2, entering], found[[0, 1, 3]]
    onset, recovery, entry, changes = (_padded(each, rows) for each in parts)
    tables: Any = (*onset, *recovery, *entry, divergence, *changes, mu_max)
    return ManyFlutterOnsets(*tables)


def crossings(table: Array, fmax: float, mu_max: float, rig: Rig, threads: int = 1) -> tuple[Array, Array]:
    """All crossings of rows of `rig_table`, (4, k), and divergence_mu of each row; arguments are not checked.

    The rows of the result are the row number (ascending), the friction (ascending within a row), the place, and
    the change of the number of growing eigenvalues. The place is the frequency in Hz, or beyond fmax a position on
    the rest of the path of `onsets`.
    """
    workers = checks.count("threads", threads, 1024)
    beams = [unit_cantilever(beam.elements) for beam in (rig.p1, rig.p2)]

    def search(start: int) -> tuple[Array, Array]:
        rows = table[start : start + RIGS_AT_ONCE]
        found, divergence, failed = _search_rows(rows, 2.0 * np.pi * fmax, mu_max, *beams)
        if failed >= 0:
            raise onsets.endless(mu_max, fmax, f" in row {start + failed}, theta = {rows[failed, 0]:g},")
        found[:, 0] += start
        return found.T, divergence

    starts = range(0, len(table), RIGS_AT_ONCE)
    with ThreadPoolExecutor(workers) if min(workers, len(starts)) > 1 else nullcontext() as pool:
        solutions = list(pool.map(search, starts) if pool else map(search, starts))
    found = np.concatenate([np.empty((4, 0)), *(part for part, _ in solutions)], axis=1)
    found = found[:, np.lexsort(found[1::-1])] * [[1.0], [1.0], [fmax], [1.0]]
    return found, np.concatenate([np.empty(0), *(part for _, part in solutions)])


def _padded(values: Array, rows: int) -> Array:
    """Arrange values (1 + k, n), whose first row is the ascending row number, as k NaN-padded tables."""
    row = values[0].astype(int)
    count = np.bincount(row, minlength=rows)
    tables = np.full((len(values) - 1, rows, count.max(initial=0)), np.nan)
    tables[:, row, np.arange(len(row)) - (np.cumsum(count) - count)[row]] = values[1:]
    return tables


def rig_table(numbers: Mapping[str, Any], rig: Rig) -> Array:
    """Checked parameters of rigs, (n, PARAMETERS); parameters that are not named are those of `rig`."""
    checks.instance("numbers", numbers, Mapping)
    for name in numbers:
        checks.choice("a name in numbers", name, PARAMETERS)
    if "theta" not in numbers:
        raise InputError("numbers: theta is missing")
    given = {}
    for name in PARAMETERS:
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
        # If any number is bad, then a non-finite one, the smallest or largest of its kind, or this one is.
        beyond = np.argmax(given["contact_position"] > given["p2_length"])
        for row in sorted({*np.argmin(table, axis=0), *np.argmax(table, axis=0), beyond}):
            _check(row, table[row].tolist(), rig)
    return table


def _check(row: int, values: list[Any], rig: Rig) -> None:
    """Raise what `Beam`, `Rig` and `flutter_onsets` would raise for the parameters of a row."""
    part = "p1"
    try:
        upper, part = replace(rig.p1, **dict(zip(BEAM, values[5:10], strict=True))), "p2"
        lower, part = replace(rig.p2, **dict(zip(BEAM, values[10:], strict=True))), "rig"
        Rig(upper, lower, *values[1:5])
        checks.theta_degrees(values[0])
    except InputError as error:
        raise InputError(f"{part} of row {row}: {error}") from None


@kernel
def _search_rows(table: Array, unit: float, mu_max: float, upper: Any, lower: Any) -> tuple[Array, Array, int]:
    """Crossings (k, 4): row, mu, place, change; divergence_mu of the rows; a row that failed, or -1."""
    divergence = np.full(len(table), np.nan)
    found, brackets = np.empty((0, 4)), np.empty((MOST_INTERVALS, 3))
    for k in range(len(table)):
        d1, d2 = table[k, 3] / unit, table[k, 4] * unit
        x, y = axis_point(1.0, d1, d2)
        # The band's largest lambda, more than 1 with heavy damping.
        p, a, b = contact_poles(table[k], unit, max(1.0, np.hypot(x, y)), upper, lower)
        own, judged = isolated_crossings(p, a, b, d1, d2, mu_max, brackets)
        if judged == MOST_INTERVALS:
            return found, divergence, k
        divergence[k] = divergence_onset(p, d1 + d2 * p, a, b, mu_max)
        found = np.concatenate((found, np.column_stack((np.full(len(own), float(k)), own))))
    return found, divergence, -1


@kernel
def contact_poles(row: Array, unit: float, limit: float, upper: Any, lower: Any) -> tuple[Array, Array, Array]:
    """Poles p and residues a, b of `isolate`, far ones compressed.

    `row` is one of `rig_table`, `upper` and `lower` are the beams' `unit_cantilever`; `limit` times unit^2 is the
    largest lambda in the band, rad2/s2.
    """
    (mass1, along, across), (mass2, _, bending) = _scales(row[5:10]), _scales(row[10:15])
    modes = upper_modes(row[0], row[2] / mass1, along, across, upper[0], upper[2])
    deflections = lower_deflections(row[1] / row[10], lower[1])
    # Entries that are rounding relative to the largest are no coupling, as in `beams.modes`.
    first = np.abs(modes[1]) > 1e-15 * np.abs(modes[1]).max()
    second = np.abs(deflections) > 1e-15 * np.abs(deflections).max()
    p = np.append(modes[0][first], bending * lower[0][0, len(deflections) // 2 :][second]) / unit**2
    g, n = np.zeros((2, len(p))), np.sum(first)
    g[:, :n] = modes[1:, first] / (np.sqrt(mass1) * unit)
    g[0, n:] = -deflections[second] / (np.sqrt(mass2) * unit)
    p, _, few = compressed(p, np.zeros(len(p)), g, p > FAR * limit, BLOCKS)
    return p, few[0] * few[0], few[0] * few[1]


@kernel
def _scales(beam: Array) -> tuple[float, float, float]:
    """Mass of a beam, and squared frequencies of axial and of bending modes over those of the unit beam."""
    length, width, thickness, young_modulus, density = beam[0], beam[1], beam[2], beam[3], beam[4]
    scale = young_modulus / (density * length * length)
    return density * length * width * thickness, scale, scale * (thickness / length) ** 2
