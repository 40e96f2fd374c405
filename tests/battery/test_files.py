"""Every kind of file that is read, damaged and crafted: an answer, or one line that names the file and its cause.

| file | read by |
| --- | --- |
| `STUDY.nc`, with its seal, without it, and large | open_results, status, query, plan, run, plot, report |
| `STUDY.parts/`: manifest, parts | the same; run computes again what is lost |
| `STUDY.parts/progress.json`, while a run has the lock | status, query, plan, run |
| `STUDY.png` | report |
| run.toml, of --config | plan, run |
| points.csv, of --points | plan, run |
| FILE.py, a study of one's own | list, plan |

The program's own files (its Python, catalogue.json, known.json, templates) are no input.
"""

import os
import shutil
from contextlib import contextmanager

import pytest
from filelock import lock_descriptor

from studies import registry, runner
from sweeps.plan import batches
from sweeps.storage import manifest, netcdf
from sweeps.storage.checked import SEAL
from tests.battery.damage import crafted, harmed
from tests.battery.reader import Reader, opened
from tests.helpers.tiny import STUDY
from tests.helpers.waves import interrupted

pytestmark = [pytest.mark.battery, pytest.mark.slow]

FLIPS, CRAFTED = 500, 150
FILE = "results/tiny/tiny.nc"
COMMANDS = [
    ("status", "tiny"),
    ("query", "tiny", "--format", "csv"),
    ("plan", "tiny"),
    ("run", "tiny", "-q"),
    ("status", "tiny", "--json"),
    ("query", "tiny", "--where", "word == 'wild'", "--show", "x,row,gain,status,error"),
    ("plan", "tiny", "--set", "x=1:9:9"),
    ("plot", "tiny"),
    ("status", "tiny", "--toml"),
    ("query", FILE, "--by", "kind", "--show", "count,mean:y,share:word"),
    ("plan", FILE, "--fresh"),
    ("run", "tiny", "-q", "--set", "x=1:6:6"),
    ("report", "tiny"),
]
OF_HALF = [command for command in COMMANDS if FILE not in command]
# Of axes and settings a message may have the name and the value.
OWN = ("tiny.nc", "kind = ", "gain = ", "STUDY = ", "show = ", "where = ", "by = ")


def prepare():
    """A process knows the study, and computes a point at a time."""
    registry._registered, batches.BATCH_BYTES = {"tiny": STUDY}, 1.0


def prepare_large():
    """A process for which every file is a large one."""
    prepare()
    netcdf.CHECKED = netcdf.READ_AT_ONCE = netcdf.LARGE = manifest.LARGE = 100


class Trial:
    """Files in the place of one of a folder, what is asked of them, and what is wrong with the answers."""

    def __init__(self, reader, kept, folder):
        self.reader, self.kept, self.folder = reader, kept, folder
        self.failures = []
        self.good = {}

    @contextmanager
    def place(self, file):
        shutil.copytree(self.kept, self.folder, symlinks=True)
        try:
            yield self.folder / file
        finally:
            shutil.rmtree(self.folder)

    def ask(self, case, command, *names, codes=(0, 1, 2, 3)):
        """Ask, `None` for `open_results`, and note what no damaged file may lead to."""
        how = {"how": opened} if command is None else {}
        done = self.reader.ask(self.folder, *(command or [FILE]), **how)
        told = [line for line in done.err.splitlines() if "compiling once" not in line]
        if done.code not in codes or "Traceback" in done.err:
            self.note(case, command, done, "its end")
        elif done.code > 1 and not (len(told) == 1 and told[0].startswith("fiv: ")):
            self.note(case, command, done, "not one line")
        elif done.code > 1 and not any(name in told[0] for name in names):
            self.note(case, command, done, "no name")
        return done

    def note(self, case, command, done, what):
        print(what, case, command, done.code, done.out[-200:], done.err[-1000:], flush=True)
        self.failures.append((what, case, command, done))

    def expected(self, command):
        """The answer of a whole file."""
        if command not in self.good:
            with self.place(FILE):
                how = {"how": opened} if command is None else {}
                self.good[command] = self.reader.ask(self.folder, *(command or [FILE]), **how)
        return self.good[command]


@pytest.fixture(scope="module", params=[prepare])
def reader(request):
    with_study = Reader(request.param)
    yield with_study
    with_study.end()


