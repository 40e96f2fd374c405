"""What cannot be asked for is refused: a message names the argument, its value and what would do."""

import re
from functools import partial

import numpy as np
import pytest

from fivcore import (
    Beam,
    Rig,
    Scene,
    critical_mu,
    flutter_onsets,
    glued_frequencies,
    node_positions,
    onset_curves,
    simulate,
    simulate_many,
    sliding_modes,
    tune_head_mass,
    unstable_windows,
)
from fivcore.contact.ablation import with_dashpot, with_relaxation_time, without_cross_terms
from fivcore.contact.reduced import reduced_model

RIG, SCENE = Rig(), Scene(5e-3, 5.0, 0.2, 9.0)
STEEL = {"length": 0.15, "width": 0.015, "thickness": 0.003, "young_modulus": 185e9, "density": 7900.0}
NAN, ZEROS, SHORT = float("nan"), np.zeros(361), partial(with_relaxation_time, tau=1e-7)
ANGLE = "it must be a single angle between -90 and 90 degrees"


def beam(**change):
    Beam(**{**STEEL, "elements": 90, **change})


def scene(**change):
    Scene(**{"V": 1e-3, "theta": 5.0, "mu": 0.2, "F": 9.0, **change})


def run(**change):
    simulate(**{"scene": SCENE, "duration": 0.01, **change})


def law(**change):
    """An option of the contact's law, which two functions check."""
    with pytest.raises(ValueError, match=r".") as caught:
        critical_mu(RIG, 5.0, **change)
    with pytest.raises(ValueError, match=re.escape(str(caught.value))):
        run(**change)
    raise caught.value


