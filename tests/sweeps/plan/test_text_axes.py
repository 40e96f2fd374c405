"""Axes of texts are planned, keyed, kept, grown, read and reproduced like axes of numbers."""

import numpy as np
import pytest
import xarray as xr

from sweeps import Axis, Grid, Refinement, Sweep, Variable, open_results, refined, status

CASES = ["tangent", "tangent, missed", "µ = 0", "θ = 90°"]
METHODS = ["fast", "exact", "paper"]
CALLS = []


def letters(points):
    """Number of letters of a case, times a size; one method refuses one case."""
    CALLS.extend(zip(points["case"].tolist(), points["method"].tolist(), strict=True))
    if np.any((points["case"] == CASES[1]) & (points["method"] == "exact")):
        raise ValueError("refused by 'exact'")
    count = np.char.str_len(points["case"])
    return {"letters": count, "weight": count * points["size"]}


def sweep(cases=CASES, methods=METHODS, sizes=(1.0, 2.0, 3.0), **more):
    axes = {"case": Axis(cases, long_name="case"), "method": Axis(methods), "size": Axis(sizes, "m")}
    variables = {"letters": Variable(dtype="int16"), "weight": Variable("m")}
    return Sweep("letters", letters, Grid(axes), variables, title="Letters", **more)


@pytest.fixture(autouse=True)
def calls():
    CALLS.clear()
    return CALLS


def test_a_file_has_the_texts_and_is_read_by_them(path, inner):
    found = sweep().plan(path).run(inner)
    with xr.open_dataset(path) as plain:
        xr.testing.assert_equal(plain.load(), found)
        xr.testing.assert_equal(open_results(path), found)
        assert plain.sizes == {"case": 4, "method": 3, "size": 3, "failure": 3}
        assert plain["case"].values.tolist() == CASES
        assert plain.sel({"case": "θ = 90°", "method": "paper", "size": 2.0})["weight"].item() == 14.0
        assert set(plain["status"].sel({"case": CASES[1], "method": "exact"}).values) == {2}
        with pytest.raises(KeyError):
            plain.sel(case="tang")
    assert (status(path).done, status(path).failed) == (33, 3)


def test_a_failure_tells_the_line_that_raises_it_again():
    found = sweep().plan().run("sync")
    assert found["failure_case"].values.tolist() == [CASES[1]] * 3
    assert found["failure_method"].values.tolist() == ["exact"] * 3
    with pytest.raises(ValueError, match="refused by 'exact'"):
        exec(str(found["reproduce"].values[0]))


@pytest.mark.parametrize("columns", [["case"], ["case", "size"]])
def test_equal_texts_are_one_computation(calls, columns):
    def key(points):
        return np.stack([points[name].astype(str) for name in columns], axis=1)

    planned = sweep(CASES[2:], key=key).plan()
    assert planned.distinct == 2 * (3 if "size" in columns else 1)
    planned.run("sync")
    assert len(calls) == planned.distinct


def test_between_texts_nothing_is_refined():
    rule = Refinement("weight", levels=1)
    with pytest.raises(ValueError, match="method is of texts, between which nothing is interpolated"):
        refined(sweep(CASES[:1]), rule)
    found = refined(sweep(CASES[:1], METHODS[:1], np.linspace(1.0, 2.0, 9)), rule).plan().run("sync")
    np.testing.assert_allclose(found["weight"].values[0, 0], 7.0 * np.linspace(1.0, 2.0, 9))


def test_one_text_twice_and_what_is_no_text_are_refused():
    with pytest.raises(ValueError, match=r"takes the value .*fast.* twice"):
        sweep(methods=["fast", "exact", "fast"])
    with pytest.raises(ValueError, match="they must be numbers or texts"):
        Axis([None, "fast"])
