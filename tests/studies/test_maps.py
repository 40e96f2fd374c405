"""Maps: what each quantity says, over which axes, what is computed once, and the command that makes them."""

import json
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import xarray as xr

from fivcore import Rig, Scene, critical_mu, flutter_onsets, glued_frequencies, sliding_modes
from fivcore.rig import P2
from studies.gallery.regimes import study as regimes
from studies.maps import maps
from studies.maps.quantities import AXES, QUANTITIES, RUN
from studies.motion import ensembles, transients
from studies.motion.jobs import run_all
from studies.plotting import figures, planes
from tests.helpers.boundaries import distances, refine
from tests.helpers.commands import written

MOTION = ("regime_certainty", *transients.SUMMARY)
SHORT = {"members": 2, "least": 0.05, "standard_error": 0.5, "most": 0.2}


def mapped(folder, x, y, quantity, fixed=None, halvings=0, **how):
    plane = maps.plane_of(x, y, halvings)
    sweep = maps.sweep_of(plane, quantity, fixed or {}, halvings, **how)
    return refine(sweep, maps.file_of(plane, quantity, folder), "sync")


STABLE_PLANE = ("theta=-10:20:9", "mu=0:0.5:9", "growth_rate")


def test_the_stability_boundary_is_that_of_the_full_grid_for_a_fifth_of_its_evaluations(tmp_path):
    """65 x 65 points from 9 x 9 by three halvings, and every boundary edge where the full grid has it."""
    plane = maps.plane_of(*STABLE_PLANE[:2], 3)
    full = np.nanmax(sliding_modes(Rig(), plane.xs[:, None], plane.ys, transients.BAND).growth_rate, axis=-1)
    data = mapped(tmp_path, *STABLE_PLANE, halvings=3)
    computed = data["status"].values == 1
    assert computed.size == 4225
    assert computed.sum() <= 0.2 * computed.size
    unstable, there = data["growth_rate"].values > 0.0, full > 0.0
    for one, other in ((unstable, there), (there, unstable)):
        assert len(distances(one, other)) > 100
        assert np.all(distances(one, other) <= 1.0)
    np.testing.assert_allclose(data["growth_rate"].values[computed], full[computed], rtol=1e-3, atol=1e-3)
    # The range is 10 700 1/s; of the interpolated points hardly one misses by more than the tolerance.
    assert np.mean(np.abs(data["growth_rate"].values - full) > 0.02 * np.ptp(full)) < 0.002


def growth(rig, theta):
    modes = sliding_modes(rig, theta, 0.2, transients.BAND)
    top = np.nanargmax(modes.growth_rate)
    return modes.growth_rate[top], modes.frequency[top], np.count_nonzero(modes.growth_rate > 0.0)


# Of a rig, its inclination as seen from the drive, and the paper's friction, from `fivcore` itself.
DIRECT = {
    "growth_rate": lambda rig, theta: growth(rig, theta)[0],
    "frequency": lambda rig, theta: growth(rig, theta)[1],
    "unstable_modes": lambda rig, theta: growth(rig, theta)[2],
    "onset_mu": lambda rig, theta: next(iter(flutter_onsets(rig, theta).mu), np.nan),
    "onset_frequency": lambda rig, theta: next(iter(flutter_onsets(rig, theta).frequency), np.nan),
    "critical_mu": lambda rig, theta: critical_mu(rig, theta),
    "glued_frequency_8": lambda rig, theta: glued_frequencies(rig, theta)[7],
}


@pytest.mark.parametrize("quantity", DIRECT)
def test_what_does_not_move_is_what_the_core_says(quantity, tmp_path):
    fixed = {"head_mass": 3.2, "p2_thickness": 0.0035, "V": -1e-3}
    data = mapped(tmp_path, "theta=-5,0,5,12", "contact_position=0.06,0.09", quantity, fixed)
    for theta, position in product(data["theta"].values, data["contact_position"].values):
        rig = Rig(p2=replace(P2, thickness=0.0035), head_mass=3.2, contact_position=float(position))
        # With V < 0 the drive sees the mirror image.
        expected = DIRECT[quantity](rig, -float(theta) + 0.0)
        found = float(data[quantity].sel(theta=theta, contact_position=position))
        np.testing.assert_allclose(found, expected if np.isfinite(expected) else np.nan, rtol=1e-3, atol=1e-3)


