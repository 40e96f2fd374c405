"""Starts by their motion: an oscillator on a belt, whose unstable cycle bounds the starts that slide steadily.

That of bSTAB (Stender, Hoffmann, Nonlinear Dynamics 107, 2022), x'' + 2 xi x' + x = mu(V - x') with the friction
(1 + exp(-2 |u|)) / 2 and xi = 0.05; starts are uniform in (x, x') in [-2, 2] x [0, 2].
"""

from functools import cache

import numpy as np
import pytest
from matplotlib.path import Path
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from fivcore import Friction, Scene, State, simulate
from studies import registry
from studies.asking.sweep import sweep_of
from studies.motion.run import REGIMES
from studies.physics.classical import block_of, slipping

XI, LAW = 0.05, Friction(0.5, 0.5)
BLOCK, BOX = block_of(1.0, XI), np.array([[-2.0, 0.0], [2.0, 2.0]])
PUBLISHED = {1.25: 0.080197, 1.5: 0.307126, 1.7: 0.494112}
STEADY = REGIMES.index("steady sliding")


@cache
def unstable_cycle(V):
    """Its points, (n, 2), from motion backwards in time, which it attracts."""
    rates, centre = slipping(V, LAW, XI), LAW.kinetic_ratio + 0.5 * np.exp(-V / LAW.decay_speed)

    def around(x, **options):
        def top(t, y):
            return y[1] if t > 1.0 else 1.0

        top.terminal, top.direction = True, 1.0
        how = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "events": top}
        return solve_ivp(lambda t, y: -np.array(rates(t, y)), (0.0, 20.0), [centre + x, 0.0], **how, **options)

    radius = brentq(lambda x: around(x).y[0, -1] - centre - x, 0.2, 1.05 * V, xtol=1e-12)
    found = around(radius, dense_output=True)
    return found.sol(np.linspace(0.0, found.t[-1], 20_000, endpoint=False)).T


def share_inside(V):
    """Area of the box within the cycle over that of the box."""
    points = unstable_cycle(V)
    for axis in (0, 1):
        for sign, end in ((1.0, BOX[0, axis]), (-1.0, BOX[1, axis])):
            height = sign * (points[:, axis] - end)
            following, after = np.roll(points, -1, axis=0), np.roll(height, -1)
            cuts = np.flatnonzero(height * after < 0.0)
            share = (height[cuts] / (height[cuts] - after[cuts]))[:, None]
            crossing = points[cuts] + share * (following[cuts] - points[cuts])
            inside = np.flatnonzero(height >= 0.0)
            points = np.concatenate([points[inside], crossing])[np.argsort(np.append(inside, cuts + 0.5))]
    x, y = points.T
    return 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / np.prod(BOX[1] - BOX[0])


def duration(V):
    """Twenty times the time in which a disturbance decays to its e-th part."""
    return 20.0 / (XI + 0.5 * LAW.slope(V))


@cache
def drawn(V, most, **options):
    """The study's result at one speed."""
    given = {"V": V, "mu": 1.0, "F": 1.0, "kinetic_ratio": 0.5, "decay_speed": 0.5, "about": "rest", "knock": 0.0}
    given |= {
        "displacement": BOX[:, 0],
        "velocity": BOX[:, 1],
        "most": most,
        "width": 1e-3,
        "duration": duration(V),
    }
    return (
        sweep_of(registry.load("basins"), given | options, structure=BLOCK.to_dict()).plan().run("sync").squeeze()
    )


def check_share(V, most, expected):
    data = drawn(V, most)
    assert int(data["draws"]) == most
    share = float(data["share"].sel(kind="steady sliding"))
    assert abs(share - expected) <= np.sqrt(expected * (1.0 - expected) / most)
    assert data["share_low"].sel(kind="steady sliding") < expected < data["share_high"].sel(kind="steady sliding")


def differing(V, most):
    """How many labels differ from the side of the cycle that the start lies on."""
    data = drawn(V, most)
    places = np.stack([data["start_displacement"], data["start_velocity"]], axis=1)
    return int(np.sum(Path(unstable_cycle(V)).contains_points(places) != (data["label"].values == STEADY)))


def test_areas_within_the_unstable_cycle_are_those_that_are_published():
    for V, share in PUBLISHED.items():
        assert share_inside(V) == pytest.approx(share, abs=1e-5)


@pytest.mark.parametrize("V", [1.5, 1.7])
def test_the_share_of_steady_sliding_is_the_area_within_the_unstable_cycle(V):
    check_share(V, 256, PUBLISHED.get(V, share_inside(V)))
    assert differing(V, 256) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("V", [*PUBLISHED, 1.4, 1.6])
def test_of_a_thousand_starts_three_are_on_the_wrong_side_at_most(V):
    check_share(V, 1000, PUBLISHED.get(V, share_inside(V)))
    assert differing(V, 1000) <= 3


def exactly(V, data, k, time=200.0):
    """Whether a start leads to steady sliding by method "exact"."""
    x, v = (float(data[name][k]) for name in ("start_displacement", "start_velocity"))
    scene = Scene(V, 0.0, 1.0, 1.0, BLOCK, LAW)
    run = simulate(scene, time, "exact", initial=State.of(scene, [0.0, x], [0.0, v]), settle=0.5 * time, step=0.1)
    return run.summary["regime"] == "steady sliding"


def test_exact_motion_of_ten_starts_has_the_same_labels():
    data = drawn(1.7, 256)
    steady = data["label"].values[:10] == STEADY
    assert {*steady} == {True, False}
    assert [exactly(1.7, data, k) for k in range(10)] == steady.tolist()


@pytest.mark.slow
@pytest.mark.parametrize("V", [1.3, 1.35, 1.4, 1.45, 1.5, 1.55, 1.6, 1.65, 1.7, 1.75])
def test_ten_shares_are_those_by_exact(V):
    data = drawn(V, 8)
    assert [exactly(V, data, k, duration(V)) for k in range(8)] == (data["label"].values == STEADY).tolist()
