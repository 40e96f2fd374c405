"""The figure of an assembled sweep: branches over friction, and those that grow."""

import numpy as np
import pytest
from scipy import io, sparse

from fivcore import assembled_modes, assembled_onsets
from studies.plotting import figures
from studies.plotting.modes import modes_figure
from sweeps import InputError
from tests import HOME

FOLDER = HOME.parent / "shared" / "data" / "brake_m0"
# Hoffmann, Fischer, Allgaier, Gaul, Mech. Res. Comm. 29 (2002) 197-205: onset at 0.75.
HOFFMANN, FRICTION = (np.eye(2), None, np.array([[2.0, 1.0], [1.0, 2.0]])), [[0.0, -4.0 / 3.0], [0.0, 0.0]]


def drawn(axes, colour):
    """Points of the curves of a colour, without those that are missing."""
    curves = [line.get_xydata() for line in axes.lines if line.get_color() == colour and len(line.get_xdata()) > 2]
    return [curve[np.isfinite(curve).all(axis=1)] for curve in curves]


def texts(axes):
    return [text.get_text() for text in axes.texts]


def test_two_modes_that_coalesce():
    mu = np.linspace(1.5, 0.0, 61)
    modes = assembled_modes(*HOFFMANN, friction_stiffness=FRICTION, mu=mu, fmax=1.0)
    figure = modes_figure(modes, assembled_onsets(*HOFFMANN, FRICTION, 1.0, 1.5))
    top, bottom = figure.axes
    (curve,) = [curve for curve in drawn(bottom, figures.RED) if len(curve)]
    assert curve[:, 0].min() == pytest.approx(0.775)
    # lam^2 = -2 + root of 1 - 4 mu / 3.
    np.testing.assert_allclose(
        curve[:, 1], np.sqrt(-2.0 + np.emath.sqrt(1.0 - curve[:, 0] / 0.75)).real, rtol=1e-9
    )
    assert texts(top) == ["μ = 0.7500, 0.2251 Hz"]
    assert texts(bottom) == ["0.2316 Hz"]
    assert figures.saved(figure, "png", "")[:4] == b"\x89PNG"


def test_branches_cross_end_and_begin():
    """Modes over a speed: 3 and 3 + s rad/s cross; one leaves the band where another comes into it."""

    def stiffness(s):
        return np.diag(np.square([3.0, 2.6 + s, 5.0 + 1.25 * s, 5.6 + s - 1.2 * (s > 0.5)]))

    modes = assembled_modes(np.eye(4), 0.1 * np.diag([1.0, 2.0, 3.0, 4.0]), stiffness, mu=np.linspace(0, 1, 21),
                            fmax=5.5 / 2.0 / np.pi)  # fmt: skip
    top, bottom = modes_figure(modes, parameter="speed").axes
    rates = [np.unique(curve[:, 1].round(9)).tolist() for curve in drawn(bottom, figures.BLACK) if len(curve)]
    assert sorted(rates) == [[-0.2], [-0.15], [-0.1], [-0.05]]
    assert bottom.get_xlabel() == "speed"
    assert not texts(top)


@pytest.mark.parametrize("mu", [0.5, [0.5], [[0.5, 0.6]]])
def test_a_figure_needs_two_values(mu):
    modes = assembled_modes(*HOFFMANN, friction_stiffness=FRICTION, mu=mu, fmax=1.0)
    with pytest.raises(InputError, match=r"modes.mu of shape \(.*\): it must be \(n,\), with n of at least 2"):
        modes_figure(modes)


@pytest.mark.slow
def test_disc_brake():
    """Its two unstable modes: shared/data/README.md."""
    if not FOLDER.is_dir():
        pytest.skip(f"no {FOLDER}")

    def read(name):
        file = io.loadmat(FOLDER / f"B{name}LL00.mat")
        return sparse.csr_array(file[next(key for key in file if not key.startswith("__"))])

    m, d1, dg, dr, d4, k1, kr, kgeo = map(read, ("M", "D", "Y", "DIW", "H", "K", "KQ", "W"))
    w = 4.0 * np.pi
    matrices = m, d1 + w * dg + (1.0 / w - 1.0) * dr + d4 / (3200.0 * np.pi), k1 + (w**2 - 1.0) * kgeo
    modes = assembled_modes(*matrices, friction_stiffness=kr, mu=np.linspace(0, 1, 5), fmax=20e3 / (2.0 * np.pi))
    _, bottom = modes_figure(modes).axes
    assert texts(bottom) == ["2769 Hz", "785 Hz"]
    ends = sorted(float(curve[-1, 1]) for curve in drawn(bottom, figures.RED) if len(curve))
    assert ends == pytest.approx([5.4742, 74.8306], abs=1e-3)
