"""Fixtures that several folders share."""

import pytest

from sweeps.plan import batches
from tests.helpers.waves import BROKEN, LOG


@pytest.fixture
def small_pieces(monkeypatch):
    """Batches of a point or two, nothing logged yet, nothing broken."""
    LOG.clear()
    BROKEN["points"] = set()
    monkeypatch.setattr(batches, "BATCH_BYTES", 1.0)
