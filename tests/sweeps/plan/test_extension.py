"""A variable that a sweep gets is added to its file: the function runs again, and gives what is there."""

import numpy as np
import pytest

from sweeps import InputError, StoreError, Sweep, Variable, open_results
from sweeps.errors import FailedPointsWarning
from tests.helpers.state import Log
from tests.helpers.waves import interrupted

GRID = {"x": np.arange(6.0), "y": [1.0, 2.0]}
BEFORE, MORE, OTHER = "{'z': x + y}", "{'z': x + y, 'w': x * y}", "{'z': x + y + 1e-9 * (x > 4.5), 'w': x}"


def of(text, grid=GRID, **options):
    """A sweep of a function whose code is `text`, with its variables."""
    names = {"__name__": "extended", "np": np}
    exec(f"def f(points, **constants):\n    x, y = points['x'], points['y']\n    return {text}", names)
    return Sweep("extended", names["f"], grid, [each for each in "zw" if f"'{each}'" in text], **options)


@pytest.fixture
def stored(path):
    of(BEFORE).plan(path).run("sync")
    return path


def test_a_variable_is_added_to_all_stored_points(stored):
    of(BEFORE, {"x": [7.0], "y": [1.0, 3.0]}).plan(stored).run("sync")
    before = open_results(stored)
    plan = of(MORE).plan(stored)
    assert (plan.todo, plan.cached, plan.extends) == (14, 0, "w")
    assert "\nadded           w; stored points are computed again, and must come out the same\n" in repr(plan)
    data = plan.run("sync")
    assert data["w"].values.tolist() == [[x * y for y in GRID["y"]] for x in GRID["x"]]
    whole = open_results(stored)
    for name in ("z", "status"):
        np.testing.assert_array_equal(whole[name], before[name])
    assert int(whole["w"].notnull().sum()) == 14
    lines = whole.attrs["history"].splitlines()
    assert len(lines) == 3
    assert lines[-1].endswith("; w added")
    assert "extends" not in whole.attrs
    again = of(MORE).plan(stored)
    assert (again.todo, again.whole, again.extends) == (0, True, "")


def test_other_values_are_refused_and_nothing_changes(stored):
    before = stored.read_bytes()
    message = r"w cannot be added, and nothing has changed: at x = 5.0, y = 1.0 z = 6.0 there, 6.000000001 with"
    with pytest.raises(StoreError, match=message):
        of(OTHER).plan(stored).run("sync")
    assert stored.read_bytes() == before
    assert [each.name for each in stored.parent.iterdir() if each.suffix != ".lock"] == [stored.name]
    of(OTHER).plan(stored, fresh=True).run("sync")
    assert float(open_results(stored)["z"].sel(x=5.0, y=1.0)) == 6.0 + 1e-9


def test_a_run_that_is_interrupted_goes_on_and_compares_in_the_end(stored):
    for text, fails in ((MORE, False), (OTHER, True)):
        of(BEFORE).plan(stored, fresh=True).run("sync")
        plan = of(text).plan(stored)
        interrupted(plan, 2)
        again = of(text).plan(stored)
        assert 0 < again.cached < 12
        assert again.extends == "w"
        if fails:
            with pytest.raises(StoreError, match="w cannot be added"):
                again.run("sync")
        else:
            assert again.run("sync")["w"].notnull().all()


@pytest.mark.parametrize("options", [{"constants": {"k": 1.0}}, {"name": "other"}])
def test_what_differs_otherwise_is_refused(stored, options):
    sweep = of(MORE, **{k: v for k, v in options.items() if k != "name"})
    if "name" in options:
        sweep = Sweep("other", sweep.function, GRID, ["z", "w"])
    with pytest.raises(StoreError, match=r"has other results|has the results of extended"):
        sweep.plan(stored)
    with pytest.raises(StoreError, match="has other results"):
        of("{'w': x}").plan(stored)


CALLS = Log()


def alone(w, grid=GRID, before=BEFORE):
    """The sweep of `BEFORE` with w by a function of its own; `CALLS` gets what it computes."""

    def own(points, **constants):
        CALLS.extend(points["x"])
        return {"w": w(points["x"], points["y"])}

    return Sweep("extended", of(before).function, grid, ["z", "w"], functions={"w": own})


def product(x, y):
    return x * y


def test_a_variable_with_its_own_function_costs_itself(stored):
    before = open_results(stored)
    CALLS.clear()
    plan = alone(product).plan(stored)
    assert (plan.todo, plan.alone) == (12, True)
    assert "\nadded           w; computed alone at the stored points\n" in repr(plan)
    data = plan.run("sync")
    assert len(CALLS) == 12
    assert data["w"].values.tolist() == [[x * y for y in GRID["y"]] for x in GRID["x"]]
    for name in ("z", "status", "wall_time", "error"):
        np.testing.assert_array_equal(data[name], before[name])
    assert data.attrs["history"].splitlines()[-1].endswith("; w added")
    assert alone(product).plan(stored).whole
    # A new point then costs both, as one that begins with both.
    grid = {"x": [*GRID["x"], 9.0], "y": GRID["y"]}
    grown, whole = alone(product, grid).plan(stored).run("sync"), alone(product, grid).plan().run("sync")
    for name in ("z", "w"):
        np.testing.assert_array_equal(grown[name], whole[name])


