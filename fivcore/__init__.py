"""Solver core: structures in frictional point contact, their stability and their motion.

Nothing here knows of sweeps or figures. Units are SI; only theta is in degrees. The modules `checks`, `exact`,
`observe`, `published` and `structure_files`, the reduced models and the constants serve studies of the solver.
"""

from fivcore import checks, structure_files
from fivcore.beams.modes import propagator
from fivcore.contact.reduced import ReducedModel, default_cutoff, full_model, modified, reduced_model
from fivcore.contact.step_map import largest_stable_step
from fivcore.contact.step_map import stable as is_stable_step
from fivcore.cycles.branch import CycleBranch, follow_cycle
from fivcore.cycles.limit_cycle import LimitCycle, limit_cycle
from fivcore.errors import FIXED as FIXED_CONTACT_LIMIT
from fivcore.errors import (
    ContactError,
    DampingWarning,
    DivergenceError,
    FixedContactWarning,
    InputError,
    NoVibrationError,
    OutOfBandWarning,
    SceneError,
    SceneValueError,
    UnsolvedError,
    fixed_contact,
)
from fivcore.foot import on_foot
from fivcore.friction import DECAYS, FRICTION_PARAMETERS, Friction
from fivcore.modal.cutoffs import motion_cutoff
from fivcore.rig import BEAM_PARAMETERS, RIG_PARAMETERS, Beam, Rig, Scene, one_contact
from fivcore.scenes import equilibrium, loading_time, model_exponents, speed_per_load
from fivcore.stability.assembled import AssembledModes, assembled_modes, assembled_onsets
from fivcore.stability.exponents import sliding_shape
from fivcore.stability.falling import SlidingOnsets, sliding_onsets
from fivcore.stability.following import FollowedModes, followed_modes, modes_along
from fivcore.stability.intervals import OnsetCurve, OnsetCurves, UnstableWindows, onset_curves, unstable_windows
from fivcore.stability.many import FlutterOnsets, ManyFlutterOnsets, flutter_onsets, flutter_onsets_many
from fivcore.stability.sensitivity import OnsetSensitivity, onset_sensitivity
from fivcore.stability.several import steady_forces
from fivcore.stability.sliding import SlidingModes, node_positions, node_shapes, sliding_modes
from fivcore.stability.tied import glued_frequencies, tune_head_mass
from fivcore.structure import Structure, modal_structure
from fivcore.transient import exact, observe, published
from fivcore.transient.driver import Transient, located
from fivcore.transient.lyapunov import LyapunovExponent, lyapunov_exponent
from fivcore.transient.normalised import Normalised, State, slip_distance
from fivcore.transient.options import LONG_STICK, Options, Until
from fivcore.transient.published import with_numerical_damping
from fivcore.transient.simulate import growing_frequencies, painleve_mu, simulate, simulate_many
from fivcore.transient.simulate import request as checked_run
from fivcore.transient.statistics import SEPARATION, SETTLING, SLIP, STICK
from fivcore.transient.summary import LONG_SHARE, STEADY_SHARE, STEADY_SPREAD

__all__ = [
    "BEAM_PARAMETERS", "DECAYS", "FIXED_CONTACT_LIMIT", "FRICTION_PARAMETERS", "LONG_SHARE", "LONG_STICK",
    "RIG_PARAMETERS", "SEPARATION", "SETTLING", "SLIP", "STEADY_SHARE", "STEADY_SPREAD", "STICK",
    "AssembledModes", "Beam", "ContactError", "CycleBranch", "DampingWarning", "DivergenceError",
    "FixedContactWarning", "FlutterOnsets", "FollowedModes", "Friction", "InputError", "LimitCycle",
    "LyapunovExponent", "ManyFlutterOnsets", "NoVibrationError", "Normalised", "OnsetCurve", "OnsetCurves",
    "OnsetSensitivity", "Options", "OutOfBandWarning", "ReducedModel", "Rig", "Scene", "SceneError",
    "SceneValueError", "SlidingModes", "SlidingOnsets", "State", "Structure", "Transient", "UnsolvedError",
    "UnstableWindows", "Until", "assembled_modes", "assembled_onsets", "checked_run", "checks", "default_cutoff",
    "equilibrium", "exact", "fixed_contact", "flutter_onsets", "flutter_onsets_many", "follow_cycle",
    "followed_modes", "full_model", "glued_frequencies", "growing_frequencies", "is_stable_step",
    "largest_stable_step", "limit_cycle", "loading_time", "located", "lyapunov_exponent", "modal_structure",
    "model_exponents", "modes_along", "modified", "motion_cutoff", "node_positions", "node_shapes", "observe",
    "on_foot", "one_contact", "onset_curves", "onset_sensitivity", "painleve_mu", "propagator", "published",
    "reduced_model", "simulate", "simulate_many", "sliding_modes", "sliding_onsets", "sliding_shape",
    "slip_distance", "speed_per_load", "steady_forces", "structure_files", "tune_head_mass", "unstable_windows",
    "with_numerical_damping",
]  # fmt: skip
