"""Structures of one's own in the commands: by modes, by matrices, built by a study; and what is refused."""

import itertools
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy import io, sparse

import studies
from fivcore import Scene, Structure, flutter_onsets, simulate, sliding_modes
from studies.asking.request import structure_of
from studies.cli.structure import hints
from studies.declaring.own import varied
from studies.plotting import general
from tests.docs import readmes
from tests.helpers.plate import plate

PIN = next(block for block in readmes.blocks("toml", "studies/README.md") if block.startswith("# pin.toml"))
OWN = Path(__file__).with_name("pin_angle.py")
RUN = ("run", "scenes", "--rig", "pin.toml", "--set", "V=0.01,0.02", "--set", "mu=0.2,0.4", "--set", "F=9", "-q")
STATISTICS = ("stick_fraction", "velocity_rms", "mean_normal_force")


@pytest.fixture
def pin(tmp_path, here, undrawn):
    (tmp_path / "pin.toml").write_text(PIN)
    return Structure.read(tmp_path / "pin.toml")


def by_matrices(folder, pin, unit):
    """The file of the same structure by matrices, in kg and N/m divided by `unit`; coordinates are mixed modes."""
    mixed = np.array([[1.0, 0.5, 0.2], [0.0, 2.0, 0.3], [0.4, 0.0, 1.0]])
    io.mmwrite(folder / "M.mtx", sparse.coo_array(mixed.T @ mixed / unit))
    io.mmwrite(folder / "K.mtx", sparse.coo_array(mixed.T @ (pin.stiffness[:, None] * mixed) / unit))
    lines = ["mass = 'M.mtx'", "stiffness = 'K.mtx'", "damping_ratio = 0.002"]
    for name in ("normal", "tangential", "load"):
        np.savetxt(folder / f"{name}.txt", getattr(pin, name) @ mixed)
        lines.append(f"{name} = '{name}.txt'")
    (folder / "matrices.toml").write_text("\n".join(lines))
    return folder / "matrices.toml"


def test_a_run_is_of_the_structure_and_is_not_computed_twice(here, pin, tmp_path):
    done = here(*RUN)
    assert (done.returncode, repr(pin) in done.stdout, "Beside the paper" in done.stdout) == (0, True, False)
    file = "results/scenes/scenes.nc"
    data = xr.open_dataset(file).isel(theta=0, F=0)
    assert "head_mass" not in data.coords
    alone = simulate(Scene(0.01, 0.0, 0.4, 9.0, pin), float(data["simulated_time"].sel(V=0.01, mu=0.4)))
    assert alone.summary["regime"] == "periodic"
    assert float(data["velocity_rms"].sel(V=0.01, mu=0.4)) == pytest.approx(
        alone.summary["velocity_rms"], rel=0.01
    )
    # Sliding steadily, friction of mu = 0.2 opens the contact statically: 0 = g_N = h_NN N + h_NT mu N + h_NF F.
    normal, tangential, load = (
        pin.normal / pin.stiffness @ np.transpose([pin.normal, 0.2 * pin.tangential, pin.load])
    )
    force = -9.0 * load / (normal + tangential)
    assert float(data["mean_normal_force"].sel(V=0.01, mu=0.2)) == pytest.approx(force, rel=0.01)
    assert "to do           0" in here("plan", *RUN[1:-1]).stdout
    # The result alone is enough to make it again.
    (tmp_path / "pin.toml").unlink()
    again = here("run", file, "--out", "again", "-q")
    assert (again.returncode, again.stdout) == (0, done.stdout)
    with xr.open_dataset(f"again/{file.removeprefix('results/')}") as other, xr.open_dataset(file) as first:
        assert all(other[name].equals(first[name]) for name in STATISTICS)
    assert structure_of(file)["stiffness"] == pin.to_dict()["stiffness"]
    # Nowhere are its numbers printed.
    for words in (("status", "scenes"), ("status", "scenes", "--json"), ("query", "scenes"), ("plan", file)):
        assert f"{pin.stiffness[0]:.12g}"[:8] not in here(*words).stdout


