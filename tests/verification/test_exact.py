"""Event to event: trajectories beside extended precision, energy, the search for events, touch-down."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial.polynomial import polyval

from fivcore import Rig, Scene, simulate
from fivcore.contact.reduced import full_model, reduced_model
from fivcore.transient import exact
from fivcore.transient.exact import ExactRun, states_at
from fivcore.transient.normalised import Normalised, State, slip_distance
from fivcore.transient.options import RunOptions
from tests.helpers.exact_runs import counted, energy_residual, run_for
from tests.helpers.rigs import workshop_rig

RAMP, CUTOFF = 1e-3, 75e3
# First slip after 8 ms, first separation about 3 ms later.
SCENE = Normalised.of(Scene(0.02, 5.0, 0.2, 9.0))
LONG, EPS = np.longdouble, np.finfo(float).eps


def exact_run(scene=SCENE, kind=ExactRun, duration=1.0, **given):
    """A run that counts from its start."""
    usual = {"ramp": RAMP, "cutoff": CUTOFF, "settle": 0.0}
    return kind(scene, RunOptions(duration=duration, method="exact", **usual | given))


class Reference:
    """The reduced model in extended precision: whole displacements, u as a state of its own, Taylor series.

    States are q, v, u_N, u_T, the clamp's velocity and 1. Events are looked for at every one of many small steps
    and located on the step's Taylor polynomial: neither eigenbases nor bounds, nothing of the module's own.
    """

    def __init__(self, model, scene, ramp, step):
        self.step, self.ramp = LONG(step), LONG(ramp)
        names = ("stiffness", "damping", "normal", "tangential", "inertia", "static_equilibrium", "K", "C")
        k, c, a, b, inertia, rest, K, C = (LONG(getattr(model, name)) for name in names)
        n, mu = len(k), LONG(scene.mu)
        unit = np.eye(2 * n + 4, dtype=LONG)
        q, v, u, P, one = unit[:n], unit[n : 2 * n], unit[2 * n : 2 * n + 2], unit[-2], unit[-1]
        rates = {"stick": np.stack([-(a @ v), P - b @ v]), "open": -u * K[0, 0] / C[0, 0]}
        for name, m in (("up", mu), ("down", -mu)):
            # K_T u + C_T u' = m (K_N u + C_N u'), u_N' = -n.v
            row = (K[1] - m * K[0]) @ u - (C[1, 0] - m * C[0, 0]) * (a @ v)
            rates[name] = np.stack([-(a @ v), -row / (C[1, 1] - m * C[0, 1])])
        self.matrix, self.watched = {}, {}
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

    def advance(self, until):
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
        q, v = reference.y[: 2 * n].reshape(2, n)
        expected = np.concatenate([q - model.static_equilibrium, v]).astype(float)
        for part in (slice(None, n), slice(n, 2 * n)):
            # Rounding is amplified by flutter after the first slip.
            error = 3e-10 if t < slip else 1e-7
            assert np.abs(state[part] - expected[part]).max() < error * np.abs(expected[part]).max()
    # The surfaces part for 90 ns, which steps of 100 ns pass by.
    fine = Reference(model, SCENE, RAMP, 1e-9)
    fine.y, fine.t, fine.regime = reference.y, reference.t, reference.regime
    assert not fine.advance(separation + 1e-8)
    assert reference.switches[0] == (pytest.approx(slip, rel=1e-10), "up")
    assert fine.switches == [(pytest.approx(separation, rel=1e-10), "open")]
    assert len(reference.switches) > 10


def test_the_last_bits_of_the_damping_decide_nothing(monkeypatch):
    """Flutter amplifies what rounding does to an eigenbasis, the more the worse its coordinates are chosen."""
    found = []
    for bits in (0, -5, 4):
        model = reduced_model(SCENE.rig, SCENE.theta, CUTOFF)
        model = replace(model, C=model.C * (1.0 + bits * EPS))
        monkeypatch.setattr(exact, "reduced_model", lambda *_, nearly=model: nearly)
        run = run_for(exact_run(duration=0.012))
        events = counted(run, "first_slip", "first_separation")
        times = events[1] * np.array([0.1, 0.3, 0.6, 0.9, 0.99])
        found.append((states_at(SCENE, times, ramp=RAMP, cutoff=CUTOFF)[:, :-2], events))
        assert energy_residual(run) < 1e-10
    (states, events), *others = found
    weights = np.append(run.model.stiffness, np.ones(len(run.model.stiffness)))
    for there, later in others:
        change = np.sqrt((weights * (there - states) ** 2).sum(axis=1) / (weights * states**2).sum(axis=1))
        assert 0.0 < change.max() < 1e-7
        assert np.abs(later - events).max() < 1e-12


def test_energy_and_mean_force_over_many_events():
    run = run_for(exact_run(duration=0.06))
    switches, impact, work, sum_N = counted(run, "switches", "impact", "work", "sum_N")
    assert switches > 1000
    assert energy_residual(run) < 1e-10
    assert run.held < 0.01 * switches
    # Nothing is lost in deciding between regimes.
    assert abs(impact) < 1e-9 * work
    mean = sum_N / counted(run, "separation_time", "stick_time", "slip_time").sum()
    assert mean == pytest.approx(1.0, abs=0.02)


def test_in_slip_T_is_mu_N_to_the_last_digits_at_large_friction():
    rig = replace(Rig(), p1=replace(Rig().p1, length=0.06))
    scene = Scene(0.08, -6.3, 1.96, 1.0, rig)
    run = simulate(scene, 2e-3, "exact", ramp=1e-4, record=True, sample_rate=None, settle=0.0)
    N, T = (force[run.state == 2] for force in (run.normal_force, run.tangential_force))
    assert np.count_nonzero(N > 0.0) > 100
    np.testing.assert_allclose(np.abs(T), scene.mu * N, rtol=1e-15, atol=0.0)


@pytest.mark.parametrize("seed", range(3, 9))
def test_energy_of_other_rigs(seed):
    rig, theta, mu = workshop_rig(seed, seed % 2 > 0), 3.0 * seed - 12.0, 0.3
    distance = slip_distance(Normalised.of(Scene(1.0, theta, mu, 1.0, rig)))
    scene = Normalised.of(Scene(1e3 * distance, theta, mu, 1.0, rig))
    run = run_for(exact_run(scene, duration=0.01, ramp=0.0 if seed < 6 else RAMP, cutoff=30e3))
    assert run.record["switches"] > 1
    assert energy_residual(run) < 1e-10


@pytest.mark.parametrize("contact", [0, 1, 2])
def test_any_start_keeps_its_energy_balance(contact):
    """A start that contradicts its contact state is put right, and what that takes is counted."""
    full = full_model(SCENE.rig, SCENE.theta)
    rng = np.random.default_rng(contact)
    away = 1e-8 * rng.normal(size=len(full.normal)) / np.sqrt(1.0 + full.stiffness / 1e8)
    moved = full.static_equilibrium + away
    initial = State(moved, 1e-4 * rng.normal(size=len(moved)), contact)
    assert energy_residual(run_for(exact_run(duration=0.005, initial=initial))) < 1e-10


@pytest.mark.parametrize(("V", "mu"), [(0.143067, 0.0), (0.02, 0.2)])
def test_a_mode_that_creeps_costs_no_digits(V, mu):
    """At d1 = 1e4 1/s and above, the slowest mode creeps, 1e4 times as slowly as the others vibrate."""
    for d1 in (1e4, 1e5):
        run = simulate(Scene(V, 5.0, mu, 9.0, Rig(d1=d1)), 1e-3, "exact")
        assert run.summary["energy_residual"] < 1e-10


class Landing(ExactRun):
    """Keeps the time and the closing rates of each touch-down and the energy that is booked as impact there."""

    def _decide(self, t, y, was, touchdown=False):
        n = len(self.model.stiffness)
        closing = self.model.shapes @ y[n : 2 * n] - [0.0, self._clamp_velocity(t)]
        before = float(self.record["impact"][0])
        super()._decide(t, y, was, touchdown)
        if touchdown:
            now = self.motion[:-7].copy()
            N, _ = self._forces(t, now, self.which)
            self.landings.append((t, closing, float(self.record["impact"][0]) - before, N))


def test_at_touch_down_N_jumps_by_the_dashpots_resistance_times_the_closing_speed():
    """Without friction T gives way to none."""
    scene = Normalised.of(Scene(0.01, 5.0, 0.0, 9.0))
    # P1 above P2 and moving down as a whole.
    full = full_model(scene.rig, scene.theta)
    rigid = np.where(full.stiffness == 0.0, 1.0, 0.0) / full.normal[0]
    assert np.flatnonzero(rigid).tolist() == [0]
    run = exact_run(scene, initial=State(1e-9 * rigid, -1e-2 * rigid, 0), kind=Landing, duration=2e-7, step=1e-8)
    run.landings = []
    ((t, closing, lost, N),) = run_for(run).landings
    C = run.model.C
    jump = -(C[0, 0] - C[0, 1] ** 2 / C[1, 1]) * closing[0]
    assert t == pytest.approx(1e-7, rel=0.01)
    assert pytest.approx(jump, rel=1e-9) == N
    assert abs(lost) < 1e-12 * closing[0] ** 2
