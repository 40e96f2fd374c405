"""Fixtures of the battery's long tests."""

import zlib
from collections import Counter

import numpy as np
import pytest

from tests.battery import harness


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Storms come first: they take their time whatever else there is, and the other process does the rest."""
    items.sort(key=lambda item: item.path.name != "test_storms.py")


@pytest.fixture
def tried() -> Counter[str]:
    """Counts of what was tried, by what it is, for the end of the run and its file: `tried["flips"] += 1`."""
    return harness.TRIED


@pytest.fixture
def rng(request) -> np.random.Generator:
    """Random numbers of the run's seed, others for each test."""
    return np.random.default_rng([harness.seed(request.config), zlib.crc32(request.node.nodeid.encode())])
