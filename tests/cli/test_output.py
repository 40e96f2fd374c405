"""Texts of files, of other processes and of errors reach no terminal as they are, whichever command tells them."""

import ast
import io
import json
import re
import subprocess
import sys
import threading
import warnings
from dataclasses import replace
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import studies
from studies import registry
from studies.check import installation
from studies.cli import output, progress
from studies.study import Setting, Study
from sweeps import Axis, Snapshot, Store, Variable
from sweeps.storage.store import write_state

# Sets a window's title, clears the screen, turns the direction round, and overwrites the line.
HOSTILE = "\x1b]0;owned\x07\x1b[2J\u202eowned\r\x9b1m\x7f"
SHOWN = r"\x1b]0;owned\x07\x1b[2J\u202eowned\x0d\u009b1m\u007f"
FILE = Path("results/hostile/hostile.nc")
# A file's own lock, as another machine holds it.
HELD = {"pid": 1, "host": HOSTILE, "started": HOSTILE, "todo": 2, "done": 1, "failed": 0, "elapsed": 1.0}


def fails(points, gain):
    """One of two points fails."""
    if np.any(points["x"] == 2.0):
        raise ValueError(HOSTILE)
    return {"y": gain * points["x"]}


def draw(data):
    from matplotlib.figure import Figure

    return Figure(figsize=(1.0, 1.0))


def findings(data):
    warnings.warn(HOSTILE, stacklevel=1)
    return [HOSTILE]


STUDY = Study(
    name="hostile",
    title=HOSTILE,
    question=HOSTILE,
    paper=HOSTILE,
    axes={"x": Axis([1.0, 2.0], "m", HOSTILE), "kind": Axis(["one", HOSTILE], long_name=HOSTILE)},
    settings={"gain": Setting(2.0, "1", HOSTILE)},
    function=fails,
    variables={"y": Variable(HOSTILE, HOSTILE)},
    draw=draw,
    findings=findings,
)


@pytest.fixture
def kept(here, monkeypatch):
    """Run commands on the study's result, in which other texts are hostile too; each says something of them."""
    monkeypatch.setattr(registry, "_registered", {"hostile": STUDY})
    monkeypatch.setattr("sweeps.plan.batches.BATCH_BYTES", 1.0)
    monkeypatch.setattr(progress, "INTERVAL", 0.0)
    ran = here("run", "hostile", "-v")
    assert ran.returncode == 1
    check(ran, 6)
    with netCDF4.Dataset(FILE, "a") as file:
        for name in ("title", "history", "sweep_version"):
            file.setncattr(name, HOSTILE)
        file["y"].units = file["y"].long_name = file["x"].units = HOSTILE
    return here


def check(done, count=1):
    """What was said tells of the text, cut or quoted, so often at least; nothing of it is obeyed."""
    said = done.stdout + done.stderr
    assert not output.OBEYED.search(said), said
    assert len(re.findall(r"\\x1b\]0;owned", said)) >= count, said


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("list", "hostile"), 0),
        (("plan", "hostile", "--set", f"kind={HOSTILE}", "--out", HOSTILE), 0),
        (("run", "hostile", "--retry-failed"), 1),
        (("query", "hostile"), 0),
        (("query", "hostile", "--show", "x,y,error", "--units"), 0),
        (("status", HOSTILE), 2),
        (("status", "hostile", "--out", HOSTILE), 2),
        (("plot", "hostile", "--out", HOSTILE), 2),
        (("plot", str(FILE), "--out", HOSTILE), 0),
        (("report", "hostile", "--file", f"{HOSTILE}.html"), 0),
        (("query", "hostile", "--where", f"x == {HOSTILE}"), 2),
        (("run", "hostile", "--set", f"{HOSTILE}=1"), 2),
        (("run", "hostile", f"--{HOSTILE}"), 2),
        ((HOSTILE,), 2),
        (("list", f"{HOSTILE}.py"), 2),
        (("map", "--x", f"{HOSTILE}=0:1:2", "--quantity", "growth_rate"), 2),
        (("plan", "hostile", "--config", "hostile.toml"), 2),
        (("plan", "hostile", "--points", "hostile.csv"), 2),
        (("plan", "raising.py"), 2),
        (("completion", HOSTILE), 2),
        (("check", HOSTILE), 2),
    ],
)
def test_no_command_prints_what_a_terminal_obeys(kept, arguments, code):
    Path("hostile.toml").write_text(f"{json.dumps(HOSTILE)} = 1\n")
    Path("hostile.csv").write_text(f'"{HOSTILE}"\n1\n', newline="")
    Path("raising.py").write_text(f"raise ValueError({HOSTILE!r})\n")
    done = kept(*arguments)
    assert done.returncode == code, done.stderr
    check(done)


