"""Files that are damaged, or something else: one line with the file and the cause, whatever is asked of them."""

import os
import random
import re
import shutil
import signal
from pathlib import Path

import netCDF4
import numpy as np
import pytest

from studies import registry, runner
from sweeps.storage.checked import SEAL
from sweeps.storage.packed import Packed, pack
from tests.helpers.tiny import STUDY
from tests.helpers.waves import interrupted

FILE = Path("results/tiny/tiny.nc")
COMMANDS = (
    ("status", "tiny"),
    ("status", "tiny", "--json"),
    ("status", "tiny", "--toml"),
    ("query", "tiny"),
    ("query", "tiny", "--where", "word == 'wild'", "--show", "x,row,gain,status,error"),
    ("plan", "tiny"),
    ("plan", "tiny", "--set", "x=1:9:9"),
    ("plan", str(FILE), "--fresh"),
    ("plot", "tiny"),
)
OF_PARTS = [(*command, "--out", "half") for command in COMMANDS if command[1] == "tiny"]
# Bits that are changed of a result; of each file of a run a tenth.
FLIPS = 60


@pytest.fixture
def kept(here, tmp_path, monkeypatch):
    """Run commands; there is a finished result, and in `half` one that was interrupted, with four points kept."""
    monkeypatch.setattr(registry, "_registered", {"tiny": STUDY})
    monkeypatch.setattr("sweeps.plan.batches.BATCH_BYTES", 1.0)
    assert here("run", "tiny", "-q").returncode == 1
    interrupted(runner.plan(STUDY, {}, tmp_path / "half"), 4)
    return here


def check(done, *names):
    """An answer, or one line that names what it is about, with an exit code that says whose fault it is."""
    told = done.stderr.strip()
    assert done.returncode in (0, 1, 2, 3), told
    assert "Traceback" not in told
    if done.returncode:
        line, *more = [line for line in told.splitlines() if "compiling once" not in line]
        assert (line.startswith("fiv: ") and not more) or done.returncode == 1
        assert any(name in line for name in names), line


