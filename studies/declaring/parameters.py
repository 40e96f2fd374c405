"""Parameters of studies, and those common to all rigs, scenes and runs."""

from __future__ import annotations

import difflib
import sys
import warnings
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fivcore import BEAM_PARAMETERS, DECAYS, FRICTION_PARAMETERS, RIG_PARAMETERS, Friction, Rig
from studies import paper
from sweeps import Axis, InputError


@dataclass(frozen=True, eq=False)
class Parameter:
    """A number or a word that a study depends on.

    Parameters
    ----------
    default : float, int, str, None or array_like
        One value: the parameter is fixed unless a run asks for several. An array of numbers or words: an axis of
        the result. An int takes whole numbers only; None is written "auto" and leaves the value to the method.
    units, text : str
        As UDUNITS reads them; description.
    choices : tuple of str
        The words that it can be.
    common : bool
        All points of one call of the study's function share its value.
    inner : bool
        A range is a dimension of the outputs, and the function takes it whole.
    """

    default: Any
    units: str = "1"
    text: str = ""
    choices: tuple[str, ...] = ()
    common: bool = False
    inner: bool = False

    def __post_init__(self) -> None:
        if np.ndim(self.default):
            axis = Axis(self.default)
            words = tuple(axis.values.tolist()) if axis.values.dtype.kind == "U" else self.choices
            vars(self).update(default=axis.values, choices=words)  # it is frozen

    @property
    def is_axis(self) -> bool:
        """Whether it is an axis of the result by default."""
        return bool(np.ndim(self.default)) and not self.inner

    @property
    def is_whole(self) -> bool:
        """Whether it takes whole numbers only."""
        return np.asarray(self.default).dtype.kind == "i"

    def read(self, name: str, value: Any) -> Any:
        """Check a requested value: one number, word or None, an ascending array of several, or a distribution.

        Raises
        ------
        InputError
            Naming the parameter, its value and what is allowed.
        """
        if hasattr(value, "ppf"):
            if self.choices or self.is_whole or self.inner:
                raise InputError(f"{name} = {value.text}: it has no distribution; give it values")
            return value
        if value is None or (isinstance(value, str) and value == "auto"):
            if self.default is not None:
                raise InputError(f"{name} = {value!r}: it must be {self._allowed}")
            return None
        values = np.atleast_1d(np.asarray(value))
        if self.choices:
            for word in values.ravel().tolist():
                if word not in self.choices:
                    near = suggest(str(word), self.choices)
                    raise InputError(f"{name} = {word!r}: {near}it must be one of {', '.join(self.choices[:12])}")
            values = np.array([word for word in self.choices if word in values])
        else:
            if values.dtype.kind not in "iuf" or values.ndim != 1 or not len(values):
                raise InputError(f"{name} = {value!r}: it must be {self._allowed}")
            if not np.all(np.isfinite(values)):
                raise InputError(f"{name} = {values[~np.isfinite(values)][0]}: it must be finite")
            values = np.unique(Axis(values.astype(float)).values)
            if self.is_whole:
                # Axes are rounded to 15 digits.
                fraction = (values != np.rint(values)) | (np.abs(values) >= 1e15)
                if np.any(fraction):
                    raise InputError(f"{name} = {values[fraction][0]:g}: it must be a whole number below 1e15")
                values = values.astype(np.int64)
        return values[0].item() if len(values) == 1 and not np.ndim(self.default) else values

    def axis(self, values: Any) -> Axis:
        """An axis of these values."""
        return Axis(values, self.units, self.text)

    @property
    def _allowed(self) -> str:
        if self.choices:
            return f"one of {', '.join(self.choices[:12])}"
        return "a number or a list of numbers" + (", or auto" if self.default is None else "")


def suggest(name: str, names: Any) -> str:
    """A hint, 'did you mean ...? ', at names that are similar or contain this one; else ''."""
    known, long = list(names), len(name) > 2
    near = difflib.get_close_matches(name, known, 1, 0.6 if long else 0.5)
    near += [each for each in known if each.endswith(f"_{name}")]
    near = near or [each for each in known if long and name in each]
    return f"did you mean {' or '.join([*dict.fromkeys(near)][:2])}? " if near else ""


def check_keys(table: Mapping[str, Any], known: Collection[str], more: str = "") -> None:
    """Raise an `InputError` for an unknown key of a file."""
    for key in table:
        if key not in known:
            raise InputError(f"{key}: no such key; {suggest(key, known)}the keys are {', '.join(known)}{more}")


def rig_numbers(rig: Rig) -> dict[str, Any]:
    """The numbers of a rig by the names of its parameters."""
    numbers = {name: getattr(rig, name) for name in RIG_PARAMETERS}
    for beam in ("p1", "p2"):
        numbers |= {f"{beam}_{name}": getattr(getattr(rig, beam), name) for name in BEAM_PARAMETERS}
    return numbers


def _rig_parameters() -> dict[str, Parameter]:
    parameters = {}
    for name, value in rig_numbers(Rig()).items():
        beam, _, field = name.partition("_") if name[:3] in ("p1_", "p2_") else ("", "", name)
        units, text = (BEAM_PARAMETERS if beam else RIG_PARAMETERS)[field]
        text = f"{text} of {beam.upper()}" if beam else text
        parameters[name] = Parameter(value if field == "elements" else float(value), units, text, common=True)
    return parameters


