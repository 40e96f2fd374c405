"""A study: parameters, the function of them that answers a question, and how the answer is presented."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fivcore import Rig, Structure, checks, flutter_onsets, painleve_mu
from fivcore.errors import SceneError
from studies import paper
from studies.motion import scenes, series
from studies.motion.above import with_growth_above
from studies.parameters import FRICTION, RIG, SCENE, Parameter, suggest
from studies.results import is_usual, settled, structure_in
from sweeps import DONE, PENDING, Axis, Grid, InputError, Sample, Sweep, Variable, check_size

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from studies.claims import Claim

__all__ = ["Parameter", "Study"]

SAMPLES, SEED = 1024, 0
# Values of an axis, and draws, that are checked before a run; others fail by themselves.
CHECKED, DRAWS_CHECKED = 10_000, 16
# Largest friction at which the first onset of a structure is sought.
MOST_FRICTION = 10.0


@dataclass(frozen=True, eq=False)
class Study:
    """A question, the parameters that it is asked over, and the function that answers it at each point.

    Parameters
    ----------
    name, title, question : str
        `title` heads the figure's page; `question` is a sentence.
    parameters : mapping of str to Parameter
        In the order of the result's dimensions. Those of the rig and of a scene that `function` takes are added
        with the paper's values.
    outputs : mapping of str to (Variable or tuple)
        (units, text, *dimensions) or a `sweeps.Variable`.
    function : callable
        Called with what its signature names: `rig`, a `fivcore.Rig`; `scenes`, a list of `fivcore.Scene`;
        `distributions`, the requested ones as text; `record`, series to keep, with their `times`; or parameters:
        one value of those that are fixed or common, else an array with one entry a point; ``**others`` takes the
        rest. Returns an array for each output, points first; a shorter one is padded with NaN.
    paper : str
        What the paper says, with the section.
    derive : callable, optional
        `derive(dataset)` returns the dataset with what follows from the whole of it.
    summary : callable, optional
        `summary(dataset)` yields sentences, and pairs of a caption and a pandas DataFrame; the finding first.
    figure : callable, optional
        `figure(dataset)` returns a Matplotlib figure.
    claims : sequence of Claim
        What the paper prints, to stand beside the result.
    coords : mapping of str to Axis, or callable
        Axes of the outputs' own dimensions; a callable takes parameters by name, or `rig`; of
        several rigs the longest axes count.
    check : callable, optional
        Takes parameters by name, one value or an array, or `rig`, the first; raises `ValueError` for what cannot
        be computed.
    follows : str
        The parameter that names another, whose range is the dimension "followed" of the outputs and goes by its
        own name in a result: `scenes` has a tuple of scenes for each point, one for each value in their order.
    normalised : bool
        Compute the scaled scene with V > 0 and F = 1 once for all points that are equivalent to it;
        `Variable.scale` "load" or "along" names the factor of a point. A function that takes no scenes is of
        steady sliding: with friction that does not fall it depends neither on V nor on F.
    chaotic : bool
        The motion is chaotic: another processor changes digits, and only statistics can be compared.
    beams : bool
        It is about the paper's two beams: structures of one's own are refused.
    by_contact : mapping
        Outputs on the dimension `contact`, which a structure with several contacts has besides.
    """

    name: str
    title: str
    question: str
    parameters: Mapping[str, Parameter]
    outputs: Mapping[str, Any]
    function: Callable[..., Mapping[str, Any]]
    paper: str = field(default="", kw_only=True)
    derive: Callable[[xr.Dataset], xr.Dataset] | None = field(default=None, kw_only=True)
    summary: Callable[[xr.Dataset], Iterator[Any]] | None = field(default=None, kw_only=True)
    figure: Callable[[xr.Dataset], Figure] | None = field(default=None, kw_only=True)
    claims: Sequence[Claim] = field(default=(), kw_only=True)
    coords: Mapping[str, Axis] | Callable[..., Mapping[str, Axis]] = field(default_factory=dict, kw_only=True)
    check: Callable[..., None] | None = field(default=None, kw_only=True)
    follows: str = field(default="", kw_only=True)
    normalised: bool = field(default=False, kw_only=True)
    chaotic: bool = field(default=False, kw_only=True)
    beams: bool = field(default=False, kw_only=True)
    by_contact: Mapping[str, Variable] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        takes = set(inspect.signature(self.function).parameters)
        added = dict[str, Parameter]()
        if "scenes" in takes:
            added |= SCENE | FRICTION
        if takes & {"scenes", "rig"}:
            added |= {name: SCENE[name] for name in SCENE if name in takes} | RIG
        parameters = {**self.parameters, **{k: v for k, v in added.items() if k not in self.parameters}}
        # A call has one rig.
        parameters = {k: replace(v, common=True) if k in RIG else v for k, v in parameters.items()}
        outputs = {
            k: v if isinstance(v, Variable) else Variable(v[0], v[1], tuple(v[2:]))
            for k, v in self.outputs.items()
        }
        vars(self).update(parameters=parameters, outputs=outputs)  # it is frozen

    @property
    def takes(self) -> set[str]:
        """The names in the function's signature."""
        return set(inspect.signature(self.function).parameters)

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of the points of a run without requests."""
        return tuple(name for name, parameter in self.parameters.items() if parameter.is_axis)

    def is_usual(self, dataset: xr.Dataset) -> bool:
        """Whether a result has the study's own dimensions, which its summary and figure present."""
        return is_usual(dataset, self.dims)

    def presented(self, dataset: xr.Dataset) -> xr.Dataset | None:
        """The result as summary and figure take it; None for which they are not made, or if no point is done.

        A result that is not finished gets what the study derives; pending points have no values.
        """
        status = dataset["status"]
        if not (self.is_usual(dataset) and (status == DONE).any()):
            return None
        return self.derive(dataset) if self.derive is not None and (status == PENDING).any() else dataset

    def parameter(self, name: str, structure: Any = None) -> Parameter:
        """A parameter by its name; an `InputError` suggests the nearest, with a structure not of the beams."""
        if name not in self.parameters:
            known = self.known(structure)
            falls = "; friction falls with the speed by kinetic_ratio and decay_speed (studies/README.md)"
            friction = falls if {"mu", "friction"} & {*name.split("_")} else ""
            raise InputError(
                f"{name}: study {self.name} has no such parameter; {suggest(name, known)}"
                f"it has {', '.join(known)}{friction}"
            )
        return self.parameters[name]

    def known(self, structure: Any = None) -> list[str]:
        """Names of the parameters; with a structure without the numbers of the beams and their inclination."""
        return [name for name in self.parameters if structure is None or name not in (*RIG, "theta")]

    def describe(self) -> str:
        """The paper's statement and the parameters, as lines."""
        lines = [f"Paper: {self.paper}"] if self.paper else []
        for name, parameter in self.parameters.items():
            value = parameter.default
            if np.ndim(value):
                words = ", ".join(map(str, value))
                ends = words if len(words) <= 22 else f"{len(value)} words"
                value = ends if value.dtype.kind == "U" else f"{value[0]:g} to {value[-1]:g} ({len(value)})"
            elif value is None:
                value = "auto"
            units = "" if parameter.units == "1" else f", {parameter.units}"
            value = f"{value:g}" if isinstance(value, (int, float)) else value
            lines.append(f"{name:<18} {value:<22} {parameter.text}{units}")
        return "\n".join(lines)

    def sweep(
        self,
        values: Mapping[str, Any],
        *,
        rows: Mapping[str, Any] | None = None,
        record: Sequence[str] = (),
        sample_rate: float | None = None,
        samples: int = SAMPLES,
        seed: int = SEED,
        structure: Mapping[str, Any] | None = None,
    ) -> Sweep:
        """The sweep over the requested points.

        Parameters
        ----------
        values : mapping
            By parameter one value, several, or a distribution with `ppf` and `text` (`studies.uncertainty`).
        rows : mapping of str to array_like, (rows,), optional
            Parameters that vary together, a point in each row.
        record, sample_rate : sequence of str, float
            Series to keep, and their sampling rate, Hz.
        samples, seed : int
            Number of draws, and their seed (`sweeps.Sample`).
        structure : mapping, optional
            `fivcore.Structure.to_dict` of one in place of the rig, whose parameters are left out; theta is 0.

        Raises
        ------
        InputError
            For a parameter or a series that does not exist, or a value out of range.
        """
        if self.normalised and any((structure or {}).get("gap", ())):
            # With initial gaps the motion at another load is no copy.
            plain, own_plain = (
                {name: replace(each, scale="") for name, each in outputs.items()}
                for outputs in (self.outputs, self.by_contact)
            )
            study = replace(self, normalised=False, outputs=plain, by_contact=own_plain)
            how: dict[str, Any] = {"samples": samples, "seed": seed, "structure": structure}
            return study.sweep(values, rows=rows, record=record, sample_rate=sample_rate, **how)
        requested = {name: self._read(name, value) for name, value in values.items()}
        draws = {name: value for name, value in requested.items() if hasattr(value, "ppf")}
        columns = {name: self._column(name, column) for name, column in (rows or {}).items()}
        for name in columns:
            if name in requested:
                raise InputError(f"{name}: it is a column of the points already; give one of the two")
        parameters, fixed = self.parameters, dict[str, Any]()
        if structure is not None:
            own = Structure.from_dict(structure)
            parameters = self._without_beams({**requested, **columns}, own)
            fixed["structure"] = {"name": repr(own), **own.to_dict()}
        # In the study's order, so that the order of a request changes nothing.
        default = {name: parameter.default for name, parameter in parameters.items()}
        chosen = {name: requested.get(name, value) for name, value in default.items() if name not in columns}
        if draws and "distributions" in self.takes:
            fixed["distributions"] = {name: draw.text for name, draw in draws.items()}
            # The nominal rig is in the middle of the uncertain ones.
            chosen |= {name: float(f"{draw.ppf(0.5):.6g}") for name, draw in draws.items()}
            draws = {}
        followed = self._followed(chosen, requested)
        names = [followed] if followed else [name for name in chosen if self.parameters[name].inner]
        inner = {name: self._axis(name, chosen[name]) for name in names}
        axes = {n: self._axis(n, v) for n, v in chosen.items() if np.ndim(v) and n not in inner and n not in draws}
        fixed |= {n: v for n, v in chosen.items() if n not in axes and n not in inner and n not in draws}
        fixed |= {name: axis.values.tolist() for name, axis in inner.items()}
        if not (axes or draws or columns):
            first = next(name for name in fixed if name in self.parameters)
            axes = {first: self._axis(first, fixed.pop(first))}
        grid = self._grid(axes, draws, columns, samples, seed)
        check_size(grid)
        outputs, coords = dict(self.outputs), dict(inner) | self._coords(fixed, grid.axes)
        if structure is not None and own.several and self.by_contact:
            outputs |= self.by_contact
            coords["contact"] = Axis(np.arange(own.contacts), "1", "contact, from 0")
        for name, variable in outputs.items() if followed else ():
            dims = tuple(followed if dim == "followed" else dim for dim in variable.dims)
            outputs[name] = replace(variable, dims=dims)
        for name in (each for each in record if each.startswith("contact_") and "contact" not in coords):
            raise InputError(f"record = {name!r}: it is of a structure with several contacts; leave it out")
        if len(record) or sample_rate is not None:
            kept, elapsed = self._recorded(tuple(record), sample_rate, fixed)
            coords.setdefault("elapsed", elapsed)
            outputs = {**kept, **outputs}
            fixed["record"] = tuple(name for name in kept if name not in self.outputs)
        self._check(grid, fixed, inner)
        common = tuple(n for n in grid.axes if n in self.parameters and self.parameters[n].common)
        shapes = {name: tuple(len(coords[dim]) for dim in each.dims) for name, each in outputs.items()}
        times = coords["elapsed"].values if "elapsed" in coords else None
        call = Call(self.function, common, self.normalised, tuple(self.parameters), shapes, times, followed)
        numbers = {name: fixed[name] for name in (*SCENE, *FRICTION) if name in fixed}
        others = tuple(name for name in grid.axes if name not in (*SCENE, *FRICTION, "sample", "row"))
        unordered, steady = ("V", "mu", "F", *FRICTION), "scenes" not in self.takes
        key = partial(scenes.key, fixed=numbers, others=others, steady=steady)
        # Along theta and mu alone no steady sliding is a copy.
        copies = self.normalised and not (steady and {"V", "F", *FRICTION}.isdisjoint(grid.axes))
        about = {
            name: (fixed[name], parameter.units, parameter.text)
            for name, parameter in self.parameters.items()
            if name in fixed and name not in inner
        }
        return Sweep(
            self.name,
            partial(compute, call),
            grid,
            outputs,
            fixed,
            key=key if copies else None,
            scale=partial(scenes.factors, fixed=numbers) if copies else None,
            coords={name: axis for name, axis in coords.items() if name not in grid.axes},
            title=self.title,
            derive=partial(finish, self.derive, self.dims, about, "scenes" in self.takes),
            # The modes of P1, of a rig and of an inclination are computed once for neighbours.
            order_by=() if draws or columns else tuple(name for name in axes if name not in unordered),
            request={"fixed": about},
        )

    def _followed(self, chosen: dict[str, Any], requested: Mapping[str, Any]) -> str:
        """The parameter that is followed, with a range; sets others whose default is one to the usual value."""
        if not self.follows:
            return ""
        name = chosen[self.follows]
        if np.ndim(name):
            raise InputError(f"{self.follows} = {', '.join(name)}: give one; run the study once for each")
        if len(np.ravel(chosen.get(name, 0.0))) < 2:
            raise InputError(f"{name}: it is followed; give several values of it, as {name}=START:STOP:COUNT")
        for each in (n for n, parameter in self.parameters.items() if parameter.inner and n != name):
            value = np.ravel(requested.get(each, SCENE[each].default))
            if len(value) > 1:
                raise InputError(f"{each}: {name} is followed; give one value of {each}, or {self.follows}={each}")
            chosen[each] = value[0].item()
        return str(name)

    def _read(self, name: str, value: Any) -> Any:
        parameter = self.parameter(name)
        if not hasattr(value, "ppf"):
            return parameter.read(name, value)
        if parameter.choices or parameter.is_whole or parameter.inner:
            raise InputError(f"{name} = {value.text}: it has no distribution; give it values")
        return value

    def _without_beams(self, requested: Mapping[str, Any], own: Structure) -> dict[str, Parameter]:
        """The parameters with a structure of one's own: theta is 0, and a rig has no numbers.

        A default range of mu lies around its first onset as the study's does around that of the paper's rig.
        """
        if self.beams or not self.takes & {"rig", "scenes"}:
            taking = "fig5, stability, regimes, scenes, stick_time, contact and most maps"
            raise InputError(
                f"rig: study {self.name} needs the paper's beams, which a structure has not; {taking} take it"
            )
        for name, value in requested.items():
            text = f"{name} = {getattr(value, 'text', None) or checks.short(value)}"
            if name in RIG:
                raise InputError(f"{text}: a structure has no such number; leave it out, or change its file")
            if name == "theta" and (hasattr(value, "ppf") or np.any(value)):
                raise InputError(f"{text}: the modes of a structure have their inclination already; leave it out")
        left = {name: parameter for name, parameter in self.parameters.items() if name not in RIG}
        if theta := left.get("theta"):
            left["theta"] = replace(theta, default=np.zeros(1) if theta.is_axis else 0.0)
        mu = left.get("mu")
        if mu and np.ndim(mu.default) and "mu" not in requested:
            left["mu"] = replace(mu, default=mu.default * _scale_of_friction(own, float(np.max(mu.default))))
        if cutoff := left.get("cutoff"):
            left["cutoff"] = replace(cutoff, default=None)  # another default is for the paper's beams
        return left

    def _column(self, name: str, values: Any) -> NDArray[Any]:
        """The values of a column, in their order."""
        parameter = self.parameter(name)
        if parameter.inner:
            raise InputError(f"points: {name}: study {self.name} takes its values together; give a range of it")
        column = [parameter.read(name, value) for value in np.asarray(values).tolist()]
        return np.array([np.ravel(value)[0] for value in column])

    def _axis(self, name: str, values: Any) -> Axis:
        return Axis(values, self.parameters[name].units, self.parameters[name].text)

    def _grid(
        self,
        axes: Mapping[str, Axis],
        draws: Mapping[str, Any],
        columns: Mapping[str, NDArray[Any]],
        samples: int,
        seed: int,
    ) -> Grid:
        if draws and columns:
            raise InputError("points: distributions and a table both say where the points are; leave one out")
        if draws:
            units = {name: (self.parameters[name].units, self.parameters[name].text) for name in draws}
            return Sample(draws, samples, seed=seed, units=units, axes=axes)
        if columns:
            number = Axis(np.arange(1, len(next(iter(columns.values()))) + 1), long_name="row of the table")
            table = {"row": number} | {name: self._axis(name, values) for name, values in columns.items()}
            return Grid({**table, **axes}, zipped=tuple(table), sampling={"method": "a table"})
        return Grid(axes)

    def _coords(self, fixed: dict[str, Any], axes: Mapping[str, Axis]) -> dict[str, Axis]:
        if not callable(self.coords):
            return dict(self.coords)
        names = [name for name in inspect.signature(self.coords).parameters if name != "rig"]
        for name in names:
            if name not in fixed:
                raise InputError(
                    f"{name}: it decides the size of the results of study {self.name}; give one value"
                )
        given, found, problems = {name: fixed[name] for name in names}, dict[str, Axis](), [""]
        for numbers in self._extremes(axes):
            try:
                rig = {"rig": scenes.rig_of(fixed | numbers)} if numbers is not None else {}
                each = self.coords(**given, **rig)
            except ValueError as problem:
                problems.append(str(problem))
                continue
            found = {name: max(found.get(name, axis), axis, key=len) for name, axis in each.items()}
        if not found:
            raise InputError(problems[-1])
        return found

    def _extremes(self, axes: Mapping[str, Axis]) -> list[dict[str, Any] | None]:
        """Numbers of the rigs by which a size is decided: the ends of each that varies; None if by no rig."""
        assert callable(self.coords)
        if "rig" not in inspect.signature(self.coords).parameters:
            return [None]
        varied = [(name, axes[name].values) for name in RIG if name in axes]
        return [{}, *({name: end(values).item()} for name, values in varied for end in (np.min, np.max))]

    def _recorded(
        self, names: tuple[str, ...], sample_rate: float | None, fixed: dict[str, Any]
    ) -> tuple[dict[str, Variable], Axis]:
        """Variables of requested series and their times; sets `sample_rate` and `duration` in `fixed`."""
        if "record" not in self.takes:
            raise InputError(
                f"record = {', '.join(names)}: study {self.name} records no series; study scenes does"
            )
        if not names:
            raise InputError(f"sample_rate = {sample_rate!r}: it is for recorded series; give record")
        for name in (name for name in names if name not in series.SERIES):
            near = suggest(name, series.SERIES)
            raise InputError(f"record = {name!r}: no such series; {near}the series are {', '.join(series.SERIES)}")
        for name in ("duration", "sample_rate"):
            if name in self.parameters and name not in fixed:
                raise InputError(f"{name}: recorded series need one value of it")
        if sample_rate is not None and fixed.get("sample_rate", sample_rate) != sample_rate:
            text = f"it is set to {fixed['sample_rate']:g}; give one of the two"
            raise InputError(f"sample_rate = {sample_rate!r}: {text}")
        rate = fixed.get("sample_rate", series.SAMPLE_RATE if sample_rate is None else sample_rate)
        fixed |= {"duration": fixed.get("duration") or series.DURATION, "sample_rate": float(rate)}
        try:
            times = series.even_times(fixed["duration"], rate)
        except ValueError as problem:
            raise InputError(str(problem)) from None
        kept = {
            name: series.SERIES[name] for name in series.SERIES if name in names
        }  # their order changes nothing
        if self.normalised:
            kept = {name: replace(each, scale=series.FACTORS.get(name, "")) for name, each in kept.items()}
        return kept, times

    def _check(self, grid: Grid, fixed: Mapping[str, Any], inner: Mapping[str, Axis]) -> None:
        """Build the rig or the scene at the values of each dimension, the others at their first ones."""
        if "structure" in fixed:
            fixed = {**fixed, "structure": scenes.rig_of(fixed)}
        problems: list[Exception] = []
        for row, (place, numbers) in enumerate(_rows(grid)):
            try:
                for each in _steps({**fixed, **numbers}, next(iter(inner), "") if self.follows else ""):
                    _build(each, self.takes | ({"scenes"} if self.normalised else set()))
            except ValueError as problem:
                if grid.dims[0] != "sample":
                    raise InputError(f"{place}{problem}") from None
                problems.append(problem)
                if len(problems) == row + 1 == min(DRAWS_CHECKED, grid.shape[0]):
                    raise InputError(str(problem)) from None
        if self.check is not None:
            values = {**fixed, **{name: axis.values for name, axis in {**grid.axes, **inner}.items()}}
            if "rig" in inspect.signature(self.check).parameters:
                numbers = {name: np.ravel(value)[0].item() for name, value in values.items() if name in RIG}
                values["rig"] = scenes.rig_of({"structure": values.get("structure"), **numbers})
            try:
                self.check(**_chosen(inspect.signature(self.check).parameters, values))
            except ValueError as problem:
                raise InputError(str(problem)) from problem


