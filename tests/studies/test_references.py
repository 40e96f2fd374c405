"""Every study computed from nothing is what the reference holds, within the scatter of chaotic motion."""

import numpy as np
import pytest
import xarray as xr

import studies
from studies import registry
from studies.comparison import CHAOTIC, scatter
from tests import HOME

HELD = HOME / "results" / "reference"

# Share of the values of a figure that must lie so near: two peaks of a spectrum may rival each other, a scene may
# stand between two regimes.
NEAR = 0.85
# What the checks of `stress` find is chaotic too, and one of them is a cost: only what came of them is compared.
FOUND = ("value", "bound", "margin")


def share_near(kept: xr.DataArray, new: xr.DataArray, absolute: float, relative: float) -> float:
    """Share of values that lie within the limits, or are missing in both."""
    a, b = kept.values.astype(float), new.values.astype(float)
    near = np.abs(a - b) <= absolute + relative * np.abs(a)
    return float(np.mean(near | (np.isnan(a) & np.isnan(b))))


@pytest.mark.slow
@pytest.mark.parametrize("name", registry.NAMES)
def test_every_study_computed_from_nothing_is_what_is_held(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FIV_RESULTS", raising=False)
    with xr.open_dataset(HELD / name / f"{name}.nc") as file:
        kept = file.load()
    new = studies.run(name).load()
    assert (tmp_path / "results" / name / f"{name}.png").stat().st_size > 10_000
    assert set(new.variables) == set(kept.variables)
    assert new.sizes == kept.sizes
    np.testing.assert_array_equal(new["status"], kept["status"])
    for dim in kept.dims:
        if dim in kept.coords and dim != "onset":
            np.testing.assert_array_equal(new[dim], kept[dim])
    compared = 0
    for variable in kept.data_vars:
        if variable in ("status", "error", "wall_time") or (name == "stress" and variable in FOUND):
            continue
        if name not in CHAOTIC:
            xr.testing.assert_allclose(new[variable], kept[variable], rtol=1e-6, atol=1e-9)
        elif "regime" in str(variable) and kept[variable].attrs.get("flag_meanings"):
            assert np.mean(new[variable].values == kept[variable].values) >= NEAR, variable
        else:
            limits = scatter(str(variable))
            if limits is None:
                continue
            assert share_near(kept[variable], new[variable], *limits) >= NEAR, variable
        compared += 1
    assert compared >= 2
