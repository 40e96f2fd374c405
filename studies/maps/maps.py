"""Maps: one quantity over any two axes, on every point or refined where it changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Any, NoReturn

from numpy.typing import NDArray

from fivcore import Scene, checks
from studies import results, spec
from studies.gallery.regimes import study as regimes
from studies.maps import quantities
from studies.maps.quantities import AXES, OVER_MU, QUANTITIES, RUN, Quantity
from studies.motion import ensembles, transients
from studies.motion.jobs import BATCH_MULTIPLE, check_jobs
from studies.plausible import unusual
from studies.rig import rig_of
from studies.scatter import instability
from studies.study import Study, deferred, one_word, suggest
from sweeps import Axis, Grid, InputError, Refinement, Sweep, refined

NAME = "map"
# Largest error of interpolation of a refined map, in units of the range of its values.
TOLERANCE = 0.02
MOST_POINTS = 4_000_000
# Of a file's name; file systems allow 255 bytes, and other endings take its place.
MOST_LETTERS = 200


@dataclass(frozen=True, eq=False)
class Plane:
    """Two axes with the values that they take: `x` is drawn across."""

    x: str
    y: str
    xs: NDArray[Any]
    ys: NDArray[Any]


def sweep_of(
    plane: Plane,
    quantity: str,
    fixed: Mapping[str, float],
    halvings: int = 0,
    tolerance: float | None = None,
    scatter: Mapping[str, str] | None = None,
) -> Sweep:
    """The sweep of a map.

    Parameters
    ----------
    plane : Plane
        The values of a refined map are those of its finest lattice (`studies.spec.refined`).
    quantity : str
        One of `studies.maps.quantities.QUANTITIES`.
    fixed : mapping of str to float
        Other axes' values, and settings of the runs where the quantity needs them; what is not named has the
        paper's value.
    halvings : int
        How often the intervals of the coarse lattice are halved where the quantity changes; 0: every point is
        computed.
    tolerance : float, optional
        Largest error expected of interpolation between computed points, in units of the range of the values;
        default TOLERANCE. Not for classes and counts.
    scatter : mapping of str to str, optional
        Distributions by the numbers that scatter, for a quantity of scattered rigs
        (`studies.scatter.distributions`); default: `studies.scatter.instability.usual`.

    Raises
    ------
    ValueError
        Naming the argument; nothing is planned then.
    """
    definition = _definition(quantity)
    constants = _constants(plane, quantity, fixed)
    if definition.settings is quantities.SCATTER:
        constants |= instability.counted(constants) | {"scatter": _scatter(plane, constants, scatter)}
    elif scatter:
        raise InputError(f"--scatter: {quantity} is of one rig; choose --quantity probability_unstable")
    tolerance = _tolerance(definition, quantity, halvings, tolerance)
    _check_counts(len(plane.xs), len(plane.ys))
    _check(plane, definition, constants)
    if "members" in constants:
        constants |= {"members": int(constants["members"]), "method": transients.METHOD}
    variable = definition.variable
    scaled = bool(variable.scale) and "F" in (plane.x, plane.y)
    axes = {
        name: Axis(values, AXES[name].units, AXES[name].long_name)
        for name, values in ((plane.x, plane.xs), (plane.y, plane.ys))
    }
    sweep = Sweep(
        NAME,
        definition.function,
        Grid(axes),
        {quantity: variable if scaled else replace(variable, scale="")},
        {"quantity": quantity} | constants,
        key=definition.key,
        scale=quantities.load if scaled else None,
        code=("fivcore",),
        # Bases are made anew for each of their values.
        order_by=tuple(name for name in axes if name not in ("V", "mu", "F")),
        title=f"{variable.long_name[0].upper()}{variable.long_name[1:]}, over {plane.x} and {plane.y}",
        batch_multiple=BATCH_MULTIPLE if definition.function is quantities.motion else 1,
    )
    return refined(sweep, Refinement(quantity, halvings, tolerance, definition.thresholds))


def _scatter(plane: Plane, constants: Mapping[str, Any], scatter: Mapping[str, str] | None) -> dict[str, str]:
    """How the numbers scatter that are no axis: as given, else as usual about the values that they have."""
    if not scatter:
        return instability.usual(constants)
    for name in scatter:
        if name in (plane.x, plane.y):
            raise InputError(f"--scatter {name}: it is an axis of this map; leave it out")
    return {name: each.text for name, each in instability.scatters(scatter).items()}


def plane_of(x: str, y: str, halvings: int = 0) -> Plane:
    """The plane of two texts AXIS=SPEC, each interval halved so often."""
    across, up = spec.split(x, "--x"), spec.split(y, "--y")
    _check_counts(*((spec.count(text) - 1) * 2**halvings + 1 for _, text in (across, up)))
    xs, ys = (spec.refined(text, name, halvings, _units(name)) for name, text in (across, up))
    return Plane(across[0], up[0], xs, ys)


def _check_counts(across: int, up: int) -> None:
    """Refuse more points than a map may have, at best before their values are made."""
    if across * up > MOST_POINTS:
        raise InputError(f"{across} x {up} values are {across * up} points: it must be at most {MOST_POINTS}")


def line_along(x: str, quantity: str, fixed: dict[str, Any]) -> str:
    """AXIS=VALUE of the other axis of a map along x alone, taken from what is fixed, else the paper's value."""
    names = [name for name in ("mu", "theta", "V") if name != spec.split(x, "--x")[0]]
    name = next(name for name in names if name != "mu" or quantity not in OVER_MU)
    return f"{name}={spec.typed(fixed.pop(name, AXES[name].value))}"


