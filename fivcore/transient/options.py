"""Options of a run, checked once and frozen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from fivcore import checks
from fivcore.contact.reduced import INTERVAL, Modify, ReducedModel, modified, reduced_model
from fivcore.errors import InputError
from fivcore.jit import Array
from fivcore.rig import Rig, Scene, one_contact
from fivcore.structure import modal_structure
from fivcore.transient.normalised import Normalised, State, loading_time
from fivcore.transient.statistics import SERIES, SETTLING, STICK, begin

BOUNDS = {
    "settle": (0.0, 1e6, "s"),
    "min_stick": (1e-9, 1e6, "s"),
    "step": (1e-12, 1.0, "s"),
    "cutoff": (1.0, 1e12, "Hz"),
    "sample_rate": (1e-3, 1e9, "Hz"),
    # Below 0.5 every mode is unstable.
    "beta2": (0.5, 1.0, "1"),
}
DURATION = (1e-9, 1e6, "s")
# Default sampling rate of series, Hz (divided by a structure's `time_scale`), and default ramp, s.
DEFAULT_RATE, DEFAULT_RAMP = 100e3, 1e-3
# Shortest long stick, in loading times.
LONG_STICK = 0.2
# Options that a method does not use.
UNUSED = {
    "fast": ("beta2",),
    "exact": ("beta2", "skip_sticks", "end_early"),
    "paper": ("cutoff", "modify", "skip_sticks", "end_early"),
}


@dataclass(frozen=True)
class Until:
    """Stopping rule: a run lasts until its shares of time in stick, slip and separation are certain enough.

    The run is checked at times that grow by a quarter. It ends when, at two successive checks, no share has a
    larger standard error than requested (`observe.standard_errors`), so that one small by chance does not end it.
    Statistics last for at least 20 loading times, the static time in which the drive loads a stuck contact until
    it slips. If steady sliding is proved, or if the drive has moved 1.3 times the static slip distance without
    slip, `least` is sufficient.

    Parameters
    ----------
    standard_error : float
        Largest standard error of a share.
    least, most : float
        Shortest duration of the statistics, s; longest simulated time, s, which limits everything else.

    Raises
    ------
    ValueError
        Names the argument, its value and the allowed values.
    """

    standard_error: float = 0.005
    least: float = 0.3
    most: float = 60.0

    def __post_init__(self) -> None:
        checks.between("standard_error", self.standard_error, 1e-6, 1.0, "1")
        checks.between("most", self.most, 1e-9, 1e6, "s")
        checks.between("least", self.least, 0.0, 1e6, "s")


@dataclass(frozen=True, kw_only=True)
class Options:
    """Numerical options and recording of `simulate`; checked on construction.

    Parameters
    ----------
    method : {"fast", "exact", "paper"}
        "fast": reduced model with symmetric steps of second order. "exact": the same model integrated from event
        to event, about 500 times slower for the paper's rig. "paper": the published scheme (Newmark with the
        friction law of Prakash and Clifton) on all modes.
    numerical_damping : {"published", "none"}, optional
        "published": with the numerical stiffness damping of the published scheme, (beta2 - 1/2) times its step of
        2e-8 s (for a structure its default step), which "fast" and "exact" add to d2. "none": the model as given;
        for "paper" beta2 = 0.5. Default: "published" for "paper", "none" for the others.
    ramp : float, optional
        Duration of the uniform acceleration of P2's clamp to its velocity, s. "fast" ignores a ramp shorter than a
        step, "exact" one below 1e-7 s (times `time_scale`). Default: 1 ms; if the drive runs already there is no
        ramp, and a value is an error.
    settle : float, optional
        Start of the statistics, s since the drive started. Default: 0.1 s after the first slip (for a structure
        times `summary["time_scale"]`); 0 without slip.
    initial : State or tuple, optional
        Displacements and velocities of all modes and contact state; the drive starts or already runs (`State`).
        Default: at rest under the load with T = 0, in stick. The `final_state` of a run with the same scene,
        method and model continues that run: times count from its start, `duration` is added, and the motion has
        the same bits as an uninterrupted run ("exact": to rounding; with skips: if both stop at the same times,
        such as multiples of 1024 samples of 20 microseconds). With another scene or model the run starts at t = 0
        from the modal and contact state. Two functions `modify` count as equal if their models are equal.
    cutoff : float, optional
        Cut-off frequency of the modal truncation, Hz; not for "paper", which keeps all modes. Default: 94 kHz for
        the paper's rig (`contact.reduced.default_cutoff`), and a higher one around the onset
        (`transient.fast.onset`). A structure from matrices keeps the modes that take part in impacts, independent
        of its `fmax`; one from modes keeps all.
    step : float, optional
        Time step, s. Default: 2e-8 for "paper"; for "fast" a step that resolves the contact (1.8e-6 with the
        default rig; for a structure in rigid contact at most a hundredth of the duration,
        `transient.fast.run.default_step`); for "exact", where it is only the grid of the statistics, 1e-6 times
        `time_scale`. "fast" refuses steps above `ReducedModel.largest_step` (2.07e-6 s with the default rig),
        because changes of the contact status add energy. Over 0.2 s of 60 random rigs they add less than 4 % of
        the exchanged energy up to that step (median 0.5 %; with the default step 0.2 %), but 70 % with a step 12 %
        longer. `summary["energy_residual"]` is this share.
    min_stick : float, optional
        Shortest duration of a long stick, s. Default: a fifth of the loading time, the static time in which the
        drive loads a stuck contact until it slips, which depends on the scene alone.
    record : bool or sequence of str
        Series to keep: all, or some of `velocity_B`, `normal_force`, `tangential_force`, `slip_velocity`, `state`.
    sample_rate : float, optional
        Sampling rate of the series, Hz. Values at the times k / sample_rate are interpolated linearly between two
        steps, with the state of the earlier step. If the sampling interval is a whole number of steps, as with the
        default, samples are taken at the steps themselves without interpolation. None: every step. A continued run
        interpolates from the last step of the previous run, if that was recorded at such a rate. Default: 100 kHz,
        for a structure divided by `time_scale`.
    sample_times : array_like, (n,), optional
        Ascending times of the series, s, in place of `sample_rate`. Values are interpolated linearly between
        steps, with the state of the earlier step, and constant before the first and after the last step.
    end_early : bool
        For "fast": complete the run with steady sliding once that is proved to last (`transient.fast.steady`).
        This changes results by about 1e-9 of their size.
    skip_sticks : bool
        For "fast": skip the quiet part of long sticks, which is known in closed form (`transient.fast.skip`). The
        motion changes by rounding, which chaos amplifies. During a skip the maximum normal force is sampled every
        20 microseconds.
    modify : callable, optional
        For "fast" and "exact": function that takes a `contact.reduced.ReducedModel` and returns a modified one,
        for ablation studies (`studies/accuracy/ablation.py`).
    beta2 : float, optional
        For "paper" only, from 0.5 to 1, in place of `numerical_damping`. Default: 0.8, the paper's.

    Raises
    ------
    ValueError
        Names the argument, its value and the allowed values.
    """

    method: str = "fast"
    numerical_damping: str | None = None
    ramp: float | None = None
    settle: float | None = None
    initial: State | tuple[Any, Any, int] | None = None
    cutoff: float | None = None
    step: float | None = None
    min_stick: float | None = None
    record: bool | Sequence[str] = False
    sample_rate: float | str | None = "default"
    sample_times: Any = None
    end_early: bool = True
    skip_sticks: bool = True
    modify: Modify | None = None
    beta2: float | None = None

    def __post_init__(self) -> None:
        values = vars(self)
        for name, limits in BOUNDS.items():
            given = values[name]
            if given is not None and not (isinstance(given, str) and (name, given) == ("sample_rate", "default")):
                values[name] = checks.between(name, given, *limits)
        if self.ramp is not None:
            allowed = "0 or a time from 1e-9 to 1000 s"
            values["ramp"] = checks.number("ramp", self.ramp, allowed, lambda x: x == 0.0 or 1e-9 <= x <= 1e3)
        checks.choice("method", self.method, tuple(UNUSED))
        for name in UNUSED[self.method]:
            if (value := values[name]) is not None and value is not True:
                text = f"{name} = {checks.short(value)}: method {self.method!r} does not use it; leave it out"
                raise InputError(text)
        if self.modify is not None and not callable(self.modify):
            text = f"modify = {checks.short(self.modify)}: it must be a function of a reduced model, or None"
            raise InputError(text)
        if self.numerical_damping is not None:
            checks.choice("numerical_damping", self.numerical_damping, ("published", "none"))
            if self.beta2 is not None:
                both = f"beta2 = {self.beta2:g} with numerical_damping = {self.numerical_damping!r}"
                raise InputError(f"{both}: each sets the other; leave one out")
        values["record"] = _names(self.record)
        for name in ("end_early", "skip_sticks"):
            checks.instance(name, values[name], bool)
        if not (self.initial is None or isinstance(self.initial, State)):
            try:
                values["initial"] = State(*self.initial)
            except TypeError:
                text = "initial: it must be modal displacements, modal velocities and a contact state"
                raise InputError(text) from None
        if self.sample_times is not None:
            values["sample_times"] = _times(self.sample_times, self.record)

    @property
    def law(self) -> dict[str, Any]:
        """Numerical damping and beta2 with their defaults."""
        damping = self.numerical_damping or ("published" if self.method == "paper" else "none")
        undamped = (self.method, self.numerical_damping) == ("paper", "none")
        return {"numerical_damping": damping, "beta2": 0.5 if undamped else self.beta2}


def options_of(options: Options | None, keywords: dict[str, Any]) -> Options:
    """The options that were given, or those of keywords."""
    if options is None:
        return Options(**keywords)
    checks.instance("options", options, Options)
    for name, value in keywords.items():
        text = f"{name} = {checks.short(value)} beside options"
        raise InputError(f"{text}: give all in one, as dataclasses.replace(options, {name}=...)")
    return options


@dataclass(frozen=True, eq=False, kw_only=True)
class RunOptions(Options):
    """Options of one run, checked for its scene and completed with defaults; `initial` is normalised (F = 1).

    If the run ends by `until`, `duration` is its longest duration.
    """

    duration: float
    numerical_damping: str = "none"
    ramp: float = DEFAULT_RAMP
    initial: State | None = None
    record: tuple[str, ...] = ()
    sample_rate: float | None = DEFAULT_RATE
    sample_times: Array | None = None
    until: Until | None = None
    # The run (`stepped.Run`) that this one continues from its end `initial`, and its last row.
    resumed: Any = None
    last_row: Array | None = None

    def __post_init__(self) -> None:
        """Skip the checks, which `Options` has done."""

    @property
    def contact(self) -> int:
        """Contact status at the start."""
        return STICK if self.initial is None else self.initial.contact

    def record_of(self, scene: Normalised, fields: Any, record: Any = None, time: float = 0.0) -> Any:
        """A method's record (1,), by default a new one, with the counters at the start of a run at `time`, s."""
        # A stick shorter than a sampling interval does not interrupt a vibration.
        least = max(LONG_STICK * loading_time(scene), INTERVAL * scene.rig.time_scale)
        least = least if self.min_stick is None else self.min_stick
        settling = SETTLING * scene.rig.time_scale
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


