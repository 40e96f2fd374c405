"""Every kind of file that a command reads, damaged: an answer, or one line that names the file and the cause."""

import random
from pathlib import Path

import pytest

from studies import registry, runner
from studies.request import Request
from sweeps.storage.netcdf import CHECKSUM
from tests.helpers.processes.sweep_programs import flip
from tests.helpers.tiny import STUDY
from tests.helpers.waves import interrupted

FILE = Path("results/tiny/tiny.nc")
COMMANDS = (
    ("status", "tiny"),
    ("query", "tiny", "--where", "word == 'wild'", "--show", "x,row,gain,status,error"),
    ("plan", "tiny"),
    ("plan", "tiny", "--set", "x=1:9:9"),
    ("plot", "tiny"),
)
OTHER = {"none": None, "empty": b"", "text": b"not netCDF", "folder": "folder", "foreign": b"CDF\x01" + bytes(28)}


@pytest.fixture
def fiv(here, tmp_path, monkeypatch):
    """Run commands; there is a finished result, and in `half` a run that was interrupted after four points."""
    monkeypatch.setattr(registry, "_registered", {"tiny": STUDY})
    monkeypatch.setattr("sweeps.plan.batches.BATCH_BYTES", 1.0)
    assert here("run", "tiny", "-q").returncode == 1  # a point fails
    interrupted(runner.plan(STUDY, Request(), tmp_path / "half"), 4)
    return here


def check(done, *names):
    """An answer, or one line with one of the names, and an exit code of wrong input or of the store."""
    lines = [line for line in done.stderr.splitlines() if "compil" not in line]
    assert done.returncode in (0, 1, 2, 3), done.stderr
    assert "Traceback" not in done.stderr
    if done.returncode > 1:
        assert len(lines) == 1, done.stderr
        assert lines[0].startswith("fiv: ")
        assert any(name in lines[0] for name in names), lines[0]


def flips(path, count):
    """Change one bit of a file, each time another one."""
    good, drawn = path.read_bytes(), random.Random(path.name)  # noqa: S311 - reproducible
    for number in range(count):
        flip(path, drawn.randrange(8 * len(good)))
        yield number
        path.write_bytes(good)


def test_a_flipped_bit_of_a_result_is_noticed_by_every_command(fiv):
    for number in flips(FILE, 20):
        done = fiv(*COMMANDS[number % len(COMMANDS)])
        assert done.returncode in (2, 3)
        check(done, "tiny.nc")
        assert "damaged" in done.stderr


def test_without_its_checksum_there_is_an_answer_or_a_line(fiv):
    FILE.write_bytes(FILE.read_bytes().rpartition(CHECKSUM)[0])
    for number in flips(FILE, 20):
        # A value in the file may be refused by its own name.
        check(fiv(*COMMANDS[number % len(COMMANDS)]), "tiny.nc", "kind = ", "gain = ", "STUDY = ")


def test_damage_of_an_unfinished_run_costs_what_is_damaged(fiv, tmp_path):
    for path in sorted((tmp_path / "half" / "tiny" / "tiny.nc.parts").iterdir()):
        for number in flips(path, 3):
            check(fiv(*COMMANDS[number % 3], "--out", "half"), "tiny.nc", "damaged")
    assert fiv("run", "tiny", "-q", "--out", "half").returncode == 1
    shown = ("query", "tiny", "--show", "x,kind,y,status", "--format", "csv")
    assert fiv(*shown, "--out", "half").stdout == fiv(*shown).stdout


@pytest.mark.parametrize("kind", OTHER)
def test_what_is_no_result_is_refused_and_kept(fiv, kind):
    content = OTHER[kind]
    FILE.unlink()
    if content == "folder":
        FILE.mkdir()
    elif content is not None:
        FILE.write_bytes(content)
    for command in COMMANDS:
        done = fiv(*command)
        assert done.returncode in (0, 2, 3)
        check(done, "tiny")
    assert not isinstance(content, bytes) or FILE.read_bytes() == content
