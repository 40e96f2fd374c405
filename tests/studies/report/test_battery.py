"""The page says in one line what the long tests tried last."""

import json

from studies.report.battery import battery

KNOWN = {
    "date": "2026-11-23",
    "commit": "abc1234",
    "seed": 7,
    "passed": 40,
    "failed": 0,
    "tried": {"flips": 500, "runs killed": 1000},
}


def test_the_line_has_outcome_counts_and_origin(tmp_path):
    (tmp_path / "reference").mkdir()
    for text, line in (
        (
            json.dumps(KNOWN),
            "all 40 tests passed, with 1,500 cases of 2 kinds (2026-11-23, commit abc1234, seed 7).",
        ),
        (json.dumps(KNOWN | {"failed": 2}), ": 2 of 42 tests failed, with"),
        (json.dumps(KNOWN | {"tried": 3}), ""),
        ("{", ""),
    ):
        (tmp_path / "battery.json").write_text(text)
        assert line in battery(tmp_path)
        assert bool(line) == bool(battery(tmp_path))
