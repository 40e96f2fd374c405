"""Constants that decide the motion, each with the measurement behind it: `python -m tests.benchmarks constants`.

Shares of time are compared with those by four times the cut-off. Motion is chaotic: members differ by the ramp,
and what counts is by how much a difference exceeds two standard errors. `--full` measures more scenes, and
`python -m tests.benchmarks constants.rigs` keeps what 40 rigs say about the contact's constants. Half of the
rigs are those of `drawn_scene(2010, number)` that the defaults were chosen with, the others are new.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count, islice
from typing import Any, NamedTuple

import numpy as np

from fivcore import Friction, Rig, Scene, simulate, simulate_many
from fivcore.contact import reduced
from fivcore.errors import ContactError, SceneError
from fivcore.jit import Array
from fivcore.structure import MOTION_MODES, motion_cutoff
from fivcore.transient import summary
from fivcore.transient.normalised import Normalised, loading_time
from studies.accuracy.rigs import drawn_scene
from studies.physics.classical import belted, cycle
from tests.benchmarks.tables import Column, Table
from tests.helpers import meshes

SHARES = ("stick_fraction", "slip_fraction", "separation_fraction")
# Members of a scene, their least and longest time, and that in loading times.
MEMBERS, LEAST, LONGEST, LOADS = 3, 0.5, 3.0, 25.0


def shares(scene: Scene, **options: Any) -> tuple[Array, Array, list[Any]]:
    """Mean shares of the members, (3,), their standard errors, and the summaries."""
    load = loading_time(Normalised.of(scene))
    ramps = [min(1e-3, 0.1 * load) * (1.0 + 0.37 * k) for k in range(MEMBERS)]
    runs = simulate_many([scene] * MEMBERS, float(np.clip(LOADS * load, LEAST, LONGEST)), ramp=ramps, **options)
    for run in runs:
        if isinstance(run, SceneError):
            raise run
    found = np.array([[run.summary[name] for name in SHARES] for run in runs])
    return found.mean(axis=0), found.std(axis=0, ddof=1) / np.sqrt(MEMBERS), [run.summary for run in runs]


def apart(one: tuple[Array, Array, Any], other: tuple[Array, Array, Any]) -> tuple[float, float]:
    """Largest difference of a share, and how far it exceeds two standard errors."""
    difference, error = np.abs(one[0] - other[0]), 2.0 * np.hypot(one[1], other[1])
    return float(difference.max()), float(max((difference - error).max(), 0.0))


def rigs(number: int) -> Iterator[Scene]:
    """Scenes of random rigs, in halves: those that the defaults were chosen with, and new ones."""
    for k in range(number):
        yield drawn_scene(2010, k // 2) if k % 2 == 0 else drawn_scene(2026, k // 2)


def line(label: str, found: list[tuple[float, float]]) -> str:
    """Mean and largest error, and how many scenes are further off than 0.02 and two standard errors."""
    raw, beyond = np.array(found).T
    missed = int((beyond > 0.02).sum())
    return f"  {label:18}{raw.mean():8.4f}{raw.max():8.3f}{beyond.max():8.3f}{missed:5d} of {len(raw)}"


# Of an even number of `rigs`.
KNOWN, NEW = slice(0, None, 2), slice(1, None, 2)
HEAD = f"  {'':18}{'mean':>8}{'most':>8}{'beyond':>8}   further than .02 beyond 2 standard errors"


def damped(ratio: float) -> Callable[[Any], Any]:
    """A change of the damping ratio of the contact."""
    return lambda model: replace(model, C=ratio / reduced.CONTACT_DAMPING * model.C)


class Rigs(NamedTuple):
    """What random rigs say; the last axes are those of `rigs`, in halves."""

    # Of each variant, (n, 3): errors of stick and separation, and energy residual.
    errors: dict[str, Array]
    # Largest error and how far it exceeds two standard errors; of the default besides what is expected.
    largest: dict[str, list[tuple[float, float]]]
    expected: list[tuple[float, float, float]]


def measured_rigs(number: int, names: tuple[str, ...] = ()) -> Rigs:
    """Compare variants of CUTOFF_SHARE and CONTACT_DAMPING, or those named, with four times the cut-off."""
    variants: dict[str, Any] = {f"SHARE {share:g}": {"share": share} for share in (0.64, 1.0)}
    variants |= {f"DAMPING {ratio:g}": {"ratio": ratio} for ratio in (0.03, 0.045, reduced.CONTACT_DAMPING, 0.09)}
    variants = {name: variants[name] for name in names or variants}
    found = Rigs({name: [] for name in variants}, {name: [] for name in variants}, [])
    for scene in rigs(number):
        usual = reduced.default_cutoff(scene.rig)
        reference = shares(scene, cutoff=4.0 * usual)
        for name, change in variants.items():
            cutoff = change.get("share", reduced.CUTOFF_SHARE) / reduced.CUTOFF_SHARE * usual
            modify = damped(change["ratio"]) if "ratio" in change else None
            run = shares(scene, cutoff=cutoff, modify=modify)
            difference = np.abs(run[0] - reference[0])
            residual = np.mean([each["energy_residual"] for each in run[2]])
            found.errors[name].append([difference[0], difference[2], residual])
            found.largest[name].append(apart(run, reference))
        own = shares(scene)
        guess = float(np.nanmean([each["cutoff_error"] for each in own[2]]))
        scatter = 2.0 * float(np.hypot(own[1], reference[1]).max())
        found.expected.append((apart(own, reference)[0], guess, scatter))
    return found._replace(errors={name: np.array(each) for name, each in found.errors.items()})


def rig_table() -> Table:
    """Errors of shares on 40 rigs with two values of CONTACT_DAMPING, and by how much less than today's."""
    own = f"DAMPING {reduced.CONTACT_DAMPING:g}"
    errors = measured_rigs(40, ("DAMPING 0.045", own)).errors
    today, kinds = errors[own], {"40": slice(None), "20 known": KNOWN, "20 new": NEW}
    rows: list[list[Any]] = []
    for name, found in errors.items():
        for kind, which in kinds.items():
            gains = (today - found)[which, :2]
            cells = [*(mean_of(found[which, k]) for k in (0, 1)), *(mean_of(gains[:, k]) for k in (0, 1))]
            rows.append([f"{name}, {kind} rigs", *cells, float(found[which, 2].mean())])
    columns = ["stick", "separation", "less than today's: stick", "separation"]
    names = [Column("constant"), *(Column(name, "", ".4f") for name in columns)]
    return Table([*names, Column("energy residual", "", ".2g")], rows)


