"""Parts: what has come of a batch, one file each, beside the result until it is whole.

A part holds the results and computing times of its rows, which points of its manifest's grid they are, which of
them failed, and why, and in what environment they were computed. It is written under a temporary name, flushed and
renamed, so that it is whole or not there. Any process that sees the folder may write one: its name is decided by
whoever hands the batch out, so that a batch computed twice is kept once.
"""

from __future__ import annotations

import json
import os
import re
import threading
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from sweeps.compute.batch import BatchResult, Failure
from sweeps.errors import UNREADABLE, StoreError, reason
from sweeps.fingerprint.provenance import read_environment
from sweeps.grid import MOST_POINTS, Variable
from sweeps.storage.packed import Packed, pack
from sweeps.storage.replacing import replacing

NAME = re.compile(r"(\d{6,})-[0-9a-f]{8}\.part")


def encode(
    result: BatchResult, points: NDArray[np.intp], variables: Mapping[str, Variable], manifest: str
) -> bytes:
    """The content of a part.

    Parameters
    ----------
    result : BatchResult
    points : ndarray of int
        Of each row its point in the manifest's grid.
    variables : mapping of str to Variable
    manifest : str
        The manifest's token.
    """
    about: dict[str, Any] = {
        "manifest": manifest,
        "rows": len(points),
        "failed": len(result.failures),
        "seconds": float(result.wall_time.sum()),
        "environment": result.environment,
    }
    arrays: dict[str, NDArray[Any]] = {}
    if int(points[-1]) - int(points[0]) == len(points) - 1 and np.all(np.diff(points) == 1):
        about["first"] = int(points[0])
    else:
        arrays["steps"] = np.diff(points, prepend=0)
    if result.failures:
        arrays["failed"] = np.fromiter(result.failures, np.int64)
        reasons = json.dumps(list(result.failures.values())).encode()
        arrays["failures"] = np.frombuffer(reasons, np.uint8)
    arrays["wall_time"] = result.wall_time
    arrays |= {f"value_{name}": values for name, values in result.values.items()}
    # Full-precision floats hardly shrink; rounded ones and whole numbers do.
    small = [n for n, v in variables.items() if v.digits is not None or np.dtype(v.dtype).kind == "i"]
    return pack(about, arrays, ["steps", "failures", *(f"value_{name}" for name in small)])


class Contents(NamedTuple):
    """What is read of a part before its values are wanted.

    Its manifest's token, its points in that one's grid, rows that failed, the computing time of all in s, and the
    environment in which they were computed.
    """

    manifest: str
    points: NDArray[np.intp]
    failed: NDArray[np.intp]
    seconds: float
    environment: dict[str, str]


class PartFolder:
    """The parts of a store."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._run = uuid4().hex[:8]
        self._last: int | None = None
        self._closed = False
        self._lock = threading.Lock()

    def names(self) -> list[str]:
        """The parts' names in the order in which their batches were handed out."""
        try:
            with os.scandir(self.path) as found:
                names = [each.name for each in found if NAME.fullmatch(each.name) and each.is_file()]
        except (FileNotFoundError, NotADirectoryError):
            return []
        except OSError as problem:
            raise StoreError(f"{self.path} cannot be read: {reason(problem)}") from None
        return sorted(names, key=_number)

    def next_name(self) -> str:
        """A name that no other part has, of this run or of one before."""
        if self._last is None:
            self._last = max(map(_number, self.names()), default=0)
        self._last += 1
        return f"{self._last:06d}-{self._run}.part"

    def put(self, name: str, content: bytes) -> None:
        """Write a part; nothing once the folder is closed."""
        if not self._closed:
            with replacing(self.path / name, rename=self._rename) as temporary:
                temporary.write_bytes(content)

    def _rename(self, temporary: Path, path: Path) -> None:
        with self._lock:
            if not self._closed:
                os.replace(temporary, path)

    def close(self) -> None:
        """Take no more parts: the store is given back, and threads that still compute come too late."""
        with self._lock:
            self._closed = True

    def contents(self, name: str) -> Contents | None:
        """Which points a part holds; None if it is damaged or gone."""
        try:
            part = Packed(self.path / name)
            about, index = part.about, part.read([each for each in ("steps", "failed") if each in part.names])
            sound = isinstance(about["manifest"], str) and isinstance(about["seconds"], (int, float))
            if not (sound and isinstance(about["rows"], int) and 0 < about["rows"] <= MOST_POINTS):
                return None
            points = np.cumsum(index["steps"]) if "steps" in index else about["first"] + np.arange(about["rows"])
            failed = index.get("failed", np.zeros(0, dtype=np.int64))
            if points.dtype.kind != "i" or failed.dtype.kind != "i":
                return None
            where = read_environment(about.get("environment", {}))
            return Contents(about["manifest"], points, failed, about["seconds"], where)
        except UNREADABLE:
            return None

    def read(self, name: str, variables: Collection[str], reasons: bool = True) -> BatchResult | None:
        """The values of some variables, with or without why points failed; None if the part is damaged or gone."""
        try:
            part = Packed(self.path / name)
            failing = ["failed", "failures"] if reasons and "failed" in part.names else []
            found = part.read(["wall_time", *failing, *(f"value_{each}" for each in variables)])
            for each in (found["wall_time"], *(found[f"value_{name}"] for name in variables)):
                if each.shape[:1] != (part.about["rows"],) or each.dtype.kind not in "biuf":
                    return None
            texts = json.loads(found["failures"].tobytes()) if failing else []
            rows = found["failed"].tolist() if failing else []
            failures = {row: Failure(*each) for row, each in zip(rows, texts, strict=True)}
        except UNREADABLE:
            return None
        return BatchResult({each: found[f"value_{each}"] for each in variables}, found["wall_time"], failures)


def _number(name: str) -> int:
    return int(name.partition("-")[0])
