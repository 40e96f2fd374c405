"""Errors of arguments, of searches for roots, and of transients, which carry their scene."""

from __future__ import annotations

from typing import Any


class InputError(ValueError):
    """An argument cannot be used; the message names it, its value and what would do."""


class UnsolvedError(ArithmeticError):
    """Roots could not be told apart or followed with certainty; the message says where."""


class SceneError(RuntimeError):
    """A transient without an answer; `scene` is the `Scene` of it."""

    def __init__(self, message: str, scene: Any = None) -> None:
        super().__init__(message)
        self.scene = scene


class ContactError(SceneError):
    """The method's contact problem has no unique solution (Painleve)."""


class SceneValueError(SceneError, InputError):
    """An option of the run has a value that does not suit this scene, which shows only once its model is made."""


class DivergenceError(SceneError):
    """The motion left the range of numbers."""


def not_unique(mu: float, critical: float) -> ContactError:
    """Make the error for a coefficient of friction at or beyond the critical one."""
    return ContactError(
        f"mu = {mu:g}: from {critical:.6g} on the contact force of this method is not unique (Painleve)"
    )
