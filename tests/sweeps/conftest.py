"""What tests of sweeps share."""

import pytest


@pytest.fixture
def path(tmp_path):
    """Where a sweep is stored."""
    return tmp_path / "sweep.nc"


@pytest.fixture
def limits(monkeypatch):
    """Set from how many bytes on a variable is large, and how many are in a chunk of a file."""

    def limits(large, chunk=256):
        for name in ("assemble.LARGE", "netcdf.LARGE", "existing.READ_AT_ONCE"):
            monkeypatch.setattr(f"sweeps.storage.{name}", large)
        monkeypatch.setattr("sweeps.storage.netcdf.CHUNK_BYTES", chunk)
        monkeypatch.setattr("sweeps.storage.netcdf.MOST_CHUNK_BYTES", 2 * chunk)

    return limits
