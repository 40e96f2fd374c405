"""Maps: quantities over two parameters or along one; those of one function are a group, and that a study."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from typing import Any

import numpy as np
import xarray as xr

from fivcore import (
    Friction,
    Rig,
    Scene,
    Structure,
    checks,
    flutter_onsets,
    glued_frequencies,
    limit_cycle,
    lyapunov_exponent,
    painleve_mu,
)
from fivcore.errors import SceneError, UnsolvedError
from studies import labels, paper, spec, summary, uncertainty
from studies.asking.sweep import sweep_of
from studies.gallery import knock
from studies.motion import ensemble, regimes, run
from studies.motion.jobs import outcomes
from studies.parameters import RIG, RUN, SCENE, SLIDING, Parameter, rig_numbers, suggest, unusual, warn_unusual
from studies.plotting import figures, planes
from studies.refinement import report
from studies.request import Request, assignment, structure_of
from studies.results import MAPS, configuration, results_folder, settings, structure_in
from studies.stability import first_of, growths
from studies.study import Study
from sweeps import FAILED, InputError, Plan, Refinement, Variable, check_counts, refined

MU_MAX, LONGEST_NAME = 1.0, 60
# Length of a run that is searched for a limit cycle, s; of a structure in units of its time.
SEARCH = 0.5
# A quantity passes from one class to another at these values.
THRESHOLDS = {"growth_rate": 0.0, "lyapunov_exponent": 0.0, "probability_unstable": 0.5}
# Points of the paper: its tests, and where it finds modes to become unstable.
POINT = {name: parameter.default for name, parameter in (SCENE | RIG).items()}
PAPER = [("*", "tests, paper", POINT | {"V": V}) for V in paper.SPEEDS]
PAPER += [("D", "first unstable μ, paper", POINT | {"mu": mu}) for mu, _ in paper.ONSETS]
GROWTH = {
    "growth_rate": Variable("s-1", "growth rate of the least stable mode", (), "float32", digits=4),
    "frequency": Variable("Hz", "frequency of the least stable mode", (), "float32", digits=5),
    "unstable_modes": Variable("1", "number of unstable modes", (), "int8"),
}
ONSET = {"onset_mu": ("1", "lowest onset mu"), "onset_frequency": ("Hz", "frequency at the lowest onset")}
ONSET |= {
    "recovery_mu": ("1", "lowest mu at which a pair recovers"),
    "divergence_mu": ("1", "mu from which the contact jams"),
}
GLUED = {f"glued_frequency_{k}": ("Hz", f"natural frequency {k}, glued") for k in range(1, 9)}
# A standard error says what it is of; what a member or a regime has is left out.
MOTION = {
    n: v if n.endswith("_se") else replace(v, long_name=v.long_name.split(",")[0])
    for n, v in ensemble.outputs().items()
    if v.dims in ((), ("motion",))
}
CHAOS = {"lyapunov_exponent": ("s-1", "largest Lyapunov exponent of the motion")}
CHAOS |= {f"{name}_se": ("s-1", f"standard error of the {text}") for name, (_, text) in CHAOS.items()}
CYCLE = {
    "limit_cycle_frequency": ("Hz", "frequency of the limit cycle near the motion"),
    "limit_cycle_rms": Variable("m s-1", "RMS of the velocity of B on the limit cycle", (), scale="load"),
    "limit_cycle_stable": ("1", "1 where the limit cycle is stable, 0 where it is not"),
}
PROBABILITY = {"probability_unstable": ("1", "probability of instability")}
PROBABILITY |= {f"{name}_se": ("1", f"standard error of the {text}") for name, (_, text) in PROBABILITY.items()}


def growth(rig: Rig, theta: Any, mu: Any, **sliding: Any) -> dict[str, Any]:
    """The least stable mode of steady sliding, and the number of unstable ones."""
    return dict(zip(GROWTH, map(np.atleast_1d, growths(rig, theta, mu, **sliding)), strict=True))


def onset(rig: Rig, theta: Any, **sliding: Any) -> dict[str, Any]:
    """The lowest onset of flutter, the lowest recovery, and divergence; NaN without one."""
    columns, found = np.broadcast_arrays(np.atleast_1d(theta), *(sliding[name] for name in SLIDING)), []
    for angle, V, F, *law in zip(*(column.tolist() for column in columns), strict=True):
        crossings = flutter_onsets(rig, angle, run.BAND, MU_MAX, friction=Friction(*law), V=V, F=F)
        recovery = min(crossings.recovery_mu.tolist(), default=np.nan)
        found.append((*first_of(crossings, run.BAND), recovery, crossings.divergence_mu))
    return dict(zip(ONSET, np.transpose(found), strict=True))


def contact_limit(rig: Rig, theta: Any, **options: Any) -> dict[str, Any]:
    """The friction from which on the contact force is not unique; NaN where it always is."""
    found = [painleve_mu(rig, angle, run.METHOD, **options) for angle in np.ravel(theta).tolist()]
    return {"painleve_mu": np.where(np.isfinite(found), found, np.nan)}


def glued(rig: Rig, theta: Any) -> dict[str, Any]:
    """Natural frequencies of the beams glued at the contact."""
    found = [glued_frequencies(rig, angle, len(GLUED)) for angle in np.ravel(theta).tolist()]
    return dict(zip(GLUED, np.transpose(found), strict=True))


def motion(scenes: Sequence[Scene], members: int, **options: Any) -> dict[str, Any]:
    """Statistics of the realisations of each scene."""
    jobs = [ensemble.ensemble(scene, members, options) for scene in scenes]
    return outcomes(jobs, lambda _, runs: {k: v for k, v in ensemble.statistics(runs).items() if k in MOTION})


def chaos(scenes: Sequence[Scene], duration: float, **how: Any) -> dict[str, Any]:
    """The largest Lyapunov exponent of the motion of each scene, NaN where it has none."""
    found, errors = list[tuple[float, float]](), list[SceneError | None]()
    for scene in scenes:
        try:
            exponent = lyapunov_exponent(scene, duration, **how)
            found.append((exponent.value, exponent.standard_error))
            errors.append(None)
        except SceneError as error:
            found.append((np.nan, np.nan))
            errors.append(error)
    return dict(zip(CHAOS, np.transpose(found), strict=True)) | {"error": errors}


def cycles(scenes: Sequence[Scene], duration: float | None, **how: Any) -> dict[str, Any]:
    """The limit cycle near which the motion of each scene is, NaN where none is found."""
    found, errors = list[tuple[float, ...]](), list[SceneError | None]()
    for scene in scenes:
        values, error = (np.nan, np.nan, np.nan), None
        try:
            cycle = limit_cycle(scene, duration=duration or SEARCH * scene.rig.time_scale, **how)
            values = (cycle.frequency, cycle.summary["velocity_rms"], float(cycle.stable))
        except UnsolvedError:
            pass
        except SceneError as problem:
            error = problem
        found.append(values)
        errors.append(error)
    return dict(zip(CYCLE, np.transpose(found), strict=True)) | {"error": errors}


def probability(rig: Rig, theta: Any, mu: Any, samples: int, seed: int, distributions: Any) -> dict[str, Any]:
    """The fraction of uncertain rigs that are unstable; one sample of rigs serves all points."""
    theta, mu = np.broadcast_arrays(np.atleast_1d(theta), np.atleast_1d(mu))
    draws = uncertainty.draws(distributions or uncertainty.usual(rig_numbers(rig)), samples, seed)
    drawn_mu, share = draws.pop("mu", None), np.empty(len(theta))
    for angle in np.unique(theta):
        rows = theta == angle
        friction = mu[rows] if drawn_mu is None else drawn_mu[:, None]
        share[rows] = uncertainty.unstable_share(rig, {"theta": angle} | draws, friction)
    return dict(zip(PROBABILITY, (share, np.sqrt(share * (1.0 - share) / samples)), strict=True))


def plan(
    x: str, y: str | None = None, quantities: str | Sequence[str] = "growth_rate",
    fix: Mapping[str, Any] | None = None, refine: int = 0, tolerance: float | None = None, out: Any = None, *,
    samples: int | None = None, seed: int | None = None, strict: bool = False, rig: Any = None, command: str = "",
    **how: Any,
) -> tuple[Study, Plan]:  # fmt: skip
    """The study and the plan of a map, with its file in the results folder.

    `x` and `y` are NAME=SPEC, `fix` has values of other parameters and distributions. With `refine` intervals are
    halved so often where the first quantity changes, or where interpolation is off by `tolerance` of its range.
    `rig` is a structure or its file (`request.structure_of`), in place of the beams; `command` as in a `Request`.
    """
    names = [name.strip() for name in quantities.split(",")] if isinstance(quantities, str) else list(quantities)
    groups = dict.fromkeys(map(quantity_group, names))
    if len(groups) > 1:
        raise InputError(
            f"quantity {','.join(names)}: {' and '.join(groups)} need different computations; draw two maps"
        )
    study, sides = STUDIES[next(iter(groups))], dict(assignment(side, "x or y") for side in (x, y) if side)
    fixed = dict(fix or {}) | {k: v for k, v in (("samples", samples), ("seed", seed)) if v is not None}
    for option, name in [*zip(("x", "y"), sides, strict=False), *(("fix", name) for name in fixed)]:
        if name not in study.parameters:
            near = f"{suggest(name, known := study.known(rig))}choose from {', '.join(known)}"
            raise InputError(f"{option} {name}: {names[0]} does not depend on it; {near}")
        if (y and len(sides) < 2) or (option == "fix" and name in sides):
            raise InputError(f"{option} {name}: it varies already; give it once")
    check_counts({name: (spec.count(text) - 1) * 2**refine + 1 for name, text in sides.items()})
    values = Request(study.name, fixed | sides).values_of(study)
    default = {name: parameter.default for name, parameter in study.parameters.items()}
    for name in fixed:
        if np.size(values[name]) > 1 or (hasattr(values[name], "ppf") and "samples" not in default):
            raise InputError(f"fix {name}: it must have one value; what varies is x or y")
    numbers = {name: np.ravel(value)[0] for name, value in (default | values).items() if name not in sides}
    changed = [f"{n}{spec.typed(getattr(v, 'text', v))}" for n, v in sorted(numbers.items()) if v != default[n]]
    if "samples" in numbers and not any(hasattr(value, "ppf") for value in values.values()):
        values |= uncertainty.distributions(uncertainty.usual(numbers))
    if refine:
        values |= {n: spec.refined(text, n, refine, study.parameters[n].units) for n, text in sides.items()}
    structure = None if rig is None else structure_of(rig)
    sweep = sweep_of(study, values, structure=structure)
    whole = np.dtype(study.outputs[names[0]].dtype).kind == "i"
    plain = {name: value for name, value in values.items() if not hasattr(value, "ppf")}
    # A file is written again where its title changes: then it has this request, which is drawn.
    title, request = f"{', '.join(names)} over {', '.join(sides)}", {"x": next(iter(sides)), "quantities": names}
    request |= {"command": command} if command else {}
    remark = warn_unusual(unusual(plain, plain), strict=strict)
    sweep = replace(sweep, title=title, request={**sweep.request, **request}, remark=remark)
    if tolerance is not None and (whole or not refine):
        raise InputError(f"tolerance = {tolerance:g}: it is for numbers, with refine; leave it out")
    if refine:
        limit = checks.between("tolerance", 0.02 if tolerance is None else tolerance, 1e-12, 1e12, "of the range")
        thresholds = tuple(value for name, value in THRESHOLDS.items() if name == names[0])
        sweep = refined(sweep, Refinement(names[0], refine, None if whole else limit, thresholds))
    if structure is not None:
        changed.append(f"rig{Structure.from_dict(structure).digest[:8]}")
    parts = [names[0] if refine else study.name.removeprefix(f"{MAPS}_"), *sides]
    file = re.sub(r"[^\w.+-]", "_", "-".join([*parts, *changed]))
    file = file if len(file) <= LONGEST_NAME else "-".join([*parts, sha256(file.encode()).hexdigest()[:8]])
    return study, sweep.plan(results_folder(out) / MAPS / f"{file}.nc", strict=strict, **how)


def quantity_group(name: str) -> str:
    """The group of a quantity; an `InputError` suggests the nearest."""
    if name not in QUANTITIES:
        main = ", ".join(each for each in QUANTITIES if not each.endswith(("_se", "_std")))
        raise InputError(f"quantity {name}: there is none; {suggest(name, QUANTITIES)}choose from {main}")
    return QUANTITIES[name]


def arranged(dataset: xr.Dataset) -> tuple[list[str], str, str | None]:
    """The requested quantities, the parameter across, and that upwards."""
    request, dims = configuration(dataset).get("request", {}), [str(dim) for dim in dataset["status"].dims]
    x = request["x"] if request.get("x") in dims else dims[0]
    names = [name for name in request.get("quantities", ()) if name in dataset]
    return names or list(map(str, dataset.data_vars))[:1], x, next((dim for dim in dims if dim != x), None)


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """The range of each quantity, how it was computed, and the values along one parameter."""
    names, x, y = arranged(dataset)
    for name in names:
        values, (unit, _) = labels.readable(dataset[name]), labels.unit_of(dataset[name])
        found = " to ".join(dict.fromkeys(labels.number(float(end)) for end in (values.min(), values.max())))
        missing = int(values.isnull().sum())
        found = f"{found} {unit}".rstrip() + f", no value at {missing} of {values.size} points" * bool(missing)
        if "flag_values" in values.attrs:
            words, counts = np.unique(labels.words(values), return_counts=True)
            shares = zip(words, 100.0 * counts / values.size, strict=True)
            found = ", ".join(f"{word} {share:.3g} %" for word, share in shares)
        elif name in THRESHOLDS:
            found += f", above {THRESHOLDS[name]:g} at {100.0 * float((values > THRESHOLDS[name]).mean()):.3g} %"
        yield f"{labels.title(name, dataset[name])}: {found}."
    yield " ".join([f"{dataset['status'].size} points.", *report(dataset)])
    if y is None:
        yield "Values", summary.frame(dataset, [x, *names, *(f"{n}_se" for n in names if f"{n}_se" in dataset)])
    if texts := configuration(dataset)["constants"].get("distributions"):
        yield "Uncertain parameters", uncertainty.table(texts)


def draw(dataset: xr.Dataset) -> Any:
    """A panel for each quantity, over two parameters or along one."""
    names, x, y = arranged(dataset)
    figure, panels = figures.panels(len(names), 1, 16.0, 4.0 + (7.5 if y else 5.0) * len(names))
    if "regime" in dataset:
        other = planes.FAILED + (dataset["status"] != FAILED)
        dataset = dataset.assign(kind=dataset["regime"].fillna(other).astype(int))
    for axes, name in zip(panels, names, strict=True):
        (_draw_plane if y else _draw_curve)(axes, dataset, name, x, str(y))
    figures.legend_below(figure, panels, 3)
    study = STUDIES[str(dataset.attrs["sweep"]).removeprefix(f"{MAPS}_")]
    texts = configuration(dataset)["constants"].get("distributions", {})
    fixed = [n for n, value in settings(dataset).items() if n in SCENE or value != study.parameters[n].default]
    about = [labels.named(name, dataset[name]) for name in fixed if name not in texts]
    about += [structure_in(dataset).get("name", "")] * bool(structure_in(dataset))
    about += [f"{len(texts)} uncertain parameters"] * bool(texts)
    figure.suptitle(figures.fitted(f"{study.title}\n{', '.join(about)}".strip(), 16.0))
    return figure


def _draw_plane(axes: Any, dataset: xr.Dataset, name: str, x: str, y: str) -> None:
    """A quantity over two parameters, its threshold between the cells, failed points, and the paper's."""
    values = labels.readable(dataset[name].transpose(y, x)).astype(float)
    left, low = (planes.edges(labels.readable(dataset[dim]).values.astype(float)) for dim in (x, y))
    if name == "regime":
        planes.regimes(axes, dataset["kind"], x, y)
        for code in np.unique(dataset["kind"]):
            axes.fill_between([], [], facecolor=planes.COLOURS[code], edgecolor="black", label=regimes.KINDS[code])
    else:
        if name == "growth_rate":
            planes.cells(axes, 0.0 * values.where(values <= 0.0), x, y, cmap="Greys", vmin=-0.15, vmax=1.0)
            axes.fill_between([], [], color="#ededed", label="stable")
            values = values.where(values > 0.0)
        log = {"norm": "log"} if name in knock.OUTPUTS and values.min() > 0.0 else {}
        bar = axes.figure.colorbar(planes.cells(axes, values, x, y, **log), ax=axes)
        bar.set_label(figures.fitted(labels.label(dataset[name], long=True), 7.0))
        axes.set_title("" if values.notnull().any() else "no value", fontsize=9.0)
        failed = np.ma.masked_not_equal(dataset["status"].transpose(y, x).values, FAILED)
        if failed.count():
            axes.pcolor(left, low, failed, hatch="xxxx", facecolor="none", edgecolor=figures.GREY, label="failed")
    if name in THRESHOLDS:
        above = (dataset[name] > THRESHOLDS[name]).where(dataset[name].notnull()).transpose(y, x)
        if 0.0 < float(above.mean()) < 1.0:
            # Twice the values at both ends of each cell: the contour follows the sides of the cells.
            sides = [np.repeat(ends, 2)[1:-1] for ends in (left, low)]
            axes.contour(*sides, np.kron(above, np.ones((2, 2))), levels=[0.5], colors="black", linewidths=1.2)
            axes.plot([], [], color="black", label=f"{labels.title(name)} {THRESHOLDS[name]:g}")
    planes.mark_mixed(axes, dataset, x, y)
    _mark_paper(axes, dataset, [x, y])


