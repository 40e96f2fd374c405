"""Motion of scenes in time, `simulate` and `simulate_many`, and the limit of its uniqueness, `painleve_mu`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any
from warnings import warn

import numpy as np

from fivcore import checks, errors
from fivcore.contact.reduced import full_model, modified, reduced_model
from fivcore.errors import ContactError, FixedContactWarning, InputError, OutOfBandWarning, SceneError
from fivcore.jit import Array
from fivcore.modal.cutoffs import GROWTH_REACH
from fivcore.rig import ContactModel, Rig, Scene, checked_theta, one_contact
from fivcore.stability.several import exponents_at
from fivcore.structure import Structure, modal_structure
from fivcore.transient import published
from fivcore.transient.driver import Transient, drive
from fivcore.transient.fast.steady import sliding_growth
from fivcore.transient.normalised import Normalised
from fivcore.transient.options import Options, RunOptions, Until, options_of, run_options


def simulate(
    scene: Scene,
    duration: float | Until,
    method: str | None = None,
    *,
    options: Options | None = None,
    **keywords: Any,
) -> Transient:
    """Simulate a scene from the start of its drive.

    Parameters
    ----------
    scene : Scene
    duration : float or Until
        Simulated time, s, or a stopping rule.
    method : {"fast", "exact", "paper"}, optional
    **keywords
        The parameters of `fivcore.Options`, of which `method` is one.
    options : Options, optional
        In place of `method` and all keywords.

    Returns
    -------
    Transient

    Raises
    ------
    ValueError
        For a bad argument, naming it, its value and the allowed values.
    ContactError
        If the contact force is not unique; raised before the first step, or for falling friction when it occurs.
    DivergenceError
        If the motion exceeds the range of floating-point numbers.

    Warns
    -----
    FixedContactWarning
        If V times the duration exceeds 2 % of the length of P2, because the contact point of the model is fixed.
    OutOfBandWarning
        If sliding is unstable only above 10 kHz, the default band of `fivcore.flutter_onsets` (for "fast" with
        the default cut-off, from rest).
    """
    (result,) = simulate_many([scene], duration, method, options=options, **keywords)
    if isinstance(result, Exception):
        raise result
    length = scene.rig.p2.length if isinstance(scene.rig, Rig) else np.inf
    moved = abs(scene.V) * result.summary["simulated_time"] / length
    if moved > errors.FIXED:
        warn(errors.fixed_contact(moved), FixedContactWarning, stacklevel=2)
    slips = isinstance(scene.rig, Rig) and np.isfinite(result.summary["first_slip_time"])
    if slips and len(result.growing) and result.growing[0] > errors.BAND:
        text = f"at mu = {scene.mu:g} sliding is unstable at {1e-3 * result.growing[0]:.3g} kHz and not below"
        text += f" {1e-3 * errors.BAND:g} kHz, the default band of flutter_onsets; the beam model holds up to"
        text += f" {1e-3 * scene.rig.valid_up_to:.3g} kHz (rig.valid_up_to)"
        warn(text, OutOfBandWarning, stacklevel=2)
    return result


def simulate_many(
    scenes: Sequence[Scene],
    duration: Any,
    method: str | None = None,
    *,
    options: Options | None = None,
    **keywords: Any,
) -> list[Transient | SceneError]:
    """Simulate many scenes; each result has the same bits as that of `simulate`.

    Parameters
    ----------
    scenes : sequence of Scene
    duration : float or Until, or list of them
    method, options, **keywords
        As for `simulate`. A list, as long as `scenes`, gives each scene its own `duration`, `ramp`, `settle`,
        `initial` or `numerical_damping`; other lists apply to all scenes.

    Returns
    -------
    list
        For each scene what `simulate` returns, or the `fivcore.errors.SceneError` that it raises.

    Raises
    ------
    ValueError
        For any other bad argument, or for a list that is not as long as `scenes`.
    """
    keywords |= {"duration": duration} if method is None else {"duration": duration, "method": method}
    listed = ("duration", "ramp", "settle", "initial", "numerical_damping")
    own = {name: value for name, value in keywords.items() if name in listed and isinstance(value, list)}
    for name, values in own.items():
        if (given := len(values)) != len(scenes):
            raise InputError(f"{name}: a list of {given}: it must have one entry for each of {len(scenes)} scenes")
    requests = []
    for k, scene in enumerate(scenes):
        each = keywords | {name: values[k] for name, values in own.items()}
        requests.append(request(scene, each.pop("duration"), options_of(options, each)))
    return [drive(*each) for each in requests]


def request(scene: Scene, duration: Any, options: Options) -> tuple[Scene, Normalised, RunOptions]:
    """Check a scene, a duration and options, and return what `driver.ObservedRun` needs."""
    checks.instance("scene", scene, Scene)
    normalised = Normalised.of(scene)
    checked = run_options(scene, normalised, duration, options)
    rig = published.with_numerical_damping(normalised.rig, checked.method, checked.numerical_damping)
    scaled = replace(normalised, rig=rig)
    if isinstance(rig, Structure) and checked.cutoff is None and checked.method != "paper":
        scaled = replace(scaled, rig=_reaching(scaled, rig))
    return scene, scaled, checked


def _reaching(scene: Normalised, own: Structure) -> Structure:
    """The structure with the cut-off that its motion needs, higher if modes grow just below the usual one."""
    if own.several or own.cutoff is None or own.reaching == own:
        return own
    try:
        model = reduced_model(own, scene.theta)
        found = sliding_growth(scene, model, model.default_step)
    except ContactError:
        # The method itself reports why the contact force is not unique.
        return own
    return own.reaching if len(found) and found[-1] > GROWTH_REACH * own.cutoff else own


def growing_frequencies(
    scene: Scene, *, cutoff: float | None = None, numerical_damping: str | None = None
) -> Array:
    """Frequencies of growing motions about steady sliding in the reduced model of `simulate`.

    Its modes extend far above the usual band of stability analysis (`sliding_modes`), and modes that grow only
    there also drive the motion.

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
    _, scaled, options = request(scene, 1.0, Options(cutoff=cutoff, numerical_damping=numerical_damping))
    if scene.rig.several:
        own = modal_structure(scaled.rig, 0.0).motion
        top = float(options.cutoff or 1.01 * own.frequency[-1])
        phi = exponents_at(own, top, scaled.friction)(scene.mu, scaled.speed_per_load, 1.0 / own.preload)
        return np.asarray(top * np.sort(phi.imag[phi.real > 0.0]))
    model = reduced_model(scaled.rig, scaled.theta, options.cutoff)
    return sliding_growth(scaled, model, model.default_step)


