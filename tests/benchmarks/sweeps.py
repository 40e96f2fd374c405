"""What the sweep engine costs, as sweeps/README.md quotes it: `python -m tests.benchmarks.sweeps [PART ...]`.

Parts: overhead, memory, size, client, cores, recorded, grid; by default all (20 minutes on two cores). Whatever is
compared is measured in turns in one run; figures are medians, ratios those of neighbours in time.
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

from sweeps import Axis, Grid, Sweep, Variable, open_results
from sweeps.plan import batches
from tests.benchmarks.stability import machine

# The transient sweep: so many scenes of so many simulated seconds.
SCENES, SECONDS = 2400, 1.0
# Recorded scenes, and of what.
RECORDED, SERIES = 320, ("velocity_B", "normal_force", "slip_velocity")
TURNS = 3


def double(points):
    return {"y": 2.0 * points["x"]}


def vector(points):
    return {"y": points["x"][:, None] * np.arange(1000.0)}


def trivial(count, wide):
    grid = Grid({"x": Axis(np.arange(float(count)))})
    if not wide:
        return Sweep("trivial", double, grid, {"y": Variable()})
    return Sweep("trivial", vector, grid, {"y": Variable(dims=("k",))}, coords={"k": Axis(np.arange(1000))})


def scenes(count, record=(), half=None):
    """A transient sweep of `count` different scenes, or of every other one of them."""
    from studies import registry

    speeds = np.linspace(1e-3, 5e-3, count // 4)[slice(half, None, None if half is None else 2)]
    given = {"V": speeds, "theta": [3.0, 5.0, 7.0, 9.0], "mu": 0.2, "F": 9.0, "duration": SECONDS}
    return registry.load("scenes").sweep(given, record=record, sample_rate=50e3 if record else None)


def plane(points):
    return {"y": 2.0 * points["x"] + points["z"]}


def command(part, *given):
    return [sys.executable, "-m", "tests.benchmarks.sweeps", f"_{part}", *map(str, given)]


def apart(part, *given):
    """What a part prints in a process of its own."""
    return subprocess.run(command(part, *given), stdout=subprocess.PIPE, text=True).stdout


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


def wait_for_the_other():
    print("ready", flush=True)
    sys.stdin.readline()


def numbers(told):
    return [float(each) for each in told.splitlines()[-1].split()]


def peak():
    """Most memory that this process has held, MB; `getrusage` goes on from that of the one which started it."""
    told = Path("/proc/self/status").read_text().partition("VmHWM:")[2]
    return int(told.split()[0]) / 1024


def overhead():
    """Microseconds a point of a function that does nothing, planned, run through Dask's threads, stored."""
    print(f"\n{'points':>9}  {'result':<16} {'us a point':>10}  {'all cached':>10}")
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
                    found.append((time.perf_counter() - begin) / count * 1e6)
        what = "vector of 1000" if wide else "scalar"
        # The first turn pays for imports.
        print(f"{count:>9}  {what:<16} {median(spent[1:]):>10.1f}  {median(resumed[1:]):>10.1f}")


def memory():
    """Peak memory, each in a process of its own, and the most that is on the disk."""
    print(f"\n{'what':<44} {'peak memory':>11}  {'most on disk':>12}  {'file':>8}  {'time':>7}")
    for what in ("million", "series"):
        print(apart("measured", what), end="")


def _measured(what):
    if what == "million":
        name, sweep = "1 000 000 points, one scalar each", trivial(1_000_000, False)
    else:
        name, sweep = "1000 scenes of 1 s, 3 series at 50 kHz", scenes(1000, SERIES)
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
        size = store.stat().st_size / 1e6
        print(f"{name:<44} {peak():>8.0f} MB  {max(most) / 1e6:>9.0f} MB  {size:>5.0f} MB  {spent:>5.1f} s")
        data.close()


def size(counts=(10**7, 10**8)):
    """Many points of a cheap function: a run that is killed half-way, and taken up by another process."""
    for count in counts:
        print(f"\n{count} points, a scalar each")
        with tempfile.TemporaryDirectory() as folder:
            for way in ("killed", "resumed"):
                print(apart("sized", way, count, folder), end="", flush=True)


def _sized(way, count, folder):
    axis, store = Axis(np.arange(float(round(int(count) ** 0.5)))), Path(folder) / "plane.nc"
    begin = time.perf_counter()
    plan = Sweep("plane", plane, Grid({"x": axis, "z": axis}), {"y": Variable()}).plan(store)
    print(f"planned in {time.perf_counter() - begin:.2f} s, {plan.todo} to do, peak {peak():.0f} MB", flush=True)

    def kill(snapshot):
        if way == "killed" and snapshot.done > int(count) // 2:
            os.kill(os.getpid(), signal.SIGKILL)

    begin = time.perf_counter()
    plan.run(progress=kill)
    spent, begin = time.perf_counter() - begin, time.perf_counter()
    data = open_results(store)
    opened = time.perf_counter() - begin
    assert not data["y"].variable._in_memory
    print(f"run in {spent:.1f} s, opened in {1e3 * opened:.0f} ms, peak {peak():.0f} MB, ", end="")
    print(f"file {store.stat().st_size / 1e6:.0f} MB")


