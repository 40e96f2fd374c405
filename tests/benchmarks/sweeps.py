"""What the sweep engine costs: twenty minutes on two cores.

Whatever is compared is measured in turns in one run; figures are medians, ratios those of neighbours in time.
`python -m tests.benchmarks.sweeps _NAME` is what is done in a process of its own.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from statistics import median

import numpy as np

from studies.asking.sweep import sweep_of
from sweeps import Axis, Grid, Sweep, Variable, open_results
from sweeps.plan import batches
from tests.benchmarks.strangers import strangers
from tests.benchmarks.tables import Column, Table

# The transient sweep: so many scenes of so many simulated seconds.
SCENES, SECONDS = 2400, 1.0
# What recorded scenes record.
SERIES = ("velocity_B", "normal_force", "slip_velocity")
TURNS = 3
CORES = (
    "two independent processes of `simulate_many`",
    "a sweep on two threads",
    "a sweep on two processes, once they have started",
    "a sweep on two processes, with their start",
)


def double(points):
    return {"y": 2.0 * points["x"]}


def vector(points):
    return {"y": points["x"][:, None] * np.arange(1000.0)}


def trivial(count, wide):
    grid = Grid({"x": Axis(np.arange(float(count)))})
    if not wide:
        return Sweep("trivial", double, grid, {"y": Variable()})
    return Sweep("trivial", vector, grid, {"y": Variable(dims=("k",))}, coords={"k": Axis(np.arange(1000))})


def scenes(count, record=()):
    """A transient sweep of `count` different scenes."""
    from studies import registry

    given = {"V": np.linspace(1e-3, 5e-3, count // 4), "theta": [3.0, 5.0, 7.0, 9.0], "mu": 0.2, "F": 9.0}
    given["duration"] = SECONDS
    return sweep_of(registry.load("scenes"), given, record=record, sample_rate=50e3 if record else None)


def plane(points):
    return {"y": 2.0 * points["x"] + points["z"]}


def command(part, *given):
    return [sys.executable, "-m", "tests.benchmarks.sweeps", f"_{part}", *map(str, given)]


def apart(part, *given):
    """What a part prints in a process of its own."""
    done = subprocess.run(command(part, *given), stdout=subprocess.PIPE, text=True)
    assert done.returncode in (0, -signal.SIGKILL)  # half-way one kills itself
    return done.stdout


def at_once(part):
    """The last line that a part prints in each of two processes of its own that begin together, as numbers."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    begun = [subprocess.Popen(command(part, half), **pipes) for half in range(2)]
    for each in begun:
        assert each.stdout.readline() == "ready\n"
    for each in begun:
        each.stdin.write("go\n")
        each.stdin.flush()
    return [numbers(each.communicate()[0]) for each in begun]


def numbers(told):
    return [float(each) for each in told.splitlines()[-1].split()]


def peak():
    """Most bytes that this process has held; `getrusage` goes on from those of the one which started it."""
    told = Path("/proc/self/status").read_text(encoding="utf-8").partition("VmHWM:")[2]
    return 1024.0 * int(told.split()[0])


def overhead():
    """A function that does nothing: planned, run on threads, stored; and again, when every point is cached."""
    rows = []
    for count, wide in ((10_000, False), (100_000, False), (10_000, True), (100_000, True)):
        spent, resumed = [], []
        for _ in range(6 if count == 10_000 else 4):
            with tempfile.TemporaryDirectory() as folder:
                store = Path(folder) / "trivial.nc"
                for found in (spent, resumed):
                    begin = time.perf_counter()
                    plan = trivial(count, wide).plan(store)
                    assert plan.todo == (count if found is spent else 0)
                    plan.run()
                    found.append((time.perf_counter() - begin) / count)
        # The first turn pays for imports.
        rows.append([count, "vector of 1000" if wide else "scalar", median(spent[1:]), median(resumed[1:])])
    heads = (Column("a point", "s"), Column("all cached, a point", "s"))
    return Table([Column("points"), Column("result"), *heads], rows)


def memory():
    """Each in a process of its own."""
    names = {
        "million": "1 000 000 points, a scalar each",
        "series": "1000 recorded scenes of 1 s, three series at 50 kHz",
    }
    rows = [[name, *numbers(apart("measured", what))] for what, name in names.items()]
    heads = (Column(each, "B") for each in ("peak memory", "most on disk", "file"))
    return Table([Column("what"), *heads, Column("time", "s")], rows)


def _measured(what):
    sweep = trivial(1_000_000, False) if what == "million" else scenes(1000, SERIES)
    with tempfile.TemporaryDirectory() as folder:
        store, most, stop = Path(folder) / "sweep.nc", [0], threading.Event()

        def watch():
            while not stop.wait(0.1):
                listed = subprocess.run(["du", "-sb", folder], capture_output=True, text=True).stdout
                most.append(int(listed.split()[0]))

        watcher = threading.Thread(target=watch)
        watcher.start()
        begin = time.perf_counter()
        data = sweep.plan(store).run()
        spent = time.perf_counter() - begin
        stop.set()
        watcher.join()
        assert np.all(data["status"] == 1)
        print(peak(), max(most), store.stat().st_size, spent)
        data.close()


