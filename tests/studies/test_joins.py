"""Results of two requests join by xarray, as every dimension has a coordinate."""

import numpy as np
import pytest
import xarray as xr

import studies
from tests import HOME

HOW = {"join": "outer", "combine_attrs": "drop_conflicts"}


def test_runs_with_two_and_three_onsets_join(tmp_path):
    few = studies.run("fig5", theta=3.0, mu=[0.1, 0.25], out=tmp_path / "few")
    many = studies.run("fig5", theta=8.0, mu=[0.1, 0.25], out=tmp_path / "many")
    assert (few.sizes["onset"], many.sizes["onset"]) == (2, 3)
    joined = xr.concat([few, many], "theta", **HOW)
    assert joined["onset"].values.tolist() == [1, 2, 3]
    for each in (few, many):
        part = joined["onset_mu"].sel(theta=each["theta"]).dropna("onset")
        np.testing.assert_array_equal(part, each["onset_mu"])
    files = [tmp_path / name / "fig5" / "fig5.nc" for name in ("many", "few")]
    with xr.open_mfdataset(
        files, preprocess=lambda data: data.expand_dims("theta"), data_vars="all", **HOW
    ) as read:
        assert read["theta"].values.tolist() == [3.0, 8.0]
        xr.testing.assert_equal(read["onset_mu"].compute(), joined["onset_mu"])
    assert len(joined.fiv.query("growth_rate > 0 and theta == 8 and mu == 0.25")) == 3


def test_runs_of_two_speeds_combine(tmp_path):
    point = {"theta": [5.0], "mu": [0.2], "F": [9.0], "duration": 0.02}
    runs = [studies.run("scenes", V=[V], out=tmp_path / f"{V}", **point) for V in (5e-3, 2e-3)]
    joined = xr.combine_by_coords(runs, data_vars="all", **HOW)
    xr.testing.assert_equal(joined["velocity_rms"], xr.concat([each["velocity_rms"] for each in runs[::-1]], "V"))


@pytest.mark.parametrize(
    "file", sorted((HOME / "results" / "reference").rglob("*.nc")), ids=lambda file: file.stem
)
def test_every_dimension_has_a_coordinate(file):
    with xr.open_dataset(file) as data:
        assert set(data.dims) == set(data.indexes)
