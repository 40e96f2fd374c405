"""Order of convergence: beams in their meshes, `fast` and the published scheme in their steps."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fivcore import Beam, Rig, Scene, simulate, simulate_many, sliding_modes
from fivcore.beams.modes import lower_basis
from fivcore.transient.exact import states_at
from fivcore.transient.fast import layout
from fivcore.transient.fast.run import FastRun
from fivcore.transient.fast.solver import take
from fivcore.transient.normalised import Normalised
from fivcore.transient.options import RunOptions
from fivcore.transient.published import BETA2, PAPER_STEP
from studies.accuracy.ablation import truncated, with_dashpot
from tests.helpers.small_systems import System, stepped
from tests.known import AXIAL, CANTILEVER, PINNED, bar


def free(n):
    """Frequencies of a free tip, Hz."""
    return np.sqrt(lower_basis(bar(n), 0.1).stiffness)[:4] / (2.0 * np.pi)


def pinned(n):
    """An upright P1 that neither moves nor gives pins the end of P2; its own bending does not touch y."""
    stiff = Beam(0.05, 0.01, 0.0015, 185e17, 7900.0, 1)
    rig = Rig(stiff, bar(n), contact_position=0.15, head_mass=1e12, d1=0.0, d2=0.0)
    found = sliding_modes(rig, 0.0, 0.0, 1.2 * PINNED[-1]).frequency
    return found[found > 50.0][:4]


def axially(n):
    basis = lower_basis(bar(n), 0.1)
    return np.sqrt(basis.stiffness)[basis.tangential != 0.0][:3] / (2.0 * np.pi)


@pytest.mark.parametrize(
    ("frequencies", "exact", "coarsest", "order", "apart"),
    [(free, CANTILEVER, 8, 4.0, 0.15), (pinned, PINNED, 8, 4.0, 0.15), (axially, AXIAL, 32, 2.0, 0.05)],
)
def test_frequencies_converge_to_the_analytic_ones(frequencies, exact, coarsest, order, apart):
    errors = np.array([np.abs(frequencies(factor * coarsest) / exact - 1.0) for factor in (1, 2, 4)])
    assert np.all(errors[-1] < 1e-4 * (4.0 if order == 2.0 else 1.0))
    np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), order, atol=apart)


# `fast`: first slip after 8 ms, first separation about 3 ms later.
SCENE = Normalised.of(Scene(0.02, 5.0, 0.2, 9.0))
GIVEN = {"ramp": 1e-3, "cutoff": 75e3}


def fast_state(step, time, modify=None):
    """Displacements of fast in the middle of the step that contains `time`, which is such a middle."""
    steps = round(time / step - 0.5)
    run = FastRun(SCENE, RunOptions(duration=steps * step, modify=modify, step=step, **GIVEN))
    assert run.steps == steps
    while not run.done:
        run.advance()
    return take(run.blocks, run.places, layout.Q) + run.shift


@pytest.mark.parametrize(("near", "most"), [(0.0085, 2e-8), (0.0100, 1e-5)])
def test_fast_converges_to_the_exact_motion_with_order_two(near, most):
    """In the first slip, and after dozens of changes between slip and stick just before the first separation."""
    errors = []
    for step in 3e-7 / 2.0 ** np.arange(3):
        time = (round(near / step) + 0.5) * step
        expected = states_at(SCENE, np.array([time]), **GIVEN)[0]
        found = fast_state(step, time)
        errors.append(np.abs(found - expected[: len(found)]).max() / np.abs(expected[: len(found)]).max())
    ratios = np.array(errors[:-1]) / errors[1:]
    assert errors[-1] < most
    assert np.all(ratios > 3.5), (errors, ratios)
    # One halving may do better by chance, as changes fall here or there within a step.
    assert np.sqrt(np.prod(ratios)) < 5.0, (errors, ratios)


@pytest.mark.parametrize("modify", [partial(with_dashpot, factor=0.0), truncated])
def test_fast_converges_with_order_two_without_dashpot_and_in_rigid_contact(modify):
    """In the first slip, against its own motion at a 27th of the largest step."""
    steps = 8.1e-7 / 3.0 ** np.arange(4)
    # The middle of a step of each.
    time = (round(0.0085 / steps[0]) + 0.5) * steps[0]
    *states, finest = (fast_state(step, time, modify) for step in steps)
    errors = np.array([np.abs(state - finest).max() for state in states]) / np.abs(finest).max()
    assert errors[-1] < 1e-6
    assert np.all(errors[:-1] / errors[1:] > 8.0), errors


def test_switches_and_energy_converge_as_the_step_goes_to_zero():
    """Changes of contact state per second: first order, a tenth too few at 1 us; the energy residual, second.

    Means over eight runs of 1.2 s; `exact` has 55.4 thousand changes.
    """
    ramps, found = [1e-3 * (1 + 0.013 * k) for k in range(8)], []
    for step in (1e-6, 0.5e-6, 0.25e-6):
        runs = simulate_many([Scene(5e-3, 5.0, 0.2, 9.0)] * 8, 1.2, step=step, cutoff=75e3, ramp=ramps)
        found.append([[run.summary[name] for run in runs] for name in ("switches_per_second", "energy_residual")])
    rates, residuals = np.mean(found, axis=2).T
    limit = 2.0 * rates[2] - rates[1]
    assert limit == pytest.approx(55.4e3, rel=0.03)
    missed = 1.0 - rates / limit
    assert 0.0 < missed[0] < 0.16
    assert np.all(missed[1:] < 0.67 * missed[:-1])
    assert max(residuals) < 0.005
    assert residuals[2] < 0.5 * max(residuals)


# The damping that the published scheme adds of itself. Newmark's method with beta = 0 and gamma = b takes a free
# mode's (q, v) through a step by a matrix of determinant
#     (1 - (1 - b) c dt - (b - 1/2) (omega dt)^2) / (1 + b c dt),   c = d1 + d2 omega^2,
# and it decays at the rate -log(determinant) / (2 dt): to leading order that of d2 + (b - 1/2) dt in place of d2.
# The paper's rig flutters at 96 kHz, far above the band.
OMEGA = 2.0 * np.pi * 96e3


def determinant(c, dt, b):
    """Determinant of a step of the kernel on a free mode, from velocities: v'' = trace v' - determinant v."""
    # The second mode is P1 out of reach: a gap that stays open.
    damped = np.array([c, 0.0])
    free = System([OMEGA**2, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 0.0], [1.0, 1.0], [0.0, 0.0], 0.0, c=damped)
    v = stepped(free, 4000, dt, b)[0][:, 1]
    # Of trace 2 - x and determinant 1 - y the small parts, for the sake of digits.
    (_, y), *_ = np.linalg.lstsq(np.stack([-v[1:-1], v[:-2]], axis=1), np.diff(v, 2))
    return 1.0 - y