def mean_of(values: Array) -> dict[str, float]:
    """Mean and its standard error."""
    return {"mean": float(values.mean()), "se": float(values.std(ddof=1) / np.sqrt(len(values)))}


TABLES = {"rigs": rig_table}


def rig_constants(full: bool) -> Iterator[str]:
    """`CUTOFF_SHARE` of `LEAST_CUTOFF`, `CONTACT_DAMPING`, and the expected error of the shares."""
    _, largest, expected = measured_rigs(40 if full else 6)
    names = ("LEAST_CUTOFF", "CUTOFF_SHARE", "CONTACT_DAMPING")
    yield ", ".join(f"{name} = {getattr(reduced, name):g}" for name in names) + ":"
    yield f"  errors of shares of time on {len(expected)} random rigs, half of them new"
    yield HEAD
    yield from (line(name, found) for name, found in largest.items())
    within = sum(e < 2.0 * g + s for e, g, s in expected)
    yield f"CUTOFF_ERROR = {summary.CUTOFF_ERROR:g}, UNSTEADY = {summary.UNSTEADY:g}:"
    yield f"  at {within} of {len(expected)} the error is below twice the expected one and two standard errors;"
    means = np.nanmean(expected, axis=0)
    yield f"  mean error {means[0]:.4f}, expected {means[1]:.4f}"


def vibrating(number: int, kinds: tuple[int, ...] = (0, 1)) -> list[tuple[int, Scene]]:
    """The first scenes of random meshes of some of `meshes.KINDS` that vibrate."""
    scenes = ((seed, meshes.vibrating(seed)) for seed in count() if seed % 3 in kinds)
    return list(islice(((seed, scene) for seed, scene in scenes if scene is not None), number))


