"""Checks that an installation computes, stores and draws correctly, each with its value and its bound.

Constants are the reference's, to ten digits (fiv query table4 --show frequency --format csv; likewise the onsets).
"""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import image

from fivcore import Rig, Scene, flutter_onsets, glued_frequencies, simulate, sliding_modes, tune_head_mass
from studies import registry, runner
from studies.asking.request import Request
from sweeps import DONE, Sweep, pointwise

GLUED = (16.0, 361.6562112, 1664.488491, 2055.406886, 2924.067593, 5035.521765, 6624.390951, 8030.957647)
ONSETS, FREQUENCIES = (0.1112325689, 0.1529771887, 0.2236480729), (2802.133779, 397.8166799, 7704.742641)
GROWTH = (383.7790620, 1764.185104)
PACKAGES = ("fiv", "numpy", "scipy", "numba", "dask", "xarray", "netCDF4", "matplotlib")
# Processors differ by rounding, 1e-12. Errors of `fast` at twice its step, and of its energy: fivcore/README.md.
ROUNDING, TRAJECTORY, ENERGY = 1e-6, 0.01, 0.005
INK = 0.01  # of the pixels of a figure, at least, are not white
SPEEDS, MOVED = np.geomspace(1e-3, 8e-3, 24), ("velocity_rms", "stick_fraction")
# A check's subject, value and bound, and whether it passed.
Found = tuple[str, str, str, bool]


def machine() -> str:
    """Python, the packages and the processor, in a line."""
    packages = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return f"Python {platform.python_version()}, {packages}; {platform.platform()}, {os.cpu_count()} cores"


def checks(folder: Path) -> Iterator[Found]:
    """Run all checks, which write into `folder`. One that raises an exception fails; the others continue."""
    for check in (stability, motion, engine, study):
        try:
            yield from check(folder)
        except Exception as problem:  # noqa: BLE001 - whatever an installation lacks
            reason = " ".join(f"{type(problem).__name__}: {problem}".split())
            yield check.__name__, reason, "no error", False


def stability(folder: Path) -> Iterator[Found]:
    """Frequencies, onsets and growth rates of the paper's rig beside the reference's."""
    rig = Rig(contact_position=0.085, head_mass=tune_head_mass(Rig(contact_position=0.085), 5.0))
    yield _near("natural frequencies, glued contact", glued_frequencies(rig, 5.0), GLUED)
    onsets = flutter_onsets(Rig(), 5.0, mu_max=0.5)
    yield _near("flutter onsets: friction", onsets.mu, ONSETS)
    yield _near("flutter onsets: frequency", onsets.frequency, FREQUENCIES)
    rates = sliding_modes(Rig(), 5.0, 0.2).growth_rate
    yield _near("growth rates at mu = 0.2", rates[rates > 0.0], GROWTH)


def motion(folder: Path) -> Iterator[Found]:
    """A short transient by `fast` beside `exact`, and balances of a longer one."""
    fast, exact = (
        simulate(Scene(5e-3, 5.0, 0.2, 9.0), 0.031, method, record=True) for method in ("fast", "exact")
    )
    first, step = exact.summary["first_slip_time"], float(np.median(np.diff(fast.time)))
    yield _below("fast and exact: first slip, in steps", abs(fast.summary["first_slip_time"] - first) / step, 1.0)
    # The first separation, where chaos begins, is later.
    times = np.linspace(0.0, first + 1e-3, 2000)
    one, other = (np.interp(times, run.time, run.velocity_B) for run in (fast, exact))
    yield _near("fast and exact: velocity of B", one, other, TRAJECTORY)
    vibrating = simulate(Scene(2e-3, 5.0, 0.2, 9.0), 1.0).summary
    yield _below("energy balance: residual", vibrating["energy_residual"], ENERGY)
    fractions = [vibrating[f"{state}_fraction"] for state in ("stick", "slip", "separation")]
    yield _near("fractions of time: their sum", sum(fractions), 1.0)


def engine(folder: Path) -> Iterator[Found]:
    """A sweep on threads and one point after another, its file, and a run that completes another."""
    grids = {"V": SPEEDS}, {"V": SPEEDS[::2]}
    whole, half = (Sweep("check", pointwise(moved), grid, MOVED, code=("fivcore",)) for grid in grids)
    threads = whole.plan(folder / "threads.nc").run("threads", 2)
    yield _same("sweep on threads and in sequence", threads, whole.plan().run("sync"))
    yield _counted("points computed", int((threads["status"] == DONE).sum()), len(SPEEDS))
    with xr.open_dataset(folder / "threads.nc") as plain:
        yield _same("its file, read by xarray alone", threads, plain)
    half.plan(folder / "longer.nc").run("sync")
    plan = whole.plan(folder / "longer.nc")
    yield _counted("points that a shorter run stored", plan.cached, len(SPEEDS[::2]))
    yield _same("the run that completes it", threads, plan.run())


def moved(V: float) -> dict[str, Any]:
    """The motion of the paper's rig in the first 50 ms."""
    return {name: simulate(Scene(V, 5.0, 0.2, 9.0), 0.05, settle=0.0).summary[name] for name in MOVED}


def study(folder: Path) -> Iterator[Found]:
    """A study with its figure."""
    first = registry.load(registry.names_for("modes")[0])
    finished = runner.execute(first, runner.plan(first, Request(values={"mu": "0:0.5:6"}), folder))
    yield _near(f"study {first.name}: onsets in its file", finished.dataset["onset_mu"].values, ONSETS)
    ink = float(np.mean(np.any(image.imread(finished.figures[0])[..., :3] < 1.0, axis=-1)))
    yield f"study {first.name}: pixels drawn", f"{ink:.2g}", f"above {INK:g}", ink > INK


def _near(what: str, ours: Any, theirs: Any, bound: float = ROUNDING) -> Found:
    """Whether values agree with the expected ones, relative to the largest."""
    what, value, most, passed = _below(
        what, float(np.max(np.abs(np.subtract(ours, theirs))) / np.max(np.abs(theirs))), bound
    )
    return what, f"off by {value}", most, passed


def _counted(what: str, ours: int, theirs: int) -> Found:
    return what, f"{ours}", f"exactly {theirs}", ours == theirs


def _below(what: str, value: float, bound: float) -> Found:
    return what, f"{value:.2g}", f"at most {bound:g}", bool(value <= bound)


def _same(what: str, one: xr.Dataset, other: xr.Dataset) -> Found:
    changed = [name for name in (*MOVED, "status") if one[name].values.tobytes() != other[name].values.tobytes()]
    return what, f"{', '.join(changed) or 'nothing'} differs", "no bit differs", not changed
