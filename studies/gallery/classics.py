"""Classical models with friction or impact whose answers are published or known in closed form."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial
from typing import Any

import numpy as np
import xarray as xr
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import fivcore
from fivcore import SLIP, STICK, Friction, Normalised, Scene, State, Structure, assembled_modes, exact, simulate
from studies.declaring import labels
from studies.declaring.parameters import Parameter
from studies.plotting import figures
from studies.study import Study

# Accuracy of eigenvalues, and of motion and of cycles by 'exact'; least difference that is drawn. In a cycle the
# spring of rigid contact gives way by 1e-9 m. Hulten's (eta_1, eta_2).
CLOSED, MOTION, CYCLE, LEAST = 1e-9, 1e-8, 1e-7, 1e-16
SOLVER: dict[str, Any] = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-15}
DAMPING = np.array([(0.0, 0.0), (0.02, 0.02), (0.02, 0.06), (0.06, 0.02), (0.02, 0.002)])
OUTPUTS = {
    "expected": ("1", "published or closed-form value, in its own unit"),
    "ours": ("1", "computed value, in its own unit"),
    "difference": ("1", "computed less expected value"),
    "fast": ("1", "likewise by method fast"),
    "fast_half": ("1", "likewise by method fast with half the step"),
    "accuracy": ("1", "stated accuracy of the difference"),
}


def coupled(k11: float, k12: float, k21: float, k22: float, kn: float, mu: float) -> Any:
    """lam^2 = -(k11 + k22) / 2 +- root of (k11 - k22)^2 / 4 + k21 (k12 - mu kn), which vanishes at the onset."""
    matrices, friction = (np.eye(2), None, [[k11, k12], [k21, k22]]), [[0.0, -kn], [0.0, 0.0]]
    onset = fivcore.assembled_onsets(*matrices, friction, 1.0, 2.0)[0][0]
    modes = assembled_modes(*matrices, friction_stiffness=friction, mu=[onset, mu], fmax=1.0)
    mean, apart = 0.5 * (k11 + k22), 0.25 * (k11 - k22) ** 2
    grows = np.sqrt(-mean + np.emath.sqrt(apart + k21 * (k12 - mu * kn))).real
    # Where two frequencies meet each has half of all digits, their mean all.
    ours = [onset, 2.0 * np.pi * modes.frequency[0].mean(), modes.growth_rate[1].max()]
    return [(k12 + apart / k21) / kn, np.sqrt(mean), grows], ours


def hulten() -> Any:
    """Hurwitz's a1 a2 a3 = a1^2 + a3^2 a0; without damping the limit of equal damping."""
    w = 2.0 * np.pi * np.array([100.0, 75.0])
    damping, K, friction = DAMPING * w, np.diag(w**2), [[0.0, -(w[1] ** 2)], [w[0] ** 2, 0.0]]
    ours = [fivcore.assembled_onsets(np.eye(2), np.diag(c), K, friction, 200.0)[0][0] for c in damping]
    modes = assembled_modes(np.eye(2), None, K, friction_stiffness=friction, mu=ours[0], fmax=200.0)
    square = np.array([c @ w[::-1] ** 2 / c.sum() if c.any() else w @ w / 2.0 for c in damping])
    onset = np.sqrt(square * (w @ w + damping.prod(axis=1)) - square**2 - w.prod() ** 2) / w.prod()
    return [np.sqrt(square[0]) / 2.0 / np.pi, *onset], [modes.frequency.mean(), *ours]


def block_of(omega: float, xi: float = 0.0) -> Structure:
    """1 kg on a spring along the drive, damped, under a load."""
    hertz, damping = [0.0, omega / (2.0 * np.pi)], [0.0, xi] if xi else None
    return Structure.from_modes(hertz, [1.0, 0.0], [0.0, 1.0], load=[-1.0, 0.0], damping_ratio=damping)


def moved(
    omega: float,
    x: float,
    v: float,
    contact: int,
    scene: Any,
    times: Any,
    step: float,
    law: Friction | None = None,
) -> Any:
    """Positions of 1 kg on a spring by 'exact' and, with two steps, 'fast'; its velocity; `scene` is V, mu, N."""
    (V, mu, N), last, block = scene, float(times[-1]), block_of(omega)
    own, q, rate = Scene(V, 0.0, mu, N, block, law or Friction()), np.array([0.0, x]), np.array([0.0, v])
    states = partial(exact.states_at, Normalised.of(own), ramp=0.0, initial=State(q / N, rate / N, contact))
    fast = partial(simulate, own, last, ramp=0.0, initial=State(q, rate, contact), record=True, sample_rate=None)
    # Velocities in the middle of the steps.
    paths = [(h, x + h * np.cumsum(fast(step=h).velocity_B)) for h in (step, 0.5 * step)]
    columns = [N * states(times)[:, 1], *(path[np.rint(times / h).astype(int) - 1] for h, path in paths)]
    return columns, lambda t: states(np.array([t]))[0, 3]


