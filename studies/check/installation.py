"""Whether an installation computes, stores and draws as it should: each check with what it found and its bound.

What it compares with is in `known.json`; `python -m studies.check` takes that from the reference.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterator, Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from fivcore import Scene, simulate
from studies import registry, results, runner
from sweeps import DONE, Store, open_results

KNOWN = Path(__file__).with_name("known.json")
SHARES = ("stick_fraction", "slip_fraction", "separation_fraction")
# Of the reference: studies, values of an axis, and variables.
TAKEN: Mapping[str, tuple[str, list[float], tuple[str, ...]]] = {
    "table4": ("mode", [*range(1, 9)], ("frequency", "frequency_at_text_position")),
    "fig5": ("mu", [0.0, 0.1, 0.2, 0.3, 0.4, 0.5], ("frequency", "growth_rate", "onset_mu", "onset_frequency")),
    "contact": ("V", [2e-3], (*SHARES, *(f"{name}_se" for name in SHARES))),
}
PACKAGES = ("fiv", "numpy", "scipy", "numba", "dask", "xarray", "netCDF4", "matplotlib")
# Processors differ in rounding, 1e-12; whatever is wrong in the model or the solver changes far more.
ROUNDING = 1e-6
# Its error at the default step is 0.27 % of the largest velocity, and is of second order: that of twice the step.
TRAJECTORY = 0.01
# Until so long after the first slip trajectories are compared: the first separation, where chaos begins, is later.
SLIPPING = 1e-3
# Within this `fast` closes its balance with the paper's rig (fivcore/README.md, order and energy balance).
ENERGY = 0.005
STANDARD_ERRORS = 4.0
# Sixty-four short scenes make four batches.
SCENES: Mapping[str, Any] = {"V": np.geomspace(1e-3, 8e-3, 64), "theta": 5.0, "mu": 0.2, "F": 9.0, "duration": 0.1}
# Of a figure, so many of its points are not white.
INK = 0.01


class Found(NamedTuple):
    """A check's subject, value, bound and verdict."""

    what: str
    found: str
    bound: str
    passed: bool


class _Interrupt(Exception):  # noqa: N818 - nothing goes wrong
    """Leaves a run half-way."""


def machine() -> str:
    """Python, the packages and the processor, in a line."""
    packages = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    where = f"{platform.system()}, {platform.machine()}, {os.cpu_count()} cores"
    return f"Python {platform.python_version()}, {packages}; {where}"


def checks(folder: Path) -> Iterator[Found]:
    """Every check, one after another; `folder` takes what they write."""
    known = json.loads(KNOWN.read_text(encoding="utf-8"))
    for check in (stability, motion, contact, engine):
        try:
            yield from check(folder, known)
        except Exception as problem:  # noqa: BLE001 - whatever an installation lacks: the others still tell
            why = " ".join(f"{type(problem).__name__}: {problem}".split())
            yield Found(check.__name__, why, "no error", False)


def stability(folder: Path, known: Mapping[str, Any]) -> Iterator[Found]:
    """Frequencies, growth rates and onsets beside the reference's, and a figure of them."""
    for name in ("table4", "fig5"):
        finished = runner.run(name, {TAKEN[name][0]: TAKEN[name][1]}, folder)
        pairs = [(finished.dataset[each].values, np.array(values)) for each, values in known[name].items()]
        apart = max(float(np.max(np.abs(ours - theirs)) / np.max(np.abs(theirs))) for ours, theirs in pairs)
        yield _below(f"{name}: difference from the reference", apart, ROUNDING)
    from matplotlib.image import imread

    picture = imread(finished.figure)
    ink = float(np.mean(np.any(picture[..., :3] < 1.0, axis=-1)))
    size = f"{picture.shape[1]} x {picture.shape[0]} points"
    yield Found(f"figure of fig5, {size}", f"{ink:.2g} not white", f"above {INK:g}", ink > INK)


