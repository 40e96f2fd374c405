"""Random structures, the paper's rig from its matrices, and comparison of sets of exponents."""

from dataclasses import replace

import numpy as np

from fivcore import Rig, Structure
from fivcore.finite_elements import static_modes
from tests.helpers.reference import assemble


def drawn(seed, rayleigh=False):
    """A structure and its frequency: 2 to 40 modes, ratios of 0 to 5 %, every other with a rigid motion."""
    rng = np.random.default_rng(seed)
    n, scale = int(rng.integers(2, 41)), 10.0 ** rng.uniform(-1.0, 4.0)
    frequency = np.sort(scale * 10.0 ** rng.uniform(-1.5, 0.5, n))
    frequency[0] *= seed % 2
    normal, tangential = rng.normal(size=(2, n))
    damping = {"damping_ratio": rng.uniform(0.0, 0.05, n)}
    if rayleigh:
        damping = {"d1": 10.0 ** rng.uniform(-3.0, 0.0) * scale, "d2": 10.0 ** rng.uniform(-5.0, -2.0) / scale}
    load = -normal * rng.uniform(0.1, 1.0, n)
    own = Structure.from_modes(frequency, normal, tangential, load=load, **damping)
    if seed % 4 < 2:
        return own, scale
    root = rng.normal(size=(3, 3)) * 0.05 * np.sqrt(n) / scale
    stiffness, *rows = static_modes(root @ root.T, float(own.stiffness.max()))
    rows = dict(zip(("normal", "tangential", "load"), rows, strict=True))
    rows |= dict.fromkeys(("damping", "inertia", "output", "struck"), np.zeros(2)) | {"stiffness": stiffness}
    rows = {name: np.append(getattr(own, name), row) for name, row in rows.items()}
    return replace(own, static=2, **rows), scale


def within(values, fmax):
    omega = 2.0 * np.pi * fmax * (1.0 - 1e-6)
    return values[(values.imag < omega) & (np.abs(values) < 2.0 * omega)]


def assert_same_set(mine, theirs, error):
    assert len(mine) == len(theirs)
    for one, other in ((mine, theirs), (theirs, mine)):
        assert all(np.abs(other - each).min() < error * np.abs(each) for each in one)


def beams(convert=np.asarray, rig=Rig(), theta=5.0, **given):  # noqa: B008
    """A rig, the paper's at 5 degrees, from a second assembly of its finite elements."""
    K, M, normal, tangential = assemble(rig, theta)
    p1, p2 = rig.p1.elements, rig.p2
    load, output, moved = np.zeros((3, len(K)))
    load[3 * p1] = -1.0
    # B lies between two nodes; A has no x.
    output[: 3 * p1 : 3] = np.maximum(1.0 - np.abs(np.arange(p1) - (1.0 - rig.point_b) * p1), 0.0)
    # P2's nodes move with its clamp, whose own element has a sixth of its mass on the first of them.
    moved[3 * p1 + 1 :: 3] = 1.0
    drive = M @ moved
    drive[3 * p1 + 1] += p2.density * p2.width * p2.thickness * p2.length / p2.elements / 6.0
    rows = {"normal": normal, "tangential": tangential, "load": load, "output": output, "drive": drive}
    return Structure.from_matrices(convert(M), convert(K), **rows, d1=rig.d1, d2=rig.d2, **given)
