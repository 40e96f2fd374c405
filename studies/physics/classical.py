"""Classical models with friction or impact: their known answers, and those of the solver.

Each function returns a row of published or closed-form values and a row of values by `fivcore`; for a motion, one
row by method "exact" and two by "fast" with two steps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import fivcore
from fivcore import SLIP, STICK, Friction, Normalised, Scene, State, Structure, assembled_modes, exact, simulate

# Hulten's (eta_1, eta_2).
DAMPING = np.array([(0.0, 0.0), (0.02, 0.02), (0.02, 0.06), (0.06, 0.02), (0.02, 0.002)])
SOLVER: dict[str, Any] = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-15}


def coupled(k11: float, k12: float, k21: float, k22: float, kn: float, mu: float) -> Any:
    """Two coupled modes: lam^2 = -(k11 + k22) / 2 +- sqrt((k11 - k22)^2 / 4 + k21 (k12 - mu kn)).

    The root vanishes at the onset.
    """
    matrices, friction = (np.eye(2), None, [[k11, k12], [k21, k22]]), [[0.0, -kn], [0.0, 0.0]]
    onset = fivcore.assembled_onsets(*matrices, friction, 1.0, 2.0)[0][0]
    modes = assembled_modes(*matrices, friction_stiffness=friction, mu=[onset, mu], fmax=1.0)
    mean, apart = 0.5 * (k11 + k22), 0.25 * (k11 - k22) ** 2
    grows = np.sqrt(-mean + np.emath.sqrt(apart + k21 * (k12 - mu * kn))).real
    # Where two frequencies meet each has half of all digits, their mean all.
    ours = [onset, 2.0 * np.pi * modes.frequency[0].mean(), modes.growth_rate[1].max()]
    return [(k12 + apart / k21) / kn, np.sqrt(mean), grows], ours


def hulten() -> Any:
    """Onsets of Hulten's model by Hurwitz's condition a1 a2 a3 = a1^2 + a3^2 a0.

    Without damping the onset is the limit for equal damping of both modes.
    """
    w = 2.0 * np.pi * np.array([100.0, 75.0])
    damping, K, friction = DAMPING * w, np.diag(w**2), [[0.0, -(w[1] ** 2)], [w[0] ** 2, 0.0]]
    ours = [fivcore.assembled_onsets(np.eye(2), np.diag(c), K, friction, 200.0)[0][0] for c in damping]
    modes = assembled_modes(np.eye(2), None, K, friction_stiffness=friction, mu=ours[0], fmax=200.0)
    square = np.array([c @ w[::-1] ** 2 / c.sum() if c.any() else w @ w / 2.0 for c in damping])
    onset = np.sqrt(square * (w @ w + damping.prod(axis=1)) - square**2 - w.prod() ** 2) / w.prod()
    return [np.sqrt(square[0]) / 2.0 / np.pi, *onset], [modes.frequency.mean(), *ours]


def block_of(omega: float, xi: float = 0.0) -> Structure:
    """A damped block of 1 kg on a spring along the drive, under a load."""
    hertz, damping = [0.0, omega / (2.0 * np.pi)], [0.0, xi] if xi else None
    return Structure.from_modes(hertz, [1.0, 0.0], [0.0, 1.0], load=[-1.0, 0.0], damping_ratio=damping)


def belted(V: float, law: Friction, xi: float = 0.0) -> tuple[Scene, State]:
    """The block on a belt with m = k = F_s = 1; the belt carries it along from x = 0."""
    return Scene(V, 0.0, 1.0, 1.0, block_of(1.0, xi), law), State(np.zeros(2), np.array([0.0, V]), STICK)


def states(scene: Scene, start: State, times: Any) -> Any:
    """Positions and velocities by "exact"; the second and the fourth are those of the block."""
    own, begin = Normalised.of(scene), State(start.displacement / scene.F, start.velocity / scene.F, start.contact)
    return scene.F * exact.states_at(own, np.atleast_1d(times), ramp=0.0, initial=begin)


def positions(scene: Scene, start: State, times: Any, step: float) -> list[Any]:
    """Positions of the block by "exact" and, with two steps, by "fast"."""
    found = [states(scene, start, times)[:, 1]]
    for h in (step, 0.5 * step):
        run = simulate(scene, times[-1], ramp=0.0, initial=start, step=h, record=True, sample_rate=None)
        # Velocities are those in the middle of the steps.
        path = start.displacement[1] + h * np.cumsum(run.velocity_B)
        found.append(path[np.rint(times / h).astype(int) - 1])
    return found


def decay() -> Any:
    """Free oscillation: the amplitude decreases by 2 mu N / k in each half period down to mu N / k; in 1e-4 m."""
    N, x, half, turn = 10.0 * np.sqrt(0.5), 0.85e-3 * np.sqrt(0.5), np.pi / 100.0, np.arange(1, 6)
    known = (-1.0) ** np.minimum(turn, 4) * (x - 0.2e-4 * N * np.minimum(turn, 4))
    scene, start = Scene(1e-11, 0.0, 0.1, N, block_of(100.0)), State(np.array([0.0, x]), np.zeros(2), SLIP)
    return 1e4 * np.array([known, *positions(scene, start, turn * half, half / 50.0)])


def swings() -> Any:
    """Seven swings of the block: the first turn is at sqrt(205) - 1 when tan t = 6 / 13, each later one 2 less."""
    first, root, eight = np.arctan2(6.0, 13.0), np.sqrt(205.0), np.array([0.0, 8.0 * np.pi])
    start = State(np.array([0.0, 12.0]), np.array([0.0, 6.0]), SLIP)
    scene = Scene(1e-12, 0.0, 1.0, 1.0, block_of(1.0))
    time = brentq(lambda t: states(scene, start, t)[0, 3], 0.2, 0.6, xtol=1e-13)
    places = positions(scene, start, first + eight, first / 30.0)
    return np.column_stack([[[root - 1.0, 15.0 - root], *places], [first, time, np.nan, np.nan]])


def belt() -> Any:
    """The block sticks until x1 = mu N / k = 1; then x = x1 + V / omega sin omega (t - t1)."""
    V, times = 2.0 / np.pi, 0.5 * np.pi * np.array([1.0, 2.0, 4.0])
    return [[1.0, 1.0 + V, 1.0 - V], *positions(*belted(V, Friction()), times, np.pi / 100.0)]


def slipping(V: float, law: Friction, xi: float = 0.0) -> Any:
    """Rates of (x, v) by x'' + 2 xi x' + x = mu(V - v); `way` is 1, or -1 where the block overtakes the belt."""

    def rates(_: float, y: Any, way: float = 1.0) -> Any:
        u, kappa = abs(V - y[1]) / law.decay_speed, law.kinetic_ratio
        g = np.exp(-u) if law.decay == "exponential" else 1.0 / (1.0 + u)
        return [y[1], way * (kappa + (1.0 - kappa) * g) - 2.0 * xi * y[1] - y[0]]

    return rates


