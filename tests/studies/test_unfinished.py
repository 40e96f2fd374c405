"""Results of runs under way or interrupted: what there is, is drawn and told, of every study."""

import numpy as np
import pytest
import xarray as xr

from studies import registry, runner
from studies.answering import summary
from studies.answering.results import settled
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
# `half` draws every figure; that nothing is there yet, is told and drawn of one study of each kind.
KINDS = ("fig5", "contact", "regimes", "robust")
QUICK = [*((name, "half") for name in registry.NAMES), *((name, "none") for name in KINDS)]
CASES = [
    pytest.param(name, each, marks=[pytest.mark.slow] * ((name, each) not in QUICK))
    for name in registry.NAMES
    for each in HOLES
]


@pytest.mark.parametrize(("name", "holes"), CASES)
def test_what_is_there_is_told_and_drawn(name, holes, results):
    study, data = results(name, HOLES[holes])
    pending = int((data["status"] == PENDING).sum())
    text = summary.text(summary.parts(study, data), 100)
    assert (
        f"{pending} of {data['status'].size} points are not computed yet" in " ".join(text.split()) or not pending
    )
    assert runner.draw(study, data)[""].axes
    assert int((data["status"] == DONE).sum()) + pending == data["status"].size


@pytest.mark.parametrize(
    "holes", [pytest.param(each, marks=[pytest.mark.slow] * (each != "half")) for each in HOLES]
)
@pytest.mark.parametrize(
    ("sides", "quantities"),
    [
        (("theta=2:8:3", "mu=0.1:0.3:3"), "growth_rate,unstable_modes"),
        (("V=1e-3:5e-3:3", None), "velocity_rms,regime"),
        (("theta=2:8:3", None), "onset_mu"),
    ],
)
def test_maps_too(sides, quantities, holes, tmp_path):
    fix = {"max_duration": 0.1, "min_duration": 0.02} if "regime" in quantities else {}
    study, planned = runner.plan_map(*sides, quantities, fix, out=tmp_path)
    data = planned.run("sync")
    pending = xr.DataArray(HOLES[holes](data["status"].shape), dims=data["status"].dims)
    for name in [*study.outputs]:
        data[name] = data[name].where(~pending).assign_attrs(data[name].attrs)
    data["status"] = data["status"].where(~pending, PENDING).assign_attrs(data["status"].attrs)
    assert "not computed yet" in " ".join(summary.text(summary.parts(study, data), 100).split())
    assert runner.draw(study, data)[""].axes
