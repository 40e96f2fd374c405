"""Classical models with friction or impact whose answers are published or known in closed form."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial
from typing import Any

import numpy as np
import xarray as xr

from studies.physics import classical
from studies.plotting import figures
from studies.study import Parameter, Study

# Accuracy of eigenvalues, and of motion and of cycles by 'exact'; least difference that is drawn. In a cycle the
# spring of rigid contact gives way by 1e-9 m.
CLOSED, MOTION, CYCLE, LEAST = 1e-9, 1e-8, 1e-7, 1e-16
OUTPUTS = {
    "expected": ("1", "published or closed-form value, in its own unit"),
    "ours": ("1", "computed value, in its own unit"),
    "difference": ("1", "computed less expected value"),
    "fast": ("1", "likewise by method fast"),
    "fast_half": ("1", "likewise by method fast with half the step"),
    "accuracy": ("1", "stated accuracy of the difference"),
}

# Equation, source, accuracy, quantities, and their values: expected, ours and, of a motion, two by 'fast'.
MODELS: dict[str, Any] = {
    "Hoffmann": ("K = [[2, 1 - 4 mu / 3], [1, 2]]", "Hoffmann et al., Mech. Res. Commun. 29 (2002)", CLOSED,
        ("onset", "rad/s there", "growth at mu = 1"),
        partial(classical.coupled, 2.0, 1.0, 1.0, 2.0, 4.0 / 3.0, 1.0)),
    "Mode coupling": ("K = [[3, .7 - mu], [.7, 1.6]]", "closed form", CLOSED,
        ("onset", "rad/s there", "growth at mu = 1.5"), partial(classical.coupled, 3.0, 0.7, 0.7, 1.6, 1.0, 1.5)),
    "Hulten": ("K = [[a^2, -mu b^2], [mu a^2, b^2]], C = diag(eta w)", "Sinou, Jezequel, Eur. J. Mech. 26 (2007)",
        CLOSED, ("undamped, Hz", *(f"onset, eta = {a:g}, {b:g}" for a, b in classical.DAMPING)), classical.hulten),
    "Coulomb decay": ("x'' + 1e4 x = r, |r| <= 1 / root 2", "closed form", MOTION,
        (*(f"turn {k}, .1 mm" for k in range(1, 5)), "rest, .1 mm"), classical.decay),
    "Seven swings": ("x'' + x = r, |r| <= 1, 12 at 6", "closed form", MOTION, ("turn", "rest", "time"),
        classical.swings),
    "Belt": ("x'' + x = r, |r| <= 1, V = 2 / pi", "Den Hartog", MOTION, ("first slip", "most", "least"),
        classical.belt),
    "Rational": ("x'' + x = r, |r| <= 1 / (1 + 3 v), V = .2", "Leine et al., Nonlinear Dyn. 16 (1998)", CYCLE,
        ("period", "slip", "stick", "most", "least", *(f"period, V = {V}" for V in (0.05, 0.1, 0.4, 0.8))),
        classical.leine),
    "Jump": ("x'' + x = r, |r| <= 1, .5 in slip, V = .2", "closed form", CYCLE, ("stick", "slip", "most"),
        classical.jump),
    "Fading": ("x'' + .1 x' + x = r, |r| <= .5 + .5 exp(-2 v)", "closed form; SciPy", CYCLE,
        ("stable from V", "sticks up to V"), classical.fading),
    "Impacting bar": ("E = 900, rho = 1, L = v = 10", "Doyen, Ern, Piperno, SIAM J. Sci. Comput. 33 (2011)",
        CLOSED, ("pressure", "time"), classical.bar),
}  # fmt: skip
# How a figure calls models and quantities.
TITLES = {
    "Hoffmann": "two modes (Hoffmann et al.)", "Mode coupling": "two modes, other stiffness",
    "Hulten": "two modes, damped (Hultén)", "Coulomb decay": "dry friction: two periods",
    "Seven swings": "dry friction: seven half periods", "Belt": "belt: constant friction",
    "Rational": "belt: falling friction (Leine et al.)", "Jump": "belt: kinetic friction half of static",
    "Fading": "belt: falling friction, damped", "Impacting bar": "elastic bar hits a wall",
}  # fmt: skip
WORDS = {
    "onset": "flutter onset, μ", "rad/s there": "its frequency, rad/s", "growth at mu": "growth rate at μ",
    "undamped": "frequency at onset", "onset, eta": "onset μ, η", "turn": "turning point",
    "rest": "final position", ".1 mm": "in 0.1 mm", "first slip": "position at slip onset",
    "most": "largest displacement", "least": "smallest displacement", "slip": "slip time", "stick": "stick time",
    "stable from V": "lowest stable speed", "sticks up to V": "highest speed with stick",
    "pressure": "contact pressure", "time": "time",
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
    """The number of values within their accuracy, all values, and a description of each model."""
    right, count = int((abs(data["difference"]) <= data["accuracy"]).sum()), data.sizes["case"]
    yield (
        f"{right} of {count} values agree with the known one to {CLOSED:g}, in motions by method exact to"
        f" {MOTION:g}, in cycles to {CYCLE:g}."
    )
    table = data[[*OUTPUTS][:-1]].to_pandas().reset_index()
    yield "Values", table.assign(**{k: table[k].map("{:.10f}".format) for k in ("expected", "ours")})
    yield "Models", data[[*ABOUT]].to_pandas().drop_duplicates()


def draw(data: xr.Dataset) -> Any:
    """Differences by case on a logarithmic axis, with the stated accuracy; models above their quantities."""
    rows, places = list[str](), list[int]()
    for name in data["case"].values.tolist():
        model, quantity = name.split(": ", 1)
        rows += [] if TITLES[model] in rows else [TITLES[model]]
        places.append(len(rows))
        rows.append(figures.reworded(quantity, WORDS))
    figure, (axes,) = figures.panels(1, 1, 1.5 + 0.38 * len(rows))
    looks = "os^|", (figures.BLACK, figures.BLUE, figures.ORANGE, figures.RED)
    for array, look, c in zip((data[name] for name in [*OUTPUTS][2:]), *looks, strict=True):
        axes.plot(abs(array).clip(LEAST), places, look, color=c, label=array.long_name, mfc="none")
    axes.set(xscale="log", xlabel="difference in the unit of the value", ylim=(len(rows) - 0.5, -0.5))
    figures.name_rows(axes, rows, {*range(len(rows))}.difference(places))
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
