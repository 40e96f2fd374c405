"""Expressions of a query beside an interpreter of their trees, row by row, over a small result."""

import ast
import math
import operator
import warnings
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from studies.query.query import query
from sweeps import open_results
from tests.battery.surfaces.examples import surface
from tests.helpers.trials import FAILS, WORDS, A, B, sweep

examples = surface("expressions of a query", times=34)
pytestmark = pytest.mark.battery

WORD = [word.replace("_", " ") for word in WORDS]
NAMES = ["nil", "one", "two", "three", "four"]
# What the rows of the result are, from its own formulas and not from its file.
ROWS = [
    {
        "a": a,
        "b": b,
        "size": a * math.sqrt(b),
        "share": float(np.float32(b / 3.0)) if a > 0.0 else math.nan,
        "kind": WORD[int(a) % 3],
        "count": 10.0 * a,
        "a_name": NAMES[int(a)],
        "top": a * a,
        "whole": 7.5,
        "level": 2.5,
        "d1": 50.0,
        "p1_length": 0.05,
        "note": "dry",
    }
    for a in A
    for b in B
]
for row in ROWS:
    if (row["a"], row["b"]) == FAILS:
        row |= {"size": math.nan, "share": math.nan, "count": math.nan, "kind": None}
AXES = {"a": A, "b": B}
NUMBERS = ["a", "b", "size", "share", "count", "top", "whole", "level", "d1", "p1_length"]
TEXTS = {"a_name": NAMES, "note": ["dry", "wet"]}


@dataclass(frozen=True)
class Node:
    """A part of an expression: an operator or what it stands for, and its parts."""

    kind: str
    value: object = None
    parts: tuple = ()


# The trees.

CONSTANTS = st.sampled_from(
    ["0", "1", "2", "3.0", "4", "0.5", "1e-3", "0.01", "1e-1", ".25", "20", "7.5", "0.1000001", "5."]
).map(lambda text: Node("number", text))
NUMBER_LEAVES = st.one_of(st.sampled_from(NUMBERS).map(lambda name: Node("name", name)), CONSTANTS)


def _calculated(inner):
    return st.one_of(
        st.builds(
            lambda sign, a, b: Node(sign, parts=(a, b)), st.sampled_from(["+", "-", "*", "/"]), inner, inner
        ),
        st.builds(lambda sign, a: Node(sign, parts=(a,)), st.sampled_from(["neg", "pos"]), inner),
        st.builds(
            lambda a, power: Node("**", parts=(a, Node("number", power))),
            inner,
            st.sampled_from(["2", "0.5", "3"]),
        ),
    )


NUMERIC = st.recursive(NUMBER_LEAVES, _calculated, max_leaves=5)
ORDER = {"==": operator.eq, "!=": operator.ne, "<": operator.lt, "<=": operator.le}
ORDER |= {">": operator.gt, ">=": operator.ge}
SIGNS = st.sampled_from([*ORDER])
EQUAL = st.sampled_from(["==", "!="])
NAN = Node("nan")


def _text(value):
    return Node("text", value)


def _chain(first, *pairs):
    """first SIGN second SIGN third ..."""
    return Node("chain", tuple(sign for sign, _ in pairs), (first, *(part for _, part in pairs)))


CODED = st.one_of(st.just(Node("name", "kind")), st.sampled_from([*WORD, *WORDS]).map(_text))
COMPARED = st.one_of(
    st.builds(lambda a, s, b: _chain(a, (s, b)), NUMERIC, SIGNS, NUMERIC),
    st.builds(lambda a, s, b, t, c: _chain(a, (s, b), (t, c)), NUMERIC, SIGNS, NUMERIC, SIGNS, NUMERIC),
    st.builds(lambda a, s, b: _chain(a, (s, b)), st.just(Node("name", "kind")), EQUAL, CODED),
    st.builds(lambda a, s, b: _chain(a, (s, b)), CODED, EQUAL, st.just(Node("name", "kind"))),
    *(
        st.builds(
            lambda n, s, v: _chain(Node("name", n), (s, _text(v))), st.just(name), EQUAL, st.sampled_from(words)
        )
        for name, words in TEXTS.items()
    ),
    st.builds(
        lambda n, s: _chain(Node("name", n), (s, NAN)),
        st.sampled_from(["size", "share", "count", "kind", "a", "whole"]),
        EQUAL,
    ),
    st.builds(
        lambda n, s, m: Node(s, parts=(n, *m)),
        NUMERIC,
        st.sampled_from(["in", "not in"]),
        st.lists(NUMBER_LEAVES, min_size=1, max_size=3),
    ),
    st.builds(
        lambda s, m: Node(s, parts=(Node("name", "kind"), *map(_text, m))),
        st.sampled_from(["in", "not in"]),
        st.lists(st.sampled_from(WORD), min_size=1, max_size=3),
    ),
)
CONDITIONS = st.recursive(
    COMPARED,
    lambda inner: st.one_of(
        st.builds(lambda word, a, b: Node(word, parts=(a, b)), st.sampled_from(["and", "or"]), inner, inner),
        st.builds(lambda a: Node("not", parts=(a,)), inner),
    ),
    max_leaves=5,
)