def motion(folder: Path, known: Mapping[str, Any]) -> Iterator[Found]:
    """A short transient by `fast` beside the same by `exact`, which goes from event to event."""
    scene = Scene(5e-3, 5.0, 0.2, 9.0)
    fast, exact = (simulate(scene, 0.031, method, record=True) for method in ("fast", "exact"))
    first = exact.summary["first_slip_time"]
    step = float(np.median(np.diff(fast.time)))
    late = abs(fast.summary["first_slip_time"] - first)
    yield _below("first slip, fast beside exact, in steps of fast", late / step, 1.0)
    times = np.linspace(0.0, first + SLIPPING, 2000)
    one, other = (np.interp(times, run.time, run.velocity_B) for run in (fast, exact))
    apart = float(np.max(np.abs(one - other)) / np.max(np.abs(other)))
    yield _below("velocity of B, fast beside exact", apart, TRAJECTORY)


def contact(folder: Path, known: Mapping[str, Any]) -> Iterator[Found]:
    """Energy and shares of time of 2.5 s of stick, slip and separation."""
    dataset = runner.run("contact", {TAKEN["contact"][0]: TAKEN["contact"][1]}, folder).dataset
    yield _below("energy that a run does not account for", float(dataset["energy_residual"].max()), ENERGY)
    for name in SHARES:
        (ours, error), (theirs, its) = (
            [float(np.asarray(data[each]).item()) for each in (name, f"{name}_se")]
            for data in (dataset, known["contact"])
        )
        apart = abs(ours - theirs) / float(np.hypot(error, its))
        yield _below(f"{name}, {ours:.3f}: standard errors off", apart, STANDARD_ERRORS)


def engine(folder: Path, known: Mapping[str, Any]) -> Iterator[Found]:
    """A sweep on threads, in processes, and gone on with after an interrupt and the loss of a part."""
    sweep = registry.load("scenes").sweep(SCENES)
    count = sweep.grid.size
    whole = sweep.plan(folder / "threads.nc").run("threads", 2)
    spread = sweep.plan(folder / "processes.nc").run("processes", 2)
    yield _same(f"{count} scenes on two threads, in two processes", whole, spread)
    with xr.open_dataset(folder / "threads.nc") as plain:
        yield _same("their file, read by xarray alone", whole, plain)
        done = int((plain["status"] == DONE).sum())
    yield Found("scenes that were computed", str(done), str(count), done == count)

    def interrupt(snapshot: Any) -> None:
        if snapshot.done >= count // 2:
            raise _Interrupt

    store = folder / "resumed.nc"
    with suppress(_Interrupt):
        sweep.plan(store).run("sync", progress=interrupt)
    # Whatever was done, a part is lost now.
    sorted(Store(store).parts.glob("*.part"))[0].unlink()
    plan = sweep.plan(store)
    yield _same(f"gone on with, {plan.todo} scenes due", whole, plan.run())
    kept = count - plan.todo
    yield Found("scenes kept from the run that was interrupted", str(kept), f"1 to {count - 1}", 0 < kept < count)


def _below(what: str, value: float, bound: float) -> Found:
    return Found(what, f"{value:.2g}", f"at most {bound:g}", bool(value <= bound))


def _same(what: str, one: xr.Dataset, other: xr.Dataset) -> Found:
    """Whether all numbers but the times that computing took have the same bits."""
    names = [name for name, values in one.data_vars.items() if values.dtype.kind in "fi" and name != "wall_time"]
    pairs = ((one[name].values, other[name].values.astype(one[name].dtype)) for name in names)
    changed = sum(ours.tobytes() != theirs.tobytes() for ours, theirs in pairs)
    return Found(what, f"{changed} of {len(names)} variables differ", "none, by a bit", not changed)


def known_of(folder: Path) -> dict[str, dict[str, Any]]:
    """Take the values to compare with from the reference in a folder."""
    found = dict[str, dict[str, Any]]()
    for name, (axis, values, variables) in TAKEN.items():
        with open_results(results.file_of(name, folder)) as dataset:
            chosen = dataset.sel({axis: values}, method="nearest")
            found[name] = {each: chosen[each].values.tolist() for each in variables}
    return found
