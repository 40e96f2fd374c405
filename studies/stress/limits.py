"""How far each method can be driven: limits computed from its own functions, or read from what it says in refusal.

Each limit is of one argument of a question (`studies.stress.questions`); a case asks for a share of it.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fivcore import critical_mu
from fivcore.contact.reduced import full_model, reduced_model
from fivcore.contact.step_map import largest_stable_step, stable
from fivcore.transient import published

if TYPE_CHECKING:
    from studies.stress.questions import Question

NUMBER = r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?"
# Far beyond any limit, on either side.
FAR = 1e80


def largest_step(question: Question) -> float:
    """The largest stable step of the method, s; NaN for "exact", which has none."""
    rig, theta, mu = question.rig, question.theta, question.numbers["mu"]
    if question.method == "exact":
        return float("nan")
    if question.method == "paper":
        full = full_model(rig, theta)
        return published.largest_step(full.stiffness, full.damping, published.BETA2)
    options = question.options
    model = reduced_model(rig, theta, options.get("cutoff"), options.get("termination", "absorbing"))
    limit = model.largest_step
    return limit if stable(model, mu, limit) else largest_stable_step(model, mu, limit)


def critical_friction(question: Question) -> float:
    """The coefficient of friction from which on the method's contact force is not unique."""
    options = {k: v for k, v in question.options.items() if k in ("cutoff", "termination", "step")}
    return critical_mu(question.rig, question.theta, question.method, **options)


def stated(message: str, word: str) -> float:
    """The number that follows a word in a message; NaN where none does."""
    found = re.search(rf"\b{word} ({NUMBER})", message)
    return float(found.group(1)) if found else float("nan")


def said_beyond(question: Question, word: str) -> float:
    """The number that follows `word` in the refusal of a question that goes too far."""
    try:
        question.ask()
    except ValueError as refusal:
        return stated(str(refusal), word)
    return float("nan")


def _pace(question: Question, V: float, word: str) -> float:
    return said_beyond(replace(question, numbers={**question.numbers, "V": V}), word)


def _longest(question: Question) -> float:
    return said_beyond(replace(question, duration=1e5), "at most")


def _least_cutoff(question: Question) -> float:
    options = {**question.options, "cutoff": 1.0}
    return said_beyond(replace(question, options=options, method="fast"), "above")


def _most_samples(question: Question) -> float:
    options = {**question.options, "sample_rate": 1e9}
    return said_beyond(replace(question, options=options), "at most")


LIMITS: dict[str, Callable[[Question], float]] = {
    "step": largest_step,
    "fitting step": largest_step,
    "mu": critical_friction,
    "least pace": lambda question: _pace(question, 1.0 / FAR, "from"),
    "largest pace": lambda question: _pace(question, FAR, "to"),
    "reach": _longest,
    "cutoff": _least_cutoff,
    "samples": _most_samples,
}


def driven(question: Question, edge: str, share: float) -> tuple[Question, float]:
    """The question with `share` of a limit asked, and the value asked for; NaN where nothing had to change."""
    limit = LIMITS[edge](question)
    value = share * limit
    numbers, options = dict(question.numbers), dict(question.options)
    if edge == "fitting step":
        if question.method != "paper" or value >= published.STEP:
            return question, float("nan")
        options["step"] = value
    elif edge == "mu":
        numbers["mu"] = value
    elif edge.endswith("pace"):
        # Of the two numbers in the ratio, V is moved.
        numbers["V"] = value * numbers["F"]
    elif edge == "reach":
        return replace(question, duration=value), value
    elif edge == "samples":
        options["sample_rate"] = value
    else:
        options[edge] = value
    assert np.isfinite(value), f"no limit of {edge} is known"
    return replace(question, numbers=numbers, options=options), value