def test_a_request_and_a_structure_together_and_another_structure(here, pin, tmp_path):
    (tmp_path / "run.toml").write_text('set = { V = 0.01, mu = "0.2,0.4", F = 9 }\n')
    assert here("run", "scenes", "--config", "run.toml", "--rig", "pin.toml", "-q").returncode == 0
    assert "to do           2" in here("plan", *RUN[1:-1]).stdout
    (tmp_path / "pin.toml").write_text(PIN.replace("800.0", "810.0"))
    done = here(*RUN)
    assert (done.returncode, done.stderr.count("\n"), repr(pin) in done.stderr) == (3, 1, True)
    # From Python, and by a result's file, as points that failed are computed again.
    for rig in (pin, "results/scenes/scenes.nc"):
        assert studies.run("scenes", rig=rig, V=0.01, mu=[0.2, 0.4], F=9).sizes["mu"] == 2


def test_a_cut_off_for_the_beams_is_not_for_a_structure(here, pin, tmp_path):
    """Modes that act by their static compliance are far above all others; sticks are computed at 585 kHz."""
    n = 24
    chain = 1e7 * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    rows = {"normal": {n - 1: 1.0}, "tangential": {n - 2: 1.0}, "load": {n - 1: -1.0}}
    own = Structure.from_matrices(0.01 * np.eye(n), chain, **rows, damping_ratio=0.01, fmax=3e3)
    assert own.static
    values = {"V": 0.2, "F": 500.0, "mu": 0.3, "member": 1, "max_duration": 0.2, "min_duration": 0.05}
    data = studies.run("stick_time", rig=own, **values)
    assert (data["status"] == 1).all()
    assert np.isnan(data["cutoff"])


def test_maps_and_stability_of_a_structure(here, pin):
    done = here("run", "fig5", "--rig", "pin.toml", "--set", "mu=0:0.5:11", "-q")
    assert done.returncode == 0
    assert re.search(r"flutters from mu = 0\.2756 on, at 940 Hz", done.stdout)
    done = here("run", "stability", "--rig", "pin.toml", "--set", "mu=0:0.4:5", "-q")
    assert (done.returncode, "unstable at 2 of 5 points" in done.stdout) == (0, True)
    words = ("--x", "mu=0:0.4:5", "--quantity", "growth_rate,unstable_modes", "--rig", "pin.toml")
    assert here("map", *words, "-q").returncode == 0
    data = studies.open(f"growth-mu-rig{pin.digest[:8]}")
    assert data["unstable_modes"].values.tolist() == [0, 0, 0, 1, 1]


def test_what_was_read_is_shown(here, pin, tmp_path):
    done = here("structure", str(by_matrices(tmp_path, pin, 1.0)))
    assert (done.returncode, done.stderr) == (0, "\nwritten: results/structure/matrices.png\n")
    assert (tmp_path / "results" / "structure" / "matrices.png").stat().st_size > 20_000
    assert re.search(r"\n1 +500 .*\n2 +800 .*\n3 +1700 ", done.stdout)
    assert f"{pin.preload:.6g}" in done.stdout
    assert re.search(r"\n0.275\d* +94\d", done.stdout)
    assert "hint" not in done.stdout


PLATE = """
mass = "M.mtx"
stiffness = "K.mtx"
nodes = "rows.txt"
positions = "nodes.csv"
normal = "node 62, y"
tangential = "node 62, x"
load = { "node 64, y" = -1.0 }
damping_ratio = 0.002
fmax = 40e3
"""


@pytest.fixture
def own_plate(tmp_path):
    """A plate, clamped at node 12 and 14, whose nodes are columns of three: 22 to 24, 32 to 34, ..."""
    M, K = plate(5, 2, 0.05, 0.02)
    labels = [10 * column + row for column in range(1, 7) for row in (2, 3, 4)]
    for name, matrix in (("M.mtx", M), ("K.mtx", K)):
        io.mmwrite(tmp_path / name, matrix, symmetry="symmetric", precision=17)
    (tmp_path / "rows.txt").write_text("".join(f"{node} UX\n{node} UY\n" for node in labels[3:]))
    places = [f"{node}, {(node // 10 - 1) * 0.01:g}, {(node % 10 - 2) * 0.01:g}, 0" for node in labels[::-1]]
    (tmp_path / "nodes.csv").write_text("\n".join(places))
    (tmp_path / "plate.toml").write_text(PLATE)
    return Structure.read(tmp_path / "plate.toml")