def run_options(scene: Scene, normalised: Normalised, duration: Any, options: Options) -> RunOptions:
    """Check options for a scene; a `ValueError` names the first that does not suit it."""
    until = duration if isinstance(duration, Until) else None
    duration = checks.between("duration", until.most if until else duration, *DURATION)
    if options.method != "fast":
        one_contact(scene.rig, f"method {options.method!r} moves one contact; use 'fast'")
    rate, times = options.sample_rate, options.sample_times
    rate = DEFAULT_RATE / scene.rig.time_scale if isinstance(rate, str) else rate
    if options.record and times is None and rate is not None and duration * rate > 1e8:
        raise InputError(f"sample_rate = {rate:g}: over this duration it must be at most {1e8 / duration:g} Hz")
    checks.between("V / F", normalised.speed_per_load, 1e-12, 1e8, "m/s per N")
    ramp, start = DEFAULT_RAMP if options.ramp is None else options.ramp, 0.0
    values = vars(options) | options.law
    values |= {"duration": duration, "until": until, "sample_rate": rate, "ramp": ramp}
    if isinstance(initial := options.initial, State):
        run = _continued(initial, normalised, values)
        state = _state(initial, scene, normalised)
        started = run.options.ramp if run is not None else 0.0 if state.running else ramp
        if options.ramp is not None and ramp != started and (ramp > 0.0 or not state.running):
            text = "the drive of the initial state has started already; leave it out"
            raise InputError(f"ramp = {ramp:g}: {text}")
        values |= {"ramp": started, "initial": state}
        if run is not None and initial.origin is not None:
            start, values["resumed"], values["last_row"] = initial.time, run, initial.origin[2]
    if times and not (times[0] >= start and times[-1] <= start + duration):
        raise InputError(
            f"sample_times from {times[0]:g} to {times[-1]:g} s: they must be from {start:g} to"
            f" {start + duration:g} s, the run's start and end"
        )
    values["sample_times"] = None if times is None else np.array(times)
    return RunOptions(**values)


