"""Flutter onsets, and their normalised sensitivities, in extended precision from the parameters of a rig.

The receptances of the gap by elimination of one element after the other (block-tridiagonal), without any modes;
many rigs that differ in their parameters are solved together, (k,). Roots are Newton's, slopes central differences
of fourth order.
"""

from collections.abc import Callable

import numpy as np

from fivcore import Rig

Numbers = dict[str, np.ndarray]
# Slope and value in the middle of four points at -2, -1, 1, 2, both of fourth order.
SLOPE, MIDDLE = np.array([1, -8, 8, -1]) / np.longdouble(12), np.array([-1, 4, 4, -1]) / np.longdouble(6)
# Without damping, the imaginary part that lambda gets instead, as a share of it.
TINY = 1e-9
# Relative distance for the slope in Newton's iteration, and the step with which that ends.
BESIDE, SETTLED = 1e-8, 1e-11


def numbers(rig: Rig, theta: float) -> dict[str, float]:
    """Parameters of a rig but its meshes, by the names of the sensitivities."""
    parts = "length", "width", "thickness", "young_modulus", "density"
    found = {f"{p}_{name}": getattr(getattr(rig, p), name) for p in ("p1", "p2") for name in parts}
    return found | {"theta": theta} | {n: getattr(rig, n) for n in ("contact_position", "head_mass", "d1", "d2")}


