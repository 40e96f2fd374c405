"""A million points of stability and a hundred thousand short transients through a local cluster, watched."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from studies import registry
from studies.config import read_values
from sweeps import DONE, open_results
from sweeps.storage.store import Store
from tests.helpers.processes.watched import watch

pytestmark = [pytest.mark.battery, pytest.mark.slow]

CHECKED = 200
# The whole run may have so much more memory in the last third of its time than in the middle one.
MORE_MEMORY = 0.05
# The rate in the last third is at least this share of that in the middle one. Rates are by the time that the run's
# processes had of a processor: what else the machine does is no matter.
SLOWEST = 0.6
# No wait for the next points takes more than this share of the whole, s and share: a batch is a second of work.
PAUSE = 15.0, 0.1
RUNS = {
    "stability points": ("stability", ["theta=-10:20:1000", "mu=0:0.5:1000"], 1_000_000),
    "short transients": (
        "scenes",
        ["V=log:1e-3:1:500", "theta=0:12:10", "mu=0.05:0.4:20", "F=9", "duration=2e-3"],
        100_000,
    ),
}


def thirds(series):
    """Medians of times and values in the middle and in the last third of the time."""
    at, values = np.array(series).T
    ends = np.linspace(at[0], at[-1], 4)
    return [float(np.median(values[(at >= low) & (at <= high)])) for low, high in pairwise(ends[1:])]


def steps(looks):
    """Pairs of looks, one after the other, at which points had been counted anew."""
    counted = [look for k, look in enumerate(looks) if k == 0 or look.done > looks[k - 1].done]
    return list(pairwise(counted))


def rate(one, later):
    """Points for each second of a processor between two looks."""
    return (later.done - one.done) / (sum(later.processor.values()) - sum(one.processor.values()))


def alone(study, point, settings):
    """A point of a study computed by itself in this process."""
    sweep = replace(study.sweep(read_values(study, settings) | point), derive=None)
    return sweep.plan().run("sync").squeeze()


@pytest.mark.parametrize("what", RUNS)
def test_memory_and_rate_are_steady(what, tmp_path, rng, tried):
    name, given, count = RUNS[what]
    store = Store(tmp_path / name / f"{name}.nc")
    options = [part for each in given for part in ("--set", each)]
    looks, printed = watch(store, "run", name, *options, "--workers", "2", "--out", str(tmp_path))
    assert looks[-1].todo == count
    # Client, workers and those who watch over them.
    assert min(len(look.memory) for look in looks) >= 3
    middle, last = thirds([(look.at, sum(look.memory.values())) for look in looks])
    told = f"{what}: {middle / 1e6:.0f} MB, then {last / 1e6:.0f} MB"
    assert last <= (1.0 + MORE_MEMORY) * middle, f"{told}; {looks[-1].memory}"
    before, after = thirds([(later.at, rate(one, later)) for one, later in steps(looks)])
    told += f"; {before:.0f} points for a second of a processor, then {after:.0f}"
    print(f"{told}; {count / looks[-1].at:.0f} points a second")
    assert after >= SLOWEST * before, told
    longest = max(later.at - one.at for one, later in steps(looks))
    assert longest <= PAUSE[0] + PAUSE[1] * looks[-1].at, f"{what}: {longest:.0f} s without a point"
    complete(name, store, count, given, rng, printed)
    tried[f"{what} by a cluster"] += count


def complete(name, store, count, given, rng, printed):
    """Fail unless every point is there, with the bits that a random few have when they are computed alone."""
    study = registry.load(name)
    settings = {each.partition("=")[0]: each.partition("=")[2] for each in given if each.startswith("duration")}
    with open_results(store.file) as data:
        assert data["status"].size == count, printed
        assert (data["status"] == DONE).all()
        axes = [dim for dim in data["status"].dims if dim in study.axes]
        wrong = []
        for number in rng.choice(count, CHECKED, replace=False):
            places = dict(zip(axes, np.unravel_index(number, data["status"].shape), strict=True))
            kept = data.isel(places)
            point = {axis: float(kept[axis]) for axis in axes}
            found = alone(study, point, settings)
            same = [kept[each].values.tobytes() == found[each].values.tobytes() for each in study.variables]
            if not all(same):
                wrong.append(
                    (point, [each for each, is_same in zip(study.variables, same, strict=True) if not is_same])
                )
        assert wrong == []
