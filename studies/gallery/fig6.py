"""Fig. 6: the two modes that coalesce first, in the complex plane, and the mode shape at lock-in."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from fivcore import checks, node_positions, sliding_modes
from studies import paper
from studies.answering import results
from studies.answering.claims import is_papers_point
from studies.declaring import labels, spec
from studies.declaring.parameters import Parameter
from studies.motion import run, scenes
from studies.motion.stability import MODES
from studies.physics.onsets import MOST_MU, closest_two, lock_in, pair, path
from studies.plotting import figures, moving, planes
from studies.study import Claim, Study
from sweeps import Axis


def check(mu: Any, theta: Any, **numbers: Any) -> None:
    """Refuse friction beyond the range in which the pair is followed, and a rig without such a pair."""
    checks.between("mu", float(np.max(mu)), 0.0, MOST_MU, "a coefficient of friction")
    if not any(np.ndim(value) for value in (theta, *numbers.values())):
        lock_in(scenes.rig_of(numbers), theta)


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Number the modes; add the lock-in point and the shape of the neutral mode there."""
    rig, theta = results.rig_of(dataset), float(dataset["theta"])
    mu, frequency, eigenvalues = lock_in(rig, theta)
    position, modes = node_positions(rig, theta), sliding_modes(rig, theta, [mu], run.BAND)
    shape = modes.shape[0, min(closest_two(modes, 0, eigenvalues), key=lambda k: abs(modes.growth_rate[0, k]))]
    beam = np.repeat(np.array([1, 2], np.int8), [rig.p1.elements + 1, rig.p2.elements + 1])
    numbers = closest_two(sliding_modes(rig, theta, [0.0], run.BAND), 0, path(rig, theta, 1)[0]) + 1
    dataset = dataset.assign_coords({"mode": dataset["mode"].copy(data=numbers)} if len(numbers) else {})
    added: dict[str, Any] = {"lock_in_mu": ((), mu, "1", "coefficient of friction at lock-in")}
    added["node"] = "node", np.arange(1, len(beam) + 1), "1", "number of the node, those of P1 first"
    added["lock_in_frequency"] = (), frequency, "Hz", "frequency at lock-in"
    for k, x in enumerate("xy"):
        added[f"node_{x}"] = "node", position[:, k], "m", f"undeformed position along {x}"
        for part in ("real", "imag"):
            text = f"displacement along {x}, {part} part"
            added[f"shape_{x}_{part}"] = "node", getattr(shape[:, k], part), "1", text
    flags = {"flag_values": beam[[0, -1]], "flag_meanings": "P1 P2", "long_name": "beam"}
    return results.with_variables(dataset, added).assign(beam=("node", beam, flags))


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Frequencies and friction at lock-in, and the motion of the contact in the unstable mode."""
    numbers, start = " and ".join(map(str, dataset["mode"].values)), dataset.isel(mu=0)
    mu, hertz = (float(dataset[f"lock_in_{name}"]) for name in ("mu", "frequency"))
    tip = dataset.isel(node=(dataset["node_x"] ** 2 + dataset["node_y"] ** 2).argmin("node"))
    x, y = (float(np.hypot(tip[f"shape_{x}_real"], tip[f"shape_{x}_imag"])) for x in "xy")
    yield f"Modes {numbers} lock in at mu = {mu:.4f}, {hertz:.0f} Hz."
    yield f"In the unstable mode (largest displacement 1) P1's tip moves by {x:.3f} along x, {y:.3f} along y."
    yield f"The modes at mu = {float(start['mu']):g}", labels.frame(start, ["mode", "frequency", "growth_rate"])


# The model's marks lie within those of the paper.
PAPER: dict[str, Any] = planes.PAPER["first unstable μ"] | {"label": "paper", "markersize": 9.0, "zorder": 1.5}


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Root locus above, the shape at lock-in below."""
    figure, (locus, shape) = figures.panels(2, 1, 7.5, 7.0)
    mu, onset, hertz = dataset["mu"].values, float(dataset["lock_in_mu"]), float(dataset["lock_in_frequency"])
    locus.set_prop_cycle(color=[figures.BLUE, figures.RED], marker=["o", "s"])
    texts = [f"mode {number}" for number in dataset["mode"].values]
    locus.plot(dataset["growth_rate"], dataset["frequency"], markevery=[0], label=texts)
    locus.plot(0.0, hertz, "*", markersize=11, color=figures.BLACK, label=f"lock-in, model: μ = {onset:.4f}")
    if is_papers_point(dataset, theta=paper.THETA):
        for hertz_of_paper in (*paper.MODES_5_AND_6, paper.ONSETS[0][1]):
            locus.plot(0.0, hertz_of_paper, **PAPER)
    locus.set(xlabel="growth rate / (1/s)", ylabel="frequency / Hz")
    scale, phases = 40.0 * float(np.ptp(dataset["node_x"].values)), np.exp(1j * np.linspace(0.0, np.pi, 7))
    for beam, colour in ((1, figures.ORANGE), (2, figures.GREEN)):
        at = dataset.isel(node=np.flatnonzero(dataset["beam"].values == beam))
        place = 1e3 * np.stack([at["node_x"].values, at["node_y"].values])
        moved = np.stack([at[f"shape_{x}_real"].values + 1j * at[f"shape_{x}_imag"].values for x in "xy"])
        faint = place[..., None] + scale * (moved[..., None] * phases[1:]).real
        shape.plot(*faint, color=figures.GREY, alpha=0.5, linewidth=0.6, label="other phases")
        shape.plot(*place, color=figures.BLACK, linewidth=0.8, linestyle="--", label="undeformed")
        shape.plot(*(place + scale * moved.real), color=colour, linewidth=2.0, label=f"P{beam}")
    head = 1e3 * np.array([dataset["node_x"], dataset["node_y"]])[:, int(np.argmax(dataset["node_y"].values))]
    shape.plot(*head, "s", color=figures.GREY, markersize=12.0, label="head with the load F", zorder=1.5)
    arrow: dict[str, Any] = {"arrowprops": {"arrowstyle": "-|>", "color": figures.BLACK}, "va": "center"}
    shape.annotate("V", (-45.0, 20.0), (-72.0, 20.0), **arrow)
    shape.margins(y=0.15)
    shape.set(aspect="equal", xlabel="x from the contact / mm", ylabel="y / mm")
    figure.suptitle("Lock-in of two modes")
    titles = f"root locus, μ from {mu[0]:g} (marked) to {mu[-1]:g}", f"growing mode, {hertz:.0f} Hz, enlarged"
    figures.entitle((locus, shape), titles)
    figures.legend_below(figure, [locus, shape], 3)
    return figure


