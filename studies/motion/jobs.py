"""Simulate a flat list of runs, and collect the values of a sweep's points."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fivcore import Scene, SceneError, Transient, Until, located, simulate_many

# Largest `energy_residual` of a run that counts. "fast": what landing within a step leaves; 0.042 was the largest
# of 1440 runs on the paper's rig and on rigs drawn at random. "exact": rounding, below 1e-9. "paper": its own
# damping and its impacts, which its balance leaves out, 0.18 in the scenes of fivcore/README.md.
BALANCE = {"fast": 0.1, "exact": 1e-6, "paper": 0.3}


class BalanceError(SceneError):
    """The energy residual of a run exceeds the limit of its method."""


@dataclass(frozen=True, eq=False)
class Job:
    """One run to be simulated, for `duration` seconds or until its statistics are certain enough.

    `options` are further arguments of `fivcore.simulate`, `method` among them.
    """

    scene: Scene
    duration: float | Until
    options: Mapping[str, Any]


def run_all(jobs: Sequence[Job]) -> list[Transient | SceneError]:
    """Simulate each job: its `Transient`, or the `SceneError` of its scene. Bad arguments raise `ValueError`."""
    return [simulate_many([job.scene], job.duration, **job.options)[0] for job in jobs]


def balanced(job: Job, result: Transient | SceneError) -> Transient | SceneError:
    """Return a result, or a `BalanceError` if its energy residual exceeds the limit of its method."""
    method = job.options.get("method", "fast")
    if isinstance(result, SceneError) or result.summary["energy_residual"] <= BALANCE[method]:
        return result
    other = "method 'fast'" if method == "exact" else "a smaller step or method 'exact'"
    text = f"energy_residual = {result.summary['energy_residual']:.3g}: of method {method!r} at most"
    return located(BalanceError(f"{text} {BALANCE[method]:g} counts; simulate the scene with {other}"), job.scene)


def run_one(job: Job, *, balance: bool = True) -> Transient:
    """Simulate a job, or raise its `SceneError`, by default also a `BalanceError`."""
    (result,) = run_all([job])
    result = balanced(job, result) if balance else result
    if isinstance(result, SceneError):
        raise result
    return result


def stacked(found: Sequence[Any]) -> dict[str, Any]:
    """Stack values of all points into arrays, exceptions into `error`; if all points failed, raise the first."""
    errors = [each if isinstance(each, Exception) else None for each in found]
    if None not in errors:
        raise errors[0]  # type: ignore[misc]
    # A failed point has values too, those of another point: the sweep drops them.
    some = found[errors.index(None)]
    whole = [some if error else each for each, error in zip(found, errors, strict=True)]
    return {name: np.stack([each[name] for each in whole]) for name in some} | {"error": errors}


def each_scene(scenes: Sequence[Scene], values: Callable[[Scene], Mapping[str, Any]]) -> dict[str, Any]:
    """Compute values of each scene, mirrored so that V > 0, and stack them."""
    found = list[Any]()
    for scene in scenes:
        try:
            found.append(values(scene if scene.V > 0.0 else scene.mirrored()))
        except (SceneError, ValueError, ArithmeticError) as error:
            found.append(error)
    return stacked(found)


def outcomes(
    points: Sequence[Sequence[Job]], values: Callable[[Sequence[Job], Sequence[Transient]], Mapping[str, Any]]
) -> dict[str, Any]:
    """Simulate the jobs of all points of a batch, and return the outputs of a sweep's function.

    The `SceneError` (or `BalanceError`) of a point becomes its `error`, so that the other points of the batch need
    not be computed again. If every point has one, the first is raised, so that a point that is computed alone
    fails with its own message.

    Parameters
    ----------
    points : sequence of sequence of Job
        The jobs of each point.
    values : callable
        `values(jobs, runs)` returns the value of each variable at one point. Long arrays should have their final
        type, for a batch holds many.

    Returns
    -------
    dict
        An array over the points for each variable; `error`, the exception or None for each point; `wall_time`,
        s, the time that all took together, shared by the time that each simulates.
    """
    start = time.perf_counter()
    every = [job for jobs in points for job in jobs]
    results: Iterator[Any] = map(balanced, every, run_all(every))
    runs = [[next(results) for _ in jobs] for jobs in points]
    errors: list[Any] = [next((each for each in own if isinstance(each, Exception)), None) for own in runs]
    whole = stacked([
        error or values(jobs, own) for jobs, own, error in zip(points, runs, errors, strict=True)
    ])  # fmt: skip
    # A run that ends with an error takes no time that counts.
    simulated = np.array(
        [sum(run.summary["simulated_time"] for run in own if isinstance(run, Transient)) for own in runs]
    )
    per_second = (time.perf_counter() - start) / simulated.sum()
    return whole | {"wall_time": per_second * simulated}