# How trees are written: an operator's part is in brackets where it binds less than the operator asks.

BINDS = {"or": 1, "and": 2, "not": 3, "chain": 4, "in": 4, "not in": 4, "+": 5, "-": 5, "*": 6, "/": 6}
BINDS |= {"neg": 7, "pos": 7, "**": 8}
ATOM = 9


@st.composite
def written(draw, tree):
    """The tree as text, with brackets and blanks that mean nothing here and there."""
    blank = st.sampled_from(["", "", " ", "  ", "\t"])

    def around(word):
        # Words need a blank, signs do not.
        need = " " if word[0].isalpha() else ""
        return f"{draw(blank)}{need}{word}{need}{draw(blank)}"

    def text(node, least):
        own = BINDS.get(node.kind, ATOM)
        parts = node.parts
        match node.kind:
            case "number" | "name":
                result = str(node.value)
            case "nan":
                result = "nan"
            case "text":
                quote = draw(st.sampled_from("'\""))
                result = f"{quote}{node.value}{quote}"
            case "neg" | "pos":
                result = f"{'-' if node.kind == 'neg' else '+'}{draw(blank)}{text(parts[0], own)}"
            case "not":
                result = f"not {text(parts[0], own)}"
            case "**":
                result = text(parts[0], ATOM) + around("**") + text(parts[1], BINDS["neg"])
            case "chain":
                result = text(parts[0], own + 1)
                for sign, part in zip(node.value, parts[1:], strict=True):
                    result += around(sign) + text(part, own + 1)
            case "in" | "not in":
                members = f"{draw(blank)},{draw(blank)}".join(text(part, 1) for part in parts[1:])
                comma = "," if len(parts) == 2 or draw(st.booleans()) else ""
                result = f"{text(parts[0], own + 1)}{around(node.kind)}({members}{comma})"
            case _:
                result = text(parts[0], own) + around(node.kind) + text(parts[1], own + 1)
        extra = node.kind != "nan" and draw(st.integers(0, 7)) == 0
        if own < least or extra:
            result = f"({draw(blank)}{result}{draw(blank)})"
        return result

    return draw(blank) + text(tree, 0) + draw(blank)


TREES = CONDITIONS.flatmap(lambda tree: st.tuples(st.just(tree), written(tree)))
SHOWN = NUMERIC.flatmap(lambda tree: st.tuples(st.just(tree), written(tree)))


# What trees mean.


def constant(node):
    """Whether it is of numbers alone."""
    return node.kind == "number" or (
        bool(node.parts)
        and node.kind in ("+", "-", "*", "/", "**", "neg", "pos")
        and all(map(constant, node.parts))
    )


def meant(node, row):
    """The value of a tree in a row."""
    parts = node.parts
    with np.errstate(all="ignore"):
        match node.kind:
            case "number":
                return np.float64(node.value)
            case "name":
                value = row[node.value]
                return np.float64(value) if isinstance(value, float) else value
            case "nan":
                return None
            case "text":
                return node.value
            case "neg":
                return -meant(parts[0], row)
            case "pos":
                return meant(parts[0], row)
            case "+":
                return meant(parts[0], row) + meant(parts[1], row)
            case "-":
                return meant(parts[0], row) - meant(parts[1], row)
            case "*":
                return meant(parts[0], row) * meant(parts[1], row)
            case "/":
                return meant(parts[0], row) / meant(parts[1], row)
            case "**":
                # As an array: of one number NumPy rounds otherwise.
                return np.power(np.full(len(ROWS), meant(parts[0], row)), meant(parts[1], row))[0]
            case "not":
                return not meant(parts[0], row)
            case "and":
                return meant(parts[0], row) and meant(parts[1], row)
            case "or":
                return meant(parts[0], row) or meant(parts[1], row)
            case "chain":
                pairs = zip(node.value, parts, parts[1:], strict=False)
                return all(compared(left, sign, right, row) for sign, left, right in pairs)
            case "in":
                return any(compared(parts[0], "==", part, row) for part in parts[1:])
            case "not in":
                return all(compared(parts[0], "!=", part, row) for part in parts[1:])


def near(axis, number):
    """The value of an axis that a number means: within a thousandth of its distance from its neighbour."""
    k = int(np.argmin(np.abs(axis - number)))
    others = np.delete(axis, k)
    return axis[k] if abs(axis[k] - number) <= 1e-3 * np.min(np.abs(others - axis[k])) else None


