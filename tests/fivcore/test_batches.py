"""Many scenes: the bits of each alone, on threads too, and a scene that fails leaves the others alone."""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from fivcore import ContactError, DivergenceError, Friction, Rig, Scene, painleve_mu, simulate, simulate_many
from fivcore.errors import SceneError
from fivcore.transient.fast.run import FastRun
from fivcore.transient.normalised import Normalised
from tests.helpers.runs import assert_same_run

PAPERS = Scene(5e-3, 5.0, 0.2, 9.0)
COMPANY = [
    PAPERS,
    Scene(1e-3, 5.0, 0.2, 9.0),
    Scene(2e-2, 12.0, 0.35, 9.0),
    Scene(5e-3, -5.0, 0.2, 9.0),
    Scene(5e-3, 0.0, 0.3, 2.0),
    Scene(5e-3, 5.0, 0.2, 9.0, Rig(contact_position=0.065)),
]


@pytest.mark.parametrize("method", ["fast", "exact", "paper"])
def test_every_scene_of_a_batch_is_the_scene_alone(method):
    scenes = COMPANY if method == "fast" else COMPANY[:3:2]
    durations = [0.05 + 0.01 * k if method == "fast" else 2e-3 for k in range(len(scenes))]
    for run, scene, duration in zip(simulate_many(scenes, durations, method), scenes, durations, strict=True):
        assert_same_run(run, simulate(scene, duration, method))
    assert simulate_many([], 0.01, method) == []


def test_a_scene_has_the_same_bits_on_threads():
    alone = [simulate(scene, 0.1, record=True) for scene in COMPANY]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda scene: simulate(scene, 0.1, record=True), COMPANY))
    for one, other in zip(alone, together, strict=True):
        assert_same_run(one, other)


def test_what_is_recorded_of_one_is_recorded_of_all():
    """Only durations, ramps, settling times, states and numerical damping are lists of each scene's own."""
    names, times = ["velocity_B", "state"], [0.0, 0.011, 0.0123, 0.05]
    two, damping = [PAPERS, COMPANY[1].mirrored()], ["published", None]
    for given, count in (({"record": names}, 5000), ({"record": True, "sample_times": times}, 4)):
        runs = simulate_many(two, 0.05, numerical_damping=damping, **given)
        for run, scene, own in zip(runs, two, damping, strict=True):
            assert_same_run(run, simulate(scene, 0.05, numerical_damping=own, **given))
            assert len(run.velocity_B) == len(run.state) == len(run.time) == count
            assert bool(len(run.normal_force)) == (count == 4)
    # As long as the scenes are many, too.
    for run in simulate_many(two, 0.05, record=names, sample_times=times[:2]):
        assert run.time.tolist() == times[:2]


PAINLEVE = replace(PAPERS, mu=1.01 * painleve_mu(Rig(), 5.0))
FAILING = [
    ("fast", PAINLEVE, 0.02, {}, ContactError),
    ("exact", replace(PAPERS, V=0.05, friction=Friction(0.5, 0.1)), 0.01, {}, ContactError),
    ("fast", replace(PAPERS, rig=Rig(d2=100.0)), 2e-3, {}, SceneError),
]


@pytest.mark.parametrize(("method", "failing", "duration", "given", "error"), FAILING)
def test_a_scene_that_fails_leaves_the_others_alone(method, failing, duration, given, error):
    """Before its first step or on its way."""
    runs = simulate_many([PAPERS, failing, COMPANY[2]], duration, method, **given)
    assert isinstance(runs[1], error)
    assert runs[1].scene == failing
    assert f"V = {failing.V:g} m/s" in str(runs[1])
    assert_same_run(runs[0], simulate(PAPERS, duration, method, **given))
    assert_same_run(runs[2], simulate(COMPANY[2], duration, method, **given))


def test_a_scene_that_blows_up_leaves_the_others_alone(monkeypatch):
    flush = FastRun.flush

    def blown_up(run, floor):
        return flush(run, floor) and not (run.scene == Normalised.of(COMPANY[2]) and run.time > 0.03)

    alone = [simulate(scene, 0.06) for scene in COMPANY[:2]]
    monkeypatch.setattr(FastRun, "flush", blown_up)
    runs = simulate_many([PAPERS, COMPANY[2], COMPANY[1]], 0.06)
    assert isinstance(runs[1], DivergenceError)
    assert runs[1].scene == COMPANY[2]
    assert_same_run(runs[0], alone[0])
    assert_same_run(runs[2], alone[1])


# Ramp, onset, skip, slip, separation, record, steady sliding, and stability, in mixed batches; vibrating runs end
# before last bits have grown to 1e-6.
PROGRAM = """
import json
from fivcore import Rig, Scene, flutter_onsets_many, simulate_many, unstable_windows

slow, quick, odd = (Scene(V, theta, mu, 9.0, Rig.of(p2_length=length))
    for V, theta, mu, length in ((1e-3, 5.0, 0.2, 0.15), (0.02, 5.0, 0.2, 0.15), (5e-3, 12.0, 0.3, 0.2)))
given = {"record": True, "sample_rate": 20e3, "min_stick": 1e-5, "settle": 0.0}
runs = simulate_many([slow, quick, odd] * 11, [0.06, 0.01, 0.01] * 11, **given)
runs += simulate_many([slow, quick], 0.01, cutoff=75e3, ramp=0.0, **given)
runs += simulate_many([Scene(5e-3, -5.0, 0.2, 9.0)], 1.0, **given)
runs += simulate_many([quick], 0.01, "exact", **given)
runs += simulate_many([quick], 2e-3, "paper", **given)
told = [{name: getattr(value, "tolist", lambda: value)() for name, value in run.summary.items()} for run in runs]
found = flutter_onsets_many({"theta": [5.0, 12.0, -40.0]}), unstable_windows(Rig(), 0.2, 0.5, 3.0)
told += [{"states": sorted({int(state) for run in runs for state in run.state})}]
told += [{"onsets": found[0].mu.ravel().tolist(), "windows": found[1].theta_from.tolist()}]
print(json.dumps(told))
"""


@pytest.mark.slow
def test_no_kernel_leaves_its_arrays(tmp_path):
    """With every index checked the figures are the same; compiled now or before, the bits are."""

    def told(folder, **given):
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / folder)} | given
        return subprocess.check_output([sys.executable, "-c", PROGRAM], text=True, env=environment)

    usual = told("usual")
    assert told("usual") == usual
    for one, other in zip(json.loads(usual), json.loads(told("checked", NUMBA_BOUNDSCHECK="1")), strict=True):
        assert set(one) == set(other)
        for name, value in one.items():
            if isinstance(value, (str, bool)) or name == "states":
                assert other[name] == value, name
            else:
                assert other[name] == pytest.approx(value, rel=1e-5, abs=1e-9, nan_ok=True), name
    assert json.loads(usual)[-2]["states"] == [0, 1, 2]
