"""The two beams taken apart: finite elements, modes, and free motion of a mode."""

from fivcore.beams.elements import axial, hermite
from fivcore.beams.free_motion import propagator
from fivcore.beams.modes import contact_modes, lower_basis, one_blas_thread, residual_flexibility, rig_bases

__all__ = [
    "axial",
    "contact_modes",
    "hermite",
    "lower_basis",
    "one_blas_thread",
    "propagator",
    "residual_flexibility",
    "rig_bases",
]
