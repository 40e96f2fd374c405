"""Rows of results: which there are, their columns and their order."""

import json
import re

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from studies import runner
from studies.query import rows
from studies.query.columns import Columns
from studies.query.query import query, select
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
        ("kind != 'steady_sliding' and status == 'done'", lambda a, b: a % 3 != 1 and (a, b) != FAILS),
        ("size ** 2 > 1 and not a == 4", lambda a, b: a**2 * b > 1 and a != 4),
        ("a_name == 'three' and error != ''", lambda a, b: (a, b) == FAILS),
        ("top >= 9", lambda a, b: a >= 3),
        ("a < level and note == 'dry' and d1 == 50", lambda a, b: a < 2.5),
        ("whole > 7", lambda a, b: True),
        ("2 < 1", lambda a, b: False),
    ],
)
def test_where_chooses_rows(data, where, keep, monkeypatch):
    assert pairs(query(data, where)) == points(keep)
    # However few rows are in hand at once, and whether columns are read once or block by block.
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
    found = runner.open_dataset(f"{HOME}/results/reference/fig5/fig5.nc").pipe(
        query, "mu == 0.2 and growth_rate > 0"
    )
    assert list(found) == ["mu", "mode", "frequency", "growth_rate"]
    assert [round(f) for f in found["frequency"]] == [398, 2794]
    whole = query(runner.open_dataset(f"{HOME}/results/reference/fig6/fig6.nc"))
    assert list(whole) == ["mu", "mode", "frequency", "growth_rate"]
    assert len(whole) == 2 * 2001


def test_without_numbers_of_their_own_points_have_rows_of_the_first_entries(data):
    assert list(query(data[["mode_size", "member_kind"]])) == ["a", "b", "mode", "mode_size"]


def test_settings_have_the_units_that_are_declared():
    constants = {"rig": {"d1": 50.0, "p1": {"width": 0.02}}, "ramp": 1e-3, "settle": None}

    def units(study, *names):
        made = json.dumps({"axes": {}, "constants": constants})
        every = Columns(xr.Dataset(attrs={"sweep": study, "configuration": made}))
        return [every.find(name, "show").units for name in names]

    assert units("map", "d1", "p1_width", "ramp", "settle") == ["s-1", "m", "s", ""]
    assert units("fig5", "d1", "p1_width", "ramp") == ["s-1", "m", ""]
    assert units("scenes", "ramp", "settle") == ["s", "s"]
    assert units("none", "d1") == [""]


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


@pytest.fixture
def read(monkeypatch):
    """The columns whose values are read, in turn."""
    names, own = [], rows.Block._read
    monkeypatch.setattr(rows.Block, "_read", lambda *given: names.append(given[1].name) or own(*given))
    return names


def test_only_what_is_needed_is_read(data, read, monkeypatch):
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
    with pytest.warns(UserWarning, match="a == 2: a has no such value; the nearest is nan"):
        assert query(data.isel(a=[]), "a == 2").empty
    with pytest.raises(ValueError, match="not the result of a sweep"):
        query(data.drop_attrs())
    with pytest.raises(ValueError, match="not the result of a sweep"):
        query(xr.Dataset({"x": ("n", [1.0])}))


