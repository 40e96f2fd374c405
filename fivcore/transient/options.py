"""Options of a run, checked once and frozen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fivcore import checks
from fivcore.contact.reduced import TERMINATIONS
from fivcore.jit import Array
from fivcore.rig import Scene
from fivcore.transient.moving_contact import ContactMotion
from fivcore.transient.normalised import Normalised, State
from fivcore.transient.record import names_of, times_of
from fivcore.transient.switches import METHODS, switches

# Largest number of samples in a record.
MOST_SAMPLES = 1e8
BOUNDS = {
    "duration": (1e-9, 1e6, "s"),
    "settle": (0.0, 1e6, "s"),
    "min_stick": (1e-9, 1e6, "s"),
    "step": (1e-12, 1.0, "s"),
    "cutoff": (1.0, 1e12, "Hz"),
    "sample_rate": (1e-3, 1e9, "Hz"),
}
REQUIRED = ("duration", "sample_rate")


@dataclass(frozen=True, eq=False)
class Options:
    """Options of a run as in `fivcore.simulate`; `skip` is its `leap`, and `initial` is normalised (F = 1)."""

    duration: float
    method: str = "fast"
    ramp: float = 1e-3
    settle: float | None = None
    initial: State | None = None
    contact_motion: int = 0
    cutoff: float | None = None
    termination: str = "absorbing"
    step: float | None = None
    min_stick: float | None = None
    record: tuple[str, ...] = ()
    sample_rate: float = 100e3
    sample_times: Array | None = None
    end_early: bool = True
    skip: bool = True
    relaxation_time: float | None = None
    cross_terms: bool = True
    beta2: float | None = None

    @property
    def sampling_rate(self) -> float | None:
        """Rate at which rows of a record are taken, Hz; infinite: in every step; None: not at all."""
        if not self.record:
            return None
        # Sample times lie between two steps of the method.
        return self.sample_rate if self.sample_times is None else np.inf


def options_for(scene: Scene, normalised: Normalised, arguments: dict[str, Any]) -> Options:
    """Check the arguments of `fivcore.simulate`, by name; a `ValueError` names the first that is wrong."""
    get = arguments.get
    numbers: dict[str, Any] = {
        name: checks.between(name, get(name), *limits)
        for name, limits in BOUNDS.items()
        if name in REQUIRED or get(name) is not None
    }
    duration, sample_rate = numbers["duration"], numbers["sample_rate"]
    ramp = checks.number(
        "ramp", get("ramp"), "0 or a time from 1e-9 to 1000 s", lambda x: x == 0.0 or 1e-9 <= x <= 1e3
    )
    method = checks.choice("method", get("method"), METHODS)
    termination = checks.choice("termination", get("termination"), TERMINATIONS)
    law = switches(method, termination, *(get(name) for name in ("relaxation_time", "cross_terms", "beta2")))
    directions = "0, -1 (towards P2's clamp) or 1 (away)"
    motion = int(checks.number("contact_motion", get("contact_motion"), directions, lambda x: x in (-1, 0, 1)))
    record = names_of(get("record"))
    for name in ("end_early", "leap"):
        checks.instance(name, get(name), bool)
    if record and get("sample_times") is None and duration * sample_rate > MOST_SAMPLES:
        most = MOST_SAMPLES / duration
        raise ValueError(f"sample_rate = {sample_rate:g}: over this duration it must be at most {most:g} Hz")
    if not 1e-12 <= normalised.speed_per_load <= 1e8:
        raise ValueError(
            f"V / F = {normalised.speed_per_load:g}: it must be from 1e-12 to 1e+08 m/s per N to be resolved"
        )
    initial = None if get("initial") is None else _state(get("initial"), scene, normalised)
    times = None if get("sample_times") is None else times_of(get("sample_times"), record, duration)
    if motion:
        ContactMotion(normalised, ramp, motion).check(duration)
        if method == "exact":
            raise ValueError(f"contact_motion = {motion}: for method 'exact' it must be 0")
    if method == "paper" and "cutoff" in numbers:
        raise ValueError(f"cutoff = {numbers['cutoff']:g}: the published scheme keeps all modes; leave it out")
    return Options(
        method=method, ramp=ramp, initial=initial, contact_motion=motion, termination=termination, record=record,
        sample_times=times, end_early=arguments["end_early"], skip=arguments["leap"], **numbers, **law,
    )  # fmt: skip


def _state(initial: Any, scene: Scene, normalised: Normalised) -> State:
    """The given state, normalised."""
    try:
        q, v, contact = vars(initial).values() if isinstance(initial, State) else initial
        q, v = np.asarray(q), np.asarray(v)
    except (TypeError, ValueError):
        raise ValueError("initial: it must be modal displacements, modal velocities and a contact state") from None
    modes = 3 * scene.rig.p1.elements + 1 + 3 * scene.rig.p2.elements
    for name, part in (("displacements", q), ("velocities", v)):
        if part.shape != (modes,) or part.dtype.kind not in "iuf" or not np.all(np.abs(part) < 1e50):
            text = f"initial: modal {name} of shape {part.shape}: they must be {modes} finite numbers below 1e50"
            raise ValueError(text)
    if not isinstance(contact, (int, np.integer)) or isinstance(contact, bool) or contact not in (0, 1, 2):
        raise ValueError(f"initial: contact state {contact!r}: it must be 0 (separation), 1 (stick) or 2 (slip)")
    if normalised.sense < 0:
        raise ValueError("initial: with V < 0 give the mirrored scene (scene.mirrored()) and its state")
    return State(q.astype(float) / normalised.load, v.astype(float) / normalised.load, int(contact))