# The numbers of the rig with the paper's values, and those of a scene at the paper's operating point.
RIG = _rig_parameters()
SCENE = {
    "V": Parameter(paper.SPEEDS[1], "m s-1", "speed of the drive"),
    "theta": Parameter(paper.THETA, "degree", "inclination of P1"),
    "mu": Parameter(paper.MU, "1", "coefficient of friction"),
    "F": Parameter(paper.LOAD, "N", "load on A"),
}
# How friction falls with the sliding speed; by default it does not.
FRICTION = {name: Parameter(getattr(Friction(), name), *about) for name, about in FRICTION_PARAMETERS.items()} | {
    "decay": Parameter(DECAYS[0], "1", "exponential: exp(-v / decay_speed); rational: its 1 / (1 + x)", DECAYS)
}
# What stability depends on besides the rig, theta and mu, where friction falls.
SLIDING = {name: SCENE[name] for name in ("V", "F")} | FRICTION
KNOWN = SCENE | FRICTION | RIG
DAMPINGS = ("published", "none")
# Options of every run in time.
RUN = {
    "ramp": Parameter(1e-3, "s", "time in which the drive reaches its speed", common=True),
    "cutoff": Parameter(None, "Hz", "highest modelled mode; auto: the method's default", common=True),
    "skip_long_sticks": Parameter(
        1, "1", "1: skip the quiet part of long sticks; 0: take every step", common=True
    ),
    "numerical_damping": Parameter(
        "none",
        "1",
        "published: add the published scheme's damping; none: the model as given",
        DAMPINGS,
        common=True,
    ),
}


def published(parameters: Mapping[str, Parameter]) -> dict[str, Parameter]:
    """The same parameters with the published scheme's numerical damping as default."""
    return dict(parameters) | {"numerical_damping": replace(parameters["numerical_damping"], default="published")}


# Usual ranges, in the parameters' units; V and theta by size. A value beyond is most often one without its unit.
USUAL_RANGES: Mapping[str, tuple[float, float, str]] = {
    "V": (1e-7, 0.5, "mm/s"),
    "theta": (0.2, 80.0, "radians? it is in degrees"),
    "mu": (0.0, 10.0, ""),
    "F": (1e-3, 1e4, ""),
    "kinetic_ratio": (0.1, 1.0, ""),
    "decay_speed": (1e-6, 1.0, "mm/s"),
    "contact_position": (1e-3, 2.0, "mm"),
    "head_mass": (1e-3, 1e3, ""),
    "d1": (1e-6, 1e4, ""),
    "d2": (1e-12, 1e-4, ""),
    "length": (5e-3, 2.0, "mm"),
    "width": (1e-3, 0.5, "mm"),
    "thickness": (1e-4, 0.1, "mm"),
    "young_modulus": (1e8, 1.5e12, "GPa"),
    "density": (100.0, 25e3, "g/cm3"),
}
# A beam at least so many times as long as it is thick has Euler and Bernoulli's stiffness.
SLENDER = 8.0


class UnusualWarning(UserWarning):
    """A value is outside the usual range of such a rig."""


def unusual(values: Mapping[str, Any], requested: Any) -> list[str]:
    """Describe each value outside its usual range among those that are `requested`, by name; 0 is always usual."""
    lines = []
    for name, value in values.items():
        kind = name.removeprefix("p1_").removeprefix("p2_")
        known = name in requested and kind in USUAL_RANGES and name in KNOWN
        if not known or np.asarray(value).dtype.kind not in "iuf":
            continue
        low, high, unit = USUAL_RANGES[kind]
        # A range may begin near zero.
        largest = float(np.max(np.abs(np.asarray(value, dtype=float))))
        if largest > high or 0.0 < largest < low:
            units = "" if KNOWN[name].units == "1" else f" {KNOWN[name].units}"
            hint = f"; {unit}{'' if '?' in unit else ' without the unit?'}" if unit else ""
            lines.append(f"{name} = {largest:g}{units} is unusual: {low:g} to {high:g}{units} is usual{hint}")
    for beam in ("p1", "p2"):
        sides = [f"{beam}_length", f"{beam}_thickness"]
        if set(sides) & set(requested) and set(sides) <= set(values):
            ratio = float(np.min(values[sides[0]]) / np.max(values[sides[1]]))
            if ratio < SLENDER:
                lines.append(
                    f"{beam}_length / {beam}_thickness = {ratio:.3g} is unusual: below {SLENDER:g} shear makes a "
                    "beam softer, which this model leaves out"
                )
    return lines


def warn_unusual(lines: Sequence[str], *, strict: bool) -> str:
    """Warn about unusual values and return a text for the file's history; if `strict`, raise an `InputError`."""
    if lines and strict:
        stop = "" if lines[0].endswith("?") else ";"
        raise InputError(f"{lines[0]}{stop} strict=True refuses unusual values")
    # The first caller outside this package gave the value.
    level, frame, package = 1, sys._getframe(), str(Path(__file__).parents[1])
    while frame.f_back is not None and frame.f_code.co_filename.startswith(package):
        level, frame = level + 1, frame.f_back
    for line in lines:
        warnings.warn(line, UnusualWarning, stacklevel=level)
    return "; ".join(lines)
