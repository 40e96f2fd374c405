"""Jobs of the motion studies: each has the result of `simulate`, and only the guilty one fails."""

from dataclasses import replace

import numpy as np
import pytest

from fivcore import ContactError, Rig, Scene, Transient, simulate
from studies.motion import jobs
from studies.motion.jobs import BalanceError, Job, outcomes, run_all

SCENE, SLOW = Scene(5e-3, 5.0, 0.2, 9.0), Scene(1e-3, 12.0, 0.35, 9.0)
UNSOLVABLE = Job(Scene(5e-3, 40.0, 5.0, 9.0), 5e-3, {"method": "fast", "ramp": 1e-3})
JOBS = [
    Job(SCENE, 0.05, {"method": "fast", "ramp": 1e-3}),
    UNSOLVABLE,
    Job(SLOW, 0.06, {"method": "fast", "ramp": 2e-3}),
]


def test_jobs_have_the_bits_of_a_run_alone():
    found = run_all(JOBS)
    assert isinstance(found[1], ContactError)
    for job, run in ((JOBS[0], found[0]), (JOBS[2], found[2])):
        np.testing.assert_equal(run.summary, simulate(job.scene, job.duration, **job.options).summary)


def test_an_option_that_does_not_suit_one_scene_fails_that_scene_alone():
    bad = replace(SCENE, rig=Rig(p1=replace(Rig().p1, elements=60)))
    good, error = run_all([Job(scene, 1e-4, {"method": "paper", "step": 2e-8}) for scene in (SCENE, bad)])
    assert isinstance(good, Transient)
    assert str(error).startswith("step = 2e-08: with these modes")
    with pytest.raises(ValueError, match=r"^duration = -1\.0: it must be"):
        run_all([JOBS[0], Job(SCENE, -1.0, {})])


def test_a_point_fails_with_the_first_error_of_its_runs_and_for_its_energy(monkeypatch):
    def durations(chosen, runs):
        return {"time": sum(job.duration for job in chosen)}

    found = outcomes([[JOBS[0], JOBS[2]], [JOBS[0], UNSOLVABLE]], durations)
    assert found["time"][0] == pytest.approx(0.11)
    assert [type(error) for error in found["error"]] == [type(None), ContactError]
    monkeypatch.setitem(jobs.BALANCE, "fast", 0.0)
    with pytest.raises(BalanceError, match=r"^energy_residual = .*of method 'fast'.*scene V = 0\.005 m/s"):
        outcomes([[JOBS[0]]], durations)
