"""Results of any type: texts, whole numbers and truth values are stored as declared; nothing gets lost."""

import distributed
import numpy as np
import pytest
import xarray as xr

from sweeps import Axis, InputError, StoreError, Sweep, Variable, open_results, pointwise, status
from tests.helpers.backends import INSIDE, visible
from tests.helpers.state import Chosen
from tests.helpers.waves import interrupted

FAILING, LABELLED = Chosen(), Chosen()
STATES = {"missing": None, "short": "µ", "long": "no\0thing " * 40}


def classify(x, state):
    if x in FAILING:
        raise ValueError("no class")
    text = STATES[state]
    return {"label": text, "pair": [f"{x:g}", float("nan")], "count": int(1e15 * x), "is_long": state == "long"}


VARIABLES = {
    "label": Variable(dtype="str", long_name="what it is"),
    "pair": Variable(dtype="str", dims="side"),
    "count": Variable(dtype="int64"),
    "is_long": Variable(dtype="bool"),
}


def sweep(x, **changes):
    grid = {"x": Axis(x, "m"), "state": list(STATES)}
    return Sweep("classes", pointwise(classify), grid, VARIABLES, coords={"side": ["left", "right"]}, **changes)


@pytest.mark.usefixtures("small_pieces")
def test_texts_are_stored_copied_resumed_and_read_like_numbers(path):
    FAILING.add(2.0)
    sweep([1.0, 2.0]).plan(path).run("sync")
    interrupted(sweep([1.0, 2.0, 3.0]).plan(path), 7)
    assert set(open_results(path)["label"].values.ravel()) <= {"", "µ", "no\\0thing " * 40}
    FAILING.clear()
    data = sweep([1.0, 2.0, 3.0]).plan(path, retry_failed=True).run("sync")
    assert data["label"].values.tolist() == [["", "µ", "no\\0thing " * 40]] * 3
    assert data["pair"].values[:, 1].tolist() == [["1", ""], ["2", ""], ["3", ""]]
    assert data["label"].attrs == {"long_name": "what it is"}
    assert data["count"].values[:, 0].tolist() == [1e15, 2e15, 3e15]
    assert data["is_long"].dtype == bool
    xr.testing.assert_equal(data[list(VARIABLES)], sweep([1.0, 2.0, 3.0]).plan().run("sync")[list(VARIABLES)])
    xr.testing.assert_identical(data, open_results(path))
    frame = data["label"].to_dataframe().reset_index()
    assert frame.query("label == 'µ'")["x"].tolist() == [1.0, 2.0, 3.0]
    with xr.open_dataset(path) as plain:
        assert plain["label"].values.tolist() == data["label"].values.tolist()


def test_points_that_are_one_computation_have_one_text(path):
    one = sweep([1.0, 2.0], key=lambda points: points["state"])
    data = one.plan(path).run("sync")
    assert one.plan(path).todo == 0
    assert data["pair"].values[:, 1].tolist() == [["1", ""], ["1", ""]]


@pytest.mark.parametrize("large", [300, 1 << 40])
def test_texts_of_a_large_result_follow_from_all_points_as_others_do(path, limits, large):
    limits(large)
    changes = {"derive": lambda data: data.assign(both=data["label"] + data["pair"].isel(side=0))}
    found = sweep(np.arange(30.0), **changes).plan(path).run("sync")
    assert found["both"].values[7].tolist() == ["7", "µ7", "no\\0thing " * 40 + "7"]
    xr.testing.assert_equal(found[["label", "both"]].load(), open_results(path)[["label", "both"]].load())


def undeclared(x):
    return {"y": x, "wall_time": 0.0, "error": None} | ({"label": "a"} if x in LABELLED else {})


def undeclared_batch(points):
    return {"y": points["x"], "rest": np.zeros((len(points["x"]), 2), int)}


CASES = [
    (
        pointwise(undeclared),
        r"'label', .* y; declare it, as 'label': Variable\(dtype='str'\), or do not return it",
    ),
    (undeclared_batch, r"'rest', .* declare it, as 'rest': Variable\(dtype='int64', dims=\.\.\.\)"),
]