def painleve_mu(
    rig: ContactModel, theta: Any, method: str | None = None, *, options: Options | None = None, **keywords: Any
) -> float:
    """Find the mu above which a method's contact force is not unique (Painleve's paradox).

    At this mu a divisor of the slip law vanishes. It is not an onset of flutter (`flutter_onsets`).

    Parameters
    ----------
    rig : Rig
    theta : float
        Degrees; its sign does not matter, because both directions of slip are examined.
    method, options, **keywords
        As in `fivcore.simulate`; numerical damping, cut-off, step, `modify` and beta2 have an effect.

    Returns
    -------
    float
        Infinite where normal and tangential direction do not couple at the contact.

    Raises
    ------
    ValueError
        Names the argument, its value and the allowed values.
    """
    theta = checked_theta("rig", rig, theta)
    given = options_of(options, keywords if method is None else keywords | {"method": method})
    method, step, law = given.method, given.step, given.law
    if method != "fast":
        one_contact(rig, f"method {method!r} moves one contact; use 'fast'")
    rig = published.with_numerical_damping(rig, method, law["numerical_damping"])
    if method == "paper":
        step, beta2 = step or published.paper_step(rig), law["beta2"] or published.BETA2
        return published.painleve_limit(full_model(rig, theta), step, beta2, published.relaxation_time(rig, step))
    if method == "exact" and step is not None:
        raise InputError(f"step = {step:g}: method 'exact' does not use it here; leave it out")
    model = modified(reduced_model(rig, theta, given.cutoff), given.modify)
    return model.painleve_mu(None if method == "exact" else step or model.default_step)
