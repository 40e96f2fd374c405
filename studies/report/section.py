"""A section of the page: the content for one result, as plain data."""

from __future__ import annotations

import gzip
import json
import os
import re
import traceback
from base64 import b64encode
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from markupsafe import Markup

import sweeps
from studies import registry, runner
from studies.answering import results, summary
from studies.answering.results import settings
from studies.declaring import labels
from studies.motion import run
from studies.motion.regimes import KINDS
from studies.plotting import figures, planes
from studies.plotting.moving import Moving
from studies.study import Study

# A result with more rows, or more values, is thinned on the page.
MOST_ROWS, MOST_VALUES = 12_500, 100_000
# Units of the larger extent in an animation.
FINE = 2000
# Digits of a computed value on the page; parameters keep all of theirs.
DIGITS = 6
# Variables that say whether a point was computed; files of libraries.
STATE = ("status", "error")
LIBRARY = "site-packages.(?!studies)|^<"

Tell = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Result:
    """A stored result."""

    study: Study
    dataset: xr.Dataset
    file: Path
    status: sweeps.Status

    @property
    def is_reference(self) -> bool:
        """Whether it is one of the repository's own outcomes."""
        return results.is_reference(self.file)

    @property
    def name(self) -> str:
        """A short name for menus."""
        return self.file.stem

    @property
    def anchor(self) -> str:
        """The identifier of the section in the page."""
        return re.sub(r"\W+", "-", str(self.file.with_suffix(""))).strip("-")

    @property
    def title(self) -> str:
        """The study's title; of a map, a study without axes, also its parameters."""
        along = " and ".join(labels.title(str(dim)) for dim in self.dataset["status"].dims)
        return self.study.title if self.study.dims else f"{self.study.title} over {along}"

    @property
    def kind(self) -> str:
        """Kind of the result: study, own study or map."""
        own = "study" if self.study.name in registry.NAMES else "own study"
        return "map" if self.file.parent.name == results.MAPS else own

    @property
    def stamp(self) -> str:
        """Time of the last computation, from the file; for an unfinished run, of its last change of files."""
        if self.status.state == "complete":
            return str(self.dataset.attrs.get("history", "")).rpartition("\n")[2].partition(" ")[0]
        changed = max((each.st_mtime for each in self._files()), default=0.0)
        return f"{datetime.fromtimestamp(changed, UTC):%Y-%m-%dT%H:%M:%SZ}"

    def _files(self) -> list[os.stat_result]:
        paths = (self.file, *Path(f"{self.file}.parts").glob("*"))
        return [path.stat() for path in paths if path.is_file()]

    @property
    def progress(self) -> str:
        """The progress of a run: "running, 3.2 min left"; "" for a complete one."""
        state, left = self.status.state, self.status.run.get("left", np.nan)
        time = f", {sweeps.duration(left)} left" if left > 0.0 else ""
        return "" if state == "complete" else f"{state}{time}"

    @property
    def facts(self) -> dict[str, str]:
        """Points, size, CPU time, date, program, file, and the command that computes it."""
        codes = self.dataset["status"].values
        words = sweeps.STATUS_FLAGS | sweeps.INTERPOLATED_FLAG
        counts = {word: np.count_nonzero(codes == code) for code, word in words.items()}
        return {
            "points": ", ".join(f"{count} {word}" for word, count in counts.items() if count),
            "size": sweeps.size(sum(each.st_size for each in self._files())),
            "CPU time": sweeps.duration(float(np.nansum(self.dataset["wall_time"].values))),
            "computed": self.progress or date(self.stamp),
            "by": str(self.dataset.attrs.get("source", "unknown")),
            "file": str(self.file),
        } | ({"again": self.again} if self.again else {})

    @property
    def again(self) -> str:
        """The command that computes the result: from its file if possible, else as it was typed; "" if unknown."""
        configured, own = results.configuration(self.dataset), self.study.name not in registry.names()
        # A file tells neither where the user's study is nor how a map is refined.
        if own and (typed := configured.get("request", {}).get("command")):
            return str(typed)
        if (own and self.kind != "map") or "refinement" in configured:
            return ""
        return results.command("run", self.study.name if self.is_reference else str(self.file))


def date(stamp: str) -> str:
    """A time of a file's history for a reader: "24 Nov 2026, 00:29 UTC"."""
    with suppress(ValueError):
        when = datetime.fromisoformat(stamp)
        return f"{when.day} {when:%b %Y, %H:%M} UTC"
    return stamp


