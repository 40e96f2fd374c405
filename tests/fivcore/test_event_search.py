"""Events of `exact`: short visits to a status, grazes, and what cannot be followed."""

import numpy as np
import pytest

from fivcore import ContactError, DivergenceError, Scene
from fivcore.transient.exact import DWELL, ExactRun
from fivcore.transient.exact_kernels import NOTHING, follow
from fivcore.transient.normalised import Normalised
from fivcore.transient.options import RunOptions
from fivcore.transient.statistics import SEPARATION, STICK

BUFFERS = np.empty((9, 7)), np.empty((9, 6)), np.empty((9, 2))


def made(V, theta, mu):
    """A run before its first step."""
    return ExactRun(
        Normalised.of(Scene(V, theta, mu, 9.0)), RunOptions(duration=1.0, method="exact", cutoff=75e3, settle=0.0)
    )


@pytest.mark.parametrize(("dip", "heeded"), [(1e-2, True), (1e-3, True), (-1e-3, False)])
def test_a_gap_that_closes_and_opens_between_two_readings_is_found(dip, heeded):
    """A mode whose motion closes the gap for sqrt(8 dip) / omega, while readings are a period apart."""
    run = made(0.02, 5.0, 0.2)
    model, n = run.model, len(run.model.stiffness)
    k = int(np.argmax(model.stiffness * (np.abs(model.normal) > 0.1 * np.abs(model.normal).max())))
    omega, size = np.sqrt(model.stiffness[k]), 1e-6
    shapes, damping = np.zeros_like(model.shapes), np.zeros(n)
    shapes[0, k] = size
    system = (model.stiffness, damping, shapes, model.inertia, model.output, model.K, model.C, 0.0 * model.K)
    motion = run.motion.copy()
    # With no force on the springs, the gap is size (1 - dip + cos omega t).
    motion[k], motion[2 * n] = 1.0, size * (1.0 - dip)
    event = follow(
        motion, SEPARATION, 0.0, 2.0 * np.pi / omega, True, (*system, run._law), np.zeros(3), run.zeros, 1.0,
        run.record, *BUFFERS,
    )  # fmt: skip
    assert (event > NOTHING) == heeded


def test_a_graze_on_the_tip_of_the_cone_is_held():
    """mu = 0: stick has no room at all, and what is found at once is acted on a dwell later."""
    run = made(0.02, 5.0, 0.0)
    run._go(1.5 * DWELL, *BUFFERS)
    assert run.held == 1
    assert run._origin == DWELL


def test_a_run_without_a_unique_contact_force_or_a_finite_state_is_an_error():
    with pytest.raises(ContactError, match="not unique"):
        made(0.01, 40.0, 30.0)
    run = made(0.02, 5.0, 0.2)
    with pytest.raises(DivergenceError, match="blown up at t = 0 s"):
        run.enter(0.0, STICK, np.full(2 * len(run.model.stiffness) + 2, np.nan))
