"""What the gallery cannot compute or record is refused in a line before anything is planned."""

import pytest

from studies import registry

# By what refuses it, each once; `fivcore.Scene` and `Rig` name their own numbers.
REFUSED = [
    # A grid of scenes: every value of each axis, and both ends of V / F.
    ("scenes", {"theta": [0.0, 95.0]}, r"^theta = 95\.0: it must be"),
    ("scenes", {"V": [1e-12, 1e-3]}, r"^V / F = 1\.1.*e-13: it must be"),
    ("scenes", {"duration": -1.0}, r"^duration = -1\.0: it must be a number from"),
    ("scenes", {"standard_error": 0.0}, r"^standard_error = 0\.0: it must be a number from"),
    ("scenes", {"settle": 1e7}, r"^settle = 10000000\.0: it must be"),
    ("scenes", {"rho": 1.0}, "^rho: study scenes has no such axis; "),
    # Histories along one axis.
    ("fig7", {"duration": 0.01}, "^duration = 0.01: it must be a number from 0.05 to"),
    ("fig7", {"sample_rate": 10.0}, "^sample_rate = 10.0: it must be a number from 1000 to"),
    ("fig7", {"ramp": -1.0}, "^ramp = -1.0: it must be 0 or a time from 1e-9 to"),
    ("contact", {"window": 1.0}, "^window = 1.0: it must be a number from 1e-05 to 0.1"),
    ("contact", {"window_start": 100.0}, "^window_start = 100.0: it must be a number from 0 to"),
    ("contact", {"overview": 0.0}, "^overview = 0.0: it must be a number from 0.01 to"),
    ("fig11", {"theta": [10.0, 95.0]}, "^theta = 95.0: it must be a single angle"),
    # Ensembles.
    ("regimes", {"V": [-1e-3, 1e-3]}, r"^V = -0\.001: it must be above 0; the mirror image"),
    ("regimes", {"members": 101.0}, r"^members = 101\.0: it must be a whole number"),
    ("regimes", {"least": -1.0}, r"^least = -1\.0: it must be a number from"),
    ("regimes", {"standard_error": -1.0}, "^standard_error = -1.0: it must be a number from"),
    ("stick_time", {"loading_times": -1.0}, "^loading_times = -1.0: it must be a number from"),
    ("regimes", {"most": 0.0}, r"^most = 0\.0: it must be a number from"),
    (
        "regimes",
        {"ramp": 0.0},
        r"^ramp = 0\.0: it must be a number from 1e-09 to 1000 \(s, for repeat runs differ by it",
    ),
    ("regimes", {"duration": 1.0}, "^duration: study regimes has no such axis"),
    ("table6", {"theta": [5.0, 95.0]}, "^theta = 95.0: it must be a single angle"),
    ("stick_time", {"member": [0, 1]}, "^member = 0"),
    # Modes.
    ("stability", {"theta": [0.0, 90.0]}, "^theta = 90.0: it must be"),
    ("stability", {"mu": [-0.1, 0.2]}, "^mu = -0.1: it must be a number from 0"),
    ("sensitivity", {"pairs_theta": 0.0}, "^pairs_theta = 0.0: it must be an angle between 0 and 90"),
    ("sensitivity", {"mu_max": 0.0}, "^mu_max = 0.0: it must be a number from"),
    ("sensitivity", {"parameter": "p2_lenght"}, "^parameter = 'p2_lenght': .* did you mean p2_length"),
]


@pytest.mark.parametrize(("name", "given", "message"), REFUSED)
def test_what_cannot_be_computed_is_named(name, given, message):
    with pytest.raises(ValueError, match=message) as caught:
        registry.load(name).sweep(given)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "given", "record", "rate", "message"),
    [
        ("scenes", {}, ["velocity_b"], None, "^record = 'velocity_b': .* no such series; did you mean velocity_B"),
        ("fig7", {}, ["force"], None, "^record = 'force': .* no such series; .*the series are velocity_B, normal"),
        ("fig5", {}, ["velocity_B"], None, "^study fig5 has no motion in time to record"),
        ("fig6", {}, (), 1e4, "^study fig6 has no motion in time to record"),
        ("scenes", {}, (), 1e4, "^sample_rate = 10000.0: it is for what is recorded, and nothing is"),
        ("fig7", {}, (), 1e4, "^sample_rate = 10000.0: it is for what is recorded"),
        ("scenes", {}, ["state"], 99.0, "^sample_rate = 99.0: it must be a number from 100 to 1e"),
        ("scenes", {}, ["state"], 2e6, "^sample_rate = 2000000.0: it must be a number from 100 to 1e"),
        ("scenes", {}, ["state"], "fast", "^sample_rate = 'fast': it must be a number"),
        ("scenes", {"duration": 40.0}, ["state"], None, "= 50000: over duration = 40 s it must be at most 25000"),
        ("scenes", {"duration": 1e-3}, ["state"], 500.0, "= 500: over duration = 0.001 s it must be at least"),
        ("fig7", {"sample_rate": 1e4}, ["state"], 2e4, "^sample_rate = 20000.0: study fig7 has it as a setting"),
        ("fig11", {}, ["state"], 200.0, "^sample_rate = 200.0: it must be a number from 1000 to"),
        ("contact", {}, ["state"], 1e5, "^record = state: study contact keeps its series in a window already"),
        ("contact", {}, ["stat"], 1e5, "^record = 'stat': there is no such series; did you mean state"),
    ],
)
def test_what_cannot_be_recorded_is_named(name, given, record, rate, message):
    with pytest.raises(ValueError, match=message) as caught:
        registry.load(name).sweep(given, record=record, sample_rate=rate)
    assert "\n" not in str(caught.value)
