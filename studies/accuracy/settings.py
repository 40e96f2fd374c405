"""Scenes, methods, and the settings of each method."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import Any, NamedTuple

import fivcore
from fivcore import ReducedModel, Rig, Scene, full_model, is_stable_step, modified, published, reduced_model
from studies import paper
from studies.accuracy.ablation import truncated, with_dashpot, without_cross_terms
from studies.accuracy.rigs import drawn_scene

METHODS = FAST, PAPER, EXACT = ("fast", "paper", "exact")
# V, theta, mu and F of the scenes of the paper's rig; the numbers of the drawn ones in their sequence.
PAPERS = {f"{1e3 * V:g} mm/s": (V, paper.THETA, paper.MU, paper.LOAD) for V in paper.SPEEDS}
SEED, DRAWN = 2010, {f"rig {number}": number for number in range(8)}
SCENES = (*PAPERS, *DRAWN)
# Scenes of the published scheme, and of what is more expensive still.
FIVE, TWO = (*PAPERS, "rig 0", "rig 1"), ("5 mm/s", "rig 0")


@lru_cache(maxsize=len(SCENES))
def scene_of(name: str, rig: Rig) -> Scene:
    """The scene by its name; `rig` is that of the paper's scenes."""
    return Scene(*PAPERS[name], rig) if name in PAPERS else drawn_scene(SEED, DRAWN[name])


def model_of(method: str, scene: Scene, options: Mapping[str, Any]) -> ReducedModel:
    """The reduced model with which a scene is simulated with these `options`."""
    if method == PAPER:
        return full_model(scene.rig, scene.drive_theta)
    return modified(reduced_model(scene.rig, scene.drive_theta, options.get("cutoff")), options.get("modify"))


class Setting(NamedTuple):
    """One way to run some methods."""

    kind: str  # settings of one kind are one curve of the figure
    of: Callable[[Scene], dict[str, Any]] = lambda scene: {}  # options of `simulate` that depend on the scene
    fixed: Mapping[str, Any] = {}  # and those that do not
    scenes: Mapping[str, tuple[str, ...]] = {FAST: SCENES}  # by method

    def options(self, scene: Scene) -> dict[str, Any]:
        """Arguments of `simulate` that differ from the defaults."""
        return {**self.of(scene), **self.fixed}


def _step(factor: float, scene: Scene) -> dict[str, Any]:  # in units of the largest stable one
    model = model_of(FAST, scene, {})
    limit = model.largest_step
    if not is_stable_step(model, scene.mu, limit):
        limit = fivcore.largest_stable_step(model, scene.mu, limit)
    return {"step": factor * limit}


def _cutoff(factor: float, scene: Scene) -> dict[str, Any]:
    return {"cutoff": factor * fivcore.default_cutoff(scene.rig)}


def _converged(scene: Scene) -> dict[str, Any]:
    options = _cutoff(3.0, scene)
    return options | {"step": 0.5 * model_of(FAST, scene, options).default_step}


DEFAULT, CONVERGED = "default", "converged"
PUBLISHED, MODEL = (f"numerical damping {name}" for name in ("published", "none"))
HALF_STEP = {"numerical_damping": "none", "step": 0.5 * published.PAPER_STEP}
SETTINGS = {
    DEFAULT: Setting("default", scenes={FAST: SCENES, PAPER: FIVE, EXACT: TWO}),
    CONVERGED: Setting("converged", _converged),
    PUBLISHED: Setting("published damping", fixed={"numerical_damping": "published"}, scenes={FAST: FIVE}),
    MODEL: Setting("no numerical damping", fixed=HALF_STEP, scenes={PAPER: TWO}),
}
SETTINGS |= {f"step {x:g}": Setting("step", partial(_step, x)) for x in (0.25, 0.5, 0.98)}
SETTINGS |= {f"cut-off {x:g}": Setting("cut-off", partial(_cutoff, x)) for x in (0.4, 0.64, 0.8, 1.4, 2.0)}
for x in (0.0, 1.0 / 3.0, 3.0):
    SETTINGS[f"damping {x:.3g}"] = Setting("damping", fixed={"modify": partial(with_dashpot, factor=x)})
for x in (1.0, 1.4, 2.0):
    SETTINGS[f"truncation {x:g}"] = Setting("truncation", partial(_cutoff, x), {"modify": truncated})
SETTINGS["cross terms off"] = Setting("no cross terms", fixed={"modify": without_cross_terms})
# What each method and setting is compared with: the published scheme, or the model as given.
SCHEME, GIVEN = (PAPER, DEFAULT), (FAST, CONVERGED)
REFERENCES = {(FAST, PUBLISHED): SCHEME}