def _draw_curve(axes: Any, dataset: xr.Dataset, name: str, x: str, _: str) -> None:
    """A quantity along one parameter with its standard errors, its threshold, and the paper's values."""
    xs, values = (labels.readable(dataset[key]).values.astype(float) for key in (x, name))
    errors = labels.readable(dataset[f"{name}_se"]).values if f"{name}_se" in dataset else None
    if "regime" in dataset:
        planes.along(axes, xs, values, dataset["kind"].values, errors)
    else:
        line = "" if name == "onset_frequency" else "-"  # that of another pair wherever it jumps
        axes.errorbar(xs, values, errors, color=figures.BLUE, marker="o", markersize=3.0, linestyle=line)
    if name == "regime":
        axes.set_yticks(range(len(run.REGIMES)), run.REGIMES)
    elif name in THRESHOLDS:
        axes.axhline(THRESHOLDS[name], color=figures.GREY, linewidth=0.8)
    planes.draw_mixed(axes, dataset, x, name)
    planes.set_side(axes, "x", dataset[x])
    axes.set_ylabel(figures.fitted(labels.label(dataset[name], long=True), 6.0))
    _mark_paper(axes, dataset, [x])


def _mark_paper(axes: Any, dataset: xr.Dataset, dims: list[str]) -> None:
    """Mark the points of the paper's rig and tests in a plane, or their values along one parameter."""
    fixed = settings(dataset)
    for marker, label, point in PAPER:
        beams = set(dims) <= set(point) and not structure_in(dataset)
        papers = beams and all(fixed.get(name, value) == value for name, value in point.items())
        if papers and (marker == "*" or ("mu" in dims and "regime" not in dataset)):
            place = tuple(labels.unit_of(dataset[dim])[1] * point[dim] for dim in dims)
            if len(dims) == 2:
                planes.marks(axes, [place], marker=marker, color="black", mfc="white", markersize=8.0, label=label)
            elif dataset[dims[0]].min() <= point[dims[0]] <= dataset[dims[0]].max():
                axes.axvline(*place, color=figures.ORANGE, linestyle=":" if marker == "*" else "--", label=label)


