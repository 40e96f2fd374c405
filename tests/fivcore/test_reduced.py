"""The reduced contact: residual flexibility and damping, impulses, ablations, and where its force is unique."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.linalg import eigh
from scipy.optimize import brentq

from fivcore import ContactError, Rig, Scene, Structure, painleve_mu, simulate
from fivcore.beams.modes import propagator
from fivcore.contact import step_map
from fivcore.contact.law import SMALL, at_impulses, between_impulses
from fivcore.contact.reduced import (
    CONTACT_DAMPING,
    CUTOFF_SHARE,
    LEAST_CUTOFF,
    ReducedModel,
    default_cutoff,
    full_model,
    modified,
    reduced_model,
)
from fivcore.rig import P1, P2
from fivcore.transient.fast.steady import steady_sliding
from fivcore.transient.published import PAPER_STEP, TAU, contact_closing
from studies.accuracy.ablation import truncated, with_dashpot, without_cross_terms
from studies.accuracy.rigs import drawn_scene
from tests.helpers.examples import examples

CUTOFF = 75e3


def test_the_residual_keeps_the_static_flexibility():
    full, *reduced = full_model(Rig(), 20.0), reduced_model(Rig(), 20.0, CUTOFF), reduced_model(Rig(), 20.0, 200e3)

    def flexibility(model):
        elastic = model.stiffness > 0.0
        return (model.shapes[:, elastic] / model.stiffness[elastic]) @ model.shapes[:, elastic].T

    for model in reduced:
        assert flexibility(model) + np.linalg.inv(model.K) == pytest.approx(flexibility(full))


@pytest.mark.parametrize("make", [Rig, lambda: Rig(contact_position=0.12), lambda: drawn_scene(2010, 0).rig])
def test_the_contacts_damping_ratio_is_what_it_should_be(make):
    model = reduced_model(make(), 5.0)
    squares, shapes = eigh(model.K, np.linalg.inv(model.W))
    assert np.sqrt(squares[-1]) == pytest.approx(model.contact_frequency)
    damping = shapes[:, -1] @ model.C @ shapes[:, -1]
    assert damping == pytest.approx(2.0 * CONTACT_DAMPING * model.contact_frequency)


@given(st.floats(-6.0, 0.5), st.floats(0.0, 2.0), st.booleans())
@examples(60)
def test_free_motion_backwards_undoes_free_motion(exponent, damping, free):
    """Of a mode with phase 10^exponent and `damping` in a step."""
    stiffness = np.array([0.0 if free else (10.0**exponent / 1e-6) ** 2])
    there, back = (propagator(stiffness, np.array([damping / 1e-6]), step)[:, 0] for step in (1e-6, -1e-6))
    # Velocities in units of the step.
    there, back = (flow.reshape(2, 2) * [[1.0, 1e6], [1e-6, 1.0]] for flow in (there, back))
    assert back @ there == pytest.approx(np.eye(2), abs=1e-11)


# Impulses.
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
@example(0.05, 0.1)  # critical damping
@example(0.5, 1.0)
@examples(60)
def test_what_impulses_miss_is_what_a_sawtooth_lacks(phase, decay):
    step = 2e-6
    square, damping = (phase / step) ** 2, decay / step
    q, rate, midway = sawtooth(phase / step, damping, step)
    defect, drift = (float(part[0]) for part in at_impulses(np.array([square]), np.array([damping]), step))
    assert defect == pytest.approx(1.0 / square - q, rel=1e-8, abs=1e-12 / square)
    assert drift == pytest.approx(rate, rel=1e-8, abs=1e-12 * step)
    if decay == 0.0:
        between = float(between_impulses(np.array([square]), step)[0])
        assert between == pytest.approx(midway - 1.0 / square, rel=1e-8)


@pytest.mark.parametrize("decay", [0.0, 0.01, 0.3])
def test_slow_modes_miss_a_twelfth_of_the_steps_square_and_the_series_joins(decay):
    step, rel = 2e-6, 1e-4 + 0.02 * decay**2
    omegas = np.array([0.0, 1e-6, 1.0 - 1e-9, 1.0 + 1e-9]) * SMALL / step
    defect, drift = at_impulses(omegas**2, np.full(4, decay / step), step)
    assert defect == pytest.approx(step**2 / 12.0, rel=rel)
    assert defect[2] == pytest.approx(defect[3], rel=1e-5)
    assert drift[2] == pytest.approx(drift[3], rel=1e-5, abs=1e-14)
    assert drift == pytest.approx(decay * step / 12.0, rel=rel, abs=1e-14)


def test_growth_near_the_onset_is_right_in_steps_of_two_microseconds():
    """At mu = 0.11 a mode at 55 kHz decays by 529 1/s; taken for lasting, impulses let it grow."""
    model, mu = reduced_model(Rig(), 5.0, 117.35e3), 0.11
    finest, coarse, half = (steady_sliding(model, mu, step).eigenvalues for step in (0.02e-6, 2e-6, 1e-6))
    near = finest[np.abs(finest.imag / (2.0 * np.pi) - 55.3e3) < 2e3]
    true = near[np.argmax(near.real)]
    assert true.real == pytest.approx(-528.6, abs=1.0)
    errors = [abs(found[np.abs(found - true).argmin()].real - true.real) for found in (coarse, half)]
    assert errors[0] < 6.0
    assert errors[1] < 0.35 * errors[0]


# Ablations.
ELASTIC = partial(with_dashpot, factor=0.0)


def test_a_changed_dashpot_changes_nothing_else():
    own = reduced_model(Rig(), 5.0, CUTOFF)
    np.testing.assert_allclose(own.C, 2.0 * CONTACT_DAMPING / own.contact_frequency * own.K, rtol=1e-14)
    for factor in (0.0, 0.5, 2.0):
        model = with_dashpot(own, factor)
        np.testing.assert_allclose(model.C, factor * own.C, rtol=1e-14)
        assert np.array_equal(model.K, own.K)
        assert np.array_equal(model.static_equilibrium, own.static_equilibrium)
    # At least the material's.
    np.testing.assert_allclose(reduced_model(Rig(d2=1e-2), 5.0, CUTOFF).C, 1e-2 * own.K, rtol=1e-14)
    modify = partial(with_dashpot, factor=0.6)
    assert modified(own, None) is own
    np.testing.assert_array_equal(modified(own, modify).C, with_dashpot(own, 0.6).C)


def test_without_cross_terms_normal_and_tangential_flexibility_stay():
    own = reduced_model(Rig(), 20.0, CUTOFF)
    model = without_cross_terms(own)
    assert own.K[0, 1] != 0.0
    assert np.count_nonzero(model.K) == np.count_nonzero(model.C) == 2
    np.testing.assert_allclose(1.0 / np.diag(model.K), np.diag(np.linalg.inv(own.K)), rtol=1e-12)
    np.testing.assert_allclose(model.C, own.C[0, 0] / own.K[0, 0] * model.K, rtol=1e-14)


SCENE = Scene(0.02, 5.0, 0.2, 9.0)


@pytest.mark.parametrize("modify", [partial(with_dashpot, factor=2.0), without_cross_terms])
def test_fast_and_exact_solve_the_same_changed_law(modify):
    """Until the surfaces part they agree better with each other than with the law as it is."""
    given = {"cutoff": CUTOFF, "step": 1e-7, "record": True, "sample_rate": 1e7}
    methods = ("fast", modify), ("exact", modify), ("exact", None)
    runs = [simulate(SCENE, 0.0125, method, modify=each, **given) for method, each in methods]
    until = int(min(run.summary["first_separation_time"] for run in runs) / 1e-7) - 1
    fast, exact, plain = (run.velocity_B[:until] for run in runs)
    assert np.abs(fast - exact).max() < 0.05 * np.abs(plain - exact).max()
    # Unless a cut-off is given the first burst is reached by a finer model, which obeys the changed law too.
    times = [simulate(SCENE, 0.0125, modify=each).summary["first_separation_time"] for each in (None, modify)]
    assert np.isfinite(times).all()
    assert times[0] != times[1]


# Where the contact force is not unique, and where a step is not stable.
@pytest.mark.parametrize(
    ("method", "given"),
    [("fast", {}), ("fast", {"modify": ELASTIC}), ("fast", {"modify": truncated}), ("paper", {})],
)
def test_beyond_the_critical_friction_a_method_refuses(method, given):
    critical = painleve_mu(Rig(), 30.0, method, **given)
    below, above = (Scene(0.1, 30.0, critical * factor, 9.0) for factor in (1 - 1e-6, 1 + 1e-6))
    cutoff = None if method == "paper" else default_cutoff(Rig())
    simulate(below, 1e-4, method, cutoff=cutoff, **given)
    with pytest.raises(ContactError, match=f"from {critical:.6g} on") as caught:
        simulate(above, 1e-4, method, **given)
    assert caught.value.scene == above


def test_the_critical_friction_is_that_of_the_law_the_ablation_and_the_damping():
    """Truncated to 24 modes the contact force is lost at mu = 1.92."""
    assert painleve_mu(Rig(), 5.0, cutoff=50e3, modify=truncated) == pytest.approx(1.92, abs=0.005)
    model, r = full_model(Rig(), 5.0), PAPER_STEP / TAU
    inverse = 1.0 / (1.0 + 0.8 * PAPER_STEP * model.damping)
    normal, cross = np.sum(model.normal**2 * inverse), np.sum(model.normal * model.tangential * inverse)
    assert painleve_mu(Rig(), 5.0, "paper") == pytest.approx(normal * (1 + r) / (r * abs(cross)))
    assert painleve_mu(Rig(), 20.0, "exact", modify=without_cross_terms) == np.inf
    springs = with_dashpot(reduced_model(Rig(), 20.0), 0.0)
    K = springs.discrete(springs.default_step).stiffness
    assert painleve_mu(Rig(), 20.0, "fast", modify=ELASTIC) == pytest.approx(abs(K[1, 1] / K[0, 1]), rel=1e-12)
    W = contact_closing(full_model(Rig(), 20.0), 2e-8, 0.5)
    undamped = abs(W[0] / W[1]) * (1.0 + TAU / 2e-8)
    assert painleve_mu(Rig(), 20.0, "paper", beta2=0.5) == pytest.approx(undamped, rel=1e-12)
    assert painleve_mu(Rig(), 20.0, "paper", numerical_damping="none") == pytest.approx(undamped, rel=1e-12)
    assert undamped != painleve_mu(Rig(), 20.0, "paper")
    for method in ("fast", "exact"):
        damped = painleve_mu(Rig(d2=1.6e-8), 20.0, method)
        assert painleve_mu(Rig(), 20.0, method, numerical_damping="published") == damped


@np.errstate(divide="ignore", invalid="ignore")
def slip_by_its_equation(K, C, M, m, step):
    """Slip with T = m N, m (n, 1), where u_T follows the element's own equation.

    Returns divisors (n,), and N and u_T at the end from (p, u_T, v_N), (n, 2, 3); v is the mean rate of g_N.
    """
    zero, divisor = np.zeros_like(m), C[1, 1] - m * C[0, 1]
    rate = (m * K[0, 1] - K[1, 1]) / divisor
    on_p, on_v = (m * K[0, 0] - K[1, 0]) / divisor, (C[1, 0] - m * C[0, 0]) / divisor
    mean_rate = np.expm1(rate * step) / (rate * step) * np.hstack([on_p, rate, on_v])
    mean = (mean_rate - np.hstack([on_p, zero, on_v])) / rate
    N = np.array([K[0, 0], 0.0, -C[0, 0]]) + K[0, 1] * mean + C[0, 1] * mean_rate
    # v = v_N + inertia N, solved for N.
    inertia = M[0, 0] + m * M[0, 1]
    solved = 1.0 - inertia * N[:, 2:]
    force = N / solved
    end = step * (mean_rate + mean_rate[:, 2:] * inertia * force) + [0.0, 1.0, 0.0]
    return solved[:, 0], np.stack([force, end], axis=1)


def scanned_limit(K, C, M, step):
    """The least friction at which a divisor is zero, first looked for at 400 frictions up to the law's limit."""

    def least(mu):
        return slip_by_its_equation(K, C, M, np.append(mu, -mu)[:, None], step)[0].reshape(2, -1).min(axis=0)

    law = abs(K[1, 1] / K[0, 1])
    trial = np.linspace(0.0, min(law, 1e6) * (1.0 - 1e-9), 400)
    past = np.flatnonzero(least(trial) <= 0.0)[:1]
    ends = (trial[k] for k in (*(past - 1), *past))
    return brentq(lambda mu: least(np.array([mu]))[0], *ends, xtol=1e-15, rtol=1e-15) if len(past) else law