def test_no_text_of_a_file_turns_others_round_in_the_page(kept):
    """Neither as it stands there, nor where the page's own script puts it."""
    assert kept("report", "hostile", "--file", "page.html").returncode == 0
    page = Path("page.html").read_text()
    assert not output.OBEYED.search(page)
    assert len(re.findall(r"\\x1b\]0;owned", page)) >= 5
    [data] = re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', page)
    assert not re.search(r"(?<!\\)\\u(001b|202e)", data)
    assert r"\\x1b]0;owned" in data


@pytest.mark.parametrize("form", ["csv", "json"])
def test_data_are_as_they_are_but_on_a_terminal(kept, monkeypatch, form):
    command = ("query", "hostile", "--show", "kind,error", "--format", form)
    piped = kept(*command)
    assert (HOSTILE in piped.stdout) == (form == "csv")
    if form == "json":
        assert HOSTILE in {row["kind"] for row in json.loads(piped.stdout)}
    monkeypatch.setattr(type(sys.stdout), "isatty", lambda self: True)
    shown = kept(*command)
    assert not output.OBEYED.search(shown.stdout)
    assert "owned" in shown.stdout


@pytest.mark.parametrize(("verb", "code"), [("status", 0), ("run", 3)])
def test_who_holds_the_lock_is_told(kept, verb, code):
    store = Store(FILE)
    with store.locked():
        write_state(store.progress, HELD | {"rate": 1.0, "left": 1.0, "now": [HOSTILE], "stopping": False})
        done = kept(verb, "hostile")
    assert done.returncode == code
    check(done)


def test_a_fault_of_ours_is_told_with_a_harmless_traceback(kept, monkeypatch):
    def raises(data):
        raise RuntimeError(HOSTILE)

    monkeypatch.setattr(registry, "_registered", {"hostile": replace(STUDY, draw=raises)})
    done = kept("plot", "hostile")
    assert done.returncode == 70
    assert "Traceback" in done.stderr
    check(done)


def test_a_check_that_fails_is_told_harmlessly(here, monkeypatch):
    def raises(folder, known):
        raise ValueError(HOSTILE)

    for name in ("stability", "motion", "contact", "engine"):
        monkeypatch.setattr(installation, name, raises)
    monkeypatch.setattr(installation.platform, "system", lambda: HOSTILE)
    done = here("check")
    assert done.returncode == 1
    check(done, 5)


def test_a_bar_shows_what_is_under_way(monkeypatch, capsys):
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "200")
    with progress.bar(2) as tell:
        tell(Snapshot(2, 1, 0, 1.0, 1.0, 1.0, (f"{HOSTILE} [red]not red[/red]",), False))
    said = capsys.readouterr().err
    assert SHOWN in said
    assert "[red]not red[/red]" in said
    assert HOSTILE not in said
    assert "\x1b]0;" not in said
    assert "\u202e" not in said


