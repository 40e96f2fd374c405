"""Word and frequency of a vibration, by a look at its recorded series."""

import numpy as np
import pytest
from scipy.signal import periodogram

from fivcore import Friction, Scene, Structure, flutter_onsets, painleve_mu, simulate

PIN = Structure.from_modes(
    [500.0, 800.0, 1700.0], [0.4, 0.1, 0.4], [-0.9, -0.7, -0.4], load=[-0.4, -0.1, 0.0], damping_ratio=0.002
)


def drawn(count):
    """Structures with up to five modes that vibrate, beyond their first onset of flutter."""
    seed = 0
    while count:
        rng, seed = np.random.default_rng(seed), seed + 1
        n = int(rng.integers(2, 6))
        load, frequency = -rng.uniform(0.2, 1.0, n), np.sort(rng.uniform(200.0, 4000.0, n))
        own = Structure.from_modes(frequency, -load, -rng.uniform(0.2, 1.5, n), load=load, damping_ratio=0.003)
        V, share = 10.0 ** rng.uniform(-2.5, -0.5), rng.uniform(1.1, 1.6)
        found = flutter_onsets(own, 0.0)
        if len(found.mu) and share * found.mu[0] < 0.9 * painleve_mu(own, 0.0):
            count -= 1
            yield pytest.param(Scene(V, 0.0, share * found.mu[0], 50.0, own), id=f"drawn {seed}")


def belt(V):
    """A mass on a belt whose friction is lower in slip: it sticks and slips at the frequency of its spring."""
    own = Structure.from_modes([50.0, 0.0], [0.0, 1.0], [1.0, 0.0], load=[0.0, -1.0], damping_ratio=1e-3)
    return Scene(V, 0.0, 0.4, 10.0, own, Friction(kinetic_ratio=0.5, decay_speed=0.0))


def looked_at(scene, duration):
    """Regime and frequency by the series of a run after its settling, and its summary."""
    unit = scene.rig.time_scale
    run = simulate(scene, duration * unit, record=("velocity_B", "slip_velocity", "state"), sample_rate=None)
    start = run.summary["first_slip_time"] + 0.1 * unit
    if np.isnan(start):
        return "undecided or stuck", start, run.summary
    t, velocity, state = (each[run.time >= start] for each in (run.time, run.velocity_B, run.state))
    even = np.arange(t[0], t[-1], 2e-5 * unit)
    velocity, state = np.interp(even, t, velocity), state[np.searchsorted(t, even)]
    frequency, power = periodogram(velocity, 1.0 / (even[1] - even[0]), "hann", detrend="constant")
    inside = (frequency > 200.0 / unit) & (frequency < 10e3 / unit)
    main = frequency[inside][np.argmax(power[inside])]
    edges = np.flatnonzero(np.diff(np.r_[False, state == 1, False]))
    lengths = (edges[1::2] - edges[::2]) * (even[1] - even[0])
    long = lengths[lengths > 1.0 / main]
    late = run.slip_velocity[run.time > 0.75 * run.time[-1]]
    if np.all(state == 2) and np.ptp(late) < 0.02 * scene.V:
        return "steady sliding", main, run.summary
    if long.sum() > 0.1 * (even[-1] - even[0]):
        return "intermittent", main, run.summary
    lag, around = round(20.0 / main / (even[1] - even[0])), round(0.5 / main / (even[1] - even[0]))
    about = velocity - velocity.mean()
    part = len(about) - lag - around
    products = [(about[:part] * about[k : k + part]).mean() for k in range(lag - around, lag + around + 1)]
    most = max(products) / (about[:part] ** 2).mean()
    words = {"periodic": most > 0.88, "irregular": most < 0.92}  # by which of them near 0.9, neither is wrong
    return " or ".join(word for word, holds in words.items() if holds), main, run.summary


SCENES = [
    *(
        pytest.param(Scene(V, 0.0, mu, 500.0, PIN), id=f"pin {V} {mu}")
        for V in (0.05, 0.03, 0.1)
        for mu in (0.3, 0.4)
    ),
    *(pytest.param(belt(V), id=f"belt {V}") for V in (0.005, 0.02, 0.05)),
    *drawn(20),
]


@pytest.mark.parametrize(
    "scene",
    [pytest.param(*p.values, id=p.id, marks=[pytest.mark.slow] if k % 6 else []) for k, p in enumerate(SCENES)],
)
def test_what_is_said_is_what_is_seen(scene):
    regime, main, summary = looked_at(scene, 2.0)
    assert summary["regime"] in regime
    if summary["regime"] == "periodic":
        assert summary["dominant_frequency"] == pytest.approx(main, rel=0.01)
