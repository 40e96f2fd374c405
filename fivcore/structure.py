"""Structure in modal form for stability and motion: the beams of a rig, or a user's matrices or modes.

With mass-normalised modal coordinates q, normal and tangential gaps g_N = n q and g_T = t q - X (X: displacement
of the drive), contact forces N and T and the load F,

    q'' + c q' + p q = n N + t T + l F + m X''.

The modes of a finite-element model that are not computed act by their static compliance, which two additional
modes far above all others represent (`static_modes`). Stability needs the modes of its band. Motion needs those
that take part in impacts: of a structure from matrices, `MOTION_MODES` modes that move the gaps.

A structure may have c contacts. Then n and t have c rows, and each contact has an initial gap and a factor of mu.
Which contacts the load closes is a result (`equilibrium`).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any, cast

import numpy as np

from fivcore import checks
from fivcore.beams.elements import axial
from fivcore.beams.modes import contact_modes, one_blas_thread, rig_bases
from fivcore.damping import BAND_SHARE, fitted, tied_modes, tied_ratios
from fivcore.errors import DampingWarning, InputError
from fivcore.finite_elements import DENSE_SIZE, checked_matrix, free_rows, lowest_modes
from fivcore.jit import Array, ReadOnlyArrays
from fivcore.modal.building import NO_PRELOAD, for_motion, of_loaded_bodies, structure_of, with_matrix
from fivcore.modal.cutoffs import MOST_MODES, motion_cutoffs
from fivcore.modal.rows import (
    checked_positions,
    contact_rows,
    extended,
    finite,
    kept_nodes,
    over_dofs,
    ratios_of,
    row_of,
)
from fivcore.rig import ContactModel, Rig, html_table
from fivcore.statics import resting
from fivcore.structure_files import structure_arguments

# Frequency, Hz, at which default times and bands equal those of the beams.
MIDDLE = 5e3
# Normal force at rest, relative to the sum of its terms, that counts as rounding. For a pin on soft springs that
# is loaded at its far end rounding is 1e-9 to 1e-7 with 4 to 80 elements, and 3e-5 on processors without long
# double.
PRESSED = 1e-4
ROWS = ("stiffness", "damping", "normal", "tangential", "inertia", "output", "load", "struck")


@dataclass(frozen=True, eq=False, repr=False)
class Structure(ContactModel, ReadOnlyArrays):
    """Modes of a structure with their coupling to contact, load and drive; arrays are read-only, SI units.

    Constructed by `from_matrices`, `from_modes`, `read` or `of`. Equal structures have the same `digest`.

    Attributes
    ----------
    stiffness, damping : ndarray, (n,)
        Squared angular frequencies, rad2/s2, 0 for a rigid motion; damping, 1/s.
    normal, tangential : ndarray, (n,), or (c, n) with several contacts
        Gap shapes: change of the normal and tangential gaps for a unit of each modal coordinate, kg^-1/2.
    inertia, output, load : ndarray, (n,)
        Modal force for a unit acceleration of the drive; shape of the observed displacement; modal unit load.
    struck : ndarray, (n,)
        `normal` restricted to the bodies that the load acts on, which a knock sets in motion.
    rayleigh : (float, float) or None
        d1, 1/s, and d2, s, if damping = d1 + d2 * stiffness; None: modal damping.
    static : int
        Number of modes, the last ones, that represent the static compliance of the modes that are not computed.
    remarks : tuple of str
        What was neglected.
    cutoff : float or None
        Default cut-off of motion, Hz; None: all modes are kept.
    wider : Structure or None
        The structure for motion, if that needs more modes than stability.
    gap, friction : ndarray, (c,), or None
        Initial gaps, m, and factors of mu of several contacts; None with one contact.
    nodes, numbers, shapes, edges : ndarray, (k, 3), (k,), (k, 3, m), (e, 2), or None
        Stored on request: positions of nodes, m, node numbers, displacement in each computed mode, kg^-1/2, and
        index pairs of nodes that the stiffness connects (none for a full matrix). They do not enter `digest`,
        because stability and motion depend on the contact alone.
    """

    stiffness: Array
    damping: Array
    normal: Array
    tangential: Array
    inertia: Array
    output: Array
    load: Array
    struck: Array
    rayleigh: tuple[float, float] | None
    static: int = 0
    remarks: tuple[str, ...] = ()
    cutoff: float | None = None
    wider: Structure | None = None
    gap: Any = None
    friction: Any = None
    nodes: Any = None
    numbers: Any = None
    shapes: Any = None
    edges: Any = None

    @classmethod
    def of(cls, rig: Rig, theta: float) -> Structure:
        """The modes of a rig's two beams, P1 at `theta` degrees."""
        checks.instance("rig", rig, Rig)
        return of_beams(rig, checks.theta_degrees(theta))

    @classmethod
    def from_modes(
        cls,
        frequency: Any,
        normal: Any,
        tangential: Any,
        *,
        load: Any,
        output: Any = None,
        drive: Any = None,
        d1: float = 0.0,
        d2: float = 0.0,
        damping_ratio: Any = None,
        gap: Any = None,
        friction: Any = None,
        node_positions: Any = None,
        node_numbers: Any = None,
        node_shapes: Any = None,
    ) -> Structure:
        """Construct a structure from mass-normalised modes, which are complete, so that the contact is rigid.

        Parameters
        ----------
        frequency : array_like, (n,)
            Hz, of the structure with its contact open; 0 for a rigid motion.
        normal, tangential : array_like, (n,) or (c, n)
            Gap shapes, kg^-1/2: `normal` is positive in opening, `tangential` is the displacement of the surface
            along the drive. One row for each of c contacts.
        load : array_like, (n,)
            Modal forces of a unit load, kg^-1/2.
        output : array_like, (n,), optional
            Shape of the observed displacement (point B). Default: the tangential gap.
        drive : array_like, (n,), optional
            Participation factors of a moving base, kg^1/2: coordinates are relative to the base, whose
            acceleration acts as the modal force -drive * acceleration. Default: a rigid surface slides past at V.
        d1, d2 : float
            Rayleigh damping, 1/s and s.
        damping_ratio : float or array_like, (n,), optional
            Additional damping ratios of these modes. For ratios of tied modes use `damped`.
        gap, friction : float or array_like, (c,), optional
            Initial gaps of several contacts, m, 0 for contacts that touch without load, positive for open ones;
            factors of the coefficient of friction. Default: 0 and 1.
        node_positions, node_shapes : array_like, (k, 3) and (k, 3, n), optional
            Positions of nodes, m, and their displacement in each mode, kg^-1/2, for `displacement`.
        node_numbers : array_like of int, (k,), optional
            Node numbers in files. Default: from 1.

        Raises
        ------
        ValueError
            Names the argument, its value and the allowed values, or the motion that is not constrained.
        """
        omega = 2.0 * np.pi * row_of("frequency", frequency, None)
        if np.any(omega < 0.0):
            raise InputError(f"frequency = {omega.min() / (2.0 * np.pi):g}: it must be 0 or above (Hz)")
        n = len(omega)
        own, rows = contact_rows(normal, tangential, gap, friction, n, row_of)
        pushed = row_of("load", load, n)
        read = rows[len(rows) // 2 :].mean(axis=0) if output is None else row_of("output", output, n)
        inertia = np.zeros(n) if drive is None else -row_of("drive", drive, n)
        found = structure_of(cls, np.vstack([omega**2, rows, pushed, inertia, read]), own, (d1, d2), damping_ratio)
        if node_positions is None:
            return found
        nodes, numbers = checked_positions(node_positions, node_numbers)
        shapes = finite("node_shapes", node_shapes)
        if shapes.shape != (*nodes.shape, n):
            raise InputError(f"node_shapes of shape {shapes.shape}: it must be {(*nodes.shape, n)}")
        ordered = shapes[..., np.argsort(omega**2, kind="stable")]
        return replace(found, nodes=nodes, numbers=numbers, shapes=ordered)

    @classmethod
    @one_blas_thread()
    def from_matrices(
        cls,
        mass: Any,
        stiffness: Any,
        *,
        normal: Any,
        tangential: Any,
        load: Any,
        output: Any = None,
        drive: Any = None,
        damping: Any = None,
        d1: float = 0.0,
        d2: float = 0.0,
        damping_ratio: Any = None,
        gap: Any = None,
        friction: Any = None,
        fmax: float | None = None,
        names: Sequence[str] | None = None,
        node_positions: Any = None,
        node_numbers: Any = None,
        node_rows: Any = None,
    ) -> Structure:
        """Compute the modes of a finite-element model with its contact open.

        Modes up to `fmax` are computed, or all modes if there are at most 600 degrees of freedom and no `fmax`.
        The other modes act by their static compliance at contact and load. Larger models are solved by
        shift-invert Lanczos, and the number of modes is verified by the number of negative pivots of stiffness -
        (2 pi fmax)^2 mass. A motion is rigid if its strain energy is within the rounding of the stiffness; a
        remark gives the corresponding frequency. Degrees of freedom that are so stiff that all other stiffnesses
        are rounding, such as the 1e36 of Abaqus, are constrained and eliminated.

        Parameters
        ----------
        mass, stiffness : array_like or sparse, (n, n)
            Symmetric, kg and N/m (or kg m2 and N m); mass positive definite, stiffness semidefinite.
        normal, tangential, load, output, drive : array_like, (n,), or dict {dof: weight}
            As for `from_modes`, as rows over the degrees of freedom; `drive` is the mass matrix times the rigid
            motion for a unit motion of the base. With several contacts `normal` and `tangential` are lists of
            rows.
        damping : array_like or sparse, (n, n), optional
            N s/m. Its diagonal in modal coordinates is used; `remarks` quantifies the neglected coupling.
        d1, d2, damping_ratio, gap, friction :
            As for `from_modes`.
        fmax : float, optional
            Highest frequency of a mode for stability, Hz. Default: 10 kHz for more than 600 degrees of freedom.
            Motion uses as many modes as it needs, independent of `fmax` (`wider`).
        names : sequence of str, (n,), optional
            Names of the degrees of freedom in messages. Default: "degree of freedom 7", from 0.
        node_positions : array_like, (k, 3) or (k, 2), optional
            Positions of nodes, m. If given, eigenvectors are stored (`shapes`), and `displacement` maps modal
            coordinates to nodes.
        node_numbers : array_like of int, (k,), optional
            Node numbers in files. Default: from 1.
        node_rows : array_like of int, (k, 3) or (k, 2), optional
            Degrees of freedom along x, y and z of each node, -1 if there is none. Default: each node has the same
            number of consecutive degrees of freedom.

        Raises
        ------
        ValueError
            Names the argument, its value and the allowed values, or the motion that is not constrained.
        ArithmeticError
            If the number of modes found differs from the verified number.
        """
        M = checked_matrix("mass", mass, None)
        n = M.shape[0]
        K = checked_matrix("stiffness", stiffness, n)
        C = None if damping is None else checked_matrix("damping", damping, n)
        own, touching = contact_rows(normal, tangential, gap, friction, n, over_dofs)
        given = {"load": load, "output": output, "drive": drive}
        rows = {name: over_dofs(name, row, n) for name, row in given.items() if row is not None}
        rows["normal"], rows["tangential"] = np.split(touching, 2)
        if names is not None and len(names) != n:
            raise InputError(f"names: there are {len(names)}; it must be {n}, one for each degree of freedom")
        kept = None if node_positions is None else kept_nodes(node_positions, node_numbers, node_rows, K)
        remarks, free, diagonal = tuple[str, ...](), free_rows(K), K.diagonal()
        name = np.array([f"degree of freedom {dof}" for dof in range(n)] if names is None else names)[free]
        if not free.all():
            M, K, C = (None if each is None else each[free][:, free] for each in (M, K, C))
            rows = {each: row[..., free] for each, row in rows.items()}
            remarks = (f"stiffness: {n - len(name)} degrees of freedom are held, with {diagonal.max():g}",)
        contact = np.vstack([rows["normal"], rows["tangential"], rows["load"]])
        band = None if fmax is None else checks.band(fmax)
        band = 10e3 if band is None and n > DENSE_SIZE else band
        struck = of_loaded_bodies(M, K, rows["normal"], rows["load"])
        output_row = rows.get("output", rows["tangential"].mean(axis=0))
        drive_row = rows.get("drive", np.zeros(len(name)))

        def up_to(top: float | None) -> Structure:
            values, vectors, compliance, rigid = lowest_modes(M, K, top, contact, name)
            more = 0 if top == band else len(values) - np.size(damping_ratio)
            table = np.vstack([values, contact @ vectors, -drive_row @ vectors, output_row @ vectors])
            found = structure_of(
                cls, table, own, (d1, d2), extended(damping_ratio, more), compliance, vectors, name
            )
            text = f"stiffness: motions below {rigid:.2g} Hz, which is its rounding, count as rigid"
            found = replace(found, remarks=(*found.remarks, *remarks, *([text] if rigid else [])))
            if not np.array_equal(struck, rows["normal"]):
                moved = np.pad(struck @ vectors, ((0, 0), (0, found.static)))
                found = replace(found, struck=moved.reshape(found.normal.shape))
            if kept is not None and top == band:
                nodes, numbers, dofs, edges = kept
                # Constrained and missing degrees of freedom do not move.
                whole = np.zeros((n + 1, len(values)))
                whole[:-1][free] = vectors[:, np.argsort(values, kind="stable")]
                found = replace(found, nodes=nodes, numbers=numbers, shapes=whole[dofs], edges=edges)
            return found if C is None else with_matrix(found, vectors.T @ (C @ vectors))

        return for_motion(up_to(band), band, len(name), up_to)

    @classmethod
    def read(cls, path: str | Path) -> Structure:
        """Read a TOML file that names files of matrices or modes, or contains the modes (`README.md`)."""
        kind, arguments = structure_arguments(Path(path))
        structure: Structure = getattr(cls, kind)(**arguments)
        return structure

    @cached_property
    def digest(self) -> str:
        """Digest of all numbers and of the damping law, which determine stability and motion."""
        content = np.vstack([getattr(self, name) for name in ROWS]).tobytes()
        content += np.array(self.rayleigh or (np.nan, np.nan)).tobytes()
        content += b"".join(each.tobytes() for each in (self.gap, self.friction) if each is not None)
        content += bytes([self.static]) + (b"" if self.cutoff is None else f"cutoff {self.cutoff!r}".encode())
        return sha256(content + (self.wider.digest.encode() if self.wider else b"")).hexdigest()

    def to_dict(self) -> dict[str, Any]:
        """All numbers as lists, from which `from_dict` makes an equal structure."""
        rows = {name: getattr(self, name).tolist() for name in ROWS}
        own = {"rayleigh": self.rayleigh, "static": self.static, "remarks": list(self.remarks)}
        if self.several:
            own |= {"gap": self.gap.tolist(), "friction": self.friction.tolist()}
        return rows | own | {"cutoff": self.cutoff, "wider": self.wider.to_dict() if self.wider else None}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Structure:
        """The structure of `to_dict`."""
        # Older dictionaries may lack `struck`, `cutoff` and `wider`; those with one contact have no gap.
        given = {"cutoff": None, "wider": None} | dict(content)
        given["struck"] = given["normal"] if given.get("struck") is None else given["struck"]
        rows: Any = {name: np.array(given[name], float) for name in ROWS}
        rayleigh = None if given["rayleigh"] is None else tuple(given["rayleigh"])
        own: Any = {"rayleigh": rayleigh, "static": int(given["static"]), "remarks": tuple(given["remarks"])}
        own |= {name: np.array(given[name], float) for name in ("gap", "friction") if name in given}
        wider = cls.from_dict(given["wider"]) if given["wider"] else None
        return cls(**rows, **own, cutoff=given["cutoff"], wider=wider)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Structure) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    def __repr__(self) -> str:
        top = self.frequency[-1] if len(self.frequency) else 0.0
        several = f"{self.contacts} contacts, " if self.several else ""
        return f"Structure({several}{len(self.frequency)} modes up to {top:.6g} Hz, {self.digest[:12]})"

    def _repr_html_(self) -> str:
        own = (("modes", f"{len(self.frequency)}", "1"), ("preload", f"{self._normal_force[0]:g}", "1"))
        modes = enumerate(self.frequency[:12].tolist(), 1)
        rows = [*own, *((f"mode {number}", f"{each:.6g}", "Hz") for number, each in modes)]
        return html_table("Structure", ("", "value", "unit"), rows)

    @property
    def d1(self) -> float:  # type: ignore[override]
        """Rayleigh damping, 1/s; 0 for modal damping."""
        return self.rayleigh[0] if self.rayleigh else 0.0

    @property
    def d2(self) -> float:  # type: ignore[override]
        """Rayleigh damping, s; 0 for modal damping."""
        return self.rayleigh[1] if self.rayleigh else 0.0

    @property
    def frequency(self) -> Array:
        """Frequencies of the modes that were computed, (m,), Hz."""
        return np.asarray(np.sqrt(self.stiffness[: len(self.stiffness) - self.static]) / (2.0 * np.pi))

    @property
    def contacts(self) -> int:
        """Number of contacts."""
        return 1 if self.gap is None else len(self.gap)

    @property
    def several(self) -> bool:
        """Whether there are several contacts, or one with an initial gap or a factor of mu."""
        return self.gap is not None

    def equilibrium(self, F: float = 1.0) -> tuple[Array, Array]:
        """Normal forces, N, and gaps, m, of the contacts, each (c,), at rest under the load F, N, with T = 0.

        With one contact, which the load closes, the force is F times the preload. Raises `InputError` if the load
        closes no contact.
        """
        if self.gap is None:
            return np.array([F * self.preload]), np.zeros(1)
        forces, gaps = resting(self.stiffness, self.normal, F * self.load, self.gap)
        if not forces.any():
            raise InputError(f"F = {F:g}: no contact is closed; the least gap is {gaps.min():.3g} m")
        return forces, gaps

    @cached_property
    def preload(self) -> float:
        """Normal force at rest for a unit load with g_N = 0 and T = 0; an `InputError` if it vanishes.

        With several contacts, the sum of the contact forces for initial gaps of zero.
        """
        force, rounding = self._normal_force
        if abs(force) <= rounding:
            raise InputError(f"load: {NO_PRELOAD}; change where it acts")
        return force

    @property
    def _normal_force(self) -> tuple[float, float]:
        """The preload and its possible rounding error."""
        rigid = self.stiffness == 0.0
        if self.gap is not None:
            return float(resting(self.stiffness, self.normal, self.load, 0.0 * self.gap)[0].sum()), 0.0
        if rigid.any():
            return float(-self.load[rigid][0] / self.normal[rigid][0]), 0.0
        flexible = self.normal / self.stiffness
        terms = -flexible * self.load / (flexible @ self.normal)
        return float(-(flexible @ self.load) / (flexible @ self.normal)), PRESSED * float(np.abs(terms).sum())

    @cached_property
    def time_scale(self) -> float:
        """Factor of all default times of a run, such as segments and sampling intervals; 1 for the beams."""
        elastic = self.frequency[self.frequency > 0.0]
        return MIDDLE / float(np.clip(MIDDLE, elastic.min(), elastic.max())) if len(elastic) else 1.0

    def displacement(self, modal: Any) -> Any:
        """Displacement of the nodes, (..., k, 3), for coordinates of the computed modes, (..., m)."""
        if self.shapes is None:
            raise InputError(
                "structure: it keeps no eigenvectors; give node_positions (positions in a file of matrices)"
            )
        return np.einsum("kdm,...m->...kd", self.shapes, np.asarray(modal))

    def with_stiffness_damping(self, added: float) -> Structure:
        """The structure with additional stiffness damping, s."""
        own = self.stiffness * (np.arange(len(self.stiffness)) < len(self.frequency))
        rayleigh = None if self.rayleigh is None else (self.d1, self.d2 + added)
        wider = self.wider and self.wider.with_stiffness_damping(added)
        return replace(self, damping=self.damping + added * own, rayleigh=rayleigh, wider=wider)

    def with_gap(self, gap: Array) -> Structure:
        """The structure with other initial gaps of its contacts, m."""
        return replace(self, gap=gap, wider=self.wider and self.wider.with_gap(gap))

    def truncated(self) -> Structure:
        """The structure without the static compliance of the modes that are not computed."""
        rows: Any = {name: getattr(self, name)[..., : len(self.frequency)] for name in ROWS}
        return replace(self, **rows, static=0, wider=self.wider and self.wider.truncated())

    def mirrored(self) -> Structure:
        """The mirror image of the structure with respect to the direction of the drive."""
        turned = {name: -getattr(self, name) for name in ("tangential", "inertia", "output")}
        return replace(self, **turned, wider=self.wider and self.wider.mirrored())

    @property
    def motion(self) -> Structure:
        """The structure with the modes used for motion."""
        return self.wider or self

    @cached_property
    def reaching(self) -> Structure:
        """The structure with the higher cut-off for growth near the usual one, if it has enough modes."""
        if self.cutoff is None or self.wider:
            return replace(self, cutoff=None) if self.wider and self.wider.static else self
        m = len(self.frequency)
        return replace(
            self, cutoff=motion_cutoffs(self, MOST_MODES if self.static else 2 * m // 3)[1] or self.cutoff
        )

    def receptances(self, frequency: Any, mu: float = 0.0, contact: int = 0) -> Any:
        """Receptances h_NN + mu h_NT and h_TN + mu h_TT, m/N, at frequencies, Hz: gaps for N = 1 and T = mu N.

        With several contacts, gaps and force of the one with index `contact`, from 0.
        """
        phi = 2j * np.pi * np.asarray(frequency, dtype=float)[..., None]
        normal, tangential = (np.atleast_2d(row)[contact] for row in (self.normal, self.tangential))
        response = (normal + mu * tangential) / (self.stiffness + self.damping * phi + phi**2)
        return (response * normal).sum(axis=-1), (response * tangential).sum(axis=-1)

    def damped(self, damping_ratio: Any, of: str = "tied") -> Structure:
        """Replace the damping by given ratios of the modes with the contact tied in both directions, or free.

        Measured ratios usually belong to the assembled structure with the contact tied. Modal damping is fitted to
        them by least squares, mainly for tied modes below 0.8 of the highest computed frequency; `tied_damping`
        returns the ratios achieved. `damping_ratio` is one number, or one for each mode in ascending order of
        frequency.

        Warns
        -----
        DampingWarning
            If the ratio of a tied mode below 0.8 of the highest frequency is missed by more than 10 %. A remark
            lists all such modes, including those above.
        """
        checks.choice("of", of, ("tied", "free"))
        m, wider = len(self.frequency), self.wider
        if wider is not None:
            wider = wider.damped(extended(damping_ratio, len(wider.frequency) - m), of)
        if of == "free":
            added = 2.0 * ratios_of(damping_ratio, m) * np.sqrt(self.stiffness[:m])
            return replace(self, damping=np.pad(added, (0, self.static)), rayleigh=None, wider=wider)
        values, shapes = tied_modes(self.stiffness, np.vstack([self.normal, self.tangential]), self.static)
        ratios, frequency = ratios_of(damping_ratio, len(values)), np.sqrt(values) / (2.0 * np.pi)
        found = fitted(ratios, self.stiffness[:m], values, shapes)
        structure = replace(self, damping=np.pad(found, (0, self.static)), rayleigh=None, wider=wider)
        given = tied_ratios(found, values, shapes)
        missed = np.abs(given - ratios) > 0.1 * ratios
        if not missed.any():
            return structure
        each = [f"{a:.6g} Hz: {b:.3g} for {c:.3g}" for a, b, c in np.stack([frequency, given, ratios]).T[missed]]
        text = f"damping: ratios of tied modes are missed at {', '.join(each)}; compute more modes (fmax)"
        if np.any(missed & (frequency < BAND_SHARE * self.frequency[-1])):
            warnings.warn(text, DampingWarning, stacklevel=2)
        return replace(structure, remarks=(*structure.remarks, text))

    @property
    def tied_damping(self) -> tuple[Array, Array]:
        """Frequencies, Hz, and first-order damping ratios of the modes with the contact tied, each (k,)."""
        values, shapes = tied_modes(self.stiffness, np.vstack([self.normal, self.tangential]), self.static)
        ratios = tied_ratios(self.damping[: len(shapes)], values, shapes)
        return np.sqrt(values) / (2.0 * np.pi), ratios


@lru_cache(maxsize=64)
@one_blas_thread()
def of_beams(rig: Rig, theta: float) -> Structure:
    """`Structure.of` for checked arguments."""
    stiffness, normal, tangential = contact_modes(rig, theta)
    upper, lower = rig_bases(rig, theta)
    n1 = len(upper.stiffness)
    inertia, output, load = np.zeros((3, len(stiffness)))
    inertia[n1:] = -axial(rig.p2).base_inertia @ lower.shapes[1:, 0]
    # B lies between two nodes, where the displacement is linear.
    distance = np.arange(rig.p1.elements + 1) - (1.0 - rig.point_b) * rig.p1.elements
    output[:n1] = np.maximum(1.0 - np.abs(distance), 0.0) @ upper.shapes[:, 0]
    load[:n1] = -upper.shapes[0, 1]
    damping = rig.d1 + rig.d2 * stiffness
    struck = np.where(np.arange(len(normal)) < n1, normal, 0.0)
    return Structure(stiffness, damping, normal, tangential, inertia, output, load, struck, (rig.d1, rig.d2))


def modal_structure(rig: ContactModel, theta: float) -> Structure:
    """The structure of a rig at `theta`, degrees; a structure is returned unchanged."""
    return of_beams(rig, theta) if isinstance(rig, Rig) else cast(Structure, rig)
