"""SPEC, the way values are written on the command line."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FORMS = "0.2 | 1e-3,2e-3,5e-3 | 0:0.5:101 (start:stop:count) | log:1e-4:1e-2:30"
MOST_VALUES = 10_000_000


def assignment(text: str) -> tuple[str, NDArray[Any]]:
    """Read AXIS=SPEC."""
    name, equals, spec = text.partition("=")
    if not equals or not name.strip():
        raise ValueError(f"--set {text!r}: it must be AXIS=SPEC, for example mu=0:0.5:101")
    return name.strip(), parse(spec.strip(), name.strip())


def parse(spec: str, name: str) -> NDArray[Any]:
    """The values that SPEC stands for.

    Raises
    ------
    ValueError
        If it is none of the forms; the message names the axis, what was written and the forms.
    """
    logarithmic = spec.startswith("log:")
    body = spec.removeprefix("log:")
    try:
        if ":" in body or logarithmic:
            start_text, stop_text, count_text = body.split(":")
            start, stop, count = float(start_text), float(stop_text), int(count_text)
            if count < 1 or (count == 1 and start != stop) or not np.all(np.isfinite([start, stop])):
                raise ValueError
            if logarithmic and not (start > 0.0 and stop > 0.0):
                raise ValueError
            if count > MOST_VALUES:
                raise ValueError
            return np.geomspace(start, stop, count) if logarithmic else np.linspace(start, stop, count)
        values = np.array([float(part) for part in body.split(",")])
        if not np.all(np.isfinite(values)):
            raise ValueError
        return values
    except ValueError:
        raise ValueError(f"{name} = {spec!r}: it must be a SPEC of finite numbers: {FORMS}") from None
