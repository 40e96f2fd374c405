"""Rigid contact, of structures without compliance: one impact law for all methods, and starts from rest.

The impact takes the closing speed whole and slip by an impulse within the cone (J. J. Moreau, Unilateral contact
and dry friction in finite freedom dynamics, 1988, with restitution 0); T of `paper` relaxes after an impact,
by as much in all.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from fivcore import Friction, Rig, Scene, State, Structure, simulate
from fivcore.friction import COULOMB
from studies.physics.classical import block_of

SHARES = ("stick_fraction", "slip_fraction", "separation_fraction")
PIN = Structure.from_modes(
    [500.0, 800.0, 1700.0], [0.4, 0.1, 0.4], [-0.9, -0.7, -0.4], load=[-0.4, -0.1, 0.0], damping_ratio=0.002
)


def shares(motion):
    return np.array([motion.summary[name] for name in SHARES])


@pytest.mark.parametrize("method", ["fast", "exact", "paper"])
def test_a_mass_that_falls_on_rigid_contact_does_not_rebound(method):
    scene, fall = Scene(1e-9, 0.0, 0.3, 1e-6, block_of(10.0)), 1e-3
    start = State(np.array([fall, 0.0]), np.array([-1.0, 0.0]), 0, True)
    # A time between fall and end in which a rebound of one in a thousand would have come down no more.
    found = simulate(scene, 2.0 * fall, method, initial=start, step=fall / 500.0, settle=0.0).final_state
    assert abs(found.velocity[0]) < 1e-5
    assert found.contact != 0


@pytest.mark.parametrize(("slide", "after"), [(-1.0, -0.7), (0.1, 0.0)])
@pytest.mark.parametrize("method", ["fast", "exact", "paper"])
def test_a_mass_that_slides_as_it_falls_is_slowed_by_mu_or_stopped(method, slide, after):
    """The spring changes its speed by a hundredth of its way, 1e-4 of it."""
    scene, fall = Scene(1e-9, 0.0, 0.3, 1e-6, block_of(10.0)), 1e-3
    start = State(np.array([fall, 0.0]), np.array([-1.0, slide]), 0, True)
    found = simulate(scene, 2.0 * fall, method, initial=start, step=fall / 500.0, settle=0.0).final_state
    assert found.velocity == pytest.approx([0.0, after], abs=3e-4)


def test_shares_of_paper_converge_to_those_of_exact():
    """Its T relaxes within five steps, whatever they are."""
    scene = Scene(2e-2, 0.0, 0.3, 50.0, PIN)
    exact = shares(simulate(scene, 0.6, "exact", settle=0.1))
    coarse, fine = (
        np.abs(shares(simulate(scene, 0.6, "paper", settle=0.1, step=h)) - exact).max() for h in (8e-6, 5e-7)
    )
    assert fine < 0.02
    assert coarse > 2.0 * fine


def test_every_mode_of_a_coarse_rig_moves_alike_by_both_methods():
    scene = Scene(2e-3, 5.0, 0.2, 9.0, Rig.of(p1_elements=4, p2_elements=6))
    exact, fast = (simulate(scene, 0.08, method, cutoff=1e9).summary for method in ("exact", "fast"))
    assert exact["energy_residual"] < 1e-10
    assert exact["first_slip_time"] == pytest.approx(fast["first_slip_time"], rel=2e-4)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(("method", "error"), [("exact", 1e-9), ("fast", 2e-3)])
def test_an_impact_has_restitution_zero_and_an_impulse_within_the_cone(method, error, seed):
    rng = np.random.default_rng(seed)
    normal, tangential = rng.uniform(0.5, 1.0, 3) * [1, 1, -1], rng.normal(size=3)
    # Modes far slower than the impact, one of them rigid.
    own = Structure.from_modes(np.linspace(0.0, 1e-3, 3), normal, tangential, load=-normal)
    shapes = np.stack([normal, tangential])
    W = shapes @ shapes.T
    mu = rng.uniform(0.1, 0.9) * min(abs(W[0, 0] / W[0, 1]), 1.0)
    before = rng.normal(size=3)
    before -= normal * (normal @ before + 1.0) / W[0, 0]
    N, T = -np.linalg.solve(W, shapes @ before)
    if abs(T) > mu * N:
        m = np.copysign(mu, T)
        N = 1.0 / (W[0, 0] + m * W[0, 1])
        T = m * N
    after, fall = before + normal * N + tangential * T, 1e-3
    start = State(fall * normal / W[0, 0], before, 0, True)
    scene = Scene(1e-9, 0.0, mu, 1e-6, own)
    found = simulate(scene, 1.5 * fall, method, initial=start, step=fall / 1000.0, settle=0.0).final_state
    assert found.velocity == pytest.approx(after, abs=error * np.abs(before).max())


def test_shares_of_fast_converge_to_those_of_exact():
    scene = Scene(2e-2, 0.0, 0.3, 50.0, PIN)
    exact = shares(simulate(scene, 0.6, "exact", settle=0.1))
    coarse, fine = (np.abs(shares(simulate(scene, 0.6, settle=0.1, step=h)) - exact).max() for h in (2e-6, 5e-7))
    assert fine < 0.003
    assert coarse < 0.01


def small(seed):
    """A scene of 2 to 4 modes, every other with a rigid motion, and three laws of friction."""
    rng = np.random.default_rng(seed)
    n = 2 + seed % 3
    frequency = np.sort(10.0 ** rng.uniform(1.5, 3.0, n))
    frequency[0] *= seed % 2
    normal, tangential = rng.uniform(-1.0, 1.0, (2, n))
    own = Structure.from_modes(
        frequency, normal, tangential, load=-normal * rng.uniform(0.5, 2.0), damping_ratio=0.01
    )
    law = (COULOMB, Friction(0.7, 0.0), Friction(0.6, 0.1))[seed // 3 % 3]
    W = np.abs(np.stack([normal, tangential]) @ np.stack([normal, tangential]).T)
    mu = rng.uniform(0.2, 0.8) * min(W[0, 0] / W[0, 1], 1.0)
    return Scene(10.0 ** rng.uniform(-2.5, -1.5) * (1 - 2 * (seed % 2)), 0.0, mu, 10.0, own, law)


METHODS = (("exact", {}), ("fast", {"step": 1e-6}))


@pytest.mark.parametrize("seed", range(18))
def test_small_structures_move_alike_by_both_methods(seed):
    scene = small(seed)
    one, other = (simulate(scene, 0.05, method, settle=0.0, **given) for method, given in METHODS)
    assert one.summary["energy_residual"] < 1e-10
    assert shares(one) == pytest.approx(shares(other), abs=5e-3)


def test_energy_is_in_balance_over_impacts():
    for mu, law in ((0.3, COULOMB), (0.4, Friction(0.8, 0.0)), (0.4, Friction(0.8, 0.02))):
        found = simulate(Scene(2e-2, 0.0, mu, 50.0, PIN, law), 0.2, "exact", settle=0.0)
        assert found.summary["separation_fraction"] > 0.1
        assert found.summary["energy_residual"] < 1e-10


@pytest.mark.parametrize("method", ["fast", "exact"])
@pytest.mark.parametrize(
    ("normal", "tangential"), [([1.0], [0.5]), ([1.0, 0.5], [2.0, 1.0]), ([1, 2, 3], [-2, -4, -6])]
)
def test_parallel_directions_are_one_clear_line(method, normal, tangential):
    frequency = 100.0 * np.arange(1, len(normal) + 1)
    own = Structure.from_modes(frequency, normal, tangential, load=-np.array(normal))
    with pytest.raises(ValueError, match=r"^normal, tangential: they are parallel over the modes"):
        simulate(Scene(1e-2, 0.0, 0.2, 1.0, own), 0.02, method)


# Starts from rest.


@pytest.mark.parametrize("scale", [1.0, 0.0])
@pytest.mark.parametrize("V", [1e-6, 1e-3, -1e-2])
def test_exact_starts_where_the_load_stores_nothing(V, scale):
    """With scale 1 the load presses at the contact alone."""
    load = np.array([-0.4, -0.1, -0.4]) * [1.0, 1.0, scale]
    exact, fast = (
        simulate(Scene(V, 0.0, 0.2, 10.0, replace(PIN, load=load)), 0.02, method, settle=0.0)
        for method in ("exact", "fast")
    )
    assert exact.summary["first_slip_time"] == pytest.approx(
        fast.summary["first_slip_time"], abs=1e-5, nan_ok=True
    )
    assert shares(exact) == pytest.approx(shares(fast), abs=0.02)


@pytest.mark.parametrize("seed", range(60))
def test_a_block_from_rest_is_caught_by_its_belt_when_the_closed_form_says(seed):
    """x = mu N / k (1 - cos omega t) while the belt is faster."""
    rng = np.random.default_rng(seed)
    omega, mu, N = 10.0 ** rng.uniform(-1.0, 5.0), rng.uniform(0.05, 1.0), 10.0 ** rng.uniform(-3.0, 3.0)
    V = mu * N / omega * 10.0 ** rng.uniform(-4.0, 0.5)
    found = simulate(
        Scene(V, 0.0, mu, N, block_of(omega)), 4.0 / omega, "exact", ramp=0.0, settle=0.0, step=0.01 / omega
    )
    slips = np.arcsin(min(V * omega / (mu * N), 1.0)) / omega
    expected = slips if V * omega < mu * N else 4.0 / omega
    # From then on it moves with the belt until its spring is tight.
    tight = (mu * N / omega**2 * np.cos(omega * slips)) / V if V * omega < mu * N else 0.0
    assert found.summary["stick_fraction"] * 4.0 / omega == pytest.approx(
        min(max(4.0 / omega - expected, 0.0), tight) if tight else 0.0, rel=1e-2, abs=0.02 / omega
    )


def test_where_an_impact_may_end_in_stick_or_in_slip_it_slips_on():
    """Friction falls so fast that much less of it is left at the speed of slip than would be needed for stick."""
    law, mu, slide, fall = Friction(0.0, 0.05), 0.3, 0.25, 1e-3
    start = State(np.array([fall, 0.0]), np.array([-1.0, -slide]), 0, True)
    scene, given = Scene(1e-9, 0.0, mu, 1e-6, block_of(10.0), law), {"initial": start, "step": fall / 500.0}
    found = simulate(scene, 2.0 * fall, **given, settle=0.0).final_state
    after = brentq(lambda v: v - slide + mu * law.ratio(v), 0.5 * slide, slide)
    assert slide < mu
    assert found.velocity[1] == pytest.approx(-after, abs=1e-4)
