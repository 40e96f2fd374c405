"""Errors of arguments, of searches for roots, and of transients, which carry their scene."""

from __future__ import annotations

from typing import Any


class InputError(ValueError):
    """An invalid argument; the message names it, its value and the allowed values."""


class UnsolvedError(ArithmeticError):
    """Roots or cycles could not be isolated or followed reliably; the message says where."""


class NoVibrationError(UnsolvedError):
    """The motion near which a limit cycle is sought is stuck or slides steadily."""


class SceneError(RuntimeError):
    """A transient that has no result; `scene` is its `Scene`."""

    def __init__(self, message: str, scene: Any = None) -> None:
        super().__init__(message)
        self.scene = scene


class ContactError(SceneError):
    """The method's contact problem has no unique solution (Painleve)."""


class SceneValueError(SceneError, InputError):
    """An option does not suit the scene, which only the construction of its model reveals."""


class DivergenceError(SceneError):
    """The motion exceeded the range of floating-point numbers."""


class FixedContactWarning(UserWarning):
    """P2 moves further than a model with a fixed contact point can represent."""


class OutOfBandWarning(UserWarning):
    """Sliding is unstable by a mode above the band in which onsets of flutter are searched by default."""


class DampingWarning(UserWarning):
    """No modal damping gives the tied modes of a structure the requested damping ratios."""


class ThinnedWarning(UserWarning):
    """A run is so long that some of its statistics use only parts of it."""


# The band of `OutOfBandWarning`, Hz; the largest share of P2's length that P2 may move without a warning.
BAND, FIXED = 10e3, 0.02


def fixed_contact(moved: float) -> str:
    """Text of `FixedContactWarning`; `moved` is V * duration in units of P2's length."""
    share = f"V * duration is {100.0 * moved:.3g} % of P2's length"
    return f"{share}, by which the contact moves in a rig; here it stays, so the result holds for one position"


def not_unique(mu: float, limit: float) -> ContactError:
    """Make the error for a coefficient of friction at or beyond the Painleve limit."""
    return ContactError(
        f"mu = {mu:g}: from {limit:.6g} on the contact force of this method is not unique (Painleve)"
    )
