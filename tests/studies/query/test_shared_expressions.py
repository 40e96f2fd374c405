"""Expressions with the rows that each selects, held to by Python and by the filter of the report page."""

import json
import warnings
from importlib.resources import files
from pathlib import Path

import pytest

from studies.query.query import query
from studies.report.points import points_of
from tests.helpers.browser import browser
from tests.helpers.trials import A, B, pairs

LIST = Path(__file__).with_name("expressions.json")
# Those with the same outcome stand together.
EXPRESSIONS = [each | {"where": text} for each in json.loads(LIST.read_text()) for text in each["where"]]
SCRIPTS = ("page.js", "filter.js")
# Every expression's rows, or why it is refused.
FILTER = """
    const points = Points.of("data");
    return arguments[0].map((text) => {
      try {
        const { test } = filter(points, text);
        return [...Array(points.count).keys()].filter(test);
      } catch (error) {
        return error.message;
      }
    });
"""


@pytest.mark.parametrize("given", EXPRESSIONS, ids=lambda given: ascii(given["where"])[:50])
def test_python_selects_these_rows(data, given):
    with warnings.catch_warnings():
        # Of values that an axis does not have.
        warnings.simplefilter("ignore")
        if "rows" in given:
            order = [(a, b) for a in A for b in B]
            assert [order.index(pair) for pair in pairs(query(data, given["where"], show="a,b"))] == given["rows"]
            return
        with pytest.raises(ValueError, match=r"^where = ") as problem:
            query(data, given["where"])
    message = str(problem.value)
    assert given["refused"] in message
    assert message.isprintable()
    assert len(message) < 400


@pytest.mark.browser
def test_the_page_selects_the_same_rows(data, tmp_path):
    points = json.dumps(points_of(data).data).replace("<", "\\u003c")
    scripts = "\n".join(files("studies.report").joinpath(name).read_text() for name in SCRIPTS)
    page = tmp_path / "page.html"
    page.write_text(
        f'<meta charset="utf-8"><script type="application/json" id="data">{points}</script>'
        f"<script>{scripts}</script>"
    )
    with browser(tmp_path / "profile") as driver:
        driver.get(page.as_uri())
        found = driver.execute_script(FILTER, [each["where"] for each in EXPRESSIONS])
    for given, rows in zip(EXPRESSIONS, found, strict=True):
        if "rows" in given:
            assert (given["where"], rows) == (given["where"], given["rows"])
        else:
            assert isinstance(rows, str), given["where"]
            assert "\n" not in rows.replace(given["where"], "")
