"""Which rows a query has, their columns and order; groups; how rows are written."""

import io
import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from studies.query import query
from studies.query.query import select, text
from sweeps import InputError
from tests import HOME
from tests.query.trial import FAILED, A, places, trial

DATA = trial()


def test_the_points_are_the_rows():
    rows = select(DATA)
    assert [*rows] == ["a", "b", "name", "size", "share", "kind", "sure", "status"]
    assert places(rows) == [*range(20)]
    assert rows["kind"].cat.categories.tolist() == ["calm", "steady sliding", "wild"]
    (failed,) = np.flatnonzero(rows["status"] == "failed")
    assert (rows["a"][failed], rows["b"][failed]) == FAILED
    assert rows.loc[failed, ["size", "share", "kind"]].isna().all()
    assert select(DATA, "error != ''", "a,error")["error"][0].startswith("ValueError")
    # What is named besides has a column; a standard error only where it is named.
    assert [*select(DATA, "size_se > 0", sort="-wall_time")][-3:] == ["size_se", "wall_time", "status"]
    assert rows.attrs["units"] == {"a": "m s-1", "b": "s", "size": "m"}


ROWS = [
    # Rows run along what is shown, and the coordinate of a further dimension is a column.
    ({"show": "a"}, {"a": A.tolist()}),
    ({"show": "level, method"}, {"level": [2.5], "method": ["fast"]}),
    ({"show": "peak_size"}, {"peak": [0, 1], "peak_size": [2, 3]}),
    ({"where": "peak_size > 2"}, {"peak": [1], "peak_size": [3]}),
    ({"where": "peak == 1 and b == 1", "show": "a"}, {"peak": [1] * 5, "a": A.tolist()}),
    ({"where": "side == 'left' and a > 3", "show": "sided", "limit": 1}, {"side": ["left"], "sided": [4]}),
    # Entries without a value are left out, unless the condition has nan.
    ({"where": "a == 2 and b == 0.1", "show": "mode_size"}, {"mode": [1, 2], "mode_size": [3, 4]}),
    ({"where": "a == 1 and b == 1 and top != nan", "show": "mode,mode_size*0"}, {"mode": [1, 2, 3]}),
    ({"where": "mode == 3 and b == 1", "show": "mode, a*10"}, {"a*10": [0, 10, 20, 30, 40]}),
    ({"where": "member_kind == 'wild' and b == 1", "show": "a"}, {"member": [2, 1, 2], "a": [1, 2, 4]}),
    # Columns are calculated; texts and brackets may have commas.
    ({"where": "a in (1, 3) and b == 1", "show": "(a + b)/2, a in (1, 2)"}, {"a in (1, 2)": [True, False]}),
    ({"show": ["a", "'x, y'"], "where": "a == 1"}, {"'x, y'": ["x, y"]}),
    ({"show": "((a + 1) * 2) in (2, 4)", "limit": 2}, {"((a + 1) * 2) in (2, 4)": [True, True]}),
    # Order: several columns, calculated ones, words as the file has them, missing values last.
    ({"show": "a", "sort": "-top", "limit": 2}, {"a": [4, 3]}),
    ({"show": "a", "sort": "-(a - 1) ** 2, -a", "limit": 3}, {"a": [4, 3, 2]}),
    ({"show": "a,b", "sort": "-kind, b, -a", "limit": 3}, {"a": [2, 2, 2], "b": [0.001, 0.01, 0.1]}),
    ({"show": "a,b,share", "sort": "share,-b", "where": "a > 2 and b > 0.05"}, {"b": [0.1, 1, 1, 0.1]}),
    ({"show": "a,share", "sort": "-share", "where": "a in (0, 4)"}, {"a": [4] * 4 + [0] * 4}),
    ({"show": "a", "limit": 0}, {"a": []}),
]


@pytest.mark.parametrize(("options", "expected"), ROWS)
def test_rows(options, expected):
    rows = select(DATA, **options)
    assert {name: rows[name].tolist() for name in expected} == expected
    assert rows.index.equals(pd.RangeIndex(len(rows)))
    assert len(expected) == 1 or [*rows][: len(expected)] == [*expected]


