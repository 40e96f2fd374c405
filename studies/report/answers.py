"""Answers to the studies' questions, in a sentence each with numbers of the results and of the paper."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from studies import paper
from studies.accuracy import findings as accuracy
from studies.claims import Claim, answer
from studies.gallery import contact, fig7, table4
from studies.gallery.sensitivity import findings as sensitivity
from studies.motion.regimes import STEADY, VIBRATING, dominant_frequency, is_of
from studies.query.nearest import nearest
from studies.study import constants
from studies.tables import number, word

# Numbers of the rig that are named as those that matter.
MATTER = 3


class Answer(NamedTuple):
    """A finding, and the paper's claim; "" where it makes none, or where the result is not of its rig."""

    finding: str
    paper: str = ""


def answers(name: str, dataset: xr.Dataset) -> list[Answer]:
    """Answers from a result of the study called `name`; none where it lacks what they need."""
    if name not in ANSWERS:
        return []
    try:
        every = ANSWERS[name](dataset)
    except (KeyError, ValueError, IndexError, TypeError, AttributeError):
        return []
    own = name == "table4" or paper.is_rig(dataset)
    return [each if own else each._replace(paper="") for each in every]


def _table4(data: xr.Dataset) -> list[Answer]:
    listed = data["frequency_paper"].dropna("mode")
    if not listed.size:
        return []
    worst = [(float(abs(table4.deviation(data, name)).max()), at) for name, at, _ in table4.computed(data)]
    apart = " and within ".join(f"{value:.2g} % with the contact at {at}" for value, at in worst)
    ends = f"{float(listed.min()):.0f} to {float(listed.max()):.0f} Hz"
    return [
        Answer(
            f"The {listed.size} natural frequencies of the glued beams are the paper's within {apart}.",
            f"Table 4 lists {ends}; Section 3.2 puts the contact at {1e3 * paper.CONTACT_POSITION:g} mm.",
        )
    ]


def _fig5(data: xr.Dataset) -> list[Answer]:
    theta, most = constants(data)["theta"], float(data["mu"].max())
    onsets = zip(data["onset_mu"].values, data["onset_frequency"].values, strict=True)
    here = _joined(f"μ = {mu:.4f} ({hertz:.0f} Hz)" for mu, hertz in onsets)
    claimed = _joined(f"{mu:g} ({hertz:.0f} Hz)" for mu, hertz in paper.ONSETS)
    if not here:
        return [Answer(f"At θ = {theta:g}° steady sliding is stable up to μ = {most:g}.")]
    return [
        Answer(
            f"At θ = {theta:g}° pairs of modes become unstable at {here}.",
            f"On a grid of μ in steps of 0.01 they are first unstable at {claimed}."
            if theta == paper.THETA
            else "",
        )
    ]


def _fig7(data: xr.Dataset) -> list[Answer]:
    kinds = _each(data, fig7.CLAIMS, "regime", word)
    lines = _each(data, fig7.CLAIMS, "dominant_frequency", lambda at: number(at, ".0f"), " Hz")
    parts = []
    if kinds:
        parts.append(Answer(f"The vibration is {kinds[0]}.", f"It is {kinds[1]}."))
    if lines:
        parts.append(
            Answer(
                f"The dominant frequency of the vibration is {lines[0]}.",
                f"Its simulation has {paper.SIMULATED_LINE:.0f} Hz at each speed.",
            )
        )
    return parts


def _contact(data: xr.Dataset) -> list[Answer]:
    forces = _each(data, contact.CLAIMS, "normal_force_999", lambda at: number(at, ".1f"), " N")
    return (
        [
            Answer(
                f"For 99.9 % of the time the normal force is below {forces[0]}.",
                f"It reaches {forces[1]}.",
            )
        ]
        if forces
        else []
    )


