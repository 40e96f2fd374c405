"""Solver core: structures in frictional point contact, their stability and their motion.

Nothing here knows of sweeps or figures. Units are SI; only theta is in degrees.
"""

from fivcore.cycles.branch import CycleBranch, follow_cycle
from fivcore.cycles.limit_cycle import LimitCycle, limit_cycle
from fivcore.errors import (
    ContactError,
    DampingWarning,
    DivergenceError,
    FixedContactWarning,
    InputError,
    OutOfBandWarning,
    UnsolvedError,
)
from fivcore.friction import Friction
from fivcore.rig import Beam, Rig, Scene
from fivcore.stability.assembled import AssembledModes, assembled_modes, assembled_onsets
from fivcore.stability.falling import SlidingOnsets, sliding_onsets
from fivcore.stability.intervals import OnsetCurve, OnsetCurves, UnstableWindows, onset_curves, unstable_windows
from fivcore.stability.many import FlutterOnsets, ManyFlutterOnsets, flutter_onsets, flutter_onsets_many
from fivcore.stability.sensitivity import OnsetSensitivity, onset_sensitivity
from fivcore.stability.sliding import SlidingModes, node_positions, sliding_modes
from fivcore.stability.tied import glued_frequencies, tune_head_mass
from fivcore.structure import Structure
from fivcore.transient.driver import Transient
from fivcore.transient.lyapunov import LyapunovExponent, lyapunov_exponent
from fivcore.transient.normalised import State
from fivcore.transient.options import Options, Until
from fivcore.transient.simulate import growing_frequencies, painleve_mu, simulate, simulate_many

__all__ = [
    "AssembledModes", "Beam", "ContactError", "CycleBranch", "DampingWarning", "DivergenceError",
    "FixedContactWarning", "FlutterOnsets", "Friction", "InputError", "LimitCycle", "LyapunovExponent",
    "ManyFlutterOnsets", "OnsetCurve", "OnsetCurves", "OnsetSensitivity", "Options", "OutOfBandWarning", "Rig",
    "Scene", "SlidingModes", "SlidingOnsets", "State", "Structure", "Transient", "UnsolvedError",
    "UnstableWindows", "Until", "assembled_modes", "assembled_onsets", "flutter_onsets", "flutter_onsets_many",
    "follow_cycle", "glued_frequencies", "growing_frequencies", "limit_cycle", "lyapunov_exponent",
    "node_positions", "onset_curves", "onset_sensitivity", "painleve_mu", "simulate", "simulate_many",
    "sliding_modes", "sliding_onsets", "tune_head_mass", "unstable_windows",
]  # fmt: skip
