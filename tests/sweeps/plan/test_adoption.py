"""Results of other code are kept where computations that are repeated agree, and stay as they are elsewhere."""

import json

import netCDF4
import numpy as np
import pytest

from sweeps import Adopt, InputError, StoreError, Sweep, Variable
from tests.helpers.waves import interrupted

GRID = {"x": np.arange(8.0), "y": [1.0, 2.0, 3.0]}


def of(text, grid=GRID, variables=("z",), **options):
    """A sweep of a function whose code is `text`."""
    names = {"__name__": "adopted", "np": np}
    exec(f"def f(points, **constants):\n    x, y = points['x'], points['y']\n    return {text}", names)
    return Sweep("adopted", names["f"], grid, variables, **options)


BEFORE, SAME, OTHER = "{'z': x + y}", "{'z': y + x}", "{'z': x + y * 1.5}"
CORNER = "{'z': x + y + 1e-9 * ((x > 6.5) & (y > 2.5))}"


def contents(path):
    return {each.name: each.read_bytes() for each in path.parent.rglob("*") if each.is_file()}


@pytest.fixture
def stored(path):
    of(BEFORE).plan(path).run("sync")
    return path


def test_equal_results_are_adopted_and_the_history_says_so(stored):
    with pytest.raises(StoreError, match=r"the code of adopted has changed"):
        of(SAME).plan(stored)
    plan = of(SAME).plan(stored, adopt=Adopt(5, seed=7))
    assert (plan.todo, plan.cached) == (0, 24)
    assert "\nadoption        5 of 24 stored computations are repeated first (seed 7)\n" in repr(plan)
    data = plan.run("sync")
    line = "5 of 24 computations, repeated with other code, agree in all bits (seed 7; a change at 10 % of the"
    line += " points would have been found with a probability of 41 %)"
    assert plan.adopted == line
    assert f"; {line}" in data.attrs["history"].splitlines()[-1]
    assert data.attrs["history"].count("\n") == 1
    assert data["z"].values.tolist() == [[x + y for y in GRID["y"]] for x in GRID["x"]]
    again = of(SAME).plan(stored)
    assert (again.todo, again.whole, again.adoption) == (0, True, None)
    # Where the code is the same nothing is repeated.
    assert of(SAME).plan(stored, adopt=5).adoption is None
    with pytest.raises(StoreError, match=r"the code of adopted has changed"):
        of(BEFORE).plan(stored)


def test_other_results_are_not_adopted_and_nothing_changes(stored):
    before = contents(stored)
    message = (
        r"^the results are not adopted, and nothing has changed: at x = \S+, y = \S+ z = \S+ there, \S+ with the"
    )
    with pytest.raises(StoreError, match=message):
        of(OTHER).plan(stored, adopt=3).run("sync")
    failing = "{'z': x + y, 'error': [ValueError('no')] * len(x)}"
    with pytest.raises(RuntimeError, match=r"ValueError: no"):
        of(failing).plan(stored, adopt=3).run("sync")
    assert contents(stored) == before
    assert of(BEFORE).plan(stored).todo == 0


@pytest.mark.usefixtures("small_pieces")
def test_missing_points_are_computed_after_the_adoption(path):
    interrupted(of(BEFORE).plan(path), 6)
    plan = of(SAME).plan(path, adopt=Adopt(4, 0))
    assert plan.todo > 0
    calls = []
    data = plan.run("sync", progress=calls.append)
    assert plan.adopted
    assert bool((data["status"] == 1).all())
    assert data["z"].values.tolist() == [[x + y for y in GRID["y"]] for x in GRID["x"]]
    assert of(SAME).plan(path).whole


@pytest.mark.usefixtures("small_pieces")
def test_a_run_that_is_killed_after_the_adoption_continues(path):
    interrupted(of(BEFORE).plan(path), 6)
    with pytest.raises(KeyboardInterrupt):
        of(SAME).plan(path, adopt=4).run("sync", progress=stop_after_adoption())
    plan = of(SAME).plan(path)
    assert plan.cached
    assert plan.todo
    assert plan.run("sync")["z"].notnull().all()


def stop_after_adoption():
    todo = set()

    def progress(snapshot):
        todo.add(snapshot.todo)
        if len(todo) > 1 and snapshot.done > 8:
            raise KeyboardInterrupt

    return progress


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"constants": {"k": 2.0}}, r"k = nothing there, 2\.0 here"),
        ({"variables": {"z": Variable("m")}}, r'variables z\.units = "1" there, "m" here'),
        ({"grid": GRID | {"w": [1.0]}}, r"axes w = nothing there"),
    ],
)
def test_only_code_is_adopted(stored, change, message):
    before = contents(stored)
    with pytest.raises(StoreError, match=message):
        of(SAME, **change).plan(stored, adopt=3)
    assert contents(stored) == before


