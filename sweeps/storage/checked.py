"""What a file must be before anything of it is used: a regular file, with sizes that a result may have."""

from __future__ import annotations

import errno
import json
import math
import os
import stat
from pathlib import Path
from typing import Any

from sweeps.errors import InputError
from sweeps.grid import MOST_POINTS


def check_regular(path: Path) -> None:
    """Raise the `OSError` of a path at which there is no regular file: a pipe would be waited for, for ever."""
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise OSError(errno.EINVAL, f"{path.name} is not a regular file")


def check_sizes(file: Any) -> None:
    """Refuse an open netCDF file that declares more than a result may have, before it is allocated.

    Raises
    ------
    InputError
        Naming the variable and its shape.
    LookupError, TypeError, ValueError, AttributeError
        If what the file says of itself cannot be understood.
    """
    most = {name: MOST_POINTS for name in ("status", *file.dimensions)}
    if "identity" in file.ncattrs():
        most |= _most_entries(file, json.loads(file.identity))
    for name, variable in file.variables.items():
        if math.prod(variable.shape) > most.get(name, math.inf):
            raise InputError(f"{name} has the shape {' x '.join(map(str, variable.shape))}, which no result has")


def _most_entries(file: Any, identity: dict[str, Any]) -> dict[str, int]:
    """Of each variable that was computed how many entries it may have, by its points and its own dimensions."""
    points = math.prod(len(file.dimensions[group[0]]) for group in identity["groups"])
    lengths = {name: int(text.partition(" ")[0]) for name, text in identity["coords"].items()}
    return {
        name: points * math.prod(lengths[dim] for dim in each["dims"])
        for name, each in identity["variables"].items()
    }
