"""What expressions mean, which are refused, and that nothing is executed."""

import numpy as np
import pytest

from studies.query.query import select
from sweeps import InputError
from tests.query.trial import FAILED, A, B, places, trial

DATA = trial()
CASES = [
    ("1 < a < 3", lambda a, b: a == 2),
    ("a > b < 0.5", lambda a, b: a > b < 0.5),
    ("0.1 * 3 < b * 3 <= 3 and a + b - a > 0.5", lambda a, b: b == 1),
    ("-a ** 2 == -4 and (-a) ** 2 == 4 and +a == 2", lambda a, b: a == 2),
    ("a // 2 == 1 and a % 2 == 1", lambda a, b: a == 3),
    ("a - 1 - 1 == 0 or 8 / a / 2 == 4", lambda a, b: a in (1, 2)),
    ("2 ** 3 ** 2 == 512 and 1 + 2 * 3 == 7 and a >= 3", lambda a, b: a >= 3),
    ("a / 0 == nan", lambda a, b: a == 0),
    ("top ** 40 > 1e30", lambda a, b: a > 2),
    ("a / 0 > 1 and 9 ** 999 ** 9 > a", lambda a, b: a > 0),
    ("a == 0 or a > 1 and b < 0.5", lambda a, b: a == 0 or (a > 1 and b < 0.5)),
    ("not (a == 1 or b == 1)", lambda a, b: not (a == 1 or b == 1)),
    ("not a > 1 or not True", lambda a, b: a <= 1),
    ("sure and True and sure == True", lambda a, b: a > 2),
    ("(a == 1) != (b == 1)", lambda a, b: (a == 1) != (b == 1)),
    ("(a == 1)\n and # a remark\n b == 1", lambda a, b: (a, b) == (1, 1)),
    ("a == 2.0009 or 3.0011 == a", lambda a, b: a == 2),
    ("b == 0.1 + 1e-5 or b == 0.01000001", lambda a, b: b in (0.01, 0.1)),
    ("a != 2.0009 and 3.01 != a", lambda a, b: a != 2),
    ("level == 2.5000001 and a < 2.0009", lambda a, b: a <= 2),
    ("level == 2.50001", lambda a, b: False),
    ("a == b == 1", lambda a, b: a == b == 1),
    ("a in (1, 3.0001) and b not in [1, 0.1]", lambda a, b: a in (1, 3) and b < 0.1),
    ("2 in (a, b * 20)", lambda a, b: a == 2 or b == 0.1),
    ("share == 0.033333335", lambda a, b: b == 0.1 and a > 0 and (a, b) != FAILED),
    ("0.033333335 != share", lambda a, b: b != 0.1 and a > 0),
    ("kind == 'steady sliding'", lambda a, b: a in (1, 4)),
    ("'steady_sliding' == kind", lambda a, b: a in (1, 4)),
    ("name == 'one a' or name in ('two',)", lambda a, b: a in (1, 2)),
    ("kind not in ('calm', 'wild')", lambda a, b: a in (1, 4)),
    ("error != ''", lambda a, b: (a, b) == FAILED),
    ("method == 'fast' and a == 4 and 'a, (b' != error", lambda a, b: a == 4),
    ("kind == name or error == name", lambda a, b: False),
    ("kind != name and a == 3", lambda a, b: a == 3 and b != 0.1),
    ("share == nan", lambda a, b: a == 0 or (a, b) == FAILED),
    ("nan != share", lambda a, b: a > 0 and (a, b) != FAILED),
    ("share != 5 or share == 5 or share < nan or a != a", lambda a, b: a > 0 and (a, b) != FAILED),
    ("kind in ('wild', nan)", lambda a, b: a == 2 or (a, b) == FAILED),
    ("not share > 0", lambda a, b: a == 0 or (a, b) == FAILED),
]


@pytest.mark.parametrize(("where", "keep"), CASES, ids=[where for where, _ in CASES])
def test_rows(where, keep):
    points = [(a, b) for a in A for b in B]
    assert places(select(DATA, where, "a,b")) == [k for k, point in enumerate(points) if keep(*point)]


REFUSED = {
    "a = 1": "to compare is ==",
    "a ==": "invalid syntax; it may have names, SI numbers",
    "": "a list can only stand after in, like mu in (0.1, 0.2)",
    "a == 1 & b == 1": "write and; it may have",
    "open('x')": "nothing can be called",
    "__import__('os').system('touch x')": "nothing can be called",
    "a.real == 1": "no Attribute",
    "a[0] == 1": "no Subscript",
    "(a := 1) == 1": "no NamedExpr",
    "name == b'x'": "no Constant",
    "a == 1\0": "where = 'a == 1\\x00'",
    "a == " + "9" * 400: "too large a number",
    "a == 1" + " + a" * 5000: "where = 'a == 1 + a",
    "a == " + "-" * 900 + "1": "too many levels",
    "a == (1, 2)": "a list can only stand after in",
    "a in (1)": "where = '1': in needs a list, like (0.1, 0.2)",
    "a in b": "where = 'b': in needs a list",
    "a": "it is a number, and must be true or false; compare it with a value, the whole in quotes: 'mu > 0",
    "not kind": "where = 'kind': it is a text, and must be true or false",
    "kind * 2 == 2": "where = 'kind': it is a text, and must be a number",
    "(a == 1) + 1 == 2": "where = 'a == 1': it is true or false, and must be a number",
    "kind > 'calm'": "where = 'kind': it is a text, and cannot be compared so with a text",
    "a == '1'": "where = 'a': it is a number, and cannot be compared so with a text",
    "a < (b == 1)": "cannot be compared so with true or false",
    "kind == 'calms'": "'kind': it is never 'calms'; did you mean calm? its words are calm, steady sliding, wild",
    "kind in ('wild', 'zzz')": "it is never 'zzz'; its words are calm, steady sliding, wild",
    "side == 'lft'": "it is never 'lft'; did you mean left? its words are left, right",
    "sise > 1": "where = 'sise': no such column; did you mean size?",
    "drive > 1": "no such column; did you mean a (speed of the drive)?",
    "kind == calm": "where = 'calm': no such column; to compare with the word, write 'calm' in quotes",
    "zzz == 1": "no such column; it has a, b, name,",
    "a == 2mm/s and b > 0": "units cannot stand in a condition; a is in m/s: write a == 0.002",
    "a == 2kg": "kg is a mass; a is a speed",
    "share == 2kg": "units cannot stand in a condition; it may have",
    "a == 2 and b = 3": "to compare is ==",
}


@pytest.mark.parametrize("where", REFUSED, ids=lambda where: ascii(where)[:40])
def test_refusals(where, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as problem:
        select(DATA, where, "a,b")
    assert REFUSED[where] in str(problem.value)
    assert str(problem.value).isprintable()
    assert len(str(problem.value)) < 400
    assert not [*tmp_path.iterdir()]


def test_a_number_that_no_axis_has_is_noted_with_the_nearest():
    notes = []
    assert select(DATA, "a == 2.3 and b < 1", note=notes.append).empty
    assert select(DATA.isel(a=[0]), "a in (1, 0)", "a", note=notes.append)["a"].tolist() == [0]
    assert notes == ["a has no value 2.3; the nearest is 2", "a has no value 1; the nearest is 0"]
    assert select(DATA.isel(a=[]), "a == 1", "a").empty
    assert np.isnan(select(DATA, "a == 1", "nan").iloc[0, 0])
