"""Fixtures that several files share."""

import sys

import pytest

from sweeps.plan import batches
from tests.helpers.identity_parts import FILES, Package
from tests.helpers.waves import BROKEN, LOG


@pytest.fixture
def package(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    yield lambda files=FILES: Package(tmp_path, files)
    for name in [name for name in sys.modules if name.partition(".")[0] == "ident"]:
        del sys.modules[name]


@pytest.fixture
def small_pieces(monkeypatch):
    """Batches of a point or two, nothing logged yet, nothing broken."""
    LOG.clear()
    BROKEN["points"] = set()
    monkeypatch.setattr(batches, "BATCH_BYTES", 1.0)
