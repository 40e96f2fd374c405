"""Results of other constants, variables, units or samples are refused, and the message says what differs."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from studies import runner
from studies.gallery import table4
from sweeps import Axis, Grid, Sample, StoreError, Variable, json_equal
from sweeps.fingerprint.identity import differences
from tests.helpers import waves
from tests.helpers.waves import VARIABLES, sweep


@dataclasses.dataclass
class Rig:
    mass: float = 1.0
    parts: tuple = (1, 2)


def wide(points, factor=1.0, rig=None):
    return waves.wave(points)


XY = {"x": Axis([1.0, 2.0], "m"), "y": Axis([3.0], "m")}
SAMPLE = {"x": stats.uniform(1.0, 2.0)}
BEFORE = {"constants": {"factor": 2.0, "rig": Rig()}, "grid": Grid(XY)}
ZIPPED = Grid({"x": Axis([1.0], "m"), "y": Axis([3.0], "m")}, zipped=("x", "y"))
CHANGES = [
    ({"constants": {"factor": 2.0 * (1.0 + 2e-16), "rig": Rig()}}, "factor = 2.0 there, 2.0000000000000004 here"),
    ({"constants": {"factor": 2.0, "rig": Rig(1.5)}}, "rig.mass = 1.0 there, 1.5 here"),
    ({"constants": {"factor": 2.0, "rig": Rig(1.0, (1, 3))}}, "rig.parts = [1, 2] there, [1, 3] here"),
    ({"constants": {"factor": 2.0}}, 'rig = {"mass": 1.0, "parts": [1, 2]} there, nothing here'),
    ({"variables": VARIABLES | {"root": Variable("s")}}, 'variables root.units = "m" there, "s" here'),
    ({"variables": VARIABLES | {"root": Variable("m", digits=4)}}, "variables root.digits = null there, 4 here"),
    ({"variables": {"root": Variable("m")}}, "variables count = {"),
    ({"grid": Grid(XY | {"x": Axis([1.0], "km")})}, 'axes x.units = "m" there, "km" here'),
    ({"grid": Grid(XY | {"z": Axis([1.0])})}, "axes z = nothing there"),
    ({"grid": Grid(XY | {"x": Axis(["1.0"], "m")})}, "axes x.text = false there, true here"),
    ({"grid": ZIPPED}, 'groups = [["x"], ["y"]] there, [["x", "y"]] here'),
    ({"coords": {"power": Axis([1, 2, 4])}}, "coords power = "),
    ({"function": wide}, "the code of tests.sweeps.fingerprint.test_identity"),
    ({"grid": Sample(SAMPLE, 4)}, "sample = nothing there"),
]


@pytest.mark.parametrize(("changes", "message"), CHANGES)
def test_results_of_another_declaration_are_refused_naming_what_differs(path, changes, message):
    sweep(**BEFORE).plan(path).run("sync")
    with pytest.raises(StoreError, match=r"has other results: [^\n]*; start over with fresh") as caught:
        sweep(**(BEFORE | changes)).plan(path)
    assert message in str(caught.value)
    assert sweep(**(BEFORE | changes)).plan(path, fresh=True).todo


def test_names_titles_and_more_values_are_no_other_results(path):
    sweep(**BEFORE).plan(path).run("sync")
    grid = Grid(XY | {"x": Axis([1, 2, 5], "m", "another name")})
    changes = {"grid": grid, "title": "another", "remark": "again", "request": {"a": 1}}
    assert sweep(**(BEFORE | changes)).plan(path).todo == 1
    named = VARIABLES | {"root": Variable("m", "another name")}
    assert sweep(**(BEFORE | {"variables": named})).plan(path).todo == 0


PAIRS = [
    (pd.DataFrame({"a": [1.0]}), pd.DataFrame({"a": [2.0]})),
    (pd.Series([1.0]), pd.Series([2.0])),
    (np.arange(3), np.arange(4)),
    (1 + 2j, 1 - 2j),
    ({"a": [None, True]}, {"a": [None, False]}),
    (float("nan"), 0.0),
]


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_constants_are_compared_by_value(path, one, other):
    sweep(function=wide, constants={"rig": one}).plan(path).run("sync")
    assert sweep(function=wide, constants={"rig": one}).plan(path).todo == 0
    with pytest.raises(StoreError, match=r"rig\S* = .* there, .* here"):
        sweep(function=wide, constants={"rig": other}).plan(path)


def test_differences_are_short_and_nan_equals_nan():
    assert differences({"code": {"a": "1"}}, {"code": {"a": "2", "b": "1"}}) == "the code of a, b has changed"
    many = {"constants": {str(k): "long" * 50 for k in range(9)}}
    assert len(differences(many, {"constants": {}})) < 400
    assert json_equal({"a": float("nan")}, {"a": float("nan")})


def test_a_tuned_head_mass_is_rounded_so_that_another_processor_resumes(tmp_path, monkeypatch):
    whole = table4.tune_head_mass
    runner.run("table4", {}, tmp_path)
    monkeypatch.setattr(table4, "tune_head_mass", lambda *given: float(whole(*given)) * (1.0 + 1e-15))
    assert runner.plan("table4", {}, tmp_path).todo == 0
    monkeypatch.setattr(table4, "tune_head_mass", lambda *given: float(whole(*given)) * (1.0 + 1e-8))
    with pytest.raises(StoreError, match=r"has other results: .*rig\.head_mass = "):
        runner.plan("table4", {}, tmp_path)
