"""The declaration of a study: what its function gets, what a request may be, and what is refused."""

import re

import numpy as np
import pytest
import xarray as xr

import studies
from fivcore import Beam, Rig, flutter_onsets, sliding_modes
from studies import registry, runner
from studies.answering import claims, results, summary
from studies.asking.request import Request
from studies.asking.sweep import sweep_of
from studies.gallery import fig5
from studies.study import Parameter, Study
from sweeps import FAILED, Axis, InputError, StoreError, SweepStoppedError
from tests import HOME

EIGHT, REFERENCE = 1e-3 * np.arange(1.0, 9.0), HOME / "results" / "reference"


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch, undrawn):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FIV_RESULTS", raising=False)


def study_of(function, outputs=None, **options):
    parameters = {"x": Parameter(np.array([1.0, 2.0, 3.0]), "m", "place"), "gain": Parameter(2.0, "1", "gain")}
    parameters |= options.pop("parameters", {})
    return Study("own", "Own", "Why?", parameters, outputs or {"y": ("m", "height")}, function, **options)


def run(study, **values):
    return sweep_of(study, values).plan().run("sync")


def test_a_function_gets_one_value_of_what_is_fixed_and_an_array_of_what_varies():
    seen = []

    def function(x, gain):
        seen.append((np.shape(x), np.shape(gain)))
        return {"y": np.broadcast_to(gain * x, np.broadcast_shapes(np.shape(x), np.shape(gain)))}

    study = study_of(function)
    np.testing.assert_array_equal(run(study)["y"], [2.0, 4.0, 6.0])
    assert seen.pop() == ((3,), ())
    data = run(study, gain=[1.0, 10.0], x=2.0)
    assert data["y"].dims == ("x", "gain")
    assert data["y"].values.tolist() == [[2.0, 20.0]]
    assert (float(run(study)["gain"]), run(study)["gain"].attrs["units"]) == (2.0, "1")


def test_points_of_one_call_share_a_common_parameter_and_the_rig():
    seen = []

    def function(rig, x, order):
        seen.append((rig.head_mass, order))
        return {"y": rig.head_mass * x + order}

    study = study_of(function, parameters={"order": Parameter(1, "1", "order", common=True)})
    data = run(study, head_mass=[1.0, 2.0], order=[3, 4])
    assert sorted(set(seen)) == [(1.0, 3), (1.0, 4), (2.0, 3), (2.0, 4)]
    expected = data["head_mass"] * data["x"] + data["order"]
    np.testing.assert_array_equal(data["y"].transpose(*expected.dims), expected)


@pytest.mark.parametrize(
    ("function", "parameters"),
    [
        (lambda x: {"y": x[:1]}, {"x": Parameter(EIGHT)}),
        (lambda scenes: {"y": [scenes[0].V]}, {"x": Parameter(1.0), "V": Parameter(EIGHT, "m s-1")}),
        (lambda **rest: {"y": np.ravel(rest["x"])[:1]}, {"x": Parameter(EIGHT)}),
    ],
)
def test_one_value_for_several_points_is_refused(function, parameters):
    with pytest.raises(SweepStoppedError, match=r"1 value for \d points; return an array with one entry for each"):
        run(study_of(function, parameters=parameters))
    # Where calls of several common parameters are one batch, each says so.
    common = study_of(function, parameters=parameters | {"order": Parameter([1, 2], "1", "order", common=True)})
    data = run(common)
    failed = data["status"] == FAILED
    assert failed.sum() >= failed.size - 1  # the first point is a batch of its own
    assert all(re.search(r"1 value for \d points", text) for text in data["error"].values[failed.values])


def test_rows_that_agree_in_all_that_a_function_takes_have_its_one_value():
    study = study_of(lambda rig: {"y": [rig.head_mass]}, parameters={"x": Parameter(1.0)})
    rows = {"head_mass": [2.0, 2.0, 3.0], "x": [1.0, 2.0, 3.0]}
    assert sweep_of(study, {}, rows=rows).plan().run("sync")["y"].values.tolist() == [2.0, 2.0, 3.0]


