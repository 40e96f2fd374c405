"""Expressions: what they are, what they mean beside Python's own reading of them, and what they never do."""

import ast
import os

import numpy as np
import pytest
from hypothesis import given, settings
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
    assert "\n" not in said
    assert len(said) < 500
    return said


ATTACKS = {
    "__import__('os').system('touch owned')": "at letter 24 cannot stand there; nothing can be called",
    "open('owned', 'w')": "\"('owned', 'w')\" at letter 5 cannot stand there; nothing can be called",
    "().__class__": "'.__class__' at letter 3 cannot stand there; there are no attributes",
    "x.__class__ == 1": "'.__class__' at letter 2 cannot stand there; there are no attributes",
    "x[0] == 1": "'[' at letter 2 cannot stand there; nothing can be indexed",
    "lambda: 1": "':' at letter 7 cannot stand there",
    "lambda x: x": "':' at letter 9 cannot stand there",
    "f'{x}' == 1": """"f'{x}'" at letter 1 cannot stand there""",
    "(x := 1) == 1": "':' at letter 4 cannot stand there",
    "x == 1; y == 1": "';' at letter 7 cannot stand there",
    "[k for k in x]": "'[' at letter 1 cannot stand there",
    "x if y else 1": "'if y else 1' at letter 3 cannot stand there",
    "x == 1\\": r"'\\' at letter 7 cannot stand there",
    "x == {1}": "'{' at letter 6 cannot stand there",
    "x == 1 # y": "'#' at letter 8 cannot stand there",
    "x == 0x10": "'0x10' at letter 6 cannot stand there",
    "x == 1_000": "'1_000' at letter 6 cannot stand there",
    "x == 1.2.3": "'1.2.3' at letter 6 cannot stand there",
    "x == '''a": "a text ends with the quote that it began with",
    "x == 'a": "a text ends with the quote that it began with",
    "x == 'a\nb'": "a text ends with the quote that it began with",
    "x == 1\0": r"'\x00' at letter 7 cannot stand there",
    "x ＝＝ 1": "'＝' (U+FF1D) at letter 3 cannot stand there",
    "x == １": "'１' (U+FF11) at letter 6 cannot stand there",
    "x == 1 ａｎｄ y == 1": "'ａｎｄ' (U+FF41, U+FF4E, U+FF44) at letter 8 cannot stand there",
    "x == 1 & y == 1": "'&' at letter 8 cannot stand there; write and",
    "x = 1": "'=' at letter 3 cannot stand there; to compare is ==",
    "x ^ 2 == 1": "a power is **",
    "!x": "write not, or != to compare",
    "x // 2 == 1": "'// 2' at letter 3 cannot stand there; there is no //",
    "x % 2 == 1": "'%' at letter 3 cannot stand there",
    "x @ y": "'@' at letter 3 cannot stand there",
    "x is 1": "'is 1' at letter 3 cannot stand there; to compare is ==",
    "1 < x is not 1": "'< x is not 1' at letter 3 cannot stand there; to compare is !=",
    "(x) .real == 1": "'.real' at letter 5 cannot stand there; there are no attributes",
    "x == (y for y in z)": "'for y in z)' at letter 9 cannot stand there",
    "x in (*y, 1)": "'*y' at letter 7 cannot stand there",
    "x == True": "'True' at letter 6 cannot stand there",
    "x == ...": "'...' at letter 6 cannot stand there",
    "x == 1j": "'1j' at letter 6 cannot stand there",
    "x == 01": "'0' at letter 6 cannot stand there",
    "x == 1or y == 1": "'1or' at letter 6 cannot stand there",
    "x == 'a' 'b'": """"'a' 'b'" at letter 6 cannot stand there""",
    "told == r'a'": """"r'a'" at letter 9 cannot stand there""",
    "told == b'a'": """"b'a'" at letter 9 cannot stand there""",
    "told == '''a'''": "at letter 9 cannot stand there",
    "ｘ == 1": "'ｘ' (U+FF58) at letter 1 cannot stand there",
    "(yield)": "'yield' at letter 2 cannot stand there",
    "x == (1 y)": "'1 y' at letter 7 cannot stand there",
    "x << 1 == 2": "'<< 1' at letter 3 cannot stand there",
    "": "it is empty",
    "  ": "it is empty",
    "x ==": "something is missing at its end",
    "(x == 1": "something is missing at its end",
    "x == 1)": "')' at letter 7 cannot stand there",
    "x == 1 and": "something is missing at its end",
    "and x == 1": "'and' at letter 1 cannot stand there",
}


