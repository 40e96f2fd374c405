"""Problems with known answers, through the kernels that run the rig: small systems given as plain arrays."""

from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import pytest
from scipy.linalg import eigh

from fivcore import Rig, Scene, State, simulate, sliding_modes
from fivcore.contact.ablation import with_relaxation_time
from fivcore.contact.reduced import full_model
from fivcore.rig import P1, P2
from tests.helpers.small_systems import SAMPLED, Small, stepped
from tests.helpers.transient_reference import SEPARATION, SLIP, STICK

T_OF, N_OF, STATE_OF = 3, 2, 5


# Coulomb friction and the belt: a block of unit mass on a unit spring, mu N = 1.


def block(kT, step, *, x, v, V=0.0, contact=SLIP, d1=0.0):
    """The block, its contact of stiffness kT and a dashpot that damps it well."""
    K = kT * np.eye(2)
    # The first mode is the normal direction, which does nothing but press.
    return Small(
        [0.0, 1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], K, K / np.sqrt(kT),
        mu=1.0, step=step, q=[-1.0 / kT, x], v=[0.0, v], c=np.array([0.0, d1]), V=V,
        contact=contact, u=(1.0 / kT, 0.0),
    )  # fmt: skip


@pytest.mark.parametrize("kT", [1e3, 1e5])
def test_coulomb_friction_lets_a_block_rest_inside_the_dead_band(kT):
    """x'' + x = r, |r| <= 1, from 12 at 6: turns at sqrt(205) - 1, two less each time, and stays at 0.682179.

    The element's compliance displaces the place of rest by 1.5 / kT.
    """
    first = np.sqrt(205.0) - 1.0
    system = block(kT, 1e-3, x=12.0, v=6.0)
    _, q, rows = system.follow(40.0, 10)
    x = q[:, 1]
    np.testing.assert_allclose(rows[:, N_OF], 1.0, rtol=1e-12)
    assert x[-1] == pytest.approx(14.0 - first, abs=1.7 / kT)
    assert abs(x[-1] - (14.0 - first)) > 1.3 / kT
    assert np.all(rows[-1000:, STATE_OF] == STICK)
    expected = (first - 2.0 * np.arange(7)) * (-1.0) ** np.arange(7)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(x)))) + 1
    np.testing.assert_allclose(x[turns][:7], expected, atol=1e-4 + 2.5 / kT)


def belt(t, V):
    """Sticks to x = mu N / k = 1, then x = 1 + V sin(t - t1): at its lowest it never catches the belt again."""
    return np.where(t < 1.0 / V, V * t, 1.0 + V * np.sin(t - 1.0 / V))


@pytest.mark.parametrize("kT", [1e3, 1e5])
def test_belt_oscillator(kT):
    """Through one stick and two periods of sliding, to 1.25 / kT."""
    V, step = 0.7, 1e-3
    t, q, rows = block(kT, step, x=0.0, v=V, V=V, contact=STICK).follow(15.0, 8)
    assert np.abs(q[:, 1] - belt(t, V)).max() < 1.25 / kT
    slipping = rows[:, STATE_OF] == SLIP
    assert rows[np.argmax(slipping), 0] == pytest.approx(1.0 / V, abs=1.0 / kT + 2.0 * step)
    # The belt runs ahead: P1's surface lags and friction drags it along.
    assert np.all(rows[slipping, T_OF] == rows[slipping, N_OF])
    assert rows[slipping, 4].max() < 1e-3


@pytest.mark.parametrize("dt", [1e-3, 1e-4])
def test_belt_oscillator_by_the_published_scheme(dt):
    """First order: to 1.3 steps."""
    V = 0.7
    rows, _ = stepped(
        [0.0, 1.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0],
        mu=1.0, dt=dt, tau=10.0 * dt, steps=int(15.0 / dt), q=[0.0, 0.0], v=[0.0, V], V=V, held=True,
    )  # fmt: skip
    t = rows[:, 0]
    x = np.cumsum(rows[:, 4]) * dt + V * t
    assert np.abs(x - belt(t, V)).max() < 1.3 * dt
    assert t[np.argmax(rows[:, STATE_OF] == SLIP)] == pytest.approx(1.0 / V, abs=2.0 * dt)


