"""The reduced model of a rig: the modes below a cut-off, and the others' residual flexibility at the contact.

The modes above the cut-off are too fast to matter by themselves, but they are most of the contact's own compliance
and take energy out of impacts. A spring and a dashpot in parallel (Kelvin and Voigt) replace them between the two
surfaces (`fivcore.contact.law`):

- K is the inverse of their static flexibility (MacNeal, Computers & Structures 1, 1971; Rubin, AIAA Journal 13,
  1975), cross terms included: sliding stability and all quasi-static motion stay those of all modes.
- C = tau K. Modes above the cut-off take energy from those below it and lose it by damping or to modes higher
  still. tau gives the fastest oscillation of the kept modes' mass on K the damping ratio CONTACT_DAMPING, of
  solids less (`ReducedModel.beam_share`), and is at least d2, the dropped modes' own material damping.

Where every mode is kept, the surfaces touch rigidly.
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
# Of a structure in rigid contact, likewise, for each elastic mode and at most: blocks on belts have periods and
# sticks within 1e-3 (with twice as much 2.5e-3), and up to 20 modes no run takes longer than one with 20.
STEP_PER_MODE, MOST_RIGID_STEP = 0.005, 0.1
# Statistics are sampled so often, s; where a default step is not longer, a whole number of them fills the time.
INTERVAL = 20e-6
# Hz. With CUTOFF_SHARE of the frequency that follows from it the largest error of a share of time is below 0.008
# on half of 102 random scenes, and on 90 % of them below 0.022; with all of it, below 0.006 and 0.025; with 0.64
# above 0.02 on a fifth of the scenes that stay in one kind of motion. Linear stability, the contact's responses
# and the axial modes next to the cut-off do not tell which scenes need more.
LEAST_CUTOFF, CUTOFF_SHARE = 115e3, 0.8
# Damping ratio of the contact. With 0.045 the mean error of a share of time over random rigs with one
# kind of motion is below 0.01 at cut-offs from 3.1 to 6.2 c / (4 L); 0.06 balances energy better and shifts stick
# by 0.003. At 75 kHz two and a half times as much raises stick by 0.02 to 0.03; a quarter lets contact ring.
CONTACT_DAMPING = 0.06


@dataclass(frozen=True, eq=False)
class ReducedModel(ReadOnlyArrays):
    """Kept modes, and spring and dashpot for the residual flexibility of the others; arrays are read-only."""

    # Of each kept mode, (n,), as in `Structure`; loads are in units of the preload.
    stiffness: Array
    damping: Array
    normal: Array
    tangential: Array
    inertia: Array
    output: Array
    load: Array
    # Which of all modes these are, (all modes,).
    kept: NDArray[np.bool_]
    # Inverse of the residual flexibility, N/m, and its dashpot, N s/m, (2, 2), normal first; zero: rigid contact.
    K: Array
    C: Array
    # Time between two samples, s.
    interval: float = INTERVAL
    # Static normal gap of the modes that are not kept under a unit load, m; 0 where a rigid mode closes it.
    load_gap: Any = 0.0
    # Default step in rigid contact, in units of the fastest mode's time.
    rigid_step: float = RIGID_STEP
    # Of c contacts gap shapes are (c, n), K and C (2c, 2c), normal gaps first, and `load_gap` (2c,). These are
    # initial gaps, factors of mu, and normal forces at rest for a unit load, (c,); the inverse of K, m/N, which
    # may be singular except for rounding; and C over K, s.
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
            # The contacts that are closed are: g_N + u_N = 0.
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
        """Gaps of the modes that are not kept, of several contacts at rest, (2c,), m for a unit load."""
        force = np.append(self.forces, np.zeros(len(self.normal)))
        return np.asarray((0.0 if self.flexibility is None else self.flexibility @ force) + self.load_gap)

    def discrete(self, step: float) -> DiscreteContact:
        """The contact in steps of `fast`, s, corrected for impulses."""
        return _discrete(self, step)

    def dissipation(self, contact: DiscreteContact) -> Array:
        """Damping of the dashpot by the mean rates of the gaps over a step, (2, 2), N s/m."""
        # The mean rate of a gap over an impulse is less than that of the spring within it, by what impulses miss.
        rates = contact.flexibility @ self.K
        return np.asarray(rates.T @ self.C @ rates)

    def painleve_mu(self, step: float | None) -> float:
        """Mu above which the contact force is not unique, in steps of `fast` or, without a step, by the law."""
        if self.forces is not None:
            return unique_up_to(self, step or self.default_step)
        if step is not None:
            return self.discrete(step).painleve_mu
        return ratio(*(self.K[1, ::-1] if self.K.any() else self.W[0]))

    @cached_property
    def contact_frequency(self) -> float:
        """Largest angular frequency of the kept modes' mass on the spring K, rad/s; zero in rigid contact."""
        if not self.K.any():
            return 0.0
        matrix = self.K @ self.W if self.flexibility is None else np.linalg.solve(self.flexibility, self.W)
        return float(np.sqrt(np.linalg.eigvals(matrix).real.max()))

    @property
    def beam_share(self) -> float:
        """The contact's frequency over `SLENDER` times that of the highest kept mode; 1 at most, as of beams.

        Where it is less, as of solids, most of the contact's compliance belongs to modes far above the cut-off:
        they yield, but hardly take energy from those below, and the highest kept mode decides the step.
        """
        return min(self.contact_frequency / (SLENDER * float(np.sqrt(self.stiffness.max()))), 1.0)

    @property
    def default_step(self) -> float:
        """Step of `fast`, s: a whole part of `INTERVAL`, and where it is longer rounded down to two digits."""
        omega, damping = self.contact_frequency, float(self.damping.max())
        share = self.beam_share * (CONTACT_STEP if self.C.any() else UNDAMPED_CONTACT_STEP)
        most = share / omega if omega else self.rigid_step / float(np.sqrt(self.stiffness.max()))
        # The law takes the mean of a velocity over an impulse, so a mode may not lose more than e^-2 of it.
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
        # The dashpot against a motion of all contacts stays.
        flexibility, every = model.flexibility + defect, np.arange(len(half)) < len(half) // 2
        before, after = (np.linalg.solve(each, every)[every].sum() for each in (model.flexibility, flexibility))
        return DiscreteContact(flexibility, model.relaxation * float(before / after), half - drift, step, defect)
    flexibility = np.linalg.inv(model.K) + defect
    # C_NN stays.
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
    """Cut-off of a reduced model, Hz: `CUTOFF_SHARE` of a frequency just below an axial mode of P1.

    That is the first above `LEAST_CUTOFF`, but not below the third, 5 c / (4 L), which keeps an impact's reflected
    axial wave. Of large beams less is enough: the frequency at which the bending waves of one of them are four
    thicknesses long, where Euler-Bernoulli theory has ended, replaces `LEAST_CUTOFF` if it is lower. For the
    paper's rig: 94 kHz. A structure from matrices keeps the modes that motion needs (`fivcore.structure`), one
    from modes all.
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
    """Return the modes below `cutoff`, Hz, by default that of `default_cutoff`, with a residual for the others.

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
        # A little compliance of each contact's own, so that contacts in one place share a force alike.
        flexibility = with_local(flexibility)
        gaps, K = (lost[1] / lost[0]) @ full.load[~kept], np.asarray(np.linalg.inv(flexibility))
        modal: dict[str, Any] = {name: getattr(full, name)[..., kept] for name in MODAL}
        model = replace(full, **modal, kept=kept, K=K, load_gap=gaps, flexibility=flexibility)
        tau = max(2.0 * CONTACT_DAMPING * model.beam_share**4 / model.contact_frequency, rig.d2)
        return replace(model, C=tau * K, relaxation=tau)
    # One or two modes have no residual of rank two; with them the finite elements are complete. Its condition
    # number is usually about 3; of a flexibility at 1e8 the inverse has half its digits.
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
    """The model after `modify`, made anew each time, for it may depend on more than the model; None: the model."""
    return model if modify is None else modify(model)