@pytest.mark.parametrize("text", ATTACKS)
def test_nothing_but_expressions_is_read(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert ATTACKS[text] in refused(text)
    assert os.listdir(tmp_path) == []


def test_what_is_long_or_deep_is_refused_at_once():
    assert f"it has 1000004 letters; it may have {LONGEST}" in refused("x == " + "1" * 999_999)
    for text in (
        "(" * 10_000 + "x" + ")" * 10_000 + " == 1",
        "not " * 5000 + "x == 1",
        "x == " + "-" * 1_000_000 + "1",
    ):
        assert f"letters; it may have {LONGEST}" in refused(text)
    for opened in ("(", "not ", "-"):
        deep = opened * (DEEPEST + 1)
        closed = ")" * (DEEPEST + 1) if opened == "(" else ""
        text = f"{deep}x == 1{closed}" if opened != "-" else f"x == {deep}1"
        assert f"more than {DEEPEST} levels are within each other" in refused(text)
    assert f"more than {DEEPEST} levels" in refused("x == " + "2 ** " * (DEEPEST + 1) + "1")
    # As deep as it may be, and as long as it may be: wide is not deep.
    assert chosen("(" * DEEPEST + "x" + ")" * DEEPEST + " == 1") == [1]
    assert chosen(" or ".join(["x == 1"] * 399)) == [1]
    assert chosen("x == 1" + " + 0" * 990) == [1]


def test_of_a_long_expression_a_message_shows_what_is_about_the_spot():
    text = "x == 1 or " * 10 + "x = 1" + " or x == 1" * 10
    spot = text.index("= 1 or x = 1") + len("= 1 or x ")
    about = f"where = ...{text[spot - 30 : spot + 30]!r}...: '=' at letter {spot + 1} cannot stand there; "
    assert refused(text).startswith(about)
    text = "x = 1" + " or x == 1" * 10
    assert refused(text).startswith(f"where = {text[:60]!r}...: '=' at letter 3 cannot stand there; ")
    text = "x == 1 or " * 10 + "x ="
    assert refused(text).startswith(f"where = ...{text[-60:]!r}: '=' at letter 103 cannot stand there; ")
    # Of 60 letters all are shown.
    assert refused("told == " + "1" * 60).endswith(f"told is a text and {'1' * 60} a number")
    assert refused("told == " + "1" * 61).endswith(f"told is a text and {'1' * 60}... a number")


def test_powers_are_bounded():
    for text in ("x == 10**10**10", "x == 10**(-1000)", "x ** 101 > 1", "x ** 1e999 > 1"):
        assert "must be a number from -100 to 100" in refused(text)
    assert "the power y must be a number" in refused("x ** y == 1")
    assert "the power 0/0 must be a number" in refused("x ** (0/0) == 1")
    # No number grows beyond a float.
    assert chosen("9 ** 99 ** 1 * 9 ** 99 * 9 ** 99 * 9 ** 99 > x") == [0, 1, 2, 3]


def test_the_grammar_reads_as_python_does():
    assert chosen("-x ** 2 == -4") == [2]
    assert chosen("2 ** -1 == 0.5") == [0, 1, 2, 3]
    assert chosen("2 ** 3 ** 2 == 512") == [0, 1, 2, 3]
    assert chosen("8 / 4 / 2 == 1") == [0, 1, 2, 3]
    assert chosen("7 - 3 - 2 == 2 and + x > - 1") == [0, 1, 2, 3]
    assert chosen("0 < x <= 2") == [1, 2]
    assert chosen("not x == 1 and x < 5 or x == 1") == [0, 1, 2]
    assert chosen("not (x == 1 or x == 5)") == [0, 2]
    assert chosen("x==.5e1 or\n\tx == 1.") == [1, 3]
    expression = parse(" μ == 1 and (b == '\\' or c == 3) and not d == b\n")
    assert [expression.part(part) for part in expression.tree.values] == [
        "μ == 1",
        "b == '\\' or c == 3",
        "not d == b",
    ]
    assert expression.names() == ["μ", "b", "c", "d"]
    assert expression.names(expression.tree.values[1]) == ["b", "c"]


def test_what_is_missing_matches_no_comparison():
    for sign in ("==", "!=", "<", "<=", ">", ">="):
        assert 1 not in chosen(f"y {sign} 3")
        assert 1 not in chosen(f"3 {sign} y")
    assert chosen("y != 3") == [2, 3]
    assert chosen("y * 2 != 6") == [2, 3]
    assert chosen("y == nan") == [1]
    assert chosen("nan != y") == [0, 2, 3]
    assert chosen("kind == nan") == [2]
    assert chosen("kind != 'wild'") == [0, 1]
    assert chosen("not y == 3") == [1, 2, 3]
    assert chosen("0 / x == nan") == [0]
    assert "of texts the empty one is ''" in refused("told == nan")
    assert "compared by == and !=" in refused("y < nan")
    assert "only numbers can be calculated with" in refused("nan + 1 == 1")


def test_words_and_texts():
    assert chosen("kind == 'steady sliding'") == chosen('kind == "steady_sliding"') == [1]
    assert chosen("'wild' != kind") == [0, 1]
    assert chosen("kind == kind") == [0, 1, 3]
    assert chosen("told == 'a'") == [1, 3]
    assert chosen("told != ''") == [1, 2, 3]
    assert chosen("told == told") == [0, 1, 2, 3]
    assert chosen("told == kind") == []
    assert chosen("told != kind") == [0, 1, 3]
    assert (
        "kind is never 'steady'; did you mean steady sliding? its values are calm, steady sliding, wild"
        in refused("kind == 'steady'")
    )


def test_nonsense_of_types_is_told():
    assert '\'x == "a"\': "a" is a text and x a number' in refused('x == "a"')
    assert "without quotes 3 is a number" in refused("x == '3'")
    assert "kind is a word and 3 a number; its words are 'calm'," in refused("kind == 3")
    assert "only numbers are above or below each other" in refused("kind > 'calm'")
    assert "only numbers are above or below each other" in refused("told < 'b'")
    assert "told is a text; only numbers can be calculated with" in refused("told + 1 == 2")
    assert "kind is a word; only numbers" in refused("-kind == 2")
    assert "it is a number; compare it, like x == 0" in refused("x")
    assert "it is a word; compare it, like kind == 'calm'" in refused("kind")
    assert "x is a number; and is for what is true or false, like x == 0" in refused("x and y == 1")
    assert "told is a text; not is for" in refused("not told")
    assert "(x == 1) is true" not in refused("(x == 1) == (y == 1)")
    assert "x == 1 is true or false already" in refused("(x == 1) == (y == 1)")
    assert "only numbers can be calculated with" in refused("(x == 1) + 1 == 2")


@pytest.mark.parametrize(
    ("text", "rows", "told"),
    [
        ("x == 5.0000001", [3], None),
        ("x == 5.0029", [3], None),
        ("4.9971 == x", [3], None),
        ("x == 0.1 + 0.2 + 0.7", [1], None),
        ("x != 5.0000001", [0, 1, 2], None),
        ("x == 5.01", [], "x == 5.01: x has no such value; the nearest is 5"),
        ("x == 1e9", [], "x == 1e9: x has no such value; the nearest is 5"),
        ("x == -(3 + 4)", [], "the nearest is 0"),
        ("x != 5.01", [0, 1, 2, 3], None),
        ("x == 5.01 or x == 1", [1], "the nearest is 5"),
        # Only equality, and only with a number.
        ("x >= 5.0000001", [], None),
        ("x + 0 == 5.0000001", [], None),
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


PIECES = [
    *("x", "y", "kind", "told", "nan", "1", "0.5", "1e400", "'calm'", '"a"', "'"),
    *("==", "!=", "<", ">=", "in", "not", "and", "or", "+", "-", "*", "**", "/", "(", ")", ",", "."),
    *("[", "]", "{", "}", ":", ":=", "=", "f'", "lambda", "if", "else", "for", "is", "await", "yield", "...", "@"),
    *(
        "\n",
        "\t",
        "\\",
        "#",
        ";",
        "\0",
        "\ud800",
        "µ",
        "ｘ",
        "²",
        "_",
        "0x1",
        "1j",
        "None",
        "print",
        "!",
        "%",
        "&",
        "~",
    ),
]


@settings(max_examples=500, deadline=None)
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
