"""Parts and the manifest: the results of finished batches, and the description of the file that they will form.

A part is one batch: results, computing times, which points of its manifest's grid they are, failures and the
environment. Both are zip archives with a JSON header, whose CRC-32 finds damage; they are complete or absent. The
manifest is written twice, since all parts depend on it.
"""

import json
import os
import threading
import zipfile
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from sweeps.errors import HINT_EITHER, HINT_START_OVER, UNREADABLE, DamagedError, StoreError, reason
from sweeps.grid import STATUS_FLAGS, Alignment, Axis, Grid, Variable
from sweeps.storage.store import Store, check_regular, replacing

# Version of the manifest's fields; parts of another version cannot be read.
FORMAT = [2, *(each.name for each in fields(Variable))]
# A file up to this size is read and checked at once.
SMALL = 1 << 16
# Variables of every file besides the sweep's own.
BOOKKEEPING = {
    "status": Variable("", "status of the point", dtype="int8", flags=STATUS_FLAGS),
    "error": Variable("", "why the point failed"),
    "wall_time": Variable("s", "computing time of the point"),
}


def pack(
    path: Path, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], deflated: Collection[str] = ()
) -> None:
    """Write an archive of a header, as JSON, and arrays; those `deflated` with the bytes of entries transposed."""
    types = {name: [each.dtype.str, each.shape, name in deflated] for name, each in arrays.items()}
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(zipfile.ZipInfo("header"), json.dumps({"header": dict(header), "arrays": types}))
        for name, values in arrays.items():
            raw = np.ascontiguousarray(values).reshape(-1).view(np.uint8)
            if name in deflated and raw.size:
                raw = np.ascontiguousarray(raw.reshape(values.size, -1).T).reshape(-1)
            how = zipfile.ZIP_DEFLATED if name in deflated else zipfile.ZIP_STORED
            archive.writestr(zipfile.ZipInfo(f"{name}.array"), raw.data, how, 1)


class Packed:
    """An archive written by `pack`; arrays are read on demand. Damage raises one of UNREADABLE."""

    def __init__(self, path: Path) -> None:
        check_regular(path)
        self._file: Path | bytes = path.read_bytes() if path.stat().st_size <= SMALL else path
        with self._open() as archive:
            if isinstance(self._file, bytes) and archive.testzip() is not None:
                raise ValueError(f"{path} is damaged")
            content = json.loads(archive.read("header"))
        self.header: dict[str, Any] = content["header"]
        self._arrays: dict[str, Any] = content["arrays"]
        self.names = list(self._arrays)

    def _open(self) -> zipfile.ZipFile:
        return zipfile.ZipFile(BytesIO(self._file) if isinstance(self._file, bytes) else self._file)

    def read(self, name: str) -> NDArray[Any]:
        """One of the arrays."""
        kind, shape, deflated = self._arrays[name]
        dtype = np.dtype(kind)
        with self._open() as archive:
            raw = archive.read(f"{name}.array")
        if deflated and raw:
            raw = np.frombuffer(raw, np.uint8).reshape(dtype.itemsize, -1).T.tobytes()
        return np.frombuffer(raw, dtype).reshape(shape)


class Failure(NamedTuple):
    """The reason why a point failed, the point, and a command that computes it again."""

    error: str
    traceback: str = ""
    reproduce: str = ""


# The point of each row of a source in a manifest's grid, -1 for none; failed rows; s; computations; environments.
Coverage = tuple[NDArray[np.intp], NDArray[np.bool_], float, int, list[dict[str, str]]]


@dataclass(eq=False)
class BatchResult:
    """Computed points, one row each: unscaled results, wall times in s, failures by row; a source of results."""

    values: dict[str, NDArray[Any]]
    wall_time: NDArray[np.float64]
    failures: dict[int, Failure] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=dict)
    # Flat indices in the grid of the task, which is that of the manifest.
    points: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    name = "memory"

    def __len__(self) -> int:
        return len(self.wall_time)

    def coverage(self, manifest: "Manifest") -> Coverage:
        """The computed points."""
        failed = np.isin(np.arange(len(self)), list(self.failures))
        return self.points, failed, float(self.wall_time.sum()), len(self), [self.environment]

    def read(self, name: str, rows: Any) -> NDArray[Any]:
        """Values of a variable, or `wall_time`, at some rows."""
        return np.asarray((self.wall_time if name == "wall_time" else self.values[name])[rows])


