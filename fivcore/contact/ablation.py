"""Ablations: modifications of a reduced model, to measure what each part of the contact element is worth.

`fivcore.simulate` and `fivcore.critical_mu` apply `modify` to every reduced model, the onset's finer one included;
`functools.partial` sets parameters. A modification raises `SceneValueError` where the model has no element.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from fivcore import checks
from fivcore.contact.reduced import ReducedModel
from fivcore.errors import SceneValueError

Modify = Callable[[ReducedModel], ReducedModel]


@lru_cache(maxsize=64)
def modified(model: ReducedModel, modify: Modify | None) -> ReducedModel:
    """The model after `modify`, from a cache, so that scenes share it; None: the model itself."""
    return model if modify is None else modify(model)


def with_relaxation_time(model: ReducedModel, tau: float) -> ReducedModel:
    """Give the element the relaxation time `tau`, a number from 0 (elastic) to 1 s: C = tau K."""
    return replace(_with_element(model), C=checks.between("tau", tau, 0.0, 1.0, "s") * model.K)


def with_dashpot(model: ReducedModel, factor: float) -> ReducedModel:
    """Multiply the element's damping and relaxation time by `factor`, a number from 0 to 1e6."""
    return replace(_with_element(model), C=checks.between("factor", factor, 0.0, 1e6, "1") * model.C)


def without_cross_terms(model: ReducedModel) -> ReducedModel:
    """Uncouple the element's normal and tangential direction: its flexibility keeps its diagonal, C / K stays."""
    K = np.diag(1.0 / np.diag(np.linalg.inv(_with_element(model).K)))
    return replace(model, K=K, C=model.C[0, 0] / model.K[0, 0] * K)


def _with_element(model: ReducedModel) -> ReducedModel:
    if not model.K.any():
        raise SceneValueError(
            "modify: with termination 'none', or every mode kept, there is no element to modify; leave it out"
        )
    return model
