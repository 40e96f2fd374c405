"""The figure of an assembled sweep: branches over friction, and those that grow."""

import numpy as np
import pytest

from fivcore import FollowedModes, assembled_modes, assembled_onsets
from studies.plotting import figures
from studies.plotting.modes import modes_figure
from sweeps import InputError

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
    assert texts(bottom) == ["0.2316 Hz"]
    named = top.get_legend_handles_labels()[1]
    assert "flutter onset at μ = 0.7500, 0.2251 Hz" in named
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
    assert (bottom.get_xlabel(), texts(top)) == ("speed", [])


def test_curves_of_followed_modes_are_their_columns():
    """Two that would be linked the other way by their eigenvalues, drawn over a parameter that descends."""
    hertz = np.array([[1.0, 2.0], [1.6, 1.5], [2.0, 1.0]])
    modes = FollowedModes(np.array([3.0, 2.0, 1.0]), hertz, 0.0 * hertz - 1.0)
    top = modes_figure(modes, parameter="theta").axes[0]
    curves = drawn(top, figures.BLACK)
    assert [curve[:, 1].tolist() for curve in curves if len(curve)] == hertz[::-1].T.tolist()


@pytest.mark.parametrize("mu", [0.5, [0.5], [[0.5, 0.6]]])
def test_a_figure_needs_two_values(mu):
    modes = assembled_modes(*HOFFMANN, friction_stiffness=FRICTION, mu=mu, fmax=1.0)
    with pytest.raises(InputError, match=r"modes.mu of shape \(.*\): it must be \(n,\), with n of at least 2"):
        modes_figure(modes)
