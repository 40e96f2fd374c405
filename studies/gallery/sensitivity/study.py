"""Which numbers of the rig move the flutter onsets of three pairs of modes, and by how much, over the inclination.

A pair is one branch of onsets over theta, followed from where pairs are numbered. The file holds derivatives as
elasticities and, beside them, the change when a number is 1 % larger in fact. Under a heavy head mu - tan(theta)
is e (tan(theta) + 1 / tan(theta)), e not knowing theta: it has the same elasticities at every inclination.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import InputError, OnsetSensitivity, Rig, checks, flutter_onsets, onset_curves, onset_sensitivity
from fivcore.rig import BEAM_NUMBERS, RIG_NUMBERS
from studies import paper
from studies.motion import transients
from studies.rig import rig_of, rig_settings
from studies.spec import evenly
from studies.study import Setting, Study, deferred
from sweeps import Axis, Variable

Array = NDArray[Any]

PAIRS = 3
# Share by which a number is made larger.
STEP = 0.01
# On the imaginary axis friction is a function of frequency, which therefore tells onsets apart. Further from what
# the derivative predicts for the changed rig an onset may be another, born where this one met a recovery.
SAME = 0.01
# What the onsets can follow: point_b is where one looks, and element counts have no derivative.
PARAMETERS = (
    "theta",
    *(name for name in RIG_NUMBERS if name != "point_b"),
    *(f"{beam}_{name}" for beam in ("p1", "p2") for name in BEAM_NUMBERS if name != "elements"),
)
VARIABLES = {
    "onset_mu": Variable("1", "coefficient of friction at the pair's flutter onset", ("pair",)),
    "onset_frequency": Variable("Hz", "frequency at the pair's flutter onset", ("pair",)),
    "elasticity_mu": Variable("1", "relative change of onset_mu for that of the parameter, derivative", ("pair",)),
    "elasticity_frequency": Variable(
        "1", "relative change of onset_frequency for that of the parameter, derivative", ("pair",)
    ),
    "change_mu": Variable("1", "change of onset_mu when the parameter is 1 % larger, solved again", ("pair",)),
    "change_frequency": Variable(
        "Hz", "change of onset_frequency when the parameter is 1 % larger, solved again", ("pair",)
    ),
    "fold": Variable(
        "1",
        "whether the onset meets a recovery, without derivatives",
        ("pair",),
        "int8",
        flags={0: "no", 1: "yes"},
    ),
}


def sensitivities(
    points: Mapping[str, Any], *, rig: Rig, pairs_theta: float, mu_max: float, fmax: float
) -> dict[str, Array]:
    """The variables at each point; NaN for a pair without an onset there, so for all at theta <= 0."""
    results = {name: np.full((len(points["theta"]), PAIRS), np.nan) for name in VARIABLES}
    results["fold"][:] = 0.0
    for row, (theta, name) in enumerate(zip(points["theta"].tolist(), points["parameter"].tolist(), strict=True)):
        onsets, places = pairs_at(rig, theta, pairs_theta, fmax, mu_max)
        mu, frequency = changed(rig, theta, name, onsets, fmax, mu_max)
        values = onsets.mu, onsets.frequency, onsets.mu_elasticity[name], onsets.frequency_elasticity[name]
        every = *values, mu - onsets.mu, frequency - onsets.frequency, onsets.fold
        for variable, value in zip(VARIABLES, every, strict=True):
            results[variable][row, places >= 0] = value[places[places >= 0]]
    return results


@lru_cache(maxsize=8)
def pairs_at(
    rig: Rig, theta: float, start: float, fmax: float, mu_max: float
) -> tuple[OnsetSensitivity, NDArray[np.intp]]:
    """All onsets at `theta`, and which of them are on the branches of the lowest ones at `start`; -1 for none."""
    angles = np.unique([start, theta])
    branches = onset_curves(rig, angles, fmax, mu_max).mu
    first, last = branches[np.searchsorted(angles, [start, theta])]
    onsets, places = onset_sensitivity(rig, theta, fmax, mu_max), np.full(PAIRS, -1)
    for pair, branch in enumerate(np.argsort(first)[:PAIRS]):
        # At the given angles the curves have the bits of `flutter_onsets`.
        if np.isfinite(first[branch]) and last[branch] in onsets.mu:
            places[pair] = np.flatnonzero(onsets.mu == last[branch])[0]
    return onsets, places


def changed(
    rig: Rig, theta: float, name: str, onsets: OnsetSensitivity, fmax: float, mu_max: float
) -> tuple[Array, Array]:
    """Friction and frequency of the onsets where one number is 1 % larger.

    NaN where there is no onset within SAME of the frequency that the derivative predicts, or no such rig.
    """
    mu, frequency = np.full((2, len(onsets.mu)), np.nan)
    try:
        # An onset may rise beyond the friction of interest.
        after = flutter_onsets(*larger(rig, theta, name), fmax, 2.0 * mu_max)
    except InputError:
        return mu, frequency
    predicted = onsets.frequency * (1.0 + STEP * np.nan_to_num(onsets.frequency_elasticity[name]))
    apart = np.abs(np.log(after.frequency[:, None] / predicted))
    j, k = np.nonzero((apart == apart.min(0, initial=SAME)) & (apart == apart.min(1, initial=SAME, keepdims=True)))
    mu[k], frequency[k] = after.mu[j], after.frequency[j]
    return mu, frequency


def larger(rig: Rig, theta: float, name: str) -> tuple[Rig, float]:
    """The rig and the inclination with one number 1 % larger."""
    if name == "theta":
        return rig, (1.0 + STEP) * theta
    if name in RIG_NUMBERS:
        return replace(rig, **{name: (1.0 + STEP) * getattr(rig, name)}), theta
    beam, _, number = name.partition("_")
    whole = getattr(rig, beam)
    return replace(rig, **{beam: replace(whole, **{number: (1.0 + STEP) * getattr(whole, number)})}), theta


def constants(settings: Mapping[str, float]) -> dict[str, Any]:
    """The rig, where pairs are numbered, the friction of interest and the band."""
    rig, _ = rig_of({**settings, "theta": paper.THETA})
    return {"rig": rig, **{name: settings[name] for name in ("pairs_theta", "mu_max")}, "fmax": transients.BAND}


def check(axes: Mapping[str, Axis], fixed: Mapping[str, Any]) -> None:
    """Refuse what is out of range; a point whose onsets cannot be isolated fails by itself."""
    for theta in axes["theta"].values[[0, -1]]:
        checks.theta_degrees(theta)
    allowed = "an angle between 0 and 90 degrees, both excluded"
    start = checks.number("pairs_theta", fixed["pairs_theta"], allowed, lambda angle: 0.0 < angle < 90.0)
    with suppress(ArithmeticError):
        flutter_onsets(fixed["rig"], start, fixed["fmax"], fixed["mu_max"])


STUDY = Study(
    name="sensitivity",
    title="Sensitivity of the flutter onsets to the numbers of the rig",
    question="Which numbers of the rig move the friction and the frequency of each flutter onset, how far does "
    "1 % move them, and is that so at every inclination?",
    paper="Section 3.4.2: at 5 degrees pairs of modes are first unstable at mu = 0.12 (2800 Hz), 0.16 (400 Hz) "
    "and 0.23 (7700 Hz). Section 3.6: the geometry of the contact matters for instability; of the rig's numbers "
    "only theta is varied.",
    axes={
        "theta": Axis(evenly(0.5, 20.0, 40), "degree", "inclination of P1"),
        "parameter": Axis(PARAMETERS, long_name="number that is changed, the others kept; theta in degrees"),
    },
    settings={name: each for name, each in rig_settings().items() if name != "theta"}
    | {
        "pairs_theta": Setting(paper.THETA, "degree", "inclination at which pairs are numbered by onset_mu"),
        "mu_max": Setting(1.0, "1", "largest friction of interest"),
    },
    function=sensitivities,
    variables=VARIABLES,
    constants=constants,
    coords={"pair": Axis(np.arange(1, PAIRS + 1), "1", "pair, ascending in onset_mu at pairs_theta")},
    check=check,
    options={"order_by": ("theta",), "batch_multiple": len(PARAMETERS)},
    draw=deferred("studies.gallery.sensitivity.figure:draw"),
    findings=deferred("studies.gallery.sensitivity.findings:findings"),
)
