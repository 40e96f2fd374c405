"""Reduced models with a part of the contact model changed or left out, to measure the effect of that part.

`modify` of `fivcore.simulate` applies one of these functions to each reduced model, also to the finer model of the
onset.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fivcore import ReducedModel, SceneValueError, checks


def with_dashpot(model: ReducedModel, factor: float) -> ReducedModel:
    """Multiply the dashpot and with it the relaxation time by `factor`, from 0 (elastic) to 1e6."""
    return replace(_flexible(model), C=checks.between("factor", factor, 0.0, 1e6, "1") * model.C)


def without_cross_terms(model: ReducedModel) -> ReducedModel:
    """Uncouple normal and tangential direction: the residual flexibility keeps its diagonal, and C / K stays."""
    K = np.diag(1.0 / np.diag(np.linalg.inv(_flexible(model).K)))
    return replace(model, K=K, C=model.C[0, 0] / model.K[0, 0] * K)


def truncated(model: ReducedModel) -> ReducedModel:
    """Leave out the residual flexibility, so that the kept modes touch rigidly."""
    return replace(_flexible(model), K=np.zeros((2, 2)), C=np.zeros((2, 2)))


def _flexible(model: ReducedModel) -> ReducedModel:
    if not model.K.any():
        raise SceneValueError("modify: every mode is kept, so there is no residual flexibility; leave it out")
    return model
