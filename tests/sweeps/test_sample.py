"""Samples: draws in a grid's place, which grow, resume, and are told apart."""

import json

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from sweeps import Axis, Sample, StoreError, Sweep, Variable
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


def sweep(count, method="sobol", seed=0, distributions=FLAT):
    return waves.sweep(Sample(distributions, count, method, seed))


def rows(grid):
    return np.column_stack([axis.values for axis in grid.axes.values()])


@pytest.mark.parametrize("method", ["sobol", "random"])
def test_a_longer_sample_begins_with_the_shorter(method):
    whole = rows(Sample(KINDS, 300, method, 7))
    for count in (1, 5, 64, 100):
        np.testing.assert_array_equal(rows(Sample(KINDS, count, method, 7)), whole[:count])
    assert not np.array_equal(rows(Sample(KINDS, 300, method, 8)), whole)


@pytest.mark.parametrize(("method", "close"), [("sobol", 2e-3), ("latin", 1e-3), ("random", 3e-2)])
def test_draws_are_of_their_distributions(method, close):
    drawn = Sample(KINDS, 4096, method, 3).axes
    for name, each in KINDS.items():
        values = drawn[name].values
        assert stats.kstest(values, each.cdf).statistic < close
        assert values.mean() == pytest.approx(each.mean(), abs=2.0 * close * each.std())
        assert values.std() == pytest.approx(each.std(), rel=3.0 * close)
    together = np.corrcoef([drawn[name].values for name in KINDS])
    assert np.abs(together - np.eye(len(KINDS))).max() < 0.05


def test_a_latin_hypercube_has_one_draw_in_each_layer():
    values = Sample({"x": stats.uniform(0.0, 1.0)}, 50, "latin").axes["x"].values
    assert sorted((50.0 * values).astype(int)) == [*range(50)]


def test_draws_have_no_more_digits_than_every_processor_agrees_in():
    values = Sample(KINDS, 64).axes["normal"].values
    assert [float(f"{value:.12g}") for value in values] == values.tolist()


@pytest.mark.usefixtures("small_pieces")
@pytest.mark.parametrize("method", ["sobol", "random"])
def test_only_new_draws_are_computed(path, method):
    sweep(8, method).plan(path).run("sync")
    assert len(LOG) == 8
    assert sweep(20, method).plan(path).todo == 12
    whole = sweep(20, method).plan(path).run("sync")
    assert len(LOG) == len(set(LOG)) == 20
    # A shorter one is part of it, and a run in one go is the same.
    part = sweep(5, method).plan(path).run("sync")
    assert len(LOG) == 20
    xr.testing.assert_identical(part["root"], whole["root"][:5])
    at_once = sweep(20, method).plan().run("sync")
    for name in ("sample", "x", "y", "root", "row"):
        np.testing.assert_array_equal(whole[name], at_once[name])


@pytest.mark.usefixtures("small_pieces")
def test_an_interrupted_sample_goes_on(path):
    interrupted(sweep(16).plan(path), 5)
    kept = len(LOG)
    assert 5 <= kept < 16
    # It may grow at once.
    plan = sweep(24).plan(path)
    assert plan.todo == 24 - kept
    assert (plan.run("sync")["status"] == 1).all()
    assert len(LOG) == len(set(LOG)) == 24


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (sweep(8, seed=1), 'sample drawn by = "sobol, seed 0" there, "sobol, seed 1" here'),
        (sweep(8, "random"), 'sample drawn by = "sobol, seed 0" there, "random, seed 0" here'),
        (
            sweep(8, distributions=FLAT | {"x": stats.uniform(1.0, 3.0)}),
            'sample x = "uniform(1.0, 2.0)" there, "uniform(1.0, 3.0)" here',
        ),
        (waves.sweep({"sample": range(8), "x": [1.0], "y": [1.0]}), "sample"),
    ],
)
def test_other_draws_are_refused(path, other, told):
    sweep(8).plan(path).run("sync")
    with pytest.raises(StoreError, match=r"start over with fresh \(--fresh\)") as refused:
        other.plan(path)
    assert told in str(refused.value)
    assert other.plan(path, fresh=True).todo == 8


def test_a_latin_hypercube_does_not_grow(path):
    sweep(8, "latin").plan(path).run("sync")
    assert sweep(8, "latin").plan(path).todo == 0
    with pytest.raises(StoreError, match='"latin, seed 0, 8 of them" there, "latin, seed 0, 9 of them" here'):
        sweep(9, "latin").plan(path)


def test_a_processor_that_draws_otherwise_is_refused(path, monkeypatch):
    sweep(8).plan(path).run("sync")
    right = samples.quantiles
    monkeypatch.setattr(samples, "quantiles", lambda *given: right(*given) * (1.0 + 1e-11))
    with pytest.raises(StoreError, match=r"has other points: x = .* there, .* here, at sample = 0; start over"):
        sweep(12).plan(path)


def test_a_plain_reader_finds_the_draws(path):
    grid = Sample(
        {"mass": stats.norm(2.0, 0.1)},
        6,
        axes={"t": Axis([1.0, 2.0], "s")},
        about={"mass": ("kg", "mass at A")},
    )
    made = Sweep("m", lambda points: {"y": points["mass"] * points["t"]}, grid, {"y": Variable("kg s")})
    made.plan(path).run("sync")
    with xr.open_dataset(path) as data:
        assert data["y"].dims == ("sample", "t")
        assert "mass" in data.coords
        assert data["mass"].dims == ("sample",)
        assert data["mass"].attrs == {"units": "kg", "long_name": "mass at A"}
        np.testing.assert_array_equal(data["y"], data["mass"] * data["t"])
        assert json.loads(data.attrs["identity"])["sample"] == {
            "drawn by": "sobol, seed 0",
            "mass": "norm(2.0, 0.1)",
        }


def test_a_plain_grid_is_what_it_was(path):
    waves.sweep().plan(path).run("sync")
    with xr.open_dataset(path) as data:
        assert "sample" not in json.loads(data.attrs["identity"])


def test_distributions_are_told_apart():
    class Own:
        def ppf(self, share):
            return 2.0 * share

    assert samples.described(stats.norm(loc=1, scale=2)) == "norm(loc=1, scale=2)"
    assert samples.described(Own()).startswith("quantiles [0.002, 0.2, 0.5, 1.0")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (({}, 4), r"distributions = \{\}: there must be at least one"),
        (({"x": 3.0}, 4), r"x = 3.0: it must be a distribution, like scipy.stats.norm\(0, 1\)"),
        ((FLAT, 0), "count = 0: it must be a whole number from 1 to"),
        ((FLAT, True), "count = True"),
        ((FLAT, 4, "halton"), "method = 'halton': it must be one of sobol, latin, random"),
        ((FLAT, 4, "sobol", -1), "seed = -1: it must be a whole number, 0 or above"),
        (({"sample": stats.norm()}, 4), "sample is the number of the draw"),
        (({"x": stats.norm(np.nan, 1.0)}, 4), "x = .*: it gives a draw that is not finite"),
        (({"status": stats.norm()}, 4), "Grid: axes has the name 'status'"),
    ],
)
def test_wrong_arguments(given, message):
    with pytest.raises(ValueError, match=message):
        Sample(*given)
