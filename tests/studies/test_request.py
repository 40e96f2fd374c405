"""Requests: SPEC, units, words, TOML files and tables of points, as values of a study's parameters."""

import numpy as np
import pytest

from studies.asking import request
from studies.asking.request import Request
from studies.asking.sweep import sweep_of
from studies.declaring import spec
from studies.declaring.parameters import suggest
from studies.declaring.units import convert
from studies.gallery import fig5
from studies.study import Parameter, Study
from sweeps import InputError


def letters(case, method, V):
    return {"letters": np.char.str_len(case).astype(float)}


CASES = ["touching", "tangent, missed", "tangent", "mu = 0"]
WORDS = Study(
    "letters", "Letters", "How many letters?",
    {"case": Parameter(CASES), "method": Parameter(["fast", "exact"]), "V": Parameter(1e-3, "m s-1"),
     "cutoff": Parameter(None, "Hz"), "members": Parameter(4)},
    {"letters": ("1", "letters")}, letters,
)  # fmt: skip


@pytest.mark.parametrize(
    ("text", "units", "values"),
    [
        ("0.2", "1", [0.2]),
        ("1e-3,2e-3,5e-3", "m s-1", [1e-3, 2e-3, 5e-3]),
        ("0:0.5:6", "1", [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]),
        ("-5:5:3", "degree", [-5.0, 0.0, 5.0]),
        ("log:1e-4:1e-2:3", "m s-1", [1e-4, 1e-3, 1e-2]),
        ("2mm/s", "m s-1", [0.002]),
        ("50:80:7mm", "m", [0.05, 0.055, 0.06, 0.065, 0.07, 0.075, 0.08]),
        ("0.15cm:3mm:4", "m", [1.5e-3, 2e-3, 2.5e-3, 3e-3]),
        ("1,2,5 mm/s", "m s-1", [1e-3, 2e-3, 5e-3]),
        ("log:0.1mm/s:10mm/s:3", "m s-1", [1e-4, 1e-3, 1e-2]),
        ("7.85 g/cm^3", "kg m-3", [7850.0]),
        ("20%", "1", [0.2]),
        ("0.1rad", "degree", [5.72957795130823]),
        ("0.5,2mm/s", "m s-1", [5e-4, 2e-3]),
        ("1e-3,2m/s", "m s-1", [1e-3, 2.0]),  # the unit changes nothing
        ("1e-3,2e-3", "m s-1", [1e-3, 2e-3]),
        ("1,2e0 mm/s", "m s-1", [1e-3, 2e-3]),  # the exponent is beside the unit
    ],
)
def test_a_spec_is_the_values_one_would_type(text, units, values):
    np.testing.assert_array_equal(spec.parse(text, "x", units), values)
    assert spec.count(text) >= len(values)


@pytest.mark.parametrize(
    ("text", "units", "reason"),
    [
        ("", "m", "'' must be a finite number; the forms are 0.2 |"),
        ("1_0", "m", "'1_0' must be a finite number"),
        ("0x1", "m", "x1 is no unit"),
        ("nan", "m", "'nan' must be a finite number"),
        ("1e400m", "m", "'1e400' must be a finite number"),
        ("1,,2", "m", "'' must be a finite number"),
        ("0:1", "m", "a range must be start:stop:count"),
        ("0:1:2.5", "m", "count must be a whole number from 1 to 10000000, not '2.5'"),
        ("0:1:1", "m", "two equal ends have a count of 1, two others a larger one"),
        ("5:5:11", "m", "two equal ends have a count of 1, two others a larger one"),
        ("-1e308:1e308:3", "m", "the ends must not be so far apart"),
        ("log:0:1:3", "m", "both ends of a log: range must be above 0"),
        ("1mm:2:4", "m", "write a unit at each value (the count has none), or once at the end for all"),
        ("1mm,2", "m", "write a unit at each value, or once at the end for all"),
        ("1e-3,2mm/s", "m s-1", "1e-3 beside 2mm/s: write 1e-3mm/s, or 1e-3 m s-1;"),
        ("log:1E-4:1e-2:30mm/s", "m s-1", "1E-4 beside 30mm/s: write 1E-4mm/s, or 1E-4 m s-1;"),
        ("2e1,50%", "1", "2e1 beside 50%: write 2e1%, or 2e1;"),
        ("2mm", "m s-1", "mm is a length; x is a speed: 5mm/s or 5e-3"),
        ("5kg", "degree", "kg is a mass; x is an angle: 5deg or 5"),
        ("3x", "m", "x is no unit; write it like mm, mm/s or kg m-3"),
    ],
)
def test_what_is_no_spec_is_refused_with_the_reason(text, units, reason):
    with pytest.raises(InputError) as caught:
        spec.parse(text, "x", units)
    assert str(caught.value).startswith(f"x = {text!r}: {reason}")


