"""Fixtures that several folders share."""

import subprocess
import sys

import pytest

from sweeps.plan import batches
from tests.helpers.waves import BROKEN, LOG


@pytest.fixture
def small_pieces(monkeypatch):
    """Batches of a point or two, nothing logged yet, nothing broken."""
    LOG.clear()
    BROKEN["points"] = set()
    monkeypatch.setattr(batches, "BATCH_BYTES", 1.0)


@pytest.fixture
def here(tmp_path, monkeypatch, capsys):
    """Run `fiv` in an empty folder, in this process: a second of imports is saved each time."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FIV_RESULTS", raising=False)
    from studies.cli.main import main

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["fiv", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return subprocess.CompletedProcess(arguments, ended.value.code, *capsys.readouterr())

    return run
