"""What is wrong input, what is a fault of our own, and what reaches the terminal."""

import importlib.metadata
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import sweeps
from fivcore import InputError, UnsolvedError
from studies.cli import main, output
from sweeps.compute.executors import Backend

TABLES = {
    "semi.csv": "mu;theta\n1;2\n",
    "cell.csv": "mu,theta\n0.1,5\n0.2,x\n",
    "broken.toml": "x = [",
    "key.toml": "scater = {}\n",
    "large.toml": "set = {V = '1e-3:1e-2:10000000', mu = '0.1:0.3:8000000'}\n",
    "text.nc": "mine",
    "takes.py": "from studies.study import Parameter, Study\ndef f(sped):\n    return {'y': sped}\n"
    "STUDY = Study('takes', 'T', '', {'speed': Parameter([1.0, 2.0])}, {'y': ('1', '')}, f)\n",
    "raising.py": "raise RuntimeError('mine')",
}
WRONG = [
    ("rnu fig5", "No such command 'rnu'. Did you mean 'run'?"),
    ("run fig55", "STUDY = 'fig55': no study has this name; did you mean fig5?"),
    ("show fig5", "No such command 'show'. All of them: fiv --help"),
    ("fig5", "fig5 is no command; write: fiv run fig5"),
    ("run fig5 theta=8", "extra argument (theta=8); a value needs --set before it, or --fix for a map"),
    ("run fig5 --set young_modulus=210GPa", "did you mean p2_young_modulus or p1_young_modulus? it has mu,"),
    ("run fig5 --sett theta=8", "'--set'"),
    ("run fig5 --set tehta=8", "tehta: study fig5 has no such parameter; did you mean theta?"),
    ("run fig5 --set mu=-0.2", "mu = -0.2: it must be a number from 0 to"),
    ("run fig5 --set mu", "--set 'mu': it must be NAME=VALUE, for example mu=0:0.5:101"),
    (
        "run fig5 --set p1_length=50 --strict",
        "p1_length = 50 m is unusual: 0.005 to 2 m is usual; mm without the unit? --strict refuses unusual values",
    ),
    ("plan scenes --set V=1e-3,2mm/s", "V = '1e-3,2mm/s': 1e-3 beside 2mm/s: write 1e-3mm/s, or 1e-3 m s-1; the"),
    ("plan scenes --record velocity_B --sample-rate 20km", "sample_rate = '20km': km is a length"),
    ("map --x theta --quantity growth_rate", "--x or --y 'theta': it must be NAME=VALUE"),
    ("map --x theta=1:5:3 --quantity loud", "--quantity loud: no such quantity"),
    ("map --x theta=1:5:3 --quantity growth_rate --fix nu=1", "--fix nu: growth_rate does not depend on it; did"),
    ("report fig55", "no result 'fig55' in results, which is empty; compute it with fiv run"),
    ("query mine", "no result 'mine'; the folder "),
    ("run scenes --set V=0", "V = 0: the drive must move; usual are 1e-07 to 0.5 m/s"),
    ("run scenes --set mu_static=0.3", "friction falls with the speed by kinetic_ratio"),
    ("run scenes --set intial=slip", "scenes has no such parameter; it has V, theta, mu"),
    (
        "plan fig5 --set mu=0,5",
        "a point is the decimal sign; write mu=0.5; or, for 2 values, 'mu=0, 5' with a space",
    ),
    ("plan fig5 --set mu=1,05", "write mu=1.05; or, for 2 values, 'mu=1, 5'"),
    (
        "plan fig5 --set theta=5,5",
        "theta = '5,5': a comma separates values, a point is the decimal sign; write theta=5.5",
    ),
    ("plan fig5 --set p1_length=60,5mm", "write p1_length=60.5mm; or, for 2 values, 'p1_length=5, 60mm'"),
    ("plan fig5 --set head_mass=2,9434", "write head_mass=2.9434"),
    ("plan fig5 --set mu=0,1,0,2", "write mu=0.1,0.2"),
    ("plan fig5 --set mu=0,5;0,6", "commas separate values, and a point is the decimal sign"),
    ("plan fig5 --set mu=0:0,5:11", "'0,5' must be a finite number; a point is the decimal sign: 0.5"),
    ("plan fig5 --set mu=normal:0,2:0,02", "a point is the decimal sign; write normal:0.2:0.02"),
    ("plan scenes --record velocity_B --sample-rate 20,5kHz", "a point is the decimal sign: 20.5kHz"),
    ("plan fig5 --set theta=8,p1_length=60mm", "give each parameter its own option: --set p1_length=60mm"),
    ("plan scenes --set F=1kg", "kg is a mass; F is a force: 9N or 9"),
    ("plan fig5 --set V=2mm/s", "study fig5 does not depend on the speed of the drive; leave it out"),
    ("map --x theta=1:5:3 --quantity regime --quantity onset_mu", "regime and onset_mu need different"),
    (
        "map --x mu=0:1:3 --quantity growth_rate --scatter mode1=normal:1:2",
        "--scatter mode1: growth_rate does not",
    ),
    ("run raising", "no study has this name; did you mean raising.py? give the file"),
    (
        "plan scenes --record velocity",
        "record = 'velocity': no such series; did you mean velocity_B or slip_velocity?",
    ),
    ("plan fig5 --samples 4", "--samples 4: it is for draws; give a distribution, mu=normal"),
    ("plan fig5 --scatter mu=0.2", "--scatter 'mu=0.2': it must be NAME=DIST, for example"),
    ("plan fig5 --points semi.csv", "its columns are separated by ';'; separate them by commas"),
    ("plan fig5 --points cell.csv", "row 2, column theta: 'x' must be a finite number"),
    ("plan fig5 --config broken.toml", "--config broken.toml: it is not TOML: "),
    ("plan fig5 --config key.toml", "scater: no such key; did you mean scatter? the keys are set, scatter"),
    ("plan scenes --config large.toml", "grid = V 10000000 x theta"),
    ("run fig5 --scheduler cloud", "scheduler = 'cloud': it must be 'threads', 'sync', "),
    ("run fig5 --scheduler tcp://127.0.0.1:9 --workers 2", "--workers 2: the cluster at tcp://127.0.0.1:9"),
    ("query fig5", "results does not exist; name another one with --out; compute it with: fiv run fig5"),
    ("run", "STUDY is missing: give a study that fiv list names, or your own file"),
    ("help run", "No such command 'help'. All of them: fiv --help; the options of one: fiv run --help"),
    ("plan fig5 --set mu=0:0.5:0.01", "not '0.01'; for a step of 0.01 write 0:0.5:51; the forms are"),
    ("plan fig5 --set mu=0:0.5:0.3", "from 1 to 10000000, not '0.3'; the forms are"),
    ("plot fig5 --out there", "compute it with: fiv run fig5 --out there"),
    ("query regmes", "no result 'regmes'; did you mean regimes?"),
    *((f"{name} text.nc", "text.nc is damaged or not netCDF") for name in ("plot", "query", "status")),
    ("plan takes.py", "study takes: its function takes 'sped', which is no parameter; did you mean speed?"),
    ("run raising.py", "raising.py: it cannot be loaded: RuntimeError: mine"),
    ("plan fig5 --out ~nobody-of-this-name/place", "~nobody-of-this-name has no home folder"),
    ("plan fig5 --out \udcff", "it is no text in this system's encoding"),
]


