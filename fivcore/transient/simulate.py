"""The motion of scenes in time: `simulate` and `simulate_many`."""

from __future__ import annotations

from collections.abc import Sequence
from inspect import signature
from typing import Any, cast

from fivcore import checks
from fivcore.contact.ablation import Modify
from fivcore.errors import ContactError, DivergenceError
from fivcore.rig import Scene
from fivcore.transient.drive import Normalised, State
from fivcore.transient.driver import Transient, drive
from fivcore.transient.options import options_for, per_scene


def simulate(
    scene: Scene,
    duration: float,
    method: str = "fast",
    *,
    ramp: float = 1e-3,
    settle: float | None = None,
    initial: State | tuple[Any, Any, int] | None = None,
    contact_motion: int = 0,
    cutoff: float | None = None,
    termination: str = "absorbing",
    step: float | None = None,
    min_stick: float | None = None,
    record: bool | Sequence[str] = False,
    sample_rate: float = 100e3,
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
    duration : float
        Simulated time, s.
    method : {"fast", "exact", "paper"}
        "fast": the reduced model in symmetric steps of second order (default); "exact": the same model from
        event to event, some two hundred times slower; "paper": the published scheme on all modes.
    ramp : float
        Time in which the clamp of P2 reaches its velocity, uniformly accelerated, s.
    settle : float, optional
        When statistics start, s since the drive started. Default: 0.1 s after the first slip, and for a scene
        that never slips its start.
    initial : State or tuple, optional
        Modal displacements and velocities of all modes and the contact state. Default: at rest under the
        load, T = 0, stuck.
    contact_motion : {0, -1, 1}
        0: the contact point stays at the same distance from P2's clamp. -1, 1: P2 slides under C, and the
        point of P2 below C moves towards P2's clamp or away from it (`fivcore.transient.moving_contact`).
    cutoff : float, optional
        Modes above are represented by the termination, Hz; not for "paper", which keeps all. Default: 75 kHz
        for the paper's rig (`contact.reduced.default_cutoff`), with more for the onset (`transient.fast`).
    termination : {"absorbing", "elastic", "none"}
        What stands for the modes above the cut-off (`fivcore.contact.reduced`).
    step : float, optional
        Time step, s. Default: 2e-8 for "paper"; what the contact needs for "fast" (2e-6 with the default rig);
        for "exact" only the grid on which statistics are taken, 1e-6.
    min_stick : float, optional
        What counts as a long stick, s. Default: a fifth of the time to the first slip.
    record : bool or sequence of str
        Keep time series: all, or those named of `velocity_B`, `normal_force`, `tangential_force`, `slip_velocity`
        and `state`.
    sample_rate : float
        Of what is kept, Hz.
    sample_times : array_like, (n,), optional
        Ascending times at which the series are kept instead, s: on the line between two neighbouring steps of the
        method, and the state is that of the step before. Before the first and after the last step the nearest
        stands. Memory is taken for what is kept only.
    end_early : bool
        For "fast" with a frozen contact point: where it is proved that a scene slides steadily for good
        (`fivcore.transient.steady`), fill in the rest of the run instead of stepping through it. Figures differ by
        some 1e-9 of their size, line and coherence by more where statistics begin so late that the velocity
        of B has less than 1e-7 V left; `summary["settled_early"]` tells. False: take every step.
    leap : bool
        For "fast" with a frozen contact point: skip the quiet part of long sticks, which is known in closed form
        (`transient.stick_skip`), instead of stepping through it. What moves differs by rounding, until chaos makes
        more of it; in a skip the normal force enters its maximum every 20 microseconds. False: take every step.
    modify : callable, optional
        For "fast" and "exact": a function that returns a changed copy of a reduced model, to measure what a part
        of it is worth (`fivcore.contact.ablation`). Default: no change.
    beta2 : float, optional
        For "paper" only, from 0.5 to 1. Default: 0.8, the paper's.

    Returns
    -------
    Transient

    Raises
    ------
    ValueError
        For a bad argument, naming it, its value and what is allowed.
    ContactError
        Where the contact force of the method is not unique; found before the first step.
    DivergenceError
        Where the motion leaves the range of numbers.
    """
    given = dict(locals())
    (result,) = simulate_many([given.pop("scene")], **given)
    if isinstance(result, Exception):
        raise result
    return result


def simulate_many(
    scenes: Sequence[Scene], duration: Any, method: str = "fast", **options: Any
) -> list[Transient | ContactError | DivergenceError]:
    """Simulate scenes together; each has the bits that `simulate` gives it.

    Parameters
    ----------
    scenes : sequence of Scene
    duration : float or list of float
    method : {"fast", "exact", "paper"}
        "fast" computes many scenes in less time than one by one.
    **options
        As for `simulate`. A list, as long as `scenes`, gives each scene its own `duration`, `ramp`, `settle` or
        `initial`; other lists belong to all scenes.

    Returns
    -------
    list
        For each scene what `simulate` returns, or the `ContactError` or `DivergenceError` that it raises.

    Raises
    ------
    ValueError
        For a bad argument, as `simulate` raises it, or a list that is not as long as `scenes`.
    """
    for name in options:
        if name not in DEFAULTS:
            raise TypeError(f"simulate_many() got an unexpected keyword argument {name!r}")
    given = DEFAULTS | options | {"duration": duration, "method": method}
    asked = []
    for scene, own in zip(scenes, per_scene(scenes, given, OWN), strict=True):
        checks.instance("scene", scene, Scene)
        normalised = Normalised.of(scene)
        asked.append((scene, normalised, options_for(scene, normalised, own)))
    results = drive(asked)
    for result in results:
        if isinstance(result, ValueError):
            raise result
    return cast(list[Transient | ContactError | DivergenceError], results)


# Options of a run and what they are if they are not given; those of which a list gives each scene its own.
DEFAULTS = {
    name: each.default for name, each in signature(simulate).parameters.items() if each.kind is each.KEYWORD_ONLY
}
OWN = frozenset({"duration", "ramp", "settle", "initial"})
