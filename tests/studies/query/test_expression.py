"""Expressions: what they mean beside Python's own reading of them, and what they never do.

`expressions.json` has what each form selects, and why each other is refused (`test_shared_expressions.py`).
"""

import ast
import os

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from studies.query.columns import NUMBER, TEXT, WORDS, Column
from studies.query.evaluate import condition
from studies.query.language import DEEPEST, LONGEST, parse
from studies.query.nearest import nearest

AXIS = np.array([0.0, 1.0, 2.0, 5.0])
COLUMNS = {
    "x": Column("x", NUMBER, ("x",), axis=True, values=AXIS),
    "y": Column("y", NUMBER, ("x",)),
    "z": Column("z", NUMBER, ("x",)),
    "kind": Column("kind", WORDS, ("x",), words={0: "calm", 1: "steady sliding", 2: "wild"}, whole=True),
    "told": Column("told", TEXT, ("x",)),
}
VALUES = {
    "x": AXIS,
    "y": np.array([3.0, np.nan, -2.0, 0.5]),
    "kind": np.array([0.0, 1.0, np.nan, 2.0]),
    "told": np.array(["", "a", "b c", "a"], dtype=object),
}


def chosen(text, values=VALUES, note=lambda text: None):
    expression = parse(text)
    for name in expression.names():
        assert name in COLUMNS
    found = condition(expression, COLUMNS, note, expression.tree)(values)
    return np.flatnonzero(np.broadcast_to(found, AXIS.shape)).tolist()


def refused(text):
    with pytest.raises(ValueError, match=r"^where = ") as problem:
        chosen(text)
    said = str(problem.value)
    assert said.isprintable()
    assert len(said) < 500
    return said


@pytest.mark.parametrize("text", ["__import__('os').system('touch owned')", "open('owned', 'w')"])
def test_nothing_is_executed(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "nothing can be called" in refused(text)
    assert os.listdir(tmp_path) == []


def test_what_is_long_or_deep_is_refused_at_once():
    assert f"it has 1000004 letters; it may have {LONGEST}" in refused("x == " + "1" * 999_999)
    # Of brackets and of signs the shared list says the same.
    for text in ("not " * (DEEPEST + 1) + "x == 1", "x == " + "2 ** " * (DEEPEST + 1) + "1"):
        assert f"more than {DEEPEST} levels are within each other" in refused(text)
    # As long as it may be: wide is not deep.
    assert chosen(" or ".join(["x == 1"] * 399)) == [1]
    assert chosen("x == 1" + " + 0" * 990) == [1]


def test_the_parts_of_an_expression_are_those_that_were_written():
    expression = parse(" μ == 1 and (b == '\\' or c == 3) and not d == b\n")
    assert [expression.part(part) for part in expression.tree.values] == [
        "μ == 1",
        "b == '\\' or c == 3",
        "not d == b",
    ]
    assert expression.names() == ["μ", "b", "c", "d"]
    assert expression.names(expression.tree.values[1]) == ["b", "c"]


@pytest.mark.parametrize(
    ("text", "rows", "told"),
    [
        ("x == 5.0000001", [3], None),
        ("x == 5.0029", [3], None),
        ("4.9971 == x", [3], None),
        ("x == 5.01", [], "x == 5.01: x has no such value; the nearest is 5"),
        ("x == 1e9", [], "x == 1e9: x has no such value; the nearest is 5"),
        ("x == -(3 + 4)", [], "the nearest is 0"),
        ("x == 5.01 or x == 1", [1], "the nearest is 5"),
    ],
)
def test_equality_with_a_number_finds_the_nearest_value_of_an_axis(text, rows, told):
    notes = []
    assert chosen(text, note=notes.append) == rows
    assert [told in note for note in notes] == ([] if told is None else [True])


def test_the_rule_of_the_nearest_value():
    assert nearest([0.1, 0.2, 0.3], 0.1 + 0.2) == (0.3, True)
    # A thousandth of the distance to the nearest neighbour, which is on the left here.
    assert nearest([1.0, 2.0, 12.0], 2.0009) == (2.0, True)
    assert nearest([1.0, 2.0, 12.0], 2.0011) == (2.0, False)
    assert nearest([12.0, 2.0, 1.0], 11.9901) == (12.0, True)
    logarithmic = np.geomspace(1e-4, 1e-2, 201)
    for value in logarithmic:
        assert nearest(logarithmic, float(f"{value:.6g}")) == (value, True)
        assert nearest(logarithmic, 1.001 * value)[1] is False
    assert nearest([5.0], 5.000004) == (5.0, True)
    assert nearest([5.0], 5.00001) == (5.0, False)
    assert nearest([0.0], 1e-9) == (0.0, False)
    assert nearest([0.0, 1.0], 1e-9) == (0.0, True)
    assert nearest([1, 2, 3], 2.0) == (2, True)
    assert nearest([1, 2, 3], float("nan"))[1] is False
    assert nearest([1, 2, 3], float("inf"))[1] is False


class Wrapped(ast.NodeTransformer):
    """Numbers become NumPy's, so that 0 / 0 is NaN; what is missing is not unequal either."""

    def visit_Constant(self, node):
        if isinstance(node.value, str):
            return node
        return ast.Call(ast.Name("float64", ast.Load()), [ast.Constant(float(node.value))], [])

    def visit_Compare(self, node):
        node = self.generic_visit(node)
        sides = [node.left, *node.comparators]
        whole = [node]
        for sign, left, right in zip(node.ops, sides, sides[1:], strict=False):
            if isinstance(sign, ast.NotEq):
                whole += [ast.Compare(each, [ast.Eq()], [each]) for each in (left, right)]
        return ast.BoolOp(ast.And(), whole) if len(whole) > 1 else node


ROWS = {
    "z": AXIS,
    "y": np.array([3.0, 1.5, -2.0, 0.5]),
    "kind": np.array([0.0, 1.0, 2.0, 2.0]),
    "told": np.array(["", "a", "b c", "a"], dtype=object),
}
NUMBERS = st.recursive(
    st.sampled_from(["z", "y", "0", "1", "2", "0.5", "5", "3.25", "1e3"]),
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*", "/"]), inner).map("({0[0]} {0[1]} {0[2]})".format),
        inner.map("-{}".format),
        inner.map("({}) ** 2".format),
    ),
    max_leaves=6,
)
SIGNS = st.sampled_from(["==", "!=", "<", "<=", ">", ">="])
COMPARED = st.one_of(
    st.tuples(NUMBERS, SIGNS, NUMBERS).map(" ".join),
    st.tuples(NUMBERS, SIGNS, NUMBERS, SIGNS, NUMBERS).map(" ".join),
    st.tuples(
        st.sampled_from(["kind", "'calm'", "'steady sliding'", "'wild'"]),
        st.sampled_from(["==", "!="]),
        st.just("kind"),
    ).map(" ".join),
    st.tuples(st.just("told"), st.sampled_from(["==", "!="]), st.sampled_from(["''", "'a'", "'z'"])).map(" ".join),
    *(
        st.tuples(
            st.sampled_from(left),
            st.sampled_from(["in", "not in"]),
            st.lists(st.sampled_from(members), min_size=1, max_size=4).map(lambda parts: f"({', '.join(parts)},)"),
        ).map(" ".join)
        for left, members in (
            (["z", "y", "z + 1", "2", "1 < y", "0 < z <= y"], ["z", "y", "0", "1.5", "y - 1", "5"]),
            (["kind"], ["'calm'", "'wild'", "'steady sliding'", "kind"]),
            (["told", "'a'"], ["''", "'a'", "told", "'z'"]),
        )
    ),
)
EXPRESSIONS = st.recursive(
    COMPARED,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["and", "or"]), inner).map(" ".join),
        inner.map("not {}".format),
        inner.map("({})".format),
    ),
    max_leaves=6,
)