def unusual_in(plane: Plane, quantity: str, fixed: Mapping[str, float]) -> list[str]:
    """Warnings about unusual requested values (`studies.plausible.unusual`)."""
    values = defaults(quantity) | dict(fixed) | {plane.x: plane.xs, plane.y: plane.ys}
    return unusual(values, {name: _units(name) for name in values}, {plane.x, plane.y, *fixed})


def _units(name: str) -> str:
    """Units of what may be an axis or fixed; "" for a name that there is not."""
    setting = (AXES | RUN).get(name)
    return "" if setting is None else setting.units


def fixed_of(texts: Sequence[str]) -> dict[str, Any]:
    """Parse the texts AXIS=VALUE of fixed values.

    Raises
    ------
    ValueError
        If one is not of the form, gives more than one value, or names what another has.
    """
    fixed: dict[str, Any] = {}
    words = regimes.STUDY.texts
    for text in texts:
        name, written = spec.split(text, "--fix")
        values = [written] if name in words else spec.parse(written, name, _units(name)).tolist()
        if len(values) > 1 or name in fixed:
            raise InputError(f"--fix {text!r}: {name} must have one value; what is to vary is --x or --y")
        fixed[name] = values[0]
    return fixed


def file_of(
    plane: Plane,
    quantity: str,
    out: str | Path | None = None,
    fixed: Mapping[str, float] | None = None,
    scatter: Mapping[str, str] | None = None,
) -> Path:
    """The file of a map, named after values that are fixed at others than the paper's, and after what scatters.

    So maps that differ in these have files of their own, whatever the order of the options.
    """
    other = [f"{key}={spec.typed(value)}" for key, value in changed(quantity, fixed or {}).items()]
    other += [f"{key}={text}" for key, text in sorted((scatter or {}).items())]
    name = "-".join([quantity, plane.x, plane.y, *other])
    if len(name) > MOST_LETTERS:
        name = f"{quantity}-{plane.x}-{plane.y}-{sha256(name.encode()).hexdigest()[:16]}"
    return results.results_folder(out) / NAME / f"{name}.nc"


def defaults(quantity: str) -> dict[str, Any]:
    """Default values, by name, of everything that a map of this quantity can fix."""
    return {name: each.value for name, each in (AXES | dict(_definition(quantity).settings)).items()}


