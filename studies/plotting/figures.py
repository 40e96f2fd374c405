"""How every figure of the project looks: sizes, lines, and colours that colour blindness leaves apart.

Matplotlib is imported when something is drawn: workers and `fiv --help` never need it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from hashlib import sha256
from io import BytesIO
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from studies.declaring import labels

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
# Of a parameter that is followed up and down.
WAYS = {"up": (GREEN, "^"), "down": (RED, "v")}

STYLE: Any = {
    "font.size": 9.0, "axes.titlesize": 10.0, "figure.titlesize": 11.0, "lines.linewidth": 1.2,
    "axes.spines.top": False, "axes.spines.right": False, "axes.axisbelow": True,
    "axes.grid": True, "grid.color": "#e0e0e0", "grid.linewidth": 0.6,
    "legend.fontsize": 8.0, "legend.edgecolor": "none", "legend.framealpha": 0.85,
    # Names within a vector figure follow from what is drawn, not from chance.
    "svg.hashsalt": "fiv",
}  # fmt: skip

# Metadata of each format: which entry names the data that a figure shows, and no date, so that the same result is
# the same file.
SOURCE = {"png": "Source", "svg": "Source", "pdf": "Keywords"}
UNDATED: dict[str, dict[str, None]] = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
# Of a title to a centimetre.
LETTERS = 4.4
# Of a large variable so many bytes are read at a time.
READ_BYTES = 1 << 24


@contextmanager
def style() -> Iterator[None]:
    """Draw and save in the project's style, whatever the user's own settings."""
    import matplotlib.style

    with matplotlib.style.context(["default", STYLE]):
        yield


def data_digest(dataset: xr.Dataset) -> str:
    """SHA-256 of all values of a result and of its configuration, but for the times that its points took."""
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
    """A figure as a file of this format, with the digest of the data that it shows among its metadata."""
    # The layout needs the ticks, which the first drawing chooses.
    figure.draw_without_rendering()
    file = BytesIO()
    figure.savefig(file, format=form, dpi=200, metadata=UNDATED[form] | {SOURCE[form]: digest})
    return file.getvalue()


def shows(image: bytes, digest: str) -> bool:
    """Whether a PNG file that `saved` gave was drawn from the data with this digest."""
    return f"tEXt{SOURCE['png']}\0{digest}".encode() in image


def panels(rows: int, columns: int, width: float, height: float, **options: object) -> tuple[Figure, list[Axes]]:
    """A figure of `width` by `height` cm and its panels, row by row."""
    figure = _figure(width, height)
    axes = figure.subplots(rows, columns, squeeze=False, **options)  # type: ignore[call-overload]
    return figure, list(axes.ravel())


def mosaic(layout: Any, width: float, height: float, **options: Any) -> tuple[Figure, dict[str, Axes]]:
    """A figure of `width` by `height` cm and its panels by their names in `layout`."""
    figure = _figure(width, height)
    return figure, figure.subplot_mosaic(layout, **options)


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / 2.54, height / 2.54), layout="constrained")
    # Labels of panels that span several columns reach into the margin.
    figure.get_layout_engine().set(w_pad=0.1)  # type: ignore[union-attr, call-arg]
    return figure


def trace(axes: Axes, x: Any, y: Any, columns: int = 1500, **options: Any) -> None:
    """A long series without loss of its peaks: its range in each of `columns`, or a line if it is short."""
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
    """Ticks of logarithmic axes at 1, 2 and 5 times a power of ten; over many decades at the powers alone.

    Ticks that were chosen by hand stay.
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
            side.set_major_formatter("{x:g}")
            side.set_minor_formatter(NullFormatter())


def fitted(title: str, width: float) -> str:
    """A figure's title, broken where a line is longer than the figure is wide, cm, but not in `F = 9 N`."""
    whole = re.sub(r" = [^\s,]+(?: [^\s,=]+)?", lambda found: found[0].replace(" ", "\N{NO-BREAK SPACE}"), title)
    broken = "\n".join(fill(line, int(LETTERS * width)) for line in whole.splitlines())
    return broken.replace("\N{NO-BREAK SPACE}", " ")


def place(dataset: xr.Dataset, *names: str) -> str:
    """Those parameters that have one value: "θ = 5, μ = 0.2"."""
    return ", ".join(labels.named(name, dataset[name]) for name in names
                     if name in dataset.coords and not dataset[name].ndim)  # fmt: skip


def curve(axes: Axes, x: Any, y: Any, error: Any = None, ends: Any = None, **look: Any) -> None:
    """A quantity along a parameter, with its errors, or the ends of its interval, where they are known.

    Nothing without values, so that a legend names what is drawn.
    """
    y = np.asarray(y, dtype=float)
    if np.isfinite(y).any():
        error = np.abs(np.asarray(ends) - y) if ends is not None else error
        bars = None if error is None else np.nan_to_num(np.asarray(error))
        axes.errorbar(x, y, bars, **{"markersize": 4.0, "linewidth": 0.8, "capsize": 2.0} | look)


def distributions(axes: Axes, samples: Mapping[str, Any]) -> None:
    """The fraction of each sample below a value."""
    for (label, values), colour, style in zip(samples.items(), COLOURS, ("-", "--", "-.", ":"), strict=False):
        axes.ecdf(values, color=colour, linestyle=style, label=label)
    axes.set_ylim(0.0, 1.02)
    if samples:
        axes.set_xlim(left=0.0)
        axes.legend(loc="upper left")


def spans(axes: Axes, intervals: Iterable[Any], label: str = "", **look: Any) -> None:
    """Shade intervals of the parameter across; of an empty one nothing."""
    for ends in intervals:
        if len(ends):
            options: dict[str, Any] = {
                "color": GREY,
                "alpha": 0.2,
                "linewidth": 0.0,
                "label": label or None,
            } | look
            axes.axvspan(*ends, **options)


def letter(panels: Iterable[Axes], titles: Iterable[str]) -> None:
    """Over each panel its letter and title."""
    for k, (axes, title) in enumerate(zip(panels, titles, strict=True)):
        axes.set_title(f"({chr(ord('a') + k)}) {title}".rstrip(), loc="left", fontsize=9.0)


def legend_below(figure: Figure, panels: Sequence[Axes], columns: int = 4) -> None:
    """One legend under the whole figure, each label once."""
    entries: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    if entries:
        figure.legend(
            entries.values(), entries.keys(), loc="outside lower center", ncols=min(columns, len(entries))
        )
