"""Beams, the rig that they form, and its operating point (Tables 1 to 3 of the paper).

Meziane, Baillet, Laulagnet, Applied Acoustics 71 (2010) 843-853, called "the paper" throughout.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import Any

from fivcore import checks
from fivcore.errors import InputError
from fivcore.friction import COULOMB, FRICTION_PARAMETERS, Friction

# Units and meaning of the parameters of a rig, and of those of each beam.
RIG_PARAMETERS = {
    "contact_position": ("m", "distance of the contact from P2's clamp"),
    "head_mass": ("kg", "mass at A"),
    "d1": ("s-1", "Rayleigh damping on the mass"),
    "d2": ("s", "Rayleigh damping on the stiffness"),
    "point_b": ("1", "where the velocity of P1 is read, as a share of its length from C"),
}
BEAM_PARAMETERS = {
    "length": ("m", "length"),
    "width": ("m", "width"),
    "thickness": ("m", "thickness"),
    "young_modulus": ("Pa", "Young's modulus"),
    "density": ("kg m-3", "density"),
    "elements": ("1", "number of elements"),
}


def _set(frozen: Any, **values: Any) -> None:
    for name, value in values.items():
        object.__setattr__(frozen, name, value)


@dataclass(frozen=True)
class Beam:
    """A uniform straight Euler-Bernoulli beam and its mesh.

    Parameters
    ----------
    length, width, thickness : float
        In m; the beam bends about the axis along its width.
    young_modulus : float
        In Pa.
    density : float
        In kg/m3.
    elements : int
        Elements of equal length, three degrees of freedom a node.

    Raises
    ------
    ValueError
        Names the argument, its value and the allowed values.
    """

    length: float
    width: float
    thickness: float
    young_modulus: float
    density: float
    elements: int

    def __post_init__(self) -> None:
        ranges = dict.fromkeys(("length", "width", "thickness"), (1e-9, 1e6, "m"))
        ranges |= {"young_modulus": (1e-3, 1e25, "Pa"), "density": (1e-6, 1e9, "kg/m3")}
        for name, limits in ranges.items():
            _set(self, **{name: checks.between(f"Beam: {name}", getattr(self, name), *limits)})
        _set(self, elements=checks.count("Beam: elements", self.elements, 1000))

    @property
    def mass(self) -> float:
        """Mass of the beam, kg."""
        return self.density * self.length * self.width * self.thickness

    @property
    def axial_stiffness(self) -> float:
        """E A, in N."""
        return self.young_modulus * self.width * self.thickness

    @property
    def bending_stiffness(self) -> float:
        """E I, in N m2."""
        return self.young_modulus * self.width * self.thickness**3 / 12.0


# Table 3 of the paper.
P1 = Beam(0.05, 0.010, 0.0015, 185e9, 7900.0, 30)
P2 = Beam(0.15, 0.015, 0.0030, 185e9, 7900.0, 90)
PAPER = {"p1": P1, "p2": P2}


# Euler-Bernoulli frequency of bending waves 7.9 thicknesses long, in units of sqrt(E / density) / thickness.
VALID = 0.0291


class ContactModel:
    """Base class of `Rig` and `fivcore.Structure`: a function that takes one takes the other."""

    # Normal force at rest for a unit load, and the factor of default times of a run.
    preload: Any = 1.0
    time_scale: Any = 1.0
    # Number of contacts; whether there are several, or one with a gap or a factor of mu.
    contacts: Any = 1
    several: Any = False
    d1: float
    d2: float
    _repr_html_: Any

    def mirrored(self) -> Any:
        """Return the mirror image with respect to y; a rig is unchanged, because theta changes its sign."""
        return self


def one_contact(rig: ContactModel, what: str) -> None:
    """Raise an error for a structure with several contacts; `what` says which feature needs one contact."""
    if rig.several:
        places = f"in {rig.contacts} places" if rig.contacts > 1 else "with a gap or a factor of mu"
        raise InputError(f"structure: it touches {places}; {what}")


def checked_theta(name: str, rig: Any, theta: Any) -> float:
    """Check a rig with its inclination, degrees, or a structure with theta = 0; return theta."""
    if not isinstance(rig, ContactModel):
        raise InputError(f"{name} = {checks.short(rig)}: it must be a Rig or a Structure")
    degrees = checks.theta_degrees(theta)
    if degrees != 0.0 and not isinstance(rig, Rig):
        raise InputError(f"theta = {degrees:g}: the modes of a Structure have its inclination already; give 0")
    return degrees


@dataclass(frozen=True)
class Rig(ContactModel):
    """Two beams in point contact: the tip C of P1 rests on P2, and the support A of P1 above it is free along y.

    A bad value is a `ValueError`, naming it and the allowed values.

    Parameters
    ----------
    p1, p2 : Beam
        The upper (inclined) and the lower (horizontal, driven) beam; default: Table 3 of the paper.
    contact_position : float
        Distance of the contact point D from P2's clamp, m; default: 80 mm (section 3.2 of the paper).
    head_mass : float
        Concentrated mass M_A at A, kg. With the default the first tied mode has 16 Hz with the contact at 85 mm,
        the only position that reproduces Table 4 of the paper; `tune_head_mass` computes it.
    d1, d2 : float
        Rayleigh damping C = d1 M + d2 K, in 1/s and s (Table 3).
    point_b : float
        Observation point B of the velocity of P1, as a fraction of its length from C. The paper does not give it;
        the default is mid-length.
    """

    p1: Beam = P1
    p2: Beam = P2
    contact_position: float = 0.080
    head_mass: float = 2.9434
    d1: float = 50.0
    d2: float = 1e-8
    point_b: float = 0.5

    def __post_init__(self) -> None:
        for name in ("p1", "p2"):
            checks.instance(f"Rig: {name}", getattr(self, name), Beam)
        most, on_p2 = self.p2.length, f"above 0 and at most P2's length, {self.p2.length:g} m"
        position, on_p1 = self.contact_position, "a fraction of P1's length, from 0 at C to 1 at A"
        _set(
            self,
            contact_position=checks.number("Rig: contact_position", position, on_p2, lambda x: 0.0 < x <= most),
            head_mass=checks.between("Rig: head_mass", self.head_mass, 0.0, 1e15, "kg"),
            d1=checks.between("Rig: d1", self.d1, 0.0, 1e12, "1/s"),
            d2=checks.between("Rig: d2", self.d2, 0.0, 1e6, "s"),
            point_b=checks.number("Rig: point_b", self.point_b, on_p1, lambda x: 0.0 <= x <= 1.0),
        )

    @property
    def valid_up_to(self) -> float:
        """Frequency up to which the beam model holds, Hz: 47 kHz for the paper's rig.

        At this frequency bending waves of P1 or P2 are 7.9 thicknesses long, and their speed in Euler-Bernoulli
        theory is 10 % higher than in Timoshenko's (K. F. Graff, Wave Motion in Elastic Solids, 1975; shear
        coefficient 5/6, Poisson ratio 0.3). Modes above it take part in the contact, but growth there may be an
        artefact of the model.
        """
        speeds = [(beam, (beam.young_modulus / beam.density) ** 0.5) for beam in (self.p1, self.p2)]
        return min(VALID * speed / beam.thickness for beam, speed in speeds)

    @classmethod
    def of(cls, **numbers: Any) -> Rig:
        """Return the paper's rig with some parameters changed.

        Parameters
        ----------
        **numbers : float, Beam or mapping
            Names of fields, with p1_ or p2_ before those of a beam (p1_length); or p1 and p2, each a `Beam` or a
            mapping of some of its fields.

        Returns
        -------
        Rig

        Raises
        ------
        ValueError
            For an unknown name or a value out of range.
        """
        beams: dict[str, Any] = dict(PAPER)
        own: dict[str, Any] = {}
        # Whole beams come before their parameters.
        for name in sorted(numbers, key=len):
            value, (beam, _, field) = numbers[name], name.partition("_")
            if name in RIG_PARAMETERS:
                own[name] = value
            elif name in PAPER:
                beams[name] = value if isinstance(value, Beam) else _changed(name, beams[name], value)
            elif beam in PAPER and field in BEAM_PARAMETERS:
                beams[beam] = _changed(beam, beams[beam], {field: value})
            else:
                names = [*RIG_PARAMETERS, *(f"{p}_{each}" for p in PAPER for each in BEAM_PARAMETERS), *PAPER]
                near = difflib.get_close_matches(name, names, 1)
                hint = f"did you mean {near[0]}? " if near else ""
                raise InputError(f"{name}: a rig has no such number; {hint}it has {', '.join(names)}")
        try:
            return cls(**beams, **own)
        except InputError as problem:
            raise InputError(str(problem).replace("Rig: ", "", 1)) from None

    def _repr_html_(self) -> str:
        beams = (
            (name, *(f"{getattr(beam, name):g}" for beam in (self.p1, self.p2)), unit)
            for name, (unit, _) in BEAM_PARAMETERS.items()
        )
        own = ((name, f"{getattr(self, name):g}", "", unit) for name, (unit, _) in RIG_PARAMETERS.items())
        return html_table("Rig", ("", "p1", "p2", "unit"), (*beams, *own))


def _changed(name: str, beam: Beam, changes: Any) -> Beam:
    """A beam with changed parameters; error messages name them as parameters of the rig."""
    if not isinstance(changes, Mapping) or not set(changes) <= set(BEAM_PARAMETERS):
        raise InputError(
            f"{name} = {checks.short(changes)}: it must be a Beam, or some of {', '.join(BEAM_PARAMETERS)}"
        )
    try:
        return replace(beam, **changes)
    except InputError as problem:
        raise InputError(str(problem).replace("Beam: ", f"{name}_", 1)) from None


def html_table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table for a notebook."""
    lines = ["".join(f"<th>{escape(cell)}</th>" for cell in heads)]
    lines += ["".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows]
    return f"<table><caption>{escape(title)}</caption><tr>{'</tr><tr>'.join(lines)}</tr></table>"


