"""Fixtures of the battery's long tests."""

import zlib
from collections import Counter

import numpy as np
import pytest

from tests.battery import harness


@pytest.fixture
def tried() -> Counter[str]:
    """Counts of what was tried, by what it is, for the end of the run and its file: `tried["flips"] += 1`."""
    return harness.TRIED


@pytest.fixture
def rng(request) -> np.random.Generator:
    """Random numbers of the run's seed, others for each test."""
    return np.random.default_rng([harness.seed(request.config), zlib.crc32(request.node.nodeid.encode())])