# Bars that fall on a rigid floor (Doyen, Ern, Piperno, SIAM J. Sci. Comput. 33 (2011) 223-249).

YOUNG, LENGTH, SOUND, FALL = 900.0, 10.0, 30.0, 10.0


@lru_cache
def bar(elements, lumped=False):
    """omega^2 and the lower end's displacement in the modes of a free bar of unit section and density."""
    h, line = LENGTH / elements, np.ones(elements)
    ends = np.append(line, 0.0) + np.append(0.0, line)
    beside = np.diag(line, 1) + np.diag(line, -1)
    K, M = YOUNG / h * (np.diag(ends) - beside), h / 6.0 * (2.0 * np.diag(ends) + beside)
    if lumped:
        M = np.diag(M.sum(axis=1))
    k, shapes = eigh(K, M)
    k[0], shapes[:, 0] = 0.0, 1.0 / np.sqrt(LENGTH)
    return k, shapes[0]


def reduced_bar(elements, unit, *, height, speed, weight, z=0.5):
    """Modes below half the highest frequency; the others' flexibility and the bar's own impedance, rho c = 30.

    Forces are counted in `unit`. Returns the system and its height's factor.
    """
    k, end = bar(elements)
    kept = k < 0.25 * k[-1]
    rigid = (np.arange(len(k)) == 0)[kept]
    stiff = 1.0 / np.sum(end[~kept] ** 2 / k[~kept])
    step = z / np.sqrt(stiff * np.sum(end[kept] ** 2))
    f = -weight * end[kept] * rigid
    return Small(
        k[kept], end[kept], 0.0 * end[kept], f, stiff * np.eye(2), SOUND * np.eye(2), mu=0.0, step=step,
        q=unit * height * np.sqrt(LENGTH) * rigid, v=unit * speed * np.sqrt(LENGTH) * rigid, contact=SEPARATION,
    )  # fmt: skip


def contacts(t, N, gap=0.05):
    """Begin and end of each contact; shorter gaps do not end one."""
    touching = t[N > 0.0]
    parts = np.split(touching, np.flatnonzero(np.diff(touching) > gap) + 1)
    return np.array([(part[0], part[-1]) for part in parts])


def about(t, N, when):
    """Mean pressure within 0.05 s, some periods of the fastest modes."""
    return np.array([N[np.abs(t - x) < 0.05].mean() for x in when])


@pytest.mark.parametrize(
    ("elements", "duration", "mean"), [(50, 0.009, 0.0145), (100, 0.0048, 0.0073), (200, 0.0032, 0.0046)]
)
def test_impacting_bar(elements, duration, mean):
    """Pressure rho c v = 300 for 2 L / c: duration (s) and mean pressure (relative) nearer with the mesh.

    Consistent mass disperses the front, with an error that falls like h^(2/3).
    """
    # So violent that the kernel's load of 1 is nothing beside it.
    unit = 1e8
    system = reduced_bar(elements, unit, height=5.0, speed=-10.0, weight=0.0)
    rows = system.run(int(1.6 / system.step))
    t, N = rows[:, 0], rows[:, N_OF] / unit
    (begin, end), *others = contacts(t, N, gap=0.0015 + 2.0 * system.step)
    assert not others
    assert begin == pytest.approx(0.5, abs=2.0 * system.step)
    # From the middle of the first step in contact to that of the last; each of them lasts a whole step.
    assert end - begin + system.step == pytest.approx(2.0 * LENGTH / SOUND, abs=duration)
    within = (t >= begin) & (t <= begin + 2.0 * LENGTH / SOUND)
    assert N[within].mean() == pytest.approx(300.0, rel=mean)
    # Twice the momentum it came with, but for what rings on in the bar and what its end has absorbed.
    assert np.sum(N) * system.step == pytest.approx(200.0, rel=mean)
    np.testing.assert_allclose(about(t, N, begin + np.array([0.15, 0.3, 0.5])), 300.0, rtol=0.03)