def test_what_is_not_known_is_told_with_the_nearest(data):
    for given, told in (
        ({"where": "sise > 1"}, "where = 'sise': no such column; did you mean size?"),
        ({"show": "a,shar"}, "show = 'shar': no such column; did you mean share?"),
        ({"sort": "-knid"}, "sort = 'knid': no such column; did you mean kind?"),
        ({"where": "zzz == 1"}, "no such column; there are a, b, size, "),
        ({"where": "kind == calm"}, "no such column; to compare with the word, write 'calm' in quotes"),
        ({"where": r"kind in ('calm', 'cal\')"}, r"kind is never 'cal\\\\'; did you mean calm\?"),
        ({"show": ""}, "show = '': it must be one name or more"),
        ({"show": "a,,b"}, "show = 'a,,b': it must be one name or more"),
        ({"show": []}, r"show = \[\]: it must be one name or more"),
        ({"sort": "a, "}, "sort = 'a, ': it must be one name or more"),
        ({"show": "a,b +"}, "show = 'b \\+': something is missing at its end"),
        ({"show": "a > 1"}, "show = 'a > 1': it is true or false; where = 'a > 1' chooses such rows"),
        ({"sort": "a > 1"}, "sort = 'a > 1': it is true or false"),
        ({"show": "'x'"}, "it is a text; a column has a name, or is calculated"),
        ({"sort": "-a b"}, "sort = 'a b': unexpected 'b' at column 3"),
        ({"sort": "-"}, "sort = '': it is empty"),
        ({"by": "sise"}, "by = 'sise': no such column; did you mean size?"),
        ({"by": ""}, "by = '': it must be one name or more"),
        ({"by": "a", "sort": "b"}, "sort = 'b': the grouped table has no such column; there are a, count"),
        ({"by": "a", "sort": "-coun"}, "sort = '-coun': the grouped table has no such column; did you mean count"),
        ({"limit": -1}, "limit = -1: it must be a whole number, 0 or above"),
        ({"limit": 2.5}, "limit = 2.5: it must be a whole number"),
        ({"limit": True}, "limit = True: it must be a whole number"),
        ({"where": 3}, "where = 3: it must be a text"),
    ):
        with pytest.raises(ValueError, match=told):
            query(data, **given)


@pytest.mark.parametrize(("name", "near"), [("time", "elapsed"), ("velocity_A", "velocity_B")])
def test_of_a_series_the_time_is_called_elapsed(name, near):
    data = runner.open_dataset(f"{HOME}/results/reference/fig7/fig7.nc")
    with pytest.raises(ValueError, match=rf"no such column; did you mean {near}\?$"):
        query(data, f"{name} == 1")


def test_a_number_that_an_axis_has_not_is_a_warning(data):
    with pytest.warns(UserWarning, match=r"a == 2\.1: a has no such value; the nearest is 2$") as told:
        assert len(query(data, "a == 2.1")) == 0
    assert told[0].filename == __file__
    with pytest.warns(UserWarning, match="side has no such value; did you mean left"):
        assert len(query(data, "side == 'lefft'", show="sided")) == 0


def test_too_many_rows_are_not_sorted(data, monkeypatch):
    monkeypatch.setattr(rows, "MOST_HELD", 19)
    with pytest.raises(ValueError, match="sort: more than 19 rows are to be sorted; give a limit"):
        query(data, sort="size")
    monkeypatch.setattr(rows, "MOST_HELD", 20)
    assert len(query(data, sort="size")) == 20
    monkeypatch.setattr(rows, "MOST_HELD", 10)
    monkeypatch.setattr(rows, "AT_ONCE", 2)
    assert len(query(data, sort="size", limit=3)) == 3


def test_columns_are_calculated(data):
    found = query(data, "a in (1, 3)", show="a*10, kind,(a + b) / 2,2 ** 3 ,-a", sort="-a*b,b")
    assert list(found) == ["a*10", "kind", "(a + b) / 2", "2 ** 3", "-a"]
    expected = sorted(points(lambda a, b: a in (1, 3)), key=lambda pair: (-pair[0] * pair[1], pair[1]))
    np.testing.assert_array_equal(found["a*10"], [10 * a for a, _ in expected])
    np.testing.assert_array_equal(found["(a + b) / 2"], [(a + b) / 2 for a, b in expected])
    assert set(found["2 ** 3"]) == {8.0}
    # A leading minus says descending, and is no part of the expression.
    assert query(data, show="a", sort="-a + 1")["a"].tolist() == [4.0, 3.0, 2.0, 1.0, 0.0]
    assert query(data, show="a", sort="1 - a")["a"].tolist() == [4.0, 3.0, 2.0, 1.0, 0.0]
    # A list, whose entries may hold commas only in texts and brackets; a name in brackets is the column.
    assert list(query(data, show=["(a)", "b"])) == ["a", "b"]
    assert query(data, show="1 + 1").to_dict("list") == {"1 + 1": [2.0]}
    # Whole numbers do not overflow, and what is missing stays so.
    found = query(data, "a == 3", show="count ** 9, share * 0")
    assert found["count ** 9"].tolist() == [30.0**9, 30.0**9, pytest.approx(np.nan, nan_ok=True), 30.0**9]
    assert np.isnan(found["share * 0"]).tolist() == [False, False, True, False]