def _names(record: Any) -> tuple[str, ...]:
    """Series to keep: all for True, none for False, or those named."""
    if isinstance(record, (bool, np.bool_)):
        return tuple(SERIES) if record else ()
    names = (record,) if isinstance(record, str) else record
    if not isinstance(names, (tuple, list)) or any(name not in SERIES for name in names):
        raise InputError(f"record = {record!r}: it must be a bool or names of series among {', '.join(SERIES)}")
    return tuple(name for name in SERIES if name in names)


def _continued(initial: State, normalised: Normalised, options: dict[str, Any]) -> Any:
    """Return the run that ended in `initial` if it had the same scene, method and model, else None.

    Functions that modify a model are the same if the models that they make now are equal to those of the run.
    """
    scene, run, _ = initial.origin or (None, None, None)
    names, modify = ("method", "numerical_damping", "cutoff", "step", "beta2"), options["modify"]
    if scene != normalised or run is None or any(getattr(run.options, name) != options[name] for name in names):
        return None
    if modify is run.options.modify is None:
        return run
    rig, theta, parts = run.scene.rig, run.scene.theta, [each.name for each in fields(ReducedModel)]
    models = [(modified(reduced_model(rig, theta, cutoff), modify), model) for cutoff, model in run.models]
    same = all(np.array_equal(getattr(a, part), getattr(b, part)) for a, b in models for part in parts)
    return run if same else None


