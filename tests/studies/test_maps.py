"""Maps: values of the core, bits of the full grid where refined, what a file keeps, its name and its figure."""

from itertools import product

import numpy as np
import pytest

from fivcore import Rig, Scene, flutter_onsets, glued_frequencies, limit_cycle, painleve_mu, sliding_modes
from studies import registry, runner
from studies.answering import results, summary
from studies.gallery import maps
from studies.motion import ensemble, run
from studies.motion.jobs import run_all
from studies.plotting import figures, general
from sweeps import open_results
from tests.helpers.boundaries import distances

SHORT = {"members": 2, "min_duration": 0.05, "standard_error": 0.5, "max_duration": 0.2}
STABLE = {"x": "theta=-10:20:9", "y": "mu=0:0.5:9"}


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FIV_RESULTS", raising=False)


def mapped(*what, **how):
    study, plan = runner.plan_map(*what, **how)
    return study, plan.run("sync")


def test_the_refined_stability_boundary_is_that_of_the_full_grid():
    """65 x 65 points from 9 x 9, a fifth of them computed; the boundary is where the full grid has it."""
    _, data = mapped(**STABLE, refine=3)
    theta, mu, growth = (data[name].values for name in ("theta", "mu", "growth_rate"))
    full = np.nanmax(sliding_modes(Rig(), theta[:, None], mu, run.BAND).growth_rate, axis=-1)
    computed = data["status"].values == 1
    assert computed.size == 4225
    assert computed.sum() <= 0.2 * computed.size
    for one, other in ((growth > 0.0, full > 0.0), (full > 0.0, growth > 0.0)):
        assert np.all(distances(one, other) <= 1.0)
    np.testing.assert_allclose(growth[computed], full[computed], rtol=1e-3, atol=1e-3)
    assert np.mean(np.abs(growth - full) > 0.02 * np.ptp(full)) < 0.002


def test_the_summary_has_ranges_in_a_readers_unit_and_counts_what_is_missing():
    study, data = mapped("theta=-5:5:3", None, "onset_frequency")
    text = summary.text(summary.parts(study, data))
    assert "2802 Hz, no value at 2 of 3 points." in text
    # The lowest onset jumps from pair to pair, which no line joins.
    assert runner.draw(study, data)[""].axes[0].lines[0].get_linestyle() == "None"


def test_what_does_not_move_is_what_the_core_computes():
    groups = ("growth_rate,frequency,unstable_modes", "onset_mu", "painleve_mu", "glued_frequency_8")
    data = [mapped("theta=0,5,12", "contact_position=0.06,0.09", names, {"head_mass": 3.2})[1] for names in groups]
    for theta, position in product((0.0, 5.0, 12.0), (0.06, 0.09)):
        growth, onset, limit, glued = (part.sel(theta=theta, contact_position=position) for part in data)
        rig = Rig.of(head_mass=3.2, contact_position=position)
        modes = sliding_modes(rig, theta, 0.2, run.BAND)
        top = np.nanargmax(modes.growth_rate)
        np.testing.assert_allclose(growth["growth_rate"], modes.growth_rate[top], rtol=1e-3)
        np.testing.assert_allclose(growth["frequency"], modes.frequency[top], rtol=1e-3)
        assert growth["unstable_modes"] == np.sum(modes.unstable)
        assert np.array_equal(onset["onset_mu"], [*flutter_onsets(rig, theta).mu, np.nan][0], equal_nan=True)
        assert float(limit["painleve_mu"].fillna(np.inf)) == painleve_mu(rig, theta)
        assert glued["glued_frequency_8"] == glued_frequencies(rig, theta)[7]


def test_a_motion_is_an_ensemble_and_equivalent_scenes_are_scaled():
    _, data = mapped("V=2e-3,4e-3", "F=4.5,9", "velocity_rms,regime", SHORT)
    half, whole = (data.sel(V=V, F=F) for V, F in ((2e-3, 4.5), (4e-3, 9.0)))
    assert float(whole["velocity_rms"]) == pytest.approx(2.0 * float(half["velocity_rms"]), rel=1e-5)
    options = {name: parameter.default for name, parameter in maps.STUDIES["motion"].parameters.items()} | SHORT
    found = ensemble.statistics(run_all(ensemble.ensemble(Scene(4e-3, 5.0, 0.2, 9.0), 2, options)))
    for name in ("velocity_rms", "regime", "stick_fraction"):
        np.testing.assert_allclose(float(whole[name]), found[name], rtol=1e-4)


def test_one_sample_of_rigs_serves_a_map_and_what_is_an_axis_is_certain():
    _, data = mapped("theta=4:6:2", "mu=0.08:0.16:9", "probability_unstable", samples=64, seed=5)
    share = data["probability_unstable"].transpose("theta", "mu").values
    assert np.all(np.diff(share, axis=1) >= 0.0)
    _, alone = mapped("mu=0.12,0.2", None, "probability_unstable", {"theta": 6.0}, samples=64, seed=5)
    assert alone["probability_unstable"].values[0] == share[1, 4]
    _, data = mapped("p1_length=48:52:3mm", None, "probability_unstable", samples=8)
    assert "p1_length" not in results.configuration(data)["constants"]["distributions"]


