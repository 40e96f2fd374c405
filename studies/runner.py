"""From a declared study to stored and drawn results: plan, execute, draw."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import sweeps
from fivcore import FIXED_CONTACT_LIMIT
from studies import registry
from studies.answering import reference, summary
from studies.answering.results import (
    MAPS,
    file_of,
    is_fit,
    is_own,
    open_dataset,
    reference_folder,
    results_folder,
    rig_in,
)
from studies.asking import mapping, rigs
from studies.asking.request import Request
from studies.asking.sweep import sweep_of
from studies.declaring.parameters import unusual, warn_unusual
from studies.declaring.spec import joined
from sweeps import InputError, check_backend

if TYPE_CHECKING:
    import xarray as xr

    from studies.plotting.moving import Moving
    from studies.study import Study
    from sweeps import Progress

# Formats of a figure.
FORMATS = ("png", "svg", "pdf")


@dataclass(frozen=True, eq=False)
class RunResult:
    """Result, file and figures of a finished run."""

    study: Study
    dataset: xr.Dataset
    file: Path
    figures: list[Path]

    def beside_reference(self) -> str:
        """A sentence on the difference from the reference; "" if the reference lacks the study."""
        file = file_of(self.study.name, reference_folder(self.file.parent.parent))
        if not file.exists() or file.resolve() == self.file.resolve():
            return ""
        return reference.compared(self.study, self.dataset, open_dataset(file))

    def fixed_contact(self) -> str:
        """A warning where P2 moves too far for a fixed contact point; "" elsewhere."""
        data, known = self.dataset, ("simulated_time", "duration", "max_duration")
        time = next((data[name] for name in known if name in data), None)
        if time is None or "V" not in data or "p2_length" not in data:
            return ""
        moved = float((np.abs(data["V"]) * time / data["p2_length"]).max())
        if not moved > FIXED_CONTACT_LIMIT:  # a duration that a study chooses is NaN
            return ""
        place = np.ravel(data["contact_position"].values) if "contact_position" in data else np.array([])
        where = f"{1e3 * place[0]:g} mm" if len(place) == 1 else "one place"
        share = f"{100.0 * moved:.{'2g' if moved < 0.1 else '0f'}} %"
        moves = f"the drive moves {share} of P2's length in a run"
        return f"{moves}; a real contact would travel along, here it stays at {where}"

    @property
    def failed(self) -> int:
        """Number of points that failed."""
        return int((self.dataset["status"] == sweeps.FAILED).sum())


def plan(
    study: str | Study,
    request: Request,
    out: str | Path | None = None,
    *,
    fresh: bool = False,
    adopt: int | None = None,
    retry_failed: bool = False,
    strict: bool = False,
    file: Path | None = None,
) -> sweeps.Plan:
    """The plan of a study (`registry.resolve`) or a map, with its file in the results folder, or in `file`.

    Unusual values are a warning or, with `strict`, an `InputError`; so are points computed in several
    environments. The folder of the reference is refused.
    """
    one = registry.resolve(study) if file is None else study
    assert not isinstance(one, str)
    if is_own(results_folder(out)) or is_own(results_folder(out).parent):
        raise InputError(f"{results_folder(out)}: runs only read the reference; choose another folder (out=...)")
    if (inside := rig_in(results_folder(out))) and request.rig != inside:
        raise InputError(f"{results_folder(out)}: it is the folder of the rig {inside!r}; write rig={inside!r}")
    values = request.values_of(one)
    sweep = sweep_of(one, values, **request.points_of(one))
    if request.sides:
        sweep = mapping.mapped(one, request, sweep)
        file = file or results_folder(out) / MAPS / f"{mapping.name_of(one, request, values)}.nc"
    file = file or file_of(one.name, out)
    if inside := rig_in(file.parent):
        raise InputError(f"{file.parent}: it is the folder of the rig {inside!r}; give the study another name")
    every = {name: parameter.default for name, parameter in one.parameters.items()} | values
    numbers = {k: v for k, v in every.items() if v is not None and not hasattr(v, "ppf")}
    lines = unusual(numbers, set(values))
    # A value with its unit lacks none.
    lines = [line.partition("; ")[0] if request.has_unit(line.partition(" ")[0]) else line for line in lines]
    remark = warn_unusual(lines, strict=strict)
    typed_study, rig = registry.argument_of(one.name), file if request.structure else None
    sweep = replace(
        sweep,
        request={**sweep.request, **request.stored()},
        remark=remark,
        rerun=partial(rerun, typed_study, dict(values), rig=rig) if typed_study else None,
    )
    return sweep.plan(file, fresh=fresh, adopt=adopt, retry_failed=retry_failed, strict=strict)


def plan_map(
    x: str, y: str | None = None, quantities: str | Sequence[str] = "growth_rate",
    fix: Mapping[str, Any] | None = None, out: str | Path | None = None, *, rig: Any = None, **how: Any,
) -> tuple[Study, sweeps.Plan]:  # fmt: skip
    """The study and the plan of a map; `rig` is as in `rigs.requested`, `how` has options of both."""
    names = [name.strip() for name in quantities.split(",")] if isinstance(quantities, str) else quantities
    one = registry.of_quantities(names)
    stored = {name: how.pop(name) for name in ("fresh", "adopt", "retry_failed", "strict") if name in how}
    sides = tuple(side.partition("=")[0].strip() for side in (x, y) if side)
    asked, place = rigs.requested(rig, Request(values=fix or {}, sides=sides), one, out)
    about: dict[str, Any] = {"structure": asked.structure, "rig": asked.rig, "base": asked.base}
    request = mapping.request_of(one, x, y, names, asked.values, **about, **how)
    return one, plan(one, request, place, **stored)


def rerun(study: str, values: Mapping[str, Any], point: Mapping[str, Any], rig: Path | None = None) -> str:
    """The command that computes one point of a study again; `rig` is the file of a result with its structure."""
    chosen = {name: value for name, value in values.items() if not hasattr(value, "ppf")} | dict(point)
    options = []
    for name, value in chosen.items():
        if name not in ("sample", "row"):
            numbers = ["auto" if each is None else each for each in np.ravel(value).tolist()]
            options += ["--set", f"{name}={joined(numbers)}"]
    options += ["--rig", str(rig)] if rig else []
    return shlex.join(["fiv", "run", study, *options, "--scheduler", "sync", "--out", "again", "--fresh"])


def backend(scheduler: Any, workers: int | None) -> tuple[Any, int | None]:
    """Back end and workers for `Plan.run`: as requested; else Dask's configured cluster; else threads.

    Workers without a scheduler are processes on this machine. Other combinations raise an `InputError`.
    """
    if scheduler is None:
        import dask

        address = dask.config.get("scheduler-address", None)
        if address is not None and "://" not in str(address):
            raise InputError(f"DASK_SCHEDULER_ADDRESS = {address!r}: it must be an address like tcp://host:8786")
        scheduler = "processes" if workers is not None else (address or "threads")
    if isinstance(scheduler, str):
        if "://" in scheduler and workers is not None:
            raise InputError(f"workers = {workers}: the cluster at {scheduler} has its own; leave it out")
        check_backend(scheduler, workers)
    return scheduler, workers


def execute(
    study: Study,
    planned: sweeps.Plan,
    scheduler: Any = "threads",
    workers: int | None = None,
    progress: Progress | None = None,
    *,
    fail_fast: bool = False,
) -> RunResult:
    """Run a study's plan, then draw its whole file, which may contain more than the requested points."""
    assert planned.store is not None
    dataset = planned.run(scheduler, workers, progress, fail_fast=fail_fast)
    whole = dataset if planned.points == planned.manifest.grid.size else sweeps.open_results(planned.store)
    return RunResult(study, dataset, planned.store, plot(study, whole, planned.store))