def _fig11(data: xr.Dataset) -> list[Answer]:
    motions = []
    for theta in data["theta"].values.tolist():
        at = data.sel(theta=theta)
        hertz = float(dominant_frequency(at))
        motions.append(f"{word(at['regime'])} at {theta:g}°" + (f" ({hertz:.0f} Hz)" if hertz > 0.0 else ""))
    claimed = [
        f"{hertz:.0f} Hz at {theta:g}°" if hertz > 0.0 else f"none at {theta:g}°" for theta, hertz in _angles()
    ]
    return [
        Answer(
            f"At {1e3 * constants(data)['V']:g} mm/s the motion is {_joined(motions)}.",
            f"It measures vibration with {_joined(claimed)}.",
        )
    ]


def _table6(data: xr.Dataset) -> list[Answer]:
    fixed = constants(data)
    windows = sorted(zip(data["window_from"].values, data["window_to"].values, strict=True))
    spans = _joined(f"{low:.2f}° to {high:.2f}°" for low, high in windows)
    vibrating = data["theta"].values[is_of(data["regime"].values, *VIBRATING)]
    steady = is_of(data["regime"].values, STEADY)
    if not spans or not len(vibrating):
        return []
    low, high = vibrating.min(), vibrating.max()
    outside = (data["theta"].values < low) | (data["theta"].values > high)
    beyond = "and slides steadily at every other" if steady[outside].all() else "but not only there"
    below, above = paper.STEADY_ANGLES[0][1], paper.STEADY_ANGLES[1][0]
    return [
        Answer(
            f"At μ = {fixed['mu']:g} steady sliding is unstable for θ from {spans}; of the inclinations computed "
            f"the rig vibrates from {low:g}° to {high:g}° {beyond}.",
            f"It slides steadily below {below:g}° and above {above:g}°.",
        )
    ]


def _stick_time(data: xr.Dataset) -> list[Answer]:
    at = _at_point(data, "mu", "F")
    if at is None:
        return []
    low, value, high = (float(at[f"exponent{end}"].sel(law="start_up")) for end in ("_low", "", "_high"))
    ends = 1e3 * float(at["intermittence_end"])
    if np.isnan(value):
        return []
    until = f" Sticks between bursts of vibration end at {ends:.2f} mm/s." if ends > 0.0 else ""
    return [
        Answer(
            f"The mean stick time at start-up is proportional to V to the power {value:.2f} "
            f"(95 % interval {low:.2f} to {high:.2f}).{until}",
            "It is proportional to 1/V; from some speed on there are no sticks, none at 5 mm/s.",
        )
    ]


def _stability(data: xr.Dataset) -> list[Answer]:
    at = data.transpose("theta", "mu", ...)
    growth, theta, mu = at["growth_rate"].values, at["theta"].values, at["mu"].values
    finite, grows = np.isfinite(growth), growth > 0.0
    tangent = np.tan(np.radians(theta))[:, None]
    outside = int((grows & ~((tangent > 0.0) & (tangent < mu))).sum())
    if not finite.any():
        return []
    return [
        Answer(
            f"Steady sliding is unstable at {100.0 * grows.sum() / finite.sum():.1f} % of the plane θ from "
            f"{theta.min():g}° to {theta.max():g}°, μ from {mu.min():g} to {mu.max():g}, and at "
            f"{outside or 'none'} of its points outside 0 < tan θ < μ.",
            f"At μ = {paper.MU:g} it is unstable at {paper.THETA:g}°; it has no map over both.",
        )
    ]


def _sensitivity(data: xr.Dataset) -> list[Answer]:
    at = sensitivity.reference(data)
    lowest = at["onset_mu"].max("parameter")
    at = at.isel(pair=int(lowest.argmin("pair")))
    share = 100.0 * at["change_mu"] / at["onset_mu"]
    parts = [
        f"{sensitivity.named(name)} ({float(share.sel(parameter=name)):+.1f} %)"
        for name in at["parameter"].values[:MATTER].tolist()
    ]
    return [
        Answer(
            f"The onsets depend most on {_joined(parts)}; in brackets the change of the lowest onset where the "
            "number is 1 % larger.",
            "The geometry of the contact matters; of the rig's numbers only θ is varied.",
        )
    ]


