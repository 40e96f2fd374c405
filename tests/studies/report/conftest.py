"""Small results for tests of the report page: a table, a line, a plane, failures and a refined map."""

import pytest

from studies import runner
from studies.maps import maps
from studies.spec import evenly

SHORT = {"members": 2.0, "least": 0.2, "standard_error": 0.5, "most": 0.4}


@pytest.fixture(autouse=True, scope="session")
def _no_reference(tmp_path_factory):
    """A folder without a reference, which would stand in for what has not been run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("empty"))
        patch.delenv("FIV_RESULTS", raising=False)
        yield


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """A results folder with some studies and a map."""
    folder = tmp_path_factory.mktemp("report")
    runner.run("table4", {}, folder)
    runner.run("fig5", {"mu": evenly(0.0, 0.5, 51)}, folder)
    runner.run("regimes", SHORT | {"V": [1e-3, 2e-3, 5e-3], "mu": [0.05, 0.2, 0.3]}, folder)
    grid = {"V": [2e-3, 4e-3], "theta": [5.0, 40.0], "mu": [0.2, 3.0], "F": [9.0, 4.5], "duration": 0.05}
    runner.run("scenes", grid, folder)
    plane = maps.plane_of("contact_position=0.06:0.1:3", "mu=0:0.5:3", 2)
    sweep = maps.sweep_of(plane, "growth_rate", {}, 2)
    runner.execute(sweep.plan(maps.file_of(plane, "growth_rate", folder)), "sync")
    return folder
