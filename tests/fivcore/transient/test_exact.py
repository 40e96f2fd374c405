"""The exact method: integration in extended precision, energy, events, touch-down, and the order of fast."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.polynomial.polynomial import polyval

from fivcore import ContactError, DivergenceError, Rig, Scene, simulate
from fivcore.contact.ablation import with_relaxation_time
from fivcore.contact.reduced import ReducedModel, full_model, reduced_model
from fivcore.transient import exact
from fivcore.transient import fast_scene as at
from fivcore.transient.exact import DWELL, HELD, ExactRun, states_at
from fivcore.transient.exact_kernels import DRAG, PULL, Q_R, V_R, A, P, S, search, waves_at
from fivcore.transient.fast import FastRun
from fivcore.transient.fast_solver import take
from fivcore.transient.normalised import Normalised, State, slip_distance
from fivcore.transient.options import Options
from fivcore.transient.statistics import ENERGIES, STICK
from tests.helpers.rigs import workshop_rig

RAMP, CUTOFF = 1e-3, 75e3
# First slip after 8 ms, first separation about 3 ms later.
SCENE = Normalised.of(Scene(0.02, 5.0, 0.2, 9.0))
LONG, EPS = np.longdouble, np.finfo(float).eps


def exact_run(scene: Normalised = SCENE, kind: type[ExactRun] = ExactRun, duration: float = 1.0, **given):
    """A run that counts from its start."""
    usual = {"ramp": RAMP, "cutoff": CUTOFF, "settle": 0.0}
    return kind(scene, Options(duration, "exact", **usual | given))


def run_for(run: ExactRun) -> ExactRun:
    """Take a run to its end."""
    while not run.done:
        ExactRun.advance([run])
        assert run.calm(1e-150)
    return run


def counted(run: ExactRun, *names: str) -> np.ndarray:
    """Counters of a run."""
    return np.array([float(run.record[name][0]) for name in names])


def energy_residual(run: ExactRun) -> float:
    work, *lost = counted(run, *ENERGIES)
    parts = np.array([work, run.released_energy(), *(-part for part in lost)])
    return float(abs(parts.sum()) / np.abs(parts).sum())


class Reference:
    """The reduced model in extended precision: whole displacements, u as a state of its own, Taylor series.

    States are q, v, u_N, u_T, the clamp's velocity and 1. Events are looked for at every one of many small steps
    and located on the step's Taylor polynomial: neither eigenbases nor bounds, nothing of the module's own.
    """

    def __init__(self, model: ReducedModel, scene: Normalised, ramp: float, step: float) -> None:
        self.step, self.ramp = LONG(step), LONG(ramp)
        names = ("stiffness", "damping", "normal", "tangential", "inertia", "rest", "K", "C")
        k, c, a, b, inertia, rest, K, C = (LONG(getattr(model, name)) for name in names)
        n, mu = len(k), LONG(scene.mu)
        unit = np.eye(2 * n + 4, dtype=LONG)
        q, v, u, P, one = unit[:n], unit[n : 2 * n], unit[2 * n : 2 * n + 2], unit[-2], unit[-1]
        rates = {"stick": np.stack([-(a @ v), P - b @ v]), "open": -u * K[0, 0] / C[0, 0]}
        for name, m in (("up", mu), ("down", -mu)):
            # K_T u + C_T u' = m (K_N u + C_N u'), u_N' = -n.v
            row = (K[1] - m * K[0]) @ u - (C[1, 0] - m * C[0, 0]) * (a @ v)
            rates[name] = np.stack([-(a @ v), -row / (C[1, 1] - m * C[0, 1])])
        self.matrix, self.watched, self.flow = {}, {}, {}
        for name, rate in rates.items():
            force = K @ u + C @ rate
            slip = b @ v - P + rate[1]
            forces = np.outer(k * rest - a, one) + np.outer(a, force[0]) + np.outer(b, force[1])
            for push in (LONG(scene.speed_per_load) / self.ramp, LONG(0.0)):
                acceleration = forces - k[:, None] * q - c[:, None] * v + np.outer(inertia, push * one)
                self.matrix[name, push > 0.0] = np.vstack([v, acceleration, rate, push * one, 0.0 * one])
            self.watched[name] = {
                "stick": [(mu * force[0] - force[1], "up"), (mu * force[0] + force[1], "down")],
                "up": [(-slip, "stick"), (force[0], "open")],
                "down": [(slip, "stick"), (force[0], "open")],
                "open": [],
            }[name]
        self.flow = {key: sum(self._terms(matrix, unit, self.step)) for key, matrix in self.matrix.items()}
        flexible = np.linalg.inv(model.K)[:, 0]
        self.y = np.concatenate([rest, np.zeros(n), flexible, [0.0, 1.0]]).astype(LONG)
        self.n, self.t, self.regime, self.switches = n, LONG(0.0), "stick", []

    @staticmethod
    def _terms(matrix, start, h=1.0):
        """Terms of the Taylor series after a time h; of a time of one: its coefficients."""
        terms = [start]
        for j in range(1, 26):
            terms.append(matrix @ terms[-1] * (h / j))
        return np.stack(terms)

    def advance(self, until) -> bool:
        """Go on to `until`; False, and no further, where the surfaces part."""
        until = LONG(until)
        while self.t < until:
            ramping = self.t < self.ramp
            end = min(until, self.ramp) if ramping else until
            h, key = min(self.step, end - self.t), (self.regime, ramping)
            whole = h == self.step
            new = self.flow[key] @ self.y if whole else self._terms(self.matrix[key], self.y, h).sum(axis=0)
            crossed = [(row, after) for row, after in self.watched[self.regime] if row @ new < 0.0]
            if not crossed:
                self.y, self.t = new, self.t + h if whole else end
                continue
            series = self._terms(self.matrix[key], self.y)
            at, after = min((self._root(series @ row, h), after) for row, after in crossed)
            self.y = polyval(at, series)
            self.t, self.regime = self.t + at, after
            self.switches.append((float(self.t), after))
            if after == "open":
                return False
        return True

    @staticmethod
    def _root(polynomial, h):
        """Bisection: where it leaves the positive values for the negative one at h."""
        low, high = LONG(0.0), h
        for _ in range(80):
            middle = (low + high) / 2
            low, high = (middle, high) if polyval(middle, polynomial) > 0.0 else (low, middle)
        return high


@pytest.mark.skipif(np.finfo(LONG).eps > 1e-18, reason="this machine has no extended precision")
def test_trajectories_up_to_the_first_separation():
    model = reduced_model(SCENE.rig, SCENE.theta, CUTOFF)
    run = run_for(exact_run(duration=0.012))
    slip, separation = counted(run, "first_slip", "first_separation")
    assert slip < separation < 0.012
    reference = Reference(model, SCENE, RAMP, 1e-7)
    # Nothing happens before the first slip.
    stuck = Reference(model, SCENE, RAMP, 1e-6)
    times = np.concatenate([[0.5e-3, 2e-3, 7e-3], np.linspace(slip, separation, 7)[1:-1], [separation - 1e-9]])
    found = states_at(SCENE, times, ramp=RAMP, cutoff=CUTOFF)
    n = reference.n
    for t, state in zip(times, found, strict=True):
        if t < 7.5e-3:
            assert stuck.advance(t)
            reference.y, reference.t = stuck.y, stuck.t
        assert reference.advance(t)
        expected = np.concatenate([reference.y[:n] - model.rest, reference.y[n : 2 * n]]).astype(float)
        for part in (slice(None, n), slice(n, 2 * n)):
            assert np.abs(state[part] - expected[part]).max() < 1e-10 * np.abs(expected[part]).max()
    # The surfaces part for 90 ns, which steps of 100 ns pass by.
    fine = Reference(model, SCENE, RAMP, 1e-9)
    fine.y, fine.t, fine.regime = reference.y, reference.t, reference.regime
    assert not fine.advance(separation + 1e-8)
    assert reference.switches[0] == (pytest.approx(slip, rel=1e-13), "up")
    assert fine.switches == [(pytest.approx(separation, rel=1e-12), "open")]
    assert len(reference.switches) > 10


def test_energy_and_mean_force_over_many_events():
    run = run_for(exact_run(duration=0.06))
    switches, impact, work, sum_N = counted(run, "switches", "impact", "work", "sum_N")
    assert switches > 1000
    assert energy_residual(run) < 1e-12
    assert run.held < 0.01 * switches
    # Nothing is lost in deciding between regimes.
    assert abs(impact) < 1e-9 * work
    mean = sum_N / counted(run, "separation_time", "stick_time", "slip_time").sum()
    assert mean == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("seed", range(3, 9))
def test_energy_of_other_rigs(seed):
    rig, theta, mu = workshop_rig(seed, seed % 2 > 0), 3.0 * seed - 12.0, 0.3
    distance = slip_distance(Normalised.of(Scene(1.0, theta, mu, 1.0, rig)))
    scene = Normalised.of(Scene(1e3 * distance, theta, mu, 1.0, rig))
    run = run_for(exact_run(scene, duration=0.01, ramp=0.0 if seed < 6 else RAMP, cutoff=30e3))
    assert run.record["switches"] > 1
    assert energy_residual(run) < 1e-10


def value_and_slope(eigenvalues, factors, start, s):
    """One function of `search` and its derivative at s."""
    m, out = len(eigenvalues), np.empty(len(factors), dtype=complex)
    waves_at(eigenvalues, start, s, out)
    waves, d, forced = factors[:m] * np.exp(eigenvalues * s), out[m:].real, factors[m:].real
    slope = forced[S] * d[P] + forced[P] * d[A] + forced[Q_R] * d[V_R]
    slope += forced[V_R] * (start[PULL] - start[DRAG] * d[V_R])
    return waves.sum().real + forced @ d, (waves * eigenvalues).sum().real + slope


NO_START = np.zeros(8)
NO_START[3] = 1.0


def waves(*terms):
    """Rates and factors for `search`, from pairs of rate and amplitude, without drift."""
    rates = np.array([rate for rate, _ in terms], dtype=complex)
    return rates, np.array([[*(amplitude for _, amplitude in terms), *np.zeros(6)]], dtype=complex)


def test_a_pair_of_crossings_between_samples_is_found():
    omega, phase = 2.0 * np.pi * 1e5, 0.7
    for dip in (1e-6, 1e-9, 1e-12):
        # 1 - dip + cos: negative for about sqrt(8 dip) / omega, 4.5 ns down to 4.5 ps.
        system = waves((0.0, 1.0 - dip), (1j * omega, np.exp(1j * phase)))
        time, which = search(*system, NO_START, np.zeros(1, dtype=np.int64), 1e-3)
        assert which == 0
        assert time == pytest.approx((np.pi - phase - np.sqrt(2.0 * dip)) / omega, abs=2e-14)
        near = waves((0.0, 1.0 + dip), (1j * omega, np.exp(1j * phase)))
        assert search(*near, NO_START, np.zeros(1, dtype=np.int64), 1e-4) == (1e-4, -1)


def test_the_first_crossing_of_random_sums_is_found():
    rng = np.random.default_rng(4)
    found = 0
    for _ in range(40):
        rates = rng.uniform(-3e4, 2e3, 6) + 1j * rng.uniform(1e3, 1e6, 6)
        parts = rng.normal(size=(1, 6)) + 1j * rng.normal(size=(1, 6))
        drift, start = np.zeros((1, 6)), np.array([1e-3, 2.0, 1e3, 1.0, 0.0, 0.0, 0.0, 0.0])
        drift[0, :4] = rng.normal(), rng.normal(), 0.0, 12.0 * rng.uniform()
        factors = np.hstack([parts, drift])
        factors[0, 9] += max(0.0, 0.1 - value_and_slope(rates, factors[0], start, 0.0)[0])
        drift = factors[:, 6:].real
        time, which = search(rates, factors, start, np.zeros(1, dtype=np.int64), 1e-4)
        t = np.linspace(0.0, 1e-4, 20_001)
        f = (parts[0] * np.exp(np.outer(t, rates))).real.sum(axis=1)
        f += drift[0, 0] * (1e-3 + 2.0 * t + 500.0 * t**2) + drift[0, 1] * (2.0 + 1e3 * t) + drift[0, 3]
        assert (f[t < time - 1e-12] > 0.0).all()
        if which == 0:
            value, slope = value_and_slope(rates, factors[0], start, time)
            assert abs(value / slope) < 1e-13
            found += 1
        else:
            assert (f > 0.0).all()
    assert 10 < found < 40


@pytest.mark.parametrize("order", [1, 2])
def test_what_begins_at_zero_departs_and_returns(order):
    """sin and (1 - cos)(1 + 2 sin): no crossing at the start, and the next one found."""
    omega = 1e5
    sums = {
        1: (waves((1j * omega, -1j)), np.pi),
        2: (waves((0.0, 1.0), (1j * omega, -1.0 - 2.0j), (2j * omega, 1.0j)), 7.0 * np.pi / 6.0),
    }
    (rates, parts), expected = sums[order]
    time, which = search(rates, parts, NO_START, np.array([order], dtype=np.int64), 5.0 / omega)
    assert which == 0
    assert omega * time == pytest.approx(expected, abs=1e-8)
    assert search(rates, -parts, NO_START, np.array([order], dtype=np.int64), 1.0) == (0.0, 0)


class Landing(ExactRun):
    """Keeps the time and the closing rates of each touch-down and the energy that is booked as impact there."""

    landings: list

    def _decide(self, t, y, was, touchdown=False):
        n = len(self.model.stiffness)
        closing = self.model.shapes @ y[n : 2 * n] - [0.0, self._clamp_velocity(t)]
        before = float(self.record["impact"][0])
        super()._decide(t, y, was, touchdown)
        if touchdown:
            self.landings.append((t, closing, float(self.record["impact"][0]) - before))


def test_touch_down_on_the_dashpot():
    """N jumps by the dashpot's resistance times the closing speed; without friction T gives way to none."""
    scene = Normalised.of(Scene(0.01, 5.0, 0.0, 9.0))
    # P1 above P2 and moving down as a whole.
    full = full_model(scene.rig, scene.theta)
    q, v = np.zeros((2, len(full.stiffness)))
    rigid = full.stiffness == 0.0
    q[rigid], v[rigid] = 1e-9 / full.normal[rigid], -1e-2 / full.normal[rigid]
    run = exact_run(scene, initial=State(q, v, 0), kind=Landing, duration=2e-7, step=1e-8)
    run.landings = []
    run_for(run)
    ((t, closing, lost),) = run.landings
    C, r = run.model.C, run._regime
    jump = -(C[0, 0] - C[0, 1] ** 2 / C[1, 1]) * closing[0]
    N, _ = value_and_slope(r.eigenvalues, r.margins[0] * run._amplitudes, run._start, 0.0)
    assert t == pytest.approx(1e-7, rel=0.01)
    assert pytest.approx(jump, rel=1e-9) == N
    assert abs(lost) < 1e-12 * closing[0] ** 2