@pytest.fixture(scope="module")
def whole(reader, tmp_path_factory):
    """A folder with a result."""
    folder = tmp_path_factory.mktemp("whole")
    assert reader.ask(folder, "run", "tiny", "-q").code == 1
    return folder


@pytest.fixture
def trial(reader, whole, tmp_path):
    return Trial(reader, whole, tmp_path / "case")


def turns(n, commands):
    """Each of many cases is for `open_results` and two of the commands."""
    return [None, *(commands[(2 * n + k) % len(commands)] for k in range(2))]


def cases(rng, whole, count):
    """Other contents of a file, each with its number and what was done."""
    for n in range(count):
        told, content = harmed(rng, whole)
        while content == whole:
            told, content = harmed(rng, whole)
        yield n, f"{n}: {told}", content


def test_a_result_with_its_seal(trial, rng, tried):
    whole = (trial.kept / FILE).read_bytes()
    for n, case, content in cases(rng, whole, FLIPS):
        for command in turns(n, COMMANDS):
            good = trial.expected(command)
            with trial.place(FILE) as path:
                path.write_bytes(content)
                done = trial.ask(case, command, "tiny.nc")
                if done.code in (2, 3) and path.read_bytes() != content:
                    trial.note(case, command, done, "the file has changed")
                if done.code < 2 and (done.code, done.out) != (good.code, good.out):
                    trial.note(case, command, done, "another answer, unseen")
        tried["damaged results"] += 1
    assert trial.failures == []


def test_a_result_without_its_seal(trial, rng, tried):
    whole = (trial.kept / FILE).read_bytes().rpartition(SEAL)[0]
    for n, case, content in cases(rng, whole, FLIPS):
        for command in turns(n, COMMANDS):
            with trial.place(FILE) as path:
                path.write_bytes(content)
                done = trial.ask(case, command, *OWN)
                if done.code in (2, 3) and path.read_bytes() != content:
                    trial.note(case, command, done, "the file has changed")
        tried["damaged results without a seal"] += 1
    assert trial.failures == []


@pytest.mark.parametrize("reader", [prepare_large], indirect=True)
def test_a_large_result(trial, rng, tried):
    whole = (trial.kept / FILE).read_bytes()
    for n, case, content in cases(rng, whole, FLIPS):
        for command in turns(n, COMMANDS):
            good = trial.expected(command)
            with trial.place(FILE) as path:
                path.write_bytes(content)
                done = trial.ask(case, command, *OWN)
                if done.code < 2 and (done.code, done.out) != (good.code, good.out):
                    trial.note(case, command, done, "another answer, unseen")
        tried["damaged results that are large"] += 1
    assert trial.failures == []


def test_crafted_results(trial, rng, tried, tmp_path):
    whole = (trial.kept / FILE).read_bytes()
    for n in range(CRAFTED):
        case = f"{n}: {crafted(rng, tmp_path / f'{n}.nc', whole)}"
        content = (tmp_path / f"{n}.nc").read_bytes()
        for command in [None, *COMMANDS[n % 3::3]]:
            with trial.place(FILE) as path:
                path.write_bytes(content)
                done = trial.ask(case, command, *OWN)
                if done.code in (2, 3) and path.read_bytes() != content:
                    trial.note(case, command, done, "the file has changed")
        tried["crafted results"] += 1
    assert trial.failures == []


HALF = "half/tiny/tiny.parts"
TABLE = ("query", "tiny", "--out", "half", "--format", "csv", "--show", "x,kind,y,word,status,error")


