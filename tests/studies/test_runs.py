"""Jobs of the studies: each has the result that `simulate` gives it, whatever the other jobs ask for."""

from dataclasses import replace
from functools import partial
from traceback import extract_tb

import numpy as np
import pytest

from fivcore import ContactError, Rig, Scene, Transient, simulate, simulate_many
from fivcore.contact.ablation import with_relaxation_time
from studies.motion import jobs as runs
from studies.motion.jobs import BALANCE, BalanceError, Job, outcomes, run_all
from sweeps import Axis, Grid, Sweep, Variable

SCENE, SLOW = Scene(5e-3, 5.0, 0.2, 9.0), Scene(1e-3, 12.0, 0.35, 9.0)
TIMES = np.linspace(0.0, 5e-3, 7)
COARSE = Rig(replace(Rig().p1, elements=1), replace(Rig().p2, elements=1))
UNSOLVABLE = Job(Scene(5e-3, 40.0, 5.0, 9.0), 5e-3, {"method": "fast", "ramp": 1e-3})
JOBS = [
    Job(SCENE, 0.05, {"method": "fast", "ramp": 1e-3}),
    Job(SLOW, 5e-3, {"method": "fast", "record": ("velocity_B",), "sample_times": TIMES}),
    UNSOLVABLE,
    Job(SLOW, 0.06, {"method": "fast", "ramp": 2e-3}),
    Job(SCENE, 1e-3, {"method": "paper", "step": 1e-8}),
    Job(SCENE, 5e-3, {"method": "fast", "record": ("velocity_B",), "sample_times": TIMES.copy()}),
    Job(SCENE, 5e-3, {"method": "fast", "record": ("velocity_B",), "sample_times": TIMES[:3]}),
]


def test_jobs_with_equal_options_share_a_call_and_keep_their_bits(monkeypatch):
    calls = []
    monkeypatch.setattr(runs, "simulate_many", lambda s, *a, **k: calls.append(s) or simulate_many(s, *a, **k))
    for job, run in zip(JOBS, run_all(JOBS), strict=True):
        if job is UNSOLVABLE:
            assert isinstance(run, ContactError)
            continue
        own = simulate(job.scene, job.duration, **job.options)
        assert run.scene is job.scene
        np.testing.assert_array_equal(run.velocity_B, own.velocity_B)
        np.testing.assert_equal(run.summary, own.summary)
    assert [len(scenes) for scenes in calls] == [3, 2, 1, 1]
    assert run_all([]) == []


def test_a_bad_argument_is_raised():
    with pytest.raises(ValueError, match=r"^duration = -1\.0: it must be"):
        run_all([JOBS[0], Job(SCENE, -1.0, {})])


@pytest.mark.parametrize(
    ("rig", "options", "text"),
    [
        (Rig(p1=replace(Rig().p1, elements=60)), {"method": "paper", "step": 2e-8}, "step = 2e-08: with this rig"),
        (Rig(p2=replace(Rig().p2, thickness=0.1)), {"method": "exact", "cutoff": 2e3}, "cutoff = 2000: it must"),
        (COARSE, {"method": "exact", "cutoff": 75e3}, "cutoff = 75000: it keeps every mode"),
    ],
)
def test_an_option_that_does_not_suit_one_scene_fails_that_scene_alone(rig, options, text):
    bad = replace(SCENE, rig=rig)
    good, error = run_all([Job(SCENE, 1e-4, options), Job(bad, 1e-4, options)])
    assert isinstance(good, Transient)
    assert isinstance(error, ValueError)
    assert error.scene == bad
    assert str(error).startswith(text)
    assert "; scene V = 0.005 m/s, theta = 5 degrees" in str(error)
    with pytest.raises(ValueError, match=f"^{text}"):
        simulate(bad, 1e-4, **options)


def test_a_point_fails_with_the_first_error_of_its_runs():
    def values(jobs, found):
        assert all(isinstance(run, Transient) for run in found)
        return {"time": sum(job.duration for job in jobs)}

    whole = outcomes([[JOBS[0], JOBS[3]], [JOBS[0], UNSOLVABLE]], values, copies=True)
    assert whole["time"][0] == pytest.approx(0.11)
    assert whole["error"][0] is None
    assert str(whole["error"][1]).endswith("which this is a copy of")
    assert "fivcore" in extract_tb(whole["error"][1].__traceback__)[-1].filename
    # The time that all took is shared by what was simulated; a scene that is refused takes none.
    assert whole["wall_time"][0] == pytest.approx(0.11 / 0.05 * whole["wall_time"][1])
    with pytest.raises(ContactError, match="mu = 5"):
        outcomes([[UNSOLVABLE]], values)


def relaxed(points):
    """The energy residual at points whose contact element has its own relaxation time."""
    options = [
        {"method": "fast", "modify": partial(with_relaxation_time, tau=float(tau))} for tau in points["tau"]
    ]
    return outcomes([[Job(SCENE, 0.1, each)] for each in options], lambda _, runs: {"left": residual(runs[0])})


def residual(run):
    return run.summary["energy_residual"]


def test_a_point_whose_energy_does_not_add_up_fails_with_the_reason():
    """An element that relaxes a hundred times too slowly takes steps as small."""
    grid = Grid({"tau": Axis([1e-7, 1e-5], "s")})
    data = Sweep("relaxed", relaxed, grid, {"left": Variable("1")}).plan().run("sync")
    left = simulate(SCENE, 0.1, modify=partial(with_relaxation_time, tau=1e-5)).summary["energy_residual"]
    assert data["left"][0] < BALANCE["fast"] < left
    assert data["status"].values.tolist() == [1, 2]
    assert np.isnan(data["left"][1])
    error = str(data["error"].values[1])
    assert error.startswith(f"BalanceError: energy_residual = {left:.3g}: of method 'fast' at most 0.1 counts; ")
    assert "a smaller step or method 'exact'; scene V = 0.005 m/s" in error
    # A point alone ends as the line that reproduces it does.
    with pytest.raises(BalanceError, match=r"^energy_residual = 0\.\d+: "):
        relaxed({"tau": [1e-5]})
    # What the message advises helps.
    assert (
        simulate(SCENE, 0.1, modify=partial(with_relaxation_time, tau=1e-5), step=1e-7).summary["energy_residual"]
        < BALANCE["fast"]
    )
