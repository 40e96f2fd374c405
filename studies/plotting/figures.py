"""Style of all figures: sizes, lines, and colours that colour-blind readers can tell apart.

Matplotlib is imported on the first drawing: workers and `fiv --help` never need it.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from hashlib import sha256
from io import BytesIO
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from studies.declaring import labels, spec
from sweeps import InputError

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes as Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure as Figure

Array = NDArray[Any]

# From this ratio of its ends on a logarithmic axis has ticks at powers of ten only.
MANY_DECADES = 200.0
# Okabe and Ito's palette; distinct in grey by lightness and by the markers used with it.
BLACK, GREY = "#000000", "#7f7f7f"
BLUE, ORANGE, GREEN, RED = "#0072b2", "#e69f00", "#009e73", "#d55e00"
COLOURS = (BLUE, BLACK, ORANGE, GREEN, RED)
SUPERSCRIPTS = str.maketrans("-−0123456789", "⁻⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "+")
# Of a parameter that is followed up and down.
WAYS = {"up": (GREEN, "^"), "down": (RED, "v")}

# Width of a figure, mm, from which its panels stand side by side, and type of its size; else the smaller one.
WIDTH, WIDE, LARGE, SMALL = 180.0, 130.0, 8.0, 7.0
NARROWEST, WIDEST = 40.0, 1000.0
STYLE: Any = {
    "figure.figsize": (WIDTH / 25.4, 0.75 * WIDTH / 25.4),
    "figure.dpi": 200.0,
    "font.size": LARGE, "axes.titlesize": "medium", "figure.titlesize": "large", "lines.linewidth": 1.2,
    "axes.spines.top": False, "axes.spines.right": False, "axes.axisbelow": True,
    "axes.grid": True, "grid.color": "#e0e0e0", "grid.linewidth": 0.6,
    "legend.fontsize": "medium", "legend.edgecolor": "none", "legend.framealpha": 0.85,
    # Names within a vector figure follow from what is drawn, not from chance.
    "svg.hashsalt": "fiv",
}  # fmt: skip
# Fonts are embedded as TrueType, and text stays text, as journals ask; it is as wide as where it is measured.
FONTS: Any = {"pdf.fonttype": 42, "ps.fonttype": 42, "svg.fonttype": "none", "text.hinting": "none"}

# Metadata of each format: which entry names the data that a figure shows, and no date, so that the same result is
# the same file.
SOURCE = {"png": "Source", "svg": "Source", "pdf": "Keywords"}
UNDATED: dict[str, dict[str, None]] = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
# Of a large variable so many bytes are read at a time.
READ_BYTES = 1 << 24
# What is taken of a user's matplotlibrc: how things look.
LOOKS = (
    *("axes", "boxplot", "contour", "date", "errorbar", "figure", "font", "grid", "hatch", "hist", "image"),
    *("legend", "lines", "markers", "mathtext", "patch", "path", "pcolor", "pdf", "ps", "savefig", "scatter"),
    *("svg", "text", "xaxis", "xtick", "yaxis", "ytick"),
)
# Lines of a figure's title; what is longer goes below. Gap between parts of a figure, and height of a page, cm.
LINES, GAP, PAGE = 2, 0.15, 23.5
# Least width of a marker's edge, points; most passes in which panels and their texts are fitted to each other.
LEAST_EDGE, PASSES = 0.6, 4


@contextmanager
def style(
    width: float | str | None = None, font: str | None = None, sheet: str | PathLike[str] | None = None
) -> Iterator[None]:
    """Draw and save in the project's style, then the user's matplotlibrc, then a style `sheet`.

    `width` is in m, or text like "88mm", `font` a family or a file, `sheet` a name or a file.
    """
    import matplotlib.style

    path, look = matplotlib.matplotlib_fname(), dict[str, Any]()
    if Path(path).parent != Path(matplotlib.get_data_path()):
        own = matplotlib.rc_params_from_file(path, use_default_template=False)
        look = {key: value for key, value in own.items() if key.partition(".")[0] in LOOKS}
    metres = None if width is None else spec.one(str(width), "width", "m")
    if metres is not None and not NARROWEST <= 1e3 * metres <= WIDEST:
        raise InputError(f"width = {width}: it must be from {NARROWEST:g}mm to {WIDEST:g}mm")
    try:
        context = matplotlib.style.context(["default", STYLE | FONTS, look, *([str(sheet)] if sheet else [])])
        context.__enter__()
    except OSError as problem:
        known = ", ".join(matplotlib.style.available)
        raise InputError(f"style = {str(sheet)!r}: it must be a style file or one of {known}") from problem
    try:
        settings: Any = matplotlib.rcParams
        # Texts are not TeX's, and a figure is as wide as requested.
        settings.update({"text.usetex": False, "savefig.bbox": None})
        # Open markers have an edge, and labels of ticks that point inwards leave the corner free.
        settings["lines.markeredgewidth"] = max(settings["lines.markeredgewidth"], LEAST_EDGE)
        for side in ("xtick", "ytick"):
            if settings[f"{side}.direction"] == "in":
                settings[f"{side}.major.pad"] += settings[f"{side}.major.size"]
        if metres is not None:
            settings["figure.figsize"] = (metres / 0.0254, 0.75 * metres / 0.0254)
        if settings["font.size"] == LARGE and not is_wide():  # nobody has set it
            settings["font.size"] = SMALL
        if font is not None:
            settings.update(_typeface(font))
        yield
    finally:
        context.__exit__(None, None, None)


def _typeface(font: str) -> dict[str, Any]:
    """Settings of a font; glyphs that it lacks come from DejaVu Sans."""
    from matplotlib import font_manager

    try:
        if Path(font).suffix.lower() in (".ttf", ".otf"):
            font_manager.fontManager.addfont(font)
            font = font_manager.get_font(font).family_name
        font_manager.findfont(font, fallback_to_default=False)
    except (ValueError, OSError) as problem:
        near = get_close_matches(font, font_manager.get_font_names(), 3)
        also = f"; did you mean {' or '.join(near)}" if near else ", like DejaVu Serif, or a .ttf file"
        raise InputError(f"font = {font!r}: there is no such font here{also}") from problem
    math = {f"mathtext.{name}": f"{font}{kind}" for name, kind in (("rm", ""), ("it", ":italic"), ("bf", ":bold"))}
    return {"font.family": [font, "DejaVu Sans"], "mathtext.fontset": "custom", "mathtext.default": "rm"} | math


def is_wide() -> bool:
    """Whether panels fit side by side."""
    return width_cm() >= 0.1 * WIDE


def width_cm() -> float:
    """The width of figures in the current style, cm."""
    from matplotlib import rcParams

    return 2.54 * float(rcParams["figure.figsize"][0])


def look_digest() -> str:
    """Digest of the differences between the current style and the project's; "" if there are none."""
    from matplotlib import rcParams, rcParamsDefault

    plain = {**rcParamsDefault, **STYLE, **FONTS}
    changed = {k: v for k, v in rcParams.items() if k != "backend" and str(v) != str(plain[k])}
    return str(sorted((key, str(value)) for key, value in changed.items())) if changed else ""