def test_scenes_are_built_and_only_the_guilty_group_fails():
    def function(scenes, head_mass):
        if head_mass == 2.0:
            raise ValueError("two is not allowed")
        return {"y": [scene.V * scene.rig.head_mass for scene in scenes]}

    study = Study(
        "own", "Own", "Why?", {"V": Parameter(np.array([1e-3, 2e-3]), "m s-1", "V")}, {"y": ("1", "y")}, function
    )
    data = run(study, head_mass=[1.0, 2.0, 3.0])
    np.testing.assert_array_equal(data["status"].sel(head_mass=2.0), 2)
    assert "two is not allowed" in str(data["error"].sel(head_mass=2.0).values[0])
    np.testing.assert_allclose(data["y"].sel(head_mass=3.0), [3e-3, 6e-3])
    with pytest.raises(InputError, match="theta = 95"):
        sweep_of(study, {"theta": 95.0})


def test_a_function_of_numbers_gets_one_point_at_a_time():
    data = run(study_of(lambda x, gain: {"y": gain * float(x[0]) if len(x) == 1 else 0.0}))
    assert data["y"].values.tolist() == [2.0, 4.0, 6.0]


def test_a_short_output_is_padded_and_an_inner_range_is_a_dimension():
    study = study_of(
        lambda x, level: {"y": np.stack([x * v for v in level[:2]], axis=1)},
        {"y": ("m", "height", "level")},
        parameters={"level": Parameter(np.array([1.0, 2.0, 3.0]), "1", "level", inner=True)},
    )
    data = run(study)
    assert data["y"].dims == ("x", "level")
    assert np.isnan(data["y"].sel(level=3.0)).all()
    assert data["y"].sel(level=2.0).values.tolist() == [2.0, 4.0, 6.0]


def test_summary_figure_and_derived_values_are_of_the_usual_dimensions_only():
    study = study_of(
        lambda x, gain: {"y": gain * x},
        derive=lambda data: data.assign(twice=2.0 * data["y"]),
        summary=lambda data: iter([f"The largest is {float(data['y'].max()):g}."]),
    )
    assert "The largest is 6." in summary.text(summary.parts(study, run(study)))
    data = run(study, gain=[1.0, 2.0, 3.0])
    assert "twice" not in data
    text = summary.text(summary.parts(study, data))
    assert "Quantiles" in text
    assert set(runner.draw(study, data)) == {""}


def test_the_summary_says_which_output_no_point_has():
    outputs = {name: ("m", "height") for name in "yz"}
    text = summary.text(summary.general(run(study_of(lambda x: {"y": x, "z": x * np.nan}, outputs))))
    assert "No point has a value of z: every computation returned NaN or infinity." in " ".join(text.split())


def test_auto_is_no_number():
    def function(x, limit):
        return {"y": x if limit is None else np.minimum(x, limit)}

    study = study_of(function, parameters={"limit": Parameter(None, "m", "limit")})
    assert np.isnan(run(study)["limit"])
    assert run(study, limit=2.0)["y"].values.tolist() == [1.0, 2.0, 2.0]
    assert run(study, limit="auto")["y"].values.tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(InputError, match="gain = 'auto'"):
        sweep_of(study, {"gain": "auto"})


def test_a_warning_names_the_line_of_the_caller():
    with pytest.warns(UserWarning, match="p1_length = 50 m is unusual") as caught:
        studies.run("fig5", mu=0.1, p1_length=50.0)
    assert caught[0].filename == __file__


def test_fig5_has_ten_modes_and_the_papers_onsets():
    data = studies.run("fig5")
    # Every onset lies where the number of unstable modes rises on the grid.
    unstable = (data["growth_rate"] > 0.0).sum("mode").values
    rises = data["mu"].values[1:][np.diff(unstable) > 0]
    assert np.all((rises - data["onset_mu"].values >= 0.0) & (rises - data["onset_mu"].values <= 1e-3))
    table = claims.beside(data, fig5.CLAIMS)
    assert table["computed"].tolist()[1::2] == ["2802", "397.8", "7705"]
    assert table["deviation"].tolist()[1::2] == ["+0.1 %", "-0.5 %", "+0.1 %"]
    assert len(claims.beside(data.isel(onset=slice(1)), fig5.CLAIMS)) == 2


