"""Rows of results: which there are, their columns and their order."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from studies import runner
from studies.query import rows
from studies.query.query import query
from tests import HOME
from tests.helpers.trials import FAILS, A, B, pairs, points


def test_the_points_are_the_rows(data):
    found = query(data)
    assert list(found) == ["a", "b", "a_name", "size", "share", "kind", "count", "status"]
    assert pairs(found) == points(lambda a, b: True)
    done = found[found["status"] == "done"]
    np.testing.assert_array_equal(done["size"], done["a"] * np.sqrt(done["b"]))
    assert list(found["a_name"][:5]) == ["nil"] * 4 + ["one"]
    assert found["kind"].cat.categories.tolist() == ["calm", "steady sliding", "wild"]
    # The point that failed is there, without values.
    (failed,) = np.flatnonzero(found["status"] == "failed")
    assert pairs(found)[failed] == FAILS
    assert found.loc[failed, ["size", "count", "kind"]].isna().all()


@pytest.mark.parametrize(
    ("where", "keep"),
    [
        ("a == 2 and b > 0.05", lambda a, b: a == 2 and b > 0.05),
        ("a == 2.0000001 or b == 0.0999999", lambda a, b: a == 2 or b == 0.1),
        ("kind == 'steady sliding'", lambda a, b: a % 3 == 1),
        ("kind != 'steady_sliding' and status == 'done'", lambda a, b: a % 3 != 1 and (a, b) != FAILS),
        ("size ** 2 > 1 and not a == 4", lambda a, b: a**2 * b > 1 and a != 4),
        ("a_name == 'three' and error != ''", lambda a, b: (a, b) == FAILS),
        ("share == nan", lambda a, b: a == 0 or (a, b) == FAILS),
        ("top >= 9", lambda a, b: a >= 3),
        ("a < level and note == 'dry' and d1 == 50", lambda a, b: a < 2.5),
        ("p1_length * 20 == a", lambda a, b: a == 1),
        ("whole > 7", lambda a, b: True),
        ("1 < 2", lambda a, b: True),
        ("2 < 1", lambda a, b: False),
        ("count == a * 10", lambda a, b: (a, b) != FAILS),
    ],
)
def test_where_chooses_rows(data, where, keep, monkeypatch):
    assert pairs(query(data, where)) == points(keep)
    # However few rows are in hand at once.
    for few in (1, 3, 7):
        monkeypatch.setattr(rows, "AT_ONCE", few)
        assert pairs(query(data, where)) == points(keep)


def test_a_single_precision_number_is_what_it_is_written_as(data):
    wanted = float(str(np.float32(0.1 / 3.0)))
    assert pairs(query(data, f"share == {wanted!r}")) == points(
        lambda a, b: b == 0.1 and a > 0 and (a, b) != FAILS
    )


def test_a_variable_on_a_further_dimension_makes_rows_of_its_entries(data):
    found = query(data, "a == 2 and b == 0.1", show="a,b,mode_size")
    assert list(found) == ["a", "b", "mode", "mode_size"]
    # Of three modes there are two: the third is padding.
    assert found["mode"].tolist() == [1, 2]
    np.testing.assert_allclose(found["mode_size"], [3.0, 4.0])
    filled = query(data, "a == 2 and b == 0.1 and (mode_size == nan or mode_size != nan)", show="a,mode,mode_size")
    assert filled["mode"].tolist() == [1, 2, 3]
    # In an expression too, with all that runs along it.
    found = query(data, "member_kind == 'wild' and b == 1")
    assert list(found) == ["a", "b", "a_name", "member", "member_kind"]
    assert list(zip(found["a"], found["member"], strict=True)) == [(1, 2), (2, 1), (4, 2)]
    found = query(data, "mode == 2 and b == 1")
    assert list(found) == ["a", "b", "a_name", "mode", "mode_size"]
    assert found["a"].tolist() == [2, 3, 4]
    # A text names its entries.
    assert query(data, "side == 'left'", show="a,side,sided", limit=2)["sided"].tolist() == [0.0, 0.0]
    assert query(data, "kind == member_kind", show="a,b")["member"].unique().tolist() == [1]


def test_rows_run_along_what_is_asked_for_only(data):
    assert query(data, show="a")["a"].tolist() == A.tolist()
    assert query(data, show="top,a_name", sort="-top", limit=2)["a_name"].tolist() == ["four", "three"]
    assert query(data, "a > 2", show="top")["top"].tolist() == [9.0, 16.0]
    assert query(data, show="whole,level,note").to_dict("list") == {
        "whole": [7.5],
        "level": [2.5],
        "note": ["dry"],
    }
    # What has nothing to do with the points, its entries counted.
    assert query(data, show="peak_size").to_dict("list") == {"peak": [0, 1], "peak_size": [2.0, 3.0]}
    assert list(query(data, "peak == 1")) == ["a", "b", "a_name", "peak", "peak_size"]
    assert query(data, "peak_size > 2").to_dict("list") == {"peak": [1], "peak_size": [3.0]}
    assert query(data, show="failure_a,failure_b").to_dict("list") == {
        "failure": [0],
        "failure_a": [FAILS[0]],
        "failure_b": [FAILS[1]],
    }


def test_what_has_no_rows_in_common_is_refused(data):
    with pytest.raises(ValueError, match="member_kind runs along member and mode_size runs along mode"):
        query(data, "member_kind == 'wild'", show="a,mode_size")


def test_without_numbers_of_their_own_points_have_rows_of_entries():
    found = runner.open_dataset(f"{HOME}/results/fig5/fig5.nc").pipe(query, "mu == 0.2 and growth_rate > 0")
    assert list(found) == ["mu", "mode", "frequency", "growth_rate"]
    assert [round(f) for f in found["frequency"]] == [398, 2794]
    whole = query(runner.open_dataset(f"{HOME}/results/fig6/fig6.nc"))
    assert list(whole) == ["mu", "mode", "frequency", "growth_rate"]
    assert len(whole) == 2 * 2001


@pytest.mark.parametrize("limit", [None, 0, 1, 7, 100])
@pytest.mark.parametrize("few", [1, 6, 10_000])
def test_sort_and_limit(data, limit, few, monkeypatch):
    monkeypatch.setattr(rows, "AT_ONCE", few)
    whole = query(data)
    for sort, ascending in (("size", [True]), ("-share,b", [False, True]), ("-count,-size", [False, False])):
        names = [name.removeprefix("-") for name in sort.split(",")]
        expected = whole.sort_values(names, ascending=ascending, kind="stable", na_position="last")[:limit]
        pd.testing.assert_frame_equal(query(data, sort=sort, limit=limit), expected.reset_index(drop=True))
    texts = query(data, show="a_name", sort="-a_name", limit=limit)["a_name"].tolist()
    assert texts == ["two", "three", "one", "nil", "four"][:limit]
    assert pairs(query(data, "a > 0", limit=limit)) == points(lambda a, b: a > 0)[:limit]
    # A column that is not shown.
    assert query(data, show="a", sort="-top", limit=limit)["a"].tolist() == [4.0, 3.0, 2.0, 1.0, 0.0][:limit]


def test_words_are_sorted_as_the_file_has_them(data):
    found = query(data, sort="-kind,a", show="a,b,kind")["kind"]
    assert found[:19].tolist() == ["wild"] * 4 + ["steady sliding"] * 8 + ["calm"] * 7
    assert found[19:].isna().all()
    states = query(data, sort="-status", show="a,b,status")["status"].tolist()
    assert states == ["failed"] + ["done"] * 19


def test_only_what_is_needed_is_read(data, monkeypatch):
    read = []
    own = rows.Source._array

    def logged(self, column, block):
        read.append(column.name)
        return own(self, column, block)

    monkeypatch.setattr(rows.Source, "_array", logged)
    monkeypatch.setattr(rows, "AT_ONCE", 4)
    query(data, "size > 1e6 and a == 3", show="a,share")
    # The axis decides first: of five blocks one is looked into.
    assert read == ["a"] * 3 + ["a", "size"] + ["a"]
    read.clear()
    query(data, "a >= 0", show="share", limit=2)
    assert read == ["a", "share"]


def test_a_part_of_a_result_and_one_opened_by_xarray(file, data):
    with xr.open_dataset(file) as plain:
        pd.testing.assert_frame_equal(query(plain, "a > 1"), query(data, "a > 1"))
    part = data.sel(a=2.0)
    assert pairs(query(part, "size > 0 and a == 2")) == [(2.0, b) for b in B]
    assert pairs(query(data.isel(a=[1, 2], b=[0]))) == [(1.0, 1e-3), (2.0, 1e-3)]
    with pytest.raises(ValueError, match="not the result of a sweep"):
        query(data.drop_attrs())
    with pytest.raises(ValueError, match="not the result of a sweep"):
        query(xr.Dataset({"x": ("n", [1.0])}))


def test_what_is_not_known_is_told_with_the_nearest(data):
    for given, told in (
        ({"where": "sise > 1"}, "where = 'sise': nothing is called so; did you mean size?"),
        ({"show": "a,shar"}, "show = 'shar': nothing is called so; did you mean share?"),
        ({"sort": "-knid"}, "sort = 'knid': nothing is called so; did you mean kind?"),
        ({"where": "zzz == 1"}, "nothing is called so; there are a, b, size, "),
        ({"show": ""}, "show = '': it must be one name or more"),
        ({"show": "a,,b"}, "show = 'a,,b': it must be one name or more"),
        ({"show": []}, r"show = \[\]: it must be one name or more"),
        ({"sort": "a, "}, "sort = 'a, ': it must be one name or more"),
        ({"limit": -1}, "limit = -1: it must be a whole number, 0 or above"),
        ({"limit": 2.5}, "limit = 2.5: it must be a whole number"),
        ({"limit": True}, "limit = True: it must be a whole number"),
        ({"where": 3}, "where = 3: it must be a text"),
    ):
        with pytest.raises(ValueError, match=told):
            query(data, **given)


def test_a_number_that_an_axis_has_not_is_a_warning(data):
    with pytest.warns(UserWarning, match=r"a == 2\.1: a has no such value; the nearest is 2$") as told:
        assert len(query(data, "a == 2.1")) == 0
    assert told[0].filename == __file__
    with pytest.warns(UserWarning, match="side has no such value; did you mean left"):
        assert len(query(data, "side == 'lefft'", show="sided")) == 0


def test_too_many_rows_are_not_sorted(data, monkeypatch):
    monkeypatch.setattr(rows, "MOST_SORTED", 10)
    with pytest.raises(ValueError, match="sort: more than 10 rows are to be sorted; give a limit"):
        query(data, sort="size")
    monkeypatch.setattr(rows, "AT_ONCE", 2)
    assert len(query(data, sort="size", limit=3)) == 3