@pytest.mark.parametrize(("line", "message"), WRONG)
def test_wrong_input_is_one_line_with_exit_2_and_leaves_nothing(here, folder, tmp_path, forgetful, line, message):
    for name, text in TABLES.items():
        (tmp_path / name).write_text(text)
    done = here(*line.split(" "))
    assert (done.returncode, done.stdout) == (2, "")
    (said,) = [text for text in done.stderr.splitlines() if "compiling, once" not in text]
    assert said.startswith("fiv: ")
    assert message in said
    assert folder() == sorted(name for name in TABLES if not name.endswith(".py"))


@pytest.mark.parametrize(
    "values", ["theta=0,5", "V=1,2mm/s", "F=5,10", "mu=0,0.5", "mu=1e-3,2e-3", "p1_elements=9,12"]
)
def test_lists_that_are_no_decimal_commas_are_two_values(here, values):
    done = here("plan", "scenes", "--set", values)
    assert done.returncode == 0
    assert re.search(rf"(?m)^  {values.split('=')[0]} .* and .*, 2 values$", done.stdout)


@pytest.mark.parametrize(
    ("taken", "said"),
    [
        ("results/fig5/fig5.nc", "is damaged or not netCDF; move it away, or choose another folder (--out)"),
        ("results/fig5/fig5.png/mine", "fig5.png could not be written"),
        ("results", "results"),
    ],
)
def test_what_is_in_the_way_is_exit_3_and_stays(here, tmp_path, taken, said):
    (tmp_path / taken).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / taken).write_text("mine")
    done = here("run", "fig5", "--set", "mu=0.1,0.2", "-q")
    assert (done.returncode, done.stderr.count("\n")) == (3, 1)
    assert said in done.stderr
    assert done.stderr.count("move it away") < 2
    assert "keep both" not in done.stderr
    assert (tmp_path / taken).read_text() == "mine"


