"""Constants that are computed from a request are compared but for rounding; what is asked for, exactly."""

import numpy as np
import pytest

from studies import runner
from studies.gallery import table4
from sweeps import Axis, Grid, StoreError, Sweep, Variable

WHOLE = table4.tune_head_mass


def test_another_processor_takes_up_what_one_has_computed(tmp_path, monkeypatch):
    """A tuned head mass has another last digit there; another head mass is another computation."""
    runner.run("table4", {}, tmp_path)

    def perturbed(change):
        monkeypatch.setattr(table4, "tune_head_mass", lambda *given: float(change(WHOLE(*given))))

    # The last two are past an edge of any rounding to twelve digits.
    for factor in (None, 1.0 + 5e-12, 1.0 - 5e-12):
        perturbed(lambda mass, factor=factor: mass * factor if factor else np.nextafter(mass, 9.0))
        assert runner.plan("table4", {}, tmp_path).todo == 0
    assert runner.plan("table4", {"mode": [1, 9]}, tmp_path).todo == 1
    perturbed(lambda mass: mass * (1.0 + 1e-8))
    with pytest.raises(StoreError, match=r"holds something else: rig\.head_mass = "):
        runner.plan("table4", {}, tmp_path)
    # What is asked for is compared exactly.
    monkeypatch.setattr(table4, "tune_head_mass", WHOLE)
    said = r"holds something else: .*contact_position = 0\.085 there, 0\.08500000000"
    with pytest.raises(StoreError, match=said):
        runner.plan("table4", {"contact_position": 0.085 * (1.0 + 1e-12)}, tmp_path)


def sweep(constant, request):
    grid, variables = Grid({"x": Axis([1.0, 2.0])}), {"y": Variable()}
    return Sweep("named", lambda points, a: {"y": points["x"]}, grid, variables, {"a": constant}, request=request)


@pytest.mark.parametrize(
    ("request_", "constant", "same"),
    [
        ({"b": 1}, 2.0 + 4e-16, True),
        ({"b": 1}, 2.0 + 1e-8, False),
        ({"b": 2}, 2.0 + 4e-16, False),
        ({}, 2.0 + 4e-16, False),
        ({}, 2.0, True),
        ({"b": 2}, 2.0, True),
    ],
)
def test_rounding_is_of_one_request(tmp_path, request_, constant, same):
    sweep(2.0, {"b": 1}).plan(tmp_path / "named.nc").run("sync")
    if same:
        assert sweep(constant, request_).plan(tmp_path / "named.nc").todo == 0
    else:
        with pytest.raises(StoreError, match=r"a = 2\.0 there"):
            sweep(constant, request_).plan(tmp_path / "named.nc")
