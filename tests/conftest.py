"""Fixtures that several folders share."""

import os
import subprocess
import sys

import pytest
from hypothesis import settings

from sweeps.plan import batches
from tests.helpers.examples import FRESH
from tests.helpers.waves import BROKEN, LOG

# No test fails because a machine is slow, and the code decides whether one fails, not a draw.
settings.register_profile("any machine", deadline=None, derandomize=not FRESH, database=None)
settings.load_profile("any machine")


# Files that two processes begin with: on a new installation the first compiles most kernels of motion, and the
# second, which is busy for as long without any, then finds them.
FIRST = ("fivcore/test_batches.py", "sweeps/compute/test_backends.py")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    def place(item):
        return next((k for k, name in enumerate(FIRST) if item.path.as_posix().endswith(name)), len(FIRST))

    items.sort(key=place)
    for item in items if os.name == "nt" else ():
        if item.get_closest_marker("posix"):
            item.add_marker(pytest.mark.skip(reason="needs what only POSIX has"))


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


@pytest.fixture
def forgetful(tmp_path, monkeypatch):
    """What a test loads from files of its own is unknown after it, as after a process."""
    from studies import registry

    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(registry, "_registered", {})
    yield
    for name, module in list(sys.modules.items()):
        if (getattr(module, "__file__", None) or "").startswith(f"{tmp_path}{os.sep}"):
            del sys.modules[name]


@pytest.fixture
def undrawn(monkeypatch):
    """Runs draw no figure: what a test is not about."""
    monkeypatch.setattr("studies.runner.plot", lambda study, dataset, file, *_, **__: [file.with_suffix(".png")])