def element(given: Numbers, beam: str, count: int, value: np.ndarray) -> np.ndarray:
    """Dynamic stiffness of an element, (k, 6, 6), in u, w and h times the rotation of its two nodes."""
    length, width, thickness, modulus, density = (
        given[f"{beam}_{name}"] for name in ("length", "width", "thickness", "young_modulus", "density")
    )
    h, area = length / count, width * thickness
    along, across = np.ix_([0, 3], [0, 3]), np.ix_([1, 2, 4, 5], [1, 2, 4, 5])
    parts = np.zeros((4, 6, 6), dtype=np.longdouble)
    parts[0][along], parts[1][along] = [[1, -1], [-1, 1]], [[2, 1], [1, 2]]
    parts[2][across] = [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
    parts[3][across] = [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
    mass = -value * density * area * h
    scales = modulus * area / h, mass / 6, modulus * area * thickness**2 / (12 * h**3), mass / 420
    return sum(scale[:, None, None] * part for scale, part in zip(scales, parts, strict=True))


def solve(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Gaussian elimination of (k, n, n) and (k, n, m) in their own precision."""
    a, b, n = a.copy(), b.copy(), a.shape[1]
    for i in range(n):
        for j in [*range(i), *range(i + 1, n)]:
            factor = a[:, j, i] / a[:, i, i]
            a[:, j, i:] -= factor[:, None] * a[:, i, i:]
            b[:, j] -= factor[:, None] * b[:, i]
    return b / np.diagonal(a, axis1=1, axis2=2)[:, :, None]


def chain(block: np.ndarray, count: int, start: np.ndarray) -> np.ndarray:
    """What the far end of some equal elements feels, the near end of the first feeling `start`."""
    n = block.shape[1] // 2
    for _ in range(count):
        start = block[:, n:, n:] - block[:, n:, :n] @ solve(block[:, :n, :n] + start, block[:, :n, n:])
    return start


def receptances(given: Numbers, rig: Rig, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """h_NN and h_NT at each lambda; of the rig only the meshes, and which element holds the contact."""
    angle = given["theta"] * (np.arctan(np.longdouble(1)) / 45)
    sine, cosine, zero = np.sin(angle), np.cos(angle), 0 * angle
    block = element(given, "p1", rig.p1.elements, value)
    # The support has one degree of freedom, along y.
    up = np.stack([-cosine, -sine, zero], axis=1)[:, :, None]
    head = up.transpose(0, 2, 1) @ block[:, :3, :3] @ up - (value * given["head_mass"])[:, None, None]
    row = up.transpose(0, 2, 1) @ block[:, :3, 3:]
    tip = chain(block, rig.p1.elements - 1, block[:, 3:, 3:] - row.transpose(0, 2, 1) @ (row / head))
    reads = np.stack([up[:, :, 0], np.stack([-sine, cosine, zero], axis=1)], axis=2)
    upper = reads.transpose(0, 2, 1) @ solve(tip, reads.astype(tip.dtype))
    bends = np.ix_(range(len(value)), [1, 2, 4, 5], [1, 2, 4, 5])
    block, n = element(given, "p2", rig.p2.elements, value)[bends], rig.p2.elements
    e = min(int(rig.contact_position / rig.p2.length * n * (1 + 1e-12)), n - 1)
    assert e > 0
    # Both sides of the element that holds the contact, from the clamp and from the free end.
    held, order = block.copy(), np.ix_(range(len(value)), [2, 3, 0, 1], [2, 3, 0, 1])
    held[:, :2, :2] += chain(block, e - 1, block[:, 2:, 2:])
    held[:, 2:, 2:] += chain(block[order], n - 1 - e, 0 * block[:, :2, :2])
    x = given["contact_position"] / given["p2_length"] * n - e
    y = 1 - x
    row = np.stack([(1 + 2 * x) * y**2, x * y**2, x**2 * (1 + 2 * y), -(x**2) * y], axis=1)[:, :, None]
    lower = row.transpose(0, 2, 1) @ solve(held, row.astype(held.dtype))
    return upper[:, 0, 0] + lower[:, 0, 0], upper[:, 0, 1]


def onset_roots(rig: Rig, given: Numbers, omega: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """Angular frequency and friction of the onsets near the ones given, (2, k)."""

    def at(omega):
        phi = 1j * omega
        value = -phi * (phi + given["d1"]) / (1 + given["d2"] * phi)
        return receptances(given, rig, value if rig.d1 or rig.d2 else value * (1 - 1j * TINY))

    for _ in range(8):
        (a, b), (a_beside, b_beside) = at(omega), at(omega * (1 + BESIDE))
        slope, rest = (a_beside - a + mu * (b_beside - b)) / (BESIDE * omega), a + mu * b
        determinant = slope.real * b.imag - slope.imag * b.real
        step = np.stack([rest.real * b.imag - rest.imag * b.real, slope.real * rest.imag - slope.imag * rest.real])
        omega, mu = omega - step[0] / determinant, mu - step[1] / determinant
        if np.abs(step / determinant / [omega, mu]).max() < SETTLED:
            return np.stack([omega, mu])
    raise ArithmeticError("an onset was not found again")


def normalised(
    values: dict[str, float], solved: Callable[..., np.ndarray], start: list[np.ndarray], step: float = 5e-5
) -> dict[str, np.ndarray]:
    """p / q dq / dp, (quantity, k), of what `solved` finds near `start`, by name of p where p is not zero."""
    names = [name for name, value in values.items() if value != 0.0]
    found = np.zeros((len(start), len(names), 1, len(start[0])), dtype=np.longdouble)
    # Beside a pole of F Newton's iteration needs a better start, which slopes from smaller steps give.
    for size in (0.01 * step, step):
        shifts = size * np.array([-2, -1, 1, 2], dtype=np.longdouble)[:, None]
        moved = {
            name: np.full((len(names), 4, len(start[0])), np.longdouble(value)) for name, value in values.items()
        }
        for k, name in enumerate(names):
            moved[name][k] *= 1 + shifts
        near = [each * (1 + shifts * slope) for each, slope in zip(start, found, strict=True)]
        given = {name: each.ravel() for name, each in moved.items()}
        roots = solved(given, *(each.ravel() for each in near)).reshape(len(start), len(names), 4, -1)
        slope, middle = (np.einsum("qnsk,s->qnk", roots, np.array(each)) for each in (SLOPE, MIDDLE))
        found = (slope / (size * middle))[:, :, None]
    return {name: found[:, k, 0] for k, name in enumerate(names)}