@pytest.mark.parametrize(
    ("lumped", "b", "share", "ripple", "peak"),
    [(True, 0.5, 1.0, 1e-9, 300.0), (False, 0.8, 0.9, 1e-4, 305.3), (False, 0.5, 0.9, 0.25, 464.7)],
)
def test_impacting_bar_by_the_published_scheme(lumped, b, share, ripple, peak):
    """Exact with lumped mass at the Courant limit; beta2 = 0.8 calms consistent mass, beta2 = 0.5 leaves 55 %.

    That overshoot, to 465, does not depend on the mesh; the 373 quoted for consistent mass is not met.
    """
    k, end = bar(100, lumped)
    rigid = 1.0 * (np.arange(len(k)) == 0)
    dt = share * np.sqrt(2.0 / b / k[-1])
    rows, _ = stepped(
        k, 0.0 * k, end, 1e-9 * rigid, 0.0 * k, mu=0.0, dt=dt, steps=int(1.4 / dt),
        q=5.0 * np.sqrt(LENGTH) * rigid, v=-10.0 * np.sqrt(LENGTH) * rigid, b=b,
    )  # fmt: skip
    t, N = rows[:, 0], rows[:, N_OF]
    ((begin, ends),) = contacts(t, N)
    assert ends - begin == pytest.approx(2.0 * LENGTH / SOUND, abs=0.006)
    middle = (t > begin + 0.1) & (t < begin + 2.0 * LENGTH / SOUND - 0.1)
    np.testing.assert_allclose(N[middle], 300.0, rtol=ripple)
    assert N[t > begin + 5.0 * dt].max() == pytest.approx(peak, rel=2e-3)


@pytest.mark.parametrize(("elements", "error"), [(100, 0.07), (400, 0.027)])
def test_bouncing_bar(elements, error):
    """Dropped from 5 under its weight, the bar is where it was after 16 / 3 s: two bounces.

    Undeformed at 1 s, pressure rises from 300 by rho g c t to 500 in 2 L / c, the same wave that makes 300 of
    v = 10 bringing the weight. It leaves deformed as twice its static self, with v = 10, and 2 s of flight are
    three periods of its modes: all is reversed, pressure falls from 500 to 300 and the bar leaves undeformed.
    """
    unit = 1.0 / (LENGTH * FALL)
    system = reduced_bar(elements, unit, height=5.0, speed=0.0, weight=1.0)
    times, q, rows = system.follow(6.9, 20)
    t, N = rows[:, 0], rows[:, N_OF] / unit
    centre = q[:, 0] / (unit * np.sqrt(LENGTH))
    bounce = 2.0 * LENGTH / SOUND
    found = contacts(t, N)[:2]
    expected = np.array([[1.0, 1.0 + bounce], [3.0 + bounce, 3.0 + 2.0 * bounce]])
    np.testing.assert_allclose(found, expected, atol=error)
    rising = about(t, N, found[0, 0] + np.array([0.1, 0.5 * bounce, bounce - 0.1]))
    falling = about(t, N, found[1, 0] + np.array([0.15, 0.5 * bounce]))
    np.testing.assert_allclose(
        rising, 300.0 + 300.0 * np.array([0.1, 0.5 * bounce, bounce - 0.1]), rtol=0.25 * error
    )
    np.testing.assert_allclose(falling, 500.0 - 300.0 * np.array([0.15, 0.5 * bounce]), rtol=1.5 * error)
    later = times > 4.0
    top = np.argmax(centre[later])
    assert times[later][top] == pytest.approx(16.0 / 3.0, abs=error)
    assert centre[later][top] == pytest.approx(5.0, abs=5.0 * error)
    # Mean force is the weight, over the period that has passed.
    period = t < times[later][top]
    assert N[period].mean() == pytest.approx(LENGTH * FALL, rel=1e-3)


# Mode coupling: K = [[k11, k12 - mu kn], [k12, k22]], unit masses; kn is the contact's.

K11, K12, K22, KN = 3.0, 0.7, 1.6, 1.0
CRITICAL = (K12 + (K11 - K22) ** 2 / (4.0 * K12)) / KN


def poles(y, step, count):
    """Exponents of a sum of `count` exponentials, by linear prediction."""
    columns = np.stack([y[count - 1 - j : len(y) - 1 - j] for j in range(count)], axis=1)
    ahead, *_ = np.linalg.lstsq(columns, y[count:], rcond=None)
    return np.log(np.roots(np.concatenate([[1.0], -ahead])).astype(complex)) / step


