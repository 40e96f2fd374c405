"""What may be asked of a method's contact law beyond its defaults, and of which method.

They are for finding out what each part of a law is worth, not for daily use: the relaxation time of the element
(`fivcore.contact.reduced` derives it), the cross terms of its flexibility, and beta2 of the published scheme.
"""

from __future__ import annotations

from typing import Any

from fivcore import checks

METHODS = ("fast", "exact", "paper")


def switches(method: str, termination: str, relaxation_time: Any, cross_terms: Any, beta2: Any) -> dict[str, Any]:
    """Check them and return those that this method has; a default means that nothing was asked."""
    checks.instance("cross_terms", cross_terms, bool)
    if method == "paper":
        if relaxation_time is not None:
            raise ValueError(f"relaxation_time = {relaxation_time}: method 'paper' keeps all modes; leave it out")
        if not cross_terms:
            raise ValueError("cross_terms = False: method 'paper' keeps all modes; leave it out")
        return {} if beta2 is None else {"beta2": checks.number("beta2", beta2, _BETA2, lambda x: 0.5 <= x <= 1.0)}
    if beta2 is not None:
        raise ValueError(f"beta2 = {beta2}: method {method!r} has none, only 'paper'; leave it out")
    if relaxation_time is not None:
        relaxation_time = checks.between("relaxation_time", relaxation_time, 0.0, 1.0, "s")
        if method != "exact" and termination != "absorbing":
            text = f"relaxation_time = {relaxation_time:g}: termination {termination!r} has none; leave it out"
            raise ValueError(text)
    if method == "exact":
        require_absorbing(termination, relaxation_time)
    if not cross_terms and termination == "none":
        raise ValueError("cross_terms = False: termination 'none' has no element; leave it out")
    return {"relaxation_time": relaxation_time, "cross_terms": cross_terms}


def require_absorbing(termination: str, relaxation_time: float | None) -> None:
    """Refuse for method "exact" what asks for another element than the absorbing one."""
    if termination != "absorbing":
        raise ValueError(
            f"termination = {termination!r}: method 'exact' needs the absorbing element; use method 'fast'"
        )
    if relaxation_time == 0.0:
        raise ValueError("relaxation_time = 0: method 'exact' needs a time above 0; use method 'fast'")


# Below 0.5 every mode grows.
_BETA2 = "a number from 0.5 to 1"