def by_modes(seed: int, scene: Scene, numbers: tuple[Any, ...]) -> dict[Any, tuple[float, float]]:
    """Errors with so many modes that move the gaps, None: by default, beside four times the default cut-off.

    Where the mesh ends below that, an eighth of its modes is left for the residual.
    """
    own = scene.rig
    default = own.cutoff or float(own.motion.frequency[-1])
    wide = meshes.structure(seed, 4.2 * default)
    top = min(4.0 * default, float(wide.frequency[-1 if wide.static > 1 else -(len(wide.frequency) // 8)]))
    scene, found = replace(scene, rig=wide), {}
    try:
        reference = shares(scene, cutoff=top)
    except ContactError:
        # With more modes the contact force is not unique.
        return {}
    for number in numbers:
        cutoff = motion_cutoff(wide, len(wide.frequency), number)
        if cutoff is not None and cutoff < 0.7 * top:
            found[number] = apart(shares(scene, cutoff=number and cutoff), reference)
    return found


def structure_constants(full: bool) -> Iterator[str]:
    """`MOTION_MODES`, and the expected error of a structure's shares."""
    numbers = (24, 30, MOTION_MODES, 50, None) if full else (None,)
    yield f"MOTION_MODES = {MOTION_MODES}, OWN_CUTOFF_ERROR = {summary.OWN_CUTOFF_ERROR:g}:"
    yield "  errors of shares of time on structures of random meshes"
    yield HEAD
    # Of strips the modes are dense, and the contact's dashpot outweighs a weak flutter.
    for scenes in (vibrating(30 if full else 4), vibrating(5, (2,)) if full else []):
        errors: dict[Any, list[tuple[float, float]]] = {number: [] for number in numbers}
        for seed, scene in scenes:
            for number, found in by_modes(seed, scene, numbers).items():
                errors[number].append(found)
        names = ", strips" if scenes and scenes[0][0] % 3 == 2 else ""
        yield from (
            line(f"{number or 'default'} modes{names}", found) for number, found in errors.items() if found
        )


def belts(step: float, full: bool) -> tuple[float, float]:
    """Largest relative errors of period and stick time of a block on a belt, rational law and a jump."""
    errors = []
    speeds = (0.05, 0.1, 0.2, 0.4, 0.8) if full else (0.2,)
    cases: list[Any] = [(V, Friction(0.0, 1.0 / 3.0, "rational")) for V in speeds]
    for V, law in [*cases, (0.2, Friction(0.5, 0.0)), (0.25, Friction(0.5, 0.0))]:
        slip, stick, _ = cycle(V, law) if law.decay_speed else (2.0 * (np.pi - np.arctan(0.5 / V)), 1.0 / V, None)
        scene, start = belted(V, law)
        how: dict[str, Any] = {"ramp": 0.0, "settle": 0.0, "min_stick": 0.5, "initial": start, "step": step}
        run = simulate(scene, 1.0 / V + 12.0 * (slip + stick), **how).summary
        periods, sticks = np.diff(run["stick_starts"]), run["stick_times"]
        errors.append((np.abs(periods / (slip + stick) - 1.0).max(), np.abs(sticks / stick - 1.0).max()))
    return tuple(np.max(errors, axis=0).tolist())


def step_constants(full: bool) -> Iterator[str]:
    """`STEP_PER_MODE` by belts, `CONTACT_STEP` by the energy of the paper's rig."""
    most = f"MOST_RIGID_STEP = {reduced.MOST_RIGID_STEP:g}"
    yield f"STEP_PER_MODE = {reduced.STEP_PER_MODE:g} ({most}): largest relative error on belts"
    yield f"  {'step times omega':18}{'period':>10}{'stick':>10}"
    for step in (0.1, 0.02, 0.01, reduced.STEP_PER_MODE, 0.0025):
        yield "  {:<18g}{:10.1e}{:10.1e}".format(step, *belts(step, full))
    yield f"CONTACT_STEP = {reduced.CONTACT_STEP:g}: energy residual of the paper's rig at 2 mm/s"
    scene, usual = Scene(2e-3, 5.0, 0.2, 9.0), reduced.reduced_model(Rig(), 5.0).default_step
    for share in (0.5, 1.0, 1.05, 1.1):
        run = simulate(scene, 2.0 if full else 0.5, step=share * usual).summary
        yield f"  {share * reduced.CONTACT_STEP:<18.3g}{run['energy_residual']:10.1e}"


def show(full: bool) -> None:
    """Print all tables."""
    for part in (step_constants, structure_constants, rig_constants):
        for text in part(full):
            print(text, flush=True)
