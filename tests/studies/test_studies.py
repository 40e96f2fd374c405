"""The predefined studies: what they find, what they store, what they draw and what they say."""

import re

import matplotlib
import numpy as np
import pytest
import xarray as xr

import studies
from fivcore import Beam, Rig, flutter_onsets, sliding_modes
from studies import paper, registry, runner
from studies.accuracy.study import COSTS
from studies.claims import beside
from studies.gallery import fig5
from studies.stress.checks import CHECKS
from sweeps import StoreError
from sweeps.fingerprint import provenance
from sweeps.storage.assemble import rounded
from sweeps.task import Task, one_blas_thread
from tests.helpers.commands import written

PLOT = runner.plot


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch, undrawn):
    """Figures are compared with the kept ones (tests/studies/test_kept_figures.py)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FIV_RESULTS", raising=False)


# Those that take long as they are.
ENSEMBLE = {"members": 2, "most": 0.6}
SCENE = {"mu": 0.2, "F": 9.0}
SMALLER = {
    "fig7": {"duration": 0.3},
    "contact": {"duration": 0.4},
    "fig11": {"duration": 0.2},
    "table6": {"theta": [-5.0, 5.0, 15.0]} | ENSEMBLE,
    "stick_time": {"V": [1e-3, 2e-3], "member": [1, 2], "least": 0.3} | SCENE,
    "stability": {"theta": [-5.0, 5.0, 15.0], "mu": [0.0, 0.2, 0.4]},
    "sensitivity": {"theta": [-5.0, 5.0, 9.0]},
    "robust": {"theta": [0.0, 5.0, 9.0], "samples": 64, "sobol_samples": 16},
    "regimes": {"V": [1e-3, 5e-3], "mu": [0.05, 0.2]} | ENSEMBLE,
    "scenes": {"V": [2e-3, 5e-3], "duration": 0.1} | SCENE,
    "accuracy": {"method": "fast", "setting": ["default", "cut-off 0.4"], "scene": "5 mm/s", "members": 2}
    | {"duration": 0.25},
    "stress": {"case": ["theta = 90°", "3 and 3 elements"]},
}


@pytest.fixture
def batches(monkeypatch):
    """Points and values of every batch that a run computes."""
    seen, call = [], Task._call

    def watched(self, points):
        found = call(self, points)
        seen.append((points, found[0]))
        return found

    monkeypatch.setattr(Task, "_call", watched)
    return seen


@pytest.mark.parametrize("name", registry.NAMES)
def test_every_study_runs_to_a_file_and_has_the_same_bits_in_any_batch(name, tmp_path, batches):
    data = studies.run(name, **SMALLER.get(name, {}))
    folder = tmp_path / "results" / name
    assert written(folder) == [f"{name}.nc"]
    assert np.all(data["status"] == 1)
    xr.testing.assert_equal(studies.open(name), data)
    with xr.open_dataset(folder / f"{name}.nc") as plain:
        for variable in plain.data_vars.values():
            assert "long_name" in variable.attrs
            assert "units" in variable.attrs or variable.dtype.kind in "OUT" or "flag_values" in variable.attrs
        for text in (plain.attrs["configuration"], plain.attrs["history"], plain.attrs["source"]):
            assert str(tmp_path) not in text
    sweep, rng = registry.load(name).sweep(SMALLER.get(name, {})), np.random.default_rng(0)
    points, values = (
        {key: np.concatenate([each[part][key] for each in batches]) for key in batches[0][part]} for part in (0, 1)
    )
    count = len(points[next(iter(points))])
    # Those of every method take long.
    for size in (1,) if name in ("accuracy", "stress") else (1, 7):
        some = np.sort(rng.choice(count, min(size, count), replace=False))
        with one_blas_thread():
            found = sweep.function({axis: each[some] for axis, each in points.items()}, **sweep.constants)
        # What a run costs is measured anew each time.
        for key in set(sweep.variables) - set(COSTS):
            variable, whole = sweep.variables[key], values[key][some]
            alone = rounded(np.asarray(found[key]).astype(variable.dtype), variable.digits)
            if (name, key) == ("stress", "value"):
                alone, whole = (np.delete(each, list(CHECKS).index("cost"), 1) for each in (alone, whole))
            np.testing.assert_array_equal(alone, whole, key)


@pytest.mark.parametrize("form", runner.FORMATS)
def test_a_figure_is_the_same_each_time_whatever_the_users_matplotlib_is_like(form, tmp_path):
    study, file = registry.load("fig5"), tmp_path / "fig5.nc"
    data = study.sweep({"mu": np.linspace(0.0, 0.3, 31)}).plan().run("sync")
    drawn = PLOT(study, data, file, form).read_bytes()
    with matplotlib.rc_context({"axes.facecolor": "black", "savefig.transparent": True}):
        assert PLOT(study, data, file, form).read_bytes() == drawn
    assert drawn.lstrip()[:5] == {"png": b"\x89PNG\r", "svg": b"<?xml", "pdf": b"%PDF-"}[form]


def test_fig5_has_ten_modes_and_the_papers_onsets():
    data = studies.run("fig5")
    assert data["frequency"].dims == ("mu", "mode")
    assert data["frequency"].shape == (501, 10)
    np.testing.assert_allclose(data["onset_mu"], [0.11123, 0.15298, 0.22365], atol=1e-5)
    np.testing.assert_allclose(data["onset_frequency"], [2802.0, 398.0, 7705.0], atol=0.5)
    at = data.sel(mu=paper.MU, method="nearest")
    modes = sliding_modes(Rig(), 5.0, paper.MU)
    np.testing.assert_allclose(at["frequency"], modes.frequency[:10], rtol=1e-12)
    np.testing.assert_allclose(at["growth_rate"], modes.growth_rate[:10], rtol=1e-9)
    # Every onset lies where the grid says that the number of growing modes rises.
    growing = (data["growth_rate"] > 0.0).sum("mode").values
    rises = data["mu"].values[1:][np.diff(growing) > 0]
    assert np.all((rises - data["onset_mu"].values >= 0.0) & (rises - data["onset_mu"].values <= 1e-3))
    (table,) = beside(data, fig5.CLAIMS)[1:]
    assert [row[1:3] for row in table.rows[::2]] == [
        [f"onset = {k + 1}", f"{paper.ONSETS[k][0]}"] for k in range(3)
    ]
    assert [row[3:5] for row in table.rows[1::2]] == [["2802", "+0.1 %"], ["397.8", "-0.5 %"], ["7705", "+0.1 %"]]
    assert len(beside(data.isel(onset=slice(1)), fig5.CLAIMS)[1].rows) == 2


def test_another_rig_can_be_set_number_by_number():
    data = studies.run(
        "fig5", p1_length=0.06, p2_thickness=0.004, p2_elements=40, d1=20.0, mu=[0.1, 0.3], theta=8.0
    )
    rig = Rig(Beam(0.06, 0.01, 0.0015, 185e9, 7900.0, 30), Beam(0.15, 0.015, 0.004, 185e9, 7900.0, 40), d1=20.0)
    expected = sliding_modes(rig, 8.0, [0.1, 0.3])
    np.testing.assert_array_equal(data["frequency"], expected.frequency[:, :10])
    assert beside(data, fig5.CLAIMS) == []


def test_fig5_without_any_instability():
    data = studies.run("fig5", theta=-5.0, mu=[0.0, 0.1, 0.2])
    assert data.sizes["onset"] == 0
    assert "stable over this range" in registry.load("fig5").report(data)
    with pytest.raises(StoreError, match=r"theta = -5.0 there, 5.0 here"):
        studies.run("fig5", mu=0.0)
    assert studies.run("fig5", fresh=True, mu=0.0).sizes["onset"] == 0


@pytest.fixture(scope="module")
def locked_in():
    """Fig. 6 as it is."""
    return registry.load("fig6").sweep({}).plan().run("sync")


def test_fig6_follows_modes_5_and_6_to_their_lock_in(locked_in):
    data = locked_in
    np.testing.assert_array_equal(data["mode"], [5, 6])
    np.testing.assert_allclose(data["frequency"][0], [2530.0, 3087.0], atol=1.0)
    onset = flutter_onsets(Rig(), 5.0)
    assert float(data["lock_in_mu"]) == onset.mu[0]
    assert float(data["lock_in_frequency"]) == onset.frequency[0]
    after = data.sel(mu=slice(0.12, 0.2))
    assert np.all(after["frequency"][:, 0] - after["frequency"][:, 1] < 1.0)
    assert np.all(np.abs(after["growth_rate"].sum("mode") + 53.0) < 1.0)


@pytest.mark.parametrize(
    "settings",
    [{"contact_position": 0.02}, {"theta": 20.0, "head_mass": 0.0}, {"theta": 2.0}, {"contact_position": 0.15}],
)
def test_fig6_never_leaves_its_two_modes(settings):
    """Where other modes cross or couple nearby, the branches stay continuous and end as a pair."""
    data = registry.load("fig6").sweep({"mu": np.linspace(0.0, 0.6, 3001)} | settings).plan().run("sync")
    frequency, growth = data["frequency"].values, data["growth_rate"].values
    inside = np.isfinite(frequency).all(axis=1)
    assert inside[0]
    steps = np.abs(np.diff(frequency[inside], axis=0))
    # A pair on its way to a divergence falls steeply to zero, but never jumps.
    assert np.all(steps < 0.02 * frequency[inside][1:] + 25.0)
    after = inside & (data["mu"].values > float(data["lock_in_mu"]) + 1e-3)
    assert np.all(growth[after, 1] > growth[after, 0])
    # P2's axial mode crosses, and is not one of the two.
    assert np.all(np.ptp(frequency[inside], axis=0) > 1.0)


def test_fig6_goes_on_beyond_its_largest_mu():
    mu = np.linspace(0.0, 0.6, 13)
    together = registry.load("fig6").sweep({"mu": mu}).plan().run("sync")["frequency"]
    studies.run("fig6", mu=mu[:5])
    np.testing.assert_array_equal(studies.run("fig6", mu=mu)["frequency"], together)


def test_fig6s_shape_keeps_the_contact_closed(locked_in):
    data = locked_in
    shape = np.stack([data[f"shape_{axis}_real"] + 1j * data[f"shape_{axis}_imag"] for axis in "xy"], axis=1)
    at_contact = np.abs(data["node_x"].values) + np.abs(data["node_y"].values) < 1e-12
    tip, below = shape[at_contact]
    assert abs(tip[1] - below[1]) < 1e-9
    # Tangential and normal motion are both large at the contact, as the paper's figure shows.
    assert np.max(np.abs(shape)) == pytest.approx(1.0)
    clamp = (data["beam"].values == 2).argmax()
    np.testing.assert_array_equal(shape[clamp], 0.0)


def test_table4_has_the_papers_frequencies_at_85_mm_and_not_at_80():
    data = studies.run("table4")
    text = registry.load("table4").report(data)
    np.testing.assert_allclose(data["frequency"], data["frequency_paper"], rtol=0.0025)
    np.testing.assert_array_equal(data["frequency_measured"], paper.GLUED_MEASURED)
    assert np.abs(data["frequency_at_text_position"] / data["frequency_paper"] - 1.0).max() > 0.1
    for number in ("374", "4875", "361.7", "325.4", "0.22 % at 85 mm", "10.1 % at 80 mm"):
        assert number in text
    # Of a ninth mode the paper says nothing.
    data = studies.run("table4", mode=[8, 9])
    assert np.isnan(data["frequency_paper"].values[1])
    assert float(data["frequency"][1]) == pytest.approx(8237.0, abs=1.0)
    assert registry.load("table4").report(data).splitlines()[-2].split()[:3] == ["9", "-", "-"]


def test_results_go_where_the_environment_says_and_a_home_folder_is_understood(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("FIV_RESULTS", "~/mine")
    studies.run("table4")
    assert (tmp_path / "mine" / "table4" / "table4.nc").is_file()
    assert not (tmp_path / "~").exists()


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("fig55", {}, "STUDY = 'fig55': there is no such study; did you mean fig5"),
        ("fig5", {"mo": 0.2}, "mo: study fig5 has no such axis; did you mean mu"),
        ("fig5", {"mu": -0.1}, "mu = -0.1: it must be a number from 0 to"),
        ("fig5", {"mu": [0.1, float("nan")]}, "mu = nan: it must be finite"),
        ("fig5", {"mu": "much"}, "mu = 'much': 'much' must be a finite number"),
        ("fig5", {"theta": 95.0}, "theta = 95.0: it must be a single angle between -90 and 90"),
        ("fig5", {"theta": [1.0, 2.0]}, "it must be one number"),
        ("fig5", {"contact_position": 0.2}, "contact_position = 0.2: it must be above 0 and at most"),
        ("table4", {"mode": 0}, "mode = 0: it must be a whole number from 1 to 359"),
        ("fig5", {"mu": []}, r"mu = \[\]: it must be a number or a list of numbers"),
        ("fig5", {"mu": [0.1, [0.2]]}, r"mu = \[0.1, \[0.2\]\]: it must be a number or a list"),
        ("fig5", {"mu": np.zeros((2, 2))}, "mu = array"),
        ("fig6", {"mu": 5.0}, "mu = 5.0: it must be a number from 0 to 4"),
        ("fig5", {"mu": 1e308}, r"mu = 1e\+308: it must be a number from 0 to 1e\+06"),
        ("fig5", {"d1": 1e300}, r"^d1 = 1e\+300: it must be a number from 0 to 1e\+12"),
        (5, {}, "STUDY = 5: there is no such study"),
        ("table4", {"mode": 1e30}, r"mode = 1e\+30: it must be a whole number"),
        ("table4", {"mode": [1, 400]}, "mode = 400: it must be a whole number from 1 to 359"),
        ("table4", {"mode": 1.5}, "mode = 1.5: it must be a whole number"),
        ("table4", {"first_frequency": 1e4}, "first_frequency = 10000.0: it must be above"),
        ("fig6", {"theta": -5.0}, "theta = -5: no two modes below 10 kHz lock in up to mu = 1"),
        ("fig6", {"d2": 1e-3}, "theta = 5: the two modes that lock in cannot be followed back"),
        ("fig6", {"p2_elements": 0}, "p2_elements = 0.0: it must be a whole number from 1 to"),
    ],
)
def test_bad_input_is_named_and_nothing_is_written(name, given, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        studies.run(name, **given)
    assert not list(tmp_path.iterdir())


def test_opening_takes_paths_and_checks_whose_the_file_is(tmp_path):
    data = studies.run("table4")
    file = tmp_path / "results" / "table4" / "table4.nc"
    xr.testing.assert_equal(studies.open(file), data)
    other = tmp_path / "results" / "fig5" / "fig5.nc"
    other.parent.mkdir()
    other.write_bytes(file.read_bytes())
    with pytest.raises(ValueError, match="it holds the results of table4, not of fig5"):
        studies.open("fig5")
    with pytest.raises(FileNotFoundError, match="there is no such file"):
        studies.open(str(tmp_path / "none.nc"))


def test_a_file_that_lacks_something_is_told(tmp_path):
    data = studies.run("fig5", mu=[0.1, 0.2]).drop_vars("onset_mu")
    with pytest.raises(
        ValueError, match=r"it lacks onset_mu, which the figure shows; make it whole with: fiv run fig5"
    ):
        PLOT(registry.load("fig5"), data, tmp_path / "fig5.nc")


def test_the_source_attribute_names_version_and_commit(monkeypatch):
    assert re.fullmatch(r"fiv \S+ \(commit \w+(-dirty)?\)", provenance.source("fivcore"))
    monkeypatch.setattr(provenance, "_checkout", lambda package: "")
    built = {"g1a2b3c4": "1a2b3c4", "g1a2b3c4.d20261120": "1a2b3c4-dirty", "d20261120": "unknown", "": "unknown"}
    for local, commit in built.items():
        monkeypatch.setattr(provenance, "_version", lambda name, local=local: f"1.0+{local}")
        assert provenance.source.__wrapped__("fivcore") == f"fiv 1.0 (commit {commit})"