def test_a_motion_is_an_ensemble_of_its_scene(tmp_path):
    fixed = {name: RUN[name].value for name in ensembles.RUN} | {"method": "fast"} | SHORT
    rig, load = Rig(point_b=0.4), 4.5
    for quantity in ("velocity_rms", "regime", "stick_fraction"):
        data = mapped(tmp_path, "V=5e-3", "point_b=0.4", quantity, SHORT | {"F": load})
        scene = Scene(5e-3, 5.0, 0.2, load, rig)
        members = run_all(ensembles.ensemble(scene, SHORT["members"], fixed))
        found = regimes.ensemble_figures(members)[quantity]
        np.testing.assert_allclose(data[quantity].item(), found, rtol=1e-4)


def test_copies_of_a_scene_are_scaled(tmp_path):
    data = mapped(tmp_path, "V=2e-3,4e-3", "F=4.5,9", "velocity_rms", SHORT)
    half, whole = (float(data["velocity_rms"].sel(V=V, F=F)) for V, F in ((2e-3, 4.5), (4e-3, 9.0)))
    assert whole == pytest.approx(2.0 * half, rel=1e-5)


@pytest.mark.parametrize(
    ("x", "y", "quantity", "distinct"),
    [
        ("V=-4e-3,-2e-3,2e-3,4e-3", "F=2,4,9", "growth_rate", 2),
        ("V=-4e-3,-2e-3,2e-3,4e-3", "F=2.25,4.5,9", "velocity_rms", 8),
        ("V=1e-3,2e-3", "mu=0.1,0.2", "frequency", 2),
        ("mu=0.1,0.2,0.3", "theta=4,5", "glued_frequency_2", 2),
        ("V=-1e-3,1e-3", "theta=-5,0,5", "onset_mu", 3),
        ("V=-1e-3,1e-3", "theta=-5,0,5", "regime", 3),
        ("V=1e-3,2e-3", "p1_elements=20,30", "unstable_modes", 2),
        ("V=1e-3,2e-3", "d2=1e-8,2e-8", "velocity_rms", 4),
    ],
)
def test_what_makes_no_difference_is_computed_once(x, y, quantity, distinct):
    fixed = SHORT if quantity in MOTION else {}
    assert maps.sweep_of(maps.plane_of(x, y), quantity, fixed).plan().distinct == distinct


@pytest.mark.parametrize("name", AXES)
def test_every_number_can_be_an_axis(name):
    value = AXES[name].value
    other = "mu" if name != "mu" else "theta"
    spec = "5,6" if name == "theta" else f"{value:.12g},{1.2 * value:.12g}"
    plane = maps.plane_of(f"{name}={spec}", f"{other}=0.1,0.2")
    assert maps.sweep_of(plane, "growth_rate", {}).grid.shape == (2, 2)
    assert name in planes.SYMBOLS


def test_a_file_explains_itself(tmp_path):
    mapped(tmp_path, "V=log:1e-3:4e-3:3", "mu=0.2,0.3", "regime", SHORT | {"theta": 8.0}, 1)
    with xr.open_dataset(tmp_path / "map" / "regime-V-mu.nc") as plain:
        assert plain["regime"].dims == ("V", "mu")
        assert plain["regime"].attrs["flag_meanings"].split()[2] == "steady_sliding"
        told = json.loads(plain.attrs["configuration"])
    assert {"theta": 8.0, "members": 2, "quantity": "regime"}.items() <= told["constants"].items()
    assert {"variable": "regime", "levels": 1, "tolerance": None}.items() <= told["refinement"].items()


DRAWN = {
    "refined": (*STABLE_PLANE, {}, 1),
    "counts": ("theta=-4:8:9", "mu=0:0.4:9", "unstable_modes", {}, 2),
    "one row": ("theta=0:10:5", "mu=0.2", "frequency", {"head_mass": 3.0}, 1),
    "no value": ("theta=-10:-5:3", "contact_position=0.05,0.08", "onset_mu", {}, 0),
    "regime": ("V=log:5e-4:2e-2:3", "mu=0.1,0.3", "regime", SHORT, 1),
    "failed": ("theta=-40:40:5", "mu=1:5:5", "stick_fraction", SHORT, 1),
}