def decay() -> Any:
    """2 mu N / k less each half period, until a turn is within mu N / k; in 1e-4 m."""
    N, x, half, turn = 10.0 * np.sqrt(0.5), 0.85e-3 * np.sqrt(0.5), np.pi / 100.0, np.arange(1, 6)
    expected = (-1.0) ** np.minimum(turn, 4) * (x - 0.2e-4 * N * np.minimum(turn, 4))
    return 1e4 * np.array([expected, *moved(100.0, x, 0.0, SLIP, (1e-11, 0.1, N), turn * half, half / 50.0)[0]])


def swings() -> Any:
    """The first turn is at sqrt(205) - 1 when tan t = 6 / 13, each of the seven swings two less."""
    first, root, eight = np.arctan2(6.0, 13.0), np.sqrt(205.0), np.array([0.0, 8.0 * np.pi])
    columns, velocity = moved(1.0, 12.0, 6.0, SLIP, (1e-12, 1.0, 1.0), first + eight, first / 30.0)
    time = [first, brentq(velocity, 0.2, 0.6, xtol=1e-13), np.nan, np.nan]
    return np.column_stack([[[root - 1.0, 15.0 - root], *columns], time])


def belt() -> Any:
    """Sticks until x1 = mu N / k = 1, then x = x1 + V / omega sin omega (t - t1)."""
    V, times = 2.0 / np.pi, 0.5 * np.pi * np.array([1.0, 2.0, 4.0])
    return [[1.0, 1.0 + V, 1.0 - V], *moved(1.0, 0.0, V, STICK, (V, 1.0, 1.0), times, np.pi / 100.0)[0]]


def slipping(V: float, law: Friction, xi: float = 0.0) -> Any:
    """Rates of (x, v) by x'' + 2 xi x' + x = mu(V - v); `way` is 1, or -1 where it overtakes the belt."""
    kappa, v_d = law.kinetic_ratio, law.decay_speed

    def rates(_: float, y: Any, way: float = 1.0) -> Any:
        u = abs(V - y[1]) / v_d
        g = np.exp(-u) if law.decay == "exponential" else 1.0 / (1.0 + u)
        return [y[1], way * (kappa + (1.0 - kappa) * g) - 2.0 * xi * y[1] - y[0]]

    return rates