def test_one_map_is_slip_with_any_friction_and_knows_its_limit():
    """Of 200 random models; N does not depend on u_T, whose own equation relaxes with tau alone."""
    rng, below = np.random.default_rng(3), 0
    for seed in range(200):
        # Gap shapes of six modes that are kept and of six that are not; the contact rarely rings in a step.
        shapes, left = rng.normal(size=(2, 2, 6)) * [[[1.0], [10.0 ** rng.uniform(-1.0, 0.5)]]]
        stiffness, step = 10.0 ** rng.uniform(10.0, 13.0, 6), 10.0 ** rng.uniform(-6.5, -5.5)
        K, W = np.linalg.inv(left / stiffness @ left.T), shapes @ shapes.T
        omega = np.sqrt(np.linalg.eigvals(K @ W).real.max())
        C = K * 10.0 ** rng.uniform(-1.5, 0.5) / omega
        none, kept = np.zeros(6), np.ones(6, dtype=bool)
        model = ReducedModel(stiffness * 1e-3, none, *shapes, none, none, none, kept, K, C)
        contact = model.discrete(step)
        limit, M = contact.painleve_mu, contact.delassus
        K, C = contact.stiffness, contact.tau * contact.stiffness
        assert limit == pytest.approx(scanned_limit(K, C, M, step), rel=2e-13), seed
        below += limit < 0.999 * abs(K[1, 1] / K[0, 1])
        for m in rng.uniform(-0.9, 0.9, 3) * min(limit, 2.0):
            N, T, u = contact.slip.forces(m)
            (expected,) = slip_by_its_equation(K, C, M, np.array([[m]]), step)[1]
            scale = np.abs(expected).max(axis=1, keepdims=True)
            np.testing.assert_allclose(np.stack([N, u])[:, :3] / scale, expected / scale, 1e-9, 1e-13)
            np.testing.assert_allclose(T, m * N, rtol=1e-12)
    assert 20 < below < 180


