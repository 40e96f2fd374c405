"""Scenes, methods, and the settings with which each method runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import Any, NamedTuple

import fivcore
from fivcore import ReducedModel, Rig, Scene, full_model, is_stable_step, modified, published, reduced_model
from studies import paper
from studies.accuracy.ablation import truncated, with_dashpot, without_cross_terms
from studies.accuracy.rigs import drawn_scene

PAPER_STEP = published.PAPER_STEP
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
    """The model of a scene simulated with such `options`."""
    if method == PAPER:
        return full_model(scene.rig, scene.drive_theta)
    return modified(reduced_model(scene.rig, scene.drive_theta, options.get("cutoff")), options.get("modify"))


def _step(scene: Scene, factor: float) -> dict[str, Any]:  # in units of the largest stable one
    model = model_of(FAST, scene, {})
    largest = model.largest_step
    limit = (
        largest
        if is_stable_step(model, scene.mu, largest)
        else fivcore.largest_stable_step(model, scene.mu, largest)
    )
    return {"step": factor * limit}


def _cutoff(scene: Scene, factor: float, **options: Any) -> dict[str, Any]:
    return {"cutoff": factor * fivcore.default_cutoff(scene.rig), **options}


def _converged(scene: Scene) -> dict[str, Any]:
    options = _cutoff(scene, 3.0)
    return options | {"step": 0.5 * model_of(FAST, scene, options).default_step}


def _fixed(_: Scene, **options: Any) -> dict[str, Any]:
    return options


class Setting(NamedTuple):
    """One way to run some methods."""

    kind: str  # settings of one kind are one curve of the figure
    options: Callable[[Scene], dict[str, Any]]  # arguments of `simulate` that differ from the defaults
    scenes: Mapping[str, tuple[str, ...]]  # by method


def _fast(kind: str, options: Callable[..., dict[str, Any]], **values: Any) -> Setting:
    return Setting(kind, partial(options, **values), {FAST: SCENES})


DEFAULT, CONVERGED = "default", "converged"
PUBLISHED, MODEL = (f"numerical damping {name}" for name in ("published", "none"))
SETTINGS = {
    DEFAULT: Setting("default", _fixed, {FAST: SCENES, PAPER: FIVE, EXACT: TWO}),
    CONVERGED: _fast("converged", _converged),
    PUBLISHED: Setting("published damping", partial(_fixed, numerical_damping="published"), {FAST: FIVE}),
    MODEL: Setting(
        "no numerical damping", partial(_fixed, numerical_damping="none", step=0.5 * PAPER_STEP), {PAPER: TWO}
    ),
    **{f"step {x:g}": _fast("step", _step, factor=x) for x in (0.25, 0.5, 0.98)},
    **{f"cut-off {x:g}": _fast("cut-off", _cutoff, factor=x) for x in (0.4, 0.64, 0.8, 1.4, 2.0)},
    **{
        f"damping {x:.3g}": _fast("damping", _fixed, modify=partial(with_dashpot, factor=x))
        for x in (0.0, 1.0 / 3.0, 3.0)
    },
    **{f"truncation {x:g}": _fast("truncation", _cutoff, factor=x, modify=truncated) for x in (1.0, 1.4, 2.0)},
    "cross terms off": _fast("no cross terms", _fixed, modify=without_cross_terms),
}
# What each method and setting is compared with: the published scheme, or the model as given.
SCHEME, GIVEN = (PAPER, DEFAULT), (FAST, CONVERGED)
REFERENCES = {(FAST, PUBLISHED): SCHEME}
