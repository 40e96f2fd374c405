"""What is compared: scenes, methods, and the settings that each method is run with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import Rig, Scene
from fivcore.contact.ablation import modified, with_dashpot, without_cross_terms
from fivcore.contact.reduced import ReducedModel, default_cutoff, full_model, reduced_model
from fivcore.contact.step_map import largest_stable_step, stable
from fivcore.transient import published
from studies import paper

METHODS = ("fast", "paper", "paper in finite elements", "exact", "SciPy solve_ivp", "sliding stability")
FAST, PAPER, ELEMENTS, EXACT, EVENTS, LINEAR = METHODS
# The methods of `fivcore.simulate`.
SIMULATED = (FAST, PAPER, EXACT)

# V (m/s), theta (degrees), mu, F (N): the paper's scenes, and one by which no part of a method was chosen.
SCENES = {f"{1e3 * V:g} mm/s": (V, paper.THETA, paper.MU, paper.LOAD) for V in paper.SPEEDS} | {
    "12 degrees": (3e-3, 12.0, 0.35, paper.LOAD)
}


@dataclass(frozen=True)
class Option:
    """One setting of some methods; everything else has its default."""

    kind: str
    # "step": in units of the largest stable one. "cut-off": in units of P1's first axial frequency, c / (4 L).
    # "mesh": factor of both numbers of elements. "tau": factor of the derived relaxation time. Otherwise itself.
    value: float | str
    methods: tuple[str, ...]

    @property
    def name(self) -> str:
        """The setting on its axis."""
        value = f"{self.value:.3g}" if isinstance(self.value, float) else self.value
        return f"{self.kind} {value}".rstrip()

    @property
    def size(self) -> float | None:
        """Factor of the mesh, 1 by default; None where something else is set."""
        return float(self.value) if self.kind == "mesh" else 1.0 if self.kind == "default" else None


OPTIONS = {
    option.name: option
    for option in (
        Option("default", "", METHODS),
        *(Option("step", share, (FAST,)) for share in (0.15, 0.3)),
        Option("step", 0.45, (FAST, PAPER)),
        *(Option("step", share, (FAST,)) for share in (0.6, 0.75, 0.9, 0.98)),
        # Below, just above, and well above P1's second axial mode, which has 3 of these units.
        *(Option("cut-off", units, (FAST, LINEAR)) for units in (1.05, 1.6, 2.1, 2.5, 3.02, 3.1, 4.1, 6.2, 8.3)),
        *(Option("cut-off", units, (LINEAR,)) for units in (16.0, 32.0, 64.0)),
        *(Option("termination", kind, (FAST,)) for kind in ("elastic", "none")),
        Option("mesh", 1.0 / 3.0, (LINEAR,)),
        *(Option("mesh", factor, (FAST, LINEAR)) for factor in (0.5, 2.0)),
        Option("mesh", 4.0, (LINEAR,)),
        *(Option("tau", factor, (FAST,)) for factor in (0.5, 2.0, 4.0)),
        Option("cross terms", "off", (FAST,)),
        Option("leaps", "off", (FAST,)),
        *(Option("beta2", value, (PAPER,)) for value in (0.5, 1.0)),
        *(Option("tolerance", value, (EVENTS,)) for value in (1e-4, 1e-8)),
    )
}
DEFAULT = "default"
# The published scheme without its numerical damping.
UNDAMPED = "beta2 0.5"


def skip(points: Mapping[str, Any]) -> NDArray[np.bool_]:
    """Which combinations of method and setting there are not."""
    pairs = zip(points["method"], points["setting"], strict=True)
    return np.array([method not in OPTIONS[setting].methods for method, setting in pairs], dtype=bool)


def cutoff_of(option: Option, rig: Rig) -> float:
    """The cut-off that an option sets, or the method's own, Hz."""
    if option.kind != "cut-off":
        return default_cutoff(rig)
    beam = rig.p1
    return float(option.value) * float(np.sqrt(beam.young_modulus / beam.density)) / (4.0 * beam.length)


def meshed(scene: Scene, option: Option) -> Scene:
    """The scene on the option's mesh."""
    if option.kind != "mesh":
        return scene
    rig, factor = scene.rig, float(option.value)
    p1, p2 = (replace(beam, elements=max(round(beam.elements * factor), 1)) for beam in (rig.p1, rig.p2))
    return replace(scene, rig=replace(rig, p1=p1, p2=p2))


def arguments(method: str, option: Option, scene: Scene) -> dict[str, Any]:
    """Arguments of `fivcore.simulate` besides a scene (`meshed`) and a ramp."""
    match option.kind:
        case "step":
            return {"step": float(option.value) * step_limit(method, scene)}
        case "cut-off":
            return {"cutoff": cutoff_of(option, scene.rig)}
        case "termination" | "beta2":
            return {option.kind: option.value}
        case "tau":
            return {"modify": partial(with_dashpot, factor=float(option.value))}
        case "cross terms":
            return {"modify": without_cross_terms}
        case "leaps":
            return {"leap": False}
    return {}


def model_of(scene: Scene, options: Mapping[str, Any]) -> ReducedModel:
    """The reduced model of a scene simulated with such `options`."""
    chosen = {name: options[name] for name in ("cutoff", "termination") if name in options}
    return modified(reduced_model(scene.rig, scene.drive_theta, **chosen), options.get("modify"))


def step_limit(method: str, scene: Scene) -> float:
    """The largest step with which a method is stable, s."""
    if method == PAPER:
        model = full_model(scene.rig, scene.theta)
        return published.largest_step(model.stiffness, model.damping, published.BETA2)
    reduced = model_of(scene, {})
    most = reduced.largest_step
    return most if stable(reduced, scene.mu, most) else largest_stable_step(reduced, scene.mu, most)