def _times(sample_times: Any, record: Any) -> tuple[float, ...]:
    """Times of a record, s."""
    if not record:
        raise InputError("sample_times: they are for what is recorded, and nothing is; give record = True")
    try:
        times = np.asarray(sample_times, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("sample_times: they must be numbers, s") from None
    if times.ndim != 1 or not np.all(np.isfinite(times)) or np.any(np.diff(times) < 0.0):
        raise InputError(f"sample_times of shape {times.shape}: they must be a row of finite, ascending times, s")
    return tuple(times.tolist())


def seen(scene: Normalised) -> Any:
    """The normalised inclination of a rig, or the structure: equal for a scene and its mirror image."""
    return scene.theta if isinstance(scene.rig, Rig) else scene.rig


def _state(given: State, scene: Scene, normalised: Normalised) -> State:
    """The given state, normalised."""
    q, v, contact = np.asarray(given.displacement), np.asarray(given.velocity), given.contact
    band = modal_structure(scene.rig, scene.theta)
    own, fewer = band.motion, len(band.frequency)
    modes = len(own.frequency)
    shapes = {(modes,), (modes + own.static,), (fewer,)}
    for name, part in (("displacements", q), ("velocities", v)):
        if part.shape not in shapes or part.dtype.kind not in "iuf" or not np.all(np.abs(part) < 1e50):
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
    if given.statuses is not None:
        statuses = np.asarray(given.statuses)
        if statuses.shape != (own.contacts,) or not np.isin(statuses, (0, 1, 2)).all():
            text = f"they must be {own.contacts}, each 0 (separation), 1 (stick) or 2 (slip)"
            raise InputError(f"initial: statuses {checks.short(given.statuses)}: {text}")
    return State(q, v, int(contact), given.running, given.statuses)