@pytest.mark.parametrize("case", DRAWN)
def test_every_map_has_its_figure_and_report(case, tmp_path):
    x, y, quantity, fixed, halvings = DRAWN[case]
    data = mapped(tmp_path, x, y, quantity, fixed, halvings)
    with figures.style():
        figure = maps.STUDY.draw(data)
        figure.draw_without_rendering()
    axes = figure.axes[0]
    names = [text.partition("=")[0] for text in (x, y)]
    # A number along one axis is a line, and a plane with one cell across has none.
    up = "frequency / Hz" if case == "one row" else planes.label(names[1])
    assert [axes.get_xlabel(), axes.get_ylabel()] == [planes.label(names[0]), up]
    report = maps.STUDY.report(data).splitlines()
    assert report[0].startswith(f"{quantity}: ")
    assert f"{data['status'].size} points: " in "\n".join(report)
    legend = [text.get_text() for each in figure.legends for text in each.get_texts()]
    assert ("failed" in legend) == ("failed" in case)
    assert any(text.startswith("computed (") for text in legend) == bool(np.any(data["status"] == 4))
    # The bar of a shaded map is a second axes.
    shaded = case in ("refined", "failed")
    assert len(figure.axes) == 1 + shaded


def test_the_papers_points_stand_where_its_rig_is_mapped(tmp_path):
    def legend(*what):
        with figures.style():
            figure = maps.STUDY.draw(mapped(tmp_path / str(len(list(tmp_path.iterdir()))), *what))
        return {text.get_text() for each in figure.legends for text in each.get_texts()}

    assert {"paper: tests", "paper: first unstable μ"} <= legend("theta=0,10", "mu=0:0.4:3", "growth_rate")
    assert "paper: first unstable μ" not in legend("theta=0,10", "mu=0:0.05:3", "growth_rate")
    assert "paper: tests" in legend("V=1e-3,5e-3", "mu=0.1,0.3", "stick_fraction", SHORT)
    assert "paper: tests" not in legend("V=1e-3,5e-3", "mu=0.1,0.3", "stick_fraction", SHORT | {"theta": 8.0})
    assert "paper: tests" not in legend("theta=0,10", "mu=0:0.4:3", "growth_rate", {"head_mass": 3.5})


# The command.

MAP = ("map", "--x", "theta=0:10:3", "--y", "mu=0:0.4:3", "--quantity", "growth_rate")


def test_the_command_leaves_file_figure_and_numbers(tmp_path, here):
    done = here(*MAP, "--refine", "2")
    assert done.returncode == 0, done.stderr
    assert written(tmp_path) == ["results/map/growth_rate-theta-mu.nc", "results/map/growth_rate-theta-mu.png"]
    assert "over θ / ° from 0 to 10 (9)" in done.stdout
    assert "81 points: " in done.stdout
    assert "refined         to 9 points (11.1 %) so far; " in done.stderr
    # Once more: nothing is computed.
    again = here(*MAP, "--refine", "2")
    assert again.stdout == done.stdout
    assert "to do           0" in again.stderr
    # It is found by its name, as a study is.
    state = json.loads(here("status", "growth_rate-theta-mu", "--json").stdout)
    assert state["state"] == "complete"
    assert state["done"] + state["interpolated"] == state["points"] == 81
    assert here("plot", "results/map/growth_rate-theta-mu.nc").stdout.strip().endswith("growth_rate-theta-mu.png")


def test_maps_that_differ_in_what_is_fixed_are_kept_beside_each_other():
    plane = maps.plane_of("theta=0,1", "mu=0,1")

    def name(**fixed):
        return maps.file_of(plane, "growth_rate", "there", fixed).name

    assert name(head_mass=3.0) == "growth_rate-theta-mu-head_mass=3.nc"
    assert name(head_mass=3.0, V=-1e-3) == name(V=-1e-3, head_mass=3.0) != name(head_mass=3.0)
    # At the value that it has anyway nothing else is asked for.
    assert name(F=9.0) == name() == "growth_rate-theta-mu.nc"
    # File systems allow 255 bytes, and other endings take the place of this one.
    many = {each: 1.1 * setting.value for each, setting in AXES.items() if each.startswith("p")}
    assert name(**many, F=1.0) != name(**many, F=2.0)
    assert len(name(**many, F=1.0)) < 220


def test_a_map_of_something_else_is_exit_3(tmp_path, here):
    assert here(*MAP, "-q", "--fix", "head_mass=3").returncode == 0
    taken = tmp_path / "results" / "map" / "growth_rate-theta-mu.nc"
    taken.with_name("growth_rate-theta-mu-head_mass=3.nc").rename(taken)
    before = taken.read_bytes()
    done = here(*MAP, "-q")
    assert done.returncode == 3
    assert done.stderr.strip().count("\n") == 0
    assert "has other results: head_mass = 3.0 there, 2.9434 here; start over with fresh" in done.stderr
    assert taken.read_bytes() == before


