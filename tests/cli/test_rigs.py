"""Named rigs: kept with their results, used by every command, never changed under them, compared."""

import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy import io, sparse

import studies
from fivcore import Structure
from studies.asking import rigs

pytestmark = pytest.mark.usefixtures("undrawn")
MU = ("--set", "mu=0.1,0.2", "-q")
PIN = """damping_ratio = 0.002
mode = [
    { frequency = 500.0, normal = 0.4, tangential = -0.9, load = -0.4 },
    { frequency = 800.0, normal = 0.1, tangential = -0.7, load = -0.1 },
]
"""
FIT = """
[unknown]
contact_position = "uniform:75:85mm"
[[target]]
output = "glued_frequency_2"
value = "346Hz"
within = "1%"
"""


@pytest.fixture
def mine(here):
    assert here("rig", "mine", "--set", "p1_length=60mm").returncode == 0
    return here


def test_results_of_a_rig_lie_in_its_folder_and_are_those_of_its_numbers(mine, folder):
    assert mine("run", "fig5", *MU).returncode == 0
    assert mine("run", "fig5", "--rig", "mine", *MU).returncode == 0
    assert mine("run", "fig5", "--set", "p1_length=60mm", "--out", "same", *MU).returncode == 0
    assert folder() == [
        "results/fig5/fig5.nc",
        "results/mine/fig5/fig5.nc",
        "results/mine/rig.toml",
        "same/fig5/fig5.nc",
    ]
    one, other = studies.open("fig5", rig="mine"), studies.open("fig5", "same")
    np.testing.assert_array_equal(one["growth_rate"], other["growth_rate"])
    assert one["p1_length"] == 0.06
    rows = mine("query", "fig5", "--rig", "mine", "--show", "mu,p1_length").stdout
    assert rows.split() == ["mu", "p1_length", "0.1", "0.06", "0.2", "0.06"]
    listed = mine("list").stdout
    assert "\n\nrig mine: p1_length = 60mm\n  name  kind" in listed
    assert "complete" in mine("status", "fig5", "--rig", "mine").stdout
    assert mine("plot", "fig5", "--rig", "mine").stdout == "results/mine/fig5/fig5.png\n"
    shutil.move("results", "moved")
    again = mine("plan", "fig5", "--rig", "mine", "--out", "moved", *MU[:2])
    assert "to do           0" in again.stdout
    assert studies.run("fig5", rig="mine", out="moved", mu=[0.1, 0.2])["p1_length"] == 0.06


def test_a_map_and_a_fit_take_a_rig(mine, folder):
    Path("mine.toml").write_text('[set]\np1_length = "60mm"\n')
    Path("bench.toml").write_text(FIT)
    line = ["map", "--x", "mu=0.1,0.2", "--quantity", "growth_rate", "--rig"]
    assert mine(*line, "mine", "-q").returncode == 0
    assert mine(*line, "mine.toml", "-q").returncode == 0
    one, other = studies.open("growth-mu", rig="mine"), studies.open("growth-mu-p1_length0.06")
    np.testing.assert_array_equal(one["growth_rate"], other["growth_rate"])
    assert mine("fit", "bench.toml", "--rig", "mine", "--samples", "16", "--rounds", "1", "-q").returncode == 0
    assert "results/mine/fit/bench/bench.nc" in folder()
    found = studies.fit("bench.toml", rig="mine", samples=16, rounds=1)
    whole = studies.fit("bench.toml", rig="mine.toml", samples=16, rounds=1)
    np.testing.assert_array_equal(found["glued_frequency_2"], whole["glued_frequency_2"])


def test_a_study_with_a_range_of_a_number_keeps_it(here):
    assert here("rig", "mine", "--set", "theta=8", "--set", "d1=40").returncode == 0
    assert "theta 61" in here("plan", "table6", "--rig", "mine").stdout
    data = studies.run("fig5", rig="mine", mu=[0.1, 0.2])
    assert (data["theta"], data["d1"]) == (8.0, 40.0)
    assert studies.map("theta=4,5", rig="mine")["d1"] == 40.0