def _workers():
    import distributed

    with distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()


def client():
    """Processor time that a batch costs whoever hands it out, on a cluster of two processes."""
    batches.BATCH_BYTES = 24.0
    spent = []
    cluster = subprocess.Popen(command("workers"), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    address = cluster.stdout.readline().strip()
    with tempfile.TemporaryDirectory() as folder:
        for count in (100, 200, 1200):
            plan = trivial(count, False).plan(Path(folder) / f"{count}.nc")
            begin = time.process_time()
            plan.run(address)
            spent.append(time.process_time() - begin)
    cluster.communicate()
    print(f"\n{spent[2] - spent[1]:.2f} ms a batch")


def cores():
    """A transient sweep on two cores, against two independent copies of the same work."""
    rates = {"copies": [], "threads": [], "processes": [], "processes, whole": []}
    print(f"\n{SCENES} scenes of {SECONDS:g} s; scenes a second on two cores, {TURNS} turns")
    for _ in range(TURNS):
        rates["copies"].append(SCENES / np.max(at_once("copy")))
        rates["threads"].append(numbers(apart("engine", "threads"))[1])
        for name, rate in zip(
            ("processes", "processes, whole"), numbers(apart("engine", "processes")), strict=True
        ):
            rates[name].append(rate)
    for name, values in rates.items():
        ratio = np.median(np.divide(values, rates["copies"]))
        print(f"{name:<18} {median(values):>7.2f}  {ratio:>6.3f} of two copies")


def _copy(half):
    """Seconds of a process that knows nothing of the other or of sweeps."""
    from fivcore import Scene, simulate_many

    points = scenes(SCENES).grid.points()
    every = [Scene(*(float(points[name][j]) for name in ("V", "theta", "mu", "F"))) for j in range(SCENES)]
    # As a sweep orders them: by what shares a basis.
    every.sort(key=lambda scene: scene.theta)
    simulate_many(every[:1], 0.1)
    wait_for_the_other()
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


def recorded():
    """Recorded scenes in one run on two threads, against two processes that run half of them each."""
    rates = {"halves": [], "threads": []}
    print(f"\n{RECORDED} recorded scenes of {SECONDS:g} s; scenes a second on two cores: computed, and in all")
    for _ in range(TURNS):
        # Twice the rate of the slower half.
        rates["halves"].append(np.min(at_once("recorded"), axis=0) * 2.0)
        rates["threads"].append(numbers(apart("recorded")))
    for name, values in rates.items():
        ratios = np.median(np.divide(values, rates["halves"]), axis=0)
        print(f"{name:<8} {np.median(values, axis=0).round(1)}  {ratios.round(3)} of two halves")


def _recorded(half=None):
    """Scenes a second until the last one was computed, and until the file was written."""
    with tempfile.TemporaryDirectory() as folder:
        scenes(4, SERIES).plan(Path(folder) / "first.nc").run("sync")  # what compiles
        plan = scenes(RECORDED, SERIES, None if half is None else int(half)).plan(Path(folder) / "scenes.nc")
        if half is not None:
            wait_for_the_other()
        ends, begin = [], time.perf_counter()
        plan.run("threads", 2 if half is None else 1, lambda snapshot: ends.append(time.perf_counter())).close()
        print(plan.todo / (ends[-1] - begin), plan.todo / (time.perf_counter() - begin))


def grid():
    """The 4-D grid whose V and F grow by the same ratio."""
    from studies import registry

    given = {
        "V": np.geomspace(1e-3, 1e-3 * 1.3**9, 10),
        "theta": np.linspace(-10.0, 20.0, 13),
        "mu": np.linspace(0.05, 0.35, 11),
        "F": np.geomspace(9.0, 9.0 * 1.3**9, 10),
        "duration": 0.1,
    }
    begin = time.perf_counter()
    plan = registry.load("scenes").sweep(given).plan()
    print(f"\n{plan.points} points are {plan.distinct} scenes; planned in {time.perf_counter() - begin:.2f} s")


def main():
    parts = sys.argv[1:] or ["overhead", "memory", "size", "client", "cores", "recorded", "grid"]
    if parts[0].startswith("_"):
        globals()[parts[0]](*parts[1:])
        return
    print(machine().removesuffix(", one core used"))
    for part in parts:
        globals()[part]()


if __name__ == "__main__":
    main()
