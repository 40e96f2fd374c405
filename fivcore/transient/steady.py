"""Whether a scene slides steadily for good, so that the rest of its run is known.

At constant drive a step of `transient.fast_kernel` in slip is an affine map of x = (q, v, u_T), the same whatever
V: x' = M x + b. Steady sliding is its fixed point (N = 1). What decides whether the next step slips too is
affine in x as well: N > 0, contact stays closed, and the trial of stick fails (T > mu N and T > 0).

The proof: with M = X diag(z) X^-1 and y = X^-1 (x - fixed point), every |y_j| stays below its present value
if all |z_j| < 1, so a reading R x stays within sum_j |R X|_j |y_j| of its steady value for ever. Where that is
less than what would end slip, slip never ends. What the eigenvectors get wrong, E = X^-1 (M X - X diag(z)), is
part of the bound: with a contraction rho + |E| < 1 in the largest |y_j|, it adds at most
|E| / (1 - rho) of the largest. All kept modes take part, those above 10 kHz and those that the contact does
not feel included.

A run is ended only when the same bound on N, on the slip rate and on the velocity of B is below `TOLERANCE`
of 1 and of V: nine decades below what could end slip, so that the rounding of single steps (1e-16 each, at
most 1 / `LEAST_DECAY` of them at once) is no concern, and no more than `transient.summary` takes for silence. With
the paper's rig at V / F below some 1e-5 m/s/N that rounding is itself more than the tolerance of speeds: such a
run takes every step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fivcore.beams.free_motion import propagator
from fivcore.beams.modes import one_blas_thread
from fivcore.contact.law import regime_maps
from fivcore.contact.reduced import ReducedModel
from fivcore.contact.step_map import energy_units, slip_matrix
from fivcore.jit import Array, Complex
from fivcore.transient.statistics import SLIP

# Deviations from steady sliding that may be left when a run is ended: of N in units of F, of speeds in units of V.
TOLERANCE = 1e-9
# How little the slip rate varies, in units of V, before it is worth asking.
NEAR = 10.0 * TOLERANCE
# The least that every mode must lose in a step.
LEAST_DECAY = 1e-9
# Rows of the readings; the last two are T of the trial of stick and its excess over mu N.
NORMAL, SLIP_RATE, VELOCITY, PENETRATION, CREEP, TRIAL, EXCESS = range(7)


@dataclass(frozen=True, eq=False)
class SteadySliding:
    """Slip at constant drive, T = mu N, as a map of one step about its fixed point.

    Attributes
    ----------
    eigenvalues : ndarray of complex, (2n + 1,)
        1/s: log(z) / step for the eigenvalues z of the step's matrix. One of them is the element's own.
    decays : bool
        Whether all of them decay, by more than can be mistaken.
    state : ndarray, (2n + 1,)
        q, v and u_T before a kick in steady sliding.
    """

    eigenvalues: Complex
    decays: bool
    state: Array
    _mu: float
    _rows: Array
    _constant: Array
    _opening: Array
    _into: Complex
    _reach: Array
    _slack: float

    def readings(self, speed: float) -> Array:
        """The seven readings in steady sliding at V = `speed`."""
        # The slip rate and the trial of stick see the drive.
        return np.asarray(self._rows @ self.state + self._constant @ [1.0, speed])

    def start(self, speed: float) -> tuple[Array, Array, Array]:
        """Copies of q and v before a kick, and the element's state after a step."""
        size = len(self.state) // 2
        return (
            self.state[:size].copy(),
            self.state[size:-1].copy(),
            self.readings(speed)[[PENETRATION, CREEP]],
        )

    def row(self, speed: float) -> tuple[float, ...]:
        """What a record shows: velocity of B, N, T, slip rate and contact state."""
        values = self.readings(speed)
        force = float(values[NORMAL])
        return float(values[VELOCITY]), force, self._mu * force, float(values[SLIP_RATE]), float(SLIP)

    @one_blas_thread()
    def bounds(self, x: Array) -> Array:
        """How far each reading can ever be from its steady value if slip goes on from `x`."""
        parts = np.abs(self._into @ (x - self.state))
        return np.asarray(self._reach @ (parts + self._slack * parts.max()))

    def is_permanent(self, q: Array, v: Array, u: Array, speed: float) -> bool:
        """Whether slip never ends from here on, and never again differs noticeably from steady sliding.

        Parameters
        ----------
        q, v : ndarray, (n,)
            Before a kick, in slip.
        u : ndarray, (2,)
            The element's state after the last step.
        speed : float
            Constant speed of the drive.
        """
        if not self.decays:
            return False
        most, steady = self.bounds(np.concatenate([q, v, u[1:]])), self.readings(speed)
        if most[NORMAL] > TOLERANCE or max(most[SLIP_RATE], most[VELOCITY]) > TOLERANCE * speed:
            return False
        # Contact opens where the penetration is below what is left of the element's last state.
        closed = steady[PENETRATION] - self._opening @ steady[[PENETRATION, CREEP]]
        at_most = max(most[PENETRATION], abs(u[0] - steady[PENETRATION]))
        opening = most[PENETRATION] + np.abs(self._opening) @ [at_most, most[CREEP]]
        return bool(opening < closed and np.all(most[[NORMAL, TRIAL, EXCESS]] < steady[[NORMAL, TRIAL, EXCESS]]))