def test_modes_are_written_back_and_move(here, own_plate, tmp_path):
    """Also at nodes without rows, which are clamped; what is written is read again."""
    pytest.importorskip("pyuff")
    done = here("structure", "plate.toml", "--fmax", "40kHz", "--at", "0.3", "--modes", "own.uff", "--vtu")
    frames = "plate-frames"
    assert (done.returncode, done.stderr) == (
        0, "\nwritten: results/structure/plate.png, own.uff, results/structure/plate.pvd\n"
    )  # fmt: skip
    assert len([*(tmp_path / "results" / "structure" / frames).glob("*.vtu")]) == 48
    assert here("structure", "plate.toml", "--fmax", "40kHz", "--at", "0.3", "--modes", "own.npz").returncode == 0
    arrays = np.load(tmp_path / "own.npz")
    modes = sliding_modes(own_plate, 0.0, 0.3, 40e3)
    assert arrays["sliding_frequency"] == pytest.approx(modes.frequency)
    assert arrays["sliding_shapes"] == pytest.approx(own_plate.displacement(modes.shape))
    clamped = arrays["positions"][:, 0] == 0.0
    assert (clamped.sum(), np.abs(arrays["shapes"][clamped]).max()) == (3, 0.0)
    assert arrays["nodes"].tolist()[:2] == [64, 63]
    # The tip moves as the contact does.
    assert arrays["shapes"][2, :2] == pytest.approx(
        np.stack([own_plate.tangential, own_plate.normal])[:, : len(own_plate.frequency)]
    )
    rows = [line for line in PLATE.splitlines() if line.split(" ")[0] in ("normal", "tangential", "load")]
    files = ["modes = 'own.uff'", "positions = 'nodes.csv'"]
    (tmp_path / "again.toml").write_text("\n".join([*files, *rows]))
    again = Structure.read(tmp_path / "again.toml")
    assert again.frequency == pytest.approx(own_plate.frequency, rel=1e-5)
    assert again.shapes == pytest.approx(own_plate.shapes, abs=1e-5 * np.abs(own_plate.shapes).max())
    assert again.nodes == pytest.approx(own_plate.nodes)
    assert again.numbers.tolist() == own_plate.numbers.tolist()


@pytest.mark.parametrize(
    ("file", "words", "message"),
    [
        ("pin.toml", ["--animate"], "it keeps no eigenvectors; give node_positions"),
        ("pin.toml", ["--modes", "pin.uff"], "it keeps no eigenvectors; give node_positions"),
        ("pin.toml", ["--modes", "pin.txt"], "it keeps no eigenvectors; give node_positions"),
        ("plate.toml", ["--modes", "pin.txt"], "it must be a file that ends in .npz, .uff or .unv"),
        ("plate.toml", ["--vtu", "--at", "0", "--fmax", "100"], "mu = 0: no mode below 100 Hz oscillates"),
        ("three.toml", [], "positions = 'three.csv': its lines must be node, x, y, z"),
        ("other.toml", [], "positions: no row is of its nodes, such as 7"),
        ("unnamed.toml", [], "positions: they need nodes or dofs_per_node"),
    ],
)
def test_what_cannot_move_is_one_line(here, pin, own_plate, tmp_path, file, words, message):
    (tmp_path / "three.csv").write_text("7, 1\n")
    (tmp_path / "other.csv").write_text("7, 1, 2, 3\n")
    for name in ("three", "other"):
        (tmp_path / f"{name}.toml").write_text(PLATE.replace("nodes.csv", f"{name}.csv"))
    unnamed = re.sub('"node .*?"', "0", PLATE.replace('nodes = "rows.txt"', ""))
    (tmp_path / "unnamed.toml").write_text(unnamed.replace("{ 0 =", '{ "0" ='))
    done = here("structure", file, *words)
    assert (done.returncode, message in done.stderr, done.stderr.count("\n")) == (2, True, 1), done.stderr
    assert not [*tmp_path.glob("pin.uff")]


@pytest.mark.parametrize(
    ("modes", "told"),
    [
        ([(500.0, 0.4, -0.9, -0.4)], "no motion: normal, tangential: they are parallel"),
        (
            [(500.0, 0.4, -0.9, 0.0), (900.0, 0.3, 0.9, 0.0), (1900.0, 0.0, 0.9, -0.2)],
            "no motion: load: it does not",
        ),
        (
            [(500.0, 0.4, -0.9, -0.4), (800.0, 0.1, -0.7, -0.1), (1700.0, 0.4, -0.4, 0.0)],
            "not unique from mu = 0.559",
        ),
    ],
)
def test_stability_is_shown_of_what_cannot_move(here, tmp_path, modes, told):
    names = ("frequency", "normal", "tangential", "load")
    rows = ", ".join(f"{{{', '.join(f'{n} = {v}' for n, v in zip(names, each, strict=True))}}}" for each in modes)
    (tmp_path / "own.toml").write_text(f"damping_ratio = 0.002\nmode = [{rows}]\n")
    done = here("structure", "own.toml")
    assert (done.returncode, done.stderr) == (0, "\nwritten: results/structure/own.png\n")
    assert told in done.stdout
    assert "jams: growth without oscillation from mu = " in done.stdout


