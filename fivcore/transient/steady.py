"""Steady-state certificate: a proof that slip never ends and comes ever closer to steady sliding.

At constant drive a step in slip is an affine map of x = (q, v, u_T) (`fivcore.contact.step_map`), x' = M x + b;
steady sliding, with N = 1, is its fixed point x*. Slip goes on while N > 0, the contact is closed and the forces
that stick would need have T > mu N and T > 0. These readings are affine in x too.

With computed eigenvalues z and eigenvectors X of M let y = X^-1 (x - x*) and E = X^-1 (M X - X diag(z)), the error
of the eigenvectors: a step takes y to diag(z) y + E y. Let rho be the largest |z| and e the maximum norm of E.
Where rho + e < 1, the largest |y_j| never grows, and no |y_j| exceeds its present value by more than e / (1 - rho)
times the largest. A reading R x then stays within sum_j |R X|_j times that bound of its steady value. Where this
is less than what would end slip, slip never ends. M has all kept modes, at any frequency.

A run is ended only when the bounds on N, slip rate and velocity of B are below `TOLERANCE`, nine decades below
what could end slip. The rounding of single steps (1e-16 each; at most 1 / `LEAST_DECAY` of them add up) is
therefore left out. With the paper's rig at V / F below some 1e-5 m/s/N it exceeds the tolerance; such a run takes
every step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fivcore.beams.modes import one_blas_thread
from fivcore.contact.law import regime_maps
from fivcore.contact.reduced import ReducedModel
from fivcore.contact.step_map import eigenvectors, slip_map
from fivcore.jit import Array, Complex
from fivcore.transient.statistics import SLIP

# Deviations from steady sliding that may be left when a run is ended: of N in units of F, of speeds in units of V.
TOLERANCE = 1e-9
# A proof is tried once the slip rate varies by no more than this, in units of V.
NEAR = 10.0 * TOLERANCE
# The least that every mode must lose in a step.
LEAST_DECAY = 1e-9
# Readings: those of a record, penetration and u_T, T that stick would need and its excess over mu N.
VELOCITY, NORMAL, TANGENTIAL, SLIP_RATE, PENETRATION, U_T, STICK_FORCE, EXCESS = range(8)


@dataclass(frozen=True, eq=False)
class SteadySliding:
    """Steady sliding at constant drive with T = mu N.

    Attributes
    ----------
    eigenvalues : ndarray of complex, (2n + 1,)
        log(z) / step, 1/s; one of them is the element's own.
    decays : bool
        Whether all of them decay, by more than their errors.
    state : ndarray, (2n + 1,)
        x*: q, v and u_T before an impulse.
    """

    eigenvalues: Complex
    decays: bool
    state: Array
    _rows: Array
    _relaxing: Array
    _weights: Array
    _inverse: Complex
    _error: float

    def readings(self, speed: float) -> Array:
        """Return the readings in steady sliding at V = `speed`."""
        return np.asarray(self._rows @ np.append(self.state, [1.0, speed]))

    def start(self, speed: float) -> tuple[Array, Array, Array]:
        """Return q and v before an impulse, and the element's state after a step."""
        q, v = self.state[:-1].reshape(2, -1).copy()
        return q, v, self.readings(speed)[[PENETRATION, U_T]]

    def row(self, speed: float) -> tuple[float, ...]:
        """Return a record's velocity of B, N, T, slip rate and contact state."""
        return (*self.readings(speed)[: SLIP_RATE + 1].tolist(), float(SLIP))

    @one_blas_thread()
    def bounds(self, x: Array) -> Array:
        """Bound how far each reading can ever be from its steady value if slip goes on from `x`."""
        parts = np.abs(self._inverse @ (x - self.state))
        return np.asarray(self._weights @ (parts + self._error * parts.max()))

    def is_permanent(self, q: Array, v: Array, u: Array, speed: float) -> bool:
        """Whether slip never ends from here on and stays within `TOLERANCE` of steady sliding at V = `speed`.

        q and v, (n,), are those before an impulse in slip, u, (2,), is the element's state after the last step.
        """
        if not self.decays:
            return False
        bound, steady = self.bounds(np.concatenate([q, v, u[1:]])), self.readings(speed)
        if bound[NORMAL] > TOLERANCE or max(bound[SLIP_RATE], bound[VELOCITY]) > TOLERANCE * speed:
            return False
        # Contact opens where the penetration falls below the u_N that relaxes from the last step's element state.
        last = [max(bound[PENETRATION], abs(u[0] - steady[PENETRATION])), bound[U_T]]
        bound[PENETRATION] += np.abs(self._relaxing) @ last
        steady[PENETRATION] -= self._relaxing @ steady[[PENETRATION, U_T]]
        positive = [NORMAL, PENETRATION, STICK_FORCE, EXCESS]
        return bool(np.all(bound[positive] < steady[positive]))


@lru_cache(maxsize=64)
@one_blas_thread()
def steady_sliding(model: ReducedModel, mu: float, step: float) -> SteadySliding | None:
    """Build the map of slip with T = mu N, its fixed point and its spectrum; some milliseconds.

    The spectrum is that of `fivcore.sliding_modes` for the kept modes, in its band and above, with the element's
    damping.

    Parameters
    ----------
    model : ReducedModel
        With an element: without one only rounding holds the gap of a lasting contact.
    mu, step : float

    Returns
    -------
    SteadySliding or None
        None where the matrix has no full set of eigenvectors, or no unique fixed point.
    """
    impulse, n, b, half = model.impulse(step), model.normal, model.point_b, 0.5 * step
    slip, M = slip_map(model, impulse, mu, step, 0), impulse.mobility
    maps = regime_maps(impulse.stiffness, impulse.damping, M, mu, step)
    # Two more columns: the unit load, whose share of the impulse comes first, and a unit of V.
    load = [impulse.defect[0, 0] - n @ model.rest, 0.0, -M[0, 0], -M[1, 0]]
    seen = np.column_stack([slip.seen, load, [0.0, 0.0, 0.0, -1.0]])
    (N, T, following), (p, u_T, _, rate_T) = slip.law @ seen, seen
    stick_N, stick_T = maps.entering @ seen
    slip_rate = rate_T + M[1, 0] * N + M[1, 1] * T + (following - u_T) / step
    velocity = half * (b @ n * N + b @ model.tangential * T)
    velocity += np.concatenate([np.zeros(len(n)), b, [0.0, -half * (b @ n), 0.0]])
    rows = np.stack([velocity, N, T, slip_rate, p, u_T, stick_T, stick_T - mu * stick_N])
    constant = slip.impulse @ [N[-2] - 1.0, T[-2]]
    constant[-1] = following[-2]
    try:
        z, X, inverse, error = eigenvectors(slip)
        state = np.linalg.solve(np.eye(len(constant)) - slip.matrix, constant)
    except np.linalg.LinAlgError:
        return None
    decay = 1.0 - float(np.abs(z).max())
    decays = decay > max(LEAST_DECAY, 2.0 * error)
    # Without a dashpot u_T has no memory: a zero among the eigenvalues.
    eigenvalues = (np.log(z + np.finfo(float).tiny) / step).astype(complex)
    weights, share = np.abs(rows[:, :-2] @ X), error / decay if decays else np.inf
    return SteadySliding(eigenvalues, decays, state, rows, maps.separation[0], weights, inverse, share)
