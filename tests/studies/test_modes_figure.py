"""The figure of an assembled sweep: branches over friction, and those that grow."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

from fivcore import FollowedModes, assembled_modes, assembled_onsets
from studies.plotting import figures, general
from studies.plotting.modes import draw_branches, modes_figure
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


def test_a_mode_that_grows_at_a_single_point_is_seen():
    figure, (top, bottom) = plt.subplots(2)
    growth = np.array([[-1.0, -1.0], [-1.0, 3.0], [2.0, -1.0], [2.0, -1.0], [-1.0, -1.0], [-1.0, 5.0]])
    mu, frequency = np.linspace(0.0, 0.5, 6), np.tile([100.0, 200.0], (6, 1))
    draw_branches(top, bottom, mu, frequency, growth)
    for axes, seen in ((top, [[0.1, 200.0], [0.5, 200.0]]), (bottom, [[0.1, 3.0], [0.5, 5.0]])):
        dots = [line.get_xydata() for line in axes.lines if line.get_marker() == "."]
        np.testing.assert_allclose(np.vstack([each[np.isfinite(each).all(axis=1)] for each in dots]), seen)
    plt.close(figure)


def test_the_zoom_of_a_series_has_the_period_of_the_highest_line_that_its_spectrum_shows():
    time = np.arange(20000) / 50e3
    values = np.sin(2.0 * np.pi * 1e3 * time) + 3.0 * np.sin(2.0 * np.pi * 14e3 * time)
    series = xr.Dataset(
        {"velocity_B": (("V", "elapsed"), values[None], {"units": "m s-1"}), "status": ("V", [1])},
        {"V": ("V", [2e-3], {"units": "m s-1"}), "elapsed": ("elapsed", time, {"units": "s"})},
    )
    with figures.style():
        _, zoom, right = general.draw_series(series, ["velocity_B"]).axes
    assert right.get_xlim() == (0.0, 10.0)
    assert np.ptp(zoom.lines[0].get_xdata()) == pytest.approx(10.0, abs=0.1)  # ms


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