def compared(left, sign, right, row):
    """Whether two parts compare so; what is missing does not."""
    for one, other in ((left, right), (right, left)):
        if other.kind == "nan":
            value = meant(one, row)
            missing = value is None or value != value
            return bool(missing == (sign == "=="))
        if one.kind == "name" and one.value in AXES and constant(other) and sign in ("==", "!="):
            found = near(AXES[one.value], meant(other, row))
            return bool((found == row[one.value]) == (sign == "==")) if found is not None else sign == "!="
    a, b = meant(left, row), meant(right, row)
    if a is None or b is None or a != a or b != b:
        return False
    if "name" in (left.kind, right.kind) and "kind" in (left.value, right.value):
        # Words may be written with underscores.
        a, b = a.replace("_", " "), b.replace("_", " ")
    return bool(ORDER[sign](a, b))


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    path = tmp_path_factory.mktemp("battery") / "trial.nc"
    sweep().plan(path).run("sync")
    return open_results(path)


def chosen(data, text):
    """The rows that an expression chooses, as (a, b)."""
    frame = query(data, text, show="a,b")
    return list(zip(frame["a"], frame["b"], strict=True))


def expected(tree):
    return [(row["a"], row["b"]) for row in ROWS if meant(tree, row)]


def message(data, text):
    """What is said of a text that is refused: one line with where it is wrong; None for one that is not."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", SyntaxWarning)
            chosen(data, text)
    except ValueError as problem:
        said = str(problem)
        assert said.isprintable()
        assert said.startswith("where = ")
        assert len(said) < 600
        return said
    return None


QUIET = pytest.mark.filterwarnings("ignore:.*has no such value", "ignore::SyntaxWarning")


@QUIET
@examples(120)
@given(case=TREES)
def test_the_rows_of_an_expression_are_those_of_its_tree(data, case):
    tree, text = case
    assert chosen(data, text) == expected(tree)


@QUIET
@examples(60)
@given(case=SHOWN)
def test_a_calculated_column_has_the_values_of_its_tree(data, case):
    tree, text = case
    frame = query(data, show=["a", "b", f"0 * a * b + ({text})"])
    found = frame.iloc[:, -1].to_numpy(float)
    wanted = [np.float64(0.0) * row["a"] * row["b"] + meant(tree, row) for row in ROWS]
    np.testing.assert_array_equal(found, np.array(wanted, dtype=float))


def tree_of(node):
    """The tree of what Python reads; None for what the language has not."""
    kinds = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
    kinds |= {ast.UAdd: "pos", ast.USub: "neg", ast.Not: "not", ast.And: "and", ast.Or: "or"}
    signs = {ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
    match node:
        case ast.Constant(value=str()):
            return _text(node.value)
        case ast.Constant():
            return Node("number", repr(node.value))
        case ast.Name(id="nan"):
            return NAN
        case ast.Name():
            return Node("name", node.id)
        case ast.UnaryOp():
            return Node(kinds[type(node.op)], parts=(tree_of(node.operand),))
        case ast.BinOp():
            return Node(kinds[type(node.op)], parts=(tree_of(node.left), tree_of(node.right)))
        case ast.BoolOp():
            first, *rest = map(tree_of, node.values)
            for each in rest:
                first = Node(kinds[type(node.op)], parts=(first, each))
            return first
        case ast.Compare():
            # a < b in (c, d) asks for both.
            whole, left = None, node.left
            for sign, right in zip(node.ops, node.comparators, strict=True):
                if isinstance(sign, ast.In | ast.NotIn):
                    word = "in" if isinstance(sign, ast.In) else "not in"
                    link = Node(word, parts=(tree_of(left), *map(tree_of, right.elts)))
                else:
                    link = _chain(tree_of(left), (signs[type(sign)], tree_of(right)))
                whole, left = link if whole is None else Node("and", parts=(whole, link)), right
            return whole
    return None


def as_python(text):
    """The tree that Python reads, in whose texts a backslash means itself."""
    return ast.parse(text.strip().replace("\\", "\\\\"), mode="eval").body


@QUIET
@examples(120)
@given(case=TREES, changes=st.data())
def test_a_damaged_expression_means_what_python_reads_or_is_one_line(data, case, changes):
    _, text = case
    place = changes.draw(st.integers(0, len(text)))
    letters = st.sampled_from(["", *"()+-*/=<>!'\", 0159.e_ab&|[]{}:;@#\\µ"])
    text = text[:place] + changes.draw(letters) + text[place + changes.draw(st.integers(0, 1)) :]
    said = message(data, text)
    if said is None:
        assert chosen(data, text) == expected(tree_of(as_python(text)))
        return
    try:
        as_python(text)
    except SyntaxError:
        assert "unexpected " in said or "missing at its end" in said or "it is empty" in said
        if "unexpected " in said:
            column = int(said.split(" at column ")[1].split(";")[0])
            assert 1 <= column <= len(text.strip())