def test_calculated_columns_run_along_further_dimensions(data):
    found = query(data, "a == 2 and b == 0.1", show="mode_size * 2")
    # Padding is left out: of three modes there are two. Division by zero is no padding.
    assert found.to_dict("list") == {"mode": [1, 2], "mode_size * 2": [6.0, 8.0]}
    found = query(data, "a == 2 and b == 0.1", show="mode_size / 0 - mode_size / 0")
    assert found["mode"].tolist() == [1, 2]
    assert list(query(data, show="mode_size", sort="-mode_size * top", limit=2)["mode_size"]) == [34.0, 24.0]
    for argument in ("show", "sort"):
        with pytest.raises(ValueError, match="they have no rows in common"):
            query(data, **{argument: "mode_size * peak_size"})
    assert list(query(data, sort="-a * b", limit=1))[-2:] == ["a * b", "status"]
    # Entries that are sorted by are shown, but for their coordinate, which has its own place.
    names = list(query(data, sort="-mode_size * 2,mode"))
    assert names == ["a", "b", "a_name", "mode", "mode_size", "mode_size * 2"]


def test_groups_are_those_of_pandas(data):
    shown = "count,mean:size,std:size,min:count,max:count,median:share,share:kind,share:size > 0.3,mean:a*b"
    found = query(data, "b > 0.005", by="a", show=shown)
    rows = query(data, "b > 0.005", show="a,b,size,count,share,kind")
    groups = rows.groupby("a")
    assert list(found) == [
        *("a", "count", "mean:size", "std:size", "min:count", "max:count", "median:share"),
        *("share:kind=calm", "share:kind=steady sliding", "share:kind=wild", "share:size > 0.3", "mean:a*b"),
    ]
    assert found["a"].tolist() == A.tolist()
    assert found["count"].tolist() == [3] * 5
    for name in ("mean:size", "std:size", "min:count", "max:count", "median:share"):
        function, _, column = name.partition(":")
        np.testing.assert_allclose(found[name], groups[column].agg(function), rtol=1e-7)
    # Of four rows one has no kind.
    assert found["share:kind=calm"].tolist() == [1.0, 0.0, 0.0, 2 / 3, 0.0]
    assert found["share:kind=steady sliding"].tolist() == [0.0, 1.0, 0.0, 0.0, 1.0]
    assert found["share:kind=wild"].tolist() == [0.0, 0.0, 1.0, 0.0, 0.0]
    above = rows.assign(above=rows["size"] > 0.3).groupby("a")["above"].mean()
    np.testing.assert_array_equal(found["share:size > 0.3"], above)
    np.testing.assert_allclose(found["mean:a*b"], A * np.mean(B[1:]))


def test_groups_by_words_settings_and_more_than_one_column(data):
    found = query(data, by="kind,status")
    assert found["kind"].cat.categories.tolist() == ["calm", "steady sliding", "wild"]
    # What is missing makes a group, the last.
    assert found["kind"].tolist()[:3] == ["calm", "steady sliding", "wild"]
    assert found["kind"].isna().tolist() == [False, False, False, True]
    assert found["status"].tolist() == ["done", "done", "done", "failed"]
    assert found["count"].tolist() == [7, 8, 4, 1]
    assert query(data, by="note,level").to_dict("list") == {"note": ["dry"], "level": [2.5], "count": [20]}
    assert query(data, by=["a_name"], show=["count"])["a_name"].tolist() == ["four", "nil", "one", "three", "two"]
    # A key may be shown too, and be averaged.
    assert list(query(data, by="a", show="a,mean:a")) == ["a", "mean:a"]
    assert query(data, by="b", show="mean:top")["mean:top"].tolist() == [6.0] * 4
    # Every point is a row, whatever runs along fewer dimensions.
    assert query(data, by="a", show="count,mean:top")["count"].tolist() == [4] * 5


