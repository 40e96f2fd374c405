"""Realisations that follow different motions are told; those that scatter about one are not."""

import numpy as np
import xarray as xr

from fivcore import Scene, Until, simulate
from studies import registry, summary
from studies.motion import ensemble, mixed


def result(groups):
    """A result of `regimes` with the statistics of each group of runs as a point."""
    points = [ensemble.statistics(runs) for runs in groups]
    names = [f"{name}{part}" for name in mixed.QUANTITIES for part in ("", "_std", "_se")]
    data = {name: ("V", [point[name] for point in points]) for name in names}
    coords = {"V": ("V", np.arange(1.0, len(groups) + 1.0), {"units": "m s-1"}), "members": len(groups[0])}
    return xr.Dataset(data | {"status": ("V", np.ones(len(groups), dtype=np.int8))}, coords)


def test_only_different_motions_are_told():
    def runs(V, mu=0.2):
        ramps = 1e-3 * (1.0 + 0.13 * np.arange(4))
        return [simulate(Scene(V, 5.0, mu, 9.0), Until(0.01, 0.3, 3.0), ramp=ramp) for ramp in ramps]

    one, two, five, rest = runs(1e-3), runs(2e-3), runs(5e-3), runs(2e-3, 0.05)
    data = result([one, two, five, rest, one[:2] + five[:2], rest[:1] + two[:3]])
    np.testing.assert_array_equal(mixed.mixed(data), [False, False, False, False, True, True])
    (line,) = mixed.told(data)
    assert line.startswith("At 2 of 6 points the realisations follow different motions")
    assert line.endswith("V = 5000 mm/s; V = 6000 mm/s.")
    assert not [*mixed.told(data.isel(V=slice(4)))]
    assert line in [*summary.parts(registry.load("regimes"), data.assign_attrs(sweep="regimes"))]


def test_results_without_realisations_say_nothing():
    data = result([[simulate(Scene(2e-3, 5.0, 0.05, 9.0), 0.3)]])
    assert not [*mixed.told(data)]
    assert not [*mixed.told(data.drop_vars("members"))]
