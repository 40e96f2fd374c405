"""Rows of results as they are printed: table, CSV and JSON, and the command that does it."""

import io
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from studies import registry
from studies.query import output as writing
from studies.query.query import query, select
from sweeps.storage.netcdf import CHECKSUM, append_checksum
from tests import HOME
from tests.benchmarks import query as benchmark_query
from tests.helpers.commands import FIV
from tests.helpers.trials import pairs, points, sweep
from tests.helpers.waves import interrupted


def test_csv_reads_back_bit_for_bit(data):
    text = io.StringIO(newline="")
    shown = "a,b,size,share,kind,count,error"
    assert writing.write_csv(*select(data, show=shown), text) == 20
    written = text.getvalue()
    assert written.count("\r\n") == 21
    frame = query(data, show=shown)
    read = pd.read_csv(io.StringIO(written, newline=""), dtype=str).fillna({"error": ""})
    pd.testing.assert_frame_equal(read.astype(frame.dtypes), frame, check_exact=True)
    # Single precision has its own digits, and whole numbers no point; what is missing is empty.
    assert "3.0,1.0,3.0,0.33333334,calm,30,\r\n" in written
    assert '3.0,0.1,,,,,"ValueError: no result, ""really"";\nnone"\r\n' in written


def test_json_is_a_list_of_objects(data, monkeypatch):
    # However few are written at a time.
    monkeypatch.setattr(writing, "AT_ONCE", 3)
    text = io.StringIO()
    chosen = select(data, "a >= 3 and b >= 0.1", show="a,b,share,kind,count")
    assert writing.write_json(*chosen, text) == 4
    found = json.loads(text.getvalue(), parse_constant=pytest.fail)
    share = float(str(np.float32(1.0 / 3.0)))
    assert found[0] == {"a": 3.0, "b": 0.1, "share": None, "kind": None, "count": None}
    assert found[1] == {"a": 3.0, "b": 1.0, "share": share, "kind": "calm", "count": 30}
    assert len(found) == 4
    text = io.StringIO()
    chosen = select(data, "a > 9")
    assert writing.write_json(*chosen, text) == 0
    assert json.loads(text.getvalue()) == []


def test_a_table_is_aligned_below_names_and_units(data):
    text = io.StringIO()
    chosen = select(data, "a >= 3 and b >= 0.1", show="a,a_name,size,kind,count,error")
    assert writing.write_table(*chosen, text) == 4
    assert text.getvalue().splitlines() == [
        "a  a_name     size  kind            count  error",
        "m                m",
        '3  three         -  -                   -  ValueError: no result, "really"; none',
        "3  three         3  calm               30",
        "4  four    1.26491  steady sliding     40",
        "4  four          4  steady sliding     40",
    ]


def test_texts_of_a_file_do_not_reach_the_terminal_as_they_are():
    assert writing._cell("a\x1b[31mred\nb\tc\x00") == r"a\x1b[31mred b c\x00"
    assert writing._cell("μ and θ") == "μ and θ"
    assert writing._cell("x" * 100) == "x" * 57 + "..."


@pytest.mark.parametrize(("width", "count"), [(1, 1), (8, 2), (15, 2), (16, 3), (1000, 8)])
def test_a_narrow_terminal_gets_the_columns_that_fit(data, width, count):
    # a, b, a_name and size take 1 + 5 + 6 + 9 letters, with gaps of two.
    text, notes = io.StringIO(), []
    writing.write_table(*select(data), text, width, notes.append)
    lines = text.getvalue().splitlines()
    assert len(lines[0].split()) == count
    assert count == 1 or max(map(len, lines)) <= width
    assert len(notes) == (count < 8)


# --- the command


def test_every_format_of_the_command(file, here):
    ask = ("query", str(file), "--where", "a == 4 and b > 0.05", "--show", "b,size", "--sort", "-b")
    assert here(*ask).stdout == "  b     size\n  s        m\n  1        4\n0.1  1.26491\n"
    assert here(*ask, "--format", "csv").stdout.splitlines() == ["b,size", "1.0,4.0", "0.1,1.2649110640673518"]
    assert json.loads(here(*ask, "--format", "json").stdout) == [
        {"b": 1.0, "size": 4.0},
        {"b": 0.1, "size": 1.2649110640673518},
    ]
    done = here(*ask, "--limit", "1", "--format", "csv")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == ["b,size", "1.0,4.0"]


def test_heads_carry_units(file, here):
    ask = ("query", str(file), "--where", "a == 4 and b > 0.05", "--show", "b,size,kind,b+b", "--units")
    table = here(*ask).stdout.splitlines()
    assert table[0] == "b [s]  size [m]  kind            b+b"
    assert table[1].split() == ["0.1", "1.26491", "steady", "sliding", "0.2"]
    assert here(*ask, "--format", "csv").stdout.splitlines() == [
        "b [s],size [m],kind,b+b",
        "0.1,1.2649110640673518,steady sliding,0.2",
        "1.0,4.0,steady sliding,2.0",
    ]
    first = {"b": 0.1, "size": 1.2649110640673518, "kind": "steady sliding", "b+b": 0.2}
    assert json.loads(here(*ask, "--limit", "1", "--format", "json").stdout) == {
        "units": {"b": "s", "size": "m"},
        "rows": [first],
    }
    empty = here("query", str(file), "--where", "a > 9", "--units", "--show", "a", "--format", "json")
    assert json.loads(empty.stdout) == {"units": {"a": "m"}, "rows": []}