@pytest.mark.parametrize(("scheduler", "count"), [("threads", 40), ("sync", 2), ("inside", 40)])
@pytest.mark.parametrize(("function", "said"), CASES)
def test_an_undeclared_result_is_refused_and_nothing_is_stored(path, request, function, said, scheduler, count):
    """Not as a failure of each point; also if the first points lack it."""
    LABELLED.update(np.arange(1.0, 40.0))
    where = request.getfixturevalue("cluster") if scheduler == "inside" else scheduler
    for store in (path, None):
        with pytest.raises(InputError, match=f"^the function of sweep some returned {said}"):
            Sweep("some", function, {"x": np.arange(float(count))}, ["y"]).plan(store).run(where)
    assert visible(path.parent) == []


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(n_workers=1, threads_per_worker=2, **INSIDE) as one:
        yield one


def test_finished_points_are_kept_when_a_later_one_has_an_undeclared_result(path, small_pieces):
    LABELLED.clear()
    LABELLED.add(40.0)
    one = Sweep("some", pointwise(undeclared), {"x": np.arange(60.0)}, ["y"])
    with pytest.raises(InputError, match="'label'"):
        one.plan(path).run("sync")
    done = status(path).done
    assert 35 < done < 45
    LABELLED.clear()
    assert one.plan(path).todo == 60 - done
    assert one.plan(path).run("sync")["y"].values.tolist() == list(range(60))


def test_a_point_that_lacks_a_declared_result_fails_alone_in_any_batch(monkeypatch):
    def partial(x):
        if x == 5.0:
            raise ValueError("five")
        return {"label": "a", "error": None} | ({} if x in (1.0, 4.0) else {"y": x, "note": "b"})

    variables = {"y": Variable(), "label": Variable(dtype="str"), "note": Variable(dtype="str")}
    found = []
    for size in (1.0, 1e9):
        monkeypatch.setattr("sweeps.plan.batches.BATCH_BYTES", size)
        found.append(Sweep("some", pointwise(partial), {"x": np.arange(30.0)}, variables).plan().run("sync"))
        assert np.flatnonzero(found[-1]["status"] == 2).tolist() == [1, 4, 5]
        assert "returned no 'y'" in found[-1]["error"].values[4]
    xr.testing.assert_equal(*(each.drop_vars("wall_time") for each in found))


RETURNS = [
    (lambda x: "text", r"of type <U4, which does not fit float64; it may be declared as Variable\(dtype='str'\)"),
    (lambda x: 2**53 + 1, "of type int64, which does not fit float64"),
    (lambda x: 1j, "of type complex128, which does not fit float64; return its real and its imaginary part$"),
    (lambda x: None, "of type object, which does not fit float64$"),
]


@pytest.mark.parametrize(("function", "said"), RETURNS)
def test_what_a_float_would_lose_is_refused_and_the_message_says_how_to_declare_it(function, said):
    error = Sweep("one", pointwise(function), {"x": [1.0]}, "y").plan().run("sync")["error"].item()
    with pytest.raises(StoreError, match=f"ValueError: the function of sweep one returned 'y' .*{said}"):
        raise StoreError(error)


def test_whole_numbers_and_truth_values_that_are_named_only_become_floats(path):
    def function(points):
        return {"a": points["x"] > 1.0, "b": np.full(len(points["x"]), 2**53)}

    found = Sweep("two", function, {"x": [1.0, 2.0]}, ["a", "b"]).plan(path).run("sync")
    assert found["a"].values.tolist() == [0.0, 1.0]
    assert found["b"].values.tolist() == [2.0**53] * 2


@pytest.mark.parametrize("options", [{"digits": 3}, {"scale": "s"}, {"flags": {1: "a"}}])
def test_a_text_has_no_digits_scale_or_flags(options):
    with pytest.raises(InputError, match="Variable: "):
        Variable(dtype="str", **options)
