"""The accessor `.fiv`: rows, figure and summary of a dataset, scenes and rigs of its points."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import studies.query.accessor  # noqa: F401 - registers `.fiv`
from fivcore import Friction, Rig, Scene
from studies import registry
from studies.declaring.parameters import FRICTION, RIG, rig_numbers
from studies.query.query import select
from studies.study import Study
from sweeps import InputError
from tests.query.trial import trial

OWN = Rig.of(p1_length=0.06, p2_elements=60, d1=40.0, head_mass=2.0)
SPEEDS, LENGTHS = np.array([1e-3, 2e-3, 4e-3]), np.array([0.05, 0.06])


def result(**others) -> xr.Dataset:
    """A result over V and p1_length; theta varies with V; other numbers are fixed."""
    numbers = rig_numbers(OWN) | {"mu": 0.3, "F": 5.0} | others
    fixed = {name: ((), value) for name, value in numbers.items()}
    theta = {"theta": ("V", [5.0, 6.0, 7.0]), "p1_length": LENGTHS, "V": SPEEDS}
    return xr.Dataset({"x": (("V", "p1_length"), np.zeros((3, 2)))}, fixed | theta)


def test_scene_and_rig_are_those_of_the_file():
    assert result().fiv.scene(V=0.002 + 1e-10, p1_length=0.06) == Scene(2e-3, 6.0, 0.3, 5.0, OWN)
    assert result().isel(V=0).fiv.scene(p1_length=0.06) == Scene(1e-3, 5.0, 0.3, 5.0, OWN)
    assert result().fiv.scene(theta=7, p1_length=0.05).rig == Rig.of(**rig_numbers(OWN) | {"p1_length": 0.05})
    assert result().drop_vars(["V", "mu"]).fiv.rig(p1_length=0.06) == OWN


def test_the_law_of_friction_is_that_of_the_file():
    """Words vary like numbers; a file of before, without any, is of friction that does not fall."""
    words = {"decay": ("decay", ["exponential", "rational"])}
    data = result(kinetic_ratio=0.7, decay_speed=0.02).drop_vars("p1_length").isel(p1_length=0)
    data = data.assign_coords(words | {"p1_length": 0.06})
    found = data.fiv.scene(V=2e-3, decay="rational")
    assert found == Scene(2e-3, 6.0, 0.3, 5.0, OWN, Friction(0.7, 0.02, "rational"))
    for decay, message in (("linear", "no such value"), (1.0, "must be one number of an axis")):
        with pytest.raises(InputError, match=message):
            data.fiv.scene(V=2e-3, decay=decay)
    for name in FRICTION:
        with pytest.raises(InputError, match=f"^{name}: "):
            data.drop_vars(name).fiv.scene(V=2e-3, **{} if name == "decay" else {"decay": "rational"})


@pytest.mark.parametrize("name", [*RIG, "V", "theta", "mu", "F"])
def test_what_the_file_lacks_is_never_the_papers(name):
    at = {each: value for each, value in (("V", 1e-3), ("p1_length", 0.06)) if each != name}
    data = result().drop_vars(name)
    for method in (data.fiv.scene, data.fiv.rig)[: 1 + (name in RIG)]:
        with pytest.raises(InputError, match=f"^{name}: it is not in the file"):
            method(**at)


def test_points_that_are_none():
    for at, message in (
        ({"p1_length": 0.06}, "V: give one of its values, like V=0.001"),
        ({"V": 0.0021, "p1_length": 0.06}, "V = 0.0021: the result has no such value; the nearest is 0.002"),
        ({"nu": 1}, "nu = 1: it must be one number of an axis; these are "),
        ({"V": "a"}, "V = 'a': it must be one number"),
        ({"V": [1e-3]}, "V = [0.001]: it must be one number"),
    ):
        with pytest.raises(InputError) as problem:
            result().fiv.scene(**at)
        assert message in str(problem.value)


def test_rows_figure_and_summary(monkeypatch):
    data = trial().assign_attrs(sweep="trial", configuration='{"axes": {}, "constants": {}}')
    with pytest.warns(UserWarning, match="a has no value 2.5; the nearest is 2") as warned:
        rows = data.fiv.query("a in (1, 2.5)", show="a,b", limit=3)
    assert warned[0].filename == __file__
    assert rows.equals(select(trial(), "a == 1", "a,b", limit=3))
    monkeypatch.setattr(registry, "_registered", {})
    registry.register(Study("trial", "A trial", "", {}, {"size": ("m", "")}, lambda: {}))
    assert isinstance(data.fiv.plot(), Figure)
    assert "19 of 20 points computed" in data.fiv.summary()
