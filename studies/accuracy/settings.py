"""Scenes, methods, and the settings of each method."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache, partial
from typing import Any, NamedTuple

import fivcore
from fivcore import ReducedModel, Rig, Scene, full_model, modified, published, reduced_model
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
    given: Mapping[str, Any] = {}  # arguments of `simulate` that are equal for all scenes
    cutoff: float = 0.0  # in units of the scene's default, if any
    step: float = 0.0  # in units of the largest stable one, if any
    finer: float = 0.0  # by how much shorter the step is than the model's default, if any
    scenes: Mapping[str, tuple[str, ...]] = {FAST: SCENES}  # by method

    def options(self, scene: Scene) -> dict[str, Any]:
        """Arguments of `simulate` that differ from the defaults."""
        options = {**self.given}
        if self.cutoff:
            options["cutoff"] = self.cutoff * fivcore.default_cutoff(scene.rig)
        if self.finer:
            options["step"] = model_of(FAST, scene, options).default_step / self.finer
        if self.step:
            options["step"] = self.step * largest_step(model_of(FAST, scene, options), scene.mu)
        return options


def largest_step(model: ReducedModel, mu: float) -> float:
    """The largest stable step of `fast`, s."""
    limit = model.largest_step
    return limit if fivcore.is_stable_step(model, mu, limit) else fivcore.largest_stable_step(model, mu, limit)


DEFAULT, CONVERGED = "default", "converged"
PUBLISHED, MODEL = (f"numerical damping {name}" for name in ("published", "none"))
HALF_STEP = {"numerical_damping": "none", "step": 0.5 * published.PAPER_STEP}
SETTINGS = {
    DEFAULT: Setting("default", scenes={FAST: SCENES, PAPER: FIVE, EXACT: TWO}),
    CONVERGED: Setting("converged", cutoff=3.0, finer=2.0),
    PUBLISHED: Setting("published damping", {"numerical_damping": "published"}, scenes={FAST: FIVE}),
    MODEL: Setting("no numerical damping", HALF_STEP, scenes={PAPER: TWO}),
    **{f"step {x:g}": Setting("step", step=x) for x in (0.25, 0.5, 0.98)},
    **{f"cut-off {x:g}": Setting("cut-off", cutoff=x) for x in (0.4, 0.64, 0.8, 1.4, 2.0)},
    **{
        f"damping {x:.3g}": Setting("damping", {"modify": partial(with_dashpot, factor=x)})
        for x in (0.0, 1.0 / 3.0, 3.0)
    },
    **{f"truncation {x:g}": Setting("truncation", {"modify": truncated}, cutoff=x) for x in (1.0, 1.4, 2.0)},
    "cross terms off": Setting("no cross terms", {"modify": without_cross_terms}),
}
# What settings are compared with: that with the published scheme's damping with the scheme, others with the model.
SCHEME, GIVEN = (PAPER, DEFAULT), (FAST, CONVERGED)
