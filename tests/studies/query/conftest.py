"""The small result that queries are tried on."""

import pytest

from sweeps import open_results
from tests.helpers.trials import sweep


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("query") / "trial.nc"
    sweep().plan(path).run("sync")
    return path


@pytest.fixture(scope="module")
def data(file):
    return open_results(file)
