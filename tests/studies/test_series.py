"""Recorded series that a study does not show are drawn beside its figure, with their spectra."""

import numpy as np
import pytest
import xarray as xr

from studies import registry, runner
from studies.motion import series_figure
from studies.plotting import figures


@pytest.fixture(scope="module")
def recorded():
    """A tone of 1 kHz at two points."""
    elapsed = np.arange(20_000) / 50e3
    tone = np.sin(2e3 * np.pi * elapsed)
    values = np.stack([1e-3 * tone, 2e-3 * tone])[:, None, None, None]
    axes = {"V": [1e-3, 2e-3], "theta": [5.0], "mu": [0.2], "F": [9.0], "elapsed": elapsed}
    series = {"velocity_B": ([*axes], values), "normal_force": ([*axes], 9.0 + values)}
    return xr.Dataset(series, axes, {"configuration": "{}"})


def test_each_point_has_its_series_and_the_line_of_its_spectrum(recorded):
    names = series_figure.names(registry.load("scenes"), recorded)
    assert names == ["velocity_B", "normal_force"]
    with figures.style():
        figure = series_figure.draw(recorded, names)
        figure.draw_without_rendering()
    assert len(figure.axes) == 8
    assert figure.axes[0].get_title(loc="left") == "V = 1 mm/s, θ = 5°, μ = 0.2, F = 9 N"
    assert figure.axes[0].get_ylabel() == "velocity of B / (mm/s)"
    for axes in figure.axes[1::2]:
        frequency, power = axes.lines[0].get_data()
        above = frequency > 0.1
        assert frequency[above][np.argmax(power[above])] == pytest.approx(1.0, abs=0.02)


def test_of_many_points_some_are_shown_and_of_a_studys_own_series_none(recorded):
    many = xr.concat([recorded.isel(V=[0]).assign_coords(V=[k * 1e-3]) for k in range(1, 21)], "V")
    figure = series_figure.draw(many, ["velocity_B"])
    assert len(figure.axes) == 2 * series_figure.MOST
    assert figure.get_suptitle() == "Recorded series (6 of 20)"
    assert series_figure.names(registry.load("fig7"), recorded) == ["normal_force"]
    assert runner.series_of(registry.load("fig5"), recorded.isel(elapsed=0)) is None
