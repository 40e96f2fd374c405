"""Reduced model: modal truncation at a cut-off frequency with the residual flexibility of the truncated modes.

Modes above the cut-off do not matter individually, but they provide most of the compliance at the contact and
absorb energy in impacts. A spring and a dashpot in parallel (Kelvin-Voigt) between the surfaces replace them
(`fivcore.contact.law`):

- K is the inverse of their static flexibility (MacNeal, Computers & Structures 1, 1971; Rubin, AIAA Journal 13,
  1975), cross terms included: sliding stability and all quasi-static motion stay those of all modes.
- C = tau K. Modes above the cut-off take energy from those below and dissipate it or pass it on to higher modes.
  tau gives the fastest oscillation of the modal contact mass on K the damping ratio CONTACT_DAMPING, and less in
  solids (`ReducedModel.beam_share`). It is at least d2, the material damping of the truncated modes.

If no mode is truncated, the contact is rigid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.beams.modes import one_blas_thread, residual_flexibility
from fivcore.contact.law import DiscreteContact, at_impulses, ratio, resistance
from fivcore.contact.several import unique_up_to, with_local
from fivcore.errors import SceneValueError
from fivcore.jit import Array, ReadOnlyArrays
from fivcore.modal.cutoffs import SLENDER
from fivcore.rig import ContactModel, Rig
from fivcore.statics import resting
from fivcore.structure import modal_structure

MODAL = ("stiffness", "damping", "normal", "tangential", "inertia", "output", "load")
# Default step of `fast` in units of the contact's own time 1 / omega (with 1.75 the paper's rig balances its
# energy to 0.3 %, with 1.92 to 1 %); without a dashpot, which damps the step's energy error; of a rigid contact,
# in units of the fastest mode's time; and the limit of linear stability, below the 2.389 at which the paper's rig
# loses its stability in stick (`step_map`), for any mu.
CONTACT_STEP, UNDAMPED_CONTACT_STEP, RIGID_STEP, STABILITY_LIMIT = 1.75, 0.3, 0.5, 2.35
# Largest step in units of that limit. Each status of the contact is stable up to the limit, but changes of the
# status add energy: over 0.2 s of 60 random rigs at most 3.2 % of what is exchanged with 1.75 / omega (median
# 0.2 %), 3.7 % with 1.9 (0.5 %), 9 % with 2.0, 70 % with 2.1 (`python -m tests.benchmarks constants`). Rigid
# contacts gain below 1 % up to the limit.
LARGEST_SHARE = 0.8
# Default step of structures in rigid contact, in the same unit: so much for each elastic mode, up to a maximum.
# Periods and stick times of blocks on belts are then right within 1e-3 (2.5e-3 with twice the step), and a run
# with fewer than 20 modes takes no longer than one with 20.
STEP_PER_MODE, MOST_RIGID_STEP = 0.005, 0.1
# Sampling interval of the statistics, s; a default step that is not longer divides it.
INTERVAL = 20e-6
# The cut-off is CUTOFF_SHARE of a frequency that follows from LEAST_CUTOFF, Hz (`default_cutoff`). On 102 random
# scenes the largest error of a share of time is then below 0.008 in half and below 0.022 in 90 % of them; with a
# share of 1 below 0.006 and 0.025. With 0.64 it exceeds 0.02 in a fifth of the scenes whose motion does not change
# its kind. Neither linear stability nor the contact's receptances nor the axial modes next to the cut-off predict
# which scenes need more.
LEAST_CUTOFF, CUTOFF_SHARE = 115e3, 0.8
# Damping ratio of the contact. With 0.045 the mean error of a share of time over random rigs with one kind of
# motion is below 0.01 at cut-offs from 3.1 to 6.2 c / (4 L); 0.06 improves the energy balance and changes the
# share of stick by 0.003. At 75 kHz, 2.5 times the ratio raises the share of stick by 0.02 to 0.03, and with a
# quarter of it the contact rings.
CONTACT_DAMPING = 0.06


@dataclass(frozen=True, eq=False)
class ReducedModel(ReadOnlyArrays):
    """Kept modes, and the contact element for the residual flexibility of the others; arrays are read-only."""

    # Kept modes, (n,), as in `Structure`; loads are in units of the preload.
    stiffness: Array
    damping: Array
    normal: Array
    tangential: Array
    inertia: Array
    output: Array
    load: Array
    # Mask of the kept modes among all modes, (all modes,).
    kept: NDArray[np.bool_]
    # Spring (inverse residual flexibility), N/m, and dashpot, N s/m, (2, 2), normal first; zero: rigid contact.
    K: Array
    C: Array
    # Time between two samples, s.
    interval: float = INTERVAL
    # Static normal gap of the truncated modes under a unit load, m; 0 where a rigid mode closes it.
    load_gap: Any = 0.0
    # Default step in rigid contact, in units of the fastest mode's time.
    rigid_step: float = RIGID_STEP
    # With c contacts gap shapes are (c, n), K and C (2c, 2c), normal gaps first, and `load_gap` (2c,). The fields
    # below hold initial gaps, factors of mu and normal forces at rest for a unit load, (c,); the inverse of K,
    # m/N, which may be singular to rounding; and the ratio of C to K, s.
    gap: Any = None
    friction: Any = None
    forces: Any = None
    flexibility: Any = None
    relaxation: float = 0.0

    @cached_property
    def shapes(self) -> Array:
        """Normal and tangential gap shapes, (2, n), kg^-1/2. Read-only."""
        shapes = np.vstack([self.normal, self.tangential])
        shapes.setflags(write=False)
        return shapes

    @property
    def W(self) -> Array:
        """Delassus matrix: inverse mass of the kept modes at the contact, (2, 2), 1/kg."""
        return np.asarray(self.shapes @ self.shapes.T)

    @cached_property
    def static_equilibrium(self) -> Array:
        """Static equilibrium under a unit load with T = 0, (n,); the rigid mode closes the gap. Read-only."""
        rigid, push = self.stiffness == 0.0, self.normal if self.forces is None else self.forces @ self.normal
        rest = np.where(rigid, 0.0, (self.load + push) / np.where(rigid, 1.0, self.stiffness))
        if self.forces is not None:
            # Closed contacts satisfy g_N + u_N = 0.
            closed, gaps = self.forces > 0.0, self.rest_u[: len(self.forces)] + self.gap + self.normal @ rest
            rest[rigid] = np.linalg.lstsq(self.normal[np.ix_(closed, rigid)], -gaps[closed])[0]
            rest.setflags(write=False)
            return rest
        flexibility = np.linalg.inv(self.K)[0, 0] if self.K.any() else 0.0
        rest[rigid] = -(flexibility + self.normal @ rest) / self.normal[rigid]
        rest.setflags(write=False)
        return rest

    @cached_property
    def rest_u(self) -> Array:
        """Gaps u of the truncated modes with several contacts at rest, (2c,), m for a unit load."""
        force = np.append(self.forces, np.zeros(len(self.normal)))
        return np.asarray((0.0 if self.flexibility is None else self.flexibility @ force) + self.load_gap)

    def discrete(self, step: float) -> DiscreteContact:
        """The contact in steps of `fast`, s, corrected for impulses."""
        return _discrete(self, step)

    def dissipation(self, contact: DiscreteContact) -> Array:
        """Dashpot as seen by the mean rates of the gaps during a step, (2, 2), N s/m."""
        # Because of the impulse defect, the mean rate of a gap during an impulse is less than that of the spring.
        rates = contact.flexibility @ self.K
        return np.asarray(rates.T @ self.C @ rates)

    def painleve_mu(self, step: float | None) -> float:
        """Mu above which the contact force is not unique, in steps of `fast` or, with None, in continuous time."""
        if self.forces is not None:
            return unique_up_to(self, step or self.default_step)
        if step is not None:
            return self.discrete(step).painleve_mu
        return ratio(*(self.K[1, ::-1] if self.K.any() else self.W[0]))

    @cached_property
    def contact_frequency(self) -> float:
        """Largest angular frequency of the modal contact mass on the spring K, rad/s; zero in rigid contact."""
        if not self.K.any():
            return 0.0
        matrix = self.K @ self.W if self.flexibility is None else np.linalg.solve(self.flexibility, self.W)
        return float(np.sqrt(np.linalg.eigvals(matrix).real.max()))

    @property
    def beam_share(self) -> float:
        """Contact frequency divided by `SLENDER` times the highest kept frequency; at most 1, the value of beams.

        A smaller value, as in solids, means that most of the contact's compliance belongs to modes far above the
        cut-off. They yield statically but absorb little energy, and the highest kept mode determines the step.
        """
        return min(self.contact_frequency / (SLENDER * float(np.sqrt(self.stiffness.max()))), 1.0)

    @property
    def default_step(self) -> float:
        """Default step of `fast`, s: it divides `INTERVAL`, or if longer is rounded down to two digits."""
        omega, damping = self.contact_frequency, float(self.damping.max())
        share = self.beam_share * (CONTACT_STEP if self.C.any() else UNDAMPED_CONTACT_STEP)
        most = share / omega if omega else self.rigid_step / float(np.sqrt(self.stiffness.max()))
        # The law uses mean velocities during an impulse, so no mode may decay by more than a factor of e^-2.
        most = min(most, 2.0 / damping) if damping > 0.0 else most
        if most <= self.interval:
            return self.interval / float(np.ceil(self.interval / most * (1.0 - 1e-9)))
        digit = 10.0 ** (np.floor(np.log10(most)) - 1.0)
        return float(f"{np.floor(most / digit * (1.0 + 1e-9)) * digit:.1e}")

    @property
    def largest_step(self) -> float:
        """Largest step of `fast`, s: LARGEST_SHARE of the stability limit, all of it in rigid contact."""
        omega = self.contact_frequency
        return self.largest_share * (STABILITY_LIMIT / omega if omega else np.pi / np.sqrt(self.stiffness.max()))

    @property
    def largest_share(self) -> float:
        """Largest step in units of the linearly stable one."""
        return LARGEST_SHARE if self.K.any() else 1.0


@lru_cache(maxsize=256)
def _discrete(model: ReducedModel, step: float) -> DiscreteContact:
    half = 0.5 * step * model.W
    if not model.K.any():
        return DiscreteContact(np.zeros(half.shape), 0.0, half, step, np.zeros(half.shape))
    parts = at_impulses(model.stiffness, model.damping, step)
    defect, drift = ((model.shapes * part) @ model.shapes.T for part in parts)
    if model.flexibility is not None:
        # The dashpot for a common motion of all contacts is unchanged.
        flexibility, every = model.flexibility + defect, np.arange(len(half)) < len(half) // 2
        before, after = (np.linalg.solve(each, every)[every].sum() for each in (model.flexibility, flexibility))
        return DiscreteContact(flexibility, model.relaxation * float(before / after), half - drift, step, defect)
    flexibility = np.linalg.inv(model.K) + defect
    # C_NN is unchanged.
    tau = float(model.C[0, 0] / np.linalg.inv(flexibility)[0, 0])
    return DiscreteContact(flexibility, tau, half - drift, step, defect)


@lru_cache(maxsize=64)
def full_model(rig: ContactModel, theta: float) -> ReducedModel:
    """Return the structure itself, every mode in rigid contact; loads are in units of the preload."""
    own = modal_structure(rig, theta).motion
    kept, none = np.ones(len(own.stiffness), dtype=bool), np.zeros((2 * own.contacts, 2 * own.contacts))
    load, few = own.load / own.preload, STEP_PER_MODE * max(int(np.sum(own.stiffness > 0.0)), 1)
    model = ReducedModel(
        own.stiffness, own.damping, own.normal, own.tangential, own.inertia, own.output, load, kept, none, none,
        INTERVAL * own.time_scale, rigid_step=RIGID_STEP if isinstance(rig, Rig) else min(few, MOST_RIGID_STEP),
    )  # fmt: skip
    if own.gap is None:
        return model
    forces, gaps = resting(own.stiffness, own.normal, load, own.gap)[0], np.zeros(2 * own.contacts)
    return replace(model, gap=own.gap, friction=own.friction, forces=forces, load_gap=gaps)


def default_cutoff(rig: ContactModel) -> float:
    """Default cut-off of a reduced model, Hz: `CUTOFF_SHARE` of a frequency just below an axial mode of P1.

    This is the first axial mode above `LEAST_CUTOFF`, and at least the third, 5 c / (4 L), so that the model keeps
    the reflected axial wave of an impact. Large beams need less: `LEAST_CUTOFF` is replaced by the frequency at
    which the bending waves of either beam are four thicknesses long, beyond the validity of Euler-Bernoulli
    theory, if that is lower. The paper's rig has 94 kHz. A structure from matrices keeps the modes that take part
    in impacts (`fivcore.modal.cutoffs`), a structure from modes keeps all.
    """
    if not isinstance(rig, Rig):
        own = modal_structure(rig, 0.0)
        return own.cutoff or 1e3 * float(own.motion.frequency[-1])
    speeds = [(beam, float(np.sqrt(beam.young_modulus / beam.density))) for beam in (rig.p1, rig.p2)]
    slender = min(np.pi / (8.0 * np.sqrt(12.0)) * c / beam.thickness for beam, c in speeds)
    below = 0.97 * speeds[0][1] / (4.0 * rig.p1.length)
    odd = max(2.0 * np.ceil(0.5 * min(LEAST_CUTOFF, slender) / below - 0.5) + 1.0, 5.0)
    return CUTOFF_SHARE * float(below * odd)


@lru_cache(maxsize=64)
@one_blas_thread()
def reduced_model(rig: ContactModel, theta: float, cutoff: float | None = None) -> ReducedModel:
    """Truncate a structure at `cutoff`, Hz (default: `default_cutoff`), with the residual flexibility of the rest.

    A cut-off that keeps fewer than three modes is a `SceneValueError`.
    """
    full, own = full_model(rig, theta), modal_structure(rig, theta).motion
    cutoff = default_cutoff(rig) if cutoff is None else cutoff
    kept, modes = full.stiffness < (2.0 * np.pi * cutoff) ** 2, len(full.stiffness) - own.static
    # Static modes represent the residual flexibility and are never kept.
    kept[modes:] = False
    if kept.sum() < (least := min(modes, 3)):
        lowest = float(np.sqrt(np.sort(full.stiffness)[least - 1])) / (2.0 * np.pi)
        number = ("one mode", "two modes", "three modes")[least - 1]
        raise SceneValueError(f"cutoff = {cutoff:g}: it must be above {lowest:.6g} Hz, so that {number} are kept")
    lost = full.stiffness[~kept], full.shapes[:, ~kept]
    flexibility = residual_flexibility(*lost)
    if full.forces is not None and flexibility.any():
        # A small local compliance of each contact, so that coincident contacts share a force equally.
        flexibility = with_local(flexibility)
        gaps, K = (lost[1] / lost[0]) @ full.load[~kept], np.asarray(np.linalg.inv(flexibility))
        modal: dict[str, Any] = {name: getattr(full, name)[..., kept] for name in MODAL}
        model = replace(full, **modal, kept=kept, K=K, load_gap=gaps, flexibility=flexibility)
        tau = max(2.0 * CONTACT_DAMPING * model.beam_share**4 / model.contact_frequency, rig.d2)
        return replace(model, C=tau * K, relaxation=tau)
    # One or two truncated modes have no residual of rank two, so they are kept. The condition number of a residual
    # is usually about 3; at 1e8 its inverse would lose half the digits.
    complete = (~kept).sum() <= 2 and not own.static
    if complete or kept.all() or np.linalg.cond(flexibility) > 1e8:
        moves = np.arange(len(full.stiffness)) < modes
        if not moves.all():
            full = replace(full, kept=moves, **{name: getattr(full, name)[..., moves] for name in MODAL})
        if full.forces is None:
            resistance(full.W)
        return full
    modal, K = {name: getattr(full, name)[kept] for name in MODAL}, np.asarray(np.linalg.inv(flexibility))
    gap = 0.0 if full.stiffness.min() == 0.0 else float(np.sum((full.normal * full.load / full.stiffness)[~kept]))
    model = replace(full, **modal, kept=kept, K=K, load_gap=gap)
    ratio = CONTACT_DAMPING * model.beam_share**4
    return replace(model, C=max(2.0 * ratio / model.contact_frequency, rig.d2) * K)


# A change of a reduced model, for ablations.
Modify = Callable[[ReducedModel], ReducedModel]


def modified(model: ReducedModel, modify: Modify | None) -> ReducedModel:
    """Apply `modify`, each time anew because it may depend on more than the model; None: no change."""
    return model if modify is None else modify(model)