def study_of(dataset: xr.Dataset, whose: str = "dataset") -> Study:
    """The study of a result, by the name in its file; an unknown study gets the general presentation."""
    name = str(dataset.attrs.get("sweep", ""))
    if not name or "status" not in dataset:
        raise InputError(f"{whose}: it is not the result of a study; give the file of one")
    if is_fit(dataset):
        from studies.fitting import presentation

        return presentation.study(dataset)
    try:
        return registry.load(name)
    except InputError:
        from studies.study import Study

        return Study(name, str(dataset.attrs.get("title", name)), "", {}, {"-": ("1", "")}, lambda: {})


def draw(study: Study, dataset: xr.Dataset, *, title: bool = True, **look: Any) -> dict[str, Any]:
    """Figures of a result by the suffix of their file: "" for the study's, "-series" for recorded series.

    `look` are the options of `figures.style`. Settings stand below a figure with a `title`; missing points are
    named below each figure.
    """
    from studies.plotting import figures, general

    with figures.style(**look):
        shown = summary.presented(study, dataset) if study.figure is not None else None
        whole = general.draw(dataset, study) if shown is None or study.figure is None else study.figure(shown)
        drawn = {"": whole}
        names = [name for name in general.series_of(dataset) if name not in study.outputs]
        drawn |= {"-series": general.draw_series(dataset, names)} if names else {}
        texts = summary.was_set(study, dataset), summary.missing(dataset)
        return {name: figures.finish(figure, *texts, title=title) for name, figure in drawn.items()}


