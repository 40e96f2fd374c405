"""Measured signals: each format gives the same numbers, which agree with closed forms and with a run's summary."""

import re
import struct
import warnings
import wave

import numpy as np
import pytest
from scipy.io import savemat, wavfile
from scipy.signal import lfilter

import studies
from fivcore import FixedContactWarning, Rig, Scene, simulate
from studies import registry, runner
from studies.answering.measured import Signal, statistics
from studies.cli.measure import beside

RATE, BAND = 50e3, (200.0, 10e3)


def run(V, d2=1.5e-7, duration=1.0):
    """A recorded run, and its velocity of B after settling, mm/s, with its times."""
    scene = Scene(V, 5.0, 0.2, 9.0, Rig.of(d2=d2))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FixedContactWarning)
        motion = simulate(scene, duration, record=("velocity_B",), sample_rate=RATE)
    settled = motion.time >= motion.summary["first_slip_time"] + 0.1
    return motion.summary, motion.time[settled], 1e3 * motion.velocity_B[settled]


@pytest.fixture(scope="module")
def motion():
    return run(2e-3, duration=0.6)


def text(path, rows, separator=",", decimal=".", head=""):
    lines = [separator.join(f"{each:.9g}".replace(".", decimal) for each in row) for row in rows]
    path.write_text("\n".join([head, *lines] if head else lines) + "\n")


