"""What cannot be asked for is refused with a ValueError that names the argument and its value, in one line."""

from functools import partial

import numpy as np
import pytest

import fivcore
from fivcore import Beam, InputError, Rig, Scene, Until
from fivcore.contact.reduced import reduced_model
from studies.accuracy.ablation import truncated, with_dashpot, without_cross_terms

RIG, SCENE, NAN, INF = Rig(), Scene(5e-3, 5.0, 0.2, 9.0), float("nan"), float("inf")
ZEROS, SHORT = np.zeros(361), partial(with_dashpot, factor=0.6)
STEEL = {"length": 0.15, "width": 0.015, "thickness": 0.003, "young_modulus": 185e9, "density": 7900.0}


def law(**given):
    """Options of the contact's law, which two functions check alike."""
    messages = []
    for call in (partial(fivcore.painleve_mu, RIG, 5.0), partial(fivcore.simulate, SCENE, 0.01)):
        with pytest.raises(ValueError, match=r".") as caught:
            call(**given)
        messages.append(str(caught.value))
    assert messages[1].startswith(messages[0])
    raise caught.value


def of(function, **usual):
    """The function with usual arguments, of which a row changes some."""
    return lambda **given: function(**usual | given)


CALLS = {
    "beam": of(Beam, elements=90, **STEEL),
    "rig": Rig,
    "rig of": Rig.of,
    "scene": of(Scene, V=1e-3, theta=5.0, mu=0.2, F=9.0),
    "modes": of(fivcore.sliding_modes, rig=RIG, theta=5.0, mu=0.2),
    "onsets": of(fivcore.flutter_onsets, rig=RIG, theta=5.0),
    "onset sensitivity": of(fivcore.onset_sensitivity, rig=RIG, theta=5.0),
    "curves": of(fivcore.onset_curves, rig=RIG, theta=[5.0, 6.0]),
    "windows": of(fivcore.unstable_windows, rig=RIG, mu=0.2, theta_min=0.0, theta_max=10.0),
    "glued": of(fivcore.glued_frequencies, rig=RIG, theta=5.0),
    "tuning": of(fivcore.tune_head_mass, rig=RIG, theta=5.0, frequency=16.0),
    "nodes": of(fivcore.node_positions, rig=RIG, theta=5.0),
    "many": lambda numbers=None, **given: fivcore.flutter_onsets_many(
        {"theta": 1.0} if numbers is None else numbers, **given
    ),
    "unstable": fivcore.flutter_onsets_many({"theta": 5.0}).unstable,
    "run": of(fivcore.simulate, scene=SCENE, duration=0.01),
    "runs": of(fivcore.simulate_many, scenes=[SCENE, SCENE], duration=0.01),
    "law": law,
    "until": Until,
    "dashpot": partial(with_dashpot, reduced_model(RIG, 5.0, 75e3)),
}
# A function, and arguments of it each of which alone is wrong.
ALONE = [
    ("beam", {"length": -0.05, "young_modulus": INF, "density": "steel", "width": 1e7, "thickness": None}),
    ("beam", {"elements": 0}),
    ("beam", {"elements": True}),
    ("rig", {"contact_position": 0.2, "head_mass": -1.0, "d1": NAN, "d2": -1e-8, "point_b": 1.5, "p1": 3}),
    ("rig", {"contact_position": 0.0}),
    ("rig of", {"p1_length": -1.0, "contact_position": 9.0, "p1": 3, "p2": {"size": 1.0}}),
    ("scene", {"V": 0.0, "theta": 90.0, "mu": -0.1, "F": 0.0, "rig": "rig"}),
    ("modes", {"rig": 3, "theta": "five", "mu": ["0.2"]}),
    ("modes", {"mu": [0.1, [0.2]]}),
    ("onsets", {"rig": None, "theta": 90.0, "fmax": -1.0, "mu_max": 0.0}),
    ("onset sensitivity", {"rig": 3, "theta": "five", "fmax": -1.0, "mu_max": 0.0}),
    ("curves", {"fmax": 0.0, "mu_max": 0.0}),
    ("windows", {"mu": -0.1, "theta_min": -90.0, "theta_max": NAN, "fmax": -1.0}),
    ("glued", {"rig": [], "count": 360}),
    ("tuning", {"rig": "rig", "frequency": 9000.0}),
    ("tuning", {"frequency": 1e-6}),
    ("tuning", {"frequency": NAN}),
    ("nodes", {"rig": 3}),
    ("many", {"numbers": 5.0, "threads": 0, "rig": None, "fmax": -1.0}),
    ("unstable", {"mu": 1.5}),
    ("run", {"scene": "fig5", "duration": 0.0, "ramp": -1.0, "settle": -1.0, "cutoff": -1.0, "sample_rate": 0.0}),
    ("run", {"method": "newmark", "ramp": 1e-320, "end_early": 1, "skip_sticks": 1, "record": "a", "initial": 3}),
    ("run", {"step": 3e-6, "cutoff": 1.0}),
    ("runs", {"duration": -1.0}),
    ("law", {"modify": 0, "beta2": 0.8, "numerical_damping": "newmark"}),
    ("until", {"standard_error": 0.0, "least": -1.0, "most": NAN}),
    ("dashpot", {"factor": -1.0}),
]
# A function, arguments that are wrong together or within themselves, and what the message has to say.
MASKED = np.ma.masked_array([0.1, 0.2], [False, True])
MOVED = {"theta": 1.0, "contact_position": [0.3, 0.1, 0.29], "p2_length": [0.4, 0.05, 0.3]}
TOGETHER = [
    ("rig of", {"p1_lenght": 1.0}, "p1_lenght: a rig has no such number; did you mean p1_length?"),
    ("rig of", {"p3_length": 1.0}, "p3_length: a rig has no such number"),
    ("modes", {"theta": [5.0, 95.0]}, "theta = 95.0"),
    ("modes", {"mu": [0.1, -0.2]}, "mu = -0.2"),
    ("modes", {"mu": [0.1, NAN]}, "mu = nan"),
    ("modes", {"mu": MASKED}, "mu = masked_array"),
    ("modes", {"mu": 10**400}, "mu = 1000"),
    ("modes", {"theta": np.zeros(3), "mu": np.zeros(2)}, "mu of shape (2,): it must broadcast with theta, (3,)"),
    ("curves", {"theta": [5.0, 3.0]}, "theta of shape (2,)"),
    ("curves", {"theta": 5.0}, "theta of shape ()"),
    ("curves", {"theta": []}, "theta of shape (0,)"),
    ("curves", {"theta": [5.0, 90.0]}, "theta = 90.0"),
    ("windows", {"theta_min": 10.0, "theta_max": 10.0}, "theta_max = 10.0: it must be above theta_min = 10"),
    ("many", {"numbers": {}}, "theta is missing"),
    ("many", {"numbers": {"theta": [1.0, 90.0]}}, "rig of row 1: theta = 90.0"),
    ("many", {"numbers": {"theta": 1.0, "p1_lenght": 1.0}}, "'p1_lenght'"),
    ("many", {"numbers": {"theta": 1.0, "p1_length": [1, 0]}}, "p1 of row 1: Beam: length = 0.0"),
    ("many", {"numbers": {"theta": 1.0, "p2_density": [1e3, 1e10]}}, "p2 of row 1: Beam: density = 10000000000.0"),
    ("many", {"numbers": {"theta": 1.0, "d1": [1.0, 2.0, NAN, 0.0]}}, "rig of row 2: Rig: d1 = nan"),
    ("many", {"numbers": {"theta": 1.0, "head_mass": "heavy"}}, "head_mass = 'heavy'"),
    ("many", {"numbers": {"theta": 1.0, "head_mass": True}}, "head_mass = True"),
    ("many", {"numbers": {"theta": [[1.0]]}}, "theta = [[1.0]]"),
    ("many", {"numbers": {"theta": [1.0, 2.0], "d1": [1.0, 2.0, 3.0]}}, "rows of [2, 3] numbers"),
    ("many", {"numbers": MOVED}, "rig of row 1: Rig: contact_position = 0.1"),
    ("run", {"method": np.array(["fast"])}, "method = array"),
    ("run", {"step": 2.2e-8, "method": "paper"}, "at most 2.164e-08 s"),
    *(
        ("run", {"method": method, name: value}, f"{name} = {value}: method '{method}' does not use it")
        for method, given in {
            "fast": {"beta2": 0.7},
            "exact": {"beta2": 0.7, "skip_sticks": False, "end_early": False},
            "paper": {"cutoff": 50e3, "skip_sticks": False, "end_early": False},
        }.items()
        for name, value in given.items()
    ),
    (
        "run",
        {"cutoff": 20e3, "method": "exact", "modify": partial(with_dashpot, factor=0.0)},
        "cutoff = 20000",
    ),
    ("run", {"duration": 1e4, "record": True}, "over this duration it must be at most 10000 Hz"),
    ("run", {"duration": 2e-3, "step": 1e-12}, "step = 1e-12: it must be at least 2e-11 s over this duration"),
    ("run", {"sample_times": [0.0]}, "sample_times"),
    ("run", {"sample_times": ["x"], "record": True}, "sample_times"),
    ("run", {"sample_times": [1e-3, 0.0], "record": True}, "sample_times of shape (2,)"),
    ("run", {"sample_times": [0.0, 0.02], "record": True}, "sample_times from 0 to 0.02 s"),
    ("run", {"initial": (np.zeros(3), np.zeros(3), 1)}, "initial: modal displacements of shape (3,)"),
    ("run", {"initial": (ZEROS + 1e60, ZEROS, 1)}, "initial: modal displacements"),
    ("run", {"initial": (ZEROS, ZEROS, 7)}, "initial: contact state 7"),
    ("run", {"initial": (ZEROS, ZEROS, 1), "scene": SCENE.mirrored()}, "initial: with V < 0 give the mirrored"),
    ("run", {"scene": Scene(1e-30, 5.0, 0.2, 9.0)}, "V / F = 1.11111111111e-31"),
    ("run", {"scene": Scene(1e-3, 5.0, 0.2, 9.0, Rig(d2=100.0)), "duration": 2e-3}, "d2 = 100:"),
    ("run", {"scene": Scene(1e-3, 5.0, 0.2, 9.0, Rig(d1=1e12)), "duration": 2e-3}, "d1 = 1e+12,"),
    ("runs", {"ramp": [1e-3]}, "ramp: a list of 1"),
    ("runs", {"numerical_damping": ["none", "published", None]}, "numerical_damping: a list of 3"),
    ("law", {"modify": partial(with_dashpot, factor=-1e-9)}, "factor = -1e-09"),
    ("law", {"modify": truncated, "cutoff": 1e9}, "modify: every mode is kept"),
    ("law", {"modify": without_cross_terms, "cutoff": 1e9}, "modify: every mode is kept"),
    ("law", {"modify": SHORT, "method": "paper"}, "method 'paper' does not use it"),
    ("law", {"cutoff": 50e3, "method": "paper"}, "cutoff = 50000.0: method 'paper' does not use it"),
    ("law", {"beta2": 0.49, "method": "paper"}, "beta2 = 0.49"),
    ("law", {"beta2": 0.6, "numerical_damping": "none", "method": "paper"}, "beta2 = 0.6 with numerical_damping"),
]
ROWS = [(call, {name: value}, None) for call, given in ALONE for name, value in given.items()]


@pytest.mark.parametrize(("call", "given", "text"), ROWS + TOGETHER)
def test_a_bad_argument_is_named_with_its_value(call, given, text):
    with pytest.raises(ValueError, match=r".") as caught:
        CALLS[call](**given)
    message = str(caught.value)
    assert "\n" not in message
    if text is not None:
        assert text in message
        return
    ((name, value),) = given.items()
    written = {f"{name} = {value!r}"} | ({f"{name} = {value:g}"} if isinstance(value, float) else set())
    assert any(each in message for each in (*written, f"{name}: ")), message
    assert isinstance(caught.value, InputError)


def test_an_option_that_there_is_not_is_a_type_error():
    with pytest.raises(TypeError, match=r"'ramps'"):
        fivcore.simulate_many([SCENE], 0.01, ramps=1e-3)
