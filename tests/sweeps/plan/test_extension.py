"""A variable that a sweep gets is added to its file: the function runs again, and gives what is there."""

import numpy as np
import pytest

from sweeps import StoreError, Sweep, open_results
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
