"""Animations: a mode, or the contact through a period, as frames for the page, films and ParaView."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from fivcore import Rig, SlidingModes, Structure, node_positions, node_shapes, with_numerical_damping
from studies.answering import results
from studies.declaring import labels
from studies.motion import run
from studies.physics import phases
from studies.physics.phases import SEPARATION, SLIP, STICK
from studies.plotting import figures, planes
from sweeps import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = np.ndarray[Any, Any]
# Frames of a mode, and at most of a film; how long a period is shown, s; the largest displacement as drawn, of the
# extent; speeds at most; one frame of so many samples of a limit cycle.
FRAMES, FILMED, SHOWN, DRAWN, COLUMNS, EVERY = 48, 100, 2.0, 0.045, 3, 5
# Colour and marker of the contact.
STATES = {SEPARATION: (figures.ORANGE, "o"), STICK: (figures.BLACK, "s"), SLIP: (figures.BLUE, "o")}
# VTK's types of a vertex and a line, by their number of nodes.
VTK_TYPES = {1: 1, 2: 3}


@dataclass(frozen=True, eq=False)
class Moving:
    """Nodes that move, at evenly spaced instants.

    Attributes
    ----------
    title, note : str
        What moves; how it is drawn.
    seconds, loop : float
        The time that all frames take, and how long they are shown, s.
    place, moved : ndarray, (nodes, 3) and (frames, nodes, 3)
        Undeformed, m; displacement, m, or of a mode in units of the largest.
    scale : float
        Factor of displacements as drawn.
    lines : sequence of (str, ndarray)
        Names and the nodes that a line goes through; without any the nodes are drawn.
    tip : int or None
        The node C, in the colour of `state`, (frames,), codes as in `run.STATES`.
    series : mapping of str to ndarray, (frames,)
        Drawn over time, in readers' units.
    """

    title: str
    note: str
    seconds: float
    loop: float
    place: Array
    moved: Array
    scale: float
    lines: Sequence[tuple[str, Array]]
    tip: int | None = None
    state: Array = field(default_factory=lambda: np.array([], int))
    series: Mapping[str, Array] = field(default_factory=dict)

    @property
    def caption(self) -> str:
        """Title, how it is drawn, and by how much it is slowed."""
        return f"{self.title}. {self.note}; slowed {labels.number(self.loop / self.seconds)} times."

    @property
    def drawn(self) -> Array:
        """Nodes in the plane of the largest extents, undeformed and then as drawn, (1 + frames, nodes, 2)."""
        plane = np.sort(np.argsort(-np.ptp(self.place, axis=0), kind="stable")[:2])
        return np.stack([self.place, *(self.place + self.scale * self.moved)])[..., plane]


def oscillating(
    title: str, hertz: float, place: Array, shape: Array, lines: Sequence[tuple[str, Array]], **more: Any
) -> Moving:
    """A mode with the complex `shape`, (nodes, 3), through a period."""
    phases = np.exp(2j * np.pi * np.arange(FRAMES) / FRAMES)
    shape = shape / np.linalg.norm(np.abs(shape), axis=-1).max()
    scale = DRAWN * float(np.ptp(place, axis=0).max())
    moved = (phases[:, None, None] * shape).real
    return Moving(title, "Not to scale", 1.0 / hertz, SHOWN, place, moved, scale, lines, **more)


def mode(dataset: xr.Dataset) -> Iterator[Moving]:
    """The mode whose shape is stored on `node`."""
    place = np.stack([dataset["node_x"], dataset["node_y"], 0.0 * dataset["node_x"]], axis=1)
    shape = [dataset[f"shape_{x}_real"].values + 1j * dataset[f"shape_{x}_imag"].values for x in "xy"]
    beam, hertz = dataset["beam"].values, float(dataset["lock_in_frequency"])
    title = f"Unstable mode at lock-in, μ = {float(dataset['lock_in_mu']):.4f}, {hertz:.0f} Hz"
    of: Any = {"tip": int(np.flatnonzero(beam == 1)[-1]), "state": np.full(FRAMES, SLIP)}
    yield oscillating(title, hertz, place, np.stack([*shape, 0.0 * shape[0]], axis=1), _beams(beam), **of)


def _beams(beam: Array) -> list[tuple[str, Array]]:
    return [(f"P{number}", np.flatnonzero(beam == number)) for number in (1, 2)]


def sliding(own: Structure, modes: SlidingModes) -> Moving:
    """The sliding mode of a structure with positions that grows fastest, or decays slowest, at one mu."""
    shape = own.displacement(modes.shape)
    if not np.any(oscillates := modes.frequency > 0.0):
        raise InputError(f"mu = {modes.mu:g}: no mode below {modes.fmax:g} Hz oscillates; give another mu or fmax")
    k = int(np.argmax(np.where(oscillates, modes.growth_rate, -np.inf)))
    where = f"μ = {labels.number(float(modes.mu))}, {modes.frequency[k]:.0f} Hz"
    title = f"Mode at {where}, growth rate {labels.number(modes.growth_rate[k])} 1/s"
    edges = () if own.edges is None else own.edges
    found = oscillating(title, modes.frequency[k], own.nodes, shape[k], [("", pair) for pair in edges])
    # The static ones have no shape.
    left_out = f"; of the modes up to {own.frequency[-1]:.0f} Hz alone" if own.static else ""
    return replace(found, note=found.note + left_out)


def contact(dataset: xr.Dataset) -> Iterator[Moving]:
    """The contact through two periods at each speed, and both beams on the limit cycle if there is one."""
    for k in planes.subset(dataset.sizes["V"], COLUMNS):
        point = dataset.isel(V=k)
        if not np.isfinite(point["normal_force"].values).all():
            continue
        speed, theta = labels.named("V", point["V"]), np.radians(float(point["theta"]))
        first, last, one = phases.periods(point)
        window = point.isel(elapsed=slice(first, last))
        slip, step = window["slip_displacement"].values, float(np.diff(window["elapsed"].values).mean())
        slip = slip - 0.5 * (slip.min() + slip.max())
        wide = 0.75 * float(np.ptp(slip)) or 1e-9
        place = wide * np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3])
        place[3, :2] = 0.6 * wide * np.array([np.sin(theta), np.cos(theta)])
        moved = np.zeros((len(slip), 4, 3))
        moved[:, 2:, 0] = slip[:, None]
        title, lines = f"Contact at {speed}", [("P1", np.array([3, 2])), ("P2", np.array([0, 1]))]
        note = f"Seen from P2, {2e6 * wide:.2g} μm of which are shown; the gap is not stored"
        loop = SHOWN * (last - first) / (one - first)
        yield Moving(title, note, len(slip) * step, loop, place, moved, 1.0, lines, 2, **_forces(window))
        if np.isfinite(float(point["cycle_frequency"])) and not results.structure_in(dataset):
            yield on_cycle(dataset, point)


def _forces(point: xr.Dataset, of: str = "") -> dict[str, Any]:
    """State and series of a contact."""
    N, speed = (point[f"{of}{name}"].values for name in ("normal_force", "slip_velocity"))
    series = {"normal force / N": N, "slip velocity / (mm/s)": 1e3 * speed}
    return {"state": point[f"{of}state"].values.astype(int), "series": series}


def on_cycle(dataset: xr.Dataset, point: xr.Dataset) -> Moving:
    """Both beams on the limit cycle: their response to its stored contact forces."""
    theta, hertz = float(point["theta"]), float(point["cycle_frequency"])
    rig: Any = with_numerical_damping(results.rig_of(dataset), "fast", str(point["numerical_damping"].values))
    N, every = point["cycle_normal_force"].values, slice(None, None, EVERY)
    displacement = beams_under(rig, theta, hertz, N, N * point["cycle_apparent_friction"].values)[every]
    of = _forces(point.isel(phase=every), "cycle_")
    beam = np.repeat([1, 2], [rig.p1.elements + 1, rig.p2.elements + 1])
    place = np.pad(node_positions(rig, theta), ((0, 0), (0, 1)))
    moved, tip = np.pad(displacement, ((0, 0), (0, 0), (0, 1))), rig.p1.elements
    below = int(np.abs(place[tip + 1 :, 0]).argmin()) + tip + 1
    # Each beam moves about its mean; P1 touches P2 where the contact is closed.
    closed = of["state"] != SEPARATION
    moved[:, : tip + 1, 1] -= np.median((moved[:, tip, 1] - moved[:, below, 1])[closed])
    of["series"]["gap / μm"] = gap = 1e6 * (moved[:, tip, 1] - moved[:, below, 1])
    scale = DRAWN * float(np.ptp(place, axis=0).max()) / float(np.abs(moved).max())
    kind = "stable" if float(point["cycle_multiplier"]) < 1.0 else "unstable"
    title = f"Limit cycle at {labels.named('V', point['V'])}, {hertz:.0f} Hz, {kind}"
    note = f"Displacements from the mean are drawn {labels.number(scale)} times larger"
    # It follows from the forces that are stored; in contact it is 0 but for the harmonics that these lack.
    note += f"; the gap is computed from the forces to ±{np.abs(gap[closed]).max():.2g} μm"
    return Moving(title, note, 1.0 / hertz, SHOWN, place, moved, scale, _beams(beam), tip, **of)


def beams_under(rig: Rig, theta: float, hertz: float, N: Array, T: Array) -> Array:
    """Displacement of the beams' nodes, (instants, nodes, 2), m, under a periodic contact force, without its mean.

    N and T are given evenly over a period. Each harmonic acts on the modes, q'' + c q' + p q = n N + t T.
    """
    own, (N, T) = Structure.of(rig, theta), np.fft.rfft([N, T])[..., None]
    phi = 2j * np.pi * hertz * np.arange(1, N.shape[0])[:, None]
    q = (own.normal * N[1:] + own.tangential * T[1:]) / (own.stiffness + phi * (own.damping + phi))
    moved = np.einsum("hm,ndm->hnd", q, node_shapes(rig, theta), optimize=True)
    return np.fft.irfft(np.concatenate([np.zeros_like(moved[:1]), moved]), axis=0)


def draw(moving: Moving) -> tuple[Figure, Callable[[int], None]]:
    """A figure of a moving structure, and a function that draws a frame into it."""
    from matplotlib.collections import LineCollection

    (still, *drawn), series, state = moving.drawn, moving.series, moving.state
    low, high = np.min([still, *drawn], axis=(0, 1)), np.max([still, *drawn], axis=(0, 1))
    edge = 0.06 * float((high - low).max())
    tall = float(np.clip(14.0 * (high[1] - low[1] + 2.0 * edge) / (high[0] - low[0] + 2.0 * edge), 4.0, 14.0))
    figure, (scene, *strips) = figures.panels(1 + len(series), 1, tall + 1.5, *[2.6] * len(series))
    scene.set(xlim=(low[0] - edge, high[0] + edge), ylim=(low[1] - edge, high[1] + edge), aspect="equal")
    scene.set_axis_off()
    figure.suptitle(moving.caption)
    look: Any = {"colors": figures.GREY, "linewidths": 0.7, "linestyles": "--"}
    scene.add_collection(LineCollection([still[nodes] for _, nodes in moving.lines], **look))
    lines = LineCollection([], colors=figures.BLACK, linewidths=2.0 if len(moving.lines) < 9 else 0.6)
    scene.add_collection(lines)
    marker: Any = {"linestyle": "none", "marker": None if moving.lines else ".", "markersize": 3.0}
    (nodes,) = scene.plot([], [], color=figures.BLACK, **marker)
    for name, along in moving.lines:
        scene.annotate(name, still[along[-1 if name == "P2" else 0]], (4, 6), textcoords="offset points")
    (tip,) = scene.plot([], [], "o", markersize=9.0, zorder=4.0)
    word = scene.text(0.01, 1.0, "", transform=scene.transAxes, va="top")
    cursors = [_strip(axes, name, moving) for axes, name in zip(strips, series, strict=True)]

    def show(k: int) -> None:
        lines.set_segments([drawn[k][along] for _, along in moving.lines])
        nodes.set_data(*drawn[k].T)
        if moving.tip is not None:
            colour, marker = STATES[int(state[k])]
            tip.set(data=drawn[k][moving.tip][:, None], color=colour, marker=marker)
            word.set_text(f"C: {run.STATES[int(state[k])]}")
        for cursor in cursors:
            cursor.set_xdata([k / len(drawn)])

    show(0)
    return figures.finish(figure), show


def _strip(axes: Axes, name: str, moving: Moving) -> Any:
    """A series over time in the colours of the states; returns the cursor."""
    values, time = moving.series[name], np.arange(len(moving.moved)) / len(moving.moved)
    axes.plot(time, values, color=figures.GREY, linewidth=0.6)
    for code, (colour, marker) in STATES.items():
        here = np.where(moving.state == code, values, np.nan)
        axes.plot(time, here, marker, color=colour, markersize=2.0)
    axes.set(ylabel=name.replace(" / ", "\n/ "), xlim=(0.0, 1.0), xticks=[])
    return axes.axvline(0.0, color=figures.RED, linewidth=1.0)


def film(moving: Moving, form: str) -> bytes:
    """A film, `form` gif or mp4; mp4 needs ffmpeg."""
    from matplotlib import animation

    if form == "mp4" and not animation.writers.is_available("ffmpeg"):
        raise InputError("--animate mp4: ffmpeg is not installed; install it, or write --animate gif")
    frames = range(0, len(moving.moved), -(-len(moving.moved) // FILMED))
    kind: Any = animation.PillowWriter if form == "gif" else animation.FFMpegWriter
    writer = kind(fps=len(frames) / moving.loop)
    with figures.style(), TemporaryDirectory() as folder:
        figure, show = draw(moving)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        # The writers know the form by the file's name.
        with writer.saving(figure, file := f"{folder}/film.{form}", 100):
            for k in frames:
                show(k)
                writer.grab_frame()
        return Path(file).read_bytes()


def vtu(moving: Moving, k: int) -> str:
    """A frame as VTK's XML file of an unstructured grid: nodes as drawn, their displacement and its amplitude."""
    place, moved = moving.place + moving.scale * moving.moved[k], moving.moved[k]
    numbered = enumerate((nodes for _, nodes in moving.lines), 1)
    pieces = [np.column_stack([nodes[:-1], nodes[1:], np.full(len(nodes) - 1, n)]) for n, nodes in numbered]
    # Lines of two nodes, which every reader knows; without lines the nodes.
    *nodes, line = np.concatenate(pieces or [np.tile(np.arange(len(place))[:, None], 2)]).T
    at_nodes = [("displacement", "Float64", moved), ("amplitude", "Float64", np.linalg.norm(moved, axis=1))]
    at_nodes += [("state", "Int8", np.full(len(place), moving.state[k]))] if len(moving.state) else []
    parts = {
        "PointData": at_nodes,
        "CellData": [("line", "Int32", line)],
        "Points": [("points", "Float64", place)],
        "Cells": [
            ("connectivity", "Int32", np.ravel(nodes, "F")),
            ("offsets", "Int32", len(nodes) * np.arange(1, len(line) + 1)),
            ("types", "UInt8", np.full(len(line), VTK_TYPES[len(nodes)])),
        ],
    }
    body = "".join(f"<{name}>\n{''.join(_array(*each) for each in own)}</{name}>\n" for name, own in parts.items())
    head = f'<Piece NumberOfPoints="{len(place)}" NumberOfCells="{len(line)}">\n'
    return _vtk("UnstructuredGrid", f"{head}{body}</Piece>\n")


def _array(name: str, kind: str, values: Array) -> str:
    width = f' NumberOfComponents="{values.shape[1]}"' if values.ndim > 1 else ""
    text = " ".join(f"{each:.9g}" for each in values.ravel().tolist())
    return f'<DataArray type="{kind}" Name="{name}"{width} format="ascii">{text}</DataArray>\n'


def pvd(moving: Moving, files: Sequence[str]) -> str:
    """The series of frames: each file and its time, s."""
    step = moving.seconds / len(files)
    lines = [f'<DataSet timestep="{k * step:.9g}" file="{name}"/>\n' for k, name in enumerate(files)]
    return _vtk("Collection", "".join(lines))


def _vtk(kind: str, body: str) -> str:
    head = f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian">'
    return f'<?xml version="1.0"?>\n{head}\n<{kind}>\n{body}</{kind}>\n</VTKFile>\n'
