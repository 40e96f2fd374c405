"""Systems of a few modes and a contact as plain arrays, simulated by the three methods."""

from dataclasses import dataclass, field
from typing import Any
from unittest import mock

import numpy as np

from fivcore import Rig
from fivcore.beams.modes import propagator
from fivcore.contact.reduced import ReducedModel
from fivcore.transient import exact, published
from fivcore.transient.fast import kernel, layout
from fivcore.transient.fast.run import aligned
from fivcore.transient.fast.skip import NO_TABLES, workspace_for
from fivcore.transient.fast.solver import Solver, put, take
from fivcore.transient.normalised import Normalised, State
from fivcore.transient.options import RunOptions
from fivcore.transient.statistics import ENERGIES, SAMPLE, SEPARATION, SLIP, begin, count_in

# Columns of a record: time, normal and tangential force, slip velocity and contact state.
TIME, N_OF, T_OF, SPEED_OF, STATE_OF = 0, 2, 3, 4, 5
# Steps between two samples of `fast`.
SAMPLED = 10


@dataclass
class System:
    """Modes of unit mass under constant forces f, their gap shapes, and the contact element (K, C), if any.

    The load is one newton: a mode without stiffness must carry it, f = -normal.
    """

    k: Any
    normal: Any
    tangential: Any
    f: Any
    q: Any
    v: Any
    mu: float
    K: Any = field(default_factory=lambda: np.zeros((2, 2)))
    C: Any = field(default_factory=lambda: np.zeros((2, 2)))
    c: Any = 0.0
    V: float = 0.0
    contact: int = SLIP
    u: tuple[float, float] = (0.0, 0.0)
    # Friction at the start, for the published scheme; `held`: contact bears the load, so that nothing accelerates.
    last_T: float = 0.0
    held: bool = False

    def __post_init__(self):
        for name in ("k", "normal", "tangential", "f", "q", "v", "K", "C"):
            setattr(self, name, np.array(getattr(self, name), dtype=float))
        self.c = self.c + 0.0 * self.k

    @property
    def model(self):
        none, kept = np.zeros(len(self.k)), np.ones(len(self.k), dtype=bool)
        return ReducedModel(self.k, self.c, self.normal, self.tangential, none, none, self.f, kept, self.K, self.C)


def fill(record, **given):
    for name, value in given.items():
        record[name] = value