class PartWriter:
    """Names and writes the parts of one run while it `goes_on`, after the part `last` of earlier runs."""

    def __init__(
        self,
        folder: Path,
        variables: Mapping[str, Variable],
        token: str,
        last: str = "",
        goes_on: Callable[[], bool] = lambda: True,
    ) -> None:
        self.folder, self.variables, self.token, self._goes_on = folder, variables, token, goes_on
        self._run = uuid4().hex[:8]
        self._last = int(last.partition("-")[0] or 0)
        self._closed = False
        self._lock = threading.Lock()

    def next_name(self) -> str:
        """A name that no part of this run or of an earlier one has."""
        self._last += 1
        return f"{self._last:06d}-{self._run}.part"

    def write(self, name: str, result: BatchResult) -> None:
        """Write the results of a batch, unless the writer is closed."""
        if self._closed:
            return
        points, arrays = result.points, dict[str, NDArray[Any]](wall_time=result.wall_time)
        contiguous = bool(np.all(np.diff(points) == 1))
        header = {"manifest": self.token, "rows": len(points), "first": int(points[0]) if contiguous else None}
        header |= {"failures": result.failures, "environment": result.environment}
        header |= {"seconds": float(result.wall_time.sum())}
        arrays |= {} if contiguous else {"points": points}
        for key, each in result.values.items():
            arrays[f"value_{key}"] = np.char.encode(each.astype(str), "utf-8") if each.dtype == object else each
        # Floats of full precision hardly shrink; everything else does.
        small = [n for n, v in self.variables.items() if v.digits is not None or not v.is_float]
        with replacing(self.folder / name, rename=self._rename) as temporary:
            pack(temporary, header, arrays, ["points", *(f"value_{name}" for name in small)])

    def _rename(self, temporary: Path, path: Path) -> None:
        with self._lock:
            if not self._closed and self._goes_on():
                os.replace(temporary, path)

    def close(self) -> None:
        """Accept no more parts: abandoned threads may still compute when the store is released."""
        with self._lock:
            self._closed = True


