"""A plate in plane stress, clamped at its left edge: square elements with four nodes, assembled at once."""

import numpy as np
from scipy import sparse


def plate(nx, ny, length, height, young=200e9, poisson=0.3, density=7800.0, thickness=5e-3):
    """Mass and stiffness, nodes by columns from left to right and from below, x before y."""
    a, b, gauss = length / nx, height / ny, 3.0**-0.5
    ends_x, ends_y = np.array([-1.0, 1.0, 1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0])
    elastic = np.array([[1.0, poisson, 0.0], [poisson, 1.0, 0.0], [0.0, 0.0, 0.5 * (1.0 - poisson)]])
    stiffness = np.zeros((8, 8))
    for x, y in ((sx * gauss, sy * gauss) for sx in (-1, 1) for sy in (-1, 1)):
        strain = np.zeros((3, 8))
        strain[0, 0::2] = strain[2, 1::2] = ends_x * (1.0 + ends_y * y) / (2.0 * a)
        strain[1, 1::2] = strain[2, 0::2] = ends_y * (1.0 + ends_x * x) / (2.0 * b)
        stiffness += strain.T @ elastic @ strain * young / (1.0 - poisson**2) * thickness * a * b / 4.0
    shares = np.array([[4, 2, 1, 2], [2, 4, 2, 1], [1, 2, 4, 2], [2, 1, 2, 4]]) / 36.0
    mass = np.kron(shares, np.eye(2)) * density * thickness * a * b
    first = (np.arange(nx)[:, None] * (ny + 1) + np.arange(ny)).ravel()
    nodes = first[:, None] + [0, ny + 1, ny + 2, 1]
    dofs = (2 * nodes[:, :, None] + [0, 1]).reshape(-1, 8)
    places = np.repeat(dofs, 8, axis=1).ravel(), np.tile(dofs, (1, 8)).ravel()
    free, size = slice(2 * (ny + 1), None), 2 * (nx + 1) * (ny + 1)
    parts = (
        sparse.coo_array((np.tile(part.ravel(), len(dofs)), places), shape=(size, size)).tocsc()
        for part in (mass, stiffness)
    )
    return tuple(part[free][:, free] for part in parts)