def test_entries_are_shown_with_the_axes():
    assert [*select(DATA, "mode == 2")] == ["a", "b", "name", "mode", "mode_size"]
    # Where a point has no value of its own, the first variable with entries is shown; without a status too.
    assert [*select(DATA[["mode_size", "member_kind"]])] == ["a", "b", "name", "mode", "mode_size"]
    assert [*select(DATA[["status"]])] == ["a", "b", "name", "status"]
    assert [*select(DATA.drop_vars(["size", "share", "kind", "sure", "size_se"]))][-1] == "mode_size"
    assert [*select(DATA.isel(a=1))] == ["b", "size", "share", "kind", "sure", "status"]
    assert select(DATA.isel(a=1, b=0), show="a,size").values.tolist() == [[1, np.sqrt(1e-3)]]
    assert [*select(DATA.isel(a=1, b=0))] == ["size", "share", "kind", "sure", "top", "status"]


def test_groups_are_those_of_pandas():
    shown = "count,mean:size,std:size,min:size,max:a*2,median: share,share:kind,share:size > 0.3,kind"
    rows = select(DATA, "b > 0.005", "a,b,size,share,kind").astype({"share": float})
    found = select(DATA, "b > 0.005", shown, by="kind", sort="-count", limit=3)
    groups, words = rows.groupby("kind", dropna=False, observed=True), rows["kind"].cat.categories
    expected = {
        "count": groups.size(),
        **{f"{name}:size": groups["size"].agg(name) for name in ("mean", "std", "min")},
        **{"max:a*2": 2 * groups["a"].max(), "median: share": groups["share"].median()},
        **{f"share:kind={word}": groups["kind"].agg(lambda g, w=word: (g == w).mean()) for word in words},
        "share:size > 0.3": groups["size"].agg(lambda g: (g > 0.3).mean()),
    }
    expected = pd.DataFrame(expected).sort_values("count", ascending=False, kind="stable")[:3].reset_index()
    pd.testing.assert_frame_equal(found, expected, check_dtype=False)
    assert found.attrs["units"] == {"mean:size": "m", "std:size": "m", "min:size": "m"}
    # By default the number of rows, in the order of the keys; missing keys are a group, points count once.
    assert select(DATA, by="kind")["count"].tolist() == [7, 8, 4, 1]
    assert select(DATA, by="a > 2", show="count,max:top").values.tolist() == [[False, 12, 4], [True, 8, 16]]
    assert select(DATA, by="mode", show="count,min:mode_size")["count"].tolist() == [15, 11, 7]
    assert select(DATA, by="peak", show="count,max:peak_size").values.tolist() == [[0, 1, 2], [1, 1, 3]]
    assert select(DATA, "a > 9", by="kind", show="count,median:size").empty


REFUSED = [
    ({"show": "a,shar"}, "show = 'shar': no such column; did you mean share?"),
    ({"show": ""}, "show = '': it must be columns with commas between them"),
    ({"sort": "a, "}, "sort = 'a, ': it must be columns"),
    ({"by": []}, "by = []: it must be columns"),
    ({"show": "a,b +"}, "show = 'b +': invalid syntax"),
    ({"sort": "size DESC"}, "sort = 'size DESC': a minus before the name sorts descending"),
    ({"sort": "-knd"}, "sort = 'knd': no such column; did you mean kind?"),
    ({"show": "a, -kind"}, "show = 'kind': it is a text, and must be a number"),
    ({"by": "a", "show": "size"}, "show = 'size': with by it is count, or mean, std"),
    ({"by": "a", "show": "sum:size"}, "show = 'sum:size': with by it is count"),
    ({"by": "a", "show": "mean:kind"}, "show = 'mean:kind': it is a text; share is of words"),
    ({"by": "a", "show": "share:size"}, "show = 'share:size': it is a number; share is of words"),
    ({"by": "a", "sort": "-b"}, "sort = 'b': the grouped table has only a, count"),
    ({"limit": -1}, "limit = -1: it must be a whole number, 0 or above"),
    ({"limit": 2.5}, "limit = 2.5: it must be a whole number"),
    ({"where": "member_kind == 'wild'", "show": "mode_size"}, "run along different dimensions"),
]


