"""What every figure shares: long series keep their peaks, short ones are drawn as they are."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import sweeps
from studies import registry
from studies.maps.figure import _alone
from studies.plotting import figures, planes
from tests import HOME

COLUMNS = 1500


def drawn(y, columns=COLUMNS):
    """The axes with a series drawn in them."""
    _, (axes,) = figures.panels(1, 1, 17.0, 8.0)
    figures.trace(axes, np.arange(len(y)) * 1e-6, y, columns)
    return axes


@pytest.mark.parametrize("place", [0, 1, 249_999, 499_999])
@pytest.mark.parametrize("peak", [1e3, -1e3])
def test_a_spike_of_one_sample_among_many_is_drawn(place, peak):
    y = np.zeros(500_000, dtype=np.float32)
    y[place] = peak
    across, height = np.concatenate([path.vertices for path in drawn(y).collections[0].get_paths()]).T
    assert height[np.abs(height).argmax()] == peak
    assert np.abs(across[height == peak] - place * 1e-6).max() <= 0.5 / COLUMNS
    # Two points a column, and those that close the outline.
    assert len(across) <= 2 * COLUMNS + 3


@pytest.mark.parametrize("count", [1, 2, 4 * COLUMNS])
def test_a_short_series_is_drawn_bit_for_bit(count):
    y = np.random.default_rng(2).normal(size=count)
    axes = drawn(y)
    assert not axes.collections
    assert np.array_equal(axes.lines[0].get_ydata(), y)


def test_gaps_stay_gaps_and_swallow_nothing_beside_them():
    y = np.ones(100_000)
    y[30_000:40_000] = np.nan
    y[::1000] = np.nan
    y[70_001] = 9.0
    x, low, high = figures.envelope(np.arange(len(y)), y, 100)
    empty = (x >= 30_000) & (x < 40_000)
    assert np.array_equal(np.isnan(low), empty)
    assert np.array_equal(np.isnan(high), empty)
    assert high[70] == 9.0
    assert len(drawn(y, 100).collections[0].get_paths()) == 2


@given(hnp.arrays(float, st.integers(50, 400), elements=st.floats(-1e6, 1e6)), st.integers(1, 50))
def test_each_column_has_the_range_of_its_samples_and_touches_the_next(y, columns):
    x, low, high = figures.envelope(np.arange(len(y)), y, columns)
    assert np.all(np.diff(x) > 0)
    bounds = [*x, len(y)]
    for k in range(columns):
        part = y[bounds[k] : bounds[k + 1] + 1]
        assert (low[k], high[k]) == (part.min(), part.max())


def test_a_unit_with_a_slash_is_in_brackets_and_few_values_are_the_ticks():
    assert [planes.label(name) for name in ("V", "theta", "mu")] == ["V / (mm/s)", "θ / °", "μ"]
    _, (axes,) = figures.panels(1, 1, 17.0, 8.0)
    planes.set_axes(axes, "V", [1e-4, 1e-2], "mu", [0.1, 0.4])
    figures.one_two_five(axes.xaxis, axes.yaxis)
    assert [list(axes.get_xticks()), list(axes.get_yticks())] == [[0.1, 10.0], [0.1, 0.4]]


def test_bands_of_values_are_told_apart_however_far_they_lie():
    values = np.array([[2.0, np.nan, 2.8], [7.2, 7.6, 2.0]])
    scale, ticks = planes.banded(values)
    shades = scale([2.0, 2.8, 7.2, 7.6])
    assert np.all(np.diff(shades) > 0.15)
    assert all(2.0 <= tick <= 2.8 or 7.2 <= tick <= 7.6 for tick in ticks)
    assert np.all(np.isfinite(planes.banded(np.full((2, 2), 3.0))[0]([3.0])))


def test_a_cell_unlike_all_around_it_is_alone():
    stable = np.zeros((5, 6), dtype=bool)
    stable[1, 1] = stable[3, 3:5] = stable[0, 5] = True
    for cells in (stable, ~stable):
        assert np.argwhere(_alone(cells)).tolist() == [[1, 1]]


def test_the_paper_stands_beside_its_own_speeds_only():
    data = sweeps.open_results(HOME / "results" / "reference" / "fig7" / "fig7.nc").isel(V=[0, 1])
    lines = [axes.lines for axes in registry.load("fig7").draw(data.assign_coords(V=[1e-3, 3e-3])).axes[1::2]]
    assert [sum(line.get_label().startswith("paper") for line in each) for each in lines] == [5, 0]
