"""How errors fall with cut-off, step and mesh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from studies.accuracy import settings as asked
from studies.accuracy import styles as looks
from studies.accuracy.errors import place
from studies.accuracy.rows import mean, root_mean_square
from studies.plotting import figures

# Below, an error is rounding.
LEAST = 1e-13
# Of errors in units of their tolerances.
RANGE = (0.05, 5.0)


def draw_cutoffs(axes: Axes, data: xr.Dataset) -> None:
    """Mismatch of `fast` at each scene against the cut-off, each at its default step."""
    rig = looks.rig_of(data)
    chosen = [
        (k, 1e-3 * asked.cutoff_of(option, rig))
        for k, option in looks.options(data)
        if option.kind == "cut-off" and not option.share and asked.FAST in option.methods
    ]
    _by_scene(axes, data, chosen)
    if "mismatch_undamped" in data and asked.FAST in data["method"].values:
        at = data["mismatch_undamped"].sel({"method": asked.FAST})
        pairs = [(x, root_mean_square(at.isel(setting=k).values)) for k, x in chosen]
        looks.plot(axes, pairs, {"color": figures.BLACK, "linewidth": 2.2, "label": "all, against paper undamped"})
    second = 1e-3 * asked.cutoff_of(asked.Option("cut-off", 3.0, ()), rig)
    axes.axvline(second, color=figures.GREY, linewidth=0.8, linestyle="--")
    how: looks.Look = {"fontsize": looks.TINY, "ha": "right", "transform": axes.get_xaxis_transform()}
    axes.text(second, 0.05, "P1's 2nd axial mode ", **how)
    axes.set(xscale="log", yscale="log", xlabel="cut-off / kHz", ylabel="error / tolerance, rms", ylim=RANGE)
    axes.set_title("cut-off of fast")
    axes.xaxis.set_minor_formatter(NullFormatter())
    ticks = [x for x in (10, 25, 50, 100, 200, 500) if chosen and 0.8 * chosen[0][1] < x < 1.3 * chosen[-1][1]]
    if ticks:
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
    handles = [line for line in axes.get_lines() if str(line.get_label()).startswith("all")]
    if handles:
        axes.legend(handles=handles, fontsize=looks.TINY, loc="upper left")


def draw_steps(axes: Axes, data: xr.Dataset) -> None:
    """Mismatch of `fast` at each scene against the step."""
    chosen = [(k, float(option.value)) for k, option in looks.options(data) if option.kind == "step"]
    _by_scene(axes, data, chosen)
    own = place(data, asked.FAST, asked.DEFAULT)
    if own is not None:
        rig = looks.rig_of(data)
        limits = [asked.step_limit(asked.FAST, asked.scene_of(int(n), rig), {}) for n in data["scene"].values]
        share = mean(data["step"].values[own] / limits)
        if np.isfinite(share):
            looks.upright(axes, share, "default")
    axes.set(yscale="log", xlabel="step / largest stable step", ylabel="error / tolerance, rms", ylim=RANGE)
    axes.set_xlim(0.0, 1.05)
    axes.set_title("step of fast")
    looks.legend(axes, ncols=2, loc="upper left")


def _by_scene(axes: Axes, data: xr.Dataset, chosen: Sequence[tuple[int, float]]) -> None:
    """Mismatch of settings of `fast`, one line a scene."""
    looks.tolerance(axes)
    if "mismatch" not in data or asked.FAST not in data["method"].values:
        return
    at = data["mismatch"].sel({"method": asked.FAST})
    for n, look in zip(range(at.sizes["scene"]), looks.SCENES, strict=False):
        pairs = [(x, float(at.isel(setting=k, scene=n))) for k, x in chosen]
        looks.plot(axes, pairs, {**look, "label": str(data["scene_name"].values[n])})


def draw_modes(axes: Axes, data: xr.Dataset) -> None:
    """Error of the lowest onset against the cut-off, by termination."""
    if "onset_error" in data:
        rig = looks.rig_of(data)
        errors = data["onset_error"].transpose("termination", "setting", "scene").values
        chosen = [
            (k, 1e-3 * asked.cutoff_of(option, rig))
            for k, option in looks.options(data)
            if option.kind == "cut-off" and not option.share
        ]
        for kind, own in zip(data["termination"].values, errors, strict=True):
            pairs = [(x, max(root_mean_square(own[k]), LEAST)) for k, x in chosen]
            looks.plot(axes, pairs, {**looks.TERMINATIONS[str(kind)], "label": str(kind)})
            order = {"none": 1, "elastic": 3}.get(str(kind))
            if order is not None and pairs:
                looks.slope(axes, *pairs[2 * len(pairs) // 3], order, 2.0)
    axes.set(xscale="log", yscale="log", xlabel="cut-off / kHz", ylabel=r"error of the lowest onset's $\mu$")
    axes.set_title("sliding stability: cut-off")
    looks.legend(axes, loc="lower left")


def draw_elements(axes: Axes, data: xr.Dataset) -> None:
    """Errors of onset and growth against the number of elements."""
    count = looks.rig_of(data).p1.elements
    meshes = [(option.size, k) for k, option in looks.options(data) if option.size is not None]
    known: list[tuple[float, float]] = []
    for what, name, look in (
        ("onset", r"lowest onset's $\mu$", "absorbing"),
        ("growth", "largest growth rate", "elastic"),
    ):
        if f"{what}_error" not in data:
            continue
        at = data[f"{what}_error"].isel(termination=0)
        pairs = [(count * factor, root_mean_square(at.isel(setting=k).values)) for factor, k in sorted(meshes)]
        looks.plot(axes, pairs, {**looks.TERMINATIONS[look], "label": name})
        if what == "onset":
            known = [pair for pair in pairs if np.isfinite(pair[1])]
    if known:
        looks.slope(axes, *known[0], 4, 0.3)
    axes.set(xscale="log", yscale="log", xlabel="elements of P1", ylabel="relative error")
    axes.xaxis.set_minor_formatter(NullFormatter())
    if known:
        axes.set_xticks([x for x, _ in known], [f"{x:.0f}" for x, _ in known])
    axes.set_title("sliding stability: mesh")
    looks.legend(axes, loc="upper right")