def packed(text: str) -> str:
    """A text in the form that the page stores: compressed, in base64."""
    return b64encode(gzip.compress(text.encode(), mtime=0)).decode()


def picture(png: bytes) -> str:
    """A figure for the page in base64, at full resolution with 128 colours."""
    from PIL import Image

    with Image.open(BytesIO(png)) as image:
        image.convert("RGB").quantize(128).convert("RGB").save(small := BytesIO(), "webp", lossless=True)
    return b64encode(small.getvalue()).decode()


def images(result: Result) -> list[bytes]:
    """The figures of a result: those beside its file if they are up to date, else new ones."""
    beside = [result.file.with_name(f"{result.name}{each}.png") for each in ("", "-series")]
    found = [path.read_bytes() for path in beside if path.is_file()]
    digest = runner.picture_digest(result.study, result.dataset) if found else ""
    shown = [image for image in found if digest and figures.is_drawn_from(image, digest)]
    return shown or list(runner.image(result.study, result.dataset, "png").values())


def failure_text(problem: Exception) -> str:
    """An exception in one line; of a programming error also its kind and place."""
    text = " ".join(str(problem).split())
    if isinstance(problem, (sweeps.InputError, sweeps.StoreError, FileNotFoundError)):
        return text
    frames = [f for f in traceback.extract_tb(problem.__traceback__) if not re.search(LIBRARY, f.filename)]
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{type(problem).__name__}: {text}{place}"


def content(result: Result, tell: Tell) -> dict[str, Any]:
    """Figures, summary and points of a result; parts that cannot be made are listed in `problems`."""
    study, dataset = result.study, result.dataset
    made: dict[str, Any] = {"figures": [], "parts": [], "finding": "", "points": None, "problems": []}
    made |= {"facts": result.facts, "moving": []}

    def draw() -> None:
        made["figures"] = [picture(image) for image in images(result)]

    def summarise() -> None:
        for part in summary.parts(study, dataset):
            made["parts"].append(part if isinstance(part, str) else (part[0], Markup(summary.html(part[1]))))
        shown = summary.presented(study, dataset) if study.summary is not None else None
        if study.summary is not None and shown is not None:
            made["finding"] = next((part for part in study.summary(shown) if isinstance(part, str)), "")

    def tabulate() -> None:
        made["points"] = points(study, dataset, result.file)
        made["packed"] = packed(json.dumps(made["points"], allow_nan=False, separators=(",", ":")))

    def animate() -> None:
        for each in runner.moving_of(study, dataset):
            made["moving"].append((each.caption, packed(json.dumps(played(each), separators=(",", ":")))))

    steps = (("figure", draw), ("summary", summarise), ("animation", animate), ("table of points", tabulate))
    for what, make in steps:
        try:
            make()
        except Exception as problem:  # noqa: BLE001 - a study's own code can raise anything; the page says it
            made["problems"].append(f"No {what}: {failure_text(problem)}")
            tell(f"{result.file}: no {what}: {failure_text(problem)}")
    return made


def played(moving: Moving) -> dict[str, Any]:
    """Animations for the page: x and y (downwards) of the nodes in turn, in 1 / FINE of the larger extent."""
    drawn = moving.drawn * [1.0, -1.0]
    low = drawn.min(axis=(0, 1))
    drawn = np.rint((drawn - low) * (FINE / np.ptp(drawn, axis=(0, 1)).max())).astype(int)
    return {
        "loop": moving.loop,
        "size": drawn.max(axis=(0, 1)).tolist(),
        "still": drawn[0].ravel().tolist(),
        "frames": drawn[1:].reshape(len(drawn) - 1, -1).tolist(),
        "lines": [(name, nodes.tolist()) for name, nodes in moving.lines],
        "tip": moving.tip,
        "state": "".join(map(str, moving.state)),
        "states": run.STATES,
        "series": {name: [float(f"{v:.4g}") for v in values] for name, values in moving.series.items()},
    }


