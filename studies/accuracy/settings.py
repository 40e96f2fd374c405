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

FAST, PAPER, ELEMENTS, EXACT, EVENTS, LINEAR = range(6)
# As they are called by a reader; the first two and EXACT are `fivcore.simulate`'s.
METHODS = (
    "fast",
    "paper",
    "paper in finite elements",
    "exact",
    "SciPy solve_ivp",
    "sliding stability",
)
SIMULATED = {FAST: "fast", PAPER: "paper", EXACT: "exact"}

# Name, V (m/s), theta (degrees), mu, F (N): the paper's, and one that no part of a method was chosen by.
SCENES = (
    *((f"{1e3 * V:g} mm/s", V, paper.THETA, paper.MU, paper.LOAD) for V in paper.SPEEDS),
    ("12 degrees", 3e-3, 12.0, 0.35, paper.LOAD),
)

# Of a method's largest stable step: to stay below it.
BELOW = 0.98
# Relative tolerance of solve_ivp.
TOLERANCE = 1e-6


@dataclass(frozen=True)
class Option:
    """One setting of a method; everything else is as it is by default.

    Attributes
    ----------
    kind : str
        What is set; "default" sets nothing.
    value : float or str
        "step": in units of the largest stable one. "cut-off": in units of P1's first axial frequency, c / (4 L).
        "mesh": factor of both numbers of elements. "tau": factor of the derived relaxation time. "contact": the
        `contact_motion`. "beta2", "tolerance", "termination": itself.
    methods : tuple of int
        Which have it.
    share : float
        With a cut-off: the step in units of its largest stable one; 0: its default.
    """

    kind: str
    value: float | str
    methods: tuple[int, ...]
    share: float = 0.0

    @property
    def size(self) -> float | None:
        """Factor of the mesh, 1 by default; None where something else is set."""
        if self.kind == "default":
            return 1.0
        return float(self.value) if self.kind == "mesh" else None

    def label(self, rig: Rig) -> str:
        """The setting for a reader."""
        value = self.value
        if self.kind == "cut-off":
            step = f", step {self.share:g} of its limit" if self.share else ""
            return f"cut-off {1e-3 * cutoff_of(self, rig):.3g} kHz{step}"
        if isinstance(value, str):
            return f"{self.kind} {value}" if value else self.kind
        if self.kind == "step":
            return f"step {value:g} of its limit"
        if self.kind == "contact":
            return "contact moving"
        if self.kind in ("mesh", "tau"):
            return f"{self.kind} x {value:.3g}"
        return f"{self.kind} {value:g}"


OPTIONS = (
    Option("default", "", (FAST, PAPER, ELEMENTS, EXACT, EVENTS, LINEAR)),
    *(Option("step", share, (FAST,)) for share in (0.15, 0.3)),
    Option("step", 0.45, (FAST, PAPER)),
    *(Option("step", share, (FAST,)) for share in (0.6, 0.75, 0.9, BELOW)),
    # Below, just above, and well above P1's second axial mode, which has 3 of these units.
    *(Option("cut-off", units, (FAST, LINEAR)) for units in (1.05, 1.6, 2.1, 2.5, 3.02, 3.1, 4.1, 6.2, 8.3)),
    *(Option("cut-off", units, (LINEAR,)) for units in (16.0, 32.0, 64.0)),
    *(Option("cut-off", 3.02, (FAST,), share) for share in (0.75, 0.9)),
    *(Option("termination", kind, (FAST,)) for kind in ("elastic", "none")),
    Option("mesh", 1.0 / 3.0, (LINEAR,)),
    *(Option("mesh", factor, (FAST, LINEAR)) for factor in (0.5, 2.0)),
    Option("mesh", 4.0, (LINEAR,)),
    *(Option("tau", factor, (FAST,)) for factor in (0.5, 2.0, 4.0)),
    Option("cross terms", "off", (FAST,)),
    Option("contact", 1.0, (FAST,)),
    Option("leaps", "off", (FAST,)),
    *(Option("beta2", value, (PAPER,)) for value in (0.5, 1.0)),
    *(Option("tolerance", value, (EVENTS,)) for value in (1e-4, 1e-8)),
)
DEFAULT = 0
# The published scheme without its numerical damping.
UNDAMPED = next(k for k, option in enumerate(OPTIONS) if (option.kind, option.value) == ("beta2", 0.5))


def skip(points: Mapping[str, Any]) -> NDArray[np.bool_]:
    """Which combinations of method and setting there are not."""
    pairs = zip(points["method"], points["setting"], strict=True)
    return np.array([int(method) not in OPTIONS[int(setting)].methods for method, setting in pairs], dtype=bool)


def scene_of(number: int, rig: Rig) -> Scene:
    """The scene that has this number, on this rig."""
    _, V, theta, mu, F = SCENES[number]
    return Scene(V, theta, mu, F, rig)


def cutoff_of(option: Option, rig: Rig) -> float:
    """The cut-off that an option asks for, or the method's own, Hz."""
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


def arguments(method: int, option: Option, scene: Scene) -> dict[str, Any]:
    """What `fivcore.simulate` is given besides a scene (`meshed`) and a ramp."""
    given: dict[str, Any] = {}
    if option.kind == "step":
        given["step"] = float(option.value) * step_limit(method, scene, given)
    elif option.kind == "cut-off":
        given["cutoff"] = cutoff_of(option, scene.rig)
        if option.share:
            given["step"] = option.share * step_limit(method, scene, given)
    elif option.kind == "termination":
        given["termination"] = option.value
    elif option.kind == "tau":
        given["modify"] = partial(with_dashpot, factor=float(option.value))
    elif option.kind == "cross terms":
        given["modify"] = without_cross_terms
    elif option.kind == "leaps":
        given["leap"] = False
    elif option.kind == "contact":
        given["contact_motion"] = int(option.value)
    elif option.kind == "beta2":
        given["beta2"] = option.value
    return given


def model_of(scene: Scene, given: Mapping[str, Any]) -> ReducedModel:
    """The reduced model that arguments of `fivcore.simulate` stand for."""
    chosen = {name: given[name] for name in ("cutoff", "termination") if name in given}
    return modified(reduced_model(scene.rig, scene.drive_theta, **chosen), given.get("modify"))


def step_limit(method: int, scene: Scene, given: Mapping[str, Any]) -> float:
    """The largest step with which a method is stable, s."""
    if method == PAPER:
        model = full_model(scene.rig, scene.theta)
        return published.largest_step(model.stiffness, model.damping, published.BETA2)
    model = model_of(scene, given)
    most = model.largest_step
    return most if stable(model, scene.mu, most) else largest_stable_step(model, scene.mu, most)


def tolerance_of(option: Option) -> float:
    """The relative tolerance of solve_ivp."""
    return float(option.value) if option.kind == "tolerance" else TOLERANCE
