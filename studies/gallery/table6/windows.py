"""What is known of inclinations besides runs at them: windows of instability, and what the paper's text says."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fivcore import Rig, unstable_windows
from studies import paper
from studies.motion import transients

# Places for unstable pairs; fixed, so that a file can be completed whatever its angles. The paper's rig fills two
# at mu = 0.2 and at most four up to mu = 2.
PAIRS = 8
# Regimes in which B vibrates: what is left of a motion that dies has a strongest line too, but none that sounds.
VIBRATING = tuple(transients.REGIMES.index(name) for name in ("intermittent", "periodic", "irregular"))
STEADY = transients.REGIMES.index("steady sliding")

# How a window of instability ends: there the pair grows no more, or leaves the band, or oscillates no more; or the
# range of angles ends.
ENDS = ("pair grows no more", "end of the range")
# By their names here: names in `fivcore.UnstableWindows`, units and meaning.
WINDOWS = {
    "from": ("theta_from", "degree", "inclination from which a pair is unstable"),
    "to": ("theta_to", "degree", "inclination up to which the pair is unstable"),
    "frequency_from": ("frequency_from", "Hz", "frequency of the pair where the window begins"),
    "frequency_to": ("frequency_to", "Hz", "frequency of the pair where the window ends"),
    "open_from": ("open_from", "1", "what the window begins with"),
    "open_to": ("open_to", "1", "what the window ends with"),
    "peak_growth_rate": ("peak_growth_rate", "s-1", "largest growth rate of the pair within the window"),
    "peak_theta": ("peak_theta", "degree", "inclination at which the pair grows fastest"),
    "peak_frequency": ("peak_frequency", "Hz", "frequency of the pair where it grows fastest"),
}

# What the paper's text says of an inclination.
STATED = ("not stated", "vibrates", "slides steadily")
NOT_STATED, VIBRATES, SLIDES = range(3)
STATEMENTS: dict[str, tuple[tuple[str, ...], str, str]] = {
    "stated": (("theta",), "1", "motion, paper's text"),
    "measured_frequency": (("theta",), "Hz", "main line, measured, paper's text"),
    "simulated_frequency": (("theta",), "Hz", "main line, simulated, paper's text"),
    "unstable_frequency": (("theta", "pair"), "Hz", "frequency of the unstable pair, paper's text"),
}


def beside(dataset: xr.Dataset, *, rig: Rig, mu: float, V: float) -> xr.Dataset:
    """Add the windows of instability, and what the paper's text says where this is its operating point.

    Where the windows cannot be found all else is kept, and the `comment` of `window_from` tells the reason.
    """
    theta = dataset["theta"].values
    found, comment = windows(rig, mu, V, float(theta.min()), float(theta.max()))
    for name, (_, units, long_name) in WINDOWS.items():
        dataset[f"window_{name}"] = ("window", found[name], {"units": units, "long_name": long_name})
    if comment:
        dataset["window_from"].attrs["comment"] = comment
    papers = paper.is_point(dataset, mu=paper.MU, F=paper.LOAD, V=paper.ANGLES_SPEED)
    said = stated(theta if papers else np.full(len(theta), np.nan))
    for name, (dims, units, long_name) in STATEMENTS.items():
        dataset[f"{name}_paper"] = (dims, said[name], {"units": units, "long_name": long_name})
    return transients.with_flags(dataset, window_open_from=ENDS, window_open_to=ENDS, stated_paper=STATED)


def windows(rig: Rig, mu: float, V: float, low: float, high: float) -> tuple[dict[str, NDArray[Any]], str]:
    """Windows of theta in which a pair is unstable.

    Parameters
    ----------
    rig : Rig
    mu : float
    V : float
        Only its sign matters: with V < 0 the windows are those of -theta.
    low, high : float
        Range of theta, degrees; there are no windows in a single angle.

    Returns
    -------
    found : dict
        What WINDOWS describes, each (windows,), ascending in frequency, then theta; `open_` are places in ENDS.
    comment : str
        Why there are none though there might be; else "".
    """
    try:
        ends = (low, high) if V > 0.0 else (-high, -low)
        seen = unstable_windows(rig, mu, *ends, transients.BAND) if low < high else None
        comment = ""
    except ArithmeticError as problem:
        seen, comment = None, str(problem)
    found = {name: np.array(getattr(seen, field, [])) for name, (field, _, _) in WINDOWS.items()}
    if V < 0.0:
        # In the mirror a window begins where it ended; 0 - theta, for -theta makes -0 of 0.
        found = {name: found[_other_end(name)] for name in found}
        found |= {name: 0.0 - found[name] for name in ("from", "to", "peak_theta")}
    found |= {name: found[name].astype(np.int8) for name in ("open_from", "open_to")}
    order = np.lexsort((found["from"], found["frequency_from"]))
    return {name: values[order] for name, values in found.items()}, comment


def _other_end(name: str) -> str:
    """The name of the same thing at the other end of a window."""
    if name.endswith("from"):
        return name.removesuffix("from") + "to"
    return name.removesuffix("to") + "from" if name.endswith("to") else name


def stated(theta: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
    """What the paper's text says of inclinations (degrees): a place in STATED, and frequencies (Hz) or NaN."""
    code = np.full(len(theta), NOT_STATED, dtype=np.int8)
    below, above = paper.STEADY_ANGLES
    code[(theta < below) | (theta > above)] = SLIDES
    code[np.isin(theta, list(paper.ANGLES_MEASURED))] = VIBRATES
    unstable = np.full((len(theta), PAIRS), np.nan)
    for row, angle in zip(unstable, theta, strict=True):
        said = paper.ANGLES_UNSTABLE.get(float(angle), ())
        row[: len(said)] = said

    def said_of(numbers: dict[float, float]) -> NDArray[np.float64]:
        return np.array([numbers.get(float(angle), np.nan) for angle in theta])

    return {
        "stated": code,
        "measured_frequency": said_of(paper.ANGLES_MEASURED),
        "simulated_frequency": said_of(paper.ANGLES_SIMULATED),
        "unstable_frequency": unstable,
    }