STUDY = Study(
    name="fig6",
    title="Fig. 6: lock-in of two modes, and the unstable shape",
    question="How do the two modes that coalesce first move in the complex plane, and which shape is unstable?",
    paper="3.4.2, Fig. 6: modes 5 and 6, near 2500 and 3100 Hz without friction, lock in at mu = 0.12, 2800 Hz, "
    "and part in growth rate; at lock-in normal and tangential motion of the contact are strongly coupled.",
    parameters={
        "mu": Parameter(spec.evenly(0.0, 0.2, 2001), "1", "coefficient of friction"),
        "theta": Parameter(paper.THETA, "degree", "inclination of P1", common=True),
    },
    outputs=MODES,
    function=pair,
    coords={"mode": Axis([1, 2], "1", "number of the mode without friction, ascending in frequency")},
    derive=derive, summary=summarise, figure=draw, animate=moving.mode,
    claims=(
        *(Claim("frequency", {"mode": 5 + k, "mu": 0.0}, paper.MODES_5_AND_6[k], "Fig. 6a") for k in (0, 1)),
        *(Claim(f"lock_in_{x}", {}, paper.ONSETS[0][k], "3.4.2") for k, x in enumerate(("mu", "frequency"))),
    ),
    check=check, beams=True,
)  # fmt: skip