@lru_cache(maxsize=64)
@one_blas_thread()
def steady_sliding(model: ReducedModel, mu: float, step: float) -> SteadySliding | None:
    """Build the map, its fixed point and its spectrum; some milliseconds.

    Parameters
    ----------
    model : ReducedModel
        With an element: without one only rounding holds the gap of a lasting contact.
    mu, step : float

    Returns
    -------
    SteadySliding or None
        None where the step's matrix has no full set of eigenvectors, or no unique fixed point.

    Notes
    -----
    The spectrum is that of `fivcore.sliding_modes` for the kept modes, with the element's damping; above the band
    that is reported there a mode may grow before any within it does. Then nothing is proved, as it should be.
    """
    rows, start, opening = _readings(model, mu, step)
    # In these units the energy is the sum of squares: eigenvectors are then as well conditioned as they can be.
    units = np.append(energy_units(model), np.sqrt(model.K[1, 1]))
    matrix = units[:, None] * slip_matrix(model, model.impulse(step), mu, step, 0) / units
    try:
        # A memory of u_T that is only rounding would spoil the eigenvectors' balance; E takes it in all the same.
        z, X = np.linalg.eig(np.where(np.abs(matrix) < 1e-15, 0.0, matrix))
        state = np.linalg.solve(np.eye(len(units)) - matrix, units * start)
        into = np.linalg.inv(X)
    except np.linalg.LinAlgError:
        return None
    wrong = float(np.abs(into @ (matrix @ X - X * z)).sum(axis=1).max())
    decay = 1.0 - float(np.abs(z).max())
    decays = bool(decay > LEAST_DECAY and decay > 2.0 * wrong)
    # Without a dashpot u_T has no memory: a zero among the eigenvalues.
    eigenvalues = (np.log(np.maximum(np.abs(z), np.finfo(float).tiny)) + 1j * np.angle(z)) / step
    return SteadySliding(
        eigenvalues,
        decays,
        state / units,
        mu,
        rows[:, :-2].copy(),
        rows[:, -2:].copy(),
        opening,
        into * units,
        np.abs(rows[:, :-2] / units @ X),
        wrong / decay if decays else np.inf,
    )


def _readings(model: ReducedModel, mu: float, step: float) -> tuple[Array, Array, Array]:
    """The readings as `transient.fast_kernel` takes them, a step from x = 0, and what the opening depends on.

    A row stands for something affine: its factors on x, its value at x = 0, what a unit of V adds.
    """
    n, t, half = model.normal, model.tangential, 0.5 * step
    defect, K, C, M = model.impulse(step)
    maps = regime_maps(K, C, M, mu, step)
    slip, separation, entry = maps.slip, maps.separation, maps.entering
    zero = np.zeros(len(n))
    p = np.concatenate([-n, zero, [0.0, defect[0, 0] - float(n @ model.rest), 0.0]])
    u = np.concatenate([zero, zero, [1.0, 0.0, 0.0]])
    # The unit load's share of the kick comes first; the slip rate sees the drive.
    rate_N = np.concatenate([zero, n, [0.0, -M[0, 0], 0.0]])
    rate_T = np.concatenate([zero, t, [0.0, -M[1, 0], -1.0]])
    force, after = slip[0] @ np.stack([p, u, rate_N])
    slip_rate = rate_T + (M[1, 0] + mu * M[1, 1]) * force + (after - u) / step
    b = model.point_b
    velocity = np.concatenate([zero, b, [0.0, -half * float(b @ n), 0.0]]) + half * float(b @ (n + mu * t)) * force
    trial_N, trial_T = entry @ np.stack([p, u, rate_N, rate_T])
    rows = np.stack([force, slip_rate, velocity, p, u, trial_T, trial_T - mu * trial_N])
    _, q_of_v, _, v_of_v = propagator(model.stiffness, model.damping, step)
    kick = step * ((n + mu * t) * force[-2] - n)
    return rows, np.concatenate([q_of_v * kick, v_of_v * kick, after[-2:-1]]), separation[0].copy()
