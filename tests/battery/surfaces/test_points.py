"""Tables of points: what their cells are in SI beside decimal arithmetic, and where a bad one stands."""

import csv
import io

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from studies import registry
from studies.scatter.table import table
from sweeps import InputError
from tests.battery.surfaces.examples import surface
from tests.battery.surfaces.numerals import digits15, numerals, units_of

examples = surface("tables of points", times=63)
pytestmark = pytest.mark.battery

# Axes and settings of a study, with their units and what each can be.
STUDY = registry.load("scenes")
COLUMNS = {
    "V": ("m s-1", None, None),
    "theta": ("degree", -90, 90),
    "mu": ("1", 0, None),
    "F": ("N", 0, None),
    "duration": ("s", 0, None),
    "p1_length": ("m", 0, None),
    "p2_thickness": ("m", 0, None),
    "p1_young_modulus": ("Pa", 0, None),
    "p2_density": ("kg m-3", 0, None),
    "head_mass": ("kg", 0, None),
    "point_b": ("1", 0, 1),
}
BLANK, SPACE = st.sampled_from(["", "", " ", "\t"]), st.sampled_from(["", " "])


def within(name, value):
    _, low, high = COLUMNS[name]
    return (
        (low is None or value >= low)
        and (high is None or value <= high)
        and not (name == "theta" and abs(value) >= 90)
    )


@st.composite
def tables(draw):
    """Heads, cells as texts, and the exact values in SI, a list for each row."""
    names = draw(st.lists(st.sampled_from(sorted(COLUMNS)), min_size=1, max_size=5, unique=True))
    units = [draw(st.one_of(st.none(), units_of(COLUMNS[name][0]))) for name in names]
    inside = ["" if unit is None else f"{draw(BLANK)}[{draw(SPACE)}{unit[0]}{draw(SPACE)}]" for unit in units]
    heads = [f"{draw(BLANK)}{name}{unit}{draw(BLANK)}" for name, unit in zip(names, inside, strict=True)]
    rows, values = [], []
    for _ in range(draw(st.integers(1, 6))):
        cells, exact = [], []
        for name, unit in zip(names, units, strict=True):
            factor = 1 if unit is None else unit[1]
            text, value = draw(numerals(-3, 3).filter(lambda one, n=name, f=factor: within(n, one[1] * f)))
            cells.append(f"{draw(BLANK)}{text}{draw(BLANK)}")
            exact.append(value * factor)
        rows.append(cells)
        values.append(exact)
    return heads, names, rows, values


@st.composite
def files(draw, lines):
    """The file of some lines, as one of several programs writes it, and the number of each line in it."""
    newline = draw(st.sampled_from(["\n", "\r\n"]))
    quoting = draw(st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL]))
    text, numbers = io.StringIO(), []
    writer = csv.writer(text, quoting=quoting, lineterminator=newline)
    count = 0
    for line in lines:
        for _ in range(draw(st.integers(0, 1))):
            text.write(draw(st.sampled_from(["", ",,", "  "])) + newline)
            count += 1
        writer.writerow(line)
        count += 1
        numbers.append(count)
    mark = draw(st.sampled_from([b"", b"\xef\xbb\xbf"]))
    return mark + text.getvalue().encode(), numbers


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return tmp_path_factory.mktemp("points") / "points.csv"


def refused(file, content):
    """The message about a file, which must be one line that begins with its name."""
    file.write_bytes(content)
    with pytest.raises(InputError) as caught:
        table(STUDY, file)
    message = str(caught.value)
    assert message.startswith(f"--points {file}: ")
    assert "\n" not in message
    return message.removeprefix(f"--points {file}: ")


@examples(50)
@given(case=tables(), data=st.data())
def test_a_table_is_what_decimal_arithmetic_says(file, case, data):
    heads, names, rows, values = case
    content, numbers = data.draw(files([heads, *rows]))
    file.write_bytes(content)
    found = table(STUDY, file)
    assert list(found.columns) == names
    for k, name in enumerate(names):
        assert found.columns[name].tolist() == [digits15(row[k]) for row in values]
    assert found.places == [f"--points {file}: line {number}" for number in numbers[1:]]


@examples(50)
@given(case=tables(), data=st.data())
def test_a_bad_cell_is_told_with_its_line_and_column(file, case, data):
    heads, names, rows, _ = case
    row, column = data.draw(st.integers(0, len(rows) - 1)), data.draw(st.integers(0, len(names) - 1))
    rows[row][column] = data.draw(
        st.sampled_from(["x", "nan", "-inf", "1e999", "1_0", "2 mm", "1,5", "--1", "٣", "."])
    )
    content, numbers = data.draw(files([heads, *rows]))
    told = refused(file, content)
    assert told.startswith(
        f"line {numbers[row + 1]}, column {names[column]}: {rows[row][column]!r}: it must be a "
    )


@examples(30)
@given(case=tables(), data=st.data())
def test_a_value_that_cannot_be_is_told_with_its_line_and_column(file, case, data):
    heads, names, rows, _ = case
    bad = {"theta": "1e4", "point_b": "-1.5"} | {
        name: "-1" for name in names if name not in ("V", "theta", "point_b")
    }
    able = [k for k, name in enumerate(names) if name in bad]
    if not able:
        return
    row, column = data.draw(st.integers(0, len(rows) - 1)), data.draw(st.sampled_from(able))
    rows[row][column] = bad[names[column]]
    content, numbers = data.draw(files([heads, *rows]))
    place = f"line {numbers[row + 1]}, column {names[column]}: {bad[names[column]]}: it must be "
    assert refused(file, content).startswith(place)


@examples(30)
@given(case=tables(), data=st.data())
@example(case=(["mu"], ["mu"], [["0.1"]], None), data=None)
def test_a_bad_row_or_head_is_told(file, case, data):
    heads, names, rows, _ = case
    damage = (
        "head"
        if data is None
        else data.draw(st.sampled_from(["more", "fewer", "head", "twice", "unit", "no rows"]))
    )
    row = 0 if data is None else data.draw(st.integers(0, len(rows) - 1))
    if damage == "more":
        rows[row].append("1")
    elif damage == "fewer" and len(names) > 1:
        rows[row].pop()
    elif damage == "twice":
        heads.append(heads[0])
        rows = [[*cells, cells[0]] for cells in rows]
    elif damage == "unit":
        heads[0] = f"{names[0]} [furlongz]"
    elif damage == "no rows":
        rows = []
    else:
        damage, heads[0] = "head", "v_0"
    content = "\n".join(",".join(cells) for cells in [heads, *rows]).encode()
    told = refused(file, content)
    expected = {
        "more": f"line {row + 2}: it has {len(names) + 1} cells",
        "fewer": f"line {row + 2}: it has {len(names) - 1} cell",
        "twice": f"line 1: the column {names[0]} stands there twice",
        "unit": f"line 1, column '{names[0]} [furlongz]': [furlongz] is no unit",
        "no rows": "it has no row below its heads",
        "head": "line 1, column 'v_0': study scenes has no axis and no setting of that name",
    }
    assert told.startswith(expected[damage])


@pytest.mark.parametrize("head", ["F\t", "\tF", "F [N]\t"])
def test_a_tab_at_the_end_of_the_only_head_separates_nothing(file, head):
    file.write_text(f"{head}\n9\n")
    assert table(STUDY, file).columns["F"].tolist() == [9.0]
    assert "separated by tabs" in refused(file, b"V\tF\n1\t9\n")
