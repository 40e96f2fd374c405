"""A rig and its own matrices have the same stability, motion and thresholds, at either sign of V."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy import sparse

from fivcore import equilibrium, flutter_onsets, lyapunov_exponent, simulate, sliding_modes
from fivcore.contact.reduced import default_cutoff, reduced_model
from fivcore.transient.normalised import Normalised
from studies.accuracy.rigs import drawn_scene
from studies.declaring.parameters import RUN
from studies.motion import following, knock, regimes, starts
from studies.motion.jobs import each_scene
from tests.benchmarks.constants import apart, shares
from tests.helpers.structures import beams

NUMBER, QUICK = 25, (2, 7)
SLOW = [k for k in range(NUMBER) if k not in QUICK]
SCENES = [*QUICK, *(pytest.param(k, marks=pytest.mark.slow) for k in SLOW)]
OPTIONS = {"duration": 0.3, "step": None, "numerical_damping": "none"}


@lru_cache(maxsize=64)
def pair(number, convert=np.asarray, **given):
    """A random scene of beams, by odd numbers at V < 0, leaning the other way; and that of their matrices."""
    scene = drawn_scene(1957, number)
    scene = scene.mirrored() if number % 2 else scene
    own = beams(convert, scene.rig, scene.theta, **given)
    return scene, replace(scene, theta=0.0, rig=own)


def seen(scene):
    """As stability sees it: the rig and the angle of a scene at V > 0."""
    normalised = Normalised.of(scene)
    return normalised.rig, normalised.theta


def vibrates(label):
    return regimes.is_of(label, *regimes.VIBRATING)


@pytest.mark.parametrize("number", SCENES)
def test_onsets_and_growth(number):
    scene, own = pair(number)
    one, other = flutter_onsets(*seen(scene)), flutter_onsets(*seen(own))
    np.testing.assert_allclose(other.mu, one.mu, rtol=1e-8)
    np.testing.assert_allclose(other.frequency, one.frequency, rtol=1e-8)
    rates = [sliding_modes(*seen(each), each.mu).growth_rate for each in (scene, own)]
    np.testing.assert_allclose(*rates, rtol=1e-7)


@pytest.mark.parametrize("given", [{}, {"fmax": 10e3}, {"convert": sparse.csc_array}])
@pytest.mark.parametrize("number", SCENES)
def test_the_model_that_moves(number, given, monkeypatch):
    """With one cut-off, modes and contact are the same, and so are balance and knock."""
    if "convert" in given:
        for module in ("structure", "finite_elements"):
            monkeypatch.setattr(f"fivcore.{module}.DENSE_SIZE", 10)
    scene, own = pair(number, **given)
    cutoff = min(default_cutoff(scene.rig), 1.0001 * float(own.rig.motion.frequency[-1]))
    models = [reduced_model(*seen(each), cutoff) for each in (scene, own)]
    for name in ("stiffness", "damping"):
        np.testing.assert_allclose(*(np.sort(getattr(model, name)) for model in models), 1e-7, 1e-3)
    for name in ("W", "K", "C", "default_step"):
        np.testing.assert_allclose(*(getattr(model, name) for model in models), 1e-6)
    seen_by = []
    for each, model in zip((scene, own), models, strict=True):
        turned = each if each.V > 0.0 else each.mirrored()
        rest, (_, struck) = equilibrium(turned), starts.directions(turned, ["knock"])[0]
        rows = np.stack([model.normal, model.tangential, model.inertia, model.output, model.load])
        parts = rows * np.stack([rest, struck])[:, None, model.kept]
        seen_by.append([*parts.sum(axis=2), (rows**2).sum(axis=1), np.abs(parts).sum(axis=2)[0]])
    for one, other in zip(*seen_by, strict=True):
        np.testing.assert_allclose(other, one, 1e-6, 1e-6 * np.abs(one).max())


def members(scene, cutoff, count=6, duration=1.0):
    runs = [simulate(scene, duration, cutoff=cutoff, ramp=1e-3 * (1.0 + 0.37 * k)).summary for k in range(count)]
    names = ("stick_fraction", "slip_fraction", "separation_fraction")
    values = np.array([[run[name] for name in names] for run in runs])
    return values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(count)


@pytest.mark.parametrize("number", SCENES)
def test_shares_with_one_cutoff(number):
    scene, own = pair(number)
    (one, error), (other, more) = (members(each, default_cutoff(scene.rig)) for each in (scene, own))
    assert np.all(np.abs(one - other) < 4.0 * np.hypot(error, more) + 1e-3)


@pytest.mark.slow
def test_shares_by_default():
    beyond = np.array([apart(*map(shares, pair(number)))[1] for number in range(NUMBER)])
    assert np.count_nonzero(beyond > 0.02) <= NUMBER // 10, beyond
    assert beyond.max() < 0.05, beyond


@pytest.mark.parametrize("number", [QUICK[1], *(pytest.param(k, marks=pytest.mark.slow) for k in (2, *SLOW))])
def test_knock_thresholds(number):
    """Within their standard errors, which chaotic transients make large."""
    scene, own = pair(number)
    mu = 0.9 * float(flutter_onsets(*seen(scene)).mu[0])
    options = OPTIONS | {"cutoff": default_cutoff(scene.rig)}
    found = [
        each_scene([replace(each, mu=mu)], lambda each: knock.threshold(each, 1e-2, 0.02, options))
        for each in (scene, own)
    ]
    (one, other), errors = ([float(each[name][0]) for each in found] for name in knock.OUTPUTS)
    assert np.isnan(one) == np.isnan(other)
    assert np.isnan(one) or abs(one - other) <= 4.0 * np.hypot(*errors), (one, other, errors)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(NUMBER))
def test_hysteresis(number):
    """Where vibration begins and ceases as mu rises and falls: within one value."""
    scene, own = pair(number)
    values = float(flutter_onsets(*seen(scene)).mu[0]) * np.linspace(0.7, 1.15, 10)
    run = {name: each.default for name, each in RUN.items()} | {"cutoff": default_cutoff(scene.rig)}
    found = []
    for each in (scene, own):
        chain = tuple(replace(each, mu=float(mu)) for mu in values)
        found.append(vibrates(following.follow([chain], 1.0, 0.2, **run)["regime"][0].astype(np.int8)).sum(axis=0))
    assert np.all(np.abs(found[0] - found[1]) <= 1)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(NUMBER))
def test_lyapunov_exponents(number):
    scene, own = pair(number)
    # Where sticks are long, two seconds are too short for a standard error.
    for duration in (2.0, 8.0, 32.0):
        one, other = (lyapunov_exponent(each, duration, cutoff=default_cutoff(scene.rig)) for each in (scene, own))
        if np.isfinite(error := np.hypot(one.standard_error, other.standard_error)):
            break
    assert abs(one.value - other.value) < 3.0 * error