def test_a_step_at_which_slip_alternates_is_refused():
    rig, mu, cutoff = Rig(replace(P1, elements=10), replace(P2, elements=30)), 2.0, 300e3
    model = reduced_model(rig, 60.0, cutoff)
    assert step_map.stable(model, mu, model.default_step)
    with pytest.raises(ValueError, match=r"at most .* s; beyond, slip with mu = 2 is unstable") as caught:
        simulate(Scene(-0.05, -60.0, mu, 9.0, rig), 1e-3, step=0.99 * model.largest_step, cutoff=cutoff)
    limit = float(str(caught.value).split("at most ")[1].split(" s")[0])
    assert step_map.stable(model, mu, 0.99 * limit)
    assert not step_map.stable(model, mu, 1.01 * limit)


def test_the_cut_off_of_large_beams_is_where_their_bending_waves_are_four_thicknesses_long():
    """Rounded up to an odd multiple of an axial mode of P1, at least five, twice of which they are apart."""
    for size in (1.0, 10.0):
        grown = ({way: size * getattr(b, way) for way in ("length", "width", "thickness")} for b in (P1, P2))
        p1, p2 = (replace(beam, **given) for beam, given in zip((P1, P2), grown, strict=True))
        rig = Rig(p1, p2, size * Rig().contact_position)
        # Waves of length 4 h: omega = (pi / 2 h)^2 h c / sqrt(12).
        waves = [
            np.pi / (8.0 * np.sqrt(12.0)) * np.sqrt(b.young_modulus / b.density) / b.thickness for b in (p1, p2)
        ]
        mode = 0.97 * np.sqrt(p1.young_modulus / p1.density) / (4.0 * p1.length)
        odd, least = default_cutoff(rig) / CUTOFF_SHARE / mode, min(LEAST_CUTOFF, *waves) / mode
        assert odd % 2.0 == pytest.approx(1.0)
        assert least <= odd < max(least + 2.0, 5.1)
        assert (least * mode < LEAST_CUTOFF) == (size > 1.0)


@pytest.mark.parametrize("highest", [2.0, 40.0, 3e3])
def test_the_step_of_rigid_contact_is_a_share_of_the_fastest_modes_time(highest):
    own = Structure.from_modes(
        [0.0, 0.3 * highest, highest], [1.0, 0.3, 0.5], [0.0, 1.0, 0.7], load=[-1.0, 0.0, 0.0]
    )
    model = full_model(own, 0.0)
    most = model.rigid_step / (2.0 * np.pi * highest)
    assert 0.5 * most <= model.default_step <= most * (1.0 + 1e-9)
