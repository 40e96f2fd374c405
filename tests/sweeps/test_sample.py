"""Samples: draws as points, which grow, resume, and are told apart."""

import json

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from sweeps import Axis, Sample, StoreError, Sweep
from sweeps import sample as samples
from tests.helpers import waves
from tests.helpers.waves import LOG, interrupted

FLAT = {"x": stats.uniform(1.0, 2.0), "y": stats.triang(0.5, 1.0, 1.0)}
KINDS = {
    "normal": stats.norm(0.2, 0.02),
    "flat": stats.uniform(1.9, 0.2),
    "skewed": stats.lognorm(0.3, scale=2e-3),
    "peaked": stats.triang(0.25, 1.0, 4.0),
}


def sweep(count, seed=0, distributions=FLAT):
    return waves.sweep(Sample(distributions, count, seed=seed))


def rows(grid):
    return np.column_stack([axis.values for axis in grid.axes.values()])


def test_a_longer_sample_begins_with_the_shorter():
    whole = rows(Sample(KINDS, 300, seed=7))
    for count in (1, 5, 64, 100):
        np.testing.assert_array_equal(rows(Sample(KINDS, count, seed=7)), whole[:count])
    assert not np.array_equal(rows(Sample(KINDS, 300, seed=8)), whole)


def test_draws_follow_their_distributions_independently():
    axes, close = Sample(KINDS, 4096, seed=3).axes, 2e-3
    for name, each in KINDS.items():
        values = axes[name].values
        assert stats.kstest(values, each.cdf).statistic < close
        assert values.mean() == pytest.approx(each.mean(), abs=2.0 * close * each.std())
        assert values.std() == pytest.approx(each.std(), rel=3.0 * close)
    together = np.corrcoef([axes[name].values for name in KINDS])
    assert np.abs(together - np.eye(len(KINDS))).max() < 0.05


def test_draws_have_only_the_digits_on_which_processors_agree():
    values = Sample(KINDS, 64).axes["normal"].values
    assert [float(f"{value:.12g}") for value in values] == values.tolist()


@pytest.mark.usefixtures("small_pieces")
def test_only_new_draws_are_computed(path):
    sweep(8).plan(path).run("sync")
    interrupted(sweep(12).plan(path), 2)
    whole = sweep(20).plan(path).run("sync")
    part = sweep(5).plan(path).run("sync")
    assert len(LOG) == len(set(LOG)) == 20
    xr.testing.assert_identical(part["root"], whole["root"][:5])
    at_once = sweep(20).plan().run("sync")
    for name in ("sample", "x", "y", "root", "row"):
        np.testing.assert_array_equal(whole[name], at_once[name])


OTHERS = [
    (sweep(8, seed=1), 'sample method = "sobol, seed 0" there, "sobol, seed 1" here'),
    (sweep(8, distributions=FLAT | {"x": stats.uniform(1.0, 3.0)}), 'sample x = "uniform(1.0, 2.0)" there'),
    (waves.sweep({"sample": range(8), "x": [1.0], "y": [1.0]}), "sample"),
]


@pytest.mark.parametrize(("other", "message"), OTHERS)
def test_other_draws_are_refused(path, other, message):
    sweep(8).plan(path).run("sync")
    with pytest.raises(StoreError, match=r"start over \(fresh=True\)") as refused:
        other.plan(path)
    assert message in str(refused.value)
    assert other.plan(path, fresh=True).todo == 8


def test_a_processor_with_other_draws_is_refused(path, monkeypatch):
    sweep(8).plan(path).run("sync")
    right = samples.quantiles
    monkeypatch.setattr(samples, "quantiles", lambda *given: right(*given) * (1.0 + 1e-11))
    with pytest.raises(
        StoreError, match=r"has other points: x = .* there, .* here, at sample = 0; choose another"
    ):
        sweep(12).plan(path)


def test_draws_are_coordinates_with_units_and_may_be_combined_with_axes(path):
    axes, units = {"t": Axis([1.0, 2.0], "s")}, {"mass": ("kg", "mass at A")}
    grid = Sample({"mass": stats.norm(2.0, 0.1)}, 6, axes=axes, units=units)
    Sweep("m", lambda points: {"y": points["mass"] * points["t"]}, grid, ["y"]).plan(path).run("sync")
    with xr.open_dataset(path) as data:
        assert data["y"].dims == ("sample", "t")
        assert data["mass"].dims == ("sample",)
        assert data["mass"].attrs == {"units": "kg", "long_name": "mass at A"}
        np.testing.assert_array_equal(data["y"], data["mass"] * data["t"])
        described = json.loads(data.attrs["fingerprint"])["sample"]
    assert described == {"method": "sobol, seed 0", "mass": "norm(2.0, 0.1)"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (({}, 4), r"distributions = \{\}: there must be at least one"),
        (({"x": 3.0}, 4), r"x = 3.0: it must be a distribution, like scipy.stats.norm\(0, 1\)"),
        ((FLAT, 0), "count = 0: it must be "),
        ((FLAT, True), "count = True"),
        ((FLAT, 4, "latin"), "method = 'latin': it must be 'sobol'"),
        ((FLAT, 4, "sobol", -1), "seed = -1: it must be "),
        (({"sample": stats.norm()}, 4), "sample is the number of the draw"),
        (({"x": stats.norm(np.nan, 1.0)}, 4), "x = .*: it gives a draw that is not finite"),
        (({"status": stats.norm()}, 4), "Grid: axes has the name 'status'"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        Sample(*arguments)