def image(
    study: Study, dataset: xr.Dataset, form: str = "png", *, title: bool = True, **look: Any
) -> dict[str, bytes]:
    """The figures as files that contain their origin (`picture_digest`); options as in `draw`."""
    from studies.plotting import figures

    with figures.style(**look):
        # A report looks for pictures with a title.
        digest = picture_digest(study, dataset) if title else ""
        drawn = draw(study, dataset, title=title, **look)
        return {name: figures.saved(figure, form, digest) for name, figure in drawn.items()}


def picture_digest(study: Study, dataset: xr.Dataset) -> str:
    """Digest of what a result's figures show: data, style, and code that draws; "" if that cannot be compared."""
    from studies.plotting import figures, general

    try:
        drawing = (study.derive, study.figure, general.draw, general.draw_series, figures.finish)
        code = sweeps.digests([each for each in drawing if each is not None])
    except InputError:
        return ""
    return sha256(f"{figures.data_digest(dataset)} {code} {figures.look_digest()}".encode()).hexdigest()


def plot(study: Study, dataset: xr.Dataset, beside: Path, form: str = "png", **look: Any) -> list[Path]:
    """Draw a result beside its netCDF file, in one of `FORMATS`, like `draw`; the paths of the figures."""
    paths = []
    for name, content in image(study, dataset, form, **look).items():
        paths.append(beside.with_name(f"{beside.stem}{name}.{form}"))
        with atomic_write(paths[-1]) as temporary:
            temporary.write_bytes(content)
    return paths


def animate(moving: Sequence[Moving], beside: Path, form: str | None, vtu: bool) -> list[Path]:
    """Write animations beside a file, numbered if several: a film (gif, mp4), a series for ParaView."""
    from studies.plotting import moving as moved

    files = dict[str, bytes]()
    for k, each in enumerate(moving, 1):
        stem = f"{beside.stem}-{k}" if len(moving) > 1 else beside.stem
        files |= {f"{stem}.{form}": moved.film(each, form)} if form else {}
        if vtu:
            names = [f"{stem}-frames/{frame:03}.vtu" for frame in range(len(each.moved))]
            files |= {name: moved.vtu(each, frame).encode() for frame, name in enumerate(names)}
            files[f"{stem}.pvd"] = moved.pvd(each, names).encode()
    for name, content in files.items():
        with atomic_write(beside.parent / name) as temporary:
            temporary.write_bytes(content)
    return [beside.with_name(name) for name in files if "/" not in name]


def moving_of(study: Study, dataset: xr.Dataset) -> list[Moving]:
    """Animations of a result; none if its study does not present it."""
    shown = summary.presented(study, dataset) if study.animate is not None else None
    return [] if shown is None or study.animate is None else [*study.animate(shown)]


def nothing_moves(study: Study) -> str:
    """The reason why a result has no animation, and the studies that have one."""
    can = ", ".join(name for name in registry.names() if registry.load(name).animate is not None)
    why = "the study has no animation" if study.animate is None else "nothing in this result moves"
    return f"{study.name}: {why}; {can} have one, and structures: fiv structure FILE.toml --animate"


@contextmanager
def atomic_write(target: Path) -> Iterator[Path]:
    """Yield a temporary file, which replaces `target` unless an error occurs; a `StoreError` if it cannot."""
    if target.exists() and not target.is_file():
        raise sweeps.StoreError(f"{target} could not be written: it is no file; choose another name")
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, target)
    except OSError as problem:
        raise sweeps.StoreError(f"{target} could not be written: {problem.strerror}") from problem
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