def _scale_of_friction(own: Structure, most: float) -> float:
    """The first onset of a structure, of flutter or divergence, over that of the paper's rig; 1 without one.

    Times `most` it stays below the friction at which the contact force is no longer unique.
    """
    papers, limit = flutter_onsets(Rig(), paper.THETA).mu[0], np.inf
    try:
        # With initial gaps the load decides which contacts are closed.
        found = flutter_onsets(own, 0.0, mu_max=MOST_FRICTION, F=paper.LOAD)
        limit = painleve_mu(own, 0.0)
    except (ArithmeticError, SceneError):
        return 1.0
    first = min([*found.mu, *found.entry_mu, np.nan_to_num(found.divergence_mu, nan=np.inf)])
    ratio = min(first / papers if np.isfinite(first) else 1.0, 0.9 * limit / most)
    return float(f"{ratio:.3g}")


def _chosen(signature: Mapping[str, inspect.Parameter], values: Mapping[str, Any]) -> dict[str, Any]:
    """The values that a signature names; all with ``**others``."""
    takes_rest = any(parameter.kind is inspect.Parameter.VAR_KEYWORD for parameter in signature.values())
    return {name: value for name, value in values.items() if takes_rest or name in signature}


def _rows(grid: Grid) -> Iterator[tuple[str, dict[str, Any]]]:
    """Parameters at each value of each dimension, the others at their first; rows of a table with their number."""
    first = {name: axis.values[0].item() for name, axis in grid.axes.items()}
    for group in grid.groups:
        for k in range(min(len(grid.axes[group[0]]), CHECKED)):
            place = f"points: row {k + 1}: " if group[0] == "row" else ""
            yield place, {**first, **{name: grid.axes[name].values[k].item() for name in group}}


