"""What a file says: each mistake is one line that names it; nothing is computed or written for it."""

import copy

import pytest

import fivcore
from studies import registry
from studies.fitting import problem
from sweeps import InputError

GOOD = {
    "set": {"theta": 5},
    "unknown": {"contact_position": "uniform:60:110mm", "young_modulus": "loguniform:100:300GPa"},
    "target": [{"output": ["glued_frequency_1", "glued_frequency_2"], "value": "16, 374Hz", "within": "1%"}],
}
STUCK = "[unknown]\nmu = 'uniform:0:1'\n[[target]]\nis = "
STATES = {"is": "intermittent", "at": {"V": "1,2mm/s", "mu": 0.2}}


def read(**changes):
    return problem.read(copy.deepcopy(GOOD) | changes, registry.resolve)


def test_a_number_of_both_beams_is_one_unknown():
    model = read().model
    assert model.sources[0].unknowns == {
        "contact_position": "contact_position", "p1_young_modulus": "young_modulus",
        "p2_young_modulus": "young_modulus",
    }  # fmt: skip
    assert [(t.name, t.value, t.within, t.units) for t in model.targets] == [
        ("glued_frequency_1", 16.0, 0.16, "Hz"), ("glued_frequency_2", 374.0, 3.74, "Hz"),
    ]  # fmt: skip


def test_a_statement_is_a_target_at_each_point_and_targets_of_one_point_are_one_computation():
    own, at = {"d2": "loguniform:1e-8:1e-7"}, STATES["at"] | {"numerical_damping": "none"}
    loud = {"study": "regimes", "output": "velocity_rms", "value": "5,5 mm/s", "within": "1mm/s", "at": at}
    model = read(unknown=own, target=[{**STATES, "name": "slow"}, loud]).model
    assert [t.name for t in model.targets] == ["slow_1", "slow_2", "velocity_rms_1", "velocity_rms_2"]
    assert len(model.sources) == 1
    assert [t.has_error for t in model.targets] == [False, False, True, True]
    (target,) = read(unknown=own, target=[{"is": "not stuck", "at": at | {"V": "1mm/s"}}]).model.targets
    assert len(target.codes) == 5


WRONG = [
    ({"unknown": {}}, "unknown = {}: it must be a table of distributions"),
    ({"target": []}, "target = []: it must be tables [[target]]"),
    ({"targets": []}, "targets: no such key; did you mean target? the keys are name, set"),
    ({"samples": 0}, "samples = 0: it must be a whole number from 1 to"),
    ({"rounds": 1.5}, "rounds = 1.5: it must be a whole number from 1 to 100"),
    ({"name": "../a"}, "name = '../a': it must be of letters, digits, _ and -"),
    ({"set": {"thteta": 5}}, "thteta: no target depends on it; did you mean theta?"),
    ({"set": {"contact_position": 0.08}}, "contact_position: it is unknown and has a value; leave one out"),
    ({"unknown": {"contact_positon": "normal:1:1"}}, "glued_frequency_2: study map_glued depends on no unknown"),
    ({"unknown": GOOD["unknown"] | {"V": "normal:1:1mm/s"}}, "V: no target depends on it"),
    ({"unknown": {"contact_position": "normal:1"}}, "normal takes 2 numbers, not 1"),
    ({"unknown": {"contact_position": "loguniform:0:1"}}, "LOW must be above 0, not 0"),
    ({"unknown": {"contact_position": "uniform:1:2m"}}, "contact_position = "),
    ({"unknown": {"theta": "normal:5:1kg"}}, "theta: it is unknown and has a value"),
    ({"target": [1]}, "target 1: target = 1: it must be a"),
    ({"target": GOOD["target"] * 2}, "there are two of the name glued_frequency_1; give one another name"),
    ({"rig": "none.toml"}, "rig none.toml: it cannot be read"),
]
WRONG_TARGETS = [
    ({"value": "16, 374"}, "value = 16, 374: it needs its unit, for example 374 Hz"),
    ({"value": [16, 374]}, "value = 16, 374: it needs its unit"),
    ({"within": 1}, "within = 1: it needs its unit, for example 1 Hz"),
    ({"within": None}, "it must have output, value and within, or is"),
    ({"value": None}, "it must have output, value and within, or is"),
    ({"output": None}, "it must have output, value and within, or is"),
    ({"output": []}, "target 1: it must have output, value and within, or is"),
    ({"within": "0Hz"}, "within = 0: it must be above 0, one standard deviation"),
    ({"value": "16 kg"}, "kg is a mass"),
    ({"value": "16Hz"}, "has 2 values, value 1, within 1: select one in at, or give as many"),
    ({"values": 1}, "values: no such key; did you mean value?"),
    (
        {"output": "glued_frequncy_1"},
        "quantity glued_frequncy_1: no such quantity; did you mean glued_frequency_1",
    ),
    ({"study": "figure5"}, "STUDY = 'figure5': no study has this name"),
    ({"study": "fig5", "output": "frequency", "at": {"mu": "0.1,0.2"}}, " values, value 2, within 2: select"),
    ({"study": "fig5", "output": "frequencie"}, "study fig5 computes no frequencie; did you mean frequency?"),
    ({"study": "fig5", "output": "frequency", "at": {"mode": 99}}, "mode = 99: it must be one of 1, 2, 3"),
    ({"output": ["onset_mu", "onset_frequency"]}, "its outputs have different units"),
    ({"at": {"thet": 1}}, "thet: study map_glued has no such parameter; did you mean theta?"),
    ({"is": "intermittent", "value": None, "within": None, "output": "glued_frequency_1"}, "regimes computes no"),
    ({"at": "theta = 5"}, "at = 'theta = 5': it must be"),
    ({"output": "onset_mu", "value": 0.1, "within": 0.1, "name": "weight"}, "there are two of the name weight"),
    ({"output": "regime"}, "regime has words; write is = ..."),
]
WRONG_STATEMENTS = [
    ({"is": "intermitent"}, "is = 'intermitent': did you mean intermittent? it must be one of undecided, stuck"),
    ({"at": {"V": "1mm/s"}}, "mu: study regimes has a range of it; give its value in at"),
    ({"is": 3}, "is = '3': it must be one of undecided"),
    ({"is": "auto"}, "is = 'auto': it must be one of undecided"),
    ({"output": "velocity_rms"}, "velocity_rms has numbers; write value = ..."),
]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        *WRONG,
        *(({"target": [{**GOOD["target"][0], **change}]}, message) for change, message in WRONG_TARGETS),
        *(({"target": [STATES | change]}, message) for change, message in WRONG_STATEMENTS),
    ],
)
def test_a_mistake_is_one_line(change, message):
    whole = copy.deepcopy(GOOD) | change
    for table in whole["target"]:
        if isinstance(table, dict):
            for key in [key for key, value in table.items() if value is None]:
                del table[key]
    with pytest.raises((InputError, fivcore.InputError)) as caught:
        problem.read(whole, registry.resolve)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "bench.toml: it cannot be read: No such file"),
        ("a = [", "bench.toml: it is not TOML"),
        (f"seed = -1\n{STUCK}'stuck'", "bench.toml: seed = -1: it must be"),
        (f"{STUCK}'stuc'\nat.V = 0.001", "target 1: is = 'stuc': did you mean stuck?"),
    ],
)
def test_the_command_refuses_a_file_and_writes_nothing(here, tmp_path, text, message):
    if text is not None:
        (tmp_path / "bench.toml").write_text(text)
    done = here("fit", "bench.toml", "-q")
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert message in done.stderr
    assert not (tmp_path / "results").exists()
