"""The published scheme: against finite elements stepped plainly, its limit of stability, its friction law."""

import re
from dataclasses import replace
from itertools import repeat

import numpy as np
import pytest

from fivcore import ContactError, Rig, Scene, State, critical_mu, simulate
from fivcore.contact.reduced import full_model
from fivcore.rig import P1, P2
from fivcore.transient.moving_contact import LEAST
from fivcore.transient.normalised import Normalised
from fivcore.transient.options import Options
from fivcore.transient.published import STEP, PaperRun, largest_step
from tests.helpers.small_systems import stepped
from tests.helpers.transient_reference import SEPARATION, SLIP, STICK, finite_elements, nodal, published_scheme

COARSE = Rig(replace(P1, elements=6), replace(P2, elements=10), contact_position=0.083)
# Rig, inclination, friction, load, how fast its modes move at the start, time step.
CASES = {
    "coarse": (COARSE, 5.0, 0.2, 4.0, 0.1, 1e-7),
    "coarse, leaning back": (COARSE, -20.0, 0.5, 4.0, 0.1, 1e-7),
    "the paper's mesh": (Rig(), 5.0, 0.2, 2.0, 0.3, STEP),
}


def lively(rig: Rig, theta: float, mu: float, F: float, speed: float, contact: int) -> State:
    """Modes below 60 kHz moving at random, from where such a contact is in equilibrium.

    Separated: P1 is lifted and falls. Stuck: the surfaces at rest. Slipping: bent by
    friction as in steady sliding, and lagging behind.
    """
    model = full_model(rig, theta)
    rng = np.random.default_rng(contact)
    q = F * model.rest
    low = model.stiffness < (2.0 * np.pi * 60e3) ** 2
    v = np.sqrt(1e-3) * speed * rng.standard_normal(len(q)) * low
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
    start = lively(rig, theta, mu, F, speed, contact)
    scene = Scene(2e-3, theta, mu, F, rig)
    given = {"ramp": 2e-5, "initial": start, "step": dt, "record": True, "sample_rate": 1.0 / dt}
    run = simulate(scene, steps * dt, "paper", **given)
    q, v = (nodal(rig, theta, part) for part in (start.displacement, start.velocity))
    plain = published_scheme(
        finite_elements(rig, theta), V=scene.V, mu=mu, F=F, ramp=2e-5, q=q, v=v,
        contact=contact, steps=steps, dt=dt,
    )  # fmt: skip
    same = run.state == plain.state
    agreed = len(same) if same.all() else int(np.argmin(same))
    switches = np.flatnonzero(np.diff(plain.state[:agreed])) + 1
    assert plain.state[0] == contact
    assert set(plain.state.tolist()) == {SEPARATION, STICK, SLIP}
    assert agreed >= 0.98 * len(same)
    assert len(switches) >= 6
    pairs = {
        "N": (run.normal_force, plain.N),
        "T": (run.tangential_force, plain.T),
        "slip velocity": (run.slip_velocity, plain.slip_velocity),
        "velocity of B": (run.velocity_B, plain.velocity_B),
    }
    for name, (modal, plainly) in pairs.items():
        error = np.abs(modal - plainly) / np.abs(plainly[:agreed]).max()
        assert error[: switches[5]].max() < 1e-9, name
        assert error[:agreed].max() < 3e-8, name
    q = F * nodal(rig, theta, displaced(scene, start, dt, steps))
    np.testing.assert_allclose(q, plain.q, rtol=0.0, atol=1e-10 * np.abs(plain.q).max())


def displaced(scene: Scene, start: State, dt: float, steps: int) -> np.ndarray:
    """Modal displacements after some steps, per newton of load."""
    initial = State(start.displacement / scene.F, start.velocity / scene.F, start.contact)
    options = Options(steps * dt, "paper", ramp=2e-5, initial=initial, step=dt)
    run = PaperRun(Normalised.of(scene), options)
    assert run.steps == steps
    while not run.done:
        PaperRun.advance([run])
    return run._q