def cycle(V: float, law: Friction) -> tuple[float, float, Any]:
    """Duration of slip and of stick, and the turns, (n, 2), of the cycle.

    If the spring force exceeds static friction when the block has become as fast as the belt, it overtakes the
    belt.
    """
    t, x, v, way, turns = 0.0, 1.0, V, 1.0, []

    def level(_: float, y: Any, way: float) -> Any:
        return way * (V - y[1])

    vars(level).update(terminal=True, direction=-1.0)
    events = [level, lambda _, y, way: y[1]]
    while abs(x) >= 1.0:
        found = solve_ivp(slipping(V, law), (t, t + 40.0), [x, v], events=events, args=(way,), **SOLVER)
        turns.append(np.column_stack([found.t_events[1], found.y_events[1].reshape(-1, 2)[:, 0]]))
        t, (x, v), way = found.t_events[0][0], found.y_events[0][0], -way
    return t, (1.0 - x) / V, np.concatenate(turns)


def cycles(V: float, law: Friction, slip: float, stick: float, turns: Any) -> Any:
    """Period, slip, stick and turns: the given ones, and those by "exact" and, with two steps, by "fast"."""
    (scene, start), rows = belted(V, law), [[slip + stick, slip, stick]]
    how: dict[str, Any] = {"ramp": 0.0, "settle": 0.0, "min_stick": 0.5, "initial": start}
    duration = 1.0 / V + 2.0 * (slip + stick) + 1.0
    for method, step in (("exact", 0.05), ("fast", 2e-3), ("fast", 1e-3)):
        summary = simulate(scene, duration, method, step=step, **how).summary
        period, stick = np.diff(summary["stick_starts"])[0], summary["stick_times"][0]
        rows.append([period, period - stick, stick])
    return np.hstack([rows, [turns[:, 1], *positions(scene, start, 1.0 / V + turns[:, 0], 2e-3)]])


