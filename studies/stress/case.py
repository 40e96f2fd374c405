"""What a case of the battery is, and what may come of it, in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fivcore import Rig
from studies import paper

METHODS = ("fast", "exact", "paper")
PASSES, VALUE, CONTACT, DIVERGENCE = "passes", "ValueError", "ContactError", "DivergenceError"
EXPECTATIONS = (PASSES, VALUE, CONTACT, DIVERGENCE)
# As expected: a run that passes every check, or a refusal; else a failure; or not asked, for another reason or as
# too dear. The last is for what is not known yet, and no outcome of a run. A file holds their places.
CAME = (*EXPECTATIONS, "fails", "not asked", "too dear", "pending")
FAILS, APART, DEAR, PENDING = (CAME.index(word) for word in ("fails", "not asked", "too dear", "pending"))

PAPERS = Rig()
# Ten times the paper's middle speed: first slip after 8 ms, the first burst 3 ms later, bursts from then on.
POINT = {"V": 20e-3, "theta": paper.THETA, "mu": paper.MU, "F": paper.LOAD}
DURATION = 30e-3


@dataclass(frozen=True)
class Case:
    """One thing asked of every method.

    Attributes
    ----------
    name, group : str
        Labels; the group's in the report and the figure.
    asks : str
        What is asked, for a reader.
    scene : mapping
        What differs from the operating point: V, theta, mu, F.
    rig : Rig
    run : mapping
        Further arguments of `fivcore.simulate`, `duration` among them.
    edge : str
        A limit of `studies.stress.limits`, of which `share` is asked; "" for none.
    share : float
    slips_at : float
        When the drive has moved by what a contact at rest gives way before it slips, s: V follows from it. 0: V is
        as it is.
    start : str
        An initial state of `studies.stress.starts`; "" for rest under the load.
    expected : str, or mapping of str to str
        One of EXPECTATIONS, for all methods or by method (those not named: PASSES).
    names : str
        The argument that a refusal must name.
    apart : mapping of str to str
        Methods of which this is not asked, and why.
    copy : bool
        Whether the motion is that of the operating point in another size or in a mirror.
    """

    name: str
    group: str
    asks: str
    scene: Mapping[str, float] = field(default_factory=dict)
    rig: Rig = PAPERS
    run: Mapping[str, Any] = field(default_factory=dict)
    edge: str = ""
    share: float = 1.0
    slips_at: float = 0.0
    start: str = ""
    expected: str | Mapping[str, str] = PASSES
    names: str = ""
    apart: Mapping[str, str] = field(default_factory=dict)
    copy: bool = False

    def expectation(self, method: str) -> str:
        """What is expected of a method."""
        if isinstance(self.expected, str):
            return self.expected
        return self.expected.get(method, PASSES)
