"""2000 simulations and 200 runs without growth of memory, of open files or of threads."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from tests import HOME
from tests.helpers.processes.repeated import SAMPLES

pytestmark = [pytest.mark.battery, pytest.mark.slow]

# By how much the last third of a process may be above the middle one, as medians. Of so many pieces of work a leak
# makes a third as much as all of them leave: 1 kB a simulation is 0.7 MB, and one object a simulation 670 blocks.
# Where nothing leaks, 2000 simulations end within 0.1 MB and 50 blocks of the middle.
MOST = {"memory": 0.25e6, "blocks": 300, "files": 0, "threads": 0}
# What 200 runs keep of the latest rigs, figures and texts still fills up, ever more slowly: their last third is
# 0.7 MB and 1300 blocks above the middle one. 30 kB a run, less than one open file or figure, are 2 MB.
MOST_OF_RUNS = MOST | {"memory": 2.0e6, "blocks": 3000}


def growth(samples):
    """By how much the last third of samples is above the middle third, as medians, for each quantity."""
    thirds = [samples[k * len(samples) // 3 : (k + 1) * len(samples) // 3] for k in (1, 2)]
    middle, last = ({name: np.median([one[name] for one in third]) for name in MOST} for third in thirds)
    return {name: float(last[name] - middle[name]) for name in MOST}


def grown(samples, most):
    """What has grown by more than it may, with by how much."""
    return {name: more for name, more in growth(samples).items() if more > most[name]}


def samples_of(what, count):
    """What a process holds after every twentieth of its work."""
    path = os.pathsep.join([str(HOME), os.environ.get("PYTHONPATH", "")])
    # With a heap for each thread glibc takes 1 to 4 MB at once, at a run of chance, and once in a thousand runs.
    settings = {"PYTHONPATH": path, "MALLOC_ARENA_MAX": "1"}
    ended = subprocess.run(
        [sys.executable, "-W", "ignore", "-m", "tests.helpers.processes.repeated", what, str(count)],
        cwd=HOME,
        env=os.environ | settings,
        capture_output=True,
        text=True,
        check=False,
    )
    assert not ended.returncode, ended.stderr
    samples = [json.loads(line) for line in ended.stdout.splitlines()]
    assert len(samples) == SAMPLES
    return samples


@pytest.mark.parametrize(("what", "count", "most"), [("simulations", 2000, MOST), ("runs", 200, MOST_OF_RUNS)])
def test_nothing_grows(what, count, most, tried):
    samples = samples_of(what, count)
    assert not grown(samples, most), samples
    tried[f"{what} that leave nothing behind"] += count


@pytest.mark.parametrize(("name", "count"), [("memory", 2000), ("blocks", 2000), ("files", 200), ("threads", 200)])
def test_a_leak_is_found(name, count, tried):
    """1 kB, an object, an open file or a thread at each piece of work, and nothing else."""
    assert name in grown(samples_of(f"leaking {name}", count), MOST)
    tried["leaks that are found"] += 1
