"""Every kind of file that is read, damaged: a right answer, or one line that names the file and the cause.

| file | read by | what damage does |
| --- | --- | --- |
| `STUDY.nc` | open_results, status, query, plan, run, plot, report | any is noticed; the file stays |
| above 268 MB | the same | values are right or missing, or are refused |
| `STUDY.nc.parts/`: manifest | the same | its copy is read |
| `STUDY.nc.parts/`: parts | the same | points are pending, and computed again |
| `progress.json`, beside a lock | status, plan, run | nothing is told of the run |

The program's own files (its Python, catalogue.json, known.json, templates) are no input, and `surfaces/` has the
texts of users. Of a large file bits alone are changed: the checksum of zeros is zero, so that a small block that
is lost is read as zeros.
"""

import json

import pytest
from filelock import lock_descriptor

from tests.battery.faults.damage import harmed
from tests.battery.faults.reader import (
    COMMANDS,
    FILE,
    NAMES,
    OF_HALF,
    PARTS,
    TABLE,
    prepare_large,
)

pytestmark = [pytest.mark.battery, pytest.mark.slow]

FLIPS = 500


def cases(rng, whole, kinds=None):
    """Other contents of a file, each with its number and what was done."""
    for n in range(FLIPS):
        told, content = harmed(rng, whole, kinds)
        while content == whole:
            told, content = harmed(rng, whole, kinds)
        yield n, f"{n}: {told}", content


def turns(n):
    """Each case is for `open_results` and two of the commands."""
    return [None, *(COMMANDS[(2 * n + k) % len(COMMANDS)] for k in range(2))]


def test_a_result(trial, rng, tried):
    for n, case, content in cases(rng, (trial.kept / FILE).read_bytes(), ["bit", "bit", "bit", "end", "more"]):
        for command in turns(n):
            good = trial.good(command)
            with trial.place(FILE) as path:
                done = trial.asked_of(path, content, case, command, "tiny.nc")
            if done.code < 2 and (done.code, done.out) != (good.code, good.out):
                trial.note(case, command, done, "another answer, unseen")
        tried["damaged results"] += 1
    assert trial.failures == []


@pytest.mark.parametrize("reader", [prepare_large], indirect=True)
def test_a_large_result(trial, rng, tried):
    """HDF5 checks what is read of its variables, but not where it is."""
    good = json.loads(trial.good(None).out)["values"]
    for n, case, content in cases(rng, (trial.kept / FILE).read_bytes(), ["bit"]):
        for command in turns(n):
            with trial.place(FILE) as path:
                done = trial.asked_of(path, content, case, command, *NAMES)
            if command is None and done.code == 0 and not _right(json.loads(done.out)["values"], good):
                trial.note(case, command, done, "another value, unseen")
        tried["damaged results that are large"] += 1
    assert trial.failures == []


def _right(found, good):
    """Whether each value is what it was, or missing."""
    missing = ("nan", "-127", "")
    return all(
        one == other or one in missing for name in good for one, other in zip(found[name], good[name], strict=True)
    )


@pytest.mark.parametrize("kind", ["manifest", "part"])
def test_what_a_run_has_left(trial, rng, tried, kind):
    """What is shown of it is right, and a run computes the rest."""
    name = kind if kind == "manifest" else min(each.name for each in (trial.kept / PARTS).glob("*.part"))
    finished = set(trial.good(TABLE).out.splitlines())
    longer = finished | {"6.0,one,12.0,wild,done,", "6.0,other,12.0,wild,done,"}
    table = (*TABLE, "--out", "half")
    for n, case, content in cases(rng, (trial.kept / PARTS / name).read_bytes()):
        command = OF_HALF[n % len(OF_HALF)]
        with trial.place(f"{PARTS}/{name}") as path:
            path.write_bytes(content)
            done = trial.ask(case, table, "tiny.nc", "tiny.nc.parts")
            if not {line for line in done.out.splitlines() if "pending" not in line} <= finished:
                trial.note(case, table, done, "another value, unseen")
            done = trial.ask(case, command, "tiny.nc", "tiny.nc.parts")
            if command[0] == "run" and done.code < 2:
                done = trial.ask(case, table, "tiny.nc")
                if set(done.out.splitlines()) != (longer if "--set" in command else finished):
                    trial.note(case, command, done, "another result")
        tried[f"damaged {kind}s of a run"] += 1
    assert trial.failures == []


def test_the_progress_of_a_run_that_goes_on(trial, rng, tried):
    state = {"pid": 7, "host": "here", "started": "2026-01-01", "todo": 9, "done": 1, "failed": 0, "elapsed": 1.5}
    state |= {"rate": 2.0, "left": 4.0, "now": ["x = 1"], "stopping": False, "written": 0.5}
    asked = [command for command in OF_HALF if command[0] in ("status", "run", "plan")]
    with (
        trial.place(f"{PARTS}/progress.json") as path,
        open(trial.folder / "half/tiny/.tiny.nc.lock", "ab") as lock,
    ):
        assert lock_descriptor(lock.fileno(), blocking=False)
        for n, case, content in cases(rng, json.dumps(state).encode()):
            command = asked[n % len(asked)]
            done = trial.asked_of(path, content, case, command, "tiny.nc", "tiny.nc.parts")
            if command[0] == "run" and done.code != 3:
                trial.note(case, command, done, "it runs beside another")
            tried["damaged tellings of progress"] += 1
    assert trial.failures == []