def test_groups_of_the_command(file, here):
    ask = ("query", str(file), "--by", "kind", "--show", "count,mean:size,max:count", "--sort", "-count")
    assert here(*ask, "--where", "kind in ('calm', 'wild')").stdout.splitlines() == [
        "kind  count  mean:size  max:count",
        "                     m",
        "calm      7   0.484981         30",
        "wild      4   0.723925         20",
    ]
    rows = here(*ask, "--limit", "1", "--format", "csv", "--units").stdout.splitlines()
    assert rows[0] == "kind,count,mean:size [m],max:count"
    assert rows[1].startswith("steady sliding,8,0.904")
    assert here("query", str(file), "--by", "kind", "--where", "a > 9").stdout == "kind  count\n"


def test_settings_have_the_units_that_their_study_declares(here):
    done = here("query", f"{HOME}/results/reference/fig5/fig5.nc", "--show", "theta,d1,p1_length,head_mass,fmax")
    assert done.stdout.splitlines()[0].split() == ["theta", "d1", "p1_length", "head_mass", "fmax"]
    assert done.stdout.splitlines()[1].split() == ["degree", "s-1", "m", "kg"]
    assert done.stdout.splitlines()[2].split() == ["5", "50", "0.05", "2.9434", "10000"]


def test_an_empty_result_is_its_header(file, here):
    for form, header in (("table", "a  b\nm  s\n"), ("csv", "a,b\r\n"), ("json", "[]\n")):
        done = here("query", str(file), "--where", "a > 9", "--show", "a,b", "--format", form)
        assert (done.returncode, done.stdout, done.stderr) == (0, header, "fiv: no row\n")
    quiet = here("query", str(file), "--where", "a > 9", "--show", "a,b", "-q")
    assert (quiet.returncode, quiet.stderr) == (0, "")
    far = here("query", str(file), "--where", "a == 2.5 and b < 1", "--show", "a")
    assert far.stderr == "fiv: a == 2.5: a has no such value; the nearest is 2\nfiv: no row\n"
    assert far.stdout == "a\nm\n"


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (("--where", "sise > 1"), "where = 'sise': no such column; did you mean size?"),
        (("--show", "sise"), "show = 'sise': no such column; did you mean size?"),
        (("--limit", "-1"), "Invalid value for '--limit': -1 is not in the range x>=0."),
        (("--format", "xml"), "'xml' is not one of 'table', 'csv', 'json'."),
    ],
)
def test_what_is_wrong_is_one_line_and_exit_2(file, here, given, told):
    done = here("query", str(file), *given)
    assert (done.returncode, done.stdout) == (2, "")
    assert told in done.stderr
    assert done.stderr.count("\n") == 1


def test_targets_that_are_not_there(here, tmp_path):
    for target, told in (
        ("fig5", "fig5.nc: there is no such file; make it with: fiv run fig5"),
        ("fig55", "did you mean fig5?"),
        ("no.nc", "no.nc: there is no such file"),
    ):
        done = here("query", target)
        assert (done.returncode, done.stdout) == (2, "")
        assert told in done.stderr
        assert done.stderr.count("\n") == 1
    xr.Dataset({"x": ("n", [1.0])}).to_netcdf(tmp_path / "other.nc")
    assert "it is not the result of a sweep" in here("query", "other.nc").stderr


def test_out_and_the_environment_say_where_a_study_is(here, tmp_path, monkeypatch):
    assert here("run", "table4", "--out", "there", "-q").returncode == 0
    asked = ("query", "table4", "--show", "mode,frequency_paper", "--limit", "1")
    shown = ["mode  frequency_paper", "                   Hz", "   1               16"]
    assert here(*asked, "--out", "there").stdout.splitlines() == shown
    assert here(*asked).returncode == 2


@pytest.mark.usefixtures("small_pieces")
def test_a_result_that_is_half_done(tmp_path, here):
    path = tmp_path / "half.nc"
    interrupted(sweep().plan(path), 8)
    assert not path.exists()
    done = here("query", str(path), "--show", "a,b,size,status", "--format", "csv")
    found = pd.read_csv(io.StringIO(done.stdout))
    assert (done.returncode, done.stderr) == (0, "")
    assert pairs(found) == points(lambda a, b: True)
    pending = found["status"] == "pending"
    assert 0 < pending.sum() <= 12
    assert np.array_equal(found["size"].isna(), found["status"] != "done")
    some = here("query", str(path), "--where", "status == 'pending'", "--show", "a,b", "--format", "csv")
    assert pairs(pd.read_csv(io.StringIO(some.stdout))) == pairs(found[pending])


