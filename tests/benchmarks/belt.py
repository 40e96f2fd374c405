"""One mass on a belt, x'' + 0.1 x' + x = mu(V - x'), by this engine and by what one could use instead.

mu falls from 1 to 0.5 within some 0.5 of slip; in the end the mass slides steadily or sticks and slips. A method
returns whether it sticks after `LAST`, and with `paths` times and x until the first stick.
"""

import time
from importlib.util import find_spec

import numpy as np
from numba import njit
from scipy import integrate

from fivcore import Friction, Scene, Structure, simulate_many
from tests.benchmarks.tables import Column, Table

END, LAST, FEW = 500.0, 450.0, 20


def by_fiv(rows, step, paths=None):
    """Here `paths` are the times to which x is wanted, from the velocity in the middle of the steps."""
    block = Structure.from_modes([0, 0.5 / np.pi], [1, 0], [0, 1], load=[-1, 0], damping_ratio=[0, 0.05])
    scenes, starts = [Scene(V, 0, 1, 1, block, Friction(0.5, 0.5)) for V in rows[:, 0]], rows[:, 1:, None]
    how = {"ramp": 0.0, "step": step, "initial": [(*np.pad(each, ((0, 0), (1, 0))), 2) for each in starts]}
    if paths is None:
        return [run.summary["stick_fraction"] > 0 for run in simulate_many(scenes, END, settle=LAST, **how)], []
    found = simulate_many(scenes, paths, record=["velocity_B"], sample_rate=None, **how)
    ends = [
        (run.time + 0.5 * step, row[1] + step * np.cumsum(run.velocity_B))
        for run, row in zip(found, rows, strict=True)
    ]
    return [], ends


@njit
def pull(x, v, V, way):
    return way * (0.5 + 0.5 * np.exp(-2.0 * way * (V - v))) - 0.1 * v - x


@njit
def after(x, v, V, way, h):
    """A step of RK4."""
    a = pull(x, v, V, way)
    b = pull(x + 0.5 * h * v, v + 0.5 * h * a, V, way)
    c = pull(x + 0.5 * h * (v + 0.5 * h * a), v + 0.5 * h * b, V, way)
    d = pull(x + h * (v + 0.5 * h * b), v + h * c, V, way)
    return x + h * (v + h / 6.0 * (a + b + c)), v + h / 6.0 * (a + 2.0 * (b + c) + d)


@njit
def turned(t, x, V, way):
    """Time, x, v and direction of slip a bit after it began anew, and whether there was a stick before."""
    stuck, bit = abs(x + 0.1 * V) <= 1.0, 1e-5
    if stuck:
        t, x, way = t + (1.0 - 0.1 * V - x) / V, 1.0 - 0.1 * V, 1.0
    else:
        way = -way
    a = way - 0.1 * V - x
    return t + bit, x + bit * (V + 0.5 * bit * a), V + bit * (a + 0.5 * bit * (0.9 * a - V)), way, stuck


@njit
def plain(x, v, V, h, path):
    t, way, last, n = 0.0, 1.0 if v < V else -1.0, -1.0, 0
    while t < END:
        size, (y, w) = h, after(x, v, V, way, h)
        turns = way * (V - w) <= 0.0
        for _ in range(6 if turns else 0):
            size = min(max(size + (V - w) / pull(y, w, V, way), 0.0), h)
            y, w = after(x, v, V, way, size)
        t, x, v = t + size, y, w
        if n < len(path) and last < 0.0:
            path[n, 0], path[n, 1], n = t, x, n + 1
        if turns:
            t, x, v, way, stuck = turned(t, x, V, way)
            last = t if stuck else last
    return last > LAST, n


def by_loop(rows, step, paths=None):
    room = np.empty((0 if paths is None else int(2.0 * END / step), 2))
    labels, ends = [], []
    for V, x, v in rows:
        label, n = plain(x, v, V, step, room)
        labels.append(label)
        ends.append(room[:n].T.copy())
    return labels, ends


def by_scipy(rows, tolerance, paths=None):
    """With `paths` it has, in place of points, the times of the first stick and x before it as a function."""
    labels, ends = [], []
    for V, x, v in rows:
        t, way, last, parts = 0.0, 1.0 if v < V else -1.0, -1.0, []
        while t < END:

            def turn(t, y, V, way):
                return way * (V - y[1])

            turn.terminal, turn.direction = True, -1.0
            found = integrate.solve_ivp(
                lambda t, y, V, way: (y[1], pull(y[0], y[1], V, way)),
                (t, END),
                (x, v),
                "DOP853",
                rtol=tolerance,
                atol=tolerance,
                events=turn,
                args=(V, way),
                dense_output=paths is not None and last < 0.0,
            )
            if last < 0.0:
                parts.append(found)
            t, (x, v) = found.t[-1], found.y[:, -1]
            if found.status == 1:
                t, x, v, way, stuck = turned(t, x, V, way)
                last = t if stuck else last
        labels.append(last > LAST)
        ends.append(parts)
    return labels, ends