@settings(max_examples=300, deadline=None)
@given(EXPRESSIONS)
def test_rows_are_those_that_a_loop_in_python_chooses(text):
    read = ast.fix_missing_locations(Wrapped().visit(ast.parse(text, mode="eval")))
    found = []
    for k in range(len(AXIS)):
        row = {"z": np.float64(ROWS["z"][k]), "y": np.float64(ROWS["y"][k]), "told": ROWS["told"][k]}
        row |= {"kind": ("calm", "steady sliding", "wild")[int(ROWS["kind"][k])], "float64": np.float64}
        with np.errstate(all="ignore"):
            found.append(bool(eval(compile(read, "row", "eval"), row)))  # noqa: S307 - Python's own reading
    assert chosen(text, ROWS) == np.flatnonzero(found).tolist()


WRITTEN = """x y kind told nan 1 0.5 1e400 'calm' "a" ' == != < >= in not and or + - * ** / ( ) , . [ ] { } : :=
= f' lambda if else for is await yield ... @ \\ # ; µ ｘ ² _ 0x1 1j None print ! % & ~"""
PIECES = [*WRITTEN.split(), "\n", "\t", "\0", "\ud800"]


@settings(max_examples=500, deadline=None)
@example(["'", "\t", "'"], "")
@example(["x", "\n", "+", "told"], "")
@given(st.lists(st.sampled_from(PIECES), max_size=12), st.sampled_from(["", " "]))
def test_whatever_is_written_is_an_expression_or_refused_in_one_line(pieces, between):
    text = between.join(pieces)
    try:
        expression = parse(text)
        unknown = set(expression.names()) - set(COLUMNS)
        assert unknown or chosen(text) is not None
        message = ""
    except ValueError as problem:
        message = str(problem)
    assert message == "" or message.isprintable()
    assert len(message) < 600