def fast_state(step: float, time: float, termination: str = "absorbing") -> np.ndarray:
    """Displacements of fast in the middle of the step that contains `time`, which is such a middle."""
    steps = round(time / step - 0.5)
    options = Options(steps * step, ramp=RAMP, cutoff=CUTOFF, termination=termination, step=step)
    run = FastRun(SCENE, options)
    assert run.steps == steps
    while not run.done:
        FastRun.advance([run])
    return take(run.blocks, at.Q, len(run.model.rest)) + run._shift


@pytest.mark.parametrize(("near", "most"), [(0.0085, 2e-8), (0.0100, 1e-5)])
def test_fast_converges_to_it_with_order_two(near, most):
    """In the first slip, and after dozens of changes between slip and stick just before the first separation."""
    errors = []
    for halving in range(3):
        step = 3e-7 / 2**halving
        time = (round(near / step) + 0.5) * step
        expected = states_at(SCENE, np.array([time]), ramp=RAMP, cutoff=CUTOFF)[0]
        found = fast_state(step, time)
        errors.append(np.abs(found - expected[: len(found)]).max() / np.abs(expected[: len(found)]).max())
    ratios = np.array(errors[:-1]) / errors[1:]
    assert errors[-1] < most
    assert np.all(ratios > 3.5), (errors, ratios)
    # One halving may do better by chance, as changes fall here or there within a step.
    assert np.sqrt(np.prod(ratios)) < 5.0, (errors, ratios)


