"""Sliding that grows only above the band is told by point, in the file and at the end of a run."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from fivcore import InputError, OutOfBandWarning, Rig, Scene, growing_frequencies, simulate
from studies import registry
from studies.accuracy.rigs import drawn_scene
from studies.answering import summary
from studies.asking.sweep import sweep_of
from studies.declaring.parameters import RIG
from studies.gallery import maps
from studies.motion.above import NAME

SCENE = replace(drawn_scene(2010, 9), mu=0.18)
RUN = {"duration": 0.02, "ramp": 1e-3}


def numbers_of(rig):
    flat = {f"{beam}_{k}": v for beam in ("p1", "p2") for k, v in asdict(getattr(rig, beam)).items()}
    return {name: flat.get(name, getattr(rig, name, None)) for name in RIG}


def moved(**values):
    return sweep_of(registry.load("scenes"), values | RUN).plan().run("sync")


@pytest.fixture(scope="module")
def data():
    point = {"V": SCENE.V, "theta": SCENE.theta, "F": SCENE.F, "mu": [0.0, 0.18]}
    return moved(**numbers_of(SCENE.rig), **point)


def test_every_point_has_it(data):
    above = data[NAME].squeeze()
    assert np.isnan(above[0])
    assert float(above[1]) == pytest.approx(growing_frequencies(SCENE)[0], rel=1e-9)
    with pytest.warns(OutOfBandWarning, match="sliding is unstable at 19.2 kHz"):
        simulate(SCENE, 0.02)


def test_one_line_says_so(data):
    (line,) = [part for part in summary.parts(registry.load("scenes"), data) if "only above" in str(part)]
    assert line.startswith("At 1 of 2 points sliding grows only above 10 kHz, from 19.2 kHz on")
    assert f"holds up to {SCENE.rig.valid_up_to / 1e3:.3g} kHz" in line


def test_maps_and_other_studies_say_so():
    study, short = maps.STUDIES["motion"], {"min_duration": 0.01, "max_duration": 0.02}
    point = {"mu": [0.0, 0.18], "V": SCENE.V, "theta": SCENE.theta, "F": SCENE.F}
    data = sweep_of(study, numbers_of(SCENE.rig) | point | short).plan().run("sync")
    assert np.isfinite(data[NAME]).sum() == 1
    assert any("only above" in str(part) for part in summary.parts(study, data))


@pytest.mark.parametrize("theta", [5.0, -5.0])
def test_the_papers_rig_grows_within_the_band_or_nowhere(theta):
    data = moved(V=[-2e-3, 2e-3], theta=theta, mu=[0.05, 0.2], F=9.0)
    assert not np.isfinite(data[NAME]).any()
    assert not any("only above" in str(part) for part in summary.parts(registry.load("scenes"), data))


def test_growth_is_of_the_model_of_the_run():
    scene = Scene(2e-3, 5.0, 0.2, 9.0)
    np.testing.assert_array_equal(growing_frequencies(scene), simulate(scene, 1e-3).growing)
    assert len(growing_frequencies(replace(scene, mu=0.05))) == 0
    mirrored = replace(scene, V=-2e-3, theta=-5.0)
    np.testing.assert_array_equal(growing_frequencies(mirrored), growing_frequencies(scene))
    with pytest.raises(InputError, match="cutoff = -1"):
        growing_frequencies(Scene(2e-3, 5.0, 0.2, 9.0, Rig()), cutoff=-1.0)
