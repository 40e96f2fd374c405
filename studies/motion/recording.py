"""Series of the motion that are recorded besides a study's own variables: their names, times and declaration.

A series holds samples, not averages: at each of its times the value that the motion has there, on the line
between two of the solver's steps. Frequencies above half the sample rate fold into those below; spikes of
microseconds at the contact may fall between two samples.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fivcore import Transient, checks
from studies.motion import transients
from studies.motion.jobs import Job, outcomes
from studies.study import suggest
from sweeps import InputError, Sweep, Variable

if TYPE_CHECKING:
    from studies.study import Study

# Hz, by default.
SAMPLE_RATE = 50e3
# Duration of recorded runs where none is set, s.
DURATION = 1.0
# Of one series of one scene.
MOST_SAMPLES = 1_000_000
# Series make most of a large sweep's file, and rounded ones can be compressed.
DIGITS = 4

_ELAPSED = ("elapsed",)
SERIES = {
    "velocity_B": Variable("m s-1", "velocity of B along x, sampled", _ELAPSED, "float32", DIGITS),
    "normal_force": Variable("N", "normal force on P1, sampled", _ELAPSED, "float32", DIGITS),
    "tangential_force": Variable("N", "force along x on P1, sampled", _ELAPSED, "float32", DIGITS),
    "slip_velocity": Variable(
        "m s-1", "velocity of P1's surface relative to P2's, sampled", _ELAPSED, "float32", DIGITS
    ),
    "state": Variable(
        "1", "state of the contact, sampled", _ELAPSED, "int8", flags=dict(enumerate(transients.STATES))
    ),
}
# What multiplies the series of a normalised scene (`studies.motion.normalised`).
FACTORS = {"velocity_B": "along", "normal_force": "load", "tangential_force": "along", "slip_velocity": "along"}


def options(record: Sequence[str], times: np.ndarray) -> dict[str, Any]:
    """Options of `simulate` for these series; none where no series is recorded."""
    return {"record": tuple(record), "sample_times": times} if record else {"record": False}


def series(run: Transient, record: Sequence[str]) -> dict[str, Any]:
    """The recorded series of a run, as they are stored."""
    every = {name: getattr(run, name) for name in record}
    return {name: values if name == "state" else values.astype(np.float32) for name, values in every.items()}


def histories(
    points: Mapping[str, Any],
    fixed: Mapping[str, Any],
    values: Callable[[Transient, np.ndarray, np.ndarray], dict[str, Any]],
    own: Sequence[str],
    record: Sequence[str],
    sample_rate: float,
) -> dict[str, Any]:
    """Velocity of B at even times, summary figures and what a study adds, for the points of a batch.

    `values(run, series, times)` returns what the study adds; `series` is the velocity of B at `times`. Of `own`
    series, velocity_B among them, it needs every step; those to `record` besides come from a second run.
    """
    times = transients.even_times(fixed["duration"], sample_rate).values
    fine = {"record": tuple(own), "sample_rate": transients.OVERSAMPLING * sample_rate}
    second = [options(record, times)] if record else []

    def all_values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        velocity = transients.velocity(runs[0], times, sample_rate)
        added = values(runs[0], velocity, times) | series(runs[-1], record)
        return {"velocity_B": velocity, **added, **transients.figures_of(runs[0])}

    every = transients.scenes(points, fixed)
    jobs = [[transients.job(scene, fixed, **each) for each in (fine, *second)] for scene in every]
    return outcomes(jobs, all_values)


def whole_runs(study: Study, values: Mapping[str, Any], names: Sequence[str], sample_rate: float | None) -> Sweep:
    """The sweep of a study without series of its own; from the start of the drive to the end of the run."""
    names = _checked(names, sample_rate)
    rate = checks.between("sample_rate", SAMPLE_RATE if sample_rate is None else sample_rate, 100.0, 1e6, "Hz")
    sweep = study.sweep(values)
    duration = float(sweep.constants["duration"]) or DURATION
    if duration * rate > MOST_SAMPLES * (1.0 + 1e-9):
        raise InputError(
            f"sample_rate = {rate:g}: over duration = {duration:g} s it must be at most "
            f"{MOST_SAMPLES / duration:.6g} Hz, for {MOST_SAMPLES} samples of a scene"
        )
    if duration * rate < 1.0:
        raise InputError(
            f"sample_rate = {rate:g}: over duration = {duration:g} s it must be at least {1.0 / duration:.6g} Hz"
        )
    timed = replace(
        sweep,
        constants={**sweep.constants, "sample_rate": rate, "duration": duration},
        coords={**sweep.coords, "elapsed": transients.even_times(duration, rate)},
    )
    return _added(timed, names)


def on_own_times(
    study: Study, values: Mapping[str, Any], names: Sequence[str], sample_rate: float | None
) -> Sweep:
    """The sweep of a study that keeps the velocity of B, with the other series at the same times."""
    names = _checked(names, sample_rate)
    if sample_rate is not None:
        if "sample_rate" in values:
            raise InputError(
                f"sample_rate = {sample_rate!r}: study {study.name} has it as a setting, and that is set to "
                f"{values['sample_rate']}; give one of the two"
            )
        values = {**values, "sample_rate": sample_rate}
    sweep = study.sweep(values)
    return _added(sweep, tuple(name for name in names if name not in sweep.variables))


def in_a_window(study: Study, values: Mapping[str, Any], names: Sequence[str], sample_rate: float | None) -> Sweep:
    """Refuse: the study's series are those of a window of its own."""
    raise InputError(
        f"record = {', '.join(_checked(names, sample_rate))}: study {study.name} keeps its series in a window "
        "already (settings window_start, window and sample_rate); study scenes records whole runs"
    )


def _checked(names: Sequence[str], sample_rate: float | None) -> tuple[str, ...]:
    """The names, each once and in the order of SERIES, so that their order changes nothing."""
    names = (names,) if isinstance(names, str) else tuple(names)
    if not names:
        raise InputError(f"sample_rate = {sample_rate!r}: it is for what is recorded, and nothing is; give record")
    for name in names:
        if name not in SERIES:
            raise InputError(
                f"record = {name!r}: there is no such series; {suggest(str(name), list(SERIES))}"
                f"the series are {', '.join(SERIES)}"
            )
    return tuple(name for name in SERIES if name in names)


def _added(sweep: Sweep, names: tuple[str, ...]) -> Sweep:
    """The sweep with these series besides, scaled like its figures if it computes normalised scenes."""
    if not names:
        return sweep
    more = {name: SERIES[name] for name in names}
    if sweep.scale is not None:
        more = {name: replace(each, scale=FACTORS.get(name, "")) for name, each in more.items()}
    constants = {**sweep.constants, "record": names}
    return replace(sweep, variables={**sweep.variables, **more}, constants=constants)
