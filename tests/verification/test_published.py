"""The published scheme against finite elements stepped plainly, and its limit of stability."""

from itertools import repeat

import numpy as np
import pytest

from fivcore import Rig, Scene, State, simulate
from fivcore.contact.reduced import full_model
from fivcore.transient.normalised import Normalised
from fivcore.transient.options import RunOptions
from fivcore.transient.published import PAPER_STEP, PaperRun, largest_step
from tests.helpers.transient_reference import SEPARATION, SLIP, STICK, finite_elements, nodal, published_scheme
from tests.known import COARSE, LARGEST_STEPS

# Rig, inclination, friction, load, how fast its modes move at the start, time step.
CASES = {
    "coarse, leaning back": (COARSE, -20.0, 0.5, 4.0, 0.1, 1e-7),
    "the paper's mesh": (Rig(), 5.0, 0.2, 2.0, 0.3, PAPER_STEP),
}


def lively(rig, theta, mu, F, speed, contact):
    """Modes below 60 kHz moving at random; P1 falls, rests, or is bent by friction and lags behind."""
    model = full_model(rig, theta)
    # Whatever the signs of the modes.
    rng, sign = np.random.default_rng((contact, 1)), np.copysign(1.0, model.normal + model.tangential)
    q = F * model.static_equilibrium
    low = model.stiffness < (2.0 * np.pi * 60e3) ** 2
    v = np.sqrt(1e-3) * speed * sign * rng.standard_normal(len(q)) * low
    if contact == SEPARATION:
        q[0] += 2e-7 / model.normal[0]
        v[0] -= 0.3 / model.normal[0]
    elif contact == STICK:
        rows = np.stack([model.normal * low, model.tangential * low])
        v -= rows.T @ np.linalg.solve(rows @ rows.T, rows @ v)
    else:
        bent = mu * F * model.tangential[1:] / model.stiffness[1:]
        q[1:] += bent
        q[0] -= model.normal[1:] @ bent / model.normal[0]
        tip = model.tangential * low
        v -= 2.0 * speed * tip / (tip @ tip)
        v[0] -= (model.normal @ v) / model.normal[0]
    return State(q, v, contact)


@pytest.mark.parametrize("contact", [SEPARATION, STICK, SLIP])
@pytest.mark.parametrize("case", CASES)
def test_modes_move_as_the_finite_elements_do(case, contact):
    """N, T and velocities to 1e-9 up to the sixth switch; then what is left of 16 digits grows with every impact.

    Finite elements cost digits too: in their coordinates the two bases' modes are orthogonal to 5e-10.
    """
    steps = 2500 if case == "the paper's mesh" and contact != SLIP else 5000
    rig, theta, mu, F, speed, dt = CASES[case]
    start, scene = lively(rig, theta, mu, F, speed, contact), Scene(2e-3, theta, mu, F, rig)
    given = {"ramp": 2e-5, "initial": start, "step": dt, "record": True, "sample_rate": 1.0 / dt}
    run = simulate(scene, steps * dt, "paper", **given)
    q, v = (nodal(rig, theta, part) for part in (start.displacement, start.velocity))
    plain = published_scheme(finite_elements(rig, theta), scene, 2e-5, q, v, contact, steps, dt)
    same = run.state == plain.state
    agreed = len(same) if same.all() else int(np.argmin(same))
    switches = np.flatnonzero(np.diff(plain.state[:agreed])) + 1
    assert plain.state[0] == contact
    assert set(plain.state.tolist()) == {SEPARATION, STICK, SLIP}
    assert agreed >= 0.98 * len(same)
    assert len(switches) >= 6
    for name in ("normal_force", "tangential_force", "slip_velocity", "velocity_B"):
        modal, plainly = getattr(run, name), getattr(plain, name)
        error = np.abs(modal - plainly) / np.abs(plainly[:agreed]).max()
        assert error[: switches[5]].max() < 1e-9, name
        assert error[:agreed].max() < 3e-8, name
    q = F * nodal(rig, theta, displaced(scene, start, dt, steps))
    np.testing.assert_allclose(q, plain.q, rtol=0.0, atol=1e-10 * np.abs(plain.q).max())


def displaced(scene, start, dt, steps):
    """Modal displacements after some steps, per newton of load."""
    initial = State(start.displacement / scene.F, start.velocity / scene.F, start.contact)
    run = PaperRun(
        Normalised.of(scene), RunOptions(duration=steps * dt, method="paper", ramp=2e-5, initial=initial, step=dt)
    )
    assert run.steps == steps
    while not run.done:
        run.advance()
    return run._q


def spectral_radius(k, c, dt, b):
    """Spectral radius of one free step on (q, v, a) of a mode."""
    q, star = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, dt * (1.0 - b)])
    a = -(k * q + c * star) / (1.0 + b * dt * c)
    v = star + b * dt * a
    return float(np.abs(np.linalg.eigvals(np.stack([q + dt * v + 0.5 * dt**2 * a, v, a]))).max())


@pytest.mark.parametrize(("b", "damped", "limit"), LARGEST_STEPS)
def test_the_largest_stable_step(b, damped, limit):
    """(b / 2) z^2 - 2 zeta (b - 1/2) z = 1, z = omega dt: 2e-8 s with beta2 = 0.8 needs the stiffness damping."""
    model = full_model(Rig(), 5.0)
    damping = model.damping if damped else 0.0 * model.damping
    found = largest_step(model.stiffness, damping, b)
    assert found == pytest.approx(limit, abs=0.5e-11)
    omega = float(np.sqrt(model.stiffness.max()))
    zeta = float(damping[np.argmax(model.stiffness)]) / (2.0 * omega)
    lever = zeta * (b - 0.5)
    assert omega * found == pytest.approx((lever + np.sqrt(b / 2.0 + lever**2)) / (b / 2.0), rel=1e-5)
    # No mode grows just below the limit, and the fastest one does just above it.
    assert max(map(spectral_radius, model.stiffness, damping, repeat(0.9999 * found), repeat(b))) < 1.0 + 1e-9
    assert max(map(spectral_radius, model.stiffness, damping, repeat(1.0001 * found), repeat(b))) > 1.0 + 1e-5
