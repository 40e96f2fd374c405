"""Probability that steady sliding is unstable in an uncertain rig, and the parameters that dominate it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import checks
from studies import paper
from studies.answering.claims import is_papers_rig, rig_text
from studies.answering.results import configuration, settings
from studies.declaring import labels
from studies.declaring.parameters import RIG, Parameter
from studies.declaring.spec import evenly
from studies.motion import uncertainty
from studies.motion.run import BAND
from studies.motion.uncertainty import MOST_SAMPLES, MU_MAX, USUAL
from studies.physics.probability import OUTPUTS, probabilities, with_draws
from studies.plotting import figures, planes
from studies.study import Study
from sweeps import DONE, Axis, InputError

# Fractions of rigs in the table, contours in the figure, parameters in both; total index of a dominant parameter.
RISKS = (0.01, 0.05, 0.5, 0.95, 0.99)
CONTOURS: dict[float, Any] = {0.05: (0, (1.3, 1.3)), 0.5: "-", 0.95: (0, (6, 1.5))}
LISTED, DOMINANT = 6, 0.05


def check(mu: Any, samples: int, sobol_samples: int, seed: int, **others: Any) -> None:
    """Refuse numbers out of range, and distributions of a parameter that is an axis."""
    checks.friction(float(np.min(mu)))
    uncertainty.check(samples, seed, **others)
    checks.number("sobol_samples", sobol_samples, "a power of 2", lambda n: n in [1 << k for k in range(15)])
    for name in others.get("distributions", ()):
        if name not in USUAL:
            raise InputError(
                f"{name}: it is an axis of study robust, without a distribution; leave it out, or draw a map"
            )


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Add Wilson's interval of the probability, and the draws as coordinates."""
    texts = configuration(dataset)["constants"].get("distributions") or uncertainty.usual(settings(dataset))
    return with_draws(dataset, texts, settings(dataset)["seed"])


def ranked(dataset: xr.Dataset) -> xr.Dataset:
    """The computed inclination nearest to the paper's, and the parameters by their total Sobol indices."""
    at = dataset.isel(theta=dataset["status"].values == DONE).sel(theta=paper.THETA, method="nearest").load()
    at = at.sel(parameter=[name for name in at["parameter"].values if at[name].ndim])
    at = at.isel(parameter=np.argsort(-at["sobol_total"].values, kind="stable"))
    return at.assign_coords(text=("parameter", [RIG[name].text for name in at["parameter"].values]))


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Friction by the fraction of rigs that are unstable, dominant parameters, distributions."""
    if not (dataset["status"] == DONE).any():
        return
    at, count = ranked(dataset), dataset.sizes["sample"]
    where, nominal = f"at {labels.named('theta', at['theta'])}", float(at["nominal_onset_mu"])
    onset = at["onset_mu"].fillna(np.inf).values
    start = f"from mu = {nominal:.4f} on, at {float(at['nominal_onset_frequency']):.0f} Hz"
    names = at["text"].values[at["sobol_total"].values >= DOMINANT]
    below, never = 100.0 * np.mean(onset <= nominal), 100.0 * np.mean(np.isinf(onset))
    nominally = f"flutters {start}" if np.isfinite(nominal) else "does not flutter"
    told = f"The nominal rig {nominally} {where}, in modes below {BAND / 1e3:g} kHz."
    if np.isfinite(nominal):
        told += f" {below:.0f} % of {count} uncertain rigs begin to flutter at a lower mu."
    all_or_none = {0.0: "All of them flutter", 100.0: "None of them flutters"}
    told += f" {all_or_none.get(never, f'{never:.3g} % do not flutter')} for mu up to {MU_MAX:g}."
    yield f"{told} Dominant parameters: {', '.join(names) or 'none'}."
    ends = np.array([RISKS, *uncertainty.wilson(RISKS, count)])
    rows = np.vstack([100.0 * ends[0], np.quantile(onset, ends, method="inverted_cdf")]).T
    table = pd.DataFrame(rows, columns=["unstable rigs %", "from mu", "95 % interval: from", "to"])
    yield f"Lowest onset of the rigs {where}", table.replace(np.inf, np.nan)
    table = labels.frame(at.isel(parameter=slice(LISTED)), ["text", *list(OUTPUTS)[-4:]])
    yield f"Sobol indices of the lowest onset {where}", table.rename(columns={"text": "parameter"})
    yield "Uncertain parameters", uncertainty.table({name: at[name].distribution for name in at.parameter.values})


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Probability over inclination and friction; the Sobol indices at the inclination nearest to the paper's."""
    at, whole = ranked(dataset), min(dataset.sizes["theta"], dataset.sizes["mu"]) > 1
    layout = [["plane", "plane"]] * whole + [["along", "rigs"], ["bars", "bars"]]
    figure, panels = figures.mosaic(layout, *[7.0, 5.0, 5.0][-len(layout) :])
    if whole:
        _draw_plane(panels["plane"], dataset)
    axes, mu, middle = panels["along"], at["mu"].values, at["probability_unstable"].values
    axes.fill_between(mu, at["probability_low"], at["probability_high"], color="#b3d4e8", label="Wilson 95 %")
    axes.plot(mu, middle, color=figures.BLUE, marker=".", label="fraction of rigs")
    axes.axvline(float(at["nominal_onset_mu"]), color=figures.RED, linestyle="--", label="nominal onset")
    steps = np.flatnonzero(np.diff(middle))
    if len(steps):
        axes.set_xlim(mu[max(steps[0] - 4, 0)], mu[min(steps[-1] + 5, len(mu) - 1)])
    axes.set(xlabel="μ", ylabel=labels.label(at["probability_unstable"], long=True), ylim=(-0.03, 1.03))
    # Rigs by their dominant parameters; a few outliers do not flatten the scale.
    x, y = (at[name] for name in [*at["parameter"].values[:2].tolist(), "onset_mu"][:2])
    low, high = at["onset_mu"].fillna(MU_MAX).quantile([0.01, 0.99]).values
    look: dict[str, Any] = {"cmap": "cividis", "vmin": low, "vmax": high, "linewidths": 0.0}
    dots = panels["rigs"].scatter(labels.readable(x), labels.readable(y), 7.0, at["onset_mu"], **look)
    figure.colorbar(dots, ax=panels["rigs"]).set_label("lowest onset μ")
    across, up = (labels.label(array, long=True) for array in (x, y))
    panels["rigs"].set(xlabel=across, ylabel=up)
    bars, axes = at.isel(parameter=slice(LISTED)), panels["bars"]
    rows = np.arange(bars.sizes["parameter"])
    for shift, kind, colour in ((-0.19, "first", figures.GREY), (0.19, "total", figures.BLUE)):
        look = {"color": colour, "label": f"{kind} Sobol index", "xerr": bars[f"sobol_{kind}_se"]}
        axes.barh(rows + shift, bars[f"sobol_{kind}"], 0.36, **look)
    axes.set_yticks(rows, bars["text"].values)
    axes.set(xlabel="fraction of the variance of the lowest onset", xlim=(0.0, None), ylim=(len(rows) - 0.5, -0.5))
    titles = ["probability of instability"] * whole + ["along μ", "lowest onsets", "dominant parameters"]
    figures.entitle(panels.values(), titles)
    figures.legend_below(figure, list(panels.values()))
    where = labels.named("theta", at["theta"]) + rig_text(dataset)
    figure.suptitle(f"Steady sliding of {at.sizes['sample']} uncertain rigs, onsets at {where}")
    return figure


