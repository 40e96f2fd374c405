"""The contact of the reduced model: what it keeps, its law, when the law has one answer, one step as a map."""

from fivcore.contact.impulse import Impulse, corrected
from fivcore.contact.law import RegimeMaps, regime_maps
from fivcore.contact.reduced import (
    TERMINATIONS,
    ReducedModel,
    default_cutoff,
    full_model,
    reduced_model,
    relaxation_time,
)
from fivcore.contact.step_map import largest_stable_step, slip_map, stable, stick_map
from fivcore.contact.uniqueness import check_unique, critical_mu_of

__all__ = [
    "TERMINATIONS",
    "Impulse",
    "ReducedModel",
    "RegimeMaps",
    "check_unique",
    "corrected",
    "critical_mu_of",
    "default_cutoff",
    "full_model",
    "largest_stable_step",
    "reduced_model",
    "regime_maps",
    "relaxation_time",
    "slip_map",
    "stable",
    "stick_map",
]