def test_what_nobody_can_catch_is_told_in_one_line(capsys):
    class Late:
        def __del__(self):
            raise ValueError(HOSTILE)

    def leave(problem):
        raise problem

    with output.streams():
        for problem in (ValueError(f"{HOSTILE}\nmore"), SystemExit(HOSTILE)):
            thread = threading.Thread(target=leave, args=[problem], name=HOSTILE)
            thread.start()
            thread.join()
        Late()
    of_thread, of_destructor = capsys.readouterr().err.splitlines()
    assert of_thread.startswith(f"fiv: thread {SHOWN}: ValueError: {SHOWN} more ({__file__}, line ")
    assert re.search(r"ignored .*Late.__del__.*: ValueError: ", of_destructor)
    assert SHOWN in of_destructor


OWN = f"""import threading, warnings
from matplotlib.figure import Figure
from studies.study import Study
from sweeps import Axis, Variable
def late():
    raise ValueError({HOSTILE!r})
def own(points):
    thread = threading.Thread(target=late, name={HOSTILE!r})
    thread.start()
    thread.join()
    warnings.warn({HOSTILE!r})
    return {{"y": points["x"]}}
STUDY = Study(
    name="own", title="Own", question="?", paper="-", axes={{"x": Axis([1.0])}}, settings={{}}, function=own,
    variables={{"y": Variable()}}, draw=lambda data: Figure((1.0, 1.0)), findings=lambda data: ["nothing"],
)
"""


def test_what_python_reports_in_a_process_of_its_own_goes_the_same_way(tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    command = [sys.executable, "-m", "studies", "run", "own.py", "--workers", "1", "-q"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert f"fiv: thread {SHOWN}: ValueError: {SHOWN}" in done.stderr
    assert f"UserWarning: {SHOWN}" in done.stderr
    assert not output.OBEYED.search(done.stdout + done.stderr)


LATE = """
import sys
from studies.cli import output

class Raising:
    def __del__(self):
        raise ValueError("early" if self.early else "late")

output.dask_setup(None)
Raising().early = True
output.kept = sys.kept = Raising()
sys.kept.early = False
"""


def test_nothing_is_said_when_a_process_has_lost_its_names():
    """Of the interpreter's end, at which modules are emptied, the hooks tell nothing."""
    done = subprocess.run([sys.executable, "-c", LATE], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "")
    assert [line.partition(" (")[0] for line in done.stderr.splitlines()] == [
        "fiv: ignored in Raising.__del__: ValueError: early"
    ]


@given(st.text(st.characters(codec=None)))
def test_harmless_text_is_what_it_was_but_for_what_is_obeyed(text):
    shown = output.harmless(text)
    assert not output.OBEYED.search(shown)
    assert output.harmless(shown) == shown
    plain = text.replace("\r\n", "\n")
    assert (shown == plain) == (not output.OBEYED.search(plain))


def test_letters_that_a_terminal_lacks(monkeypatch):
    for encoding, said in (("ascii", rb"\u03bc and \u03b8"), ("latin-1", rb"\u03bc and \u03b8")):
        for name, err in (("stdout", False), ("stderr", True)):
            written = io.BytesIO()
            monkeypatch.setattr(sys, name, io.TextIOWrapper(written, encoding))
            with output.streams():
                output.show("μ and θ", err=err)
            assert written.getvalue() == said + b"\n"


PRINTING = {"print", "echo", "secho", "echo_via_pager", "print_exc", "print_exception", "print_stack", "print_tb"}


def test_everything_is_printed_in_one_place():
    """No other module of the package prints, or writes to a standard stream."""
    found = []
    for path in Path(studies.__file__).parent.rglob("*.py"):
        if path == Path(output.__file__):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            called = node.func if isinstance(node, ast.Call) else None
            name = getattr(called, "id", None) or getattr(called, "attr", None)
            streams = ast.unparse(called) if called else ""
            if name in PRINTING or streams.startswith(("sys.stdout.write", "sys.stderr.write")):
                found.append(f"{path.name}:{node.lineno}: {streams}")
    assert not found