def flipped(whole, count, seed):
    """The content of a file with one bit changed, again and again."""
    drawn = random.Random(seed)  # noqa: S311 - nobody is to be surprised
    for _ in range(count):
        content, place = bytearray(whole), drawn.randrange(8 * len(whole))
        content[place // 8] ^= 1 << place % 8
        yield place, bytes(content)


def test_a_bit_of_a_result_changes_nothing_unseen(kept):
    whole = FILE.read_bytes()
    for n, (place, content) in enumerate(flipped(whole, FLIPS, "unseen")):
        FILE.write_bytes(content)
        for command in COMMANDS[n % 9 :: 9]:
            print(place, *command)
            done = kept(*command)
            assert done.returncode in (2, 3)
            check(done, "tiny.nc")
            assert "damaged" in done.stderr


def test_a_bit_of_a_result_without_a_seal(kept):
    """An older one, or one that something else has changed."""
    whole, seen = FILE.read_bytes().rpartition(SEAL)[0], set()
    for n, (place, content) in enumerate(flipped(whole, FLIPS // 2, "result")):
        FILE.write_bytes(content)
        # All commands take turns.
        for command in COMMANDS[n % 3 :: 3]:
            print(place, *command)
            done = kept(*command)
            seen.add(done.returncode)
            # A value that the file gives may be refused by its own name.
            check(done, "tiny.nc", "kind = ", "gain = ", "STUDY = ")
    assert {0, 2, 3} <= seen


def test_a_bit_of_what_a_run_has_left(kept, tmp_path):
    parts = tmp_path / "half" / "tiny" / "tiny.parts"
    for path in sorted(parts.iterdir()):
        whole = path.read_bytes()
        for n, (place, content) in enumerate(flipped(whole, FLIPS // 10, path.name)):
            path.write_bytes(content)
            for command in OF_PARTS[n % 3 :: 3]:
                print(path.name, place, *command)
                check(kept(*command), "tiny.nc", "tiny.parts")
        path.write_bytes(whole)


TEXTS = ("", "[]", "3", "{}", '{"axes": 3}', '{"constants": [], "axes": {}}', "[" * 100_000)
TEXTS += ('{"name": "tiny", "axes": [], "constants": {"gain": 2.0}}',)
TEXTS += ('{"name": "tiny", "axes": {}, "constants": {"gain": 2.0}, "request": {"settings": 3}}',)


def test_what_a_result_says_of_itself_is_of_another_shape(kept):
    whole = FILE.read_bytes()
    with netCDF4.Dataset(FILE) as file:
        attributes, variables = file.ncattrs(), list(file.variables)
    shapes = (*TEXTS, np.arange(4.0))
    changes = [lambda file, n=name, t=text: file.setncattr(n, t) for name in attributes for text in shapes]
    changes += [lambda file, n=name: file.delncattr(n) for name in attributes]
    changes += [lambda file, n=name: file.renameVariable(n, "else") for name in variables]
    changes += [lambda file, n=name: file[n].setncattr("flag_values", np.int8([1])) for name in variables]
    changes += [lambda file, n=name: file[n].setncattr("units", 3.0) for name in variables]
    changes += [lambda file, n=name: file.renameDimension(n, "else") for name in ("x", "kind", "power")]
    for number, change in enumerate(changes):
        FILE.write_bytes(whole)
        with netCDF4.Dataset(FILE, "a") as file:
            change(file)
        for command in COMMANDS[number % 7 :: 7]:
            print(number, *command)
            check(kept(*command), "tiny.nc", "STUDY = ", "show = ", "where = ")


OF_ITS_OWN = {
    "vlen": lambda file: file.createVLType(np.int32, "vlen"),
    "compound": lambda file: file.createCompoundType(np.dtype([("a", "f8"), ("b", "i4")]), "compound"),
    "enum": lambda file: file.createEnumType(np.int8, "enum", {"a": 0}),
    "number": lambda file: np.float64,
    "letters": lambda file: "S1",
    "texts": lambda file: str,
}
OTHERS = [(name, kind, None) for name in ("row", "word", "y") for kind in OF_ITS_OWN if kind != "number"]
OTHERS += [("status", "number", ("x", "kind", "long")), ("reproduce", "number", ())]
OTHERS += [("error", "number", ("long", "long")), ("error", "number", ("long", "kind", "x"))]
OTHERS += [("reproduce", "letters", ("kind", "failure", "long")), ("wall_time", "letters", None)]
OTHERS += [("row", "number", ("x", "kind")), ("y", "number", ("x", "kind", "long")), ("x", "letters", None)]
OTHERS += [
    ("x", "number", ("empty",)),
    ("power", "number", ("long", "power")),
    ("else", "number", ("long", "long")),
]


def test_variables_of_another_type_or_other_dimensions(kept):
    whole = FILE.read_bytes()
    for name, kind, dims in OTHERS:
        FILE.write_bytes(whole)
        with netCDF4.Dataset(FILE, "a") as file:
            file.createDimension("long", 9)
            file.createDimension("empty", None)
            if name in file.variables:
                dims = file[name].dimensions if dims is None else dims
                file.renameVariable(name, f"other_{name}")
            file.createVariable(name, OF_ITS_OWN[kind](file), dims)
        for command in COMMANDS:
            print(name, kind, dims, *command)
            check(kept(*command), "tiny.nc")


def test_a_manifest_of_another_shape(kept, tmp_path):
    path = tmp_path / "half" / "tiny" / "tiny.parts" / "manifest"
    file = Packed(path)
    arrays = file.read(file.names)
    wrong = [(file.about | {key: value}, arrays) for key in file.about for value in (None, [], 7, {"a": {}}, "a")]
    wrong += [({k: v for k, v in file.about.items() if k != key}, arrays) for key in file.about]
    wrong += [(file.about, arrays | {name: each[:1]}) for name, each in arrays.items()]
    wrong += [(file.about, {k: v for k, v in arrays.items() if k != name}) for name in arrays]
    wrong += [(file.about, arrays | {name: np.array(["text"])}) for name in arrays for _ in range(2)]
    for number, (about, others) in enumerate(wrong):
        path.write_bytes(pack(about, others))
        for command in OF_PARTS[number % 2 :: 2]:
            print(number, *command)
            check(kept(*command), "tiny.nc", "tiny.parts")


def test_a_part_of_another_shape(kept, tmp_path):
    """Its points are pending, and computed again."""
    path = min((tmp_path / "half" / "tiny" / "tiny.parts").glob("*.part"))
    file = Packed(path)
    arrays = file.read(file.names)
    wrong = [(file.about | {key: value}, arrays) for key in file.about for value in (None, {"a": {}}, ["a"], 0.5)]
    wrong += [(file.about, arrays | {name: each[:0]}) for name, each in arrays.items()]
    wrong += [(file.about, arrays | {name: np.array(["text"])}) for name in arrays]
    for number, (about, others) in enumerate(wrong):
        path.write_bytes(pack(about, others))
        for command in OF_PARTS[number % 2 :: 2]:
            print(number, *command)
            check(kept(*command), "tiny.nc", "tiny.parts")
    done = kept("run", "tiny", "-q", "--out", "half")
    assert done.returncode in (1, 3), done.stderr
    check(done, "tiny.parts", "failed: ")


def test_a_configuration_that_is_nested_too_deeply(here, tmp_path):
    (tmp_path / "deep.toml").write_text("axes = " + "[" * 100_000)
    done = here("plan", "fig5", "--config", "deep.toml")
    assert done.returncode == 2
    check(done, "deep.toml")


@pytest.mark.parametrize("option", ["--config", "--points"])
def test_a_text_that_never_ends(here, monkeypatch, option):
    monkeypatch.setattr(registry, "MOST_LETTERS", 1000)
    done = here("plan", "fig5", option, "/dev/zero")
    assert done.returncode == 2
    assert done.stderr == f"fiv: {option} /dev/zero: it has more than 1000 letters\n"


def nested(path):
    path.write_text("[" * 100_000)


def listed(path):
    path.write_text('[{"pid": "one", "todo": []}]')


def shaped(path):
    path.write_text('{"pid": 1, "host": "here", "started": "now", "todo": {}, "now": 3, "left": "long"}')


def linked(path):
    path.symlink_to(path.parent / "nowhere" / "at-all")


KINDS = (os.mkfifo, os.mkdir, linked, nested, listed, shaped)


@pytest.fixture
def _hurry():
    """Whoever waits for a pipe waits for ever."""
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.usefixtures("_hurry")
@pytest.mark.parametrize("place", ["tiny.nc", "tiny.parts", "manifest", "progress.json", "part", ".tiny.nc.lock"])
def test_something_else_in_the_place_of_a_file(kept, tmp_path, monkeypatch, place):
    (tmp_path / "half").rename(tmp_path / "whole")
    for kind in KINDS:
        shutil.copytree(tmp_path / "whole", tmp_path / "half")
        folder, parts = tmp_path / "half" / "tiny", tmp_path / "half" / "tiny" / "tiny.parts"
        path = next(parts.glob("*.part")) if place == "part" else (folder if "tiny" in place else parts) / place
        shutil.rmtree(path, ignore_errors=True)
        path.unlink(missing_ok=True)
        kind(path)
        for command in OF_PARTS:
            print(kind, *command)
            check(kept(*command), "tiny.nc", "tiny.parts")
        with monkeypatch.context() as patch:
            patch.setattr("sweeps.watch.status.is_locked", lambda store: True)
            for command in OF_PARTS[:2]:
                check(kept(*command), "tiny.nc", "tiny.parts")
        done = kept("run", "tiny", "-q", "--out", "half")
        # It runs, and one point fails; or the place is refused.
        assert done.returncode in (1, 3)
        check(done, "tiny.nc", "tiny.parts", "failed: ")
        shutil.rmtree(tmp_path / "half")


def test_a_large_result_is_damaged_where_it_is_read(kept, monkeypatch):
    """HDF5 finds it when a value is used."""
    for name in ("netcdf.CHECKED", "netcdf.READ_AT_ONCE", "netcdf.LARGE", "manifest.LARGE"):
        monkeypatch.setattr(f"sweeps.storage.{name}", 100)
    kept("run", "tiny", "-q", "--fresh")
    content, one = bytearray(FILE.read_bytes().rpartition(SEAL)[0]), np.float32([4.0, 16.0]).tobytes()
    content[content.index(one)] ^= 1
    other = FILE.with_name("other.nc")
    other.write_bytes(content)
    other.replace(FILE)
    for command in (("query", "tiny", "--show", "x,row"), ("plot", "tiny"), ("run", "tiny", "-q")):
        done = kept(*command)
        assert done.returncode == 2
        assert re.fullmatch(r"fiv: .*damaged.*: NetCDF: .*\n", done.stderr), done.stderr
        assert "tiny.nc: " in done.stderr


def test_what_a_result_says_of_its_making_is_of_another_type(kept):
    """Environments are numbers, a variable has no points, and a traceback is no text."""
    whole = FILE.read_bytes()
    for change in (numbered, pointless, counted):
        FILE.write_bytes(whole)
        with netCDF4.Dataset(FILE, "a") as file:
            change(file)
        for command in (("plot", "tiny"), ("run", "tiny", "-q", "--set", "x=1:6:6")):
            check(kept(*command), "tiny.nc", "failed: ")


@pytest.mark.filterwarnings("always")
def test_units_that_look_like_a_date(kept):
    with netCDF4.Dataset(FILE, "a") as file:
        file["y"].units = "seconds since 0"
    done = kept("query", "tiny", "--where", "x == 2", "--show", "y")
    assert (done.returncode, done.stderr) == (0, "")


def numbered(file):
    file.environments = '[{"python": 3.11}]'


def pointless(file):
    file.renameVariable("y", "old")
    file.createVariable("y", "f8", ("kind",))


def counted(file):
    file.renameVariable("traceback", "old")
    file.createVariable("traceback", "f4", ("failure", "power"))
