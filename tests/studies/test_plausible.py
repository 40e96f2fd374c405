"""What is unusual for such a rig: told with its unit, kept in the file, refused if asked."""

import numpy as np
import pytest
import xarray as xr

import studies
from studies import registry
from studies.plausible import UnusualWarning, unusual
from studies.rig import rig_settings
from sweeps import InputError

UNITS = {name: each.units for name, each in rig_settings().items()} | {"V": "m s-1", "F": "N", "mu": "1"}


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"V": 2.0}, "V = 2 m s-1 is unusual: 1e-07 to 0.5 m s-1 is usual; mm/s without their unit?"),
        ({"V": [-1e-3, -3.0]}, "V = 3 m s-1 is unusual"),
        ({"theta": 0.1}, "theta = 0.1 degree is unusual: 0.2 to 80 degree is usual; radians? it is in degrees"),
        ({"p1_length": 50.0}, "p1_length = 50 m is unusual: 0.005 to 2 m is usual; mm without their unit?"),
        ({"p2_young_modulus": 210.0}, "p2_young_modulus = 210 Pa is unusual"),
        ({"p1_density": 7.85}, "p1_density = 7.85 kg m-3 is unusual"),
        ({"p1_length": 0.05, "p1_thickness": [1.5e-3, 0.01]}, "p1_length / p1_thickness = 5 is unusual: below 8"),
    ],
)
def test_it_is_told_with_its_unit(values, line):
    assert [each for each in unusual(values, UNITS) if each.startswith(line)]


def test_the_papers_rig_and_every_study_are_usual_and_zero_is():
    assert unusual({name: each.value for name, each in rig_settings().items()}, UNITS) == []
    assert unusual({"theta": 0.0, "mu": 0.0, "d1": 0.0, "d2": 0.0, "head_mass": 0.0}, UNITS) == []
    for name in registry.NAMES:
        study = registry.load(name)
        values = {name: each.value for name, each in study.settings.items()}
        values |= {name: axis.values for name, axis in study.axes.items()}
        assert unusual(values, {each: study.units(each) for each in values}) == [], name


def test_only_what_was_asked_for_is_judged():
    assert unusual({"V": 2.0, "theta": 5.0}, UNITS, {"theta"}) == []


def test_it_is_kept_in_the_files_history_and_refused_if_that_is_asked(tmp_path):
    with pytest.warns(UnusualWarning, match="theta = 0.1 degree is unusual"):
        studies.run("fig5", theta=0.1, mu=[0.0, 0.1], out=tmp_path)
    with xr.open_dataset(tmp_path / "fig5" / "fig5.nc") as data:
        assert data.attrs["history"].endswith("usual; radians? it is in degrees")
        assert "remark" not in data.attrs
    from studies import runner

    with pytest.raises(InputError, match=r"^theta = 0.1 degree is unusual.*leave --strict out"):
        runner.plan("fig5", {"theta": 0.1}, tmp_path / "other", strict=True)
    assert not (tmp_path / "other").exists()


def test_python_takes_what_the_command_line_takes(tmp_path):
    """Texts with units, a schedule, progress, series, and maps."""
    seen = []
    data = studies.run("fig5", mu="0:0.3:4", theta="6deg", out=tmp_path, scheduler="sync", progress=seen.append)
    assert data["mu"].values.tolist() == [0.0, 0.1, 0.2, 0.3]
    assert seen[-1].done == 4
    np.testing.assert_array_equal(
        studies.run("fig5", mu=[0.1], theta=6.0, out=tmp_path)["frequency"][0], data["frequency"][1]
    )
    run = studies.run(
        "scenes", V="2mm/s", theta=5, mu=0.2, F="9N", duration="20ms", record=["velocity_B"], out=tmp_path
    )
    assert run["velocity_B"].dims[-1] == "elapsed"
    line = studies.map("p1_thickness=1.4mm:1.6mm:3", quantity="onset_mu", fix={"theta": "8deg"}, out=tmp_path)
    assert line["onset_mu"].shape == (3, 1)
    plane = studies.map("theta=5:9:2", "mu=0.1:0.2:2", "unstable_modes", fix={"p1_length": 0.052}, out=tmp_path)
    assert plane["unstable_modes"].shape == (2, 2)
    assert (tmp_path / "map" / "unstable_modes-theta-mu-p1_length=0.052.png").exists()
