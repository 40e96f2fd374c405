"""Scenes, methods, and the settings that each method is run with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import Rig, Scene
from fivcore.contact.ablation import modified, with_dashpot, without_cross_terms
from fivcore.contact.reduced import ReducedModel, default_cutoff, full_model, reduced_model
from fivcore.contact.step_map import largest_stable_step, stable
from fivcore.transient.published import STEP
from studies import paper
from studies.accuracy.pseudo_modes import with_pseudo_modes
from studies.accuracy.rigs import drawn_scene

METHODS = ("fast", "paper", "exact", "SciPy solve_ivp")
FAST, PAPER, EXACT, EVENTS = METHODS

# V (m/s), theta (degrees), mu, F (N) of the scenes of the paper's rig, and the others' numbers in their sequence.
OWN = {f"{1e3 * V:g} mm/s": (V, paper.THETA, paper.MU, paper.LOAD) for V in paper.SPEEDS}
SEED = 2010
DRAWN = {f"rig {number}": number for number in range(8)}
SCENES = (*OWN, *DRAWN)
# Scenes of the published scheme, and of the methods that are more expensive still.
REFERRED = (*OWN, "rig 0", "rig 1")
CHECKED = ("5 mm/s", "rig 0")


@dataclass(frozen=True)
class Option:
    """One setting of some methods; everything else has its default."""

    kind: str
    # "step": in units of the largest stable one. "cut-off" and "truncation", which has no element: in units of the
    # default cut-off. "damping": factor of the element's. "pseudo-modes": their share of critical damping.
    value: float | str = ""
    methods: tuple[str, ...] = (FAST,)

    @property
    def name(self) -> str:
        """The setting on its axis."""
        value = f"{self.value:.3g}" if isinstance(self.value, float) else self.value
        return f"{self.kind} {value}".rstrip()

    def scenes(self, method: str) -> tuple[str, ...]:
        """Where it is run with a method."""
        if method == FAST:
            return REFERRED if self.name == PUBLISHED else SCENES
        return REFERRED if (method, self.name) == (PAPER, DEFAULT) else CHECKED


DEFAULT, CONVERGED = "default", "converged"
PUBLISHED, MODEL = (f"numerical damping {name}" for name in ("published", "none"))
# Cut-off and step of `fast` that are taken for converged, in units of the default and of that model's own.
HIGHER, FINER = 3.0, 0.5
OPTIONS = {
    option.name: option
    for option in (
        Option(DEFAULT, methods=METHODS),
        Option(CONVERGED),
        Option("numerical damping", "published"),
        Option("numerical damping", "none", (PAPER,)),
        *(Option("step", share) for share in (0.25, 0.5, 0.98)),
        *(Option("cut-off", share) for share in (0.4, 0.64, 0.8, 1.4, 2.0)),
        *(Option("damping", factor) for factor in (1.0 / 3.0, 3.0)),
        *(Option("termination", kind) for kind in ("elastic", "none")),
        *(Option("truncation", share) for share in (1.4, 2.0)),
        *(Option("pseudo-modes", damping) for damping in ("bandwidth", 0.02)),
        Option("cross terms", "off"),
    )
}
# What each method and setting is compared with: the published scheme, or the model as given.
SCHEME, GIVEN = (PAPER, DEFAULT), (FAST, CONVERGED)
REFERENCES = {(FAST, PUBLISHED): SCHEME}


def skip(points: Mapping[str, Any]) -> NDArray[np.bool_]:
    """Which combinations of method, setting and scene there are not."""
    every = zip(points["method"], points["setting"], points["scene"], strict=True)
    return np.array(
        [
            method not in (option := OPTIONS[setting]).methods or scene not in option.scenes(method)
            for method, setting, scene in every
        ],
        dtype=bool,
    )


@lru_cache(maxsize=len(SCENES))
def scene_of(name: str, rig: Rig) -> Scene:
    """The scene by its name; `rig` is that of the paper's scenes."""
    return Scene(*OWN[name], rig) if name in OWN else drawn_scene(SEED, DRAWN[name])


def arguments(method: str, option: Option, scene: Scene) -> dict[str, Any]:
    """Arguments of `fivcore.simulate` besides a scene and a ramp."""
    base = default_cutoff(scene.rig)
    share = option.value if isinstance(option.value, float) else 1.0
    match option.kind:
        case "numerical damping":
            return {"numerical_damping": option.value} | ({"step": 0.5 * STEP} if method == PAPER else {})
        case "converged":
            cutoff = HIGHER * base
            own = reduced_model(scene.rig, scene.drive_theta, cutoff).default_step
            return {"cutoff": cutoff, "step": FINER * own}
        case "step":
            return {"step": share * step_limit(scene)}
        case "cut-off":
            return {"cutoff": share * base}
        case "truncation":
            return {"cutoff": share * base, "termination": "none"}
        case "termination":
            return {"termination": option.value}
        case "damping":
            return {"modify": partial(with_dashpot, factor=share)}
        case "pseudo-modes":
            # A given cut-off has no finer model for the onset, where pseudo-modes would have no counterpart.
            full = full_model(scene.rig, scene.drive_theta)
            damping = None if option.value == "bandwidth" else share
            return {"cutoff": base, "modify": partial(with_pseudo_modes, full=full, damping=damping)}
        case "cross terms":
            return {"modify": without_cross_terms}
    return {}


def model_of(method: str, scene: Scene, options: Mapping[str, Any]) -> ReducedModel:
    """The model of a scene simulated with such `options`."""
    if method == PAPER:
        return full_model(scene.rig, scene.drive_theta)
    chosen = {name: options[name] for name in ("cutoff", "termination") if name in options}
    return modified(reduced_model(scene.rig, scene.drive_theta, **chosen), options.get("modify"))


def step_limit(scene: Scene) -> float:
    """The largest step with which `fast` is stable by default, s."""
    reduced = model_of(FAST, scene, {})
    most = reduced.largest_step
    return most if stable(reduced, scene.mu, most) else largest_stable_step(reduced, scene.mu, most)