@pytest.fixture(scope="module")
def half(whole):
    """An interrupted run beside the result: four points are kept."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "_registered", {"tiny": STUDY})
        patch.setattr(batches, "BATCH_BYTES", 1.0)
        interrupted(runner.plan(STUDY, {}, whole / "half"), 4)
    return whole / HALF


def lines_of(done):
    return set(done.out.splitlines())


def asked_of_half(trial, case, command):
    """Ask of what a run has left; what it shows is right, and a run makes the rest."""
    done = trial.ask(case, (*command, "--out", "half"), "tiny.nc", "tiny.parts")
    if command[0] == "run" and done.code < 2:
        table = trial.ask(case, TABLE, "tiny.nc", "tiny.parts")
        right = trial.finished if "--set" not in command else {*trial.finished, *trial.sixth}
        if lines_of(table) != right:
            trial.note(case, command, table, "another result")


def ask_table(trial, case):
    table = trial.ask(case, TABLE, "tiny.nc", "tiny.parts")
    shown = {line for line in lines_of(table) if "pending" not in line}
    if not shown <= trial.finished:
        trial.note(case, TABLE, table, "another value, unseen")


@pytest.fixture
def half_trial(trial, half):
    table = [each for each in TABLE if each not in ("--out", "half")]
    trial.finished = lines_of(trial.reader.ask(trial.kept, *table))
    trial.sixth = ["6.0,one,12.0,wild,done,", "6.0,other,12.0,wild,done,"]
    return trial


def test_what_a_run_has_left(half_trial, half, rng, tried):
    trial = half_trial
    files = ["manifest", next(each.name for each in half.glob("*.part"))]
    for name in files:
        whole = (half / name).read_bytes()
        for n, case, content in cases(rng, whole, FLIPS):
            with trial.place(f"{HALF}/{name}") as path:
                path.write_bytes(content)
                ask_table(trial, f"{name} {case}")
                if n % 2:
                    asked_of_half(trial, f"{name} {case}", OF_HALF[n // 2 % len(OF_HALF)])
            tried["damaged parts of a run"] += 1
    assert trial.failures == []


def test_the_progress_of_a_run_that_goes_on(half_trial, half, rng, tried):
    trial = half_trial
    whole = b'{"pid": 7, "host": "here", "started": "2026-01-01", "todo": 9, "done": 1, "failed": 0, "elapsed": 1.5, '
    whole += b'"rate": 2.0, "left": 4.0, "now": ["x = 1"], "stopping": false, "written": 0.5}'
    commands = [command for command in OF_HALF if command[0] in ("status", "run", "plan")]
    with trial.place(f"{HALF}/progress.json") as path, open(trial.folder / "half/tiny/.tiny.nc.lock", "ab") as file:
        assert lock_descriptor(file.fileno(), blocking=False)
        for n, case, content in cases(rng, whole, FLIPS):
            path.write_bytes(content)
            command = commands[n % len(commands)]
            done = trial.ask(case, (*command, "--out", "half"), "tiny.nc", "tiny.parts")
            if command[0] == "run" and done.code != 3:
                trial.note(case, command, done, "it runs beside another")
            tried["damaged tellings of progress"] += 1
    assert trial.failures == []


TOML = """study = "tiny"
[axes]
x = "1:5:5"
kind = ["one", "other"]
[settings]
gain = 2.5
"""
CSV = """x [mm],kind,gain
1000,one,2
2000,other,2.5
"""
PY = """import numpy as np
from studies.study import Setting, Study
from sweeps import Axis, Variable
STUDY = Study(
    name="NAME", title="A", question="B", paper="C",
    axes={"x": Axis(np.arange(3.0), "m", "place")},
    settings={"gain": Setting(2.0, "1", "gain")},
    function=lambda points, gain: {"y": gain * points["x"]},
    variables={"y": Variable("m", "height")},
)
"""


@pytest.mark.parametrize(
    ("name", "text", "option"), [("run.toml", TOML, "--config"), ("points.csv", CSV, "--points")]
)
def test_a_text_of_a_user(trial, rng, tried, name, text, option):
    with trial.place(name) as path:
        for n, case, content in cases(rng, text.encode(), FLIPS):
            path.write_bytes(content)
            done = trial.ask(case, ("plan", "tiny", option, name, "--out", "new"), name, "kind", "gain", "x", codes=(0, 2))
            if path.read_bytes() != content or (trial.folder / "new").exists():
                trial.note(case, name, done, "the file has changed")
            tried["damaged texts of a user"] += 1
    assert trial.failures == []


def test_a_study_of_a_users_own(trial, rng, tried):
    with trial.place("none"):
        for n, case, content in cases(rng, PY.encode(), FLIPS // 2):
            name = f"own_{n}.py"
            (trial.folder / name).write_bytes(content.replace(b"NAME", f"own_{n}".encode()))
            trial.ask(case + str(content), (("list", "plan")[n % 2], name), name, f"own_{n}", codes=(0, 2))
            tried["damaged studies of a user"] += 1
    assert trial.failures == []
