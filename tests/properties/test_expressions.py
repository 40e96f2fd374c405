"""Random expressions: valid ones select the rows that NumPy selects; any text is answered or refused."""

from contextlib import suppress
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from studies.query.query import select
from sweeps import InputError
from tests.query.trial import FAILED, places, trial

DATA = trial()
COLUMNS = {
    name: DATA[name].broadcast_like(DATA["size"]).values.ravel() for name in ("a", "b", "size", "top", "level")
}
FAILS = (COLUMNS["a"] == FAILED[0]) & (COLUMNS["b"] == FAILED[1])
KINDS = np.where(FAILS, "", np.array(["calm", "steady sliding", "wild"])[COLUMNS["a"].astype(int) % 3])
SIGNS = {"==": np.equal, "!=": np.not_equal, "<": np.less, "<=": np.less_equal, ">": np.greater}
OPERATORS = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "%": np.mod, "**": np.power}


def calculated(x, sign, y):
    with np.errstate(all="ignore"):
        return f"({x[0]}) {sign} ({y[0]})", OPERATORS[sign](x[1], y[1])


def compared(x, sign, y):
    """A comparison is false where a value is missing."""
    return f"{x[0]} {sign} {y[0]}", SIGNS[sign](x[1], y[1]) & ~np.isnan(x[1]) & ~np.isnan(y[1])


def chained(x, sign, y, other, z):
    return f"{x[0]} {sign} {y[0]} {other} {z[0]}", compared(x, sign, y)[1] & compared(y, other, z)[1]


def member(x, values):
    found = np.any([compared(x, "==", y)[1] for y in values], axis=0)
    return f"{x[0]} in ({', '.join(y[0] for y in values)},)", found


# An expression is its text and its values. Plus 0, so that no axis finds its nearest value.
NAMES = st.sampled_from([*COLUMNS]).map(lambda name: (f"({name} + 0)", COLUMNS[name]))
CONSTANTS = st.sampled_from(["0", "1", "2.0", "3", ".25", "1e-1"]).map(
    lambda text: (text, np.full(20, float(text)))
)
NUMBERS = st.recursive(
    NAMES | CONSTANTS,
    lambda inner: (
        st.builds(calculated, inner, st.sampled_from([*OPERATORS]), inner)
        | inner.map(lambda x: (f"-({x[0]})", -x[1]))
    ),
    max_leaves=4,
).filter(lambda x: not np.isnan(x[1]).all())
ORDER = st.sampled_from([*SIGNS])
CONDITIONS = st.recursive(
    st.builds(compared, NUMBERS, ORDER, NUMBERS)
    | st.builds(chained, NUMBERS, ORDER, NUMBERS, ORDER, NUMBERS)
    | st.builds(member, NUMBERS, st.lists(NUMBERS, min_size=1, max_size=3))
    | st.sampled_from(["calm", "wild"]).map(lambda word: (f"kind == '{word}'", word == KINDS))
    | st.just(("size == nan", np.isnan(COLUMNS["size"]))),
    lambda inner: (
        st.builds(lambda x, y: (f"({x[0]}) and ({y[0]})", x[1] & y[1]), inner, inner)
        | st.builds(lambda x, y: (f"({x[0]}) or ({y[0]})", x[1] | y[1]), inner, inner)
        | inner.map(lambda x: (f"not ({x[0]})", ~x[1]))
    ),
    max_leaves=4,
)


@settings(deadline=None, max_examples=100)
@given(CONDITIONS)
def test_a_condition_selects_the_rows_of_numpy(condition):
    assert places(select(DATA, condition[0], "a,b")) == np.flatnonzero(condition[1]).tolist()


SIGNS_AND_WORDS = "()[]<=-'\",.1#:\\\n ", "a kind nan == 1e9 ** and not in lambda if f'{a}'"
PIECES = [*SIGNS_AND_WORDS[0], *(f"{word} " for word in SIGNS_AND_WORDS[1].split())]
CALLS = ["__import__('os').mkdir('made')", "open('made', 'w')", "eval('1')", "a.__class__"]


@settings(deadline=None, max_examples=200)
@given(st.text(max_size=30) | st.lists(st.sampled_from(PIECES + CALLS), max_size=10).map("".join))
def test_any_text_is_answered_or_refused(text):
    with suppress(InputError):
        assert len(select(DATA, text, "a,b")) <= 20
    assert not Path("made").exists()