@dataclass(frozen=True)
class Scene:
    """One operating point of a rig; a bad value is a `ValueError`, naming it and the allowed values.

    Parameters
    ----------
    V : float
        Velocity of P2's clamp along x, m/s, not zero.
    theta : float
        Inclination of P1, degrees: from C up to A it runs along (sin theta, cos theta). With V > 0, a
        positive theta is the digging sense (Spurr's sprag).
    mu : float
        Coefficient of friction.
    F : float
        Load on A along -y, N.
    rig : Rig or Structure
        With a `fivcore.Structure`, whose modes include its inclination, theta is 0; V is along the tangential gap,
        and F scales its load.
    friction : Friction
        Dependence of friction on the sliding speed; mu is the static coefficient. Default: constant.
    """

    V: float
    theta: float
    mu: float
    F: float
    rig: Any = Rig()
    friction: Friction = COULOMB

    def __post_init__(self) -> None:
        allowed = "a speed of 1e-100 to 1e+100 m/s, of either sign"
        _set(
            self,
            V=checks.number("V", self.V, allowed, lambda x: 1e-100 <= abs(x) <= 1e100),
            theta=checked_theta("Scene: rig", self.rig, self.theta),
            mu=checks.friction(self.mu),
            F=checks.between("F", self.F, 1e-100, 1e100, "N"),
        )
        checks.instance("Scene: friction", self.friction, Friction)

    def _repr_html_(self) -> str:
        units = {"V": "m s-1", "theta": "degree", "mu": "1", "F": "N"}
        rows = [(name, f"{getattr(self, name):g}", unit) for name, unit in units.items()]
        if self.friction.kinetic_ratio != 1.0:
            law = self.friction
            rows += [(name, f"{getattr(law, name):g}", unit) for name, (unit, _) in FRICTION_PARAMETERS.items()]
            rows.append(("decay", law.decay, ""))
        return html_table("Scene", ("", "value", "unit"), rows) + self.rig._repr_html_()

    def mirrored(self) -> Scene:
        """Return the same motion seen in a mirror along y: -V, -theta, and of a structure its mirror image."""
        return replace(self, V=-self.V, theta=-self.theta, rig=self.rig.mirrored())

    @property
    def drive_theta(self) -> float:
        """Inclination seen from the drive, sign(V) theta, degrees; stability depends on V only through it."""
        return self.theta if self.V > 0 else -self.theta
