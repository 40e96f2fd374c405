"""Axes of texts of a study: how they are asked for, stated, and queried."""

import numpy as np
import pytest

import studies
from studies import spec
from studies.query.query import query
from studies.report import commands
from studies.study import Study
from sweeps import Axis, Grid, Sweep, Variable

CASES = ["touching", "tangent, missed", "tangent", "mu = 0"]


def letters(points):
    return {"letters": np.char.str_len(points["case"])}


def build(axes, settings):
    return Sweep("own_letters", letters, Grid(dict(axes)), {"letters": Variable(dtype="int16")}, title="Letters")


STUDY = Study(
    name="own_letters",
    title="Letters",
    question="How many letters?",
    paper="None.",
    axes={"case": Axis(CASES, long_name="case"), "method": Axis(["fast", "exact"], long_name="method")},
    settings={},
    build=build,
    draw=lambda dataset: None,
    findings=lambda dataset: [],
)


@pytest.mark.parametrize(
    ("text", "texts"),
    [
        ("touching", ["touching"]),
        ("tangent, missed", ["tangent, missed"]),
        ("tangent,touching", ["tangent", "touching"]),
        ("mu = 0, tangent, missed ,tangent", ["mu = 0", "tangent, missed", "tangent"]),
        ("nothing,touching", ["nothing,touching"]),
        ("touching,nothing", ["touching", "nothing"]),
    ],
)
def test_a_list_of_texts_is_read(text, texts):
    assert spec.assignment(f"case={text}", STUDY.texts) == ("case", texts)
    assert spec.assignment("V=1,2", STUDY.texts)[1].tolist() == [1.0, 2.0]


def test_texts_come_in_the_order_of_the_study_each_once():
    given = {"case": ["tangent", "touching", "tangent"], "method": "exact"}
    found = STUDY.sweep(given).plan().run("sync")
    assert found["case"].values.tolist() == ["touching", "tangent"]
    assert found["method"].values.tolist() == ["exact"]
    assert found["letters"].values.tolist() == [[8], [7]]


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("tangnt", r"case = 'tangnt': there is no such case; did you mean tangent\?$"),
        (["tangent", "x"], "case = 'x': there is no such case; it must be one of touching, tangent, missed, tang"),
        (1, "case = 1: there is no such case"),
        ([["tangent"], ["x"]], "case = 'x': there is no such case"),
    ],
)
def test_a_text_that_the_axis_does_not_have_is_refused(value, message):
    with pytest.raises(ValueError, match=message):
        STUDY.sweep({"case": value})


def test_a_study_states_its_texts():
    case, method = STUDY.statement().splitlines()[1:]
    assert case.split() == ["axis", "case", "4", "texts", "case"]
    assert method.split() == ["axis", "method", "fast,", "exact", "method"]


def test_rows_are_chosen_by_texts():
    data = STUDY.sweep({}).plan().run("sync")
    rows = query(data, "case == 'tangent, missed' and method != 'fast'")
    assert rows[["case", "method", "letters"]].values.tolist() == [["tangent, missed", "exact", 15]]
    rows = query(data, "letters > 7 and method == 'exact'", show=["case"], sort=["-case"])
    assert rows["case"].tolist() == ["touching", "tangent, missed"]
    with pytest.warns(UserWarning, match="case has no such value; did you mean"):
        assert query(data, "case == 'tangents'").empty


def test_a_study_of_texts_is_run_and_opened(tmp_path, monkeypatch):
    monkeypatch.setattr("studies.runner.plot", lambda *arguments, **options: None)
    found = studies.run(STUDY, out=tmp_path, case=["tangent", "tangent, missed"])
    again = studies.open("own_letters", out=tmp_path)
    assert found.equals(again)
    assert again.fiv.query("case == 'tangent'")["letters"].tolist() == [7, 7]
    assert commands.again(found).whole == "fiv run own_letters --set case='tangent, missed,tangent'"