@pytest.mark.parametrize("c", [0.0, 50.0 + 1e-8 * OMEGA**2])
@pytest.mark.parametrize("b", [0.5, BETA2, 1.0])
def test_a_free_mode_decays_as_if_d2_were_larger_by_beta2_minus_a_half_steps(b, c):
    """To second order in omega dt, and with damping in c / omega."""
    errors = []
    for dt in (PAPER_STEP, 1e-8, 5e-9):
        expected = (1.0 - (1.0 - b) * c * dt - (b - 0.5) * (OMEGA * dt) ** 2) / (1.0 + b * c * dt)
        found = determinant(c, dt, b)
        assert found == pytest.approx(expected, rel=0.0, abs=1e-12)
        if b == BETA2:
            added = 0.5 * (b - 0.5) * dt * OMEGA**2
            errors.append((-np.log(found) / (2.0 * dt) - 0.5 * c) / added - 1.0)
            assert abs(errors[-1]) < (OMEGA * dt) ** 2 + (c / OMEGA) ** 2
    if errors and c == 0.0:
        np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=0.01)


def first_separation(method, d2=1e-8, **given):
    """Time from the first slip to the first separation, s."""
    scene = replace(Scene(5e-3, 5.0, 0.2, 9.0), rig=Rig(d2=d2))
    summary = simulate(scene, 0.034, method, **given).summary
    return summary["first_separation_time"] - summary["first_slip_time"]


STEPS = [(PAPER_STEP, "published"), *(pytest.param(s, "published", marks=pytest.mark.slow) for s in (1e-8, 5e-9))]
STEPS += [pytest.param(step, "none", marks=pytest.mark.slow) for step in (PAPER_STEP, 1e-8)]


@pytest.mark.parametrize(("step", "damping"), STEPS)
def test_the_first_separation_of_the_published_scheme_is_that_of_its_own_damping(step, damping):
    """2.94, 2.26 and 2.09 ms, and 1.95 ms without it: each within 0.03 ms."""
    added = (BETA2 - 0.5) * step if damping == "published" else 0.0
    found = first_separation("fast", 1e-8 + added)
    assert found == pytest.approx(first_separation("paper", step=step, numerical_damping=damping), abs=3e-5)
    if step == PAPER_STEP:
        assert found == first_separation("fast", numerical_damping=damping)
