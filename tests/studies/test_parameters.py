"""Parameters: what each usual one is, what it can be set to, and which values are warned about."""

import re
from dataclasses import FrozenInstanceError, fields

import numpy as np
import pytest

from fivcore import Beam, Rig
from studies.asking.request import Request, rows
from studies.asking.sweep import sweep_of
from studies.declaring import parameters, spec
from studies.declaring.parameters import FRICTION, RIG, RUN, SCENE, Parameter, unusual
from studies.study import Study
from sweeps import InputError
from tests.helpers.rigs import workshop_rig

ALL, WORDS = RIG | SCENE | FRICTION | RUN, ["alpha", "beta"]
STUDY = Study("own", "Own", "Why?", RUN, {"y": ("1", "y")}, lambda scenes, **run: {})
TYPED = dict(
    V="2mm/s", theta="5deg", mu="20%", F="9N", kinetic_ratio="100%", decay_speed="1cm/s", decay="exponential",
    ramp="1ms", cutoff="auto", skip_long_sticks="1",
    numerical_damping="none", contact_position="80mm", head_mass="2943.4g", d1="50 s-1", d2="10ns",
    p1_length="5cm", p1_width="10mm", p1_thickness="1.5mm", p1_density="7.9g/cm3", p1_young_modulus="185GPa",
    p2_length="15cm", p2_width="15mm", p2_thickness="3mm", p2_density="7900", p2_young_modulus="185e9",
    p1_elements="30", p2_elements="90", point_b="50%",
)  # fmt: skip


def test_the_papers_values_typed_with_their_units_are_the_usual_ones():
    assert set(TYPED) == set(STUDY.parameters) == set(ALL)
    found = {n: ALL[n].read(n, value) for n, value in Request(values=TYPED).values_of(STUDY).items()}
    assert all((v, type(v)) == (ALL[n].default, type(ALL[n].default)) for n, v in found.items())
    assert not unusual(found, ALL)
    assert [n for n in ALL if ALL[n].is_whole] == ["p1_elements", "p2_elements", "skip_long_sticks"]
    other = Request(values={"cutoff": "375kHz", "numerical_damping": "published"}).values_of(STUDY)
    assert [ALL[n].read(n, value) for n, value in other.items()] == [375e3, "published"]
    assert {RUN[name].units for name in ("skip_long_sticks", "numerical_damping")} == {"1"}
    assert [each.default for each in parameters.published(RUN).values()] == [1e-3, None, 1, "published"]
    assert all(each.common for each in (RIG | RUN).values())


def test_a_rigs_parameters_are_the_fields_of_the_rig_and_of_its_beams():
    own = {field.name for field in fields(Rig)} - {"p1", "p2"}
    assert set(RIG) == own | {f"{beam}_{field.name}" for beam in ("p1", "p2") for field in fields(Beam)}
    assert Rig.of(**parameters.rig_numbers(workshop_rig(1))) == workshop_rig(1)
    assert len({each.text for each in ALL.values() if not each.text.endswith(" of ")}) == len(ALL)


def test_a_bare_parameter_is_one_plain_number_and_several_are_an_axis():
    bare, axis, words = Parameter(1.0), Parameter([1, 2]), Parameter(["b", "a"])
    assert (bare.units, bare.text, bare.choices, bare.common, bare.inner) == ("1", "", (), False, False)
    assert [p.is_axis for p in (bare, axis, words, Parameter([1], inner=True))] == [False, True, True, False]
    assert (words.choices, axis.choices, len({axis, words})) == (("b", "a"), (), 2)
    with pytest.raises(FrozenInstanceError):
        bare.units = "mm"


@pytest.mark.parametrize(("default", "value", "found"), [
    (2.0, 3, 3.0), (2.0, [3.0], 3.0), (2.0, [3.0, 1.0, 3.0], [1.0, 3.0]), ([1.0, 2.0], 3, [3.0]),
    (2, 3.0, 3), (2, np.array([4.0, 3.0]), [3, 4]), (2, 10**15 - 1, 10**15 - 1), ([1, 2], 5, [5]),
    (None, None, None), (None, "auto", None), (None, 5, 5.0), (None, [7, 5], [5.0, 7.0]),
    (["beta", "alpha"], "alpha", ["alpha"]), (["c", "b", "a"], ["a", "c", "a"], ["c", "a"]),
])  # fmt: skip
def test_a_value_is_read_as_one_or_as_several_in_order(default, value, found):
    read = np.asarray(Parameter(default).read("x", value))
    assert (read.tolist(), read.dtype) == (found, np.asarray(found).dtype)


@pytest.mark.parametrize(("default", "value", "said", "end"), [
    *((2.0, value, f"{value!r}: it must", "numbers") for value in (None, "auto", "low", [[1.0]], [], True)),
    (None, "low", "'low': it must", "auto"), (2.0, [0.5, float("nan")], "nan: it must", "finite"),
    (2, [3, 1.5], "1.5: it must", "1e15"), (2, 1e15, "1e+15: it must", "1e15"),
    (WORDS, "bta", "'bta': did you mean beta? it must", "beta"), (WORDS, "auto", "'auto': it must", "beta"),
    (WORDS, ["beta", "?"], "'?': it must", "beta"),
])  # fmt: skip
def test_what_is_refused_is_named_with_its_value_and_what_is_allowed(default, value, said, end):
    with pytest.raises(InputError, match=rf"^x = {re.escape(said)}.* {end}$"):
        Parameter(default).read("x", value)


