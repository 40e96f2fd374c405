"""Realisations that follow different motions are told apart; those that scatter about one are not."""

import numpy as np
import pytest
import xarray as xr

from fivcore import Scene, Until, simulate
from studies import registry
from studies.answering import summary
from studies.asking.sweep import sweep_of
from studies.motion import ensemble, mixed, run
from studies.plotting import planes

REST, VIBRATES = run.REGIMES.index("steady sliding"), run.REGIMES.index("irregular")
V = 2e-3


def realisations(count, stick, rms, rng, regime=VIBRATES, spread=(0.005, 1e-4)):
    """Members that follow one motion, with standard errors as uncertain as those of runs; at rest without any."""
    found = {"regime": np.full(count, regime)}
    for name, mean, sd in zip(mixed.QUANTITIES, (stick, rms), spread, strict=True):
        found[name] = mean + sd * rng.normal(size=count)
        found[f"{name}_se"] = sd * np.sqrt(rng.chisquare(mixed.observe.FEWEST, count) / mixed.observe.FEWEST)
    if regime == REST:
        rest = np.zeros(count), rng.uniform(0.0, 1e-3, count), np.zeros(count), np.full(count, np.nan)
        found |= dict(zip((*mixed.QUANTITIES, *(f"{name}_se" for name in mixed.QUANTITIES)), rest, strict=True))
    return found


def together(*groups, order=None):
    """Groups of members as one ensemble, in an order."""
    joined = {name: np.concatenate([group[name] for group in groups]) for name in groups[0]}
    return joined if order is None else {name: values[order] for name, values in joined.items()}


@pytest.mark.parametrize("members", [2, 4, 12])
def test_one_motion_is_told_for_several_as_often_as_said(members, monkeypatch):
    monkeypatch.setattr(mixed, "LEVEL", level := 0.01)
    rng, count = np.random.default_rng(members), 2000
    # What is too small to matter is none, which would lower the rate.
    ensembles = (realisations(members, 0.7, 5.0, rng, spread=(0.05, 0.5)) for _ in range(count))
    alarms = sum(len(mixed.motions(found, V)) > 1 for found in ensembles)
    assert abs(alarms - count * level) < 4.0 * np.sqrt(count * level)