def test_refined_values_keep_those_of_fewer_levels():
    for text in ("0:20:9", "log:1e-4:1e-2:9", "1,2,5"):
        coarse, fine = (spec.refined(text, "V", levels) for levels in (2, 3))
        np.testing.assert_array_equal(fine[::2], coarse)
        assert len(fine) == 2 * len(coarse) - 1
    for text, values in (("log:1:100:2", [1, 10, 100]), ("log:1:100:3", 10.0 ** np.arange(0, 2.1, 0.5))):
        np.testing.assert_allclose(spec.refined(text, "V", 1), values)
    assert spec.refined("0:3:3", "V", 1).tolist() == [0.0, 0.75, 1.5, 2.25, 3.0]
    for text, levels in (("0:1:3", 23), ("1,1.0000000000000002", 1), ("1.000000000000009,1.00000000000001", 1)):
        with pytest.raises(InputError, match=f"it cannot be halved {levels} times; choose a smaller refine"):
            spec.refined(text, "V", levels)


@pytest.mark.parametrize(
    ("values", "ends"),
    [
        ([2.0], [1.0, 3.0]),
        ([0.0], [-0.5, 0.5]),
        ([1.0, 19.0], [-8.0, 10.0, 28.0]),
        ([1.0, 10.5, 20.0], [-3.75, 5.75, 15.25, 24.75]),  # wide, but even
        ([-1.0, 0.0, 99.0], [-1.5, -0.5, 49.5, 148.5]),
        ([1.0, 25.0], [0.2, 5.0, 125.0]),
        ([1.0, 20.0], [20.0**-0.5, 20.0**0.5, 20.0**1.5]),
        ([1.0, 7.0, 20.0], [7.0**-0.5, 7.0**0.5, 140.0**0.5, 20.0 * (20.0 / 7.0) ** 0.5]),
    ],
)
def test_cells_end_half_way_in_logarithms_on_an_axis_that_is_wide_and_whose_steps_grow(values, ends):
    np.testing.assert_allclose(spec.edges(np.array(values)), ends, rtol=1e-14)


@pytest.mark.parametrize(
    ("values", "number", "found", "meant"),
    [
        ([0.0], 0.0, 0.0, True),
        ([1e-3], 1.0000009e-3, 1e-3, True),
        ([1e-3], 1.001e-3, 1e-3, False),
        ([3.0, 2.0, 1.0], 2.0009, 2.0, True),  # a thousandth of the way to the next
        ([1.0, 2.0, 3.0], 1.0011, 1.0, False),
        ([1.0, 2.0, 2.1], 2.00009, 2.0, True),
        ([1.0, 2.0, 2.1], 2.0002, 2.0, False),  # that way is the shorter one
        ([1, 2], 2.4, 2, False),
    ],
)
def test_a_number_means_the_value_next_to_it_if_it_is_near(values, number, found, meant):
    assert spec.nearest(values, number) == (found, meant)


@pytest.mark.parametrize(
    ("name", "known", "said"),
    [
        ("mod", ["mu", "p1_young_modulus"], "p1_young_modulus"),
        ("le", ["mu", "p1_length"], ""),
        ("mv", ["mu", "V"], "mu"),
        ("elements", ["p1_elements", "p2_elements"], "p2_elements or p1_elements"),
    ],
)
def test_a_near_miss_or_a_part_of_a_name_is_suggested(name, known, said):
    assert suggest(name, known) == (f"did you mean {said}? " if said else "")


@pytest.mark.parametrize(
    ("value", "given", "own", "found"),
    [
        (2.0, "mm s-1", "m s-1", 2e-3),
        (2.0, "mm * s^-1", "m s-1", 2e-3),
        (3.0, "N mm-2", "Pa", 3e6),
        (0.5, "µm", "m", 5e-7),
        (5.0, "°", "degree", 5.0),
        (2.0, "kHz", "s-1", 2000.0),
    ],
)
def test_a_value_in_another_unit(value, given, own, found):
    assert convert(value, given, own) == found


@pytest.mark.parametrize("given", ["degC", "furlongz", "__import__('os')", "9**9**9", "m**9**9**9"])
def test_what_is_no_unit_is_never_computed(given):
    with pytest.raises(InputError, match=r"(is no unit|have different zeros|is a)"):
        convert(1.0, given, "K")


