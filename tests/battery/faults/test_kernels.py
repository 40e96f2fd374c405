"""Kernels under a memory checker and with every index checked: 1 to 33 scenes of mixed rigs, beside each alone."""

import json
import os
import signal
import subprocess
import sys

import pytest

from tests import HOME
from tests.helpers.processes import guards
from tests.helpers.processes.kernel_batches import MOST, PARTS

pytestmark = [pytest.mark.battery, pytest.mark.slow]


def program(*arguments, **environment):
    """A program of Python in a process of its own, ended."""
    path = os.pathsep.join([str(HOME), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=HOME,
        env=os.environ | {"PYTHONPATH": path} | environment,
        capture_output=True,
        text=True,
        check=False,
    )


def batches(how, **environment):
    """What was done of each part of the batches, all of which must have gone well."""
    ended = program("-m", "tests.helpers.processes.kernel_batches", how, *PARTS, **environment)
    told = [json.loads(line) for line in ended.stdout.splitlines()]
    done = [line["part"] for line in told]
    assert not ended.returncode, f"exit {ended.returncode} after {done}:\n{ended.stderr}"
    assert done == PARTS
    assert [line["batches"] for line in told] == [MOST] * len(PARTS)
    # No part is without what it is about.
    assert {state for line in told for state in line.get("states", [])} == {0, 1, 2}
    assert [line["part"] for line in told if 2 * line.get("errors", 0) > MOST] == []
    return told


def inner_names():
    """Names that kernels use, and so those of the kernels that they call."""
    return {name for each in guards.kernels().values() for name in each.py_func.__code__.co_names}


def test_every_batch_stays_within_its_arrays_and_has_the_bits_of_each_scene_alone(tried):
    """All arrays that Python gives a kernel end right ahead of a guard page, and begin right behind one."""
    told = batches("guarded")
    called = {name for line in told for name in line["calls"]}
    # Every kernel was called, by Python or by a kernel that was.
    assert called
    every = {f"{each.__module__}.{each.__name__}" for each in guards.kernels().values()}
    inner = inner_names()
    assert {name for name in every - called if name.rpartition(".")[2] not in inner} == set()
    tried["batches against guard pages"] += sum(line["batches"] for line in told)
    tried["calls of kernels against guard pages"] += sum(sum(line["calls"].values()) for line in told)


def test_every_batch_stays_within_its_arrays_where_each_index_is_checked(tmp_path, tried):
    """The arrays that a kernel makes for itself, too; the program begins with an index that is none."""
    told = batches("checked", NUMBA_BOUNDSCHECK="1", NUMBA_CACHE_DIR=str(tmp_path))
    tried["batches with bounds checks"] += sum(line["batches"] for line in told)


# What a page and a check find.

LEAVING = """
import numpy as np
from collections import Counter
from fivcore.jit import kernel
from tests.helpers.processes.guards import guarded

@kernel
def leaving(x, place, value):
    if value != 0.0:
        x[place] = value
    return x[place]

numbers = np.arange({count}.0)[::{stride}]
guarded(leaving, Counter())(numbers, np.uint64(0), 1.0)
assert numbers[0] == 1.0
guarded(leaving, Counter())(numbers, {place}, {value})
"""
# One number too far, at the end and at the beginning; of a row with gaps; of an array of nothing.
READS = {
    "after": (10, 1, "10"),
    "before": (10, 1, "np.uint64(2**64 - 1)"),
    "page": (512, 1, "512"),
    "gaps": (9, 2, "5"),
}


@pytest.mark.parametrize("case", READS)
def test_a_kernel_that_reads_a_number_too_far_dies(case, tried):
    count, stride, place = READS[case]
    ended = program("-c", LEAVING.format(count=count, stride=stride, place=place, value=0.0))
    assert ended.returncode == -signal.SIGSEGV, ended.stderr
    tried["kernels that leave their arrays"] += 1


@pytest.mark.parametrize("place", ["10", "np.uint64(2**64 - 1)"])
def test_a_kernel_that_writes_a_number_too_far_dies_or_is_named(place, tried):
    """Behind a page there is room behind the array, and the bytes there change; ahead of it the process dies."""
    ended = program("-c", LEAVING.format(count=10, stride=1, place=place, value=1.0))
    named = "__main__.leaving wrote beside arrays that lie behind a page" in ended.stderr
    assert named if place == "10" else ended.returncode == -signal.SIGSEGV, ended.stderr
    tried["kernels that leave their arrays"] += 1


def test_without_checks_the_program_says_that_there_are_none(tmp_path):
    ended = program("-m", "tests.helpers.processes.kernel_batches", "checked", NUMBA_CACHE_DIR=str(tmp_path))
    assert ended.returncode == 1
    assert "DID NOT RAISE" in ended.stderr
