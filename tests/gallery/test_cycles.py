"""Study `cycles`: a known fold and onset, places on a branch; cycles in `contact`."""

import numpy as np
import pytest

import fivcore
from fivcore import CycleBranch, Rig, Scene, flutter_onsets, follow_cycle, limit_cycle, simulate
from fivcore.cycles.branch import Place
from studies import registry
from studies.answering import summary
from studies.asking.sweep import sweep_of
from studies.gallery import cycles
from studies.physics import cycles as orbits
from sweeps import InputError

# Of the paper's rig with d2 = 1e-6 s stable and unstable cycles meet here (tests/verification/test_cycles.py).
FOLD, DAMPED = 0.10356, Rig(d2=1e-6)


@pytest.fixture(scope="module")
def damped(computed):
    return computed("cycles", d2=[1e-6], mu=[0.102, 0.104, 0.106, 0.108, 0.11, 0.114], hold=0.1, edges=1, most=20)


def test_stable_and_unstable_cycles_meet_where_hysteresis_begins(damped):
    ((text, point),) = cycles.each_point(damped)
    assert text == "d2 = 1e-06 s"
    folds = point["place_value"].values[point["place_text"].values.astype(str) == "fold"]
    assert np.abs(folds - FOLD).min() < 2e-5
    assert point["onset_value"].values[0] == pytest.approx(flutter_onsets(DAMPED, 5.0).mu[0], rel=1e-9)
    multiplier = point["cycle_multiplier"].dropna("number").values
    assert multiplier.min() < 1.0 < multiplier.max()
    assert np.isfinite(point["knock_threshold"]).sum() == 1
    said = " ".join(summary.text(summary.parts(registry.load("cycles"), damped)).split())
    for part in (
        "stable ones exist from",
        "unstable ones exist from 0.10356",
        "flutter begins at 0.11223",
        "upward and downward runs",
    ):
        assert part in said


def test_places_lie_on_their_branch_in_its_order():
    values = np.array([1.0, 2.0, 3.0, 2.5, 1.5])
    places = [Place(1.5, "slip vanishes"), Place(3.1, "fold"), Place(2.0, "stick vanishes")]
    branch = CycleBranch("mu", values, [], places, "no convergence beyond mu = 1.5")
    found = [*orbits.places_of(branch, (0.0, 4.0))]
    assert found == [(1.5, "slip vanishes", 0), (3.1, "fold", 2), (2.0, "stick vanishes", 3),
                     (1.5, "end: no convergence", 4)]  # fmt: skip


def test_places_are_spread():
    assert orbits.spread(np.arange(10, 21), 3) == [12, 15, 18]
    assert orbits.spread(np.array([4]), 3) == [4]
    assert orbits.spread(np.array([]), 3) == []


@pytest.mark.parametrize(("values", "message"), [
    ({"V": -1e-3}, "V = -0.001: it must be above 0"),
    ({"most": 0}, "most = 0"),
    ({"edges": 100}, "edges = 100"),
    ({"follow": "V"}, "V: it is followed; give several values of it"),
])  # fmt: skip
def test_wrong_input_is_refused(values, message):
    with pytest.raises(InputError, match=message):
        sweep_of(registry.load("cycles"), values)


@pytest.fixture(scope="module")
def stable():
    """A stable cycle of the rig with much damping, and a run on it."""
    scene = Scene(2e-3, 5.0, 0.12, 9.0, DAMPED)
    return limit_cycle(scene, simulate(scene, 0.6).final_state)


def test_a_motion_on_its_cycle_is_near_it_all_the_time(stable):
    start = stable.final_state
    how = {"initial": start, "record": True, "sample_rate": None}
    motion = simulate(stable.scene, 0.05, **how)
    motion.summary["first_slip_time"] = 0.0
    assert orbits.near(motion, stable) == 1.0
    sliding = Scene(2e-3, 5.0, 0.05, 9.0)
    quiet = simulate(sliding, 0.3, record=True)
    assert orbits.near(quiet, stable) == 0.0


def test_the_cycle_is_followed_to_the_damping_or_to_where_it_ends(monkeypatch, stable):
    scene = stable.scene
    monkeypatch.setattr(orbits, "SOUGHT", 1e-6)
    monkeypatch.setattr(orbits, "limit_cycle", lambda *_, **__: stable)
    assert orbits.followed(scene, None, 3) == (stable, 1e-6)
    branch = follow_cycle(stable, "d2", 9.5e-7, most=3)
    monkeypatch.setattr(fivcore, "follow_cycle", lambda *_, **__: branch)
    other = Scene(2e-3, 5.0, 0.12, 9.0, Rig(d2=1e-9))
    cycle, reached = orbits.followed(other, None, 3)
    assert cycle is None
    assert reached == branch.values.min()


def test_no_cycle_is_sought_where_the_motion_has_long_sticks():
    cycle, reached = orbits.followed(Scene(2e-3, 5.0, 0.2, 9.0), None, 3)
    assert cycle is None
    assert np.isnan(reached)