def test_another_rig_is_set_number_by_number():
    values = {"p1_length": 0.06, "p2_thickness": 0.004, "p2_elements": 40, "d1": 20.0, "theta": 8.0}
    data = studies.run("fig5", mu=[0.1, 0.3], **values)
    rig = Rig(Beam(0.06, 0.01, 0.0015, 185e9, 7900.0, 30), Beam(0.15, 0.015, 0.004, 185e9, 7900.0, 40), d1=20.0)
    frequency = sliding_modes(rig, 8.0, [0.1, 0.3]).frequency
    np.testing.assert_array_equal(data["frequency"].dropna("mode", how="all"), frequency)
    assert results.rig_of(data) == rig
    assert not len(claims.beside(data, fig5.CLAIMS))


def test_any_parameter_may_vary():
    data = studies.run("fig5", mu=[0.1, 0.2], theta=[5.0, 8.0], head_mass=[2.0, 3.0])
    assert data["frequency"].dims == ("mu", "theta", "head_mass", "mode")
    expected, found = sliding_modes(Rig(head_mass=3.0), 8.0, [0.1, 0.2]).frequency, data["frequency"]
    modes = found.sel(theta=8.0, head_mass=3.0).dropna("mode", how="all")
    # They keep their numbers along mu.
    np.testing.assert_allclose(np.sort(modes), expected, rtol=1e-12)


def test_a_file_has_room_for_the_modes_of_its_longest_rig():
    data = studies.run("fig5", mu=[0.1, 0.2], p2_length=[0.15, 0.9])
    modes = data["frequency"].sel(p2_length=0.9).dropna("mode", how="all")
    expected = sliding_modes(Rig(p2=Beam(0.9, 0.015, 0.003, 185e9, 7900.0, 90)), 5.0, [0.1, 0.2]).frequency
    np.testing.assert_allclose(modes, expected, rtol=1e-12)


