"""What the sweep engine costs, as the README quotes it: `python -m tests.benchmarks.sweeps [PART ...]`.

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

from tests.benchmarks.stability import machine

# The transient sweep: so many scenes of so many simulated seconds.
SCENES, SECONDS = 2400, 1.0
# Recorded scenes.
RECORDED = 320
TURNS = 3


def double(points):
    return {"y": 2.0 * points["x"]}


def vector(points):
    return {"y": points["x"][:, None] * np.arange(1000.0)}


def trivial(count, wide):
    from sweeps import Axis, Grid, Sweep, Variable

    grid = Grid({"x": Axis(np.arange(float(count)))})
    if not wide:
        return Sweep("trivial", double, grid, {"y": Variable()})
    return Sweep("trivial", vector, grid, {"y": Variable(dims=("k",))}, coords={"k": Axis(np.arange(1000))})


def scenes(count, record=(), given=None):
    """A transient sweep of `count` different scenes."""
    from studies import registry

    given = given or {"V": np.linspace(1e-3, 5e-3, count // 4), "theta": [3.0, 5.0, 7.0, 9.0]}
    given = given | {"mu": 0.2, "F": 9.0, "duration": SECONDS}
    rate = 50e3 if record else None
    return registry.load("scenes").sweep(given, record=record, sample_rate=rate)


def _apart(part):
    """What a part prints in a process of its own."""
    command = [sys.executable, "-m", "tests.benchmarks.sweeps", f"_{part}"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def overhead():
    """Microseconds a point of a function that does nothing, planned, run through Dask's threads, stored."""
    print(f"\n{'points':>9}  {'result':<16} {'us a point':>10}  {'all cached':>10}")
    for count, wide in ((10_000, False), (100_000, False), (10_000, True), (100_000, True)):
        spent, resumed = [], []
        # The first round pays for imports.
        for turn in range(6 if count == 10_000 else 4):
            with tempfile.TemporaryDirectory() as folder:
                sweep, store = trivial(count, wide), Path(folder) / "trivial.nc"
                begin = time.perf_counter()
                plan = sweep.plan(store)
                plan.run()
                middle = time.perf_counter()
                again = trivial(count, wide).plan(store)
                assert again.todo == 0
                again.run()
                if turn:
                    spent.append((middle - begin) / count * 1e6)
                    resumed.append((time.perf_counter() - middle) / count * 1e6)
        what = "vector of 1000" if wide else "scalar"
        print(f"{count:>9}  {what:<16} {median(spent):>10.1f}  {median(resumed):>10.1f}")


def memory():
    """Peak memory, each in a process of its own, and the most that is on the disk."""
    print(f"\n{'what':<44} {'peak memory':>11}  {'most on disk':>12}  {'file':>8}  {'time':>7}")
    for what in ("million", "recorded"):
        told = subprocess.run(
            [sys.executable, "-m", "tests.benchmarks.sweeps", f"_{what}"],
            capture_output=True,
            text=True,
            check=True,
        )
        print(told.stdout, end="")


def _measured(what, sweep):
    with tempfile.TemporaryDirectory() as folder:
        store, most, stop = Path(folder) / "sweep.nc", [0], threading.Event()

        def watch():
            while not stop.wait(0.1):
                files = [path for path in Path(folder).rglob("*") if path.is_file()]
                sizes = []
                for path in files:
                    try:
                        sizes.append(path.stat().st_size)
                    except OSError:  # gone meanwhile
                        continue
                most[0] = max(most[0], sum(sizes))

        watcher = threading.Thread(target=watch)
        watcher.start()
        begin = time.perf_counter()
        data = sweep.plan(store).run()
        spent = time.perf_counter() - begin
        stop.set()
        watcher.join()
        assert np.all(data["status"] == 1)
        peak = _peak()
        size = store.stat().st_size / 1e6
        print(f"{what:<44} {peak:>8.0f} MB  {most[0] / 1e6:>9.0f} MB  {size:>5.0f} MB  {spent:>5.1f} s")
        data.close()


