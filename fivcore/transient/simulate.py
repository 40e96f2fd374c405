"""The motion of scenes in time, `simulate` and `simulate_many`, and how far it is unique, `painleve_mu`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from inspect import signature
from typing import Any
from warnings import warn

import numpy as np

from fivcore import checks
from fivcore.contact.reduced import Modify, full_model, modified, reduced_model
from fivcore.errors import (
    BAND,
    FIXED,
    ContactError,
    FixedContactWarning,
    InputError,
    OutOfBandWarning,
    SceneError,
    fixed_contact,
    out_of_band,
)
from fivcore.jit import Array
from fivcore.rig import Rig, Scene, Structural, checked_theta
from fivcore.structure import REACH, Structure
from fivcore.transient import published
from fivcore.transient.driver import Transient, drive
from fivcore.transient.fast.steady import sliding_growth
from fivcore.transient.normalised import Normalised, State
from fivcore.transient.options import Options, Until, law_options, options_for


def simulate(
    scene: Scene,
    duration: float | Until,
    method: str = "fast",
    *,
    numerical_damping: str | None = None,
    ramp: float | None = None,
    settle: float | None = None,
    initial: State | tuple[Any, Any, int] | None = None,
    cutoff: float | None = None,
    step: float | None = None,
    min_stick: float | None = None,
    record: bool | Sequence[str] = False,
    sample_rate: float | str | None = "default",
    sample_times: Any = None,
    end_early: bool = True,
    leap: bool = True,
    modify: Modify | None = None,
    beta2: float | None = None,
) -> Transient:
    """Simulate a scene from the start of its drive.

    Parameters
    ----------
    scene : Scene
    duration : float or Until
        Simulated time, s, or what ends the run.
    method : {"fast", "exact", "paper"}
        Symmetric steps of second order of the reduced model; the same model driven from event to event, some
        600 times slower for the paper's rig, and more where friction falls with the speed; the published
        scheme (Newmark with the friction law of Prakash and Clifton) on all modes.
    numerical_damping : {"published", "none"}, optional
        "published": with the stiffness damping that the published scheme adds of its own, (beta2 - 1/2) times its
        step of 2e-8 s, of a structure its default step: "fast" and "exact" add it to the rig's d2. "none": the
        model as given; for "paper" beta2 = 0.5. Default: "published" for "paper", "none" for the others.
    ramp : float, optional
        Time in which the clamp of P2 is uniformly accelerated to its velocity, s. "fast" takes a ramp shorter than
        a step as none, "exact" one below 1e-7 s (times `time_scale`); the drive that decides on "undecided"
        includes it. Default: 1 ms; none where the drive runs already, beside which a ramp is an error.
    settle : float, optional
        Start of the statistics, s since the drive started. Default: 0.1 s after the first slip, of a structure
        0.1 s times `summary["time_scale"]`; 0 without slip.
    initial : State or tuple, optional
        Displacements and velocities of all modes, contact state; its drive starts or runs already (`State`).
        Default: at rest under the load, T = 0, stuck. The `final_state` of a run of the same scene, method and
        model continues that run: times count from its start, `duration` is added, and the motion has the same bits
        as one run without the stop ("exact": to rounding; with skips: if both stop at the same times, as at
        multiples of 1024 samples of 20 microseconds). In another scene or model the run starts at t = 0 from the
        modes and the contact state; a `modify` is the same if it makes equal models.
    cutoff : float, optional
        Highest frequency of a mode, Hz; not for "paper", which keeps all. Default: 94 kHz for the paper's rig
        (`contact.reduced.default_cutoff`), with more for the onset (`transient.fast.onset`). A structure from
        matrices keeps the modes that take part in impacts, whatever its `fmax`; one from modes keeps all.
    step : float, optional
        Time step, s. Default: 2e-8 for "paper"; what the contact needs for "fast" (1.8e-6 with the default rig; of
        a structure in rigid contact also at most a hundredth of the duration, `transient.fast.run.default_step`);
        for "exact" only the grid on which statistics are taken, 1e-6 times `time_scale`.
    min_stick : float, optional
        Shortest long stick, s. Default: a fifth of the time in which the drive at V loads a stuck contact until it
        slips, statically: it depends on the scene alone, not on the start of the run.
    record : bool or sequence of str
        Series to keep: all, or some of `velocity_B`, `normal_force`, `tangential_force`, `slip_velocity`, `state`.
    sample_rate : float, optional
        Sampling rate of the series, Hz: at the times k / sample_rate, linear between two steps, with the state of
        the step before. Where a whole number of steps fits between two samples, as with the default, they are
        every so many steps without interpolation, at those steps' own times. None: every step. Where a run goes
        on, they are linear from the last step before, if that run was recorded at such a rate. Default: 100 kHz,
        of a structure divided by `time_scale`.
    sample_times : array_like, (n,), optional
        Ascending times of the series instead, s: linear between two steps of the method, with the state of the
        step before; beyond the first and the last step their values.
    end_early : bool
        For "fast": fill in the rest of the run where steady sliding is proved to last
        (`transient.fast.steady`), which changes figures by some 1e-9 of their size.
    leap : bool
        For "fast": skip the quiet part of long sticks, known in closed form
        (`transient.fast.skip`). The motion differs by rounding, which chaos amplifies; in a skip the normal force
        enters its maximum every 20 microseconds.
    modify : callable, optional
        For "fast" and "exact": a function that takes a `contact.reduced.ReducedModel` and returns a changed one,
        to measure what a part of it is worth (`studies/accuracy/ablation.py`).
    beta2 : float, optional
        For "paper" only, from 0.5 to 1, in place of `numerical_damping`. Default: 0.8, the paper's.

    Returns
    -------
    Transient

    Raises
    ------
    ValueError
        For a bad argument, naming it, its value and what is allowed.
    ContactError
        Where the contact force is not unique; before the first step, or, of a falling friction, where it is met.
    DivergenceError
        Where the motion leaves the range of numbers.

    Warns
    -----
    FixedContactWarning
        Where V times the duration exceeds 2 % of P2's length, along which the contact point does not move.
    OutOfBandWarning
        Where sliding is unstable only above 10 kHz, the default band of `fivcore.flutter_onsets` (for "fast" with
        the default cut-off, from rest).
    """
    arguments = dict(locals())
    (result,) = simulate_many([arguments.pop("scene")], **arguments)
    if isinstance(result, Exception):
        raise result
    length = scene.rig.p2.length if isinstance(scene.rig, Rig) else np.inf
    moved = abs(scene.V) * result.summary["simulated_time"] / length
    if moved > FIXED:
        warn(fixed_contact(moved), FixedContactWarning, stacklevel=2)
    slips = isinstance(scene.rig, Rig) and np.isfinite(result.summary["first_slip_time"])
    if slips and len(result.growing) and result.growing[0] > BAND:
        warn(out_of_band(scene.mu, result.growing[0], scene.rig.valid_up_to), OutOfBandWarning, stacklevel=2)
    return result


def simulate_many(
    scenes: Sequence[Scene], duration: Any, method: str = "fast", **options: Any
) -> list[Transient | SceneError]:
    """Simulate many scenes; each has the bits that `simulate` gives it.

    Parameters
    ----------
    scenes : sequence of Scene
    duration : float or Until, or list of them
    method : {"fast", "exact", "paper"}
    **options
        As for `simulate`. A list, as long as `scenes`, gives each scene its own `duration`, `ramp`, `settle`,
        `initial` or `numerical_damping`; other lists belong to all scenes.

    Returns
    -------
    list
        For each scene what `simulate` returns, or the `fivcore.errors.SceneError` that it raises.

    Raises
    ------
    ValueError
        For any other bad argument, or for a list that is not as long as `scenes`.
    """
    bound = signature(simulate).bind(None, duration, method, **options)
    bound.apply_defaults()
    arguments, requests = dict(bound.arguments), []
    del arguments["scene"]
    listed = ("duration", "ramp", "settle", "initial", "numerical_damping")
    own = [name for name in listed if isinstance(arguments[name], list)]
    for name in own:
        if (given := len(arguments[name])) != len(scenes):
            raise InputError(f"{name}: a list of {given}: it must have one entry for each of {len(scenes)} scenes")
    for k, scene in enumerate(scenes):
        requests.append(request(scene, arguments | {name: arguments[name][k] for name in own}))
    return [drive(*each) for each in requests]


def request(scene: Scene, arguments: dict[str, Any]) -> tuple[Scene, Normalised, Options]:
    """Check a scene and the arguments of `simulate`, by name, and return what `driver.Job` needs."""
    checks.instance("scene", scene, Scene)
    normalised = Normalised.of(scene)
    checked = options_for(scene, normalised, arguments)
    rig = published.with_numerical_damping(normalised.rig, checked.method, checked.numerical_damping)
    scaled = replace(normalised, rig=rig)
    if isinstance(rig, Structure) and checked.cutoff is None and checked.method != "paper":
        scaled = replace(scaled, rig=_reaching(scaled, rig))
    return scene, scaled, checked


def _reaching(scene: Normalised, own: Structure) -> Structure:
    """The structure with the cut-off that its motion needs: modes that grow just below the usual one need more."""
    if own.cutoff is None or own.reaching == own:
        return own
    try:
        model = reduced_model(own, scene.theta)
        found = sliding_growth(scene, model, model.default_step)
    except ContactError:
        # The method says where and why the contact force is not unique.
        return own
    return own.reaching if len(found) and found[-1] > REACH * own.cutoff else own


def growing_frequencies(
    scene: Scene, *, cutoff: float | None = None, numerical_damping: str | None = None
) -> Array:
    """Frequencies of growing motions about steady sliding in the reduced model by which `simulate` moves.

    Its modes reach far above the band in which stability is usually asked (`sliding_modes`): what grows only there
    drives the motion, too.

    Parameters
    ----------
    scene : Scene
    cutoff, numerical_damping
        As in `simulate` with method "fast".

    Returns
    -------
    ndarray, (n,)
        Hz, ascending; 0 for a motion that grows without oscillation.

    Raises
    ------
    ValueError, ContactError
        For a bad argument; where the contact force is not unique.
    """
    arguments = {each.name: each.default for each in signature(simulate).parameters.values()}
    arguments |= {"duration": 1.0, "cutoff": cutoff, "numerical_damping": numerical_damping}
    del arguments["scene"]
    _, scaled, options = request(scene, arguments)
    model = reduced_model(scaled.rig, scaled.theta, options.cutoff)
    return sliding_growth(scaled, model, model.default_step)


def painleve_mu(
    rig: Structural,
    theta: Any,
    method: str = "fast",
    *,
    numerical_damping: str | None = None,
    cutoff: float | None = None,
    step: float | None = None,
    modify: Modify | None = None,
    beta2: float | None = None,
) -> float:
    """Find the mu above which a method's contact force is not unique (Painleve's paradox).

    There a divisor of the method's slip is zero. Onsets of flutter are something else (`flutter_onsets`).

    Parameters
    ----------
    rig : Rig
    theta : float
        Degrees; its sign does not matter, for both directions of slip are looked at.
    method, numerical_damping, cutoff, step, modify, beta2
        As in `fivcore.simulate`.

    Returns
    -------
    float
        Infinite where normal and tangential direction do not couple at the contact.

    Raises
    ------
    ValueError
        Naming the argument, its value and what is allowed.
    """
    theta = checked_theta("rig", rig, theta)
    law = law_options(dict(locals()))
    rig, beta2 = published.with_numerical_damping(rig, method, law["numerical_damping"]), law["beta2"]
    step = None if step is None else checks.between("step", step, 1e-12, 1.0, "s")
    if method == "paper":
        step, tau = step or published.default_step(rig), published.relaxation_time
        return published.painleve_mu(full_model(rig, theta), step, beta2 or published.BETA2, tau(rig, step))
    if method == "exact" and step is not None:
        raise InputError(f"step = {step:g}: method 'exact' does not use it here; leave it out")
    cutoff = None if cutoff is None else checks.between("cutoff", cutoff, 1.0, 1e12, "Hz")
    model = modified(reduced_model(rig, theta, cutoff), modify)
    return model.painleve_mu(None if method == "exact" else step or model.default_step)