def _draw_plane(axes: figures.Axes, dataset: xr.Dataset) -> None:
    """Probability as lightness, its contours, and the boundary of instability of the nominal rig."""
    share = dataset["probability_unstable"].transpose("mu", "theta")
    planes.numbers(axes, share, "theta", "mu", labels.label(share, long=True), vmin=0.0, vmax=1.0)
    for level, style in CONTOURS.items():
        if (share > level).any() and (share < level).any():
            look: dict[str, Any] = {"levels": [level], "linestyles": [style], "linewidths": 1.3}
            # Seen on light and dark.
            axes.contour(share["theta"], share["mu"], share, levels=[level], colors="white", linewidths=2.8)
            axes.contour(share["theta"], share["mu"], share, colors="black", **look)
            axes.plot([], [], color=figures.BLACK, linestyle=style, label=f"probability {level:g}")
    axes.plot(share["theta"], dataset["nominal_onset_mu"], color=figures.RED, label="nominal rig", scaley=False)
    if is_papers_rig(dataset):
        planes.marks(axes, [(paper.THETA, mu) for mu, _ in paper.ONSETS], **planes.PAPER["first unstable μ"])


STUDY = Study(
    name="robust",
    title="Uncertainty of the flutter onset: probability of instability and dominant parameters",
    question="How likely is a rig like this to squeal, and which of its parameters must be known better?",
    paper="The paper computes one rig, and what it measured differs from that; uncertainty is not in it.",
    parameters={
        "theta": Parameter(evenly(0.0, 20.0, 41), "degree", "inclination of P1"),
        "mu": Parameter(evenly(0.0, 0.5, 101), "1", "coefficient of friction", inner=True),
        "samples": Parameter(1024, "1", "number of uncertain rigs", common=True),
        "sobol_samples": Parameter(512, "1", "base of the Sobol indices, a power of 2", common=True),
        "seed": Parameter(0, "1", "seed of the random numbers", common=True),
    },
    outputs=OUTPUTS, function=probabilities,
    coords=lambda samples: {
        "sample": Axis(np.arange(checks.count("samples", samples, MOST_SAMPLES)), "1", "number of the draw"),
        "parameter": Axis(list(USUAL), long_name="uncertain parameter"),
    },
    check=check, derive=derive, summary=summarise, figure=draw, beams=True,
)  # fmt: skip