def test_a_change_in_one_corner_is_found_as_often_as_the_message_says(stored):
    """One of 24 points differs; a choice of 6 of them has it with a probability of 1/4."""
    changed = of(CORNER)
    found = 0
    for seed in range(200):
        plan = changed.plan(stored, adopt=Adopt(6, seed))
        found += 23 in plan.adoption.points
        assert len(set(plan.adoption.points.tolist())) == 6
    # Four standard deviations of a binomial distribution.
    assert abs(found / 200 - 0.25) < 4.0 * np.sqrt(0.25 * 0.75 / 200)
    hit = next(seed for seed in range(99) if 23 in changed.plan(stored, adopt=Adopt(6, seed)).adoption.points)
    with pytest.raises(StoreError, match=r"at x = 7\.0, y = 3\.0 z = 10\.0 there, 10\.000000001 with"):
        changed.plan(stored, adopt=Adopt(6, hit)).run("sync")


CHAOTIC = "{{'z': x + {0} * y, 'z_se': 0.0 * x + 0.01, 'label': (x + {1}).astype(int), 'w': x, 'w_se': 0.0 * x}}"
KINDS = {
    "z": Variable(),
    "z_se": Variable(),
    "label": Variable(dtype="int32"),
    "w": Variable(),
    "w_se": Variable(),
}


def test_chaotic_results_agree_within_four_standard_errors(path):
    of(CHAOTIC.format(0.0, 0), variables=KINDS).plan(path).run("sync")
    # Outputs without an error are not compared where the run is chaotic, and are listed.
    near = of(CHAOTIC.format(0.01, 1), variables=KINDS).plan(path, adopt=Adopt(24, 0))
    with pytest.raises(StoreError, match=r"z = 0\.0 there, 0\.01 with the present code$"):
        of(CHAOTIC.format(0.01, 1), variables=KINDS).plan(path, adopt=Adopt(24, 0, exact=True)).run("sync")
    near.run("sync")
    assert "agree within 4 standard errors" in near.adopted
    assert near.adopted.endswith("without a standard error, so not compared: label")
    with pytest.raises(StoreError, match=r"z = 0\.0 there, 0\.1 with .*, 7\.07 standard errors apart"):
        of(CHAOTIC.format(0.1, 1), variables=KINDS).plan(path, adopt=24).run("sync")


def test_what_is_not_chaotic_needs_the_same_bits(path):
    """Nothing with an error differs, so a label that does has other code."""
    of(CHAOTIC.format(0.0, 0), variables=KINDS).plan(path).run("sync")
    with pytest.raises(StoreError, match=r"label = 0 there, 1 with the present code$"):
        of(CHAOTIC.format(0.0, 1), variables=KINDS).plan(path, adopt=24).run("sync")


def test_results_of_the_earlier_scheme_are_named_and_adopted(stored):
    with netCDF4.Dataset(stored, "a") as file:
        before = json.loads(file.fingerprint)
        for name in ("values", "sources", "compiler"):
            del before[name]
        file.fingerprint = json.dumps(before | {"code": {"adopted": "0123456789abcdef"}})
    with pytest.raises(StoreError, match=r"the fingerprint of its code is of an earlier version of sweeps"):
        of(BEFORE).plan(stored)
    of(BEFORE).plan(stored, adopt=3).run("sync")
    assert of(BEFORE).plan(stored).whole


@pytest.mark.parametrize(
    ("sources", "compiler", "message"),
    [
        ("", "cpython-399 -O0", ""),
        ("", "cpython-311 -O2", ""),
        ("0", "cpython-399 -O0", r"the sources have changed since cpython-399 -O0 compiled them"),
    ],
)
def test_the_sources_decide_where_another_python_has_compiled(stored, sources, compiler, message):
    with netCDF4.Dataset(stored, "a") as file:
        before = json.loads(file.fingerprint)
        before |= {"compiler": compiler, "sources": sources or before["sources"], "code": {"adopted": "0"}}
        file.fingerprint = json.dumps(before)
    if message:
        with pytest.raises(StoreError, match=message):
            of(BEFORE).plan(stored)
    else:
        with pytest.warns(
            UserWarning, match=rf"computed by code that {compiler} has compiled; the sources are the"
        ):
            assert of(BEFORE).plan(stored).todo == 0


@pytest.mark.parametrize("adopt", [-1, 0, 1.5, True, "many", Adopt(0)])
def test_a_wrong_number_is_refused(stored, adopt):
    with pytest.raises(
        InputError, match=r"^adopt = .*: it must be the number of points to compute again, 1 or above"
    ):
        of(SAME).plan(stored, adopt=adopt)


def test_there_must_be_results_to_adopt(path):
    with pytest.raises(InputError, match=r"^adopt: it is for stored results"):
        of(SAME).plan(adopt=3)
    with pytest.raises(InputError, match=r"^adopt: it is for stored results"):
        of(SAME).plan(path, adopt=3, fresh=True)
    assert of(SAME).plan(path, adopt=3).adoption is None