REPORT = "please report it with the lines above"


def fails(problem):
    """A function that raises in a check of ours, or within a library."""

    def check(*arguments, **options):
        if problem:
            raise problem
        return np.zeros(3) + np.zeros(4)

    return check


@pytest.mark.parametrize(
    ("problem", "code", "last"),
    [
        (InputError("mu = 9: it must be less"), 2, "mu = 9: it must be less"),
        (UnsolvedError("theta = 9: a branch is lost"), 2, "theta = 9: a branch is lost"),
        (MemoryError("no 9 GiB"), 2, "out of memory: no 9 GiB; take fewer values"),
        (RecursionError("depth"), 2, "something is nested too deeply; -v shows where"),
        (OSError(36, "File name too long", "a" * 9), 3, "aaaaaaaaa: File name too long"),
        (sweeps.ClusterLostError("the scheduler is gone"), 3, "the scheduler is gone"),
        (sweeps.SweepStoppedError("stopped"), 1, "stopped"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (ValueError("mu = 9"), 70, f"internal error: ValueError; {REPORT}"),
        (BrokenPipeError(32, "pipe"), 70, f"internal error: BrokenPipeError; {REPORT}"),
        (None, 70, f"internal error: ValueError; {REPORT}"),
    ],
)
def test_a_fault_of_ours_is_not_reported_as_wrong_input(here, monkeypatch, problem, code, last):
    monkeypatch.setattr("studies.runner.sweep_of", fails(problem))
    done = here("plan", "fig5")
    assert done.returncode == code
    assert done.stderr.splitlines()[-1] == f"fiv: {last}"
    assert ("Traceback" in done.stderr) == (code == 70)
    if code in (1, 2, 3):
        assert "Traceback" in here("plan", "fig5", "-v").stderr


@pytest.mark.usefixtures("undrawn")
def test_a_lost_cluster_is_exit_3_and_what_is_stored_stays(here, own, monkeypatch):
    whole = Backend.submit

    def submit(self, name, points):
        if len(sweeps.Store("results/squares/squares.nc").part_names()):
            raise sweeps.ClusterLostError("the scheduler does not answer any more")
        return whole(self, name, points)

    monkeypatch.setattr(Backend, "submit", submit)
    run = ("run", "own.py", "--set", "x=3:9:50", "--scheduler", "sync")
    done = here(*run)
    assert done.returncode == 3
    counts = re.search(
        r"any more; (\d+) of 100 computations are stored; go on from there with: fiv run", done.stderr
    )
    assert counts
    assert f"cached          {counts[1]}" in here("plan", *run[1:4]).stdout
    monkeypatch.setattr(Backend, "submit", whole)
    assert here(*run).returncode == 0


FULL = "fiv: standard output could not be written: No space left on device\n"
LINUX = pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has a device that is full")


@pytest.mark.posix
@pytest.mark.parametrize(
    ("command", "redirected", "code", "last"),
    [
        pytest.param("--help", "> /dev/full", 3, FULL, marks=LINUX),
        pytest.param("list", "> /dev/full", 3, FULL, marks=LINUX),
        ("--help", "| true", 0, ""),
        ("list", ">&-", 0, ""),
        ("list nothing", "2>&-", 2, ""),
    ],
)
def test_streams_that_are_closed_or_full(command, redirected, code, last):
    script = f"set -o pipefail; {sys.executable} -m studies {command} {redirected}"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (code, last)


HOSTILE = "\x1b]0;owned\x07\u202eowned\r\x9b1m\x7f"


@pytest.mark.usefixtures("undrawn")
def test_no_text_of_a_file_or_an_argument_reaches_a_terminal_as_it_is(here, own, monkeypatch):
    own.write_text(own.read_text().replace('"Squares"', repr(HOSTILE)).replace("two is", repr(HOSTILE)[1:-1]))
    words = ["run own.py --set x=1,2,3", "list own.py", "query squares --show x,error", "plan own.py --set H=1"]
    for line in [*words, "query H", "H", "plan own.py --out H"]:
        done = here(*(word.replace("H", HOSTILE) for word in line.split()))
        assert not output.OBEYED.search(done.stdout + done.stderr)
        assert r"\x1b]0;owned" in done.stdout + done.stderr
    # Programs get data as they are.
    query = ("query", "squares", "--show", "x,error", "--format", "csv")
    assert HOSTILE in here(*query).stdout
    monkeypatch.setattr(type(sys.stdout), "isatty", lambda self: True)
    assert HOSTILE not in here(*query).stdout


@pytest.mark.usefixtures("undrawn")
def test_a_refused_folder_comes_with_a_command_that_works(here):
    assert here("run", "fig5", "--set", "mu=0.1,0.2", "-q").returncode == 0
    done = here("run", "fig5", "--set", "mu=0.1,0.2", "--set", "theta=8")
    offered = done.stderr.rstrip().partition("; for example: fiv ")[2]
    assert (done.returncode, offered.endswith("--out mu-0.1,0.2-theta-8")) == (3, True)
    assert here(*shlex.split(offered)).returncode == 0
    assert "for example" not in here("run", "fig5", "--set", "theta=8", "--out", "results").stderr
    # So many modes more that outputs get another shape.
    done = here("run", "fig5", "--set", "mu=0.1,0.2", "--set", "p1_length=6")
    assert (done.returncode, "p1_length = 0.05 there, 6.0 here; choose" in done.stderr) == (3, True)


@pytest.mark.parametrize(
    ("text", "options"),
    [
        (
            "another folder (out=...), or start over (fresh=True)",
            "another folder (--out), or start over (--fresh)",
        ),
        ("retry_failed=True computes them; adopt=3 keeps", "--retry-failed computes them; --adopt 3 keeps"),
        ("samples = 4: it is for draws", "--samples 4: it is for draws"),
        ("points: row 2: theta", "points: row 2: theta"),
        ("x = 'a': it must be finite", "x = 'a': it must be finite"),
    ],
)
def test_arguments_in_a_message_are_options_here(text, options):
    assert main.in_options(text) == options


def test_libraries_that_do_not_fit_are_named_where_something_breaks(here, monkeypatch):
    versions = {"numpy": "1.26.4", "numba": "0.70.1"}
    true = importlib.metadata.version
    monkeypatch.setattr(importlib.metadata, "version", lambda name: versions.get(name) or true(name))
    monkeypatch.setattr("studies.runner.sweep_of", fails(ImportError("numpy.core")))
    done = here("plan", "fig5")
    found = "numpy 1.26.4 is too old: fiv needs 2.2 or newer; numba 0.70.1 is too new: fiv needs one below 0.69"
    assert (done.returncode, done.stderr.splitlines()[-1]) == (
        2,
        f"fiv: {found}; install into another environment",
    )
    monkeypatch.undo()
    assert main.unfit() == ""
