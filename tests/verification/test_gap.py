"""No gap under a contact force, and none below zero: the modes are moved again by the recorded forces alone.

No contact law is in the replay: only the forces, the drive of P2's clamp, and in place of the modes not kept their
element, C = tau K, so that u relaxes to K^-1 (N, T) whatever the contact does; in normalised units (F = 1, V > 0).
For `fast` the forces are impulses, as its own are. For `paper` the modes move exactly, with the damping that the
scheme has itself added to theirs; the error is of the first order in its step.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from fivcore import Scene, simulate
from fivcore.beams.modes import propagator
from fivcore.contact.reduced import default_cutoff, full_model, reduced_model
from fivcore.transient.normalised import Normalised, reference_energy
from fivcore.transient.published import BETA2, PAPER_STEP
from studies.accuracy.rigs import drawn_scene
from tests.known import COARSE

PAPERS = Scene(5e-3, 5.0, 0.2, 9.0)
# Method, scene, duration, step (None: the default) and ramp.
CASES = {
    "fast": ("fast", PAPERS, 0.1, None, 1e-3),
    "fast, half steps": ("fast", PAPERS, 0.1, 0.8e-6, 1e-3),
    "fast, mirrored": ("fast", Scene(-0.5, 5.0, 0.4, 2.0), 0.05, None, 0.0),
    "fast, leaning far": ("fast", Scene(0.05, 30.0, 0.6, 9.0), 0.05, None, 1e-3),
    "fast, another rig": ("fast", drawn_scene(2010, 1), 0.1, None, 1e-3),
    "paper": ("paper", replace(PAPERS, V=0.05), 6e-3, PAPER_STEP, 1e-3),
    "paper, another rig": ("paper", replace(drawn_scene(2010, 1), V=0.05), 6e-3, PAPER_STEP, 0.0),
    "paper, coarse": ("paper", Scene(0.05, 20.0, 0.5, 9.0, COARSE), 0.05, 1e-7, 1e-3),
}
# Largest gap, in units of the compliance under the largest force and what is closed in a step; energy residual.
GAP, BALANCE = {"fast": 0.05, "paper": 0.03}, 0.015


def replayed(model, held, speed, ramp, time, N, T):
    """Motion of the modes under forces per N of load, `held` over a step or impulses in its middle.

    Returns g_N + u_N at each record, the largest closing speed, and energies: lost to the modes' own and to the
    added damping, taken out of them by the normal force, and the work of the clamp's acceleration.
    """
    step, elastic = (time[-1] - time[0]) / (len(time) - 1), model.stiffness > 0.0
    added = (BETA2 - 0.5) * step * model.stiffness if held else np.zeros_like(model.stiffness)
    a, b, c, d = propagator(model.stiffness, model.damping + added, step)
    moved, pushed = b, d
    if held:
        moved, pushed = np.full_like(b, 0.5 * step), b / step
        moved[elastic] = (1.0 - a[elastic]) / (model.stiffness[elastic] * step)
    push = model.inertia * speed
    # From rest under the load, where N = 1; before the first impulse there is half a step.
    q, v, carried, shift = np.zeros_like(push), np.zeros_like(push), 0.0, np.zeros_like(push)
    # While the clamp accelerates, the modes move about where that pushes them; what it still has to give when the
    # last whole step of that is over comes at once.
    ends = int(np.searchsorted(time, ramp * (1.0 + 1e-12), side="right"))
    if ends:
        shift[elastic] = push[elastic] / ramp / model.stiffness[elastic]
        q = -shift
        if not held:
            first = propagator(model.stiffness, model.damping, float(time[0]))
            q, v = first[0] * q, first[2] * q
    gap, rate, losses = np.empty(len(N)), np.empty(len(N)), np.zeros(2)
    for i in range(len(N)):
        if i == ends:
            late = push * (1.0 - float(time[ends - 1]) / ramp) if ends else push
            carried = float((model.stiffness * shift) @ (q + shift)) + float(late @ (v + 0.5 * late))
            q, v, shift = q + shift, v + late, np.zeros_like(q)
        force = step * (model.normal * (N[i] - 1.0) + model.tangential * T[i])
        x, y = a * q + b * v + moved * force, c * q + d * v + pushed * force
        mean = 0.5 * (v + y) if held else v + 0.5 * force
        gap[i], rate[i] = model.normal @ ((x if held else q) + shift), model.normal @ mean
        losses += step * np.array([model.damping @ mean**2, added @ mean**2])
        q, v = x, y
    # Impulses see less of the modes' flexibility than a lasting force does; their element has it instead.
    contact, u = model.discrete(step), np.zeros(len(N))
    defect, closed = float(contact.defect[0, 0]), float(model.normal @ model.static_equilibrium)
    if contact.flexibility.any():
        lasting, tau = contact.flexibility[0] @ np.stack([N, T]), contact.tau
        # Over the part of a step before its record, and over what is left of it.
        before, after = np.exp(-time[0] / tau), np.exp(-(step - time[0]) / tau)
        start = before * after * (defect - closed)
        left, _ = lfilter([1.0 - before * after], [1.0, -before * after], lasting, zi=[start])
        u = lasting + (np.concatenate([[defect - closed], left[:-1]]) - lasting) * before
    gap += closed - defect + u
    # The work of the load's share of N is what the gap has changed by.
    opened = np.where(N[[0, -1]] == 0.0, gap[[0, -1]], 0.0)
    struck = -step * float((N - 1.0) @ rate) - float(opened[1] - opened[0])
    return gap, float(-rate.min(initial=0.0)), (*losses, struck, carried)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_the_recorded_forces_leave_no_gap_in_contact_and_no_penetration(case):
    method, scene, duration, step, ramp = CASES[case]
    normal, held = Normalised.of(scene), method == "paper"
    usual = reduced_model(scene.rig, normal.theta)
    model = full_model(scene.rig, normal.theta) if held else usual
    step = step or usual.default_step
    given = {"ramp": ramp, "settle": 0.0, "step": step, "record": True, "sample_rate": None}
    given |= {} if held else {"cutoff": default_cutoff(scene.rig), "end_early": False}
    run = simulate(scene, duration, method, **given)
    N, T = run.normal_force / scene.F, normal.sense * run.tangential_force / scene.F
    assert {0, 1, 2} >= set(run.state.tolist()) > {1}
    speed = normal.speed_per_load
    gap, closing, (damped, added, struck, carried) = replayed(model, held, speed, ramp, run.time, N, T)
    unit = step * closing + (np.linalg.inv(usual.K)[0, 0] * N.max() if usual.K.any() else 0.0)
    touching = run.state != 0
    assert np.all(np.where(touching, np.abs(gap), -gap) <= GAP[method] * unit)
    residual = run.summary["energy_residual"]
    if held:
        # Its balance is without its own damping and its impacts; the replay says what they take.
        drive = speed * np.minimum(run.time / max(ramp, 1e-300), 1.0)
        work, friction = step * T @ drive, -step * T @ (normal.sense * run.slip_velocity / scene.F)
        given, lost, rest = work + carried, friction + damped, added + struck
        exchanged = max(abs(given) + abs(lost) + abs(given - lost - rest), reference_energy(normal, None))
        residual = abs(residual - abs(rest) / exchanged)
    assert residual <= BALANCE