def test_lists_ranges_draws_and_columns_are_speeds_of_the_drive(tmp_path):
    for V in ("1,2mm/s", "2, 1mm/s", "1:2:2mm/s", "log:1mm/s:2mm/s:2", [2e-3, 1e-3], np.array([1e-3, 2e-3])):
        grid = sweep_of(STUDY, Request(values={"V": V}).values_of(STUDY)).grid
        assert grid.axes["V"].values.tolist() == [1e-3, 2e-3]
    drawn = sweep_of(STUDY, Request(values={"V": "uniform:1:2mm/s"}).values_of(STUDY), samples=64).grid.axes["V"]
    np.testing.assert_allclose(np.quantile(drawn.values, [0.0, 0.5, 1.0]), [1e-3, 1.5e-3, 2e-3], atol=2e-5)
    (tmp_path / "speeds.csv").write_text("V [mm/s],p2_elements\n2,45\n1,90\n")
    table = sweep_of(STUDY, {}, rows=rows(STUDY, tmp_path / "speeds.csv")).grid.axes
    assert [table[name].values.tolist() for name in ("V", "p2_elements")] == [[2e-3, 1e-3], [45, 90]]


@pytest.mark.parametrize(("kind", "least", "most", "mistake"), [
    ("V", "0.1µm/s", "0.5m/s", 1.0), ("theta", "0.2deg", "80deg", 0.1), ("mu", "0", "1000%", 20.0),
    ("length", "5mm", "2m", 50.0), ("width", "1mm", "50cm", 10.0), ("thickness", "0.1mm", "10cm", 1.5),
    ("young_modulus", "0.1GPa", "1500GPa", 185.0), ("density", "0.1g/cm3", "25g/cm3", 7.9),
    ("contact_position", "1mm", "2m", 80.0), ("F", "1mN", "10kN", 9e6), ("head_mass", "1g", "1000kg", 2943.4),
    ("d1", "1e-6", "1e4", 5e7), ("d2", "1ps", "0.1ms", 0.01), ("decay_speed", "1µm/s", "1m/s", 10.0),
    ("kinetic_ratio", "0.1", "100%", 50.0),
])  # fmt: skip
def test_a_value_beyond_the_usual_is_reported_with_the_unit_that_mends_it(kind, least, most, mistake):
    for name in [kind] if kind in ALL else [f"p1_{kind}", f"p2_{kind}"]:
        units = ALL[name].units
        low, high = (float(spec.parse(text, name, units)[0]) for text in (least, most))
        assert not any(unusual({name: v}, {name}) for v in (low, high, -high, 0.0, np.array([0.0, high])))
        beyond = [
            np.nextafter(high, np.inf),
            np.array([low, -1.1 * high]),
            [low, 1.1 * high],
            *[0.999 * low] * (low > 0.0),
        ]
        assert all(len(unusual({name: value}, {name})) == 1 for value in beyond)
        (line,) = unusual({name: mistake, "p1_elements": 10**6, "numerical_damping": "none"}, ALL)
        text, _, hint = line.partition("; ")
        assert text.startswith(f"{name} = {mistake:g} {units}".removesuffix(" 1") + " is unusual: ")
        # A parameter of a study of one's own may have the name of a number of a beam.
        assert not unusual({"length": mistake, "density": mistake}, {"length", "density"})
        assert bool(hint) == (kind not in ("mu", "F", "kinetic_ratio", "head_mass", "d1", "d2"))
        if hint:
            assert hint.endswith(" degrees" if kind == "theta" else " without the unit?")
            again = spec.parse(f"{mistake}{hint.split()[0].strip('?')}", name, units)
            assert not unusual({name: again}, {name})


@pytest.mark.parametrize("asked", ["p1_length", "p1_thickness", "p2_length", "p2_thickness"])
def test_a_beam_less_than_eight_times_as_long_as_thick_is_reported(asked):
    length, depth = f"{asked[:2]}_length", f"{asked[:2]}_thickness"
    assert not unusual({length: 0.08, depth: 0.01}, {asked})
    for least, most in ((0.07, 0.01), (np.array([0.07, 0.8]), np.array([1e-3, 0.01]))):
        assert unusual({length: least, depth: most}, {asked})[0].startswith(f"{length} / {depth} = 7 is")
    assert not unusual({length: 1e-3, depth: 0.01}, {"mu"}) + unusual({asked: 0.01}, {asked})


def test_unusual_values_are_warnings_where_the_caller_is_or_errors():
    with pytest.warns(parameters.UnusualWarning) as caught:
        assert parameters.warn_unusual(["one", "two"], strict=False) == "one; two"
    assert [(str(each.message), each.filename) for each in caught] == [("one", __file__), ("two", __file__)]
    assert parameters.warn_unusual([], strict=True) == ""
    with pytest.raises(InputError, match=r"^one; "):
        parameters.warn_unusual(["one", "two"], strict=True)