def _peak():
    """Most memory that this process has held, MB."""
    # The system's usual figure goes on from that of the program which started this one.
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    raise OSError("this system does not tell the most memory that a program has held")


def plane(points):
    return {"y": 2.0 * points["x"] + points["z"]}


def size(counts=(10**7, 10**8)):
    """Many points of a cheap function: a run that is killed half-way, and taken up by another process."""
    for count in counts:
        with tempfile.TemporaryDirectory() as folder:
            print(f"\n{count} points, a scalar each")
            for way in ("_killed", "_resumed"):
                command = [sys.executable, "-m", "tests.benchmarks.sweeps", way, str(count), folder]
                print(subprocess.run(command, capture_output=True, text=True).stdout, end="", flush=True)


def _sized(way, count, folder):
    from sweeps import Axis, Grid, Sweep, Variable, open_results

    axis, store = Axis(np.arange(float(round(count**0.5)))), Path(folder) / "plane.nc"
    sweep = Sweep("plane", plane, Grid({"x": axis, "z": axis}), {"y": Variable()})
    begin = time.perf_counter()
    plan = sweep.plan(store)
    print(f"planned in {time.perf_counter() - begin:.2f} s, {plan.todo} to do, peak {_peak():.0f} MB", flush=True)

    def kill(snapshot):
        if way == "_killed" and snapshot.done > count // 2:
            os.kill(os.getpid(), signal.SIGKILL)

    begin = time.perf_counter()
    plan.run(progress=kill)
    spent, begin = time.perf_counter() - begin, time.perf_counter()
    data = open_results(store)
    opened = time.perf_counter() - begin
    assert not data["y"].variable._in_memory
    print(f"run in {spent:.1f} s, opened in {1e3 * opened:.0f} ms, peak {_peak():.0f} MB, ", end="")
    print(f"file {store.stat().st_size / 1e6:.0f} MB")


CLUSTER = """
import time, distributed
if __name__ == "__main__":
    print(distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None).scheduler_address, flush=True)
    time.sleep(1000)
"""


def client():
    """Processor time that a batch costs whoever hands it out, on a cluster of two processes."""
    from sweeps.plan import batches

    batches.BATCH_BYTES = 24.0
    spent = []
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "cluster.py"
        program.write_text(CLUSTER)
        command = [sys.executable, str(program)]
        cluster = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
        try:
            address = cluster.stdout.readline().strip()
            for count in (100, 200, 1200):
                plan = trivial(count, False).plan(Path(folder) / f"{count}.nc")
                begin = time.process_time()
                plan.run(address)
                spent.append(time.process_time() - begin)
        finally:
            os.killpg(cluster.pid, signal.SIGKILL)
    print(f"\n{spent[2] - spent[1]:.2f} ms a batch")


def cores():
    """A transient sweep on two cores, against two independent copies of the same work."""
    rates = {"copies": [], "threads": [], "processes": [], "processes, whole": []}
    print(f"\n{SCENES} scenes of {SECONDS:g} s; scenes a second on two cores, {TURNS} turns")
    for _ in range(TURNS):
        rates["copies"].append(_copies())
        for scheduler in ("threads", "processes"):
            told = _apart(scheduler).split()
            rates[scheduler].append(float(told[0]))
            if scheduler == "processes":
                rates["processes, whole"].append(float(told[1]))
    for name, values in rates.items():
        ratio = median(v / c for v, c in zip(values, rates["copies"], strict=True))
        print(f"{name:<18} {median(values):>7.2f}  {ratio:>6.3f} of two copies")


def _copies():
    """Scenes a second of two processes that know nothing of each other or of sweeps."""
    return SCENES / max(float(told) for told in _at_once("_copy"))