def values(**typed):
    return Request(values=typed).values_of(WORDS)


def test_values_are_words_numbers_auto_and_distributions():
    found = values(case="mu = 0, tangent, missed ,tangent", V="1,2mm/s", cutoff="auto", method=["exact"])
    assert found["case"] == ["mu = 0", "tangent, missed", "tangent"]
    assert found["V"].tolist() == [1e-3, 2e-3]
    assert found["cutoff"] is None
    assert values(V="uniform:1:2mm/s")["V"].ppf(0.5) == pytest.approx(1.5e-3)
    data = sweep_of(WORDS, found).plan().run("sync")
    # Words in the study's order, each once.
    assert data["case"].values.tolist() == ["tangent, missed", "tangent", "mu = 0"]
    assert data["letters"].sel(V=2e-3).values.ravel().tolist() == [15.0, 7.0, 6.0]


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ({"case": "tangnt"}, "case = 'tangnt': did you mean tangent?"),
        ({"case": "x"}, "case = 'x': it must be one of touching, tangent, missed, tangent, mu = 0"),
        ({"speed": "1"}, "speed: study letters has no such parameter"),
        ({"members": "2.5"}, "members = 2.5: it must be a whole number"),
        ({"V": True}, "V = True: it must be a number or a list of numbers"),
        ({"case": "normal:1:2"}, "case = 'normal:1:2': it must be one of"),
        ({"members": "normal:4:1"}, "members = normal:4:1: it has no distribution"),
    ],
)
def test_what_a_parameter_cannot_be_is_refused(typed, message):
    with pytest.raises(InputError) as caught:
        sweep_of(WORDS, values(**typed))
    assert str(caught.value).startswith(message)


def test_a_request_is_completed_by_another():
    file = Request("fig5", {"mu": "0.1", "theta": "8"}, samples=4, seed=1, scheduler="sync")
    options = Request(values={"mu": "0.2"}, seed=0, workers=2)
    both = options.over(file)
    assert both.values == {"mu": "0.2", "theta": "8"}
    assert (both.study, both.samples, both.seed) == ("fig5", 4, 0)
    assert (both.scheduler, both.workers) == (None, 2)  # together they say where


def test_a_file_is_the_request_that_it_writes(tmp_path):
    file = tmp_path / "run.toml"
    file.write_text(
        'study = "scenes"\nrecord = ["velocity_B"]\nsample_rate = 20_000\nsamples = 8\nseed = 3\n'
        'points = {F = [9, 18]}\nset = {V = "2mm/s", mu = [0.1, 0.3]}\n'
        '[scatter]\ntheta = "normal:5:1"\n'
    )
    found = request.read(file)
    assert found.values == {"V": "2mm/s", "mu": [0.1, 0.3], "theta": "normal:5:1"}
    assert (found.study, found.record, found.sample_rate) == ("scenes", ("velocity_B",), 20_000)
    assert (found.samples, found.seed) == (8, 3)
    assert found.points == {"F": [9, 18]}
    assert found.stored() == {"record": ["velocity_B"], "scatter": {"theta": "normal:5:1"}, "seed": 3}


@pytest.mark.parametrize(("rate", "found"), [(2e4, 2e4), ("20kHz", 2e4), ("2e4", 2e4)])
def test_a_sampling_rate_may_have_a_unit(rate, found):
    assert Request(sample_rate=rate).points_of(WORDS)["sample_rate"] == found
    with pytest.raises(InputError, match="sample_rate = '1,2kHz': it must be one value"):
        Request(sample_rate="1,2kHz").points_of(WORDS)


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_a_table_is_in_the_studys_units(tmp_path, newline, mark):
    lines = ["p1_length [mm], mu,theta [rad]", "", '"50", 0.1 ,0.1', "60,2e-1,-0.1"]
    (tmp_path / "rigs.csv").write_bytes(mark + newline.join([*lines, ""]).encode())
    found = request.rows(fig5.STUDY, tmp_path / "rigs.csv")
    assert found == {
        "p1_length": [0.05, 0.06], "mu": [0.1, 0.2], "theta": [5.72957795130823, -5.72957795130823],
    }  # fmt: skip
    columns = {name: np.array(column) for name, column in found.items()}
    assert request.rows(fig5.STUDY, columns) == found
    words = request.rows(WORDS, {"case": ["tangent", "mu = 0"], "V [mm/s]": [1, 2]})
    assert words == {"case": ["tangent", "mu = 0"], "V": [1e-3, 2e-3]}
