"""Whole fits: what is found again, what a file keeps, and what is said of it."""

from contextlib import contextmanager, nullcontext
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy import stats

import studies
from fivcore import Rig, Structure, flutter_onsets, glued_frequencies
from studies import paper, registry, runner
from studies.answering import results
from studies.declaring.own import varied
from studies.fitting import presentation, problem, rounds
from sweeps import InputError
from tests.docs import readmes

pytestmark = pytest.mark.usefixtures("undrawn")
SYNC = "sync", None
GLUED = [f"glued_frequency_{k}" for k in range(1, 9)]
TRUE = {"contact_position": 0.0713, "head_mass": 2.1}
PRIORS = {"contact_position": "uniform:50:100mm", "head_mass": "loguniform:1:10"}
# A coarse mesh, whose lowest frequencies are those of the rig, too.
COARSE = {"p1_elements": 5, "p2_elements": 10}


def hammer(values, within="0.5%", **more):
    """A fit of the lowest natural frequencies of the beams glued at their contact, Hz."""
    text = ", ".join(f"{value:.9g}" for value in values) + " Hz"
    target = {"output": GLUED[: len(values)], "value": text, "within": within}
    return {"set": {"theta": 5} | COARSE, "unknown": PRIORS, "target": [target]} | more


def frequencies(count=3, **numbers):
    return glued_frequencies(Rig.of(**COARSE, **numbers), 5.0, count)


