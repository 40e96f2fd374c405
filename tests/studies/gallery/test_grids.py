"""Grids of every shape have a figure and a report: a point, an axis, one plane and several, failed points."""

import re

import numpy as np
import pytest

from studies import registry
from studies.plotting import figures
from studies.spec import evenly

SCENE = {"V": 5e-3, "theta": 5.0, "mu": 0.2, "F": 9.0}
NINE = np.linspace(1e-3, 5e-3, 9)
INCLINATIONS, FRICTIONS = evenly(-4.0, 16.0, 21), evenly(0.0, 0.5, 26)
# What is given besides; without a solution from mu = 5 on at 40 degrees.
SHORT = {
    "scenes": {"duration": 0.05, "settle": 0.0} | SCENE,
    "regimes": {"least": 0.0, "most": 0.12, "members": 2.0} | SCENE,
    **{name: {"duration": 0.1} for name in ("fig7", "contact", "fig11")},
}
FAIL = {"theta": 40.0, "mu": 7.0}


@pytest.mark.parametrize(
    ("name", "given", "panels", "title", "line"),
    [
        ("scenes", {}, 2, "One scene", "1 scene of .*"),
        ("scenes", {"theta": [-5.0, 0.0, 5.0]}, 2, "Scenes along θ", "3 scenes of .*"),
        ("scenes", {"V": [1e-4, 1e-3, 1e-2]}, 2, "Scenes along V", "3 scenes of .*"),
        ("scenes", FAIL | {"V": [2e-3, 4e-3]}, 2, "Scenes along V", r"Scenes: 2 failed\."),
        ("scenes", FAIL | {"V": [-5e-3, 5e-3], "theta": [5.0, 40.0]}, 1, "μ = 7, F = 9 N", r"Scenes: 4 failed\."),
        (
            "scenes",
            {"V": [2e-3, 4e-3], "theta": [5.0, 10.0], "mu": [0.2, 0.3], "F": np.arange(1.0, 7.0)},
            4,
            "Regime of the motion\nruns of 0.05 s",
            r"and 8 more in the file\.",
        ),
        ("regimes", {}, 3, "V = 5 mm/s", "1 scene on the paper's rig: .*"),
        ("regimes", {"mu": np.linspace(0.0, 0.4, 5)}, 3, "V = 5 mm/s", "5 scenes on the paper's rig: .*"),
        ("regimes", {"V": [2e-3, 5e-3], "mu": [0.05, 0.11, 0.2]}, 8, "F = 9 N", "6 scenes on .*"),
        ("regimes", {"theta": [0.0, 5.0], "F": [4.5, 9.0]}, 8, "V = 5 mm/s", "4 scenes on .*"),
        (
            "regimes",
            {"V": [2e-3, 5e-3], "mu": [0.1, 0.2], "theta": [0.0, 5.0], "F": [4.5, 9.0]},
            4,
            "2 runs of each",
            "16 scenes on .*",
        ),
        ("regimes", FAIL | {"V": [2e-3, 5e-3], "mu": [0.2, 5.0]}, 8, "θ = 40°", " *failed +2 .*"),
        ("regimes", FAIL | {"V": [2e-3, 5e-3]}, 3, "θ = 40°", " *failed +2 .*"),
        (
            "regimes",
            {"V": [1e-4, 2e-4], "mu": [0.2, 0.3], "head_mass": 2.0},
            8,
            "undecided: 4 of 4",
            "4 scenes on another rig than the paper's: .*",
        ),
        ("stability", {"theta": [5.0], "mu": FRICTIONS}, 2, "θ = 5°", "A single inclination has no window.*"),
        ("stability", {"theta": INCLINATIONS, "mu": [0.2]}, 2, "μ = 0.2", "Windows of instability at mu = 0.2.*"),
        ("stability", {"theta": [15.0], "mu": [0.2]}, 2, "θ = 15°", r"points with a growing mode +0 of 1 .*"),
        ("stability", {"theta": [0.0, 5.0], "mu": [0.0]}, 2, "μ = 0", "No pair is unstable at mu = 0,.*"),
        ("stability", {"theta": [-5.0, -4.0], "mu": [0.1, 0.3]}, 4, "", "No flutter onset in this range."),
        ("stability", {"theta": [70.0, 80.0], "mu": [0.0, 1.0]}, 4, "", "No flutter onset in this range."),
        ("stability", {"theta": [2.0, 8.0], "mu": [0.1, 0.3], "head_mass": 0.5}, 6, "not the paper's", "onset .*"),
        ("fig7", {"V": NINE}, 12, r" of 9\)\nwith the published scheme's", "Velocity of B, .*"),
        ("contact", {"V": NINE}, 18, r" of 9\)\nwith the published scheme's", "The contact, .*"),
        ("fig11", {"theta": np.linspace(-20.0, 20.0, 9)}, 3, r" of 9\)\nwith the pub", "Velocity of B, .*"),
    ],
)
def test_every_grid_has_its_figure_and_report(name, given, panels, title, line, computed):
    data = computed(name, **SHORT.get(name, {}) | given)
    study = registry.load(name)
    with figures.style():
        figure = study.draw(data)
        figure.canvas.draw()
    assert len(figure.axes) == panels
    assert re.search(title, figure.get_suptitle())
    assert re.search(f"^{line}$", study.report(data), re.MULTILINE)
