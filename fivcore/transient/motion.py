"""A run from its arguments to its result, as a generator that asks for steps to be taken (`transient.bench`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import checks
from fivcore.contact.reduced import TERMINATIONS
from fivcore.errors import ContactError, DivergenceError
from fivcore.jit import Array
from fivcore.rig import Rig, Scene
from fivcore.transient.bench import Running, Stretch
from fivcore.transient.drive import Canonical, State
from fivcore.transient.exact import ExactRun
from fivcore.transient.fast import FastRun
from fivcore.transient.moving_contact import ContactMotion
from fivcore.transient.published import PaperRun
from fivcore.transient.record import Record, names_of, times_of
from fivcore.transient.spectra import Listener
from fivcore.transient.statistics import FIRST_SLIP, LEAST_STICK, SETTLED_FROM, STICK_START, WORK, Tally
from fivcore.transient.summary import Outcome, summarise
from fivcore.transient.switches import METHODS, switches

# Statistics start this long after the first slip, s.
SETTLING = 0.1
# Samples that a record may have.
MOST_SAMPLES = 1e8
# A run has diverged when its energy is that many times what it was given.
DIVERGED = 1e3


@dataclass(frozen=True, eq=False)
class Transient:
    """Motion of one scene.

    Attributes
    ----------
    scene : Scene
    summary : dict
        The figures listed in `fivcore.transient.summary.summarise`.
    time : ndarray, (n,)
        s since the drive started; this and the following only as far as they were recorded.
    velocity_B : ndarray, (n,)
        Velocity of B along x, m/s.
    normal_force, tangential_force : ndarray, (n,)
        Contact force on P1, N.
    slip_velocity : ndarray, (n,)
        Velocity along x of P1's surface relative to P2's, m/s.
    state : ndarray of int8, (n,)
        0 separation, 1 stick, 2 slip.
    """

    scene: Scene
    summary: dict[str, Any]
    time: Array = field(default_factory=lambda: np.zeros(0))
    velocity_B: Array = field(default_factory=lambda: np.zeros(0))
    normal_force: Array = field(default_factory=lambda: np.zeros(0))
    tangential_force: Array = field(default_factory=lambda: np.zeros(0))
    slip_velocity: Array = field(default_factory=lambda: np.zeros(0))
    state: NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, dtype=np.int8))


def motion_of(
    scene: Scene,
    duration: float,
    method: str,
    *,
    ramp: float,
    settle: float | None,
    initial: State | tuple[Any, Any, int] | None,
    contact_motion: int,
    cutoff: float | None,
    termination: str,
    step: float | None,
    min_stick: float | None,
    record: bool | Sequence[str],
    sample_rate: float,
    sample_times: Array | None,
    end_early: bool,
    relaxation_time: float | None,
    cross_terms: bool,
    beta2: float | None,
    leap: bool,
) -> Running[Transient]:
    """Check what is asked for and run it; arguments and errors are those of `fivcore.simulate`."""
    checks.instance("scene", scene, Scene)
    duration = checks.between("duration", duration, 1e-9, 1e6, "s")
    ramp = checks.number("ramp", ramp, "0 or a time from 1e-9 to 1000 s", lambda x: x == 0.0 or 1e-9 <= x <= 1e3)
    settle = None if settle is None else checks.between("settle", settle, 0.0, 1e6, "s")
    min_stick = None if min_stick is None else checks.between("min_stick", min_stick, 1e-9, 1e6, "s")
    step = None if step is None else checks.between("step", step, 1e-12, 1.0, "s")
    cutoff = None if cutoff is None else checks.between("cutoff", cutoff, 1.0, 1e12, "Hz")
    sample_rate = checks.between("sample_rate", sample_rate, 1e-3, 1e9, "Hz")
    method = checks.choice("method", method, METHODS)
    termination = checks.choice("termination", termination, TERMINATIONS)
    asked = switches(method, termination, relaxation_time, cross_terms, beta2)
    checks.number(
        "contact_motion", contact_motion, "0, -1 (towards P2's clamp) or 1 (away)", lambda x: x in (-1, 0, 1)
    )
    contact_motion = int(contact_motion)
    names = names_of(record)
    checks.instance("end_early", end_early, bool)
    checks.instance("leap", leap, bool)
    if names and sample_times is None and duration * sample_rate > MOST_SAMPLES:
        most = MOST_SAMPLES / duration
        raise ValueError(f"sample_rate = {sample_rate:g}: over this duration it must be at most {most:g} Hz")
    canonical = Canonical.of(scene)
    if not 1e-12 <= canonical.pace <= 1e8:
        raise ValueError(f"V / F = {canonical.pace:g}: it must be from 1e-12 to 1e+08 m/s per N to be resolved")
    state = None if initial is None else _checked_state(initial, scene, canonical)
    tally = Tally().start(1, settle, SETTLING, min_stick)
    times = None if sample_times is None else times_of(sample_times, names, duration)
    # What is kept at given times lies between two steps of the method.
    rate = None if not names else sample_rate if times is None else np.inf
    motion = ContactMotion(canonical, ramp, contact_motion) if contact_motion else None
    if motion is not None:
        motion.check(duration)
        if method == "exact":
            raise ValueError(f"contact_motion = {contact_motion}: for method 'exact' it must be 0")
    common: dict[str, Any] = {
        "ramp": ramp,
        "step": step,
        "initial": state,
        "tally": tally,
        "sample_rate": rate,
    }
    if method != "exact":
        common["motion"] = motion
    try:
        run: Any
        if method == "paper":
            if cutoff is not None:
                raise ValueError(f"cutoff = {cutoff:g}: the published scheme keeps all modes; leave it out")
            run = PaperRun(canonical, **common, **asked)
        else:
            kind = FastRun if method == "fast" else ExactRun
            if method == "fast":
                common |= {"end_early": end_early, "leap": leap}
            run = kind(canonical, cutoff=cutoff, termination=termination, **common, **asked)
        return (yield from _watch(scene, canonical, run, tally, Record(canonical, names, times), duration, ramp))
    except (ContactError, DivergenceError) as error:
        raise type(error)(f"{error}; {_named(scene)}", scene) from None


def _watch(
    scene: Scene, canonical: Canonical, run: Any, tally: Tally, record: Record, duration: float, ramp: float
) -> Running[Transient]:
    """Let a run go through, listen to it, and put it into the scene's own units."""
    listener = Listener(run.rate)
    steps = max(round(duration / run.step), 1)
    sticks: list[Array] = []
    late, early = np.full(2, np.nan), False
    floor = 1e-150 * min(canonical.pace, 1.0)
    model = run.model
    given = abs(run.stored_energy()) + float(np.sum(model.stiffness * model.rest**2))
    given += canonical.pace**2 * float(np.sum(model.inertia**2))
    for chunk in run.chunks(steps):
        if isinstance(chunk, Stretch):
            yield chunk
            continue
        if isinstance(chunk, np.ndarray):
            record.add(chunk)
            continue
        finite = run.calm(floor)
        if not finite or not run.stored_energy() <= DIVERGED * (given + abs(tally.sums[WORK])):
            now = chunk.t[-1] if len(chunk.t) else 0.0
            raise DivergenceError(f"the motion has blown up at t = {now:.6g} s")
        sticks.append(chunk.sticks)
        heard_sticks, unsure = _stuck(tally, chunk.sticks, chunk.t)
        listener.hear(chunk.t, chunk.velocity, heard_sticks, unsure, float(tally.moments[SETTLED_FROM]))
        if chunk.further:
            early = True
            listener.hold(chunk.t[-1], chunk.velocity[-1], chunk.further)
        last = chunk.slip_rate[np.searchsorted(chunk.t, 0.75 * duration - chunk.further / run.rate) :]
        if len(last):
            late = np.array([np.fmin(late[0], last.min()), np.fmax(late[1], last.max())])
    listener.close()
    steadiness = float(0.5 * (late[1] - late[0]) / canonical.pace)
    outcome = Outcome(steps * run.step, ramp, np.concatenate(sticks), steadiness, run.released_energy(), early)
    summary = summarise(canonical, tally, listener, outcome)
    return Transient(scene, summary, **record.whole())


