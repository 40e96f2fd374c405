"""Random finite-element models like those of users: pins under arms, bars on beams, strips.

Steel to aluminium, 20 to 200 mm, 60 to 3 000 degrees of freedom; the touching part leans by 2 to 20 degrees.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from fivcore import Scene, Structure, flutter_onsets
from fivcore.transient.normalised import Normalised, slip_distance
from tests.helpers.plate import plate


def element(length: float, angle: float, width: float, thickness: float, young: float, density: float) -> Any:
    """Mass and stiffness of an Euler-Bernoulli element, (x, y, rotation) at either end, at an angle to x."""
    along, across, area = np.ix_([0, 3], [0, 3]), np.ix_([1, 2, 4, 5], [1, 2, 4, 5]), width * thickness
    mass, stiffness, levers = np.zeros((6, 6)), np.zeros((6, 6)), np.array([1.0, length, 1.0, length])
    stiffness[along] = young * area / length * np.array([[1, -1], [-1, 1]])
    mass[along] = density * area * length / 6 * np.array([[2, 1], [1, 2]])
    levers = np.outer(levers, levers)
    bend = [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
    stiffness[across] = young * width * thickness**3 / 12 / length**3 * levers * np.array(bend)
    lump = [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
    mass[across] = density * area * length / 420 * levers * np.array(lump)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.kron(np.eye(2), np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
    return turn.T @ mass @ turn, turn.T @ stiffness @ turn


def chain(beams: list[tuple[float, ...]], elements: int, held: list[int]) -> Any:
    """Mass and stiffness of beams in a row, without the fixed degrees of freedom."""
    size = 3 * (len(beams) * elements + 1)
    whole = np.zeros((2, size, size))
    for number, (length, *rest) in enumerate(beams):
        parts = element(length / elements, *rest)
        for k in range(number * elements, (number + 1) * elements):
            whole[:, 3 * k : 3 * k + 6, 3 * k : 3 * k + 6] += parts
    free = np.setdiff1d(np.arange(size), held)
    return whole[:, free[:, None], free]


KINDS = ("pin under an arm", "bar on a beam", "strip")


def model(seed: int) -> tuple[Any, Any, dict[str, Any]]:
    """Mass and stiffness, sparse, and the other arguments of `Structure.from_matrices`; KINDS take turns."""
    rng = np.random.default_rng(seed)

    def beam(low: float, high: float, slender: tuple[float, float], angle: float) -> tuple[float, ...]:
        length = 10.0 ** rng.uniform(low, high)
        material = 10.0 ** rng.uniform(10.8, 11.4), 10.0 ** rng.uniform(3.4, 4.0)
        return length, angle, 0.01, length / 10.0 ** rng.uniform(*slender), *material

    lean, size = np.radians(rng.uniform(2.0, 20.0)), 10.0 ** rng.uniform(np.log10(60.0), np.log10(3000.0))
    rows: dict[str, Any] = {"d1": 10.0 ** rng.uniform(1.0, 2.0), "d2": 10.0 ** rng.uniform(-8.5, -7.7)}
    if seed % 3 == 0:
        # A pin under an arm, or under an arm with a knee; the load is where they meet.
        arms, knee = int(rng.integers(1, 3)), rng.uniform(-0.3, 0.3, 2)
        parts = [beam(-1.3, -0.7, (1.2, 1.7), angle) for angle in knee[:arms]]
        parts.append(beam(-1.8, -1.2, (0.8, 1.5), -0.5 * np.pi - lean))
        n = max(int(size / 3.0 / len(parts)), 8)
        M, K = chain(parts, n, [0, 1, 2])
        tip = len(M) - 3
        rows |= {"normal": {tip + 1: 1.0}, "tangential": {tip: 1.0}, "load": {3 * arms * n - 2: -1.0}}
    elif seed % 3 == 1:
        # A bar under a mass that slides along y, on a beam whose clamp is driven.
        n = max(int(size / 6.0), 8)
        M1, K1 = chain([beam(-1.7, -0.9, (1.0, 1.6), -0.5 * np.pi - lean)], n, [0, 2])
        M1[0, 0] += 10.0 ** rng.uniform(-1.0, 0.5)
        M2, K2 = chain([beam(-1.2, -0.5, (1.2, 1.8), 0.0)], n, [0, 1, 2])
        tip, under = len(M1) - 3, len(M1) + 3 * int(rng.integers(n // 3, n))
        M, K = (sparse.block_diag(pair, format="csc") for pair in ((M1, M2), (K1, K2)))
        moved = np.zeros(M.shape[0])
        moved[len(M1) :: 3] = 1.0
        rows |= {"normal": {tip + 1: 1.0, under + 1: -1.0}, "tangential": {tip: 1.0, under: -1.0}}
        rows |= {"load": {0: -1.0}, "drive": M @ moved}
    else:
        # A strip in plane stress that leans on its lower corner.
        high, length = int(rng.integers(2, 7)), 10.0 ** rng.uniform(-1.5, -0.7)
        wide = max(int(size / (2 * high + 2)), 10)
        M, K = plate(wide, high, length, length / 10.0 ** rng.uniform(0.8, 1.4))
        x, c, s = M.shape[0] - 2 * (high + 1), np.cos(lean), np.sin(lean)
        rows |= {"normal": {x: s, x + 1: c}, "tangential": {x: c, x + 1: -s}}
        rows |= {"load": {M.shape[0] - 2: -s, M.shape[0] - 1: -c}}
    return sparse.csc_array(M), sparse.csc_array(K), rows


def structure(seed: int, fmax: float | None = None) -> Structure:
    """The structure of `model`, its matrices dense up to 600 degrees of freedom."""
    M, K, rows = model(seed)
    if M.shape[0] <= 600:
        M, K = M.toarray(), K.toarray()
    return Structure.from_matrices(M, K, **rows, fmax=fmax)


def vibrating(seed: int) -> Scene | None:
    """A scene above the first onset of flutter of the five lowest modes; None without one below mu = 0.5.

    The drive loads the stuck contact until it slips within 20 to 200 periods of that flutter.
    """
    rng, own = np.random.default_rng(10_000 + seed), structure(seed, 200e3)
    lowest = float(own.frequency[own.frequency > 0.0][:5][-1])
    for sense, each in ((1.0, own), (-1.0, own.mirrored())):
        found = flutter_onsets(each, 0.0, lowest, 0.5)
        if len(found.mu):
            mu, periods = float(found.mu[0] * rng.uniform(1.2, 1.8)), 10.0 ** rng.uniform(1.3, 2.3)
            scene = Normalised.of(Scene(1.0, 0.0, mu, 10.0, each))
            speed = slip_distance(scene) * scene.load * float(found.frequency[0]) / periods
            return Scene(sense * speed, 0.0, mu, 10.0, own)
    return None
