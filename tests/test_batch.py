"""Scenes side by side: the same bits in any company; leaps over long sticks that leave what steps would have."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fivcore import ContactError, Rig, Scene, critical_mu, simulate, simulate_many
from fivcore.contact.reduced import reduced_model
from fivcore.contact.step_map import step_matrices
from fivcore.jit import SOURCES, kernel
from fivcore.transient import lane_rows as rows
from fivcore.transient.bench import Bench
from fivcore.transient.fast_kernel import work
from fivcore.transient.fast_solver import frozen_solver
from fivcore.transient.lanes import WIDTH, aligned, bits, each, fma, load, select, store
from fivcore.transient.leap_sums import HEAD, LOG, LOOKS, OVER_VALUES
from fivcore.transient.leaps import leaps

SERIES = ("time", "velocity_B", "normal_force", "tangential_force", "slip_velocity", "state")
PAPERS = Scene(5e-3, 5.0, 0.2, 9.0)
COMPANY = [
    PAPERS,
    Scene(1e-3, 5.0, 0.2, 9.0),
    Scene(2e-2, 12.0, 0.35, 9.0),
    Scene(5e-3, -5.0, 0.2, 9.0),
    Scene(5e-3, 0.0, 0.3, 2.0),
    Scene(5e-3, 5.0, 0.2, 9.0, Rig(contact_position=0.065)),
]


def same(one, other):
    """Whether two runs have the same bits in everything."""
    assert one.scene == other.scene
    for name in SERIES:
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    for name, value in one.summary.items():
        assert np.array_equal(value, other.summary[name], equal_nan=not isinstance(value, str)), name


@kernel
def arithmetic(a, b, c):
    x, y, z = load(a, 0), load(a, 1), load(a, 2)
    store(b, 0, fma(x, y, z))
    store(b, 1, select((x < y) & ~(y == z), x / y, -x + each(3.0) * z))
    store(c, 0, x * y + z)
    return bits(x <= y)


def test_compiled_code_is_kept_for_this_state_of_all_sources():
    assert SOURCES in work.stats.cache_path
    assert len(SOURCES) == 16


def test_lanes_calculate_as_numbers_do():
    given_, found, plain = (aligned(rows)[None] for rows in (3, 2, 1))
    rng = np.random.default_rng(0)
    given_[0] = x, y, z = rng.standard_normal((3, WIDTH)) * 10.0 ** rng.integers(-3, 4, (3, WIDTH))
    z[0] = y[0]
    given_[0, 2, 0] = y[0]
    mask = arithmetic(*(part.ctypes.data for part in (given_, found, plain)))
    assert mask == sum(1 << k for k in range(WIDTH) if x[k] <= y[k])
    assert np.array_equal(plain[0, 0], x * y + z)
    assert np.array_equal(found[0, 1], np.where((x < y) & (y != z), x / y, -x + 3.0 * z))
    # Rounded once: what is left when the rounded product is taken off is the product's rounding.
    exact = np.array(
        [float(np.longdouble(p) * np.longdouble(q) + np.longdouble(r)) for p, q, r in zip(x, y, z, strict=True)]
    )
    assert found[0, 0] == pytest.approx(exact, rel=3e-16)


@pytest.mark.parametrize("count", [1, 3, 2 * WIDTH, 2 * WIDTH + 1, 4 * WIDTH + 3])
def test_a_scene_has_the_same_bits_in_any_company(count):
    alone = simulate(PAPERS, 0.06, record=True, sample_rate=50e3)
    beside = [COMPANY[(k + count) % len(COMPANY)] for k in range(count - 1)]
    place = count // 2
    many = [*beside[:place], PAPERS, *beside[place:]]
    ramps = [1e-3 if k == place else 1e-3 * (1.0 + 0.1 * k) for k in range(count)]
    same(alone, simulate_many(many, 0.06, ramp=ramps, record=True, sample_rate=50e3)[place])


def test_every_scene_of_a_batch_is_the_scene_alone():
    durations = [0.05 + 0.01 * k for k in range(len(COMPANY))]
    for run, scene, duration in zip(simulate_many(COMPANY, durations), COMPANY, durations, strict=True):
        same(run, simulate(scene, duration))


def test_a_scene_without_an_answer_leaves_the_others_alone():
    painleve = Scene(5e-3, 5.0, 1.01 * critical_mu(Rig(), 5.0, termination="none"), 9.0)
    runs = simulate_many([PAPERS, painleve, COMPANY[2]], 0.02, termination="none")
    assert isinstance(runs[1], ContactError)
    assert runs[1].scene == painleve
    same(runs[0], simulate(PAPERS, 0.02, termination="none"))
    same(runs[2], simulate(COMPANY[2], 0.02, termination="none"))


def test_other_methods_run_one_after_another():
    for method in ("exact", "paper"):
        (run,) = simulate_many([PAPERS], 2e-3, method)
        same(run, simulate(PAPERS, 2e-3, method))


def test_what_is_wrong_is_named():
    with pytest.raises(ValueError, match=r"ramp: a list of 1: it must have one entry for each of 2 scenes"):
        simulate_many([PAPERS, PAPERS], 0.01, ramp=[1e-3])
    with pytest.raises(ValueError, match=r"duration = -1.0: it must be"):
        simulate_many([PAPERS], -1.0)
    with pytest.raises(TypeError, match=r"'ramps'"):
        simulate_many([PAPERS], 0.01, ramps=1e-3)
    with pytest.raises(ValueError, match=r"leap = 1: it must be a bool"):
        simulate(PAPERS, 0.01, leap=1)
    assert simulate_many([], 0.01) == []


# Leaps.


@pytest.mark.parametrize("scene", [PAPERS, Scene(5e-3, 12.0, 0.1, 9.0), Scene(5e-3, 0.0, 0.3, 9.0)])
def test_what_is_leapt_by_is_the_map_of_a_step_in_stick(scene):
    model = reduced_model(scene.rig, scene.theta)
    solver = frozen_solver(model, scene.mu, model.default_step)
    packed, size = leaps(solver, 16), len(model.rest)
    count, room = int(packed[0]), int(packed[1])
    assert room == sum(solver.sizes)
    turns, over, table = np.split(packed[HEAD:], np.cumsum([2 * count * LOOKS, OVER_VALUES * count]))
    table = table.reshape(-1, 2 * room)[:, np.r_[solver.place, room + solver.place]]
    log = over.reshape(-1, count)[LOG : LOG + 2]
    ahead = np.exp(np.outer(log[0] + 1j * log[1], 16.0 * np.arange(1, LOOKS + 1)))
    assert np.abs(turns.reshape(2, count, LOOKS) - [ahead.real, -ahead.imag]).max() < 1e-11
    into = table[6 : 6 + count] + 1j * table[6 + count : 6 + 2 * count]
    back = table[6 + 2 * count : 6 + 3 * count] + 1j * table[6 + 3 * count :]
    units = np.r_[np.sqrt(np.maximum(model.stiffness, 1e4)), np.ones(size)]
    step = (back.T * np.exp(log[0] + 1j * log[1]) @ into).real
    expected = step_matrices(model, scene.mu, solver.step)[0]
    assert np.abs(units[:, None] * (step - expected) / units).max() < 1e-9
    assert np.abs(units[:, None] * ((back.T @ into).real - np.eye(2 * size)) / units).max() < 1e-9


@given(st.floats(3e-4, 3e-3), st.floats(1.0, 12.0), st.floats(0.05, 0.5))
@settings(max_examples=12, deadline=None)
def test_a_leap_ends_before_stick_does(V, theta, mu):
    """First slip, which a leap that went too far would delay, at the same step; and the motion up to there."""
    scene = Scene(V, theta, mu, 9.0)
    duration = min(1.2 * 0.1435e-3 * mu / 0.2 / V, 0.25)
    every, leapt = (
        simulate(scene, duration, leap=leap, record=True, sample_rate=20e3, cutoff=75e3) for leap in (False, True)
    )
    assert every.summary["first_slip_time"] == pytest.approx(
        leapt.summary["first_slip_time"], abs=1e-9, nan_ok=True
    )
    slip = every.summary["first_slip_time"]
    stuck = every.time < (slip if slip > 0.0 else np.inf)
    for name, unit in (("velocity_B", V), ("normal_force", 9.0), ("tangential_force", 9.0)):
        apart = np.abs(getattr(every, name) - getattr(leapt, name))[stuck]
        assert apart.max() < 1e-7 * unit, name
    assert np.array_equal(every.state[stuck], leapt.state[stuck])


def test_what_a_leap_counts_is_what_steps_count():
    """A stick that lasts the whole run: means, spectra and energies."""
    scene = Scene(2e-4, 5.0, 0.2, 9.0)
    every, leapt = (simulate(scene, 0.3, leap=leap, settle=0.05).summary for leap in (False, True))
    assert leapt["regime"] == every["regime"]
    for name in ("stick_fraction", "mean_normal_force", "velocity_rms", "stuck_frequency"):
        assert leapt[name] == pytest.approx(every[name], rel=1e-6, nan_ok=True), name
    for name in ("normal_force_999", "max_normal_force"):
        assert leapt[name] == pytest.approx(every[name], rel=1e-3), name
    assert leapt["max_slip_speed"] == every["max_slip_speed"] == 0.0
    assert max(leapt["energy_residual"], every["energy_residual"]) < 1e-2


def test_a_leap_is_recorded_like_steps():
    """At any rate, and with the same bits of everything else as without a record."""
    scene = Scene(1e-3, 5.0, 0.2, 9.0)
    plain = simulate(scene, 0.3)
    every = simulate(scene, 0.14, record=True, sample_rate=1e6, leap=False)
    for rate in (1e6, 33e3):
        leapt = simulate(scene, 0.3, record=True, sample_rate=rate)
        for name, value in plain.summary.items():
            assert np.array_equal(value, leapt.summary[name], equal_nan=not isinstance(value, str)), name
        held = leapt.time[leapt.time < 0.13]
        assert np.allclose(np.diff(held), held[1] - held[0], rtol=1e-9)
        assert np.interp(held, every.time, every.velocity_B) == pytest.approx(
            leapt.velocity_B[: len(held)], abs=1e-9
        )


def test_a_lane_that_is_left_does_nothing_any_more():
    """Whoever left it may be gone, and with him what it would write to."""
    bench = None
    durations = [0.03, *([0.06] * 3)]
    original = Bench.work

    def watched(self):
        nonlocal bench
        bench = self
        return original(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Bench, "work", watched)
        simulate_many([COMPANY[2]] * 4, durations, cutoff=75e3)
    assert bench.stretches == []
    for part in (bench._q, bench._v, bench._places):
        assert not part.any()
    assert np.all(bench._state[:, rows.CONTACT] == 0.0)
    assert np.all(bench._state[:, rows.STICK_START : rows.STICK_START + 1] != 0.0)


def test_where_a_mode_is_gone_within_a_step_there_are_no_leaps():
    scene = Scene(0.2, 5.0, 0.2, 9.0, Rig(d2=1e-4))
    every, leapt = (
        simulate(scene, 5e-3, leap=leap, record=True, sample_rate=1e7, settle=0.0, cutoff=75e3, step=9.2e-8)
        for leap in (False, True)
    )
    for name in SERIES:
        assert np.all(np.isfinite(getattr(leapt, name)))
    assert np.array_equal(every.velocity_B, leapt.velocity_B)


def test_without_eigenvectors_that_decay_there_are_no_leaps():
    rig = Rig(d1=0.0, d2=0.0)
    model = reduced_model(rig, 5.0)
    packed = leaps(frozen_solver(model, 0.2, model.default_step), 16)
    rigid = reduced_model(Rig(), 5.0, 75e3, "none")
    assert leaps(frozen_solver(rigid, 0.2, rigid.default_step), 16) is None
    every, leapt = (simulate(Scene(2e-3, 5.0, 0.2, 9.0, rig), 0.09, leap=leap).summary for leap in (False, True))
    assert leapt["first_slip_time"] == pytest.approx(every["first_slip_time"], abs=2e-6)
    assert packed is None or packed[0] > 0