def test_wrong_units_and_rows_are_hinted_at(pin, tmp_path):
    assert not list(hints(pin))
    (hint,) = hints(Structure.read(by_matrices(tmp_path, pin, 1e3)))
    assert "if the model is in mm, t, s, multiply mass and stiffness by 1000" in hint
    (tmp_path / "pin.toml").write_text(re.sub("(tangential =) -0.[94]|(normal =) 0.1", r"\1\2 0", PIN))
    (hint,) = hints(Structure.read(tmp_path / "pin.toml"))
    assert "no mode moves both gaps" in hint


@pytest.mark.parametrize(
    ("text", "words", "message"),
    [
        (PIN, ("--set", "theta=5"), "theta = "),
        (PIN, ("--set", "p1_length=60mm"), "p1_length = 0.06: a structure has no such number"),
        (PIN, ("--scatter", "head_mass=normal:3:0.1"), "head_mass = normal:3:0.1: a structure has no such number"),
        (PIN, ("--set", "V=-1e-3"), "V = -0.001: it must be above 0 with a structure"),
        (PIN.replace("normal =", "norml =", 1), (), "norml: there is none of this name"),
        (
            PIN.replace("normal = 0.1", "normal = 0").replace("normal = 0.4", "normal = 0"),
            (),
            "normal: it must not be",
        ),
        ("masss = 'M.mtx'", (), "masss: no such key"),
    ],
)
def test_what_cannot_be_is_one_line(here, tmp_path, text, words, message):
    (tmp_path / "pin.toml").write_text(text)
    done = here("run", "scenes", "--rig", "pin.toml", *words)
    # A new installation says first that it compiles: the default range of friction needs the structure's onset.
    lines = [line for line in done.stderr.splitlines() if not line.startswith("fiv: compiling")]
    assert (done.returncode, len(lines), message in lines[-1]) == (2, 1, True), done.stderr


def test_a_result_of_the_beams_takes_no_structure(here, pin):
    assert here("run", "fig5", "--set", "mu=0:0.2:3", "-q").returncode == 0
    done = here("run", "results/fig5/fig5.nc", "--rig", "pin.toml", "--out", "own")
    advice = "it is a result of the paper's beams; give a STUDY with --rig, such as fiv run fig5 --rig pin.toml"
    assert (done.returncode, done.stderr) == (2, f"fiv: results/fig5/fig5.nc: {advice}\n")
    done = here("structure", "results/fig5/fig5.nc")
    assert (done.returncode, "give one of a structure, or a FILE.toml" in done.stderr) == (2, True)


@pytest.mark.parametrize(
    "words", [("run", "scenes", "--set", "f=9"), ("map", "--x", "f=1:2:3", "--quantity", "regime")]
)
def test_only_parameters_of_a_structure_are_named(here, pin, words):
    done = here(*words, "--rig", "pin.toml")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert " V, " in done.stderr
    assert not re.search("p1_|p2_|theta|head_mass|contact_position|d1", done.stderr), done.stderr


@pytest.mark.parametrize("study", ["table4", "fig7", "table6", "robust", "stress"])
def test_what_needs_the_beams_says_so(here, pin, study):
    done = here("plan", study, "--rig", "pin.toml")
    assert (done.returncode, done.stderr.count("\n"), "is about the paper's beams" in done.stderr) == (2, 1, True)


def test_a_study_builds_its_structure_with_scikit_fem(here, tmp_path, forgetful, undrawn):
    shutil.copy(OWN, tmp_path)
    assert here("run", "pin_angle.py", "-q").returncode == 0
    data = xr.open_dataset("results/pin_angle/pin_angle.nc")
    # A beam of three quarters of the length, clamped (Euler-Bernoulli).
    bending = 1.8751**2 * 2e-3 / (2.0 * np.pi * 0.075**2) * np.sqrt(200e9 / 7800.0 / 12.0)
    assert data["bending_frequency"].values == pytest.approx(bending, rel=0.02)
    assert float(data["velocity_rms"][0]) > 3.0 * float(data["velocity_rms"][2])


