"""Table 6: unstable intervals, motion over the inclination, and the paper's text beside."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fivcore import Rig, sliding_modes, unstable_windows
from studies import paper, registry, runner
from studies.answering import claims, summary
from studies.asking.sweep import sweep_of
from studies.motion import ensemble, regimes, run, stability

# Angles on either side of every bound, and all of which the paper's text gives a number.
ANGLES = [-5.0, 0.0, 0.5, 1.0, 2.5, 5.0, 10.0, 10.5, 11.0, 12.0, 12.5, 15.0]
SHORT = {"members": 2, "min_duration": 0.4, "max_duration": 0.65}
STUDY = registry.load("table6")
STEADY, INTERMITTENT = map(run.REGIMES.index, ("steady sliding", "intermittent"))


def vibrates(codes):
    return regimes.is_of(codes, *regimes.VIBRATING)


@pytest.fixture(scope="module")
def computed(computed):
    return lambda **values: computed("table6", **SHORT | {"theta": ANGLES} | values)


@pytest.fixture(scope="module")
def angles(computed):
    return computed()


def rows_of(dataset):
    """Paper, computed and deviation of each claim."""
    return claims.beside(dataset, STUDY.claims).iloc[:, 2:5].to_numpy().tolist()


def test_the_rig_vibrates_where_a_mode_is_unstable_and_nowhere_else(angles):
    unstable = angles["unstable_modes"].values > 0
    np.testing.assert_array_equal(angles["theta"].values[unstable], [1.0, 2.5, 5.0, 10.0, 10.5])
    np.testing.assert_array_equal(vibrates(angles["regime"]), unstable)
    np.testing.assert_array_equal(angles["regime"].values[~unstable], STEADY)
    # Where none is unstable, d1 on the mass is all that the least stable mode decays by.
    np.testing.assert_allclose(angles["mode_growth_rate"].values[~unstable], -0.5 * Rig().d1, rtol=1e-3)


def test_the_figure_says_where_an_interval_goes_on_beyond_the_range(computed):
    figure = runner.draw(STUDY, computed(theta=[0.0, 5.0]))[""]
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "unstable, 0.62° to > 5.00°, 2794 Hz" in texts


def test_unstable_pairs_and_intervals_are_those_of_the_stability_analysis(angles):
    at = angles.sel(theta=5.0)
    np.testing.assert_allclose(at["frequency"][:2], [398.0, 2794.0], atol=1.0)
    np.testing.assert_allclose(at["growth_rate"][:2], [384.0, 1764.0], atol=1.0)
    for theta in angles["theta"].values:
        here, modes = angles.sel(theta=theta), sliding_modes(Rig(), theta, paper.MU)
        for name in ("frequency", "growth_rate"):
            np.testing.assert_array_equal(here[name].dropna("pair"), getattr(modes, name)[modes.unstable])
        assert int(here["unstable_modes"]) == modes.unstable.sum()
    solver = unstable_windows(Rig(), paper.MU, -5.0, 15.0)
    np.testing.assert_allclose(solver.theta_from, [1.971, 0.623], atol=1e-3)
    for name, (field, _, _) in stability.INTERVALS.items():
        np.testing.assert_array_equal(angles[f"window_{name}"], getattr(solver, field), err_msg=name)


def test_the_mirror_image_is_the_same_rig(computed):
    right = computed(theta=[0.0, 5.0, 12.0])
    left = computed(theta=[-12.0, -5.0, 0.0], V=-paper.ANGLES_SPEED)
    for name in STUDY.outputs:
        np.testing.assert_array_equal(left[name][::-1], right[name], err_msg=name)
    for name, other in (("from", "to"), ("to", "from"), ("peak_theta", "peak_theta")):
        np.testing.assert_allclose(left[f"window_{name}"], -right[f"window_{other}"], rtol=1e-9)
    np.testing.assert_array_equal(left["window_open_from"], right["window_open_to"])
    np.testing.assert_allclose(left["window_frequency_to"], right["window_frequency_from"], rtol=1e-9)
    assert not np.any(np.signbit(left["window_to"]) & (left["window_to"] == 0.0))
    # The paper's text is of V > 0.
    assert rows_of(right)
    assert not rows_of(left)


def test_only_what_vibrates_has_a_dominant_frequency_and_it_is_near_the_measured_one(angles):
    hertz = angles["member_dominant_frequency"]
    np.testing.assert_array_equal(np.isfinite(hertz), vibrates(angles["member_regime"]))
    for theta, measured in paper.ANGLES_MEASURED.items():
        assert float(angles["dominant_frequency"].sel(theta=theta)) == pytest.approx(measured, rel=0.05)


@given(st.lists(st.floats(200.0, 1e4) | st.just(np.nan), max_size=9))
def test_the_middle_frequency_is_one_of_them(hertz):
    known = np.array([f for f in hertz if np.isfinite(f)])
    middle = ensemble.middle(np.array(hertz, dtype=float))
    assert middle in known if len(known) else np.isnan(middle)
    assert max(np.sum(known < middle), np.sum(known > middle)) <= len(known) / 2


def test_the_papers_text_stands_beside_the_model(angles, computed):
    """At 5 degrees 2700 Hz and pairs at 400 and 2800 Hz; at 10 degrees vibration; at 15, < 0 and > 12 steady."""
    rows = rows_of(angles)
    numbers, words = [row[0] for row in rows[:5]], [row[0].partition(",")[0] for row in rows[5:]]
    assert numbers == ["2700", "2700", "400", "2800", "2700"]
    assert words == ["periodic", *["steady sliding"] * 3]
    assert [row[2] for row in rows[5:]] == ["none"] * 4
    other = angles.copy(deep=True)
    other["regime"].loc[{"theta": [0.0, 12.0, 12.5]}] = INTERMITTENT
    other["dominant_frequency"].loc[{"theta": 10.0}] = np.nan
    # At neither end of a range does the text say anything.
    assert rows_of(other)[4:] == [
        ["2700", "-", "-"],
        *rows[5:8],
        [rows[8][0], "intermittent, steady sliding", "differs"],
    ]
    assert not rows_of(computed(theta=[5.0, 15.0], max_duration=0.2, min_duration=0.0, F=10.0))


def test_the_finding_says_where_the_rig_vibrates(angles):
    part = "Steady sliding is unstable at 1 to 10.5 degrees; the rig vibrates at"
    assert f"{part} 1 to 10.5 degrees." in next(STUDY.summary(angles))
    other = angles.copy(deep=True)
    other["regime"].loc[{"theta": 5.0}] = STEADY
    assert f"{part} 1 to 2.5, 10 to 10.5 degrees." in next(STUDY.summary(other))


def test_failed_and_pending_points_leave_gaps(computed, angles):
    data = computed(theta=[10.0, 40.0], mu=2.2, max_duration=0.1, min_duration=0.02)
    np.testing.assert_array_equal(data["status"], [1, 2])
    assert "ContactError: mu = 2.2" in summary.text(summary.parts(STUDY, data), 200)
    some = angles.copy(deep=True)
    some["status"][5:7] = [0, 2]
    for name in STUDY.outputs:
        some[name] = some[name].where(some["status"] == 1)
    (table,) = (part[1] for part in STUDY.summary(some) if part[0].startswith("By inclination"))
    assert table["regime"][5:7].tolist() == ["pending", "failed"]
    assert runner.draw(STUDY, some)


@pytest.mark.slow
def test_the_whole_table():
    """Half a degree apart, every ensemble does what stability says of its angle."""
    data = sweep_of(STUDY).plan().run()
    unstable = data["unstable_modes"].values > 0
    np.testing.assert_array_equal(vibrates(data["member_regime"]).all(axis=1), unstable)
    np.testing.assert_array_equal((data["member_regime"] == STEADY).all(axis=1), ~unstable)
    hertz = data["dominant_frequency"].values[unstable]
    assert np.all((hertz > 2580.0) & (hertz < 2700.0))
