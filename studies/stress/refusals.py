"""Whether a refusal is the one expected, and tells what a user needs to go on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fivcore import ContactError, DivergenceError
from studies.stress.case import CONTACT, DIVERGENCE, VALUE, Case
from studies.stress.limits import stated
from studies.stress.questions import Question

ERRORS: dict[str, type[Exception]] = {VALUE: ValueError, CONTACT: ContactError, DIVERGENCE: DivergenceError}
# The word before the limit in a refusal, and to how much of itself the limit is told.
TOLD, DIGITS = ("at most", "at least", "above", "from", "to"), 5e-3
# Limits that are allowed themselves, and how many steps show it.
ALLOWED, STEPS = ("step", "least pace", "largest pace"), 10
# Methods that have no such limit: they refuse the argument altogether.
WITHOUT = {"cutoff": ("paper",), "reach": ("exact",)}


def missing(case: Case, question: Question, asked: float, expected: str) -> float:
    """How many things a refusal fails to tell: the argument; its limit; and a limit that is told must be allowed.

    Raises
    ------
    AssertionError
        If there is no refusal.
    Exception
        If it is another than the one expected: that one.
    """
    message = refusal(question, expected)
    wrong = float(bool(case.names) and case.names not in message)
    # Without a number asked nothing was driven to a limit.
    driven = bool(case.edge) and not np.isnan(asked)
    if not driven or question.method in WITHOUT.get(case.edge, ()) or expected == DIVERGENCE:
        return wrong
    limit = asked / case.share
    told = [number for number in (stated(message, word) for word in TOLD) if abs(number / limit - 1.0) <= DIGITS]
    if not told:
        return wrong + 1.0
    if case.edge in ALLOWED and not _accepted(question, case.edge, told[0]):
        wrong += 1.0
    return wrong


def refusal(question: Question, expected: str) -> str:
    """The message with which a question is refused."""
    try:
        question.ask()
    except ERRORS[expected] as error:
        return str(error)
    raise AssertionError(f"{question.method} does what it should refuse with {expected}")


def _accepted(question: Question, edge: str, value: float) -> bool:
    """Whether a question at the limit that was told is taken."""
    numbers, options = dict(question.numbers), dict(question.options)
    if edge == "step":
        options["step"] = value
    else:
        numbers["V"] = value * numbers["F"]
    within = replace(question, numbers=numbers, options=options)
    try:
        within.ask(STEPS * within.step)
    except ValueError:
        return False
    return True
