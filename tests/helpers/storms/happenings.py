"""What may happen to a sweep in a storm: each ends when the run that it happened to has."""

import errno
import os
import re
import signal
import subprocess
import time
from contextlib import suppress

import numpy as np

from tests.helpers.processes.sweep_programs import end
from tests.helpers.storms.clusters import altered_home, send, workers_of
from tests.helpers.storms.faults import mount

FULL = r"StoreError: \S+ could not be written: .*; (.* kept|nothing was finished)"
CHANGED = r"StoreError: \S+ has changed (since|while) this was planned; plan again$"
VERSION = (
    r"InputError: \S+ not all points are computed in one environment|SchedulerError: a worker joined whose env"
)
TAKEN = r"LockedError: \S+ is being written by (another run|process \d+ on \S+, begun [^;]+); wait for it, or"


def killed(storm):
    process = storm.start()
    storm.wait_a_moment(process)
    send(process.pid, signal.SIGKILL)
    storm.over(process, -signal.SIGKILL, 0)
    storm.tried["runs killed"] += storm.codes[-1] == -signal.SIGKILL
    storm.check_kept()


def stopped(storm):
    """Whoever stands still keeps the store."""
    process = storm.start()
    storm.wait_a_moment(process)
    send(process.pid, signal.SIGSTOP)
    time.sleep(0.05)
    held = storm.store.is_locked()
    try:
        if storm.rng.random() < 0.6:
            line = storm.over(storm.one_more("sync"), 3 if held else 0)
            if held:
                one_line(line, TAKEN)
                storm.tried["runs refused while another stands still"] += 1
        time.sleep(storm.rng.uniform(0.1, 2.0))
    finally:
        send(process.pid, signal.SIGCONT)
    # Whoever stood still before he had the store finds it finished by the other.
    line = storm.over(process, 0) if held else storm.over(process, 0, 3)
    if line != "done":
        one_line(line, CHANGED)
    storm.tried["runs stopped and continued"] += 1
    storm.check_kept()


def worker_killed(storm):
    """One of the run's own."""
    process = storm.start("processes")
    if worker := one_of_its_workers(storm, process):
        send(worker, signal.SIGKILL)
        storm.tried["workers killed"] += 1
    storm.over(process, 0)
    storm.check_kept()


def worker_stopped(storm):
    process = storm.start("processes")
    if worker := one_of_its_workers(storm, process):
        send(worker, signal.SIGSTOP)
        time.sleep(storm.rng.uniform(0.1, 2.0))
        send(worker, signal.SIGCONT)
        storm.tried["workers stopped and continued"] += 1
    storm.over(process, 0)
    storm.check_kept()


def one_of_its_workers(storm, process):
    """A worker in the middle of the run; None where it has ended."""
    storm.wait_a_moment(process, least=1)
    found = workers_of(process.pid)
    return int(storm.rng.choice(found)) if found else None


def interrupted(storm, times=1):
    process = storm.start()
    storm.wait_a_moment(process)
    for _ in range(times):
        with suppress(ProcessLookupError):
            (os.killpg if storm.rng.random() < 0.5 else os.kill)(process.pid, signal.SIGINT)
        time.sleep(storm.rng.uniform(0.0, 0.1))
    # `python -m` ends itself by the signal where that met an `exec` of a text, as of a named tuple's class.
    storm.over(process, 130, -signal.SIGINT, 0)
    storm.tried[f"runs interrupted {'once' if times == 1 else 'twice'}"] += storm.codes[-1] != 0
    storm.check_kept()
    if times == 1:
        assert set(storm.logged()) <= storm.finished(), "what was begun is not kept"


def interrupted_twice(storm):
    interrupted(storm, 2)


def disk_full(storm):
    """A disk of some pages, which gets more later."""
    mount(storm.path.parent, 4 * int(storm.rng.integers(2, 40)))
    storm.afterwards.callback(subprocess.run, ["umount", "-l", storm.path.parent], check=True)
    fails_to_write(storm, "disks filled")
    mount(storm.path.parent, 1 << 14, "remount,")


def fails_to_write(storm, what, **told):
    line = storm.run(0, 3, **told)
    if line != "done":
        one_line(line, FULL)
        assert ("nothing was finished" in line) == (not storm.finished()), line
        storm.tried[what] += 1


def disk_refuses(storm):
    """Steps on the disk that fail, from one to another."""
    first = int(storm.rng.integers(1, 4 * storm.points))
    last = first + int(storm.rng.choice([0, 3, 10**6]))
    code = int(storm.rng.choice([errno.ENOSPC, errno.EIO, errno.EDQUOT]))
    scheduler = str(storm.rng.choice(["sync", "threads"]))
    fails_to_write(storm, "disks that refuse", scheduler=scheduler, refused=[first, last, code])


