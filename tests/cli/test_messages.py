"""What the command line says: lists, plans, help, and one clear line for whatever is wrong.

In this process, through the command's own entry point: a second of imports is saved each time.
"""

import time
from dataclasses import replace

import pytest

from studies import registry
from studies.cli.main import fiv
from studies.gallery import fig5
from tests import HOME
from tests.helpers.commands import written


def kept(name):
    return str(HOME / "results" / "reference" / name / f"{name}.nc")


def test_plan_writes_nothing_and_computes_only_what_the_time_is_asked_of(tmp_path, here, monkeypatch):
    calls, whole = [], fig5.modes

    def counted(points, **constants):
        calls.append(len(points["mu"]))
        return whole(points, **constants)

    monkeypatch.setattr(fig5, "STUDY", replace(fig5.STUDY, function=counted))
    done = here("plan", "fig5", "--set", "mu=0:0.5:101")
    assert done.returncode == 0
    for line in ("points          101", "distinct        101", "cached          0", "to do           101"):
        assert line in done.stdout
    assert "estimated time  unknown: there is no earlier run" in done.stdout
    assert calls == []
    assert "on one core" in here("plan", "fig5", "--time").stdout
    assert calls
    assert written(tmp_path) == []


def test_list_shows_every_study_and_all_of_one(here):
    done = here("list")
    assert done.returncode == 0
    for name in registry.NAMES:
        assert name in done.stdout
    assert "501 points, about" in done.stdout
    assert len(done.stdout.splitlines()) == 3 * len(registry.NAMES)
    one = here("list", "fig5").stdout
    assert "Paper: Section 3.4.2 and Fig. 5" in one
    assert "axis     mu                0 to 0.5 (501)         coefficient of friction" in one
    assert "setting  p2_thickness      0.003 m                thickness of P2" in one


def test_every_command_has_help(here):
    assert here("--version").stdout.startswith("fiv, version ")
    for command in ([], *([name] for name in fiv.commands)):
        done = here(*command, "--help")
        assert (done.returncode, done.stderr) == (0, "")
        assert "Usage: fiv" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "fig55"], "fiv: STUDY = 'fig55': there is no such study; did you mean fig5?"),
        (["run", "fig5", "--set", "mu=0:0.5"], "fiv: mu = '0:0.5': a range must be start:stop:count; the forms"),
        (["run", "fig5", "--set", "mu"], "fiv: --set 'mu': it must be AXIS=SPEC, for example mu=0:0.5:101"),
        (["run", "fig5", "--set", "mu=-0.1"], "fiv: mu = -0.1: it must be a number from 0 to"),
        (["run", "fig5", "--set", "mu=0.1", "--set", "mu=0.2"], "fiv: --set 'mu=0.2': mu is set already"),
        (
            ["run", "fig5", "--scheduler", "cloud"],
            "fiv: scheduler = 'cloud': it must be 'threads', 'sync', 'processes', an address like tcp://",
        ),
        (
            ["run", "fig5", "--scheduler", "tcp://127.0.0.1:9", "--workers", "2"],
            "fiv: --workers 2: the cluster at tcp://127.0.0.1:9 has workers of its own; leave it out",
        ),
        (["plan", "fig5", "--record", "velocity_B"], "fiv: study fig5 has no motion in time to record"),
        (["plan", "scenes", "--record", "velocity_C"], "velocity_B"),
        (["status", "fig5"], "results/fig5/fig5.nc: there is no such file"),
        (["run", "fig5", "--workers", "0"], "fiv: Invalid value for '--workers': 0 is not in the range x>=1."),
        (["list", "fig55"], "fiv: STUDY = 'fig55': there is no such study; did you mean fig5?"),
        (["run"], "fiv: Missing argument 'STUDY'."),
        (["rum", "fig5"], "fiv: No such command 'rum'."),
        (["plot", "none.nc"], "fiv: none.nc: there is no such file"),
        (["query", kept("fig5"), "--where", "mu >"], "fiv: where = 'mu >': something is missing at its end"),
        (["query", kept("fig6"), "--show", "growth_rate,node_x"], "no rows in common"),
        (
            ["run", "scenes", "--set", "V=1e-3:1e-2:1000", "--set", "mu=0.1:0.3:1000", "--set", "F=1:9:1000"],
            "fiv: grid = V 1000 x theta 4 x mu 1000 x F 1000: 4e+09 points are more than the 2e+07 of one plan",
        ),
    ],
)
def test_wrong_input_is_one_clear_line(tmp_path, here, arguments, message):
    done = here(*arguments)
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if "compiling once" not in line]
    assert message in line
    assert done.stdout == ""
    assert written(tmp_path) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["plan", "scenes", "--set=V=1e-3:1e-2:10000000", "--set=mu=log:0.1:0.3:10000000"],
            "fiv: grid = V 10000000 x theta 4 x mu 10000000 x F 2: ",
        ),
        (["plan", "scenes", "--config", "large.toml"], "fiv: grid = V 10000000 x theta 4 x mu 8000000 x F 2: "),
        (
            ["map", "--x=theta=0:20:1500", "--y=mu=0:0.5:1500", "--refine=12", "--quantity=growth_rate"],
            "fiv: 6139905 x 6139905 values are 37698433409025 points: it must be at most 4000000",
        ),
        (
            ["plan", "fig5", "--set", "p1_elements=1e12"],
            "p1_elements = 1000000000000.0: it must be a whole number from 1 to 1000",
        ),
    ],
)
def test_what_is_far_too_much_is_refused_at_once(tmp_path, here, arguments, message):
    """By what is asked for, before any value is made of it."""
    large = 'axes = { V = "1e-3:1e-2:10000000", mu = "0.1:0.3:8000000" }\n'
    (tmp_path / "large.toml").write_text(large)
    here("list", "scenes")
    begin = time.monotonic()
    done = here(*arguments)
    assert time.monotonic() - begin < 1.0
    (line,) = [line for line in done.stderr.splitlines() if "compiling once" not in line]
    assert (done.returncode, done.stdout) == (2, "")
    assert message in line


@pytest.mark.usefixtures("undrawn")
def test_what_is_there_is_not_computed_again(here):
    here("run", "fig5", "--set", "mu=0:0.5:11", "-q")
    planned = here("plan", "fig5", "--set", "mu=0:0.5:21").stdout
    assert "cached          11" in planned
    assert "to do           10" in planned
    # A part of what is there: the answer is of that part, the file keeps all.
    part = here("run", "fig5", "--set", "mu=0.2,0.3")
    assert "to do           0" in part.stderr
    assert "mu from 0.2 to 0.3 (2)" in part.stdout
    assert "points          11" in here("status", "fig5").stdout
