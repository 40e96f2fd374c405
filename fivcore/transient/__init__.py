"""Motion in time: three methods of one shape, what is observed of them, and the summary."""

from fivcore.transient.critical import critical_mu
from fivcore.transient.driver import Transient
from fivcore.transient.normalised import Normalised, State, slip_distance
from fivcore.transient.simulate import simulate, simulate_many
from fivcore.transient.statistics import SEPARATION, SETTLING, SLIP, STICK

__all__ = [
    "SEPARATION",
    "SETTLING",
    "SLIP",
    "STICK",
    "Normalised",
    "State",
    "Transient",
    "critical_mu",
    "simulate",
    "simulate_many",
    "slip_distance",
]