@pytest.mark.parametrize(("options", "message"), REFUSED)
def test_refusals(options, message):
    with pytest.raises(InputError) as problem:
        select(DATA, **options)
    assert message in str(problem.value)


def test_only_what_is_named_is_read_and_too_much_is_refused(tmp_path, monkeypatch):
    DATA.to_netcdf(tmp_path / "trial.nc")
    with xr.open_dataset(tmp_path / "trial.nc") as data:
        assert places(select(data, "size > 0.5 and a == 2 and b == 1", "a,b")) == [11]
        loaded = {name for name, variable in data.variables.items() if variable._in_memory}
        assert not loaded & {"size", "share", "kind", "mode_size", "error", "wall_time"}
    # A condition along one dimension comes first.
    monkeypatch.setattr(query, "MOST_ROWS", 4)
    assert places(select(DATA, "size > 0.5 and a == 2", "a,b")) == [10, 11]
    for where, count in (("size > 0.5 and b == 1", 5), ("a == 2 or b == 1", 20)):
        with pytest.raises(InputError, match=f"^{count} rows are more than 4: select along a, like 'a == 0.0'"):
            select(DATA, where)


def test_the_reference_has_the_rows_that_it_had():
    with xr.open_dataset(HOME / "results/reference/fig5/fig5.nc") as data:
        data = data.assign_coords(theta=((), 5.0, {"units": "degree"}))
        rows = select(data, "mu == 0.2 and growth_rate > 0 and theta == 5")
        assert [*rows] == ["mu", "mode", "frequency", "growth_rate"]
        assert [round(f) for f in rows["frequency"]] == [398, 2794]
        assert select(data, show="onset_mu")["onset"].tolist() == [1, 2, 3]
    with xr.open_dataset(HOME / "results/reference/regimes/regimes.nc") as data:
        shares = select(data, by="regime", sort="-count")
        assert shares["count"].sum() == data["status"].size


SHOWN = {"where": "a >= 3 and b >= 0.1", "show": "a, size*1, share, kind, sure, error"}


def test_csv_reads_back_in_full_precision():
    rows = select(DATA, show="a,b,size,share,kind,error")
    written = text(rows, "csv")
    assert written.count("\r\n") == 21
    read = pd.read_csv(io.StringIO(written, newline=""), dtype=str).fillna({"error": ""})
    pd.testing.assert_frame_equal(read.astype(rows.dtypes), rows, check_exact=True, check_dtype=False)
    assert text(rows, "csv", units=True).startswith("a [m s-1],b [s],size [m],share,kind,error\r\n")


def test_json_is_a_list_of_objects():
    rows = json.loads(text(select(DATA, **SHOWN), "json"), parse_constant=pytest.fail)
    assert {name for name, value in rows[0].items() if value is None} == {"size*1", "share", "kind"}
    assert rows[1] == {"a": 3, "size*1": 3, "share": np.float32(1 / 3), "kind": "calm", "sure": True, "error": ""}
    assert json.loads(text(select(DATA, "a == 0", "1/a, -1/a"), "json")) == [{"1/a": None, "-1/a": None}]
    with_units = json.loads(text(select(DATA, "a > 9", "a,kind"), "json", units=True))
    assert with_units == {"units": {"a": "m s-1"}, "rows": []}
    assert text(select(DATA, "a > 9"), "json") == "[]\n"


def test_a_table_is_aligned():
    lines = text(select(DATA, **SHOWN), "table").splitlines()
    assert len({*map(len, lines)}) == 1
    assert [line.split() for line in lines] == [
        ["a", "size*1", "share", "kind", "sure", "error"],
        ["3", "-", "-", "-", "True", "ValueError:", '"really";', "none"],
        ["3", "3", "0.333333", "calm", "True"],
        ["4", "1.26491", "0.0333333", "steady", "sliding", "True"],
        ["4", "4", "0.333333", "steady", "sliding", "True"],
    ]
    head, *_ = text(select(DATA, show="a,top,sure", limit=1), "table", units=True).splitlines()
    assert head.split() == ["a", "[m", "s-1]", "top", "sure"]
    assert text(select(DATA, "a > 9", "a,b"), "table") == "a  b\n"
    assert max(map(len, text(select(DATA), "table", width=40).splitlines())) <= 40