@pytest.mark.parametrize("termination", ["elastic", "none"])
def test_fast_converges_with_order_two_without_the_absorbing_element(termination):
    """In the first slip, against its own motion at a 27th of the largest step."""
    steps = 8.1e-7 / 3.0 ** np.arange(4)
    # The middle of a step of each.
    time = (round(0.0085 / steps[0]) + 0.5) * steps[0]
    *states, finest = (fast_state(step, time, termination) for step in steps)
    errors = np.array([np.abs(state - finest).max() for state in states]) / np.abs(finest).max()
    assert errors[-1] < 1e-6
    assert np.all(errors[:-1] / errors[1:] > 8.0), errors


def test_sampled_rows_and_segments():
    """Rows are the exact motion in the middle of each sampled step, and segments join without a seam."""
    run, segments = exact_run(duration=0.05, record=("velocity_B",), step=1e-6), []
    while not run.done:
        ExactRun.advance([run])
        segments += run.segments
    assert len(segments) == 2
    rows, samples = (np.concatenate([getattr(each, name) for each in segments]) for name in ("rows", "samples"))
    # Samples every 20 microseconds are those of the rows that are there.
    t = np.concatenate([each.t for each in segments])
    assert len(t) == 2500
    np.testing.assert_allclose(t, rows[::2, 0], rtol=1e-12)
    np.testing.assert_array_equal(samples[:, :3], rows[::2][:, [1, 4, 2]])
    assert len(rows) == 5000
    np.testing.assert_allclose(np.diff(rows[:, 0]), 1e-5, rtol=1e-6)
    first = rows[rows[:, 0] < 0.0105]
    states = states_at(SCENE, first[:, 0], ramp=RAMP, cutoff=CUTOFF)
    n = len(run.model.stiffness)
    velocity = states[:, n : 2 * n] @ run.model.point_b
    np.testing.assert_allclose(first[:, 1], velocity, atol=1e-13 + 1e-9 * np.abs(velocity).max())
    assert (rows[rows[:, 5] == 0][:, 2:4] == 0.0).all()
    assert (rows[rows[:, 5] == 1][:, 4] == 0.0).all()
    slipping = rows[rows[:, 5] == 2]
    np.testing.assert_allclose(np.abs(slipping[:, 3]), SCENE.mu * slipping[:, 2], rtol=1e-9)
    assert (slipping[:, 3] * slipping[:, 4] < 0.0).all()


