"""Errors of a transient; each carries its scene."""

from __future__ import annotations

from typing import Any


class SceneError(RuntimeError):
    """A transient without an answer.

    Attributes
    ----------
    scene : Scene
    """

    def __init__(self, message: str, scene: Any = None) -> None:
        super().__init__(message)
        self.scene = scene


class ContactError(SceneError):
    """The method's contact problem has no unique solution (Painleve)."""


class SceneValueError(SceneError, ValueError):
    """An option of the run has a value that does not suit this scene, which shows only once its model is made."""


class DivergenceError(SceneError):
    """The motion left the range of numbers."""


def not_unique(mu: float, critical: float) -> ContactError:
    """Make the error for a coefficient of friction at or beyond the critical one."""
    return ContactError(
        f"mu = {mu:g}: from {critical:.6g} on the contact force of this method is not unique (Painleve)"
    )
