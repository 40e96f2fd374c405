"""What a lasting force looks like in impulses, and what making up for it brings."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fivcore import Rig, Scene, simulate
from fivcore.beams.free_motion import propagator
from fivcore.contact.impulse import SMALL, at_impulses, between_impulses
from fivcore.contact.law import regime_maps
from fivcore.contact.reduced import default_cutoff, reduced_model
from fivcore.transient.published import ADDED_DAMPING
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


def without(model, mu, step):
    """Eigenvalues of slip in impulses that are taken for a lasting force, 1/s."""
    half = 0.5 * step * model.W
    slip = regime_maps(model.K, model.C, half, mu, step).slip
    n, t, size = model.normal, model.tangential, len(model.normal)
    inputs = np.zeros((3, 2 * size + 1))
    inputs[0, :size], inputs[1, -1], inputs[2, size:-1] = -n, 1.0, n
    kick, flow = np.eye(2 * size + 1), np.eye(2 * size + 1)
    kick[size:-1] += step * np.outer(n + mu * t, slip[0][0] @ inputs)
    kick[-1] = slip[0][1] @ inputs
    a, b, c, d = (np.diag(row) for row in propagator(model.stiffness, model.damping, step))
    flow[:-1, :-1] = np.block([[a, b], [c, d]])
    return np.log(np.linalg.eigvals(flow @ kick).astype(complex)) / step


def test_growth_near_the_onset_is_right_in_steps_of_two_microseconds():
    """At mu = 0.11 a mode at 55 kHz decays by 69 1/s; impulses taken for a lasting force let it grow."""
    model, mu = reduced_model(Rig(), 5.0), 0.11
    finest = steady_sliding(model, mu, 0.02e-6).eigenvalues
    near = finest[np.abs(finest.imag / (2.0 * np.pi) - 55.3e3) < 2e3]
    true = near[np.argmax(near.real)]
    assert true.real == pytest.approx(-69.0, abs=1.0)
    errors = {}
    for step in (2e-6, 1e-6):
        ours, others = steady_sliding(model, mu, step).eigenvalues, without(model, mu, step)
        errors[step] = [abs(found[np.abs(found - true).argmin()].real - true.real) for found in (ours, others)]
    assert errors[2e-6][0] < 6.0
    assert errors[2e-6][1] > 800.0
    assert errors[1e-6][0] < 0.35 * errors[2e-6][0]


def test_what_grows_after_a_gentle_end_of_stick_does_not_depend_on_the_step():
    """With all that matters above the cut-off: as many changes of state, and a vibration of the same size."""
    rig = replace(Rig(), d2=Rig().d2 + ADDED_DAMPING)
    asked = {"cutoff": 5.0 * default_cutoff(rig), "ramp": 1e-2, "record": True}
    changes, sizes = [], []
    for step in (0.4e-6, 0.1e-6):
        run = simulate(Scene(5e-3, 5.0, 0.2, 9.0, rig), 34.4e-3, step=step, sample_rate=1.0 / step, **asked)
        changes.append(np.count_nonzero(np.diff(run.state)))
        left = run.time - run.summary["first_slip_time"]
        sizes.append(np.ptp(run.normal_force[(left > 0.3e-3) & (left < 0.4e-3)]))
    assert changes[0] == changes[1] < 10
    assert sizes[0] == pytest.approx(sizes[1], rel=0.01)
