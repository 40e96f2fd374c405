"""Figures: what is drawn of the kept results is the picture that is kept beside them."""

import re
from functools import cache
from itertools import combinations

import matplotlib
import pytest
from matplotlib.testing.compare import compare_images
from matplotlib.transforms import Bbox

import sweeps
from studies import registry
from studies.plotting import figures
from tests import HOME

# Root mean square over the pixels, of 255: another machine may draw letters otherwise; a line that is missing
# makes more (`test_a_line_that_is_missing_shows`).
TOLERANCE = 1.0
KEPT = HOME / "results" / "reference"


@cache
def figure_of(name):
    with figures.style():
        return registry.load(name).draw(sweeps.open_results(KEPT / name / f"{name}.nc"))


@pytest.mark.parametrize("name", registry.NAMES)
def test_every_kept_figure_is_drawn_again(name, tmp_path):
    kept, again = KEPT / name / f"{name}.png", tmp_path / f"{name}.png"
    drawn_by = re.search(rb"Matplotlib version(\d+\.\d+)", kept.read_bytes())[1].decode()
    if not matplotlib.__version__.startswith(f"{drawn_by}."):
        pytest.skip(f"Matplotlib {drawn_by} drew it; another measures letters otherwise, and so moves the axes")
    with figures.style():
        again.write_bytes(figures.saved(figure_of(name), "png", ""))
    assert compare_images(str(kept), str(again), TOLERANCE) is None


def boxes_of_labels(axes):
    """Of each side of some axes, where its numbers stand."""
    for side in (axes.xaxis, axes.yaxis):
        low, high = sorted(side.get_view_interval())
        ticks = [tick for tick in side.get_major_ticks() if low <= tick.get_loc() <= high]
        labels = [tick.label1 for tick in ticks if tick.label1.get_visible() and tick.label1.get_text()]
        yield [label.get_window_extent() for label in labels]


@pytest.mark.parametrize("name", registry.NAMES)
def test_nothing_covers_what_is_drawn(name):
    """Legends name each thing once, lie within the figure and off its lines; numbers and notes stand apart."""
    with figures.style():
        figure = figure_of(name)
        figure.draw_without_rendering()
    for legend in [*figure.legends, *filter(None, (axes.get_legend() for axes in figure.axes))]:
        labels, box = [text.get_text() for text in legend.get_texts()], legend.get_window_extent()
        assert len(set(labels)) == len(labels)
        assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1, labels
        for axes in figure.axes:
            if (covered := Bbox.intersection(box, axes.bbox)) and not (covered.width == 0 or covered.height == 0):
                paths = [line.get_path().transformed(line.get_transform()) for line in axes.lines]
                assert not any(path.cleaned(remove_nans=True).intersects_bbox(box, False) for path in paths), (
                    labels
                )
    for axes in figure.axes:
        notes = [note.get_window_extent() for note in axes.texts if note.get_text()]
        for group in (*boxes_of_labels(axes), notes):
            assert not any(one.overlaps(other) for one, other in combinations(group, 2)), axes.get_title("left")
