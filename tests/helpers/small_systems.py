"""A few modes and a contact given as plain arrays, stepped by the kernels that run the rig."""

import numpy as np

from fivcore.beams.modes import propagator
from fivcore.contact.reduced import ReducedModel
from fivcore.transient import fast_kernel, published
from fivcore.transient import fast_scene as at
from fivcore.transient.fast import aligned
from fivcore.transient.fast_scene import lanes_for
from fivcore.transient.fast_solver import Solver, put, take
from fivcore.transient.published import BETA2, TAU
from fivcore.transient.record import SAMPLE, count_in
from fivcore.transient.statistics import ENERGIES, begin
from tests.helpers.transient_reference import SEPARATION, SLIP

# Steps between two samples.
SAMPLED = 10


class Small:
    """A few modes and a contact element under constant modal forces, by the kernel of `method="fast"`.

    The kernel's load presses with one newton: a mode without stiffness must carry it, f = -normal.
    """

    def __init__(
        self, k, normal, tangential, f, K, C, *, mu, step, q, v, c=0.0, V=0.0, contact=SLIP, u=(0.0, 0.0)
    ):
        k, normal, tangential, f, q, v = (np.array(x, dtype=float) for x in (k, normal, tangential, f, q, v))
        none = np.zeros(len(k))
        kept = np.ones(len(k), dtype=bool)
        self.model = ReducedModel(
            k, c + none, normal, tangential, none, none.copy(), f, kept, np.array(K), np.array(C)
        )
        rest = self.model.rest
        self.solver = Solver(self.model, mu, step)
        self.mu, self.V, self.step = mu, V, step
        u = np.array(u)
        if self.model.K.any() and contact != SEPARATION:
            # The same force of the element that impulses need.
            u = np.linalg.solve(self.solver.impulse.stiffness, self.model.K @ u)
        self.record = record = begin(self.solver.record.copy(), 0.0, 0.0, 1.0)
        record["contact"], record["speed"], record["threshold"] = contact, V, np.inf
        record["u_N"], record["u_T"] = u
        record["anchor"] = u[1] + tangential @ (q - rest) + self.solver.at_rest[1]
        record["p_rest"], record["T_rest"] = self.solver.at_rest
        # Impulses come in the middle of a step.
        x, v = self._moved(q - rest, v, 0.5 * step)
        blocks = self.solver.blocks.copy()
        put(blocks, at.Q, x)
        put(blocks, at.V, v)
        self.modes = aligned(blocks.size)
        self.modes[:] = blocks.ravel()
        record["g_N"], record["g_T"] = normal @ x, tangential @ x
        record["v_N"], record["v_T"] = normal @ v, tangential @ v
        self.first = self.energy()

    def _moved(self, x, v, time):
        a, b, c, d = propagator(self.model.stiffness, self.model.damping, time)
        return a * x + b * v, c * x + d * v

    def run(self, steps):
        """Go on; returns a record of each step: t, -, N, T, slip velocity, state."""
        record, now = self.record, int(self.record["now"][0])
        last = now + steps
        record["last"], record["next_row"], record["row_every"] = last, now, 1
        record["sample_every"], record["next_sample"] = SAMPLED, -(-now // SAMPLED) * SAMPLED
        record["samples"] = record["rows"] = record["sticks"] = 0
        record["stick_room"] = steps
        rows, samples = np.empty((steps, 6)), np.empty((count_in(now, last, SAMPLED), SAMPLE))
        sticks, no_skip = np.empty((steps, 2)), np.empty(0)
        fast_kernel.advance(record, *lanes_for(record), self.modes, samples, rows, sticks, no_skip, no_skip)
        assert (record["now"], record["rows"], record["samples"]) == (last, steps, len(samples))
        return rows

    def follow(self, duration, every):
        """Time and displacements every so many steps, and the record of all."""
        times, places, rows = [], [], []
        for _ in range(int(duration / self.step / every)):
            rows.append(self.run(every))
            times.append(int(self.record["now"][0]) * self.step)
            places.append(self.q)
        return np.array(times), np.array(places), np.concatenate(rows)

    def _state(self):
        """Displacements about rest and velocities at the start of the step."""
        blocks, count = self.modes.reshape(self.solver.blocks.shape), len(self.model.rest)
        return self._moved(take(blocks, at.Q, count), take(blocks, at.V, count), -0.5 * self.step)

    @property
    def q(self):
        return self._state()[0] + self.model.rest

    def energy(self):
        """Of modes, load and element."""
        model, u = self.model, np.array([self.record["u_N"][0], self.record["u_T"][0]])
        (x, v), K = self._state(), self.solver.impulse.stiffness
        return 0.5 * np.sum(v**2 + model.stiffness * x**2) + model.normal @ x + 0.5 * u @ K @ u

    def imbalance(self):
        """Work in less what is stored, damped, rubbed, and lost in termination and impacts."""
        work, *lost = (float(self.record[name][0]) for name in ENERGIES)
        return work + self.first - self.energy() - sum(lost)


def stepped(
    stiffness,
    damping,
    normal,
    tangential,
    f,
    *,
    mu,
    dt,
    steps,
    q,
    v,
    b=BETA2,
    tau=TAU,
    V=0.0,
    last_T=0.0,
    held=False,
):
    """The scheme on a few modes given as plain arrays: a record of every step and the final q.

    `held`: at the start contact bears the load, so that nothing accelerates.
    """
    k, c, normal, tangential, f, q, v = (
        np.array(x, dtype=float) for x in (stiffness, damping, normal, tangential, f, q, v)
    )
    inverse = 1.0 / (1.0 + b * dt * c)
    scale = dt**2 * (b + 0.5)
    W = scale * np.array([normal @ (normal * inverse), normal @ (tangential * inverse), 0.0])
    W[2] = scale * tangential @ (tangential * inverse)
    vs = v if held else v + dt * (1.0 - b) * (f - k * q - c * v)
    a = (f - k * q - c * vs) * inverse
    reach = q + dt * (vs + b * dt * a) + 0.5 * dt**2 * a
    record = begin(np.zeros(1, published.SCENE), 0.0, 0.0, 1.0)
    record["dt"], record["b"], record["r"], record["mu"], record["speed"] = dt, b, dt / tau, mu, V
    record["W_NN"], record["W_NT"], record["W_TT"] = W
    record["gap_N"], record["gap_T"] = normal @ reach, tangential @ reach
    record["last_gT"], record["last_T"], record["contact"] = tangential @ q, last_T, SLIP
    record["sample_every"], record["row_every"], record["stick_room"] = steps, 1, steps
    rows, samples = np.empty((steps, 6)), np.empty((count_in(0, steps, steps), SAMPLE))
    modes = (k, c, inverse, normal, tangential, 1.0 * (np.arange(len(k)) == 0))
    published.advance(
        record, steps, modes, f, np.zeros((2, 0)), q, vs, a, reach, samples, rows, np.empty((steps, 2))
    )
    return rows, q