def test_at_rest_it_stays_at_rest():
    """A drive of 1e-11 m/s is none; what is left is rounding of a contact held by positions."""
    run = simulate(Scene(1e-11, 5.0, 0.2, 9.0), 2e-3, "paper", record=True, sample_rate=1e6)
    assert np.all(run.state == STICK)
    np.testing.assert_allclose(run.normal_force, 9.0, rtol=1e-7)
    assert np.abs(run.tangential_force).max() < 1e-6
    assert np.abs(run.velocity_B).max() < 1e-11


def test_mean_normal_force_is_the_load_on_a_coarse_mesh():
    run = simulate(Scene(5e-3, 5.0, 0.4, 9.0, COARSE), 0.6, "paper", settle=0.1, step=2e-7)
    assert run.summary["separation_fraction"] > 0.05
    assert run.summary["mean_normal_force"] == pytest.approx(9.0, rel=0.01)


def spectral_radius(k: float, c: float, dt: float, b: float) -> float:
    """Spectral radius of one free step on (q, v, a) of a mode."""
    q, star = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, dt * (1.0 - b)])
    a = -(k * q + c * star) / (1.0 + b * dt * c)
    v = star + b * dt * a
    return float(np.abs(np.linalg.eigvals(np.stack([q + dt * v + 0.5 * dt**2 * a, v, a]))).max())


@pytest.mark.parametrize(
    ("b", "damped", "limit"),
    [(0.8, False, 1.750e-8), (0.8, True, 2.165e-8), (0.5, False, 2.214e-8), (0.5, True, 2.214e-8)],
)
def test_the_largest_stable_step(b, damped, limit):
    """Newmark's closed form for beta = 0: (b / 2) z^2 - 2 zeta (b - 1/2) z = 1, z = omega dt.

    2e-8 s with beta2 = 0.8 is stable only by the stiffness damping.
    """
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


def test_a_contact_that_moves_to_where_it_is_not_unique_is_an_error():
    """Between two nodes of P2 the contact closes less than at a node."""
    start, end = (critical_mu(Rig(contact_position=place), 5.0, "paper") for place in (0.0801, 0.08))
    scene = Scene(0.1, 5.0, 32.1, 9.0, Rig(contact_position=0.0801))
    assert end < scene.mu < start
    with pytest.raises(
        ContactError, match=r"mu = 32\.1: from 32\.0\d* on .* with the contact 0\.0800\d* m"
    ) as caught:
        simulate(scene, 2e-3, "paper", contact_motion=-1)
    place = float(re.search(r"contact (\S*) m", str(caught.value))[1])
    assert critical_mu(Rig(contact_position=place), 5.0, "paper") <= scene.mu
    assert critical_mu(Rig(contact_position=place + 2.0 * LEAST), 5.0, "paper") > scene.mu


@pytest.mark.parametrize("r", [0.2, 0.02, 0.002])
def test_after_a_step_in_N_friction_relaxes_to_mu_N(r):
    """Prakash-Clifton, simplified: by 1 / (1 + r) a step, exp(-t / tau) to r / 2 of the exponent."""
    mu, dt = 0.3, 1e-6
    # A block of unit mass on a belt that runs ahead of it; the load has just grown from 1 to 2.
    rows, _ = stepped(
        [0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-2.0, 0.0],
        mu=mu, dt=dt, tau=dt / r, steps=int(12.0 / r), q=[0.0, 0.0], v=[0.0, 0.0], V=1.0, last_T=mu, held=True,
    )  # fmt: skip
    N, T, state = rows[:, 2], rows[:, 3], rows[:, 5]
    assert np.all(state == SLIP)
    np.testing.assert_allclose(N, 2.0, rtol=1e-9)
    steps = np.arange(1, len(T) + 1)
    np.testing.assert_allclose(2.0 * mu - T, mu * (1.0 + r) ** -steps, rtol=0.0, atol=1e-10)
    within = steps * r < 3.0
    np.testing.assert_allclose(np.log(2.0 - T[within] / mu), -steps[within] * r, rtol=0.5 * r, atol=1e-8)