def test_a_file_keeps_all_that_its_points_computed_and_draws_what_is_requested(tmp_path):
    for quantities, todo in (("onset_mu", 6), ("onset_frequency", 0), ("onset_mu,onset_frequency", 0)):
        study, plan = runner.plan_map("p2_length=140:160:2mm", "theta=4:6:3", quantities, out=tmp_path)
        assert plan.todo == todo
        assert runner.draw(study, runner.execute(study, plan, "sync").dataset)
        assert general.arranged(open_results(plan.store)) == (quantities.split(","), "p2_length", "theta")
    assert registry.load(open_results(plan.store).attrs["sweep"]) is study


def test_names_of_files_are_short_and_portable(tmp_path):
    def name(**how):
        return runner.plan_map("theta=0,1", out=tmp_path, **how)[1].store.name

    assert name(y="mu=0, 1", refine=1) == "growth_rate-theta-mu.nc"
    assert name(y="mu=0, 1", fix={"head_mass": 3.0, "p1_length": 0.05}) == "growth-theta-mu-head_mass3.nc"
    assert name(quantities="regime", fix={"mu": 0.11, "members": 4}) == "motion-theta-members4-mu0.11.nc"
    many = dict.fromkeys(("p1_length", "p1_width", "p2_thickness", "contact_position"), 0.0123)
    assert len(name(fix=many)) < 60
    assert name(fix=many) != name(fix=many | {"d1": 20.0})


DRAWN = {
    "refined": ({**STABLE, "quantities": "growth_rate,unstable_modes", "refine": 1}, {"growth rate 0", "stable"}),
    "no value": ({"x": "theta=-10:-5:3", "y": "contact_position=0.05,0.08", "quantities": "onset_mu"}, set()),
    "regime": ({"x": "V=log:5e-4:2e-2:3", "y": "mu=0.1,0.3", "quantities": "regime", "fix": SHORT}, {"irregular"}),
    "curve": ({"x": "F=2,10", "quantities": "regime,velocity_rms", "fix": SHORT | {"theta": 8.0}}, set()),
    "failed": ({"x": "theta=0,40", "y": "mu=1, 5", "quantities": "stick_fraction", "fix": SHORT}, {"failed"}),
}


@pytest.mark.filterwarnings("error", "ignore::sweeps.FailedPointsWarning")
@pytest.mark.parametrize("case", DRAWN)
def test_every_map_has_its_figure_and_nothing_is_clipped(case):
    how, expected = DRAWN[case]
    study, data = mapped(**how)
    with figures.style():
        figure = runner.draw(study, data)[""]
        figure.draw_without_rendering()
        title = figure._suptitle.get_window_extent()
    assert 0.0 <= title.x0 < title.x1 <= figure.bbox.width
    legend = {text.get_text() for key in figure.legends for text in key.get_texts()}
    assert expected <= legend


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"quantities": "growth"}, "quantity growth: no such quantity; did you mean growth_rate"),
        ({"quantities": "loudness"}, "quantity loudness: no such quantity; choose from growth_rate"),
        ({"quantities": "regime,onset_mu"}, "regime and onset_mu need different computations"),
        ({"x": "thata=0:10:3"}, "x thata: growth_rate does not depend on it; did you mean theta"),
        ({"quantities": "onset_mu"}, "y mu: onset_mu does not depend on it"),
        ({"fix": {"mu": 0.2}}, "y mu: it varies already"),
        ({"fix": {"d1": "normal:50:1"}}, "fix d1: it must have one value"),
    ],
)
def test_wrong_input_is_one_line_that_names_the_option(how, message):
    with pytest.raises(ValueError, match=message) as refused:
        runner.plan_map(**{"x": "theta=0:10:3", "y": "mu=0:0.4:3"} | how)
    assert "\n" not in str(refused.value)


def test_limit_cycles_are_mapped_in_their_own_units():
    """The vibration at 9 N; no vibration where sliding is all there is; none found in a run that is too short."""
    names = "limit_cycle_frequency,limit_cycle_rms,limit_cycle_stable,limit_cycle_search"
    how = {"mu": 0.12, "d2": 1e-6, "duration": 0.6}
    _, data = mapped("V=1e-3,2e-3", None, names, fix=how)
    cycle = limit_cycle(Scene(2e-3, 5.0, 0.12, 9.0, Rig(d2=1e-6)), duration=0.6)
    assert data["limit_cycle_frequency"].values == pytest.approx([cycle.frequency, cycle.frequency], rel=1e-5)
    assert data["limit_cycle_rms"].values[1] == pytest.approx(cycle.summary["velocity_rms"], rel=1e-5)
    assert data["limit_cycle_stable"].values.tolist() == [1.0, 1.0]
    assert data["limit_cycle_search"].values.tolist() == [0, 0]
    assert data["limit_cycle_search"].attrs["flag_meanings"] == "found no_vibration not_found"
    for duration, outcome in ((0.3, 1), (1.1e-3, 2)):
        _, none = mapped("mu=0.05,0.06", None, "limit_cycle_search", fix={"duration": duration})
        assert none["limit_cycle_frequency"].isnull().all()
        assert none["limit_cycle_search"].values.tolist() == [outcome, outcome]
