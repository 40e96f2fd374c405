"""How likely steady sliding is unstable where the rig's numbers scatter, and which of them decide.

One sample of rigs serves all inclinations and frictions, so that neighbouring probabilities differ by what the
inclination or the friction does, and not by chance.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fivcore import Rig, checks
from studies.rig import rig_of, rig_settings
from studies.scatter import instability
from studies.spec import evenly
from studies.study import Setting, Study, deferred
from sweeps import Axis, Grid, InputError, Sweep, Variable

Array = NDArray[Any]

SETTINGS = {
    "samples": Setting(1024.0, "1", "number of scattered rigs"),
    "sobol_samples": Setting(512.0, "1", "base of the Sobol indices, a power of 2"),
    "seed": Setting(0.0, "1", "of the random numbers"),
}
MOST_BASE = 1 << 14
SHARE = {"units": "1"}
VARIABLES = {
    "probability_unstable": Variable("1", "share of scattered rigs whose steady sliding is unstable", ("mu",)),
    "nominal_unstable": Variable(
        "1", "whether the nominal rig's is", ("mu",), "int8", flags={0: "stable", 1: "unstable"}
    ),
    "nominal_onset_mu": Variable("1", "lowest friction from which a pair of the nominal rig grows"),
    "nominal_onset_frequency": Variable("Hz", "frequency there"),
    "onset_mu": Variable("1", "lowest friction from which a pair of a scattered rig grows", ("sample",), digits=6),
    "onset_frequency": Variable("Hz", "frequency there", ("sample",), digits=6),
    "sobol_first": Variable("1", "first Sobol index of the lowest onset", ("parameter",)),
    "sobol_total": Variable("1", "total Sobol index of the lowest onset", ("parameter",)),
    "sobol_first_se": Variable("1", "standard error of the first Sobol index", ("parameter",)),
    "sobol_total_se": Variable("1", "standard error of the total Sobol index", ("parameter",)),
}
# Where a rig has no onset up to it, this friction stands in for the Sobol indices.
MU_MAX = instability.MU_MAX


def probabilities(
    points: Mapping[str, Any],
    *,
    rig: Rig,
    scatter: Mapping[str, str],
    samples: int,
    sobol_samples: int,
    seed: int,
    mu: Any,
) -> dict[str, Any]:
    """The variables at each inclination."""
    draws, parsed = instability.sample(scatter, samples, seed), instability.scatters(scatter)
    friction = np.asarray(mu)
    rows: list[tuple[Any, ...]] = []
    for theta in points["theta"]:

        def lowest(values: Mapping[str, Array], theta: float = theta) -> Array:
            return instability.lowest(instability.onsets(rig, {"theta": theta, **values}), MU_MAX)[0]

        nominal, table = (instability.onsets(rig, {"theta": theta, **values}) for values in ({}, draws))
        onset, frequency = instability.lowest(table, np.nan)
        rows.append(
            (
                table.unstable(friction).mean(axis=0),
                nominal.unstable(friction)[0],
                *(float(each[0]) for each in instability.lowest(nominal, np.nan)),
                onset,
                frequency,
                *instability.sobol_indices(lowest, parsed, sobol_samples, seed),
            )
        )
    return dict(zip(VARIABLES, map(np.array, zip(*rows, strict=True)), strict=True))


def with_draws(dataset: xr.Dataset, *, scatter: Mapping[str, str], samples: int, seed: int) -> xr.Dataset:
    """Add Wilson's interval of the probability, and the draws with the share of each that was cut away."""
    low, high = instability.wilson(dataset["probability_unstable"].values, samples)
    place = dataset["probability_unstable"].dims
    name = "Wilson's 95 % interval of probability_unstable"
    dataset = dataset.assign(
        probability_low=(place, low, SHARE | {"long_name": f"lower end of {name}"}),
        probability_high=(place, high, SHARE | {"long_name": f"upper end of {name}"}),
    )
    settings, parsed = rig_settings(), instability.scatters(scatter)
    return dataset.assign_coords(
        {
            each: (
                "sample",
                values,
                {
                    "units": settings[each].units,
                    "long_name": settings[each].long_name,
                    "distribution": scatter[each],
                    "share_cut_away": parsed[each].cut,
                },
            )
            for each, values in instability.sample(scatter, samples, seed).items()
        }
    )


def build(axes: Mapping[str, Axis], settings: Mapping[str, Any]) -> Sweep:
    """The sweep over theta: every friction and every draw belongs to one computation."""
    rig, _ = rig_of({**settings, "theta": 0.0})
    scatter = dict(settings.get("scatter") or instability.usual(settings))
    scatter = {name: each.text for name, each in instability.scatters(scatter).items()}
    for name in scatter:
        if name in axes:
            raise InputError(f"--scatter {name}: study robust has it as an axis; leave it out, or use fiv map")
    base = checks.count("sobol_samples", settings["sobol_samples"], MOST_BASE)
    if base & (base - 1):
        raise InputError(f"sobol_samples = {base}: it must be a power of 2, like {1 << base.bit_length()}")
    for name, check in (("theta", checks.theta_degrees), ("mu", checks.friction)):
        for value in axes[name].values[[0, -1]]:
            check(float(value))
    counted = instability.counted(settings)
    fixed: dict[str, Any] = {"scatter": scatter, **counted}
    return Sweep(
        "robust",
        probabilities,
        Grid({"theta": axes["theta"]}),
        VARIABLES,
        {"rig": rig, "sobol_samples": base, "mu": axes["mu"].values.tolist()} | fixed,
        coords={
            "mu": axes["mu"],
            "sample": Axis(np.arange(counted["samples"]), long_name="number of the draw"),
            "parameter": Axis(list(scatter), long_name="number that scatters"),
        },
        code=("fivcore",),
        title=STUDY.title,
        derive=partial(with_draws, **fixed),
        # So that progress shows.
        batch_multiple=1,
    )


STUDY = Study(
    name="robust",
    title="Probability that steady sliding is unstable where the rig's numbers scatter",
    question="How likely is a rig like this to squeal, and which of its numbers must be known better?",
    paper="The paper computes one rig, and what it measured differs from that. Scatter is not in it.",
    axes={
        "theta": Axis(evenly(0.0, 20.0, 41), "degree", "inclination of P1"),
        "mu": Axis(evenly(0.0, 0.5, 101), "1", "coefficient of friction"),
    },
    settings={
        **{name: each for name, each in rig_settings().items() if name != "theta"},
        **SETTINGS,
    },
    build=build,
    scatters=True,
    request={"axes": ["mu"]},
    draw=deferred("studies.gallery.robust.figure:draw"),
    findings=deferred("studies.gallery.robust.findings:findings"),
)
