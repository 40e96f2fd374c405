"""Results of runs under way or interrupted: what there is, is drawn and told, of every study."""

import numpy as np
import pytest
import xarray as xr

from studies import registry, runner, summary
from studies.results import settled
from sweeps import DONE, PENDING
from tests import HOME

KEPT = HOME / "results" / "reference"


@pytest.fixture(scope="module")
def results():
    """The reference of each study as if its run were under way, `missing(shape)` of its points being pending."""

    def unfinished(name, missing):
        with xr.open_dataset(KEPT / name / f"{name}.nc") as data:
            data = settled(data.load())
        study = registry.load(name)
        outputs = [each for each in study.outputs if each in data]
        # Nothing is derived yet.
        data = data.drop_vars(set(data.data_vars) - {*outputs, "status", "wall_time"})
        pending = xr.DataArray(missing(data["status"].shape), dims=data["status"].dims)
        for each in outputs:
            data[each] = data[each].where(~pending).assign_attrs(data[each].attrs)
        return study, data.assign(
            status=data["status"].where(~pending, PENDING).assign_attrs(data["status"].attrs)
        )

    return unfinished


def all_but_one(shape):
    missing = np.ones(shape, bool)
    missing.flat[-1] = False
    return missing


HOLES = {
    "none": lambda shape: np.ones(shape, bool),
    "one": all_but_one,
    "half": lambda shape: np.arange(np.prod(shape)).reshape(shape) >= np.prod(shape) // 2,
    "scattered": lambda shape: np.random.default_rng(0).random(shape) < 0.5,
}
SLOW = ("one", "scattered")  # `half` draws every figure, too


@pytest.mark.parametrize(
    "holes", [pytest.param(each, marks=pytest.mark.slow) if each in SLOW else each for each in HOLES]
)
@pytest.mark.parametrize("name", registry.NAMES)
def test_what_is_there_is_told_and_drawn(name, holes, results):
    study, data = results(name, HOLES[holes])
    pending = int((data["status"] == PENDING).sum())
    text = summary.text(summary.parts(study, data), 100)
    assert (
        f"{pending} of {data['status'].size} points are not computed yet" in " ".join(text.split()) or not pending
    )
    assert runner.draw(study, data)[""].axes
    assert int((data["status"] == DONE).sum()) + pending == data["status"].size