def files_may_not_grow(storm):
    size = int(np.exp(storm.rng.uniform(np.log(100), np.log(30_000))))
    fails_to_write(storm, "files that may not grow", scheduler="threads", file_size=size)


def scheduler_killed(storm):
    cluster = storm.cluster()
    process = storm.start(cluster.address)
    storm.wait_a_moment(process, least=1)
    end(cluster.scheduler)
    line = storm.over(process, 3, 0)
    if line != "done":
        one_line(line, "ClusterLostError: the scheduler does not answer any more$")
    storm.tried["schedulers killed"] += 1
    storm.leave_cluster()
    storm.check_kept()


def workers_of_a_cluster_killed(storm):
    """All of them at once; sometimes somebody starts another."""
    cluster = storm.cluster()
    there = [*cluster.workers]
    another = cluster.summon() if storm.rng.random() < 0.4 else None
    process = storm.start(cluster.address, bereft=10.0 if another else 3.0)
    storm.wait_a_moment(process, least=1)
    for worker in there:
        end(worker)
    if another:
        time.sleep(storm.rng.uniform(0.0, 1.0))
        another()
    line = storm.over(process, *([0] if another else [0, 3]))
    if line != "done":
        one_line(line, "ClusterLostError: the cluster has no workers left$")
    storm.tried["clusters whose workers were killed"] += 1
    storm.leave_cluster()
    storm.check_kept()


def other_version(storm):
    """Of a library, at the beginning or later, for who is strict or not."""
    cluster, strict, late = storm.cluster(), storm.rng.random() < 0.4, storm.rng.random() < 0.5
    join = cluster.summon(numpy="9.9")
    if not late:
        join()
    process = storm.start(cluster.address, strict=strict)
    if late:
        storm.wait_a_moment(process, least=1)
        join()
    line = storm.over(process, 0, 2) if strict else storm.over(process, 0)
    if strict and line != "done":
        one_line(line, VERSION)
    elif "MixedWarning: " in line:
        storm.mixed = True
        assert "numpy" in line, line
    storm.tried["workers of another version"] += 1
    storm.leave_cluster()
    storm.check_kept()


def other_code(storm):
    """Of the function, at the beginning or later: nothing of it is kept."""
    home = altered_home(storm.folder / "altered")
    cluster, late = storm.cluster(), storm.rng.random() < 0.5
    join = cluster.summon(home)
    if not late:
        join()
    process = storm.start(cluster.address)
    if late:
        storm.wait_a_moment(process, least=1)
        join()
    line = storm.over(process, 0, 2)
    if line != "done":
        one_line(line, "SchedulerError: the workers cannot compute this: InputError: this worker has another")
    storm.tried["workers of another code"] += 1
    storm.leave_cluster()
    storm.check_kept()


def clock_set_back(storm):
    """In the middle of a sweep, when its files are of the future, or of long ago."""
    killed(storm)
    then = time.time() + float(storm.rng.choice([1e9, 1e5, -1e9]))
    for path in [*storm.path.parent.rglob("*"), storm.path.parent]:
        os.utime(path, (then, then))
    shift = float(storm.rng.choice([-1e9, -1e5, -10.0, 1e8]))
    process = storm.start(str(storm.rng.choice(["sync", "threads"])), clock=shift)
    if storm.rng.random() < 0.5:
        storm.wait_a_moment(process)
        send(process.pid, signal.SIGKILL)
    storm.over(process, 0, -signal.SIGKILL)
    storm.tried["clocks set back"] += 1
    storm.check_kept()


def raced(storm):
    """Ten runs at once: each point is computed once, and whoever does not compute is told why."""
    first = storm.start("threads")
    runs = [first, *(storm.one_more(str(storm.rng.choice(["sync", "threads"]))) for _ in range(9))]
    lines = [storm.over(run, 0, 3) for run in runs]
    assert "done" in lines
    for line in lines:
        one_line(line, f"done|{TAKEN}|{CHANGED}")
    assert len(storm.logged()) == len(set(storm.logged())), "points were computed twice"
    storm.tried["racing runs"] += len(runs)
    storm.tried["racing runs refused"] += len(runs) - lines.count("done")
    storm.check_kept()


def one_line(line, words):
    """A refusal as documented."""
    assert re.match(words, line), f"{line!r} is not {words!r}"
    assert len(line.splitlines()) == 1, line


KINDS = [killed, stopped, worker_killed, worker_stopped, interrupted, interrupted_twice]
KINDS += [disk_full, disk_refuses, files_may_not_grow]
KINDS += [scheduler_killed, workers_of_a_cluster_killed, other_version, other_code, clock_set_back, raced]