def test_motion_over_numbers_of_a_structure(here, pin):
    """A scene at each value of a number is that of the structure with the value."""
    how = {"V": 0.02, "mu": 0.3, "F": 9.0, "duration": 0.3}
    words = [f"{name}={value}" for name, value in how.items()]
    words += ["frequency_3=1700,1750Hz", "damping_ratio_3=0.002,0.02"]
    line = [word for text in words for word in ("--set", text)]
    assert here("run", "scenes", "--rig", "pin.toml", *line, "-q").returncode == 0
    data = studies.open("scenes").squeeze(drop=True)
    assert data["velocity_rms"].sizes == {"frequency_3": 2, "damping_ratio_3": 2}
    for hertz, ratio in itertools.product((1700.0, 1750.0), (0.002, 0.02)):
        own = varied(pin, {"frequency_3": hertz, "damping_ratio_3": ratio})
        alone = studies.run("scenes", rig=own, out=f"{hertz:g}-{ratio:g}", **how).squeeze(drop=True)
        at = data.sel(frequency_3=hertz, damping_ratio_3=ratio)
        assert [float(at[name]) for name in STATISTICS] == [float(alone[name]) for name in STATISTICS]
    assert np.unique(data["velocity_rms"]).size == 4
    # A curve for each value of one of them.
    figure = general.draw(studies.open("scenes"))
    labels = figure.axes[0].get_legend_handles_labels()[1]
    assert labels[:2] == ["damping ratio 3 = 0.002", "damping ratio 3 = 0.02"]


def test_sensitivity_of_a_structure_names_its_modes(here, pin):
    done = here("run", "sensitivity", "--rig", "pin.toml", "-q")
    assert (done.returncode, "frequency 3" in done.stdout, "damping 1" in done.stdout) == (0, True, True)
    at = studies.open("sensitivity").sel(pair=1).squeeze()
    assert at["onset_mu"].values == pytest.approx(flutter_onsets(pin, 0.0).mu[0], rel=1e-12)
    # Both frequencies that meet move the onset, damping hardly.
    assert (abs(at["elasticity_mu"].sel(parameter=["frequency_1", "frequency_2"])) > 0.1).all()


def test_numbers_of_a_structure_are_axes_and_have_sensitivities(here, pin):
    done = here("map", "--x", "frequency_3=1695,1700Hz", "--quantity", "onset_mu", "--rig", "pin.toml", "-q")
    assert done.returncode == 0
    mapped = studies.open(f"onset-frequency_3-rig{pin.digest[:8]}")["onset_mu"].values
    data = studies.run("sensitivity", rig=pin)
    # A frequency as a parameter keeps the damping ratio; its derivative keeps the damping.
    slope = data["elasticity_mu"].sel(pair=1, parameter=["frequency_3", "damping_3"]).sum()
    assert mapped[1] == pytest.approx(float(data["onset_mu"].sel(pair=1)[0, 0]), rel=1e-9)
    assert (mapped[1] - mapped[0]) / mapped[1] * 340.0 == pytest.approx(float(slope), rel=0.01)
    changes = 100.0 * data["change_mu"] / data["onset_mu"]
    np.testing.assert_allclose(changes.sel(pair=1), data["elasticity_mu"].sel(pair=1), rtol=0.03, atol=2e-3)
    # One value of it, and damping of one mode, are of the structure that is computed.
    words = ("--set", "mu=0.2,0.3", "--set", "frequency_3=1600Hz", "--set", "damping_ratio_2=0.01")
    assert here("run", "fig5", "--rig", "pin.toml", *words, "-q").returncode == 0
    other = varied(pin, {"frequency_3": 1600.0, "damping_ratio_2": 0.01})
    np.testing.assert_array_equal(studies.open("fig5")["onset_mu"], flutter_onsets(other, 0.0, mu_max=0.3).mu)
    done = here("run", "fig5", "--rig", "pin.toml", "--set", "frequenzy_2=3", "-q")
    assert (done.returncode, "did you mean frequency_2?" in done.stderr, done.stderr.count("\n")) == (2, True, 1)
