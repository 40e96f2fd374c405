"""The picture at the head of the README."""

import numpy as np
import xarray as xr

from studies.plotting import figures
from tests import HOME
from tests.docs import front


def test_the_picture_shows_where_a_knock_starts_squeal():
    mu = np.linspace(0.088, 0.11, 5)
    knocks = xr.Dataset({"knock_threshold": ("mu", [np.nan, 5e-4, 3e-4, 1e-4, 3e-5])}, {"mu": mu})
    knocks["knock_threshold_se"] = 0.01 * knocks["knock_threshold"]
    with xr.open_dataset(HOME / "results/reference/stability/stability.nc") as stability, figures.style():
        figure = front.front(stability, knocks)
    axes = figure.axes[2]
    assert axes.get_ylabel() == "knock on P1 / (mN s)"
    assert [text.get_text() for text in axes.texts] == ["sliding", "squeal", "a stronger knock\nstarts squeal"]
    assert 0.11 < axes.lines[1].get_xdata()[0] < 0.112
