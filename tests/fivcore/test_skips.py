"""Long sticks are skipped: what is left is what every step would have left."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fivcore import Rig, Scene, simulate
from fivcore.contact.reduced import reduced_model
from fivcore.transient.fast.skip import NO_TABLES, skip_tables
from studies.accuracy.ablation import truncated
from tests.helpers.examples import examples
from tests.helpers.runs import SERIES, assert_same_summary


def both(scene, duration, **given):
    """Taken step by step, and skipped."""
    return (simulate(scene, duration, skip_sticks=leap, **given) for leap in (False, True))


@given(st.floats(3e-4, 3e-3), st.floats(1.0, 12.0), st.floats(0.05, 0.5))
@examples(12)
def test_a_skip_ends_before_stick_does(V, theta, mu):
    """First slip, which a skip that went too far would delay, at the same step; and the motion up to there."""
    duration = min(1.2 * 0.1435e-3 * mu / 0.2 / V, 0.25)
    every, skipped = both(Scene(V, theta, mu, 9.0), duration, record=True, sample_rate=20e3, cutoff=75e3)
    slip = every.summary["first_slip_time"]
    assert slip == pytest.approx(skipped.summary["first_slip_time"], abs=1e-9, nan_ok=True)
    stuck = every.time < (slip if slip > 0.0 else np.inf)
    for name, unit in (("velocity_B", V), ("normal_force", 9.0), ("tangential_force", 9.0)):
        assert np.abs(getattr(every, name) - getattr(skipped, name))[stuck].max() < 1e-7 * unit, name
    assert np.array_equal(every.state[stuck], skipped.state[stuck])


def test_what_a_skip_counts_is_what_steps_count():
    """A stick that lasts the whole run: means, spectra and energies."""
    every, skipped = (run.summary for run in both(Scene(2e-4, 5.0, 0.2, 9.0), 0.3, settle=0.05))
    assert skipped["regime"] == every["regime"]
    for name in ("stick_fraction", "mean_normal_force", "velocity_rms", "stuck_frequency"):
        assert skipped[name] == pytest.approx(every[name], rel=1e-6, nan_ok=True), name
    for name in ("normal_force_999", "max_normal_force"):
        assert skipped[name] == pytest.approx(every[name], rel=1e-3), name
    assert skipped["max_slip_speed"] == every["max_slip_speed"] == 0.0
    assert max(skipped["energy_residual"], every["energy_residual"]) < 1e-2


@pytest.mark.parametrize("rate", [None, 33e3])
def test_a_skip_is_recorded_like_steps(rate):
    """And with the same bits of everything else as without a record."""
    scene = Scene(1e-3, 5.0, 0.2, 9.0)
    every = simulate(scene, 0.14, record=True, sample_rate=None, skip_sticks=False)
    skipped = simulate(scene, 0.3, record=True, sample_rate=rate)
    assert_same_summary(simulate(scene, 0.3), skipped)
    held = skipped.time[skipped.time < 0.13]
    assert np.allclose(np.diff(held), held[1] - held[0], rtol=1e-9)
    there = np.interp(held, every.time, every.velocity_B)
    assert there == pytest.approx(skipped.velocity_B[: len(held)], abs=1e-9)


def test_there_are_no_skips_where_a_mode_is_gone_within_a_step_or_eigenvectors_do_not_decay():
    scene = Scene(0.2, 5.0, 0.2, 9.0, Rig(d2=1e-4))
    given = {"record": True, "sample_rate": None, "settle": 0.0, "cutoff": 75e3, "step": 9.2e-8}
    every, skipped = both(scene, 5e-3, **given)
    assert all(np.all(np.isfinite(getattr(skipped, name))) for name in SERIES)
    assert np.array_equal(every.velocity_B, skipped.velocity_B)
    rig = Rig(d1=0.0, d2=0.0)
    model, rigid = reduced_model(rig, 5.0), truncated(reduced_model(Rig(), 5.0, 75e3))
    assert skip_tables(model, model.default_step, 16) is not NO_TABLES
    assert skip_tables(rigid, rigid.default_step, 16) is NO_TABLES
    every, skipped = (run.summary["first_slip_time"] for run in both(Scene(2e-3, 5.0, 0.2, 9.0, rig), 0.09))
    assert skipped == pytest.approx(every, abs=2e-6)


def test_a_skip_over_many_real_eigenvalues():
    """Overdamped modes have no conjugate: there are more eigenvalues to keep than modes.

    The slowest takes seconds to decay, so that rounding in its amplitude lasts: some 1e-8 of the velocity.
    """
    rig = Rig(d1=1e5)
    model = reduced_model(rig, 5.0)
    tables = skip_tables(model, model.default_step, 10)
    assert tables.moduli.shape[1] > len(tables.drift) // 2
    every, skipped = (run.summary["velocity_rms"] for run in both(Scene(5e-4, 5.0, 0.2, 9.0, rig), 0.25))
    assert skipped == pytest.approx(every, rel=2e-7, abs=0.0)
