"""The page says in one line what the long tests tried last."""

import json

import pytest

from studies.report.battery import battery

KNOWN = {
    "date": "2026-11-23",
    "commit": "abc1234",
    "seed": 7,
    "passed": 40,
    "failed": 0,
    "tried": {"flips": 500, "runs killed": 1000},
}


@pytest.fixture
def kept(tmp_path):
    """Write the file beside a reference, and say what the line is."""
    (tmp_path / "reference").mkdir()

    def line(text):
        (tmp_path / "battery.json").write_text(text)
        return battery(tmp_path)

    return line


def test_the_line_has_outcome_counts_and_origin(kept):
    assert kept(json.dumps(KNOWN)) == (
        "Random input and faults: all 40 tests passed, with 1,500 cases of 2 kinds "
        "(2026-11-23, commit abc1234, seed 7)."
    )
    assert ": 2 of 42 tests failed, with" in kept(json.dumps(KNOWN | {"failed": 2}))


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "7", json.dumps(KNOWN | {"tried": 3}), json.dumps(KNOWN | {"seed": "x"}), "[" * 100_000],
)
def test_without_a_file_of_ours_there_is_no_line(kept, tmp_path, text):
    assert kept(text) == ""
    (tmp_path / "battery.json").unlink()
    assert battery(tmp_path) == ""


def test_the_page_has_it(kept, tmp_path, folder):
    from studies.report import page as report

    kept(json.dumps(KNOWN | {"commit": "<b>"}))
    (tmp_path / "fig5").symlink_to(folder / "fig5")
    file = report.write(("fig5",), tmp_path, tmp_path / "page.html", pytest.fail)
    assert '<p class="note">Random input and faults: all 40 tests passed' in file.read_text()
    assert "commit &lt;b&gt;" in file.read_text()