def test_a_structure_needs_no_other_file(here):
    stiffness = sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(6, 6)) * 1e7
    Path("model").mkdir()
    io.mmwrite("model/K.mtx", stiffness.tocoo())
    io.mmwrite("model/M.mtx", sparse.eye_array(6).tocoo() * 0.01)
    Path("model/disc.toml").write_text(
        'mass = "M.mtx"\nstiffness = "K.mtx"\nnormal = 1\ntangential = 2\nload = { "1" = -1.0 }\n'
        "d1 = 5.0\nfmax = 4e3\n"
    )
    own = Structure.read("model/disc.toml")
    assert here("rig", "disc", "model/disc.toml").returncode == 0
    shutil.rmtree("model")
    assert Structure.from_dict(rigs.named("disc").structure) == own
    assert "it is so already" in here("rig", "disc", "results/disc/rig.toml").stderr
    data = studies.run("fig5", rig="disc", mu=[0.1, 0.2])
    same = studies.run("fig5", rig=own, mu=[0.1, 0.2], out="same")
    np.testing.assert_array_equal(data["growth_rate"], same["growth_rate"])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("rig fig5 --set d1=40", "a study has this name; choose another, such as my_fig5"),
        *((f"rig {name} --set d1=40", "has this name; choose") for name in ("reference", "map", "rig")),
        ("rig paper --set d1=40", "it is the paper's rig; choose another name"),
        ("rig a.b --set d1=40", "a name has letters, digits, _ and -, and no suffix or slash"),
        ("rig other --set p1_length=60,5mm", "with a decimal point: p1_length=60.5mm"),
        ("rig other --set p1_lenght=60mm", "did you mean p1_length?"),
        ("rig other --set members=4", "a rig has no such number; what else a study takes is of a run"),
        ("rig other --set kinetic_ratio=0.9", "what else a study takes is of a run"),
        ("rig other --set V=0", "V = 0"),
        ("rig other --set F=-1", "F = -1"),
        ("rig other pin.toml --set theta=4", "a structure has no such number"),
        ("rig other --set d1=1:2:3", "a rig has one value"),
        ("rig other --set contact_position=500mm", "at most P2's length, 0.15 m"),
        ("rig other pin.toml --set d1=40", "a structure has no such number"),
        ("rig other nothing.toml", "it cannot be read"),
        ("rig mien", "did you mean mine? make it with: fiv rig mien"),
        ("run fig5 --rig pin", "did you mean pin.toml?"),
        ("run fig5 --rig mine --set p1_length=70mm", "fiv rig mine-p1_length-70mm mine --set p1_length=70mm"),
        ("run classics --rig mine", "study classics does not depend on the rig"),
        ("run fig5 --out results/mine", "it is the folder of the rig 'mine'; write --rig mine"),
        ("query fig5 --rig mine", "compute it with: fiv run fig5 --rig mine"),
        ("query fig5 --rig pin.toml", "give it one with: fiv rig pin pin.toml"),
        ("query fig5 --out nowhere", "no results in nowhere: the folder does not exist"),
        ("plot fig5 --out nowhere", "no results in nowhere: the folder does not exist"),
        ("compare mine mine", "they are one rig"),
        ("compare mine pin.toml", "fiv rig pin pin.toml"),
    ],
)
def test_wrong_input_is_one_line_and_writes_nothing(mine, folder, line, message):
    Path("pin.toml").write_text(PIN)
    before = folder()
    done = mine(*line.split())
    assert (done.returncode, done.stdout) == (2, "")
    assert message in [text for text in done.stderr.splitlines() if "compiling" not in text][-1]
    assert folder() == before


def test_a_rig_changes_only_until_it_has_results(mine):
    assert mine("rig", "mine", "--set", "d1=40").returncode == 0
    assert rigs.named("mine").numbers == {"p1_length": 0.06, "d1": 40.0}
    assert mine("run", "fig5", "--rig", "mine", *MU).returncode == 0
    assert mine("rig", "mine", "--set", "p1_length=0.06").returncode == 0
    done = mine("rig", "mine", "--set", "d1=30")
    assert done.returncode == 2
    offered = done.stderr.strip().partition("another rig: fiv ")[2]
    assert mine(*shlex.split(offered)).returncode == 0
    assert rigs.named("mine-2").numbers == {"p1_length": 0.06, "d1": 30.0}
    assert rigs.named("mine").numbers == {"p1_length": 0.06, "d1": 40.0}


@pytest.mark.parametrize("own", [["--set", "p1_length=60.5mm"], ["--rig", "pin.toml"]])
def test_other_numbers_than_a_file_has_are_offered_with_a_rig_for_them(here, own):
    Path("pin.toml").write_text(PIN)
    assert here("run", "fig5", *MU).returncode == 0
    done = here("run", "fig5", *own, *MU)
    assert done.returncode == 3
    for command in done.stderr.strip().partition("; keep both: ")[2].split(" && "):
        assert here(*shlex.split(command)[1:]).returncode == 0, command
    (name,) = rigs.names()
    assert studies.open("fig5", rig=name)["mu"].values.tolist() == [0.1, 0.2]


def test_two_rigs_beside_each_other(mine, folder):
    for rig in ("mine", "paper"):
        line = f"scenes --set V=2mm/s --set mu=0.05,0.3 --set theta=5 --set F=9 --set duration=.3 --rig {rig} -q"
        assert mine("run", *line.split()).returncode == 0
    done = mine("compare", "mine", "paper")
    assert done.returncode == 0
    assert "p1_length 60 mm 50 mm" in done.stdout
    assert "0.08762   325.7  0.1112     2802" in done.stdout
    assert "of 2 common points" in done.stdout
    assert {"results/compare/mine-paper.png", "results/paper/fig5/fig5.nc"} <= {*folder()}
    assert "computing" not in mine("compare", "mine", "paper").stderr
