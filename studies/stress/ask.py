"""How a case is put to a method: its question in numbers, the limits, and what a refusal fails to state."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fivcore import ContactError, DivergenceError, Rig, Scene, Transient, critical_mu, simulate
from fivcore.contact.reduced import ReducedModel, default_cutoff, full_model, reduced_model
from fivcore.contact.step_map import largest_stable_step, stable
from fivcore.transient import published
from fivcore.transient.exact import STEP as GRID
from fivcore.transient.normalised import Normalised, State, slip_distance
from studies.stress.cases import CONTACT, DIVERGENCE, DURATION, POINT, VALUE, Case
from studies.stress.starts import STARTS

RAMP = 1e-3  # of the drive, s, where a case says nothing else (`fivcore.simulate`)
ERRORS: dict[str, type[Exception]] = {VALUE: ValueError, CONTACT: ContactError, DIVERGENCE: DivergenceError}
FAR = 1e80  # beyond any limit, on either side
# The word before the limit in a refusal, and how near to the limit the number after it must be.
WORDS, DIGITS = ("at most", "at least", "above", "from", "to"), 5e-3
# Limits that are allowed themselves, and how many steps show it.
ALLOWED, STEPS = ("step", "least V/F", "largest V/F"), 10
# Methods that have no such limit: they refuse the argument altogether.
WITHOUT = {"cutoff": ("paper",), "reach": ("exact",)}


@dataclass(frozen=True)
class Question:
    """Arguments of one call of `fivcore.simulate`."""

    method: str
    numbers: Mapping[str, float]  # V, theta, mu and F
    rig: Rig
    duration: float
    options: Mapping[str, Any]  # further arguments of `simulate`
    start: str = ""  # one of STARTS, or ""

    def changed(self, **values: Any) -> Question:
        """The question with other numbers of the scene, another duration, other arguments."""
        numbers = {name: values.pop(name, value) for name, value in self.numbers.items()}
        duration = values.pop("duration", self.duration)
        return replace(self, numbers=numbers, duration=duration, options={**self.options, **values})

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
        termination = self.options.get("termination", "absorbing")
        return reduced_model(self.rig, self.theta, self.options.get("cutoff"), termination)

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
        start = STARTS.get(self.start)
        return start and start.build(self.scene, self.model.kept, *start.arguments)

    @property
    def state(self) -> State | None:
        """The initial state, per N of load."""
        given, load = self.initial, self.numbers["F"]
        return None if given is None else State(given[0] / load, given[1] / load, given[2])

    @property
    def plain_cutoff(self) -> dict[str, Any]:
        """Options that keep all of a run on `model`: "fast" may use more modes for the onset."""
        own = self.options.get("cutoff") is None and not self.start and "contact_motion" not in self.options
        refines = self.method == "fast" and own and self.options.get("termination") != "none"
        return {"cutoff": default_cutoff(self.rig)} if refines else {}

    def ask(self, duration: float | None = None, **more: Any) -> Transient:
        """Simulate it, by default for its own duration."""
        options: dict[str, Any] = {"initial": self.initial, **self.options, **more}
        return simulate(self.scene, self.duration if duration is None else duration, self.method, **options)


def question_of(case: Case, method: str) -> tuple[Question, float]:
    """The question that a case is for a method, and the value at its edge; NaN where nothing had to change."""
    options = {name: value for name, value in case.run.items() if name != "duration"}
    duration = case.run.get("duration", DURATION)
    question = Question(method, {**POINT, **case.scene}, case.rig, duration, options, case.start)
    if case.slips_at:
        # The clamp has then moved by V (t - ramp / 2), after the ramp.
        distance = slip_distance(Normalised.of(question.scene)) * question.numbers["F"]
        question = question.changed(V=distance / (case.slips_at - 0.5 * question.ramp))
    fits = case.edge == "fitting step"
    if not case.edge or (fits and method != "paper"):
        return question, float("nan")
    value = case.share * LIMITS[case.edge](question)
    if fits and value >= published.STEP:
        return question, float("nan")
    assert np.isfinite(value) or case.edge == "reach", f"no limit of {case.edge} is known"
    return _at(question, case.edge, value), value


def _at(question: Question, edge: str, value: float) -> Question:
    """The question with a value of what an edge limits; of the two numbers in V / F, V is moved."""
    if edge.endswith("V/F"):
        return question.changed(V=value * question.numbers["F"])
    argument = {"fitting step": "step", "samples": "sample_rate", "reach": "duration"}.get(edge, edge)
    return question.changed(**{argument: value})


def stated(message: str, word: str) -> float:
    """The number that follows a word in a message; NaN where none does."""
    match = re.search(rf"\b{word} ([-+]?\d+\.?\d*(?:e[-+]?\d+)?)", message)
    return float(match.group(1)) if match else float("nan")


def _refusal(question: Question, kind: type[Exception] = ValueError) -> str:
    """The message with which a question is refused; "" if it is not."""
    try:
        question.ask()
    except kind as refusal:
        return str(refusal)
    return ""


def _largest_step(question: Question) -> float:
    """The largest stable step of "fast" or "paper", s."""
    model, mu = question.model, question.numbers["mu"]
    if question.method == "paper":
        return published.largest_step(model.stiffness, model.damping, published.BETA2)
    limit = model.largest_step
    return limit if stable(model, mu, limit) else largest_stable_step(model, mu, limit)


def _critical_friction(question: Question) -> float:
    options = {k: v for k, v in question.options.items() if k in ("cutoff", "termination", "step")}
    return critical_mu(question.rig, question.theta, question.method, **options)


# How far each method can be driven: computed from its own functions, or read from its refusal.
LIMITS: dict[str, Callable[[Question], float]] = {
    "step": _largest_step,
    "fitting step": _largest_step,
    "mu": _critical_friction,
    "least V/F": lambda question: stated(_refusal(question.changed(V=1.0 / FAR)), "from"),
    "largest V/F": lambda question: stated(_refusal(question.changed(V=FAR)), "to"),
    "reach": lambda question: stated(_refusal(question.changed(duration=1e5)), "at most"),
    "cutoff": lambda question: stated(_refusal(replace(question.changed(cutoff=1.0), method="fast")), "above"),
    "samples": lambda question: stated(_refusal(question.changed(sample_rate=1e9)), "at most"),
}


def not_stated(case: Case, question: Question, value: float, expected: str) -> float:
    """How many things a refusal fails to state: the argument; its limit; and a limit stated must be allowed."""
    message = _refusal(question, ERRORS[expected])
    if not message:
        raise AssertionError(f"{question.method} does what it should refuse with {expected}")
    wrong = float(bool(case.names) and case.names not in message)
    # Without a value nothing was driven to a limit.
    driven = bool(case.edge) and not np.isnan(value)
    if not driven or question.method in WITHOUT.get(case.edge, ()) or expected == DIVERGENCE:
        return wrong
    limit = value / case.share
    near = [number for number in (stated(message, word) for word in WORDS) if abs(number / limit - 1.0) <= DIGITS]
    if near and case.edge in ALLOWED:
        within = _at(question, case.edge, near[0])
        wrong += float(bool(_refusal(within.changed(duration=STEPS * within.step))))
    return wrong + float(not near)