def _steps(numbers: Mapping[str, Any], followed: str) -> list[dict[str, Any]]:
    """The numbers at each value of the parameter that is followed."""
    return [{**numbers, followed: value} for value in numbers[followed]] if followed else [{**numbers}]


def _build(numbers: Mapping[str, Any], takes: set[str]) -> None:
    if "scenes" in takes:
        scenes.scene_of(numbers)
    elif "rig" in takes:
        scenes.rig_of(numbers)
    if "theta" in numbers and np.ndim(numbers["theta"]) == 0:
        checks.theta_degrees(numbers["theta"])
    if "mu" in numbers and np.ndim(numbers["mu"]) == 0:
        checks.friction(numbers["mu"])


@dataclass(frozen=True, eq=False)
class Call:
    """How a study's function is called with a batch of points."""

    function: Callable[..., Mapping[str, Any]]
    common: tuple[str, ...]  # parameters that vary and that all points of one call share
    normalised: bool
    parameters: tuple[str, ...]
    shapes: Mapping[str, tuple[int, ...]]  # of each output at a point
    times: NDArray[Any] | None  # of recorded series, s
    followed: str = ""

    def arguments(self, numbers: Mapping[str, Any], count: int) -> dict[str, Any]:
        """Arguments of the function for `count` points."""
        signature = inspect.signature(self.function).parameters
        if self.normalised:
            scaled = scenes.normalised(numbers, count, steady="scenes" not in signature)
            numbers = {**numbers, **{name: column for name, column in scaled.items() if name in numbers}}
        own: dict[str, Any] = {"record": (), "distributions": {}, **numbers, "times": self.times}
        if "rig" in signature:
            own["rig"] = scenes.rig_of(numbers)
        if "scenes" in signature:
            steps = [scenes.scenes_of(each, count) for each in _steps(numbers, self.followed)]
            own["scenes"] = list(zip(*steps, strict=True)) if self.followed else steps[0]
        # What a rig and scenes consist of goes to those who name it.
        parts = {*RIG, *(SCENE | FRICTION if "scenes" in signature else ())}
        rest = {name: value for name, value in numbers.items() if name in self.parameters and name not in parts}
        return {name: value for name, value in own.items() if name in signature} | _chosen(signature, rest)


