"""Largest Lyapunov exponent of a motion by `method="fast"`, from the linearisation of its steps.

An infinitesimal deviation is propagated step by step on the branch that the contact takes (`kernel.respond`). At
intervals the logarithm of its norm is recorded and its norm is reset to 1; the exponent is the mean of these
logarithms per unit time (G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15, 1980, 9-30).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from fivcore import checks
from fivcore.contact.reduced import reduced_model
from fivcore.errors import InputError, SceneError
from fivcore.jit import Array
from fivcore.rig import Scene, one_contact
from fivcore.transient.driver import ObservedRun, located
from fivcore.transient.fast import layout
from fivcore.transient.fast.run import SHORT_SEGMENT, FastRun, aligned
from fivcore.transient.fast.solver import put, take
from fivcore.transient.normalised import loading_time
from fivcore.transient.observe import degrees_of_freedom, errors_of_means
from fivcore.transient.options import DURATION, Options, options_of
from fivcore.transient.simulate import request

# Default step in units of that of `simulate`.
STEP_SHARE = 0.25


@dataclass(frozen=True)
class LyapunovExponent:
    """Exponent and its standard error (as in `transient.observe`; NaN where the time is too short for one), 1/s.

    The deviation was followed from `start`, s since the drive started, for `time`, s.
    """

    value: float
    standard_error: float
    start: float
    time: float


def lyapunov_exponent(
    scene: Scene, duration: float, *, options: Options | None = None, **keywords: Any
) -> LyapunovExponent:
    """Find the largest Lyapunov exponent of the motion that `simulate` finds by `method="fast"`.

    Neighbouring motions diverge as exp(value t). In intermittent motion the exponent is the mean over bursts, in
    which they diverge, and long sticks, in which they converge because the tied modes decay; it may be negative
    although every burst is irregular.

    The exponent belongs to the discrete steps, in which an event moves by whole steps only. It therefore needs
    shorter steps than the shares of time do: with the paper's rig (theta = 5, mu = 0.2) it is 1.4 to 1.5 times as
    large with the step of `simulate` as with an eighth of it, 1.1 times with half, and equal within 2 % with a
    quarter, the default here. For friction that jumps from static to kinetic, it neglects that a deviation shifts
    the jump.

    Parameters
    ----------
    scene, duration, options, **keywords
        As in `fivcore.simulate`, except for the default of `step`; no stick is skipped and nothing is recorded.
        The mean starts at `settle`, but not before the end of the finer model of the onset, which has other modes
        (`transient.fast.onset`). The deviation needs about 10 ms to turn into the most unstable direction.

    Raises
    ------
    ValueError, ContactError, DivergenceError
        As `fivcore.simulate`; also for rigid contact, in which a deviation of the gap is constant.
    """
    given = options_of(options, keywords)
    if given.method != "fast":
        raise InputError(f"method = {given.method!r}: a Lyapunov exponent is that of a motion by 'fast'")
    one_contact(scene.rig, "the deviation of a Lyapunov exponent follows one contact's law")
    given = replace(given, skip_sticks=False, end_early=False, record=False, sample_times=None)
    checks.between("duration", duration, *DURATION)
    try:
        _, normalised, checked = request(scene, duration, given)
        if given.step is None:
            usual = reduced_model(normalised.rig, normalised.theta, given.cutoff).default_step
            # Requested again, because a run with another step is not continued.
            _, normalised, checked = request(scene, duration, replace(given, step=STEP_SHARE * usual))
        job = ObservedRun(scene, normalised, checked)
        run, unit = cast(FastRun, job.run), scene.rig.time_scale
        if not run.model.K.any():
            raise InputError("scene: its contact is rigid; a Lyapunov exponent needs modes beyond those that move")
        model, steps, growths = None, [0], [0.0]
        while not run.done:
            if run.model is not model:
                model, steps, growths, run.tangent = run.model, [run.now], [], _deviation(run)
            settled = int(run.record["settle"][0])
            run.pause = min(run.now + round(SHORT_SEGMENT * unit / run.step), run.steps)
            run.pause = min(run.pause, settled) if settled > run.now else run.pause
            while run.now < run.pause and run.model is model:
                run.advance()
                job.observe()
            if run.model is model:
                steps.append(run.now)
                growths.append(_scaled_back(run))
    except SceneError as error:
        raise located(error, scene) from None
    first = int(np.searchsorted(steps, settled))
    times = np.asarray(np.diff(steps[first:]) * run.step)
    degrees = degrees_of_freedom(times.sum() / unit, loading_time(run.scene) / unit)
    exponent = mean_growth(np.array(growths[first:]), times, degrees)
    return LyapunovExponent(*exponent, run.time - float(times.sum()), float(times.sum()))


def mean_growth(growths: Array, times: Array, degrees: int) -> tuple[float, float]:
    """Mean of the log growths (n,) of a deviation per time, over `times` (n,) each, and its standard error."""
    value = growths.sum() / times.sum() if len(times) else np.nan
    (error,) = errors_of_means((growths - value * times)[:, None], degrees) * len(times) / times.sum()
    return float(value), float(error)


def _deviation(run: FastRun) -> Any:
    """An initial deviation of all modes for `kernel.advance`: its record and its modes."""
    model, record, blocks = run.model, np.zeros(1, layout.TANGENT), aligned(run.blocks)
    blocks[:, layout.Q : layout.V + 1] = 0.0
    put(blocks, run.places, layout.V, np.full(len(model.normal), len(model.normal) ** -0.5))
    record["v_N"], record["v_T"] = model.shapes.sum(axis=1) * len(model.normal) ** -0.5
    return record, blocks.ravel()


def _scaled_back(run: FastRun) -> float:
    """Normalise the deviation of a run (norm: root of twice its energy); return the logarithm of its old norm."""
    (record, modes), model = run.tangent, run.model
    blocks = modes.reshape(run.blocks.shape)
    q, v = (take(blocks, run.places, row) for row in (layout.Q, layout.V))
    u = np.array([record["u_N"][0], record["u_T"][0]])
    # A rigid-body mode has no stiffness and is scaled by the contact frequency.
    omega = np.sqrt(np.where(model.stiffness > 0.0, model.stiffness, model.contact_frequency**2))
    norm = float(np.sqrt(np.sum(v**2) + np.sum((omega * q) ** 2) + u @ model.K @ u))
    blocks[:, layout.Q : layout.V + 1] /= norm
    record.view(float)[:] /= norm
    return float(np.log(norm))
