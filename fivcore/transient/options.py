"""Options of a run, checked once and frozen."""

from __future__ import annotations

from dataclasses import dataclass
from inspect import signature
from typing import Any

import numpy as np

from fivcore import checks
from fivcore.contact.reduced import Modify
from fivcore.errors import InputError
from fivcore.jit import Array
from fivcore.rig import Scene
from fivcore.transient.normalised import Normalised, State
from fivcore.transient.record import SERIES
from fivcore.transient.until import Until

BOUNDS = {
    "duration": (1e-9, 1e6, "s"),
    "settle": (0.0, 1e6, "s"),
    "min_stick": (1e-9, 1e6, "s"),
    "step": (1e-12, 1.0, "s"),
    "cutoff": (1.0, 1e12, "Hz"),
    "sample_rate": (1e-3, 1e9, "Hz"),
}


@dataclass(frozen=True, eq=False)
class Options:
    """Options of a run as in `fivcore.simulate`; `skip` is its `leap`, and `initial` is normalised (F = 1).

    Where the run ends when its shares are known, `duration` is the longest.
    """

    duration: float
    method: str = "fast"
    numerical_damping: str = "none"
    ramp: float = 1e-3
    settle: float | None = None
    initial: State | None = None
    cutoff: float | None = None
    step: float | None = None
    min_stick: float | None = None
    record: tuple[str, ...] = ()
    sample_rate: float = 100e3
    sample_times: Array | None = None
    end_early: bool = True
    skip: bool = True
    modify: Modify | None = None
    beta2: float | None = None
    until: Until | None = None

    @property
    def sampling_rate(self) -> float | None:
        """Rate at which rows of a record are taken, Hz; infinite: in every step; None: not at all."""
        # Sample times lie between two steps of the method.
        return None if not self.record else self.sample_rate if self.sample_times is None else np.inf


def options_for(scene: Scene, normalised: Normalised, arguments: dict[str, Any]) -> Options:
    """Check the arguments of `fivcore.simulate`, by name; a `ValueError` names the first that is wrong."""
    options = dict(arguments)
    if isinstance(options["duration"], Until):
        options |= {"until": options["duration"], "duration": options["duration"].most}
    for name, limits in BOUNDS.items():
        if name in ("duration", "sample_rate") or options[name] is not None:
            options[name] = checks.between(name, options[name], *limits)
    duration, rate, times = options["duration"], options["sample_rate"], options["sample_times"]
    allowed = "0 or a time from 1e-9 to 1000 s"
    ramp = checks.number("ramp", options["ramp"], allowed, lambda x: x == 0.0 or 1e-9 <= x <= 1e3)
    options |= law_options(**{name: options[name] for name in signature(law_options).parameters})
    record = _names(options["record"])
    for name in ("end_early", "leap"):
        checks.instance(name, options[name], bool)
    if record and times is None and duration * rate > 1e8:
        raise InputError(f"sample_rate = {rate:g}: over this duration it must be at most {1e8 / duration:g} Hz")
    checks.between("V / F", normalised.speed_per_load, 1e-12, 1e8, "m/s per N")
    options |= {"ramp": ramp, "record": record, "skip": options.pop("leap")}
    if options["initial"] is not None:
        options["initial"] = _state(options["initial"], scene, normalised)
    if times is not None:
        options["sample_times"] = _times(times, record, duration)
    if options["method"] == "paper" and options["cutoff"] is not None:
        raise InputError(f"cutoff = {options['cutoff']:g}: the published scheme keeps all modes; leave it out")
    return Options(**options)


def law_options(method: Any, modify: Any, numerical_damping: Any, beta2: Any) -> dict[str, Any]:
    """Check the options that choose a method and its contact law; return the two that follow from others."""
    checks.choice("method", method, ("fast", "exact", "paper"))
    if modify is not None:
        if not callable(modify):
            raise InputError(f"modify = {checks.short(modify)}: it must be a function of a reduced model, or None")
        if method == "paper":
            raise InputError("modify: method 'paper' keeps all modes; leave it out")
    if beta2 is not None:
        if method != "paper":
            raise InputError(f"beta2 = {beta2}: method {method!r} has none, only 'paper'; leave it out")
        # Below 0.5 every mode grows.
        beta2 = checks.number("beta2", beta2, "a number from 0.5 to 1", lambda x: 0.5 <= x <= 1.0)
    if numerical_damping is None:
        numerical_damping = "published" if method == "paper" else "none"
    elif beta2 is not None:
        raise InputError(
            f"beta2 = {beta2:g} with numerical_damping = {numerical_damping!r}: each sets the other; leave one out"
        )
    else:
        checks.choice("numerical_damping", numerical_damping, ("published", "none"))
        beta2 = 0.5 if method == "paper" and numerical_damping == "none" else None
    return {"numerical_damping": numerical_damping, "beta2": beta2}


def _names(record: Any) -> tuple[str, ...]:
    """Series to keep: all for True, none for False, or those named."""
    if isinstance(record, (bool, np.bool_)):
        return tuple(SERIES) if record else ()
    names = (record,) if isinstance(record, str) else record
    if not isinstance(names, (tuple, list)) or not names or any(name not in SERIES for name in names):
        raise InputError(f"record = {record!r}: it must be a bool or names of series among {', '.join(SERIES)}")
    return tuple(name for name in SERIES if name in names)


def _times(sample_times: Any, names: tuple[str, ...], duration: float) -> Array:
    if not names:
        raise InputError("sample_times: they are for what is recorded, and nothing is; give record = True")
    try:
        times = np.asarray(sample_times, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("sample_times: they must be numbers, s") from None
    if times.ndim != 1 or not np.all(np.isfinite(times)) or np.any(np.diff(times) < 0.0):
        raise InputError(f"sample_times of shape {times.shape}: they must be a row of finite, ascending times, s")
    if len(times) and not (times[0] >= 0.0 and times[-1] <= duration):
        raise InputError(
            f"sample_times from {times[0]:g} to {times[-1]:g} s: they must be from 0 to duration = {duration:g} s"
        )
    return times


def _state(initial: Any, scene: Scene, normalised: Normalised) -> State:
    """The given state, normalised."""
    try:
        q, v, contact = vars(initial).values() if isinstance(initial, State) else initial
        q, v = np.asarray(q), np.asarray(v)
    except (TypeError, ValueError):
        raise InputError("initial: it must be modal displacements, modal velocities and a contact state") from None
    modes = 3 * scene.rig.p1.elements + 1 + 3 * scene.rig.p2.elements
    for name, part in (("displacements", q), ("velocities", v)):
        if part.shape != (modes,) or part.dtype.kind not in "iuf" or not np.all(np.abs(part) < 1e50):
            text = f"initial: modal {name} of shape {part.shape}: they must be {modes} finite numbers below 1e50"
            raise InputError(text)
    if not isinstance(contact, (int, np.integer)) or isinstance(contact, bool) or contact not in (0, 1, 2):
        raise InputError(f"initial: contact state {contact!r}: it must be 0 (separation), 1 (stick) or 2 (slip)")
    if normalised.sense < 0:
        raise InputError("initial: with V < 0 give the mirrored scene (scene.mirrored()) and its state")
    return State(q.astype(float) / normalised.load, v.astype(float) / normalised.load, int(contact))
