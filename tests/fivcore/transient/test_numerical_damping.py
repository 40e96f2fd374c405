"""The damping that the published scheme adds of itself: its law, and the runs with and without it.

Newmark's method with beta = 0 and gamma = b takes a free mode's (q, v) through a step by a matrix of determinant

    (1 - (1 - b) c dt - (b - 1/2) (omega dt)^2) / (1 + b c dt),

c = d1 + d2 omega^2. The mode decays at the rate -log(determinant) / (2 dt): to leading order in omega dt that of
d2 + (b - 1/2) dt in place of d2.
"""

from dataclasses import replace

import numpy as np
import pytest

from fivcore import Rig, Scene, critical_mu, simulate, simulate_many
from fivcore.transient.published import BETA2, STEP
from tests.helpers.runs import assert_same_run, assert_same_summary
from tests.helpers.small_systems import stepped

SCENE = Scene(5e-3, 5.0, 0.2, 9.0)
DAMPED = replace(SCENE, rig=Rig(d2=1e-8 + 6e-9))
# Past the first bursts, s; for "exact" and "paper" past the first separation.
LONG, BURST = 0.1, 0.033
# The frequency at which the paper's rig flutters far above the band, rad/s.
OMEGA = 2.0 * np.pi * 96e3


def determinant(c, dt, b):
    """Determinant of a step of the kernel on a free mode, from velocities: v'' = trace v' - determinant v."""
    # The second mode is P1 out of reach: a gap that stays open.
    rows, _ = stepped(
        [OMEGA**2, 0.0], [c, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 0.0],
        mu=0.0, dt=dt, steps=4000, q=[1.0, 1.0], v=[0.0, 0.0], b=b,
    )  # fmt: skip
    v = rows[:, 1]
    # Of trace 2 - x and determinant 1 - y the small parts, for the sake of digits.
    (_, y), *_ = np.linalg.lstsq(np.stack([-v[1:-1], v[:-2]], axis=1), np.diff(v, 2))
    return 1.0 - y


@pytest.mark.parametrize("c", [0.0, 50.0 + 1e-8 * OMEGA**2])
@pytest.mark.parametrize("b", [0.5, BETA2, 1.0])
@pytest.mark.parametrize("dt", [STEP, 1e-8, 5e-9])
def test_a_step_of_a_free_mode_has_this_determinant(dt, b, c):
    expected = (1.0 - (1.0 - b) * c * dt - (b - 0.5) * (OMEGA * dt) ** 2) / (1.0 + b * c * dt)
    assert determinant(c, dt, b) == pytest.approx(expected, rel=0.0, abs=1e-12)


@pytest.mark.parametrize("c", [0.0, 50.0 + 1e-8 * OMEGA**2])
def test_a_free_mode_decays_as_if_d2_were_larger_by_beta2_minus_a_half_steps(c):
    """To second order in omega dt, and with damping in c / omega."""
    errors = []
    for dt in (STEP, 1e-8, 5e-9):
        added = 0.5 * (BETA2 - 0.5) * dt * OMEGA**2
        rate = -np.log(determinant(c, dt, BETA2)) / (2.0 * dt)
        errors.append((rate - 0.5 * c) / added - 1.0)
        assert abs(errors[-1]) < (OMEGA * dt) ** 2 + (c / OMEGA) ** 2
    if c == 0.0:
        np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=0.01)


def first_separation(method, d2=1e-8, **given):
    """Time from the first slip to the first separation, s."""
    summary = simulate(replace(SCENE, rig=Rig(d2=d2)), 0.034, method, **given).summary
    return summary["first_separation_time"] - summary["first_slip_time"]


@pytest.mark.parametrize("step", [STEP, 1e-8, 5e-9])
def test_the_first_separation_of_the_published_scheme_is_that_of_its_own_damping(step):
    """2.94, 2.26 and 2.09 ms, and 1.95 ms without it: each within 0.03 ms."""
    found = first_separation("fast", 1e-8 + (BETA2 - 0.5) * step)
    assert found == pytest.approx(first_separation("paper", step=step), abs=3e-5)
    if step == STEP:
        assert found == first_separation("fast", numerical_damping="published")


def test_without_numerical_damping_the_first_separation_is_the_models_own():
    own = [first_separation("paper", numerical_damping="none", step=step) for step in (STEP, 1e-8)]
    assert own[0] == pytest.approx(own[1], abs=1e-6)
    assert first_separation("fast") == pytest.approx(own[0], abs=3e-5)


@pytest.mark.parametrize(("method", "duration"), [("fast", LONG), ("exact", BURST)])
def test_published_is_a_rig_with_so_much_more_damping(method, duration):
    given = {"record": True, "sample_rate": 50e3}
    own = simulate(SCENE, duration, method, numerical_damping="published", **given)
    other = simulate(DAMPED, duration, method, **given)
    assert_same_run(replace(own, scene=DAMPED), other)
    assert own.scene == SCENE
    assert own.summary["energy_residual"] < (1e-9 if method == "exact" else 5e-3)


def test_a_contact_that_moves_has_it_too():
    own = simulate(SCENE, BURST, numerical_damping="published", contact_motion=1)
    assert_same_summary(own, simulate(DAMPED, BURST, contact_motion=1))


def test_the_published_scheme_without_it_has_beta2_of_a_half():
    none = simulate(SCENE, BURST, "paper", numerical_damping="none", record=True)
    assert_same_run(none, simulate(SCENE, BURST, "paper", beta2=0.5, record=True))


@pytest.mark.parametrize(("method", "own"), [("fast", "none"), ("exact", "none"), ("paper", "published")])
def test_each_method_has_its_own_default(method, own):
    default, given, other = (
        simulate(SCENE, 0.0325, method, numerical_damping=name, record=True)
        for name in (None, own, "none" if own == "published" else "published")
    )
    assert_same_run(default, given)
    assert not np.array_equal(default.velocity_B, other.velocity_B)


def test_a_list_gives_each_scene_its_own():
    names = ["published", "none", None, "published"]
    scenes = [SCENE, SCENE, SCENE, SCENE.mirrored()]
    for scene, name, run in zip(
        scenes, names, simulate_many(scenes, LONG, numerical_damping=names, record=True), strict=True
    ):
        assert_same_run(run, simulate(scene, LONG, numerical_damping=name, record=True))


def test_the_critical_friction_is_that_of_the_same_model():
    def critical(method, d2=1e-8, **given):
        return critical_mu(Rig(d2=d2), 20.0, method, **given)

    for method in ("fast", "exact"):
        assert critical(method, numerical_damping="published") == critical(method, 1.6e-8)
        assert critical(method, numerical_damping="none") == critical(method)
    assert critical("paper", numerical_damping="none") == critical("paper", beta2=0.5)
    published = critical("paper", numerical_damping="published")
    assert published == critical("paper")
    assert published != critical("paper", beta2=0.5)
