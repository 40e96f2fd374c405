"""Sensitivity of the flutter onsets of three pairs of modes to each parameter of the rig."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import Structure, checks
from studies import paper
from studies.answering.claims import rig_text
from studies.answering.results import structure_in
from studies.declaring import labels
from studies.declaring.parameters import RIG, Parameter
from studies.declaring.spec import evenly
from studies.physics.onsets import PAIRS, SENSITIVITIES, VARIED, sensitivities
from studies.plotting import figures, planes
from studies.study import Study
from sweeps import Axis

# Parameters that the summary names; largest sensitivity of one that hardly matters; looks over theta.
MATTER, SLIGHT = 3, 0.1
# Bars of a pair; a structure may have many modes.
MOST_BARS = 24
COLOURS, MARKERS = (figures.BLUE, figures.RED, figures.GREEN, figures.ORANGE, figures.GREY), "os^Dv"


def of_structure(own: Structure) -> dict[str, Parameter]:
    """The parameters of a structure: frequency and damping of each mode, and the direction of its contact."""
    kinds = ("frequency", "damping") if own.damping.any() else ("frequency",)
    names = [f"{kind}_{k}" for kind in kinds for k, hertz in enumerate(own.frequency, 1) if hertz]
    text = "parameter that is changed, the others kept; a direction by radians"
    return {"parameter": Parameter([*names, "direction"], "1", text)}


def check(pairs_theta: float, mu_max: float) -> None:
    """Refuse an inclination without unstable pairs."""
    checks.between("pairs_theta", pairs_theta, 1e-6, 89.999, "degrees")
    checks.friction(mu_max)


def ranked(dataset: xr.Dataset) -> xr.Dataset:
    """The inclination at which pairs are numbered, and the parameters by their largest sensitivity of mu."""
    at = dataset.sel(theta=float(dataset["pairs_theta"]), method="nearest").load()
    ends = zip(*(at[name].max("parameter").values for name in ("onset_mu", "onset_frequency")), strict=True)
    text = ["no onset" if np.isnan(mu) else f"{hertz:.0f} Hz, μ = {mu:.4f}" for mu, hertz in ends]
    largest = abs(at["elasticity_mu"]).max("pair").fillna(0.0)
    return at.assign_coords(text=("pair", text)).isel(parameter=np.argsort(-largest.values, kind="stable"))


def text_of(name: str) -> str:
    """The name of a parameter in a table: length of P1, contact position, θ."""
    return RIG[name].text if name[:3] in ("p1_", "p2_") else labels.title(name)


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Parameters that matter most and those that hardly matter; sensitivities and changes of each pair."""
    at = ranked(dataset)
    where = "" if structure_in(dataset) else f" at {labels.named('theta', at['theta'])}"
    size = abs(at["elasticity_mu"])
    at = at.isel(pair=np.flatnonzero(size.notnull().any("parameter")))
    if not at.sizes["pair"]:
        yield f"No onset has derivatives{where}."
        return
    names, most = [text_of(name) for name in at["parameter"].values], size.max("pair").fillna(0.0).values
    ranges = zip(names, size.min("pair").values, most, strict=True)
    spans = [(name, " to ".join(dict.fromkeys((f"{low:.3g}", f"{high:.3g}")))) for name, low, high in ranges]
    matter = ", ".join([f"{name} ({span} %)" for name, span in spans][:MATTER])
    slight = ", ".join(name for name, high in zip(names, most, strict=True) if high < SLIGHT) or "no parameter"
    yield (
        f"The onsets' mu{where} changes most with {matter}, for a change of 1 %; it changes by less than"
        f" {SLIGHT:g} % with {slight}."
    )
    for pair in at["pair"].values:
        one = at.sel(pair=pair)
        columns = {"mu": one["elasticity_mu"], "mu, solved again": 100.0 * one["change_mu"] / one["onset_mu"]}
        table = pd.DataFrame({"parameter": names} | columns | {"frequency": one["elasticity_frequency"]}).round(4)
        yield f"{one['text'].item()}{where}: change in % for 1 % more of", table


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Sensitivities of each pair in order of size, beside the onsets solved again, and the largest over theta."""
    at = ranked(dataset)
    strongest = [name for name in at["parameter"].values.tolist() if name != "theta"]
    looks = dict(zip(strongest, zip(COLOURS, MARKERS, strict=True), strict=False))
    looks |= {name: (figures.BLACK, ".") for name in at["parameter"].values if name == "theta"}
    at = at.isel(parameter=slice(MOST_BARS))
    count = int(dataset["elasticity_mu"].notnull().any(["theta", "parameter"]).sum())
    pairs, row = dataset["pair"].values[: max(count, 1)], 0.36 if figures.is_wide() else 0.46
    height = 2.6 + max(row * at.sizes["parameter"], 3.2)
    # A structure has one inclination.
    alone, rows = bool(structure_in(dataset)), [[f"over {pair}" for pair in pairs]]
    rows = [] if alone else rows if figures.is_wide() else [[name] * len(pairs) for name in rows[0]]
    heights = height, *[6.0 if figures.is_wide() else 4.5] * len(rows)
    figure, panels = figures.mosaic([[f"bars {pair}" for pair in pairs], *rows], *heights, stack=False)
    for k, pair in enumerate(pairs):
        _draw_bars(panels[f"bars {pair}"], at.sel(pair=pair), looks, named=not k)
        panels[f"bars {pair}"].set_xlabel("change of μ / %")
    panels = {pair: panels[f"over {pair}"] for pair in pairs if rows}
    for pair, over in panels.items():
        over.axvline(float(at["theta"]), color=figures.GREY, linewidth=0.8, linestyle=":")
        for name, (colour, marker) in looks.items():
            curve = dataset["elasticity_mu"].sel(pair=pair, parameter=name)
            look: dict[str, Any] = {"markersize": 3.5, "markevery": 6 if len(curve) > 18 else 1}
            over.plot(curve["theta"], curve, color=colour, marker=marker, label=f"by {text_of(name)}", **look)
        wide = bool(abs(dataset["elasticity_mu"].sel(pair=pair)).max() > 5.0)
        over.set_yscale("symlog" if wide else "linear")
        over.yaxis.set_major_formatter("{x:g}")
        planes.set_side(over, "x", dataset["theta"])
        over.set_title(at.sel(pair=pair)["text"].item().partition(",")[0], loc="left")
        over.set_ylabel("change of μ / %" if pair == pairs[0] or not figures.is_wide() else "")
    where = "" if alone else f"; bars at {labels.named('theta', at['theta'])}"
    figure.supxlabel(f"change of the μ of each flutter onset by 1 % more of a parameter{where}")
    figures.legend_below(figure, figure.axes[::-1], 3)
    figure.suptitle(f"Parameters that move the flutter onsets{rig_text(dataset)}")
    return figure


def _draw_bars(axes: figures.Axes, one: xr.Dataset, looks: dict[str, tuple[str, str]], named: bool) -> None:
    """Sensitivities, the first at the top; circles where the onset is when the parameter is 1 % larger."""
    one = one.isel(parameter=slice(None, None, -1))
    values, names = one["elasticity_mu"].fillna(0.0).values, one["parameter"].values.tolist()
    rows = range(len(names))
    axes.set_title(one["text"].item(), loc="left")
    axes.set_yticks(rows, [text_of(name) if named else "" for name in names])
    axes.barh(rows, values, 0.7, color=[looks.get(name, ("#c8c8c8",))[0] for name in names])
    for row, value in enumerate(values if figures.is_wide() else ()):
        text = f"  {value:+.2f}  ".replace("-", "−")
        axes.text(0.0, row, text, ha="right" if value >= 0.0 else "left", va="center", fontsize="small")
    look: dict[str, Any] = {"linestyle": "", "markersize": 4.0, "markerfacecolor": "white", "color": figures.BLACK}
    axes.plot(100.0 * one["change_mu"] / one["onset_mu"], rows, "o", label="solved again with 1 % more", **look)
    axes.locator_params(axis="x", nbins=5)
    axes.use_sticky_edges = False
    axes.margins(x=0.4, y=0.02)


STUDY = Study(
    name="sensitivity",
    title="Sensitivity of the flutter onsets to the parameters of the rig",
    question="Which parameters of the rig move the friction and the frequency of each flutter onset, and how far?",
    paper="Section 3.4.2: at 5 degrees pairs of modes are first unstable at mu = 0.12 (2800 Hz), 0.16 (400 Hz) "
    "and 0.23 (7700 Hz). Section 3.6: the geometry of the contact matters; only theta is varied.",
    parameters={
        "theta": Parameter(evenly(0.5, 20.0, 40), "degree", "inclination of P1"),
        "parameter": Parameter(VARIED, "1", "parameter that is changed, the others kept; theta in degrees"),
        "pairs_theta": Parameter(paper.THETA, "degree", "where onset_mu numbers the pairs", common=True),
        "mu_max": Parameter(1.0, "1", "largest friction of interest", common=True),
    },
    outputs=SENSITIVITIES, function=sensitivities,
    coords={"pair": Axis(np.arange(1, PAIRS + 1), "1", "pair, ascending in onset_mu at pairs_theta")},
    check=check, summary=summarise, figure=draw, for_structure=of_structure,
)  # fmt: skip