@pytest.mark.parametrize("contact", [0, 1, 2])
def test_any_start_keeps_its_energy_balance(contact):
    """A start that contradicts its contact state is put right, and what that takes is counted."""
    full = full_model(SCENE.rig, SCENE.theta)
    rng = np.random.default_rng(contact)
    moved = full.rest + 1e-8 * rng.normal(size=len(full.rest)) / np.sqrt(1.0 + full.stiffness / 1e8)
    initial = State(moved, 1e-4 * rng.normal(size=len(moved)), contact)
    run = run_for(exact_run(duration=0.005, initial=initial))
    assert energy_residual(run) < 1e-10


def test_graze_on_the_tip_of_the_cone_is_held():
    """mu = 0: stick has no room at all, and what is found at once is acted on a dwell later."""
    run = exact_run(Normalised.of(Scene(0.02, 5.0, 0.0, 9.0)))
    assert (run._event, run._stop) == (HELD, DWELL)
    assert run.held == 1


def test_no_unique_contact_is_an_error_before_the_first_step():
    with pytest.raises(ContactError, match="not unique"):
        exact_run(Normalised.of(Scene(0.01, 40.0, 30.0, 9.0)))


def test_without_a_dashpot_it_refuses_and_what_it_advises_works():
    scene, none = Scene(0.02, 5.0, 0.2, 9.0), partial(with_relaxation_time, tau=0.0)
    text = r"cutoff = 20000: the relaxation time .* is 0.* another cutoff or method 'fast'"
    with pytest.raises(ValueError, match=text):
        simulate(scene, 1e-4, "exact", cutoff=20e3, modify=none)
    simulate(scene, 1e-4, "fast", cutoff=20e3, modify=none)
    simulate(scene, 1e-4, "exact", cutoff=75e3)
    simulate(scene, 1e-4, "exact", cutoff=20e3, modify=partial(with_relaxation_time, tau=1e-7))