RUNS = ensemble.members(1) | ensemble.until(0.3, 16.0)
DRAWS = {"samples": (1024, "number of uncertain rigs"), "seed": (0, "seed of the random numbers")}
TIME = {"duration": Parameter(4.0, "s", "simulated time", common=True)}
TIME |= {name: RUN[name] for name in ("ramp", "cutoff", "numerical_damping")}
MODEL = {name: RUN[name] for name in ("cutoff", "numerical_damping")}
SEARCHED = TIME | {"duration": Parameter(None, "s", "time of the run that is searched; auto: 0.5 s", common=True)}
BEAMS, STEADY, SEVERAL = {"beams": True}, {"normalised": True}, {"normalised": True, "chaotic": True}
LIMIT = {"painleve_mu": ("1", "mu from which on the contact force is not unique")}
DRAWN = {name: Parameter(value, "1", text, common=True) for name, (value, text) in DRAWS.items()}
# Group, title, parameters besides those of the rig and the scene, outputs, function, and the rest.
GROUPS: tuple[tuple[str, str, Any, Any, Any, dict[str, Any]], ...] = (
    ("growth", "Least stable mode of steady sliding (modes below 10 kHz)", SLIDING, GROWTH, growth, STEADY),
    ("onset", "Lowest μ at which steady sliding flutters (modes below 10 kHz)", SLIDING, ONSET, onset, STEADY),
    ("contact_limit", "Uniqueness of the contact force", MODEL, LIMIT, contact_limit, {}),
    ("glued", "Natural frequencies of the beams glued at the contact", {}, GLUED, glued, BEAMS),
    ("motion", "Motion", RUNS, MOTION, motion, SEVERAL | {"check": ensemble.check, "coords": ensemble.APART}),
    ("chaos", "Chaos: how fast neighbouring motions part", TIME, CHAOS, chaos, STEADY | {"chaotic": True}),
    ("cycles", "Limit cycle near the motion", SEARCHED, CYCLE, cycles, STEADY | {"chaotic": True}),
    (
        "knock",
        "Smallest knock that starts vibration where steady sliding is stable",
        knock.PARAMETERS,
        knock.OUTPUTS,
        knock.knocks,
        {"check": knock.check, "normalised": True, "chaotic": True},
    ),
    (
        "probability",
        "Stability of uncertain rigs",
        DRAWN,
        PROBABILITY,
        probability,
        BEAMS | {"check": uncertainty.check},
    ),
)
STUDIES = {
    group: Study(f"{MAPS}_{group}", title, title, more, out, call, summary=summarise, figure=draw, **how)
    for group, title, more, out, call, how in GROUPS
}
# Quantities with their groups.
QUANTITIES = {n: group for group, study in STUDIES.items() for n, each in study.outputs.items() if not each.dims}
