"""Fig. 5 of any rig and structure: every mode of the band, every onset, in file, text and figure."""

import numpy as np
import pytest

import studies
from fivcore import Structure, flutter_onsets, sliding_modes
from fivcore.rig import Rig
from fivcore.structure import modal_structure
from studies import registry
from studies.answering import summary
from studies.asking.sweep import sweep_of
from studies.declaring.spec import evenly
from studies.motion.run import BAND
from studies.plotting import figures
from studies.plotting.modes import UNSTABLE
from tests.helpers.scattered import rig_of, scattered

STUDY = registry.load("fig5")
MU = evenly(0.0, 0.8, 33)
RIGS = scattered(60, seed=5, width=0.4)
RIGS["contact_position"] = np.minimum(RIGS["contact_position"], 0.95 * RIGS["p2_length"])
PIN = Structure.from_modes(
    [500.0, 800.0, 1700.0], [0.4, 0.1, 0.4], [-0.9, -0.7, -0.4], load=[-0.4, -0.1, -0.4], damping_ratio=0.002
)


def of_rig(computed, row):
    numbers = {name: float(values[row]) for name, values in RIGS.items()}
    rig = rig_of(RIGS, row)
    return rig, numbers["theta"], computed("fig5", mu=MU, **numbers)


@pytest.mark.parametrize("row", [pytest.param(k, marks=[pytest.mark.slow] if k % 10 else []) for k in range(60)])
def test_every_mode_of_the_band_and_every_crossing_is_in_the_file(computed, row):
    rig, theta, data = of_rig(computed, row)
    modes = sliding_modes(rig, theta, data["mu"].values, BAND)
    count = np.isfinite(modes.frequency).sum(axis=-1)
    np.testing.assert_array_equal(np.isfinite(data["frequency"]).sum("mode"), count)
    np.testing.assert_array_equal((data["growth_rate"] > 0.0).sum("mode"), modes.unstable.sum(axis=-1))
    found = flutter_onsets(rig, theta, BAND, 0.8)
    for kind, mu in (("onset", found.mu), ("recovery", found.recovery_mu)):
        np.testing.assert_allclose(data[f"{kind}_mu"], mu, rtol=1e-9)
    # Growth begins at an onset, where a growing pair enters the band, or at divergence.
    begins = np.flatnonzero(np.diff((data["growth_rate"] > 0.0).sum("mode")) > 0)
    known = [*found.mu, *found.entry_mu, found.divergence_mu]
    for k in begins:
        assert any(data["mu"][k] <= mu <= data["mu"][k + 1] for mu in known)


@pytest.mark.parametrize("row", [0, 30, "pin"])
def test_what_grows_is_told_and_drawn(computed, row):
    data = (
        of_rig(computed, row)[2]
        if row != "pin"
        else sweep_of(STUDY, {"mu": MU}, structure=PIN.to_dict()).plan().run("sync")
    )
    told = summary.text(STUDY.summary(data))
    for mu in (*data["onset_mu"].values, *data["recovery_mu"].values):
        assert f"{mu:.4g}" in told
    assert ("jams" in told) == np.isfinite(data["divergence_mu"].item())
    with figures.style():
        top, bottom = STUDY.figure(data).axes
    grows = (data["growth_rate"] > 0.0).values
    red = [
        line for line in top.lines if line.get_color() == UNSTABLE["color"] and line.get_label() != "stable mode"
    ]
    drawn = np.stack([line.get_ydata() for line in red if len(line.get_ydata()) == len(data["mu"])], axis=1)
    np.testing.assert_array_equal(np.isfinite(drawn), grows)
    assert np.nanmax(data["frequency"]) / 1e3 <= top.get_ylim()[1]
    assert not grows.any() or np.nanmax(data["growth_rate"]) <= bottom.get_ylim()[1]
    dots = {tuple(point) for line in top.lines if line.get_marker() == "o" for point in line.get_xydata().tolist()}
    crossings = {
        point
        for kind in ("onset", "recovery")
        for point in zip(data[f"{kind}_mu"].values, data[f"{kind}_frequency"].values / 1e3, strict=True)
    }
    assert {(round(a, 9), round(b, 9)) for a, b in dots} == {(round(a, 9), round(b, 9)) for a, b in crossings}


def test_a_mode_that_grows_already_where_it_enters_the_band_is_told(computed, tmp_path):
    """With a P1 of 46.5 mm a pair flutters from mu = 0.2042 at 10.05 kHz on and is in the band from 0.2372 on."""
    rig, mu = Rig.of(p1_length=0.0465), [0.23, 0.236, 0.239, 0.25]
    whole = flutter_onsets(rig, 5.0, 12e3)
    assert (whole.mu[0], whole.frequency[0]) == (pytest.approx(0.2042, abs=1e-4), pytest.approx(10047.0, abs=1.0))
    assert flutter_onsets(rig, 5.0).mu[0] == pytest.approx(0.2411, abs=1e-4)
    told = summary.text(STUDY.summary(computed("fig5", mu=mu, p1_length=0.0465))).replace("\n", " ")
    assert "flutters from mu = 0.2411" in told
    assert "unstable from mu = 0.239 on: modes whose onset is above 10 kHz" in told
    edge = studies.map("p1_length=46:47:3mm", quantity="onset_mu,onset_frequency", out=tmp_path)
    assert "At 1 of 3 points that is where a growing mode comes below 10000 Hz" in edge.fiv.summary()


def test_divergence_of_a_structure_is_where_a_real_exponent_begins_to_grow():
    rng, met = np.random.default_rng(3), 0
    for n in rng.integers(2, 9, 60):
        frequency, load = np.sort(rng.uniform(100.0, 6000.0, n)), -rng.uniform(0.2, 1.0, n)
        own = Structure.from_modes(
            frequency, -load, rng.normal(size=n), load=load, damping_ratio=rng.uniform(1e-3, 0.05, n)
        )
        mu = flutter_onsets(own, 0.0, BAND, 2.0).divergence_mu
        if np.isfinite(mu):
            below, above = (sliding_modes(own, 0.0, share * mu, BAND) for share in (1.0 - 1e-7, 1.0 + 1e-7))
            assert not (below.unstable & (below.frequency == 0.0)).any()
            assert (above.unstable & (above.frequency == 0.0)).any()
        met += np.isfinite(mu)
        if not np.isfinite(mu):
            every = sliding_modes(own, 0.0, np.linspace(0.0, 2.0, 41), BAND)
            assert not (every.unstable & (every.frequency == 0.0)).any()
    assert met > 10


@pytest.mark.parametrize("theta", [-70.0, -5.0, 5.0, 40.0, 75.0])
def test_divergence_of_the_rig_is_that_of_its_modes(theta):
    found = flutter_onsets(Rig(), theta, BAND, 5.0).divergence_mu
    by_modes = flutter_onsets(modal_structure(Rig(), theta), 0.0, BAND, 5.0).divergence_mu
    np.testing.assert_allclose(by_modes, found, rtol=1e-9)
