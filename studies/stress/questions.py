"""A case put to a method: scene, arguments and start, in numbers; and whether it is too dear to ask."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fivcore import Rig, Scene, Transient, simulate
from fivcore.contact.reduced import ReducedModel, default_cutoff, full_model, reduced_model
from fivcore.transient import published
from fivcore.transient.exact import STEP as GRID
from fivcore.transient.normalised import Normalised, slip_distance
from studies.stress.case import DURATION, POINT, Case
from studies.stress.limits import driven
from studies.stress.starts import first_state

# Of the drive, s, where a case says nothing else (`fivcore.simulate`).
RAMP = 1e-3
# The cost bound: a case is too dear for a method if it takes longer than this, s, on a nominal core.
MOST_SECONDS = 10.0
# There a mode takes so long in a step of "fast" or "paper", and contact and statistics as long as so many modes.
NOMINAL, CONTACT = 1e-9, 12
# "exact" builds four eigenbases in extended precision, and adds up its work at POINTS / (largest frequency).
BASES, POINTS = 400e-9, 8.0 / 2.5


@dataclass(frozen=True)
class Question:
    """What `fivcore.simulate` is asked.

    Attributes
    ----------
    method : str
    numbers : mapping
        V, theta, mu and F.
    rig : Rig
    duration : float
        s.
    options : mapping
        Further arguments of `fivcore.simulate`.
    start : str
        An initial state of `studies.stress.starts`, or "".
    """

    method: str
    numbers: Mapping[str, float]
    rig: Rig
    duration: float
    options: Mapping[str, Any]
    start: str = ""

    @property
    def theta(self) -> float:
        """Inclination seen from the drive, degrees."""
        return self.numbers["theta"] if self.numbers["V"] > 0.0 else -self.numbers["theta"]

    @cached_property
    def scene(self) -> Scene:
        """The scene; raises where there is none."""
        return Scene(**self.numbers, rig=self.rig)

    @cached_property
    def model(self) -> ReducedModel:
        """The modes and the contact element that the method steps through."""
        if self.method == "paper":
            return full_model(self.rig, self.theta)
        return reduced_model(
            self.rig, self.theta, self.options.get("cutoff"), self.options.get("termination", "absorbing")
        )

    @property
    def step(self) -> float:
        """The method's time step, s; of "exact" the grid of its statistics."""
        own = {"paper": published.STEP, "exact": GRID, "fast": self.model.default_step}
        return float(self.options.get("step") or own[self.method])

    @property
    def ramp(self) -> float:
        """Time in which the clamp of P2 reaches its velocity, s."""
        return float(self.options.get("ramp", RAMP))

    @property
    def initial(self) -> Any:
        """Modal displacements, velocities and contact state; None for rest under the load."""
        return first_state(self.start, self.scene, self.model.kept) if self.start else None

    def ask(self, duration: float | None = None, **more: Any) -> Transient:
        """Put it."""
        asked: dict[str, Any] = {"initial": self.initial, **self.options, **more}
        return simulate(self.scene, self.duration if duration is None else duration, self.method, **asked)

    def seconds(self) -> float:
        """What the run takes on the nominal core, to a factor of two or three; events are not counted."""
        modes = len(self.model.stiffness)
        if self.method == "exact":
            points = POINTS * self.duration * self._fastest()
            return NOMINAL * points * modes * (modes + 7) + BASES * (2 * modes) ** 3
        return NOMINAL * self.duration / self.step * (modes + CONTACT)

    def _fastest(self) -> float:
        """Largest angular frequency of the model, with its contact closed, rad/s."""
        model = self.model
        return float(np.sqrt(model.stiffness.max() + model.contact_frequency**2))

    @property
    def refines_onset(self) -> bool:
        """Whether "fast" may take the onset with more modes than `model` has (`fivcore.transient.fast`)."""
        own = self.options.get("cutoff") is None and not self.start and "contact_motion" not in self.options
        return self.method == "fast" and own and self.options.get("termination") != "none"

    @property
    def plain_cutoff(self) -> dict[str, Any]:
        """What to add so that all of a run is taken with `model`."""
        return {"cutoff": default_cutoff(self.rig)} if self.refines_onset else {}


def question_of(case: Case, method: str) -> tuple[Question, float]:
    """The question that a case is for a method, and the value asked at its edge (NaN: none)."""
    options = {name: value for name, value in case.run.items() if name != "duration"}
    duration = case.run.get("duration", DURATION)
    question = Question(method, {**POINT, **case.scene}, case.rig, duration, options, case.start)
    if case.slips_at:
        # The clamp has then moved by V (t - ramp / 2), after the ramp.
        distance = slip_distance(Normalised.of(question.scene)) * question.numbers["F"]
        V = distance / (case.slips_at - 0.5 * question.ramp)
        question = replace(question, numbers={**question.numbers, "V": V})
    return driven(question, case.edge, case.share) if case.edge else (question, float("nan"))


def too_dear(question: Question) -> bool:
    """Whether the run would take more than MOST_SECONDS."""
    return question.seconds() > MOST_SECONDS