def test_onsets_without_any_instability():
    data = studies.run("fig5", theta=-5.0, mu=[0.0, 0.1, 0.2])
    assert data.sizes["onset"] == 0
    assert "is stable" in summary.text(summary.parts(registry.load("fig5"), data))
    with pytest.raises(StoreError, match=r"theta = -5.0 there, 5.0 here"):
        studies.run("fig5", mu=0.0)
    assert studies.run("fig5", fresh=True, mu=0.0).sizes["onset"] == 0
    assert flutter_onsets(Rig(), -5.0).mu.size == 0


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("fig5", {"mu": [0.1, float("nan")]}, "mu = nan: it must be finite"),
        ("fig5", {"mu": "much"}, "mu = 'much'"),
        ("fig5", {"theta": 95.0}, "theta = 95.0: it must be a single angle between -90 and 90"),
        ("fig5", {"contact_position": 0.2}, "contact_position = 0.2: it must be above 0 and at most"),
        ("fig5", {"mu": []}, r"mu = \[\]: it must be a number or a list of numbers"),
        ("fig5", {"mu": np.zeros((2, 2))}, "mu = array"),
        ("fig5", {"p1_elements": 1.5}, "p1_elements = 1.5: it must be a whole number"),
        ("fig5", {"record": ["velocity_B"]}, "study fig5 records no series"),
        ("scenes", {"numerical_damping": "newmark"}, "it must be one of published, none"),
        ("scenes", {"ramp": 0.0}, "ramp = 0"),
        ("fig7", {"duration": [0.1, 0.2]}, "duration: it decides the size"),
        ("table4", {"mode": 0}, "mode = 0: it must be a whole number from 1 to"),
        (5, {}, "STUDY = 5"),
    ],
)
def test_bad_input_is_named_and_nothing_is_written(name, values, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        studies.run(name, **values)
    assert not list(tmp_path.iterdir())


def test_opening_takes_paths_and_checks_whose_the_file_is(tmp_path):
    studies.run("table4")
    file = tmp_path / "results" / "table4" / "table4.nc"
    assert studies.open(file).sizes == studies.open("table4").sizes
    other = tmp_path / "results" / "fig5" / "fig5.nc"
    other.parent.mkdir()
    other.write_bytes(file.read_bytes())
    with pytest.raises(ValueError, match="it holds the results of table4, not of fig5"):
        studies.open("fig5")
    with pytest.raises(FileNotFoundError, match="no result 'fig6' in results, which has"):
        studies.open("fig6")


def test_results_go_where_the_environment_says_and_a_home_folder_is_understood(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("FIV_RESULTS", "~/mine")
    studies.run("table4")
    assert (tmp_path / "mine" / "table4" / "table4.nc").is_file()
    # A folder that is merely called like the reference is none.
    studies.run("table4", out=tmp_path / "reference")
    assert (tmp_path / "reference" / "table4" / "table4.nc").is_file()


def test_messages_of_python_have_no_words_of_the_command_line():
    lattice = ("theta=1:5:3", "mu=0.1:0.3:3")
    attempts = [
        lambda: studies.run("fig5", samples=4),
        lambda: studies.run("fig5", points="absent.csv"),
        lambda: studies.run("fig5", scheduler="tcp://127.0.0.1:9", workers=2),
        lambda: studies.run("robust", theta="normal:5:1"),
        lambda: studies.run("robust", point_b="normal:0.5:0.1"),
        lambda: studies.run("fig5", out=REFERENCE),
        lambda: studies.run("scenes", sample_rate="20km", record=["velocity_B"]),
        lambda: studies.map("theta", None),
        lambda: studies.map(*lattice, "loud"),
        lambda: studies.map(*lattice, ["growth_rate", "onset_mu"]),
        lambda: studies.map(*lattice, fix={"nu": 1.0}),
        lambda: studies.map(*lattice, fix={"mu": 0.2}),
        lambda: studies.map(*lattice, fix={"head_mass": "1,2"}),
        lambda: studies.map(*lattice, tolerance=0.1),
        lambda: studies.map(*lattice, refine=40),
        lambda: studies.map(*lattice, fix={"p1_length": 50.0}, strict=True),
        lambda: studies.open("regimes"),
        lambda: studies.run("table4").fiv.query("mode == 2mm"),
    ]
    for attempt in attempts:
        with pytest.raises(ValueError, match=r".") as refused:
            attempt()
        assert not re.search(r"--\w|\bfiv \w", str(refused.value)), refused.value


@pytest.mark.parametrize("scheduler", [object(), "threads"])
def test_a_scheduler_is_handed_to_the_plan_as_it_is(scheduler):
    assert runner.backend(scheduler, 2) == (scheduler, 2)


def test_an_output_that_is_added_leaves_the_others_as_they_are(tmp_path):
    """Along a dimension of its own, too; where others change the file is refused."""
    sides, more = Axis(np.array([1.0, 2.0])), {"y": ("m", "height"), "both": ("1", "both", "side")}

    def computed(function, outputs=None, **options):
        study = study_of(function, outputs, **options)
        return runner.plan(study, Request(), tmp_path).run("sync")

    before = computed(lambda x: {"y": x / 3.0})
    with pytest.raises(
        StoreError, match=r"own.nc: both cannot be added, and nothing has changed: at x = 1.0 y = "
    ):
        computed(
            lambda x: {"y": x * (1.0 / 3.0 + 1e-9), "both": np.stack([x, -x], 1)}, more, coords={"side": sides}
        )
    data = computed(lambda x: {"y": x / 3.0, "both": np.stack([x, -x], 1)}, more, coords={"side": sides})
    assert data["y"].values.tobytes() == before["y"].values.tobytes()
    assert data["both"].values.tolist() == [[1.0, -1.0], [2.0, -2.0], [3.0, -3.0]]


@pytest.mark.parametrize(
    ("duration", "said"), [(1e-3, ""), (np.nan, ""), (0.6, ""), (3.0, "moves 4 %"), (345.0, "460 %")]
)
def test_a_drive_that_moves_far_is_named_with_the_contact_that_stays(tmp_path, duration, said):
    data = xr.Dataset({"V": 2e-3, "simulated_time": duration, "p2_length": 0.15, "contact_position": 0.08})
    text = runner.RunResult(registry.load("scenes"), data, tmp_path, []).fixed_contact()
    assert said in text
    assert bool(said) == text.endswith("a real contact would travel along, here it stays at 80 mm")