def test_groups_of_entries(data):
    found = query(data, by="mode", show="count,max:mode_size")
    # Those without a value are padding, and no rows.
    assert found.to_dict("list") == {"mode": [1, 2, 3], "count": [15, 11, 7], "max:mode_size": [14.0, 24.0, 34.0]}
    assert query(data, "mode_size == nan or mode_size != nan", by="mode", show="count,mean:mode_size")[
        "count"
    ].tolist() == [20, 20, 20]
    assert query(data, by="member_kind")["count"].tolist() == [11, 15, 12]
    assert query(data, by="peak", show="count,mean:peak_size")["mean:peak_size"].tolist() == [2.0, 3.0]
    assert query(data, by="peak", show="count,mean:peak_size")["count"].tolist() == [1, 1]
    assert query(data, "mode == 2", by="a")["count"].tolist() == [4] * 5
    with pytest.raises(ValueError, match="they have no rows in common"):
        query(data, by="mode", show="share:member_kind")


@pytest.mark.parametrize("few", [1, 7, 10_000])
def test_groups_are_sorted_and_limited(data, few, monkeypatch):
    monkeypatch.setattr(rows, "AT_ONCE", few)
    found = query(data, by="a,kind", show="count,mean:size", sort="-mean:size", limit=2)
    assert found["a"].tolist() == [4.0, 3.0]
    assert query(data, by="kind", sort="count,-kind")["count"].tolist() == [1, 4, 7, 8]
    assert query(data, by="b", sort="-b", limit=3)["b"].tolist() == B[:0:-1].tolist()
    assert query(data, by="a", limit=0).empty
    assert query(data, "a > 9", by="kind", show="mean:size").empty
    assert list(query(data, "a > 9", by="kind", show="mean:size")) == ["kind", "mean:size"]
    # The limit is of groups, not of rows.
    assert query(data, by="a", limit=1)["count"].tolist() == [4]


def test_units_and_whole_numbers_of_groups(data):
    shown = "count,mean:size,std:a*1,min:count,max:count,median:count,mean:count,share:kind"
    columns = {column.name: column for column in select(data, by="a", show=shown).columns}
    assert [column.units for column in columns.values()] == ["m", "", "m", *[""] * 8]
    whole = [name for name, column in columns.items() if column.whole]
    assert whole == ["count", "min:count", "max:count"]
    # The least and the greatest are values of the column; means are calculated in full precision.
    found = query(data, "a > 0", by="b", show="min:share,max:share,mean:share,std:share")
    assert [str(kind) for kind in found.dtypes] == ["float64", "float32", "float32", "float64", "float64"]


@pytest.mark.parametrize(
    ("show", "message"),
    [
        ("mean:kind", "show = 'mean:kind': kind is a word, and its codes have no mean; use share:kind"),
        ("median:status", "status is a word, and its codes have no median; use share:status"),
        ("std:a_name", "show = 'std:a_name': a_name is a text, which has no std"),
        ("share:a_name", "share is of words or of what is true, like share:regime or"),
        ("share:a", "share is of words or of what is true"),
        ("mean:a > 1", "it is true or false; use share:a > 1"),
        ("mean", "show = 'mean': with by it must be count, or mean, std, min, max, median or share of a column"),
        ("mean:", "with by it must be count"),
        ("sum:a", "with by it must be count"),
        ("size", "with by it must be count"),
        ("mean:sise", "show = 'sise': no such column; did you mean size?"),
    ],
)
def test_statistics_that_there_are_not(data, show, message):
    with pytest.raises(ValueError, match=f"^[^\n]*{re.escape(message)}[^\n]*$"):
        query(data, by="b", show=show)


def test_groups_read_only_what_they_need(data, read):
    query(data, "b == 0.1", by="a", show="mean:size*2,share:kind")
    assert sorted(read) == ["a", "b", "kind", "size"]


def test_a_standard_error_is_shown_where_it_is_asked_for(data):
    known = data.assign(size_se=0.1 * data["size"].astype(float))
    assert list(query(known)) == list(query(data))
    assert list(query(known, show="size,size_se")) == ["size", "size_se"]
    assert "size_se" in query(known, where="size_se > 0")
