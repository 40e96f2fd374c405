"""Options of a run, checked once and frozen."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from fivcore import checks
from fivcore.contact.reduced import INTERVAL, Modify, ReducedModel, modified, reduced_model
from fivcore.errors import InputError
from fivcore.jit import Array
from fivcore.rig import Rig, Scene
from fivcore.structure import structure_of
from fivcore.transient.normalised import Normalised, State, loading_time
from fivcore.transient.statistics import SERIES, SETTLING, STICK, begin

BOUNDS = {
    "duration": (1e-9, 1e6, "s"),
    "settle": (0.0, 1e6, "s"),
    "min_stick": (1e-9, 1e6, "s"),
    "step": (1e-12, 1.0, "s"),
    "cutoff": (1.0, 1e12, "Hz"),
    "sample_rate": (1e-3, 1e9, "Hz"),
}
# Default rate of series, Hz, in units of a structure's time, and default ramp, s.
RATE, RAMP = 100e3, 1e-3
# Shortest long stick, in loading times.
LONG_STICK = 0.2


@dataclass(frozen=True)
class Until:
    """How long a run lasts: until its shares of time in stick, slip and separation are known well enough.

    The run is checked after times that grow by a quarter, and ends where at two checks in a row no share has a
    larger standard error (`observe.standard_errors`): one that is too small by chance does not end it. Statistics
    last for at least 20 times the time in which the drive loads a stuck contact until it slips. Once steady
    sliding is proved, or without slip the drive has moved 1.3 times what slips statically, `least` is enough.

    Parameters
    ----------
    standard_error : float
        Largest standard error of a share.
    least, most : float
        Shortest time that statistics last, s; longest simulated time, s, whatever else is asked.

    Raises
    ------
    ValueError
        Naming the argument, its value and what is allowed.
    """

    standard_error: float = 0.005
    least: float = 0.3
    most: float = 60.0

    def __post_init__(self) -> None:
        checks.between("standard_error", self.standard_error, 1e-6, 1.0, "1")
        checks.between("most", self.most, 1e-9, 1e6, "s")
        checks.between("least", self.least, 0.0, 1e6, "s")


@dataclass(frozen=True, eq=False)
class Options:
    """Options of a run as in `fivcore.simulate`; `skip` is its `leap`, and `initial` is normalised (F = 1).

    Where the run ends when its shares are known, `duration` is the longest.
    """

    duration: float
    method: str = "fast"
    numerical_damping: str = "none"
    ramp: float = RAMP
    settle: float | None = None
    initial: State | None = None
    cutoff: float | None = None
    step: float | None = None
    min_stick: float | None = None
    record: tuple[str, ...] = ()
    sample_rate: float | None = 100e3
    sample_times: Array | None = None
    end_early: bool = True
    skip: bool = True
    modify: Modify | None = None
    beta2: float | None = None
    until: Until | None = None
    # The run that goes on, where `initial` is its end.
    resumed: Any = None

    @property
    def contact(self) -> int:
        """Contact status at the start."""
        return STICK if self.initial is None else self.initial.contact

    def record_of(self, scene: Normalised, fields: Any, record: Any = None, time: float = 0.0) -> Any:
        """A method's record (1,), by default a new one, with the counters at the start of a run at `time`, s."""
        # A stick between two samples interrupts no vibration.
        least = max(LONG_STICK * loading_time(scene), INTERVAL * scene.rig.time_unit)
        least = least if self.min_stick is None else self.min_stick
        settling = SETTLING * scene.rig.time_unit
        record = np.zeros(1, fields) if record is None else record
        contact = int(record["contact"][0]) if self.resumed is not None else self.contact
        return begin(record, self.settle, settling, least, contact, time)

    def rows(self, step: float) -> tuple[int, float | None]:
        """Steps between the rows of a record, 0 for none; rate at which series are interpolated in them, Hz."""
        if not self.record or self.sample_times is not None or self.sample_rate is None:
            return int(bool(self.record)), None
        steps = 1.0 / (self.sample_rate * step)
        whole = max(round(steps), 1)
        return (whole, None) if abs(steps / whole - 1.0) < 1e-9 else (1, self.sample_rate)


def options_for(scene: Scene, normalised: Normalised, arguments: dict[str, Any]) -> Options:
    """Check the arguments of `fivcore.simulate`, by name; a `ValueError` names the first that is wrong."""
    options = dict(arguments)
    if isinstance(options["duration"], Until):
        options |= {"until": options["duration"], "duration": options["duration"].most}
    if default_rate := isinstance(options["sample_rate"], str) and options["sample_rate"] == "default":
        options["sample_rate"] = None
    for name, limits in BOUNDS.items():
        if name == "duration" or options[name] is not None:
            options[name] = checks.between(name, options[name], *limits)
    if default_rate:
        options["sample_rate"] = RATE / scene.rig.time_unit
    duration, rate, times = options["duration"], options["sample_rate"], options["sample_times"]
    allowed = "0 or a time from 1e-9 to 1000 s"
    given = options["ramp"]
    ramp = RAMP if given is None else checks.number("ramp", given, allowed, lambda x: x == 0.0 or 1e-9 <= x <= 1e3)
    options |= law_options(options)
    record = _names(options["record"])
    for name in ("end_early", "leap"):
        checks.instance(name, options[name], bool)
    if record and times is None and rate is not None and duration * rate > 1e8:
        raise InputError(f"sample_rate = {rate:g}: over this duration it must be at most {1e8 / duration:g} Hz")
    checks.between("V / F", normalised.speed_per_load, 1e-12, 1e8, "m/s per N")
    options |= {"ramp": ramp, "record": record, "skip": options.pop("leap")}
    if (initial := options["initial"]) is not None:
        run = _continued(initial, normalised, options)
        state = _state(initial, scene, normalised)
        started = run.options.ramp if run is not None else 0.0 if state.running else ramp
        if given is not None and ramp != started and (ramp > 0.0 or not state.running):
            text = "the drive of the initial state has started already; leave it out"
            raise InputError(f"ramp = {ramp:g}: {text}")
        options |= {"resumed": run, "ramp": started, "initial": state}
    if times is not None:
        start = 0.0 if options.get("resumed") is None else initial.time
        options["sample_times"] = _times(times, record, start, duration)
    return Options(**options)


