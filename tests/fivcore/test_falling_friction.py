"""Friction that depends on the slip rate, in the methods that take steps."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from fivcore import Friction, Scene, State, Structure, simulate
from fivcore.contact.law import DiscreteContact
from fivcore.contact.reduced import default_cutoff, reduced_model
from fivcore.contact.step_map import step_map
from fivcore.friction import COULOMB, friction_ratio, slip_speed
from fivcore.transient.fast.kernel import falling
from fivcore.transient.fast.steady import eigenvalues

BLOCK = Structure.from_modes([0.0, 0.5 / np.pi], [1.0, 0.0], [0.0, 1.0], load=[-1.0, 0.0])
DAMPED = Structure.from_modes(
    [0.0, 0.5 / np.pi], [1.0, 0.0], [0.0, 1.0], load=[-1.0, 0.0], damping_ratio=[0.0, 0.05]
)
PAPERS = Scene(5e-3, 5.0, 0.2, 9.0)
LAWS = [Friction(0.5, 0.02), Friction(0.7, 0.01, "rational"), Friction(0.8, 0.0)]


@pytest.mark.parametrize("law", [Friction(0.3, 0.5), Friction(0.0, 0.2, "rational")], ids=lambda law: law.decay)
def test_ratio_falls_from_one_to_the_kinetic_ratio(law: Friction) -> None:
    speeds, h = np.array([0.0, 0.1, 1.0, 10.0]), 1e-6
    values = [law.ratio(v) for v in speeds]
    assert values[0] == 1.0
    assert np.all(np.diff(values) < 0.0)
    assert law.ratio(1e9) == pytest.approx(law.kinetic_ratio, abs=1e-8)
    for v in speeds[1:]:
        assert law.slope(v) == pytest.approx((law.ratio(v + h) - law.ratio(v - h)) / (2.0 * h), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"kinetic_ratio": 1.1}, "kinetic_ratio = 1.1: it must be a number from 0 to 1"),
        ({"decay_speed": -1.0}, "decay_speed = -1.0: it must be 0 or a speed"),
        ({"decay": "linear"}, "decay = 'linear': it must be one of exponential, rational"),
    ],
)
def test_a_wrong_law_is_named(wrong: dict[str, object], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        Friction(**wrong)  # type: ignore[arg-type]


def test_a_scene_takes_a_friction_only() -> None:
    with pytest.raises(ValueError, match=r"friction = 0\.5: it must be a Friction"):
        Scene(1e-3, 5.0, 0.2, 9.0, friction=0.5)  # type: ignore[arg-type]


def left_over(law: Any, numbers: Any, v: float) -> float:
    """What v is more than the slip speed that its own friction leaves."""
    ahead, S, alpha, beta, gamma, mu = numbers
    m = mu * friction_ratio(v, *law)[0]
    return float(v - ahead + S * m * alpha / (beta - gamma * m))


def test_slip_speed_is_the_largest_root() -> None:
    rng, found_by_signs = np.random.default_rng(1), 0
    for _ in range(300):
        law = float(rng.uniform(0.0, 0.9)), float(10.0 ** rng.uniform(-2.0, 0.0)), float(rng.integers(2))
        ahead, S, alpha, mu = rng.uniform(-0.5, 2.0), 10.0 ** rng.uniform(-2.0, 0.0), 1.0, rng.uniform(0.1, 1.0)
        beta, gamma = 1.0, rng.uniform(-0.3, 0.3)

        excess = partial(left_over, law, (ahead, S, alpha, beta, gamma, mu))
        trial = np.linspace(0.0, max(ahead, 0.0), 1001)
        signs = np.sign([excess(v) for v in trial])
        crossed = np.flatnonzero((signs[:-1] < 0.0) & (signs[1:] >= 0.0))
        found, ratio = slip_speed(rng.uniform(0.0, 3.0), ahead, S, alpha, beta, gamma, mu, law)
        assert ratio == pytest.approx(friction_ratio(max(found, 0.0), *law)[0], rel=1e-14)
        if len(crossed):
            root = brentq(excess, trial[crossed[-1]], trial[crossed[-1] + 1], xtol=1e-14, rtol=1e-14)
            assert found == pytest.approx(root, rel=1e-9, abs=1e-12)
            found_by_signs += 1
        elif not np.any(signs == 0.0):
            assert found < 0.0 or abs(excess(found)) < 1e-9
    assert found_by_signs > 100


def test_deviations_from_sliding_follow_the_falling_law() -> None:
    """Without a fall the map is that of constant friction; eigenvalues converge with the square of the step."""
    model = reduced_model(PAPERS.rig, 5.0)
    step = model.default_step
    constant, nearly = (step_map(model, step, 0.2, fall).matrix for fall in (0.0, 1e-300))
    np.testing.assert_allclose(nearly, constant, rtol=1e-7, atol=1e-9 * np.abs(constant).max())

    def lowest(part: float) -> np.ndarray:
        z = eigenvalues(model, 0.15, part * step, 3.0)
        z = z[(z.imag > 0.0) & (z.imag < 2.0 * np.pi * 10e3)]
        return z[np.argsort(z.imag)]

    coarse, half, fine = (lowest(part) for part in (1.0, 0.5, 0.25))
    ratio = np.abs(coarse - half) / np.abs(half - fine)
    assert np.median(ratio) == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("law", LAWS[:2], ids=lambda law: law.decay)
def test_order_is_two_in_slip(law: Friction) -> None:
    own, start, end = replace(law, decay_speed=0.5), State(np.array([0.0, 0.3]), np.zeros(2), 2), 3.0
    scene = Scene(1.5, 0.0, 0.4, 1.0, DAMPED, own)

    def rate(t: float, y: np.ndarray) -> list[float]:
        return [y[1], -y[0] - 0.1 * y[1] + 0.4 * own.ratio(1.5 - y[1])]

    reference = solve_ivp(rate, (0.0, end), [0.3, 0.0], method="DOP853", rtol=1e-12, atol=1e-14, dense_output=True)
    errors = []
    for step in (0.04, 0.02, 0.01):
        run = simulate(scene, end, ramp=0.0, step=step, initial=start, record=True, sample_rate=None)
        assert np.all(run.state == 2)
        at_ends = 0.3 + step * np.cumsum(run.velocity_B)
        errors.append(np.abs(at_ends - reference.sol(run.time + 0.5 * step)[0]).max())
    assert np.array(errors[:-1]) / errors[1:] == pytest.approx([4.0, 4.0], rel=0.1)


@pytest.mark.parametrize("law", [COULOMB, Friction(0.5, 0.0), Friction(0.0, 1.0 / 3.0, "rational")], ids=repr)
def test_rigid_stick_after_slip_does_not_alternate(law: Friction) -> None:
    """A block on a belt: in stick T is the force of the spring, and slip begins where that is mu N."""
    step, start = 0.01, State(np.array([0.0, 0.2]), np.array([0.0, -0.5]), 2)
    run = simulate(
        Scene(0.2, 0.0, 1.0, 1.0, BLOCK, law),
        12.0,
        ramp=0.0,
        step=step,
        initial=start,
        record=True,
        sample_rate=None,
    )
    x = 0.2 + step * np.cumsum(run.velocity_B) - 0.5 * step * run.velocity_B
    stuck = run.state == 1
    stuck[1:] &= run.state[:-1] == 1
    stuck[2:] &= run.state[:-2] == 1
    assert stuck.sum() > 200
    assert np.abs(run.tangential_force - x)[stuck].max() < 0.01
    assert np.abs(run.normal_force - 1.0)[stuck].max() < 1e-12
    slips = np.flatnonzero((run.state[1:] == 2) & (run.state[:-1] == 1)) + 1
    assert np.all(np.abs(np.abs(x[slips]) - 1.0) < 0.01)


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_energy_balances_and_pauses_change_no_bit(law: Friction) -> None:
    scene = replace(PAPERS, friction=law)
    run, recorded = simulate(scene, 0.2), simulate(scene, 0.2, record=True)
    assert run.summary["energy_residual"] < 5e-3
    for name, value in run.summary.items():
        np.testing.assert_array_equal(value, recorded.summary[name], err_msg=name)


@pytest.mark.parametrize("method", ["fast", "paper"])
def test_speed_load_and_decay_speed_scale_together(method: str) -> None:
    scene, duration = replace(PAPERS, friction=LAWS[0]), 0.1 if method == "fast" else 2e-3
    larger = replace(scene, V=4.0 * scene.V, F=4.0 * scene.F, friction=replace(LAWS[0], decay_speed=0.08))
    one, other = (simulate(each, duration, method, record=True, sample_rate=None) for each in (scene, larger))
    np.testing.assert_array_equal(one.state, other.state)
    np.testing.assert_array_equal(4.0 * one.velocity_B, other.velocity_B)
    np.testing.assert_array_equal(4.0 * one.tangential_force, other.tangential_force)


def test_the_published_scheme_slips_alike() -> None:
    """In the first .6 ms of slip, where constant friction would give another force."""
    scene, t = replace(PAPERS, friction=LAWS[0]), np.linspace(0.0294, 0.03, 7)
    how = {"record": True, "numerical_damping": "none", "sample_times": t}
    fast, constant = (simulate(each, 0.03, **how) for each in (scene, PAPERS))
    paper = simulate(scene, 0.03, "paper", **how)
    assert paper.summary["first_slip_time"] == pytest.approx(fast.summary["first_slip_time"], rel=1e-4)
    assert np.all(paper.state == 2)
    assert np.abs(paper.tangential_force - fast.tangential_force).max() < 0.01
    assert np.abs(paper.tangential_force - constant.tangential_force).max() > 0.5


def test_a_law_that_falls_too_steeply_is_refused() -> None:
    with pytest.raises(ValueError, match=r"decay_speed = 0\.001: .* it must be at least 0\.00\d+ m/s, or 0"):
        simulate(replace(PAPERS, friction=Friction(0.5, 0.001)), 0.01)
    steep = Scene(0.1, 0.0, 1.0, 1.0, BLOCK, Friction(0.0, 0.01))
    with pytest.raises(ValueError, match=r"step = 0\.1: .* it must be at most (0\.0\d+)") as refused:
        simulate(steep, 10.0, step=0.1)
    simulate(steep, 10.0, step=float(str(refused.value).partition("at most ")[2].split()[0]))


def test_fast_converges_to_exact_with_second_order() -> None:
    """The paper's rig in the first 1.6 ms of slip."""
    scene = replace(PAPERS, V=0.02, friction=Friction(0.5, 0.2))
    model = reduced_model(scene.rig, 5.0)
    how = {"record": True, "cutoff": default_cutoff(scene.rig)}
    exact = simulate(scene, 0.0095, "exact", step=model.default_step, sample_rate=None, **how)
    assert exact.summary["energy_residual"] < 1e-10
    errors = []
    for part in (2.0, 4.0, 8.0):
        fast = simulate(scene, 0.0095, step=model.default_step / part, sample_times=exact.time, **how)
        errors.append(float(np.sqrt(np.mean((fast.tangential_force - exact.tangential_force) ** 2))))
    assert errors[0] < 1e-3
    assert errors[0] / errors[2] > 12.0


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_forces_of_a_step_in_slip_have_the_friction_of_its_mean_speed(way: float) -> None:
    """As the equations of a step say it, with normal and tangential motion coupled."""
    contact = DiscreteContact(np.array([[1.0, 0.2], [0.2, 0.8]]), 0.05, np.array([[0.5, -0.1], [-0.1, 0.4]]), 0.02)
    slip, law, mu, (p, u, vN, vT) = contact.slip, (0.3, 0.5, 0.0), 0.4, (1.0, 0.1, -0.2, -8.0 * way)
    scene = SimpleNamespace(slip=np.array(slip), mu=mu)
    v, N, T, end = falling(scene, law, p, u, vN, vT, way, 0.0)
    rate = vT - slip.relaxing * u + slip.rate_N * N + slip.rate_T * T
    assert -way * rate == pytest.approx(v, rel=1e-10)
    assert pytest.approx(way * mu * friction_ratio(v, *law)[0] * N, rel=1e-10) == T
    assert N * (slip.beta - T / N * slip.gamma) == pytest.approx(slip.by_p * p + slip.by_v * vN, rel=1e-10)
    assert end == pytest.approx(slip.decay * u + slip.end_N * N + slip.end_T * T, rel=1e-10)
