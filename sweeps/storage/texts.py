"""Texts in netCDF files, as padded characters; and the lock of the netCDF library.

Characters shrink to nothing where they are empty. Texts of any length, as netCDF has them too, bring down HDF5 2.2
where a file that is open is opened and closed once more.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

# The netCDF library is not made for several threads at once.
NETCDF = threading.RLock()


def write_texts(file: Any, name: str, texts: np.ndarray, dim: str) -> None:
    """Write texts along a dimension of an open netCDF file or group, each padded to the longest."""
    letters = np.array([text.encode() for text in texts.tolist()], dtype=bytes)
    width = max(letters.dtype.itemsize, 1)
    if f"letters{width}" not in file.dimensions:
        file.createDimension(f"letters{width}", width)
    made = file.createVariable(name, "S1", (dim, f"letters{width}"), zlib=True, complevel=1)
    made[...] = letters.astype(f"S{width}").view("S1").reshape(len(texts), width)


def as_texts(letters: Any) -> np.ndarray:
    """Rows of padded characters as texts."""
    letters = np.asarray(letters)
    texts = np.empty(letters.shape[:-1], dtype=object)
    for place in np.ndindex(texts.shape):
        texts[place] = letters[place].tobytes().rstrip(b"\0").decode("utf-8", "replace")
    return texts