def coupled(mu, step, seed, tau, V=1e3):
    """Two modes in steady sliding with a seed, and the exponent it should grow with; always slipping one way."""
    # x -> -x turns K12 - mu KN into -(K12 - mu KN): friction along +x of a belt that runs ahead.
    k, modes = np.linalg.eigh([[K11, -K12], [-K12, K22 - KN]])
    tangential, normal = modes
    along = normal + mu * tangential
    q = -normal / KN
    matrix = np.block(
        [
            [np.zeros((2, 2)), np.eye(2)],
            [-np.diag(k) - KN * np.outer(along, normal), -tau * KN * np.outer(along, normal)],
        ]
    )
    values, vectors = np.linalg.eig(matrix)
    i = int(np.argmax(values.real + 1e-3 * (values.imag > 0.0)))
    z = seed * vectors[:, i].real
    K = np.diag([KN, 1e3])
    system = Small(
        k, normal, tangential, k * q - along, K, tau * K, mu=mu, step=step, q=q + z[:2], v=z[2:], V=V,
        u=(1.0 / KN - normal @ z[:2], mu / 1e3),
    )  # fmt: skip
    return system, values[i]


@pytest.mark.parametrize("tau", [0.0, 0.05])
@pytest.mark.parametrize("ratio", [1.05, 1.2])
def test_mode_coupling_grows_at_its_eigenvalues_rate(ratio, tau):
    """Growth to 0.5 %, frequency to 0.05 %, with 80 steps a period; tau damps the contact."""
    step = 0.05
    system, expected = coupled(ratio * CRITICAL, step, 1e-5, tau)
    rows = system.run(int(40.0 / step))
    assert np.all(rows[:, STATE_OF] == SLIP)
    found = poles((rows[:, N_OF] - 1.0)[200::8], 8 * step, 5)
    found = found[np.argmin(np.abs(found - expected))]
    assert found.real == pytest.approx(expected.real, rel=5e-3)
    assert found.imag == pytest.approx(expected.imag, rel=5e-4)


@pytest.mark.parametrize(("ratio", "grows"), [(0.98, False), (0.999, False), (1.001, True), (1.02, True)])
def test_mode_coupling_begins_at_the_critical_friction(ratio, grows):
    rows = coupled(ratio * CRITICAL, 0.05, 1e-7, 0.0)[0].run(8000)
    y = np.abs(rows[:, N_OF] - 1.0)
    quarter = len(y) // 4
    growth = y[-quarter:].max() / y[:quarter].max()
    assert growth > 10.0 if grows else growth < 2.0


# Balances.


def drag(step, d1=0.0):
    """A block that slips to and fro on a belt and sticks at last."""
    return block(1e3, step, x=12.0, v=6.0, V=0.3, d1=d1)


def impact(step):
    """A bar that bounces."""
    return reduced_bar(50, 1.0 / (LENGTH * FALL), height=1.0, speed=0.0, weight=1.0, z=step)


def ride(step):
    """A block on a belt too fast to be caught: friction is constant."""
    return block(1e3, step, x=12.0, v=6.0, V=100.0)


def couple(step):
    """Two coupled modes that slide: friction and normal force grow together."""
    return coupled(1.05 * CRITICAL, step, 0.05, 0.05, V=10.0)[0]


@pytest.mark.parametrize(
    ("case", "duration", "steps", "error", "falls"),
    [
        (ride, 8.0, (4e-3,), 1e-11, 0.0),
        (couple, 20.0, (0.1, 0.05, 0.025, 0.0125), 4e-3, 1.7),
        (drag, 40.0, (8e-3, 4e-3, 2e-3), 3e-6, 1.6),
        # The kernel samples modal damping every SAMPLED-th step.
        (partial(drag, d1=0.02), 40.0, (8e-3, 4e-3, 2e-3), 1.25e-4 * SAMPLED, 1.8),
        (impact, 3.0, (0.4, 0.2, 0.1, 0.05), 5e-3, 1.6),
    ],
)
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


# The rig itself.


