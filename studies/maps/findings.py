"""A map in words: its quantity, its fixed values, and the range of what was computed."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies.maps.quantities import AXES, QUANTITIES, RIG
from studies.motion import transients
from studies.plotting import planes
from studies.scatter import instability
from studies.study import constants
from studies.tables import Part
from sweeps import INTERPOLATED_FLAG, STATUS_FLAGS, refinement_report

# Units and factors for a reader.
UNITS = {"m s-1": ("mm/s", 1e3), "s": ("ms", 1e3), "s-1": ("1/s", 1.0), "1": ("", 1.0)}


def findings(dataset: xr.Dataset) -> list[Part]:
    """Name the quantity and the number of computed points, and summarise the values."""
    quantity = constants(dataset)["quantity"]
    values, status = dataset[quantity], dataset["status"].values
    about = held(dataset)
    lines: list[Part] = [f"{quantity}: {values.attrs['long_name']}{'; ' if about else ''}{', '.join(about)}"]
    for name in map(str, values.dims):
        ends = planes.shown(name, dataset[name].values[[0, -1]])
        lines.append(f"over {planes.label(name)} from {ends[0]:g} to {ends[1]:g} ({dataset.sizes[name]})")
    counts = [
        f"{count} {word} ({100.0 * count / status.size:.3g} %)"
        for code, word in (STATUS_FLAGS | INTERPOLATED_FLAG).items()
        if (count := int(np.count_nonzero(status == code)))
    ]
    lines += ["", f"{status.size} points: {', '.join(counts)}."]
    return [
        *lines,
        *refinement_report(dataset),
        *_values_text(quantity, values.values[np.isfinite(values.values)]),
        *_scattered(constants(dataset)),
    ]


def _scattered(fixed: dict[str, Any]) -> list[Part]:
    """How the numbers of the rigs scatter, where they do, and how well a share of so many is known."""
    if "scatter" not in fixed:
        return []
    low, high = instability.wilson(0.5, fixed["samples"])
    return [
        f"Each point is a share of {fixed['samples']} rigs, seed {fixed['seed']}: one half means {low:.3f} to "
        f"{high:.3f} (Wilson 95 %).",
        "",
        instability.table(fixed["scatter"]),
    ]


def _values_text(quantity: str, values: NDArray[Any]) -> list[str]:
    """The range of a number, or the share of each class."""
    if not len(values):
        return ["No point has a value."]
    if not QUANTITIES[quantity].is_whole:
        label, factor = readable(quantity)
        lines = [f"{label} from {factor * values.min():.4g} to {factor * values.max():.4g}."]
        if quantity == "growth_rate":
            lines.append(f"Unstable at {100.0 * np.mean(values > 0.0):.3g} % of the points.")
        return lines
    kinds, counts = np.unique(values.astype(int), return_counts=True)
    words = transients.REGIMES if quantity == "regime" else None
    shares = [
        f"{words[kind] if words else kind} {100.0 * count / len(values):.3g} %"
        for kind, count in zip(kinds.tolist(), counts, strict=True)
    ]
    return [f"{quantity.replace('_', ' ')} at points with a value: {', '.join(shares)}."]


def held(dataset: xr.Dataset) -> list[str]:
    """Texts of the values that all points share and that matter; of the rig those unlike the paper's."""
    fixed = constants(dataset)
    # What scatters has no value.
    fixed = {name: value for name, value in fixed.items() if name not in fixed.get("scatter", ())}
    matter, settings = QUANTITIES[fixed["quantity"]].matter, QUANTITIES[fixed["quantity"]].settings
    rig = [name for name in RIG if fixed.get(name, AXES[name].value) != AXES[name].value]
    sign = ["V < 0"] if "V" not in matter and fixed.get("V", 1.0) < 0.0 else []
    runs = [f"{fixed['members']} run{'s' if fixed['members'] > 1 else ''} a point"] if "members" in fixed else []
    scene, others = ([planes.named(n, fixed[n]) for n in names if n in fixed] for names in (matter, rig))
    damped = [transients.damping(fixed)] if "numerical_damping" in settings else []
    rigs = [f"{fixed['samples']} rigs, {len(fixed['scatter'])} numbers scatter"] if "scatter" in fixed else []
    return [*scene, *sign, *others, *runs, *damped, *rigs]


def readable(quantity: str) -> tuple[str, float]:
    """Name and unit of a quantity as they stand at a scale, and the factor to that unit."""
    units = QUANTITIES[quantity].variable.units
    unit, factor = UNITS.get(units, (units, 1.0))
    name = quantity.replace("_", " ")
    return (f"{name} / ({unit})" if "/" in unit else f"{name} / {unit}" if unit else name), factor