class Fast:
    """A running simulation of a system by the kernel of `fast`."""

    def __init__(self, system, step):
        self.model, self.step = system.model, step
        rest, normal, tangential = self.model.static_equilibrium, system.normal, system.tangential
        self.solver = Solver(self.model, step)
        u = np.array(system.u)
        if self.model.K.any() and system.contact != SEPARATION:
            # The same force of the element that impulses need.
            u = self.solver.contact.flexibility @ (self.model.K @ u)
        self.record = record = begin(self.solver.record.copy(), 0.0, 0.0, 1.0, system.contact)
        (p_rest, T_rest), away = self.solver.at_rest, system.q - rest
        fill(record, mu=system.mu, kinetic=system.mu, contact=system.contact, speed=system.V)
        fill(record, threshold=np.inf, u_N=u[0], u_T=u[1])
        fill(record, anchor=u[1] + tangential @ away + T_rest, p_rest=p_rest, T_rest=T_rest)
        # Impulses come in the middle of a step.
        x, v = self._moved(away, system.v, 0.5 * step)
        blocks = self.solver.blocks.copy()
        put(blocks, self.solver.places, layout.Q, x)
        put(blocks, self.solver.places, layout.V, v)
        self.modes = aligned(blocks).ravel()
        fill(record, g_N=normal @ x, g_T=tangential @ x, v_N=normal @ v, v_T=tangential @ v)
        self.first = self.energy()

    def _moved(self, x, v, time):
        a, b, c, d = propagator(self.model.stiffness, self.model.damping, time)
        return a * x + b * v, c * x + d * v

    def run(self, steps):
        """Continue; return a record of each step."""
        record, now = self.record, int(self.record["now"][0])
        last = now + steps
        fill(record, last=last, next_row=now, row_every=1, stick_room=steps, samples=0, rows=0, sticks=0)
        sample = -(-now // SAMPLED) * SAMPLED
        fill(record, sample_every=SAMPLED, next_sample=sample, energy_every=SAMPLED, next_energy=sample)
        rows, samples = np.empty((steps, 6)), np.empty((count_in(now, last, SAMPLED), SAMPLE))
        sticks = np.empty((steps, 2))
        kernel.advance(record, self.modes, samples, rows, sticks, NO_TABLES, workspace_for(NO_TABLES), (), ())
        assert (record["now"], record["rows"], record["samples"]) == (last, steps, len(samples))
        return rows

    def _state(self):
        """Displacements about rest and velocities at the start of the step."""
        blocks = self.modes.reshape(self.solver.blocks.shape)
        x, v = (take(blocks, self.solver.places, row) for row in (layout.Q, layout.V))
        return self._moved(x, v, -0.5 * self.step)

    @property
    def q(self):
        return self._state()[0] + self.model.static_equilibrium

    def energy(self):
        """Energy of modes, load and element."""
        model, u = self.model, np.array([self.record["u_N"][0], self.record["u_T"][0]])
        (x, v), K = self._state(), self.solver.contact.stiffness
        return 0.5 * np.sum(v**2 + model.stiffness * x**2) + model.normal @ x + 0.5 * u @ K @ u

    def imbalance(self):
        """Work of the drive less stored energy and dissipation by damping, friction, termination and impacts."""
        work, *lost = (float(self.record[name][0]) for name in ENERGIES)
        return work + self.first - self.energy() - sum(lost)


def by_fast(system, duration, step, every=8):
    """Times and displacements at intervals of some steps, and the record of all steps."""
    run, times, places, rows = Fast(system, step), [], [], []
    for _ in range(int(duration / step / every)):
        rows.append(run.run(every))
        times.append(int(run.record["now"][0]) * step)
        places.append(run.q)
    return np.array(times), np.array(places), np.concatenate(rows)


def by_exact(system, duration, step, every=8):
    """Simulation from event to event; the system replaces the rig from which the method reads its model."""
    speed = system.V if system.V else 1e-300
    scene = Normalised(Rig(), 0.0, speed, system.mu, 1.0, 1.0)
    given = {"initial": State(system.q, system.v, system.contact), "ramp": 0.0, "settle": 0.0, "step": step}
    options = RunOptions(duration=duration, method="exact", record=("state",), sample_rate=1.0 / step, **given)
    rows, times, places = [], [], []
    with (
        mock.patch.object(exact, "reduced_model", return_value=system.model),
        mock.patch.object(exact, "residual_gaps", return_value=np.array(system.u)),
    ):
        run = exact.ExactRun(scene, options)
        run._length = every
        while not run.done:
            run.advance()
            rows += [segment.rows for segment in run.segments]
            times.append(run.motion[-3])
            places.append(run.state()[0] + run.model.static_equilibrium)
    return np.array(times), np.array(places), np.concatenate(rows)


def by_paper(system, duration, step, every=1, b=published.BETA2, tau=None):
    """The published scheme, without an element; displacements along x follow from the slip velocity."""
    rows, _ = stepped(system, int(duration / step), step, b, 10.0 * step if tau is None else tau)
    t = rows[:, TIME]
    x = system.tangential @ system.q + np.cumsum(rows[:, SPEED_OF]) * step + system.V * t
    return t[every - 1 :: every], np.outer(x, system.tangential)[every - 1 :: every], rows


METHODS = {"fast": by_fast, "exact": by_exact, "paper": by_paper}


def stepped(system, steps, dt, b=published.BETA2, tau=published.TAU):
    """A record of every step of the published scheme's kernel, and the final q."""
    k, c, normal, tangential, f = system.k, system.c, system.normal, system.tangential, system.f
    q, v = system.q.copy(), system.v
    inverse = 1.0 / (1.0 + b * dt * c)
    scale = dt**2 * (b + 0.5)
    pairs = (normal, normal), (normal, tangential), (tangential, tangential)
    W = [scale * one @ (other * inverse) for one, other in pairs]
    vs = v if system.held else v + dt * (1.0 - b) * (f - k * q - c * v)
    a = (f - k * q - c * vs) * inverse
    reach = q + dt * (vs + b * dt * a) + 0.5 * dt**2 * a
    record = begin(np.zeros(1, published.SCENE), 0.0, 0.0, 1.0, SLIP)
    fill(record, dt=dt, b=b, r=dt / tau, mu=system.mu, speed=system.V, gap_N=normal @ reach)
    fill(record, kinetic=system.mu)
    fill(record, W_NN=W[0], W_NT=W[1], W_TT=W[2], gap_T=tangential @ reach, last_gT=tangential @ q)
    fill(record, last_T=system.last_T, contact=SLIP, sample_every=steps, row_every=1, stick_room=steps)
    rows, samples = np.empty((steps, 6)), np.empty((count_in(0, steps, steps), SAMPLE))
    modes = (k, c, inverse, normal, tangential, 1.0 * (np.arange(len(k)) == 0))
    sticks = np.empty((steps, 2))
    published.advance(record, steps, modes, f, q, vs, a, reach, samples, rows, sticks)
    return rows, q