def test_failed_points_are_exit_1(tmp_path, here):
    short = [part for name, value in SHORT.items() for part in ("--fix", f"{name}={value}")]
    arguments = ("--x", "theta=40,41", "--y", "mu=0.2,5", "--quantity", "stick_fraction", *short)
    done = here("map", *arguments, "-q")
    assert done.returncode == 1
    limit = f"from {critical_mu(Rig(), 40.0):.6g} on"
    assert f"failed: theta = 40.0, mu = 5.0: ContactError: mu = 5: {limit}" in done.stderr
    assert "compute one of them again with: " in done.stderr


def test_help_lists_what_there_is_to_choose_from(here):
    done = here("map", "--help")
    assert done.returncode == 0
    assert {*MOTION, "onset_frequency", "glued_frequency_8"} <= set(QUANTITIES)
    words = set(done.stdout.replace(",", " ").split())
    assert {*QUANTITIES, *AXES, *RUN} <= words


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"--quantity": "growth"}, "quantity = 'growth': there is no such quantity; did you mean growth_rate?"),
        ({"--x": "thata=0:10:3"}, "--x thata: there is no such axis; did you mean theta? the axes are V, theta"),
        ({"--x": "mu=0:0.4:3"}, "--y mu: it is the axis --x already"),
        ({"--x": "theta"}, "--x 'theta': it must be AXIS=SPEC, for example mu=0:0.5:101"),
        ({"--y": "mu=-0.1,0.2"}, "mu = -0.1: it must be a number from 0 to"),
        ({"--x": "p1_elements=10,11", "--refine": "1"}, "p1_elements = 10.5: it must be a whole number"),
        ({"--x": "contact_position=0.05:0.2:4"}, "contact_position = 0.2: it must be above 0 and at most"),
        ({"--quantity": "onset_mu"}, "--y mu: onset_mu is found over all mu, which cannot be an axis then"),
        ({"--fix": "mo=0.2"}, "--fix mo: there is no such axis or setting; did you mean"),
        ({"--fix": "members=3"}, "--fix members: growth_rate does not depend on it"),
        ({"--fix": "mu=0.2"}, "--fix mu: it is an axis of this map; leave it out"),
        ({"--fix": "V=1e-3,2e-3"}, "--fix 'V=1e-3,2e-3': V must have one value; what is to vary is --x or --y"),
        ({"--fix": "head_mass=-1"}, "head_mass = -1.0: it must be a number from 0 to"),
        ({"--tolerance": "0.01"}, "tolerance = 0.01: it is for a refined map; say --refine N as well"),
        ({"--refine": "1", "--tolerance": "0"}, "tolerance = 0.0: it must be a number from 1e-12"),
        (
            {"--refine": "1", "--tolerance": "0.1", "--quantity": "unstable_modes"},
            "tolerance = 0.1: unstable_modes has whole numbers, between which nothing is interpolated",
        ),
        ({"--refine": "12"}, "8193 x 8193 values are 67125249 points: it must be at most 4000000"),
        ({"--quantity": "regime", "--fix": "members=2.5"}, "members = 2.5: it must be a whole number from 1 to"),
        ({"--quantity": "regime", "--fix": "most=0"}, "most = 0.0: it must be a number from"),
        ({"--quantity": "regime", "--fix": "cutoff=-1"}, "cutoff = -1.0: it must be a number from 0"),
    ],
)
def test_wrong_input_is_one_clear_line(tmp_path, here, changes, message):
    told = dict(zip(MAP[1::2], MAP[2::2], strict=True)) | changes
    done = here("map", *(part for pair in told.items() for part in pair))
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.strip().count("\n") == 0
    assert done.stdout == ""
    assert written(tmp_path) == []


@pytest.mark.parametrize("verb", ["list", "plan", "run"])
def test_a_map_is_no_study_to_run(tmp_path, here, verb):
    done = here(verb, "map")
    assert done.returncode == 2
    assert done.stderr == "fiv: STUDY = 'map': maps are made by a command of their own: fiv map --help tells how\n"
    assert done.stdout == ""
    assert written(tmp_path) == []