def leine() -> Any:
    """Stick-slip cycles, published by shooting; here by SciPy. At V = .8 the block overtakes the belt."""
    law = Friction(0.0, 1.0 / 3.0, "rational")
    first, *others = (cycles(V, law, *cycle(V, law)) for V in (0.2, 0.05, 0.1, 0.4, 0.8))
    return np.hstack([first, *(table[:, :1] for table in others)])


def jump() -> Any:
    """A jump of friction: the block sticks for 2 (1 - kappa) / V, then swings about kappa."""
    V, kappa = 0.2, 0.5
    stick, slip = 2.0 * (1.0 - kappa) / V, 2.0 * (np.pi - np.arctan((1.0 - kappa) / V))
    top = np.array([[np.arctan(V / (1.0 - kappa)), kappa + np.hypot(1.0 - kappa, V)]])
    return cycles(V, Friction(kappa, 0.0), slip, stick, top)[:, [2, 1, 3]] - [0.0, 0.0, kappa]


def fading() -> Any:
    """Onset of self-excitation under damping and falling friction, and the higher speed at which cycles end.

    Damping outweighs the fall of friction from V = v_d ln((1 - kappa) / (2 xi v_d)) on.
    """
    law, xi, kappa, v_d = Friction(0.5, 0.5), 0.05, 0.5, 0.5
    onset = fivcore.sliding_onsets(belted(1.0, law, xi)[0], "V", 0.5, 2.0, 1.0).value[0]

    def crest(V: float) -> tuple[float, float]:
        """Time at which the block is fastest after it begins to slip, and how much slower than the belt it is."""
        rates, start = slipping(V, law, xi), [1.0 - 2.0 * xi * V, V]
        found = solve_ivp(rates, (0.0, 9.0), start, events=[lambda t, y: rates(t, y)[1]], **SOLVER)
        return found.t_events[0][-1], V - found.y_events[0][-1][1]

    end = brentq(lambda V: crest(V)[1], 1.83, 1.85, xtol=1e-13)
    near = end + np.array([1e-3, 2e-3, 3e-3])  # below it sticks
    slower = [V - states(*belted(V, law, xi), 1.0 / V - 2.0 * xi + crest(V)[0])[0, 3] for V in near]
    ours = np.polynomial.Polynomial.fit(slower, near, 2)(0.0)
    return [[v_d * np.log((1.0 - kappa) / (2.0 * xi * v_d)), end], [onset, ours]]


def bar(n: int = 50) -> Any:
    """Impact of an elastic bar by the published scheme: n elements, lumped mass, at the Courant limit.

    A last mode moves tangentially.
    """
    c, L, v, h, k = 30.0, 10.0, 10.0, 10.0 / n, np.arange(n + 1)
    end, hertz = np.sqrt(np.where(k % n, 2.0, 1.0) / L), c / h / np.pi * np.sin(0.5 * np.pi * k / n)
    rigid = np.eye(n + 2)[0] / end[0]
    rod = Structure.from_modes([*hertz, 1.0], [*end, 0.0], [*(0.0 * k), 1.0], load=-rigid / L)
    scene, start = Scene(1e-9, 0.0, 0.0, 1e-11, rod), State(5.0 * rigid, -v * rigid, fivcore.SEPARATION)
    how: dict[str, Any] = {"ramp": 0.0, "step": h / c, "numerical_damping": "none", "sample_rate": None}
    N = simulate(scene, 1.4, "paper", initial=start, record=["normal_force"], **how).normal_force
    pressed = N[N > 1e-3]
    return [c * v, 2.0 * L / c], [pressed[len(pressed) // 2], len(pressed) * h / c]
