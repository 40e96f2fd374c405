"""What a lasting force looks like in impulses, and what making up for it brings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fivcore import Rig
from fivcore.beams.modes import propagator
from fivcore.contact.impulse import SMALL, at_impulses, between_impulses
from fivcore.contact.reduced import reduced_model
from fivcore.transient.steady import steady_sliding

STEP = 2e-6


def sawtooth(omega, damping, step):
    """Of a unit force in impulses: deflection and mean velocity at one, and deflection midway to the next."""
    a, b, c, d = propagator(np.array([omega**2]), np.array([damping]), step)[:, 0]
    flow = np.array([[a, b], [c, d]], dtype=np.longdouble)
    # x = flow (x + kick), by hand: there is no solver in this precision.
    kicked = flow @ np.array([0.0, step], dtype=np.longdouble)
    m = np.eye(2) - flow
    q = (m[1, 1] * kicked[0] - m[0, 1] * kicked[1]) / (m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0])
    v = (m[0, 0] * kicked[1] - m[1, 0] * kicked[0]) / (m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0])
    half = propagator(np.array([omega**2]), np.array([damping]), 0.5 * step)[:, 0]
    return float(q), float(v + 0.5 * step), float(half[0] * q + half[1] * (v + step))


@given(st.floats(0.05, 2.5), st.floats(0.0, 1.0))
@settings(max_examples=60, deadline=None)
def test_what_impulses_miss_is_what_a_sawtooth_lacks(phase, decay):
    omega, damping = phase / STEP, decay / STEP
    q, rate, midway = sawtooth(omega, damping, STEP)
    defect, drift = (float(part[0]) for part in at_impulses(np.array([omega**2]), np.array([damping]), STEP))
    assert defect == pytest.approx(1.0 / omega**2 - q, rel=1e-8, abs=1e-12 / omega**2)
    assert drift == pytest.approx(rate, rel=1e-8, abs=1e-12 * STEP)
    if decay == 0.0:
        assert float(between_impulses(np.array([omega**2]), STEP)[0]) == pytest.approx(
            midway - 1.0 / omega**2, rel=1e-8
        )


@pytest.mark.parametrize("decay", [0.0, 0.01, 0.3])
def test_slow_modes_miss_a_twelfth_and_the_series_joins(decay):
    omegas = np.array([0.0, 1e-6, 1.0 - 1e-9, 1.0 + 1e-9]) * SMALL / STEP
    defect, drift = at_impulses(omegas**2, np.full(4, decay / STEP), STEP)
    assert defect == pytest.approx(STEP**2 / 12.0, rel=1e-4 + 0.02 * decay**2)
    assert defect[2] == pytest.approx(defect[3], rel=1e-5)
    assert drift[2] == pytest.approx(drift[3], rel=1e-5, abs=1e-14)
    assert drift == pytest.approx(decay * STEP / 12.0, rel=1e-4 + 0.02 * decay**2, abs=1e-14)


def test_growth_near_the_onset_is_right_in_steps_of_two_microseconds():
    """At mu = 0.11 a mode at 55 kHz decays by 529 1/s; taken for lasting, impulses let it grow."""
    model, mu = reduced_model(Rig(), 5.0), 0.11
    finest, coarse, half = (steady_sliding(model, mu, step).eigenvalues for step in (0.02e-6, 2e-6, 1e-6))
    near = finest[np.abs(finest.imag / (2.0 * np.pi) - 55.3e3) < 2e3]
    true = near[np.argmax(near.real)]
    assert true.real == pytest.approx(-528.6, abs=1.0)
    errors = [abs(found[np.abs(found - true).argmin()].real - true.real) for found in (coarse, half)]
    assert errors[0] < 6.0
    assert errors[1] < 0.35 * errors[0]
