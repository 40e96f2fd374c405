"""Named rigs: kept with their results, used by every command, never changed under them, compared."""

import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy import io, sparse

import studies
from fivcore import Rig, Structure
from studies.asking import rigs

pytestmark = pytest.mark.usefixtures("undrawn")
MU = ("--set", "mu=0.1,0.2", "-q")
PIN = """damping_ratio = 0.002
mode = [
    { frequency = 500.0, normal = 0.4, tangential = -0.9, load = -0.4 },
    { frequency = 800.0, normal = 0.1, tangential = -0.7, load = -0.1 },
]
"""
SETS = ("--set", "mu=0.3", "--set", "F=20N", "--set", "V=3mm/s")
SHORT = {"min_duration": 0.02, "max_duration": 0.05, "standard_error": 0.5, "members": 1}
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
    Path("mine.toml").write_text('[set]\np1_length = "60mm"\n', encoding="utf-8")
    Path("bench.toml").write_text(FIT, encoding="utf-8")
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
        "d1 = 5.0\nfmax = 4e3\n",
        encoding="utf-8",
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
        ("rig NUL --set d1=40", "Windows has no folder of this name; choose another, such as my_NUL"),
        ("rig Mine --set d1=40", "it differs from 'mine' in capitals only; choose another name"),
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
    Path("pin.toml").write_text(PIN, encoding="utf-8")
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
    Path("pin.toml").write_text(PIN, encoding="utf-8")
    assert here("run", "fig5", *MU).returncode == 0
    done = here("run", "fig5", *own, *MU)
    assert done.returncode == 3
    for command in done.stderr.strip().partition("; keep both: ")[2].split(" && "):
        assert here(*shlex.split(command)[1:]).returncode == 0, command
    (name,) = rigs.names()
    assert studies.open("fig5", rig=name)["mu"].values.tolist() == [0.1, 0.2]


def test_a_rig_says_where_it_usually_runs(here):
    """A range of the study, and what a run requests, win."""
    assert here("rig", "mine", *SETS, "--set", "head_mass=2kg").returncode == 0
    data = studies.run("fig7", rig="mine", duration=0.05)
    assert (data["mu"].item(), data["F"].item(), data["V"].size) == (0.3, 20.0, 3)
    data = studies.run("fig7", rig="mine", duration=0.05, V=[1e-3], mu=0.2, fresh=True)
    assert data["mu"].item() == 0.2
    mapped = studies.map("theta=4,5", quantity="growth_rate", rig="mine")
    fixed = studies.map("theta=4,5", quantity="growth_rate", fix={"mu": 0.3, "head_mass": 2.0})
    np.testing.assert_array_equal(mapped["growth_rate"], fixed["growth_rate"])
    Path("pin.toml").write_text(PIN, encoding="utf-8")
    assert here("rig", "pin", "pin.toml", *SETS).returncode == 0
    data = studies.map("V=0.02,0.03", quantity="velocity_rms", rig="pin", fix=SHORT)
    assert (data["mu"].item(), data["F"].item()) == (0.3, 20.0)
    Path("pin.toml").unlink()
    assert here("rig", "pin", "--set", "mu=0.4").returncode == 2


def test_a_file_means_what_a_name_means(here):
    """Numbers alone, and a range of the study is kept."""
    Path("mine.toml").write_text('[set]\ntheta = 8\np1_length = "60mm"\n', encoding="utf-8")
    assert here("rig", "mine", "mine.toml").returncode == 0
    for line in ("table6", "fig5", "fig5 --set theta=4", "scenes --set V=2mm/s --set theta=3,4"):
        named, file = (here("plan", *line.split(), "--rig", rig).stdout for rig in ("mine", "mine.toml"))
        keep = [
            [row for row in text.splitlines() if row.split()[0] not in ("rig", "file")] for text in (named, file)
        ]
        assert keep[0] == keep[1]
    assert here("run", "table6", "--rig", "mine.toml", "--set", "theta=4").returncode == 0
    for text, told in (
        ('study = "fig5"', "study is of a run (--config)"),
        ("set = {mu = '1:2:3'}", "a rig has one"),
    ):
        Path("bad.toml").write_text(text, encoding="utf-8")
        done = here("run", "fig5", "--rig", "bad.toml")
        assert (done.returncode, told in done.stderr) == (2, True)


def test_maps_of_rigs_from_files_have_names_of_their_own(here):
    """Of beams by their numbers, of structures by their digest; the map of one is never that of another."""
    for k, text in enumerate((PIN, PIN.replace("800.0", "801.0"))):
        Path(f"pin{k}.toml").write_text(text, encoding="utf-8")
        line = ["--x", "frequency_2=750,800Hz", "--quantity", "onset_mu", "-q"]
        assert here("map", *line, "--rig", f"pin{k}.toml").returncode == 0
    for k, length in enumerate(("60mm", "60.0001mm")):
        Path(f"beam{k}.toml").write_text(f'[set]\np1_length = "{length}"\ntheta = {k}\n', encoding="utf-8")
        for x in ("mu=0.1,0.2", "theta=4,5"):
            assert (
                here("map", "--x", x, "--quantity", "growth_rate", "-q", "--rig", f"beam{k}.toml").returncode == 0
            )
    named = {path.stem for path in Path("results/map").glob("*.nc")}
    assert len(named) == 6, named


def test_the_same_in_python(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mine = studies.rig("mine", p1_length="60mm", mu=np.float64(0.3))
    assert (mine.numbers, mine.results) == ({"p1_length": 0.06, "mu": 0.3}, [])
    light = studies.rig("light", Rig.of(p1_length=0.06, head_mass=2.0))
    assert studies.rig("light").numbers == light.numbers == {"p1_length": 0.06, "head_mass": 2.0}
    pin = studies.rig(
        "pin", Structure.from_modes([500.0, 800.0], [0.4, 0.1], [-0.9, -0.7], load=[-0.4, -0.1]), F=5
    )
    assert rigs.named("pin") == pin
    own = {"mu": [0.1, 0.3]}
    for rig in (mine, light):
        assert studies.run("fig5", rig=rig, **own)["p1_length"] == 0.06
        xr.testing.assert_identical(studies.open("fig5", rig=rig), studies.open("fig5", rig=rig.name))
    assert studies.run("fig5", rig=Rig.of(head_mass=2.0), **own)["head_mass"] == 2.0
    both = studies.compare(mine, "light")
    assert Path("results/compare/mine-light.png").exists()
    for name in ("mine", "light"):
        alone = studies.open("fig5", rig=name)
        np.testing.assert_array_equal(both["onset_mu"].sel(rig=name).dropna("onset"), alone["onset_mu"])
        assert float(both["head_mass"].sel(rig=name)) == alone["head_mass"]
    assert len(both.fiv.query('rig == "mine" and growth_rate > 0 and mu == 0.3')) == 3
    # No number of the beams is of a structure.
    studies.run("fig5", rig=pin, **own)
    assert np.isnan(studies.compare("pin", "mine")["p1_length"].sel(rig="pin"))
    for call, told in (
        (lambda: studies.rig("mine", p1_length="70mm"), "it has results"),
        (lambda: studies.rig("mien"), "did you mean mine"),
        (lambda: studies.compare("mine", mine), "they are one rig"),
    ):
        with pytest.raises(ValueError, match=told):
            call()


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
