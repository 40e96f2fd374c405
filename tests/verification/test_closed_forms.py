"""Motions with known answers (`tests.known`), by every method, through the kernels that run the rig."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fivcore import Rig, Scene, State, simulate, sliding_modes
from fivcore.rig import P1, P2
from fivcore.transient.published import BETA2
from fivcore.transient.statistics import SEPARATION, SLIP, STICK
from studies.accuracy.ablation import with_dashpot
from tests import known
from tests.helpers.sliding import sliding_state
from tests.helpers.small_systems import METHODS, N_OF, SAMPLED, SPEED_OF, STATE_OF, T_OF, TIME, Fast, by_paper
from tests.known import BOUNCE, CRITICAL, FALL, LENGTH, MOTIONS, PRESSURE


@pytest.mark.parametrize(("motion", "method", "resolution", "error"), known.claims())
def test_a_block_on_a_spring_moves_as_its_closed_form(motion, method, resolution, error):
    stiffness, step = (None, resolution) if method == "paper" else (resolution, 1e-3)
    system = motion.system(stiffness)
    t, q, rows = METHODS[method](system, motion.duration, step)
    when = t if motion.when is None else motion.when
    x = np.interp(when, t, q @ system.tangential)
    assert np.abs(x - motion.answer(when)).max() < error
    if method != "paper":
        np.testing.assert_allclose(rows[:, N_OF], 1.0, rtol=1e-12)
    if motion.name == "rest":
        assert np.all(rows[-1000:, STATE_OF] == STICK)
    if motion.name == "belt":
        slipping = rows[:, STATE_OF] == SLIP
        first = rows[np.argmax(slipping), TIME]
        assert first == pytest.approx(1.0 / system.V, abs=1.0 / (stiffness or np.inf) + 2.0 * step)
        if method != "paper":
            # The belt runs ahead: P1's surface lags and friction drags it along.
            np.testing.assert_allclose(rows[slipping, T_OF], rows[slipping, N_OF], rtol=1e-12)
            assert rows[slipping, SPEED_OF].max() < 1e-3


@pytest.mark.parametrize("r", [0.2, 0.02, 0.002])
def test_after_a_step_in_N_friction_relaxes_to_mu_N(r):
    """Prakash-Clifton, simplified: by 1 / (1 + r) a step, exp(-t / tau) to r / 2 of the exponent."""
    mu, dt = 0.3, 1e-6
    _, _, rows = by_paper(known.loaded_block(mu), 12.0 / r * dt, dt, tau=dt / r)
    N, T = rows[:, N_OF], rows[:, T_OF]
    assert np.all(rows[:, STATE_OF] == SLIP)
    np.testing.assert_allclose(N, 2.0, rtol=1e-9)
    steps = np.arange(1, len(T) + 1)
    np.testing.assert_allclose(2.0 * mu - T, mu * (1.0 + r) ** -steps, rtol=0.0, atol=1e-10)
    within = steps * r < 3.0
    np.testing.assert_allclose(np.log(2.0 - T[within] / mu), -steps[within] * r, rtol=0.5 * r, atol=1e-8)


# Bars that fall on a rigid floor.
def contacts(t, N, gap=0.05):
    """Begin and end of each contact; shorter gaps do not end one."""
    touching = t[N > 0.0]
    parts = np.split(touching, np.flatnonzero(np.diff(touching) > gap) + 1)
    return np.array([(part[0], part[-1]) for part in parts])


def about(t, N, when):
    """Mean pressure within 0.05 s, some periods of the fastest modes."""
    return np.array([N[np.abs(t - x) < 0.05].mean() for x in when])


IMPACTS = [("fast", 50, 0.009, 0.0145), ("fast", 100, 0.0048, 0.0073), ("fast", 200, 0.0032, 0.0046)]
IMPACTS += [("exact", 50, 0.009, 0.015), ("exact", 100, 0.0048, 0.008)]


@pytest.mark.parametrize(("method", "elements", "duration", "mean"), IMPACTS)
def test_impacting_bar(method, elements, duration, mean):
    """Pressure rho c v for 2 L / c: duration (s) and mean pressure (relative) nearer with the mesh.

    Consistent mass disperses the front, with an error that falls like h^(2/3).
    """
    # So violent that the kernel's load of 1 is nothing beside it.
    unit = 1e8
    system, step = known.reduced_bar(elements, unit, height=5.0, speed=-10.0, weight=0.0)
    _, _, rows = METHODS[method](system, 1.6, step)
    t, N = rows[:, TIME], rows[:, N_OF] / unit
    ((begin, end),) = contacts(t, N, gap=0.0015 + 2.0 * step)
    assert begin == pytest.approx(0.5, abs=2.0 * step)
    # From the middle of the first step in contact to that of the last; each of them lasts a whole step.
    assert end - begin + step == pytest.approx(BOUNCE, abs=duration)
    within = (t >= begin) & (t <= begin + BOUNCE)
    assert N[within].mean() == pytest.approx(PRESSURE, rel=mean)
    # Twice the momentum it came with, but for what rings on in the bar and what its end has absorbed.
    assert np.sum(N) * step == pytest.approx(200.0, rel=mean)
    np.testing.assert_allclose(about(t, N, begin + np.array([0.15, 0.3, 0.5])), PRESSURE, rtol=0.03)


PEAKS = [(True, 0.5, 1.0, 1e-9, PRESSURE), (False, BETA2, 0.9, 1e-4, 305.3), (False, 0.5, 0.9, 0.25, 464.7)]


@pytest.mark.parametrize(("lumped", "b", "share", "ripple", "peak"), PEAKS)
def test_impacting_bar_by_the_published_scheme(lumped, b, share, ripple, peak):
    """Exact with lumped mass at the Courant limit; beta2 = 0.8 calms consistent mass, beta2 = 0.5 leaves 55 %.

    That overshoot, to 465, does not depend on the mesh; the 373 quoted for consistent mass is not met.
    """
    k, end = known.falling_bar(100, lumped)
    start = np.sqrt(LENGTH) * (np.arange(len(k)) == 0)
    dt, none = share * np.sqrt(2.0 / b / k[-1]), np.zeros(len(k))
    system = known.System(k, end, 1e-9 * start, none, 5.0 * start, -10.0 * start, 0.0)
    _, _, rows = by_paper(system, 1.4, dt, b=b)
    t, N = rows[:, TIME], rows[:, N_OF]
    ((begin, ends),) = contacts(t, N)
    assert ends - begin == pytest.approx(BOUNCE, abs=0.006)
    middle = (t > begin + 0.1) & (t < begin + BOUNCE - 0.1)
    np.testing.assert_allclose(N[middle], PRESSURE, rtol=ripple)
    assert N[t > begin + 5.0 * dt].max() == pytest.approx(peak, rel=2e-3)


@pytest.mark.parametrize(("elements", "error"), [(100, 0.07), (400, 0.027)])
def test_bouncing_bar(elements, error):
    """Dropped from 5 under its weight, the bar is where it was after 16 / 3 s: two bounces.

    Undeformed at 1 s, pressure rises from 300 by rho g c t to 500 in 2 L / c, the same wave that makes 300 of
    v = 10 bringing the weight. It leaves deformed as twice its static self, with v = 10, and 2 s of flight are
    three periods of its modes: all is reversed, pressure falls from 500 to 300 and the bar leaves undeformed.
    """
    unit = 1.0 / (LENGTH * FALL)
    system, step = known.reduced_bar(elements, unit, height=5.0, speed=0.0, weight=1.0)
    times, q, rows = METHODS["fast"](system, 6.9, step, 20)
    t, N = rows[:, TIME], rows[:, N_OF] / unit
    centre = q[:, 0] / (unit * np.sqrt(LENGTH))
    found = contacts(t, N)[:2]
    expected = np.array([[1.0, 1.0 + BOUNCE], [3.0 + BOUNCE, 3.0 + 2.0 * BOUNCE]])
    np.testing.assert_allclose(found, expected, atol=error)
    rise, fall = np.array([0.1, 0.5 * BOUNCE, BOUNCE - 0.1]), np.array([0.15, 0.5 * BOUNCE])
    np.testing.assert_allclose(about(t, N, found[0, 0] + rise), 300.0 + 300.0 * rise, rtol=0.25 * error)
    np.testing.assert_allclose(about(t, N, found[1, 0] + fall), 500.0 - 300.0 * fall, rtol=1.5 * error)
    later = times > 4.0
    top = np.argmax(centre[later])
    assert times[later][top] == pytest.approx(known.PERIOD, abs=error)
    assert centre[later][top] == pytest.approx(5.0, abs=5.0 * error)
    # Mean force is the weight, over the period that has passed.
    assert N[t < times[later][top]].mean() == pytest.approx(LENGTH * FALL, rel=1e-3)


# Mode coupling.
def poles(y, step, count):
    """Exponents of a sum of `count` exponentials, by linear prediction."""
    columns = np.stack([y[count - 1 - j : len(y) - 1 - j] for j in range(count)], axis=1)
    ahead, *_ = np.linalg.lstsq(columns, y[count:], rcond=None)
    return np.log(np.roots(np.concatenate([[1.0], -ahead])).astype(complex)) / step


@pytest.mark.parametrize(
    ("method", "tau", "error"), [("fast", 0, 5e-4), ("fast", 0.05, 5e-4), ("exact", 0.05, 1e-9)]
)
@pytest.mark.parametrize("ratio", [1.05, 1.2])
def test_mode_coupling_grows_at_its_eigenvalues_rate(ratio, method, tau, error):
    """Growth and frequency with 80 steps a period; tau damps the contact."""
    step = 0.05
    system, expected, N = known.coupled(ratio * CRITICAL, 1e-5, tau)
    _, _, rows = METHODS[method](system, 40.0, step)
    assert np.all(rows[:, STATE_OF] == SLIP)
    found = poles((rows[:, N_OF] - N)[200::8], 8 * step, 5)
    found = found[np.argmin(np.abs(found - expected))]
    assert found.real == pytest.approx(expected.real, rel=error)
    assert found.imag == pytest.approx(expected.imag, rel=error)


@pytest.mark.parametrize(("ratio", "grows"), [(0.98, False), (0.999, False), (1.001, True), (1.02, True)])
def test_mode_coupling_begins_at_the_critical_friction(ratio, grows):
    system, _, N = known.coupled(ratio * CRITICAL, 1e-7, 0.0)
    y = np.abs(Fast(system, 0.05).run(8000)[:, N_OF] - N)
    quarter = len(y) // 4
    growth = y[-quarter:].max() / y[:quarter].max()
    assert growth > 10.0 if grows else growth < 2.0


# Balances.
def block(step, stiffness=1e3, d1=0.0, **given):
    """The block that starts at 12 with 6."""
    system = MOTIONS[1].system(stiffness)
    return Fast(replace(system, c=np.array([0.0, d1]), **given), step)


def impact(step):
    """A bar that bounces."""
    system, step = known.reduced_bar(50, 1.0 / (LENGTH * FALL), height=1.0, speed=0.0, weight=1.0, z=step)
    return Fast(system, step)


def couple(step):
    """Two coupled modes that slide: friction and normal force grow together."""
    return Fast(known.coupled(1.05 * CRITICAL, 0.05, 0.05, V=10.0, N=1.0)[0], step)


BALANCES = [
    # On a belt too fast to be caught friction is constant; to and fro on a slow one, and stuck at last.
    (partial(block, V=100.0), 8.0, (4e-3,), 1e-11, 0.0),
    (partial(block, V=0.3), 40.0, (8e-3, 4e-3, 2e-3), 3e-6, 1.6),
    # The kernel samples modal damping every SAMPLED-th step.
    (partial(block, V=0.3, d1=0.02), 40.0, (8e-3, 4e-3, 2e-3), 1.25e-4 * SAMPLED, 1.8),
    (couple, 20.0, (0.1, 0.05, 0.025, 0.0125), 4e-3, 1.7),
    (impact, 3.0, (0.4, 0.2, 0.1, 0.05), 5e-3, 1.6),
]


@pytest.mark.parametrize(("case", "duration", "steps", "error", "falls"), BALANCES)
def test_energy_balances_at_every_instant(case, duration, steps, error, falls):
    """Work in = stored + damped + friction + termination, relative to the energy at the start.

    Exact under constant forces, else first order in the step: between two impulses the element's state is half a
    step old, catches and impacts fall anywhere within a step, and modal damping is sampled.
    """
    worst = []
    for step in steps:
        system = case(step)
        size, largest = abs(system.first), 0.0
        for _ in range(int(duration / system.step / 8)):
            system.run(8)
            largest = max(largest, abs(system.imbalance()))
        worst.append(largest / size)
    assert worst[0] < error
    assert worst[0] / worst[-1] >= falls ** (len(steps) - 1)


# The finite-element model cut off at 75 kHz; with its own dashpot, or three times as much.
CUT, DAMPED = {"cutoff": 75e3}, {"modify": partial(with_dashpot, factor=3.0)}
RIG_METHODS = {
    "fast": {"method": "fast"},
    "fast, 75 kHz, half the step": {"method": "fast", "step": 6e-7} | CUT,
    "exact": {"method": "exact"} | CUT,
    "exact, three dashpots": {"method": "exact"} | CUT | DAMPED,
    "paper": {"method": "paper"},
}


def seeded(rig, pair, duration, options):
    """What a seed of one mode adds to N, from two runs that differ by it, and the exponent it should have.

    Slip is linear: what the start stirs up is in both runs and leaves with the difference.
    """
    F, V, mu, theta, runs = 8.0, 1.0, 0.2, 5.0, []
    for size in (1e-2, -1e-2):
        start, phi = sliding_state(rig, theta, mu, V, F, pair, size)
        given = {"ramp": 0.0, "initial": start, "record": True, "sample_rate": 5e5, **options}
        runs.append(simulate(Scene(V, theta, mu, F, rig), duration, **given))
    left = np.logical_or(*(run.state != SLIP for run in runs))
    slipping = int(np.argmax(left)) if left.any() else len(left)
    assert slipping > 0.4 * len(left)
    for run in runs:
        # P1 lags behind P2, which drags it along.
        assert np.all(run.slip_velocity[:slipping] < 0.0)
        late = slice(slipping // 10, slipping)
        np.testing.assert_allclose(run.tangential_force[late], mu * run.normal_force[late], atol=0.03 * F)
    added = runs[0].normal_force - runs[1].normal_force
    return added[slipping // 10 : slipping], runs[0].time[1] - runs[0].time[0], phi


def nearest_pole(y, step, phi):
    """Of four: the pair and what else there is; in means over a twelfth of a period (exponentials stay so)."""
    every = max(round(0.5 / (abs(phi) * step)), 1)
    whole = len(y) // every * every
    found = poles(y[:whole].reshape(-1, every).mean(axis=1), every * step, 4)
    return found[np.argmin(np.abs(found - phi))]


# With ten times the paper's stiffness damping; and with the paper's, where pairs of 54 to 145 kHz (the reduced
# model has none above its cut-off) grow at up to 6700 1/s and separate the surfaces within a millisecond or two,
# before 398 Hz has been through a period.
SEEDED = [(name, pair, 1e-7, 2e-3 if name == "paper" else 5e-4) for name in RIG_METHODS for pair in (0, 1)]
SEEDED += [(name, 1, 1e-8, 5e-3) for name in ("fast, 75 kHz, half the step", "exact", "paper")]
SEEDED += [("exact, three dashpots", 0, 1e-8, 5e-3)]


@pytest.mark.parametrize(("name", "pair", "d2", "error"), SEEDED)
def test_a_seeded_mode_grows_at_its_eigenvalues_rate(name, pair, d2, error):
    """398 Hz, 384 1/s and 2794 Hz, 1764 1/s (1750 with more damping)."""
    duration = 6e-3 if pair == 0 else 2e-3 if d2 == 1e-8 else 2.5e-3
    y, step, phi = seeded(Rig(d2=d2), pair, duration, RIG_METHODS[name])
    if d2 == 1e-8:
        rate, frequency = known.MODES[0].growth_rate[pair], known.MODES[0].frequency[pair]
        assert (phi.real, phi.imag / (2.0 * np.pi)) == pytest.approx((rate, frequency), abs=0.5)
    found = nearest_pole(y, step, phi)
    assert found.real == pytest.approx(phi.real, rel=error)
    assert found.imag == pytest.approx(phi.imag, rel=min(error, 2e-3))


@pytest.mark.parametrize("method", ["fast", "exact", "paper"])
def test_a_stable_scene_returns_to_steady_sliding(method):
    """N = F, T = mu F to 1e-6 of F; with a light head and more damping it does not take a second."""
    theta, mu = 5.0, 0.05
    rig, F = Rig(replace(P1, elements=10), replace(P2, elements=30), head_mass=0.03, d1=1000.0), 9.0
    assert not np.any(sliding_modes(rig, theta, mu, 100e3).unstable)
    start, _ = sliding_state(rig, theta, mu, 0.1, F)
    shaken = start.velocity + 1e-4 * np.random.default_rng(3).standard_normal(len(start.velocity))
    given = {"ramp": 0.0, "initial": State(start.displacement, shaken, SLIP), "record": True}
    run = simulate(Scene(0.1, theta, mu, F, rig), 0.05, method, **given)
    assert np.ptp(run.normal_force[: len(run.time) // 20]) > 0.01
    late = run.time > 0.045
    np.testing.assert_allclose([run.normal_force[late], run.tangential_force[late] / mu], F, rtol=1e-6)
    np.testing.assert_allclose(run.slip_velocity[late], -0.1, rtol=1e-4)
    assert np.all(run.state[late] == SLIP)


def test_friction_has_no_preferred_direction():
    """On a belt that runs the other way N stays, and T changes its sign."""
    system, *_ = known.coupled(1.2 * CRITICAL, 1e-2, 0.05)
    normal, tangential = system.u
    mirrored = replace(system, tangential=-system.tangential, V=-system.V, u=(normal, -tangential))
    one, other = (Fast(each, 0.05).run(200) for each in (system, mirrored))
    np.testing.assert_allclose(other[:, N_OF], one[:, N_OF], rtol=1e-9)
    np.testing.assert_allclose(other[:, T_OF], -one[:, T_OF], rtol=1e-9)
    assert one[:, T_OF].min() > 0.0


def test_energy_balances_as_a_spring_that_couples_both_directions_comes_apart():
    """Contact begins and ends in stick and in slip, with much left in its dashpot."""
    system, *_ = known.coupled(1.05 * CRITICAL, 8.0, 0.05, V=10.0, N=1.0)
    K, worst = system.K - 0.5 * np.sqrt(np.linalg.det(system.K)) * np.eye(2)[::-1], []
    for step in (0.05, 0.0125):
        run, states, largest = Fast(replace(system, K=K, C=K), step), set(), 0.0
        for _ in range(int(10.0 / step / 8)):
            states |= set(run.run(8)[:, STATE_OF])
            largest = max(largest, abs(run.imbalance()))
        worst.append(largest / abs(run.first))
        assert states == {SEPARATION, STICK, SLIP}
    assert worst[1] < 0.02
    assert worst[0] > 4.0 * worst[1]