def _robust(data: xr.Dataset) -> list[Answer]:
    theta, is_there = nearest(data["theta"].values, paper.THETA)
    mu, is_on_grid = nearest(data["mu"].values, paper.MU)
    if not (is_there and is_on_grid):
        return []
    at = data.sel(theta=theta)
    share = at["probability_unstable"]
    there, low, high = (100.0 * float(at[f"probability_{end}"].sel(mu=mu)) for end in ("unstable", "low", "high"))
    onset = float(at["nominal_onset_mu"])
    half = 100.0 * float(np.interp(onset, data["mu"].values, share.values))
    if not np.isfinite([there, half]).all():
        return []
    return [
        Answer(
            f"Of {data.sizes['sample']} rigs whose numbers scatter, {there:.3g} % are unstable at θ = {theta:g}° "
            f"and μ = {mu:g} (95 % interval {low:.1f} to {high:.1f} %), and {half:.0f} % at the nominal rig's "
            f"onset, μ = {onset:.4f}.",
            "It computes one rig.",
        )
    ]


def _accuracy(data: xr.Dataset) -> list[Answer]:
    row = accuracy.default(accuracy.table(data)).iloc[0]
    right, compared = (
        sum(int(row[f"{what} {group}"]) for group in accuracy.GROUPS) for what in ("right", "compared")
    )
    ratio = f", {row['ratio']:.0f} times less than the paper's scheme" if row["ratio"] > 0.0 else ""
    return [
        Answer(
            f"The default method is within its tolerances at {right} of {compared} scenes and takes "
            f"{row['cost']:.2g} s of CPU time for a simulated second{ratio}.",
            "It gives neither the cost nor the error of its scheme.",
        )
    ]


ANSWERS: dict[str, Callable[[xr.Dataset], list[Answer]]] = {
    "table4": _table4,
    "fig5": _fig5,
    "fig7": _fig7,
    "contact": _contact,
    "fig11": _fig11,
    "table6": _table6,
    "stick_time": _stick_time,
    "stability": _stability,
    "sensitivity": _sensitivity,
    "robust": _robust,
    "accuracy": _accuracy,
}


def _each(
    data: xr.Dataset, claims: Sequence[Claim], name: str, text: Callable[[xr.DataArray], str], unit: str = ""
) -> tuple[str, str] | None:
    """A variable at each speed of the paper's claims: here, and there; None where the result answers none."""
    pairs = [(claim, at) for claim in claims if claim.variable == name and (at := answer(data, claim)) is not None]
    if not pairs:
        return None
    speeds = [f"at {1e3 * float(claim.at['V']):g} mm/s" for claim, _ in pairs]  # type: ignore[arg-type]
    here = _joined(f"{text(at)}{unit} {speed}" for speed, (_, at) in zip(speeds, pairs, strict=True))
    claimed = [claim.value if isinstance(claim.value, str) else f"{claim.value:g}" for claim, _ in pairs]
    return here, _joined(f"{value}{unit} {speed}" for value, speed in zip(claimed, speeds, strict=True))


def _at_point(data: xr.Dataset, *names: str) -> xr.Dataset | None:
    """The result at the paper's operating point, where it holds that."""
    point = {"mu": paper.MU, "F": paper.LOAD}
    for name in names:
        value, is_there = nearest(data[name].values, point[name])
        if not is_there:
            return None
        data = data.sel({name: value})
    return data


def _angles() -> Iterable[tuple[float, float]]:
    return paper.ANGLES.items()


def _joined(texts: Iterable[Any]) -> str:
    """A, B and C."""
    *others, last = [*map(str, texts), ""][:-1] or [""]
    return f"{', '.join(others)} and {last}" if others else last