def points(study: Study, dataset: xr.Dataset, file: Path) -> dict[str, Any]:
    """The points for the table and the map of the page.

    Returns
    -------
    dict
        `dims` and `shape` of the grid of rows, `size` in words; `columns` (`_column`); `plane`, two dimensions by
        index or None; `scene`, what is fixed; `command` and `python`, which lack the parameters of a point, or "";
        `colours` of words.
    """
    status = dataset["status"]
    inner = [name for name, parameter in study.parameters.items() if parameter.inner and name in dataset.dims]
    dims = [*map(str, status.dims), *inner]
    variables = {str(name): v for name, v in dataset.data_vars.items() if name != "wall_time"}
    if bool((status == sweeps.DONE).all()):
        variables = {name: v for name, v in variables.items() if name not in STATE}
    wider = Counter(v.dims for v in variables.values() if set(v.dims) > set(dims))
    if wider and not any(set(v.dims) == set(dims) for name, v in variables.items() if name not in STATE):
        # Results that have a further dimension only, such as modes, have a row for each of its entries.
        dims += [str(dim) for dim in wider.most_common(1)[0][0] if dim not in dims]
        # Entries that no point has are room in the file.
        for dim in dims[len(status.dims) + len(inner) :]:
            dataset = dataset.dropna(dim, how="all", subset=[n for n, v in variables.items() if dim in v.dims])
    chosen = [str(name) for name, coord in dataset.coords.items() if coord.dims and set(coord.dims) <= set(dims)]
    chosen += [name for name, v in variables.items() if set(status.dims) <= set(v.dims) <= set(dims)]
    strides = dict.fromkeys(dims, 1)
    while True:
        thin = dataset[chosen].isel({dim: slice(None, None, stride) for dim, stride in strides.items()})
        shape = [thin.sizes.get(dim, 1) for dim in dims]
        if np.prod(shape) <= MOST_ROWS and sum(thin[name].size for name in chosen) <= MOST_VALUES:
            break
        strides[dims[int(np.argmax(shape))]] += 1
    thinned = [f"one in {stride} values of {labels.title(dim)}" for dim, stride in strides.items() if stride > 1]
    size = f"{np.prod([dataset.sizes[dim] for dim in dims])} rows"
    if thinned:
        size = f"{np.prod(shape)} of {size} ({', '.join(thinned)}); the file has all"
    columns = [_column(thin[name], dims, name in study.parameters) for name in chosen]
    varied = [dim for dim in (*status.dims, *inner) if dim in chosen and thin[dim].dtype.kind in "iuf"]
    wide = [d for d, dim in enumerate(dims) if shape[d] > 1 and dim not in results.PATHS]
    # A numeric parameter, and another, or else what comes next, such as a direction.
    plane = sorted(sorted(wide, key=lambda d: (dims[d] not in varied, -shape[d]))[:2])
    command, python = rerun_commands(study, dataset, file)
    return {
        "dims": dims,
        "shape": shape,
        "columns": columns,
        "plane": plane if len(plane) == 2 and {dims[d] for d in plane} & {*varied} else None,
        "scene": summary.fixed_text(study, dataset),
        "command": command,
        "python": python,
        "colours": dict(zip(KINDS, planes.COLOURS, strict=True)),
        "size": size,
    }


def _column(array: xr.DataArray, dims: list[str], is_parameter: bool) -> dict[str, Any]:
    """A variable or a coordinate, values in SI with the factor to a reader's unit; None where not finite."""
    array = array.transpose(*(dim for dim in dims if dim in array.dims))
    unit, factor = labels.unit_of(array)
    if "flag_meanings" in array.attrs or array.dtype.kind not in "iufb":
        words = labels.words(array) if "flag_meanings" in array.attrs else array.values
        values: list[Any] = [*map(str, words.ravel())]
    else:
        exact = is_parameter or array.dtype.kind != "f"
        numbers = array.values.ravel().tolist()
        values = [(v if exact else float(f"{v:.{DIGITS}g}")) if np.isfinite(v) else None for v in numbers]
    return {
        "name": str(array.name),
        "head": f"{labels.SYMBOLS.get(str(array.name), array.name)} {unit}".strip(),
        "about": str(array.attrs.get("long_name", "")),
        "factor": factor,
        "dims": [dims.index(dim) for dim in map(str, array.dims)],
        "parameter": is_parameter,
        "values": values,
    }


def rerun_commands(study: Study, dataset: xr.Dataset, file: Path) -> tuple[str, str]:
    """Command and Python that compute a point, without the parameters that vary; "" for an unknown study."""
    if not (study.name in registry.names() or (study.name.startswith(results.MAPS) and study.parameters)):
        return "", ""
    fixed, rig = settings(dataset), file if results.structure_in(dataset) else None
    changed = {n: v for n, v in fixed.items() if n in study.parameters and v != study.parameters[n].default}
    options = {**changed, "out": "again", "fresh": True} | ({"rig": str(rig)} if rig else {})
    python = f"studies.run({study.name!r}, {', '.join(f'{name}={value!r}' for name, value in options.items())}"
    return runner.rerun(study.name, changed, {}, rig), python