def test_what_is_stored_gets_the_variable_before_new_points_are_computed(stored):
    CALLS.clear()
    grid = {"x": [2.0, 7.0], "y": [1.0, 3.0]}
    plan = alone(product, grid).plan(stored)
    assert (plan.todo, plan.later) == (12, 3)
    data = plan.run("sync")
    assert len(CALLS) == 15
    assert data["w"].values.tolist() == [[2.0, 6.0], [7.0, 21.0]]
    assert data["z"].values.tolist() == [[3.0, 5.0], [8.0, 10.0]]
    whole = open_results(stored)
    done = whole["status"] == 1
    assert int(done.sum()) == 15
    np.testing.assert_array_equal(whole["w"].notnull(), done)


def test_the_function_of_a_variable_that_is_stored_must_stay(stored):
    alone(product).plan(stored).run("sync")
    with pytest.raises(StoreError, match="the function of w has changed"):
        alone(lambda x, y: x * y + 1.0).plan(stored)
    # That of the others too, as without.
    with pytest.raises(StoreError, match="has other results: the code of"):
        alone(product, before="{'z': x - y}").plan(stored)


def test_other_code_of_the_rest_computes_and_compares_everything(stored):
    with pytest.raises(StoreError, match="w cannot be added"):
        alone(product, before="{'z': x + y + 1e-9 * (x > 4.5)}").plan(stored).run("sync")
    plan = alone(product, before="{'z': y + x}").plan(stored)
    assert (plan.alone, plan.todo) == (False, 12)
    assert plan.run("sync")["w"].notnull().all()


def test_an_interrupted_addition_goes_on(stored):
    interrupted(alone(product).plan(stored), 2)
    again = alone(product).plan(stored)
    assert (0 < again.cached < 12, again.alone) == (True, True)
    data = again.run("sync")
    assert data["w"].notnull().all()
    assert data["z"].notnull().all()


def test_an_interrupted_addition_to_a_file_that_is_gone_starts_anew(stored):
    interrupted(alone(product).plan(stored), 2)
    stored.unlink()
    data = alone(product).plan(stored).run("sync")
    assert data["w"].notnull().all()
    assert data["z"].notnull().all()


def test_where_the_function_fails_the_variable_is_pending_and_the_point_stays(stored):
    def fails(x, y):
        if np.any(x == 3.0):
            raise ValueError("x = 3: no w there")
        return x * y

    with pytest.warns(
        FailedPointsWarning, match="w failed at 2 of 12 stored points: ValueError: x = 3: no w there"
    ):
        data = alone(fails).plan(stored).run("sync")
    assert (data["status"] == 1).all()
    assert data.attrs["pending"] == "w"
    np.testing.assert_array_equal(data["w"].isnull().all("y"), GRID["x"] == 3.0)
    # It stays pending when the grid grows, and is computed on request, where it is missing.
    alone(fails, {"x": [9.0], "y": [1.0]}).plan(stored).run("sync")
    assert open_results(stored).attrs["pending"] == "w"
    assert alone(fails).plan(stored).whole
    plan = alone(fails).plan(stored, retry_failed=True)
    assert plan.todo == 2
    with pytest.warns(FailedPointsWarning, match="w failed at 2 of 2"):
        plan.run("sync")


@pytest.mark.parametrize("scheduler", ["threads", "processes"])
def test_whatever_computes_it_the_values_are_those_of_one_run(stored, scheduler):
    def own(points):
        return {"w": points["x"] * points["y"]}

    sweep = Sweep("extended", of(BEFORE).function, GRID, ["z", "w"], functions={"w": own})
    added, once = sweep.plan(stored).run(scheduler, 2), sweep.plan().run("sync")
    for name in ("z", "w"):
        np.testing.assert_array_equal(added[name], once[name])


def test_copies_and_factors_hold_for_an_added_variable(path):
    options = {"key": lambda p: p["x"] % 3.0, "scale": lambda p: {"load": 1.0 + p["x"] // 3.0}}
    variables = {"z": Variable(scale="load"), "w": Variable(scale="load")}

    def z(points):
        return {"z": points["x"] % 3.0 + 1.0}

    def w(points):
        return {"w": points["x"] % 3.0 - 1.0}

    grid = {"x": np.arange(6.0)}
    Sweep("scaled", z, grid, {"z": variables["z"]}, **options).plan(path).run("sync")
    plan = Sweep("scaled", z, grid, variables, functions={"w": w}, **options).plan(path)
    assert plan.todo == 3
    data = plan.run("sync")
    assert data["w"].values.tolist() == [-1.0, 0.0, 1.0, -2.0, 0.0, 2.0]
    assert data["z"].values.tolist() == [1.0, 2.0, 3.0, 2.0, 4.0, 6.0]


@pytest.mark.parametrize("functions", [{"v": product}, {"w": 3.0}, {"z": product, "w": product}])
def test_functions_are_checked(functions):
    with pytest.raises(
        InputError, match=r"functions\['[vwz]'\] = .*: it must be a function of one of the variables"
    ):
        Sweep("extended", of(BEFORE).function, GRID, ["z", "w"], functions=functions)