def _at_once(part):
    """What a part prints in two processes of its own that begin together."""
    begun = [
        subprocess.Popen(
            [sys.executable, "-m", "tests.benchmarks.sweeps", part, str(k)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for k in range(2)
    ]
    for each in begun:
        assert each.stdout.readline() == "ready\n"
    for each in begun:
        each.stdin.write("go\n")
        each.stdin.flush()
    return [each.communicate()[0] for each in begun]


def _copy(k):
    from fivcore import Scene, simulate_many

    points = scenes(SCENES).grid.points()
    every = [Scene(*(float(points[name][j]) for name in ("V", "theta", "mu", "F"))) for j in range(SCENES)]
    # As a sweep orders them: by what shares a basis.
    every.sort(key=lambda scene: scene.theta)
    simulate_many(every[:1], 0.1)
    print("ready", flush=True)
    sys.stdin.readline()
    begin = time.perf_counter()
    simulate_many(every[k::2], SECONDS)
    print(time.perf_counter() - begin)


def _engine(scheduler):
    """Scenes a second while batches are done, and over the whole run, start of the cluster included."""
    ends = []
    with tempfile.TemporaryDirectory() as folder:
        plan = scenes(SCENES).plan(Path(folder) / "scenes.nc")
        begin = time.perf_counter()
        plan.run(scheduler, 2, lambda snapshot: ends.append((time.perf_counter(), snapshot.done)))
        whole = SCENES / (time.perf_counter() - begin)
    if scheduler == "threads":
        print(whole, whole)
        return
    # From the first batch that ended to the last: the cluster has started then.
    first = next(k for k, (_, done) in enumerate(ends) if done)
    (t0, d0), (t1, d1) = ends[first], ends[-1]
    print((d1 - d0) / (t1 - t0), whole)


def recorded():
    """Recorded scenes in one run on two threads, against two processes that run half of them each."""
    rates = {"halves": [], "threads": []}
    print(f"\n{RECORDED} recorded scenes of {SECONDS:g} s; scenes a second on two cores: computed, and in all")
    for _ in range(TURNS):
        # Twice the rate of the slower half.
        rates["halves"].append(np.min([_rates(told) for told in _at_once("_recorded_half")], axis=0) * 2.0)
        rates["threads"].append(_rates(_apart("recorded_threads")))
    for name, values in rates.items():
        ratios = np.median(np.divide(values, rates["halves"]), axis=0)
        print(f"{name:<8} {np.median(values, axis=0).round(1)}  {ratios.round(3)} of two halves")


def _rates(told):
    return [float(each) for each in told.split()[-2:]]


def _recorded_run(half=None):
    """Scenes a second until the last one was computed, and until the file was written."""
    series = ("velocity_B", "normal_force", "slip_velocity")
    with tempfile.TemporaryDirectory() as folder:
        scenes(4, series).plan(Path(folder) / "first.nc").run("sync")  # what compiles
        plan = scenes(RECORDED, series).plan(Path(folder) / "scenes.nc")
        if half is not None:
            given = {"V": np.linspace(1e-3, 5e-3, RECORDED // 4)[half::2], "theta": [3.0, 5.0, 7.0, 9.0]}
            plan = scenes(RECORDED, series, given).plan(Path(folder) / "scenes.nc")
            print("ready", flush=True)
            sys.stdin.readline()
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
    if parts[0] == "_million":
        _measured("1 000 000 points, one scalar each", trivial(1_000_000, False))
    elif parts[0] == "_recorded":
        _measured(
            "1000 scenes of 1 s, 3 series at 50 kHz", scenes(1000, ("velocity_B", "normal_force", "slip_velocity"))
        )
    elif parts[0] in ("_killed", "_resumed"):
        _sized(parts[0], int(parts[1]), parts[2])
    elif parts[0] == "_copy":
        _copy(int(parts[1]))
    elif parts[0] == "_recorded_threads":
        _recorded_run()
    elif parts[0] == "_recorded_half":
        _recorded_run(int(parts[1]))
    elif parts[0] in ("_threads", "_processes"):
        _engine(parts[0][1:])
    else:
        print(machine().removesuffix(", one core used"))
        for part in parts:
            globals()[part]()


if __name__ == "__main__":
    main()
