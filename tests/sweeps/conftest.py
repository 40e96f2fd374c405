"""What tests of sweeps share."""

import pytest


@pytest.fixture
def path(tmp_path):
    """Where a sweep is stored."""
    return tmp_path / "sweep.nc"
