"""Fixtures of the command line's tests."""

import subprocess
import sys

import pytest

from studies.cli.main import main


@pytest.fixture
def here(tmp_path, monkeypatch, capsys):
    """Run `fiv` in an empty folder, in this process: a second of imports is saved each time."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FIV_RESULTS", raising=False)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["fiv", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return subprocess.CompletedProcess(arguments, ended.value.code, *capsys.readouterr())

    return run