def sliding_state(rig, theta, mu, V, F, pair=0, size=0.0):
    """Steady sliding and a multiple of an unstable mode, and that mode's exponent; ramp = 0."""
    model, modes = full_model(rig, theta), sliding_modes(rig, theta, mu)
    elastic = model.stiffness > 0.0
    force = model.normal + mu * model.tangential
    # At rest under the unit load stiffness times displacement is load plus normal force.
    load = np.where(elastic, model.stiffness * model.rest, 0.0) - model.normal
    q = np.zeros(len(force))
    q[elastic] = (load + force)[elastic] / model.stiffness[elastic]
    q[~elastic] = -(model.normal @ q) / model.normal[~elastic]
    # Relative to a clamp that starts with a jerk, P2 must move for it to be at V at once.
    v = -model.inertia * V / F
    if not size:
        return State(F * q, F * v, SLIP), None
    i = np.flatnonzero(modes.unstable)[pair]
    phi = complex(modes.growth_rate[i], 2.0 * np.pi * modes.frequency[i])
    shape = size * force / (model.stiffness + model.damping * phi + phi**2)
    return State(F * (q + shape.real), F * (v + (phi * shape).real), SLIP), phi


METHODS = {
    "fast": {"method": "fast"},
    "fast, 75 kHz, half the step": {"method": "fast", "cutoff": 75e3, "step": 6e-7},
    "exact": {"method": "exact", "cutoff": 75e3},
    "exact, damped element": {
        "method": "exact",
        "cutoff": 75e3,
        "modify": partial(with_relaxation_time, tau=3.2e-7),
    },
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
    time = runs[0].time
    return (runs[0].normal_force - runs[1].normal_force)[slipping // 10 : slipping], time[1] - time[0], phi


def nearest_pole(y, step, phi):
    """Of four: the pair and what else there is; in means over a twelfth of a period (exponentials stay so)."""
    every = max(round(0.5 / (abs(phi) * step)), 1)
    whole = len(y) // every * every
    found = poles(y[:whole].reshape(-1, every).mean(axis=1), every * step, 4)
    return found[np.argmin(np.abs(found - phi))]


# With ten times the paper's stiffness damping; and with the paper's, where pairs of 54 to 145 kHz (the reduced
# model has none above its cut-off) grow at up to 6700 1/s and separate the surfaces within a millisecond or two,
# before 398 Hz has been through a period.
SEEDED = [(name, pair, 1e-7, 2e-3 if name == "paper" else 5e-4) for name in METHODS for pair in (0, 1)]
SEEDED += [(name, 1, 1e-8, 5e-3) for name in ("fast, 75 kHz, half the step", "exact", "paper")]
SEEDED += [("exact, damped element", 0, 1e-8, 5e-3)]


@pytest.mark.parametrize(("name", "pair", "d2", "error"), SEEDED)
def test_a_seeded_mode_grows_at_its_eigenvalues_rate(name, pair, d2, error):
    """398 Hz, 384 1/s and 2794 Hz, 1764 1/s (1750 with more damping)."""
    duration = 6e-3 if pair == 0 else 2e-3 if d2 == 1e-8 else 2.5e-3
    y, step, phi = seeded(Rig(d2=d2), pair, duration, METHODS[name])
    if d2 == 1e-8:
        assert phi.real == pytest.approx((384.0, 1764.0)[pair], abs=0.5)
        assert phi.imag / (2.0 * np.pi) == pytest.approx((398.0, 2794.0)[pair], abs=0.5)
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
    rng = np.random.default_rng(3)
    shaken = start.velocity + 1e-4 * rng.standard_normal(len(start.velocity))
    run = simulate(
        Scene(0.1, theta, mu, F, rig), 0.05, method, ramp=0.0,
        initial=State(start.displacement, shaken, SLIP), record=True,
    )  # fmt: skip
    assert np.ptp(run.normal_force[: len(run.time) // 20]) > 0.01
    late = run.time > 0.045
    np.testing.assert_allclose(run.normal_force[late], F, rtol=1e-6)
    np.testing.assert_allclose(run.tangential_force[late], mu * F, rtol=1e-6)
    np.testing.assert_allclose(run.slip_velocity[late], -0.1, rtol=1e-4)
    assert np.all(run.state[late] == SLIP)
