"""Fixtures of the report's tests."""

import pytest


@pytest.fixture(autouse=True, scope="module")
def _no_reference(tmp_path_factory):
    """A folder without a reference, which would stand in for what has not been run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("empty"))
        patch.delenv("FIV_RESULTS", raising=False)
        yield