# Options that a method does not use.
UNUSED = {
    "fast": ("beta2",),
    "exact": ("beta2", "leap", "end_early"),
    "paper": ("cutoff", "modify", "leap", "end_early"),
}


def law_options(options: dict[str, Any]) -> dict[str, Any]:
    """Check a method, that it uses all `options` that differ from their defaults, and its contact law.

    Returns the two options that follow from others.
    """
    method, modify, numerical_damping, beta2 = (
        options[name] for name in ("method", "modify", "numerical_damping", "beta2")
    )
    checks.choice("method", method, tuple(UNUSED))
    for name in UNUSED[method]:
        if (value := options.get(name)) is not None and value is not True:
            raise InputError(f"{name} = {checks.short(value)}: method {method!r} does not use it; leave it out")
    if modify is not None and not callable(modify):
        raise InputError(f"modify = {checks.short(modify)}: it must be a function of a reduced model, or None")
    if beta2 is not None:
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


def _continued(initial: Any, normalised: Normalised, options: dict[str, Any]) -> Any:
    """Return the run that ended in `initial` if it had the same scene, method and model, else None.

    Functions that modify a model are the same if the models that they make now are equal to those of the run.
    """
    scene, run = getattr(initial, "origin", None) or (None, None)
    names, modify = ("method", "numerical_damping", "cutoff", "step", "beta2"), options["modify"]
    if scene != normalised or run is None or any(getattr(run.options, name) != options[name] for name in names):
        return None
    if modify is run.options.modify is None:
        return run
    rig, theta = run.scene.rig, run.scene.theta
    models = [(modified(reduced_model(rig, theta, cutoff), modify), model) for cutoff, model in run.models]
    same = all(
        np.array_equal(getattr(one, each.name), getattr(other, each.name))
        for one, other in models
        for each in fields(ReducedModel)
    )
    return run if same else None


def _times(sample_times: Any, names: tuple[str, ...], start: float, duration: float) -> Array:
    if not names:
        raise InputError("sample_times: they are for what is recorded, and nothing is; give record = True")
    try:
        times = np.asarray(sample_times, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("sample_times: they must be numbers, s") from None
    if times.ndim != 1 or not np.all(np.isfinite(times)) or np.any(np.diff(times) < 0.0):
        raise InputError(f"sample_times of shape {times.shape}: they must be a row of finite, ascending times, s")
    if len(times) and not (times[0] >= start and times[-1] <= start + duration):
        raise InputError(
            f"sample_times from {times[0]:g} to {times[-1]:g} s: they must be from {start:g} to"
            f" {start + duration:g} s, the run's start and end"
        )
    return times


def seen(scene: Normalised) -> Any:
    """The normalised inclination of a rig, or the structure: equal for a scene and its mirror image."""
    return scene.theta if isinstance(scene.rig, Rig) else scene.rig


def _state(initial: Any, scene: Scene, normalised: Normalised) -> State:
    """The given state, normalised."""
    try:
        given = initial if isinstance(initial, State) else State(*initial)
        q, v, contact = given.displacement, given.velocity, given.contact
        q, v = np.asarray(q), np.asarray(v)
    except (TypeError, ValueError):
        raise InputError("initial: it must be modal displacements, modal velocities and a contact state") from None
    band = structure_of(scene.rig, scene.theta)
    own, fewer = band.motion, len(band.frequency)
    modes = len(own.frequency)
    for name, part in (("displacements", q), ("velocities", v)):
        if (
            part.shape not in {(modes,), (modes + own.static,), (fewer,)}
            or part.dtype.kind not in "iuf"
            or not np.all(np.abs(part) < 1e50)
        ):
            text = f"initial: modal {name} of shape {part.shape}: they must be {modes} finite numbers below 1e50"
            raise InputError(text)
    if not isinstance(contact, (int, np.integer)) or isinstance(contact, bool) or contact not in (0, 1, 2):
        raise InputError(f"initial: contact state {contact!r}: it must be 0 (separation), 1 (stick) or 2 (slip)")
    before = None if given.origin is None else given.origin[0]
    if normalised.sense < 0 and before is None:
        raise InputError("initial: with V < 0 give the mirrored scene (scene.mirrored()) and its state")
    if before is not None and before.sense != normalised.sense and seen(before) != seen(normalised):
        raise InputError(
            "initial: it is the end of a run with the other sign of V, whose modes are those of the mirrored scene"
            " (scene.mirrored()); give a state of this scene"
        )
    q, v = (part.astype(float) / normalised.load for part in (q, v))
    q, v = (np.pad(part, (0, modes + own.static - len(part))) for part in (q, v))
    return State(q, v, int(contact), given.running)