@pytest.mark.usefixtures("small_pieces")
def test_what_is_half_done_has_words_for_its_codes(tmp_path, here):
    given = {"V": [1e-3, 2e-3, 4e-3, 8e-3], "theta": 5.0, "mu": [0.1, 0.2], "F": 9.0, "duration": 2e-3}
    path = tmp_path / "scenes.nc"
    planned = registry.load("scenes").sweep(given, record=("state",), sample_rate=1e4).plan(path)
    interrupted(planned, 1)
    asked = ("query", str(path), "--where", "regime == 'undecided'", "--show", "V,mu,regime", "--format", "csv")
    done = here(*asked)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert 1 < len(lines) < 9
    assert all(line.endswith(",undecided") for line in lines[1:])
    states = here("query", str(path), "--where", "state == 'stick'", "--show", "V,state", "--limit", "2")
    assert states.stdout.split()[-1] == "stick"


def test_a_damaged_file_is_one_line(tmp_path, here, monkeypatch):
    """By the file's checksum, and in a file without one by HDF5's."""
    monkeypatch.setattr("sweeps.storage.existing.READ_AT_ONCE", 100)
    whole = Path(f"{HOME}/results/reference/stability/stability.nc").read_bytes().rpartition(CHECKSUM)[0]
    path = tmp_path / "damaged.nc"
    for checked, message in ((False, r"\w+: it cannot be read, the file is damaged"), (True, ".*: its checksum ")):
        path.write_bytes(whole)
        if checked:
            append_checksum(path)
        with open(path, "r+b") as file:
            # In a variable, behind the header.
            file.seek(60_000)
            file.write(b"\xff" * 20_000)
        done = here("query", "damaged.nc", "--show", "growth_rate,frequency,unstable_modes,wall_time")
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert re.match(f"fiv: {message}", done.stderr)


def test_a_refined_map(here):
    asked = ("--x", "theta=-10:20:5", "--y", "mu=0:0.5:5", "--quantity", "growth_rate", "--refine", "2")
    assert here("map", *asked, "-q").returncode == 0
    file = "results/map/growth_rate-theta-mu.nc"
    every = pd.read_csv(io.StringIO(here("query", file, "--format", "csv").stdout))
    assert list(every) == ["theta", "mu", "growth_rate", "status"]
    assert len(every) == 289
    assert set(every["status"]) == {"done", "interpolated"}
    done = here("query", file, "--where", "status == 'interpolated' and growth_rate > 0", "--format", "csv")
    expected = every[(every["status"] == "interpolated") & (every["growth_rate"] > 0)]
    assert len(expected) > 0
    pd.testing.assert_frame_equal(pd.read_csv(io.StringIO(done.stdout)), expected.reset_index(drop=True))


def test_a_closed_pipe_ends_quietly():
    file = f"{HOME}/results/reference/stability/stability.nc"
    running = subprocess.Popen(
        [FIV, "query", file], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1
    )
    assert running.stdout.readline()
    running.stdout.close()
    assert running.communicate(timeout=60)[1] == ""
    assert running.returncode == 0


def test_a_terminal_is_told_what_is_left_out(here, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    done = here("query", f"{HOME}/results/reference/regimes/regimes.nc", "--limit", "1")
    assert done.stdout.splitlines()[0].split()[:4] == ["V", "mu", "theta", "F"]
    assert max(map(len, done.stdout.splitlines())) <= 60
    left = re.fullmatch(r"fiv: too wide for this terminal and left out: (.*); choose with --show\n", done.stderr)
    assert left[1].split(", ")[-1] == "status"


def test_the_command_does_not_import_what_it_does_not_need(tmp_path):
    file = f"{HOME}/results/reference/regimes/regimes.nc"
    # xarray imports pint where there is one, and that the top of SciPy.
    program = (
        "import sys\nfrom studies.cli.main import main\n"
        f"sys.argv = ['fiv', 'query', {file!r}, '--where', 'V*mu > 0', '--by', 'mu', '--sort', '-count', '-q']\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "heavy = {'matplotlib', 'numba', 'scipy.linalg', 'fivcore', 'distributed'} & set(sys.modules)\n"
        "print(sorted(heavy), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path)
    assert done.stderr.strip() == "[]"


@pytest.mark.slow
def test_a_million_points_take_two_seconds_and_a_gigabyte(tmp_path):
    benchmark_query.make(tmp_path / "large.nc", 1_000_000)
    for asked in list(benchmark_query.QUERIES.values())[:4]:
        # The machine may do something else besides: the best of three.
        found = [benchmark_query.measured(tmp_path / "large.nc", *asked) for _ in range(3)]
        assert min(taken for taken, _, _ in found) <= benchmark_query.MOST_SECONDS
        assert max(most for _, most, _ in found) <= benchmark_query.MOST_BYTES
    _, most, rows = benchmark_query.measured(tmp_path / "large.nc")
    assert rows == 1_000_000
    assert most <= benchmark_query.MOST_BYTES
