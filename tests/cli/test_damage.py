"""Files that are damaged, or something else: one line with the file and the cause, whatever the command."""

import os
import random
import re
import shutil
from pathlib import Path

import netCDF4
import numpy as np
import pytest

from studies import registry, runner
from sweeps.storage.netcdf import CHECKSUM
from tests.helpers.processes.sweep_programs import flip
from tests.helpers.tiny import STUDY
from tests.helpers.waves import interrupted

FILE = Path("results/tiny/tiny.nc")
COMMANDS = (
    ("status", "tiny"),
    ("status", "tiny", "--json"),
    ("query", "tiny", "--where", "word == 'wild'", "--show", "x,row,gain,status,error"),
    ("plan", "tiny"),
    ("plan", "tiny", "--set", "x=1:9:9"),
    ("plan", str(FILE), "--fresh"),
    ("plot", "tiny"),
)
OF_PARTS = [(*command, "--out", "half") for command in COMMANDS if command[1] == "tiny"]
RUN = ("run", "tiny", "-q")


@pytest.fixture
def stored(here, tmp_path, monkeypatch):
    """Run commands; there is a finished result, and in `half` a run that was interrupted after four points."""
    monkeypatch.setattr(registry, "_registered", {"tiny": STUDY})
    monkeypatch.setattr("sweeps.plan.batches.BATCH_BYTES", 1.0)
    assert here(*RUN).returncode == 1  # a point fails
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


def flips(path, count):
    """Change one bit of a file, again and again, each time another one."""
    good, drawn = path.read_bytes(), random.Random(path.name)  # noqa: S311 - reproducible
    for number in range(count):
        flip(path, drawn.randrange(8 * len(good)))
        yield number
        path.write_bytes(good)


def test_a_flipped_bit_of_a_result_is_noticed_by_every_command(stored):
    for number in flips(FILE, 40):
        done = stored(*COMMANDS[number % len(COMMANDS)])
        assert done.returncode in (2, 3)
        check(done, "tiny.nc")
        assert "damaged" in done.stderr


def test_a_flipped_bit_of_a_result_without_checksum_gives_an_answer_or_a_line(stored):
    FILE.write_bytes(FILE.read_bytes().rpartition(CHECKSUM)[0])
    for number in flips(FILE, 40):
        # A value in the file may be refused by its own name.
        check(stored(*COMMANDS[number % len(COMMANDS)]), "tiny.nc", "kind = ", "gain = ", "STUDY = ")


def test_a_flipped_bit_of_a_part_or_the_manifest_gives_an_answer_or_a_line(stored, tmp_path):
    for path in sorted((tmp_path / "half" / "tiny" / "tiny.nc.parts").iterdir()):
        for number in flips(path, 6):
            check(stored(*OF_PARTS[number % len(OF_PARTS)]), "tiny.nc")
    done = stored(*RUN, "--out", "half")
    assert (done.returncode, stored("status", "tiny", "--out", "half").returncode) == (1, 0)


CHANGES = {
    "no configuration": lambda file: file.delncattr("configuration"),
    "another configuration": lambda file: file.setncattr("configuration", '{"name": "tiny", "axes": 3}'),
    "no environments": lambda file: file.delncattr("environments"),
    "no status": lambda file: file.renameVariable("status", "else"),
    "no axis": lambda file: file.renameVariable("x", "else"),
    "no variable": lambda file: file.renameVariable("y", "else"),
    "units that are no text": lambda file: file["y"].setncattr("units", 3.0),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_file_that_another_program_has_changed_gives_an_answer_or_a_line(stored, change):
    with netCDF4.Dataset(FILE, "a") as file:
        CHANGES[change](file)
    for command in COMMANDS:
        check(stored(*command), "tiny.nc", "STUDY = ", "show = ", "where = ")


@pytest.mark.filterwarnings("always")
def test_units_that_look_like_a_date(stored):
    with netCDF4.Dataset(FILE, "a") as file:
        file["y"].units = "seconds since 0"
    done = stored("query", "tiny", "--where", "x == 2", "--show", "y")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "place", ["tiny.nc", "tiny.nc.parts", "manifest", "progress.json", "part", ".tiny.nc.lock"]
)
@pytest.mark.parametrize("kind", [os.mkfifo, os.mkdir, lambda path: path.write_text("[" * 100_000)])
def test_a_pipe_a_folder_or_a_text_in_the_place_of_a_file(stored, tmp_path, place, kind):
    folder = tmp_path / "half" / "tiny"
    parts = folder / "tiny.nc.parts"
    path = next(parts.glob("*.part")) if place == "part" else (folder if "tiny" in place else parts) / place
    shutil.rmtree(path, ignore_errors=True)
    path.unlink(missing_ok=True)
    kind(path)
    for command in OF_PARTS:
        check(stored(*command), "tiny.nc")
    done = stored(*RUN, "--out", "half")
    assert done.returncode in (1, 3)  # it runs, and a point fails; or the place is refused
    check(done, "tiny.nc", "failed: ")


def test_a_large_result_is_damaged_where_it_is_read(stored, monkeypatch):
    for name in ("netcdf.CHECKED", "existing.CHECKED", "existing.READ_AT_ONCE", "netcdf.LARGE", "assemble.LARGE"):
        monkeypatch.setattr(f"sweeps.storage.{name}", 100)
    stored(*RUN, "--fresh")
    shutil.copy(FILE, other := FILE.with_name("other.nc"))  # netCDF may keep what it has read of the old one
    flip(other, 8 * other.read_bytes().index(np.float32([4.0, 16.0]).tobytes()))
    other.replace(FILE)
    for command in (("query", "tiny", "--show", "x,row"), ("plot", "tiny"), RUN):
        done = stored(*command)
        assert done.returncode == 2
        assert re.fullmatch(r"fiv: .*NetCDF: .*\n", done.stderr), done.stderr
        check(done, "tiny.nc")
        assert "damaged" in done.stderr
