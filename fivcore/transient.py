"""The motion of a scene in time: `simulate` and what it returns."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import checks
from fivcore.contact_motion import ContactMotion
from fivcore.drive import Canonical, State
from fivcore.errors import ContactError, DivergenceError
from fivcore.exact import ExactRun
from fivcore.fast import FastRun
from fivcore.kernel import Array
from fivcore.listener import Listener
from fivcore.published import PaperRun
from fivcore.reduced import TERMINATIONS
from fivcore.rig import Rig, Scene
from fivcore.summary import Outcome, summarise
from fivcore.tally import FIRST_SLIP, LEAST_STICK, SETTLED_FROM, STICK_START, WORK, Tally
from fivcore.uniqueness import METHODS

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
        The figures listed in `fivcore.summary.summarise`.
    time : ndarray, (n,)
        s since the drive started; this and the following only where `record` was true.
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


def simulate(
    scene: Scene,
    duration: float,
    method: str = "fast",
    *,
    ramp: float = 1e-3,
    settle: float | None = None,
    initial: State | tuple[Any, Any, int] | None = None,
    contact_motion: int = 0,
    cutoff: float | None = None,
    termination: str = "absorbing",
    step: float | None = None,
    min_stick: float | None = None,
    record: bool = False,
    sample_rate: float = 100e3,
    end_early: bool = True,
) -> Transient:
    """Simulate a scene from the start of its drive.

    Parameters
    ----------
    scene : Scene
    duration : float
        Simulated time, s.
    method : {"fast", "exact", "paper"}
        "fast": the reduced model in symmetric steps of second order (default); "exact": the same model from
        event to event, some two hundred times slower; "paper": the published scheme on all modes.
    ramp : float
        Time in which the clamp of P2 reaches its velocity, uniformly accelerated, s.
    settle : float, optional
        When statistics start, s since the drive started. Default: 0.1 s after the first slip, and for a scene
        that never slips its start.
    initial : State or tuple, optional
        Modal displacements and velocities of all modes and the contact state. Default: at rest under the
        load, T = 0, stuck.
    contact_motion : {0, -1, 1}
        0: the contact point stays at the same distance from P2's clamp. -1, 1: P2 slides under C, and the
        point of P2 below C moves towards P2's clamp or away from it (`fivcore.contact_motion`).
    cutoff : float, optional
        Modes above are represented by the termination, Hz; not for "paper", which keeps all. Default: 75 kHz
        for the paper's rig (`fivcore.reduced.default_cutoff`), with more for the onset (`fivcore.fast`).
    termination : {"absorbing", "elastic", "none"}
        What stands for the modes above the cut-off (`fivcore.reduced`).
    step : float, optional
        Time step, s. Default: 2e-8 for "paper"; what the contact needs for "fast" (1.2e-6 with the default rig);
        for "exact" only the grid on which statistics are taken, 1e-6.
    min_stick : float, optional
        What counts as a long stick, s. Default: a fifth of the time to the first slip.
    record : bool
        Keep time series.
    sample_rate : float
        Of what is kept, Hz.
    end_early : bool
        For "fast" with a frozen contact point: where it is proved that a scene slides steadily for good
        (`fivcore.settled`), fill in the rest of the run instead of stepping through it. Figures differ by
        some 1e-9 of their size, line and coherence by more where statistics begin so late that the velocity
        of B has less than 1e-7 V left; `summary["settled_early"]` tells. False: take every step.

    Returns
    -------
    Transient

    Raises
    ------
    ValueError
        For a bad argument, naming it, its value and what is allowed.
    ContactError
        Where the contact force of the method is not unique; found before the first step.
    DivergenceError
        Where the motion leaves the range of numbers.
    """
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
    checks.number(
        "contact_motion", contact_motion, "0, -1 (towards P2's clamp) or 1 (away)", lambda x: x in (-1, 0, 1)
    )
    contact_motion = int(contact_motion)
    checks.instance("record", record, bool)
    checks.instance("end_early", end_early, bool)
    if record and duration * sample_rate > MOST_SAMPLES:
        most = MOST_SAMPLES / duration
        raise ValueError(f"sample_rate = {sample_rate:g}: over this duration it must be at most {most:g} Hz")
    canonical = Canonical.of(scene)
    if not 1e-12 <= canonical.pace <= 1e8:
        raise ValueError(f"V / F = {canonical.pace:g}: it must be from 1e-12 to 1e+08 m/s per N to be resolved")
    state = None if initial is None else _checked_state(initial, scene, canonical)
    tally = Tally().start(1, settle, SETTLING, min_stick)
    rate = sample_rate if record else None
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
            run = PaperRun(canonical, **common)
        else:
            kind = FastRun if method == "fast" else ExactRun
            if method == "fast":
                common["end_early"] = end_early
            run = kind(canonical, cutoff=cutoff, termination=termination, **common)
        return _watch(scene, canonical, run, tally, duration, ramp)
    except (ContactError, DivergenceError) as error:
        raise type(error)(f"{error}; {_named(scene)}", scene) from None


class Record:
    """Series of a run, gathered column by column in the scene's own units.

    Seconds of motion at every step are tens of MB: they are held once, whatever else is at work meanwhile.
    """

    def __init__(self, canonical: Canonical) -> None:
        F, along = canonical.load, canonical.load * canonical.sense
        # As the columns of `Chunk.rows` come; the time is the same in all units.
        self._factors = {
            "time": 1.0,
            "velocity_B": along,
            "normal_force": F,
            "tangential_force": along,
            "slip_velocity": along,
        }
        self._pieces: dict[str, list[NDArray[Any]]] = {name: [] for name in (*self._factors, "state")}

    def add(self, rows: Array) -> None:
        """Take the next rows."""
        if len(rows):
            for column, (name, factor) in enumerate(self._factors.items()):
                self._pieces[name].append(factor * rows[:, column])
            self._pieces["state"].append(rows[:, -1].astype(np.int8))

    def whole(self) -> dict[str, Any]:
        """Each series in one piece; nothing where nothing was recorded."""
        # One by one, so that of all but one there is only one copy.
        return {name: np.concatenate(pieces) for name in [*self._pieces] if (pieces := self._pieces.pop(name))}


def _watch(scene: Scene, canonical: Canonical, run: Any, tally: Tally, duration: float, ramp: float) -> Transient:
    """Let a run go through, listen to it, and put it into the scene's own units."""
    listener = Listener(run.rate)
    record = Record(canonical)
    steps = max(round(duration / run.step), 1)
    sticks: list[Array] = []
    late, early = np.full(2, np.nan), False
    floor = 1e-150 * min(canonical.pace, 1.0)
    model = run.model
    given = abs(run.stored_energy()) + float(np.sum(model.stiffness * model.rest**2))
    given += canonical.pace**2 * float(np.sum(model.inertia**2))
    for chunk in run.chunks(steps):
        finite = run.calm(floor)
        if not finite or not run.stored_energy() <= DIVERGED * (given + abs(tally.sums[WORK])):
            now = chunk.t[-1] if len(chunk.t) else 0.0
            raise DivergenceError(f"the motion has blown up at t = {now:.6g} s")
        record.add(chunk.rows)
        sticks.append(chunk.sticks)
        heard_sticks, unsure = _stuck(tally, chunk.sticks, chunk.t)
        listener.hear(chunk.t, chunk.velocity, heard_sticks, unsure, float(tally.moments[SETTLED_FROM]))
        if chunk.further:
            early = True
            listener.hold(chunk.t[-1], chunk.velocity[-1], chunk.further)
        last = chunk.slip_rate[chunk.t + chunk.further / run.rate >= 0.75 * duration]
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
