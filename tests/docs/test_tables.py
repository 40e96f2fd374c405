"""Tables of the READMEs are those that the project generates, with where and when they were measured."""

import re

import pytest

from tests.benchmarks import __main__ as benchmarks
from tests.benchmarks import tables
from tests.docs import generated, readmes

KNOWN = tables.load()


@pytest.mark.parametrize("name", readmes.NAMES)
def test_a_readmes_tables_are_those_that_are_generated(name):
    text = readmes.TEXTS[name]
    assert generated.rendered(text) == text, "write them again: python -m tests.docs.generated"


def test_every_measured_table_stands_in_one_place_and_can_be_measured_again():
    marked = [found[2] for text in readmes.TEXTS.values() for found in tables.MARKED.finditer(text)]
    assert len(marked) == len(set(marked))
    assert set(marked) - {"summary"} <= set(KNOWN)
    assert set(KNOWN) <= set(benchmarks.chosen([]))


@pytest.mark.parametrize("name", KNOWN)
def test_a_table_says_where_and_when_it_was_measured(name):
    entry = KNOWN[name]
    assert re.fullmatch(r"[\w() -]+, \d+ cores, \w+", entry["machine"])
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", entry["date"])
    assert re.fullmatch(r"[0-9a-f]{7,40}", entry["commit"])
    assert all(len(row) == len(entry["columns"]) for row in entry["rows"])