CASES = [
    (partial(beam, length=-0.05), "Beam: length = -0.05: it must be a number from 1e-09 to 1e+06 (m)"),
    (partial(beam, young_modulus=float("inf")), "Beam: young_modulus = inf"),
    (partial(beam, density="steel"), "Beam: density = 'steel'"),
    (partial(beam, elements=0), "Beam: elements = 0: it must be a whole number from 1 to 1000"),
    (partial(beam, elements=True), "Beam: elements = True"),
    (partial(Rig, contact_position=0.2), "contact_position = 0.2: it must be above 0 and at most P2's length, "),
    (partial(Rig, contact_position=0.0), "Rig: contact_position = 0.0"),
    (partial(Rig, head_mass=-1.0), "Rig: head_mass = -1.0: it must be a number from 0 to 1e+15 (kg)"),
    (partial(Rig, d1=NAN), "Rig: d1 = nan"),
    (partial(Rig, d2=-1e-8), "Rig: d2 = -1e-08"),
    (partial(Rig, point_b=1.5), "Rig: point_b = 1.5: it must be a fraction"),
    (partial(Rig, p1=3), "Rig: p1 = 3: it must be a Beam"),
    (partial(scene, V=0.0), "V = 0.0: it must be a speed of 1e-100 to 1e+100 m/s, of either sign"),
    (partial(scene, theta=90.0), f"theta = 90.0: {ANGLE}"),
    (partial(scene, mu=-0.1), "mu = -0.1: it must be a number from 0 to 1e+06 (a coefficient of friction)"),
    (partial(scene, F=0.0), "F = 0.0: it must be a number from 1e-100"),
    (partial(scene, rig="rig"), "Scene: rig = 'rig': it must be a Rig"),
    # Arrays.
    (partial(sliding_modes, RIG, [5.0, 95.0], 0.2), "theta = 95.0"),
    (partial(sliding_modes, RIG, 5.0, [0.1, -0.2]), "mu = -0.2"),
    (partial(sliding_modes, RIG, 5.0, [0.1, NAN]), "mu = nan"),
    (partial(sliding_modes, RIG, "five", 0.2), "theta = 'five': it must be a single angle"),
    (partial(sliding_modes, RIG, 5.0, ["0.2"]), "mu = ['0.2']: it must be a number or an array of numbers"),
    (partial(sliding_modes, RIG, 5.0, np.ma.masked_array([0.1, 0.2], [False, True])), "mu = masked_array"),
    (partial(sliding_modes, RIG, 5.0, [0.1, [0.2]]), "mu = [0.1, [0.2]]"),
    (partial(sliding_modes, RIG, 5.0, 10**400), "mu = 1000"),
    (
        partial(sliding_modes, RIG, np.zeros(3), np.zeros(2)),
        "mu of shape (2,): it must broadcast with theta, (3,)",
    ),
    # Rigs, bands and ranges of the linear half.
    (partial(sliding_modes, 3, 5.0, 0.2), "rig = 3: it must be a Rig"),
    (partial(flutter_onsets, None, 5.0), "rig = None: it must be a Rig"),
    (partial(glued_frequencies, [], 5.0), "rig = []: it must be a Rig"),
    (partial(tune_head_mass, "rig", 5.0), "rig = 'rig': it must be a Rig"),
    (partial(node_positions, 3, 5.0), "rig = 3: it must be a Rig"),
    (partial(flutter_onsets, RIG, 90.0), f"theta = 90.0: {ANGLE}"),
    (partial(flutter_onsets, RIG, 5.0, -1.0), "fmax = -1.0: it must be a number from 0.001 to 1e+09 (Hz)"),
    (partial(flutter_onsets, RIG, 5.0, mu_max=0.0), "mu_max = 0.0"),
    (partial(onset_curves, RIG, [5.0, 3.0]), "theta of shape (2,): it must be a list of ascending angles"),
    (partial(onset_curves, RIG, 5.0), "theta of shape ()"),
    (partial(onset_curves, RIG, []), "theta of shape (0,)"),
    (partial(onset_curves, RIG, [5.0, 90.0]), f"theta = 90.0: {ANGLE}"),
    (partial(onset_curves, RIG, [5.0], 0.0), "fmax = 0.0"),
    (partial(onset_curves, RIG, [5.0], 10e3, 0.0), "mu_max = 0.0"),
    (partial(unstable_windows, RIG, -0.1, 0.0, 10.0), "mu = -0.1: it must be a number from 0 to 1e+06"),
    (
        partial(unstable_windows, RIG, 0.2, -90.0, 10.0),
        "theta_min = -90.0: it must be an angle between -90 and 90",
    ),
    (partial(unstable_windows, RIG, 0.2, 10.0, 10.0), "theta_max = 10.0: it must be above theta_min = 10 and bel"),
    (partial(unstable_windows, RIG, 0.2, 0.0, NAN), "theta_max = nan"),
    (partial(unstable_windows, RIG, 0.2, 0.0, 10.0, -1.0), "fmax = -1.0"),
    # Runs.
    (partial(run, step=3e-6), "step = 3e-06: "),
    (partial(run, step=2.2e-8, method="paper"), "at most 2.164e-08 s"),
    (partial(run, method="newmark"), "method = 'newmark': it must be one of fast, "),
    (partial(run, method=np.array(["fast"])), "method = array"),
    (partial(run, cutoff=-1.0), "cutoff = -1"),
    (partial(run, cutoff=1.0), "cutoff = 1: it must be above "),
    (partial(run, cutoff=50e3, method="paper"), "cutoff = 50000: the published scheme keeps all modes"),
    (partial(run, duration=0.0), "duration = 0"),
    (partial(run, ramp=-1.0), "ramp = -1"),
    (partial(run, ramp=1e-320), "ramp = 1e-320: it must be 0 or a time"),
    (partial(run, settle=-1.0), "settle = -1"),
    (partial(run, end_early=1), "end_early = 1: it must be a bool"),
    (partial(run, leap=1), "leap = 1: it must be a bool"),
    (partial(run, contact_motion=True), "contact_motion = True: it must be 0, -1 (towards P2's clamp) or 1"),
    (partial(run, contact_motion=2), "contact_motion = 2"),
    (partial(run, contact_motion=1, method="exact"), "contact_motion = 1: for method 'exact' it must be 0"),
    (partial(run, contact_motion=-1, duration=20.0), "duration = 20: it must be at most 15.6672 s, "),
    (partial(run, contact_motion=1, duration=20.0), "duration = 20: it must be at most 14.0005 s, "),
    (partial(run, record="a"), "record = 'a': it must be a bool or names of series among velocity_B, "),
    (partial(run, sample_rate=0.0), "sample_rate = 0"),
    (partial(run, duration=1e4, record=True), "over this duration it must be at most 10000 Hz"),
    (partial(run, sample_times=[0.0]), "sample_times: they are for what is recorded, and nothing is; give record"),
    (partial(run, sample_times=["x"], record=True), "sample_times: they must be numbers"),
    (partial(run, sample_times=[1e-3, 0.0], record=True), "sample_times of shape (2,): they must be a row of fin"),
    (partial(run, sample_times=[0.0, 0.02], record=True), "sample_times from 0 to 0.02 s: they must be from 0 to"),
    (partial(run, initial=3), "initial: it must be modal displacements"),
    (partial(run, initial=(np.zeros(3), np.zeros(3), 1)), "initial: modal displacements of shape (3,)"),
    (partial(run, initial=(ZEROS + 1e60, ZEROS, 1)), "initial: modal displacements"),
    (partial(run, initial=(ZEROS, ZEROS, 7)), "initial: contact state 7"),
    (
        partial(run, initial=(ZEROS, ZEROS, 1), scene=SCENE.mirrored()),
        "initial: with V < 0 give the mirrored scene",
    ),
    (
        partial(run, scene=Scene(1e-30, 5.0, 0.2, 9.0)),
        "V / F = 1.11111111111e-31: it must be a number from",
    ),
    (partial(run, scene="fig5"), "scene = 'fig5': it must be a Scene"),
    (partial(simulate_many, [SCENE, SCENE], 0.01, ramp=[1e-3]), "ramp: a list of 1: it must have one entry for"),
    (partial(simulate_many, [SCENE], -1.0), "duration = -1.0: it must be"),
    # The law of the contact.
    (partial(law, termination="soft"), "termination = 'soft': it must be one of absorbing, elastic, none"),
    (
        partial(law, termination="elastic", method="exact"),
        "termination = 'elastic': it must be 'absorbing' for method",
    ),
    (partial(law, modify=partial(with_relaxation_time, tau=-1e-9)), "tau = -1e-09: it must be a number from 0 to"),
    (partial(law, modify=SHORT, termination="none"), "modify: with termination 'none', or every mode kept, there"),
    (partial(law, modify=without_cross_terms, cutoff=1e9), "modify: with termination 'none', or every mode kept"),
    (partial(law, modify=SHORT, method="paper"), "modify: method 'paper' keeps all modes; leave it out"),
    (partial(law, modify=0), "modify = 0: it must be a function of a reduced model, or None"),
    (partial(law, beta2=0.8), "beta2 = 0.8: method 'fast' has none, only 'paper'; leave it out"),
    (partial(law, beta2=0.49, method="paper"), "beta2 = 0.49: it must be a number from 0.5 to 1"),
    (
        partial(law, numerical_damping="newmark"),
        "numerical_damping = 'newmark': it must be one of published, none",
    ),
    (
        partial(law, beta2=0.6, numerical_damping="none", method="paper"),
        "beta2 = 0.6 with numerical_damping = 'none': each sets the other; leave one out",
    ),
    (
        partial(simulate_many, [SCENE], 0.01, numerical_damping=["none", "published"]),
        "numerical_damping: a list of 2: it must have one entry for each of 1 scenes",
    ),
    (partial(with_dashpot, reduced_model(RIG, 5.0, 75e3), -1.0), "factor = -1"),
]


@pytest.mark.parametrize(("call", "text"), CASES)
def test_a_bad_argument_is_named_with_its_value_and_what_would_do(call, text):
    with pytest.raises(ValueError, match=re.escape(text)) as caught:
        call()
    assert "\n" not in str(caught.value)