@dataclass(frozen=True, eq=False)
class Manifest:
    """The grid of a file and the properties of its points; enough to assemble it without the sweep's functions.

    `variables` are as the file represents them. `representative` is the point whose computation is each point's
    too, -1 where it is skipped; None: each is its own. `factors` are those of the sweep's `scale`. A `fresh` one
    replaces a finished file. Parts refer to its `token`, or to that of an `earlier` manifest, whose grid it has.
    """

    name: str
    title: str
    grid: Grid
    coords: Mapping[str, Axis]
    variables: Mapping[str, Variable]
    representative: NDArray[Any] | None = None
    factors: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    attributes: Mapping[str, str] = field(default_factory=dict)
    fresh: bool = False
    token: str = field(default_factory=lambda: uuid4().hex[:12])
    earlier: Mapping[str, Grid] = field(default_factory=dict)

    @property
    def grids(self) -> dict[str, Grid]:
        """The grid and earlier ones, by token."""
        return {**self.earlier, self.token: self.grid}

    @cached_property
    def alignments(self) -> dict[str, Alignment]:
        """Positions of the points of `grids` in this grid, by token."""
        return {token: self.grid.align(grid) for token, grid in self.grids.items()}

    def variable(self, name: str) -> Variable:
        """One of the variables, or of those common to all files."""
        return self.variables.get(name) or BOOKKEEPING[name]

    def shape(self, name: str) -> tuple[int, ...]:
        """Shape of a variable at one point."""
        return tuple(len(self.coords[dim]) for dim in self.variable(name).dims)

    def row_bytes(self, name: str) -> int:
        """Size of a variable at one point."""
        return int(self.variable(name).itemsize * np.prod(self.shape(name), dtype=np.int64))

    def save(self, store: Store) -> None:
        """Write the manifest and its copy."""
        grids, axes = self.grids, {"axes": self.grid.axes, "coords": self.coords}
        header = {
            "format": FORMAT,
            **{name: getattr(self, name) for name in ("name", "title", "token", "fresh")},
            "attributes": dict(self.attributes),
            "groups": {token: grid.groups for token, grid in grids.items()},
            **{what: {n: [axis.units, axis.long_name] for n, axis in each.items()} for what, each in axes.items()},
            "variables": {name: asdict(variable) for name, variable in self.variables.items()},
            "factors": list(self.factors),
        }
        arrays = {f"axis {n} {token}": axis.values for token, g in grids.items() for n, axis in g.axes.items()}
        arrays |= {f"coord {name}": axis.values for name, axis in self.coords.items()}
        arrays |= {f"factor {name}": values for name, values in self.factors.items()}
        if self.representative is not None:
            arrays["representative"] = self.representative
        for path in (store.manifest.with_suffix(".copy"), store.manifest):
            with replacing(path) as temporary:
                pack(temporary, header, arrays, ["representative"])

    @classmethod
    def load(cls, store: Store) -> "Manifest | None":
        """The manifest of an unfinished run; None if there is none."""
        if not store.manifest.exists():
            return None
        reasons = list[str]()
        for path in (store.manifest, store.manifest.with_suffix(".copy")):
            try:
                file = Packed(path)
                if file.header["format"] == FORMAT:
                    return cls._of(file)
            except UNREADABLE as problem:
                if isinstance(problem, OSError) and not isinstance(problem, FileNotFoundError):
                    reasons.append(f"{path} cannot be read: {reason(problem)}")
            else:
                other = f"{store.parts} is of another version of sweeps"
                raise StoreError(f"{other}; finish the run with that version, or {HINT_START_OVER}")
        lost = f"so the parts of {store.file.name} cannot be used"
        raise StoreError([*reasons, f"{store.manifest} and its copy are damaged, {lost}; {HINT_EITHER}"][0])

    @classmethod
    def _of(cls, file: Packed) -> "Manifest":
        header, arrays, grids = file.header, {name: file.read(name) for name in file.names}, {}
        for token, groups in header["groups"].items():
            axes = {name: Axis(arrays[f"axis {name} {token}"], *each) for name, each in header["axes"].items()}
            grids[token] = Grid(axes, groups)
        for each in header["variables"].values():
            each["flags"] = each["flags"] and {int(code): word for code, word in each["flags"].items()}
        return cls(
            **{name: header[name] for name in ("name", "title", "token", "fresh", "attributes")},
            grid=grids.pop(header["token"]),
            earlier=grids,
            coords={name: Axis(arrays[f"coord {name}"], *each) for name, each in header["coords"].items()},
            variables={name: Variable(**each) for name, each in header["variables"].items()},
            representative=arrays.get("representative"),
            factors={name: arrays[f"factor {name}"] for name in header["factors"]},
        )


@dataclass(frozen=True)
class PartSource:
    """A part on the disk as a source of results; methods raise a `DamagedError` if it is damaged or missing."""

    folder: Path
    name: str

    @cached_property
    def _file(self) -> Packed:
        return Packed(self.folder / self.name)

    def _read(self, array: str = "") -> Any:
        """One of the arrays; without a name the header."""
        try:
            return self._file.read(array) if array else self._file.header
        except UNREADABLE:
            if self.folder.exists():
                raise DamagedError(self.name, str(self.folder)) from None
            raise StoreError(f"{self.folder} is gone: the run has finished; open its results again") from None

    def coverage(self, manifest: Manifest) -> Coverage:
        """The points in the part."""
        header = self._read()
        alignment = manifest.alignments.get(header["manifest"])
        if alignment is None:
            raise DamagedError(self.name, str(self.folder))
        count, first = header["rows"], header["first"]
        points = alignment(self._read("points") if first is None else first + np.arange(count))
        failed = np.isin(np.arange(count), list(self.failures))
        return points, failed, header["seconds"], count, [header["environment"]]

    def read(self, name: str, rows: Any) -> NDArray[Any]:
        """Values of a variable, or `wall_time`, at some rows."""
        values = np.asarray(self._read("wall_time" if name == "wall_time" else f"value_{name}")[rows])
        return np.char.decode(values, "utf-8") if values.dtype.kind == "S" else values

    @property
    def failures(self) -> Mapping[int, Failure]:
        """The reasons why rows failed."""
        return {int(row): Failure(*each) for row, each in self._read()["failures"].items()}
