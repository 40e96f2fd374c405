"""A study: parameters, a function of them that answers a question, and the presentation of the answer."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.declaring.parameters import FRICTION, KNOWN, RIG, SCENE, Parameter, suggest
from sweeps import Axis, InputError, Variable

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


__all__ = ["Claim", "Parameter", "Study"]

# The parameter that names the one which chains of scenes follow.
FOLLOW = "follow"


@dataclass(frozen=True)
class Claim:
    """A number or a word printed in the paper, and the value of a result to compare with it.

    Attributes
    ----------
    variable : str
        Of the result.
    at : mapping
        Values of parameters, or numbers from 1 along a dimension that has no values; a pair means all values of
        an axis between its ends, both excluded. Without theta, mu or F: those of the paper's operating point.
    value : float or str
        In the variable's units, NaN if the paper has no number; the word of a variable with flags.
    section : str
        Of the paper: section, figure or table.
    cells : bool
        A value of an axis represents its surroundings: the nearest one within the axis's range answers.
    """

    variable: str
    at: Mapping[str, float | str | tuple[float, float]]
    value: float | str
    section: str
    cells: bool = False


@dataclass(frozen=True, eq=False)
class Study:
    """A question, its parameters, and the function that answers it at each point.

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
        `chains`, for each point a tuple of scenes, one for each value of the parameter that `follow` names, whose
        range is the dimension "followed" of the outputs and goes by its own name in a result; `distributions`,
        the requested ones as text; `record`, series to keep, with their `times`; or parameters, each a scalar if
        it is fixed or common to the batch, otherwise an array, one entry a point; ``**others`` takes the rest.
        Returns an array for each output, points first; a shorter one is padded with NaN.
    paper : str
        What the paper says, with the section.
    derive : callable, optional
        `derive(dataset)` returns the dataset with what follows from the whole of it.
    summary : callable, optional
        `summary(dataset)` yields sentences, and pairs of a caption and a pandas DataFrame; the finding first.
    figure : callable, optional
        `figure(dataset)` returns a Matplotlib figure.
    animate : callable, optional
        `animate(dataset)` yields what moves (`studies.plotting.moving.Moving`), for the page, films and ParaView.
    claims : sequence of Claim
        What the paper prints, to stand beside the result.
    coords : mapping of str to Axis, or callable
        Axes of the outputs' own dimensions; a callable takes parameters by name, or `rig`; of
        several rigs the longest axes count.
    check : callable, optional
        Takes parameters by name, one value or an array, or `rig`, the first; raises `ValueError` for what cannot
        be computed.
    normalised : bool
        Compute the scaled scene with V > 0 and F = 1 once for all points that are equivalent to it;
        `Variable.scale` "load" or "along" names the factor of a point. A function that takes no scenes is of
        steady sliding: with friction that does not fall it depends neither on V nor on F.
    chaotic : bool
        The motion is chaotic: another processor changes digits, and only statistics can be compared.
    beams : bool
        It is about the paper's two beams: structures of one's own are refused.
    for_structure : callable, optional
        Takes a `fivcore.Structure`; returns parameters that depend on it.
    own : tuple of str
        With a structure: those of its numbers that are parameters (`studies.asking.own`).
    by_contact : mapping
        Outputs on the dimension `contact`, which a structure with several contacts has besides.
    roles : tuple of str
        What central code takes it for, which knows no study by its name: "first", to begin with; "modes", the
        branches of two rigs side by side; "motions", whose regimes of two rigs are compared; "states", what a fit
        asks for regimes; "measured", to draw a measured signal in.
    like : str
        The study whose points cost as much as the realisations of this one: it estimates the time of a run.
    thresholds : mapping of str to float
        Values at which outputs pass from one class to another: maps draw them, and are refined there.
    scatter : callable, optional
        Takes the numbers that have one value; returns the distributions of a run that requests none.
    functions : mapping of str to callable
        Outputs that have a function of their own, called like `function`, which returns that output: where stored
        results lack it, it alone is computed for them.
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
    animate: Callable[[xr.Dataset], Iterator[Any]] | None = field(default=None, kw_only=True)
    claims: Sequence[Claim] = field(default=(), kw_only=True)
    coords: Mapping[str, Axis] | Callable[..., Mapping[str, Axis]] = field(default_factory=dict, kw_only=True)
    check: Callable[..., None] | None = field(default=None, kw_only=True)
    normalised: bool = field(default=False, kw_only=True)
    chaotic: bool = field(default=False, kw_only=True)
    beams: bool = field(default=False, kw_only=True)
    for_structure: Callable[[Any], Mapping[str, Parameter]] | None = field(default=None, kw_only=True)
    own: tuple[str, ...] = field(default=(), kw_only=True)
    by_contact: Mapping[str, Variable] = field(default_factory=dict, kw_only=True)
    roles: tuple[str, ...] = field(default=(), kw_only=True)
    like: str = field(default="", kw_only=True)
    thresholds: Mapping[str, float] = field(default_factory=dict, kw_only=True)
    scatter: Callable[[Mapping[str, Any]], Mapping[str, Any]] | None = field(default=None, kw_only=True)
    functions: Mapping[str, Callable[..., Mapping[str, Any]]] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        added = SCENE | FRICTION | RIG if self.moves else dict[str, Parameter]()
        if "rig" in self.takes:
            added |= {name: SCENE[name] for name in SCENE if name in self.takes} | RIG
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
    def moves(self) -> bool:
        """Whether its function takes scenes."""
        return not self.takes.isdisjoint({"scenes", "chains"})

    @property
    def takes_structure(self) -> bool:
        """Whether a user's structure can take the place of the beams."""
        return not self.beams and (self.moves or "rig" in self.takes)

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of the points of a run without requests."""
        return tuple(name for name, parameter in self.parameters.items() if parameter.is_axis)

    def parameter(self, name: str, structure: Any = None) -> Parameter:
        """A parameter by its name; an `InputError` suggests the nearest, with a structure not of the beams."""
        if name not in self.parameters:
            known = self.known(structure)
            falls = "; friction falls with the speed by kinetic_ratio and decay_speed (studies/README.md)"
            friction = falls if {"mu", "friction"} & {*name.split("_")} else ""
            what = f"has no such parameter; {suggest(name, known)}"
            if name in KNOWN and name not in self.parameters:
                what = f"does not depend on the {KNOWN[name].text.partition(':')[0]}; leave it out; "
            raise InputError(
                f"{name}: study {self.name} {what}it has {', '.join(self.listed(structure))}{friction}"
            )
        return self.parameters[name]

    def known(self, structure: Any = None) -> list[str]:
        """Names of the parameters; for a structure without the numbers of the beams and their inclination."""
        beams = {*RIG, "theta"}.difference(self.own) if structure is not None else ()
        return [name for name in self.parameters if name not in beams]

    def listed(self, structure: Any = None) -> list[str]:
        """Names for a message; of the numbers of a structure's modes only those of the first mode."""
        of_others = re.compile(r"_(?!1$)\d+$")
        return [name for name in self.known(structure) if name not in self.own or not of_others.search(name)]

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
