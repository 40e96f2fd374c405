"""Detection of clipped and overlapping texts in a figure."""

from itertools import combinations
from unittest import mock

from matplotlib.text import Text

# Pixels at 100 dpi: edges of letters may touch.
TOUCH = 1.0


def faults(figure):
    """Texts that leave the figure, texts on texts, and legends on texts or panels, as they are drawn."""
    drawn, plain = [], Text.draw

    def draw(self, renderer):
        if self.get_visible() and self.get_text().strip():
            drawn.append((self, self.get_window_extent(renderer)))
        return plain(self, renderer)

    with mock.patch.object(Text, "draw", draw):
        figure.canvas.draw()
    whole, found = figure.bbox, []
    for text, box in drawn:
        if box.x0 < -TOUCH or box.y0 < -TOUCH or box.x1 > whole.x1 + TOUCH or box.y1 > whole.y1 + TOUCH:
            found.append(f"cut: {text.get_text()!r}")
    for (one, first), (other, second) in combinations(drawn, 2):
        if _overlap(first, second):
            found.append(f"{one.get_text()!r} on {other.get_text()!r}")
    legends = [*figure.legends, *filter(None, (axes.get_legend() for axes in figure.axes))]
    for legend in legends:
        box, own = legend.get_window_extent(), {*legend.get_texts(), legend.get_title()}
        found += [f"legend on {text.get_text()!r}" for text, at in drawn if text not in own and _overlap(box, at)]
    for legend in figure.legends:
        boxes = [axes.get_window_extent() for axes in figure.axes if axes.axison]
        found += ["legend on a panel"] * any(_overlap(legend.get_window_extent(), box) for box in boxes)
    return found


def _overlap(one, other):
    across = min(one.x1, other.x1) - max(one.x0, other.x0)
    up = min(one.y1, other.y1) - max(one.y0, other.y0)
    return across > TOUCH and up > TOUCH
