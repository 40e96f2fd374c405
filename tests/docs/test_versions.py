"""What results/versions.json says of the tests with the lowest and the newest versions."""

import json
from datetime import date

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from tests import HOME, floors

ROWS = json.loads(floors.FILE.read_text())
RUN = [row for row in ROWS if "versions" in row]


def test_every_dependency_has_one_lowest_version():
    lowest = floors.floors(floors.dependencies())
    assert lowest["pandas"] == "2.2.2"
    assert list(lowest) == [each.name for each in floors.dependencies()]
    assert floors.floors([Requirement("numba>=0.61,<0.69"), Requirement("dask[distributed]>=2025.1")]) == {
        "numba": "0.61",
        "dask": "2025.1",
    }
    with pytest.raises(ValueError, match="not enough values"):
        floors.floors([Requirement("numpy<3")])


def test_the_lowest_wheel_is_the_first_from_the_lowest_version_on():
    listed = (
        "numba (0.70.0)\nAvailable versions: 0.70.0, 0.69.0rc1, 0.68.1, 0.61.10, 0.61.2, 0.60.0\n  INSTALLED: 1"
    )
    requirement = Requirement("numba>=0.61,<0.69")
    assert floors.lowest_wheel(requirement, listed, lambda version: True) == "0.61.2"
    assert floors.lowest_wheel(requirement, listed, lambda version: version != "0.61.2") == "0.61.10"
    with pytest.raises(StopIteration):
        floors.lowest_wheel(requirement, listed, lambda version: version == "0.60.0")


def test_the_lowest_versions_were_tried():
    assert any(row["kind"] == "floors" and row["outcome"] == "passed" for row in RUN)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['python']}-{row['kind']}")
def test_a_row_says_what_was_run(row):
    assert row["python"] in floors.PYTHONS
    assert row["kind"] in floors.KINDS
    assert date.fromisoformat(row["date"]) >= date(2026, 1, 1)
    assert row["commit"]
    if "versions" in row:
        assert row["tests"][:3] == ["python", "-m", "pytest"]
        assert (row["outcome"] == "passed") == (row["passed"] > 0 and row["failed"] == 0)
    else:
        assert row["outcome"].startswith(("this Python is missing", "it cannot be installed: "))
    text = json.dumps(row)
    assert str(HOME) not in text
    assert "://" not in text


@pytest.mark.parametrize("row", RUN, ids=lambda row: f"{row['python']}-{row['kind']}")
def test_its_versions_are_those_that_pyproject_says(row):
    """As low as may be, or within what is allowed."""
    needed = floors.dependencies()
    assert list(row["versions"]) == [each.name for each in needed]
    if row["kind"] == "floors":
        for name, version in floors.floors(needed).items():
            # For a later Python there may be no wheel of what was the lowest before it.
            later = row["python"] != floors.PYTHONS[0] and Version(row["versions"][name]) > Version(version)
            assert later or Version(row["versions"][name]) == Version(version)
    for each in needed:
        assert each.specifier.contains(row["versions"][each.name])