def interval(data, name):
    """The 5 % quantile, the median and the 95 % quantile of an unknown."""
    return presentation.quantiles(data[name].values, data["weight"].values)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Three frequencies of a known rig, two unknowns that decide them and one that does not."""
    folder = tmp_path_factory.mktemp("fitted")
    stated = hammer(frequencies(**TRUE), name="known", unknown=PRIORS | {"d1": "uniform:10:100"})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "plot", lambda *_: [])
        return folder, stated, studies.fit(stated, samples=32, rounds=2, out=folder)


def test_a_known_rig_is_found_again(fitted):
    _, _, data = fitted
    assert data["weight"].sum() == pytest.approx(1.0)
    for name, value in TRUE.items():
        low, middle, high = interval(data, name)
        assert low < value < high
        assert middle == pytest.approx(value, rel=0.02)
        assert high - low < 0.1 * np.ptp(presentation.parts(data)[0][name].ppf([0.05, 0.95]))
    text = data.fiv.summary()
    assert "The data do not constrain d1." in text
    assert "64 draws in 2 rounds count like" in text
    assert "No draw meets" not in text


def test_the_file_is_a_result_like_others(fitted, here):
    folder, _, data = fitted
    file = folder / "fit" / "known" / "known.nc"
    with xr.open_dataset(file) as plain:
        assert plain["status"].dims == ("draw",)
        assert plain["weight"].dims == ("draw",)
        assert plain["round"].values.tolist() == [1] * 32 + [2] * 32
        assert plain["contact_position"].attrs["units"] == "m"
        assert plain["glued_frequency_2"].attrs["units"] == "Hz"
        assert plain.attrs["Conventions"] == "CF-1.11"
    constants = results.configuration(data)["constants"]
    assert constants["unknown"]["head_mass"] == "loguniform:1:10"
    assert constants["targets"][0]["value"] == pytest.approx(frequencies(1, **TRUE)[0], rel=1e-8)
    (picture,) = runner.image(runner.study_of(data), data).values()
    assert len(picture) > 10_000
    best = here("query", str(file), "--sort", "-weight", "--limit", "1", "--show", "contact_position,weight")
    assert float(best.stdout.split()[-2]) == pytest.approx(TRUE["contact_position"], rel=0.02)


def test_a_fit_of_which_one_draw_is_left_is_shown_and_called_rough(fitted):
    _, _, data = fitted
    alone = data.assign(weight=data["weight"].copy(data=np.eye(1, 64, 3)[0]))
    study = runner.study_of(alone)
    text = " ".join(str(part) for part in study.summary(alone))
    assert "count like 1 (effective sample size); intervals are rough" in text
    assert len(runner.image(study, alone)[""]) > 10_000


def test_a_fit_that_was_stopped_goes_on_and_has_the_same_bits(fitted, tmp_path):
    """Also with more rounds, in another order of threads; what is there is not computed again."""
    _, stated, data = fitted
    read = problem.read(stated, registry.resolve, samples=32, rounds=2)
    computed = []

    @contextmanager
    def watch(planned):
        computed.append(planned.todo)
        if len(computed) == 2:
            raise KeyboardInterrupt
        yield

    with pytest.raises(KeyboardInterrupt):
        rounds.run(read, tmp_path / "known.nc", SYNC, watch)
    again = rounds.run(read, tmp_path / "known.nc", SYNC, watch)
    assert computed == [32, 32, 0, 32]
    for name in (*read.priors, *GLUED[:3], "weight"):
        np.testing.assert_array_equal(again[name].values, data[name].values)


def test_draws_that_cannot_be_are_kept_as_failures_and_weigh_nothing(tmp_path):
    """The lower beam is 150 mm long."""
    unknown = {"contact_position": "uniform:140:160mm"}
    stated = hammer(frequencies(contact_position=0.148), "20%", unknown=unknown)
    data = studies.fit(stated, samples=32, rounds=1, out=tmp_path)
    failed = data["status"].values == 2
    np.testing.assert_array_equal(failed, data["contact_position"].values >= 0.150)
    assert 0 < failed.sum() < 32
    assert not data["weight"].values[failed].any()
    assert "contact_position" in str(data["error"].values[failed][0])


def test_a_prior_that_no_draw_survives_is_one_line_and_leaves_nothing(tmp_path):
    """At negative angles nothing flutters."""
    onset = [{"output": "onset_mu", "value": 0.1, "within": 0.01}]
    stated = {"set": {"theta": -5} | COARSE, "unknown": PRIORS, "target": onset}
    with pytest.raises(
        InputError, match="no draw of 8 survives: no draw gives a value of onset_mu, or fulfils it; change"
    ):
        studies.fit(stated, samples=8, rounds=1, out=tmp_path)
    assert not list(tmp_path.rglob("*.nc"))
    assert not list(tmp_path.rglob("*.png"))


def test_what_no_draw_meets_is_said(tmp_path):
    stated = hammer([10.0, 374.0], unknown=PRIORS | {"head_mass": "uniform:2:3"})
    text = " ".join(studies.fit(stated, samples=16, rounds=1, out=tmp_path).fiv.summary().split())
    assert "No draw meets: glued_frequency_1 (nearest" in text
    assert "off by more than 2 standard deviations: glued_frequency_1 Hz" in text


def test_errors_of_runs_add_in_square_and_statements_count_with_their_share():
    at = {"V": "1mm/s", "mu": 0.2, "numerical_damping": "none"}
    number = {"study": "regimes", "output": "velocity_rms", "value": "5mm/s", "within": "3mm/s", "at": at}
    stated = {"unknown": {"d1": "uniform:10:100"}, "target": [number, {"is": "intermittent", "at": at}]}
    read = problem.read(stated, registry.resolve)
    values = {"velocity_rms": [5e-3, 10e-3, np.nan, 5e-3], "velocity_rms_se": [0.0, 4e-3, 0.0, np.nan]}
    shares = {"regime": [0.25, 1.0, 1.0, 0.0]}
    data = xr.Dataset({name: ("draw", np.array(each)) for name, each in (values | shares).items()})
    exact = [stats.norm(5e-3, 3e-3).pdf(5e-3) * 0.25, stats.norm(5e-3, 5e-3).pdf(10e-3), 0.0, 0.0]
    np.testing.assert_allclose(np.exp(rounds.log_likelihood(read, data)) / np.sqrt(2.0 * np.pi), exact, rtol=1e-12)


def test_a_number_that_a_structure_has_not_is_refused_before_anything_is_computed(tmp_path):
    (tmp_path / "pin.toml").write_text(readmes.blocks("toml", "studies/README.md")[0])
    (tmp_path / "own.toml").write_text(
        'rig = "pin.toml"\nunknown.d1 = "uniform:1:9"\n[[target]]\noutput = "onset_mu"\nvalue = 1\nwithin = 1'
    )
    with pytest.raises(InputError, match=r"own.toml: d1, d2: the structure is damped by mode; take damping_ratio"):
        problem.read(tmp_path / "own.toml", registry.resolve)


def test_numbers_of_a_structure_change_what_they_say():
    own = Structure.from_modes(
        [500.0, 800.0, 1700.0], [0.4, 0.1, 0.4], [-0.9, -0.7, -0.4], load=[-0.4, -0.1, 0.0], d2=1e-7
    )
    same = varied(own, {"mass_scale": 1.0, "frequency_2": 800.0, "d1": 0.0})
    np.testing.assert_allclose(same.stiffness, own.stiffness, rtol=1e-14)
    heavy = varied(own, {"mass_scale": 4.0, "stiffness_scale": 4.0})
    np.testing.assert_allclose(heavy.frequency, own.frequency)
    np.testing.assert_allclose(heavy.receptances(600.0, 0.2)[0], own.receptances(600.0, 0.2)[0] / 4.0)
    swapped = varied(own, {"frequency_1": 900.0, "damping_ratio": 0.01})
    np.testing.assert_allclose(swapped.frequency, [800.0, 900.0, 1700.0])
    np.testing.assert_allclose(swapped.normal, [0.1, 0.4, 0.4])
    np.testing.assert_allclose(swapped.damping, 0.04 * np.pi * swapped.frequency)
    ratios = Structure.from_modes(own.frequency, own.normal, own.tangential, load=own.load, damping_ratio=0.02)
    np.testing.assert_allclose(varied(ratios, {"stiffness_scale": 4.0}).damping, 2.0 * ratios.damping)
    # What a knock moves keeps its modes.
    moved = varied(replace(own, struck=own.normal), {"frequency_1": 900.0, "mass_scale": 4.0})
    np.testing.assert_allclose(moved.struck, moved.normal)


def test_a_stiffer_structure_is_found_by_its_onset(tmp_path):
    """Frequencies grow with the root of the stiffness; the file of the structure lies beside that of the fit."""
    (tmp_path / "pin.toml").write_text(readmes.blocks("toml", "studies/README.md")[0])
    hertz = 1.1 * flutter_onsets(Structure.read(tmp_path / "pin.toml"), 0.0).frequency[0]
    target = f'[[target]]\noutput = "onset_frequency"\nvalue = "{hertz:.9g}Hz"\nwithin = "0.5%"\n'
    (tmp_path / "own.toml").write_text(f'rig = "pin.toml"\nunknown.stiffness_scale = "lognormal:1:0.3"\n{target}')
    data = studies.fit(tmp_path / "own.toml", samples=16, rounds=1, out=tmp_path)
    low, middle, high = interval(data, "stiffness_scale")
    assert middle == pytest.approx(1.21, rel=0.01)
    assert low < 1.21 < high


def ranks(count, folder, samples=64):
    """Posterior probability below the true number, of rigs that are drawn from the priors, (count, unknowns)."""
    rng, found = np.random.default_rng(7), []
    for number in range(count):
        read = problem.read(hammer([1.0]), registry.resolve)
        true = {name: float(prior.ppf(rng.uniform())) for name, prior in read.priors.items()}
        measured = frequencies(**true) * (1.0 + 0.01 * rng.standard_normal(3))
        within = [f"{1e-2 * value:.9g}Hz" for value in frequencies(**true)]
        stated = hammer(measured, within, name=f"rig{number}")
        one = problem.read(stated, registry.resolve, samples=samples, rounds=2, seed=number)
        data = rounds.run(one, folder / f"{number}.nc", SYNC, lambda _: nullcontext())
        found.append([data["weight"].values[data[name].values < value].sum() for name, value in true.items()])
    return np.array(found)


def test_a_rig_is_where_its_posterior_is(tmp_path):
    found = ranks(1, tmp_path, 32)
    assert np.all((found > 0.001) & (found < 0.999))


@pytest.mark.slow
def test_ranks_of_fifty_rigs_are_uniform_and_intervals_contain_them(tmp_path):
    """Simulation-based calibration (Talts et al., arXiv:1804.06788): chi-squared at 1 %, ten ranks in each bin."""
    found = ranks(50, tmp_path, 128)
    for column in found.T:
        counts = np.histogram(column, 5, (0.0, 1.0))[0]
        assert stats.chisquare(counts).pvalue > 0.01
        assert 0.80 <= np.mean((column > 0.05) & (column < 0.95)) <= 0.98


def table4(values, within, name, folder):
    wide = {"contact_position": "uniform:50:140mm", "head_mass": "loguniform:0.3:30"}
    unknown = wide | {"young_modulus": "uniform:120:240GPa"}
    stated = hammer(values, within, name=name, unknown=unknown, set={"theta": 5})
    data = studies.fit(stated, samples=128, rounds=3, out=folder)
    return {each: interval(data, each) for each in unknown}


@pytest.mark.slow
def test_table_4_gives_the_rig_that_the_paper_computed_with(tmp_path):
    """The contact is at 85 mm; 185 GPa is in Table 3; the head mass is tuned to 16 Hz."""
    found = table4(paper.GLUED_NUMERICAL, "0.2%", "numerical", tmp_path)
    assert found["contact_position"] == pytest.approx([0.0849, 0.0850, 0.0851], abs=5e-5)
    assert found["head_mass"][1] == pytest.approx(Rig().head_mass, rel=0.01)
    assert found["young_modulus"][1] == pytest.approx(Rig().p1.young_modulus, rel=0.005)
    for name, value in (("contact_position", 0.085), ("head_mass", Rig().head_mass), ("young_modulus", 185e9)):
        assert found[name][0] < value < found[name][2]


@pytest.mark.slow
def test_the_measured_column_of_table_4(tmp_path):
    """Within 2 %, half of the largest deviation that the paper names."""
    found = table4(paper.GLUED_MEASURED, "2%", "measured", tmp_path)
    assert found["contact_position"] == pytest.approx([0.0854, 0.0862, 0.0870], abs=3e-4)
    assert found["head_mass"] == pytest.approx([2.59, 2.77, 2.97], rel=0.03)
    assert found["young_modulus"] == pytest.approx([176.8e9, 181.2e9, 185.4e9], rel=0.01)


@pytest.mark.slow
def test_the_papers_statements_give_more_stiffness_damping_than_it_prints(tmp_path):
    """Intermittent at 1 and 2 mm/s, not at 5 (Sections 2 and 3.5.3): a band, less d2 with more d1."""
    slow = {"name": "slow", "is": "intermittent", "at": {"V": "1,2mm/s"}}
    fast = {"name": "fast", "is": "not intermittent", "at": {"V": "5mm/s"}}
    stated = {
        "unknown": {"d1": "loguniform:10:316", "d2": "loguniform:1e-8:5e-7"},
        "set": {"mu": paper.MU, "max_duration": 1.5, "min_duration": 1.0, "standard_error": 0.5},
        "target": [slow, fast],
    }
    data = studies.fit(stated, samples=64, rounds=3, out=tmp_path)
    weights, d1, d2 = (data[name].values for name in ("weight", "d1", "d2"))
    # Of the draws near the printed 50 1/s.
    near = (d1 > 30.0) & (d1 < 80.0)
    low, middle, _ = presentation.quantiles(d2[near], weights[near])
    assert low > 2e-8
    assert 4e-8 < middle < 2e-7
    together = np.cov(np.log(d1), np.log(d2), aweights=weights)
    assert together[0, 1] / np.sqrt(together[0, 0] * together[1, 1]) < -0.5


@pytest.mark.slow
def test_processes_give_the_same_bits(fitted, tmp_path):
    _, stated, data = fitted
    again = studies.fit(stated, samples=32, rounds=2, out=tmp_path, scheduler="processes", workers=2)
    for name in (*stated["unknown"], *GLUED[:3], "weight"):
        np.testing.assert_array_equal(again[name].values, data[name].values)


def test_the_example_of_the_readme_states_three_frequencies(tmp_path):
    (text,) = (block for block in readmes.blocks("toml") if "[[target]]" in block)
    (tmp_path / "bench.toml").write_text(text)
    read = problem.read(tmp_path / "bench.toml", registry.resolve)
    assert [target.units for target in read.model.targets] == ["Hz"] * 3
