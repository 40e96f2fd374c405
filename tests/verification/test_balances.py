"""Balances: energy in every kind of scene, and a mean contact force that equals the load."""

from dataclasses import replace

import numpy as np
import pytest

from fivcore import Rig, Scene, simulate
from fivcore.contact.reduced import full_model
from fivcore.rig import P2
from fivcore.transient.normalised import Normalised, State, reference_energy
from studies.accuracy.rigs import drawn_scene
from tests.known import COARSE

# Largest residuals, as fivcore/README.md has them, and longest runs of a kind, s.
BOUNDS = {"fast": 0.05, "exact": 1e-9, "paper": 0.18}
LONGEST = {"fast": 0.3, "exact": 3e-3, "paper": 1.5e-3}
PAPERS = Scene(2e-3, 5.0, 0.2, 9.0)
SOFT = Rig.of(p1_young_modulus=1.85e9, p2_young_modulus=1.85e9)


def started(scene, rng, contact):
    """At rest under the load but for random velocities of the slowest modes, and open by 1 um in separation."""
    full = full_model(scene.rig, scene.theta)
    q, slow = scene.F * full.static_equilibrium, full.stiffness < (2e4 * np.pi) ** 2
    v = np.where(slow, rng.normal(size=len(q)), 0.0)
    rigid = int(np.argmin(full.stiffness))
    q[rigid] += 1e-6 / full.normal[rigid] * (contact == 0)
    # Unless it is open the gap neither opens nor closes.
    v[rigid] = (v[rigid] - (full.normal @ v) / full.normal[rigid]) * (contact != 0)
    return State(q, 1e-4 * v, contact)


def kinds():
    """Kind, scene, duration and options of 60 runs: the paper's rig and others in turns."""
    rng, runs = np.random.default_rng(20), []
    for number in range(6):
        scene = drawn_scene(2010, number) if number % 2 else PAPERS

        def to(low, high):
            return float(10.0 ** rng.uniform(low, high))

        runs += [
            ("no friction", replace(scene, mu=0.0, V=to(-7, 1)), 0.02, {}),
            ("no friction, brief", replace(scene, mu=0.0, V=to(-5, 1)), to(-6, -3), {}),
            ("hardly moved", replace(scene, V=to(-9, -6)), 0.02, {}),
            ("stuck", replace(scene, V=to(-6, -5), mu=0.5), 0.1, {}),
            ("within the ramp", replace(scene, V=to(-4, 0)), to(-5, -3), {}),
            ("jerked", replace(scene, V=to(-4, 0)), to(-6, -3), {"ramp": 0.0}),
            ("sliding", replace(scene, theta=-5.0, mu=0.05, V=to(-3, -1)), 0.3, {}),
            ("vibrating", scene, 0.1, {}),
            ("fast drive", replace(scene, V=to(0, 2)), 5e-3, {}),
            ("started", scene, to(-5, -2), {"initial": started(scene, rng, number % 3)}),
        ]
    return runs


FEW = [("fast", 60), ("exact", 20), ("paper", 20)]
FEW += [pytest.param(name, 60, marks=pytest.mark.slow) for name in ("exact", "paper")]


@pytest.mark.parametrize(("method", "count"), FEW)
def test_energy_balances_in_every_kind_of_scene(method, count):
    found = {}
    for number, (kind, scene, duration, options) in enumerate(kinds()[:count]):
        short = min(duration, LONGEST[method])
        residual = simulate(scene, short, method, **options).summary["energy_residual"]
        found[f"{number} {kind}: {scene.V:.3g} m/s, {short:.3g} s"] = residual
    assert len(found) == count
    assert {name: value for name, value in found.items() if not value <= BOUNDS[method]} == {}


def test_the_residual_is_relative_to_what_turns_over_or_to_the_reference_energy():
    """A thousandth of what the load stores, P2's kinetic energy at the clamp's speed, and that of a start."""
    scene = Normalised.of(PAPERS)
    full = full_model(scene.rig, scene.theta)
    reference = reference_energy(scene, None)
    moving = 0.5 * scene.speed_per_load**2 * float(full.inertia @ full.inertia)
    assert reference == pytest.approx(0.5e-3 * float(full.stiffness @ full.static_equilibrium**2) + moving)
    # P2's kinetic energy is that of its mass, less the part next to the clamp.
    assert moving == pytest.approx(0.5 * P2.mass * scene.speed_per_load**2, rel=0.02)
    pushed = State(full.static_equilibrium, np.full(len(full.normal), 0.1), 1)
    assert reference_energy(scene, pushed) - reference == pytest.approx(0.005 * len(full.normal))
    # A run turns over more than that as soon as the drive loads the contact.
    force = simulate(PAPERS, 0.02, record=True).tangential_force
    assert abs(force[-1]) / 9.0 * scene.speed_per_load * 0.02 / 2.0 > reference


def test_the_accelerating_clamps_work_counts_in_a_run_that_ends_within_the_ramp():
    """On soft beams without friction it is all that the drive does; they have begun to move with the clamp."""
    for ramp in (1e-3, 5e-4):
        summary = simulate(Scene(5.0, 5.0, 0.0, 9.0, SOFT), 6e-4, ramp=ramp).summary
        assert summary["energy_residual"] < 1e-4
    assert simulate(replace(PAPERS, V=5e-3), 0.02, ramp=0.1).summary["energy_residual"] < 0.02


@pytest.mark.parametrize("duration", [5e-4, 3e-3])
@pytest.mark.parametrize(("method", "bound"), [("fast", 5e-3), ("exact", 1e-9)])
def test_the_work_of_the_clamp_counts_from_the_initial_state_on(method, bound, duration):
    scene = Scene(5.0, 5.0, 0.0, 9.0, SOFT)
    start, elastic = started(scene, np.random.default_rng(3), 2), full_model(SOFT, 5.0).stiffness > 0
    start = replace(start, displacement=start.displacement * np.where(elastic, 1.02, 1.0))
    assert simulate(scene, duration, method, initial=start).summary["energy_residual"] < bound


AT_5 = replace(PAPERS, V=5e-3)
MEANS = [
    (AT_5, "fast", 1.5, {}, 5e-3),
    (replace(AT_5, theta=-5.0), "fast", 1.5, {}, 5e-5),
    (Scene(5e-3, 5.0, 0.4, 9.0, COARSE), "paper", 0.6, {"settle": 0.1, "step": 2e-7}, 0.01),
    (drawn_scene(2010, 3), "fast", 1.5, {}, 5e-3),
]


@pytest.mark.parametrize(("scene", "method", "duration", "given", "error"), MEANS)
def test_the_mean_contact_force_equals_the_load(scene, method, duration, given, error):
    summary = simulate(scene, duration, method, **given).summary
    assert summary["mean_normal_force"] == pytest.approx(scene.F, rel=error)


@pytest.mark.parametrize("recorded", [False, True])
@pytest.mark.parametrize("d2", [1e-8, 1e-7, 1e-6, 1e-5])
def test_energy_is_in_balance_where_a_start_decays_within_a_sample(d2, recorded):
    """All modes start at the speed of the clamp; the fastest lose it within a third of a microsecond."""
    scene = Scene(2e-3, 5.0, 0.0, 9.0, Rig(d2=d2))
    given = {"ramp": 0.0, "settle": 0.0}
    found = simulate(scene, 0.1, **given, record=recorded, sample_rate=None).summary["energy_residual"]
    assert found < 1e-3
    assert found == simulate(scene, 0.1, **given).summary["energy_residual"]