def size(counts=(10**6, 10**7)):
    """Many points of a cheap function: a run that is killed half-way and resumed by another process.

    A plan of 1e7 points takes less than 10 s, and each run less than 2 GB.
    """
    rows = []
    for count in counts:
        with tempfile.TemporaryDirectory() as folder:
            for way in ("killed", "resumed"):
                found = numbers(apart("sized", way, count, folder))
                assert found[0] < 10.0
                assert found[1] < 2e9
                rows.append([count, way, *found, *[None] * (5 - len(found))])
    heads = (Column(each, unit) for each, unit in (("planned", "s"), ("peak memory", "B"), ("run", "s")))
    later = (Column("opened", "s"), Column("file", "B"))
    return Table([Column("points"), Column("half-way, then"), *heads, *later], rows)


def _sized(way, count, folder):
    axis, store = Axis(np.arange(float(round(int(count) ** 0.5)))), Path(folder) / "plane.nc"
    begin = time.perf_counter()
    plan = Sweep("plane", plane, {"x": axis, "z": axis}, ["y"]).plan(store)
    planned = time.perf_counter() - begin
    assert (plan.cached > 0) == (way == "resumed")
    print(planned, peak(), flush=True)

    def kill(snapshot):
        if way == "killed" and snapshot.done > int(count) // 2:
            os.kill(os.getpid(), signal.SIGKILL)

    begin = time.perf_counter()
    plan.run(progress=kill)
    spent, begin = time.perf_counter() - begin, time.perf_counter()
    data = open_results(store)
    opened = time.perf_counter() - begin
    assert int(count) < 10**7 or not data["y"].variable._in_memory
    print(planned, peak(), spent, opened, store.stat().st_size)


def _workers():
    import distributed

    with distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()


def growth():
    """A file of 640 MB from nothing, and 4 MB added to it."""
    spent = []
    with tempfile.TemporaryDirectory() as folder:
        for count in (80_000, 80_500):
            begin = time.perf_counter()
            plan = trivial(count, True).plan(Path(folder) / "vector.nc")
            plan.run().close()
            spent.append(time.perf_counter() - begin)
    rows = [["640 MB from nothing", spent[0]], ["4 MB more", spent[1]]]
    return Table([Column("what"), Column("time", "s")], rows)


def client():
    """What a batch costs the client of a cluster of two processes, and how many batches it completes."""
    batches.BATCH_BYTES = 24.0
    spent = []
    cluster = subprocess.Popen(command("workers"), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    address = cluster.stdout.readline().strip()
    with tempfile.TemporaryDirectory() as folder:
        for count in (100, 200, 1200):
            plan = trivial(count, False).plan(Path(folder) / f"{count}.nc")
            begin = time.process_time(), time.perf_counter()
            plan.run(address)
            spent.append((time.process_time() - begin[0], time.perf_counter() - begin[1]))
    cluster.communicate()
    processor, wall = np.subtract(spent[2], spent[1]) / 1000.0
    heads = (Column("what"), Column("CPU time of the client", "s"), Column("batches a second"))
    return Table([*heads], [["a batch of one point on a cluster", float(processor), float(1.0 / wall)]])


def cores():
    """A transient sweep on two cores, against two independent copies of the same work."""
    rates = {each: [] for each in CORES}
    copies, threads, started, whole = rates.values()
    for _ in range(TURNS):
        copies.append(float(SCENES / np.max(at_once("copy"))))
        threads.append(numbers(apart("engine", "threads"))[1])
        for found, rate in zip((started, whole), numbers(apart("engine", "processes")), strict=True):
            found.append(rate)
    rows = [[name, median(values), float(np.median(np.divide(values, copies)))] for name, values in rates.items()]
    heads = (Column("scenes a second"), Column("of the first"))
    return Table([Column(f"{SCENES} scenes of {SECONDS:g} s on two cores"), *heads], rows)


def _copy(half):
    """Seconds of a process that knows nothing of the other or of sweeps."""
    from fivcore import Scene, simulate_many

    points = scenes(SCENES).grid.points()
    every = [Scene(*(float(points[name][j]) for name in ("V", "theta", "mu", "F"))) for j in range(SCENES)]
    # As a sweep orders them: by what shares a basis.
    every.sort(key=lambda scene: scene.theta)
    simulate_many(every[:1], 0.1)
    print("ready", flush=True)
    sys.stdin.readline()  # the other is ready, too
    begin = time.perf_counter()
    simulate_many(every[int(half) :: 2], SECONDS)
    print(time.perf_counter() - begin)


def _engine(scheduler):
    """Scenes a second while batches are done, and over the whole run, start of the cluster included."""
    ends = []
    with tempfile.TemporaryDirectory() as folder:
        plan = scenes(SCENES).plan(Path(folder) / "scenes.nc")
        begin = time.perf_counter()
        plan.run(scheduler, 2, lambda snapshot: ends.append((time.perf_counter(), snapshot.done)))
        whole = SCENES / (time.perf_counter() - begin)
    # From the first batch that ended to the last: the cluster has started then.
    (t0, d0), (t1, d1) = next(each for each in ends if each[1]), ends[-1]
    print((d1 - d0) / (t1 - t0), whole)


TABLES = {each.__name__: each for each in (overhead, memory, size, growth, client, cores, strangers)}

if __name__ == "__main__":
    globals()[sys.argv[1]](*sys.argv[2:])