def compute(call: Call, points: Mapping[str, Any], **fixed: Any) -> dict[str, Any]:
    """Call a study's function for each group of points that share the common parameters, and join the results."""
    count = len(next(iter(points.values())))
    groups = _groups({name: points[name] for name in call.common}, count)
    joined: dict[str, Any] = {"error": np.full(count, None)}
    done = False
    for common, chosen in groups:
        numbers = {**fixed, **{name: values[chosen] for name, values in points.items()}, **common}
        size = len(next(iter(points.values()))[chosen])
        try:
            given = call.arguments(numbers, size)
            found = dict(call.function(**given))
            if call.normalised and "error" in found:
                found["error"] = [_without_scene(each) for each in found["error"]]
            # Without an argument that varies all points have one result, as those of a table that repeat.
            repeats = given.keys().isdisjoint({"scenes", *(points.keys() - {*call.common})})
            found = {k: _padded(k, v, size, call.shapes.get(k), repeats) for k, v in found.items()}
        except BatchError as problem:
            # Every point fails: the engine would hide the mistake, since batches of a single point succeed.
            found = {"error": [problem] * size}
        except (ValueError, ArithmeticError, SceneError) as problem:
            own = _without_scene(problem) if call.normalised else problem
            if len(groups) == 1:
                raise own from None
            joined["error"][chosen] = own
            continue
        if len(groups) == 1:
            return found
        done = True
        for name, value in found.items():
            part = np.asarray(value)
            joined.setdefault(name, np.zeros((count, *part.shape[1:]), part.dtype))[chosen] = part
    if not done:
        raise joined["error"][0]
    return joined | {"error": joined["error"].tolist()}


