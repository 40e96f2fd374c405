"""The same points of a trivial function of two numbers by this engine, by xyzpy, and by Dask and xarray alone.

`python -m tests.benchmarks.strangers TOOL FOLDER COUNT` computes COUNT x COUNT points of `law` in FOLDER/law.py,
stores them in FOLDER, and prints how many seconds it took, and the last value.
"""

import inspect
import os
import subprocess
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path

import numpy as np

from tests.benchmarks.tables import Column, Table

# Points along each axis where time is measured, and where a run is disturbed.
TIMED, DISTURBED = 100, 20
LAW = "def law(x, z):\n    return {factor} * x * z\n"
# The function with a log of its calls, 5 ms each, and a point that fails until there is a file `mended`.
LOGGED = """import os, time
def law(x, z):
    with open(os.path.join(os.path.dirname(__file__), "calls"), "ab") as file:
        file.write(b".")
    time.sleep(0.005)
    if x == z == {fails} and not os.path.exists(os.path.join(os.path.dirname(__file__), "mended")):
        raise ValueError("not this one")
    return x * z
"""


def by_sweeps(law, values, folder):
    from sweeps import Sweep, pointwise

    sweep = Sweep("law", pointwise(law), {"x": values, "z": values}, ["y"])
    return sweep.plan(folder / "law.nc").run()["y"]


def by_xyzpy(law, values, folder):
    from xyzpy import Harvester, Runner

    harvester = Harvester(Runner(law, "y"), str(folder / "law.h5"))
    harvester.harvest_combos({"x": values, "z": values}, missing_only=True, verbosity=0)
    return harvester.full_ds["y"]


def by_dask(law, values, folder):
    import dask
    import xarray as xr

    def block(x):
        file = folder / f"{x}.nc"
        if not file.exists():
            rows = [[law(x, z) for z in values]]
            xr.Dataset({"y": (("x", "z"), rows)}, {"x": [x], "z": values}).to_netcdf(folder / f"{x}.new")
            os.replace(folder / f"{x}.new", file)
        return file

    files = dask.compute(*(dask.delayed(block)(x) for x in values), scheduler="sync")  # netCDF crashes in threads
    return xr.open_mfdataset(files)["y"]


TOOLS = {"sweeps": by_sweeps, "xyzpy": by_xyzpy, "dask.delayed and xarray": by_dask}


def outcome(tool, folder, law, count=DISTURBED, most=10**9):
    """Seconds and last value of a run, nothing if it fails; and its calls. It is killed after `most` of them."""
    (folder / "law.py").write_text(law)
    (folder / "calls").write_bytes(b"")
    command = [sys.executable, "-m", "tests.benchmarks.strangers", tool, str(folder), str(count)]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    while running.poll() is None and (folder / "calls").stat().st_size < most:
        time.sleep(0.01)
    running.kill()
    found = [float(each) for each in running.communicate()[0].split()]
    return found, (folder / "calls").stat().st_size


def survives_kill(tool, folder):
    """Kill a run half-way; whether the next one computes fewer than all points."""
    outcome(tool, folder, LOGGED.format(fails=None), most=DISTURBED**2 // 2)
    found, calls = outcome(tool, folder, LOGGED.format(fails=None))
    return bool(found) and calls < DISTURBED**2


def survives_change(tool, folder):
    """Change the function; whether the next run has its values, or is refused."""
    outcome(tool, folder, LAW.format(factor=1.0))
    found, _ = outcome(tool, folder, LAW.format(factor=2.0))
    return not found or found[1] == 2.0 * DISTURBED**2


def survives_failure(tool, folder):
    """Let one point fail; whether the next run computes no other one."""
    law = LOGGED.format(fails=float(DISTURBED // 2))
    outcome(tool, folder, law)
    (folder / "mended").touch()
    found, calls = outcome(tool, folder, law)
    return bool(found) and calls <= 1


def strangers():
    """What each tool needs, costs and survives; the answers are those of runs."""
    rows = []
    for tool, function in TOOLS.items():
        answers = [len(inspect.getsource(function).splitlines())]
        with tempfile.TemporaryDirectory() as folder:
            (seconds, _), _ = outcome(tool, Path(folder), LAW.format(factor=1.0), TIMED)
            answers.append(seconds / TIMED**2)
        for survives in (survives_kill, survives_change, survives_failure):
            with tempfile.TemporaryDirectory() as folder:
                answers.append("yes" if survives(tool, Path(folder)) else "no")
        rows.append([tool, *answers])
    heads = ("keeps points after kill -9", "notices a changed function", "keeps points beside a failing one")
    return Table([Column("tool"), Column("lines"), Column("a point", "s"), *map(Column, heads)], rows)


if __name__ == "__main__":
    tool, place, count = sys.argv[1:]
    sys.path.insert(0, place)
    law, values = import_module("law").law, np.arange(1.0, int(count) + 1.0)
    with tempfile.TemporaryDirectory() as first:
        TOOLS[tool](lambda x, z: x * z, values[:2], Path(first))  # what imports
    started = time.perf_counter()
    data = TOOLS[tool](law, values, Path(place))
    print(time.perf_counter() - started, float(data[-1, -1]))
