"""Detection of clipped and overlapping texts in a figure."""

from io import BytesIO
from itertools import combinations
from unittest import mock

from matplotlib.text import Text

# Pixels at 200 dpi: edges of letters may touch. Height of a page, mm.
TOUCH, PAGE = 1.0, 240.0


def faults(figure):
    """Whatever is wrong with a figure as it is saved.

    Texts that leave it, texts on texts, legends on texts, on panels or on the curves of their own panel; panels
    without a letter; a height that no page has.
    """
    boxes, plain = {}, Text.draw

    def draw(self, renderer):
        if self.get_visible() and self.get_text().strip():
            boxes[self] = self.get_window_extent(renderer)
        return plain(self, renderer)

    with mock.patch.object(Text, "draw", draw):
        figure.savefig(BytesIO(), dpi="figure")
    drawn, whole, found = [*boxes.items()], figure.bbox, []
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
        for line in legend.axes.lines if legend.axes else ():
            path = line.get_transform().transform_path(line.get_path()).cleaned(remove_nans=True)
            marks = path.vertices[:-1] if line.get_linestyle() == "None" else ()
            hidden = any(map(box.contains, *zip(*marks, strict=True))) if len(marks) else False
            if hidden or (not len(marks) and len(path.vertices) > 1 and path.intersects_bbox(box, filled=False)):
                found.append(f"legend on the curve {line.get_label()!r}")
    for legend in figure.legends:
        boxes = [axes.get_window_extent() for axes in figure.axes if axes.axison]
        found += ["legend on a panel"] * any(_overlap(legend.get_window_extent(), box) for box in boxes)
    panels = [axes for axes in figure.axes if axes.axison and axes.get_label() != "<colorbar>"]
    if len(panels) > 1:
        found += [f"no letter: {text!r}" for axes in panels if (text := axes.get_title("left"))[:1] != "("]
    high = 25.4 * float(figure.get_size_inches()[1])
    return found + [f"{high:.0f} mm high"] * (high > PAGE)


def _overlap(one, other):
    across = min(one.x1, other.x1) - max(one.x0, other.x0)
    up = min(one.y1, other.y1) - max(one.y0, other.y0)
    return across > TOUCH and up > TOUCH