def whole_numbers(path, values, bits):
    """A WAV file of whole numbers, whose full scale is 100 mm/s."""
    scaled = np.round(values / 100.0 * (2.0 ** (bits - 1) - 1)).astype(np.int64) + 128 * (bits == 8)
    with wave.open(str(path), "wb") as file:
        file.setparams((1, bits // 8, int(RATE), 0, "NONE", ""))
        file.writeframes(scaled.astype("<i8").view("u1").reshape(-1, 8)[:, : bits // 8].tobytes())


def universal(path, values, binary, kind=1):
    """A data set 58 by its definition: 11 lines, then numbers, four to a line or doubles of 8 bytes."""
    data = struct.pack(f"<{len(values)}d", *values)
    first = f"    58b     1     2{11:12d}{len(data):12d}{0:6d}{0:6d}{0:12d}{0:12d}" if binary else f"{58:6d}"
    lines = ["    -1", first, "v_B", *["NONE"] * 4]
    lines += [f"{kind:5d}{0:10d}{0:5d}{0:10d} {'P1':>10}{12:10d}{1:4d} {'P1':>10}{0:10d}{0:4d}"]
    lines += [f"{4:10d}{len(values):10d}{1:10d}{0.0:13.5e}{1.0 / RATE:13.5e}{0.0:13.5e}"]
    for code, unit in ((17, "s"), (11, "mm/s"), (0, "NONE"), (0, "NONE")):
        lines += [f"{code:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {unit:<20}"]
    body = "".join(f"{each:20.11e}" + "\n" * (k % 4 == 3) for k, each in enumerate(values))
    content = data if binary else body.rstrip("\n").encode()
    path.write_bytes("\n".join([*lines, ""]).encode() + content + b"\n    -1\n")


FORMATS = {
    "a.csv": (lambda p, t, v: text(p, zip(t, v, strict=True), head="t [s],v_B [mm/s]"), {}, 1e-8),
    "b.csv": (lambda p, t, v: text(p, zip(1e3 * t, v, strict=True), ";", ",", "Time (ms);v (mm/s)"), {}, 1e-8),
    "c.txt": (lambda p, t, v: text(p, zip(t, v, strict=True), " ", ",", "of a rig\n"), {"unit": "mm/s"}, 1e-8),
    "d.dat": (lambda p, t, v: text(p, v[:, None]), {"unit": "mm/s", "rate": "50kHz"}, 1e-8),
    "e.tsv": (lambda p, t, v: text(p, zip(v, -v, strict=True), "\t", head="v\tw"), {"channel": "w"}, 1e-8),
    **{f"{n}.wav": (lambda p, t, v, n=n: whole_numbers(p, v, n), {}, 2.0**-n) for n in (8, 16, 24, 32)},
    "float.wav": (lambda p, t, v: wavfile.write(p, int(RATE), (v / 100.0).astype(np.float32)), {}, 1e-7),
    "double.wav": (lambda p, t, v: wavfile.write(p, int(RATE), v / 100.0), {"channel": 1}, 1e-12),
    "ascii.uff": (lambda p, t, v: universal(p, v, False), {}, 1e-9),
    "binary.unv": (lambda p, t, v: universal(p, v, True), {}, 1e-12),
    "rate.mat": (lambda p, t, v: savemat(p, {"v": v, "fs": RATE}), {"unit": "mm/s"}, 1e-12),
    "times.mat": (lambda p, t, v: savemat(p, {"x": np.c_[v, v], "t": t}), {"unit": "mm/s", "channel": 2}, 1e-9),
}


@pytest.mark.parametrize("name", FORMATS)
def test_each_format_gives_the_numbers_of_the_signal(tmp_path, motion, name):
    """To its rounding, a share of 100 mm/s."""
    _, t, v = motion
    write, how, rounding = FORMATS[name]
    write(tmp_path / name, t, v)
    if name.endswith("wav"):
        how = how | {"unit": "100mm/s"}
    elif name == "e.tsv":
        how = how | {"unit": "mm/s", "rate": RATE}
    found, expected = studies.measure(tmp_path / name, **how), statistics(Signal("v", v, "mm/s", RATE), BAND)
    assert found["unit"] == "mm/s"
    for key, value in expected.items():
        if isinstance(value, float):
            # A universal file has the step of its times in six digits.
            assert found[key] == pytest.approx(value, rel=1e-5 + 20.0 * rounding, nan_ok=True), key
    assert len(found["quiet_times"]) == len(expected["quiet_times"])
    np.testing.assert_allclose(found["quiet_times"], expected["quiet_times"], atol=1e-4 + 0.1 * rounding)
    np.testing.assert_allclose(found["line_frequencies"][:2], expected["line_frequencies"][:2], rtol=1e-3)


def test_rounding_of_the_rate_changes_statistics_by_no_more(motion):
    """Spells begin and end between samples, whatever the last digits of the rate."""
    _, _, v = motion
    one, *others = (
        statistics(Signal("v", v, "mm/s", RATE * share), BAND)["dominant_frequency"]
        for share in (1.0, 1.0 - 1e-9, 1.0 + 1e-9)
    )
    assert others == pytest.approx([one] * 2, rel=1e-8)


@pytest.mark.parametrize(("V", "d2"), [(1e-3, 1.5e-7), (2e-3, 1e-8), (5e-3, 1e-8)])
def test_numbers_agree_with_the_summary_of_the_run(V, d2):
    """What both can know; the contact alone tells where sticks begin and end."""
    summary, _, v = run(V, d2)
    found = statistics(Signal("v", v, "mm/s", RATE), BAND)
    assert found["dominant_frequency"] == pytest.approx(summary["dominant_frequency"], rel=0.01)
    assert found["velocity_rms"] == pytest.approx(1e3 * summary["velocity_rms"], rel=0.01)
    assert found["periodicity"] == pytest.approx(summary["periodicity"], abs=0.05)
    if summary["regime"] != "intermittent":
        # No long stick has begun after settling.
        assert found["quiet_fraction"] < 0.02
        error = 1e3 * summary["velocity_rms_se"]  # none in a run so short at 2 mm/s
        assert np.isnan(error) or found["velocity_rms_se"] == pytest.approx(error, rel=0.5)
        return
    sticks = summary["stick_times"][summary["stick_starts"] > summary["first_slip_time"] + 0.1]
    assert abs(len(found["quiet_times"]) - len(sticks)) <= 2
    assert found["mean_quiet_time"] == pytest.approx(sticks.mean(), rel=0.2)
    assert found["quiet_frequency"] == pytest.approx(summary["stuck_frequency"], rel=0.001)


def test_bursts_of_known_tones():
    """20 ms of 2500 Hz and a tenth of its harmonic, then 30 ms of 1000 Hz at a hundredth, twenty times."""
    t = np.arange(50_000) / RATE
    loud = (t + 0.01) % 0.05 < 0.02
    tones = np.sin(2 * np.pi * 2500 * t) + 0.1 * np.sin(2 * np.pi * 5000 * t)
    found = statistics(Signal("v", np.where(loud, tones, 0.01 * np.sin(2 * np.pi * 1000 * t)), "g", RATE), BAND)
    assert found["dominant_frequency"] == pytest.approx(2500.0, abs=2.0)
    assert found["signal_rms"] == pytest.approx(np.sqrt(0.5 * (0.4 * 1.01 + 0.6 * 1e-4)), rel=1e-3)
    assert "velocity_rms" not in found
    assert found["line_frequencies"] == pytest.approx([2500.0, 5000.0], rel=1e-3)
    # Between two of its frequencies a Hann window's spectrum is up to 1.42 dB low.
    assert found["line_levels"] == pytest.approx([0.0, -20.0], abs=1.42)
    assert len(found["quiet_times"]) == 20
    # The mean over four periods sees the ends of a burst up to two periods late.
    assert found["quiet_times"] == pytest.approx(0.03, abs=4 / 2500)
    assert found["quiet_starts"] == pytest.approx(0.01 + 0.05 * np.arange(20), abs=2 / 2500)
    assert found["quiet_frequency"] == pytest.approx(1000.0, abs=2.0)


def test_a_tone_is_periodic_and_noise_is_not():
    t, noise = np.arange(50_000) / RATE, np.random.default_rng(1).normal(size=50_000)
    tone = statistics(Signal("v", np.sin(2 * np.pi * 640.0 * t), "mm/s", RATE), BAND)
    assert tone["periodicity"] == pytest.approx(1.0, abs=1e-3)
    assert tone["dominant_frequency"] == pytest.approx(640.0, abs=1.0)
    assert len(tone["quiet_times"]) == 0
    assert np.isnan(tone["mean_quiet_time"])
    assert abs(statistics(Signal("v", noise, "mm/s", RATE), BAND)["periodicity"]) < 0.1


def test_the_standard_error_of_the_rms_holds():
    """Noise through a resonance at 2 kHz, decay time 5 ms: within two of them in 95.4 % of signals."""
    rng, pole = np.random.default_rng(2), np.exp(-1.0 / (0.005 * RATE) + 2j * np.pi * 2000.0 / RATE)
    noise = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], rng.normal(size=(60, 30_000)))[:, 5_000:]
    found = [statistics(Signal("v", each, "mm/s", RATE), BAND) for each in noise]
    a, b = -2.0 * pole.real, abs(pole) ** 2
    # Variance of an autoregressive process of second order (Box and Jenkins, Time Series Analysis, 1976, 3.2.4).
    expected = np.sqrt((1.0 + b) / ((1.0 - b) * ((1.0 + b) ** 2 - a**2)))
    within = [abs(each["velocity_rms"] - expected) <= 2.0 * each["velocity_rms_se"] for each in found]
    assert 0.85 <= np.mean(within) <= 1.0
    errors = [each["velocity_rms_se"] for each in found]
    assert np.mean(errors) < 4.0 * np.std([each["velocity_rms"] for each in found])


def test_a_fast_signal_is_decimated(motion):
    _, _, v = motion
    slow = statistics(Signal("v", v, "mm/s", RATE), BAND)
    fast = np.fft.irfft(np.fft.rfft(v), 4 * len(v)) * 4.0
    quick = statistics(Signal("v", fast, "mm/s", 4.0 * RATE), BAND)
    assert (quick["analysed_rate"], quick["rate"]) == (RATE, 4.0 * RATE)
    assert quick["duration"] == pytest.approx(len(v) / RATE, abs=1.0 / RATE)
    for name in ("dominant_frequency", "velocity_rms", "quiet_fraction"):
        assert quick[name] == pytest.approx(slow[name], rel=0.01)


TIMES = np.arange(5000) / RATE
TONE = np.sin(2.0 * np.pi * 2617.0 * TIMES)


def csv(values, head="t [s],v [mm/s]", keep=slice(None), times=TIMES):
    return lambda path: text(path, np.column_stack([times, values])[keep], head=head)


BAD = {
    "gap": (csv(np.where(TIMES == 0.02, np.nan, TONE)), "", "v: 1 of 5000 samples are missing, first number 1001"),
    "jump": (csv(TONE, keep=np.r_[:900, 1000:5000]), "", "not even: 0.01798 s is followed by 0.02 s; cut out"),
    "jitter": (csv(TONE, times=TIMES + 1.8e-5 * (np.arange(5000) % 2)), "", "its times are not even"),
    "clipped": (csv(np.minimum(TONE, 0.8)), "", "it is clipped: .* values are 0.8, .*; record it with a larger"),
    "level": (csv(TONE, "t,v [dB]"), "", "--unit dB: a level has no phase; record the signal itself"),
    "levels": (csv(TONE), "--unit dBV", "--unit dBV: a level"),
    "short": (csv(TONE, keep=slice(1000)), "", "v has 1000 samples .*; it must have 1024: record 0.0205 s or"),
    "row": (csv(TONE, "t,v [g]", slice(1)), "", "v: it has less than two samples; it must have 1024"),
    "constant": (csv(0.0 * TONE + 3.0), "", "channel v: it is constant, 3; choose"),
    "several": (csv(np.c_[TONE, TONE], "t,v [g],w [g]"), "", "--channel missing: .* has 1 .v., 2 .w.; give one"),
    "unknown": (csv(TONE), "--channel z", "--channel = z|--channel z: .* has 1 .v.; give one"),
    "no unit": (csv(TONE, "t,v"), "", "--unit missing: .* names none; give mm/s, or 50mm/s"),
    "no rate": (lambda path: text(path, TONE[:, None]), "--unit g", "--rate missing: .*; give it in Hz, such as"),
    "rate": (csv(TONE), "--rate 0", "--rate 0: it must be above 0 Hz"),
    "speed": (csv(TONE), "--rate 5mm/s", "mm/s is a speed; rate is a rate: 5kHz"),
    "band": (csv(TONE), "--band 30kHz:40kHz", "band = .*: it must lie between 0 and half the rate, 25000 Hz"),
    "ends": (csv(TONE), "--band 5", "--band 5: it must be LOW:HIGH, such as"),
    "word": (lambda path: path.write_text("v [g]\n1\n2\nx\n"), "--rate 5", "it cannot be read: .*'x'"),
    "empty": (lambda path: path.touch(), "", "it has no line of numbers"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line(tmp_path, here, name):
    write, options, message = BAD[name]
    write(tmp_path / "bad.csv")
    done = here("measure", "bad.csv", *options.split())
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert re.search(message, done.stderr), done.stderr


def test_files_that_are_none(tmp_path, here):
    (tmp_path / "bad.wav").write_bytes(b"RIFF....WAVEfmt ")
    (tmp_path / "bad.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(400))
    universal(tmp_path / "bad.uff", TONE, False, kind=4)  # a frequency response
    savemat(tmp_path / "text.mat", {"a": "text"})
    for name, message in (
        ("bad.wav", "it cannot be read"),
        ("bad.mat", "MATLAB wrote v7.3"),
        ("bad.uff", "--channel missing: bad.uff has no signal"),
        ("text.mat", "has no signal"),
        ("none.csv", "No such file"),
        ("rows.xlsx", "its name must end in one of .csv"),
    ):
        done = here("measure", name)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert message in done.stderr


def test_the_command_prints_the_numbers_and_what_they_are(tmp_path, here, motion):
    _, t, v = motion
    text(tmp_path / "a.csv", zip(t, v, strict=True), head="t [s],v_B [mm/s]")
    done, found = here("measure", "a.csv"), studies.measure("a.csv")
    assert done.returncode == 0
    rows = dict(line.split(None, 1) for line in done.stdout.splitlines() if line)
    assert rows["dominant_frequency"] == f"{found['dominant_frequency']:.5g} Hz"
    assert rows["velocity_rms"] == f"{found['velocity_rms']:.5g} mm/s"
    assert "A signal does not show the state of the contact" in done.stderr
    assert "outside of the band" in here("measure", "a.csv", "--band", "8kHz:9kHz").stderr


def test_fig7_with_a_measured_signal(tmp_path, here, motion, monkeypatch):
    """It is drawn, nothing of it is stored, and what is no velocity is refused before anything is computed."""
    _, t, v = motion
    text(tmp_path / "a.csv", zip(t, v, strict=True), head="t [s],v_B [mm/s]")
    command, none = ("run", "fig7", "--set", "V=2mm/s", "--set", "duration=0.2"), {"rate": None, "channel": None}
    for study, file, unit, message in (
        ("fig7", "a.csv", "g", "unit = g: g is a mass; what is drawn is a speed"),
        ("fig7", None, "mm/s", "--unit mm/s: it is of a measured signal; give --measured FILE, too"),
        ("fig5", "a.csv", None, "--measured a.csv: fig5 does not draw it; fiv run fig7 does"),
    ):
        with pytest.raises(ValueError, match=message):
            beside(registry.load(study), file, unit=unit, **none)
    assert here(*command, "--measured", "b.csv").returncode == 2
    assert not (tmp_path / "results").exists()
    drawn = []
    monkeypatch.setattr("studies.runner.plot", lambda *given: drawn.append(runner.draw(*given[:2])) or [])
    done = here(*command, "--measured", "a.csv")
    assert done.returncode == 0
    assert "a.csv, v_B: in the figure alone" in done.stderr
    data = studies.open("fig7")
    assert not [name for name in data.variables if "measured" in name]
    drawn.append(runner.draw(runner.study_of(data), data))
    (both, alone) = (each[""].axes for each in drawn)
    assert (len(both), len(alone)) == (6, 3)
    assert both[3].get_title("left") == "(d) measured: a.csv, v_B"
    # Its spectrum lies over that of the run, whose main line it shares.
    assert [each.get_label() for each in both[2].lines].count("measured") == 1
    (line,) = both[5].lines
    assert 1e3 * line.get_xdata()[np.argmax(line.get_ydata())] == pytest.approx(2600.0, rel=0.05)
