"""What moves: frames against the physics they show, films that move, and series that other programs read."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from fivcore import Rig, Structure, node_positions, sliding_modes
from studies import registry
from studies.answering import results
from studies.physics.phases import SEPARATION
from studies.plotting import moving
from sweeps import InputError
from tests import HOME

REFERENCE = HOME / "results" / "reference"
TIP, BELOW = 30, 79


def stored(name, folder=REFERENCE):
    return results.open_dataset(folder / name / f"{name}.nc")


def test_the_unstable_mode_keeps_its_contact_closed_and_turns_once():
    dataset = stored("fig6")
    (shown,) = registry.load("fig6").animate(dataset)
    assert np.linalg.norm(shown.moved, axis=-1).max() == pytest.approx(1.0, abs=0.01)
    assert shown.moved[:, TIP, 1] == pytest.approx(shown.moved[:, BELOW, 1], abs=1e-9)
    assert shown.moved.mean(axis=0) == pytest.approx(0.0, abs=1e-12)
    shape = [dataset[f"shape_x_{part}"].values for part in ("real", "imag")]
    unit = shown.moved[0, TIP, 0] / shape[0][TIP]
    assert shown.moved[0, :, 0] == pytest.approx(unit * shape[0])
    assert shown.moved[12, :, 0] == pytest.approx(-unit * shape[1])
    assert shown.tip == TIP
    assert "slowed 5604 times" in shown.caption


def test_the_contact_is_that_of_the_window():
    dataset = stored("contact")
    shown = [*registry.load("contact").animate(dataset)]
    assert len(shown) == 2
    for k, each in enumerate(shown):
        point = dataset.isel(V=k)
        parts = np.lib.stride_tricks.sliding_window_view(point["normal_force"].values, len(each.moved))
        (first,) = np.flatnonzero((parts == each.series["normal force / N"]).all(axis=1))
        window = point.isel(elapsed=slice(first, first + len(each.moved)))
        assert np.array_equal(each.state, window["state"])
        steps = np.diff(each.moved[:, 2, 0])
        assert steps == pytest.approx(np.diff(window["slip_displacement"].values), abs=1e-12)
        assert each.seconds == pytest.approx(2.0 / float(point["dominant_frequency"]), rel=0.01)
    failed = dataset.assign(normal_force=dataset["normal_force"].where(dataset["V"] > 3e-3))
    assert len([*moving.contact(failed)]) == 1


def test_beams_under_the_forces_of_a_limit_cycle_slip_and_part_as_it_does():
    """The response to stored forces, in all modes, has the gaps that the simulated cycle has."""
    dataset = stored("contact", REFERENCE / "identified")
    *_, shown = moving.contact(dataset)
    point = dataset.isel(V=1)
    N, ratio = (point[f"cycle_{name}"].values for name in ("normal_force", "apparent_friction"))
    rig = moving.with_numerical_damping(results.rig_of(dataset), "fast", "published")
    moved = moving.beams_under(rig, 5.0, hertz := float(point["cycle_frequency"]), N, N * ratio)
    slip, gap = (moved[:, TIP] - moved[:, BELOW]).T
    wanted = point["cycle_slip_displacement"].values + float(point["V"]) * np.arange(1000) / 1000 / hertz
    assert slip == pytest.approx(wanted - wanted.mean() + slip.mean(), abs=0.03 * np.ptp(wanted))
    closed = point["cycle_state"].values != SEPARATION
    assert gap[~closed].max() - np.median(gap[closed]) > 5.0 * np.ptp(gap[closed])
    assert shown.title == "Limit cycle at V = 5 mm/s, 2618 Hz, unstable"
    drawn = shown.moved[:, TIP, 1] - shown.moved[:, BELOW, 1]
    assert abs(np.median(drawn[shown.state != SEPARATION])) < 0.1 * drawn.max()
    shut = np.abs(shown.series["gap / μm"][shown.state != SEPARATION]).max()
    assert shown.note.endswith(f"the gap is computed from the forces to ±{shut:.2g} μm")
    assert (shown.series["gap / μm"][shown.state == SEPARATION] > -shut).all()


def structure(**more):
    shapes = np.random.default_rng(4).normal(size=(9, 3, 2))
    own = Structure.from_modes(
        [300.0, 900.0],
        [1.0, 0.5],
        [0.5, 1.0],
        load=[-1.0, -0.2],
        node_positions=np.eye(9)[:, :3],
        node_shapes=shapes,
    )
    return replace(own, **more)


def test_a_shape_says_which_modes_it_lacks():
    stiffness = 1e7 * (2.0 * np.eye(6) - np.eye(6, k=1) - np.eye(6, k=-1))
    rows = {"normal": {5: 1.0}, "tangential": {4: 1.0}, "load": {5: -1.0}, "node_positions": np.eye(2, 3)}
    for fmax, lacks in ((None, False), (500.0, True)):
        own = Structure.from_matrices(np.eye(6), stiffness, **rows, fmax=fmax)
        note = moving.sliding(own, sliding_modes(own, 0.0, 0.1, 400.0)).note
        assert note == "Not to scale" + f"; of the modes up to {own.frequency[-1]:.0f} Hz alone" * lacks


def test_a_structure_moves_in_its_fastest_growing_mode():
    own = structure()
    modes = sliding_modes(own, 0.0, 0.1)
    shown = moving.sliding(own, modes)
    wanted = own.displacement(modes.shape)[np.nanargmax(modes.growth_rate)].real
    assert shown.moved[0] / wanted == pytest.approx(shown.moved[0, 0, 0] / wanted[0, 0])
    with pytest.raises(InputError, match="no mode below 10 Hz oscillates"):
        moving.sliding(own, sliding_modes(own, 0.0, 0.1, 10.0))


def floats(array):
    return np.array(array.text.split(), float)


@pytest.mark.parametrize("edges", [None, np.array([[0, 1], [1, 5]])])
def test_a_frame_is_a_grid_that_paraview_reads(edges):
    own = structure(edges=edges)
    shown = moving.sliding(own, sliding_modes(own, 0.0, 0.1))
    root = ET.fromstring(moving.vtu(shown, 5))  # noqa: S314 - we wrote it
    piece = root.find("UnstructuredGrid/Piece")
    arrays = {array.get("Name"): floats(array) for array in piece.iter("DataArray")}
    lines = 0 if edges is None else len(edges)
    cells = lines or 9
    assert (piece.get("NumberOfPoints"), piece.get("NumberOfCells")) == ("9", str(cells))
    place = own.nodes + shown.scale * shown.moved[5]
    assert arrays["points"].reshape(9, 3) == pytest.approx(place)
    assert arrays["amplitude"] == pytest.approx(np.linalg.norm(shown.moved[5], axis=1))
    assert arrays["types"].tolist() == [3 if lines else 1] * cells
    assert arrays["offsets"].tolist() == [(2 if lines else 1) * k for k in range(1, cells + 1)]
    assert arrays["connectivity"].tolist() == (edges.ravel().tolist() if lines else [*range(9)])
    names = [f"a/{k}.vtu" for k in range(4)]
    series = ET.fromstring(moving.pvd(shown, names))  # noqa: S314 - we wrote it
    assert [each.get("file") for each in series.iter("DataSet")] == names
    steps = [float(each.get("timestep")) for each in series.iter("DataSet")]
    assert steps == pytest.approx(shown.seconds * np.arange(4) / 4)


@pytest.mark.parametrize("given", ["mode", "structure", "contact"])
def test_a_film_moves_and_lasts_as_long_as_its_caption_says(given, monkeypatch):
    monkeypatch.setattr(moving, "FILMED", 7)
    own = structure()
    shown = {
        "mode": lambda: next(moving.mode(stored("fig6"))),
        "structure": lambda: moving.sliding(own, sliding_modes(own, 0.0, 0.1)),
        "contact": lambda: next(moving.contact(stored("contact"))),
    }[given]()
    with Image.open(BytesIO(moving.film(shown, "gif"))) as film:
        assert film.n_frames == 7
        lasts = 0
        frames = set()
        for k in range(film.n_frames):
            film.seek(k)
            lasts += film.info["duration"]
            frames.add(film.convert("RGB").tobytes())
    assert len(frames) == film.n_frames
    assert lasts == pytest.approx(1e3 * shown.loop, rel=0.05)


def test_mp4_without_ffmpeg_is_one_line(monkeypatch):
    monkeypatch.setattr("matplotlib.animation.writers.is_available", lambda name: False)
    with pytest.raises(
        InputError, match="--animate mp4: ffmpeg is not installed; install it, or write --animate gif"
    ):
        moving.film(next(moving.mode(stored("fig6"))), "mp4")


def test_positions_of_the_beams_are_those_of_their_shapes():
    rig = Rig.of(p1_elements=12)
    assert len(moving.node_shapes(rig, 5.0)) == len(node_positions(rig, 5.0)) == 13 + 91
