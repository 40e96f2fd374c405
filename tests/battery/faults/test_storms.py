"""Runs that are killed, stopped, starved, raced and deserted at random: each time the undisturbed file in the end.

FIV_STORM_MINUTES gives another time; FIV_STORM repeats one storm, by its kind and seed: "killed 123".
"""

import os
import shutil
import subprocess
import tempfile
import time

import numpy as np
import pytest

from tests.helpers.processes.sweep_programs import COMPARED, make
from tests.helpers.storms import happenings
from tests.helpers.storms.faults import mount
from tests.helpers.storms.happenings import KINDS, disk_full
from tests.helpers.storms.readers import Reader, contents
from tests.helpers.storms.storm import Storm

pytestmark = [pytest.mark.battery, pytest.mark.slow]
MINUTES = 15.0
SIZES = [(20, 0.02), (40, 0.02), (60, 0.01), (40, 0.05)]
# Faults that come after others.
OTHERS = ["killed", "stopped", "interrupted", "interrupted_twice", "clock_set_back", "disk_refuses"]
# What must have been tried in the end.
ALWAYS = ["runs killed", "runs stopped and continued", "runs interrupted once", "runs interrupted twice"]
ALWAYS += ["workers killed", "disks that refuse", "files that may not grow", "schedulers killed", "racing runs"]
ALWAYS += ["racing runs refused", "clusters whose workers were killed", "workers of another version"]
ALWAYS += ["workers of another code", "workers stopped and continued", "clocks set back", "reads beside a writer"]


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    """A folder of its own for what is temporary: others use the system's meanwhile."""
    (tmp_path / "scratch").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "scratch"))
    monkeypatch.setattr(tempfile, "tempdir", None)


@pytest.fixture
def kinds():
    """What may happen here; disks can be mounted by who may."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            mount(folder, 64)
        except (OSError, subprocess.SubprocessError):
            return [kind for kind in KINDS if kind is not disk_full]
        subprocess.run(["umount", folder], check=True)
    return KINDS


class Undisturbed(dict):
    """Files of runs in which nothing happens, and their values, by the size of the sweep."""

    def __init__(self, folder):
        self.folder = folder

    def __missing__(self, size):
        points, pause = size
        path = self.folder / f"{points}-{pause}" / "powers.nc"
        data = make(points=points, pause=pause, log=self.folder / "log").plan(path).run("sync")
        self[size] = contents(path), {name: data[name].values for name in ("x", *COMPARED)}
        return self[size]


def storm_of(kind, seed, undisturbed, tried):
    """A fault of a kind, sometimes others after it, until the sweep is complete; what was wrong."""
    rng = np.random.default_rng(seed)
    points, pause = SIZES[rng.integers(len(SIZES))]
    file, values = undisturbed[points, pause]
    wrong, folder = [], undisturbed.folder / "storm"
    with Storm(folder, undisturbed.folder / "log", rng, tried, points, pause) as storm:
        reader = Reader(storm.path, values) if rng.random() < 0.5 else None
        try:
            if rng.random() < 0.3:
                storm.grow()
            for name in [kind.__name__, *rng.choice(OTHERS, rng.integers(0, 3))]:
                if reader is None:
                    storm.renew(file)
                storm.say(name)
                getattr(happenings, name)(storm)
            storm.complete(file)
        except AssertionError as problem:
            wrong.append(str(problem))
        finally:
            reads, seen = reader.stop() if reader else (0, "")
        tried["reads beside a writer"] += reads
    shutil.rmtree(folder, ignore_errors=True)
    wrong += [f"a reader saw {seen}"] if seen else []
    about = f"FIV_STORM='{kind.__name__} {seed}' repeats it; {points} points"
    print(about, *storm.said, sep="\n  ")
    return "\n  ".join([about, *storm.said, *wrong]) if wrong else ""


@pytest.mark.usefixtures("small_pieces", "scratch")
def test_whatever_happens_the_file_is_that_of_an_undisturbed_run(tmp_path, rng, tried, kinds):
    undisturbed, failures = Undisturbed(tmp_path), []
    if asked := os.environ.get("FIV_STORM"):
        name, seed = asked.split()
        wrong = storm_of(getattr(happenings, name), int(seed), undisturbed, tried)
        assert not wrong, wrong
        return
    until = time.monotonic() + 60.0 * float(os.environ.get("FIV_STORM_MINUTES", MINUTES))
    while time.monotonic() < until:
        for kind in rng.permutation(kinds):
            failures.append(storm_of(kind, int(rng.integers(2**32)), undisturbed, tried))
            tried["storms"] += 1
    told = [failure for failure in failures if failure]
    assert not told, "\n\n".join([f"{len(told)} of {len(failures)} storms:", *told])
    expected = ALWAYS + ["disks filled"] * (disk_full in kinds)
    assert not [what for what in expected if not tried[what]]