def changed(quantity: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """The values that a map of this quantity can fix and that differ from the default."""
    return {name: values[name] for name, own in defaults(quantity).items() if values.get(name, own) != own}


def _definition(quantity: str) -> Quantity:
    if quantity not in QUANTITIES:
        raise InputError(
            f"quantity = {quantity!r}: there is no such quantity; {suggest(quantity, list(QUANTITIES))}"
            f"the quantities are {', '.join(QUANTITIES)}"
        )
    return QUANTITIES[quantity]


def _constants(plane: Plane, quantity: str, fixed: Mapping[str, float]) -> dict[str, Any]:
    """Constants of all points of the map."""
    sides = {"x": plane.x, "y": plane.y}
    for side, name in sides.items():
        if name not in AXES:
            near = suggest(name, list(AXES))
            raise InputError(f"--{side} {name}: there is no such axis; {near}the axes are {', '.join(AXES)}")
        if name == "mu" and quantity in OVER_MU:
            raise InputError(f"--{side} mu: {quantity} is found over all mu, which cannot be an axis then")
    if plane.x == plane.y:
        raise InputError(f"--y {plane.y}: it is the axis --x already; a map has two")
    every = defaults(quantity)
    for name in fixed:
        if name in sides.values():
            raise InputError(f"--fix {name}: it is an axis of this map; leave it out")
        if name not in every:
            why = f"{quantity} does not depend on it" if name in RUN else "there is no such axis or setting"
            near = suggest(name, list(every))
            raise InputError(f"--fix {name}: {why}; {near}what can be fixed is {', '.join(every)}")
    return {name: value for name, value in (every | dict(fixed)).items() if name not in sides.values()}


def _tolerance(definition: Quantity, quantity: str, halvings: int, tolerance: float | None) -> float | None:
    if tolerance is None:
        return None if definition.is_whole else TOLERANCE
    problem = "" if halvings else "it is for a refined map; say --refine N as well"
    if definition.is_whole:
        problem = f"{quantity} has whole numbers, between which nothing is interpolated; leave it out"
    if problem:
        raise InputError(f"tolerance = {tolerance:g}: {problem}")
    return checks.between("tolerance", tolerance, 1e-12, 1e12, "of the range of the values")


def _check(plane: Plane, definition: Quantity, constants: Mapping[str, Any]) -> None:
    """Find out, before anything is planned, what cannot be computed.

    A scene whose contact has no unique solution is not refused: its point fails by itself.
    """
    for x, y in [*product(plane.xs, plane.ys[:1]), *product(plane.xs[:1], plane.ys)]:
        _scene(plane, constants, x, y)
    for name, setting in definition.settings.items():
        if setting.words:
            one_word(name, constants[name], setting.words)
    if "cutoff" in definition.settings:
        checks.between("cutoff", constants["cutoff"], 0.0, 1e12, "Hz")
    if "members" in definition.settings:
        checks.count("members", constants["members"], regimes.MOST_MEMBERS)
        ensembles.check(constants)
        fixed = {**constants, "method": transients.METHOD}
        corners = [_scene(plane, constants, x, y) for x, y in product(plane.xs[[0, -1]], plane.ys[[0, -1]])]
        check_jobs([ensembles.member(scene, 1, fixed, 1e-6) for scene in corners])


def _scene(plane: Plane, constants: Mapping[str, Any], x: float, y: float) -> Scene:
    numbers = {name: float(value) for name, value in constants.items() if name in AXES}
    numbers |= {plane.x: float(x), plane.y: float(y)}
    rig, _ = rig_of(numbers)
    return Scene(**{name: numbers[name] for name in transients.SCENE}, rig=rig)


def _refused(*_: Any) -> NoReturn:
    raise InputError(f"STUDY = {NAME!r}: maps are made by a command of their own: fiv map --help tells how")


# What draws and explains a map's file.
STUDY = Study(
    name=NAME,
    title="Maps: one quantity over any two axes",
    question="How does a quantity change over a plane?",
    paper="Table 6 and Figs. 5 and 11 are lines and points of such planes.",
    axes={},
    settings={},
    build=_refused,
    draw=deferred("studies.maps.figure:draw"),
    findings=deferred("studies.maps.findings:findings"),
)