@pytest.mark.parametrize("members", [2, 4, 12])
def test_equal_motions_of_unequal_certainty_are_hardly_ever_told_for_several(members):
    rng = np.random.default_rng(members)
    for _ in range(500):
        ends = [realisations(members // 2, 0.7, 5e-3, rng, spread=(f * 0.005, f * 1e-4)) for f in (1, 2)]
        assert len(mixed.motions(together(*ends), V)) == 1
    assert len(mixed.motions(realisations(members, 0.0, 0.0, rng, REST), V)) == 1


@pytest.mark.parametrize("others", [1, 3, 6])
def test_two_motions_are_told_with_their_members(others):
    """A vibration beside rest, and beside another one, 16 standard errors away in one quantity."""
    rng = np.random.default_rng(others)
    for k in range(200):
        order = rng.permutation(12)
        second = ((others, 0.0, 0.0, rng, REST), (others, 0.79, 5.1e-3, rng), (others, 0.71, 6.7e-3, rng))[k % 3]
        found = together(realisations(12 - others, 0.71, 5.1e-3, rng), realisations(*second), order=order)
        parts = [[*np.flatnonzero(order < 12 - others)], [*np.flatnonzero(order >= 12 - others)]]
        expected = sorted(parts, key=lambda part: (-len(part), part[0]))
        assert [part.tolist() for part in mixed.motions(found, V)] == expected


def test_three_motions_members_without_a_value_and_unknown_errors():
    rng = np.random.default_rng(0)
    rest = realisations(3, 0.0, 0.0, rng, REST)
    slow, fast = (realisations(4, stick, 5e-3, rng) for stick in (0.9, 0.5))
    none = {name: np.full(2, np.nan) for name in slow} | {"regime": np.zeros(2, dtype=int)}
    found = together(slow, none, rest, fast)
    apart = [part.tolist() for part in mixed.motions(found, V)]
    assert apart == [[0, 1, 2, 3], [9, 10, 11, 12], [6, 7, 8]]
    # Runs too short to know their errors still differ from rest, and not among themselves.
    short = together(rest, slow | {f"{name}_se": np.full(4, np.nan) for name in mixed.QUANTITIES})
    assert [part.tolist() for part in mixed.motions(short, V)] == [[3, 4, 5, 6], [0, 1, 2]]
    assert mixed.motions(none, V) == []


def result(groups):
    """A result of `regimes` with the statistics of each group of runs as a point."""
    points, data = [ensemble.statistics(runs) for runs in groups], {}
    for name, variable in ensemble.outputs().items():
        words = [word.replace(" ", "_") for word in (variable.flags or {}).values()]
        flags = {"flag_values": [*variable.flags], "flag_meanings": " ".join(words)} if words else {}
        values = [point[name] for point in points]
        data[name] = (("V", *variable.dims), values, {"units": variable.units, **flags})
    coords = {"V": ("V", np.arange(1.0, len(groups) + 1.0), {"units": "m s-1"}), "members": len(groups[0])}
    return xr.Dataset(data | {"status": ("V", np.ones(len(groups), dtype=np.int8))}, coords)


def test_only_different_motions_are_told():
    def runs(V, mu=0.2):
        ramps = 1e-3 * (1.0 + 0.13 * np.arange(4))
        return [simulate(Scene(V, 5.0, mu, 9.0), Until(0.01, 0.3, 3.0), ramp=ramp) for ramp in ramps]

    one, two, five, rest = runs(1e-3), runs(2e-3), runs(5e-3), runs(2e-3, 0.05)
    data = result([one, two, five, rest, one[:2] + five[:2], two[:3] + rest[:1]])
    np.testing.assert_array_equal(data["motions"], [1, 1, 1, 1, 2, 2])
    (line,) = mixed.told(data)
    assert line.startswith("At 2 of 6 points the realisations follow different motions")
    assert "V = 5000 mm/s: 2 of 4 intermittent (stick 0.9" in line
    assert "V = 6000 mm/s: 3 of 4 irregular (stick 0.7" in line
    assert ", 1 steady sliding (stick 0). All" in line
    assert not [*mixed.told(data.isel(V=slice(4)))]
    assert line in [*summary.parts(registry.load("regimes"), data.assign_attrs(sweep="regimes"))]
    # Both values and shares add up to the mean, whose standard error is no longer the small one of each motion.
    for name in mixed.QUANTITIES:
        mean = (data["motion_share"] * data[f"motion_{name}"]).sum("motion")
        np.testing.assert_allclose(mean, data[name])
        np.testing.assert_allclose(data[f"motion_{name}"][5, 0], data[f"member_{name}"][5, :3].mean())
        spread, error = data[f"{name}_std"] / 2.0, data[f"{name}_se"]
        np.testing.assert_allclose(error[4:], spread[4:])
        assert (error[:3] < 2.0 * spread[:3]).all()
    np.testing.assert_array_equal(data["member_motion"][4:], [[1, 1, 2, 2], [1, 1, 1, 2]])


def test_results_without_realisations_say_nothing():
    data = result([[simulate(Scene(2e-3, 5.0, 0.05, 9.0), 0.3)]])
    assert not [*mixed.told(data)]
    assert not [*mixed.told(data.drop_vars("motions"))]


@pytest.fixture(scope="module")
def regimes():
    """A result of `regimes` in which the realisations of the first point follow two motions."""
    few = {"members": 2, "max_duration": 0.02, "min_duration": 0.01}
    sweep = sweep_of(registry.load("regimes"), {"V": np.array([2e-3, 4e-3]), "mu": np.array([0.05, 0.06]), **few})
    data = sweep.plan().run("sync").load()
    data["motions"][0, 0] = 2
    data["motion_share"][0, 0, 0, 0, :2], data["motion_stick_fraction"][0, 0, 0, 0, :2] = 0.5, [0.0, 0.7]
    return data


def test_planes_and_curves_mark_them(regimes):
    draw, same = registry.load("regimes").figure, regimes.assign(motions=xr.ones_like(regimes["motions"]))
    for dataset, count in ((regimes, 1), (same, 0)):
        lines = [line for axes in draw(dataset).axes for line in axes.lines]
        marks = [line for line in lines if line.get_marker() == planes.MIXED["marker"]]
        assert sum(len(line.get_xdata()) for line in marks) == 4 * count
        stick = draw(dataset.isel(mu=[0])).axes[0].collections
        points = [group.get_offsets().filled(np.nan) for group in stick if hasattr(group, "get_sizes")]
        points = [group[np.isfinite(group[:, 1])] for group in points if len(group) > 1]
        np.testing.assert_allclose(points, [[[2.0, 0.0], [2.0, 0.7]]] * count)


def test_queries_say_so_and_show_each_motion(regimes, here, tmp_path):
    regimes.to_netcdf(tmp_path / "two.nc")
    lines = here("query", "two.nc", "--show", "V,mu,stick_fraction")
    assert "At 1 of 4 points the realisations follow different motions" in lines.stderr
    each = here("query", "two.nc", "--show", "motion_share,motion_stick_fraction", "--where", "motions > 1")
    assert each.stdout.split()[3:] == ["1", "0.5", "0", "2", "0.5", "0.7"]
    assert not each.stderr
