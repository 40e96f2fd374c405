"""Small results for tests of the report page: tables, a line, a plane, failures and maps."""

from studies import runner
from studies.maps import maps
from studies.spec import evenly

SHORT = {"members": 2.0, "least": 0.5, "load_ups": 1.0, "most": 1.0}


def made(folder):
    """A results folder with some studies and two maps, of which one is refined."""
    runner.run("table4", {}, folder)
    runner.run("fig5", {"mu": evenly(0.0, 0.5, 51)}, folder)
    runner.run("regimes", SHORT | {"V": [1e-3, 2e-3, 5e-3], "mu": [0.05, 0.2, 0.3]}, folder)
    grid = {"V": [2e-3, 4e-3], "theta": [5.0, 40.0], "mu": [0.2, 3.0], "F": [9.0, 4.5], "duration": 0.05}
    runner.run("scenes", grid, folder)
    for x, y, halvings in (("contact_position=0.06:0.1:3", "mu=0:0.5:3", 0), ("theta=0:10:3", "mu=0:0.5:3", 2)):
        plane = maps.plane_of(x, y, halvings)
        sweep = maps.sweep_of(plane, "growth_rate", {}, halvings)
        file = maps.file_of(plane, "growth_rate", folder)
        runner.execute(sweep.plan(file), "sync")
    return folder
