"""The accessor `.fiv`: rows, figures, and the scenes behind points, which run again as they were run."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.figure import Figure

import studies
import studies.query.accessor  # registers `.fiv`
from fivcore import Rig, Scene, simulate
from studies import registry
from studies.maps import maps
from studies.query.query import query
from tests import HOME
from tests.helpers.boundaries import refine

RESULTS = HOME / "results" / "reference"
# What a short run has figures of.
FIGURES = ("velocity_rms", "stick_fraction", "max_normal_force", "first_slip_time")


def kept(name):
    return studies.open(str(RESULTS / name / f"{name}.nc"))


def run(name, record=(), sample_rate=None, **given):
    """A study in memory, without its figure."""
    return registry.load(name).sweep(given, record=record, sample_rate=sample_rate).plan().run("sync")


def test_importing_studies_is_light_and_open_gives_the_accessor(tmp_path):
    program = (
        "import sys, studies\n"
        "assert not {'xarray', 'numpy', 'fivcore'} & set(sys.modules)\n"
        f"data = studies.open({str(RESULTS / 'fig5' / 'fig5.nc')!r})\n"
        "assert not {'matplotlib', 'numba'} & set(sys.modules)\n"
        "print(len(data.fiv.query('mu == 0.2 and growth_rate > 0')))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path)
    assert (done.stdout, done.stderr) == ("2\n", "")


def test_query_is_that_of_the_command():
    data = kept("regimes")
    how = {"show": ["V", "velocity_rms"], "sort": "-velocity_rms", "limit": 4}
    pd.testing.assert_frame_equal(data.fiv.query("mu > 0.2", **how), query(data, "mu > 0.2", **how))
    assert data.fiv.query(by="regime").equals(query(data, by="regime"))
    with pytest.warns(UserWarning, match="the nearest is 5") as told:
        data.fiv.query("theta == 6")
    assert told[0].filename == __file__


def test_plot_gives_a_figure_or_writes_one(tmp_path):
    data = kept("table4")
    assert isinstance(data.fiv.plot(), Figure)
    for name, form, written, begins in (
        ("two.svg", None, "two.svg", b"<?xml"),
        ("three", None, "three.png", b"\x89PNG"),
        ("four", "pdf", "four.pdf", b"%PDF"),
    ):
        assert data.fiv.plot(tmp_path / name, form) == tmp_path / written
        assert (tmp_path / written).read_bytes().startswith(begins)
    with pytest.raises(ValueError, match="format = 'jpg': it must be one of png, svg, pdf"):
        data.fiv.plot(tmp_path / "five.jpg")
    with pytest.raises(ValueError, match=r"^dataset: it lacks frequency, .*; make it whole with: fiv run table4"):
        data.drop_vars("frequency").fiv.plot(tmp_path / "six.png")
    assert len(list(tmp_path.iterdir())) == 3
    with pytest.raises(ValueError, match="'mine' is a study of a file of one's own, or none; name the file"):
        data.assign_attrs(sweep="mine").fiv.plot()


def test_the_scene_behind_a_point():
    with xr.open_dataset(RESULTS / "fig5" / "fig5.nc") as plain:
        assert plain.fiv.scene(mu=0.1 + 0.2) == Scene(2e-3, 5.0, 0.3, 9.0)
    assert kept("stability").fiv.scene(theta=7.5000001, mu=0.25) == Scene(2e-3, 7.5, 0.25, 9.0)
    assert kept("table6").fiv.scene(theta=-10) == Scene(2e-3, -10.0, 0.2, 9.0)
    # Axes with one value need not be named; what a table shows in six digits is found.
    regimes = kept("regimes")
    V = float(regimes["V"][17])
    assert regimes.fiv.scene(V=float(f"{V:.6g}"), mu=0.2) == Scene(V, 5.0, 0.2, 9.0)
    assert regimes.isel(V=17).fiv.scene(mu=0.2) == Scene(V, 5.0, 0.2, 9.0)
    # Nor does the member or the mode make a scene.
    sticks = kept("stick_time")
    assert sticks.fiv.scene(V=1e-3, mu=0.15, F=18) == sticks.fiv.scene(V=1e-3, mu=0.15, F=18, member=3)
    assert kept("table4").fiv.scene().rig == Rig(contact_position=0.085, head_mass=2.94344983808)


def test_the_rig_is_that_of_the_file(tmp_path):
    data = run("fig5", mu=[0.1, 0.2], theta=8.0, d1=40.0, p1_length=0.06, p2_elements=60)
    scene = data.fiv.scene(mu=0.2)
    assert (scene.theta, scene.mu) == (8.0, 0.2)
    rig = Rig()
    assert scene.rig == replace(rig, p1=replace(rig.p1, length=0.06), p2=replace(rig.p2, elements=60), d1=40.0)
    # Of a map an axis may be a number of the rig.
    plane = maps.plane_of("d1=10:60:3", "p2_thickness=0.002:0.004:3")
    sweep = maps.sweep_of(plane, "glued_frequency_2", {"theta": 8.0, "contact_position": 0.07})
    mapped = refine(sweep, tmp_path / "map.nc", "sync")
    scene = mapped.fiv.scene(d1=35, p2_thickness=0.003)
    assert scene == Scene(2e-3, 8.0, 0.2, 9.0, Rig(contact_position=0.07, d1=35.0))
    with pytest.raises(ValueError, match="study map has no motion in time"):
        mapped.fiv.run_options(d1=35, p2_thickness=0.003)


@pytest.mark.parametrize(
    ("name", "point", "told"),
    [
        ("fig5", {}, "mu: give one of its 501 values, from 0.0 to 0.5"),
        ("fig5", {"mu": 0.2005}, "mu = 0.2005: the axis has no such value; the nearest is 0.2"),
        ("fig5", {"mu": 7}, "mu = 7: the axis has no such value; the nearest is 0.5"),
        ("fig5", {"nu": 1}, "nu = 1: there is no such axis; did you mean mu?"),
        ("fig5", {"mu": "a"}, "mu = 'a': it must be one number"),
        ("fig5", {"mu": [0.1]}, r"mu = \[0.1\]: it must be one number"),
        ("fig5", {"mu": True}, "mu = True: it must be one number"),
        ("accuracy", {"scene": 0}, "the points of study accuracy are not scenes"),
        ("stress", {"case": 1}, "the points of study stress are not scenes"),
    ],
)
def test_points_that_are_none(name, point, told):
    with pytest.raises(ValueError, match=told):
        kept(name).fiv.scene(**point)


def again(data, point, **which):
    """The summary of the run behind a point, and the point."""
    found = simulate(data.fiv.scene(**point), **data.fiv.run_options(**point, **which))
    return found, data.sel(point | which, method="nearest").squeeze()


def same(data, point, names=FIGURES, **which):
    found, at = again(data, point, **which)
    known = [name for name in names if name in at and np.isfinite(at[name])]
    for name in known:
        expected = at[name].values
        assert found.summary[name] == pytest.approx(expected, rel=1e-5 if expected.dtype == np.float32 else 1e-14)
    return known


def test_the_run_behind_a_point_is_repeated():
    how = {"duration": 0.1, "settle": 0.02, "ramp": 2e-3, "cutoff": 40e3}
    scenes = run("scenes", V=[2e-3, -5e-3], theta=[5.0, 10.0], mu=0.2, F=[4.5, 9.0], d1=40.0, leap=0.0, **how)
    point = {"V": -5e-3, "theta": 10.0, "F": 4.5}
    assert same(scenes, point) == list(FIGURES)
    own = {"method": "fast", "leap": False, "numerical_damping": "none"}
    assert scenes.fiv.run_options(**point) == how | own
    # The same scene run otherwise is another motion.
    found, at = again(scenes, point)
    other = simulate(found.scene, 0.1, ramp=1e-3, settle=0.02)
    assert other.summary["first_slip_time"] != at["first_slip_time"]


def test_series_are_repeated_too():
    data = run("fig7", V=5e-3, duration=0.06)
    found, at = again(data, {})
    assert same(data, {}) == ["first_slip_time"]
    assert found.time[1] - found.time[0] == pytest.approx(1.0 / (8 * 25e3), rel=0.5)
    given = {"V": 5e-3, "theta": 5.0, "mu": 0.2, "F": 9.0, "duration": 0.05}
    data = run("scenes", record=("normal_force",), sample_rate=1e4, **given)
    found, at = again(data, {})
    expected = np.interp(data["elapsed"], found.time, found.normal_force)
    np.testing.assert_allclose(at["normal_force"], expected, rtol=1e-4, atol=1e-4)


def test_the_members_of_an_ensemble_are_repeated():
    table = run("table6", theta=[5.0, 10.0], V=4e-3, members=2, most=0.2, least=0.01, load_ups=0.1)
    names = ("velocity_rms", "stick_fraction", "slip_fraction")
    for member in (1, 2):
        found, at = again(table, {"theta": 10.0}, member=member)
        for name in names:
            assert found.summary[name] == at[f"member_{name}"].item() > 0.0
    assert table.fiv.run_options(theta=10)["ramp"] == 1e-3
    assert table.fiv.run_options(theta=10)["duration"] == float(table["duration"].sel(theta=10))
    for member in (0, 3, 1.5):
        with pytest.raises(ValueError, match=f"member = {member}: it must be a whole number from 1 to 2"):
            table.fiv.run_options(theta=10, member=member)
    regimes = run("regimes", V=8e-3, mu=0.2, theta=[5.0], F=18.0, members=1, most=0.2, least=0.01)
    assert same(regimes, {}, names[:2]) == list(names[:2])
    assert regimes.fiv.run_options()["duration"] == pytest.approx(regimes["duration"].item(), rel=1e-6)


def test_members_that_are_points_are_repeated():
    sticks = run("stick_time", V=2e-3, mu=0.2, F=[9.0, 18.0], member=[1, 2], most=0.3, least=0.05)
    found, at = again(sticks, {"F": 18.0, "member": 2})
    stuck = at["stick_time"].values
    np.testing.assert_allclose(stuck[np.isfinite(stuck)], found.summary["stick_times"], rtol=1e-4)
    assert len(found.summary["stick_times"]) > 0
    other, _ = again(sticks, {"F": 18.0, "member": 1})
    assert not np.array_equal(other.summary["stick_times"], found.summary["stick_times"])
    assert sticks.fiv.run_options(F=18.0) == sticks.fiv.run_options({"F": 18.0, "member": 1})
    assert sticks.fiv.scene({"F": 18.0}) == sticks.fiv.scene(F=18.0)


def test_a_map_of_motion_is_repeated(tmp_path):
    plane = maps.plane_of("V=1e-3,8e-3", "mu=0.1,0.3")
    fixed = {"members": 1.0, "most": 0.12, "theta": 8.0, "F": 4.5}
    data = maps.sweep_of(plane, "velocity_rms", fixed).plan(tmp_path / "map.nc").run("sync")
    known = [same(data, {"V": V, "mu": mu}, ("velocity_rms",)) for V in (1e-3, 8e-3) for mu in (0.1, 0.3)]
    assert ["velocity_rms"] in known


def test_what_did_not_run_has_no_options():
    with pytest.raises(ValueError, match="study fig5 has no motion in time"):
        kept("fig5").fiv.run_options(mu=0.2)
    with pytest.raises(ValueError, match="member = 2: each point of this study is one run"):
        kept("fig7").fiv.run_options(V=2e-3, member=2)
