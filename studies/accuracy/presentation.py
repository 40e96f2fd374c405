"""Tables and figure of run time against error: costs, errors, and the cheapest setting that is right."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import TYPE_CHECKING, Any

import pandas as pd
import xarray as xr

from studies.accuracy import errors, settings
from studies.accuracy.settings import CONVERGED, DEFAULT, FAST, GIVEN, MODEL, PAPERS, PUBLISHED, SCHEME
from studies.plotting import figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Groups of scenes, and whether they are of the paper's rig.
GROUPS = {"paper's rig": True, "random rigs": False}
MARKERS, MISMATCH = "*Pos^vDXd<>p", "error / tolerance (RMS)"
# Colours of kinds of settings; a colour comes again with another marker and line.
COLOURS = figures.BLACK, figures.BLUE, figures.ORANGE, figures.GREEN, figures.RED, figures.GREY
LINES = "-", "--"
# How the figure calls settings, and their kinds without the factor.
WORDS = {
    "numerical damping published": "published numerical damping", "numerical damping none": "no numerical damping",
    "no numerical damping": "no numerical damping", "published damping": "published numerical damping",
    "step": "time step ×", "cut-off": "cut-off frequency ×", "damping": "contact damping ×",
    "truncation": "rigid contact, cut-off ×", "cross terms off": "no normal-tangential coupling",
    "no cross terms": "no normal-tangential coupling", "converged": "refined",
}  # fmt: skip
_ALLOWED = ", ".join(f"{text} {100.0 * tolerance:g} %" for text, _, tolerance in errors.QUANTITIES.values())
TERMS = f"""CPU s/s: CPU time per simulated second, mean over scenes. CPU s to SE: CPU time until the standard
error of each fraction of time is {errors.STANDARD_ERROR:g}. Speed-up: relative to the published scheme, over the
scenes that both computed. Error: error divided by tolerance, root mean square over statistics and scenes; SE: the
error that standard errors alone would give. Fractions of time: their largest error in percentage points. Scenes
within: scenes in which each error is below its tolerance ({_ALLOWED}; percentage points for fractions of time)
plus {errors.ERRORS_ALLOWED:g} standard errors, and that of the first slip below {100.0 * errors.FIRST_SLIP:g} %.
{FAST} with {PUBLISHED} is compared with the published scheme ({", ".join(SCHEME)}). All others, the published
scheme included, are compared with {", ".join(GIVEN)}, which solves the model without numerical damping;
{settings.PAPER} with {MODEL} checks this reference.
Rigs are drawn by `studies.accuracy.rigs.drawn_scene({settings.SEED}, number)`."""


def table(data: xr.Dataset) -> pd.DataFrame:
    """Methods and settings whose cost is known, in the file's order; what is of a group of scenes by its name.

    `speed_up` is over the published scheme, the geometric mean over common scenes; `mismatch` and its standard
    `error` are root mean squares, `fraction` is the largest error of a fraction of time; others are means.
    """
    names = {"cost": "cpu_per_second", "time": "time_to_standard_error", "step": "step", "modes": "modes"}
    columns: dict[str, Any] = {column: data[name].mean("scene") for column, name in names.items()}
    ratio = errors.at(data["cpu_per_second"], *SCHEME) / data["cpu_per_second"]
    columns["speed_up"] = xr.ufuncs.exp(xr.ufuncs.log(ratio).mean("scene"))
    fraction = abs(data["quantity_error"].sel(quantity=list(errors.FRACTIONS))).max("quantity")
    for group, of_paper in GROUPS.items():
        chosen = data["scene"].isin(list(PAPERS)) == of_paper
        columns[f"mismatch {group}"] = errors.rms(data["mismatch"].where(chosen))
        columns[f"error {group}"] = errors.rms(data["mismatch_standard_error"].where(chosen))
        columns[f"fraction {group}"] = fraction.where(chosen).max("scene")
        columns[f"right {group}"] = ((data["within"] == errors.YES) & chosen).sum("scene")
        columns[f"compared {group}"] = ((data["within"] != errors.UNKNOWN) & chosen).sum("scene")
    columns = {name: column.reset_coords(drop=True) for name, column in columns.items()}
    frame = xr.Dataset(columns).to_dataframe(["method", "setting"])
    return frame[frame["cost"].notna()].reset_index()


def cheapest_right(frame: pd.DataFrame) -> pd.DataFrame:
    """The row of the cheapest setting within all tolerances in every compared scene; empty if there is none."""
    right, compared = (frame[[f"{name} {group}" for group in GROUPS]].to_numpy() for name in ("right", "compared"))
    most = compared.max(axis=0, initial=0)
    everywhere = ((compared == most) & (right == most)).all(axis=1) & most.any()
    return frame[everywhere].nsmallest(1, "cost")


def summary(data: xr.Dataset) -> Iterator[Any]:
    """The main result, costs, errors, scenes, and definitions."""
    frame = table(data)
    default = frame[(frame["method"] == FAST) & (frame["setting"] == DEFAULT)]
    cheapest = "The cheapest setting that is within them in every scene"
    for text, rows in (("The default", default), (cheapest, cheapest_right(frame))):
        for _, row in rows.iterrows():
            right, compared = (sum(row[f"{name} {group}"] for group in GROUPS) for name in ("right", "compared"))
            speed = f"{row['speed_up']:.3g} times as fast as the published scheme"
            within = f"within all tolerances in {right} of {compared} scenes"
            yield f"{text}: {row['method']}, {row['setting']}, {within}, {speed}."
    run = frame[["method", "setting"]]
    costs = {"step µs": 1e6 * frame["step"], "modes": frame["modes"], "CPU s/s": frame["cost"]}
    yield "Cost", run.assign(**costs, **{"CPU s to SE": frame["time"], "speed-up": frame["speed_up"]})
    for group in GROUPS:
        right, compared = (frame[f"{name} {group}"].astype(str) for name in ("right", "compared"))
        columns = {"error": frame[f"mismatch {group}"], "SE": frame[f"error {group}"]}
        columns |= {
            "fractions of time": 100.0 * frame[f"fraction {group}"],
            "scenes within": right + "/" + compared,
        }
        yield f"Errors, {group}", run.assign(**columns)[frame[f"compared {group}"] > 0]
    yield TERMS


def figure(data: xr.Dataset) -> Figure:
    """Error against cost of each group of scenes, error of every setting, and the time to a standard error."""
    figure, panels = figures.mosaic([[*"ab"], [*"cc"], [*"dd"]], 5.5, 9.5, 4.0)
    panels["b"].sharey(panels["a"])
    for letter, group in zip("ab", GROUPS, strict=True):
        _draw_costs(panels[letter], table(data), group)
    timed = data["setting"].isin([DEFAULT, CONVERGED, PUBLISHED, MODEL])
    _draw_scenes(panels["c"], data["mismatch"], MISMATCH)
    _draw_scenes(panels["d"], data["time_to_standard_error"].where(timed), "CPU time / s")
    panels["c"].axvline(1.0, color="black", lw=0.8, ls=":")
    until = f"CPU time to a standard error of {errors.STANDARD_ERROR:g} of the fractions of time"
    figures.entitle(panels.values(), (*GROUPS, "every setting at each scene", until))
    figures.legend_below(figure, list(panels.values()), 3)
    figure.suptitle("Run time against error")
    return figure


def _draw_costs(axes: Axes, frame: pd.DataFrame, group: str) -> None:
    """Errors of a group of scenes against cost; what standard errors alone would give is shaded."""
    frame = frame[frame[[f"mismatch {group}" for group in GROUPS]].gt(0.0).any(axis=1)]
    kinds = frame["method"] + ": " + frame["setting"].map(lambda name: settings.SETTINGS[name].kind)
    groups, looks = frame.groupby(kinds, sort=False), product(LINES, COLOURS)
    for marker, (style, colour), (kind, rows) in zip(MARKERS, looks, groups, strict=False):
        rows, size = rows.sort_values("cost"), 10 if kind == "fast: default" else 4
        look: dict[str, Any] = {"linestyle": style, "color": colour, "marker": marker}
        look["label"] = figures.reworded(kind, WORDS).removesuffix(" ×").removesuffix(", cut-off")
        axes.plot("cost", f"mismatch {group}", data=rows, ms=size, lw=1.0, **look)
    for error in frame[kinds == "fast: default"][f"error {group}"].dropna():
        axes.axhspan(0.0, error, color="grey", alpha=0.25, linewidth=0.0, label="standard errors alone")
    axes.axhline(1.0, color="black", lw=0.8, ls=":")
    if frame[f"mismatch {group}"].gt(0.0).any():
        axes.set(xscale="log", yscale="log")
    else:
        axes.set_xticks([])
    axes.set(xlabel="CPU time / simulated time", ylabel=MISMATCH)


def _draw_scenes(axes: Axes, values: xr.DataArray, label: str) -> None:
    """A row of points, one for each scene, for each method and setting that has a value."""
    rows = values.where(values > 0.0).to_series().dropna().rename("value").reset_index()
    rows["row"], names = pd.factorize(rows["method"] + ": " + rows["setting"])
    looks = (figures.BLACK, "o"), (figures.ORANGE, "^")
    for (group, of_paper), (color, marker) in zip(GROUPS.items(), looks, strict=True):
        part = rows[rows["scene"].isin(list(PAPERS)) == of_paper]
        look: dict[str, Any] = {"color": color, "marker": marker, "label": f"(c), (d): {group}"}
        axes.plot("value", "row", data=part, ms=4, mfc="none", linestyle="none", **look)
    axes.set(xscale="log", xlabel=label, ylim=(len(names) - 0.4, -0.6))
    axes.tick_params(axis="y", labelsize="small")
    figures.name_rows(axes, [figures.reworded(name, WORDS) for name in names])