def data_digest(dataset: xr.Dataset) -> str:
    """SHA-256 of all values of a result and of its configuration, without computing times."""
    digest = sha256(str(dataset.attrs.get("configuration")).encode())
    for name in sorted(map(str, set(dataset.variables) - {"wall_time"})):
        variable = dataset[name].variable
        digest.update(f"{name} {variable.dims} {variable.shape} {variable.dtype}".encode())
        rows: Any = variable if variable.ndim else variable.expand_dims("row")
        step = max(1, READ_BYTES * len(rows) // max(1, rows.nbytes))
        for first in range(0, len(rows), step):
            values = rows[first : first + step].values
            texts = values.dtype.hasobject
            digest.update("".join(f"{text!r}," for text in values.flat).encode() if texts else values.tobytes())
    return digest.hexdigest()


def saved(figure: Figure, form: str, digest: str) -> bytes:
    """A figure as a file of this format, with the digest of its data in the metadata."""
    if figure.get_layout_engine() is not None:
        # It needs the ticks, which the first drawing chooses.
        figure.draw_without_rendering()
    file = BytesIO()
    figure.savefig(file, format=form, dpi="figure", metadata=UNDATED[form] | {SOURCE[form]: digest})
    return file.getvalue()


def is_drawn_from(image: bytes, digest: str) -> bool:
    """Whether a PNG file written by `saved` was drawn from the data with this digest."""
    return f"tEXt{SOURCE['png']}\0{digest}".encode() in image


def panels(
    rows: int, columns: int, *heights: float, stack: bool = True, **options: Any
) -> tuple[Figure, list[Axes]]:
    """A figure with rows of so many cm and its panels, row by row; without room and to `stack`, one on the other.

    Columns that share an axis stand below one another.
    """
    each = list(heights) * (rows if len(heights) == 1 else 1)
    if not stack or columns == 1 or is_wide():
        figure = _figure(sum(each))
        axes = figure.subplots(rows, columns, squeeze=False, height_ratios=each, **options)
        return figure, list(axes.ravel())
    by_column = options.get("sharex") == "col"
    figure, count = _figure(columns * sum(each)), rows * columns
    order = [divmod(k, rows)[::-1] if by_column else divmod(k, columns) for k in range(count)]
    grid, found = figure.add_gridspec(count, 1, height_ratios=[each[row] for row, _ in order]), dict[Any, Any]()
    for k, (row, column) in enumerate(order):
        shared = found.get((0, column)) if by_column else None
        found[row, column] = figure.add_subplot(grid[k], sharex=shared)
        found[row, column].tick_params(labelbottom=not by_column or row == rows - 1)
    return figure, [found[divmod(k, columns)] for k in range(count)]


def mosaic(layout: Any, *heights: float, stack: bool = True, **options: Any) -> tuple[Figure, dict[str, Axes]]:
    """A figure with rows of so many cm and its panels by their names in `layout`; without room, in one column."""
    if stack and not is_wide():
        rows = {name: height for row, height in zip(layout, heights, strict=True) for name in row if name != "."}
        layout, heights = [[name] for name in rows], tuple(rows.values())
    figure = _figure(sum(heights))
    return figure, figure.subplot_mosaic(layout, height_ratios=heights, **options)


def _figure(height: float) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    height *= 1.0 if is_wide() else 0.85
    figure = Figure(figsize=(width_cm() / 2.54, height / 2.54), layout="constrained")
    FigureCanvasAgg(figure)  # which measures texts
    return figure


def trace(axes: Axes, x: Any, y: Any, columns: int = 1500, **options: Any) -> None:
    """A long series with its peaks: its range in each of `columns`, or a line if it is short."""
    if len(x) <= 4 * columns:
        axes.plot(x, y, **{"linewidth": 0.8} | options)
        return
    axes.fill_between(*envelope(x, y, columns), **{"linewidth": 0.5} | options)


def envelope(x: Any, y: Any, columns: int) -> tuple[Array, Array, Array]:
    """The range of a series in each of `columns` stretches with equally many samples.

    Parameters
    ----------
    x, y : array_like, (n,)
        Evenly sampled, n at least `columns`; a NaN in y is a gap.
    columns : int
        At least as many as a figure has pixels across, so that what is within one of them does not show.

    Returns
    -------
    x, low, high : ndarray, (columns,)
        Where each stretch begins, and the ends of its range; NaN where it has no value.
    """
    x, y = np.asarray(x), np.asarray(y)
    edges = np.linspace(0, len(x), columns + 1).astype(int)[:-1]
    # A column reaches to the first sample of the next, so that a steep flank leaves no gap.
    after = np.append(edges[1:], len(x) - 1)
    low, high = np.fmin.reduceat(y, edges), np.fmax.reduceat(y, edges)
    ends = np.where(np.isnan(low), np.nan, y[after])
    return x[edges], np.fmin(low, ends), np.fmax(high, ends)


def one_two_five(*sides: Axis) -> None:
    """Ticks of logarithmic axes at 1, 2 and 5 times a power of ten; over many decades only at the powers.

    Ticks that were set explicitly are kept.
    """
    from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator, NullFormatter

    for side in sides:
        if side.get_scale() == "log" and not isinstance(side.get_major_locator(), FixedLocator):
            low, high = side.get_view_interval()
            subs = (1.0, 2.0, 5.0) if high < MANY_DECADES * low else (1.0,)
            # Where there are fewer than two such ticks a LogLocator takes many even ones.
            places = np.outer(10.0 ** np.arange(np.floor(np.log10(low)), np.log10(high) + 1.0), subs)
            many = np.count_nonzero((low <= places) & (places <= high)) > 1
            side.set_major_locator(LogLocator(subs=subs) if many else MaxNLocator(4))
            side.set_major_formatter(lambda x, _: powers(f"{x:g}"))
            side.set_minor_formatter(NullFormatter())


def finish(figure: Figure, told: str = "", warning: str = "", *, title: bool = True) -> Figure:
    """Fit titles, legends, labels and ticks to the width of a figure of `panels` or `mosaic`.

    What was set is `told` below, small. Without `title` it has neither, but a `warning` in any case. The label of
    the figure is both, for a caption.
    """
    from matplotlib import rc_context, rcParams
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    heading, plain = figure.get_suptitle(), figure.savefig
    # Ticks, too, depend on the style in which a figure is saved.
    look: Any = {key: value for key, value in rcParams.items() if key.partition(".")[0] in LOOKS}

    def save(*where: Any, **how: Any) -> None:
        with rc_context(look | FONTS):
            plain(*where, **how)

    figure.savefig = save  # type: ignore[method-assign]
    figure.set_label("\n".join(filter(None, (heading, told))))
    _letter(figure)
    _lighten(figure)
    engine = figure.get_layout_engine()
    if not isinstance(engine, ConstrainedLayoutEngine):
        return figure
    wide, high = figure.get_size_inches() * figure.dpi
    gap = GAP / 2.54 * figure.dpi
    lines = wrapped(figure, heading, wide - 2 * gap, "figure.titlesize").split("\n") if title and heading else []
    below = [" ".join(lines[LINES:]), figure.get_supxlabel(), told if title else "", warning]
    text = wrapped(figure, "; ".join(filter(None, below)), wide - 2 * gap, "font.size")
    foot = (
        figure.supxlabel(text, x=gap / wide, ha="left", va="bottom", fontsize=points("font.size"))
        if text
        else None
    )
    bottom = gap + (foot.get_window_extent().height + gap if foot else 0.0)
    key = _legend(figure, wide - 2 * gap)
    at = bottom
    bottom += key.get_window_extent().height + gap if key else 0.0
    top = gap
    figure.suptitle("\n".join(lines[:LINES]), va="top")
    if lines:
        top += figure._suptitle.get_window_extent().height + gap  # type: ignore[attr-defined]
    # Rows become lower where a page would be too short.
    high = min(high, max(PAGE / 2.54 * figure.dpi - bottom - top, 0.5 * high))
    total = high + bottom + top
    figure.set_size_inches(wide / figure.dpi, total / figure.dpi)
    figure._suptitle.set(y=1.0 - gap / total, in_layout=False)  # type: ignore[attr-defined]
    if foot:
        foot.set(y=gap / total, in_layout=False)
    if key:
        key.set(in_layout=False)
        key.set_bbox_to_anchor((0.5, at / total), figure.transFigure)
    engine.set(rect=(0.0, bottom / total, 1.0, high / total))
    # What has room is known once panels have their places.
    for _ in range(PASSES):
        engine.execute(figure)
        if not any([_fit(figure, axes) for axes in figure.axes]):
            break
    else:
        engine.execute(figure)
    # Labels of panels that span several columns reach beyond the margin.
    reach = [axes.get_tightbbox() for axes in figure.axes]
    left = max([0.0, *(gap - box.x0 for box in reach if box)]) / wide
    right = max([0.0, *(box.x1 + gap - wide for box in reach if box)]) / wide
    if left or right:
        engine.set(rect=(left, bottom / total, 1.0 - left - right, high / total))
        engine.execute(figure)
    figure.set_layout_engine("none")  # places stay
    return figure


def _lighten(figure: Figure) -> None:
    """On a dark background, draw what is black and has no outline as light as texts are."""
    from matplotlib import rcParams
    from matplotlib.collections import Collection as Cells
    from matplotlib.colors import to_rgb, to_rgba_array
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.text import Text

    if sum(to_rgb(rcParams["axes.facecolor"])) > 1.5:
        return
    backgrounds = {figure.patch, *(axes.patch for axes in figure.axes)}
    drawn = [*figure.findobj(Line2D), *figure.findobj(Patch), *figure.findobj(Cells), *figure.findobj(Text)]
    for artist in (each for each in {*drawn} - backgrounds if not each.get_path_effects()):
        for part in ("color", "edgecolor", "facecolor", "markeredgecolor", "markerfacecolor"):
            colour = getattr(artist, f"get_{part}", lambda: "none")()
            colours = to_rgba_array(colour) if colour is not None else np.empty((0, 4))
            if len(colours) and not colours[:, :3].any() and colours[:, 3].all():
                getattr(artist, f"set_{part}")(rcParams["text.color"])


def points(name: str) -> float:
    """The size of type, in points, that a setting names."""
    from matplotlib import rcParams
    from matplotlib.font_manager import FontProperties

    return float(FontProperties(size=rcParams[name]).get_size_in_points())  # type: ignore[index]


def name_rows(axes: Axes, rows: Sequence[str], heads: Collection[int] = ()) -> None:
    """Name rows 0, 1, ... of a panel beside them; those of `heads` are headings, within the panel."""
    named = [k for k in range(len(rows)) if k not in heads]
    axes.set_yticks(named, [powers(rows[k]) for k in named])
    for k in heads:
        axes.text(0.01, k, rows[k], transform=axes.get_yaxis_transform(), va="center", fontweight="bold")


def reworded(text: str, words: Mapping[str, str]) -> str:
    """A text with those of its parts that are keys of `words` in a reader's words, the longest first."""
    known = "|".join(map(re.escape, sorted(words, key=len, reverse=True)))
    return re.sub(rf"(?<!\w)(?:{known})(?!\w)", lambda found: words[found[0]], text)


def powers(text: str) -> str:
    """A text with powers of ten as one prints them: 10⁻⁸ for 1e-08."""

    def power(found: re.Match[str]) -> str:
        digits = str(int(found[2])).translate(SUPERSCRIPTS)
        return f"10{digits}" if found[1] == "1" else f"{found[1]}·10{digits}"

    return re.sub(r"\b(\d+(?:\.\d+)?)e([-+−]?\d+)\b", power, text)


def wrapped(figure: Figure, text: str, width: float, size: str | float) -> str:
    """A text broken where a line is longer than `width`, in pixels of a figure, but not in `F = 9 N`."""
    from matplotlib.font_manager import FontProperties

    text = powers(text)

    font = FontProperties(size=points(size) if isinstance(size, str) else size)
    renderer, lines = figure.canvas.get_renderer(), list[str]()  # type: ignore[attr-defined]
    whole = re.sub(r" = [^\s,;]+(?: [^\s,=;]+)?", lambda found: found[0].replace(" ", "\N{NO-BREAK SPACE}"), text)
    for part in whole.splitlines():
        line = ""
        for word in part.split(" "):
            longer = f"{line} {word}" if line else word
            if line and renderer.get_text_width_height_descent(longer, font, ismath=False)[0] > width:
                lines.append(line)
                longer = word
            line = longer
        lines.append(line)
    return "\n".join(lines).replace("\N{NO-BREAK SPACE}", " ")


def _legend(figure: Figure, width: float) -> Any:
    """The figure's legend in as many columns as have room."""
    if not figure.legends:
        return None
    entries, most = vars(figure.legends[0])["entries"], figure.legends[0]._ncols  # type: ignore[attr-defined]
    handles, texts = [*entries.values()], [*map(powers, entries)]
    for columns in range(min(most, len(texts)), 0, -1):
        figure.legends[-1].remove()
        if columns == 1:
            texts = [wrapped(figure, text, 0.85 * width, "legend.fontsize") for text in texts]
        key = figure.legend(handles, texts, loc="lower center", ncols=columns, borderaxespad=0.0, borderpad=0.2)
        if key.get_window_extent().width <= width:
            break
    return key


def _fit(figure: Figure, axes: Axes) -> bool:
    """Wrap titles and labels that are longer than their side of a panel, thin out ticks; whether any changed."""
    box, changed = axes.get_window_extent(), False
    sides = (axes.title, box.width), (axes._left_title, box.width), (axes.xaxis.label, box.width)  # type: ignore[attr-defined]
    for text, room in (*sides, (axes.yaxis.label, box.height)):
        if text.get_text() and text.get_visible():
            whole = vars(text).setdefault("whole", text.get_text())
            before = text.get_text()
            text.set_text(wrapped(figure, whole, max(room, 40.0), text.get_fontsize()))
            changed |= text.get_text() != before
    for side in (axes.xaxis, axes.yaxis):
        while _touch(side) and _thin(side):
            changed = True
    return changed


def _touch(side: Axis) -> bool:
    """Whether tick labels overlap."""
    ticks = side._update_ticks() if side.get_visible() and side.axes.axison else []  # type: ignore[attr-defined]
    boxes = [
        text.get_window_extent().expanded(1.1, 1.0)
        for tick in ticks
        if (text := tick.label1).get_visible() and text.get_text()
    ]
    return any(one.overlaps(other) for one, other in pairwise(boxes))


def _thin(side: Axis) -> bool:
    """Remove some ticks; return False if that is not possible."""
    from matplotlib.category import StrCategoryLocator
    from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator, NullFormatter

    locator, low, high = side.get_major_locator(), *sorted(side.get_view_interval())
    places = [place for place in side.get_majorticklocs() if low <= place <= high]
    if len(places) < 3 or isinstance(locator, (FixedLocator, StrCategoryLocator)):
        return False
    if isinstance(locator, MaxNLocator) and len(places) > 3:
        side.set_major_locator(MaxNLocator(len(places) - 2, steps=[1, 2, 2.5, 5, 10]))
    elif isinstance(locator, LogLocator) and len(locator._subs) > 1:  # type: ignore[attr-defined]
        side.set_major_locator(LogLocator(subs=(1.0,) if len(locator._subs) == 2 else (1.0, 3.0)))  # type: ignore[attr-defined]
    else:
        side.set_ticks(places[::2])
    side.set_minor_formatter(NullFormatter())
    return True


def place(dataset: xr.Dataset, *names: str) -> str:
    """The parameters with a single value: "θ = 5, μ = 0.2"."""
    return ", ".join(labels.named(name, dataset[name]) for name in names
                     if name in dataset.coords and not dataset[name].ndim)  # fmt: skip


def curve(axes: Axes, x: Any, y: Any, error: Any = None, ends: Any = None, **look: Any) -> None:
    """A quantity along a parameter, with its errors or the ends of its interval, where they are known.

    Without finite values nothing is drawn, so that the legend names drawn curves only.
    """
    y = np.asarray(y, dtype=float)
    if np.isfinite(y).any():
        error = np.abs(np.asarray(ends) - y) if ends is not None else error
        bars = None if error is None else np.nan_to_num(np.asarray(error))
        axes.errorbar(x, y, bars, **{"markersize": 4.0, "linewidth": 0.8, "capsize": 2.0} | look)


def distributions(axes: Axes, samples: Mapping[str, Any]) -> None:
    """Empirical distribution function of each sample."""
    for (label, values), colour, style in zip(samples.items(), COLOURS, ("-", "--", "-.", ":"), strict=False):
        axes.ecdf(values, color=colour, linestyle=style, label=label)
    axes.set_ylim(0.0, 1.02)
    if samples:
        axes.set_xlim(left=0.0)
        axes.legend(loc="upper left", handlelength=1.4)


def spans(axes: Axes, intervals: Iterable[Any], label: str = "", **look: Any) -> None:
    """Shade intervals of the horizontal parameter."""
    for ends in intervals:
        if len(ends):
            options: dict[str, Any] = {
                "color": GREY,
                "alpha": 0.2,
                "linewidth": 0.0,
                "label": label or None,
            } | look
            axes.axvspan(*ends, **options)


def entitle(panels: Iterable[Axes], titles: Iterable[str]) -> None:
    """A title over each panel, to which `finish` adds its letter."""
    for axes, title in zip(panels, titles, strict=True):
        axes.set_title(title, loc="left")


def _letter(figure: Figure) -> None:
    """Letters before the titles of two or more panels, in their order."""
    panels = [
        axes
        for axes in figure.axes
        if axes.get_label() != "<colorbar>" and (axes.axison or axes.get_title("left"))
    ]
    for k, axes in enumerate(panels if len(panels) > 1 else ()):
        title = axes.get_title("left") or axes.get_title()
        axes.set_title("")
        axes.set_title(f"({chr(ord('a') + k)}) {title}".rstrip(), loc="left")


def legend_below(figure: Figure, panels: Sequence[Axes], columns: int = 4) -> None:
    """Draw one legend below the figure, with each label once."""
    entries: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    if entries:
        key = figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=columns)
        vars(key)["entries"] = entries  # from which `finish` makes another