def by_heyoka(rows, tolerance, paths=None, lanes=8):
    """In stick x' = V; one event ends slip or stick, whichever there is."""
    import heyoka as hy

    x, v = hy.make_vars("x", "v")
    V, way, stick = (hy.par[k] for k in range(3))
    force = way * (0.5 + 0.5 * hy.exp(-2.0 * way * (V - v))) - 0.1 * v - x
    last = np.full(lanes, -1.0)

    def turn(ta, sign, lane):
        if ta.pars[2, lane] == 0.0 and abs(ta.state[0, lane] + 0.1 * ta.pars[0, lane]) > 1.0:
            ta.pars[1, lane] *= -1.0
        else:
            ta.pars[1, lane], ta.pars[2, lane] = 1.0, 1.0 - ta.pars[2, lane]
            last[lane] = ta.time[lane]
        ta.state[1, lane] = ta.pars[0, lane]
        return True

    event = hy.t_event_batch((1.0 - stick) * (v - V) + stick * (x + 0.1 * V - 1.0), callback=turn, cooldown=1e-6)
    ta = hy.taylor_adaptive_batch(
        [(x, v), (v, (1.0 - stick) * force)],
        np.zeros((2, lanes)),
        tol=tolerance,
        pars=np.zeros((3, lanes)),
        t_events=[event],
    )
    labels, ends, begun = [], [], time.thread_time()
    for part in range(0, len(rows), lanes):
        V, x, v = np.resize(rows[part:], (lanes, 3)).T if part + lanes > len(rows) else rows[part : part + lanes].T
        ta.set_time(0.0)
        ta.reset_cooldowns()
        ta.pars[:], ta.state[:], last[:] = (V, np.where(v < V, 1.0, -1.0), 0.0 * V), (x, v), -1.0
        points = []
        while paths is not None and np.any((last < 0.0) & (ta.time < END)):
            ta.step(np.full(lanes, 1.0))
            points.append((ta.time.copy(), ta.state[0].copy()))
        ta.propagate_until(END)
        labels += list((last > LAST) | (ta.pars[2] != 0.0))
        ends += list(np.transpose(points, (2, 1, 0))) if points else []
    return labels[: len(rows)], ends[: len(rows)], time.thread_time() - begun


def worst(ends, reference):
    """Largest error of x before the first stick: where slip has one direction until then, and where it has two."""
    found = [[0.0], [0.0]]
    for (t, x), parts in zip(ends, reference, strict=True):
        for part in parts:
            inside = (t >= part.t[0]) & (t < part.t[-1])
            if inside.any():
                found[len(parts) > 1].append(float(np.abs(x[inside] - part.sol(t[inside])[0]).max()))
    return [max(each) for each in found]


def belt():
    """Cost of a trajectory, how many were timed, errors and labels of the first `FEW` beside DOP853 to 1e-13."""
    rows = np.random.default_rng(1).uniform([1.2, -2.0, 0.0], [1.8, 2.0, 2.0], (1000, 3))
    known, reference = by_scipy(rows[:FEW], 1e-13, True)
    lasting = [max(parts[-1].t[-1], 0.1) for parts in reference]
    runs = [
        ("`fast`, step 0.0006", by_fiv, 6e-4, 100, lasting),
        ("RK4 in Numba, step 0.04", by_loop, 0.04, 1000, True),
        ("`solve_ivp`, DOP853 to 1e-8", by_scipy, 1e-8, FEW, True),
    ]
    if find_spec("heyoka"):
        runs.append(("heyoka, 8 lanes, to 1e-8", by_heyoka, 1e-8, 1000, True))
    table = []
    for what, method, setting, count, paths in runs:
        ends = method(rows[:FEW], setting, paths)[1]
        if method is by_scipy:
            ends = [np.concatenate([np.stack([p.t[:-1], p.y[0, :-1]]) for p in parts], axis=1) for parts in ends]
        begun = time.thread_time()
        labels, _, *own = method(rows[:count], setting)
        cost = own[0] if own else time.thread_time() - begun
        same = float(np.mean(np.array(labels[:FEW]) == known))
        table.append([what, cost / count, count, *worst(ends, reference), same])
    heads = [Column("method"), Column("a trajectory", "s"), Column("timed"), Column("error", form=".1e")]
    return Table([*heads, Column("error with a reversal", form=".1e"), Column("equal labels", "%")], table)