def _stuck(tally: Tally, ended: Array, t: Array) -> tuple[Array, float]:
    """Long sticks of a stretch, a running one included, and from when on it is not known yet."""
    moments = tally.moments
    if np.isnan(moments[FIRST_SLIP]):
        return np.array([[0.0, np.inf]]), np.inf
    begun = moments[STICK_START]
    if not begun >= 0.0:
        return ended, np.inf
    if len(t) and t[-1] - begun >= moments[LEAST_STICK]:
        return np.vstack([ended, [begun, np.inf]]), np.inf
    return ended, float(begun)


def _named(scene: Scene) -> str:
    """A scene in one line; its rig only where it is not the paper's."""
    rig = "" if scene.rig == Rig() else f", rig = {scene.rig}"
    return f"scene V = {scene.V:g} m/s, theta = {scene.theta:g} degrees, mu = {scene.mu:g}, F = {scene.F:g} N{rig}"


def _checked_state(initial: Any, scene: Scene, canonical: Canonical) -> State:
    """The given state in canonical form."""
    try:
        q, v, contact = (
            (initial.displacement, initial.velocity, initial.contact) if isinstance(initial, State) else initial
        )
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
    q, v = q.astype(float), v.astype(float)
    if canonical.sense < 0:
        raise ValueError("initial: with V < 0 give the mirrored scene (scene.mirrored()) and its state")
    return State(q / canonical.load, v / canonical.load, int(contact))