def cycle(V: float, law: Friction) -> tuple[float, float, Any]:
    """Slip, stick, and the turns, (n, 2), of the cycle.

    Where the spring is too tight to stick when the block has become as fast as the belt, it overtakes the belt.
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


def belted(V: float, law: Friction, xi: float = 0.0) -> tuple[Scene, State]:
    """The block on a belt, m = k = F_s = 1, which is carried along from x = 0."""
    return Scene(V, 0.0, 1.0, 1.0, block_of(1.0, xi), law), State(np.zeros(2), np.array([0.0, V]), STICK)


def belt_table(V: float, law: Friction, period: float, times: Any) -> Any:
    """Period, slip, stick, and places at `times` after the first slip, by 'exact' and, with two steps, 'fast'."""
    (scene, start), rows = belted(V, law), []
    how: dict[str, Any] = {"ramp": 0.0, "settle": 0.0, "min_stick": 0.5, "initial": start}
    for method, step in (("exact", 0.05), ("fast", 2e-3), ("fast", 1e-3)):
        summary = simulate(scene, 1.0 / V + 2.0 * period + 1.0, method, step=step, **how).summary
        found, stick = np.diff(summary["stick_starts"])[0], summary["stick_times"][0]
        rows.append([found, found - stick, stick])
    places = moved(1.0, 0.0, V, STICK, (V, 1.0, 1.0), 1.0 / V + times, 2e-3, law)[0]
    return np.hstack([rows, places])


def leine() -> Any:
    """Published by shooting; here by SciPy, to more digits. At V = .8 the block overtakes the belt."""
    law, tables = Friction(0.0, 1.0 / 3.0, "rational"), []
    for V in (0.2, 0.05, 0.1, 0.4, 0.8):
        slip, stick, turns = cycle(V, law)
        expected = [slip + stick, slip, stick, *turns[:, 1]]
        tables.append(np.vstack([expected, belt_table(V, law, slip + stick, turns[:, 0])]))
    return np.hstack([tables[0], *(table[:, :1] for table in tables[1:])])


def jump() -> Any:
    """It sticks for 2 (1 - kappa) / V, then swings about kappa."""
    V, kappa = 0.2, 0.5
    stick, slip = 2.0 * (1.0 - kappa) / V, 2.0 * (np.pi - np.arctan((1.0 - kappa) / V))
    top = np.array([np.arctan(V / (1.0 - kappa))])
    expected = [slip + stick, slip, stick, kappa + np.hypot(1.0 - kappa, V)]
    table = np.vstack([expected, belt_table(V, Friction(kappa, 0.0), slip + stick, top)])
    return table[:, [2, 1, 3]] - [0.0, 0.0, kappa]


def fading() -> Any:
    """Damping outweighs the fall of friction from V = v_d ln((1 - kappa) / (2 xi v_d)) on; cycles end later."""
    law, xi, kappa, v_d = Friction(0.5, 0.5), 0.05, 0.5, 0.5
    onset = fivcore.sliding_onsets(belted(1.0, law, xi)[0], "V", 0.5, 2.0, 1.0).value[0]

    def crest(V: float) -> tuple[float, float]:
        """When the block, once it slips, is fastest, and by how much slower than the belt."""
        rates, start = slipping(V, law, xi), [1.0 - 2.0 * xi * V, V]
        found = solve_ivp(rates, (0.0, 9.0), start, events=[lambda t, y: rates(t, y)[1]], **SOLVER)
        return found.t_events[0][-1], V - found.y_events[0][-1][1]

    def slower(V: float) -> Any:
        (scene, start), time = belted(V, law, xi), np.array([1.0 / V - 2.0 * xi + crest(V)[0]])
        return V - exact.states_at(Normalised.of(scene), time, ramp=0.0, initial=start)[0, 3]

    end = brentq(lambda V: crest(V)[1], 1.83, 1.85, xtol=1e-13)
    near = end + np.array([1e-3, 2e-3, 3e-3])  # below it sticks
    ours = np.polynomial.Polynomial.fit([slower(V) for V in near], near, 2)(0.0)
    return [[v_d * np.log((1.0 - kappa) / (2.0 * xi * v_d)), end], [onset, ours]]


def bar(n: int = 50) -> Any:
    """The published scheme, n elements, lumped mass, at the Courant limit; a last mode moves tangentially."""
    c, L, v, h, k = 30.0, 10.0, 10.0, 10.0 / n, np.arange(n + 1)
    end, hertz = np.sqrt(np.where(k % n, 2.0, 1.0) / L), c / h / np.pi * np.sin(0.5 * np.pi * k / n)
    rigid = np.eye(n + 2)[0] / end[0]
    rod = Structure.from_modes([*hertz, 1.0], [*end, 0.0], [*(0.0 * k), 1.0], load=-rigid / L)
    scene, start = Scene(1e-9, 0.0, 0.0, 1e-11, rod), State(5.0 * rigid, -v * rigid, fivcore.SEPARATION)
    how: dict[str, Any] = {"ramp": 0.0, "step": h / c, "numerical_damping": "none", "sample_rate": None}
    N = simulate(scene, 1.4, "paper", initial=start, record=["normal_force"], **how).normal_force
    pressed = N[N > 1e-3]
    return [c * v, 2.0 * L / c], [pressed[len(pressed) // 2], len(pressed) * h / c]


# Equation, source, accuracy, quantities, and their values: expected, ours and, of a motion, two by 'fast'.
MODELS: dict[str, Any] = {
    "Hoffmann": ("K = [[2, 1 - 4 mu / 3], [1, 2]]", "Hoffmann et al., Mech. Res. Commun. 29 (2002)", CLOSED,
        ("onset", "rad/s there", "growth at mu = 1"), partial(coupled, 2.0, 1.0, 1.0, 2.0, 4.0 / 3.0, 1.0)),
    "Mode coupling": ("K = [[3, .7 - mu], [.7, 1.6]]", "closed form", CLOSED,
        ("onset", "rad/s there", "growth at mu = 1.5"), partial(coupled, 3.0, 0.7, 0.7, 1.6, 1.0, 1.5)),
    "Hulten": ("K = [[a^2, -mu b^2], [mu a^2, b^2]], C = diag(eta w)", "Sinou, Jezequel, Eur. J. Mech. 26 (2007)",
        CLOSED, ("undamped, Hz", *(f"onset, eta = {a:g}, {b:g}" for a, b in DAMPING)), hulten),
    "Coulomb decay": ("x'' + 1e4 x = r, |r| <= 1 / root 2", "closed form", MOTION,
        (*(f"turn {k}, .1 mm" for k in range(1, 5)), "rest, .1 mm"), decay),
    "Seven swings": ("x'' + x = r, |r| <= 1, 12 at 6", "closed form", MOTION, ("turn", "rest", "time"), swings),
    "Belt": ("x'' + x = r, |r| <= 1, V = 2 / pi", "Den Hartog", MOTION, ("first slip", "most", "least"), belt),
    "Rational": ("x'' + x = r, |r| <= 1 / (1 + 3 v), V = .2", "Leine et al., Nonlinear Dyn. 16 (1998)", CYCLE,
        ("period", "slip", "stick", "most", "least", *(f"period, V = {V}" for V in (0.05, 0.1, 0.4, 0.8))), leine),
    "Jump": ("x'' + x = r, |r| <= 1, .5 in slip, V = .2", "closed form", CYCLE, ("stick", "slip", "most"), jump),
    "Fading": ("x'' + .1 x' + x = r, |r| <= .5 + .5 exp(-2 v)", "closed form; SciPy", CYCLE,
        ("stable from V", "sticks up to V"), fading),
    "Impacting bar": ("E = 900, rho = 1, L = v = 10", "Doyen, Ern, Piperno, SIAM J. Sci. Comput. 33 (2011)",
        CLOSED, ("pressure", "time"), bar),
}  # fmt: skip
CASES = {f"{name}: {text}": (name, k) for name, model in MODELS.items() for k, text in enumerate(model[3])}
ABOUT, solved = ("model", "equation", "source"), cache(lambda name: MODELS[name][4]())


def classics(case: Any) -> dict[str, Any]:
    """Outputs of each case."""
    places = [CASES[name] for name in case.tolist()]
    table = np.array([([column[k] for column in solved(name)] + 2 * [np.nan])[:4] for name, k in places]).T
    accuracy = [MODELS[name][2] for name, _ in places]
    return dict(zip(OUTPUTS, (*table[:2], *(table[1:] - table[0]), accuracy), strict=True))


def describe(data: xr.Dataset) -> xr.Dataset:
    """Add model, equation and source of each case."""
    rows = [(CASES[case][0], *MODELS[CASES[case][0]]) for case in data["case"].values.tolist()]
    return data.assign({x: ("case", [row[k] for row in rows], {"long_name": x}) for k, x in enumerate(ABOUT)})


def summarise(data: xr.Dataset) -> Iterator[Any]:
    """How many values are right, all of them, and what each model is."""
    right = labels.counted(int((abs(data["difference"]) <= data["accuracy"]).sum()), data.sizes["case"], "value")
    agree = "agrees" if right.startswith("every") else "agree"
    yield (
        f"{right[0].upper()}{right[1:]} {agree} with the known one to {CLOSED:g}, in motions by method exact to"
        f" {MOTION:g}, in cycles to {CYCLE:g}."
    )
    table = data[[*OUTPUTS][:-1]].to_pandas().reset_index()
    yield "Values", table.assign(**{k: table[k].map("{:.10f}".format) for k in ("expected", "ours")})
    yield "Models", data[[*ABOUT]].to_pandas().drop_duplicates()


def draw(data: xr.Dataset) -> Any:
    """Differences by case on a logarithmic axis, with the stated accuracy."""
    figure, (axes,) = figures.panels(1, 1, 17.0, 4.0 + 0.5 * data.sizes["case"])
    looks = "os^|", (figures.BLACK, figures.BLUE, figures.ORANGE, figures.RED)
    for array, look, c in zip((data[name] for name in [*OUTPUTS][2:]), *looks, strict=True):
        axes.plot(abs(array).clip(LEAST), data["case"], look, color=c, label=array.long_name, mfc="none")
    axes.set(xscale="log", xlabel="difference in the unit of the value", ylim=(data.sizes["case"] - 0.5, -0.5))
    figure.suptitle("Classical models with friction or impact")
    figures.legend_below(figure, [axes], 2)
    return figure


STUDY = Study(
    "classics",
    "Classical models with friction or impact",
    "Does the program give the published and closed-form answers of classical models?",
    {"case": Parameter(np.array(list(CASES)), "1", "model and quantity")},
    OUTPUTS,
    classics,
    derive=describe, summary=summarise, figure=draw,
)  # fmt: skip
