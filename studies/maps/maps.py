"""Maps: one quantity over any two axes, on every point or refined where it changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fivcore import Scene, checks
from studies import runner, spec
from studies.gallery.regimes import study as regimes
from studies.maps import quantities
from studies.maps.figure import draw, held, readable
from studies.maps.quantities import AXES, OVER_MU, QUANTITIES, RUN, Quantity
from studies.motion import ensembles, transients
from studies.motion.jobs import BATCH_MULTIPLE, check_jobs
from studies.plotting import planes
from studies.rig import rig_of
from studies.study import Study, constants, suggest
from studies.tables import Part
from sweeps import (
    INTERPOLATED_FLAG,
    STATUS_FLAGS,
    Axis,
    Grid,
    Plan,
    Progress,
    Refinement,
    Sweep,
    open_results,
    refined,
)

NAME = "map"
# Largest error of interpolation of a refined map, in units of the range of its values.
TOLERANCE = 0.02
MOST_POINTS = 4_000_000
# Of a file's name; file systems allow 255 bytes, and other endings take its place.
MOST_LETTERS = 200


@dataclass(frozen=True, eq=False)
class Plane:
    """Two axes with the values that they take: `x` is drawn across."""

    x: str
    y: str
    xs: NDArray[Any]
    ys: NDArray[Any]


def sweep_of(
    plane: Plane, quantity: str, fixed: Mapping[str, float], halvings: int = 0, tolerance: float | None = None
) -> Sweep:
    """The sweep of a map.

    Parameters
    ----------
    plane : Plane
        The values of a refined map are those of its finest lattice (`studies.spec.refined`).
    quantity : str
        One of `studies.maps.quantities.QUANTITIES`.
    fixed : mapping of str to float
        Other axes' values, and settings of the runs where the quantity needs them; what is not named has the
        paper's value.
    halvings : int
        How often the intervals of the coarse lattice are halved where the quantity changes; 0: every point is
        computed.
    tolerance : float, optional
        Largest error expected of interpolation between computed points, in units of the range of the values;
        default TOLERANCE. Not for classes and counts.

    Raises
    ------
    ValueError
        Naming the argument; nothing is planned then.
    """
    known = _known(quantity)
    given = _settings(plane, quantity, fixed)
    limit = _tolerance(quantity, known, halvings, tolerance)
    count = len(plane.xs) * len(plane.ys)
    if count > MOST_POINTS:
        raise ValueError(
            f"{len(plane.xs)} x {len(plane.ys)} values are {count} points: it must be at most {MOST_POINTS}"
        )
    _check(plane, known, given)
    if "members" in given:
        given |= {"members": int(given["members"]), "method": transients.METHOD}
    axes = {
        name: Axis(values, AXES[name].units, AXES[name].long_name)
        for name, values in ((plane.x, plane.xs), (plane.y, plane.ys))
    }
    scaled = bool(known.variable.scale) and "F" in axes
    variable = known.variable if scaled else replace(known.variable, scale="")
    sweep = Sweep(
        NAME,
        known.find,
        Grid(axes),
        {quantity: variable},
        {"quantity": quantity} | given,
        key=known.alike,
        scale=quantities.load if scaled else None,
        # Bases are made anew for each of their values.
        order_by=tuple(name for name in axes if name not in ("V", "mu", "F")),
        title=f"{known.variable.long_name[0].upper()}{known.variable.long_name[1:]}, over {plane.x} and {plane.y}",
        batch_multiple=BATCH_MULTIPLE if known.find is quantities.motion else 1,
    )
    return refined(sweep, Refinement(quantity, halvings, limit, known.thresholds))


def plane_of(x: str, y: str, halvings: int = 0) -> Plane:
    """The plane of two texts AXIS=SPEC, each interval halved so often."""
    across, up = spec.split(x, "--x"), spec.split(y, "--y")
    xs, ys = (spec.refined(text, name, halvings) for name, text in (across, up))
    return Plane(across[0], up[0], xs, ys)


def fixed_of(texts: Sequence[str]) -> dict[str, float]:
    """What texts AXIS=VALUE fix.

    Raises
    ------
    ValueError
        If one is not of the form, gives more than one number, or names what another has.
    """
    fixed: dict[str, float] = {}
    for text in texts:
        name, written = spec.split(text, "--fix")
        values = spec.parse(written, name)
        if len(values) > 1 or name in fixed:
            raise ValueError(f"--fix {text!r}: {name} must have one value; what is to vary is --x or --y")
        fixed[name] = float(values[0])
    return fixed


def execute(
    plan: Plan,
    backend: tuple[str, int | None],
    progress: Progress | None = None,
    fail_fast: bool = False,
) -> runner.Finished:
    """Run a map's plan, then draw what its file holds.

    Parameters
    ----------
    plan : Plan
    backend : tuple
        Scheduler and workers.
    progress : callable, optional
        As for `Plan.run`.
    fail_fast : bool
        Stop at the first point that fails.
    """
    assert plan.store is not None
    dataset = plan.run(*backend, progress, fail_fast=fail_fast)
    whole = dataset if plan.points == plan.manifest.grid.size else open_results(plan.store)
    return runner.Finished(STUDY, dataset, plan.store, runner.plot(STUDY, whole, plan.store))


def file_of(
    plane: Plane, quantity: str, out: str | Path | None = None, fixed: Mapping[str, float] | None = None
) -> Path:
    """Where a map is kept: its name tells what is fixed at other values than the paper's.

    So maps that differ in what they fix are kept beside each other, whatever the order it was given in.
    """
    other = (f"{key}={spec.typed(value)}" for key, value in changed(quantity, fixed or {}).items())
    name = "-".join([quantity, plane.x, plane.y, *other])
    if len(name) > MOST_LETTERS:
        name = f"{quantity}-{plane.x}-{plane.y}-{sha256(name.encode()).hexdigest()[:16]}"
    return runner.results_folder(out) / NAME / f"{name}.nc"


def defaults(quantity: str) -> dict[str, float]:
    """What can be fixed in a map of this quantity, by name, with the values that they have otherwise."""
    return {name: each.value for name, each in (AXES | dict(_known(quantity).settings)).items()}


def changed(quantity: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """What of the given values can be fixed in a map of this quantity, and is not the default."""
    return {name: given[name] for name, own in defaults(quantity).items() if given.get(name, own) != own}


def _known(quantity: str) -> Quantity:
    if quantity not in QUANTITIES:
        raise ValueError(
            f"quantity = {quantity!r}: there is no such quantity; {suggest(quantity, list(QUANTITIES))}"
            f"the quantities are {', '.join(QUANTITIES)}"
        )
    return QUANTITIES[quantity]


def _settings(plane: Plane, quantity: str, fixed: Mapping[str, float]) -> dict[str, Any]:
    """What is the same at all points."""
    for side, name in (("x", plane.x), ("y", plane.y)):
        if name not in AXES:
            near = suggest(name, list(AXES))
            raise ValueError(f"--{side} {name}: there is no such axis; {near}the axes are {', '.join(AXES)}")
        if name == "mu" and quantity in OVER_MU:
            raise ValueError(f"--{side} mu: {quantity} is found over all mu, which cannot be an axis then")
    if plane.x == plane.y:
        raise ValueError(f"--y {plane.y}: it is the axis --x already; a map has two")
    given = defaults(quantity)
    for name, value in fixed.items():
        if name in (plane.x, plane.y):
            raise ValueError(f"--fix {name}: it is an axis of this map; leave it out")
        if name not in given:
            why = f"{quantity} does not depend on it" if name in RUN else "there is no such axis or setting"
            near = suggest(name, list(given))
            raise ValueError(f"--fix {name}: {why}; {near}what can be fixed is {', '.join(given)}")
        given[name] = value
    return {name: value for name, value in given.items() if name not in (plane.x, plane.y)}


def _tolerance(quantity: str, known: Quantity, halvings: int, tolerance: float | None) -> float | None:
    if tolerance is None:
        return None if known.whole else TOLERANCE
    if known.whole:
        raise ValueError(
            f"tolerance = {tolerance:g}: {quantity} has whole numbers, between which nothing is interpolated; "
            "leave it out"
        )
    if halvings == 0:
        raise ValueError(f"tolerance = {tolerance:g}: it is for a refined map; say --refine N as well")
    return checks.between("tolerance", tolerance, 1e-12, 1e12, "of the range of the values")


def _check(plane: Plane, known: Quantity, given: Mapping[str, Any]) -> None:
    """Find out, before anything is planned, what cannot be computed.

    A scene whose contact has no unique solution is not refused: its point fails by itself.
    """
    x, y = plane.xs[0], plane.ys[0]
    for point in [(each, y) for each in plane.xs] + [(x, each) for each in plane.ys]:
        _scene(plane, given, *point)
    corners = [_scene(plane, given, *point) for point in product(plane.xs[[0, -1]], plane.ys[[0, -1]])]
    if "cutoff" in known.settings:
        checks.between("cutoff", given["cutoff"], 0.0, 1e12, "Hz")
    if "members" in known.settings:
        checks.count("members", given["members"], regimes.MOST_MEMBERS)
        ensembles.check(given)
        fixed = {**given, "method": transients.METHOD}
        check_jobs([ensembles.member(scene, 1, fixed, 1e-6) for scene in corners])


def _scene(plane: Plane, given: Mapping[str, Any], x: float, y: float) -> Scene:
    numbers = {name: float(each) for name, each in given.items() if name in AXES}
    numbers |= {plane.x: float(x), plane.y: float(y)}
    rig, _ = rig_of(numbers)
    return Scene(**{name: numbers[name] for name in transients.SCENE}, rig=rig)


def findings(dataset: xr.Dataset) -> list[Part]:
    """What was mapped, how many of its points were computed, and what was found."""
    quantity = constants(dataset)["quantity"]
    values, status = dataset[quantity], dataset["status"].values
    about = held(dataset)
    lines: list[Part] = [f"{quantity}: {values.attrs['long_name']}{'; ' if about else ''}{', '.join(about)}"]
    for name in map(str, values.dims):
        ends = planes.shown(name, dataset[name].values[[0, -1]])
        lines.append(f"over {planes.label(name)} from {ends[0]:g} to {ends[1]:g} ({dataset.sizes[name]})")
    counts = [
        f"{count} {word} ({100.0 * count / status.size:.3g} %)"
        for code, word in enumerate((STATUS_FLAGS | INTERPOLATED_FLAG).values())
        if (count := int(np.count_nonzero(status == code)))
    ]
    lines += ["", f"{status.size} points: {', '.join(counts)}."]
    return [*lines, *_found(quantity, values.values[np.isfinite(values.values)])]


def _found(quantity: str, values: NDArray[Any]) -> list[str]:
    """The range of a number, or the share of each class."""
    if not len(values):
        return ["No point has a value."]
    if not QUANTITIES[quantity].whole:
        label, factor = readable(quantity, QUANTITIES[quantity].variable.units)
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


def _not_here(axes: Mapping[str, Axis], settings: Mapping[str, float]) -> Sweep:
    raise ValueError(f"STUDY = {NAME!r}: maps are made by a command of their own: fiv map --help tells how")


class _Maps(Study):
    """By what files of maps are drawn and told; whatever is set, a map is not made as a study is."""

    def sweep(self, given: Mapping[str, Any], **series: Any) -> Sweep:
        return self.build(self.axes, {})


STUDY = _Maps(
    name=NAME,
    title="Maps: one quantity over any two axes",
    question="How does a quantity change over a plane?",
    paper="Table 6 and Figs. 5 and 11 are lines and points of such planes.",
    axes={},
    settings={},
    build=_not_here,
    draw=draw,
    findings=findings,
)