def test_a_slow_mode_costs_no_digits():
    """At d1 = 1e5 1/s the slowest mode creeps, and the forced solution is ten decades above the motion."""
    simulate(Scene(0.143067, 5.0, 0.0, 9.0, Rig(d1=1e5)), 1e-3, "exact")
    simulate(Scene(0.02, 5.0, 0.2, 9.0, Rig(d1=1e5)), 1e-3, "exact")


def test_a_motion_that_is_not_finite_is_an_error():
    run = exact_run()
    with pytest.raises(DivergenceError, match="blown up at t = 0 s"):
        run._enter(0.0, STICK, np.full(2 * len(run.model.stiffness) + 2, np.nan))


def test_the_last_bits_of_the_damping_decide_nothing(monkeypatch):
    """Flutter amplifies what rounding does to an eigenbasis, the more the worse its coordinates are chosen."""
    found = []
    for bits in (0, -5, 4):

        def nearly(*arguments, share=1.0 + bits * EPS):
            model = reduced_model(*arguments)
            return replace(model, C=model.C * share)

        monkeypatch.setattr(exact, "reduced_model", nearly)
        run = run_for(exact_run(duration=0.012))
        events = counted(run, "first_slip", "first_separation")
        times = events[1] * np.array([0.1, 0.3, 0.6, 0.9, 0.99])
        found.append((states_at(SCENE, times, ramp=RAMP, cutoff=CUTOFF)[:, :-2], events))
        assert energy_residual(run) < 1e-13
    (states, events), *others = found
    weights = np.append(run.model.stiffness, np.ones(len(run.model.stiffness)))
    for there, later in others:
        change = np.sqrt((weights * (there - states) ** 2).sum(axis=1) / (weights * states**2).sum(axis=1))
        assert 0.0 < change.max() < 1e-8
        assert np.abs(later - events).max() < 1e-12