def _without_scene(problem: Any) -> Any:
    """The error of a scaled scene without that scene: the point that fails has the numbers that were asked."""
    text = str(problem).rpartition("; scene V = ")[0]
    return type(problem)(text, problem.scene) if isinstance(problem, SceneError) and text else problem


def _groups(common: Mapping[str, NDArray[Any]], count: int) -> list[tuple[dict[str, Any], Any]]:
    """The common parameters of each group of points, in order of appearance, and its points."""
    if not common:
        return [({}, slice(None))]
    places: dict[tuple[Any, ...], list[int]] = {}
    for k, row in enumerate(zip(*(values.tolist() for values in common.values()), strict=True)):
        places.setdefault(row, []).append(k)
    return [(dict(zip(common, row, strict=True)), np.array(chosen)) for row, chosen in places.items()]


class BatchError(ValueError):
    """A study's function returned one value for several points."""


def _padded(name: str, value: Any, count: int, shape: tuple[int, ...] | None, repeats: bool) -> Any:
    """An output of the declared shape, filled with NaN where the function returned fewer entries."""
    if shape is None:
        return value
    values = np.asarray(value)
    if not values.ndim:
        return values.reshape(1) if count == 1 else values  # the engine then asks for one point at a time
    if len(values) == 1 < count:
        if not repeats:
            raise BatchError(f"1 value for {count} points; return an array with one entry for each point")
        values = np.repeat(values, count, axis=0)
    missing = [(0, 0), *((0, full - size) for full, size in zip(shape, values.shape[1:], strict=True))]
    if not any(more for _, more in missing):
        return values
    if min(more for _, more in missing) < 0:
        raise InputError(f"{name}: {values.shape[1:]} values at a point, for which the file has room for {shape}")
    return np.pad(values.astype(float), missing, constant_values=np.nan)


def finish(
    derive: Callable[[xr.Dataset], xr.Dataset] | None,
    dims: tuple[str, ...],
    about: Mapping[str, tuple[Any, str, str]],
    moves: bool,
    dataset: xr.Dataset,
) -> xr.Dataset:
    """Add the fixed parameters as scalar coordinates, and what the study derives from its usual dimensions.

    A study in which scenes move gets what grows above the band, too.
    """
    dataset = settled(dataset, about)
    dataset = with_growth_above(dataset, structure_in(dataset) or None) if moves else dataset
    return derive(dataset) if derive is not None and is_usual(dataset, dims) else dataset
